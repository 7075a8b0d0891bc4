"""An evaluation says where a contact goes deeper than its step and its law ask for."""

from __future__ import annotations

import pytest

import hcbench as hb
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Impact, Launch, Status
from hcbench.terms.scene import load_scene
from hcbench.tuning.evaluate import evaluate_impacts

SCENE = load_scene("steel-plane")
STEEL, RUBBER = HuntCrossley(SCENE.stiffness, 0.3), HuntCrossley(2e4, 0.3)


def is_deep(law: HuntCrossley, timestep: float, depth: float) -> bool:
    """Judgement on an impact that goes so deep, m. The band ends at 0.5 m/s."""
    target = Target(law, SCENE.mass, timestep, 0.1, 0.5)
    impact = Impact(
        Launch(0.5),
        Status.PARTED,
        speed_in=0.5,
        speed_out=0.4,
        penetration_max=depth,
        force_max=1.0,
        samples=9,
    )
    return evaluate_impacts([impact], target, SCENE).deep


@pytest.mark.parametrize("timestep", [1e-3, 4e-3])
def test_a_stiff_contact_may_go_as_deep_as_two_and_a_half_steps_of_the_fastest(
    timestep: float,
) -> None:
    """Steel gives way by 0.04 mm at 0.5 m/s, and a step of 1 ms goes 0.5 mm."""
    limit = 2.5 * 0.5 * timestep
    assert closed_form.penetration_max(STEEL, SCENE.mass, 0.5) < 0.1 * limit
    assert not is_deep(STEEL, timestep, 0.99 * limit)
    assert is_deep(STEEL, timestep, 1.01 * limit)


def test_a_soft_contact_may_go_half_as_deep_again_as_its_law() -> None:
    limit = 1.5 * float(closed_form.penetration_max(RUBBER, SCENE.mass, 0.5))
    assert limit > 2.5 * 0.5 * 1e-4
    assert not is_deep(RUBBER, 1e-4, 0.99 * limit)
    assert is_deep(RUBBER, 1e-4, 1.01 * limit)


def test_a_band_that_gravity_alone_reaches_within_half_a_step_is_refused() -> None:
    with pytest.raises(SettingError, match=r"speeds: from 0.0346 m/s; expected above 0.0394 m/s"):
        hb.tune(
            "mujoco",
            restitution=1.0,
            timestep="3.176 ms",
            gravity="24.8 m/s^2",
            speeds="0.0346:0.1193 m/s",
        )
