"""A spring pair and a damper pair: e(v) as wanted, at fine and at coarse steps."""

from __future__ import annotations

import numpy as np
import pytest
from long_searches import long_search
from plain_mujoco import INCH, STEEL_MASS, STEEL_STIFFNESS, pasted, simulated

from hcbench.engines.mujoco.recipes.two_pair import TWO_PAIR, contact_duration, two_pair_rows
from hcbench.engines.mujoco.scene.rows import ConstraintRow, acceleration, restitution
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.system.errors import SettingError

HELD_OUT = np.array([1.0, 1.37, 2.1, 3.3, 5.2, 8.0, 12.3, 16.0, 20.0]) * INCH


def target_of(alpha: float, timestep: float, mass: float = STEEL_MASS) -> Target:
    return Target(HuntCrossley(STEEL_STIFFNESS, alpha / INCH), mass, timestep, INCH, 20 * INCH)


def errors(target: Target, integrator: str | None = None) -> np.ndarray:
    xml = pasted(dict(TWO_PAIR(target, integrator).options), target.timestep, target.mass)
    flight = simulated(xml, target.timestep, HELD_OUT, 1.6 * contact_duration(target))
    return np.asarray(flight.restitution - target.restitution(HELD_OUT)[:, None])


@pytest.mark.adhesion
@pytest.mark.parametrize("alpha", [pytest.param(0.002, marks=long_search), 0.016])
def test_restitution_at_a_fine_step(alpha: float) -> None:
    assert np.abs(errors(target_of(alpha, 1e-6))).max() < 1e-4


@pytest.mark.adhesion
@pytest.mark.parametrize(
    ("alpha", "timestep"), [(0.002, 2e-3), (0.004, 1e-3), (0.008, 5e-4), (0.016, 1e-4)]
)
def test_restitution_at_coarse_steps_with_a_softer_spring(alpha: float, timestep: float) -> None:
    target = target_of(alpha, timestep)
    assert contact_duration(target) == pytest.approx(36 * timestep)
    assert np.abs(errors(target)).max() < 1e-3


@pytest.mark.adhesion
def test_the_linear_reading_is_matched_too() -> None:
    law = target_of(0.008, 1e-3)
    target = Target(law.law, law.mass, 1e-3, law.speed_min, law.speed_max, reading="linear")
    assert np.abs(errors(target)).max() < 1e-3


@pytest.mark.adhesion
def test_mass_and_integrator_do_not_matter() -> None:
    assert np.abs(errors(target_of(0.008, 1e-3, mass=1000.0), "RK4")).max() < 1e-3
    light, heavy = (two_pair_rows(target_of(0.008, 1e-3, mass)) for mass in (0.001, 1.0))
    assert [row.damping for row in light] == pytest.approx([row.damping for row in heavy])


@pytest.mark.adhesion
def test_the_model_of_rows_is_the_engine() -> None:
    rows = two_pair_rows(target_of(0.016, 1e-3))
    rows.append(ConstraintRow.direct(200.0, 0.3, (0.1, 0.4, 0.002, 0.3, 2.5), onset=0.001))
    speeds = np.array([2.0, 20.0]) * INCH
    xml = pasted({"integrator": "Euler", "rows": [row.option() for row in rows]}, 1e-3, STEEL_MASS)
    engine = simulated(xml, 1e-3, speeds, 0.08, phases=8).restitution
    # The same phases: the engine's flights start 0.37 of a phase late, the model's half.
    x, v = -(np.arange(8) + 0.37) / 8 * 1e-3 * speeds[:, None], np.tile(speeds[:, None], 8)
    for _ in range(84):
        v = v - 1e-3 * acceleration(rows, x, v)
        x = x + 1e-3 * v
    assert np.abs(engine + v / speeds[:, None]).max() < 1e-12
    assert np.ptp(restitution(rows, 1e-3, speeds, 8, 0.08) - engine, axis=1).max() < 0.01


def test_what_has_no_loss_or_no_integrator_is_refused() -> None:
    with pytest.raises(SettingError, match="staggered"):
        TWO_PAIR(target_of(0.0, 1e-3))
    with pytest.raises(SettingError, match="integrator"):
        TWO_PAIR(target_of(0.008, 1e-3), "discrete")
