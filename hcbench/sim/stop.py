"""Decides at which step each launch has parted, come to rest, diverged or timed out: one rule for all.

The decision does not depend on how many steps are looked at together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from hcbench.impact import Floats, Launch, not_finite

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Whole = NDArray[np.int64]
    Flags = NDArray[np.bool_]

# A touch must come within so many times the flight, and steps: Bullet's acts from 10 µm deep on.
FLIGHT_SLACK, FLIGHT_SLACK_STEPS, FLIGHT_STEPS_MAX = 4.0, 5000, 2_000_000
CONTACT_S = 5.0  # s: no bounce that anybody measures lasts longer
CONTACT_STEPS_MIN, CONTACT_STEPS_MAX = 500, 500_000  # steps of a contact: at least, at most
# A body is at rest that has moved slower than 1e-6 of its speed at touch for 32 steps, ...
REST_SHARE, REST_STEPS = 1e-6, 32
# ... or for 128 steps and half of the contact no faster than gravity makes it in 1.5 steps. In so many steps
# the weight pushes it further in than that speed can carry it out: it cannot part any more.
FALL_STEPS, FALLING_STEPS = 1.5, 128
# ... or for as long, under gravity, in one place to the last bit: in float32 a speed may be too small for
# a step to move the position at all, and grow by gravity until the contact takes it away.
# ... or for 128 steps and half of the contact slower than 1e-3 of its speed at touch, without any force:
# it lies within an overlap that the engine lets pass, such as Bullet's contactSlop.
IDLE_SHARE, IDLE_STEPS = 1e-3, 128

_NEVER = 1 << 62  # beyond every step


class End(IntEnum):
    """Why a launch is over, the weightiest first where two reasons meet in one step."""

    GOING = 0
    NOT_FINITE = 1
    TOO_DEEP = 2
    PARTED = 3
    RESTED = 4
    TURNED_BACK = 5
    NEVER_TOUCHED = 6
    UNFINISHED = 7


@dataclass(slots=True)
class StopRule:
    """Watches launches that are simulated side by side; arrays of shape (b,).

    flight_steps: steps within which a touch must come. contact_steps: and a contact end. rest_speed: m/s.
    fall: speed that gravity gives in a step, m/s. deepest: m, penetration beyond which nothing is seen.
    steps: seen so far. touch: the step in which the force first acted, or beyond every step. last_moving,
    last_faster, last_driven, last_moved: the last step that was faster than `rest_speed`; than gravity makes
    a body at rest; in which a force acted or the body was not idle; and that began elsewhere than the one
    before, whose penetration was last_x, m.
    """

    flight_steps: Whole
    contact_steps: int
    rest_speed: Floats
    fall: float
    deepest: float
    touch: Whole
    last_moving: Whole
    last_faster: Whole
    last_driven: Whole
    last_moved: Whole
    last_x: Floats
    steps: int = 0

    @classmethod
    def for_launches(
        cls, launches: Sequence[Launch], timestep: float, gravity: float, deepest: float = math.inf
    ) -> StopRule:
        """A rule that has seen no step yet. gravity: into the plate, m/s²."""
        flights = np.array([launch.flight_time(timestep, gravity) for launch in launches]) / timestep
        flight_steps = np.minimum(np.ceil(FLIGHT_SLACK * flights) + FLIGHT_SLACK_STEPS, FLIGHT_STEPS_MAX)
        speeds = np.array([launch.touch_speed(timestep, gravity) for launch in launches])
        contact = max(CONTACT_STEPS_MIN, min(math.ceil(CONTACT_S / timestep), CONTACT_STEPS_MAX))
        never, moving = np.full(len(launches), _NEVER), np.full(len(launches), -1)
        return cls(
            flight_steps=flight_steps.astype(np.int64),
            contact_steps=contact,
            rest_speed=REST_SHARE * speeds,
            fall=abs(gravity) * timestep,
            deepest=deepest,
            touch=never,
            last_moving=moving,
            last_faster=moving.copy(),
            last_driven=moving.copy(),
            last_moved=moving.copy(),
            last_x=np.full(len(launches), np.nan),
        )

    def add(self, x: Floats, v: Floats, f: Floats) -> tuple[Whole, Whole]:
        """Look at one more chunk of penetration, rate and force, shape (b, n).

        How many of all steps belong to each launch, 0 where it has not ended, and why it has (`End`).
        """
        start, end = self.steps, self.steps + x.shape[1]
        acting, leaving = f != 0.0, v < 0.0
        self.touch = np.minimum(self.touch, _first(acting, start))
        turned, waited = _first(leaving, start), np.maximum(self.flight_steps - 1, start)
        over = np.maximum(self.touch + self.contact_steps, start)
        untouched = turned < self.touch
        parted = leaving & ~acting
        parted &= x <= 0.0
        bad, never = not_finite(x, v, f), np.full(len(x), _NEVER)
        whens = {
            End.NOT_FINITE: _first(bad, start) if bad.any() else never,
            End.TOO_DEEP: _first(x > self.deepest, start) if self.deepest < math.inf else never,
            End.PARTED: np.where(untouched, _NEVER, _first(parted, start)),
            End.RESTED: self._rested(x, v, acting),
            End.TURNED_BACK: np.where(untouched, turned, _NEVER),
            End.NEVER_TOUCHED: np.where(waited < np.minimum(self.touch, end), waited, _NEVER),
            End.UNFINISHED: np.where(over < end, over, _NEVER),
        }
        self.steps = end
        steps = np.stack(list(whens.values()))
        first = steps.min(axis=0)
        ended = first < _NEVER
        why = np.array([*whens])[steps.argmin(axis=0)]  # the weightiest comes first
        return np.where(ended, first + 1, 0), np.where(ended, why, End.GOING)

    def _rested(self, x: Floats, v: Floats, acting: Flags) -> Whole:
        """The first step at rest of each launch."""
        at_rest, speed = np.full(len(x), _NEVER), np.abs(v)
        idle_speed, fall = IDLE_SHARE / REST_SHARE * self.rest_speed, FALL_STEPS * self.fall
        slow = speed <= np.maximum(idle_speed, fall)[:, None]
        before = np.concatenate([self.last_x[:, None], x[:, :-1]], axis=1) if fall > 0.0 else x
        if fall > 0.0:
            slow |= x == before
            self.last_x = x[:, -1].copy()
        sinces = [self.last_moving, self.last_driven]
        sinces += [self.last_faster, self.last_moved] if fall > 0.0 else []
        # The few slow steps of each turn are no rest.
        some = (np.minimum.reduce(sinces) < self.steps - 1) | slow[:, -1]
        some |= np.count_nonzero(slow, axis=1) >= REST_STEPS
        last = self.steps + x.shape[1] - 1
        for since in sinces:
            since[~some] = last
        if not some.any():
            return at_rest
        step, touch = np.arange(self.steps, last + 1), self.touch[some, None]
        after, speed = step >= touch, speed[some]
        idle = after & ~acting[some] & (speed <= idle_speed[some, None])
        ways = [
            (self.last_moving, after & (speed <= self.rest_speed[some, None]), REST_STEPS),
            (self.last_driven, idle, IDLE_STEPS),
        ]
        if fall > 0.0:
            ways.append((self.last_faster, after & (speed <= fall), FALLING_STEPS))
            ways.append((self.last_moved, after & (x[some] == before[some]), IDLE_STEPS))
        rested = np.zeros(after.shape, bool)
        for since, flag, least in ways:
            if not flag.any():  # nearly always
                since[some] = last
                continue
            moving = np.maximum.accumulate(np.where(flag, since[some, None], step), axis=1)
            since[some] = moving[:, -1]
            half = 0 if since is self.last_moving else (step - np.minimum(touch, step)) // 2
            rested |= step - moving >= np.maximum(least, half)
        at_rest[some] = _first(rested, self.steps)
        return at_rest

    def keep(self, which: Flags) -> None:
        """Watch only these from now on."""
        for field in fields(self):
            if isinstance(value := getattr(self, field.name), np.ndarray):
                setattr(self, field.name, value[which])


def _first(flag: Flags, start: int) -> Whole:
    """The first step of each launch in which a flag is set, shape (b, n) from `start` on; else `_NEVER`."""
    at = flag.argmax(axis=1)
    return np.where(flag[np.arange(len(flag)), at], start + at, _NEVER)
