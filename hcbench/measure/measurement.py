"""What measuring a user's own model hands back, and what an engine must offer to be measured.

A `Subject` is a loaded model with a pair in it. It flies launches, says what the model asks for, and names
what could be wrong with it. Everything else (curves, diagnosis, reports, gates) is made of that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.errors import QuantityError
from hcbench.impact import Launch, Status
from hcbench.laws.restitution import ConstantRestitution, MeasuredRestitution, Restitution

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from hcbench.impact import Impact
    from hcbench.laws.restitution import Reading, RestitutionCurve

DEFAULT_SPEEDS = (0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0)
DEFAULT_PHASES = 4
TOLERANCE = 0.02
GAIN = 1e-6  # e above 1 by more than this is energy made from nothing, not round-off

NOTABLE_GAIN = 1e-3  # from which the causes of it are looked for

Vector = tuple[float, float, float]


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
class Request:
    """What to measure.

    pair: names of the two, moving one first; None where the model leaves no choice.
    speeds: launch speeds, m/s. phases: where in a step the touch falls, each 0 ... 1.
    timestep: s; None: the model's own. gravity: m/s^2; None: the model's own.
    key: name or number of the keyframe that everything starts from, "qpos0" for the model's zero;
        None: the first keyframe, or qpos0 where there is none.
    height: clearance at release, m; None: two to three steps of flight.
    thrifty: fly one phase only at speeds where the contact has so many steps that phase cannot matter.
    """

    pair: tuple[str, str] | None = None
    speeds: tuple[float, ...] = DEFAULT_SPEEDS
    phases: tuple[float, ...] = tuple((i + 0.5) / DEFAULT_PHASES for i in range(DEFAULT_PHASES))
    timestep: float | None = None
    gravity: Vector | None = None
    key: str | None = None
    height: float | None = None
    thrifty: bool = False

    def launches(self) -> list[Launch]:
        """One for each speed and phase, speeds in order."""
        return [Launch(v, p, self.height) for v in self.speeds for p in self.phases]


@dataclass(frozen=True, slots=True)
class Suspect:
    """Something in a model that may keep it from bouncing as asked.

    code: short and stable. title: the sentence that names it. evidence: numbers found. fix: text to paste.
    apply: makes the fix in a copy of the subject's own state; None where it cannot be tried.
    always_reported: even where the measured e is as asked, as it speaks of what the model asks for.
    assumed_e: e that the fix is written for, where nobody said which e is wanted; e is then compared with it.
    apply_last: its fix depends on the step and integrator, so it is made after those that change them.
    """

    code: str
    title: str
    evidence: str
    fix: str
    apply: Callable[[Any], None] | None = None
    always_reported: bool = False
    assumed_e: float | None = None
    apply_last: bool = False


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
class Facts:
    """What a model says of itself and of its pair, SI.

    pair: as the model names the two, the moving one first. moved: what carries it, in words.
    effective_mass: 1 / (J M^-1 J^T) along the contact normal, kg. normal: unit vector, from the moving
    one towards the other. settings: the engine's own words for what decides the bounce.
    asked: e that the model asks for at each speed of the request; () where it cannot be said.
    asked_words: where that comes from. notes: sentences a reader must know.
    """

    engine: str
    version: str
    model: str
    pair: tuple[str, str]
    moved: str
    timestep: float
    gravity: Vector
    effective_mass: float
    normal: Vector
    settings: Mapping[str, Any] = field(default_factory=dict)
    asked: tuple[float, ...] = ()
    asked_words: str = ""
    notes: tuple[str, ...] = ()


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
