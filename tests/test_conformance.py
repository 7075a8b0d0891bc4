"""What every engine and every setting must keep, ours and plug-ins' alike."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from hcbench.errors import EngineMissing, SettingError
from hcbench.impact import Impact, Launch, Status
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import LAWS, PrescribedRestitutionLaw
from hcbench.scene import Scene, load_scene, scene_names
from hcbench.scoring import loop_area
from hcbench.setting import Setting
from hcbench.sim import registry
from hcbench.tune.recipe import Recipe, Role
from hcbench.tune.target import Target

RECIPES = registry.recipe_names()
SCENES = scene_names()
SPEEDS, PHASES = (0.05, 0.21, 0.47), tuple((i + 0.5) / 8 for i in range(8))
LAUNCHES = tuple(Launch(v, p) for v in SPEEDS for p in PHASES)


def with_role(*roles: Role, native: bool | None = None, one_step: bool | None = None) -> list[str]:
    """Names of recipes that have one of the roles, and the properties that are given."""
    found = [(name, registry.recipe(name)) for name in RECIPES]
    return [
        name
        for name, recipe in found
        if recipe.role in roles and native in (None, recipe.native) and one_step in (None, recipe.one_step)
    ]


def timestep_of(recipe: Recipe) -> float:
    if recipe.role is Role.STOCK or recipe.one_step:
        return 1e-3
    # Published laws are many, and the same lines for all: coarser is enough.
    return 4e-6 if recipe.role is Role.CONSTANT_E and not recipe.native else 1e-6


@cache
def scene_of(name: str) -> Scene:
    return load_scene(name)


@cache
def setting_of(recipe: str, scene: str) -> Setting:
    found, case = registry.recipe(recipe), scene_of(scene)
    law = HuntCrossley(case.stiffness, 0.008 / 0.0254, case.exponent)
    return found(Target(law, case.mass, timestep_of(found), 0.0254, 0.508))


@cache
def impacts_of(recipe: str, scene: str) -> tuple[Impact, ...]:
    setting, case = setting_of(recipe, scene), scene_of(scene)
    engine = registry.engine(setting.engine)
    if case.form not in registry.recipe(recipe).forms:
        with pytest.raises(SettingError, match=case.form):
            engine.run(case, setting, LAUNCHES)
        pytest.skip("refused for this form of scene, with the reason")
    try:
        return tuple(engine.run(case, setting, LAUNCHES))
    except EngineMissing as error:
        pytest.skip(str(error))  # the installed version is too old for it, and says so


every = pytest.mark.parametrize(("recipe", "scene"), [(r, s) for r in RECIPES for s in SCENES])


@every
def test_an_impact_for_each_launch_in_order(recipe: str, scene: str) -> None:
    impacts = impacts_of(recipe, scene)
    assert [i.launch for i in impacts] == list(LAUNCHES)
    assert all(i.status in (Status.PARTED, Status.RESTED) for i in impacts), {i.reason for i in impacts}


@every
def test_no_bounce_gains_energy(recipe: str, scene: str) -> None:
    assert all(0 <= i.restitution <= 1 + 1e-9 for i in impacts_of(recipe, scene))


@every
def test_the_speed_in_is_the_speed_launched(recipe: str, scene: str) -> None:
    # An engine as it comes may damp the flight.
    slowest = 0.99 if registry.recipe(recipe).role is Role.STOCK else 1 - 1e-9
    assert all(slowest < i.speed_in / i.launch.speed < 1 + 1e-9 for i in impacts_of(recipe, scene))


@every
def test_what_the_loop_loses_is_what_the_body_loses(recipe: str, scene: str) -> None:
    mass = scene_of(scene).mass
    resolved = [(i, i.loop) for i in impacts_of(recipe, scene) if i.loop is not None and i.samples >= 50]
    if not resolved or registry.recipe(recipe).role is Role.STOCK:
        pytest.skip("its loops are not resolved")
    for impact, loop in resolved:
        lost = 0.5 * mass * impact.speed_in**2 * (1 - impact.restitution**2)
        assert loop_area(loop) == pytest.approx(lost, rel=0.01)


@every
def test_restitution_hardly_depends_on_the_phase(recipe: str, scene: str) -> None:
    if registry.recipe(recipe).role is Role.STOCK:
        pytest.skip("by luck of the phase: that is what it is here to show")
    for speed in SPEEDS:
        e = [i.restitution for i in impacts_of(recipe, scene) if i.launch.speed == speed]
        assert max(e) - min(e) < 0.005


@every
def test_a_repeated_run_gives_the_same_bits_and_so_does_one_launch_alone(recipe: str, scene: str) -> None:
    before = impacts_of(recipe, scene)
    setting = setting_of(recipe, scene)
    picked = LAUNCHES[3::7]
    again = registry.engine(setting.engine).run(scene_of(scene), setting, picked)
    alone = registry.engine(setting.engine).run(scene_of(scene), setting, picked[-1:])
    for one in (*again, *alone):
        other = before[LAUNCHES.index(one.launch)]
        assert (one.speed_in, one.speed_out, one.samples) == (other.speed_in, other.speed_out, other.samples)
        assert one.loop is not None
        assert other.loop is not None
        assert np.array_equal(one.loop.force, other.loop.force)


@pytest.mark.parametrize("recipe", with_role(*set(Role) - {Role.STOCK}))
def test_a_drop_under_gravity_touches_at_the_speed_of_its_fall(recipe: str) -> None:
    scene = dataclasses.replace(scene_of("steel-plane"), gravity=9.80665)
    setting = setting_of(recipe, "steel-plane")
    height = 1e-4 if setting.timestep < 1e-4 else 1e-2
    try:
        (impact,) = registry.engine(setting.engine).run(scene, setting, [Launch(0.0, height=height)])
    except EngineMissing as error:
        pytest.skip(str(error))
    fall = (2 * 9.80665 * height) ** 0.5
    assert impact.speed_in == pytest.approx(fall, abs=2 * 9.80665 * setting.timestep)


@pytest.mark.parametrize("recipe", with_role(Role.CONSTANT_E, native=True, one_step=True))
def test_one_step_settings_give_the_e_that_was_set_at_every_phase(recipe: str) -> None:
    target = closed_form.restitution(0.008 / 0.0254, np.array([0.0254, 0.508])).mean()
    for impact in impacts_of(recipe, "steel-plane"):
        assert abs(impact.restitution - target) < 1e-12


@pytest.mark.parametrize("recipe", with_role(Role.LAW, Role.LAW_AND_LOOP, native=False))
@pytest.mark.parametrize("scene", SCENES)
def test_plug_ins_give_the_laws_own_restitution(recipe: str, scene: str) -> None:
    for impact in impacts_of(recipe, scene):
        assert abs(impact.restitution - closed_form.restitution(0.008 / 0.0254, impact.speed_in)) < 1e-7


@pytest.mark.parametrize("recipe", with_role(Role.CONSTANT_E, native=True, one_step=False))
def test_spring_dampers_give_the_e_that_was_asked(recipe: str) -> None:
    case = scene_of("steel-plane")
    law = HuntCrossley(case.stiffness, 0.008 / 0.0254)
    setting = registry.recipe(recipe)(Target(law, case.mass, 1e-6, 0.0254, 0.508))
    target = closed_form.restitution(law.alpha, np.array([0.0254, 0.508])).mean()
    e = [i.restitution for i in registry.engine(setting.engine).run(case, setting, LAUNCHES)]
    assert abs(float(np.mean(e)) - target) < 2e-4
    assert max(abs(v - target) for v in e) < 5e-4


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.slug)
@pytest.mark.parametrize("engine", [name for name in registry.names() if "flores" in registry.recipes(name)])
def test_later_laws_deliver_what_follows_from_their_chi_at_every_speed_and_phase(
    engine: str, law: type[PrescribedRestitutionLaw]
) -> None:
    setting = setting_of(f"{engine}.{law.slug}", "steel-plane")
    asked = setting.options.get("law", setting.options)["restitution"]
    found = [i.restitution for s in SCENES for i in impacts_of(f"{engine}.{law.slug}", s)]
    assert len(found) == len(SCENES) * len(LAUNCHES)
    assert np.abs(np.array(found) - float(law.delivered(asked))).max() < (
        1e-13 if engine == "reference" else 5e-8
    )
