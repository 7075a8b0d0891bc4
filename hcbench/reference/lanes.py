"""Many small oscillators at once, each with steps of its own, its switches located: an integrator on NumPy.

A lane is one oscillator, y = (position, velocity, anything that is integrated along). Between switches its
rates are smooth: a `Flow` makes a `Phase` of the lanes' present modes, which says what they are and how far
each lane is from a switch. Every lane takes DOP853 steps (E. Hairer, S. P. Norsett, G. Wanner, "Solving
Ordinary Differential Equations I", Springer 1993, section II.5; coefficients from SciPy) under its own
error control, and a step across a switch is taken again, shorter, until it ends on it. So a switch is as
exact as the steps are, with no interpolant in between, and the answer of a lane does not depend on its
neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from hcbench.errors import EngineFailed
from hcbench.reference.search import Searches, root_of_quintic

if TYPE_CHECKING:
    from hcbench.impact import Floats
    from hcbench.reference.search import Flags

Modes: TypeAlias = NDArray[np.int8]
Indices: TypeAlias = NDArray[np.intp]

SURFACES = 2  # switches numbered below are met at a position; others wherever
_STAGES = 12
_A = [DOP853.A[i, :i].copy() for i in range(_STAGES)]
_B, _C = DOP853.B, DOP853.C[:_STAGES]
_ERRORS = np.array([DOP853.E5[:_STAGES], DOP853.E3[:_STAGES]])
_EPS = float(np.finfo(float).eps)
_GROW, _SHRINK = 4.0, 0.2


class Phase(Protocol):
    """Lanes in fixed modes; arrays have one column a lane."""

    def rates(self, t: Floats, y: Floats) -> Floats:
        """dy/dt, shape of y: (components, lanes)."""
        ...

    def first_step(self) -> Floats:
        """Step to begin these modes with, s, shape (lanes,); inf where the rates are smooth at once."""
        ...

    def distances(self, y: Floats) -> tuple[Floats, Indices]:
        """How far each lane is from its next switch (below 0: beyond it), and the switch.

        Distances from switches below SURFACES are positions over the length scale; all have shape (lanes,).
        """
        ...


class Flow(Protocol):
    """What moves. `lane` are the lanes' numbers, to look parameters up."""

    def phase(self, mode: Modes, lane: Indices) -> Phase:
        """The lanes in modes of shape (sides, lanes)."""
        ...

    def switched(self, y: Floats, mode: Modes, switch: Indices, lane: Indices) -> Modes:
        """The modes after the switches numbered `switch`, and after any that come with them; as `mode`."""
        ...


class Watch(Protocol):
    """Told of what happens."""

    def step(self, lane: Indices, t: Floats, y: Floats, before: Modes, after: Modes) -> None:
        """These lanes took a step to t, y, with these modes up to there and from there on."""
        ...

    def stop(self, lane: Indices, index: Indices, y: Floats) -> None:
        """These lanes reached their stops numbered `index`."""
        ...


@dataclass(slots=True)
class Lanes:
    """Where every lane is: t (s), y (components, lanes), mode (sides, lanes); h, the next step (s)."""

    t: Floats
    y: Floats
    mode: Modes
    h: Floats


@dataclass(frozen=True, slots=True)
class Control:
    """How finely to step.

    tolerance: error of a step over the size of the motion. size: of every component of y, shape of y.
    step_max: longest step of each lane, s, shape (lanes,). trials_max: when to give up.
    """

    tolerance: float
    size: Floats
    step_max: Floats
    trials_max: int = 10_000_000


def march(flow: Flow, lanes: Lanes, stops: Floats, control: Control, watch: Watch) -> None:
    """Move every lane through its stops: times in s, rising, shape (stops, lanes).

    Raises EngineFailed when a lane makes no headway.
    """
    work = _Work(flow, lanes, stops, control)
    for _ in range(control.trials_max):
        work.try_step()
        taken = work.judge()
        if taken.any():
            work.commit(taken, watch)
            if not work.lane.size:
                return
    raise EngineFailed("vibroimpact", f"not at the end after {control.trials_max} steps", "a shorter run")


class _Work:
    """The lanes still on their way, packed side by side; all arrays are (..., lanes)."""

    def __init__(self, flow: Flow, lanes: Lanes, stops: Floats, control: Control) -> None:
        self.flow, self.control, self.stops = flow, control, stops
        self.lane = np.arange(lanes.t.size)
        self.t, self.y, self.mode, self.h = lanes.t.copy(), lanes.y.copy(), lanes.mode.copy(), lanes.h.copy()
        self.step_max = control.step_max
        self.next = np.zeros(self.lane.size, dtype=np.intp)
        self.until = stops[0]
        self.phase = flow.phase(self.mode, self.lane)
        self.search = Searches(self.lane.size)
        self.turning = np.zeros(self.lane.size, dtype=bool)  # the search is for a turning point
        self.turned = np.zeros(self.lane.size, dtype=bool)  # the last step ended on a turning point
        self.size = control.size

    def try_step(self) -> None:
        """One trial a lane: of the size its errors allow, or the one that its search asks for."""
        left = self.until - self.t
        free = np.minimum(np.minimum(self.h, self.step_max), left)
        self.trial = h = np.where(self.search.on, self.search.trial, free)
        shape, rates, y = self.y.shape, self.phase.rates, self.y
        k = np.empty((_STAGES, *shape))
        flat = k.reshape(_STAGES, -1)
        k[0] = rates(self.t, y)
        for i in range(1, _STAGES):
            k[i] = rates(self.t + _C[i] * h, y + h * (_A[i] @ flat[:i]).reshape(shape))
        self.y_new = y + h * (_B @ flat).reshape(shape)
        self.t_new = np.where(h >= left, self.until, self.t + h)
        self.braking = k[0, 1], k[-1, 1]  # at both ends: the last stage is at the end, too
        errors = (_ERRORS @ flat).reshape(2, *shape) / (self.control.tolerance * self.size)
        fifth, third = np.einsum("ecl,ecl->el", errors, errors)
        bottom = np.sqrt(len(y) * (fifth + 0.01 * third))
        self.error = h * fifth / np.maximum(bottom, 1e-300)

    def judge(self) -> Flags:
        """Which trials are taken as steps. The others are aimed anew."""
        distance, self.switch = self.phase.distances(self.y_new)
        heading = self.y_new[1] * np.sign(self.y[1]) / self.size[1]
        searching = self.search.on.copy()
        fine = self.error <= 1.0  # a NaN is not
        taken = ~searching & fine
        found = self._narrow(heading, distance) if searching.any() else searching
        turn = taken & ~self.turned & self._may_hide(distance)
        # A turning point found beyond a switch: the switch comes first.
        crossed = ((taken & ~turn) | (found & self.turning)) & (distance < 0.0)
        starts = turn | crossed
        if starts.any():
            self._start(turn, crossed, heading, distance)
        self._resize(~searching, fine)
        self.located = found & ~self.turning & ~crossed
        steps: Flags = (taken | found) & ~starts
        return steps

    def _start(self, turn: Flags, crossed: Flags, heading: Floats, distance: Floats) -> None:
        """Begin searches for turning points and switches inside the trials."""
        before, _ = self.phase.distances(self.y)
        # What has just switched left its distance at 0, give or take rounding: the good side by definition.
        self.search.start(crossed, self.trial, np.maximum(before, 0.0), distance)
        self.search.start(turn, self.trial, np.abs(self.y[1]) / self.size[1], heading)
        self.turning = (self.turning | turn) & ~crossed
        surface = np.flatnonzero(crossed & (self.switch < SURFACES) & (before > 0.0))
        if surface.size:
            ends = [
                np.array([a[surface], b[surface]]) for a, b in zip(self.y[:2], self.y_new[:2], strict=True)
            ]
            slopes = np.array([side[surface] for side in self.braking])
            share = before[surface] / (before[surface] - distance[surface])
            guess = root_of_quintic(self.trial[surface], ends[0], ends[1], slopes, share)
            self.search.trial[surface] = self.trial[surface] * guess

    def _narrow(self, heading: Floats, distance: Floats) -> Flags:
        value = np.where(self.turning, heading, distance)
        # Distances of surfaces fall as the position moves; of other switches the slope is not known.
        falling = np.where(self.switch < SURFACES, -np.abs(self.y_new[1]) / self.size[0], np.nan)
        slope = np.where(self.turning, self.braking[1] * np.sign(self.y[1]) / self.size[1], falling)
        rounding = np.where(self.turning, 0.0, np.abs(self.y[0]) / self.size[0])
        near_zero = max(1e-15, 1e-5 * self.control.tolerance) + 4.0 * _EPS * rounding
        return self.search.narrow(self.search.on.copy(), value, slope, near_zero)

    def _may_hide(self, distance: Floats) -> Flags:
        """Where the motion turns inside the step, near enough to a switch to have crossed it and come back.

        A step that ends on the turning point hides nothing: position is monotone along it.
        """
        turns: Flags = self.y[1] * self.y_new[1] < 0.0
        if turns.any():
            reach = self.trial * np.maximum(np.abs(self.y[1]), np.abs(self.y_new[1])) / self.size[0]
            turns &= distance < reach
        return turns

    def _resize(self, which: Flags, fine: Flags) -> None:
        """The next step's size from this one's error; one cut short by a limit says little about growth."""
        factor = np.where(np.isfinite(self.error), 0.9 * np.maximum(self.error, 1e-16) ** -0.125, _SHRINK)
        wanted = self.trial * np.minimum(np.maximum(factor, _SHRINK), np.where(fine, _GROW, 1.0))
        cut = fine & (self.trial < self.h)
        np.copyto(self.h, np.where(cut, np.maximum(self.h, wanted), wanted), where=which)
        stuck = which & ~fine & (self.h < 1e-13 * self.size[0] / self.size[1])
        if stuck.any():
            i = int(np.flatnonzero(stuck)[0])
            where = f"no step is short enough at t = {float(self.t[i])!r} s"
            raise EngineFailed("vibroimpact", where, "finite, bounded forces")

    def commit(self, taken: Flags, watch: Watch) -> None:
        """Take the steps, switch modes where one ended, pass stops, drop lanes that have arrived."""
        np.copyto(self.t, self.t_new, where=taken)
        np.copyto(self.y, self.y_new, where=taken)
        np.copyto(self.turned, self.turning, where=taken)
        self.turning &= ~taken
        before = self.mode[:, taken]
        switched = taken & self.located
        if switched.any():
            y, lane = self.y[:, switched], self.lane[switched]
            self.mode[:, switched] = self.flow.switched(
                y, self.mode[:, switched], self.switch[switched], lane
            )
            self.phase = self.flow.phase(self.mode, self.lane)
            np.copyto(self.h, np.minimum(self.phase.first_step(), self.step_max), where=switched)
        watch.step(self.lane[taken], self.t[taken], self.y[:, taken], before, self.mode[:, taken])
        arrived = np.flatnonzero(taken & (self.t >= self.until))
        if arrived.size:
            watch.stop(self.lane[arrived], self.next[arrived], self.y[:, arrived])
            self._on(arrived)

    def _on(self, arrived: Indices) -> None:
        """Send lanes at a stop on to their next; drop those that had their last."""
        self.next[arrived] += 1
        more = arrived[self.next[arrived] < len(self.stops)]
        self.until = self.until.copy()
        self.until[more] = self.stops[self.next[more], self.lane[more]]
        if more.size == arrived.size:
            return
        stay = self.next < len(self.stops)
        for name in ("lane", "t", "h", "until", "step_max", "next", "turning", "turned"):
            setattr(self, name, getattr(self, name)[stay])
        self.y, self.mode, self.size = self.y[:, stay], self.mode[:, stay], self.size[:, stay]
        self.search.keep(stay)
        self.phase = self.flow.phase(self.mode, self.lane)
