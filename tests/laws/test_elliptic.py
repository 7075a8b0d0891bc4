"""Hertz contact in general: against printed tables, 30-digit arithmetic and direct integration."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from scipy.integrate import dblquad

from hcbench.laws.hertz_elliptic import (
    EllipticContact,
    Surface,
    axis_ratio,
    axis_stresses,
    contact,
    largest_shear,
    sphere,
)
from hcbench.system.errors import UserError
from hcbench.terms.scene import Material

STEEL = Material(206.8e9, 0.3)
BRASS = Material(100e9, 0.34)
FLAT = Surface(math.inf, math.inf, STEEL)
CYLINDER = Surface(0.02, math.inf, STEEL)
INCH = 0.0254

# S. P. Timoshenko, J. N. Goodier, "Theory of Elasticity", 3rd ed., McGraw-Hill 1970, section
# 141: m and n of a, b = m, n (3π/4 P (k1 + k2) / (A + B))^(1/3) for cos θ = (B - A)/(A + B). It
# is reference [5] of the paper.
TIMOSHENKO = {
    30: (2.731, 0.493),
    35: (2.397, 0.530),
    40: (2.136, 0.567),
    45: (1.926, 0.604),
    50: (1.754, 0.641),
    55: (1.611, 0.678),
    60: (1.486, 0.717),
    65: (1.378, 0.759),
    70: (1.284, 0.802),
    75: (1.202, 0.846),
    80: (1.128, 0.893),
    85: (1.061, 0.944),
    90: (1.000, 1.000),
}

# K. L. Johnson, "Contact Mechanics", Cambridge University Press 1985, table 4.1, ν = 0.3: b/a ->
# largest shear stress over p0, and its depth over b.
JOHNSON = {
    0.2: (0.322, 0.745),
    0.4: (0.325, 0.665),
    0.6: (0.323, 0.590),
    0.8: (0.317, 0.530),
    1.0: (0.310, 0.480),
}


def _general() -> EllipticContact:
    return contact(Surface(0.02, 0.05, STEEL), Surface(-0.09, 0.04, BRASS), angle=0.7)


@pytest.mark.parametrize(("theta", "printed"), TIMOSHENKO.items())
def test_the_axes_agree_with_the_table_of_timoshenko_and_goodier(
    theta: int, printed: tuple[float, float]
) -> None:
    cosine = math.cos(math.radians(theta))
    bodies = contact(Surface(1.0 / (1.0 - cosine), 1.0 / (1.0 + cosine), STEEL), FLAT)
    a, b = bodies.semi_axes(1.0)
    total = bodies.long_curvature + bodies.short_curvature
    unit = (0.75 / (bodies.contact_modulus * total)) ** (1.0 / 3.0)
    # The table was computed by hand; its worst entry (m, n at 65° ... 75°) is
    # wrong by 2 in the third place.
    assert a / unit == pytest.approx(printed[0], abs=0.0025)
    assert b / unit == pytest.approx(printed[1], abs=0.0025)


@pytest.mark.parametrize(("kappa", "printed"), JOHNSON.items())
def test_the_largest_shear_agrees_with_the_table_of_johnson(
    kappa: float, printed: tuple[float, float]
) -> None:
    share, depth = largest_shear(kappa, 0.3)
    assert share == pytest.approx(printed[0], abs=0.001)
    # A flat maximum: the depth is printed to 0.005 and good to about that.
    assert depth == pytest.approx(printed[1], abs=0.0065)


@pytest.mark.parametrize("ratio", [1e-6, 1e-3, 0.1, 0.5, 0.9, 1 - 1e-6, 1 - 1e-9, 1 - 1e-12])
def test_the_ellipse_solves_hertz_equation_to_the_last_digits(ratio: float) -> None:
    with mpmath.workdps(40):

        def miss(kappa: mpmath.mpf) -> mpmath.mpf:
            m = 1 - kappa**2
            big_k, big_e = mpmath.ellipk(m), mpmath.ellipe(m)
            return (big_k - big_e) / (big_e / kappa**2 - big_k) - ratio

        exact = mpmath.findroot(miss, mpmath.mpf(axis_ratio(ratio)))
    assert abs(axis_ratio(ratio) / float(exact) - 1.0) < 2e-14


@pytest.mark.parametrize("plate", [math.inf, 0.03, -2 * INCH])
def test_spheres_are_the_special_case_of_eq_5(plate: float) -> None:
    pair = contact(sphere(INCH, STEEL), sphere(plate, STEEL))
    relative = 1.0 / (1.0 / INCH + 1.0 / plate)
    modulus = STEEL.young_modulus / (2.0 * (1.0 - STEEL.poisson_ratio**2))
    assert pair.axis_ratio == 1.0
    assert pair.stiffness == pytest.approx(4.0 / 3.0 * modulus * math.sqrt(relative), rel=1e-14)
    force = 600.0
    a, b = pair.semi_axes(force)
    assert a == b == pytest.approx(math.sqrt(relative * pair.approach(force)), rel=1e-14)
    assert pair.pressure_max(force) == pytest.approx(
        (6 * force * modulus**2 / (math.pi**3 * relative**2)) ** (1 / 3), rel=1e-14
    )


def test_the_pressure_bends_the_surfaces_as_assumed() -> None:
    """∫ p / (π E* r) dA = δ - A x² - B y² inside the ellipse: Hertz's own condition, by direct
    integration."""
    pair, force = _general(), 100.0
    a, b = pair.semi_axes(force)
    p0, approach = pair.pressure_max(force), pair.approach(force)

    def sunk(x: float, y: float) -> float:
        # Polar coordinates about the point: the 1/r goes away against r dr, and
        # the chord of p is an ellipse's.
        def along(phi: float) -> float:
            c, s = math.cos(phi), math.sin(phi)
            quadratic = (c / a) ** 2 + (s / b) ** 2
            linear = x * c / a**2 + y * s / b**2
            inside = 1.0 - (x / a) ** 2 - (y / b) ** 2
            root = math.sqrt(linear**2 + quadratic * inside)
            # ∫ √(inside - 2 linear r - quadratic r²) dr over the ray, in closed form.
            q = quadratic
            half = (inside + linear**2 / q) / (2.0 * math.sqrt(q))
            return half * (math.pi / 2 - math.asin(linear / root)) - linear * math.sqrt(inside) / (
                2.0 * q
            )

        phis = (np.arange(2000) + 0.5) * 2.0 * math.pi / 2000
        return p0 / (math.pi * pair.contact_modulus) * sum(map(along, phis)) * 2.0 * math.pi / 2000

    for x, y in ((0.0, 0.0), (0.6 * a, 0.0), (0.0, 0.8 * b), (0.4 * a, -0.5 * b)):
        wanted = approach - pair.long_curvature * x**2 - pair.short_curvature * y**2
        assert sunk(x, y) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("kappa", [0.3, 0.8])
@pytest.mark.parametrize("depth", [0.2, 0.7])
def test_the_stresses_below_the_middle_agree_with_a_sum_of_point_loads(
    kappa: float, depth: float
) -> None:
    """Boussinesq's point load (Johnson, section 3.2) summed over the pressure, on the axis."""
    nu, a, b, z = 0.3, 1.0 / kappa, 1.0, depth

    def summed(kernel: str) -> float:
        def at(r: float, phi: float) -> float:
            c, s = a * math.cos(phi), b * math.sin(phi)
            x, y, jacobian = r * c, r * s, a * b * r
            rho = math.sqrt(x * x + y * y + z * z)
            p = math.sqrt(max(0.0, 1.0 - r * r))
            if kernel == "z":
                return -p * 3.0 * z**3 / (2.0 * math.pi * rho**5) * jacobian
            u, w = (x, y) if kernel == "x" else (y, x)
            flat = u * u + w * w
            first = (
                (1.0 - 2.0 * nu)
                / flat
                * ((1.0 - z / rho) * (u * u - w * w) / flat + z * w * w / rho**3)
            )
            return p / (2.0 * math.pi) * (first - 3.0 * z * u * u / rho**5) * jacobian

        value, _ = dblquad(at, 0.0, math.pi / 2, 1e-9, 1.0, epsabs=1e-9, epsrel=1e-9)
        return 4.0 * value

    ours = [float(s) for s in axis_stresses(kappa, nu, depth)]
    for got, kernel in zip(ours, "xyz", strict=True):
        assert got == pytest.approx(summed(kernel), abs=2e-7)


def test_equal_cylinders_at_a_right_angle_press_like_a_sphere_on_a_plane() -> None:
    crossed = contact(CYLINDER, CYLINDER, math.pi / 2)
    ball = contact(sphere(0.02, STEEL), FLAT)
    assert crossed.axis_ratio == pytest.approx(1.0, abs=1e-7)
    assert crossed.stiffness == pytest.approx(ball.stiffness, rel=1e-12)


def test_who_comes_first_and_which_way_round_does_not_matter() -> None:
    one, two = Surface(0.02, 0.05, STEEL), Surface(-0.09, 0.04, BRASS)
    turned = Surface(0.05, 0.02, STEEL), Surface(0.04, -0.09, BRASS)
    stiffness = contact(one, two, 0.7).stiffness
    assert contact(two, one, 0.7).stiffness == pytest.approx(stiffness, rel=1e-13)
    assert contact(*turned, 0.7).stiffness == pytest.approx(stiffness, rel=1e-13)
    assert contact(one, two, -0.7).stiffness == pytest.approx(stiffness, rel=1e-13)


def test_the_paper_pair_reaches_its_limit_at_about_600_lb() -> None:
    pair = contact(sphere(INCH, STEEL), sphere(-2 * INCH, STEEL))
    pound_force = 4.4482216152605
    assert pair.pressure_max(600.0 * pound_force) < 200_000 * pound_force / INCH**2  # section 1.10
    assert pair.pressure_max(615.0 * pound_force) > 200_000 * pound_force / INCH**2
    share, _ = largest_shear(1.0, 0.3)
    assert share == pytest.approx(0.31, abs=1e-4)  # the 0.31 of section 1.10


def test_the_theory_ends_where_the_contact_is_a_tenth_of_the_smallest_radius() -> None:
    pair = contact(Surface(INCH, 3 * INCH, STEEL), sphere(-4 * INCH, STEEL), 0.4)
    long, _ = pair.semi_axes(pair.stiffness * pair.depth_max() ** 1.5)
    assert long == pytest.approx(0.1 * INCH, rel=1e-12)


@pytest.mark.parametrize(
    ("one", "two", "angle"),
    [
        (CYLINDER, CYLINDER, 0.0),
        (CYLINDER, FLAT, 0.3),
        (sphere(0.02, STEEL), sphere(-0.02, STEEL), 0.0),
        (sphere(0.02, STEEL), sphere(-0.01, STEEL), 0.0),
        (FLAT, FLAT, 0.0),
    ],
)
def test_lines_and_hollows_too_narrow_are_refused(one: Surface, two: Surface, angle: float) -> None:
    with pytest.raises(UserError, match="touch at a point"):
        contact(one, two, angle)


def test_bad_shapes_and_matter_are_named() -> None:
    with pytest.raises(UserError, match="first: 0"):
        Surface(0.0, 1.0, STEEL)
    with pytest.raises(UserError, match="second: nan"):
        Surface(1.0, math.nan, STEEL)
    with pytest.raises(UserError, match=r"poisson_ratio: 0\.5"):
        sphere(1.0, Material(1e9, 0.5))
    with pytest.raises(UserError, match="young_modulus: -1"):
        sphere(1.0, Material(-1.0, 0.3))
    with pytest.raises(UserError, match="curvature_ratio"):
        axis_ratio(0.0)
