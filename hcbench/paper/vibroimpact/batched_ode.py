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
from hcbench.paper.vibroimpact.bracketing import Searches, root_of_cubic

if TYPE_CHECKING:
    from hcbench.impact import Floats
    from hcbench.paper.vibroimpact.bracketing import Flags

Modes: TypeAlias = NDArray[np.int8]
Indices: TypeAlias = NDArray[np.intp]

SURFACES = 2  # switches numbered below are met at a position; others wherever
STOP = -1  # the number of a stop among switches
_STAGES = 12
_A = [DOP853.A[i, :i].copy() for i in range(_STAGES)]
_B, _C = DOP853.B, DOP853.C[:_STAGES]
_ERRORS = np.array([DOP853.E5[:_STAGES], DOP853.E3[:_STAGES]])
_EPS = float(np.finfo(float).eps)
_GROW, _SHRINK = 4.0, 0.2


def _mix(weights: Floats, stages: Floats) -> Floats:
    """Weighted sum of stages, column by column: BLAS would let a lane's last bit depend on its neighbours."""
    return np.asarray(np.einsum("i,ij->j", weights, stages))


class Phase(Protocol):
    """Lanes in fixed modes, in variables z of the phase's own choice; arrays have one column a lane.

    z = (position or what stands for it, velocity, the rest of y, time), over a parameter σ of its own. Where
    `plain` is set, z is (y, t) itself and σ is time.
    """

    plain: Flags
    size: Floats  # of the components of z, what errors are measured over, shape of z

    def enter(self, t: Floats, y: Floats) -> Floats:
        """z at t, y."""
        ...

    def leave(self, z: Floats) -> tuple[Floats, Floats]:
        """t, y at z."""
        ...

    def rates(self, z: Floats) -> Floats:
        """dz/dσ."""
        ...

    def distances(self, z: Floats) -> tuple[Floats, Indices, Floats]:
        """How far each lane is from its next switch (below 0: beyond), that switch, and d distance/dσ.

        The last is NaN where it is not known. All have shape (lanes,).
        """
        ...

    def first_step(self) -> Floats:
        """Step in σ to begin these modes with, shape (lanes,)."""
        ...

    def longest_step(self, z: Floats, time: Floats) -> Floats:
        """The steps in σ that last about `time` (s)."""
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
    """Where every lane starts: t (s), y (components, lanes), mode (sides, lanes)."""

    t: Floats
    y: Floats
    mode: Modes


@dataclass(frozen=True, slots=True)
class Control:
    """How finely to step.

    tolerance: error of a step over the size of the motion. step_max: longest step of each lane, s, shape
    (lanes,). trials_max: when to give up.
    """

    tolerance: float
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
        self.mode, self.step_max = lanes.mode.copy(), control.step_max
        self.next = np.zeros(self.lane.size, dtype=np.intp)
        self.until = stops[0]
        self.phase = flow.phase(self.mode, self.lane)
        self.z = self.phase.enter(lanes.t, lanes.y)
        self.h = self.phase.first_step()
        self.search = Searches(self.lane.size)
        self.turning = np.zeros(self.lane.size, dtype=bool)  # the search is for a turning point
        self.turned = np.zeros(self.lane.size, dtype=bool)  # the last step ended on a turning point

    def try_step(self) -> None:
        """One trial a lane: of the size its errors allow, or the one that its search asks for."""
        z, rates, plain = self.z, self.phase.rates, self.phase.plain
        left = self.until - z[-1]
        free = np.minimum(self.h, self.phase.longest_step(z, self.step_max))
        free = np.where(plain, np.minimum(free, left), free)
        self.trial = h = np.where(self.search.on, self.search.trial, free)
        k = np.empty((_STAGES, *z.shape))
        flat = k.reshape(_STAGES, -1)
        k[0] = rates(z)
        for i in range(1, _STAGES):
            k[i] = rates(z + h * _mix(_A[i], flat[:i]).reshape(z.shape))
        self.z_new = z + h * _mix(_B, flat).reshape(z.shape)
        np.copyto(self.z_new[-1], self.until, where=plain & (h >= left))
        self.braking = k[0, 1], k[-1, 1]  # at both ends: the last stage is at the end, too
        self.speeds = k[0, 0], k[-1, 0]
        errors = np.array([_mix(e, flat) for e in _ERRORS]).reshape(2, *z.shape) / (
            self.control.tolerance * self.phase.size
        )
        squares = errors[:, 0] ** 2
        for i in range(1, len(z)):
            squares += errors[:, i] ** 2
        fifth, third = squares
        bottom = np.sqrt((len(z) - 1.0) * (fifth + 0.01 * third))
        self.error = h * fifth / np.maximum(bottom, 1e-300)

    def judge(self) -> Flags:
        """Which trials are taken as steps. The others are aimed anew."""
        distance, self.switch, rate = self._distances(self.z_new)
        heading = self.z_new[1] * np.sign(self.z[1]) / self.phase.size[1]
        searching = self.search.on.copy()
        fine = self.error <= 1.0  # a NaN is not
        taken = ~searching & fine
        found = self._narrow(heading, distance, rate) if searching.any() else searching
        turn = taken & ~self.turned & self._may_hide(distance, rate)
        # A turning point found beyond a switch: the switch comes first.
        crossed = ((taken & ~turn) | (found & self.turning)) & (distance < 0.0)
        starts = turn | crossed
        if starts.any():
            self._start(turn, crossed, heading, distance)
        self._resize(~searching, fine)
        self.located = found & ~self.turning & ~crossed
        steps: Flags = (taken | found) & ~starts
        return steps

    def _distances(self, z: Floats) -> tuple[Floats, Indices, Floats]:
        """Of the nearest switch, or of a stop that comes first: where σ is not time, it has to be found."""
        distance, switch, rate = self.phase.distances(z)
        early = (self.until - z[-1]) / self.phase.size[-1]
        stops = ~self.phase.plain & (early < distance)
        if stops.any():
            distance, switch = np.where(stops, early, distance), np.where(stops, STOP, switch)
            rate = np.where(stops, np.nan, rate)
        return distance, switch, rate

    def _start(self, turn: Flags, crossed: Flags, heading: Floats, distance: Floats) -> None:
        """Begin searches for turning points and switches inside the trials."""
        before, _, _ = self._distances(self.z)
        # What has just switched left its distance at 0, give or take rounding: the good side by definition.
        self.search.start(crossed, self.trial, np.maximum(before, 0.0), distance)
        self.search.start(turn, self.trial, np.abs(self.z[1]) / self.phase.size[1], heading)
        self.turning = (self.turning | turn) & ~crossed
        surfaces = (self.switch >= 0) & (self.switch < SURFACES)
        surface = np.flatnonzero(crossed & surfaces & (before > 0.0))
        if surface.size:
            place = np.array([self.z[0, surface], self.z_new[0, surface]])
            speed = np.array([end[surface] for end in self.speeds])
            share = before[surface] / (before[surface] - distance[surface])
            guess = root_of_cubic(self.trial[surface], place, speed, share)
            self.search.trial[surface] = self.trial[surface] * guess

    def _narrow(self, heading: Floats, distance: Floats, rate: Floats) -> Flags:
        value = np.where(self.turning, heading, distance)
        braking = self.braking[1] * np.sign(self.z[1]) / self.phase.size[1]
        slope = np.where(self.turning, braking, rate)
        rounding = np.where(self.turning, 0.0, np.abs(self.z[0]) / self.phase.size[0])
        rounding = np.where(self.switch == STOP, self.until / self.phase.size[-1], rounding)
        near_zero = max(1e-15, 1e-4 * self.control.tolerance) + 4.0 * _EPS * rounding
        return self.search.narrow(self.search.on.copy(), value, slope, near_zero)

    def _may_hide(self, distance: Floats, rate: Floats) -> Flags:
        """Where the motion turns inside the step, near enough to a switch to have crossed it and come back.

        A step that ends on the turning point hides nothing: position is monotone along it.
        """
        turns: Flags = self.z[1] * self.z_new[1] < 0.0
        if turns.any():
            turns &= ~(rate < 0.0)  # what it nears at the end it was leaving before it turned
            slower = np.maximum(np.abs(self.z_new[1]), 1e-300)
            reach = self.trial * rate * np.maximum(np.abs(self.z[1]), slower) / slower
            turns &= ~(distance >= reach)
        return turns

    def _resize(self, which: Flags, fine: Flags) -> None:
        """The next step's size from this one's error; one cut short by a limit says little about growth."""
        factor = np.where(np.isfinite(self.error), 0.9 * np.maximum(self.error, 1e-16) ** -0.125, _SHRINK)
        wanted = self.trial * np.minimum(np.maximum(factor, _SHRINK), np.where(fine, _GROW, 1.0))
        cut = fine & (self.trial < self.h)
        np.copyto(self.h, np.where(cut, np.maximum(self.h, wanted), wanted), where=which)
        stuck = which & ~fine & (self.h < 1e-13 * self.phase.size[0] / self.phase.size[1])
        if stuck.any():
            i = int(np.flatnonzero(stuck)[0])
            where = f"no step is short enough at t = {float(self.z[-1, i])!r} s"
            raise EngineFailed("vibroimpact", where, "finite, bounded forces")

    def commit(self, taken: Flags, watch: Watch) -> None:
        """Take the steps, switch modes where one ended, pass stops, drop lanes that have arrived."""
        np.copyto(self.z, self.z_new, where=taken)
        at_stop = taken & self.located & (self.switch == STOP)
        np.copyto(self.z[-1], self.until, where=at_stop)
        np.copyto(self.turned, self.turning, where=taken)
        self.turning &= ~taken
        before = self.mode[:, taken]
        t, y = self.phase.leave(self.z)
        switched = taken & self.located & ~at_stop
        if switched.any():
            here, lane = y[:, switched], self.lane[switched]
            self.mode[:, switched] = self.flow.switched(
                here, self.mode[:, switched], self.switch[switched], lane
            )
            self.phase = self.flow.phase(self.mode, self.lane)
            np.copyto(self.z, self.phase.enter(t, y), where=switched)
            np.copyto(self.h, self.phase.first_step(), where=switched)
        watch.step(self.lane[taken], t[taken], y[:, taken], before, self.mode[:, taken])
        arrived = np.flatnonzero(taken & (t >= self.until))
        if arrived.size:
            watch.stop(self.lane[arrived], self.next[arrived], y[:, arrived])
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
        for name in ("lane", "h", "until", "step_max", "next", "turning", "turned"):
            setattr(self, name, getattr(self, name)[stay])
        self.z, self.mode = self.z[:, stay], self.mode[:, stay]
        self.search.keep(stay)
        self.phase = self.flow.phase(self.mode, self.lane)
