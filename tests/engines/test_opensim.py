"""OpenSim: it follows the law with its loop, and its defaults do what the page says."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from plane_launches import ALPHAS, PLANE, WITH_GRAVITY, restitutions, run, target

from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.scoring import score_loop
from hcbench.sim import registry
from hcbench.sim.convert import convert
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Launch, Status
from hcbench.terms.setting import Setting


@pytest.mark.needs_engine("opensim")
@pytest.mark.parametrize("alpha", ALPHAS)
def test_is_the_law_with_its_loop(alpha: float) -> None:
    wanted = target(alpha, 1e-6)
    impacts = run(registry.recipe("opensim.force")(wanted), speeds=(0.13, 0.5))
    v, e = restitutions(impacts)
    assert np.abs(e - wanted.restitution(v)).max() < 3e-9
    loops = [score_loop(impact, wanted.law, PLANE.mass) for impact in impacts]
    assert max(loop.rms for loop in loops if loop) < 1e-3


@pytest.mark.needs_engine("opensim")
def test_bounces_as_the_law_does_under_gravity() -> None:
    wanted = target(0.008, 1e-4)
    impacts = run(registry.recipe("opensim.force")(wanted), WITH_GRAVITY)
    options = {"alpha": wanted.law.alpha}
    truth = registry.engine("reference").run(
        WITH_GRAVITY,
        Setting("reference", "hunt-crossley", 1e-4, options),
        [i.launch for i in impacts],
    )
    for impact, true in zip(impacts, truth, strict=True):
        assert impact.speed_in == pytest.approx(true.speed_in, rel=1e-9)
        assert impact.restitution == pytest.approx(true.restitution, abs=2e-8)


@pytest.mark.needs_engine("opensim")
def test_at_its_own_accuracy_is_off_by_a_fifth_or_gains_energy() -> None:
    wanted = target(0.008, 1e-2)
    setting = registry.recipe("opensim.stock-accuracy")(wanted)
    impacts = registry.engine("opensim").run(PLANE, setting, [Launch(0.0254, height=1e-2)])
    v, e = restitutions(impacts)
    assert e - wanted.restitution(v) == pytest.approx(-0.23, abs=0.01)
    (gained,) = registry.engine("opensim").run(
        PLANE, dataclasses.replace(setting, timestep=1e-3), [Launch(0.0254, height=1e-3)]
    )
    assert gained.restitution > 2


@pytest.mark.needs_engine("opensim")
def test_without_a_stiffness_loses_the_ball_and_the_reason_says_so() -> None:
    impacts = run(registry.recipe("opensim.stock")(target(0.008, 1e-3)))
    assert {(i.status, i.reason) for i in impacts} == {
        (Status.DIVERGED, "position, velocity or force is not finite")
    }


def test_refuses_an_exponent_that_its_force_does_not_have() -> None:
    linear = Target(HuntCrossley(1e8, 0.3, 1.0), PLANE.mass, 1e-6, 0.0254, 0.508)
    with pytest.raises(SettingError, match=r"n = 1 in opensim; expected n = 1\.5"):
        registry.recipe("opensim.force")(linear)


@pytest.mark.needs_engine("opensim")
def test_has_the_law_of_any_exponent_by_a_script() -> None:
    linear = Target(HuntCrossley(1e8, 0.3, 1.0), PLANE.mass, 1e-6, 0.0254, 0.508)
    impacts = run(registry.recipe("opensim.hunt-crossley")(linear), speeds=(0.37,))
    v, e = restitutions(impacts)
    assert np.abs(e - linear.restitution(v)).max() < 1e-8


def test_convert_says_what_opensim_calls_it() -> None:
    rows = {(row.system, row.parameter): row.value for row in convert(alpha=0.3, speed=0.2).rows}
    assert rows["OpenSim", "dissipation"] == (0.3,)
