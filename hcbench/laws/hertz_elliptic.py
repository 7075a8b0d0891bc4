"""Hertz contact of two bodies with any principal radii: the ellipse, the
approach, the pressure, the stress.

The paper (section 1.9) has spheres and says that its results "can with complete validity be
extended" to other contours; eqs. (5) and (6) are the special case of a circle. Formulas as in K. L.
Johnson, "Contact Mechanics", Cambridge University Press, 1985, doi 10.1017/CBO9781139171731,
sections 3.5 and 4.2 (after H. Hertz, "Über die Berührung fester elastischer Körper", J. reine
angew. Math. 92, 1882, 156-171). The complete elliptic integrals enter as Carlson's R_D, which
cancels nothing where the ellipse becomes a circle.

Symbols: A <= B, half the relative curvatures along the ellipse's long and short axis (gap A x² + B
y²), semi-axes a >= b, κ = b/a, e² = 1 - κ², E* the contact modulus.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import ellipe, ellipk, elliprd, elliprf

from hcbench.laws import hertz
from hcbench.terms.bounds import require

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Material

# Hertz's theory needs a << R (Johnson, section 4.2). At a/R = 0.1 the arc and the parabola that
# stands for it differ by (a/R)²/4 = 0.25 % of the gap.
CONTACT_OVER_RADIUS_MAX = 0.1


@dataclass(frozen=True, slots=True)
class Surface:
    """A body's shape and matter at the point of contact.

    first, second: principal radii, m; negative when hollow, inf when straight. first is the one in
    the plane that `angle` of `contact` turns.
    """

    first: float
    second: float
    material: Material

    def __post_init__(self) -> None:
        """Raise UserError for a radius of 0 or NaN and for a material that cannot exist."""
        for slot, radius in (("first", self.first), ("second", self.second)):
            require(
                slot,
                radius,
                not math.isnan(radius) and radius != 0.0,
                "a radius other than 0 m; inf: straight",
            )
        # Raises for a material that cannot exist, before any contact uses it.
        hertz.compliance(self.material)


def sphere(radius: float, material: Material) -> Surface:
    """A sphere, or with a negative radius (m) a spherical cup."""
    return Surface(radius, radius, material)


@dataclass(frozen=True, slots=True)
class EllipticContact:
    """Two surfaces pressed together; forces in N, lengths in m, pressures in Pa.

    long_curvature, short_curvature: A <= B, 1/m.
    axis_ratio: κ = b/a.
    contact_modulus: E*, Pa.
    poisson_ratios: of both bodies.
    radius_min: the smallest principal radius, m.
    """

    long_curvature: float
    short_curvature: float
    axis_ratio: float
    contact_modulus: float
    poisson_ratios: tuple[float, float]
    radius_min: float

    @property
    def stiffness(self) -> float:
        """k of F = k x^(3/2), N/m^1.5: (2π E*/(3κ)) √(E(e) / (K(e)³ (A + B))), K and E the complete
        elliptic integrals, e² = 1 - κ²; (4/3) E* √R for a circle.
        """
        m = 1.0 - self.axis_ratio**2
        big_k = float(ellipk(m))
        big_e = float(ellipe(m))
        curvature = self.long_curvature + self.short_curvature
        return (2.0 * math.pi * self.contact_modulus / (3.0 * self.axis_ratio)) * math.sqrt(
            big_e / (big_k**3 * curvature)
        )

    def approach(self, force: float) -> float:
        """x of F = k x^(3/2), m, under a force in N, 0 or more."""
        return float((force / self.stiffness) ** (2.0 / 3.0))

    def semi_axes(self, force: float) -> tuple[float, float]:
        """a >= b of the ellipse of contact, m, under a force in N."""
        big_e = float(ellipe(1.0 - self.axis_ratio**2))
        curvature = self.long_curvature + self.short_curvature
        b = (
            3.0
            * force
            * self.axis_ratio
            * big_e
            / (2.0 * math.pi * self.contact_modulus * curvature)
        ) ** (1.0 / 3.0)
        return b / self.axis_ratio, b

    def pressure_max(self, force: float) -> float:
        """p0 = 3 F / (2π a b), at the middle."""
        a, b = self.semi_axes(force)
        return 1.5 * force / (math.pi * a * b)

    def shear_max(self, force: float) -> tuple[float, float]:
        """(largest shear stress below the surface, Pa, its depth, m) under a force in N; of the body
        in which it is larger.
        """
        _, b = self.semi_axes(force)
        share, depth = max(largest_shear(self.axis_ratio, nu) for nu in self.poisson_ratios)
        return share * self.pressure_max(force), depth * b

    def depth_max(self) -> float:
        """Largest approach within Hertz's theory, m: a is there a tenth of the smallest radius."""
        a, _ = self.semi_axes(1.0)
        return self.approach((CONTACT_OVER_RADIUS_MAX * self.radius_min / a) ** 3)


def contact(one: Surface, two: Surface, angle: float = 0.0) -> EllipticContact:
    """The contact of two surfaces whose first principal planes enclose `angle` (rad).

    Raises UserError for surfaces that would touch along a line or beyond it (A <= 0): the approach
    of a line contact is not a matter of the two surfaces alone, and section 1.11 takes an exponent
    between 1 and 3/2. Also for an angle that is not finite and for a material that cannot exist.
    """
    require("angle", angle, math.isfinite(angle), "a finite angle in rad")
    radii = (one.first, one.second, two.first, two.second)
    # Principal curvatures of the one and of the other, 1/m.
    c1, c2, d1, d2 = (1.0 / r for r in radii)
    # A + B and B - A of the gap A x² + B y² (Johnson, Contact Mechanics, section 4.1).
    total = 0.5 * (c1 + c2 + d1 + d2)
    p = c1 - c2
    q = d1 - d2
    difference = 0.5 * math.sqrt(max(0.0, p * p + q * q + 2.0 * p * q * math.cos(2.0 * angle)))
    long = 0.5 * (total - difference)
    short = 0.5 * (total + difference)
    scale = max(abs(c) for c in (c1, c2, d1, d2))
    require(
        "radii",
        radii,
        long > 1e-12 * scale > 0.0,
        "surfaces that touch at a point: relative curvature above 0 in every direction",
        "Widen the hollow; for a line of contact take F = k x^n with n in 1 ... 1.5 (section 1.11)",
    )
    return EllipticContact(
        long_curvature=long,
        short_curvature=short,
        axis_ratio=axis_ratio(long / short),
        contact_modulus=hertz.contact_modulus(one.material, two.material),
        poisson_ratios=(one.material.poisson_ratio, two.material.poisson_ratio),
        radius_min=min(abs(r) for r in radii if math.isfinite(r)),
    )


def axis_ratio(curvature_ratio: float) -> float:
    """κ = b/a of the ellipse of contact, from the ratio of its curvatures.

    curvature_ratio: A/B, above 0, up to 1 for a circle.
    Raises UserError outside it.
    Hertz's B/A = (E/κ² - K) / (K - E) is R_D(0, 1, κ²) / R_D(0, κ², 1), which is 1/1 for the circle
    and not 0/0.
    """
    require(
        "curvature_ratio", curvature_ratio, 0.0 < curvature_ratio <= 1.0, "A/B above 0 and up to 1"
    )
    target = -math.log(curvature_ratio)
    if target < 1e-8:
        # The next term of the series goes with the square.
        return math.exp(-2.0 / 3.0 * target)

    def miss(log_kappa: float) -> float:
        k2 = math.exp(2.0 * log_kappa)
        return math.log(float(elliprd(0.0, 1.0, k2)) / float(elliprd(0.0, k2, 1.0))) - target

    # κ lies between A/B and 1: A/B goes with κ^(3/2) near the circle and with
    # κ², up to a logarithm, far off.
    return math.exp(brentq(miss, -target, 0.0, xtol=1e-16, rtol=1e-15))


def axis_stresses(
    kappa: float, poisson_ratio: float, depth: Floats | float
) -> tuple[Floats, Floats, Floats]:
    """σ_x, σ_y, σ_z over p0 on the axis below the middle; shape of `depth` each, tension > 0.

    kappa: b/a of the ellipse, up to 1.
    poisson_ratio: ν.
    depth: over b, 0 at the surface. x along the long axis.
    A. Sackfield, D. A. Hills, "Some useful results in the classical Hertz contact problem", J.
    Strain Analysis 18, 1983, 101-105, doi 10.1243/03093247V182101, after H. R. Thomas and V. A.
    Hoersch, 1930. Here with e² divided out by hand, so that the circle needs no branch.
    """
    # Depth over the long half axis: ζ = z/a.
    zeta = np.asarray(depth, dtype=float) * kappa
    m = 1.0 - kappa * kappa
    wide = 1.0 + zeta * zeta
    t = np.sqrt((kappa * kappa + zeta * zeta) / wide)
    sin2 = 1.0 / wide
    cos2 = zeta * zeta / wide
    delta2 = 1.0 - m * sin2
    # S = ∫ sin²/Δ, C = ∫ cos²/Δ from 0 to φ with cot φ = z/a.
    s_term = sin2**1.5 / 3.0 * elliprd(cos2, delta2, 1.0)
    c_term = np.sqrt(sin2) * elliprf(cos2, delta2, 1.0) - s_term
    # σ_x is x_own + ν x_cross, over 2 κ; σ_y likewise.
    bend = 1.0 / (wide * (1.0 + t))
    x_own = -0.5 * bend + zeta * s_term
    x_cross = (bend - 1.0 + zeta * c_term) / kappa**2
    y_own = (((1.0 + 2.0 * t) * bend - (1.0 + t)) / (2.0 * t) + zeta * c_term) / kappa**2
    y_cross = -bend + zeta * s_term
    sigma_x = 2.0 * kappa * (x_own + poisson_ratio * x_cross)
    sigma_y = 2.0 * kappa * (y_own + poisson_ratio * y_cross)
    return sigma_x, sigma_y, -kappa / (wide * t)


def largest_shear(kappa: float, poisson_ratio: float) -> tuple[float, float]:
    """Largest shear stress on the axis over p0, and its depth over b.

    kappa: b/a of the ellipse; a circle, 1, with ν = 0.3 gives 0.310 and 0.48.
    poisson_ratio: ν.
    It is half the difference of the largest and the smallest principal stress, down to a depth of 2
    b.
    """

    def shear(depth: float) -> float:
        parts = [float(s) for s in axis_stresses(kappa, poisson_ratio, depth)]
        return -0.5 * (max(parts) - min(parts))

    largest = minimize_scalar(shear, bounds=(1e-6, 2.0), method="bounded", options={"xatol": 1e-10})
    return -float(largest.fun), float(largest.x)
