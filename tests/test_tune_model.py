"""A pair tuned in its own model: what is written compiles, keeps the rest, and does what tune prints."""

import json
from pathlib import Path
from typing import Any

import pytest

from hcbench.cli import run
from hcbench.measure import measure

mujoco = pytest.importorskip("mujoco")

ROBOT = """<mujoco><option timestep="2e-3" integrator="implicitfast"/>
  <default><default class="pads"><geom friction="0.9 .01 .001" condim="{condim}"/></default></default>
  <worldbody><geom name="floor" type="plane" size="3 3 .1" class="pads"/>
  <body name="trunk" pos="0 0 1"><joint type="slide" axis="0 0 1"/><geom type="box" size=".2 .1 .1"/>
  <body name="foot" pos="0 0 -.4"><geom name="sole" type="sphere" size=".05" class="pads"/></body></body>
  </worldbody></mujoco>"""
BALL = """<mujoco><option timestep="2e-3"/><worldbody><geom name="floor" type="plane" size="3 3 .1"/>
  <body name="ball" pos="0 0 1"><freejoint/><geom size=".1" {condim}/></body>{other}</worldbody></mujoco>"""
OTHER = '<body name="second" pos="0 0 2"><freejoint/><geom name="second" size=".1"/></body>'


def tuned(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, Any]:
    out = path.with_name("tuned.xml")
    assert run(["tune", str(path), *options, "--write-model", str(out), "--json"]) == 0
    record: dict[str, Any] = json.loads(capsys.readouterr().out)
    return record


@pytest.mark.parametrize(
    ("text", "pair", "e", "limit"),
    [
        (ROBOT.format(condim=1), "foot,floor", 0.8, 0.1),
        (ROBOT.format(condim=3), "foot,floor", 0.5, 0.2),
        (ROBOT.format(condim=3), "foot,floor", 0.0, 0.02),
        (BALL.format(condim="", other=""), "ball,floor", 0.7, 0.2),
        (BALL.format(condim="", other=OTHER), "second,ball", 0.7, 0.1),
    ],
)
def test_the_written_model_bounces_as_tune_prints(
    text: str, pair: str, e: float, limit: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "robot.xml"
    path.write_text(text)
    record = tuned(path, capsys, "--pair", pair, "--restitution", str(e))
    assert record["max_error"] < limit
    found = measure(tmp_path / "tuned.xml", pair, speeds=[0.15, 0.6, 1.7], phases=5, diagnose=False)
    slack = 0.02 + record["max_error"]
    assert all(i.restitution == pytest.approx(e, abs=slack) for i in found.impacts)
    before, after = (mujoco.MjModel.from_xml_path(str(p)) for p in (path, tmp_path / "tuned.xml"))
    assert (before.nbody, before.ngeom, before.nq) == (after.nbody, after.ngeom, after.nq)
    assert after.body_mass == pytest.approx(before.body_mass)
    assert before.opt.timestep == after.opt.timestep
    assert before.opt.integrator == after.opt.integrator
    data = mujoco.MjData(after)
    assert {int(dim) for dim in after.pair_dim} == {int(before.geom_condim[0])}
    mujoco.mj_step(after, data)


def test_two_bodies_of_one_size_have_half_the_mass_and_are_told_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "balls.xml").write_text(BALL.format(condim="", other=OTHER))
    record = tuned(tmp_path / "balls.xml", capsys, "--pair", "second,ball", "--restitution", "0.7")
    mass = 4 / 3 * 3.14159265 * 0.1**3 * 1000
    assert record["effective_mass_kg"] == pytest.approx(mass / 2, rel=1e-6)
    assert any("Both bodies move" in note for note in record["notes"])
    assert any('has no name: give it name="geom_1"' in note for note in record["notes"])


def test_what_changes_for_the_whole_model_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.xml").write_text(ROBOT.format(condim=3))
    record = tuned(tmp_path / "robot.xml", capsys, "--pair", "foot,floor", "--restitution", "0.5")
    assert 'cone="elliptic"' in record["paste"]
    assert any("whole model" in note for note in record["notes"])
    assert 'friction="0.9 0.9 0.01 0.001 0.001"' in record["paste"]
    assert run(["tune", str(tmp_path / "robot.xml"), "--restitution", "0.5"]) == 2
    assert "hcbench pairs" in capsys.readouterr().err


def test_a_bullet_script_gets_its_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pybullet_data")
    (tmp_path / "world.py").write_text(
        """
import pybullet as p
import pybullet_data

def world():
    p.connect(p.DIRECT)
    p.setAdditionalSearchPath(pybullet_data.getDataPath())
    p.setGravity(0, 0, -9.81)
    p.loadURDF("plane.urdf")
    p.loadURDF("sphere_small.urdf", [0, 0, 1])
"""
    )
    source = f"{tmp_path / 'world.py'}:world"
    assert run(["tune", source, "--pair", "body:1,body:0", "--restitution", "0.6", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert "p.changeDynamics(1, -1, " in record["paste"]
    assert "restitution=0.6" in record["paste"]
    assert record["max_error"] < 0.1
