"""Brings two bodies just to touch, in any engine, and refuses those that cannot be brought there.

An engine moves one of the two along a line and says how far apart they are,
or whether it makes a contact.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hcbench.system.errors import SceneError, UserError
from hcbench.system.text import Shown
from hcbench.terms.impact import Floats

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping

    from hcbench.terms.impact import Floats


# A foot that is off the floor for longer, s, has left it; shorter gaps are chatter.
PARTED_S = 0.005
# Overlap at the start, in sizes of the smaller one, up to which the two are just moved apart.
DEEPEST = 0.1
# Share of a joint's motion that must be along the normal for it to launch a body.
LEAST_APPROACH = 1e-3
# Steps of a search for the touch, and halvings of one.
_ROUNDS = 60
# An overlap that is more than rounding, m.
_SEEN = 1e-9
# Two that are so many times their smallest distance apart again will not meet.
_PASSED = 4.0
# Equal steps in which a scan looks for a contact.
_SCAN_STEPS = 200
# Joints that an error names: the pose that cures it, with all of them, needs the room.
_SHOWN = 2
# Distance that counts as touching, in sizes of the smaller one.
_CLOSE = 1e-12


def travel_by_distance(
    distance: Callable[[float], float], size: float, approach: float = 1.0
) -> float:
    """Find how far one body has to travel until it touches another, m or rad; if the two pass each
    other without touching, the travel at which they were nearest.

    distance: moves the body to a travel and returns the signed distance there, m.
    size: of the smaller body, m: a bounding radius or the diagonal of a box, as the engine has it;
    it decides what is near enough.
    approach: how much the distance falls a unit of travel.
    Each round travels by the distance that is left: convex shapes on a straight approach take one,
    others up to _ROUNDS.
    """
    travel = best = 0.0
    nearest = math.inf
    for _ in range(_ROUNDS):
        gap = distance(travel)
        # The two have passed each other.
        if abs(gap) > _PASSED * nearest:
            return best
        if abs(gap) <= nearest:
            nearest = abs(gap)
            best = travel
        travel += gap / approach
        if abs(gap) < _CLOSE * size:
            break
    return travel


def travel_by_scan(touches: Callable[[float], bool], start: float, stop: float) -> float | None:
    """The least travel from `start` to `stop`, m, that makes a contact; None where nothing touches.

    For shapes whose distance is known only roughly: _SCAN_STEPS equal steps, then bisection. A
    contact that begins and ends within one step is missed, and `start` itself is not looked at.

    touches: moves a body by a travel, m, and returns whether the two touch there.
    """
    travels = np.linspace(start, stop, _SCAN_STEPS + 1).tolist()
    for low, high in itertools.pairwise(travels):
        if touches(high):
            return _bisected(touches, low, high)
    return None


def _bisected(touches: Callable[[float], bool], low: float, high: float) -> float:
    """The least travel that makes a contact, m, between one without (low) and one with (high).

    touches: moves a body by a travel, m, and returns whether the two touch there.
    """
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        if touches(middle):
            high = middle
        else:
            low = middle
    return float(high)


def overlap_notes(overlap: float) -> list[str]:
    """Note that the bodies overlapped by this many m at the start; empty
    if the overlap is negligible.
    """
    said = f"The two overlap by {overlap:.3g} m at the start: moved apart to touch."
    return [said] if overlap > _SEEN else []


@dataclass(frozen=True, slots=True)
class JointBeyondLimit:
    """A joint that is beyond its limit at the start.

    beyond: how far, rad if it turns, else m.
    nearest: the nearest value allowed, rad or m; NaN for a ball joint, which has four numbers.
    """

    name: str
    beyond: float
    turns: bool
    nearest: float

    @property
    def description(self) -> str:
        """Name of the joint, and how far it is beyond its limit."""
        far = f"{math.degrees(self.beyond):.3g} deg" if self.turns else f"{self.beyond:.3g} m"
        return f"{self.name} by {far}"


def require_no_joint_beyond(joints: Sequence[JointBeyondLimit], start: str) -> None:
    """Raise UserError, with the joint values that cure it, unless `joints` is empty.

    joints: those that a pose puts beyond their limits.
    start: another advice, to stand before the pose that cures it, or "":
    such as "another --key, or from ".
    """
    if not joints:
        return
    named = ", ".join(joint.description for joint in joints[:_SHOWN])
    more = ""
    if len(joints) > _SHOWN:
        more = f" and {len(joints) - _SHOWN} more"
    # A ball joint has four numbers, and no nearest one.
    if any(math.isnan(joint.nearest) for joint in joints):
        advice = "Start from another pose"
    else:
        cure = ", ".join(f"{joint.name}={joint.nearest:.4g}" for joint in joints)
        advice = f'Start from {start}--qpos "{cure}"'
    raise UserError(
        "model",
        f"joints start outside their limits, which push them back: {named}{more}",
        "a pose that the joints allow",
        advice,
    )


def require_apart(
    distance: float, size: float, first: str, second: str, advice: str = "Move one away"
) -> None:
    """Raise SceneError for two bodies that overlap at the start by more than DEEPEST of their size.

    distance: between them, signed, m, below 0 for an overlap.
    size: of the smaller one, m.
    first, second: their names.
    advice: the end of the error.
    """
    if distance < -DEEPEST * size:
        got = f"{first!r} starts {-distance:.4g} m inside {second!r}"
        raise SceneError("model", got, "the two bodies apart or just touching", advice)


def require_reachable(
    depth: float, size: float, pair: tuple[str, str], blocked: tuple[str, str], advice: str = ""
) -> None:
    """Raise UserError if two bodies cannot be brought to touch, because another part of what moves
    would then be inside something by more than DEEPEST of its size.

    depth: of that part in what it meets, m.
    size: of the smaller of these two, m.
    pair: names of the two that should meet, the moving body first.
    blocked: that part, and what it would be in, as an error calls them.
    advice: the end of the error.
    """
    if depth > DEEPEST * size:
        raise UserError(
            "pair",
            f"{pair[0]!r} cannot reach {pair[1]!r}: {blocked[0]}, which moves with it, would be "
            f"{depth:.3g} m inside {blocked[1]}",
            "two that meet before anything else does",
            f"Name the parts that meet first{advice}",
        )


# Speeds at which a plug-in's law holds.
ANY_SPEED = (0.0, float("inf"))


class Touchdown(NamedTuple):
    """A touchdown of one part on another: time, s; speed together and along each other, m/s."""

    time: float
    speed: float
    slide: float


@dataclass(frozen=True)
class Touchdowns:
    """The touchdowns of one part of the model on one other.

    part, other: their names. time, s, speed: towards the other, and slide: along it, m/s; shape
    (n,) each.
    band: speeds that the setting of the two is valid for, m/s; None where hcbench did not write the
    setting.
    setting: what the two have, in words.
    """

    part: str
    other: str
    time: Floats = field(repr=False)
    speed: Floats = field(repr=False)
    slide: Floats = field(repr=False)
    band: tuple[float, float] | None
    setting: str

    @property
    def outside(self) -> float:
        """The share of touchdowns at speeds outside the band; NaN without a band."""
        if self.band is None:
            return float("nan")
        low, high = self.band
        return float(np.mean((self.speed < low) | (self.speed > high)))


@dataclass(frozen=True, slots=True, repr=False)
class TrajectoryTouchdowns(Shown):
    """Touchdowns in a recorded motion.

    states: how many were read.
    interval: between two, s.
    feet: those that touch down most first.
    """

    engine: str
    version: str
    model: str
    states: int
    interval: float
    feet: tuple[Touchdowns, ...]

    def _lines(self) -> Iterator[str]:
        """Lines for a terminal: the recording, then each foot. Speeds in m/s, times in ms."""
        every = f"{self.states} states, one every {1e3 * self.interval:.4g} ms"
        yield f"{self.model}: {every}, {self.engine} {self.version}"
        for foot in self.feet:
            most = f"at up to {foot.speed.max():.3g} m/s"
            yield f"{foot.part} on {foot.other}: {len(foot.time)} touchdowns {most}"

    def _rows(self) -> Iterator[dict[str, object]]:
        """Yield a row for each touchdown, foot by foot, SI."""
        for foot in self.feet:
            for time, speed, slide in zip(foot.time, foot.speed, foot.slide, strict=True):
                yield {
                    "part": foot.part,
                    "other": foot.other,
                    "time_s": float(time),
                    "normal_speed_m_per_s": float(speed),
                    "sliding_speed_m_per_s": float(slide),
                }


# A recorded motion of a model: its states as they are given, and which contacts in them are new.

# A gap between two states may hide a contact: parts touch anew only after more than this many.
_STATES_APART = 1.5


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """States of a recording, SI: qpos (n, nq), qvel (n, nv) and the time of each, (n,)."""

    qpos: Floats
    qvel: Floats
    time: Floats

    @classmethod
    def read(
        cls, recorded: Mapping[str, Floats], nq: int, nv: int, timestep: float, layout: str = ""
    ) -> RecordedMotion:
        """Check and take the states of a recording: qpos (n, nq), qvel (n, nv) and time, s, (n,).

        recorded: these arrays by name; without "time" the states are `timestep`, s, apart.
        nq, nv: numbers of positions and velocities in the model's state.
        layout: what they are, a sentence for errors.
        Raises UserError for a missing array, other shapes, fewer than two states, times that do not
        rise, and numbers that are not finite.
        """
        arrays = []
        for name, width in (("qpos", nq), ("qvel", nv)):
            if (array := recorded.get(name)) is None:
                expected = "qpos and qvel of each state, and time"
                raise UserError("trajectory", f"no {name!r} in it", expected)
            if array.ndim != 2 or array.shape[1] != width or len(array) < 2:
                got = f"{name}: {' x '.join(map(str, array.shape))} numbers"
                expected = f"n x {width}, for this model, with n of 2 or more"
                raise UserError("trajectory", got, expected, layout)
            arrays.append(array)
        qpos, qvel = arrays
        steps: Floats = timestep * np.arange(len(qpos), dtype=np.float64)
        time = recorded.get("time", steps).reshape(-1)
        if not len(qpos) == len(qvel) == len(time):
            got = f"{len(qpos)} states in qpos, {len(qvel)} in qvel and {len(time)} in time"
            raise UserError("trajectory", got, "as many in each")
        for name, array in (("qpos", qpos), ("qvel", qvel), ("time", time)):
            if not np.isfinite(array).all():
                got = f"{name}: numbers that are not finite"
                raise UserError("trajectory", got, "finite numbers")
        if not (np.diff(time) > 0).all():
            raise UserError("trajectory", "time does not rise", "a later time for each state")
        return cls(qpos, qvel, time)

    @property
    def interval(self) -> float:
        """Time between two states, the median, s."""
        return float(np.median(np.diff(self.time)))


@dataclass
class NewTouches:
    """Tells which contacts of a recording are touchdowns. time: of its states, s, (n,).

    _last_seen: when each contact was there last, s, by its parts.
    """

    time: Floats
    _last_seen: dict[Hashable, float] = field(default_factory=dict)

    def begins(self, parts: Hashable, state: int) -> bool:
        """Say whether a contact in a state is a touchdown: its two parts were apart for longer than
        PARTED_S and than _STATES_APART intervals of the recording; never in the first state, in
        which they have not come down.

        parts: the two, as a key.
        state: index of the state; calls go through the states in order, and of several contacts of
        the same parts in one state only the first counts.
        """
        now = float(self.time[state])
        apart = now - self._last_seen.get(parts, -np.inf)
        self._last_seen[parts] = now
        if not state:
            return False
        return apart > max(PARTED_S, _STATES_APART * (now - float(self.time[state - 1])))
