"""Choice of the law that the data support, by the odds between the laws."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

from hcbench.laws._restitution_series import TOP, restitution_of_one

if TYPE_CHECKING:
    from collections.abc import Mapping


# A law is chosen if all others are this many times less likely.
ODDS_TO_TELL = 25.0
# A law other than eq. (16) needs less of a lead over the law with e0, which can bend towards any.
ODDS_OVER_E0 = 10.0
PLAIN = "hunt-crossley"
WITH_E0 = "hunt-crossley with e0"
EITHER = "hunt-crossley, with or without e0"
FAMILY = (PLAIN, WITH_E0, EITHER)


def chosen_law(evidence: Mapping[str, float]) -> str | None:
    """Choose the law by ln of each law's evidence; None if several are left.

    Eq. (16) with and without e0 are one family: a law outside it must be 25 times less likely than
    the better of the two, and 25 : 1 between the two then decide on e0; EITHER where they do not. A
    constant e is a case of the law with e0, which therefore does not count against it where it is
    behind; the others need less of a lead over that law, for it can bend towards any of them.
    """
    names = sorted(evidence, key=lambda name: -evidence[name])
    best = names[0]
    in_family = best in FAMILY
    for name in names[1:]:
        behind = evidence[best] - evidence[name]
        if (in_family and name in FAMILY) or (best == "constant" and name == WITH_E0):
            continue
        needed = ODDS_TO_TELL
        if name == WITH_E0:
            needed = ODDS_OVER_E0
        if behind < math.log(needed):
            return None
    if not in_family:
        return best
    lead = evidence[PLAIN] - evidence[WITH_E0]
    if abs(lead) < math.log(ODDS_TO_TELL):
        return EITHER
    return best


def laws_left(evidence: Mapping[str, float], odds: float = ODDS_TO_TELL) -> set[str]:
    """Laws that are not ruled out at these odds by the likeliest."""
    top = max(evidence.values())
    return {name for name, one in evidence.items() if one > top - math.log(odds)}


def odds_of(evidence: Mapping[str, float]) -> dict[str, float]:
    """{law: its odds against the likeliest of the others, within exp(-700) ... exp(700)}.

    evidence: {law: ln of its evidence}, two laws or more.
    """
    odds = {}
    for name, one in evidence.items():
        best_of_others = max(e for other, e in evidence.items() if other != name)
        # exp of more than 709 overflows a float.
        log_odds = max(-700.0, min(700.0, one - best_of_others))
        odds[name] = math.exp(log_odds)
    return odds


# Below this d, ln e is -(2/3) d, to five digits more than anybody measures.
_TINY = 1e-5
# The laws' formulas are cut off at this e.
_LEAST_E = 1e-3
# Powers of the speed: 1 - e of a viscoelastic impact, e of a plastic one.
VISCOELASTIC_POWER = 0.2
PLASTIC_POWER = -0.25

# ln e, d ln e/d ln v, d ln e/d parameters.
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
        """ln e at a speed, m/s, its slope over ln v, and its derivative by ln e at the reference
        speed.

        Both slopes are 0 where the law is cut off: at an e of _LEAST_E, and at an e of 1 of a
        plastic impact.
        """
        moving = self.factor * speed**self.power
        e = self.level + moving
        # Below this e the formula of the law no longer holds.
        if e < _LEAST_E:
            return math.log(_LEAST_E), 0.0, (0.0,)
        # The power law of plastic impact starts at the speed of first yield; below it e is 1.
        if self.level == 0.0 and e > 1.0:
            return 0.0, 0.0, (0.0,)
        at_reference = self.level + self.factor * self.reference**self.power
        by_parameter = 1.0
        if self.power:
            by_parameter = at_reference / e * (speed / self.reference) ** self.power
        return math.log(e), self.power * moving / e, (by_parameter,)


class ConstantLaw(CandidateLaw):
    """The same e at all speeds."""

    name, formula = "constant", "e"

    def curve(self, parameters: tuple[float, ...], reference: float) -> FittedCurve:
        """The law with these parameters."""
        return _PowerCurve(0.0, min(math.exp(parameters[0]), 1.0), 0.0, reference)

    def describe(self, parameters: tuple[float, ...], reference: float) -> dict[str, float]:
        """e, by the name "restitution"."""
        return {"restitution": math.exp(parameters[0])}


class ViscoelasticLaw(CandidateLaw):
    """e = 1 - C v^(1/5), the first order of Ramírez, Pöschel, Brilliantov
    & Schwager 1999, PRE 60, 4465.
    """

    name = "viscoelastic"
    formula = "1 - C v^(1/5)"

    def curve(self, parameters: tuple[float, ...], reference: float) -> FittedCurve:
        """The law with these parameters."""
        factor = -self.describe(parameters, reference)["coefficient"]
        return _PowerCurve(1.0, factor, VISCOELASTIC_POWER, reference)

    def describe(self, parameters: tuple[float, ...], reference: float) -> dict[str, float]:
        """C of 1 - C v^(1/5), (s/m)^(1/5), by the name "coefficient"."""
        return {"coefficient": -math.expm1(parameters[0]) / reference**VISCOELASTIC_POWER}


class PlasticLaw(CandidateLaw):
    """e = C v^(-1/4), at most 1: impacts that yield, at speeds well above that of first yield."""

    name = "plastic"
    formula = "C v^(-1/4)"

    def curve(self, parameters: tuple[float, ...], reference: float) -> FittedCurve:
        """The law with these parameters."""
        factor = self.describe(parameters, reference)["coefficient"]
        return _PowerCurve(0.0, factor, PLASTIC_POWER, reference)

    def describe(self, parameters: tuple[float, ...], reference: float) -> dict[str, float]:
        """C of C v^(-1/4), (m/s)^(1/4), by the name "coefficient"."""
        return {"coefficient": math.exp(parameters[0]) / reference**PLASTIC_POWER}


def hunt_crossley(d: float) -> tuple[float, float]:
    """ln e of eq. (16) and its slope over ln d, at d = (3/2) α v.

    Odd in d, so that searches may cross 0: for d below 0 both have the other sign.
    """
    size = abs(d)
    if size < _TINY:
        return -2.0 / 3.0 * d, -2.0 / 3.0 * d
    if size <= TOP:
        e = restitution_of_one(size)
    else:
        # Far beyond any real impact e goes as 1/d.
        e = 1.0 / size
    # With u = d e: du/dd = d (1 - u)/((1 + d) u), from d (1 + e) = ln(1 + d) - ln(1 - d e).
    slope = (1.0 - size * e) / ((1.0 + size) * e * e) - 1.0
    return math.copysign(math.log(e), -d), math.copysign(slope, -d)


# The points of one posterior are described many times.
@lru_cache(maxsize=4096)
def dissipation_of(log_e: float) -> float:
    """d = (3/2) α v, a pure number, at which ln e of eq. (16) is this, by Newton's method over ln d.

    Odd in ln e: above 0, a gain, d is below 0.
    Raises OverflowError beyond a ln e of ±709.7.
    """
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
    """The curve ln e = ln e0 + ln e of eq. (16), with its parameters fixed."""

    # (3/2) α, s/m: times a speed it is the dissipation d of the law.
    rate: float
    # Speed, m/s, at which the first parameter of the fit is ln e.
    reference: float
    # None: e0 = 1.
    log_e0: float | None

    @property
    def count(self) -> int:
        """Number of parameters of the law."""
        if self.log_e0 is None:
            return 1
        return 2

    def at(self, speed: float) -> float:
        """e at a speed in m/s, without the derivatives, which take as long again."""
        log_e, _ = hunt_crossley(self.rate * speed)
        return math.exp(log_e if self.log_e0 is None else self.log_e0 + log_e)

    def local(self, speed: float) -> Local:
        """ln e at a speed, m/s, its slope over ln v, and its derivatives by the logarithms of both
        losses.
        """
        log_e, slope = hunt_crossley(self.rate * speed)
        at_reference = hunt_crossley(self.rate * self.reference)[1]
        # Without loss both slopes are 0, and their ratio is that of the speeds.
        by_loss = speed / self.reference
        if at_reference:
            by_loss = slope / at_reference
        if self.log_e0 is None:
            return log_e, slope, (by_loss,)
        return self.log_e0 + log_e, slope, (by_loss, 1.0)


class HuntCrossleyLaw(CandidateLaw):
    """The law of eq. (16) as a candidate: e falls with speed."""

    name = "hunt-crossley"
    formula = "e of the law, α"

    def curve(self, parameters: tuple[float, ...], reference: float) -> FittedCurve:
        """The law with these parameters."""
        return _HuntCrossleyCurve(dissipation_of(parameters[0]) / reference, reference, None)

    def describe(self, parameters: tuple[float, ...], reference: float) -> dict[str, float]:
        """α, s/m, by the name "alpha"."""
        return {"alpha": dissipation_of(parameters[0]) / (1.5 * reference)}


class LossyHuntCrossleyLaw(CandidateLaw):
    """e0 times e of eq. (16): a constant share is lost besides, to vibration, spin or friction.

    Parameters: ln e of eq. (16) at the reference speed, ln e0.
    """

    name = "hunt-crossley with e0"
    formula = "e0 · e of the law, α"
    count = 2

    def curve(self, parameters: tuple[float, ...], reference: float) -> FittedCurve:
        """The law with these parameters."""
        return _HuntCrossleyCurve(
            dissipation_of(parameters[0]) / reference, reference, parameters[1]
        )

    def describe(self, parameters: tuple[float, ...], reference: float) -> dict[str, float]:
        """α, s/m, and e0, by the names "alpha" and "e0"."""
        alpha = dissipation_of(parameters[0]) / (1.5 * reference)
        return {"alpha": alpha, "e0": math.exp(parameters[1])}


LAWS: dict[str, CandidateLaw] = {
    law.name: law
    for law in (
        HuntCrossleyLaw(),
        LossyHuntCrossleyLaw(),
        ConstantLaw(),
        ViscoelasticLaw(),
        PlasticLaw(),
    )
}
