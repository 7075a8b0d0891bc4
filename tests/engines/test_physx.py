"""PhysX: its settings come as near as float32 lets them, and its defaults do what the page says."""

from __future__ import annotations

import numpy as np
import pytest
from plane_launches import ALPHAS, PLANE, WITH_GRAVITY, restitutions, run, target

from hcbench.laws import closed_form
from hcbench.sim import registry
from hcbench.sim.convert import convert
from hcbench.terms import units
from hcbench.terms.impact import Status
from hcbench.terms.setting import Setting


@pytest.mark.needs_engine("physx")
@pytest.mark.parametrize(
    ("timestep", "within"), [(1e-6, 3e-3), (1e-5, 1.3e-6), (1e-3, 1.3e-6), (1 / 240, 1.3e-6)]
)
def test_has_the_restitution_that_is_set(timestep: float, within: float) -> None:
    setting = registry.recipe("physx.restitution")(target(0.008, timestep))
    off = (
        3.0 * WITH_GRAVITY.gravity * timestep
    )  # under gravity e at the plane varies with the phase
    for scene, most in ((PLANE, within), (WITH_GRAVITY, within + off)):
        _, e = restitutions(run(setting, scene))
        assert np.abs(e - setting.options["restitution"]).max() < most


@pytest.mark.needs_engine("physx")
@pytest.mark.parametrize("alpha", ALPHAS)
def test_is_given_the_restitution_of_each_impact(alpha: float) -> None:
    setting = registry.recipe("physx.restitution-law")(target(alpha, 1e-3))
    for scene, most in ((PLANE, 1.3e-6), (WITH_GRAVITY, 0.01)):
        v, e = restitutions(run(setting, scene))
        assert np.abs(e - closed_form.restitution(alpha / units.INCH, v)).max() < most


@pytest.mark.needs_engine("physx")
def test_as_it_comes_does_not_bounce_below_two_metres_a_second() -> None:
    setting = Setting("physx", "mine", 1e-3, {})
    _, e = restitutions(run(setting, speeds=(0.2, 1.9)))
    assert e.max() < 1e-6
    _, e = restitutions(run(setting, speeds=(2.1, 3.0)))
    assert np.abs(e - 0.1).max() < 1e-5


@pytest.mark.needs_engine("physx")
def test_by_pgs_bounces_by_luck_of_the_phase() -> None:
    setting = Setting(
        "physx", "mine", 1e-3, {"bounce_threshold": 0, "enable_tgs": False, "restitution": 0.9}
    )
    _, e = restitutions(run(setting))
    assert np.ptp(e) > 0.05


@pytest.mark.needs_engine("physx")
def test_a_ball_that_float32_cannot_move_any_more_is_at_rest() -> None:
    impacts = run(Setting("physx", "mine", 1e-5, {}), WITH_GRAVITY)
    assert {i.status for i in impacts} <= {Status.RESTED, Status.PARTED}
    assert max(i.samples for i in impacts) < 1000


def test_convert_says_what_physx_calls_it() -> None:
    rows = {(row.system, row.parameter): row.value for row in convert(alpha=0.3, speed=0.2).rows}
    assert rows["PhysX", "restitution"] == (float(closed_form.restitution(0.3, 0.2)),)
