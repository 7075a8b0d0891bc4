"""Reads impacts while they are stepped: 18 numbers a launch are all that is kept.

`reader(xp)` makes the function of one step from `where`, `abs`, `logical_and` and `logical_or` of
an array library: NumPy, `jax.numpy`, under jit too, or Warp, a launch in each thread. It ends
launches by the rule of `hcbench.sim.stop`, and `hcbench.sim.read_impact` makes impacts of its
numbers: in float64, to the bit those of a record of all steps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.sim.read_impact import EndedContacts
from hcbench.sim.stop import (
    FALL_STEPS,
    FALLING_STEPS,
    IDLE_SHARE,
    IDLE_STEPS,
    REST_SHARE,
    REST_STEPS,
    End,
    StopRule,
)
from hcbench.terms.resolution import ROUND_OFF_STEP

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.sim.columns import Launches
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene


class Rule(NamedTuple):
    """Constants of the stop rule for the launches of one scene, SI, as arrays
    that an engine's device can hold.

    flight_steps, rest_speed, idle_speed: shape (b,), with the meaning they have in `StopRule`; so
    have contact_steps, fall and lowest, its `deepest`.
    held_speed: at which a body falls no longer; -1 without gravity.
    radius, beyond: of the body, in the engine's bits, and what these leave out, m.
    noise: share of a speed that is round-off.
    largest: finite number.
    """

    flight_steps: Any
    rest_speed: Any
    idle_speed: Any
    contact_steps: Any
    fall: Any
    held_speed: Any
    lowest: Any
    radius: Any
    beyond: Any
    mass: Any
    timestep: Any
    noise: Any
    largest: Any


class Reading(NamedTuple):
    """State of each launch after the steps read so far, shape (b,), SI: 32-bit
    integers, then the engine's floats.

    steps: seen until it ended; end: why it has (`End`).
    touch, last: first and last step in which the contact force acted, -1 for none.
    still, idle, held, stuck: the last step that was not so.
    height, rising: of the body's centre after the last step; x_before: the penetration before it.
    x_in, v_in: penetration and rate as the force begins to act; x_out, v_out: after it has ceased.
    deepest, hardest: the largest penetration and force of the contact; sunk: the largest
    penetration since the touch.
    """

    steps: Any
    end: Any
    touch: Any
    last: Any
    still: Any
    idle: Any
    held: Any
    stuck: Any
    height: Any
    rising: Any
    x_before: Any
    x_in: Any
    v_in: Any
    x_out: Any
    v_out: Any
    sunk: Any
    deepest: Any
    hardest: Any


# Fields of a rule that each launch has of its own.
EACH = Rule._fields[:3]
# Beyond every step.
NEVER = 2**31 - 1
# Fields that are whole numbers.
WHOLE = ("flight_steps", "contact_steps", *Reading._fields[:8])


def rule_for(launches: Launches, scene: Scene, timestep: float, bits: int, kind: type) -> Rule:
    """Return the rule for launches of a scene's ball.

    bits: of the engine's numbers.
    kind: NumPy type of the reading.
    """
    rule = StopRule.for_launches(launches, timestep, scene.normal_gravity, scene.touch_radius)
    made = Rule(
        flight_steps=rule.flight_steps,
        rest_speed=rule.rest_speed,
        idle_speed=IDLE_SHARE / REST_SHARE * rule.rest_speed,
        contact_steps=rule.contact_steps,
        fall=scene.normal_gravity * timestep,
        held_speed=FALL_STEPS * rule.fall if rule.fall > 0.0 else -1.0,
        lowest=rule.deepest,
        radius=scene.touch_radius,
        beyond=scene.touch_radius - float(kind(scene.touch_radius)),
        mass=scene.mass,
        timestep=timestep,
        noise=ROUND_OFF_STEP * float(np.finfo(f"f{bits // 8}").eps),
        largest=float(np.finfo(kind).max),
    )
    return Rule(*_typed(made, kind))


def begun(heights: Floats, rising: Floats, kind: type) -> Reading:
    """The reading before the first step.

    heights, m, rising, m/s: of the bodies as the engine has them, shape (b,).
    """
    none = np.full(len(heights), -1)
    zero = np.zeros(len(heights))
    unknown = np.full(len(heights), np.nan)
    floats = heights, rising, unknown, *[zero] * 7
    return Reading(*_typed(Reading(zero, zero, *[none] * 6, *floats), kind))


def _typed(numbers: Any, kind: type) -> list[Any]:
    """The fields of a named tuple as arrays: whole numbers of 32 bits, the others of this kind."""
    arrays: list[Any] = []
    for name, value in zip(numbers._fields, numbers, strict=True):
        arrays.append(np.asarray(value, np.int32 if name in WHOLE else kind))
    return arrays


def reader(xp: Any) -> Callable[..., tuple[Any, ...]]:
    """The function that adds a step to a reading: (height, rising, *rule,
    *reading) -> the next reading.

    height, rising: of each body's centre after the step, m and m/s, (b,). The fields of `Rule` and
    `Reading` follow in their order. The contact's force is what the step does to the momentum.
    """
    size = xp.abs
    where = xp.where
    both = xp.logical_and
    either = xp.logical_or
    rest_steps = REST_STEPS
    idle_steps = IDLE_STEPS
    falling_steps = FALLING_STEPS
    not_finite, too_deep, parted, rested = map(
        int, (End.NOT_FINITE, End.TOO_DEEP, End.PARTED, End.RESTED)
    )
    turned, never, unfinished = map(int, (End.TURNED_BACK, End.NEVER_TOUCHED, End.UNFINISHED))

    # Warp compiles these lines too: no helper, no keyword, one assignment a line.
    def add(  # type: ignore[no-untyped-def]
        height_after, rising_after,
        flight_steps, rest_speed, idle_speed, contact_steps, fall, held_speed,
        lowest, radius, beyond, mass, timestep, noise, largest,
        steps, end, touch, last, still, idle, held, stuck,
        height, rising, x_before, x_in, v_in, x_out, v_out, sunk, deepest, hardest,
    ):  # fmt: skip
        x = (radius - height) + beyond
        v = -rising
        slowed = (rising_after - rising) + fall
        speeds = (size(rising) + size(rising_after)) + fall
        f = where(size(slowed) <= noise * speeds, 0.0 * mass, mass * (slowed / timestep))

        going = end == 0
        acts = both(going, f != 0.0)
        begins = both(acts, touch < 0)
        touch = where(begins, steps, touch)
        touched = touch >= 0

        still = where(both(touched, size(v) <= rest_speed), still, steps)
        idle = where(both(both(touched, f == 0.0), size(v) <= idle_speed), idle, steps)
        held = where(both(touched, size(v) <= held_speed), held, steps)
        stuck = where(both(both(touched, held_speed >= 0.0), x == x_before), stuck, steps)
        half = where(touched, (steps - touch) // 2, 0)
        quiet = both(steps - idle >= idle_steps, steps - idle >= half)
        quiet = either(quiet, both(steps - held >= falling_steps, steps - held >= half))
        quiet = either(quiet, both(steps - stuck >= idle_steps, steps - stuck >= half))
        quiet = either(quiet, steps - still >= rest_steps)

        # The weightiest reason last.
        why = where(both(touched, steps - touch >= contact_steps), unfinished, 0)
        why = where(both(touch < 0, steps + 1 >= flight_steps), never, why)
        why = where(both(touch < 0, v < 0.0), turned, why)
        why = where(quiet, rested, why)
        why = where(both(both(touched, f == 0.0), both(v < 0.0, x <= 0.0)), parted, why)
        why = where(x > lowest, too_deep, why)
        why = where(size(x + v + f) <= largest, why, not_finite)

        last = where(acts, steps, last)
        x_in = where(begins, x, x_in)
        v_in = where(begins, v, v_in)
        seen = both(going, touched)
        after = both(seen, steps <= last + 1)
        x_out = where(after, x, x_out)
        v_out = where(after, v, v_out)
        sunk = where(either(begins, both(seen, x > sunk)), x, sunk)
        deepest = where(acts, sunk, deepest)
        hardest = where(either(begins, both(acts, f > hardest)), f, hardest)

        steps = where(going, steps + 1, steps)
        end = where(going, why, end)
        return (
            steps, end, touch, last, still, idle, held, stuck,
            height_after, rising_after, x, x_in, v_in, x_out, v_out, sunk, deepest, hardest,
        )  # fmt: skip

    return add


def contacts_of(reading: Reading) -> EndedContacts:
    """Return the contacts of launches that have ended.

    reading: NumPy arrays.
    """
    seen = Reading(*(np.asarray(column) for column in reading))
    # A launch without a touch has -1 for its first and last step in contact.
    return EndedContacts(
        counts=seen.steps.astype(np.int64),
        ends=seen.end.astype(np.int64),
        first=np.maximum(seen.touch, 0).astype(np.int64),
        stops=(seen.last + 1).astype(np.int64),
        deepest=seen.deepest.astype(np.float64),
        hardest=seen.hardest.astype(np.float64),
        came=(seen.x_in.astype(np.float64), seen.v_in.astype(np.float64)),
        left=(seen.x_out.astype(np.float64), seen.v_out.astype(np.float64)),
    )
