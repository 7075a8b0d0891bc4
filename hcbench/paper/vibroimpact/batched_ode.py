"""Integrates many masses between blocks side by side with NumPy, and ends
steps where their equations change.

The state of an oscillator is y = (position, velocity, anything that is integrated along). Between
switches, such as touch and parting, its rates are smooth. Each oscillator takes DOP853 steps (E.
Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary Differential Equations I", Springer 1993,
section II.5; coefficients from SciPy) under its own error control. A step in which the velocity
changes its sign or a switch is crossed is taken again, shorter, so that it ends there. So position
is monotone within a step and no switch is missed; a switch is as exact as the steps are; and the
result of an oscillator does not depend on the others.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from scipy.integrate import DOP853

from hcbench.paper.vibroimpact.dynamics import Flags, Indices, Modes, TwoSidedContact
from hcbench.system.errors import EngineFailed
from hcbench.terms.impact import Floats

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

    y: shape (components, oscillators).
    checkpoints: times in s, rising, shape (checkpoints, oscillators).
    step_max: the longest step of each, s.

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
    """The state of all oscillators, t, y and mode, and what comes next for each.

    passed: checkpoints.
    h: length of the next step, s.
    goal: what the end of that step is searched for; low, high: bracket of its length. Arrays have
    the shape (..., oscillators).
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

        y: shape (components, oscillators).
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
        self.rounding = max(1e-15, 1e-4 * system.tolerance)

    def try_steps(self, rows: Indices) -> None:
        """Try one step of each of these oscillators, shape (rows,).

        A good step is taken; a bad one is tried again with a shorter length. A step that passes a
        turning point or a switch begins a search for the length that ends there, which the next
        tries go on with.
        """
        goal = self.goal[rows]
        no_goal = goal == NOTHING
        left = self.checkpoints[self.passed[rows], rows] - self.t[rows]
        h = np.where(
            no_goal, np.minimum(np.minimum(self.h[rows], self.step_max[rows]), left), self.h[rows]
        )
        y, error = self._try(rows, h)
        # A NaN compares false, so that its step is not good.
        good = no_goal & (error <= 1.0)
        self._resize(rows[no_goal], h[no_goal], error[no_goal])
        speed = self._speed(rows, y)
        distance = self._distance(rows, y)
        narrow = self.high[rows] - self.low[rows] <= 2.0 * _EPS * self.high[rows]
        reached = ~no_goal & (narrow | (np.abs(np.where(goal == TURN, speed, distance)) <= 1.0))
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
        """y after steps of h (s), and the errors of these steps over the tolerance."""
        t = self.t[rows]
        y = self.y[:, rows]
        mode = self.mode[:, rows]
        k = np.empty((_STAGES, *y.shape))
        k[0] = self.system.rates(t, y, mode, rows)
        for i in range(1, _STAGES):
            k[i] = self.system.rates(t + _C[i] * h, y + h * _mix(_A[i], k[:i]), mode, rows)
        size = self.system.tolerance * self.system.size[:, rows]
        of_fifth, of_third = _ERRORS
        fifth = ((_mix(of_fifth, k) / size) ** 2).sum(axis=0)
        third = ((_mix(of_third, k) / size) ** 2).sum(axis=0)
        bottom = np.sqrt(len(y) * (fifth + 0.01 * third))
        return y + h * _mix(_B, k), h * fifth / np.maximum(bottom, 1e-300)

    def _resize(self, rows: Indices, h: Floats, error: Floats) -> None:
        """Choose the next step's size, s, from this one's error over the tolerance; a step cut short by
        a limit says little about growth. Raises EngineFailed where no step is short enough.
        """
        good = error <= 1.0
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

        h: length of the last step, s.
        y: at its end.
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
        """Take these steps to y, and change the modes where they end on a switch."""
        until = self.checkpoints[self.passed[rows], rows]
        arrived = h >= until - self.t[rows]
        before = self.mode[:, rows]
        goal = self.goal[rows]
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
