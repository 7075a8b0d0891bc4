"""Hertz contact: the constants of eqs. (5) and (6), the case of section 3.1, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hcbench.laws import closed_form, hertz, hertz_elliptic
from hcbench.laws.force import HuntCrossley
from hcbench.system.errors import UserError
from hcbench.terms.scene import Material

INCH, LBF, POUND_MASS = 0.0254, 4.4482216152605, 0.45359237
PSI = LBF / INCH**2
STEEL = Material(30e6 * PSI, 0.3)
CASE = hertz.spheres(1 * INCH, -2 * INCH, STEEL, STEEL)  # section 3.1

radii = st.floats(1e-3, 10.0)


def test_relative_radius_of_the_case_is_two_inches() -> None:
    assert CASE.relative_radius == pytest.approx(2 * INCH, rel=1e-14)


def test_printed_constants() -> None:
    """K1 = 2.198e7 lb/in² (printed 2.19e7), K2 = 1.16e4, K3 = 3.1e7 lb/in^1.5 = 3.4e7 N/cm^1.5."""
    assert f"{CASE.K1 / PSI:.4g}" == "2.198e+07"
    assert f"{CASE.K1 / 1e4:.4g}" == "1.515e+07"  # N/cm²
    assert f"{CASE.K2 / PSI ** (2 / 3):.2e}" == "1.16e+04"
    assert f"{CASE.stiffness * INCH**1.5 / LBF:.1e}" == "3.1e+07"
    assert f"{CASE.stiffness / 1000:.1e}" == "3.4e+07"


def test_largest_force_is_about_600_lb() -> None:
    """By (6) the limit of 62 000 lb/in² is reached at 608.6 lb; the paper says 600 lb."""
    force = CASE.force_at_shear()
    assert force / LBF == pytest.approx(608.6, abs=0.05)
    assert CASE.shear_max(force) == pytest.approx(62_000 * PSI, rel=1e-14)
    assert f"{CASE.pressure_max(force) / PSI:.0f}" == "200000"


@given(st.floats(1e-3, 1e5))
def test_all_forms_of_the_theory_agree(force: float) -> None:
    """(5), (6) in K1 and K2, p0 = 3 F/(2 π a²) and a² = R x are one theory."""
    curvature, a = 1 / CASE.relative_radius, math.sqrt(CASE.relative_radius * CASE.approach(force))
    assert CASE.K1 * CASE.approach(force) ** 1.5 / math.sqrt(curvature) == pytest.approx(
        force, rel=1e-12
    )
    assert CASE.pressure_max(force) == pytest.approx(1.5 * force / (math.pi * a**2), rel=1e-12)
    assert CASE.shear_max(force) == pytest.approx(
        CASE.K2 * (curvature**2 * force) ** (1 / 3), rel=1e-12
    )
    assert CASE.shear_max(force) == pytest.approx(0.31 * CASE.pressure_max(force), rel=1e-14)


@given(radii, radii)
def test_a_sphere_is_the_round_ellipse(one: float, two: float) -> None:
    """The general theory of elliptic contacts has this one as a special case."""
    ours = hertz.spheres(one, two, STEEL, Material(70e9, 0.33))
    general = hertz_elliptic.contact(
        hertz_elliptic.sphere(one, STEEL), hertz_elliptic.sphere(two, Material(70e9, 0.33))
    )
    assert general.stiffness == pytest.approx(ours.stiffness, rel=1e-10)
    assert general.pressure_max(100.0) == pytest.approx(ours.pressure_max(100.0), rel=1e-10)


def test_the_paper_pair_reaches_its_limit_near_12_in_per_s() -> None:
    law = HuntCrossley(CASE.stiffness, 0.008 / INCH)
    below, above = closed_form.force_max(law, POUND_MASS, np.array([11.9, 12.3]) * INCH)
    assert below < CASE.force_at_shear() < above


def test_at_16_in_per_s_the_limit_is_passed_by_not_more_than_about_15_percent() -> None:
    for alpha, share in ((0.002, 1.13), (0.008, 1.117), (0.016, 1.106)):
        law = HuntCrossley(3.1e7 * LBF / INCH**1.5, alpha / INCH)
        pair = hertz.from_stiffness(law.stiffness, 2 * INCH)
        over = (
            pair.shear_max(float(closed_form.force_max(law, POUND_MASS, 16 * INCH)))
            / hertz.SHEAR_LIMIT
        )
        assert over == pytest.approx(share, abs=0.01)
        assert over < 1.15


def test_wrapping_the_hollow_closer_lowers_the_stress() -> None:
    """Section 3.1: stress "can be reduced ... by wrapping the concave surface more around"."""
    stresses = []
    for radius in (3 * INCH, 2 * INCH, 1.5 * INCH):
        pair = hertz.spheres(INCH, -radius, STEEL, STEEL)
        law = HuntCrossley(pair.stiffness, 0.3)
        stresses.append(pair.shear_max(float(closed_form.force_max(law, POUND_MASS, 0.4))))
    assert np.all(np.diff(stresses) < 0)


def test_shear_is_0_31_of_the_pressure() -> None:
    share, _ = hertz_elliptic.largest_shear(1.0, 0.3)
    assert share == pytest.approx(hertz.SHEAR_OVER_PRESSURE, abs=5e-4)


@given(radii, radii)
def test_bodies_may_change_places(one: float, two: float) -> None:
    rubber = Material(5e6, 0.499)
    forth, back = hertz.spheres(one, two, STEEL, rubber), hertz.spheres(two, one, rubber, STEEL)
    assert forth.stiffness == pytest.approx(back.stiffness, rel=1e-14)


def test_a_rigid_partner_leaves_one_compliance() -> None:
    rigid = Material(1e30, 0.0)
    assert hertz.contact_modulus(STEEL, rigid) == pytest.approx(
        STEEL.young_modulus / (1 - 0.3**2), rel=1e-12
    )
    assert hertz.contact_modulus(STEEL, STEEL) == pytest.approx(
        STEEL.young_modulus / (2 * (1 - 0.3**2)), rel=1e-14
    )


def test_a_plane_leaves_the_sphere() -> None:
    assert hertz.relative_radius(0.03, math.inf) == pytest.approx(0.03, rel=1e-15)


@given(st.floats(1e3, 1e12), radii)
def test_stiffness_gives_the_contact_back(stiffness: float, radius: float) -> None:
    assert hertz.from_stiffness(stiffness, radius).stiffness == pytest.approx(stiffness, rel=1e-14)


@pytest.mark.parametrize(
    ("radius_1", "radius_2", "slot"),
    [
        (0.0254, -0.0254, "1/R1 . 1/R2"),  # conforms
        (0.0254, -0.02, "1/R1 . 1/R2"),  # does not fit in
        (-0.05, -0.05, "1/R1 . 1/R2"),
        (math.inf, math.inf, "1/R1 . 1/R2"),
        (0.0, 1.0, "radius 1"),
        (1.0, math.nan, "radius 2"),
    ],
)
def test_surfaces_that_do_not_touch_at_a_point_are_refused(
    radius_1: float, radius_2: float, slot: str
) -> None:
    with pytest.raises(UserError, match=f"^{slot}: "):
        hertz.spheres(radius_1, radius_2, STEEL, STEEL)


@pytest.mark.parametrize(
    ("young", "poisson", "slot"),
    [
        (0.0, 0.3, "young_modulus"),
        (-1e9, 0.3, "young_modulus"),
        (math.inf, 0.3, "young_modulus"),
        (1e9, 0.5, "poisson_ratio"),
        (1e9, -1.0, "poisson_ratio"),
        (1e9, math.nan, "poisson_ratio"),
    ],
)
def test_materials_that_cannot_be_are_refused(young: float, poisson: float, slot: str) -> None:
    with pytest.raises(UserError, match=f"^{slot}: "):
        hertz.contact_modulus(STEEL, Material(young, poisson))
