"""A contact under loads: how deep it lies, what friction holds, and how hard a landing hits."""

from __future__ import annotations

import math
from dataclasses import dataclass

# Multiples of the force at rest under which a contact is measured: what a robot's feet bear in
# standing, walking, running and landing.
LOADS = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class Load:
    """A pair at rest, pressed together along its normal.

    times: of the force at rest. force: that the contact bears, N. penetration: m. NaN where the
    pair did not bear it.
    """

    times: float
    force: float
    penetration: float


@dataclass(frozen=True, slots=True)
class Carried:
    """Loads that the contact of a pair carries at rest, SI; NaN for what was not measured.

    loads: rising, the first the pair's own; () where the two do not rest on each other.
    friction: the largest friction over the normal force, in the way in which the contact holds
    most; weakest: in that in which it holds least.
    slope: rad, and creep: on it, along it, m/s; of a ball, which rolls, its rolling.
    """

    loads: tuple[Load, ...] = ()
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
