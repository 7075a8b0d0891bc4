"""Targets: the bounce that a setting should match."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from hcbench import scoring
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import MeasuredRestitution, Restitution, RestitutionCurve
from hcbench.system.errors import SettingError
from hcbench.terms.arguments import checked_fields
from hcbench.terms.impact import Floats
from hcbench.terms.units import INCH

# Speeds that Hunt and Crossley's law was fitted over, m/s.
PAPER = (1.0 * INCH, 20.0 * INCH)
# In g h: slower impacts end within the step that finds them, and the body stays down.
SLOWEST = 1.6


def default_band(timestep: float, gravity: float) -> tuple[float, float]:
    """Default band of speeds, m/s: the paper's 1 to 20 in/s, cut below the slowest speed at which a
    body can bounce at a step (s) under gravity (m/s²).
    """
    low = max(PAPER[0], _above(SLOWEST * gravity * timestep))
    return low, max(PAPER[1], 4.0 * low)


def _above(speed: float) -> float:
    """The next speed above, in three digits; 0 for 0."""
    if not speed > 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(speed)) - 2)
    return float(f"{unit * (math.floor(speed / unit + 1e-9) + 1):.3g}")


def why_cut(low: float, timestep: float, gravity: float) -> str:
    """Explain why a band begins at `low` m/s; "" if that is the user's or the paper's own speed."""
    if low <= PAPER[0] or low != default_band(timestep, gravity)[0]:
        return ""
    step = f"{1e3 * timestep:.3g} ms"
    return f"The band begins above 1 in/s: below {low:.2g} m/s a {step} step cannot bounce."


TargetKind = Literal["law", "linear", "points", "constant"]
# The law is worth a try if its misfit is below this share of the error of one e for all speeds.
_GOOD_FIT = 0.25
_WORDS = {"law": "α of the law, by --alpha", "linear": "1 - α v, by --alpha and --target linear"}
_WORDS |= {"constant": "one e, by --restitution"}


@checked_fields
@dataclass(frozen=True)
class Target:
    """The bounce to match.

    law: eq. (16).
    mass: effective mass of the pair, kg.
    timestep: the engine's, s.
    speed_min, speed_max: the band of impact speeds, m/s.
    reading: "law" for e of (16), "linear" for e = 1 - α v_i of (2), "points" for `points`.
    points: pairs (v m/s, e), straight between them and constant beyond; one pair is a constant e.
    gravity: into the plate, m/s².
    friction: coefficient of Coulomb friction.
    friction_asked: whether the user asked for it; else it is the engine's own default.
    corners: points of the body that meet the plate at once, as the 4 of a flat box.
    corners_asked: whether the user asked for them; else any body may meet the plate.
    material: the measurement that the target is taken from, in a line; "" for numbers of a user.

    Raises SettingError for a mass, step or band that is not above 0, and for an e outside 0 ... 1
    or that rises with v.
    """

    law: HuntCrossley
    mass: float
    timestep: float
    speed_min: float
    speed_max: float
    reading: Literal["law", "linear", "points"] = "law"
    points: tuple[tuple[float, float], ...] = ()
    gravity: float = 0.0
    friction: float = 0.0
    corners: int = 1
    friction_asked: bool = True
    corners_asked: bool = True
    material: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        """Raise SettingError for numbers without meaning, and for points whose e rises with speed."""
        for slot, value, unit in (
            ("mass", self.mass, "kg"),
            ("timestep", self.timestep, "s"),
            ("lowest speed", self.speed_min, "m/s"),
        ):
            if not 0 < value < np.inf:
                raise SettingError(slot, f"{value!r} {unit}", f"above 0 {unit}")
        for slot, value, least in (("gravity", self.gravity, 0), ("friction", self.friction, 0)):
            if not least <= value < np.inf:
                raise SettingError(slot, f"{value!r}", f"{least} or more")
        if self.corners < 1:
            raise SettingError("corners", f"{self.corners!r}", "1 or more")
        if not self.speed_min <= self.speed_max < np.inf:
            got = f"{self.speed_min!r} ... {self.speed_max!r} m/s"
            raise SettingError("speeds", got, "the lower speed first")
        if isinstance(self.curve, MeasuredRestitution):
            _require_falling(self.curve)
        elif self.reading == "linear" and (loss := self.law.alpha * self.speed_max) > 1:
            raise SettingError(
                "speeds",
                f"1 - α v falls to {1 - loss:.3g} at {self.speed_max:.4g} m/s",
                "a restitution within 0 ... 1",
                f"Keep below {1 / self.law.alpha:.4g} m/s or take the reading 'law'",
            )

    @property
    def is_constant(self) -> bool:
        """True if the target is one e for all speeds of its band."""
        if self.speed_min == self.speed_max:
            return True
        if self.points:
            return len({e for _, e in self.points}) == 1
        return self.law.alpha == 0

    @property
    def kind(self) -> TargetKind:
        """The kind of the target: its reading, or "constant" for points that are one e."""
        if self.reading == "points" and self.is_constant:
            return "constant"
        return self.reading

    @property
    def curve(self) -> RestitutionCurve:
        """e wanted over the impact speed."""
        if self.reading == "points":
            return MeasuredRestitution(self.points)
        return Restitution(self.law.alpha, self.reading)

    def restitution(self, speed: Floats | float) -> Floats:
        """e wanted at impact speeds (m/s), same shape."""
        return self.curve.at(speed)

    def described(self) -> tuple[str, str]:
        """Return the option by which the user gave the target, and its value in words."""
        if self.reading == "points":
            if len(self.points) > 1:
                return "points", f"{len(self.points)} pairs of v and e"
            return "restitution", "one e for all speeds"
        return "target", _WORDS[self.reading].partition(",")[0]

    def fitting_law(self) -> str:
        """Advice to take the law that the points lie near, as a sentence; "" for one e, or near no
        law.
        """
        if len(self.points) < 2:
            return ""
        measured = MeasuredRestitution(self.points)
        speeds = measured.speeds
        e = measured.values
        alpha, rms = scoring.fit_alpha(speeds, e)
        if rms > _GOOD_FIT * float(np.ptp(e)) / 2:
            return ""
        return f"α = {alpha:.4g} s/m fits these pairs with rms {rms:.1g}: try --alpha {alpha:.4g}"


def _require_falling(measured: MeasuredRestitution) -> None:
    """Raise SettingError, with the first two, for points whose speeds do not rise, or whose e does."""
    speeds = measured.speeds
    values = measured.values
    rises = np.flatnonzero((np.diff(values) > 0) | (np.diff(speeds) <= 0))
    if rises.size:
        i = int(rises[0])
        before = f"{values[i]:.4g} at {speeds[i]:.4g} m/s"
        after = f"{values[i + 1]:.4g} at {speeds[i + 1]:.4g} m/s"
        got = f"e goes from {before} to {after}"
        raise SettingError("restitution", got, "one e per speed, not rising with speed")


def require_kind(target: Target, recipe: str, kinds: Sequence[TargetKind], instead: str) -> None:
    """Raise SettingError for a target of a kind that a recipe does not serve.

    recipe: its name. kinds: those that it serves. instead: recipes for the others, as words; or "".
    """
    if target.kind in kinds or target.reading in kinds:
        return
    slot, given = target.described()
    expected = " or ".join(_WORDS[kind] for kind in kinds)
    advice = []
    if instead:
        advice.append(f"Use {instead} for another restitution")
    fit = target.fitting_law()
    if fit:
        advice.append(fit)
    raise SettingError(
        slot, f"{given}, which {recipe!r} does not serve", expected, ". ".join(advice)
    )
