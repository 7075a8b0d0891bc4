"""Figs. 5 to 9: a mass between two blocks."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hcbench.laws import kelvin_voigt as kv
from hcbench.laws.force import HuntCrossley, KelvinVoigt
from hcbench.paper.impact_figures import name_axes
from hcbench.paper.vibroimpact.response import linearized
from hcbench.paper.vibroimpact.simulate import simulate
from hcbench.paper.vibroimpact.system import SimulatedMotion, Sinusoid, VibroImpact
from hcbench.reporting.plot_style import BLUE, GREEN, GREY, INK, ORANGE, new_figure
from hcbench.terms.impact import Floats

# Sketches in units of their own, k = m = 1, with a loss large enough to be seen.
ALPHA = 0.35
FLAT = HuntCrossley(1.0, ALPHA, 1.0)
HERTZ = HuntCrossley(1.0, ALPHA)
SOFT = HuntCrossley(1.0, 0.15)


def _frame(axes: Axes) -> None:
    axes.axhline(0.0, color=INK, linewidth=0.7)
    axes.axvline(0.0, color=INK, linewidth=0.7)
    name_axes(axes, "position q", "force against q")


def figure_5() -> Figure:
    """Force over position of an elastic mass with a gap, without, and fastened to a spring."""
    figure = new_figure(8.6, 2.9)
    panels = figure.subplots(1, 3, sharey=True)
    q = np.linspace(-1.6, 1.6, 401)
    spring = HuntCrossley(1.0, 0.0, 1.0)
    for axes, gap, title in zip(
        panels, (1.2, 0.0, 0.0), ("(a) gap g", "(b) gap 0", "(c) fastened"), strict=True
    ):
        system = VibroImpact(1.0, gap, spring, spring)
        axes.plot(q, system.resultant(q, 0.0), color=BLUE)
        axes.set_title(title)
        _frame(axes)
    for x in (-0.6, 0.6):
        panels[0].plot([x, x], [-0.12, 0.12], color=INK, linewidth=0.8)
    for x in (-0.3, 0.3):
        panels[0].text(x, -0.42, "½ g", ha="center", fontsize=9)
    for axes, right, left in zip(
        panels,
        ("block\npresses", "block\npresses", "spring\npresses"),
        ("block\npresses", "block\npresses", "spring\npulls"),
        strict=True,
    ):
        axes.text(1.6, -0.12, right, ha="right", fontsize=8.5, color=GREEN, va="top")
        axes.text(-1.6, 0.12, left, fontsize=8.5, color=ORANGE, va="bottom")
    return figure


def figure_6() -> Figure:
    """Free vibration of the fastened mass, eq. (4): one thin loop that shrinks exponentially."""
    law = KelvinVoigt(1.0, 0.08)
    time = np.linspace(0.0, 8.0 * np.pi, 1600)
    x, v = kv.state(law, 1.0, 1.0, time)
    figure = new_figure(6.4, 3.4)
    axes: Axes = figure.subplots()
    axes.plot(x, law.force(x, v), color=BLUE, linewidth=1.2)
    axes.plot([-1.0, 1.0], [-1.0, 1.0], color=GREY, linewidth=0.9, linestyle=(0, (4, 2)))
    _frame(axes)
    return figure


def _cycle(system: VibroImpact, velocity: float) -> SimulatedMotion:
    """One cycle of free motion from the middle."""
    run = simulate(system, 0.0, velocity, 10.0, step_max=0.03)
    forward = (run.position[1:] >= 0.0) & (run.position[:-1] < 0.0)
    return run.during(0.0, float(run.time[int(np.flatnonzero(forward)[0]) + 1]))


def figure_7() -> Figure:
    """No gap: two half loops that meet at the origin, for flat contacts
    as in the paper and for spheres.
    """
    figure = new_figure(8.4, 3.3)
    panels = figure.subplots(1, 2)
    for axes, law in zip(panels, (FLAT, HERTZ), strict=True):
        run = _cycle(VibroImpact(1.0, 0.0, law, law), 1.0)
        axes.plot(run.position, run.resultant, color=BLUE)
        axes.fill_between(run.position, run.resultant, color=BLUE, alpha=0.08, linewidth=0)
        axes.set_title(f"n = {law.exponent:g}")
        _frame(axes)
    return figure


# ½ |g| of Figs. 8 and 9.
SQUEEZE = 1.0
# Cycles of the drive until the motion has settled.
SETTLED = 12


def _overlap(force: float) -> tuple[Figure, SimulatedMotion, VibroImpact]:
    """The two loops of a squeezed mass and their sum, settled under a drive near its resonance."""
    system = VibroImpact(1.0, -2.0 * SQUEEZE, SOFT, SOFT)
    f = linearized(system).resonance
    whole_run = simulate(
        system, 0.0, 0.0, SETTLED / f, Sinusoid(force, f), tolerance=1e-9, step_max=0.008 / f
    )
    run = whole_run.during((SETTLED - 1.0) / f, SETTLED / f)
    figure = new_figure(8.4, 3.6)
    parts, whole = figure.subplots(1, 2, sharex=True)
    q = run.position
    parts.plot(q, run.right, color=GREEN)
    parts.plot(q, -run.left, color=ORANGE)
    parts.text(0.98 * q.max(), 0.3 * run.right.max(), "right", color=GREEN, ha="right", fontsize=9)
    parts.text(q.min(), -0.5 * run.left.max(), "left", color=ORANGE, fontsize=9)
    parts.set_title("(a) both blocks")
    whole.plot(q, run.resultant, color=BLUE)
    if not run.events:
        whole.plot(*_ellipse(system, run, f), color=ORANGE, linestyle=(0, (4, 3)), linewidth=1.6)
    whole.set_title("(b) their sum")
    for axes in (parts, whole):
        _frame(axes)
        if run.events:
            for x in (-SQUEEZE, SQUEEZE):
                axes.axvline(x, color=GREY, linewidth=0.8, linestyle=(0, (2, 2)))
    return figure, run, system


def _ellipse(system: VibroImpact, run: SimulatedMotion, frequency: float) -> tuple[Floats, Floats]:
    """Position and force of the linearised mass over one cycle: a Kelvin-Voigt ellipse, shape
    (200,) each.

    frequency: Hz. The amplitude is that of the run.
    """
    linear = linearized(system)
    amplitude = 0.5 * float(np.ptp(run.position))
    theta = np.linspace(0.0, 2.0 * np.pi, 200)
    q = amplitude * np.sin(theta)
    v = amplitude * 2.0 * np.pi * frequency * np.cos(theta)
    return q, linear.stiffness * q + linear.damping * v


def figure_8() -> Figure:
    """Squeezed, with impacts: the two loops overlap and add up."""
    return _overlap(1.6)[0]


def figure_9() -> tuple[Figure, str]:
    """Squeezed, no impact: the sum is nearly the ellipse of Kelvin and
    Voigt; and, in words, how nearly.
    """
    figure, run, system = _overlap(0.3)
    linear = linearized(system)
    off = run.resultant - linear.stiffness * run.position - linear.damping * run.velocity
    swing = float(np.abs(run.position).max()) / system.squeeze
    share = float(np.abs(off).max() / np.abs(run.resultant).max())
    return figure, f" Here, at {swing:.2f} of ½ |g|, by {100 * share:.1f} % of the largest force."
