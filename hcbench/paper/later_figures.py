"""Figures that the paper does not have: how good its steps are, and what came after."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hcbench.laws import closed_form, quadratic
from hcbench.laws.kelvin_voigt import Ending
from hcbench.laws.published import LAWS
from hcbench.paper import constants
from hcbench.paper.approximations import APPROXIMATIONS
from hcbench.reporting.plot_style import (
    BLUE,
    DASHES,
    GREEN,
    GREY,
    INK,
    ORANGE,
    RED,
    legend_below,
    log_axis,
    new_figure,
    numbered_line,
)
from hcbench.terms.impact import Floats

# Errors of e that the figure marks.
LEVELS = (0.01, 0.1)


def approximations_figure() -> Figure:
    """Relative error of every step over α v, log-log, with the lines of 1 % and 10 %."""
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
    """Restitution of the q = 2 variant against (16) and (2), and its loop beside that of (16)."""
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
    handles += left.plot(u, quadratic.restitution(1.0, u), color=BLUE, label="q = 2, until x = 0")
    force_reading = quadratic.restitution(1.0, u, Ending.FORCE)
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
    two = quadratic.QuadraticDamping(constants.STIFFNESS, 1.0, constants.MASS)
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


def _quadratic_loop(law: quadratic.QuadraticDamping, speed: float) -> tuple[Floats, Floats]:
    """Penetration, m, and force, N, of one loop with q = 2, shape (401,) each.

    Its path is closed: v² is exponential plus linear in x^((n+1)/2).

    speed: impact speed, m/s.
    """
    n1 = law.exponent + 1.0
    b = 4.0 * law.factor / (law.mass * n1)
    kappa = 4.0 * law.stiffness / (law.mass * n1)
    z = float(quadratic.turning_point(law.alpha * speed))
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
    """Restitution delivered less asked over asked, for every law."""
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
