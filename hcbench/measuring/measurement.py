"""The result of measuring a pair of a user's own model, and what it is compared with."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hcbench import scoring
from hcbench._arguments import checked
from hcbench._notebook import Shown
from hcbench.errors import QuantityError
from hcbench.impact import Floats, Impact, Launch, Status
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import (
    ConstantRestitution,
    MeasuredRestitution,
    Reading,
    Restitution,
    RestitutionCurve,
)
from hcbench.resolution import STEPS_TO_COMPARE, STEPS_TO_SHOW
from hcbench.sim.model_under_test import Facts, Request
from hcbench.sim.tangential import AlongPlate, along_plate

TOLERANCE = 0.02  # of e
GAIN = 1e-6  # e above 1 by more than this is energy made from nothing, not round-off
NOTABLE_GAIN = 1e-3  # e above 1 by more than this: the causes are looked for
_LEAST_E = 0.1  # below it no law of a bounce is fitted


@checked
def Wanted(
    alpha: float | None = None,
    constant: float | None = None,
    points: tuple[tuple[float, float], ...] = (),
    reading: Reading = "law",
) -> RestitutionCurve:
    """The restitution that is wanted: exactly one of alpha, constant and points is given.

    alpha: s/m, of eq. (16) (`reading` "law") or of e = 1 - α v (`reading` "linear").
    constant: one e for all speeds. points: pairs (v m/s, e), straight between, constant beyond.
    """
    given = (alpha is not None) + (constant is not None) + bool(points)
    if given != 1:
        raise QuantityError("wanted restitution", f"{given} given", "one of alpha, constant, points")
    if alpha is not None:
        return Restitution(alpha, reading)
    return ConstantRestitution(constant) if constant is not None else MeasuredRestitution(points)


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


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """All phases of one launch speed and angle; NaN where nothing parted or rested.

    speed: at launch, m/s. speed_in: mean at touch, m/s; gravity makes the two differ. restitution: mean of e
    over the step. lowest, highest: e. samples: fewest steps in contact. failed: impacts without an e.
    angle: from the normal, rad. along: what it does along the plate, means. restitution_after_force: mean of
    the ratio once the contact force has ceased; e differs where joints or servos act until the bodies part.
    """

    speed: float
    speed_in: float
    restitution: float
    lowest: float
    highest: float
    samples: int
    failed: int
    angle: float
    along: AlongPlate
    restitution_after_force: float = math.nan


@dataclass(frozen=True, slots=True)
class Measurement(Shown):
    """One pair of one model, measured.

    remedy: what is left with all causes fixed, as a sentence.
    """

    facts: Facts
    request: Request
    impacts: tuple[Impact, ...]
    wanted: RestitutionCurve | None = None
    causes: tuple[Cause, ...] = ()
    remedy: str = ""

    @property
    def curve(self) -> list[CurvePoint]:
        """e over speed, one point for each launch speed and angle, in the order of the request."""
        groups: dict[Launch, list[Impact]] = {}
        for impact in self.impacts:
            groups.setdefault(impact.launch.at_any_phase, []).append(impact)
        return [_point(launch, impacts) for launch, impacts in groups.items()]

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
        """One impact a speed, of those whose contact took steps enough to show force over penetration."""
        loops: dict[float, Impact] = {}
        for impact in self.impacts:
            if impact.status is Status.PARTED and impact.loop is not None and impact.samples >= STEPS_TO_SHOW:
                loops.setdefault(impact.launch.speed, impact)
        return list(loops.values())

    @property
    def spread(self) -> float:
        """The largest difference in e between phases of one speed; NaN with nothing to compare."""
        spreads = [point.highest - point.lowest for point in self.curve if math.isfinite(point.highest)]
        return max(spreads, default=math.nan)

    @property
    def energy_gained(self) -> bool:
        """Whether any body had more kinetic energy after the impact than before, beyond round-off."""
        return any(i.energy_lost < -2 * GAIN for i in self.measured)

    def errors(self, wanted: RestitutionCurve) -> list[tuple[Impact, float]]:
        """(impact, e - e wanted at its approach speed) of every impact that has an e."""
        return [(i, i.restitution - float(wanted.at(i.speed_in))) for i in self.measured]

    @property
    def effective_mass(self) -> float:
        """Of the model, or else by the change of momentum in the first impact with a loop, kg."""
        if math.isfinite(self.facts.effective_mass):
            return self.facts.effective_mass
        for impact in self.impacts:
            if impact.status is Status.PARTED and impact.loop is not None:
                momentum = float(impact.loop.force.sum()) * self.facts.timestep
                return momentum / (impact.speed_in + impact.speed_out)
        return math.nan

    @property
    def _fitted_alpha(self) -> float:
        """α of the law that describes e over speed, s/m; NaN where none does: where nothing bounces, or it is
        wrong by more than TOLERANCE (rms), or by more than half of what one e for all speeds would be.
        """
        speeds = np.array([i.speed_in for i in self.measured])
        e = np.array([i.restitution for i in self.measured])
        if len({i.launch.speed for i in self.measured}) < 2 or e.max() < _LEAST_E:
            return math.nan
        alpha, rms = scoring.fit_alpha(speeds, e)
        return alpha if rms <= max(min(TOLERANCE, 0.5 * float(np.std(e))), GAIN) else math.nan

    @property
    def law(self) -> HuntCrossley | None:
        """The law to compare: the target's α, or the fitted; k so that the hardest impact goes as deep.

        None where no α was given and no law describes what was measured.
        """
        alpha = self.wanted.alpha if isinstance(self.wanted, Restitution) else self._fitted_alpha
        if math.isnan(alpha):
            return None
        unit, mass = HuntCrossley(1.0, alpha), self.effective_mass
        resolved = [i for i in self.measured if i.samples >= STEPS_TO_COMPARE and i.penetration_max > 0]
        if not resolved or not math.isfinite(mass):
            return unit
        hardest = max(resolved, key=lambda i: i.speed_in)
        depth = float(closed_form.penetration_max(unit, mass, hardest.speed_in))
        return HuntCrossley((depth / hardest.penetration_max) ** (unit.exponent + 1), alpha)

    @property
    def score(self) -> scoring.Score | None:
        """Every figure of `scoring` against `law`; None without a law."""
        law, mass = self.law, self.effective_mass
        if law is None or not self.measured or not math.isfinite(mass):
            return None
        return scoring.score(self.impacts, law, mass)


def _point(launch: Launch, impacts: list[Impact]) -> CurvePoint:
    good = [i for i in impacts if i.is_measured]
    e = [i.restitution for i in good] or [math.nan]
    weights = _phase_weights([i.launch.phase for i in good] or [0.5])
    after_force = [i.restitution_after_force for i in good] or [math.nan]
    return CurvePoint(
        speed=launch.speed,
        speed_in=float(np.mean([i.speed_in for i in good])) if good else math.nan,
        restitution=float(np.average(e, weights=weights)),
        lowest=min(e),
        highest=max(e),
        samples=min((i.samples for i in good), default=0),
        failed=len(impacts) - len(good),
        angle=launch.angle,
        along=AlongPlate(*np.mean([along_plate(i) for i in good or impacts[:1]], axis=0).tolist()),
        restitution_after_force=float(np.average(after_force, weights=weights)),
    )


def _phase_weights(phases: Sequence[float]) -> Floats:
    """The share of a step that each phase stands for: half of the gaps on both sides; they add up to 1."""
    order = np.argsort(phases)
    ordered = np.asarray(phases)[order]
    gaps = np.diff(np.append(ordered, ordered[0] + 1.0))
    weights = np.empty(len(ordered))
    weights[order] = (gaps + np.roll(gaps, 1)) / 2
    return weights
