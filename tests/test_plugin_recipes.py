"""The plug-ins as settings: what they reach, in both engines, at speeds and phases nobody looked at."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hcbench.cli import run as run_command
from hcbench.errors import SettingError, UserError
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import LAWS, PublishedLaw
from hcbench.scene import load_scene
from hcbench.sim import registry
from hcbench.tune.constant import minimax_constant
from hcbench.tune.evaluate import Evaluation, evaluate
from hcbench.tune.target import Target
from hcbench.workers import call

SCENE = load_scene("steel-plane")
ALPHAS = (0.002, 0.016)


def verdict(recipe: str, alpha: float, timestep: float) -> Evaluation:
    law = HuntCrossley(SCENE.stiffness, alpha / 0.0254, SCENE.exponent)
    target = Target(law, SCENE.mass, timestep, 0.0254, 0.508)
    setting = registry.recipe(recipe)(target)
    return evaluate(registry.engine(setting.engine), SCENE, setting, target)


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
def test_the_restitution_law_is_exact_at_any_step(engine: str, alpha: float, timestep: float) -> None:
    found = verdict(f"{engine}.restitution-law", alpha, timestep)
    assert found.failed == 0
    assert found.max_error < 1e-12


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_a_step_that_does_not_resolve_the_contact_is_refused_before_anything_runs(engine: str) -> None:
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


@pytest.mark.parametrize(("engine", "instead"), [("mujoco", "impulse"), ("pybullet", "restitution")])
def test_laws_that_came_after_refuse_what_they_have_no_sense_for(engine: str, instead: str) -> None:
    recipe = registry.recipe(f"{engine}.flores")
    law, mass = HuntCrossley(SCENE.stiffness, 0.0), SCENE.mass
    with pytest.raises(UserError, match="infinite at e = 0"):
        recipe(Target(law, mass, 1e-6, 0.1, 0.5, "points", ((0.1, 0.0),)))
    with pytest.raises(SettingError, match=f"timestep: 0.001 s.*`{instead}`"):
        recipe(Target(law, mass, 1e-3, 0.1, 0.5, "points", ((0.1, 0.8),)))


@pytest.mark.parametrize(
    ("recipe", "timestep", "error"), [("hunt-crossley", 1e-5, 2e-6), ("restitution-law", 1e-3, 1e-12)]
)
def test_a_script_of_pybullets_plug_in_runs_by_itself(recipe: str, timestep: float, error: float) -> None:
    target = Target(HuntCrossley(SCENE.stiffness, 0.3), SCENE.mass, timestep, 0.0254, 0.508)
    text = registry.engine("pybullet").script(SCENE, registry.recipe(f"pybullet.{recipe}")(target))
    assert "import pybullet\n" in text
    assert "hcbench." not in text
    run = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    pairs = np.array([line.split() for line in run.stdout.splitlines() if line[0] == "0"], dtype=float)
    assert len(pairs) == 6
    assert pairs[:, 1] == pytest.approx(closed_form.restitution(0.3, pairs[:, 0]), abs=error)


def test_the_path_of_pybullets_plug_in_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["plugin", "pybullet"]) == 0
    assert Path(capsys.readouterr().out.strip()).is_file()
    assert run_command(["plugin", "pybullet", "--install"]) == 2
    assert "loadPlugin(path)" in capsys.readouterr().err


def _run_beside_another_client() -> float:
    """The error of e in a client that is not the process's first; in the worker."""
    from hcbench.engines.pybullet import world
    from hcbench.engines.pybullet.backend import BulletClient

    other = BulletClient.direct()
    world.client.cache_clear()
    try:
        return verdict("pybullet.restitution-law", 0.008, 1e-3).max_error
    finally:
        world.client().disconnect()
        world.client.cache_clear()
        other.disconnect()


def test_the_plug_in_acts_in_the_client_of_its_world() -> None:
    assert call(_run_beside_another_client, limit=60) < 1e-12
