"""Drops a robot in any engine, and reads its motion for the quantities that judge the landing."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.sim.landing import (
    DROPS,
    FALLEN,
    LATE_S,
    MANY_REBOUNDS,
    REST_SPEED,
    SECONDS,
    SECONDS_TO_FALL,
    TAIL_S,
    DropTest,
    Landed,
    Robot,
    RobotDrop,
)
from hcbench.sim.touch import PARTED_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hcbench.terms.impact import Floats

# A centre of mass that is farther from its start, m, has diverged.
_FARTHEST = 50.0


class DropBench(ABC):
    """A robot over its floor, in its pose, that an engine drops as often as it is asked.

    timestep: s.
    gravity: m/s².
    drops: that judge its landing: DROPS, without the tilted ones for a robot that cannot turn.
    """

    robot: Robot
    timestep: float
    gravity: float
    drops: Sequence[RobotDrop] = DROPS

    @abstractmethod
    def test(self, seconds: float, drops: Sequence[RobotDrop]) -> DropTest:
        """Drop the robot with the contacts that it has now. seconds: of each drop."""

    def whole_test(self, like: DropTest | None, until_worse: bool = False) -> DropTest:
        """Make every drop, each for as long as `like` took, to be compared with it. Then make those
        that show how the rebound varies with where in a step the robot touches: at more places than
        a search saw.

        like: another test of the robot; None: each drop lasts until the robot rests.
        until_worse: return the hardest drop alone where that already is worse than all of `like`.
        """
        if like is None:
            test = self._until_rest()
        else:
            if until_worse:
                # The highest, tilted. Quantities are the largest of all drops: others change
                # nothing.
                hardest = self.test(like.seconds, self.drops[-1:])
                if any(hardest.worse_than(like)):
                    return hardest
            test = self.test(like.seconds, self.drops)
        if test.diverged:
            return test
        many = self.test(min(test.seconds, SECONDS_TO_FALL), MANY_REBOUNDS)
        if many.diverged:
            return many
        return replace(test, rebound=many.rebound, spread=many.spread, phases=many.phases)

    def _until_rest(self) -> DropTest:
        """Make every drop for as long as a standing robot takes to rest; only until the touch for a
        robot that falls over.
        """
        # Where a robot lies that fell over is chance: only its touch can be compared. One drop
        # shows most robots that fall, and saves the others.
        if self.test(SECONDS, self.drops[-1:]).fell:
            return self.test(SECONDS_TO_FALL, self.drops)
        test = self.test(SECONDS, self.drops)
        if test.fell:
            return self.test(SECONDS_TO_FALL, self.drops)
        return test


@dataclass(frozen=True, slots=True)
class DropMotion:
    """A drop as an engine shows it, SI: a row for each of n steps.

    centre, velocity, (n, 3): of the centre of mass. force, (n,): of the floor along the vertical.
    distance, (n,): of the deepest point to the floor, below 0 inside. energy, (n,): of the robot,
    with that of what holds its pose as a spring.
    """

    centre: Floats
    velocity: Floats
    force: Floats
    distance: Floats
    energy: Floats


@dataclass(frozen=True, slots=True)
class DroppedRobot:
    """A robot whose motion is read.

    timestep: s.
    gravity: m/s².
    up: unit vector against it, (3,).
    weight: N.
    height: of the centre of mass over the lowest point at release, m.
    """

    timestep: float
    gravity: float
    up: Floats
    weight: float
    height: float

    def landed(self, motion: DropMotion, height: float) -> Landed | None:
        """The quantities of the landing that a motion shows, SI; None where the robot flies off or
        never touches the floor, or where a number is not finite.

        height: of the lowest point over the floor at release, m.
        """
        if not _is_finite(motion):
            return None
        pushes = motion.force > 0.0
        if np.abs(motion.centre - motion.centre[0]).max() > _FARTHEST or not pushes.any():
            return None
        touch = int(np.argmax(pushes))
        flights = _flights(pushes, touch, self.timestep)
        rising = motion.velocity @ self.up
        fastest = max((float(rising[start]) for start, _ in flights), default=0.0)
        left = flights[0][0] if flights else len(pushes)
        end = self._settling(motion, touch, flights)
        return Landed(
            # The height that a throw at this speed reaches.
            rebound=max(fastest, 0.0) ** 2 / (2.0 * self.gravity),
            contact=(left - touch) * self.timestep,
            peak=float(motion.force.max()) / self.weight,
            depth=-float(motion.distance.min()),
            gain=_gain(motion.energy, touch, flights) / (self.weight * height),
            rest=end.rest,
            sink=end.sink,
            travel=end.travel,
            creep=end.creep,
            vibration=end.vibration,
            late=end.late,
            sag=end.sag,
            fell=end.fell,
        )

    def _settling(
        self, motion: DropMotion, touch: int, flights: list[tuple[int, int]]
    ) -> _Settling:
        """The end of a drop: how the robot came to rest after the touch, and lies in the last
        TAIL_S seconds.

        motion: of the robot in each step, from release on.
        touch: index of the first step in which the floor pushes.
        flights: (first step, step after the last) of each flight after the touch. All is NaN for a
        drop that does not last longer than LATE_S + TAIL_S.
        """
        h = self.timestep
        count = len(motion.force)
        if not count * h > LATE_S + TAIL_S:
            return _Settling()
        tail = slice(max(touch, count - round(TAIL_S / h)), count)
        # The centre of mass, split into its height and its place along the floor, m.
        height = motion.centre @ self.up
        place = motion.centre - np.outer(height, self.up)
        velocity = motion.velocity[tail]
        speed = np.linalg.norm(motion.velocity, axis=1)
        last_moving = int(np.flatnonzero(speed > REST_SPEED)[-1])
        # Never, if it still moves in the last two steps.
        rest = math.inf if last_moving >= count - 2 else (last_moving + 1 - touch) * h
        about_mean = velocity - velocity.mean(0)
        # Not -float(...): -0.0 would print with a sign.
        sink = 0.0 - float(np.median(motion.distance[tail]))
        # The first step in which the floor pushes begins below the touch, by up to the way of a step.
        at_touch = float(height[touch]) - min(float(motion.distance[touch]), 0.0)
        lowered = at_touch - float(np.median(height[tail]))
        return _Settling(
            rest=rest,
            sink=sink,
            travel=float(np.linalg.norm(place[-1] - place[touch])),
            creep=float(np.linalg.norm(place[-1] - place[tail.start])) / ((count - tail.start) * h),
            vibration=float(np.sqrt((about_mean**2).sum(1).mean())),
            late=float(sum(start * h > LATE_S for start, _ in flights)),
            # The legs give way by what the contacts do not.
            sag=lowered - sink,
            fell=lowered > (1.0 - FALLEN) * self.height,
        )


@dataclass(frozen=True, slots=True)
class _Settling:
    """The end of a drop; NaN and false for a drop that is too short to settle.

    rest: time from the touch until it lies still, s, infinite if it does not.
    sink: of the deepest point into the floor, m.
    travel: along the floor since the touch, m.
    creep: mean speed along the floor in the end, m/s.
    vibration: rms of the centre's velocity about its mean there, m/s.
    late: number of flights that begin after LATE_S.
    sag: lowering of the centre since the touch that is not sink, m.
    fell: whether the robot fell over.
    """

    rest: float = math.nan
    sink: float = math.nan
    travel: float = math.nan
    creep: float = math.nan
    vibration: float = math.nan
    late: float = math.nan
    sag: float = math.nan
    fell: bool = False


def _is_finite(motion: DropMotion) -> bool:
    every = (motion.centre, motion.velocity, motion.force, motion.distance, motion.energy)
    return all(bool(np.isfinite(each).all()) for each in every)


def _flights(pushes: NDArray[np.bool_], touch: int, timestep: float) -> list[tuple[int, int]]:
    """(first step, step after the last) of each flight after the touch that is longer than chatter:
    PARTED_S or more without a force.

    pushes: of each step, whether the floor pushes, (n,).
    touch: index of the first that does.
    timestep: s.
    """
    is_flying = ~pushes
    is_flying[:touch] = False
    # 1 where a flight begins, -1 at the step after its last.
    edges = np.diff(np.concatenate([[0], is_flying.astype(int), [0]]))
    starts = np.flatnonzero(edges == 1)
    ends = np.flatnonzero(edges == -1)
    lasting = (ends - starts) * timestep >= PARTED_S
    return list(zip(starts[lasting].tolist(), ends[lasting].tolist(), strict=True))


def _gain(energy: Floats, touch: int, flights: list[tuple[int, int]]) -> float:
    """Energy that the contact gave to the robot, J: the most with which a flight begins beyond the
    least energy before; 0 if none begins with more.

    energy: of each step, J, (n,).
    touch: index of the first step with a force.
    flights: (first step, step after the last) of each.
    Before the first flight the least is the energy at the touch, then also that at the end of each
    flight: in flight nothing adds energy.
    """
    least = float(energy[max(touch - 1, 0)])
    gain = 0.0
    for start, end in flights:
        gain = max(gain, float(energy[start]) - least)
        least = min(least, float(energy[end - 1]))
    return gain
