"""The plug-in's e is the law's from the speed on that `tune` names, at any phase of the step."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from hcbench.sim import registry
from hcbench.terms.impact import Launch
from hcbench.tuning.ask import make_target

FAR = 1e30  # Bullet's own contactProcessingThreshold
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


def worst_error(e: float, shares: tuple[float, ...], ball: dict[str, float]) -> list[float]:
    """The largest error of e at shares of g h, over 32 phases at 1/240 s; ball: its settings."""
    step, engine = 1 / 240, registry.engine("pybullet")
    recipe = registry.recipe("pybullet.restitution-law")
    scene, target = make_target(timestep=step, restitution=e, speeds=[G * step, 2.0])
    heavy = replace(scene, mass=target.mass, gravity=G)
    setting = recipe(target)
    own = replace(setting, options={**setting.options, "ball": {**setting.options["ball"], **ball}})
    worst = []
    for share in shares:
        launches = [Launch.touching(share * G * step, (i + 0.5) / 32, step, G) for i in range(32)]
        impacts = engine.run(heavy, own, launches)
        worst.append(max(abs(impact.restitution - e) for impact in impacts))
    return worst


@pytest.mark.parametrize("e", [0.9, 0.5, 0.25, 0.1])
def test_it_is_exact_from_the_lowest_such_speed_on(e: float) -> None:
    recipe = registry.recipe("pybullet.restitution-law")
    assert recipe.exact_above is not None
    low = recipe.exact_above(e)
    assert low == max(1.601, 0.5 / e)
    above, below = worst_error(e, (1.001 * low, 0.9 * low), {})
    assert above < 1e-6
    assert below > 0.01


@pytest.mark.parametrize("e", [0.9, 0.5])
def test_it_is_not_so_early_with_bullets_own_threshold_for_contacts_from_afar(e: float) -> None:
    """Up to h U above the plane a body that has e² U² left needs 2 g h U
    of it: by chance of the phase.
    """
    low = (1 + math.sqrt(1 - 0.75 * e**2)) / e**2
    above, below = worst_error(e, (1.01 * low, 0.9 * low), {"contactProcessingThreshold": FAR})
    assert above < 1e-6
    assert below > 0.01
