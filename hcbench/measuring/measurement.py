"""Measurement of a pair in a user's model, and the target it is compared with."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench import scoring
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import (
    ConstantRestitution,
    MeasuredRestitution,
    Reading,
    Restitution,
    RestitutionCurve,
)
from hcbench.measuring.contact import ContactMeaning
from hcbench.measuring.curve import Curve, curve_of
from hcbench.sim.model_under_test import Facts, Request
from hcbench.sim.rest import Rest
from hcbench.system.errors import UserError
from hcbench.system.text import Drawn, gravity_text, sanitized, time_step
from hcbench.terms import units
from hcbench.terms.arguments import checked
from hcbench.terms.impact import Impact, Status
from hcbench.terms.options import Quantity
from hcbench.terms.resolution import STEPS_TO_COMPARE, STEPS_TO_SHOW

# Default tolerance of e: causes are looked for only where the error is larger.
TOLERANCE = 0.02
# An e above 1 by more than this is a gain of energy, not round-off.
GAIN = 1e-6
# Causes are looked for if e is above 1 by more than this.
NOTABLE_GAIN = 1e-3
# No law of a bounce is fitted if every e is lower.
_LEAST_E = 0.1


@checked
def Wanted(
    alpha: Quantity | None = None,
    restitution: Quantity | None = None,
    points: Sequence[tuple[Quantity, float]] = (),
    reading: Reading = "law",
) -> RestitutionCurve:
    """Build the target's e(v) from exactly one of alpha, restitution and points; SI numbers, or
    with units.

    alpha: s/m, of eq. (16) (`reading` "law") or of e = 1 - α v (`reading` "linear"); "0.31 +- 0.004
    s/m" has a standard uncertainty.
    restitution: one e for all speeds.
    points: pairs (v m/s, e), straight between, constant beyond.
    Raises UserError for none or several of the three and for an e outside 0 ... 1, QuantityError
    for text that is not such a quantity.
    """
    ways: dict[str, Any] = {"alpha": alpha, "restitution": restitution, "points": None}
    if len(points):
        ways["points"] = points
    given = [name for name, value in ways.items() if value is not None]
    if len(given) != 1:
        raise UserError("target", " and ".join(given) or "none", f"one of {', '.join(ways)}")
    if alpha is not None:
        value, uncertainty = units.parse_uncertain(alpha, "alpha", "alpha")
        return Restitution(value, reading, uncertainty)
    if restitution is not None:
        return ConstantRestitution(
            units.parse(restitution, "restitution", "restitution", least=0.0)
        )
    return MeasuredRestitution(read_points(points))


def read_points(points: Any) -> tuple[tuple[float, float], ...]:
    """Pairs of v, m/s, and e as floats.

    points: pairs of a number or text with a unit, and a number.
    Raises QuantityError for text that is not a speed, UserError for anything but pairs.
    """
    try:
        return tuple((units.parse(v, "speed", "points"), float(e)) for v, e in points)
    except (TypeError, ValueError, OverflowError):
        raise UserError("points", f"{points!r:.80}", "pairs of v in m/s and e") from None


@dataclass(frozen=True, slots=True)
class Cause:
    """A suspect that was found to matter.

    alone: largest |e - goal| at the launches that were tried, with this one fixed and nothing else.
    without: the same with the other causes fixed and not this one. NaN where that was not tried.
    """

    code: str
    title: str
    evidence: str
    fix: str
    alone: float = math.nan
    without: float = math.nan


@dataclass(frozen=True, repr=False)
class Measurement(Drawn):
    """One pair of one model, measured.

    facts: of the model, the engine and the pair.
    request: the launches that were asked for.
    impacts: one for each launch.
    wanted: the target e(v), None for none.
    causes: of a difference from the target, the strongest first.
    remedy: what is left with all causes fixed, as a sentence.
    rest: how the two lie on each other; None where they do not, or where that was not measured.
    rest_causes: of what is too much there.
    contact: what the contact means in a robot's words; None where that was not asked for.
    """

    facts: Facts
    request: Request
    impacts: tuple[Impact, ...]
    wanted: RestitutionCurve | None = None
    causes: tuple[Cause, ...] = ()
    remedy: str = ""
    rest: Rest | None = None
    rest_causes: tuple[Cause, ...] = ()
    contact: ContactMeaning | None = None

    @property
    def curve(self) -> Curve:
        """e over speed, one point for each launch speed and angle, in the order of the request."""
        wanted = self.wanted
        if wanted is None:
            return curve_of(self.impacts)
        return curve_of(self.impacts, lambda impact: float(wanted.at(impact.speed_in)))

    @property
    def asked_at(self) -> dict[float, float]:
        """{launch speed, m/s: e that the model asks for there}; NaN where it asks for none."""
        speeds = self.request.speeds
        e = self.facts.asked or (math.nan,) * len(speeds)
        return dict(zip(speeds, e, strict=True))

    @property
    def headline(self) -> list[str]:
        """Lines of model, pair, engine and conditions of the measurement, four in all.

        The step is in s, gravity in m/s², the effective mass in kg.
        """
        facts = self.facts
        step = time_step(self.facts.timestep)
        return [
            f"{sanitized(facts.model)}: {sanitized(facts.pair[0])} on {sanitized(facts.pair[1])}",
            f"{facts.engine} {facts.version}, step {step} s, gravity {gravity_text(facts.gravity)} m/s^2",
            f"effective mass {self.effective_mass:.4g} kg, {sanitized(facts.moved)}",
            f"they meet {sanitized(facts.meeting)}",
        ]

    def _lines(self) -> Iterator[str]:
        """Yield lines for a terminal: two of the headline, e at up to five speeds, and up to three
        causes.
        """
        yield from self.headline[:2]
        if self.failure:
            yield self.failure
            return
        curve = self.curve
        # Evenly over the band.
        shown = curve[:: max(1, len(curve) // 4)]
        for point in shown[:5]:
            yield f"e = {point.restitution:.4f} at {point.speed_in:.4g} m/s"
        for cause in self.causes[:3]:
            yield f"{cause.code}: {cause.title}"

    def _rows(self) -> Iterator[dict[str, Any]]:
        for point in self.curve:
            yield point.record(self.request.is_oblique)

    @property
    def failure(self) -> str:
        """Sentence on why every launch failed: the reason of the first and the likeliest cause; ""
        where one has an e, and where the bodies never touched.
        """
        touched = [impact for impact in self.impacts if impact.status is not Status.NO_TOUCH]
        if not touched or self.measured:
            return ""
        causes = "".join(f" {cause.title}" for cause in self.causes[:1])
        return (
            f"every launch of {' on '.join(self.facts.pair)} failed: {touched[0].reason}.{causes}"
        )

    @property
    def measured(self) -> list[Impact]:
        """The impacts that have a restitution."""
        return [i for i in self.impacts if i.is_measured]

    @property
    def failed(self) -> list[Impact]:
        """The impacts that have none."""
        return [i for i in self.impacts if not i.is_measured]

    @property
    def loops(self) -> list[Impact]:
        """Impacts whose loop of force over penetration is worth drawing: of each launch speed the
        first that parted, has a loop, and has STEPS_TO_SHOW steps in contact or more.
        """
        loops: dict[float, Impact] = {}
        for impact in self.impacts:
            if (
                impact.status is Status.PARTED
                and impact.loop is not None
                and impact.samples >= STEPS_TO_SHOW
            ):
                loops.setdefault(impact.launch.speed, impact)
        return list(loops.values())

    @property
    def spread(self) -> float:
        """The largest difference in e between phases of one speed; NaN with nothing to compare."""
        spreads = [point.spread for point in self.curve if math.isfinite(point.highest)]
        return max(spreads, default=math.nan)

    @property
    def energy_gained(self) -> bool:
        """True if a body had more kinetic energy after the impact than before, beyond round-off."""
        return any(i.energy_lost < -2 * GAIN for i in self.measured)

    def errors(self, wanted: RestitutionCurve) -> list[tuple[Impact, float]]:
        """(impact, e - e wanted at its approach speed) of every impact that has an e."""
        return [(i, i.restitution - float(wanted.at(i.speed_in))) for i in self.measured]

    @property
    def effective_mass(self) -> float:
        """Effective mass, kg: the model's; or, where that is unknown, the impulse of the contact
        force of the first impact with a loop, over its change of speed; or NaN.
        """
        if math.isfinite(self.facts.effective_mass):
            return self.facts.effective_mass
        for impact in self.impacts:
            if impact.status is Status.PARTED and impact.loop is not None:
                momentum = float(impact.loop.force.sum()) * self.facts.timestep
                return momentum / (impact.speed_in + impact.speed_out)
        return math.nan

    @property
    def _fitted_alpha(self) -> float:
        """α of the law fitted to the measured e over speed, s/m; NaN where no α describes it.

        So it is where nothing bounces or there is one speed, and where the fitted law is wrong by
        more than TOLERANCE (rms), or by more than half of what one e for all speeds would be.
        """
        speeds = np.array([i.speed_in for i in self.measured])
        e = np.array([i.restitution for i in self.measured])
        if len({i.launch.speed for i in self.measured}) < 2 or e.max() < _LEAST_E:
            return math.nan
        alpha, rms = scoring.fit_alpha(speeds, e)
        # The standard deviation is the rms error of the best e for all speeds.
        of_constant = float(np.std(e))
        allowed = max(min(TOLERANCE, 0.5 * of_constant), GAIN)
        return alpha if rms <= allowed else math.nan

    @property
    def law(self) -> HuntCrossley | None:
        """Law of 1975 to compare loops with: its α is the target's or else the fitted one, and its
        k, N/m^n, makes the fastest impact of many steps as deep as it was measured.

        None without an α: none was given, and no law describes the measured e. k is 1 where no
        impact of many steps shows a penetration, or the mass is unknown.
        """
        alpha = self.wanted.alpha if isinstance(self.wanted, Restitution) else self._fitted_alpha
        if math.isnan(alpha):
            return None
        unit = HuntCrossley(1.0, alpha)
        mass = self.effective_mass
        # Only an impact of many steps shows how deep it was.
        resolved = [
            i for i in self.measured if i.samples >= STEPS_TO_COMPARE and i.penetration_max > 0
        ]
        if not resolved or not math.isfinite(mass):
            return unit
        fastest = max(resolved, key=lambda impact: impact.speed_in)
        unit_depth = float(closed_form.penetration_max(unit, mass, fastest.speed_in))
        # The greatest penetration goes as k to the power -1/(n + 1).
        stiffness = (unit_depth / fastest.penetration_max) ** (unit.exponent + 1)
        return HuntCrossley(stiffness, alpha)

    @property
    def score(self) -> scoring.Score | None:
        """Every figure of `scoring` against `law`; None without a law."""
        law = self.law
        mass = self.effective_mass
        if law is None or not self.measured or not math.isfinite(mass):
            return None
        return scoring.score(self.impacts, law, mass)
