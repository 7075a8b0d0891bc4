"""Simulates a mass between two blocks: its motion, its events and its energy balance."""

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from scipy.integrate import DOP853

from hcbench.laws.force import ForceLaw, HuntCrossley
from hcbench.paper.vibroimpact.system import (
    APART,
    CONTACT,
    PULLED_OFF,
    SIGNS,
    Drive,
    Event,
    Flags,
    Indices,
    Kind,
    Modes,
    Side,
    SimulatedMotion,
    Sinusoid,
    TwoSidedContact,
    VibroImpact,
    pressing,
    stored,
)
from hcbench.system.errors import EngineFailed, HcbenchError, UserError
from hcbench.terms.bounds import positive, require
from hcbench.terms.impact import Floats

# Integrates many masses between blocks side by side with NumPy, and ends steps where their
# equations change.
#
# The state of an oscillator is y = (position, velocity, anything that is integrated along).
# Between switches, such as touch and parting, its rates are smooth. Each oscillator takes DOP853
# steps (E. Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary Differential Equations I", Springer
# 1993, section II.5; coefficients from SciPy) under its own error control. A step in which the
# velocity changes its sign or a switch is crossed is taken again, shorter, so that it ends there.
# So position is monotone within a step and no switch is missed; a switch is as exact as the steps
# are; and the result of an oscillator does not depend on the others.

# Called with each step taken: the oscillators, t, y, their modes up to there and from there on, and
# which of them have reached a checkpoint.
Observer: TypeAlias = Callable[[Indices, Floats, Floats, Modes, Modes, Flags], None]

NOTHING, TURN, SWITCH = 0, 1, 2

_STAGES = 12
_A = [DOP853.A[i, :i].copy() for i in range(_STAGES)]
_B = DOP853.B
_C = DOP853.C[:_STAGES]
_ERRORS = (DOP853.E5[:_STAGES], DOP853.E3[:_STAGES])
_EPS = float(np.finfo(float).eps)
_TRIALS_MAX = 10_000_000
# A slope is the difference over this share of a step.
_AHEAD = 1e-7
# A step is at most so many times as long as the one before.
_LARGEST_GROWTH = 4.0
# A step is at least this share of the one before.
_LARGEST_CUT = 0.2


def integrate(
    system: TwoSidedContact, y: Floats, checkpoints: Floats, step_max: Floats, observe: Observer
) -> None:
    """Move every oscillator from y at t = 0 through its checkpoints.

    system: the equations of all oscillators.
    y: shape (components, oscillators).
    checkpoints: times in s, rising, shape (checkpoints, oscillators).
    step_max: the longest step of each, s.
    observe: called with each step that is taken, see `Observer`.

    Raises EngineFailed when an oscillator makes no headway.
    """
    batch = _Batch(system, y, checkpoints, step_max, observe)
    for _ in range(_TRIALS_MAX):
        rows = np.flatnonzero(batch.passed < len(checkpoints))
        if not rows.size:
            return
        batch.try_steps(rows)
    raise EngineFailed("vibroimpact", f"not at the end after {_TRIALS_MAX} steps", "a shorter run")


class _Batch:
    """The state of all oscillators, t, y and mode, and what comes next for each; arrays have the
    shape (..., oscillators).

    passed: number of checkpoints passed.
    h: length of the next step, s.
    goal: NOTHING while steps are as long as their error allows; TURN or SWITCH while the length is
    searched after which the mass turns, or a contact changes its mode.
    low, high: bracket of that length, s.
    """

    def __init__(
        self,
        system: TwoSidedContact,
        y: Floats,
        checkpoints: Floats,
        step_max: Floats,
        observe: Observer,
    ) -> None:
        """Begin at t = 0, with the first step that the system proposes.

        system: the equations of all oscillators.
        y: states, shape (components, oscillators).
        checkpoints: times, s, rising, shape (checkpoints, oscillators).
        step_max: longest step, s, shape (oscillators,).
        observe: called with each step that is taken.
        """
        count = y.shape[1]
        self.system = system
        self.checkpoints = checkpoints
        self.step_max = step_max
        self.observe = observe
        self.t = np.zeros(count)
        self.y = y.copy()
        self.mode = system.first_modes(y)
        self.passed = np.zeros(count, dtype=np.intp)
        self.h = system.first_step(self.mode, np.arange(count))
        self.goal = np.full(count, NOTHING)
        self.low = np.zeros(count)
        self.high = np.zeros(count)
        # Share of the system's size below which a speed or a distance is 0.
        self.rounding = max(1e-15, 1e-4 * system.tolerance)

    def try_steps(self, rows: Indices) -> None:
        """Try one step of each of these oscillators, shape (rows,).

        A good step is taken; a bad one is tried again with a shorter length. A step that passes a
        turning point or a switch begins a search for the length that ends there, which the next
        tries go on with.
        Raises EngineFailed where no step is short enough.
        """
        goal = self.goal[rows]
        no_goal = goal == NOTHING
        left = self.checkpoints[self.passed[rows], rows] - self.t[rows]
        # A search has its lengths from `_narrow`, within a step that was good.
        longest = np.minimum(self.step_max[rows], left)
        h = np.where(no_goal, np.minimum(self.h[rows], longest), self.h[rows])
        y, error = self._try(rows, h)
        # A NaN compares false, so that its step is not good.
        good = no_goal & (error <= 1.0)
        self._resize(rows[no_goal], h[no_goal], error[no_goal])
        # Both fall from above 0, and pass it at a turning point and at a switch. Their unit is the
        # rounding: within 1 they are 0.
        speed = self._speed(rows, y)
        distance = self._distance(rows, y)
        narrow = self.high[rows] - self.low[rows] <= 2.0 * _EPS * self.high[rows]
        sought = np.where(goal == TURN, speed, distance)
        # A search ends on what it seeks, or where no number is left between its ends.
        reached = ~no_goal & (narrow | (np.abs(sought) <= 1.0))
        turns = good & (speed < 0.0)
        # A turning point beyond a switch: the switch comes first.
        crosses = ((good & ~turns) | (reached & (goal == TURN))) & (distance < 0.0)
        self.goal[rows[turns]] = TURN
        self.goal[rows[crosses]] = SWITCH
        self.low[rows[turns | crosses]] = 0.0
        takes = (good | reached) & ~turns & ~crosses
        search = ~takes & (self.goal[rows] != NOTHING)
        if search.any():
            self._narrow(rows[search], h[search], y[:, search])
        if takes.any():
            self._take(rows[takes], h[takes], y[:, takes])

    def _try(self, rows: Indices, h: Floats) -> tuple[Floats, Floats]:
        """y after steps of h (s), and the errors of these steps over the tolerance, shape (rows,).

        An error is Hairer's, of the embedded methods of orders 5 and 3.
        """
        t = self.t[rows]
        y = self.y[:, rows]
        mode = self.mode[:, rows]
        # Rates at each stage of the step.
        k = np.empty((_STAGES, *y.shape))
        k[0] = self.system.rates(t, y, mode, rows)
        for i in range(1, _STAGES):
            k[i] = self.system.rates(t + _C[i] * h, y + h * _mix(_A[i], k[:i]), mode, rows)
        size = self.system.tolerance * self.system.size[:, rows]
        of_fifth, of_third = _ERRORS
        fifth = ((_mix(of_fifth, k) / size) ** 2).sum(axis=0)
        third = ((_mix(of_third, k) / size) ** 2).sum(axis=0)
        # As Hairer, Norsett and Wanner have it in DOP853: the error of third order keeps the
        # estimate from being 0 where that of fifth order happens to vanish.
        bottom = np.sqrt(len(y) * (fifth + 0.01 * third))
        return y + h * _mix(_B, k), h * fifth / np.maximum(bottom, 1e-300)

    def _resize(self, rows: Indices, h: Floats, error: Floats) -> None:
        """Choose the next step's size, s, from this one's error; a step cut short by a limit says
        little about growth.

        rows: numbers of the oscillators, (rows,).
        h: length of the step just tried, s.
        error: of it, over the tolerance.
        Raises EngineFailed where no step is short enough.
        """
        good = error <= 1.0
        # The error grows with h⁸: this factor makes it 0.9⁸ of the tolerance.
        factor = np.where(
            np.isfinite(error), 0.9 * np.maximum(error, 1e-16) ** -0.125, _LARGEST_CUT
        )
        best = h * np.clip(factor, _LARGEST_CUT, np.where(good, _LARGEST_GROWTH, 1.0))
        self.h[rows] = np.where(good & (h < self.h[rows]), np.maximum(self.h[rows], best), best)
        stuck = rows[~good & (best < 1e-13 * self.system.size[0, rows] / self.system.size[1, rows])]
        if stuck.size:
            where = f"no step is short enough at t = {float(self.t[stuck[0]])!r} s"
            raise EngineFailed("vibroimpact", where, "finite, bounded forces")

    def _speed(self, rows: Indices, y: Floats) -> Floats:
        """Velocity at the end of a step, below 0 once it has changed its sign; within 1 it is 0."""
        return np.asarray(
            y[1] * np.sign(self.y[1, rows]) / (self.rounding * self.system.size[1, rows])
        )

    def _distance(self, rows: Indices, y: Floats) -> Floats:
        """Distance from the nearest switch at the end of a step; within 1 it is 0."""
        distance, _ = self.system.distance(y, self.mode[:, rows], rows)
        rounding = 4.0 * _EPS * np.abs(y[0]) / self.system.size[0, rows]
        return np.asarray(distance / (self.rounding + rounding))

    def _narrow(self, rows: Indices, h: Floats, y: Floats) -> None:
        """Choose the next step of a search from the last one: by
        Newton's method, else by bisection.

        h: length of the last step, s, shape (rows,).
        y: states at its end, shape (components, rows).
        """

        def value(y: Floats) -> Floats:
            return np.where(self.goal[rows] == TURN, self._speed(rows, y), self._distance(rows, y))

        now = value(y)
        ahead = _AHEAD * h
        rates = self.system.rates(self.t[rows] + h, y, self.mode[:, rows], rows)
        slope = (value(y + ahead * rates) - now) / ahead
        # The value falls from above 0 to below it: a step before the crossing is the new low end.
        low = np.where(now > 0.0, h, self.low[rows])
        high = np.where(now > 0.0, self.high[rows], h)
        self.low[rows] = low
        self.high[rows] = high
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = h - now / slope
        self.h[rows] = np.where((newton > low) & (newton < high), newton, 0.5 * (low + high))

    def _take(self, rows: Indices, h: Floats, y: Floats) -> None:
        """Take these steps to y, and change the modes where they end on a switch; tell the
        observer.

        h: lengths of the steps, s, shape (rows,).
        y: states at their ends, shape (components, rows).
        """
        until = self.checkpoints[self.passed[rows], rows]
        arrived = h >= until - self.t[rows]
        before = self.mode[:, rows]
        goal = self.goal[rows]
        # Exactly at the checkpoint, and exactly at rest where the mass turns.
        self.t[rows] = np.where(arrived, until, self.t[rows] + h)
        y[1, goal == TURN] = 0.0
        self.y[:, rows] = y
        on = goal == SWITCH
        if on.any():
            here = rows[on]
            _, switch = self.system.distance(y[:, on], before[:, on], here)
            self.mode[:, here] = self.system.transition(y[:, on], before[:, on], switch, here)
            self.h[here] = self.system.first_step(self.mode[:, here], here)
        self.goal[rows] = NOTHING
        self.observe(rows, self.t[rows], y, before, self.mode[:, rows], arrived)
        self.passed[rows] += arrived


def _mix(weights: Floats, stages: Floats) -> Floats:
    """Weighted sum of stages. BLAS would let the last bit of an
    oscillator depend on its neighbours.
    """
    return np.asarray(np.einsum("i,ijk->jk", weights, stages))


SIDES: tuple[Side, Side] = ("right", "left")
_KINDS: dict[tuple[int, int], Kind] = {
    (APART, CONTACT): "touch",
    (CONTACT, APART): "part",
    (PULLED_OFF, APART): "part",
    (CONTACT, PULLED_OFF): "release",
    (PULLED_OFF, CONTACT): "press",
}
# Largest force, N: the square of a larger one overflows.
_STRONGEST = 1e100


def simulate(
    system: VibroImpact,
    position: float,
    velocity: float,
    until: float,
    drive: Drive | None = None,
    *,
    tolerance: float = 1e-11,
    step_max: float = math.inf,
) -> SimulatedMotion:
    """The motion from q = position (m), q' = velocity (m/s), t = 0 to `until` (s), with its forces,
    energies and touches at each step; free without a drive.

    drive: P in N over t in s, a `Sinusoid` or any smooth function (a rough one needs `step_max`,
    s).
    tolerance: error of a step over the size of the motion.
    step_max: longest step, s; for a `Sinusoid` at most a tenth of its period.

    Raises UserError for numbers that are not finite, from the caller or from the drive, for a start
    without motion, and for contacts too shallow to resolve over their gap; EngineFailed where no
    step is short enough.
    """
    for slot, value, unit in (("position", position, "m"), ("velocity", velocity, "m/s")):
        require(slot, value, math.isfinite(value), f"a finite number in {unit}")
    positive("until", until, "s")
    require(
        "tolerance", tolerance, 1e-15 <= tolerance <= 1e-2, "1e-15 ... 1e-2 of the motion's size"
    )
    require("step_max", step_max, step_max > 0.0, "a step above 0 s")
    length, speed = motion_size(system, position, velocity, _largest(drive, until), drive)
    contact = TwoSidedContact(
        laws=(system.right, system.left),
        mass=system.mass,
        half_gap=np.array([system.gap / 2.0]),
        drive=lambda t, _: _force_of(drive, t),
        length=np.array([length]),
        speed=np.array([speed]),
        tolerance=tolerance,
        energy_balance=True,
    )
    if isinstance(drive, Sinusoid):
        step_max = min(step_max, 0.1 / drive.frequency)
    start = np.array([position, velocity, 0.0, 0.0])
    times = [0.0]
    states = [start]
    events = []

    def record(_: Indices, t: Floats, y: Floats, before: Modes, after: Modes, __: Flags) -> None:
        """Keep the state of the one oscillator after a step, and the changes of its two contacts.

        t: s, (1,).
        y: (4, 1).
        before, after: modes, (2, 1).
        """
        times.append(float(t[0]))
        states.append(y[:, 0].copy())
        for side, (sign,) in enumerate(SIGNS.tolist()):
            kind = _KINDS.get((int(before[side, 0]), int(after[side, 0])))
            if kind is not None:
                events.append(Event(times[-1], SIDES[side], kind, sign * float(y[1, 0])))

    integrate(contact, start[:, None], np.array([[until]]), np.array([step_max]), record)
    return _motion_of(system, np.array(times), np.array(states), tuple(events))


def _motion_of(
    system: VibroImpact, times: Floats, states: Floats, events: tuple[Event, ...]
) -> SimulatedMotion:
    """The motion with its forces, N, and energies, J.

    times: s, shape (n,).
    states: shape (n, 4): position (m), velocity (m/s), energies lost and put in (J).
    events: touches and partings, in the order of time.
    """
    q, v, lost, put_in = states.T
    half = system.gap / 2.0
    energy = np.empty_like(q)
    for i, x in enumerate(q.tolist()):
        energy[i] = stored(system.right, x - half) + stored(system.left, -x - half)
    return SimulatedMotion(
        time=times,
        position=q,
        velocity=v,
        right=pressing(system.right, q - half, v),
        left=pressing(system.left, -q - half, -v),
        kinetic=0.5 * system.mass * v * v,
        stored=energy,
        lost=lost,
        put_in=put_in,
        events=events,
    )


def _force_of(drive: Drive | None, times: Floats) -> Floats:
    """P in N at times (s), same shape; 0 without a drive."""
    if drive is None:
        return np.zeros_like(times)
    return np.array([_checked(drive, float(t)) for t in times])


def _checked(drive: Drive, time: float) -> float:
    """Force of a drive, N, at `time` (s). Raises UserError unless the drive gives a number below
    _STRONGEST, and where it raises; its errors of hcbench pass.
    """
    expected = "a finite force, a number in N, at every time"
    try:
        value: object = drive(time)
    except HcbenchError:
        raise
    except Exception as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise UserError("drive", f"raised {what:.200} at t = {time!r} s", expected) from error
    try:
        force = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise UserError("drive", f"gave {value!r} at t = {time!r} s", expected) from None
    if not abs(force) < _STRONGEST:
        raise UserError("drive", f"gave {force!r} N at t = {time!r} s", expected)
    return force


def _largest(drive: Drive | None, until: float) -> float:
    """Largest |P|, N, of a drive up to a time, s: of a sinusoid its amplitude, of any other that of
    257 samples; 0 without one. Raises UserError as `_checked`.
    """
    if isinstance(drive, Sinusoid):
        return abs(drive.amplitude)
    return float(np.abs(_force_of(drive, np.linspace(0.0, until, 257))).max())


def motion_size(
    system: VibroImpact, position: float, velocity: float, force: float, drive: Drive | None = None
) -> tuple[float, float]:
    """The size of the motion (m, m/s) that errors are measured over, from
    its energy and the largest P (N).

    A depth X and a speed V with F(X, 0) X = m V², about those of an impact;
    for a squeezed mass its swing. position (m), velocity (m/s): of the start.
    force: largest P, N.

    Raises UserError for a start without any energy.
    """
    half = system.gap / 2.0
    squeeze = system.squeeze
    start = 0.5 * system.mass * velocity**2
    for law, x in ((system.right, position - half), (system.left, -position - half)):
        start += max(0.0, stored(law, x) - stored(law, squeeze))
    if squeeze > 0.0:
        right, _ = tangent(system.right, squeeze)
        left, _ = tangent(system.left, squeeze)
        stiffness = right + left
        energy = start + 0.5 * force**2 / stiffness
        require(
            "start",
            energy,
            energy > 0.0,
            "a motion: a speed, a position off the middle, or a drive",
        )
        return math.sqrt(2.0 * energy / stiffness), math.sqrt(2.0 * energy / system.mass)

    def elastic(x: float) -> float:
        return float(system.right.force(x, 0.0))

    # The energy includes what the drive gives to a free mass.
    if isinstance(drive, Sinusoid):
        energy = start + 0.5 * (force / (2.0 * math.pi * drive.frequency)) ** 2 / system.mass
    else:
        energy = start
        # A steady P does the work P x up to the depth x at which the block balances it.
        if force:
            energy += force * _solve(elastic, force)
    require(
        "start", energy, energy > 0.0, "a motion: a speed, a position inside a block, or a drive"
    )
    depth = _solve(lambda x: elastic(x) * x, 2.0 * energy)
    return depth, math.sqrt(2.0 * energy / system.mass)


def tangent(law: ForceLaw, depth: float) -> tuple[float, float]:
    """dF/dx (N/m) and dF/dv (N s/m) at rest at `depth` (m).

    n k x^(n-1) and λ x^n of eq. (16); central differences of other laws.
    """
    if isinstance(law, HuntCrossley):
        k, n = law.stiffness, law.exponent
        return n * k * depth ** (n - 1.0), law.dissipation * k * depth**n
    x = depth * np.array([1.0 - 1e-5, 1.0 + 1e-5])
    stiffness = np.diff(law.force(x, 0.0))[0] / np.diff(x)[0]
    # The difference over 2e-6 m/s: near v = 0 these laws are straight lines in v.
    v = np.array([-1e-6, 1e-6])
    damping = np.diff(law.force(depth, v))[0] / 2e-6
    return float(stiffness), float(damping)


def _solve(rising: Callable[[float], float], wanted: float) -> float:
    """Find x > 0, m, at which a rising function reaches the value `wanted`, by bisection on a
    logarithmic scale, from 1e-15 to 1e6 m; beyond, the nearer end.
    """
    low = 1e-15
    high = 1e6
    # Each halves the 48 that are between the logarithms of both ends: to the last digit.
    for _ in range(60):
        middle = math.sqrt(low * high)
        if rising(middle) < wanted:
            low = middle
        else:
            high = middle
    return math.sqrt(low * high)
