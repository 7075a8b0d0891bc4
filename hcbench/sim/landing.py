"""A robot that lands on its floor: what is dropped, and what an engine measures of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from hcbench.system.text import Shown
from hcbench.terms.records import LANDING, record

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats
    from hcbench.terms.options import Controller

# A foot that is off the floor for longer, s, has left it; shorter gaps are chatter.
PARTED_S = 0.005
# Time after the first touch, s, in which a landing is measured.
WINDOW_S = 0.5


@dataclass(frozen=True, slots=True)
class DropPlan:
    """Heights, tilts and controller of a robot's drops.

    heights: of its lowest point over the floor at release, m. tilts: of its base about the world's y, rad.
    controller: "pd", "pd:KP,KD" or "ctrl", or a function of the engine's model and state that returns the
        controls or sets them itself.
    """

    heights: tuple[float, ...]
    tilts: tuple[float, ...] = (0.0,)
    controller: Controller = "pd"


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
    """One drop.

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
            peak = f"force {drop.peak:.3g} times its weight"
            largest = peak if math.isnan(drop.impulse) else f"impulse {drop.impulse:.3g} N s"
            rest = f"largest {largest}, {drop.bouncing} feet bounce"
            yield f"from {drop.height:.3g} m: e = {drop.restitution:.3f}, {rest}"

    def _rows(self) -> Iterator[dict[str, float]]:
        return (record(LANDING, drop) for drop in self.drops)


class FootfallLog:
    """Adds up what one part does on the floor, step by step."""

    def __init__(
        self, touch: float, speed: float, slide: float, *, by_impulses: bool = False
    ) -> None:
        self.touch = touch
        self.speed = speed
        self.slide = slide
        self.contact = 0.0
        self.bounces = 0
        self.slip = 0.0
        self.penetration = 0.0
        self.force_max = math.nan if by_impulses else 0.0
        self._last = touch

    def add(self, time: float, step: float, force: float, slide: float, depth: float) -> None:
        """Add one step in which the floor pushed.

        time: of its start, s.
        step: s.
        force: N.
        slide: speed along the floor, m/s.
        depth: m.
        """
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


def take_off_speed(force: Floats, rising: Floats, step: float) -> float:
    """The largest upward speed with which the whole robot leaves the
    floor, m/s; 0 where it never does.

    force, N, rising: speed of the centre of mass, m/s, at the start of each
    step from the first touch on.
    """
    off = np.append(force <= 0.0, True)
    starts = np.flatnonzero(off[1:] & ~off[:-1]) + 1
    fastest = 0.0
    least = max(1, round(PARTED_S / step))
    for start in starts.tolist():
        if start < len(rising) and off[start : start + least].all() and len(off) - start > least:
            fastest = max(fastest, float(rising[start]))
    return fastest
