"""What measuring a user's own model hands back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.errors import QuantityError
from hcbench.impact import Status
from hcbench.laws.restitution import ConstantRestitution, MeasuredRestitution, Restitution
from hcbench.sim.model_under_test import Facts, Request

if TYPE_CHECKING:
    from hcbench.impact import Impact
    from hcbench.laws.restitution import Reading, RestitutionCurve

TOLERANCE = 0.02
GAIN = 1e-6  # e above 1 by more than this is energy made from nothing, not round-off

NOTABLE_GAIN = 1e-3  # from which the causes of it are looked for


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

    alone: largest |e - goal| at the launches that were tried, with this one fixed and nothing else. without:
    the same with the other causes fixed and not this one. NaN where that was not tried.
    """

    code: str
    title: str
    evidence: str
    fix: str
    alone: float = math.nan
    without: float = math.nan


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """All phases of one launch speed; NaN where nothing parted or rested.

    speed: launched, m/s. speed_in: mean approach speed at touch, m/s, which gravity makes differ.
    """

    speed: float
    speed_in: float
    restitution: float
    lowest: float
    highest: float
    samples: int
    failed: int


@dataclass(frozen=True, slots=True)
class Measurement:
    """One pair of one model, measured."""

    facts: Facts
    request: Request
    impacts: tuple[Impact, ...]
    wanted: RestitutionCurve | None = None
    causes: tuple[Cause, ...] = ()
    remedy: str = ""  # what is left when all that was found is fixed

    @property
    def curve(self) -> list[CurvePoint]:
        """e over speed, a point a launch speed, in the order asked for."""
        return [_point(v, [i for i in self.impacts if i.launch.speed == v]) for v in self.request.speeds]

    @property
    def measured(self) -> list[Impact]:
        """The impacts that have a restitution."""
        return [i for i in self.impacts if i.status in (Status.PARTED, Status.RESTED)]

    @property
    def failed(self) -> list[Impact]:
        """The impacts that have none."""
        return [i for i in self.impacts if i.status not in (Status.PARTED, Status.RESTED)]

    @property
    def spread(self) -> float:
        """The largest difference in e between phases of one speed; NaN with nothing to compare."""
        return max(
            (p.highest - p.lowest for p in self.curve if math.isfinite(p.highest)),
            default=math.nan,
        )

    @property
    def energy_gained(self) -> bool:
        """Whether any impact left faster than it came, beyond round-off."""
        return any(i.restitution > 1 + GAIN for i in self.measured)

    def errors(self, wanted: RestitutionCurve) -> list[tuple[Impact, float]]:
        """(impact, e - e wanted at its approach speed) of every impact that has an e."""
        return [(i, i.restitution - float(wanted.at(i.speed_in))) for i in self.measured]


def _point(speed: float, impacts: list[Impact]) -> CurvePoint:
    good = [i for i in impacts if i.status in (Status.PARTED, Status.RESTED)]
    e = [i.restitution for i in good] or [math.nan]
    return CurvePoint(
        speed=speed,
        speed_in=float(np.mean([i.speed_in for i in good])) if good else math.nan,
        restitution=float(np.mean(e)),
        lowest=min(e),
        highest=max(e),
        samples=min((i.samples for i in good), default=0),
        failed=len(impacts) - len(good),
    )
