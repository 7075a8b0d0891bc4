"""Figures that the paper does not have: how good its steps are, what came after, and the forced mass."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.registry import engine
from hcbench.errors import EngineMissing
from hcbench.paper import case
from hcbench.paper.engines import track
from hcbench.paper.pens import BAD, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY
from hcbench.reference import exact, quadratic
from hcbench.reference.approximations import APPROXIMATIONS
from hcbench.reference.blocks import simulate
from hcbench.reference.forced import kelvin_voigt_blocks, linearized, orbits
from hcbench.reference.kelvin_voigt import Ending
from hcbench.reference.later_laws import LAWS
from hcbench.reference.vibroimpact import Sinusoid, VibroImpact
from hcbench.report.style import INK, legend_below, log_axis, new_figure

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hcbench.impact import Floats
    from hcbench.paper.engines import Where

INKS = (BLUE, ORANGE, GREEN, PURPLE, SKY, BAD, "#5b6670", "#3d3d9e", "#9a8a1f", INK)
DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (6, 1.5, 1.2, 1.5)))


@dataclass(frozen=True, slots=True)
class Effort:
    """How much the forced pictures compute: lanes of the bifurcation, its cycles, lanes of the response.

    timestep: of the engines, s, where the mass is clear; a quarter of it where it is squeezed. jobs:
    processes for the bifurcation; they change the time, not the picture.
    """

    values: int
    cycles: int
    kept: int
    response: int
    timestep: float
    jobs: int = 1


FULL = Effort(values=140, cycles=100, kept=30, response=64, timestep=4e-6)
QUICK = Effort(values=6, cycles=6, kept=3, response=6, timestep=2e-5)


def _pen(i: int) -> dict[str, Any]:
    """Colour and dashes of the i-th line."""
    return {"color": INKS[i], "linestyle": DASHES[i % len(DASHES)]}


def approximations_figure() -> Figure:
    """Relative error of every step over α v, log-log, with the lines of 1 % and 10 %."""
    figure = new_figure(7.6, 4.6)
    axes = figure.subplots()
    u = np.geomspace(1e-3, 3.0, 400)
    handles = []
    for i, step in enumerate(APPROXIMATIONS):
        handles += axes.plot(u, np.abs(step.error(u)), **_pen(i), label=f"{step.equation} {step.name}")
    for level in (0.01, 0.1):
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
        u, exact.restitution(1.0, u), color=GREY, linewidth=4.0, alpha=0.6, label="(16), q = 1"
    )
    handles += left.plot(u, quadratic.restitution(1.0, u), color=BLUE, label="q = 2, until x = 0")
    force_reading = quadratic.restitution(1.0, u, Ending.FORCE)
    handles += left.plot(u, force_reading, color=ORANGE, linestyle=DASHES[1], label="q = 2, until F = 0")
    handles += left.plot(u, np.maximum(1.0 - u, 0.0), color=GREEN, linestyle=DASHES[2], label="(2), 1 − α vᵢ")
    left.set_xlabel("α vᵢ")
    left.set_ylabel("restitution e")
    left.set_ylim(0.0, 1.0)
    one, two = case.law(1.0), quadratic.QuadraticDamping(case.STIFFNESS, 1.0, case.MASS)
    loop = exact.loop(one, case.MASS, 0.5)
    right.plot(loop.penetration * 1e6, loop.force, color=GREY, linewidth=4.0, alpha=0.6)
    x, force = _quadratic_loop(two, 0.5)
    right.plot(x * 1e6, force, color=BLUE)
    pulls = force < 0.0
    right.fill_between(x[pulls] * 1e6, force[pulls], color=BAD, alpha=0.4, linewidth=0)
    right.annotate(
        "pulls", (1.5, 0.6 * force.min()), (10.0, 1.1 * force.min()), color=BAD, va="center",
        arrowprops={"arrowstyle": "->", "color": BAD},
    )  # fmt: skip
    right.axhline(0.0, color=INK, linewidth=0.7)
    right.set_xlabel("approach x, µm")
    right.set_ylabel("force F, N")
    right.set_title("α v = 0.5")
    legend_below(figure, handles)
    return figure


def _quadratic_loop(law: quadratic.QuadraticDamping, speed: float) -> tuple[Floats, Floats]:
    """Force over penetration of q = 2 by its closed path: v² is exponential plus linear in x^((n+1)/2)."""
    n1 = law.exponent + 1.0
    b, kappa = 4.0 * law.factor / (law.mass * n1), 4.0 * law.stiffness / (law.mass * n1)
    z = float(quadratic.turning_point(law.alpha * speed))
    # F starts with x^(1/4): points crowd towards both ends of the loop.
    theta = np.linspace(0.0, 1.0, 401)
    theta = np.pi * theta**4 / (theta**4 + (1.0 - theta) ** 4)
    s = z * np.sin(theta)  # b y
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
        pen = {**_pen(i), "label": name}
        if name == "exact":
            pen |= {"linewidth": 3.2, "alpha": 0.5, "linestyle": "-"}
        handles += left.plot(asked, law.delivered(asked), **pen)
        right.plot(asked, law.delivered(asked) - asked, **pen)
    left.set_xlabel("restitution asked for")
    left.set_ylabel("restitution delivered")
    right.set_xlabel("restitution asked for")
    right.set_ylabel("delivered less asked")
    right.set_ylim(-0.1, 0.3)
    legend_below(figure, handles)
    return figure


def _steel(gap: float) -> VibroImpact:
    law = case.law(case.ALPHAS[-1])
    return VibroImpact(case.MASS, gap, law, law)


SQUEEZED, FORCES = _steel(-1e-5), (4.0, 120.0, 400.0)
LOOSE, PUSH = _steel(1.5e-3), 150.0
STAND_IN_SPEED = 0.4


def response_figure(effort: Effort) -> Figure:
    """Amplitude over force and frequency of the squeezed mass, against the linearised one."""
    linear = linearized(SQUEEZED)
    f = np.linspace(0.4, 1.7, effort.response) * linear.resonance
    figure = new_figure(7.6, 4.0)
    axes = figure.subplots()
    fine = np.linspace(f[0], f[-1], 400)
    pen: dict[str, Any] = {"color": GREY, "linewidth": 4.0, "alpha": 0.6, "label": "linearised"}
    handles = axes.plot(fine / 1e3, linear.amplitude(1.0, fine) * 1e9, **pen)
    cycles = max(8, effort.cycles // 2)
    for i, force in enumerate(FORCES):
        run = orbits(SQUEEZED, Sinusoid(force, 1.0), "frequency", f, cycles, max(2, cycles // 4))
        label = f"(16), {force:g} N"
        handles += axes.plot(
            f / 1e3, run.amplitude / force * 1e9, color=INKS[i], linestyle=DASHES[i], label=label
        )
    axes.set_ylim(0.0)
    axes.set_xlabel("frequency, kHz")
    axes.set_ylabel("amplitude over force, nm/N")
    legend_below(figure, handles)
    return figure


def _installed() -> Iterator[str]:
    for name in ("mujoco", "pybullet"):
        with suppress(EngineMissing):
            engine(name).version()
            yield name


def engines_figure(effort: Effort) -> Figure:
    """The clear and the squeezed mass in the engines that are installed, over the reference."""
    figure = new_figure(8.6, 4.2)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    broad: dict[str, Any] = {"color": GREY, "linewidth": 4.5, "alpha": 0.55, "label": "reference, eq. (16)"}
    drive = Sinusoid(PUSH, 90.0)
    truth = simulate(LOOSE, 0.0, 0.1, 0.03, drive, step_max=1e-4)
    handles = left.plot(truth.time * 1e3, truth.position * 1e3, **broad)
    runs: tuple[tuple[Where, float | None, str], ...] = (
        ("mujoco", None, "MuJoCo plug-in"),
        ("pybullet", None, "PyBullet plug-in"),
        ("mujoco", STAND_IN_SPEED, "MuJoCo spring-damper"),
        ("pybullet", STAND_IN_SPEED, "PyBullet restitution"),
    )
    there = set(_installed())
    for i, (where, native_at, name) in enumerate(runs):
        if where in there:
            run = track(where, LOOSE, 0.0, 0.1, 0.03, drive, timestep=effort.timestep, native_at=native_at)
            handles += left.plot(run.time * 1e3, run.position * 1e3, **_pen(i), label=name, linewidth=1.2)
    left.set_xlabel("time, ms")
    left.set_ylabel("position, mm")
    left.set_title("gap 1.5 mm")
    f, last = 3e3, 12
    hard = Sinusoid(1200.0, f)
    truth = simulate(SQUEEZED, 0.0, 0.0, last / f, hard, step_max=0.01 / f).during((last - 1) / f, last / f)
    right.plot(truth.position * 1e6, truth.resultant, **broad)
    for i, (where, native_at, _) in enumerate(runs[:3]):
        if where in there:
            step = 0.25 * effort.timestep
            run = track(where, SQUEEZED, 0.0, 0.0, last / f, hard, timestep=step, native_at=native_at)
            part = run.time >= (last - 1) / f
            right.plot(run.position[part] * 1e6, run.resultant[part], **_pen(i), linewidth=1.2)
    right.set_xlabel("position, µm")
    right.set_ylabel("force against it, N")
    right.set_title("squeezed by 5 µm")
    legend_below(figure, handles)
    return figure


def bifurcation_figure(effort: Effort) -> Figure:
    """Velocity once a cycle over the drive's frequency, for (16) and for its piecewise linear stand-in."""
    figure = new_figure(8.6, 6.0)
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    f = np.linspace(60.0, 120.0, effort.values)
    stand_in = kelvin_voigt_blocks(LOOSE, STAND_IN_SPEED)
    title = f"spring and damper (4), same e and contact time at {STAND_IN_SPEED:g} m/s"
    pictures = ((LOOSE, BLUE, "eq. (16)"), (stand_in, ORANGE, title))
    for axes, (system, colour, name) in zip(panels, pictures, strict=True):
        run = orbits(
            system, Sinusoid(PUSH, 1.0), "frequency", f, effort.cycles, effort.kept, jobs=effort.jobs
        )
        _dots(axes, np.repeat(f, effort.kept), run.velocity.ravel(), colour)
        axes.set_title(name)
        axes.set_ylabel("velocity once a cycle, m/s")
    panels[1].set_xlabel("frequency of the drive, Hz")
    return figure


def _dots(axes: Axes, x: Floats, y: Floats, colour: str) -> None:
    """Thousands of dots as one line of round ends: a tenth of the bytes that markers take."""
    nowhere = np.full_like(x, np.nan)
    tiny = 5e-4 * float(np.ptp(x))  # a line of no length is not drawn
    ends = np.stack([x - tiny, x + tiny, nowhere], axis=1).ravel(), np.stack([y, y, nowhere], axis=1).ravel()
    axes.plot(*ends, color=colour, linewidth=1.5, solid_capstyle="round")
