"""The plug-ins as settings: what they reach, in both engines, at
speeds and phases nobody looked at.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hcbench.cli import run as run_command
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import LAWS, PublishedLaw
from hcbench.measuring import measure
from hcbench.recipes.target import Target, minimax_constant
from hcbench.sim import registry
from hcbench.system.errors import SettingError, UserError
from hcbench.terms.impact import Launch
from hcbench.terms.scene import Scene, load_scene
from hcbench.terms.setting import Setting
from hcbench.tuning.evaluate import Evaluation, evaluate
from hcbench.workers import call

SCENE = load_scene("steel-plane")
ALPHAS = (0.002, 0.016)
MODEL = """<mujoco><option timestep="0.002" integrator="{integrator}" gravity="0 0 {gravity}"/>
<extension><plugin plugin="hcbench.restitution"><instance name="bounce">
  <config key="body1" value="ball"/><config key="body2" value="world"/><config key="alpha" value="0.315"/>
</instance></plugin></extension><worldbody><geom name="plate" type="plane" size="1 1 1"/>
<body name="ball" pos="0 0 .2"><freejoint/><geom name="ball" size=".05" mass="1"/></body></worldbody>
</mujoco>"""


def verdict(
    recipe: str, alpha: float, timestep: float, speed_min: float = 0.0254, scene: Scene = SCENE
) -> Evaluation:
    law = HuntCrossley(scene.stiffness, alpha / 0.0254, scene.exponent)
    target = Target(law, scene.mass, timestep, speed_min, 20 * speed_min, gravity=scene.gravity)
    setting = registry.recipe(recipe)(target)
    return evaluate(registry.engine(setting.engine), scene, setting, target)


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize(
    ("timestep", "error", "loop"), [(1e-6, 2e-9, 1e-4), (1e-5, 5e-7, 0.005), (2e-5, 2e-6, None)]
)
def test_the_force_law_is_the_law(
    engine: str, alpha: float, timestep: float, error: float, loop: float | None
) -> None:
    found = verdict(f"{engine}.hunt-crossley", alpha, timestep)
    assert found.failed == 0
    assert found.max_error < error
    if loop is not None:
        assert found.loop_rms < loop


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
@pytest.mark.parametrize("alpha", ALPHAS)
@pytest.mark.parametrize("timestep", [1e-4, 1e-3, 4e-3])
def test_the_restitution_law_is_exact_at_any_step(
    engine: str, alpha: float, timestep: float
) -> None:
    found = verdict(f"{engine}.restitution-law", alpha, timestep)
    assert found.failed == 0
    assert found.max_error < 1e-12


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
@pytest.mark.parametrize("name", ["steel-plane", "steel-cup"])
@pytest.mark.parametrize("timestep", [1e-4, 1e-3, 1 / 240])
def test_the_restitution_law_is_exact_under_gravity_above_1_6_g_h(
    engine: str, name: str, timestep: float
) -> None:
    scene = replace(load_scene(name), gravity=9.81)
    for alpha in ALPHAS:
        found = verdict(f"{engine}.restitution-law", alpha, timestep, 1.65 * 9.81 * timestep, scene)
        assert found.failed == 0
        assert found.max_error < 1e-9


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
@pytest.mark.parametrize("e", [1.0, 0.9, 0.5, 0.25])
def test_a_constant_e_is_exact_from_the_speed_on_that_the_docs_say(engine: str, e: float) -> None:
    h, g = 4e-3, 9.81
    least = 0.5 / e if engine == "mujoco" else (1 + np.sqrt(1 - 0.75 * e**2)) / e**2
    options = {"law": {"kind": "restitution", "law": "exact", "restitution": e}}
    still: dict[str, Any] = {"ball": {"linearDamping": 0.0, "angularDamping": 0.0}}
    setting = Setting(engine, "constant", h, options | (still if engine == "pybullet" else {}))
    speeds = 1.02 * max(1.6, least) * g * h * np.geomspace(1, 20, 8)
    launches = [
        Launch.touching(float(v), 0.03 + i / 8, h, g, steps_most=5.0)
        for v in speeds
        for i in range(8)
    ]
    scene = replace(SCENE, gravity=g)
    seen = registry.engine(engine).run(scene, setting, launches)
    assert [impact.restitution for impact in seen] == pytest.approx([e] * len(seen), abs=1e-9)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_measure_reads_the_e_of_a_users_model_with_the_plug_in(
    integrator: str, gravity: float
) -> None:
    text = MODEL.format(integrator=integrator, gravity=-gravity)
    found = measure(text, "ball,plate", speeds=[0.1, 0.37, 1.1], phases=4)
    assert len(found.impacts) == 3 * 4
    for impact in found.impacts:
        e = closed_form.restitution(0.315, impact.speed_in)
        assert impact.restitution == pytest.approx(e, abs=1e-9)
    assert "hcbench.restitution" in found.facts.asked_description
    assert not found.causes


def test_measure_refuses_a_models_force_law_by_name() -> None:
    law = 'key="stiffness" value="3.4e10"/><config key="alpha" value="0.315"'
    text = MODEL.format(integrator="Euler", gravity=0).replace(
        "hcbench.restitution", "hcbench.hunt_crossley"
    )
    text = text.replace('key="alpha" value="0.315"', law)
    text = text.replace(
        "</mujoco>", '<contact><exclude body1="world" body2="ball"/></contact></mujoco>'
    )
    with pytest.raises(UserError, match=r"hcbench\.hunt_crossley"):
        measure(text, "ball,plate")


def _measured_with_a_law(
    law: str, timestep: float, gravity: float
) -> tuple[str, list[str], list[Any]]:
    """A live client whose pair the plug-in moves; in the worker."""
    import pybullet as p

    from hcbench.engines.pybullet import plugin

    c = p.connect(p.DIRECT)
    p.setPhysicsEngineParameter(
        fixedTimeStep=timestep, contactBreakingThreshold=0.02, physicsClientId=c
    )
    p.setGravity(0, 0, -gravity, physicsClientId=c)
    sphere = p.createCollisionShape(p.GEOM_SPHERE, radius=0.0254, physicsClientId=c)
    plane = p.createCollisionShape(p.GEOM_PLANE, physicsClientId=c)
    ball = p.createMultiBody(0.45, sphere, basePosition=[0, 0, 0.03], physicsClientId=c)
    plate = p.createMultiBody(0, plane, physicsClientId=c)
    p.changeDynamics(ball, -1, linearDamping=0, angularDamping=0, physicsClientId=c)
    p.executePluginCommand(plugin.load(c), law, [plate, -1, ball, -1], physicsClientId=c)
    try:
        found = measure(c, speeds=[0.1, 0.37, 1.1], phases=4)
        with pytest.raises(UserError, match="along the normal"):
            measure(c, speeds=[0.1], angle=0.5)
    finally:
        p.disconnect(c)
    bounces = [(i.speed_in, i.restitution, i.force_max) for i in found.impacts]
    return found.facts.asked_description, [cause.code for cause in found.causes], bounces


@pytest.mark.needs_engine("pybullet")
@pytest.mark.parametrize(
    ("law", "timestep", "gravity", "error"),
    [
        ("restitution alpha=0.315", 1e-3, 9.81, 1e-12),
        ("restitution alpha=0.315", 1 / 240, 9.81, 1e-12),
        ("hunt_crossley stiffness=3.4e10 alpha=0.315", 1e-6, 0.0, 1e-7),
    ],
)
def test_measure_reads_the_e_of_a_live_client_with_the_plug_in(
    law: str, timestep: float, gravity: float, error: float
) -> None:
    said, causes, bounces = call(_measured_with_a_law, law, timestep, gravity, limit=60)
    assert law in said
    assert not causes
    assert len(bounces) >= 3 * 4
    steel = HuntCrossley(3.4e10, 0.315)
    for speed, e, force in bounces:
        assert e == pytest.approx(closed_form.restitution(0.315, speed), abs=error)
        if gravity == 0:
            assert force == pytest.approx(
                float(closed_form.force_max(steel, 0.45, speed)), rel=1e-3
            )


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_a_step_that_does_not_resolve_the_contact_is_refused_before_anything_runs(
    engine: str,
) -> None:
    with pytest.raises(SettingError, match="restitution-law"):
        verdict(f"{engine}.hunt-crossley", 0.008, 1e-3)


@pytest.mark.parametrize("engine", ["reference", "mujoco", "pybullet"])
@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.slug)
def test_laws_that_came_after_are_asked_for_the_best_constant_of_the_band(
    engine: str, law: PublishedLaw
) -> None:
    recipe = registry.recipe(f"{engine}.{law.slug}")
    target = Target(HuntCrossley(SCENE.stiffness, 0.3), SCENE.mass, 1e-5, 0.0254, 0.508)
    setting = recipe(target)
    options = setting.options.get("law", setting.options)
    assert (setting.engine, setting.name, recipe.engine) == (engine, law.slug, engine)
    assert options["restitution"] == minimax_constant(target)[0]
    assert law.formula in recipe.summary


@pytest.mark.parametrize(
    ("engine", "instead"), [("mujoco", "impulse"), ("pybullet", "restitution")]
)
def test_laws_that_came_after_refuse_what_they_have_no_sense_for(engine: str, instead: str) -> None:
    recipe = registry.recipe(f"{engine}.flores")
    law, mass = HuntCrossley(SCENE.stiffness, 0.0), SCENE.mass
    with pytest.raises(UserError, match="infinite at e = 0"):
        recipe(Target(law, mass, 1e-6, 0.1, 0.5, "points", ((0.1, 0.0),)))
    with pytest.raises(SettingError, match=f"timestep: 0.001 s.*`{instead}`"):
        recipe(Target(law, mass, 1e-3, 0.1, 0.5, "points", ((0.1, 0.8),)))


@pytest.mark.needs_engine("pybullet")
@pytest.mark.parametrize(
    ("recipe", "timestep", "error"),
    [("hunt-crossley", 1e-5, 2e-6), ("restitution-law", 1e-3, 1e-12)],
)
def test_a_script_of_pybullets_plug_in_runs_by_itself(
    recipe: str, timestep: float, error: float
) -> None:
    target = Target(HuntCrossley(SCENE.stiffness, 0.3), SCENE.mass, timestep, 0.0254, 0.508)
    text = registry.engine("pybullet").script(SCENE, registry.recipe(f"pybullet.{recipe}")(target))
    assert "import pybullet\n" in text
    assert "hcbench." not in text
    run = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    pairs = np.array(
        [line.split() for line in run.stdout.splitlines() if line[0] == "0"], dtype=float
    )
    assert len(pairs) == 6
    assert pairs[:, 1] == pytest.approx(closed_form.restitution(0.3, pairs[:, 0]), abs=error)


@pytest.mark.needs_engine("pybullet")
@pytest.mark.usefixtures("with_cache")
def test_the_path_of_pybullets_plug_in_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    command = [sys.executable, "-m", "hcbench", "plugin", "pybullet"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True)
    assert Path(printed.stdout.strip()).is_file()
    assert run_command(["plugin", "pybullet", "--install"]) == 2
    assert "loadPlugin(path)" in capsys.readouterr().err


def _run_beside_another_client() -> float:
    """The error of e in a client that is not the process's first; in the worker."""
    from hcbench.engines.pybullet.backend import BulletClient, client, end_clients

    BulletClient.direct()
    client.cache_clear()
    try:
        return verdict("pybullet.restitution-law", 0.008, 1e-3).max_error
    finally:
        end_clients()


@pytest.mark.needs_engine("pybullet")
def test_the_plug_in_acts_in_the_client_of_its_world() -> None:
    assert call(_run_beside_another_client, limit=60) < 1e-12
