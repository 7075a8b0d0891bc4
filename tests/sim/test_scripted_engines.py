"""Engines that a script runs: what users are handed is what was measured, and says what it lacks."""

from __future__ import annotations

import ast
import contextlib
import io
import re
import subprocess
import sys
import warnings
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hcbench.recipes.recipe import Recipe, Role
from hcbench.sim import registry
from hcbench.sim.backend import Backend, UntriedVersionWarning
from hcbench.sim.scripted import ScriptedEngine, require_motion_at
from hcbench.system.errors import EngineFailed, EngineMissing, SettingError
from hcbench.terms.impact import Launch, Status
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Setting
from hcbench.testing import setting_for

PLANE = load_scene("steel-plane")


def test_a_ball_at_rest_is_refused_without_a_step_that_would_help() -> None:
    with pytest.raises(SettingError, match=r"at 0 m/s the ball moves 0 m; .*Launch at a speed"):
        require_motion_at(0.05, 1e-3, 0.0, 32)


@pytest.mark.parametrize("fastest", [0.11, 0.2, 0.33, 0.7])
def test_a_step_that_is_advised_is_taken(fastest: float) -> None:
    with pytest.raises(SettingError) as caught:
        require_motion_at(0.05, 1e-9, fastest, 32)
    _, advised, *_ = caught.value.advice.split()
    require_motion_at(0.05, float(advised), fastest, 32)


SCRIPTED = [name for name in registry.names() if isinstance(registry.engine(name), ScriptedEngine)]
RECIPES = [f"{name}.{recipe}" for name in SCRIPTED for recipe in registry.recipes(name)]


def prints_bounces(recipe: Recipe) -> bool:
    """Without a rebound the script waits for long; defaults part in steps
    that float32 hardly tells apart.
    """
    in_float32 = registry.engine(recipe.engine).bits == 32 and recipe.role is Role.STOCK
    return recipe.ends is None and not in_float32


@pytest.mark.needs_engine
@pytest.mark.parametrize(
    "recipe", [name for name in RECIPES if prints_bounces(registry.recipe(name))]
)
def test_the_script_prints_the_restitution_that_was_measured(recipe: str) -> None:
    setting = setting_for(recipe, "steel-plane")
    engine: Any = registry.engine(setting.engine)
    impacts = engine.run(
        PLANE, setting, [Launch(speed, 0.5) for speed in (0.05, 0.1, 0.2, 0.3, 0.4, 0.5)]
    )
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the engine's own, such as of a graphics library
        exec(engine.script(PLANE, setting), {"__name__": "__main__"})
    numbers = [line.split() for line in printed.getvalue().splitlines() if line.startswith("0.")]
    told = np.array(
        numbers, dtype=float
    )  # others are the engine's own, such as of what it compiles
    assert told[:, 0].tolist() == [impact.launch.speed for impact in impacts]
    assert told[:, 1] == pytest.approx(
        [i.restitution for i in impacts], abs=1e-6 if engine.bits == 32 else 1e-9
    )


@pytest.mark.parametrize("recipe", [each for each in RECIPES if each.startswith("newton.")])
def test_the_numbers_of_what_is_pasted_stand_in_newtons_script(recipe: str) -> None:
    """Newton's text is for shapes of a user's own; the ball of the script has a mass of its own."""
    setting = setting_for(recipe, "steel-plane")
    engine: Any = registry.engine(setting.engine)
    number = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
    pasted = number.findall(engine.snippet(setting, "plane"))
    assert pasted or recipe in ("newton.stock", "newton.stock-mujoco", "newton.hunt-crossley")
    assert set(pasted) <= set(number.findall(engine.script(PLANE, setting)))


@pytest.mark.parametrize("recipe", [each for each in RECIPES if not each.startswith("newton.")])
def test_what_is_pasted_stands_in_the_script(recipe: str) -> None:
    setting = setting_for(recipe, "steel-plane")
    engine: Any = registry.engine(setting.engine)
    script = [line.strip() for line in engine.script(PLANE, setting).splitlines()]
    pasted = engine.snippet(setting, "plane").splitlines()
    assert bool(pasted) is bool(setting.options)
    for line in map(str.strip, pasted):
        assert line in script or line.replace(repr(setting.timestep), "timestep") in script


@pytest.mark.parametrize("name", SCRIPTED)
def test_bodies_are_not_sent_obliquely(name: str) -> None:
    setting = setting_for(f"{name}.stock", "steel-plane")
    with pytest.raises(SettingError, match="launch: oblique"):
        registry.engine(name).run(PLANE, setting, [Launch(0.2, slip=(0.1, 0.0))])


@pytest.mark.parametrize("name", SCRIPTED)
def test_unknown_options_are_named(name: str) -> None:
    with pytest.raises(SettingError, match=f"{name} option 'bounce'"):
        registry.engine(name).script(PLANE, Setting(name, "mine", 1e-3, {"bounce": 1}))


def test_a_missing_engine_is_one_line_with_the_command() -> None:
    with pytest.raises(
        EngineMissing, match=r"^engine 'sled': not installed.*pip install no-such-package$"
    ):
        Backend("sled", "no-such-package", "1.0", "1.0").version()


def test_an_untested_version_is_named() -> None:
    here = metadata.version("numpy")
    assert Backend("sled", "numpy", "1.0", "999").untried(here) == ""
    assert Backend("sled", "numpy", here, here).untried(here) == ""
    untried = Backend("sled", "numpy", "0.1", "0.2")
    assert untried.untried(here) == f"numpy {here} was never tried with hcbench; 0.1 ... 0.2 was"
    with (
        pytest.raises(EngineFailed, match=r"AttributeError: gone.*0\.1"),
        untried.explained_errors(),
    ):
        raise AttributeError("gone")
    with pytest.raises(AttributeError), Backend("sled", "numpy", here, here).explained_errors():
        raise AttributeError("ours")


@pytest.mark.needs_engine
@pytest.mark.parametrize("name", SCRIPTED)
def test_a_run_with_an_untested_version_warns(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from hcbench.sim import simulate

    engine: Any = registry.engine(name)
    monkeypatch.setattr(
        type(engine), "backend", Backend(name, engine.backend.package, "0.1", "0.1")
    )
    simulate.require_installed.cache_clear()
    with pytest.warns(UntriedVersionWarning, match="was never tried"):
        engine.run(PLANE, setting_for(f"{name}.stock", "steel-plane"), [Launch(0.4)])
    simulate.require_installed.cache_clear()


def test_an_engine_is_a_file_of_few_statements() -> None:
    """Comments, docstrings and the breaking of lines do not count."""
    for name in SCRIPTED:
        module: Any = sys.modules[type(registry.engine(name)).__module__]
        lines = len(ast.unparse(_without_docstrings(Path(module.__file__))).splitlines())
        assert lines <= 120, f"{name}: {lines} lines"


def _without_docstrings(path: Path) -> ast.Module:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            node.body = node.body[1:]
    return tree


@pytest.mark.needs_engine("rapier")
def test_the_command_line_says_so_in_one_line() -> None:
    code = (
        "import sys; from hcbench import cli; from hcbench.engines.rapier import RapierEngine;"
        "from hcbench.sim.backend import Backend;"
        "RapierEngine.backend = Backend('rapier', 'rapier3d', '0.1', '0.2');"
        "sys.argv = ['hcbench', 'tune', 'rapier', '--alpha', '0.3', '--timestep', '1 ms', '--gravity', '0'];"
        "cli.main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    (line,) = done.stderr.splitlines()
    assert line.startswith("hcbench: rapier3d 0.3")
    assert line.endswith("was never tried with hcbench; 0.1 ... 0.2 was")


@pytest.mark.needs_engine
@pytest.mark.parametrize("name", SCRIPTED)
def test_a_package_that_does_not_load_is_one_line(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine: Any = registry.engine(name)
    setting = setting_for(f"{name}.stock", "steel-plane")
    modules = re.findall(
        r"^(?:import|from) (\w+)", engine.lines(engine.read(setting), PLANE), re.MULTILINE
    )
    for module in {"pydrake.all", *modules} - {"numpy", "logging", "math"}:
        monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr(type(engine), "own_process", False)
    with pytest.raises(EngineMissing, match=f"engine '{name}': cannot be imported.*Try: pip"):
        engine.run(PLANE, setting, [Launch(0.4)])


@pytest.mark.needs_engine("rapier")
def test_an_engine_that_gives_up_is_a_record_with_its_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    engine: Any = registry.engine("rapier")
    broken = _RESTING.format(lines=engine.lines(engine.table(), PLANE))
    monkeypatch.setattr(type(engine), "lines", lambda *_: broken)
    (impact,) = engine.run(PLANE, setting_for("rapier.stock", "steel-plane"), [Launch(0.4)])
    assert impact.status is Status.DIVERGED
    assert "the step is too small" in impact.reason


@pytest.mark.needs_engine("rapier")
def test_an_engine_that_gave_up_takes_no_further_step(monkeypatch: pytest.MonkeyPatch) -> None:
    engine: Any = registry.engine("rapier")
    broken = _FAILS_ONCE.format(lines=engine.lines(engine.table(), PLANE))
    monkeypatch.setattr(type(engine), "lines", lambda *_: broken)
    world = engine.load(PLANE, setting_for("rapier.stock", "steel-plane"), 0.4)
    with contextlib.closing(world.release([Launch(0.4)])) as simulation:
        record = simulation.advance(4)
    assert np.isnan(record.rate[0]).tolist() == [False, True, True, True]


_FAILS_ONCE = """{lines}
steps = iter([False, True, True])

def step():
    if next(steps):
        return 1.0, 1.0
    raise RuntimeError("the step is too small")
"""
_RESTING = """{lines}
def step():
    raise RuntimeError("the step is too small")
"""
