"""Engines as the package index has them, each version in an environment of its own: make test-engines."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import pytest

from hcbench import load_scene
from hcbench.environments import make
from hcbench.errors import UserError
from hcbench.impact import Launch
from hcbench.laws.force import HuntCrossley
from hcbench.sim import install, registry
from hcbench.tune.evaluate import evaluate
from hcbench.tune.recipe import Role, first
from hcbench.tune.target import Target

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.skipif("HCBENCH_ENGINES" not in os.environ, reason="downloads; make test-engines")
SCENE = load_scene("steel-plane")
LAW = HuntCrossley(SCENE.stiffness, 0.315, SCENE.exponent)
TARGET = Target(LAW, SCENE.mass, 1e-3, 0.1, 0.5, gravity=0.0)


@pytest.fixture(scope="module", autouse=True)
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    os.environ["HCBENCH_DATA"] = str(folder)
    return folder


@pytest.mark.parametrize("name", [n for n in registry.names() if registry.engine(n).backend is not None])
def test_the_newest_of_each_engine_installs_and_bounces(name: str) -> None:
    made = install.add(name)
    assert registry.engine(made.name).version() == made.version
    recipe = first(registry.engine(made.name).recipes(), Role.CONSTANT_E, "plane")
    if recipe is not None:
        setting = recipe(TARGET)
        (impact,) = registry.engine(made.name).run(SCENE, setting, [Launch(0.4, 0.5)])
        assert impact.restitution == pytest.approx(TARGET.restitution(0.4), abs=0.1)


def test_two_versions_of_an_engine_bounce_alike_and_each_says_its_own() -> None:
    errors = {}
    for name in ("mujoco@3.3.0", "mujoco@3.6.0"):
        install.add(name)
        engine = registry.engine(name)
        (impulse,) = (recipe for recipe in engine.recipes() if recipe.name == "impulse")
        errors[engine.version()] = evaluate(engine, SCENE, impulse(TARGET), TARGET).max_error
    assert list(errors) == ["3.3.0", "3.6.0"]
    assert errors["3.3.0"] == pytest.approx(errors["3.6.0"], abs=1e-9)


def test_a_version_that_is_not_there_is_said_so() -> None:
    with pytest.raises(UserError, match="no version of mujoco==99"):
        install.add("mujoco@99")


def test_another_python_of_this_machine_runs_the_same() -> None:
    for version in make.interpreters():
        if not version.startswith("3.11."):
            made = install.add("mujoco@3.3.0", version)
            assert made.python == version
            assert registry.engine("mujoco@3.3.0").version() == "3.3.0"
            return
    pytest.skip("there is one Python only")
