"""Hertz contact of two spheres, a sphere in a cup or on a plane: eqs. (5)
and (6) of Hunt & Crossley 1975.

R1, R2 the radii (negative when hollow, inf when flat), R = 1/(1/R1 + 1/R2) the relative radius, E*
= 1/((1 - ν1²)/E1 + (1 - ν2²)/E2) the contact modulus. The paper writes both for one material, where
E* = E/(2 (1 - ν²)); K. L. Johnson, "Contact Mechanics", Cambridge University Press, 1985, doi
10.1017/CBO9781139171731, section 4.2, has the general case. SI units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hcbench.terms.bounds import positive, require

if TYPE_CHECKING:
    from hcbench.terms.scene import Material

# Largest shear stress over the largest pressure p0, on the axis below the
# surface, ν = 0.3 (section 1.10).
SHEAR_OVER_PRESSURE = 0.31
# Largest shear stress, Pa: 62 000 lb/in², 0.31 times the 200 000 of the paper's section 1.10.
SHEAR_LIMIT = 62_000 * 6894.757293168361


@dataclass(frozen=True, slots=True)
class HertzContact:
    """Two bodies that touch at a point, round about it.

    relative_radius: R, m.
    contact_modulus: E*, Pa. Forces given to the methods are N, >= 0.

    Raises UserError unless both are above 0.
    """

    relative_radius: float
    contact_modulus: float

    def __post_init__(self) -> None:
        positive("relative_radius", self.relative_radius, "m")
        positive("contact_modulus", self.contact_modulus, "Pa")

    @property
    def K1(self) -> float:
        """K1 = (4/3) E* of eq. (5), Pa: F = K1 x^(3/2) (1/R1 + 1/R2)^(-1/2)."""
        return 4.0 / 3.0 * self.contact_modulus

    @property
    def K2(self) -> float:
        """K2 = 0.31 (6 E*²/π³)^(1/3) of eq. (6), Pa^(2/3): τ = K2 ((1/R1 + 1/R2)² F)^(1/3)."""
        return SHEAR_OVER_PRESSURE * float(
            (6.0 * self.contact_modulus**2 / math.pi**3) ** (1.0 / 3.0)
        )

    @property
    def stiffness(self) -> float:
        """K3 = k of F = k x^(3/2), N/m^1.5, eq. (5)."""
        return self.K1 * math.sqrt(self.relative_radius)

    def approach(self, force: float) -> float:
        """x of F = k x^(3/2), m."""
        return float((force / self.stiffness) ** (2.0 / 3.0))

    def pressure_max(self, force: float) -> float:
        """p0 = 3 F/(2π a²) = (6 F E*²/(π³ R²))^(1/3), at the middle of the circle, Pa."""
        modulus = self.contact_modulus
        radius = self.relative_radius
        return float((6.0 * force * modulus**2 / (math.pi**3 * radius**2)) ** (1.0 / 3.0))

    def shear_max(self, force: float) -> float:
        """τ = 0.31 p0, eq. (6), Pa: the largest shear stress, about 0.48 a below the surface."""
        return SHEAR_OVER_PRESSURE * self.pressure_max(force)

    def force_at_shear(self, stress: float = SHEAR_LIMIT) -> float:
        """The force at which τ reaches `stress` (Pa), N."""
        positive("stress", stress, "Pa")
        return float((stress / self.shear_max(1.0)) ** 3)


def contact_modulus(one: Material, two: Material) -> float:
    """E* in Pa. Raises UserError for E <= 0 and for ν outside (-1, 0.5)."""
    return 1.0 / (compliance(one) + compliance(two))


def compliance(material: Material) -> float:
    """(1 - ν²)/E in 1/Pa. Raises UserError for E <= 0 and for ν outside (-1, 0.5)."""
    modulus = material.young_modulus
    poisson = material.poisson_ratio
    positive("young_modulus", modulus, "Pa")
    require("poisson_ratio", poisson, -1.0 < poisson < 0.5, "a Poisson's ratio between -1 and 0.5")
    return (1.0 - poisson**2) / modulus


def relative_radius(radius_1: float, radius_2: float) -> float:
    """R = 1/(1/R1 + 1/R2) in m.

    radius_1, radius_2: m: negative when hollow, inf when flat.
    Raises UserError for a radius of 0 or NaN, and for surfaces that do not touch at a point, 1/R <=
    0.
    """
    for slot, radius in (("radius 1", radius_1), ("radius 2", radius_2)):
        require(
            slot,
            radius,
            not math.isnan(radius) and radius != 0.0,
            "m, not 0; negative: hollow, inf: flat",
        )
    curvature = 1.0 / radius_1 + 1.0 / radius_2
    require(
        "1/R1 + 1/R2",
        curvature,
        curvature > 0.0,
        f"above 0 1/m: radii {radius_1!r} m and {radius_2!r} m do not touch at a point",
        "Give the hollow (the negative radius) a larger radius than what sits in it",
    )
    return 1.0 / curvature


def spheres(
    radius_1: float, radius_2: float, material_1: Material, material_2: Material
) -> HertzContact:
    """The contact of two bodies from their radii (m; negative: hollow, inf: flat) and materials."""
    return HertzContact(
        relative_radius(radius_1, radius_2), contact_modulus(material_1, material_2)
    )


def from_stiffness(stiffness: float, radius: float) -> HertzContact:
    """The contact whose k of F = k x^(3/2) (N/m^1.5) is known, at relative radius `radius` (m)."""
    positive("stiffness", stiffness, "N/m^1.5")
    positive("relative_radius", radius, "m")
    return HertzContact(radius, 0.75 * stiffness / math.sqrt(radius))
