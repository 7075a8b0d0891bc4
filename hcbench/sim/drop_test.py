"""Drops of a robot: the quantities of its landing that judge every setting of its feet."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hcbench.sim.model_under_test import ModelSetting, Vector

# Heights of the lowest point at release, m; the rebound is that from the highest.
HEIGHTS = (0.02, 0.05, 0.1)
# Tilts of the base, rad.
TILTS = (0.0, math.radians(5.0))
# Places in a time step where the first foot touches.
PHASES = (0.0, 0.25, 0.5, 0.75)
# Time after release, s; and of a robot that falls over by itself, whose fall is chance.
SECONDS = 10.2
SECONDS_TO_FALL = 1.2
# Last part of a drop, s, in which a robot is taken to stand.
TAIL_S = 2.0
# A flight that begins so long after release, s, belongs to no landing.
LATE_S = 3.0
# A robot rests when its centre of mass is slower, m/s.
REST_SPEED = 0.02
# It has fallen when its centre of mass is lower than this share of the height at the touch.
FALLEN = 0.6
# A rebound within this share of its target meets it, and so does one within this length, m.
WITHIN = 0.1
NO_REBOUND = 1e-3


@dataclass(frozen=True, slots=True)
class RobotDrop:
    """One drop: height of the lowest point, m; tilt of the base, rad; place in a step, 0 ... 1."""

    height: float
    tilt: float
    phase: float


DROPS = tuple(RobotDrop(*one) for one in product(HEIGHTS, TILTS, PHASES))
# Those whose mean is the rebound.
REBOUNDS = tuple(drop for drop in DROPS if drop.height == max(HEIGHTS) and not drop.tilt)


@dataclass(frozen=True, slots=True)
class LandedQuantity:
    """A quantity that a setting may not make worse.

    name: of the field. si: of what is printed. share: times what it was, above which it is worse;
    rebound_share: the same where a rebound was asked for, which takes force and way. slack: a
    growth that always will do, SI.
    """

    name: str
    key: str
    title: str
    unit: str
    si: float
    share: float
    rebound_share: float
    slack: float


QUANTITIES = (
    LandedQuantity("rest", "rest_s", "time to rest", "s", 1.0, 1.2, 1.2, 0.3),
    LandedQuantity("peak", "peak_over_weight", "peak force over weight", "", 1.0, 1.2, 1.5, 2.0),
    LandedQuantity("depth", "depth_m", "largest penetration", "mm", 1e-3, 1.2, 1.2, 5e-4),
    LandedQuantity("sink", "sink_m", "penetration at rest", "mm", 1e-3, 1.2, 1.2, 2e-4),
    LandedQuantity("travel", "travel_m", "travel in 10 s", "mm", 1e-3, 1.2, 1.5, 2e-2),
    LandedQuantity("creep", "creep_m_per_s", "creep at rest", "mm/s", 1e-3, 1.2, 1.2, 3e-4),
    LandedQuantity(
        "vibration", "vibration_m_per_s", "vibration at rest", "mm/s", 1e-3, 1.2, 1.2, 2e-4
    ),
    LandedQuantity("gain", "energy_gain", "energy gain over m g h", "", 1.0, 1.2, 1.2, 5e-3),
    LandedQuantity("late", "late_flights", "flights after 3 s", "", 1.0, 1.2, 1.2, 0.0),
)


@dataclass(frozen=True, slots=True)
class Landed:
    """Landing from one drop, SI; NaN for what its time is too short for.

    rebound: height that the centre of mass gains in its highest flight, with the whole robot off
    the floor for longer than chatter, m.
    rest: time from the first touch until the centre of mass stays slow, s; inf where it never does.
    peak: largest force of the floor over the weight. depth, sink: deepest penetration, and that at
    rest, m.
    travel: along the floor from the touch to the end, m. creep, vibration: of the centre of mass in
    the last seconds, m/s.
    gain: energy at the start of a flight beyond that before, over m g h. late: flights after 3 s.
    sag: way of the centre of mass down from the touch to its rest, m.
    fell: whether it ends low.
    """

    rebound: float
    rest: float
    peak: float
    depth: float
    sink: float
    travel: float
    creep: float
    vibration: float
    gain: float
    late: float
    sag: float
    fell: bool


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot that is dropped. model: what to call its file. name: of its base. mass: kg. timestep: s.

    gravity: m/s². controller: what holds its joints, in words.
    """

    engine: str
    model: str
    name: str
    mass: float
    timestep: float
    gravity: Vector
    controller: str


@dataclass(frozen=True, slots=True)
class DropTest:
    """A robot dropped from each height, at each tilt and phase: the worst of each quantity, SI.

    rebound, spread: mean and largest difference from it over the phases of the flat drops from the
    largest height, m. frequency: of its legs, rad/s, from how far it sags on them; NaN where it
    does not rest. diverged: whether a drop has no end; other numbers are then infinite.
    seconds: of each drop. Others: see `Landed`.
    """

    robot: Robot
    rebound: float
    spread: float
    rest: float
    peak: float
    depth: float
    sink: float
    travel: float
    creep: float
    vibration: float
    gain: float
    late: float
    frequency: float
    fell: bool
    diverged: bool
    seconds: float

    @property
    def record(self) -> dict[str, float]:
        """The numbers by their keys in JSON, SI."""
        of_quantities = {each.key: getattr(self, each.name) for each in QUANTITIES}
        return {"rebound_m": self.rebound, "rebound_spread_m": self.spread, **of_quantities}

    def worse_than(self, before: DropTest, rebound: float = 0.0) -> Iterator[str]:
        """Quantities that grew by more than the stated share and slack, in words.

        rebound: the target, m.
        """
        if self.diverged:
            yield "the simulation diverges"
            return
        for each in QUANTITIES:
            was: float = getattr(before, each.name)
            now: float = getattr(self, each.name)
            share = each.rebound_share if rebound > 0.0 else each.share
            # A NaN before is what was not measured.
            is_lost = math.isnan(now) and not math.isnan(was)
            if is_lost or now > max(share * was, was + each.slack):
                words = f"{each.title} {was / each.si:.3g} -> {now / each.si:.3g} {each.unit}"
                yield words.rstrip()

    def meets(self, rebound: float) -> bool:
        """Say whether the rebound is within a tenth, or 1 mm of none, of a target, m."""
        if self.diverged:
            return False
        return abs(self.rebound - rebound) <= (WITHIN * rebound if rebound else NO_REBOUND)


@dataclass(frozen=True, slots=True)
class Reach:
    """Limits of the rebound that a contact of the feet can give a robot.

    rebound: the largest of the settings that were tried and do not land worse, m. stiffer: (factor
    of the servos' kp, largest rebound with it at the touch, m), in order; () where none was needed.
    """

    rebound: float
    stiffer: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class ReboundSettings:
    """Settings that an engine finds for a rebound, each computed when it is asked for.

    meeting: settings that have it in some drops, the most promising first. highest: settings with
    the largest rebounds, the largest first. stiffer: see `Reach`.
    advice: sentences on options of the model that spoil every landing.
    """

    meeting: Iterable[ModelSetting]
    highest: Iterable[ModelSetting]
    stiffer: Callable[[], tuple[tuple[float, float], ...]]
    advice: tuple[str, ...] = ()


def drop_test(robot: Robot, drops: Mapping[RobotDrop, Landed | None], seconds: float) -> DropTest:
    """Join drops, None where one diverged. seconds: of each."""
    landed = [each for each in drops.values() if each is not None]
    if len(landed) < len(drops):
        numbers = {each.name: math.inf for each in QUANTITIES}
        return DropTest(
            robot,
            math.inf,
            math.inf,
            **numbers,
            frequency=math.nan,
            fell=False,
            diverged=True,
            seconds=seconds,
        )
    highest = max(drop.height for drop in drops)
    flat = [
        each.rebound
        for drop, each in drops.items()
        if each is not None and drop.height == highest and not drop.tilt
    ]
    mean = math.nan
    spread = math.nan
    if flat:
        mean = sum(flat) / len(flat)
        spread = max(abs(each - mean) for each in flat)
    worst = {each.name: max(getattr(one, each.name) for one in landed) for each in QUANTITIES}
    fell = any(one.fell for one in landed)
    sags = [one.sag for one in landed if one.sag > 0.0]
    frequency = math.nan
    if sags and not fell:
        frequency = math.sqrt(math.hypot(*robot.gravity) / min(sags))
    return DropTest(
        robot,
        mean,
        spread,
        **worst,
        frequency=frequency,
        fell=fell,
        diverged=False,
        seconds=seconds,
    )
