"""A scene: what is dropped on what. Reads the folders under scenes/."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class Material:
    """Elastic constants of a body: young_modulus Pa, poisson_ratio 1."""

    young_modulus: float
    poisson_ratio: float


@dataclass(frozen=True, slots=True)
class Scene:
    """The truth about a drop, SI, and the engine files that say the same.

    form: "cup", the true concave plate; "plane", the equivalent sphere 1/(1/R1 + 1/R2) on a plane.
    ball_radius: R1, m. plate_radius: R2, m, negative when concave, inf when flat.
    stiffness: k, N/m^exponent. gravity: m/s^2 towards the plate, 0 for launches in free flight.
    models: engine name -> role -> file, as the engine loads it.
    """

    name: str
    title: str
    form: Literal["cup", "plane"]
    mass: float
    ball_radius: float
    plate_radius: float
    ball_material: Material
    plate_material: Material
    stiffness: float
    exponent: float = 1.5
    gravity: float = 0.0
    models: Mapping[str, Mapping[str, Path]] = field(default_factory=dict)

    @property
    def relative_radius(self) -> float:
        """R = 1/(1/R1 + 1/R2), m: the sphere that meets a plane as this pair meets."""
        return 1.0 / (
            1.0 / self.ball_radius + (0.0 if math.isinf(self.plate_radius) else 1.0 / self.plate_radius)
        )
