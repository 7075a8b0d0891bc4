"""Laws that a measurement may follow: ln e over speed, with derivatives.

The first parameter of each is ln e at a reference speed in the middle of the data. In it the laws are nearly
linear, and being the same thing in all of them it makes their likelihoods comparable.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

from hcbench.laws._restitution_series import TOP, restitution_of_one

# Below this d, ln e = -(2/3) d to five digits more than anybody measures
_TINY = 1e-5
_LEAST_E = 1e-3
VISCOELASTIC_POWER, PLASTIC_POWER = 0.2, -0.25

# Ln e, d ln e/d ln v, d ln e/d parameters
Local = tuple[float, float, tuple[float, ...]]


class FittedCurve(ABC):
    """One law with its parameters fixed."""

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of parameters of the law."""

    @abstractmethod
    def local(self, speed: float) -> Local:
        """ln e at a speed in m/s, its slope over ln v, and its derivatives by the parameters."""

    def at(self, speed: float) -> float:
        """e at a speed in m/s."""
        return math.exp(self.local(speed)[0])


class CandidateLaw(ABC):
    """A law with `count` parameters."""

    name: ClassVar[str]
    formula: ClassVar[str]
    count: ClassVar[int] = 1

    @abstractmethod
    def curve(self, parameters: tuple[float, ...], reference: float) -> FittedCurve:
        """The law with these parameters; reference: speed in m/s at which the first one is ln e."""

    @abstractmethod
    def describe(self, parameters: tuple[float, ...], reference: float) -> dict[str, float]:
        """Return the parameters of the law by their common names, SI."""


@dataclass(frozen=True, slots=True)
class _PowerCurve(FittedCurve):
    """ln e from e = level + factor v^power; derivatives by ln e at the reference speed."""

    level: float
    factor: float
    power: float
    reference: float

    @property
    def count(self) -> int:
        """Number of parameters of the law."""
        return 1

    def local(self, speed: float) -> Local:
        moving = self.factor * speed**self.power
        e = self.level + moving
        if e < _LEAST_E:  # the law's own formula ends here
            return math.log(_LEAST_E), 0.0, (0.0,)
        if self.level == 0.0 and e > 1.0:  # plastic, below the speed of first yield
            return 0.0, 0.0, (0.0,)
        at_reference = self.level + self.factor * self.reference**self.power
        by_parameter = at_reference / e * (speed / self.reference) ** self.power if self.power else 1.0
        return math.log(e), self.power * moving / e, (by_parameter,)


class ConstantLaw(CandidateLaw):
    """The same e at all speeds."""

    name, formula = "constant", "e"

    def curve(self, parameters: tuple[float, ...], reference: float) -> FittedCurve:
        """The law with these parameters."""
        return _PowerCurve(0.0, min(math.exp(parameters[0]), 1.0), 0.0, reference)

    def describe(self, parameters: tuple[float, ...], reference: float) -> dict[str, float]:
        """α in s/m, e0, e, or C in its own unit."""
        return {"restitution": math.exp(parameters[0])}


class ViscoelasticLaw(CandidateLaw):
    """e = 1 - C v^(1/5), the first order of Ramírez, Pöschel, Brilliantov & Schwager 1999, PRE 60, 4465."""

    name, formula = "viscoelastic", "1 - C v^(1/5)"

    def curve(self, parameters: tuple[float, ...], reference: float) -> FittedCurve:
        """The law with these parameters."""
        factor = -self.describe(parameters, reference)["coefficient"]
        return _PowerCurve(1.0, factor, VISCOELASTIC_POWER, reference)

    def describe(self, parameters: tuple[float, ...], reference: float) -> dict[str, float]:
        """α in s/m, e0, e, or C in its own unit."""
        return {"coefficient": -math.expm1(parameters[0]) / reference**VISCOELASTIC_POWER}


class PlasticLaw(CandidateLaw):
    """e = C v^(-1/4), at most 1: impacts that yield, at speeds well above that of first yield."""

    name, formula = "plastic", "C v^(-1/4)"

    def curve(self, parameters: tuple[float, ...], reference: float) -> FittedCurve:
        """The law with these parameters."""
        factor = self.describe(parameters, reference)["coefficient"]
        return _PowerCurve(0.0, factor, PLASTIC_POWER, reference)

    def describe(self, parameters: tuple[float, ...], reference: float) -> dict[str, float]:
        """α in s/m, e0, e, or C in its own unit."""
        return {"coefficient": math.exp(parameters[0]) / reference**PLASTIC_POWER}


def hunt_crossley(d: float) -> tuple[float, float]:
    """ln e of eq. (16) and its slope over ln d, at d = (3/2) α v; odd in d, so that searches may cross 0."""
    size = abs(d)
    if size < _TINY:
        return -2.0 / 3.0 * d, -2.0 / 3.0 * d
    e = restitution_of_one(size) if size <= TOP else 1.0 / size
    # With u = d e: du/dd = d (1 - u)/((1 + d) u), from d (1 + e) = ln(1 + d) - ln(1 - d e).
    slope = (1.0 - size * e) / ((1.0 + size) * e * e) - 1.0
    return math.copysign(math.log(e), -d), math.copysign(slope, -d)


# The points of one posterior are described again and again
@lru_cache(maxsize=4096)
def dissipation_of(log_e: float) -> float:
    """d = (3/2) α v at which ln e of eq. (16) is this, by Newton's iteration over ln d."""
    if abs(log_e) < 1e-6:
        return -1.5 * log_e
    wanted = -abs(log_e)
    d = 1.5 * math.expm1(-wanted)
    for _ in range(20):
        now, slope = hunt_crossley(d)
        step = (wanted - now) / slope
        d *= math.exp(max(-1.0, min(1.0, step)))
        if abs(step) < 1e-13:
            break
    return math.copysign(d, -log_e)


@dataclass(frozen=True, slots=True)
class _HuntCrossleyCurve(FittedCurve):
    """ln e = ln e0 + ln e of eq. (16)."""

    rate: float  # (3/2) α, s/m
    reference: float
    log_e0: float | None

    @property
    def count(self) -> int:
        """Number of parameters of the law."""
        return 1 if self.log_e0 is None else 2

    def local(self, speed: float) -> Local:
        log_e, slope = hunt_crossley(self.rate * speed)
        at_reference = hunt_crossley(self.rate * self.reference)[1]
        by_loss = slope / at_reference if at_reference else speed / self.reference
        if self.log_e0 is None:
            return log_e, slope, (by_loss,)
        return self.log_e0 + log_e, slope, (by_loss, 1.0)


class HuntCrossleyLaw(CandidateLaw):
    """e of eq. (16)."""

    name, formula = "hunt-crossley", "e of the law, α"

    def curve(self, parameters: tuple[float, ...], reference: float) -> FittedCurve:
        """The law with these parameters."""
        return _HuntCrossleyCurve(dissipation_of(parameters[0]) / reference, reference, None)

    def describe(self, parameters: tuple[float, ...], reference: float) -> dict[str, float]:
        """α in s/m, e0, e, or C in its own unit."""
        return {"alpha": dissipation_of(parameters[0]) / (1.5 * reference)}


class LossyHuntCrossleyLaw(CandidateLaw):
    """e0 times e of eq. (16): a constant share is lost besides, to vibration, spin or friction.

    Parameters: ln e of eq. (16) at the reference speed, ln e0.
    """

    name, formula, count = "hunt-crossley with e0", "e0 · e of the law, α", 2

    def curve(self, parameters: tuple[float, ...], reference: float) -> FittedCurve:
        """The law with these parameters."""
        return _HuntCrossleyCurve(dissipation_of(parameters[0]) / reference, reference, parameters[1])

    def describe(self, parameters: tuple[float, ...], reference: float) -> dict[str, float]:
        """α in s/m, e0, e, or C in its own unit."""
        alpha = dissipation_of(parameters[0]) / (1.5 * reference)
        return {"alpha": alpha, "e0": math.exp(parameters[1])}


LAWS: dict[str, CandidateLaw] = {
    law.name: law
    for law in (HuntCrossleyLaw(), LossyHuntCrossleyLaw(), ConstantLaw(), ViscoelasticLaw(), PlasticLaw())
}
