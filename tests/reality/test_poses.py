"""A user's own toss: from a table of poses to impacts, errors of engines'
settings, and what to type next.
"""

from __future__ import annotations

import csv
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from hcbench.cli import app
from hcbench.reality import cube
from hcbench.reality.impacts import read_impacts
from hcbench.reality.page import build_own
from hcbench.reality.poses import Own, box, box_of, text
from hcbench.system.errors import UserError

SIZE = ["--size", "0.1048 0.1048 0.1048", "--mass", "0.37 kg", "--inertia", "0.00107"]


@pytest.fixture
def toss(tmp_path: Path) -> Path:
    """A measured toss as a user would write it."""
    motion = cube.cases((1,)).motions[0]
    path = tmp_path / "toss.csv"
    rows = np.column_stack([motion.time, motion.position, motion.quaternion])
    np.savetxt(path, rows, delimiter=",", header="t,x,y,z,qw,qx,qy,qz", comments="", fmt="%.7g")
    return path


def run(*args: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["report", "reality", "-j", "1", *args])
    return result.exit_code, result.output + str(result.exception or "")


@pytest.mark.needs_engine("pybullet")
@pytest.mark.spec_plugins
def test_a_toss_tells_its_impacts_and_how_near_each_setting_is(toss: Path, tmp_path: Path) -> None:
    code, output = run("--poses", str(toss), *SIZE, "--out", str(tmp_path / "own"))
    assert code == 0, output
    assert "hcbench tune MODEL" in output
    with (tmp_path / "own" / "scores.csv").open(encoding="utf-8") as file:
        errors = {
            (row["engine"], row["setting"]): float(row["error"]) for row in csv.DictReader(file)
        }
    assert errors["pybullet", "nothing set"] > errors["pybullet", "plug-in constant e"]
    with (tmp_path / "own" / "impacts.csv").open(encoding="utf-8") as file:
        first = next(csv.DictReader(file))
    assert 0.2 < float(first["e"]) < 0.3
    assert 0.15 < float(first["friction"]) < 0.2
    assert (
        (tmp_path / "own" / "pairs.csv")
        .read_text()
        .startswith("trial,speed [m/s],restitution,u_rest")
    )


def test_a_box_of_mjcf_has_the_size_mass_and_inertia_that_are_written(tmp_path: Path) -> None:
    path = tmp_path / "box.xml"
    inertial = '<inertial pos="0 0 0" mass="0.37" diaginertia="0.001 0.002 0.003"/>'
    geom = '<geom type="box" size="0.05 0.06 0.07"/>'
    path.write_text(f"<mujoco><worldbody><body>{inertial}{geom}</body></worldbody></mujoco>")
    assert box_of(path) == box((0.1, 0.12, 0.14), 0.37, (0.001, 0.002, 0.003))
    path.write_text(f"<mujoco><worldbody><body>{geom}</body></worldbody></mujoco>")
    assert box_of(path).mass == pytest.approx(1.68)
    path.write_text("<mujoco/>")
    with pytest.raises(UserError, match="no body with a geom of type box"):
        box_of(path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("qw", "q"), "these columns"),
        (lambda text: "\n".join(text.splitlines()[:5]), "frames"),
        (lambda text: text.replace(",0.", ",3."), "rotation"),
        (lambda text: "\n".join([text.splitlines()[0], *text.splitlines()[40:]]), "free flight"),
    ],
)
def test_a_table_that_is_no_toss_is_refused(toss: Path, change: object, said: str) -> None:
    toss.write_text(change(toss.read_text()))  # type: ignore[operator]
    code, output = run("--poses", str(toss), *SIZE)
    assert code != 0
    assert said in output


@pytest.mark.parametrize("count", [0, 2, 3])
def test_the_next_command_is_one_that_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    """`hcbench fit` refuses one or two impacts; a folder's name may have a blank."""
    tosses = cube.cases((1,))
    sure = replace(
        read_impacts(tosses.body, tosses.motions)[0], u_e=0.01, frames_after=1000, second=1.0
    )
    impacts = [replace(sure, speed_in=0.5 + 0.1 * i) for i in range(count)]
    assert all(impact.good for impact in impacts)
    folder = tmp_path / "my report"
    own = Own(tosses, impacts, [])
    build_own(own, folder)
    monkeypatch.chdir(tmp_path)
    printed = list(text(own, Path("my report")))
    commands = [shlex.split(line)[1:] for line in printed if line.startswith("  hcbench fit")]
    assert len(commands) == (count >= 3)
    for command in commands:
        assert CliRunner().invoke(app, command).exit_code == 0


def test_a_box_needs_its_size() -> None:
    code, output = run("--poses", str(cube.SHIPPED))
    assert code != 0
    assert "--size" in output


def test_options_of_the_study_are_refused_with_another() -> None:
    result = CliRunner().invoke(app, ["report", "field", "--part", "4"])
    assert result.exit_code != 0
    assert "--part" in result.output + str(result.exception)


def test_an_unknown_set_is_refused() -> None:
    code, output = run("--sets", "cube,ball2")
    assert code != 0
    assert "ball2" in output


def test_the_held_out_part_needs_the_original_data() -> None:
    code, output = run("--sets", "cube", "--part", "4")
    assert code != 0
    assert "contact-nets" in output
