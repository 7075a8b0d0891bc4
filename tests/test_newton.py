"""Newton: its best settings come as near as they can, and what it drops is dropped."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hcbench import units
from hcbench.errors import EngineMissing, SettingError
from hcbench.impact import Floats, Launch
from hcbench.laws.force import HuntCrossley
from hcbench.scene import Scene, load_scene
from hcbench.setting import Setting
from hcbench.sim import registry
from hcbench.tune.target import Target

PLANE = load_scene("steel-plane")
HEAVY = dataclasses.replace(PLANE, gravity=9.80665)
LAUNCHES = [Launch(v, p) for v in (0.031, 0.13, 0.37, 0.5) for p in (0.07, 0.31, 0.62, 0.88)]


def target(timestep: float) -> Target:
    law = HuntCrossley(PLANE.stiffness, 0.008 / units.INCH)
    return Target(law, PLANE.mass, timestep, 0.0254, 0.508)


def restitutions(setting: Setting, scene: Scene = PLANE) -> tuple[Floats, Floats]:
    """Speeds and e; a skip where Newton is not installed."""
    try:
        impacts = registry.engine("newton").run(scene, setting, LAUNCHES)
    except EngineMissing as error:
        pytest.skip(str(error))
    return np.array([i.speed_in for i in impacts]), np.array([i.restitution for i in impacts])


@pytest.mark.parametrize("timestep", [1e-5, 1e-3, 1 / 240])
def test_xpbd_has_the_restitution_that_is_set(timestep: float) -> None:
    setting = registry.recipe("newton.restitution")(target(timestep))
    for scene in (PLANE, HEAVY) if timestep < 1e-3 else (PLANE,):
        _, e = restitutions(setting, scene)
        assert np.abs(e - setting.options["restitution"]).max() < 2e-7


def test_xpbd_is_given_the_restitution_of_each_impact() -> None:
    setting = registry.recipe("newton.restitution-law")(target(1e-4))
    for scene in (PLANE, HEAVY):
        v, e = restitutions(setting, scene)
        assert np.abs(e - target(1e-4).restitution(v)).max() < 2e-7


def test_as_it_comes_a_restitution_is_not_there() -> None:
    _, e = restitutions(registry.recipe("newton.stock")(target(1e-3)))
    assert 0.005 < e.min() <= e.max() < 0.04


def test_the_closed_form_of_the_spring_and_damper_holds_in_small_steps() -> None:
    setting = registry.recipe("newton.spring-damper")(target(1e-6))
    _, e = restitutions(setting)
    ends = target(1e-6).restitution(np.array([0.0254, 0.508]))
    assert abs(float(e.mean()) - float(ends.mean())) < 2e-3


def test_an_e_for_a_solver_without_one_is_refused() -> None:
    options = {"solver": "SemiImplicit", "law": {"kind": "restitution", "alpha": 0.3}}
    with pytest.raises(SettingError, match=r"newton option 'solver': 'SemiImplicit' with an e"):
        registry.engine("newton").script(PLANE, Setting("newton", "mine", 1e-3, options))
