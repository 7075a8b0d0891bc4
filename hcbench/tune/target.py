"""What a setting should match, and what a recipe is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from hcbench.reference import exact

if TYPE_CHECKING:
    from hcbench.impact import Floats
    from hcbench.reference.laws import HuntCrossley
    from hcbench.setting import Setting

Reading = Literal["law", "linear"]


@dataclass(frozen=True, slots=True)
class Target:
    """The bounce to match.

    law: eq. (16). mass: effective mass of the pair, kg. timestep: the engine's, s.
    speed_min, speed_max: the band of impact speeds, m/s.
    reading: "law" for e of (16), "linear" for e = 1 - α v_i of (2).
    """

    law: HuntCrossley
    mass: float
    timestep: float
    speed_min: float
    speed_max: float
    reading: Reading = "law"

    def restitution(self, speed: Floats | float) -> Floats:
        """e wanted at impact speeds (m/s), same shape."""
        if self.reading == "linear":
            return np.asarray(1.0 - self.law.alpha * np.asarray(speed, dtype=float))
        return exact.restitution(self.law.alpha, speed)


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
