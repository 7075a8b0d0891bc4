"""A pair tuned in its own model: what is written compiles, keeps the
rest, and does what tune prints.
"""

import json
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from long_searches import long_search

import hcbench as hb
from hcbench import engine
from hcbench.cli import run
from hcbench.engines.mujoco.model import row_search
from hcbench.engines.mujoco.model.row_search import RowSearch, starting_rows
from hcbench.laws.conventions import NewtonSpring
from hcbench.measuring import Wanted, measure
from hcbench.measuring.request import make_request
from hcbench.sim.capabilities import TunesModels
from hcbench.system.errors import UserError
from hcbench.system.text import as_bound
from hcbench.tuning.model import tune_job
from hcbench.tuning.tuned_model import TunedModel

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


GOOD = Path(__file__).parents[2] / "examples" / "good.xml"
FIRST = ("--max-error", "1")  # whatever comes first will do


def tuned(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, Any]:
    out = path.with_name("tuned.xml")
    assert run(["tune", str(path), *options, "--write-model", str(out), "--json"]) == 0
    record: dict[str, Any] = json.loads(capsys.readouterr().out)
    return record


@pytest.mark.parametrize(
    ("text", "pair", "e", "limit"),
    [
        (ROBOT.format(condim=1), "foot,floor", 0.8, 0.05),
        pytest.param(ROBOT.format(condim=3), "foot,floor", 0.5, 0.05, marks=long_search),
        # MuJoCo's own contact would stop it already.
        (
            ROBOT.format(condim=3).replace("friction=", 'solref="-9000 -20" friction='),
            "foot,floor",
            0.0,
            0.02,
        ),
        pytest.param(
            ROBOT.format(condim=3).replace("implicitfast", "RK4"),
            "foot,floor",
            0.5,
            0.06,
            marks=long_search,
        ),
        pytest.param(
            BALL.format(condim="", other=OTHER), "second,ball", 0.7, 0.05, marks=long_search
        ),
    ],
)
def test_measure_finds_no_larger_error_in_the_written_model_than_tune_prints(
    text: str, pair: str, e: float, limit: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The speeds are none of those that tune saw, and at the phases
    that `measure` and `check` choose.
    """
    path = tmp_path / "robot.xml"
    path.write_text(text)
    record = tuned(path, capsys, "--pair", pair, "--restitution", str(e))
    assert record["max_error"] < limit
    speeds = np.geomspace(0.1005, 1.99, 17).tolist()
    found = measure(tmp_path / "tuned.xml", pair, speeds=speeds, phases=11, diagnose=False)
    promised = float(as_bound(record["max_error"]))
    assert max(abs(i.restitution - e) for i in found.impacts) <= promised
    before, after = (mujoco.MjModel.from_xml_path(str(p)) for p in (path, tmp_path / "tuned.xml"))
    assert (before.nbody, before.ngeom, before.nq) == (after.nbody, after.ngeom, after.nq)
    assert after.body_mass == pytest.approx(before.body_mass)
    assert before.opt.timestep == after.opt.timestep
    assert before.opt.integrator == after.opt.integrator
    data = mujoco.MjData(after)
    assert int(before.geom_condim[0]) in after.pair_dim  # the damper's row has no friction
    mujoco.mj_step(after, data)


def test_two_bodies_of_one_size_have_half_the_mass_and_a_note_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "balls.xml").write_text(BALL.format(condim="", other=OTHER))
    record = tuned(
        tmp_path / "balls.xml", capsys, "--pair", "second,ball", "--restitution", "0.7", *FIRST
    )
    mass = 4 / 3 * 3.14159265 * 0.1**3 * 1000
    assert record["pairs"][0]["effective_mass_kg"] == pytest.approx(mass / 2, rel=1e-6)
    assert any("Both bodies move" in note for note in record["notes"])
    assert any('has no name: give it name="geom_1"' in note for note in record["notes"])


def test_a_stiffness_and_a_damping_give_e_for_the_effective_mass_of_the_pair(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "balls.xml").write_text(BALL.format(condim="", other=OTHER))
    pair = ("--pair", "second,ball", "--newton", "semi-implicit, 1e4, 20")
    record = tuned(tmp_path / "balls.xml", capsys, *pair, *FIRST)
    mass = 2 / 3 * 3.14159265 * 0.1**3 * 1000
    wanted = NewtonSpring(False, 1e4, 20.0).restitution(mass)
    assert record["pairs"][0]["curve"][0]["target"] == pytest.approx(wanted, rel=1e-6)


def test_what_changes_for_the_whole_model_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.xml").write_text(ROBOT.format(condim=3))
    record = tuned(
        tmp_path / "robot.xml", capsys, "--pair", "foot,floor", "--restitution", "0.5", *FIRST
    )
    assert 'cone="elliptic"' in record["paste"]
    assert any("whole model" in note for note in record["notes"])
    assert 'friction="0.9 0.9 0.01 0.001 0.001"' in record["paste"]
    assert run(["tune", str(tmp_path / "robot.xml"), "--restitution", "0.5"]) == 2
    assert "hcbench measure" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("nowhere.xml", None, "nowhere.xml is not there"),
        ("cut.xml", "<mujoco", "a model that MuJoCo compiles"),
        ("mesh.xml", '<mujoco><asset><mesh file="no.obj"/></asset></mujoco>', "Error opening file"),
        (
            "still.xml",
            '<mujoco><option timestep="0"/></mujoco>',
            "timestep: 0 s; expected a step above 0 s",
        ),
        ("nan.xml", BALL.format(condim='mass="nan"', other=""), "has a NaN in it"),
        ("good.mjb", "", "good.mjb"),
    ],
)
def test_a_model_that_is_none_is_the_users_mistake(
    name: str, text: str | None, message: str, tmp_path: Path
) -> None:
    """Exit 3 and the bare ValueError of MuJoCo, once."""
    if text is not None:
        (tmp_path / name).write_text(text)
    request = make_request("ball,floor", speeds=[0.1, 1.0])
    mujoco = engine("mujoco")
    assert isinstance(mujoco, TunesModels)
    with pytest.raises(UserError, match=message):
        list(mujoco.model_settings(str(tmp_path / name), [request], Wanted(restitution=0.5)))


def test_the_step_at_which_a_model_was_tuned_is_written_into_it(tmp_path: Path) -> None:
    """The file kept its own step, at which a tuned e does not hold, without a word."""
    out = tmp_path / "tuned.xml"
    asked: dict[str, Any] = {"restitution": 0.6, "speeds": "0.5, 1 m/s", "max_error": 1.0}
    made = hb.tune_model(GOOD, "ball,plate", **asked, timestep="1/240 s", write_model=out)
    assert "1/240" not in GOOD.read_text(encoding="utf-8")
    assert mujoco.MjModel.from_xml_path(str(out)).opt.timestep == 1 / 240
    assert "the step is now 1/240 s, at which this was tuned" in " ".join(made.notes)
    own = float(mujoco.MjModel.from_xml_path(str(GOOD)).opt.timestep)
    kept = hb.tune_model(GOOD, "ball,plate", **asked, timestep=own)
    assert "<option timestep" not in kept.text
    assert "masses, step and integrator are as they were" in " ".join(kept.notes)


def test_a_model_that_is_nearest_as_it_is_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    """A spring was found with an error of 0.063, where the file has 0.003."""
    assert run(["tune", str(GOOD), "--pair=ball,plate", "--restitution=0.9"]) == 0
    captured = capsys.readouterr()
    assert "largest error of e: 0.0031 from" in captured.out
    assert "The model as it is has this e already: there is nothing to paste." in captured.out
    assert "paste:" not in captured.out


def test_what_check_advises_and_rows_that_do_not_pull_are_tried() -> None:
    """They were nearer than the setting which was called the best there is."""
    adapter = engine("mujoco")
    assert isinstance(adapter, TunesModels)
    request = make_request("ball,plate", speeds=[0.1, 2.0])
    settings = list(islice(adapter.model_settings(GOOD, [request], Wanted(restitution=0.5)), 4))
    assert [each.name for each in settings[1:]] == [
        "spring and damper",
        "spring and damper",
        "one step",
    ]
    assert [each.slides for each in settings] == [False, False, False, True]


@long_search
def test_a_row_of_one_step_is_taken_where_friction_allows_it() -> None:
    request = make_request("ball,plate", speeds=[0.1, 2.0])
    found = tune_job(GOOD, [request], Wanted(restitution=0.5), max_error=0.02)
    assert found.name == "one step"
    assert found.max_error < 0.024
    # The contact of this one does not throw up what slides.
    soft = GOOD.read_text().replace("0 -9500", "0.02 1")
    assert tune_job(soft, [request], Wanted(restitution=0.5), max_error=0.02).name != "one step"


BOX = """<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 .1"/>
    <body name="box" pos="0 0 .1">
      <freejoint/>
      <geom name="box" type="box" size=".1 .1 .1" mass="1"/>
    </body>
  </worldbody>
</mujoco>"""


def hop_of_a_slide(text: str) -> float:
    """Greatest height over its rest, m, of a box that is laid down as it slides at 1 m/s."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    heights = []
    while data.time < 1.0:
        mujoco.mj_step(model, data)
        heights.append(data.qpos[2] - 0.1)
    return float(max(heights))


Costs = tuple[list[float], list[float]]


@pytest.fixture(scope="module")
def box_tuned() -> tuple[TunedModel, Costs]:
    """A box tuned to e = 0.9 with a search that stops at its first guess; and costs of settings
    that it tries, together and each alone.
    """
    costs: list[Costs] = []

    def best(search: RowSearch, adhesive: bool) -> Any:
        random = np.random.default_rng(1)
        members = random.uniform(row_search._LOWEST, row_search._HIGHEST, (6, 7))
        settings = [search.rows(member, adhesive) for member in members]
        limits = np.full(6, np.inf)
        together = search._errors(settings, limits).tolist()
        costs.append((together, [search._errors([each], limits[:1])[0] for each in settings]))
        return starting_rows(adhesive)

    box = mujoco.MjSpec.from_string(BOX)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RowSearch, "best", best)
        asked = [make_request("box,floor", speeds=[0.3, 2.0])]
        found = tune_job(box, asked, Wanted(restitution=0.9))
    return found, costs[0]


def test_a_row_that_throws_up_a_sliding_box_is_not_taken(
    box_tuned: tuple[TunedModel, Costs],
) -> None:
    """All other settings make the box at rest worse; the search is as near as its first guess."""
    one_step = 'size=".1 .1 .1" mass="1" solref="0 -950" solimp="0.9999 0.9999 0.001 0.5 2"'
    assert hop_of_a_slide(BOX.replace('size=".1 .1 .1" mass="1"', one_step)) > 0.04
    assert box_tuned[0].name != "one step"


def test_a_setting_costs_among_others_what_it_costs_alone(
    box_tuned: tuple[TunedModel, Costs],
) -> None:
    together, alone = box_tuned[1]
    assert together == alone
    assert len(set(together)) == 6


@long_search
def test_a_box_that_slides_on_what_tune_writes_hops_no_higher_than_before() -> None:
    tuned = hb.tune_model(BOX, "box,floor", restitution=0.9, speeds=[0.3, 2.0])
    assert hop_of_a_slide(tuned.written) <= hop_of_a_slide(BOX)
    # So it is where a setting that throws the box up has a smaller error of e.
    nearer = hb.tune_model(
        BOX, "box,floor", restitution=0.9, speeds=[0.3, 2.0], max_error=tuned.max_error / 2
    )
    assert hop_of_a_slide(nearer.written) <= hop_of_a_slide(BOX)


def test_the_hop_that_tune_prints_is_no_higher_than_before_and_that_of_a_loop_of_its_own(
    box_tuned: tuple[TunedModel, Costs],
) -> None:
    tuned, _ = box_tuned
    fall = 9.81 * 0.002**2
    assert tuned.before.hop == pytest.approx(hop_of_a_slide(BOX) - fall, rel=1e-2)
    assert tuned.after.hop == pytest.approx(hop_of_a_slide(tuned.written) - fall, rel=1e-2)
    assert tuned.after.hop <= tuned.before.hop


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
    p.setTimeStep(1e-3)  # g h is a hundredth of the impact
    p.loadURDF("plane.urdf")
    p.loadURDF("sphere_small.urdf", [0, 0, 1])
"""
    )
    source = f"{tmp_path / 'world.py'}:world"
    asked = ["--pair", "body:1,body:0", "--restitution", "0.6", "--speeds", "1 m/s"]
    assert run(["tune", source, *asked, "--max-error", "0.1", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert "p.changeDynamics(1, -1, " in record["paste"]
    assert "restitution=0.6" in record["paste"]
    assert record["max_error"] < 0.1


# An e that falls with speed, several pairs
# -----------------------------------------------------------


def test_e_falls_with_speed_as_wanted_under_gravity_at_two_milliseconds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.xml").write_text(ROBOT.format(condim=3))
    record = tuned(tmp_path / "robot.xml", capsys, "--pair", "foot,floor", "--alpha", "0.31 s/m")
    assert record["setting"] == "spring and damper"
    assert record["max_error"] < 0.05
    found = measure(
        tmp_path / "tuned.xml", "foot,floor", speeds=[0.12, 0.5, 1.9], alpha=0.31, phases=5
    )
    assert (
        max(abs(error) for _, error in found.errors(Wanted(alpha=0.31)))
        < record["max_error"] + 0.005
    )
    assert found.curve[0].restitution > 0.9
    assert found.curve[2].restitution < 0.68


BOXES = "".join(
    f'''<body name="{name}" pos="0 0 {z}"><freejoint/>
      <geom name="{name}" type="box" size=".1 .1 .1" mass="{mass}"/></body>'''
    for name, z, mass in (("low", 0.1, 3), ("mid", 0.3, 2), ("top", 0.5, 1))
)
HEAD = """<mujoco><option timestep="2e-3"/><default><joint damping="{damping}" armature=".02"/>
  <position kp="{kp}"/></default><worldbody><geom name="floor" type="plane" size="3 3 .1"/>"""
STACK = f"{HEAD.format(kp=0, damping=0)}{BOXES}</worldbody></mujoco>"


def legs(text: str, names: list[tuple[str, float, float]], joints: list[str]) -> str:
    """Copies of a leg, and a servo for each of its joints."""
    bodies = "".join(text.format(n=name, x=x, y=y) for name, x, y in names)
    servos = "".join(
        f'<position joint="{joint}_{name}"/>' for name, *_ in names for joint in joints
    )
    return f"{bodies}</body></worldbody><actuator>{servos}</actuator></mujoco>"


QUADRUPED = f"""{HEAD.format(kp=120, damping=0.5)}<body name="trunk" pos="0 0 .425"><freejoint/>
  <geom type="box" size=".25 .1 .05" mass="10"/>""" + legs(
    """<body pos="{x} {y} 0"><joint name="hip_{n}" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 .1 0 -.2" size=".02" mass=".6"/>
  <body pos=".1 0 -.2"><joint name="knee_{n}" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 -.1 0 -.2" size=".015" mass=".3"/>
  <geom name="foot_{n}" type="sphere" pos="-.1 0 -.2" size=".025" mass=".05"/></body></body>""",
    [("fl", 0.2, 0.1), ("fr", 0.2, -0.1), ("rl", -0.2, 0.1), ("rr", -0.2, -0.1)],
    ["hip", "knee"],
)
HUMANOID = f"""{HEAD.format(kp=900, damping=5)}<body name="trunk" pos="0 0 .87"><freejoint/>
  <geom type="box" pos="0 0 .3" size=".1 .15 .25" mass="25"/>
  <geom type="sphere" pos="0 0 .65" size=".1" mass="4"/>""" + legs(
    """<body pos="{x} {y} 0"><joint name="roll_{n}" axis="1 0 0"/><joint name="hip_{n}" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".06" mass="6"/>
  <body pos="0 0 -.4"><joint name="knee_{n}" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".045" mass="3"/>
  <body pos="0 0 -.4"><joint name="ankle_{n}" axis="0 1 0"/><joint name="tilt_{n}" axis="1 0 0"/>
  <geom name="foot_{n}" type="box" pos=".03 0 -.04" size=".12 .05 .03" mass="1"/></body></body></body>""",
    [("left", 0, 0.1), ("right", 0, -0.1)],
    ["roll", "hip", "knee", "ankle", "tilt"],
)


def stands_at(text: str, body: str) -> Any:
    """Position of a body after 4 s, m."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=2000)
    return data.body(body).xpos.copy()


@pytest.mark.parametrize(
    ("text", "body", "pairs", "e"),
    [
        pytest.param(STACK, "top", ["low,floor", "mid,low", "top,mid"], 0.0, marks=long_search),
        (QUADRUPED, "trunk", [f"foot_{name},floor" for name in ("fl", "fr", "rl", "rr")], 0.5),
        pytest.param(
            HUMANOID, "trunk", ["foot_left,floor", "foot_right,floor"], 0.0, marks=long_search
        ),
    ],
    ids=["stack", "quadruped", "humanoid"],
)
def test_what_stood_stands_when_all_its_contacts_are_tuned(
    text: str, body: str, pairs: list[str], e: float
) -> None:
    requests = [make_request(pair, speeds=[0.5]) for pair in pairs]
    found = tune_job(text, requests, Wanted(restitution=e), max_error=1.0)
    assert [set(pair.facts.pair) for pair in found.pairs] == [
        set(pair.split(",")) for pair in pairs
    ]
    before, after = stands_at(text, body), stands_at(found.written, body)
    assert before == pytest.approx(after, abs=2e-3)


@long_search
def test_a_humanoid_stands_on_two_rows_a_foot() -> None:
    pairs = ["foot_left,floor", "foot_right,floor"]
    wanted = Wanted(points=((0.3, 0.7), (1.0, 0.5)))
    found = tune_job(
        HUMANOID, [make_request(pair, speeds=[0.3, 1.0]) for pair in pairs], wanted, max_error=0.15
    )
    assert "spring and damper" in found.name
    assert found.text.count('<pair geom1="foot_') == 4
    assert stands_at(found.written, "trunk") == pytest.approx(
        stands_at(HUMANOID, "trunk"), abs=2e-3
    )
