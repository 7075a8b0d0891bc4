"""The stress limit of section 1.10: the force and the speed that reach it, and the paper's own figures."""

from __future__ import annotations

import numpy as np
import pytest

from hcbench.errors import UserError
from hcbench.laws import closed_form, hertz
from hcbench.laws.force import HuntCrossley
from hcbench.laws.hertz_elliptic import PRESSURE_LIMIT, Surface, contact, sphere
from hcbench.laws.stress import speed_at_force, speed_at_pressure, speed_at_shear
from hcbench.scene import Material

INCH, POUND_MASS, POUND = 0.0254, 0.45359237, 4.4482216152605
STEEL = Material(206.8e9, 0.3)
PAIR = hertz.spheres(INCH, -2 * INCH, STEEL, STEEL)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("alpha", [0.0, 0.3, 50.0])
def test_the_speed_for_a_force_is_the_one_whose_impact_reaches_it(exponent: float, alpha: float) -> None:
    law = HuntCrossley(3.4e10, alpha, exponent)
    for speed in (0.01, 0.4, 30.0):
        force = float(closed_form.force_max(law, POUND_MASS, speed))
        assert speed_at_force(law, POUND_MASS, force) == pytest.approx(speed, rel=1e-12)


def test_without_loss_the_force_goes_with_the_6_5_power_of_the_speed() -> None:
    law = HuntCrossley(3.4e10, 0.0)
    ratio = speed_at_force(law, 1.0, 200.0) / speed_at_force(law, 1.0, 100.0)
    assert ratio == pytest.approx(2.0 ** (5 / 6), rel=1e-13)


def test_the_paper_pair_reaches_its_limit_near_12_in_per_s() -> None:
    """At α = 0.008 s/in: 12 in/s gives 597.9 lb and 0.999 of the limit."""
    speed = speed_at_shear(PAIR, 0.008 / INCH, POUND_MASS) / INCH
    assert 11.9 < speed < 12.3


def test_at_16_in_per_s_the_limit_is_passed_by_not_more_than_about_15_percent() -> None:
    for alpha, share in ((0.002, 1.13), (0.008, 1.117), (0.016, 1.106)):
        law = HuntCrossley(3.1e7 * POUND / INCH**1.5, alpha / INCH)
        pair = hertz.from_stiffness(law.stiffness, 2 * INCH)
        over = pair.shear_max(float(closed_form.force_max(law, POUND_MASS, 16 * INCH))) / hertz.SHEAR_LIMIT
        assert over == pytest.approx(share, abs=0.01)
        assert over < 1.15


def test_round_and_elliptic_contacts_agree_on_a_round_pair() -> None:
    ellipse = contact(sphere(INCH, STEEL), sphere(-2 * INCH, STEEL))
    one = speed_at_pressure(ellipse, 0.3, POUND_MASS, PRESSURE_LIMIT)
    assert one == pytest.approx(speed_at_shear(PAIR, 0.3, POUND_MASS), rel=1e-12)


def test_wrapping_the_hollow_closer_lets_it_run_faster() -> None:
    """Section 3.1: stress "can be reduced ... by wrapping the concave surface more around"."""
    speeds = [
        speed_at_pressure(
            contact(sphere(INCH, STEEL), Surface(-r, -r, STEEL)), 0.3, POUND_MASS, PRESSURE_LIMIT
        )
        for r in (3 * INCH, 2 * INCH, 1.5 * INCH)
    ]
    assert np.all(np.diff(speeds) > 0)


def test_bad_numbers_are_named() -> None:
    with pytest.raises(UserError, match="force: 0"):
        speed_at_force(HuntCrossley(1.0, 0.0), 1.0, 0.0)
    with pytest.raises(UserError, match="mass: -1"):
        speed_at_force(HuntCrossley(1.0, 0.0), -1.0, 1.0)
