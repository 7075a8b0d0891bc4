"""The forced mass between two blocks: response over frequency, bifurcation
pictures, and linear stand-ins.

Section 3.1: "in some instances the response is significantly at variance with that of an equivalent
linearized model". All values of a parameter are simulated side by side by `simulate.integrate`.
"""

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, get_args

import numpy as np
from scipy.optimize import brentq

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.kelvin_voigt import Ending, matched
from hcbench.paper.vibroimpact.simulate import integrate, motion_size, tangent
from hcbench.paper.vibroimpact.system import (
    APART,
    Flags,
    Indices,
    Modes,
    Sinusoid,
    TwoSidedContact,
    VibroImpact,
)
from hcbench.terms.bounds import positive, require
from hcbench.terms.impact import Floats
from hcbench.workers import WorkerPool

Over = Literal["frequency", "amplitude", "gap"]


@dataclass(frozen=True, slots=True)
class Orbits:
    """Motion over the values of a parameter, each from the same start; arrays of shape (values,
    kept cycles).

    over: the parameter.
    values: of the parameter, SI, shape (values,).
    position (m), velocity (m/s): at the end of each cycle.
    highest, lowest: the largest and smallest q within each cycle, m.
    touches: impacts in each cycle.
    """

    over: Over
    values: Floats
    position: Floats
    velocity: Floats
    highest: Floats
    lowest: Floats
    touches: Floats

    @property
    def amplitude(self) -> Floats:
        """Half the distance between the furthest points over the kept cycles, m, shape (values,)."""
        return np.asarray(0.5 * (self.highest.max(axis=1) - self.lowest.min(axis=1)))


def orbits(
    system: VibroImpact,
    drive: Sinusoid,
    over: Over,
    values: Floats,
    cycles: int = 200,
    keep: int = 60,
    *,
    position: float = 0.0,
    velocity: float = 0.0,
    tolerance: float = 1e-7,
    jobs: int = 1,
) -> Orbits:
    """Simulate each value of the parameter for `cycles` periods of the drive and return, of the
    last `keep`, the state at each end, the extremes and the number of touches.

    over: the parameter: "frequency", "amplitude" or "gap".
    values: Hz, N or m.
    drive: its other numbers hold for all values.
    position, velocity: at t = 0, m and m/s.
    tolerance: error of a step over the size of the motion.
    jobs: processes that share the values; the answer is the same to the last bit.

    Raises UserError for values the system or the drive refuses, and for a start without motion;
    EngineFailed where no step is short enough; CannotRun where a process dies.
    """
    values = np.atleast_1d(np.asarray(values, dtype=float))
    require("values", values.size, values.size >= 1, "at least one value")
    require("over", over, over in get_args(Over), " or ".join(get_args(Over)))
    require("cycles", cycles, cycles >= 1, "1 cycle or more")
    require("keep", keep, 1 <= keep <= cycles, f"1 ... {cycles} of the cycles")
    require("jobs", jobs, jobs >= 1, "1 process or more")
    cases = []
    for value in values:
        if over == "gap":
            cases.append((replace(system, gap=float(value)), drive))
        else:
            cases.append((system, replace(drive, **{over: float(value)})))
    start = np.array([position, velocity])
    task = partial(_simulate, cycles=cycles, keep=keep, start=start, tolerance=tolerance)
    # Neighbouring values take about as many steps: dealt out in turn,
    # every process has as much to do.
    shares = [cases[i::jobs] for i in range(min(jobs, len(cases)))]
    if len(shares) == 1:
        parts = [task(shares[0])]
    else:
        with WorkerPool(len(shares)) as pool:
            parts = pool.map(task, shares)
    records = np.empty((5, values.size, keep))
    for i, part in enumerate(parts):
        records[:, i :: len(parts)] = part
    return Orbits(over, values, *records)


def _simulate(
    cases: list[tuple[VibroImpact, Sinusoid]],
    cycles: int,
    keep: int,
    start: Floats,
    tolerance: float,
) -> Floats:
    """Simulate these systems and drives side by side: position, velocity, highest, lowest and
    touches of the last cycles, shape (5, cases, keep).

    cases: systems that differ in their gap alone, and the drive of each.
    cycles: periods of the drive that each runs; the last `keep` are kept.
    start: position (m) and velocity (m/s).
    tolerance: error of a step over the size of the motion.
    Raises UserError for a start without motion, EngineFailed where no step is short enough.
    """
    system, _ = cases[0]
    position, velocity = start.tolist()
    # A column for each case: N, Hz, rad, m, and the size of its motion, m and m/s.
    numbers = np.empty((6, len(cases)))
    for i, (body, drive) in enumerate(cases):
        size = motion_size(body, position, velocity, abs(drive.amplitude), drive)
        numbers[:, i] = drive.amplitude, drive.frequency, drive.phase, body.gap, *size
    amplitude, frequency, phase, gap, length, speed = numbers
    omega = 2.0 * np.pi * frequency
    contact = TwoSidedContact(
        laws=(system.right, system.left),
        mass=system.mass,
        half_gap=gap / 2.0,
        drive=lambda t, rows: amplitude[rows] * np.sin(omega[rows] * t + phase[rows]),
        length=length,
        speed=speed,
        tolerance=tolerance,
    )
    y = np.repeat(start[:, None], len(cases), axis=1)
    period = 2.0 * np.pi / omega
    recorder = _CycleRecorder(y[0], cycles, keep)
    ends = np.arange(1, cycles + 1)[:, None] * period
    integrate(contact, y, ends, 0.1 * period, recorder.observe)
    return recorder.record


class _CycleRecorder:
    """State at the end of each cycle, extremes of q and number of impacts within it.

    record: of the last cycles, shape (5, oscillators, keep): position (m), velocity (m/s), highest
    and lowest q (m), and touches.
    """

    def __init__(self, position: Floats, cycles: int, keep: int) -> None:
        """Begin with the positions at t = 0, m, shape (oscillators,).

        cycles: how many there will be.
        keep: how many of them, the last ones, are recorded.
        """
        self.record = np.empty((5, position.size, keep))
        # Column of `record` for the cycle that is under way; below 0 for one that is not kept.
        self.column = np.full(position.size, keep - cycles)
        self.highest = position.copy()
        self.lowest = position.copy()
        self.touches = np.zeros(position.size)

    def observe(
        self, rows: Indices, _: Floats, y: Floats, before: Modes, after: Modes, arrived: Flags
    ) -> None:
        """Take in one step of these oscillators. They turn only where steps end, so extremes are
        exact.

        rows: numbers of the oscillators, shape (r,).
        y: their states at the end of the step, position (m) and velocity (m/s) first.
        before, after: modes of both contacts, shape (2, r).
        arrived: whether the step ends a cycle, shape (r,).
        """
        self.highest[rows] = np.maximum(self.highest[rows], y[0])
        self.lowest[rows] = np.minimum(self.lowest[rows], y[0])
        self.touches[rows] += ((before == APART) & (after != APART)).any(axis=0)
        # Of those that end a cycle, those whose cycle is kept, and the column that it has.
        ends = rows[arrived]
        y = y[:, arrived]
        late = self.column[ends] >= 0
        which = ends[late]
        column = self.column[ends][late]
        self.record[:2, which, column] = y[:, late]
        self.record[2:, which, column] = (
            self.highest[which],
            self.lowest[which],
            self.touches[which],
        )
        self.highest[ends] = self.lowest[ends] = y[0]
        self.touches[ends] = 0.0
        self.column[ends] += 1


@dataclass(frozen=True, slots=True)
class Linear:
    """m q'' + c q' + k q = P: stiffness k (N/m), damping c (N s/m), mass m (kg)."""

    stiffness: float
    damping: float
    mass: float

    def amplitude(self, force: float, frequency: Floats | float) -> Floats:
        """Steady amplitude (m) under a sinusoid of `force` N at frequencies (Hz), same shape."""
        omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)
        return np.asarray(
            force / np.hypot(self.stiffness - self.mass * omega**2, self.damping * omega)
        )

    @property
    def resonance(self) -> float:
        """√(k/m)/(2π), Hz."""
        return math.sqrt(self.stiffness / self.mass) / (2.0 * math.pi)


def linearized(system: VibroImpact) -> Linear:
    """The squeezed mass for small swings: the slopes of both laws where it rests, summed.

    Between equal blocks it rests in the middle. For eq. (16) with x0 = |g|/2 the sums are
    2 n k x0^(n-1), k that of the law, and 2 λ x0^n. It is the Kelvin-Voigt model that the appendix
    arrives at.
    Raises UserError for g >= 0, where no slope describes the contact.
    """
    expected = "a gap below 0 m: with clearance there is no spring in the middle to linearise"
    require("gap", system.gap, system.gap < 0.0, expected, "See `kelvin_voigt_blocks`")
    rest = 0.0
    if system.resultant(rest, 0.0):
        # Nearer to the softer block.
        rest = brentq(
            lambda q: float(system.resultant(q, 0.0)), -system.squeeze, system.squeeze, xtol=1e-15
        )
    right_stiffness, right_damping = tangent(system.right, system.squeeze + rest)
    left_stiffness, left_damping = tangent(system.left, system.squeeze - rest)
    return Linear(right_stiffness + left_stiffness, right_damping + left_damping, system.mass)


def kelvin_voigt_blocks(system: VibroImpact, speed: float) -> VibroImpact:
    """The same gap with springs and dampers (4) for blocks, as Dubowsky and Freudenstein model it.

    Each has the contact time and the restitution of its law (16) at `speed` (m/s), its
    contact ending at F = 0. It is what "equivalent linearized model" can mean with
    clearance (reference [3] of the paper).
    Raises UserError for blocks of another law, and for a speed that is not above 0.
    """
    positive("speed", speed, "m/s")

    def stand_in(law: object) -> object:
        require("law", law, isinstance(law, HuntCrossley), "a law of eq. (16) on both sides")
        assert isinstance(law, HuntCrossley)
        e = float(closed_form.restitution(law.alpha, speed))
        return matched(
            e, float(closed_form.duration(law, system.mass, speed)), system.mass, Ending.FORCE
        )

    right = stand_in(system.right)
    left = stand_in(system.left)
    return replace(system, right=right, left=left)  # type: ignore[arg-type]
