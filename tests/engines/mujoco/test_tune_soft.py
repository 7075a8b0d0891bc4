"""One contact, all numbers searched: far better than one constant e, and
as good as one contact can be.
"""

from __future__ import annotations

import numpy as np
import pytest
from long_searches import long_search
from plain_mujoco import INCH, STEEL_MASS, STEEL_STIFFNESS, pasted, simulated

from hcbench.engines.mujoco.recipes.one_row import SOFT, largest_power
from hcbench.engines.mujoco.scene.rows import impedance
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target, minimax_constant
from hcbench.system.errors import SettingError

HELD_OUT = np.array([1.0, 1.37, 3.3, 8.0, 20.0]) * INCH


def target_of(alpha: float, timestep: float) -> Target:
    return Target(
        HuntCrossley(STEEL_STIFFNESS, alpha / INCH), STEEL_MASS, timestep, INCH, 20 * INCH
    )


@pytest.mark.parametrize(
    ("alpha", "must"), [(0.002, 0.0018), pytest.param(0.016, 0.011, marks=long_search)]
)
def test_restitution_follows_speed(alpha: float, must: float) -> None:
    target = target_of(alpha, 1e-5)
    flight = simulated(pasted(dict(SOFT(target).options), 1e-5, STEEL_MASS), 1e-5, HELD_OUT, 0.4)
    error = np.abs(flight.restitution - target.restitution(HELD_OUT)[:, None]).max()
    assert error < must
    assert error < 0.1 * minimax_constant(target)[1]


def test_the_same_numbers_serve_any_step_in_proportion() -> None:
    fine, coarse = (SOFT(target_of(0.002, h)).options["rows"][0] for h in (1e-6, 1e-5))
    assert coarse["solimp"][2] == pytest.approx(10 * fine["solimp"][2])
    assert coarse["solref"][0] == pytest.approx(fine["solref"][0] / 100)
    assert coarse["solref"][1] == pytest.approx(fine["solref"][1] / 10)


def test_the_largest_power_is_still_a_number_and_the_next_is_not() -> None:
    midpoint = np.array([0.4, 0.5, 0.6])
    depth = np.linspace(0.01, 0.99, 99)
    for m, power in zip(midpoint, largest_power(midpoint), strict=True):
        assert np.isfinite(impedance((1e-4, 0.9999, 1.0, m, power), depth)).all()
    with np.errstate(all="ignore"):
        beyond = impedance((1e-4, 0.9999, 1.0, 0.5, 1100.0), depth)
    assert np.isnan(beyond).any()


def test_a_step_that_would_take_it_centimetres_deep_is_refused() -> None:
    with pytest.raises(SettingError, match="staggered"):
        SOFT(target_of(0.008, 1e-3))
    with pytest.raises(SettingError, match="integrator"):
        SOFT(target_of(0.008, 1e-5), "discrete")
