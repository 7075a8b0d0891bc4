"""PhysX: its settings come as near as float32 lets them, and its defaults do what the page says."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hcbench import units
from hcbench.impact import Floats, Impact, Launch, Status
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.scene import load_scene
from hcbench.setting import Setting
from hcbench.sim import registry
from hcbench.sim.convert import convert

PLANE = load_scene("steel-plane")
WITH_GRAVITY = dataclasses.replace(PLANE, gravity=9.80665)
SPEEDS, PHASES = (0.031, 0.13, 0.37, 0.5), (0.07, 0.31, 0.62, 0.88)  # of no search or other test
ALPHAS = (0.002, 0.004, 0.008, 0.016)  # s/in


def target(alpha: float, timestep: float) -> Target:
    law = HuntCrossley(PLANE.stiffness, alpha / units.INCH)
    return Target(law, PLANE.mass, timestep, 0.0254, 0.508)


def run(setting: Setting, scene: object = PLANE, speeds: tuple[float, ...] = SPEEDS) -> list[Impact]:
    launches = [Launch(v, p) for v in speeds for p in PHASES]
    return registry.engine(setting.engine).run(scene, setting, launches)  # type: ignore[arg-type]


def restitutions(impacts: list[Impact]) -> tuple[Floats, Floats]:
    return np.array([i.speed_in for i in impacts]), np.array([i.restitution for i in impacts])


@pytest.mark.needs_engine("physx")
@pytest.mark.parametrize(
    ("timestep", "within"), [(1e-6, 3e-3), (1e-5, 1.3e-6), (1e-3, 1.3e-6), (1 / 240, 1.3e-6)]
)
def test_has_the_restitution_that_is_set(timestep: float, within: float) -> None:
    setting = registry.recipe("physx.restitution")(target(0.008, timestep))
    off = 3.0 * WITH_GRAVITY.gravity * timestep  # under gravity e at the plane varies with the phase
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
    setting = Setting("physx", "mine", 1e-3, {"bounce_threshold": 0, "enable_tgs": False, "restitution": 0.9})
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
