"""Reads impacts off what an engine recorded at each step."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.sim.columns import STATUSES, Impacts, Launches, Recorded
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
from hcbench.terms.impact import Impact, Launch, Status
from hcbench.terms.resolution import ROUND_OFF_STEP

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hcbench.terms.impact import Floats, Trajectory

    States = tuple[Floats, ...]


NOT_FINITE = "position, velocity or force is not finite"
# What became of a launch without a contact to its end. {0}: the time
# simulated, s; {1}: the engine's words.
_FAILED = {
    End.NOT_FINITE: (Status.DIVERGED, "{1}"),
    End.TOO_DEEP: (Status.DIVERGED, "went through the plate: deeper than its own radius"),
    End.TURNED_BACK: (Status.NO_TOUCH, "turned back without a contact force of the pair"),
    End.NEVER_TOUCHED: (Status.NO_TOUCH, "no contact force within {0:.3g} s"),
}
_PUSHED = "turned back by something else than the contact of the pair"
_ENDED = {
    End.UNFINISHED: Status.UNFINISHED,
    End.RESTED: Status.RESTED,
    **{end: status for end, (status, _) in _FAILED.items()},
}
_STATUS = np.array([STATUSES.index(_ENDED.get(end, Status.PARTED)) for end in End])
_FAILS = np.array([end in _FAILED for end in End])
_DIVERGED = STATUSES.index(Status.DIVERGED)


class SpeedReading(StrEnum):
    """Quantity that an integrator conserves in free flight, from which the
    speeds at the touch plane follow.

    The speeds come from a state before the contact and one after it, at a step h under gravity g
    into the plate, penetration x and rate v; e is their ratio. e² is then the share of its height
    that a body keeps, whenever in its step an engine reverses the speed. Without gravity all
    readings are the same. An engine's `World` names the one that applies.

    TOUCH_PLANE: semi-implicit Euler, which moves by the new velocity, keeps (v + g h/2)² - 2 g x
        exactly: at x = 0 that is the square of the speed at touch, whichever step sees it.
    TOUCH_PLANE_FOUR_SUBSTEPS: four such steps of h/4 in each keep (v + g h/8)² - 2 g x.
    TOUCH_PLANE_EXACT_FLIGHT: steps that are exact in free flight, as RK4's, keep v² - 2 g x.
    CROSSING: the speed where the simulated path crosses the touch plane, by the parabola through
        the states around it: for bodies on joints or under servos, which have no one acceleration.
    STAGED_CROSSING: the same where a contact bends the step that it ends in, as RK4's, too.
    """

    TOUCH_PLANE = "touch plane"
    TOUCH_PLANE_FOUR_SUBSTEPS = "touch plane, four substeps"
    TOUCH_PLANE_EXACT_FLIGHT = "touch plane, exact flight"
    CROSSING = "crossing of the touch plane"
    STAGED_CROSSING = "crossing of the touch plane, by stages"

    @property
    def steps_after(self) -> int:
        """Free steps that it needs after the bodies have parted."""
        return {"crossing of the touch plane": 1, "crossing of the touch plane, by stages": 2}.get(
            self, 0
        )

    @property
    def share(self) -> float:
        """Share of g h that v lacks for its square less 2 g x to stay the same in free flight."""
        return {"touch plane": 0.5, "touch plane, four substeps": 0.125}.get(self, 0.0)

    def speeds(
        self, before: States, after: States, fall: float, gravity: float
    ) -> tuple[Floats, Floats]:
        """Speeds in and out, m/s, shape (n,) each; for the readings at the touch plane alone.

        before, after: (penetration m, rate m/s), (n,) each, of the last free state before the
        contact and the first after it.
        fall: g h, m/s.
        gravity: g, m/s², into the plate.
        A state without the energy to reach the plane has the speed 0.
        """
        x_in, v_in = before
        x_out, v_out = after
        if gravity == 0.0:
            return v_in, -v_out
        # What the kept energy adds to a state's rate, m/s: half of g h for semi-implicit Euler.
        added = self.share * fall

        def at_plane(x: Floats, v: Floats) -> Floats:
            """Speed at x = 0 with the energy of a state, m/s."""
            with np.errstate(invalid="ignore"):
                return np.asarray(np.sqrt(np.maximum(0.0, (v + added) ** 2 - 2.0 * gravity * x)))

        return at_plane(x_in, v_in), at_plane(x_out, v_out)


def _crossing_speed(x: Floats, at: NDArray[np.int64], h: float) -> Floats:
    """Speed at which each path crosses the touch plane (x = 0) near a step, m/s, (b,): that of the
    parabola through the state at this step and the ones before and after it.

    x: penetration, m, (b, n).
    at: index of the step, (b,).
    h: time step, s.
    No contact force may act between the three states.
    """
    launch = np.arange(len(x))
    last = x.shape[1] - 1
    # A path of fewer than three states repeats its last one.
    middle = np.clip(at, 1, max(1, last - 1))
    before = x[launch, middle - 1]
    here = x[launch, np.minimum(middle, last)]
    after = x[launch, np.minimum(middle + 1, last)]
    # v² = v_here² - 2 a x_here, with the central differences of the parabola, all times h².
    with np.errstate(all="ignore"):
        squared = (0.5 * (after - before)) ** 2 - 2.0 * (after - 2.0 * here + before) * here
        return np.asarray(np.sqrt(np.maximum(0.0, squared)) / h)


def _early_crossing_speed(states: Floats, h: float) -> Floats:
    """Speed where a path crosses the touch plane, m/s, (b,), by the first two states.

    states: penetration, m, and rate, m/s, of both, (2, b, 2); of one state alone it is that rate.
    h: step between them, s.
    The path is a parabola with the mean acceleration of the two.
    """
    if states.shape[2] < 2 or h == 0.0:
        return np.asarray(states[1, :, 0])
    (x, x_next), (v, v_next) = states.transpose(0, 2, 1)
    a = (v_next - v) / h
    # In the middle of the step the parabola has the mean speed, and this penetration.
    mean = (x_next - x) / h
    middle = 0.5 * (x + x_next) - a * h * h / 8.0
    return np.asarray(np.sqrt(np.maximum(0.0, mean * mean - 2.0 * a * middle)))


def impact_of(launch: Launch, trajectory: Trajectory) -> Impact:
    """Read the impact of one launch off its trajectory, without gravity and in even steps.

    A path that ends in contact gives an impact with the status UNFINISHED, and one without a
    contact force NO_TOUCH; nothing is raised.
    """
    time = trajectory.time
    states = np.stack([trajectory.penetration, trajectory.rate, trajectory.force])[:, None]
    step = 1.0
    if len(time) > 1:
        step = float(time[1] - time[0])
    counts, ends = StopRule.for_launches([launch], step, 0.0).add(*states)
    if not counts[0]:
        end = End.UNFINISHED if trajectory.force.any() else End.NEVER_TOUCHED
        counts = np.array([len(time)])
        ends = np.array([end])
    (impact,) = impacts_of(Launches.of([launch]), time, states, counts, ends)
    return impact


def impacts_of(
    launches: Launches,
    time: Floats,
    states: Floats,
    counts: NDArray[np.int64],
    ends: NDArray[np.int64],
    gravity: float = 0.0,
    reading: SpeedReading = SpeedReading.TOUCH_PLANE,
    diverged: str = NOT_FINITE,
) -> Impacts:
    """Read impacts off trajectories that share their times, (n,), s, in even steps.

    states: penetration (m, above 0 in contact), rate (m/s, above 0 on approach) and force (N), (3,
    b, n); the first `counts` steps count.
    ends: why they end (`End`), (b,).
    gravity: into the plate, m/s².
    reading: how speeds are read off the states.
    diverged: the reason to give for NOT_FINITE.
    Contact is the run of steps in which the force acts. Speeds are read, by `reading`, off the last
    state that no contact force has touched and the first after the force has ceased for good. An
    impact that went wrong has a status and a reason; nothing is raised.
    """
    # Free steps that were waited for after the parting serve `reading` alone.
    counts = counts - np.where(ends == End.PARTED, reading.steps_after, 0)
    first, stops, deepest, hardest = _steps_in_contact(states, counts)
    launch_numbers = np.arange(len(counts))
    # Of a launch that ends in contact, its last step.
    after = np.minimum(stops, counts - 1)
    # (penetration, rate), (b,) each.
    came = tuple(states[:2, launch_numbers, first])
    left = tuple(states[:2, launch_numbers, after])
    h = 0.0
    if len(time) > 1:
        h = float(time[1] - time[0])
    seen = EndedContacts(
        counts=counts,
        ends=ends,
        first=first,
        stops=stops,
        deepest=deepest,
        hardest=hardest,
        came=came,
        left=left,
    )
    if not reading.steps_after:
        speeds: States = reading.speeds(came, left, gravity * h, gravity)
    else:
        speeds = _crossing_speeds(states, seen, h, seen.counts - 2 + reading.steps_after)
    return seen.impacts(launches, speeds, h, diverged, Recorded(time - time[:1], states))


@dataclass(frozen=True, slots=True)
class EndedContacts:
    """Contacts of launches that have ended; arrays of shape (b,), SI.

    counts, ends: the steps of each, and why it ended (`End`).
    first, stops: the step in which the contact force first acts, and the one after the last.
    deepest, hardest: largest penetration and force between them.
    came, left: penetration and rate in the first, and once the force has ceased.
    """

    counts: NDArray[np.int64]
    ends: NDArray[np.int64]
    first: NDArray[np.int64]
    stops: NDArray[np.int64]
    deepest: Floats
    hardest: Floats
    came: States
    left: States

    def impacts(
        self,
        launches: Launches,
        speeds: States,
        h: float,
        diverged: str,
        record: Recorded | None = None,
    ) -> Impacts:
        """Make the impacts of the contacts, one for each launch; NaN in what was not measured, with
        the status and the reason.

        launches: in the order of the contacts.
        speeds: (in, out), or (in, out, once the force has ceased), m/s, (b,) each; the speed out of
        a rested launch is set to 0, in place.
        h: the step, s.
        diverged: the reason to give for NOT_FINITE.
        record: has the loops; None for impacts without any.
        """
        ends = self.ends
        count = len(ends)
        # Steps in which the force acted.
        acted = self.stops - self.first
        failed = _FAILS[ends]
        v_in, v_out = speeds[:2]
        v_after = np.full(count, np.nan)
        if len(speeds) > 2:
            v_after = speeds[2]
        v_out[ends == End.RESTED] = 0.0
        _, rate_in = self.came
        _, rate_out = self.left
        still_closing = (ends == End.PARTED) & (rate_out > 0.0)
        # Other forces moved the body: it did not approach as the contact began, or approaches
        # though the contact is over.
        pushed = ~failed & (~(rate_in > 0.0) | still_closing)
        measured = ~(failed | pushed | (ends == End.UNFINISHED))
        reason = np.full(count, "", dtype=object)
        for i in np.flatnonzero(~measured | (ends == End.RESTED)):
            last = h * int(self.counts[i] - 1)
            touch = h * int(self.first[i])
            if failed[i]:
                _, words = _FAILED[End(ends[i])]
                reason[i] = words.format(last, diverged)
            elif pushed[i]:
                reason[i] = _PUSHED
            elif measured[i]:
                reason[i] = f"still in contact {last - touch:.3g} s after touch"
            else:
                steps = int(self.counts[i] - self.first[i])
                reason[i] = (
                    f"still in contact, and not at rest, after {steps} steps ({h * steps:.3g} s)"
                )
        source = np.full(count, None, dtype=object)
        source[measured] = record

        def if_measured(values: NDArray[Any]) -> Floats:
            return np.where(measured, values, np.nan)

        return Impacts(
            launches=launches,
            status=np.where(pushed, _DIVERGED, _STATUS[ends]),
            reason=reason,
            speed_in=if_measured(v_in),
            speed_out=if_measured(v_out),
            speed_after_force=if_measured(v_after),
            duration=if_measured(h * acted),
            penetration_max=if_measured(self.deepest),
            force_max=if_measured(self.hardest),
            samples=np.where(failed, 0, acted),
            tangential=np.full(count, None, dtype=object),
            source=source,
            row=np.arange(count),
            start=self.first,
        )


def _crossing_speeds(
    states: Floats, seen: EndedContacts, h: float, middle_after: NDArray[np.int64]
) -> States:
    """Speeds in, out and after the contact's last force, m/s, (b,) each, where the path crosses the
    plane.

    states: penetration, m, rate, m/s, and force, N, (3, b, n).
    seen: where the contact of each launch began and ended.
    h: the step, s.
    middle_after: index of the middle one of three free states after the contact, (b,).
    """
    x = states[0]
    is_deep = x > 0.0
    # Step in which the surfaces have met, (b,): they may do so before the force acts.
    entered = np.where(
        is_deep.any(axis=1), np.minimum(seen.first, is_deep.argmax(axis=1)), seen.first
    )
    v_in = _crossing_speed(x, entered - 1, h)
    v_out = _crossing_speed(x, middle_after, h)
    # Fewer than three states before the touch: what the first two or the first one tell.
    v_in = np.where(entered < 2, _early_crossing_speed(states[:2, :, :2], h), v_in)
    v_in = np.where(entered < 1, seen.came[1], v_in)
    return v_in, v_out, np.where(seen.ends == End.RESTED, 0.0, -seen.left[1])


class _InContact(NamedTuple):
    """Steps with a force in each of b launches, (b,) each.

    first: index of the first step with a force.
    stops: index of the step after the last one with a force.
    deepest: largest penetration from the first to the last, m.
    hardest: largest force, N.
    """

    first: NDArray[np.int64]
    stops: NDArray[np.int64]
    deepest: Floats
    hardest: Floats


def _steps_in_contact(states: Floats, counts: NDArray[np.int64]) -> _InContact:
    """Find where the force acts in each launch.

    states: penetration (m), rate (m/s), force (N), (3, b, n).
    counts: steps that count, (b,).
    A launch without force gets 0, n, and the extremes of its whole row: callers know it by its
    `End`.
    """
    penetration, _, force = states
    launches, n = force.shape
    with np.errstate(all="ignore"):
        # NaN, of an engine that gave up, counts as a force.
        acting = force != 0.0
        acting &= np.arange(n) < counts[:, None]
    first = acting.argmax(axis=1)
    stops = n - acting[:, ::-1].argmax(axis=1)
    # One reduceat over all launches, end to end.
    row_starts = n * np.arange(launches)
    edges = np.stack([row_starts + first, row_starts + stops], axis=1).ravel()
    # A contact up to the end of the last row has no right edge: reduceat
    # takes no index past the end.
    edges = edges[edges < force.size]
    # From each edge to the next: contact, gap, contact, ... Only the contacts are wanted.
    deepest = np.maximum.reduceat(penetration.ravel(), edges)[::2]
    hardest = np.maximum.reduceat(force.ravel(), edges)[::2]
    return _InContact(first, stops, deepest, hardest)


# Reads impacts while they are stepped: 18 numbers a launch are all that is kept.
#
# `reader(xp)` makes the function of one step from `where`, `abs`, `logical_and` and `logical_or`
# of an array library: NumPy, `jax.numpy`, under jit too, or Warp, a launch in each thread. It ends
# launches by the rule of `hcbench.sim.stop`, and `hcbench.sim.read_impact` makes impacts of its
# numbers: in float64, to the bit those of a record of all steps.


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
    """Make the constants by which launches of a scene's ball end, as a `Rule` whose numbers and
    arrays, (b,), are of the NumPy type `kind`.

    timestep: s.
    bits: of the engine's numbers, 32 or 64: they decide what counts as round-off.
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
        # As many units in the last place as count for nothing.
        noise=ROUND_OFF_STEP * float(np.finfo(f"f{bits // 8}").eps),
        largest=float(np.finfo(kind).max),
    )
    return Rule(*_typed(made, kind))


def begun(heights: Floats, rising: Floats, kind: type) -> Reading:
    """The `Reading` of launches before their first step: nothing has touched or ended.

    heights, m, and rising, m/s: of the bodies' centres as the engine has them, (b,).
    kind: NumPy type of its floats.
    """
    none = np.full(len(heights), -1)
    zero = np.zeros(len(heights))
    made = Reading(
        steps=zero,
        end=zero,
        touch=none,
        last=none,
        still=none,
        idle=none,
        held=none,
        stuck=none,
        height=heights,
        rising=rising,
        x_before=np.full(len(heights), np.nan),
        x_in=zero,
        v_in=zero,
        x_out=zero,
        v_out=zero,
        sunk=zero,
        deepest=zero,
        hardest=zero,
    )
    return Reading(*_typed(made, kind))


def _typed(numbers: Any, kind: type) -> list[Any]:
    """The fields of a named tuple as arrays: whole numbers of 32 bits, the others of this kind."""
    arrays: list[Any] = []
    for name, value in zip(numbers._fields, numbers, strict=True):
        arrays.append(np.asarray(value, np.int32 if name in WHOLE else kind))
    return arrays


def reader(xp: Any) -> Callable[..., tuple[Any, ...]]:
    """Make the function that reads one step of all launches: (height, rising, *rule, *reading) ->
    the fields of the next reading, in their order.

    xp: the array library to compute with, NumPy or one that has its functions.
    height, rising: of each body's centre after the step, m and m/s, (b,). The fields of `Rule`
    (constants of when a launch ends) and `Reading` (what was seen of it so far) follow in their
    order. The contact's force is what the step does to the momentum.
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

    def add(  # type: ignore[no-untyped-def]
        height_after, rising_after,
        flight_steps, rest_speed, idle_speed, contact_steps, fall, held_speed,
        lowest, radius, beyond, mass, timestep, noise, largest,
        steps, end, touch, last, still, idle, held, stuck,
        height, rising, x_before, x_in, v_in, x_out, v_out, sunk, deepest, hardest,
    ):  # fmt: skip
        # One step of all bodies, SI: each argument is of shape (b,) or a number. The first line of
        # arguments is the state after the step, the next two the fields of `Rule`, the last two
        # those of `Reading`, which are returned in their order.
        # Warp compiles these lines too: no helper, no keyword, one assignment a line.
        # Penetration and rate before the step, and the speed that the contact took in it.
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

        # Each of four runs of quiet steps, any of which is rest, keeps the last step not quiet.
        still = where(both(touched, size(v) <= rest_speed), still, steps)
        idle = where(both(both(touched, f == 0.0), size(v) <= idle_speed), idle, steps)
        held = where(both(touched, size(v) <= held_speed), held, steps)
        stuck = where(both(both(touched, held_speed >= 0.0), x == x_before), stuck, steps)
        half = where(touched, (steps - touch) // 2, 0)
        quiet = both(steps - idle >= idle_steps, steps - idle >= half)
        quiet = either(quiet, both(steps - held >= falling_steps, steps - held >= half))
        quiet = either(quiet, both(steps - stuck >= idle_steps, steps - stuck >= half))
        quiet = either(quiet, steps - still >= rest_steps)

        # Of several reasons to end the weightiest is set last.
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
    """The contacts of launches that have ended, in 64 bits.

    reading: NumPy arrays, or what converts to them; every launch of it has ended.
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
