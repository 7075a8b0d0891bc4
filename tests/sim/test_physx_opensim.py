"""PhysX and OpenSim: their best settings come as near as they can, and their traps are as they are told."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hcbench import units
from hcbench.errors import EngineMissing, SettingError
from hcbench.impact import Floats, Impact, Launch, Status
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.scene import load_scene
from hcbench.scoring import score_loop
from hcbench.setting import Setting
from hcbench.sim import registry
from hcbench.sim.convert import convert

PLANE = load_scene("steel-plane")
HEAVY = dataclasses.replace(PLANE, gravity=9.80665)
SPEEDS, PHASES = (0.031, 0.13, 0.37, 0.5), (0.07, 0.31, 0.62, 0.88)  # of no search or other test
ALPHAS = (0.002, 0.004, 0.008, 0.016)  # s/in


@pytest.fixture(autouse=True)
def _installed(request: pytest.FixtureRequest) -> None:
    for name in ("physx", "opensim"):
        if name in request.node.name:
            try:
                registry.engine(name).version()
            except EngineMissing as error:
                pytest.skip(str(error))


def target(alpha: float, timestep: float) -> Target:
    law = HuntCrossley(PLANE.stiffness, alpha / units.INCH)
    return Target(law, PLANE.mass, timestep, 0.0254, 0.508)


def run(setting: Setting, scene: object = PLANE, speeds: tuple[float, ...] = SPEEDS) -> list[Impact]:
    launches = [Launch(v, p) for v in speeds for p in PHASES]
    return registry.engine(setting.engine).run(scene, setting, launches)  # type: ignore[arg-type]


def restitutions(impacts: list[Impact]) -> tuple[Floats, Floats]:
    return np.array([i.speed_in for i in impacts]), np.array([i.restitution for i in impacts])


@pytest.mark.parametrize(
    ("timestep", "within"), [(1e-6, 3e-3), (1e-5, 1.3e-6), (1e-3, 1.3e-6), (1 / 240, 1.3e-6)]
)
def test_physx_has_the_restitution_that_is_set(timestep: float, within: float) -> None:
    setting = registry.recipe("physx.restitution")(target(0.008, timestep))
    for scene in (PLANE, HEAVY):
        _, e = restitutions(run(setting, scene))
        assert np.abs(e - setting.options["restitution"]).max() < within


@pytest.mark.parametrize("alpha", ALPHAS)
def test_physx_is_given_the_restitution_of_each_impact(alpha: float) -> None:
    setting = registry.recipe("physx.restitution-law")(target(alpha, 1e-3))
    for scene in (PLANE, HEAVY):
        v, e = restitutions(run(setting, scene))
        assert np.abs(e - closed_form.restitution(alpha / units.INCH, v)).max() < 1.3e-6


def test_physx_as_it_comes_does_not_bounce_below_two_metres_a_second() -> None:
    setting = Setting("physx", "mine", 1e-3, {})
    _, e = restitutions(run(setting, speeds=(0.2, 1.9)))
    assert e.max() < 1e-6
    _, e = restitutions(run(setting, speeds=(2.1, 3.0)))
    assert np.abs(e - 0.1).max() < 1e-5


def test_physx_by_pgs_bounces_by_luck_of_the_phase() -> None:
    setting = Setting("physx", "mine", 1e-3, {"bounce_threshold": 0, "enable_tgs": False, "restitution": 0.9})
    _, e = restitutions(run(setting))
    assert np.ptp(e) > 0.05


def test_physx_a_ball_that_float32_cannot_move_any_more_is_at_rest() -> None:
    impacts = run(Setting("physx", "mine", 1e-5, {}), HEAVY)
    assert {i.status for i in impacts} <= {Status.RESTED, Status.PARTED}
    assert max(i.samples for i in impacts) < 1000


@pytest.mark.parametrize("alpha", ALPHAS)
def test_opensim_is_the_law_with_its_loop(alpha: float) -> None:
    wanted = target(alpha, 1e-6)
    impacts = run(registry.recipe("opensim.force")(wanted), speeds=(0.13, 0.5))
    v, e = restitutions(impacts)
    assert np.abs(e - wanted.restitution(v)).max() < 3e-9
    loops = [score_loop(impact, wanted.law, PLANE.mass) for impact in impacts]
    assert max(loop.rms for loop in loops if loop) < 1e-3


def test_opensim_bounces_as_the_law_does_under_gravity() -> None:
    wanted = target(0.008, 1e-4)
    impacts = run(registry.recipe("opensim.force")(wanted), HEAVY)
    options = {"alpha": wanted.law.alpha}
    truth = registry.engine("reference").run(
        HEAVY, Setting("reference", "hunt-crossley", 1e-4, options), [i.launch for i in impacts]
    )
    for impact, true in zip(impacts, truth, strict=True):
        assert impact.speed_in == pytest.approx(true.speed_in, rel=1e-9)
        assert impact.restitution == pytest.approx(true.restitution, abs=2e-8)


def test_opensim_at_its_own_accuracy_is_off_by_a_fifth_or_gains_energy() -> None:
    wanted = target(0.008, 1e-2)
    setting = registry.recipe("opensim.stock-accuracy")(wanted)
    impacts = registry.engine("opensim").run(PLANE, setting, [Launch(0.0254, height=1e-2)])
    v, e = restitutions(impacts)
    assert e - wanted.restitution(v) == pytest.approx(-0.23, abs=0.01)
    (gained,) = registry.engine("opensim").run(
        PLANE, dataclasses.replace(setting, timestep=1e-3), [Launch(0.0254, height=1e-3)]
    )
    assert gained.restitution > 2


def test_opensim_without_a_stiffness_loses_the_ball_and_the_reason_says_so() -> None:
    impacts = run(registry.recipe("opensim.stock")(target(0.008, 1e-3)))
    assert {(i.status, i.reason) for i in impacts} == {
        (Status.DIVERGED, "position, velocity or force is not finite")
    }


def test_opensim_refuses_an_exponent_that_its_force_does_not_have() -> None:
    linear = Target(HuntCrossley(1e8, 0.3, 1.0), PLANE.mass, 1e-6, 0.0254, 0.508)
    with pytest.raises(SettingError, match=r"n = 1 in opensim; expected n = 1\.5"):
        registry.recipe("opensim.force")(linear)
    impacts = run(registry.recipe("opensim.hunt-crossley")(linear), speeds=(0.37,))
    v, e = restitutions(impacts)
    assert np.abs(e - linear.restitution(v)).max() < 1e-8


def test_convert_says_what_physx_and_opensim_call_it() -> None:
    rows = {(row.system, row.parameter): row.value for row in convert(alpha=0.3, speed=0.2).rows}
    assert rows["PhysX", "restitution"] == (float(closed_form.restitution(0.3, 0.2)),)
    assert rows["OpenSim", "dissipation"] == (0.3,)
