"""Advice on what to type next: of `measure`, and of `tune` on a model that no setting brings to its
target.
"""

from __future__ import annotations

import shlex
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from hcbench.cli import run
from hcbench.cli.tune_model import _cure
from hcbench.terms import units

if TYPE_CHECKING:
    from hcbench.tuning.tuned_model import TunedModel

GOOD = str(Path(__file__).parents[2] / "examples" / "good.xml")


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
@pytest.mark.parametrize("step", [2e-3, 1.0 / 240.0])
def test_the_step_to_try_is_a_quarter_of_the_models(engine: str, step: float) -> None:
    facts = SimpleNamespace(engine=engine, timestep=step, pair=("ball", "plate"))
    advice = _cure(cast("TunedModel", SimpleNamespace(pairs=[SimpleNamespace(facts=facts)])))
    words = advice.rpartition("--timestep ")[2]
    assert units.parse(words, "timestep") == pytest.approx(step / 4.0)


def test_a_bounce_with_a_cause_to_be_wrong_is_tuned_next_and_no_baseline(
    capsys: pytest.CaptureFixture[str],
) -> None:
    robot = str(Path(GOOD).with_name("quadruped.xml"))
    assert run(["measure", robot, "--pair=left_front_foot,floor", "--speeds=1 m/s"]) == 0
    out = capsys.readouterr().out
    assert "default-solref: " in out
    line = out.partition("next:\n")[2].split()
    assert line[:2] == ["hcbench", "tune"] and "--write-baseline" not in line


def test_the_next_line_of_measure_is_of_the_same_launches(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Once the line dropped the step, and its baseline was of another one."""
    launches = ["--speeds=1 m/s", "--phases=1", "--timestep=1/8000 s", "--no-actuators"]
    assert run(["measure", GOOD, "--pair=ball,plate", *launches]) == 0
    line = " ".join(capsys.readouterr().out.partition("next:\n")[2].replace("\\\n", " ").split())
    typed = "--speeds '1 m/s' --phases 1 --timestep '1/8000 s' --no-actuators"
    assert line == (
        f"hcbench check {shlex.quote(GOOD)} --pair ball,plate {typed} --write-baseline bounce.json"
    )
