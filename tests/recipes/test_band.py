"""The default band begins where a body can bounce at the step, whenever in the step it touches."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hcbench.recipes.target import PAPER, default_band
from hcbench.sim import registry
from hcbench.terms.impact import Launch, Status
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Setting
from hcbench.terms.units import STANDARD_GRAVITY

SCENE = replace(load_scene("steel-plane"), gravity=STANDARD_GRAVITY)


def endings(speed: float, timestep: float) -> set[Status]:
    """Ends of impacts at one speed and 16 phases, m/s and s, by MuJoCo's plug-in with an e of 0.98."""
    setting = Setting(
        "mujoco", "any", timestep, {"law": {"kind": "restitution", "restitution": 0.98}}
    )
    launches = [Launch.touching(speed, (i + 0.5) / 16, timestep, SCENE.gravity) for i in range(16)]
    return {impact.status for impact in registry.engine("mujoco").run(SCENE, setting, launches)}


@pytest.mark.parametrize("timestep", [4e-3, 1.0 / 60.0])
def test_a_body_bounces_at_the_lowest_speed_of_the_band_and_rests_at_a_tenth_less(
    timestep: float,
) -> None:
    """Rest is a rate of 1.1 g h or less as a step begins; at the touch
    it is half a g h more: 1.6 g h.
    """
    low, _ = default_band(timestep, STANDARD_GRAVITY)
    assert low > PAPER[0]
    assert endings(low, timestep) == {Status.PARTED}
    assert Status.RESTED in endings(0.9 * low, timestep)


def test_a_band_ends_at_four_times_its_lowest_speed_at_least() -> None:
    low, high = default_band(1.0 / 60.0, STANDARD_GRAVITY)
    assert high == pytest.approx(4.0 * low)
    assert default_band(1e-3, STANDARD_GRAVITY) == pytest.approx((0.0254, 0.508))
