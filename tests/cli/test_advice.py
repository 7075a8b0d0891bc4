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
from hcbench.cli.tune import _user_model
from hcbench.cli.tune_model import _cure
from hcbench.terms import units

if TYPE_CHECKING:
    from hcbench.tuning.tuned_model import TunedModel

GOOD = str(Path(__file__).parents[2] / "examples" / "good.xml")


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
@pytest.mark.parametrize("step", [2e-3, 1.0 / 240.0])
def test_the_step_to_try_is_a_quarter_of_the_models(engine: str, step: float) -> None:
    facts = SimpleNamespace(engine=engine, timestep=step, pair=("ball", "plate"), in_text=())
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


def printed_next(out: str) -> tuple[str, str]:
    """(title, command) at the end of an output."""
    title, _, line = out.rpartition("\nnext")[2].partition(":\n")
    # A long path begins a line of its own.
    return " ".join(f"next{title}:".split()), " ".join(line.replace("\\\n", " ").split())


@pytest.mark.usefixtures("tuned_once")
def test_the_next_line_of_tune_says_where_the_lines_go_and_keeps_the_pose(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Without --write-model it named the untuned file, and never the pose."""
    posed = tmp_path / "posed.xml"
    key = '<keyframe><key name="up" qpos="0 0 0.5 1 0 0 0"/></keyframe></mujoco>'
    posed.write_text(Path(GOOD).read_text(encoding="utf-8").replace("</mujoco>", key))
    asked = ["--pair=ball,plate", "--restitution=0.5", "--speeds=1 m/s", "--key=up"]
    assert run(["tune", str(posed), *asked, "--gravity=3.7"]) == 0
    title, line = printed_next(capsys.readouterr().out)
    assert title == f"next, with these lines in {posed}:"
    assert line.startswith(f"hcbench check {posed} --pair ball,plate --key up --restitution 0.5 ")
    written = tmp_path / "tuned.xml"
    assert run(["tune", str(posed), *asked, "--gravity=3.7", f"--write-model={written}"]) == 0
    title, line = printed_next(capsys.readouterr().out)
    assert title == "next:"
    # The gate of what was promised, in the gravity that was asked: it stands in the file.
    assert "--max-error 0.05" in line and "--gravity" not in line
    assert run(shlex.split(line)[1:]) == 0
    assert "gravity 3.7 m/s^2" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("engine", "model"),
    [
        ("mujoco", "my.xml"),
        ("mjx", "my.xml --engine mjx"),
        ("pybullet", "--python FILE.py:FUNCTION"),
        ("exudyn", ""),
    ],
)
def test_the_text_of_an_engine_is_measured_in_a_model_that_it_opens(
    engine: str, model: str
) -> None:
    assert _user_model(engine) == model
