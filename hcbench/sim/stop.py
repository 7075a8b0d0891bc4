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
        never, moving = np.full(len(launches), np.iinfo(np.int64).max), np.full(len(launches), -1)
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

    def add(self, x: Floats, v: Floats, f: Floats) -> tuple[Whole, NDArray[np.int64]]:
        """Look at one more chunk of penetration, rate and force, shape (b, n).

        How many of all steps belong to each launch, 0 where it has not ended, and why it has (`End`).
        """
        step = np.arange(self.steps, self.steps + x.shape[1])
        acting = f != 0.0
        waiting = self.touch > step[-1]
        if waiting.any():
            new = waiting & acting.any(axis=1)
            self.touch[new] = self.steps + acting[new].argmax(axis=1)
        after = step >= self.touch[:, None]
        parted = x <= 0.0
        for needed in (v < 0.0, after, ~acting):
            parted &= needed
        checks = [
            (End.NOT_FINITE, not_finite(x, v, f)),
            (End.PARTED, parted),
            (End.RESTED, self._rested(after, x, v, acting, step)),
        ]
        if self.deepest < math.inf:
            checks.insert(1, (End.TOO_DEEP, x > self.deepest))
        if not after[:, 0].all():
            checks.append((End.TURNED_BACK, ~after & (v < 0.0)))
            checks.append((End.NEVER_TOUCHED, ~after & (step >= self.flight_steps[:, None] - 1)))
        if step[-1] - self.touch.min() >= self.contact_steps:
            checks.append((End.UNFINISHED, step - self.touch[:, None] >= self.contact_steps))
        self.steps += x.shape[1]
        checks = [(end, flag) for end, flag in checks if flag.any()]
        over = np.zeros(x.shape, bool)
        for _, flag in checks:
            over |= flag
        each, first = np.arange(len(x)), over.argmax(axis=1)
        why, ended = np.zeros(len(x), np.int64), over[each, first]
        for end, flag in reversed(checks):
            why[ended & np.broadcast_to(flag, x.shape)[each, first]] = end
        return np.where(ended, step[0] + first + 1, 0), why

    def _rested(self, after: Flags, x: Floats, v: Floats, acting: Flags, step: Whole) -> Flags:
        speed = np.abs(v)
        idle = speed <= IDLE_SHARE / REST_SHARE * self.rest_speed[:, None]
        idle &= after
        still = idle & (speed <= self.rest_speed[:, None])
        slow = [("last_moving", still, REST_STEPS), ("last_driven", idle & ~acting, IDLE_STEPS)]
        if self.fall > 0.0:
            slow.append(("last_faster", after & (speed <= FALL_STEPS * self.fall), FALLING_STEPS))
            in_place = after & (x == np.concatenate([self.last_x[:, None], x[:, :-1]], axis=1))
            slow.append(("last_moved", in_place, IDLE_STEPS))
            self.last_x = x[:, -1].copy()
        rested: Flags = np.zeros((), bool)
        for name, flag, least in slow:
            if not flag.any():  # nearly always
                getattr(self, name)[:] = step[-1]
                continue
            moving = np.maximum.accumulate(np.where(flag, getattr(self, name)[:, None], step), axis=1)
            setattr(self, name, moving[:, -1])
            half = 0 if flag is still else (step - np.minimum(self.touch[:, None], step)) // 2
            rested = rested | (step - moving >= np.maximum(least, half))
        return rested

    def keep(self, which: Flags) -> None:
        """Watch only these from now on."""
        for field in fields(self):
            if isinstance(value := getattr(self, field.name), np.ndarray):
                setattr(self, field.name, value[which])
