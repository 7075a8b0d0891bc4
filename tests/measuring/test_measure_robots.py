"""Bodies on hinges, in any pose, met from any side: held against
loops over mj_step written by hand.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bounce_loop import bounce_by_distance
from contact_scenes import full_mass

from hcbench.cli import run
from hcbench.measuring import measure
from hcbench.system.errors import UserError

mujoco = pytest.importorskip("mujoco")

SPRING = 'solref="-40000 -12" solimp=".9999 .9999 .001 .5 2" friction="0 0 0" condim="1"'
HEAD = f'<mujoco><option timestep="1e-3" gravity="0 0 0"/><default><geom {SPRING}/></default><worldbody>'
WALL = '<geom name="wall" type="box" pos="{x} 0 0" size=".1 2 2"/>'
PENDULUM = f"""{HEAD}{WALL.format(x=0.25)}<body name="arm" pos="0 0 1"><joint name="hip" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.8" size=".02" contype="0" conaffinity="0"/>
  <geom name="tip" type="sphere" pos="0 0 -1" size=".1" mass="1"/></body></worldbody></mujoco>"""
ARM = f"""{HEAD}<geom name="floor" type="plane" size="3 3 .1"/>
  <body name="upper" pos="0 0 .6"><joint name="shoulder" axis="0 1 0" range="-90 90"/>
  <geom type="capsule" fromto="0 0 0 .5 0 0" size=".04"/>
  <body name="lower" pos=".5 0 0"><joint name="elbow" axis="0 1 0" range="-150 150"/>
  <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03"/>
  <body name="hand" pos=".4 0 0"><geom name="hand" type="sphere" size=".05"/></body></body></body></worldbody>
  <actuator><position name="shoulder" joint="shoulder" kp="{{kp}}"/></actuator></mujoco>"""
BALL_JOINT = f"""{HEAD}<geom name="floor" type="plane" size="1 1 .1"/>
  <body pos="0 0 1"><freejoint/><geom size=".1"/>
  <body pos="0 0 -.2"><joint name="hip" type="ball" range="0 30" limited="true"/>
  <geom name="hand" size=".05" pos="0 0 -.2"/></body></body></worldbody>
  <keyframe><key name="turned" qpos="0 0 1 1 0 0 0 .7071 .7071 0 0"/></keyframe></mujoco>"""
LEGGED = f"""{HEAD}<geom name="floor" type="plane" size="3 3 .1"/>
  <body name="trunk" pos="0 0 1"><freejoint/><geom type="box" size=".2 .1 .1"/>
  <body name="leg" pos=".15 0 -.1"><joint name="knee" axis="0 1 0" damping=".1"/>
  <geom name="foot" type="capsule" fromto="0 0 0 .1 0 -.4" size=".03"/></body></body></worldbody></mujoco>"""


def row_of(model: Any, data: Any, point: Any, normal: Any, body: str) -> Any:
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_jac(model, data, jacobian, None, np.asarray(point), model.body(body).id)
    return np.asarray(normal) @ jacobian


def bounce_by_hand(
    model: Any, qpos: Any, qvel: Any, geom: str, other: str, ctrl: float = 0.0
) -> tuple[float, float]:
    """(speed in, speed out) at the touch plane: the loop that a user writes."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
    return bounce_by_distance(model, data, geom, other)


@pytest.mark.parametrize("speed", [0.2, 1.0])
def test_e_of_a_pendulum_is_that_of_its_tips_speed(speed: float) -> None:
    found = measure(PENDULUM, "arm,wall", speeds=[speed], phases=[0.3], diagnose=False)
    (impact,) = found.impacts
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    angle = -np.arcsin(0.05)  # the tip touches at x = 0.05
    height = 2.3 * 1e-3 * speed
    into, out = bounce_by_hand(model, [angle + height], [-speed / np.cos(angle)], "tip", "wall")
    assert impact.speed_in == pytest.approx(into, rel=2e-3)
    assert impact.restitution == pytest.approx(out / into, abs=1e-4)
    data = mujoco.MjData(model)
    data.qpos[0] = angle
    mujoco.mj_forward(model, data)
    inertia = full_mass(model, data)
    assert found.effective_mass == pytest.approx(inertia[0, 0] / np.cos(angle) ** 2, rel=1e-6)


@pytest.mark.parametrize("kp", [0.0, 200.0])
@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_e_of_an_arms_tip_is_that_of_a_loop_written_by_hand(kp: float, speed: float) -> None:
    text = ARM.format(kp=kp)
    model = mujoco.MjModel.from_xml_string(text)
    touch = touching_pose(model, [0.2, 0.5])
    pose = {"qpos": touch, "ctrl": touch[0]}  # held there by its servo
    found = measure(text, "hand,floor", qpos=pose, speeds=[speed], phases=[0.3], diagnose=False)
    (impact,) = found.impacts
    data = mujoco.MjData(model)
    data.qpos[:] = touch
    mujoco.mj_forward(model, data)
    row = row_of(model, data, found.facts.point, [0, 0, -1], "hand")
    mass = full_mass(model, data)
    push = np.linalg.solve(mass, row)
    assert found.effective_mass == pytest.approx(1 / (row @ push), rel=1e-4)
    move = push / (row @ push)
    start = touch - move * 2.3e-3 * speed
    into, out = bounce_by_hand(model, start, move * speed, "hand", "floor", ctrl=touch[0])
    assert impact.restitution == pytest.approx(out / into, abs=1e-4)
    assert found.facts.more_than_contact == pytest.approx(0.0, abs=1e-9) or kp


def touching_pose(model: Any, start: list[float]) -> Any:
    """The pose at touch to which small steps along the push at the hand lead."""
    data = mujoco.MjData(model)
    data.qpos[:] = start
    for _ in range(2000):
        mujoco.mj_forward(model, data)
        hand = data.geom("hand").xpos
        gap = hand[2] - 0.05
        row = row_of(model, data, hand - [0, 0, 0.05], [0, 0, -1], "hand")
        mass = full_mass(model, data)
        push = np.linalg.solve(mass, row)
        data.qpos[:] += push / (row @ push) * np.clip(gap, -0.02, 0.02)
    return data.qpos.copy()


@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_a_foot_on_a_knee_is_measured_at_its_own_contact(speed: float) -> None:
    found = measure(LEGGED, "foot,floor", speeds=[speed], phases=[0.3], diagnose=False)
    (impact,) = found.impacts
    model = mujoco.MjModel.from_xml_string(LEGGED)
    bottom = 1 - 0.1 - 0.4 - 0.03
    qpos = np.array([0, 0, 1 - bottom + 2.3e-3 * speed, 1, 0, 0, 0, 0.0])
    into, out = bounce_by_hand(model, qpos, [0, 0, -speed, 0, 0, 0, 0], "foot", "floor")
    assert impact.restitution == pytest.approx(out / into, abs=1e-4)
    assert found.effective_mass < 0.9 * mujoco.mj_getTotalmass(model)


FLOOR = '<geom name="floor" type="plane" size="3 3 .1"/>'
FREE = '<body name="{name}" pos="0 0 {z}"><freejoint/><geom name="{name}" {shape}/></body>'
HOPPER = """<body name="trunk" pos="0 0 1"><joint type="slide" axis="0 0 1"/>
  <geom type="box" size=".1 .1 .1"/><body pos="0 0 -.1"><joint name="hip" axis="0 1 0" damping=".2"/>
  <geom type="capsule" fromto="0 0 0 .2 0 -.3" size=".03"/><body name="foot" pos=".2 0 -.3">
  <joint name="knee" axis="0 1 0" stiffness="5"/><geom type="capsule" fromto="0 0 0 -.15 0 -.3" size=".02"/>
  <geom name="toe" type="sphere" pos="-.15 0 -.3" size=".04"/></body></body></body>"""
# (bodies; geom that moves; its body; other; qpos at touch; which of qpos goes up)
SHAPES: dict[str, tuple[str, str, str, list[float], int]] = {
    "box": (
        FREE.format(name="b", z=1, shape='type="box" size=".1 .05 .1"'),
        "b",
        "floor",
        [0, 0, 0.1],
        2,
    ),
    "cylinder": (
        FREE.format(name="b", z=1, shape='type="cylinder" size=".1 .05"'),
        "b",
        "floor",
        [0, 0, 0.05],
        2,
    ),
    "ellipsoid": (
        FREE.format(name="b", z=1, shape='type="ellipsoid" size=".1 .08 .05"'),
        "b",
        "floor",
        [0, 0, 0.05],
        2,
    ),
    "two balls": (
        FREE.format(name="b", z=2, shape='size=".1"')
        + FREE.format(name="c", z=1, shape='size=".15"'),
        "b",
        "c",
        [0, 0, 1.25],
        2,
    ),
    "leg of two links": (HOPPER, "toe", "floor", [-0.26], 0),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("speed", [0.2, 1.1])
def test_e_of_a_shape_is_that_of_a_loop_written_by_hand(name: str, speed: float) -> None:
    """Twelve models: a ball, a pendulum, two arms and a leg, and a ball and an arm in PyBullet."""
    bodies, geom, other, touch, up = SHAPES[name]
    text = f"{HEAD}{FLOOR}{bodies}</worldbody></mujoco>"
    found = measure(text, f"geom:{geom},geom:{other}", speeds=[speed], phases=[0.3], diagnose=False)
    model = mujoco.MjModel.from_xml_string(text)
    qpos, qvel = mujoco.MjData(model).qpos.copy(), np.zeros(model.nv)
    qpos[: len(touch)] = touch
    qpos[up] += 2.3e-3 * speed
    qvel[up] = -speed
    into, out = bounce_by_hand(model, qpos, qvel, geom, other)
    (impact,) = found.impacts
    assert impact.restitution == pytest.approx(out / into, abs=1e-4)


def test_what_an_actuator_adds_is_distinguished_and_can_be_left_out() -> None:
    touch = touching_pose(mujoco.MjModel.from_xml_string(ARM.format(kp=0)), [0.2, 0.5])
    pose = {"qpos": touch, "ctrl": touch[0] + 0.02}  # it presses on
    held = measure(
        ARM.format(kp=2000), "hand,floor", qpos=pose, speeds=[0.3], phases=1, diagnose=False
    )
    off = measure(
        ARM.format(kp=2000),
        "hand,floor",
        qpos=pose,
        speeds=[0.3],
        phases=1,
        actuators=False,
        diagnose=False,
    )
    without = measure(
        ARM.format(kp=0), "hand,floor", qpos=pose, speeds=[0.3], phases=1, diagnose=False
    )
    assert abs(held.facts.shares["actuators"]) > 0.02
    assert off.facts.shares["actuators"] == 0.0
    assert off.curve[0].restitution == pytest.approx(without.curve[0].restitution, abs=1e-9)
    assert abs(held.curve[0].restitution - off.curve[0].restitution) > 0.01


def test_a_pose_comes_from_names_a_file_or_a_live_state(tmp_path: Path) -> None:
    text, qpos = ARM.format(kp=0), np.array([0.2, 0.5])
    np.savez(tmp_path / "pose.npz", qpos=qpos)
    (tmp_path / "pose.json").write_text(json.dumps({"shoulder": 0.2, "elbow": 0.5}))
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    data.qvel[:] = 7.0  # everything starts at rest
    options: dict[str, Any] = {
        "pair": "hand,floor",
        "speeds": [0.5],
        "phases": 1,
        "diagnose": False,
    }

    class Environment:
        unwrapped: Any = None

    environment = Environment()
    environment.unwrapped = type("Inner", (), {"model": model, "data": data})()
    found = [
        measure(text, qpos="shoulder=0.2, elbow=28.64788975654116 deg", **options),
        measure(text, state=tmp_path / "pose.npz", **options),
        measure(text, state=tmp_path / "pose.json", **options),
        measure(data, **options),
        measure(environment, **options),
    ]
    first = found[0].impacts[0].restitution
    assert [m.impacts[0].restitution for m in found] == pytest.approx([first] * 5, abs=1e-9)
    start = "as it stands, at rest (its velocities are left out)"
    assert found[3].facts.settings["start"] == start
    assert (data.qvel == 7.0).all()


def test_a_foot_that_just_touches_the_floor_is_launched_along_its_normal() -> None:
    standing = LEGGED.replace('pos="0 0 1"', 'pos="0 0 .53"').replace(
        'size="3 3 .1"', 'size="3 3 .1" pos="2 1 0"'
    )
    facts = measure(standing, "foot,floor", speeds=[0.5], phases=1, diagnose=False).facts
    assert facts.normal == pytest.approx((0, 0, -1), abs=1e-9)


TABLE = f"""{HEAD}<body name="table" pos="1 0 .2"><geom name="top" type="box" size=".3 .3 .2"/></body>
  <geom name="floor" type="plane" size="3 3 .1"/>
  <body name="box" pos=".2 0 .1"><freejoint/><geom name="box" type="box" size=".05 .05 .05"/></body>
  </worldbody></mujoco>"""


def test_the_side_is_chosen_and_said() -> None:
    side = measure(TABLE, "box,table", speeds=[0.5], phases=1, diagnose=False).facts
    assert "from the side, along 1 0 0" in side.meeting
    above = measure(
        TABLE, "box,table", coming_from="above", speeds=[0.5], phases=1, diagnose=False
    ).facts
    assert above.normal == pytest.approx((0, 0, -1))
    assert above.point[2] == pytest.approx(0.4, abs=1e-6)
    assert "from above" in above.meeting


def test_two_that_meet_at_an_edge_are_met_from_above() -> None:
    """MuJoCo makes no contact of two boxes that meet corner to corner on the nearest way."""
    corner = TABLE.replace('pos=".2 0 .1"', 'pos=".2 -.6 .8" euler="20 30 40"')
    facts = measure(corner, "box,table", speeds=[0.5], phases=1, diagnose=False).facts
    assert abs(facts.normal[2]) == pytest.approx(1.0, abs=1e-3) or "from above" not in facts.notes


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (
            BALL_JOINT,
            {"key": "turned"},
            r"outside their limits.*hip by 60 deg.*Start from another pose$",
        ),
        (
            ARM.format(kp=0),
            {"qpos": "shoulder=2"},
            r"outside their limits.*shoulder by 24.6 deg.*from qpos",
        ),
        (ARM.format(kp=0), {"qpos": "sholder=1"}, "Did you mean 'shoulder'"),
        (ARM.format(kp=0), {"qpos": "shoulder=1 2"}, "2 numbers; expected 1"),
        (ARM.format(kp=0), {"qpos": "shoulder"}, "joints with their values"),
        (ARM.format(kp=0), {"state": "nowhere.npz"}, "a .npz or JSON file"),
        (ARM.format(kp=0), {"coming_from": "north"}, "above, below"),
        (
            ARM.format(kp=0).replace('name="floor"', 'name="floor" pos="0 0 -3"'),
            {},
            "do not bring it nearer|away: its joints",
        ),
    ],
)
def test_a_bad_pose_is_one_line(text: str, options: dict[str, Any], words: str) -> None:
    with pytest.raises(UserError, match=words) as error:
        measure(text, "hand,floor", **options)
    assert "\n" not in str(error.value)


def test_a_tether_that_holds_a_body_back_is_named() -> None:
    text = f"""{HEAD}<site name="hook" pos="0 0 1"/><geom name="floor" type="plane" size="3 3 .1"/>
      <body name="ball" pos="0 0 .9"><freejoint/><geom name="ball" size=".05"/><site name="eye"/></body>
      </worldbody><tendon><spatial name="string" limited="true" range="0 .3"><site site="hook"/>
      <site site="eye"/></spatial></tendon></mujoco>"""
    with pytest.raises(
        UserError, match=r"held back before it meets 'floor': tendon 'string' .* 0.65 m bey"
    ):
        measure(text, "ball,floor")
    slack = measure(
        text.replace("0 .3", "0 2"), "ball,floor", speeds=[0.5], phases=1, diagnose=False
    )
    assert slack.curve[0].samples > 0


def test_bodies_that_pass_at_different_heights_are_reported() -> None:
    text = f"""{HEAD}<geom name="post" type="box" pos="1 0 1" size=".1 .1 .1"/><body name="puck" pos="0 0 .1">
      <joint type="slide" axis="1 0 0"/><geom size=".05"/></body></worldbody></mujoco>"""
    with pytest.raises(UserError, match=r"passes 'post' 0\.\d+ m away.*heights of 0.1 and 1 m"):
        measure(text, "puck,post")


def test_the_pairs_of_a_model_are_listed_with_what_touches(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "robot.xml").write_text(
        LEGGED.replace(
            "</mujoco>",
            '<keyframe><key name="stand" qpos="0 0 .53 1 0 0 0 0"/></keyframe></mujoco>',
        )
    )
    assert run(["pairs", str(tmp_path / "robot.xml"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [set(pair["geoms"]) for pair in found if pair["touching"]] == [{"foot", "floor"}]
    (foot,) = [pair for pair in found if "foot" in pair["geoms"]]
    assert foot["bodies"] == ["leg", "world"]
    assert foot["touching_in"] == ["keyframe 'stand'"]
    assert foot["contact"]["solref"] == [-40000, -12]
    measured = measure(tmp_path / "robot.xml", "foot,floor", speeds=[0.5], phases=1, diagnose=False)
    assert foot["effective_mass_kg"] == pytest.approx(measured.effective_mass, rel=1e-6)
    with pytest.raises(UserError, match=r"leaves a choice of 2: foot,floor .touching.*--all"):
        measure(tmp_path / "robot.xml")


def test_a_contact_in_force_is_mixed_as_the_engine_does() -> None:
    from hcbench.engines.mujoco.model.find_pair import contact_in_force

    one = 'solref=".01 .5" solimp=".8 .9 .002 .4 3" friction=".3 .01 .002" condim="4" solmix="3"'
    other = 'solref=".05 .9" friction=".7 .02 .001" condim="3" solmix="2"'
    for second in (other, other + ' priority="1"', other.replace(".05 .9", "-1000 -5")):
        text = f"""<mujoco><worldbody><geom type="plane" size="1 1 .1" {one}/><body pos="0 0 .04"><freejoint/>
          <geom size=".05" {second}/></body></worldbody></mujoco>"""
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        contact, mixed = data.contact[0], contact_in_force(model, 0, 1)
        assert mixed["solref"] == pytest.approx(list(contact.solref))
        assert mixed["solimp"] == pytest.approx(list(contact.solimp))
        assert mixed["friction"] == pytest.approx([contact.friction[0], *contact.friction[2:4]])
        assert mixed["condim"] == contact.dim


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_a_leg_that_folds_while_it_rises_parts_all_the_same(integrator: str) -> None:
    """Under RK4 the turning of the contact's direction was taken for a
    force that never ended: e = 0.
    """
    text = LEGGED.replace("gravity", f'integrator="{integrator}" gravity').replace(
        '"1e-3"', '"5e-4"'
    )
    found = measure(text, "foot,floor", speeds=[1.0], phases=[0.3], gravity=9.81, diagnose=False)
    (impact,) = found.impacts
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.gravity[2] = -9.81
    qpos = np.array([0, 0, 1.0 - 0.47 + 0.01, 1, 0, 0, 0, 0])
    speed = np.sqrt(impact.speed_in**2 - 2 * 9.81 * 0.01)
    into, out = bounce_by_hand(model, qpos, [0, 0, -speed, 0, 0, 0, 0], "foot", "floor")
    assert impact.restitution == pytest.approx(
        out / into, abs=0.02
    )  # the loop reads steps, not the touch
    assert impact.restitution > 0.3


def test_a_usd_file_is_refused_with_what_to_convert_it_with(tmp_path: Path) -> None:
    (tmp_path / "robot.usda").write_text("#usda 1.0")
    with pytest.raises(UserError, match="URDF exporter makes a URDF of a USD file"):
        measure(tmp_path / "robot.usda", "a,b")


def test_xacro_is_refused_with_what_expands_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:leg/></robot>'
    for name in ("robot.urdf.xacro", "robot.urdf"):
        (tmp_path / name).write_text(text)
        assert run(["pairs", str(tmp_path / name)]) == 2
        assert "xacro robot.urdf.xacro > robot.urdf" in capsys.readouterr().err
