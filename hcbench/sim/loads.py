"""A contact under loads: how deep it lies, what friction holds, and how hard a landing hits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hcbench.sim.rest import Rest
    from hcbench.terms.impact import Floats

# How every engine loads a contact.

# Multiples of the force at rest under which a contact is measured: what a robot's feet bear in
# standing, walking, running and landing.
LOADS = (1.0, 2.0, 5.0, 10.0)
# Time for which a pair is pressed, s, and the last part of it, over which a mean is taken.
PRESSED_S = 1.0
LAST = 0.2
# Bounds the time of a press at short steps.
PRESSED_STEPS = 5000
# A pair bears a load if the contact's force is within this share of it, and varies by less.
_BEARS = 0.1
# A push along the plate is so many times the friction that the model asks for: the pair slides.
_PUSH = 2.0
# Steps in which a push finds the limit of friction: a soft contact takes some.
PUSHED_STEPS = 20
# A slope, rad; it is this share of the friction angle where that is less: the body has to hold.
_SLOPE = math.radians(10.0)
_OF_FRICTION = 2.0 / 3.0
# A body rolls if its turning makes up more than this share of its speed.
_ROLLS = 0.5
# One that rolls down a slope is faster, m/s: what is slower creeps, and may turn on its place.
_SLOWEST_ROLL = 1e-3


def slope_of(friction: float) -> float:
    """Slope, rad, on which a body of a friction μ is laid; 0 without friction."""
    return min(_SLOPE, _OF_FRICTION * math.atan(friction or 0.0))


def push_of(friction: float, load: float) -> float:
    """Push along the plate, N, that a contact of friction μ under a load, N, does not hold."""
    return _PUSH * (1.0 + friction) * load


def creep_of(drift: float, spin: float, lever: float) -> float:
    """Creep of a body that drifts down a slope, m/s; NaN where it rolls.

    spin: mean angular speed, rad/s. lever: from its contact point to its centre, m.
    """
    rolls = drift > _SLOWEST_ROLL and spin * lever > _ROLLS * drift
    return math.nan if rolls else drift


@dataclass(frozen=True, slots=True)
class BorneLoad:
    """A pair at rest, pressed together along its normal.

    times: of the force at rest. force: that the contact bears, N. penetration: m. NaN where the
    pair did not bear it.
    """

    times: float
    force: float
    penetration: float


def rests(rest: Rest) -> bool:
    """Say whether a body lies still: a contact that hammers has a mean force, and no depth at it."""
    return not rest.force_noise > _BEARS


def borne(times: float, own: float, rows: Floats) -> BorneLoad:
    """A load of so many times its own, N; without numbers where the contact's force is not that, or
    does not stay.

    rows: (n, 2) of the last steps: force, N; penetration, m.
    """
    force, penetration = rows.mean(axis=0).tolist()
    noise = float(rows[:, 0].std())
    if not (abs(force / (times * own) - 1.0) < _BEARS and noise < _BEARS * force):
        return BorneLoad(times, math.nan, math.nan)
    return BorneLoad(times, force, penetration)


@dataclass(frozen=True, slots=True)
class Carried:
    """Loads that the contact of a pair carries at rest, SI; NaN for what was not measured.

    loads: rising, the first the pair's own; () where the two do not rest on each other.
    friction: the largest friction over the normal force, in the way in which the contact holds
    most; weakest: in that in which it holds least.
    slope: rad, and creep: on it, along it, m/s; of a ball, which rolls, its rolling.
    """

    loads: tuple[BorneLoad, ...] = ()
    friction: float = math.nan
    weakest: float = math.nan
    slope: float = math.nan
    creep: float = math.nan

    @property
    def load(self) -> float:
        """Force of the contact at rest, N."""
        return self.loads[0].force if self.loads else math.nan

    @property
    def stiffness(self) -> float:
        """Force at rest over penetration at rest, N/m; NaN where the contact does not yield."""
        if not self.loads or not self.loads[0].penetration > 0.0:
            return math.nan
        return self.loads[0].force / self.loads[0].penetration

    @property
    def holds(self) -> float:
        """Angle of the steepest slope, rad, on which friction holds in every direction."""
        return math.atan(self.weakest)

    @property
    def holds_most(self) -> float:
        """The same, rad, in the direction in which friction holds most."""
        return math.atan(self.friction)


@dataclass(frozen=True, slots=True)
class LandingPeak:
    """Peak forces of landings from a height, m, over the body's weight: the lowest and the highest,
    as the touch falls into a time step.
    """

    height: float
    lowest: float
    highest: float
