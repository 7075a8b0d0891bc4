"""The plug-in's e is the law's from the speed on that `tune` names, at any phase of the step."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hcbench.sim import registry
from hcbench.terms.impact import Launch
from hcbench.tuning.ask import make_target

G, PHASES = 9.81, (0.01, 0.1, 0.4, 0.7, 0.95, 0.99)


@pytest.mark.parametrize("alpha", [0.08, 0.63])
@pytest.mark.parametrize("step", [1e-3, 1 / 240, 5e-3, 1 / 60])
def test_it_is_exact_above_the_speed_that_it_names(step: float, alpha: float) -> None:
    scene, target = make_target(timestep=step, alpha=alpha, speeds=[G * step, 2.0])
    recipe, engine = registry.recipe("pybullet.restitution-law"), registry.engine("pybullet")
    assert recipe.exact_above is not None
    low = 1.5 * G * step
    for _ in range(20):  # e at that speed says how high it is
        low = recipe.exact_above(float(target.restitution(low))) * G * step
    launches = [
        Launch.touching(share * low, phase, step, G)
        for share in (1.0005, 1.05, 1.3, 2.0)
        for phase in PHASES
    ]
    heavy = replace(scene, mass=target.mass, gravity=G)
    for impact in engine.run(heavy, recipe(target), launches):
        assert impact.restitution == pytest.approx(
            float(target.restitution(impact.speed_in)), abs=1e-6
        )


@pytest.mark.parametrize("e", [0.9, 0.5])
def test_it_is_not_below_that_speed_where_bullet_reverses_a_step_early(e: float) -> None:
    """Up to h U above the plane a body that has e² U² left needs 2 g h U
    of it: by chance of the phase.

    So it is with Bullet's own contactProcessingThreshold, with which its contact acts from afar.
    """
    step, engine = 1 / 240, registry.engine("pybullet")
    recipe = registry.recipe("pybullet.restitution-law")
    assert recipe.exact_above is not None
    low = recipe.exact_above(e) * G * step
    scene, target = make_target(timestep=step, restitution=e, speeds=[0.5 * low, 2.0])
    heavy = replace(scene, mass=target.mass, gravity=G)
    setting = recipe(target)
    ball = {"linearDamping": 0.0, "angularDamping": 0.0}
    far = replace(setting, options={**setting.options, "ball": ball})

    def worst(share: float) -> float:
        launches = [Launch.touching(share * low, (i + 0.5) / 32, step, G) for i in range(32)]
        impacts = engine.run(heavy, far, launches)
        return max(abs(impact.restitution - e) for impact in impacts)

    assert worst(1.01) < 1e-6
    assert worst(0.9) > 0.01
