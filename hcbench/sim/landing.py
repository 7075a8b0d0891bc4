"""A robot that lands on its floor: what is dropped, what an engine measures of it, and the quantities
of its landing that judge every setting of its feet.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import TYPE_CHECKING, Annotated, get_type_hints

import numpy as np

from hcbench.sim.touch import PARTED_S
from hcbench.system.text import Shown, time_step
from hcbench.terms.records import LANDING, REBOUND, Field, record
from hcbench.terms.resolution import STEPS_BY_CHANCE

if TYPE_CHECKING:
    from hcbench.sim.model_under_test import ModelSetting, Vector
    from hcbench.terms.impact import Floats
    from hcbench.terms.options import Controller


# Places in a time step where the first foot touches.
PHASES = (0.0, 0.25, 0.5, 0.75)
# Time after the first touch, s, in which a landing is measured.
WINDOW_S = 0.5
# A floor is waited for as long as this times the time of a free fall, and some s more.
_FALL_SHARE = 1.5
_SLACK_S = 0.2


# Axis of the world about which `land` tilts a base where none is named.
LAND_AXIS = (0.0, 1.0, 0.0)


@dataclass(frozen=True, slots=True)
class DropPlan:
    """Heights, tilts and controller of a robot's drops.

    heights: of its lowest point over the floor at release, m. tilts: of its base, rad, about the unit
        vector `axis` of the world.
    controller: "pd", "pd:KP,KD" or "ctrl", or a function of the engine's model and state that returns the
        controls or sets them itself.
    """

    heights: tuple[float, ...]
    tilts: tuple[float, ...] = (0.0,)
    controller: Controller = "pd"
    axis: tuple[float, float, float] = LAND_AXIS


@dataclass(frozen=True, slots=True)
class Footfall:
    """Contact of one part of the robot with the floor in one landing; SI, times
    from the first touch of any part.

    part: its name. touch: when it first met the floor. speed, slide: of the contact point there, normal to
        the floor and along it. contact: how long it then stayed, gaps up to PARTED_S included.
    bounces: how often it came back after it had left for longer. force_max: the largest normal force; NaN
        where a plug-in's law gives it impulses.
    slip: length of the way along the floor while it was pressed on. penetration: the deepest.
    """

    part: str
    touch: float
    speed: float
    slide: float
    contact: float
    bounces: int
    force_max: float
    slip: float
    penetration: float


@dataclass(frozen=True, slots=True)
class Landing:
    """One drop of a robot, and what came of it.

    height, m, and tilt, rad: at release.

    speed_in: of the centre of mass towards the floor at first touch, m/s.
    speed_out: the largest away from it with which the whole robot left the floor; 0 where it never
    did.
    weight: of the robot, N.
    time: s from the first touch, and force: of the floor on the robot, upwards, N, as the mean over
    each step; shape (n,).
    feet: in the order in which they met the floor.
    impulse: of the floor in one step, the largest, N s, where a plug-in's law gives the feet
    impulses; NaN where they feel forces.
    others: the same drop with the first touch at other places in a time step, which is chance; ()
    where there are none, and in each of them.
    """

    height: float
    tilt: float
    speed_in: float
    speed_out: float
    weight: float
    feet: tuple[Footfall, ...]
    time: Floats = field(repr=False, compare=False)
    force: Floats = field(repr=False, compare=False)
    impulse: float = field(default=math.nan, compare=False)
    others: tuple[Landing, ...] = field(default=(), repr=False, compare=False)

    def over_phases(self, name: str) -> tuple[float, float]:
        """The least and the largest value of an attribute over all places of the touch in a step; NaN
        where one is.
        """
        values = np.array([getattr(one, name) for one in (self, *self.others)], dtype=np.float64)
        return float(values.min()), float(values.max())

    @property
    def restitution(self) -> float:
        """e of the centre of mass."""
        return self.speed_out / self.speed_in

    @property
    def peak(self) -> float:
        """The largest force of the floor over the robot's weight; NaN where impacts are impulses."""
        if not math.isnan(self.impulse):
            return math.nan
        return float(self.force.max(initial=0.0)) / self.weight

    @property
    def contact(self) -> float:
        """The longest first contact of a foot, s."""
        return max((foot.contact for foot in self.feet), default=math.nan)

    @property
    def slip(self) -> float:
        """The longest way of a foot along the floor, m."""
        return max((foot.slip for foot in self.feet), default=math.nan)

    @property
    def penetration(self) -> float:
        """The deepest of a foot, m."""
        return max((foot.penetration for foot in self.feet), default=math.nan)

    @property
    def bouncing(self) -> int:
        """Number of feet that bounce."""
        return sum(foot.bounces > 0 for foot in self.feet)


@dataclass(frozen=True, repr=False)
class Landings(Shown):
    """All drops of one robot.

    model: what to call it.
    robot, floor: names of its base and of what it lands on.
    controller: what holds the joints, in words.
    mass: kg.
    drops: heights in order, tilts in order for each.
    notes: sentences a reader must know.
    """

    engine: str
    version: str
    model: str
    robot: str
    floor: str
    start: str
    controller: str
    mass: float
    timestep: float
    gravity: float
    drops: tuple[Landing, ...]
    notes: tuple[str, ...] = ()

    def _lines(self) -> Iterator[str]:
        """Lines for a terminal: the robot, then each drop. Heights in m, forces over the weight."""
        yield f"{self.model}: {self.robot} ({self.mass:.4g} kg) on {self.floor}, {self.engine} {self.version}"
        for drop in self.drops:
            peak = f"force {drop.over_phases('peak')[1]:.3g} times its weight"
            largest = peak if math.isnan(drop.impulse) else f"impulse {drop.impulse:.3g} N s"
            rest = f"largest {largest}, {drop.bouncing} feet bounce"
            yield f"from {drop.height:.3g} m: e = {drop.restitution:.3f}, {rest}"

    def _rows(self) -> Iterator[dict[str, float]]:
        return (record(LANDING, drop) for drop in self.drops)


class FootfallLog:
    """Adds up what one part does on the floor, step by step.

    touch: time of its first touch, s.
    speed, slide: then, towards the floor and along it, m/s.
    by_impulses: impulses turn it back, which have no force.
    contact: s until it first left. bounces: touches after that. slip: way along the floor, m.
    penetration: deepest, m. force_max: largest force, N; NaN of impulses.
    """

    def __init__(
        self, touch: float, speed: float, slide: float, *, by_impulses: bool = False
    ) -> None:
        """Begin with the first touch of a part.

        touch: time, s.
        speed, slide: then, towards the floor and along it, m/s.
        by_impulses: a plug-in's law turns the part back by impulses, which have no force.
        """
        self.touch = touch
        self.speed = speed
        self.slide = slide
        self.contact = 0.0
        self.bounces = 0
        self.slip = 0.0
        self.penetration = 0.0
        self.force_max = math.nan if by_impulses else 0.0
        # End of the last step in which the floor pushed, s.
        self._last = touch

    def add(self, time: float, step: float, force: float, slide: float, depth: float) -> None:
        """Add one step in which the floor pushed.

        time: of the step's start, s.
        step: its length, s.
        force: along the normal, N.
        slide: speed along the floor, m/s.
        depth: penetration, m.
        """
        # A shorter gap is chatter, not a bounce.
        if time - self._last > PARTED_S:
            self.bounces += 1
        if not self.bounces:
            self.contact = time + step - self.touch
        self._last = time + step
        self.force_max = max(self.force_max, force)
        self.slip += slide * step
        self.penetration = max(self.penetration, depth)

    def footfall(self, part: str) -> Footfall:
        """The footfall that the steps add up to."""
        return Footfall(
            part, self.touch, self.speed, self.slide, self.contact, self.bounces,
            self.force_max, self.slip, self.penetration,
        )  # fmt: skip


def latest_touch(height: float, gravity: float) -> float:
    """Time after release, s, at which a robot that has not touched a floor meets none.

    height: of its lowest point over the floor, m.
    gravity: m/s². Legs that its controller moves may touch later than a free fall does.
    """
    return _FALL_SHARE * math.sqrt(2.0 * height / gravity) + _SLACK_S


def raised_for(phase: float, height: float, gravity: float, timestep: float) -> float:
    """Height, m, by which to raise a drop from `height`, m, so that it touches later by that share of
    a time step, s.

    gravity: m/s².
    """
    return phase * timestep * math.sqrt(2.0 * gravity * height)


# Fewer steps in contact do not resolve it.
ENOUGH_STEPS = 20


def few_steps(contact: float, timestep: float) -> tuple[str, ...]:
    """A sentence with the step to take, where so few steps are in contact that e depends by chance on
    where in a step the contact starts; () otherwise.

    contact: the shortest of a robot's, s; NaN or infinite where there is none.
    timestep: s.
    """
    steps = contact / timestep
    if not steps <= STEPS_BY_CHANCE:
        return ()
    words = "Too few steps in contact: e depends on where in a step the contact starts, by chance"
    h = time_step(timestep)
    evidence = f"{steps:.0f} steps in contact at {h} s; {ENOUGH_STEPS} or more are needed"
    return (f"{words}: {evidence}. Use a step of {contact / 60:.1g} s.",)


def over_phases(landing_at: Callable[[float], Landing]) -> Landing:
    """The landing at the first of PHASES, with those at the others. landing_at: drops at a phase."""
    first, *others = (landing_at(phase) for phase in PHASES)
    return replace(first, others=tuple(others))


def take_off_speed(force: Floats, rising: Floats, step: float) -> float:
    """The largest upward speed with which the whole robot leaves the floor for PARTED_S or longer,
    m/s; 0 where it never does.

    force: of the floor, N, (n,).
    rising: upward speed of the centre of mass, m/s, (n,). Both are at the start of each step from
    the first touch on.
    step: s.
    """
    # True in steps in which the robot is off the floor, and after the last one.
    is_off = np.append(force <= 0.0, True)
    starts = np.flatnonzero(is_off[1:] & ~is_off[:-1]) + 1
    fastest = 0.0
    # Steps off the floor that are more than chatter.
    least = max(1, round(PARTED_S / step))
    for start in starts.tolist():
        stays_off = is_off[start : start + least].all() and len(is_off) - start > least
        if start < len(rising) and stays_off:
            fastest = max(fastest, float(rising[start]))
    return fastest


# Drops that judge every setting of a robot's feet.

# Heights of the lowest point at release, m; the rebound is that from the highest.
HEIGHTS = (0.02, 0.05, 0.1)
# Tilts of the base, rad, about an axis of the world about which no robot is symmetric.
TILTS = (0.0, math.radians(5.0))
TILT_AXIS = (0.6, 0.8, 0.0)
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
# The same at more places in a step. At one of them a rebound jumps, with the step in which the foot
# leaves: the range of four misses every fifth drop, that of twelve one in twenty.
MANY_REBOUNDS = tuple(RobotDrop(max(HEIGHTS), 0.0, place / 12) for place in range(12))


@dataclass(frozen=True, slots=True)
class LandedQuantity:
    """A quantity of a landing that a setting of the feet may not make worse.

    field: its key, SI unit and meaning in JSON.
    title, unit: as it is printed.
    slack: a growth that always will do, SI.
    share: times what it was, above which more growth is worse; rebound_share: the same where a
    rebound was asked for, which takes force and way.
    name: of the attribute of `LandingQuantities`.
    """

    field: Field
    title: str
    unit: str
    slack: float
    share: float = 1.2
    rebound_share: float = 1.2
    name: str = ""

    @property
    def si(self) -> float:
        """The printed unit in SI: it is that of the field, or a thousandth of it."""
        return 1e-3 if self.unit.startswith("mm") else 1.0

    def limit(self, was: float, rebound: float) -> float:
        """The largest value, SI, that does not count as worse than one before: NaN where that is NaN.

        rebound: the target, m; 0 for none.
        """
        share = self.rebound_share if rebound > 0.0 else self.share
        return max(share * was, was + self.slack)

    def change(self, was: float, now: float) -> str:
        """Both values, SI, in words."""
        words = f"{self.title} {self.shown(was)} -> {self.shown(now)}"
        return words if math.isinf(now) else f"{words} {self.unit}".rstrip()

    def shown(self, value: float) -> str:
        """A value, SI, in the printed unit; infinite is the time to a rest that never came."""
        return "never" if math.isinf(value) else f"{value / self.si:.3g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class LandingQuantities:
    """Quantities of a landing by which settings of the feet are judged, SI, each with its field and
    its limits; NaN for what a drop is too short for.

    `QUANTITIES` lists them: JSON, its documentation and the judgement take them from there.
    """

    rest: Annotated[
        float,
        LandedQuantity(
            Field(
                "rest",
                "s",
                "time from the first touch until the centre of mass stays slower than 2 cm/s"
                " (null if it never does)",
            ),
            title="time to rest",
            unit="s",
            slack=0.3,
        ),
    ]
    peak: Annotated[
        float,
        LandedQuantity(
            Field("peak_over_weight", "", "largest force of the floor over the robot's weight"),
            title="peak force over weight",
            unit="",
            slack=2.0,
            rebound_share=1.5,
        ),
    ]
    depth: Annotated[
        float,
        LandedQuantity(
            Field("depth", "m", "largest penetration of all drops"),
            title="largest penetration",
            unit="mm",
            slack=5e-4,
        ),
    ]
    sink: Annotated[
        float,
        LandedQuantity(
            Field("sink", "m", "penetration at rest"),
            title="penetration at rest",
            unit="mm",
            slack=2e-4,
        ),
    ]
    travel: Annotated[
        float,
        LandedQuantity(
            Field(
                "travel", "m", "way of the centre of mass along the floor from the touch to the end"
            ),
            title="travel in 10 s",
            unit="mm",
            slack=2e-2,
            rebound_share=1.5,
        ),
    ]
    creep: Annotated[
        float,
        LandedQuantity(
            Field("creep", "m/s", "speed of the centre of mass along the floor in the last 2 s"),
            title="creep at rest",
            unit="mm/s",
            slack=3e-4,
        ),
    ]
    vibration: Annotated[
        float,
        LandedQuantity(
            Field("vibration", "m/s", "vibration at rest"),
            title="vibration at rest",
            unit="mm/s",
            slack=2e-4,
        ),
    ]
    gain: Annotated[
        float,
        LandedQuantity(
            Field(
                "energy_gain",
                "",
                "most energy that a flight starts with beyond that before, over m g h",
            ),
            title="energy gain over m g h",
            unit="",
            slack=5e-3,
        ),
    ]
    late: Annotated[
        float,
        LandedQuantity(
            Field(
                "late_flights",
                "",
                "flights that begin more than 3 s after release, in one drop",
            ),
            title="flights after 3 s",
            unit="",
            slack=0.0,
        ),
    ]


def _quantities() -> Iterator[LandedQuantity]:
    """The quantities that `LandingQuantities` states, each with its name."""
    for name, hint in get_type_hints(LandingQuantities, include_extras=True).items():
        (quantity,) = hint.__metadata__
        yield replace(quantity, name=name)


QUANTITIES = tuple(_quantities())


@dataclass(frozen=True, slots=True, kw_only=True)
class Landed(LandingQuantities):
    """Landing from one drop, SI; NaN for what its time is too short for.

    rebound: height that the centre of mass gains in its highest flight, with the whole robot off
    the floor for longer than chatter, m.
    contact: time from the touch until the first such flight, or the end of the drop, s.
    sag: way of the centre of mass down from the touch to its rest, m, without what the contacts
    give way.
    fell: whether it ends low.
    """

    rebound: float
    contact: float
    sag: float
    fell: bool


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot that is dropped. model: what to call its file. name: of its base. mass: kg. timestep: s.

    gravity: m/s².
    controller: what holds its joints, in words.
    """

    engine: str
    model: str
    name: str
    mass: float
    timestep: float
    gravity: Vector
    controller: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DropTest(LandingQuantities):
    """A robot dropped from each height, at each tilt and phase: the worst of each quantity, SI.

    rebound, spread: mean and largest difference from it over the phases of the flat drops from the
    largest height, m.
    contact: the shortest of a drop, s.
    frequency: of its legs, rad/s, from how far it sags on them; NaN where it does not rest.
    fell: whether it falls over in any drop.
    diverged: whether a drop has no end; the rebound and the quantities are then infinite.
    seconds: of the longest drops.
    drops: their number; flat: of those without a tilt.
    phases: number of drops of which the rebound is the mean.
    settled: number of drops that are long enough to show how the robot rests; the quantities of
    rest are those of these alone.
    """

    robot: Robot
    rebound: float
    spread: float
    contact: float
    frequency: float
    fell: bool
    diverged: bool
    seconds: float
    drops: int
    flat: int
    phases: int
    settled: int

    @property
    def falls(self) -> bool:
        """True if the robot falls over by itself, so that its touch alone can be compared."""
        return self.fell or self.seconds <= SECONDS_TO_FALL

    @property
    def record(self) -> dict[str, float]:
        """The numbers by their keys in JSON, SI."""
        numbers = {field.key: field.of(self) for field in REBOUND}
        for each in QUANTITIES:
            numbers[each.field.key] = getattr(self, each.name)
        return numbers

    def worse_than(self, before: DropTest, rebound: float = 0.0) -> Iterator[str]:
        """Yield a phrase for each quantity of the landing that is worse than before: that grew
        beyond the share of what it was and beyond the slack, both as `QUANTITIES` states them.

        before: the landing to compare with.
        rebound: the target, m; 0 for none: for a rebound some quantities may grow more.
        """
        if self.diverged:
            yield "the simulation diverges"
            return
        for each in QUANTITIES:
            was: float = getattr(before, each.name)
            now: float = getattr(self, each.name)
            # Without a number now a robot that came to rest no longer does; NaN in both tells nothing.
            is_lost = math.isnan(now) and not math.isnan(was)
            if is_lost or now > each.limit(was, rebound):
                yield each.change(was, now)

    def meets(self, rebound: float) -> bool:
        """Say whether the rebound is within a tenth, or 1 mm of none, of a target, m, and no chance."""
        return self.is_near(rebound) and not self.is_chance(rebound)

    def is_near(self, rebound: float) -> bool:
        """Say whether the mean rebound is within a tenth, or 1 mm of none, of a target, m."""
        if self.diverged:
            return False
        return abs(self.rebound - rebound) <= (WITHIN * rebound if rebound else NO_REBOUND)

    def is_chance(self, rebound: float) -> bool:
        """Say whether the rebound varies over the phases by as much as a target, m, to a tenth.

        A mean near the target then says nothing: in some phases the robot stays on the floor.
        """
        return rebound > 0.0 and self.spread >= (1.0 - WITHIN) * rebound


def kv_factor(factor: float) -> float:
    """Factor of the servos' kv that goes with one of kp, in the digits that are printed: its root, as
    the ratio of damping then stays.
    """
    return float(f"{math.sqrt(factor):.2g}")


@dataclass(frozen=True, slots=True)
class Reach:
    """Limits of the rebound that a contact of the feet can give a robot.

    rebound: the nearest to the target, m, of the model as it is and the settings that were tried
    and do not land worse.
    stiffer: (factor of the servos' kp, rebound with it and a contact that was found, m), in order;
    NaN for those with which none was found; () where none was tried. All drops judge that contact:
    nothing is worse than in the model with these servos.
    """

    rebound: float
    stiffer: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class ReboundSettings:
    """Settings that an engine finds for a rebound, each computed when it is asked for.

    meeting: settings that have it in some drops, the most promising first.
    nearest: settings whose rebounds are nearest to it, the nearest first, and with which no drop of
    the search lands worse.
    trading: settings with a rebound nearer to it than the model's, with which something lands
    worse, those with the least first.
    stiffer: see `Reach`.
    advice: sentences on options of the model that spoil every landing.
    """

    meeting: Iterable[ModelSetting]
    nearest: Iterable[ModelSetting]
    trading: Iterable[ModelSetting]
    stiffer: Callable[[], tuple[tuple[float, float], ...]]
    advice: tuple[str, ...] = ()


def drop_test(robot: Robot, drops: Mapping[RobotDrop, Landed | None], seconds: float) -> DropTest:
    """Join the landings of one robot's drops to one test: the worst of each quantity, and the mean
    rebound of the drops without tilt from the largest height.

    drops: one or more; None for a drop that diverged, which makes all numbers infinite.
    seconds: of the longest. The rebound is NaN without drops that have no tilt.
    """
    landed = [each for each in drops.values() if each is not None]
    if len(landed) < len(drops):
        return DropTest(
            robot=robot,
            rebound=math.inf,
            spread=math.inf,
            contact=math.nan,
            **{each.name: math.inf for each in QUANTITIES},
            frequency=math.nan,
            fell=False,
            diverged=True,
            seconds=seconds,
            drops=len(drops),
            flat=_without_tilt(drops),
            phases=0,
            settled=0,
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
    worst = {each.name: _worst(landed, each.name) for each in QUANTITIES}
    fell = any(one.fell for one in landed)
    # A tilted robot sinks by its turn, too.
    on_level = [one for drop, one in drops.items() if one is not None and not drop.tilt]
    sags = [one.sag for one in on_level if one.sag > 0.0]
    frequency = math.nan
    if sags and not fell:
        # A spring that its load shortens by s lets it oscillate at √(g/s).
        frequency = math.sqrt(math.hypot(*robot.gravity) / min(sags))
    return DropTest(
        robot=robot,
        rebound=mean,
        spread=spread,
        contact=min(one.contact for one in landed),
        **worst,
        frequency=frequency,
        fell=fell,
        diverged=False,
        seconds=seconds,
        drops=len(drops),
        flat=_without_tilt(drops),
        phases=len(flat),
        settled=sum(not math.isnan(one.rest) for one in landed),
    )


def _without_tilt(drops: Iterable[RobotDrop]) -> int:
    """Number of drops without a tilt."""
    return sum(not drop.tilt for drop in drops)


def _worst(landed: Iterable[Landed], name: str) -> float:
    """The largest value of a quantity in the drops that are long enough to show it; NaN without one."""
    every = [float(getattr(one, name)) for one in landed]
    return max((value for value in every if not math.isnan(value)), default=math.nan)
