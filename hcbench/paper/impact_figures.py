"""Figures of single impacts: the paper's own, and those of the text that followed it."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hcbench.laws import closed_form
from hcbench.laws import kelvin_voigt as kv
from hcbench.laws.force import HuntCrossley
from hcbench.laws.kelvin_voigt import Ending
from hcbench.laws.published import LAWS
from hcbench.paper import approximations, constants
from hcbench.paper.approximations import APPROXIMATIONS
from hcbench.reporting.plot_style import (
    BLUE,
    DASHES,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    RED,
    legend_below,
    log_axis,
    new_figure,
    numbered_line,
    second_axis,
)
from hcbench.terms.impact import Floats
from hcbench.terms.units import INCH, POUND_FORCE

# Figs. 1 to 4: one impact.

# α v of the sketches: a loss large enough to be seen.
SKETCH_ALPHA_SPEED = 0.5
LOOP_COLOURS = (GREEN, BLUE, ORANGE, PURPLE)


def name_axes(axes: Axes, x: str, y: str, ticks: bool = False) -> None:
    """Names of a sketch's axes, and numbers only where they mean something."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if not ticks:
        axes.set_xticks([])
        axes.set_yticks([])


def _mark_point(axes: Axes, letter: str, x: float, y: float, dx: float, dy: float) -> None:
    """A letter beside a point; dx, dy in points."""
    axes.plot([x], [y], marker="o", markersize=3.0, color=INK, linestyle="none", clip_on=False)
    axes.annotate(
        letter, (x, y), (dx, dy), textcoords="offset points", fontsize=9.5, annotation_clip=False
    )


def _mark_depth(axes: Axes, x: float) -> None:
    """A dashed line down from the end of a loop, with its name below."""
    axes.axvline(x, ymax=0.9, color=INK, linewidth=0.7, linestyle=(0, (3, 2)))
    axes.annotate("xₘ", (x, 0.0), (3, 3), textcoords="offset points", fontsize=9.5)


def figure_1() -> tuple[Figure, str]:
    """Figure 1: force over penetration of one impact of a spring and damper, eq. (4), and of the
    law, eq. (16), with the same restitution and contact time. Also, in words for the caption, the e
    of (4) if contact ends as soon as the force does.
    """
    law = HuntCrossley(1.0, SKETCH_ALPHA_SPEED)
    mass = 1.0
    e = float(closed_form.restitution(law.alpha, 1.0))
    time = float(closed_form.duration(law, mass, 1.0))
    linear = kv.matched(e, time, mass, kv.Ending.SURFACE)
    a = kv.loop(linear, mass, 1.0, kv.Ending.SURFACE)
    b = closed_form.loop(law, mass, 1.0)
    figure = new_figure(8.4, 3.5)
    left, right = figure.subplots(1, 2, sharey=True)
    left.plot(a.penetration, a.force, color=ORANGE)
    pull = a.force < 0.0
    left.fill_between(a.penetration[pull], a.force[pull], 0.0, color=RED, alpha=0.25, linewidth=0)
    spring = np.array([0.0, a.penetration.max()])
    left.plot(spring, linear.stiffness * spring, color=GREY, linewidth=1.0, linestyle=(0, (4, 2)))
    # Force at first touch, all of it the damper's, and the deepest point.
    shock = a.force[0]
    top = int(a.penetration.argmax())
    # Penetration at which the force is 0; reversed, as `interp` takes forces that rise.
    crossing = float(np.interp(0.0, a.force[top:][::-1], a.penetration[top:][::-1]))
    for letter, x, y, dx, dy in (
        ("O", 0.0, 0.0, -13, 4), ("A", 0.0, shock, -12, -3), ("B", a.penetration[top], a.force[top], 5, 2),
        ("C", crossing, 0.0, 3, -11), ("D", 0.0, a.force[-1], -12, -3),
    ):  # fmt: skip
        _mark_point(left, letter, x, y, dx, dy)
    left.annotate(
        "shock c vᵢ",
        (0.0, shock),
        (0.02, 2.1 * shock),
        arrowprops={"arrowstyle": "->", "color": INK},
    )
    low = (a.penetration[pull].mean(), 0.6 * a.force.min())
    left.annotate(
        "pulls",
        low,
        (0.5, 1.1 * a.force.min()),
        color=RED,
        arrowprops={"arrowstyle": "->", "color": RED},
    )
    left.set_title("(a) Kelvin-Voigt, eq. (4)")
    elastic = np.linspace(0.0, b.penetration.max(), 60)
    right.plot(elastic, elastic**1.5, color=GREY, linewidth=1.0, linestyle=(0, (4, 2)))
    right.plot(b.penetration, b.force, color=BLUE)
    right.fill_between(b.penetration, b.force, color=BLUE, alpha=0.12, linewidth=0)
    right.set_title("(b) Hunt-Crossley, eq. (16)")
    for axes, depth in ((left, a.penetration.max()), (right, b.penetration.max())):
        axes.axhline(0.0, color=INK, linewidth=0.8)
        _mark_depth(axes, depth)
        name_axes(axes, "approach x", "force F")
    early = float(kv.restitution(kv.damping_ratio(linear, mass), kv.Ending.FORCE))
    return (
        figure,
        f" Contact that ends at C, where F = 0, makes the restitution of (a) {early:.3f}.",
    )


def figure_2() -> Figure:
    """Figure 2: the elastic law F = k x^n for four n, with the energy under it and the speed over
    the approach, eqs. (7), (8) and (10); all as shares of their largest.
    """
    figure = new_figure(6.4, 3.2)
    axes: Axes = figure.subplots()
    x = np.linspace(0.0, 1.0, 200)
    for n, colour in ((1.0, GREY), (1.25, GREEN), (1.5, BLUE), (2.0, PURPLE)):
        linewidth = 2.2 if n == 1.5 else 1.3
        axes.plot(x, x**n, color=colour, linewidth=linewidth, label=f"n = {n:g}")
    axes.fill_between(x, x**1.5, color=BLUE, alpha=0.12, linewidth=0)
    axes.text(0.72, 0.2, "½ m vᵢ²", color=BLUE, ha="center")
    axes.plot([1.0, 1.0], [0.0, 1.0], color=INK, linewidth=0.8, linestyle=(0, (3, 2)))
    speed = axes.twinx()
    for spine in speed.spines.values():
        spine.set_visible(False)
    # With this stiffness, mass and depth the impact speed is 1.
    speed.plot(
        x, approximations.speed_at(1.25, 1.0, 1.5, 1.0, x), color=ORANGE, linestyle=(0, (5, 2))
    )
    speed.set_yticks([])
    speed.set_ylim(0.0, 1.25)
    axes.set_ylim(0.0, 1.25)
    axes.text(0.03, 1.03, "v/vᵢ of eq. (10), n = 3/2", color=ORANGE, fontsize=8.5)
    axes.legend(loc="center left", bbox_to_anchor=(0.0, 0.62), fontsize=8.5)
    name_axes(axes, "approach x/xₘ", "force F/(k xₘⁿ)", ticks=True)
    return figure


def figure_3() -> Figure:
    """Figure 3: force over penetration of the law (16), with the elastic law and the energy lost on
    the way in and out, the two halves that eq. (12) takes as equal.
    """
    law = HuntCrossley(1.0, SKETCH_ALPHA_SPEED)
    loop = closed_form.loop(law, 1.0, 1.0)
    depth = loop.penetration.max()
    middle = loop.penetration**1.5
    figure = new_figure(6.4, 3.4)
    axes: Axes = figure.subplots()
    inward = loop.rate >= 0.0
    axes.fill_between(
        loop.penetration[inward],
        loop.force[inward],
        middle[inward],
        color=ORANGE,
        alpha=0.28,
        linewidth=0,
    )
    axes.fill_between(
        loop.penetration[~inward],
        middle[~inward],
        loop.force[~inward],
        color=GREEN,
        alpha=0.28,
        linewidth=0,
    )
    axes.plot(loop.penetration, loop.force, color=BLUE)
    elastic = np.linspace(0.0, depth, 100)
    axes.plot(elastic, elastic**1.5, color=GREY, linestyle=(0, (4, 2)), linewidth=1.0)
    # Of the energy lost, and heights of the loop to which the words point.
    share = float(approximations.inward_share(SKETCH_ALPHA_SPEED))
    at = float(np.interp(0.55 * depth, loop.penetration[inward], loop.force[inward]))
    axes.annotate(
        f"way in: {100 * share:.0f} % of ΔE", (0.55 * depth, 0.5 * (at + (0.55 * depth) ** 1.5)), (0.1, 0.78),
        color=ORANGE, arrowprops={"arrowstyle": "->", "color": ORANGE},
    )  # fmt: skip
    back = float(np.interp(-0.75 * depth, -loop.penetration[~inward], loop.force[~inward]))
    axes.annotate(
        f"way out: {100 * (1 - share):.0f} %",
        (0.75 * depth, 0.5 * (back + (0.75 * depth) ** 1.5)), (0.6, 0.06),
        color=GREEN, arrowprops={"arrowstyle": "->", "color": GREEN},
    )  # fmt: skip
    _mark_depth(axes, depth)
    name_axes(axes, "approach x", "force F")
    return figure


def figure_4() -> Figure:
    """Figure 4: loops of force, lb, over penetration, in, of the steel body of section 3.1 at 4, 8,
    12 and 16 in/s, a panel for each of the four α of section 3.2.
    """
    figure = new_figure(8.6, 7.2)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    limit = 600.0
    for axes, alpha in zip(panels.flat, constants.ALPHAS, strict=True):
        handles = []
        for speed, colour in zip(constants.SPEEDS, LOOP_COLOURS, strict=True):
            loop = closed_form.loop(constants.law(alpha), constants.MASS, speed)
            x = loop.penetration / INCH * 1e3
            force = loop.force / POUND_FORCE
            handles += axes.plot(
                x, force, color=colour, linewidth=1.4, label=f"{speed / INCH:.0f} in/s"
            )
        axes.axhline(limit, color=RED, linewidth=0.9, linestyle=(0, (4, 2)))
        axes.set_title(f"α = {alpha * INCH:.3f} s/in")
        axes.set_xlim(0.0, 1.06)
        axes.set_ylim(0.0, 1000.0)
    panels[0, 0].text(0.02, limit + 10, "600 lb: largest allowed", color=RED, fontsize=8.5)
    for axes in panels[1]:
        axes.set_xlabel("approach x, 10⁻³ in")
    for axes in panels[:, 0]:
        axes.set_ylabel("force F, lb")
    for axes in panels[0]:
        second_axis(axes, "top", "µm", 1.0 / 25.4)
    for axes in panels[:, 1]:
        second_axis(axes, "right", "N", 1.0 / POUND_FORCE)
    legend_below(figure, handles)
    return figure


# Figures that the paper does not have: how good its steps are, and what came after.

# Errors of e that the figure marks.
LEVELS = (0.01, 0.1)


def approximations_figure() -> Figure:
    """Relative error of each approximation of the paper over α v, log-log, with the lines of 1 %
    and 10 %.
    """
    figure = new_figure(7.6, 4.6)
    axes = figure.subplots()
    u = np.geomspace(1e-3, 3.0, 400)
    handles = []
    for i, step in enumerate(APPROXIMATIONS):
        handles += axes.plot(
            u, np.abs(step.error(u)), **numbered_line(i), label=f"{step.equation} {step.name}"
        )
        for level in LEVELS:
            if (at := step.reaches(level)) < u[-1]:
                axes.plot([at], [level], "o", color=numbered_line(i)["color"], markersize=4.5)
    for level in LEVELS:
        axes.axhline(level, color=GREY, linewidth=0.8)
        axes.text(3.1, level, f"{100 * level:g} %", va="center", fontsize=8.5)
    # From its least to its largest α v, s/in times in/s.
    axes.axvspan(0.002 * 4, 0.016 * 16, color=GREY, alpha=0.12, linewidth=0)
    axes.text(0.0085, 1.5e-6, "the paper's own loops", fontsize=8.5, color=INK)
    log_axis(axes, "x")
    log_axis(axes, "y")
    axes.set_xlim(1e-3, 3.0)
    axes.set_ylim(1e-6, 2.0)
    axes.set_xlabel("α vᵢ")
    axes.set_ylabel("relative error")
    legend_below(figure, handles)
    return figure


def quadratic_figure() -> Figure:
    """Restitution over α v of the q = 2 variant, whose damping grows with v², against (16) and (2),
    and its loop at α v = 0.5 beside that of (16).
    """
    figure = new_figure(8.4, 3.6)
    left, right = figure.subplots(1, 2)
    u = np.linspace(0.0, 1.5, 300)
    handles = left.plot(
        u,
        closed_form.restitution(1.0, u),
        color=GREY,
        linewidth=4.0,
        alpha=0.6,
        label="(16), q = 1",
    )
    handles += left.plot(
        u, approximations.quadratic_restitution(1.0, u), color=BLUE, label="q = 2, until x = 0"
    )
    force_reading = approximations.quadratic_restitution(1.0, u, Ending.FORCE)
    handles += left.plot(
        u, force_reading, color=ORANGE, linestyle=DASHES[1], label="q = 2, until F = 0"
    )
    handles += left.plot(
        u, np.maximum(1.0 - u, 0.0), color=GREEN, linestyle=DASHES[4], label="(2), 1 − α vᵢ"
    )
    left.set_xlabel("α vᵢ")
    left.set_ylabel("restitution e")
    left.set_ylim(0.0, 1.0)
    one = constants.law(1.0)
    two = approximations.QuadraticDamping(constants.STIFFNESS, 1.0, constants.MASS)
    loop = closed_form.loop(one, constants.MASS, 0.5)
    right.plot(loop.penetration * 1e6, loop.force, color=GREY, linewidth=4.0, alpha=0.6)
    x, force = _quadratic_loop(two, 0.5)
    right.plot(x * 1e6, force, color=BLUE)
    # The way out, in the order of rising x.
    out = slice(None, int(x.argmax()) - 1, -1)
    pulls: dict[str, Any] = {"where": force[out] < 0.0, "interpolate": True, "linewidth": 0}
    right.fill_between(x[out] * 1e6, force[out], color=RED, alpha=0.4, **pulls)
    right.annotate(
        "pulls", (1.5, 0.6 * force.min()), (10.0, 1.1 * force.min()), color=RED, va="center",
        arrowprops={"arrowstyle": "->", "color": RED},
    )  # fmt: skip
    right.axhline(0.0, color=INK, linewidth=0.7)
    right.set_xlabel("approach x, µm")
    right.set_ylabel("force F, N")
    right.set_title("α v = 0.5")
    legend_below(figure, handles)
    return figure


def _quadratic_loop(law: approximations.QuadraticDamping, speed: float) -> tuple[Floats, Floats]:
    """Penetration, m, and force, N, of one loop with q = 2, shape (401,) each.

    Its path is known in closed form: v² is exponential plus linear in x^((n+1)/2). Points rise from
    the surface to the turning point, the first half, and go back.

    speed: impact speed, m/s.
    """
    n1 = law.exponent + 1.0
    b = 4.0 * law.factor / (law.mass * n1)
    kappa = 4.0 * law.stiffness / (law.mass * n1)
    z = float(approximations.turning_point(law.alpha * speed))
    # F starts with x^(1/4): points crowd towards both ends of the loop.
    theta = np.linspace(0.0, 1.0, 401)
    theta = np.pi * theta**4 / (theta**4 + (1.0 - theta) ** 4)
    # b y, where y = x^((n+1)/2): v² is linear in y plus an exponential of it.
    s = z * np.sin(theta)
    scale = kappa / b**2
    inward = (speed**2 - scale) * np.exp(-s) - scale * (s - 1.0)
    outward = scale * ((s + 1.0) - (z + 1.0) * np.exp(s - z))
    going_in = theta < np.pi / 2
    square = np.where(going_in, inward, outward)
    v = np.where(going_in, 1.0, -1.0) * np.sqrt(np.maximum(square, 0.0))
    x = (s / b) ** (2.0 / n1)
    return x, law.force(x, v)


def later_laws_figure() -> Figure:
    """Restitution that every law published since delivers over the one that it is set to, and the
    difference of the two, a line each.
    """
    figure = new_figure(8.4, 4.4)
    left, right = figure.subplots(1, 2)
    asked = np.linspace(0.02, 1.0, 300)
    handles = []
    for i, (name, law) in enumerate(LAWS.items()):
        line = {**numbered_line(i), "label": name}
        if name == "exact":
            line |= {"linewidth": 3.2, "alpha": 0.5, "linestyle": "-"}
        handles += left.plot(asked, law.delivered(asked), **line)
        right.plot(asked, law.delivered(asked) - asked, **line)
    left.set_xlabel("target restitution")
    left.set_ylabel("restitution delivered")
    right.set_xlabel("target restitution")
    right.set_ylabel("delivered e - target")
    right.set_ylim(-0.1, 0.3)
    legend_below(figure, handles)
    return figure
