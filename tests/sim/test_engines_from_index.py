"""Engines as the package index has them, each version in an environment
of its own: make test-engines.
"""

from __future__ import annotations

import os

import pytest

from hcbench import environments, load_scene
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.sim import install, registry
from hcbench.system.errors import UserError
from hcbench.testing import EngineConformance
from hcbench.tuning.evaluate import evaluate

FOLDER = os.environ.get("HCBENCH_ENGINES", "")  # where `make test-engines` added them
pytestmark = pytest.mark.skipif(not FOLDER, reason="downloads; make test-engines")
SCENE = load_scene("steel-plane")
LAW = HuntCrossley(SCENE.stiffness, 0.315, SCENE.exponent)
TARGET = Target(LAW, SCENE.mass, 1e-3, 0.1, 0.5, gravity=0.0)

if FOLDER:
    for _name in install.names():
        if not registry.version_beside(_name):  # else it is one of `make test`
            _title = f"Test{_name.title()}"
            globals()[_title] = type(_title, (EngineConformance,), {"engine": _name})


def test_every_engine_that_has_a_package_is_there() -> None:
    assert set(install.names()) == {made.engine for made in environments.installed()}


def test_two_versions_of_an_engine_bounce_alike_and_each_says_its_own() -> None:
    errors = {}
    for name in ("mujoco@3.3.0", "mujoco@3.6.0"):
        engine = registry.engine(name)
        (impulse,) = (recipe for recipe in engine.recipes() if recipe.name == "impulse")
        errors[engine.version()] = evaluate(engine, SCENE, impulse(TARGET), TARGET).max_error
    assert list(errors) == ["3.3.0", "3.6.0"]
    assert errors["3.3.0"] == pytest.approx(errors["3.6.0"], abs=1e-9)


def test_a_version_that_is_not_there_is_said_so() -> None:
    with pytest.raises(UserError, match="no version of mujoco==99"):
        install.add("mujoco@99")


def test_another_python_of_this_machine_runs_the_same(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HCBENCH_DATA", str(tmp_path_factory.mktemp("data")))
    for version in environments.interpreters():
        if not version.startswith("3.11."):
            made = install.add("mujoco@3.3.0", version)
            assert made.python == version
            assert registry.engine("mujoco@3.3.0").version() == "3.3.0"
            return
    pytest.skip("there is one Python only")
