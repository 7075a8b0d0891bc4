"""Restitution over impact speed, e(v): the target of a contact, or what
a plug-in gives to each impact.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from hcbench.laws import closed_form
from hcbench.system.errors import SettingError
from hcbench.terms.arguments import checked_fields
from hcbench.terms.bounds import require
from hcbench.terms.impact import Floats
from hcbench.terms.resolution import SIGMAS_95

# The e that an α stands for: that of eq. (16), or 1 - α v of eq. (2).
Reading = Literal["law", "linear"]


class RestitutionCurve(ABC):
    """e as a function of the impact speed.

    `of` of each kind: the measurement that e is taken from, in a line; "" for numbers of a user.
    """

    __slots__ = ()
    of: str

    @abstractmethod
    def at(self, speed: Floats | float) -> Floats:
        """e at impact speeds (m/s), same shape."""

    @property
    @abstractmethod
    def description(self) -> str:
        """Name of the curve in a report."""

    def best_constant(self, low: float, high: float) -> float:
        """The one e with the least largest error over a band of speeds, m/s."""
        e = self.at(np.geomspace(low, high, 50))
        return float(e.min() + e.max()) / 2


@checked_fields
@dataclass(frozen=True)
class Restitution(RestitutionCurve):
    """e of a contact with the parameter α: it falls as the impact speed grows.

    alpha: α, s/m.
    reading: "law" for e of eq. (16), "linear" for e = 1 - α v of eq. (2), below 0 from v = 1/α on.
    uncertainty: standard uncertainty of α, s/m.

    Raises SettingError for an α below 0 or not finite.
    """

    alpha: float
    reading: Reading = "law"
    uncertainty: float = 0.0
    of: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        if not 0 <= self.alpha < math.inf:
            raise SettingError("alpha", f"{self.alpha!r} s/m", "0 s/m or more")
        good = self.reading in get_args(Reading)
        require("reading", self.reading, good, "'law' or 'linear'", error=SettingError)

    def at(self, speed: Floats | float) -> Floats:
        """e at impact speeds (m/s), same shape."""
        if self.reading == "linear":
            return closed_form.restitution_linear(self.alpha, speed)
        return closed_form.restitution(self.alpha, speed)

    def rebound(
        self, penetration: Floats | float, rate: Floats | float, timestep: float, gravity: float
    ) -> Floats:
        """Speed, m/s, at which a body leaves a semi-implicit step that reverses it, so that e holds
        at touch.

        penetration: m, at the step's start.
        rate: m/s, above 0 on approach, at the step's start.
        timestep: h, s.
        gravity: g towards the plate, m/s².
        Free flight keeps U² = (v + g h/2)² - 2 g x, U the speed at the touch plane; after a step of
        h the body is at x - h s, with a rate of -s. Returned is s; 0 for a body too slow to leave.
        Same shape as penetration and rate.
        """
        half = gravity * timestep / 2
        sunk = 2.0 * gravity * np.asarray(penetration)
        touch = np.sqrt(np.maximum(0.0, (np.asarray(rate) + half) ** 2 - sunk))
        left = np.clip(self.at(touch), 0.0, 1.0) * touch
        leaves = np.sqrt(np.maximum(0.0, left**2 + sunk)) - half
        return np.where(touch > 0.0, np.maximum(0.0, leaves), 0.0)

    @property
    def description(self) -> str:
        """Name of the curve in a report: its α and how α gives e(v)."""
        by = f" ± {self.uncertainty:.2g}" if self.uncertainty else ""
        reading = "the law" if self.reading == "law" else "1 - α v"
        if self.of:
            return f"{self.of}, by {reading}"
        return f"α = {self.alpha:.4g}{by} s/m by {reading}"

    def margin(self, speeds: Floats | float) -> float:
        """Largest uncertainty of e at these speeds (m/s), with 95 % confidence, from that of α; 0
        for an α that is known exactly.
        """
        off = SIGMAS_95 * self.uncertainty
        e = self.at(speeds)
        low = Restitution(self.alpha + off, self.reading).at(speeds)
        high = Restitution(max(self.alpha - off, 0.0), self.reading).at(speeds)
        return float(max(np.max(e - low), np.max(high - e)))


@checked_fields
@dataclass(frozen=True)
class ConstantRestitution(RestitutionCurve):
    """The same e at all impact speeds.

    restitution: e; SettingError outside 0 ... 1. `Flores.delivered(0.8)` is what the law of
    that name makes of an e of 0.8.
    """

    restitution: float
    of: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        good = 0 <= self.restitution <= 1
        require("restitution", self.restitution, good, "0 ... 1", error=SettingError)
        object.__setattr__(self, "restitution", float(self.restitution))

    def at(self, speed: Floats | float) -> Floats:
        """e at impact speeds (m/s), same shape."""
        return np.full(np.shape(speed), self.restitution)

    @property
    def description(self) -> str:
        """Name of the curve in a report."""
        return self.of or f"constant e = {self.restitution:g}"


@dataclass(frozen=True, slots=True)
class MeasuredRestitution(RestitutionCurve):
    """e measured at some impact speeds: straight lines between the points, constant beyond them.

    points: pairs (v m/s, e) in any order.
    Raises SettingError for none and for an e outside 0 ... 1.
    """

    points: tuple[tuple[float, float], ...]
    of: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        if not self.points:
            raise SettingError("points", "none", "at least one pair of v and e")
        for v, e in self.points:
            if not 0 <= e <= 1:
                raise SettingError("points", f"e = {e:g} at {v:g} m/s", "e of 0 ... 1")

    @property
    def speeds(self) -> Floats:
        """Impact speeds of the points, m/s, rising."""
        return np.array(sorted(self.points))[:, 0]

    @property
    def values(self) -> Floats:
        """e of the points, in the order of `speeds`."""
        return np.array(sorted(self.points))[:, 1]

    def at(self, speed: Floats | float) -> Floats:
        """e at impact speeds (m/s), same shape."""
        return np.asarray(np.interp(speed, self.speeds, self.values))

    @property
    def description(self) -> str:
        """Name of the curve in a report."""
        return self.of or f"{len(self.points)} measured pairs"
