"""What a setting should match, and what a recipe is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from hcbench.errors import SettingError
from hcbench.laws.restitution import MeasuredRestitution, Restitution

if TYPE_CHECKING:
    from hcbench.impact import Floats
    from hcbench.laws.force import HuntCrossley
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.setting import Setting

TargetKind = Literal["law", "linear", "points"]


@dataclass(frozen=True, slots=True)
class Target:
    """The bounce to match.

    law: eq. (16). mass: effective mass of the pair, kg. timestep: the engine's, s.
    speed_min, speed_max: the band of impact speeds, m/s.
    reading: "law" for e of (16), "linear" for e = 1 - α v_i of (2), "points" for `points`.
    points: pairs (v m/s, e), straight between them and constant beyond; one pair is a constant e.
    Raises SettingError for a mass, step or band that is not above 0, and for an e outside 0 ... 1 or that
    rises with v.
    """

    law: HuntCrossley
    mass: float
    timestep: float
    speed_min: float
    speed_max: float
    reading: TargetKind = "law"
    points: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        for slot, value, unit in (
            ("mass", self.mass, "kg"),
            ("timestep", self.timestep, "s"),
            ("lowest speed", self.speed_min, "m/s"),
        ):
            if not 0 < value < np.inf:
                raise SettingError(slot, f"{value!r} {unit}", f"above 0 {unit}")
        if not self.speed_min <= self.speed_max < np.inf:
            raise SettingError(
                "speeds", f"{self.speed_min!r} ... {self.speed_max!r} m/s", "the lower speed first"
            )
        if isinstance(self.curve, MeasuredRestitution):
            _require_falling(self.curve)
        elif self.reading == "linear" and (fastest := self.law.alpha * self.speed_max) > 1:
            raise SettingError(
                "speeds",
                f"1 - α v falls to {1 - fastest:.3g} at {self.speed_max:.4g} m/s",
                "a restitution within 0 ... 1",
                f"Keep below {1 / self.law.alpha:.4g} m/s or take the reading 'law'",
            )

    @property
    def curve(self) -> RestitutionCurve:
        """e wanted over the impact speed."""
        if self.reading == "points":
            return MeasuredRestitution(self.points)
        return Restitution(self.law.alpha, self.reading)

    def restitution(self, speed: Floats | float) -> Floats:
        """e wanted at impact speeds (m/s), same shape."""
        return self.curve.at(speed)


def _require_falling(measured: MeasuredRestitution) -> None:
    """Refuse points with two e at one speed or an e that rises with the speed: SettingError."""
    speeds, values = measured.speeds, measured.values
    rises = np.flatnonzero((np.diff(values) > 0) | (np.diff(speeds) <= 0))
    if rises.size:
        i = int(rises[0])
        first, then = (f"{values[j]:.4g} at {speeds[j]:.4g} m/s" for j in (i, i + 1))
        raise SettingError(
            "restitution", f"e goes from {first} to {then}", "one e a speed, falling or constant as v grows"
        )


class Recipe(Protocol):
    """Makes a setting of one engine from a target.

    engine, name: "mujoco", "impulse". summary: what it does to e and to the loop, in one sentence.
    holds: where it holds and what a user must know, a sentence each.
    """

    @property
    def engine(self) -> str:
        """The engine it is for."""
        ...

    @property
    def name(self) -> str:
        """Its own name, and its settings'."""
        ...

    @property
    def summary(self) -> str:
        """One sentence."""
        ...

    @property
    def holds(self) -> tuple[str, ...]:
        """Sentences."""
        ...

    def __call__(self, target: Target) -> Setting:
        """The setting; raises SettingError where the recipe cannot serve the target."""
        ...
