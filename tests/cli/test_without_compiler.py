"""Commands without a C compiler: the plug-in is left out by name, unless it was asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hcbench.cli import run
from hcbench.engines.mujoco import plugin as mujoco_plugin
from hcbench.engines.pybullet import plugin as pybullet_plugin
from hcbench.reporting.ask import find_plan
from hcbench.sim import registry

TUNE = ["tune", "mujoco", "--alpha", "0.3 s/m", "--timestep", "2 ms", "--speeds", "0.1:2 m/s"]


@pytest.fixture(autouse=True)
def without_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HCBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("CC", "/nonexistent")
    pybullet_plugin.library.cache_clear()
    # MuJoCo unloads no library, so what an earlier test of this process loaded must not count.
    monkeypatch.setattr(mujoco_plugin, "load", mujoco_plugin.load.__wrapped__)


def test_tune_prints_the_settings_and_says_in_a_line_that_the_plug_in_was_left_out(
    capsys: Any,
) -> None:
    assert run([*TUNE, "--corners", "1"]) == 0
    out, err = capsys.readouterr()
    assert "<pair" in out
    assert "--plugin" not in out
    (line,) = [line for line in err.splitlines() if "left out" in line]
    assert "hcbench[plugin]" in line


@pytest.mark.parametrize(
    "words", [[*TUNE, "--plugin"], ["plugin", "mujoco"]], ids=lambda words: words[-1].strip("-")
)
def test_what_asks_for_the_plug_in_exits_with_3(words: list[str], capsys: Any) -> None:
    assert run(words) == 3
    assert "/nonexistent could not be run" in capsys.readouterr().err


def test_a_compiler_that_writes_nothing_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.setenv("CC", "true")
    assert run(["plugin", "mujoco"]) == 3
    assert "true ended without an error and wrote no library" in capsys.readouterr().err


def test_a_report_leaves_out_the_runs_of_the_plug_in() -> None:
    warned: list[str] = []
    _, study = find_plan("steel-1lb", warned.append)
    recipes = {run.recipe for run in study.runs if run.engine in ("mujoco", "pybullet")}
    assert not recipes & {"hunt-crossley", "restitution-law"}
    assert {"impulse", "restitution"} & recipes
    assert [line.partition(". ")[0] for line in warned if "compiled" in line] == [
        f"left out, not compiled: the plug-in of {engine}"
        for engine in ("mujoco", "pybullet")
        if registry.is_there(engine)
    ]
