"""Decides at which step each launch has parted, come to rest, diverged
or timed out: one rule for all.

The decision does not depend on how many steps are looked at together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from hcbench.sim.columns import Launches
from hcbench.terms.impact import Floats, Launch, not_finite

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Whole = NDArray[np.int64]
    Flags = NDArray[np.bool_]

# A touch must come within so many times the flight, and so many steps more: Bullet's
# contact acts from 10 µm deep on.
FLIGHT_SLACK = 4.0
FLIGHT_SLACK_STEPS = 5000
# Steps within which any touch must come.
FLIGHT_STEPS_MAX = 2_000_000
# Longest contact, s: no bounce that anybody measures lasts longer.
CONTACT_S = 5.0
# Steps of the longest contact: at least, and at most.
CONTACT_STEPS_MIN = 500
CONTACT_STEPS_MAX = 500_000
# Share of the speed at touch that is slower than any bounce.
REST_SHARE = 1e-6
# Steps for which a body at rest is so slow.
REST_STEPS = 32
# Share of the speed at touch that counts as slow where no force acts.
IDLE_SHARE = 1e-3
# Steps for which a body at rest is idle so.
IDLE_STEPS = 128
# A body that gravity holds down is slower than so many times the speed
# that gravity gives in a step.
FALL_STEPS = 1.5
# Steps for which a body at rest is held so.
FALLING_STEPS = 128

# Beyond every step.
_NEVER = 1 << 62


class End(IntEnum):
    """Reason why a launch has ended; if two apply in one step, the one listed first."""

    GOING = 0
    NOT_FINITE = 1
    TOO_DEEP = 2
    PARTED = 3
    RESTED = 4
    TURNED_BACK = 5
    NEVER_TOUCHED = 6
    UNFINISHED = 7


@dataclass(slots=True)
class QuietRun:
    """Watches for a run of steps that all meet a condition.

    least: steps that the run must have.
    half_contact: and at least half of the contact so far.
    last_broken: the last step that did not meet the condition, shape (b,).
    """

    least: int
    half_contact: bool
    last_broken: Whole

    def long_enough(self, met: Flags, touch: Whole, start: int) -> Flags:
        """Mask, (b, n), of the steps of a chunk at which the condition has been met for long enough:
        for `least` steps, and, if `half_contact`, for half of the contact so far.

        met: where the condition is met, (b, n).
        touch: index of the step of the touch, (b,).
        start: index of the chunk's first step. Chunks have to follow one another: the last step
        that broke the condition is remembered.
        """
        step = np.arange(start, start + met.shape[1])
        # Nearly always no step is quiet.
        if not met.any():
            self.last_broken[:] = step[-1]
            return np.zeros(met.shape, bool)
        broken = np.maximum.accumulate(np.where(met, self.last_broken[:, None], step), axis=1)
        self.last_broken = broken[:, -1].copy()
        in_contact = step - np.minimum(touch[:, None], step)
        least = np.maximum(self.least, in_contact // 2) if self.half_contact else self.least
        return np.asarray(step - broken >= least)


@dataclass(slots=True)
class StopRule:
    """Watches launches that are simulated side by side; arrays of shape (b,).

    flight_steps: steps within which a touch must come.
    contact_steps: and a contact end.
    rest_speed: m/s.
    fall: speed that gravity gives in a step, m/s.
    deepest: m, penetration beyond which nothing is seen.
    touch: the step in which the force first acted, or beyond every step.
    last_x: penetration of the last step seen, m.
    still, idle, held, stuck: runs of quiet steps, any of which is rest.
    parted: the first step apart after the touch, or beyond every step.
    after: steps to see after it.
    steps: seen so far.
    """

    flight_steps: Whole
    contact_steps: int
    rest_speed: Floats
    fall: float
    deepest: float
    touch: Whole
    last_x: Floats
    still: QuietRun
    idle: QuietRun
    held: QuietRun
    stuck: QuietRun
    parted: Whole
    after: int = 0
    steps: int = 0

    @classmethod
    def for_launches(
        cls,
        launches: Sequence[Launch],
        timestep: float,
        gravity: float,
        deepest: float = math.inf,
        after: int = 0,
    ) -> StopRule:
        """The rule for b launches, before any step: how long to wait for a touch and in contact, and
        when a body counts as resting.

        timestep: s.
        gravity: into the plate, m/s².
        deepest: penetration, m, beyond which a launch is TOO_DEEP.
        after: steps to wait for once the bodies are apart.
        """
        columns = Launches.of(launches)
        # Steps from release to touch.
        flights = columns.flight_time(timestep, gravity) / timestep
        flight_steps = np.minimum(
            np.ceil(FLIGHT_SLACK * flights) + FLIGHT_SLACK_STEPS, FLIGHT_STEPS_MAX
        )
        contact = max(CONTACT_STEPS_MIN, min(math.ceil(CONTACT_S / timestep), CONTACT_STEPS_MAX))

        def run(least: int, half_contact: bool) -> QuietRun:
            return QuietRun(least, half_contact, np.full(len(launches), -1))

        return cls(
            flight_steps=flight_steps.astype(np.int64),
            contact_steps=contact,
            rest_speed=REST_SHARE * columns.touch_speed(timestep, gravity),
            fall=abs(gravity) * timestep,
            deepest=deepest,
            touch=np.full(len(launches), _NEVER),
            last_x=np.full(len(launches), np.nan),
            # Slower than any bounce.
            still=run(REST_STEPS, half_contact=False),
            # Slow and without force, within an overlap that the engine permits,
            # such as Bullet's contactSlop.
            idle=run(IDLE_STEPS, half_contact=True),
            # So slow that in as many steps the weight pushes it deeper
            # than its speed can carry it out.
            held=run(FALLING_STEPS, half_contact=True),
            # In one place to the last bit: in float32 a speed may be too small to move the position
            # at all, and grow by gravity until the contact takes it away.
            stuck=run(IDLE_STEPS, half_contact=True),
            parted=np.full(len(launches), _NEVER),
            after=after,
        )

    def add(self, x: Floats, v: Floats, f: Floats) -> tuple[Whole, Whole]:
        """Look at one more chunk of steps, and decide which launches have ended.

        x, v, f: penetration, m, rate, m/s, and force, N, (b, n).
        Returns how many of all steps belong to each launch, (b,), 0 where it has not ended, and why
        it has (`End`), (b,).
        """
        start = self.steps
        end = start + x.shape[1]
        acting = f != 0.0
        leaving = v < 0.0
        # Steps, counted from the launch, (b,): of the touch, of turning back, of the end of waiting
        # for a touch, and of the end of waiting in contact.
        self.touch = np.minimum(self.touch, _first(acting, start))
        turned = _first(leaving, start)
        waited = np.maximum(self.flight_steps - 1, start)
        over = np.maximum(self.touch + self.contact_steps, start)
        untouched = turned < self.touch
        parted = leaving & ~acting
        parted &= x <= 0.0
        self.parted = np.minimum(self.parted, np.where(untouched, _NEVER, _first(parted, start)))
        # With the free steps that are wanted after the parting, which later chunks may bring.
        whole = self.parted + self.after
        bad = not_finite(x, v, f)
        never = np.full(len(x), _NEVER)
        # For each reason the step at which it first applies, (b,); in the order of `End`.
        whens = {
            End.NOT_FINITE: _first(bad, start) if bad.any() else never,
            End.TOO_DEEP: _first(x > self.deepest, start) if self.deepest < math.inf else never,
            End.PARTED: np.where(whole < end, whole, _NEVER),
            End.RESTED: self._rested(x, v, acting),
            End.TURNED_BACK: np.where(untouched, turned, _NEVER),
            End.NEVER_TOUCHED: np.where(waited < np.minimum(self.touch, end), waited, _NEVER),
            End.UNFINISHED: np.where(over < end, over, _NEVER),
        }
        self.steps = end
        steps = np.stack(list(whens.values()))
        first = steps.min(axis=0)
        ended = first < _NEVER
        # Of reasons in the same step `argmin` takes the first, which is the weightiest.
        why = np.array([*whens])[steps.argmin(axis=0)]
        return np.where(ended, first + 1, 0), np.where(ended, why, End.GOING)

    def _rested(self, x: Floats, v: Floats, acting: Flags) -> Whole:
        """The first step at rest of each launch, (b,); beyond every step for one that is not.

        x: penetration, m; v: rate, m/s; acting: where the force acts; all of the coming steps, (b,
        n).
        A launch rests where one of the four runs of quiet steps is long enough; two of them need
        gravity. Each run remembers its last loud step: call this once for each chunk, in order.
        """
        speed = np.abs(v)
        idle_speed = IDLE_SHARE / REST_SHARE * self.rest_speed
        touched = np.arange(self.steps, self.steps + x.shape[1]) >= self.touch[:, None]
        quiet = [
            (self.still, speed <= self.rest_speed[:, None]),
            (self.idle, ~acting & (speed <= idle_speed[:, None])),
        ]
        if self.fall > 0.0:
            before = np.concatenate([self.last_x[:, None], x[:, :-1]], axis=1)
            self.last_x = x[:, -1].copy()
            quiet += [(self.held, speed <= FALL_STEPS * self.fall), (self.stuck, x == before)]
        rested = np.zeros(x.shape, bool)
        for run, met in quiet:
            rested |= run.long_enough(touched & met, self.touch, self.steps)
        return _first(rested, self.steps)

    def keep(self, which: Flags) -> None:
        """Watch only these from now on: a mask of shape (b,)."""
        for name in ("flight_steps", "rest_speed", "touch", "last_x", "parted"):
            setattr(self, name, getattr(self, name)[which])
        for run in (self.still, self.idle, self.held, self.stuck):
            run.last_broken = run.last_broken[which]


def _first(flag: Flags, start: int) -> Whole:
    """The first step of each launch in which a flag is set, shape (b, n)
    from `start` on; else `_NEVER`.
    """
    at = flag.argmax(axis=1)
    return np.where(flag[np.arange(len(flag)), at], start + at, _NEVER)
