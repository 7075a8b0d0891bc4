"""Old names of options: one more version takes them, and tells the new one."""

from __future__ import annotations

from pathlib import Path

import pytest

import hcbench as hb
from hcbench.cli import run

ROOT = Path(__file__).parents[2]
MODEL = str(ROOT / "examples" / "good.xml")


@pytest.fixture
def points(tmp_path: Path) -> str:
    """A file of measured pairs that examples/good.xml does not follow."""
    file = tmp_path / "rig.csv"
    file.write_text("speed [m/s],restitution\n0.1,0.5\n1,0.4\n", encoding="utf-8")
    return str(file)


@pytest.mark.parametrize("name", ["pairs", "points"])
def test_pairs_of_check_is_points(
    name: str, points: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["check", MODEL, "--pair=ball,plate", "--speeds=0.5 m/s", f"--{name}={points}"]
    assert run(command) == 1
    assert ("--pairs is now --points" in capsys.readouterr().err) == (name == "pairs")


def test_the_old_name_is_taken_in_python_and_in_files(points: str) -> None:
    asked = {"pair": "ball,plate", "speeds": "0.5 m/s"}
    with pytest.warns(FutureWarning, match="pairs is now points"):
        (old,) = hb.check(MODEL, pairs=points, **asked).outcomes  # type: ignore[call-arg,arg-type]
    (new,) = hb.check(MODEL, points=points, **asked).outcomes  # type: ignore[arg-type]
    assert old.verdict == new.verdict == "failed"


@pytest.mark.parametrize("flag", ["--speed", "--speeds"])
def test_speed_of_law_is_speeds(flag: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["law", "--alpha=0.3", f"{flag}=1 m/s"]) == 0
    said = capsys.readouterr()
    assert "0.768" in said.out and ("--speed is now --speeds" in said.err) == (flag == "--speed")


@pytest.mark.parametrize("value", ["0.05", "5%", "5 %"])
def test_a_largest_error_may_be_in_per_cent(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["check", MODEL, "--pair=ball,plate", "--speeds=0.5 m/s", "--restitution=0.5"]
    assert run([*command, f"--max-error={value}"]) == 1
    assert "limit 0.05" in capsys.readouterr().out


def test_options_of_reality_are_in_the_help_of_that_study_alone(
    capsys: pytest.CaptureFixture[str],
) -> None:
    own = ("--sets", "--part", "--poses", "--inertia")
    assert run(["report", "--help"]) == 0
    plain = capsys.readouterr().out
    assert "hcbench report reality --help" in plain and not any(flag in plain for flag in own)
    assert run(["report", "reality", "--help"]) == 0
    assert all(flag in capsys.readouterr().out for flag in own[:1])


def test_a_pair_that_is_not_there_is_answered_by_what_can_touch_the_other(
    capsys: pytest.CaptureFixture[str],
) -> None:
    robot = str(ROOT / "examples" / "quadruped.xml")
    assert run(["measure", robot, "--pair=foot,floor"]) == 2
    said = capsys.readouterr().err
    assert "one of: left_front_foot, right_front_foot" in said and "'floor'" not in said


def test_measure_without_a_pair_lists_what_can_meet(capsys: pytest.CaptureFixture[str]) -> None:
    robot = str(ROOT / "examples" / "quadruped.xml")
    assert run(["measure", robot]) == 0
    new = capsys.readouterr()
    assert "left_hind_foot,floor" in new.out and not new.err
    assert new.out.endswith(f"next:\n  hcbench measure {robot} --pair left_front_foot,floor\n")
    assert run(["pairs", robot]) == 0
    old = capsys.readouterr()
    assert old.out == new.out and "pairs is now measure, without --pair" in old.err


def test_the_pair_to_measure_next_is_measured_as_it_was_asked_for(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The line dropped the pose: the model was measured in another one than that of the list."""
    robot = str(ROOT / "examples" / "quadruped.xml")
    assert run(["measure", robot, "--engine=mujoco", "--timestep=1 ms"]) == 0
    line = " ".join(capsys.readouterr().out.partition("next:\n")[2].replace("\\\n", " ").split())
    asked = "--pair left_front_foot,floor --timestep '1 ms' --engine mujoco"
    assert line == f"hcbench measure {robot} {asked}"


def test_a_target_asks_for_a_pair(capsys: pytest.CaptureFixture[str]) -> None:
    robot = str(ROOT / "examples" / "quadruped.xml")
    assert run(["measure", robot, "--alpha=0.3"]) == 2
    assert "`hcbench measure` without --pair lists all" in capsys.readouterr().err
