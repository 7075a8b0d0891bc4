"""`tune MODEL` keeps attitudes and rest no worse, and writes includes for the version that loads
them.
"""

import json
from pathlib import Path
from typing import Any

import pytest
from long_searches import long_search

from hcbench import engine, tune_model
from hcbench.cli import run
from hcbench.measuring import measure
from hcbench.measuring.request import make_request
from hcbench.sim.capabilities import TunesModels
from hcbench.sim.rest import Standing

mujoco = pytest.importorskip("mujoco")

CUBE = """<mujoco><option timestep="2e-3"/><worldbody>
  <geom name="floor" type="plane" size="5 5 .1" friction=".18"/>
  <body name="cube" pos="0 0 .5"><freejoint/>
  <geom name="cube" type="box" size=".0524 .0524 .0524" mass=".37" friction=".18"/></body></worldbody>
  </mujoco>"""
BALL = """<mujoco><!-- mine --><compiler meshdir="meshes"/><option timestep="2e-3"/>
  <asset><mesh file="tetra.obj"/></asset>
  <default><default class="shell"><geom type="mesh" mesh="tetra"/></default></default>
  <worldbody><geom name="floor" type="plane" size="5 5 .1"/><include file="ball.xml"/>
  <body pos="3 0 1"><geom class="shell" contype="0" conaffinity="0"/></body>
  </worldbody></mujoco>"""
BODY = """<mujocoinclude><body name="ball" pos="0 0 1"><freejoint/><geom name="ball" size=".1"/></body>
  </mujocoinclude>"""
STUCK = """<mujoco><option timestep="2e-3"/><worldbody><geom name="floor" type="plane" size="5 5 .1"/>
  <body name="foot" pos="0 0 .5"><joint type="slide" axis="0 0 1" damping="3e3"/>
  <geom name="foot" size=".1"/></body></worldbody></mujoco>"""
PADS = """<mujoco><option timestep="2e-3" cone="elliptic" impratio="10"/><worldbody>
  <body name="palm" pos="0 0 .3"><geom type="box" size=".08 .03 .02" contype="0" conaffinity="0"/>
  <body name="left" pos="-.05 0 -.06"><joint type="slide" axis="1 0 0" damping="5"/>
  <geom name="left" type="box" size=".008 .012 .04" mass=".05" friction="1.5"/></body>
  <body name="right" pos=".05 0 -.06"><joint type="slide" axis="-1 0 0" damping="5"/>
  <geom name="right" type="box" size=".008 .012 .04" mass=".05" friction="1.5"/></body></body>
  <body name="cube" pos="0 0 .241"><freejoint/><geom name="cube" type="box" size=".02 .02 .02" mass=".1"/>
  </body></worldbody></mujoco>"""


def standing(text: str, *pairs: str) -> Standing:
    adapter = engine("mujoco")
    assert isinstance(adapter, TunesModels)
    return adapter.standing(text, None, [make_request(pair) for pair in pairs])


def tuned(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, Any]:
    assert run(["tune", str(path), *options, "--json"]) == 0
    record: dict[str, Any] = json.loads(capsys.readouterr().out)
    return record


def test_a_loose_box_is_tuned_on_face_edge_and_vertex() -> None:
    adapter = engine("mujoco")
    assert isinstance(adapter, TunesModels)
    ways = adapter.attitudes(CUBE, make_request("cube,floor"))
    assert [attitude for attitude, _ in ways] == ["face", "edge", "vertex"]


@long_search
def test_a_cube_bounces_alike_on_face_edge_and_vertex(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A setting for its face had e of 0.20, 0.25 and 0.33."""
    (tmp_path / "cube.xml").write_text(CUBE)
    out = tmp_path / "tuned.xml"
    record = tuned(
        tmp_path / "cube.xml",
        capsys,
        "--pair",
        "cube,floor",
        "--restitution",
        "0.2",
        "--max-error",
        "0.1",
        "--write-model",
        str(out),
    )
    assert [pair["attitude"] for pair in record["pairs"]] == ["face", "edge", "vertex"]
    turns = {
        "face": "1 0 0 0",
        "edge": ".92388 .382683 0 0",
        "vertex": ".888074 .325058 -.325058 0",
    }
    for turn in turns.values():
        found = measure(
            out,
            "cube,floor",
            speeds=[0.5, 1.0],
            phases=6,
            diagnose=False,
            qpos=f"qpos=0 0 .5 {turn}",
        )
        assert all(abs(i.restitution - 0.2) <= record["max_error"] for i in found.impacts)
    assert record["passive"]["flat"] is True
    assert record["after"]["vibration_m_per_s"] < 1e-5


def test_rest_on_a_slope_and_in_a_grasp_are_measured_in_the_model() -> None:
    cube = standing(CUBE, "cube,floor")
    assert cube.slope == pytest.approx(2 / 3 * 0.178093, rel=1e-3)  # two thirds of atan 0.18
    assert 1e-4 < cube.drift < 1e-3
    assert cube.vibration < 1e-9
    held = standing(PADS, "geom:cube,left", "geom:cube,right")
    assert 1e-5 < held.hold < 1e-3  # 0.17 mm/s by a loop of its own


def test_more_than_a_fifth_is_worse_unless_it_stays_small() -> None:
    before = Standing(1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 4.0, 1e-5)
    assert not list(before.worse_than(before))
    small = Standing(1e-6, 1e-9, 1e-9, 1e-9, 1e-9, 0.1, 1e-5)
    assert not list(Standing(9e-5, 9e-5, 9e-5, 9e-6, 9e-5, 1.9, 1.1e-5).worse_than(small))
    worse = list(Standing(1.3e-3, 1.3e-3, 1e-3, 1e-3, 1.3e-3, 5.0, 1.3e-5).worse_than(before))
    assert [line.split()[0] for line in worse] == ["penetration", "drift", "hop", "solver"]


def test_no_choice_hangs_on_the_time_that_a_step_took() -> None:
    before = Standing(1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 4.0, 1e-5)
    slower = Standing(1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 4.0, 1.0)
    assert not list(slower.worse_than(before))


@pytest.mark.usefixtures("tuned_once")
def test_what_gains_nothing_is_not_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "stuck.xml").write_text(STUCK)
    out = tmp_path / "tuned.xml"
    options = [
        "--pair",
        "foot,floor",
        "--restitution",
        "0.5",
        "--write-model",
        str(out),
        "--max-error",
        "1",
    ]
    assert run(["tune", str(tmp_path / "stuck.xml"), *options]) == 1
    assert not out.exists()
    captured = capsys.readouterr()
    assert "Nothing is written" in captured.err
    assert "smaller step" in captured.err
    assert run(["tune", str(tmp_path / "stuck.xml"), *options, "--for", "older"]) == 2
    with pytest.warns(UserWarning, match="Nothing is written: the model as it is has e within 0.5"):
        result = tune_model(
            tmp_path / "stuck.xml", "foot,floor", restitution=0.5, max_error=1, write_model=out
        )
    assert (result.gains, result.files) == (False, ())
    assert "nothing is written" in repr(result)
    assert not out.exists()


def test_the_model_keeps_its_text_and_finds_its_files_from_another_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Folders were absolute, and includes and comments gone."""
    robot, out = tmp_path / "robot", tmp_path / "out" / "tuned.xml"
    for folder in (robot / "meshes", out.parent):
        folder.mkdir(parents=True)
    (robot / "meshes" / "tetra.obj").write_text(
        "v -.1 -.1 0\nv .2 -.1 0\nv -.1 .2 0\nv 0 0 .2\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    )
    (robot / "robot.xml").write_text(BALL)
    (robot / "ball.xml").write_text(BODY)
    pairs = out.with_name("pairs.xml")
    files = ["--write-model", str(out), "--write-include", str(pairs)]
    wanted = ["--pair", "ball,floor", "--restitution", "0.7", "--max-error", "1"]
    record = tuned(robot / "robot.xml", capsys, *wanted, *files)
    text = out.read_text()
    assert "<!-- mine -->" in text
    assert str(tmp_path) not in text
    assert '<include file="pairs.xml"/>' in text
    (tmp_path / "out").rename(tmp_path / "moved")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "moved" / "tuned.xml"))
    assert model.npair == record["paste"].count("<pair ")


@long_search
def test_lines_for_an_older_mujoco_have_no_adhesion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "ball.xml").write_text(
        '<mujoco><option timestep="2e-3"/><worldbody><geom name="floor" type="plane" size="5 5 .1"/>'
        '<body name="ball" pos="0 0 1"><freejoint/><geom name="ball" size=".1"/></body></worldbody></mujoco>'
    )
    wanted = ["--pair", "ball,floor", "--alpha", "0.3 s/m", "--max-error", "0.12"]
    record = tuned(tmp_path / "ball.xml", capsys, *wanted, "--for", "mujoco@3.5")
    assert "adhesion" not in record["paste"]
    assert record["max_error"] < 0.12


@pytest.mark.parametrize(
    ("version", "words"),
    [
        ("pybullet@3.2.7", "expected a version of mujoco, which opens this model"),
        ("mujoco@1.0", "expected mujoco@3.3 ... mujoco@"),
        ("mujoco@99", "expected mujoco@3.3 ... mujoco@"),
        ("mujoco@" + "9" * 5000, "expected an engine and its version, as ENGINE@3.5"),
    ],
)
def test_lines_are_written_for_a_known_version_of_the_models_engine(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], version: str, words: str
) -> None:
    (tmp_path / "ball.xml").write_text(
        '<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1"/>'
        '<body name="ball" pos="0 0 1"><freejoint/><geom name="ball" size=".1"/></body></worldbody></mujoco>'
    )
    options = ["--pair", "ball,floor", "--restitution", "0.5", "--for", version]
    assert run(["tune", str(tmp_path / "ball.xml"), *options]) == 2
    assert words in capsys.readouterr().err
