"""Figures of forced motion against a stop, and the same motion in engines: the scene `two-blocks`."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import cycle, product
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hcbench.laws import kelvin_voigt as kv
from hcbench.laws.force import HuntCrossley, KelvinVoigt
from hcbench.paper import constants
from hcbench.paper.impact_figures import name_axes
from hcbench.paper.vibroimpact.response import kelvin_voigt_blocks, linearized, orbits
from hcbench.paper.vibroimpact.simulate import simulate
from hcbench.paper.vibroimpact.system import SimulatedMotion, Sinusoid, VibroImpact
from hcbench.reporting.plot_style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    legend_below,
    new_figure,
    numbered_line,
)
from hcbench.reporting.wording import engine_title
from hcbench.sim import registry
from hcbench.sim.remote import interpreter_of
from hcbench.sim.two_blocks import TwoBlocks
from hcbench.system.errors import EngineMissing
from hcbench.terms.bounds import positive, require
from hcbench.terms.impact import Floats
from hcbench.workers import call

if TYPE_CHECKING:
    from hcbench.paper.vibroimpact.system import Sinusoid, VibroImpact
    from hcbench.terms.impact import Floats


# The mass between two blocks inside the engines, to be laid over the reference: the scene `two-
# blocks`.
#
# Contact is either the engine's plug-in, which is eq. (16) itself, or the best that the engine
# has of its own, tuned at one speed. The engines run in a process of their own.

# Processor time of one simulation, s: an engine that runs longer counts as hung.
LIMIT = 120.0


@dataclass(frozen=True, slots=True)
class EngineTrajectory:
    """Motion of an engine's mass at the ends of steps, arrays of shape (n,): s, m, m/s, N.

    resultant: what the blocks did against the position, by the change of speed; P taken off.
    """

    time: Floats
    position: Floats
    velocity: Floats
    resultant: Floats

    def since(self, start: float) -> EngineTrajectory:
        """The part with time >= start, s."""
        keep = self.time >= start
        return EngineTrajectory(
            self.time[keep], self.position[keep], self.velocity[keep], self.resultant[keep]
        )


def engines_with_two_blocks() -> list[str]:
    """Names of the engines that can simulate the scene, whether they are installed or not."""
    return [name for name in registry.names() if registry.submodule(name, "two_blocks") is not None]


def simulate_in_engine(
    name: str,
    system: VibroImpact,
    position: float,
    velocity: float,
    until: float,
    drive: Sinusoid | None = None,
    *,
    timestep: float = 1e-5,
    tuned_at: float | None = None,
) -> EngineTrajectory:
    """Simulate a system in an engine, from t = 0 on.

    name: of the engine, one of `engines_with_two_blocks`.
    system: both its blocks must have the same law (16).
    position, velocity: at the start, m and m/s; `VibroImpact` has the signs.
    until: duration, s.
    timestep: s.
    drive: P, N; None: the mass is free.
    tuned_at: speed, m/s, at which the engine's own contact is tuned; None: its plug-in is used.

    Raises UserError for a system that an engine cannot have and for numbers that are not above 0,
    EngineMissing, and EngineFailed where the engine crashes or passes LIMIT.

    The drive is leapfrog, so of second order: engines do v += h P/m, then q += h v. With P of the
    step's start, and the first velocity half a step behind, velocities are those half a step before
    the positions; the velocity at a step's end is the mean of its neighbours.
    """
    law = system.right
    alike = isinstance(law, HuntCrossley) and law == system.left
    require("laws", (system.right, system.left), alike, "the same law (16) on both sides")
    assert isinstance(law, HuntCrossley)
    positive("timestep", timestep, "s")
    positive("until", until, "s")
    if tuned_at is not None:
        positive("tuned_at", tuned_at, "m/s")
    engine = registry.engine(name)
    # Raises EngineMissing before the simulation starts.
    engine.version()
    count = math.ceil(until / timestep) + 1
    forces = np.zeros(count)
    if drive is not None:
        forces[:] = [drive(i * timestep) for i in range(count)]
    # Half a step before the position, see above.
    start = velocity - 0.5 * timestep * float(forces[0]) / system.mass
    blocks = TwoBlocks(system.mass, system.gap, law, timestep, tuned_at)
    where = interpreter_of(engine)
    positions, velocities = call(
        _simulate, name, blocks, position, start, forces, limit=LIMIT, at=where
    )
    return EngineTrajectory(
        time=np.asarray(np.arange(count) * timestep, dtype=np.float64),
        position=positions[:-1],
        velocity=np.asarray(0.5 * (velocities[:-1] + velocities[1:])),
        resultant=forces - system.mass * np.diff(velocities) / timestep,
    )


def _simulate(
    name: str, blocks: TwoBlocks, position: float, velocity: float, forces: Floats
) -> tuple[Floats, Floats]:
    """(positions, m; velocities, m/s) of the ball between two blocks, shape (n + 1,) each, in the
    worker process of an engine.

    name: of the engine. position, m, velocity, m/s: at the start.
    forces: on the ball in each step, N, shape (n,).
    """
    states: tuple[Floats, Floats]
    states = registry.submodule(name, "two_blocks").simulate(blocks, position, velocity, forces)
    return states


# Figs. 5 to 9: a mass between two blocks.

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
    """Figure 5: force over position of an elastic mass between two blocks with a gap, without one,
    and fastened to a spring.
    """
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
    """Figure 6: force over position in free vibration of a mass that is fastened to a spring and
    damper, eq. (4): one thin loop that shrinks exponentially.
    """
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
    """One cycle of free motion from the middle: until it is crossed in the same direction again.

    velocity: at the start, above 0. All numbers are in the sketch's own units, of which a cycle
    takes less than 10.
    """
    run = simulate(system, 0.0, velocity, 10.0, step_max=0.03)
    forward = (run.position[1:] >= 0.0) & (run.position[:-1] < 0.0)
    return run.during(0.0, float(run.time[int(np.flatnonzero(forward)[0]) + 1]))


def figure_7() -> Figure:
    """Figure 7: force over position of a mass between two blocks without a gap: two half loops that
    meet at the origin, for flat contacts as in the paper and for spheres.
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
    """The two loops of a squeezed mass and their sum, over the last of SETTLED cycles of a drive at
    the resonance of the linearised mass: the figure, that cycle, and the system.

    force: amplitude of the drive, in the sketch's own units. Without touch or parting in the cycle,
    the ellipse of the linearised mass is drawn too.
    """
    system = VibroImpact(1.0, -2.0 * SQUEEZE, SOFT, SOFT)
    f = linearized(system).resonance
    run = _last_cycle(system, force)
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


@cache
def _last_cycle(system: VibroImpact, force: float) -> SimulatedMotion:
    """The last of SETTLED cycles of a drive at the resonance of the linearised mass.

    force: amplitude of the drive, in the sketch's own units.
    """
    f = linearized(system).resonance
    drive = Sinusoid(force, f)
    run = simulate(system, 0.0, 0.0, SETTLED / f, drive, tolerance=1e-9, step_max=0.008 / f)
    return run.during((SETTLED - 1.0) / f, SETTLED / f)


def _ellipse(system: VibroImpact, run: SimulatedMotion, frequency: float) -> tuple[Floats, Floats]:
    """Position and force, in the sketch's own units, of the linearised mass over one cycle: a
    Kelvin-Voigt ellipse, shape (200,) each.

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
    figure, _, _ = _overlap(1.6)
    return figure


def figure_9() -> tuple[Figure, str]:
    """Figure 9: force over position of a driven mass that two blocks squeeze and that leaves
    neither. The sum of both forces is nearly the ellipse of a spring and damper; also, in words for
    the caption, how nearly.
    """
    figure, run, system = _overlap(0.3)
    linear = linearized(system)
    off = run.resultant - linear.stiffness * run.position - linear.damping * run.velocity
    swing = float(np.abs(run.position).max()) / system.squeeze
    share = float(np.abs(off).max() / np.abs(run.resultant).max())
    return figure, f" Here, at {swing:.2f} of ½ |g|, by {100 * share:.1f} % of the largest force."


# The forced mass of section 3.1: its response, its bifurcations, and the same mass in the engines.


@dataclass(frozen=True, slots=True)
class Effort:
    """Amount of computation for the forced figures.

    frequencies, cycles, drawn_cycles: of the bifurcation, the last cycles being drawn.
    response_frequencies: of the response.
    timestep: of the engines, s, where the mass is clear; a quarter of it where it is squeezed.
    jobs: processes for the bifurcation; they change the time, not the figure.
    """

    frequencies: int
    cycles: int
    drawn_cycles: int
    response_frequencies: int
    timestep: float
    jobs: int = 1


FULL = Effort(240, cycles=100, drawn_cycles=36, response_frequencies=84, timestep=4e-6)
QUICK = Effort(6, cycles=6, drawn_cycles=3, response_frequencies=6, timestep=2e-5)

LAW = constants.law(constants.ALPHAS[-1])
# A mass that blocks squeeze from both sides, and drives' amplitudes, N.
SQUEEZED = VibroImpact(constants.MASS, -1e-5, LAW, LAW)
FORCES = (4.0, 120.0, 400.0)
# A mass with a gap to either block, and its drive's amplitude, N.
LOOSE = VibroImpact(constants.MASS, 1.5e-3, LAW, LAW)
PUSH = 150.0
# Speed, m/s, at which the other contacts have the law's e.
STAND_IN_SPEED = 0.4


def response_figure(effort: Effort) -> Figure:
    """Amplitude over force, nm/N, of the squeezed mass over the frequency of its drive, kHz, for
    the amplitudes FORCES, against the linearised one.
    """
    linear = linearized(SQUEEZED)
    # Two thirds of the frequencies where the peaks are.
    sixth = effort.response_frequencies // 6
    near = np.linspace(0.86, 1.12, effort.response_frequencies - 2 * sixth)
    away = (np.linspace(*ends, sixth) for ends in ((0.4, 0.84), (1.14, 1.7)))
    f = np.sort(np.concatenate([near, *away])) * linear.resonance
    figure = new_figure(7.6, 4.0)
    axes = figure.subplots()
    fine = np.linspace(f[0], f[-1], 400)
    line: dict[str, Any] = {"color": GREY, "linewidth": 4.0, "alpha": 0.6, "label": "linearised"}
    handles = axes.plot(fine / 1e3, linear.amplitude(1.0, fine) * 1e9, **line)
    cycles = max(8, effort.cycles // 2)
    for i, force in enumerate(FORCES):
        # The drive's own frequency is replaced by each of f.
        run = orbits(SQUEEZED, Sinusoid(force, 1.0), "frequency", f, cycles, max(2, cycles // 4))
        label = f"(16), {force:g} N"
        handles += axes.plot(f / 1e3, run.amplitude / force * 1e9, **numbered_line(i), label=label)
    axes.set_ylim(0.0)
    axes.set_xlabel("frequency, kHz")
    axes.set_ylabel("amplitude over force, nm/N")
    legend_below(figure, handles)
    return figure


# Drive at 90 Hz of the motion in which engines differ clearly.
CLEAR = Sinusoid(PUSH, 90.0)
# Duration of that motion, s.
CLEAR_FOR = 0.03
# Its start speed, m/s.
START = 0.1
# A hard drive, N at Hz, and its cycles, the last of which is drawn.
HARD = Sinusoid(1200.0, 3e3)
HARD_CYCLES = 12
# Line styles with ever more gaps: these lines lie on one another.
_OVERLAID = (0, 1, 5, 4)


def _in_engine(
    name: str, tuned_at: float | None, effort: Effort
) -> tuple[EngineTrajectory, EngineTrajectory]:
    """The motion of the clear mass, and the last cycle of the squeezed one, in an engine.

    name: of the engine.
    tuned_at: speed, m/s, at which its own contact is tuned; None: its plug-in is used.
    Raises EngineMissing, and EngineFailed where the engine crashes or hangs.
    """
    clear = simulate_in_engine(
        name, LOOSE, 0.0, START, CLEAR_FOR, CLEAR, timestep=effort.timestep, tuned_at=tuned_at
    )
    end = HARD_CYCLES / HARD.frequency
    squeezed = simulate_in_engine(
        name, SQUEEZED, 0.0, 0.0, end, HARD, timestep=0.25 * effort.timestep, tuned_at=tuned_at
    )
    return clear, squeezed.since(end - 1.0 / HARD.frequency)


def _contact_names(name: str, tuned_at: float | None) -> list[str]:
    """Names of the contact of a clear and of a squeezed mass; one if they are the same."""
    if tuned_at is None:
        return ["plug-in"]
    own_contact = registry.submodule(name, "two_blocks").own_contact
    return list(dict.fromkeys(own_contact(squeezed) for squeezed in (False, True)))


def engines_figure(effort: Effort) -> tuple[Figure, str]:
    """The clear and the squeezed mass in the engines that are installed, over the reference; and,
    in words, the largest distance of each from the reference, over the reference's largest value.

    Each engine is drawn with its plug-in and with its own contact.
    Raises EngineFailed where one crashes.
    """
    figure = new_figure(8.6, 4.4)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    period = 1.0 / HARD.frequency
    end = HARD_CYCLES / HARD.frequency
    clear = simulate(LOOSE, 0.0, START, CLEAR_FOR, CLEAR, step_max=4e-5)
    squeezed = simulate(SQUEEZED, 0.0, 0.0, end, HARD, step_max=0.01 * period)
    last_cycle = squeezed.during(end - period, end)
    broad: dict[str, Any] = {
        "color": GREY,
        "linewidth": 4.5,
        "alpha": 0.55,
        "label": "reference, eq. (16)",
    }
    handles = left.plot(clear.time * 1e3, clear.position * 1e3, **broad)
    right.plot(last_cycle.position * 1e6, last_cycle.resultant, **broad)
    distances = []
    engines = engines_with_two_blocks()
    for i, (tuned_at, name) in zip(
        cycle(_OVERLAID), product((None, STAND_IN_SPEED), engines), strict=False
    ):
        with suppress(EngineMissing):
            in_gap, pressed = _in_engine(name, tuned_at, effort)
            line: dict[str, Any] = {**numbered_line(i), "linewidth": 1.2}
            title = engine_title(name)
            contacts = _contact_names(name, tuned_at)
            label = f"{title} " + "; right: ".join(contacts)
            handles += left.plot(in_gap.time * 1e3, in_gap.position * 1e3, **line, label=label)
            right.plot(pressed.position * 1e6, pressed.resultant, **line)
            path = _distance(in_gap.time, in_gap.position, clear, clear.position)
            loop = _distance(pressed.time, pressed.resultant, last_cycle, last_cycle.resultant)
            both = ", ".join(f"{title} {contact}" for contact in contacts)
            distances.append(f"{both} {_percent(path)} and {_percent(loop)}")
    left.set_xlabel("time, ms")
    left.set_ylabel("position, mm")
    left.set_title("gap 1.5 mm")
    right.set_xlabel("position, µm")
    right.set_ylabel("force against it, N")
    right.set_title("squeezed by 5 µm")
    legend_below(figure, handles)
    if not distances:
        return figure, " No engine is installed."
    return figure, f" {'; '.join(distances)}."


def _distance(time: Floats, values: Floats, reference: SimulatedMotion, expected: Floats) -> float:
    """Largest distance of a series from the reference's, over the largest of that."""
    errors = values - np.interp(time, reference.time, expected)
    return float(np.abs(errors).max() / np.abs(expected).max())


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 1.0 else f"{100.0 * share:.0f} %"


def bifurcation_figure(effort: Effort) -> tuple[Figure, str]:
    """Velocity once a cycle, m/s, over the drive's frequency, Hz, for (16) and for
    its piecewise linear stand-in; and, in words for the caption, how much was simulated.
    """
    figure = new_figure(8.6, 6.0)
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    f = np.linspace(60.0, 120.0, effort.frequencies)
    cycles = effort.cycles
    drawn = effort.drawn_cycles
    stand_in = kelvin_voigt_blocks(LOOSE, STAND_IN_SPEED)
    title = f"spring and damper (4), same e and contact time at {STAND_IN_SPEED:g} m/s"
    pictures = ((LOOSE, BLUE, "eq. (16)"), (stand_in, ORANGE, title))
    for axes, (system, colour, name) in zip(panels, pictures, strict=True):
        run = orbits(system, Sinusoid(PUSH, 1.0), "frequency", f, cycles, drawn, jobs=effort.jobs)
        _draw_dots(axes, np.repeat(f, drawn), run.velocity.ravel(), colour)
        axes.set_title(name)
        axes.set_ylabel("velocity once a cycle, m/s")
    panels[1].set_xlabel("frequency of the drive, Hz")
    return figure, f" {len(f)} frequencies, {cycles} cycles each from rest, the last {drawn} drawn."


def _draw_dots(axes: Axes, x: Floats, y: Floats, colour: str) -> None:
    """Draw thousands of dots as one line of round ends: a tenth of the bytes that markers take.

    x, y: of the dots, shape (n,).
    """
    # The line is broken between dots where a point is NaN.
    nowhere = np.full_like(x, np.nan)
    # Half length of a dot: Matplotlib draws no line of length 0.
    tiny = 5e-4 * float(np.ptp(x))
    ends = (
        np.stack([x - tiny, x + tiny, nowhere], axis=1).ravel(),
        np.stack([y, y, nowhere], axis=1).ravel(),
    )
    axes.plot(*ends, color=colour, linewidth=1.5, solid_capstyle="round")
