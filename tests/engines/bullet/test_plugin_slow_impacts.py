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
        Launch.touching(share * low, phase, step, G) for share in (1.0005, 1.05, 1.3, 2.0) for phase in PHASES
    ]
    heavy = replace(scene, mass=target.mass, gravity=G)
    for impact in engine.run(heavy, recipe(target), launches):
        assert impact.restitution == pytest.approx(float(target.restitution(impact.speed_in)), abs=1e-6)
