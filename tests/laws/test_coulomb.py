"""Coulomb's friction in the impact of a solid ball, by numbers worked out by hand."""

from __future__ import annotations

import math

import pytest

from hcbench.laws.coulomb import coulomb_ratio, tangential
from hcbench.terms.impact import Impact, Launch, Status
from hcbench.terms.scene import Material, Scene

STEEL = Material(2e11, 0.3)
# 2 m/s in, 1.5 m/s out, in contact for 10 ms: 0.5 (2 + 1.5) N s, and the
# weight's 0.5 x 10 x 0.01 N s.
IMPACT = Impact(Launch(2.0), Status.PARTED, speed_in=2.0, speed_out=1.5, duration=0.01)
NORMAL = 1.75 + 0.05


def ball(friction: float) -> Scene:
    return Scene(
        "ball", "a ball", "plane", mass=0.5, ball_radius=0.1, plate_radius=math.inf, ball_material=STEEL,
        plate_material=STEEL, stiffness=1e6, gravity=10.0, friction=friction,
    )  # fmt: skip


def test_the_contact_turns_the_body_and_carries_its_weight() -> None:
    along = tangential(IMPACT, Launch(2.0, slip=(3.0, 0.0)), ball(0.1))
    assert along.normal_impulse == pytest.approx(NORMAL)


def test_a_contact_that_slides_to_its_end_has_the_coefficient_times_the_normal_impulse() -> None:
    scene, launch = ball(0.1), Launch(2.0, slip=(3.0, -4.0))
    along = tangential(IMPACT, launch, scene)
    assert along.impulse == pytest.approx((-0.6 * 0.1 * NORMAL, 0.8 * 0.1 * NORMAL))
    assert along.impulse_ratio == pytest.approx(0.1)
    assert coulomb_ratio(along, scene) == pytest.approx(0.1)
    # The slip meets 2/7 of the mass: 0.18 N s takes 1.26 m/s of 5 m/s.
    assert math.hypot(*along.slip_out) == pytest.approx(5.0 - 0.1 * NORMAL * 7.0 / (2.0 * 0.5))


def test_a_contact_that_sticks_rolls_on() -> None:
    along = tangential(IMPACT, Launch(2.0, slip=(3.0, 0.0)), ball(2.0))
    assert along.impulse == pytest.approx((-2.0 / 7.0 * 0.5 * 3.0, 0.0))
    assert along.slip_out == pytest.approx((0.0, 0.0), abs=1e-12)
    # Rolling has 5/7 of the speed, and turns with it: v = R ω.
    assert along.spin_out == pytest.approx((0.0, 5.0 / 7.0 * 3.0 / 0.1, 0.0))
    rolling = (5.0 / 7.0 * 3.0) ** 2
    assert along.energy_out == pytest.approx(0.5 * 0.5 * (1.5**2 + 1.4 * rolling))
