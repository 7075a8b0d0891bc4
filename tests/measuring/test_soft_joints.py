"""e of feet, wheels and fingers on soft joints: at the touch plane, as a loop over mj_step sees it."""

import mujoco
import numpy as np
import pytest
from bounce_loop import bounce_by_distance

from hcbench.measuring import Measurement, measure
from hcbench.measuring.text import as_record, as_text
from hcbench.system.errors import SceneError, UserError

OPTION = '<option timestep="2e-3" integrator="{integrator}" gravity="{gravity}"/>'
CONTACT = 'condim="3" friction=".6" solref="-{k} -{b}" solimp=".99 .99 .001"'
FLOOR = '<geom name="floor" type="plane" size="3 3 .1"/>'
# A leg of two links on a trunk that is free: hip and knee are held by servos with damping.
LEG = """<body name="trunk" pos="0 0 .6"><freejoint/><geom type="box" size=".2 .1 .05" mass="6"/>
<body pos=".15 0 0"><joint name="hip" axis="0 1 0" damping=".2" armature=".01"/>
<geom type="capsule" fromto="0 0 0 -.12 0 -.16" size=".02" mass="1" contype="0" conaffinity="0"/>
<body pos="-.12 0 -.16"><joint name="knee" axis="0 1 0" damping=".2" armature=".01"/>
<geom type="capsule" fromto="0 0 0 .12 0 -.16" size=".015" mass=".3" contype="0" conaffinity="0"/>
<geom name="tip" type="sphere" pos=".12 0 -.16" size=".023" mass=".06" {contact}/></body></body></body>"""
# A wheel on a suspension whose chassis is free.
WHEEL = """<body name="chassis" pos="0 0 .21"><freejoint/><geom type="box" size=".3 .2 .05"
 mass="20" contype="0"
 conaffinity="0"/><body pos="0 0 -.1">
<joint name="suspension" type="slide" axis="0 0 1" stiffness="4000" damping="60"/>
<geom name="tip" type="sphere" size=".1" mass="3" {contact}/></body></body>"""
# A finger on a stiff servo, on a wrist that is free to slide.
FINGER = """<body name="hand" pos="0 0 .4"><joint name="wrist" type="slide" axis="0 0 1"/>
<geom type="box" size=".05 .05 .02" mass="1" contype="0" conaffinity="0"/>
<body pos="0 0 -.05">
<joint name="hip" axis="0 1 0" stiffness="3"/><geom name="link" type="capsule" fromto="0 0 0 .1 0 -.05"
 size=".01" mass=".1" contype="0" conaffinity="0"/><body pos=".1 0 -.05"><joint name="knee" axis="0 1 0"/>
<geom name="tip" type="sphere" pos="0 0 -.05" size=".015" mass=".02" {contact}/></body></body></body>"""
SERVOS = """<actuator><position joint="hip" kp="{kp}" kv="{kv}"/><position joint="knee" kp="{kp}" kv="{kv}"/>
</actuator>"""
# name: (bodies, k and b of the contact, servos, integrator, gravity)
ROBOTS = {
    "leg": (LEG, (30000, 20), (60, 2), "implicitfast", "0 0 -9.81"),
    "leg, Euler": (LEG, (30000, 20), (60, 0.5), "Euler", "0 0 -9.81"),
    "leg, stiff servos": (LEG, (40000, 10), (400, 5), "implicitfast", "0 0 0"),
    "leg without servos": (LEG, (30000, 20), None, "implicit", "0 0 -9.81"),
    "wheel": (WHEEL, (20000, 5), None, "implicitfast", "0 0 -9.81"),
    "wheel, Euler": (WHEEL, (60000, 30), None, "Euler", "0 0 -9.81"),
    "finger": (FINGER, (30000, 20), (2, 0.02), "implicitfast", "0 0 -9.81"),
    "finger, stiff servos": (FINGER, (60000, 20), (20, 0.1), "implicitfast", "0 0 0"),
}


def robot(name: str) -> str:
    bodies, (k, b), servos, integrator, gravity = ROBOTS[name]
    option = OPTION.format(integrator=integrator, gravity=gravity)
    actuators = SERVOS.format(kp=servos[0], kv=servos[1]) if servos else ""
    body = bodies.format(contact=CONTACT.format(k=k, b=b))
    return f"<mujoco>{option}<worldbody>{FLOOR}{body}</worldbody>{actuators}</mujoco>"


def measured(text: str, speed: float) -> Measurement:
    return measure(text, "geom:tip,floor", speeds=[speed], phases=[0.3], diagnose=False)


# Where what is launched stands in qpos and in qvel.
MOVED = {"leg": (2, 2), "wheel": (7, 6), "finger": (0, 0)}


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("speed", [0.5, 1.5])
def test_e_is_that_of_a_loop_that_watches_the_gap(name: str, speed: float) -> None:
    text = robot(name)
    (impact,) = measured(text, speed).impacts
    model = mujoco.MjModel.from_xml_string(text)
    data, (place, dof) = mujoco.MjData(model), MOVED[name.split(maxsplit=1)[0].rstrip(",")]
    mujoco.mj_forward(model, data)
    gap = data.geom("tip").xpos[2] - model.geom("tip").size[0]
    data.qpos[place] -= gap - 2.3 * model.opt.timestep * speed
    data.qvel[dof] = -speed
    into, out = bounce_by_distance(model, data, "tip", "floor")
    assert impact.speed_in == pytest.approx(into, rel=1e-9)
    assert impact.restitution == pytest.approx(out / into, abs=1e-9)


# Bodies without joints: one struck at its end, one that falls on what the floor holds, and, under
# RK4, one whose heel strikes the floor two steps before.
ROD = """<body name="tip" pos="0 0 .3" euler="0 50 0"><freejoint/>
<geom name="tip" type="capsule" size=".03 .12" mass=".5" {contact}/></body>"""
BLOCKS = """<body name="low" pos="0 0 .1"><freejoint/><geom name="low" type="box" size=".2 .2 .1" mass="2"
 {contact}/></body><body name="tip" pos="0 0 .4"><freejoint/><geom name="tip" size=".1" mass="1" {contact}/>
</body>"""
FEET = """<body name="tip" pos="0 0 .1"><freejoint/><geom name="tip" size=".05" mass="1" {contact}/>
<geom name="heel" size=".05" pos="-.2 0 -.0013" mass="1" {contact}/></body>"""


@pytest.mark.parametrize(
    ("body", "integrator", "other"),
    [(ROD, "Euler", "floor"), (BLOCKS, "Euler", "low"), (FEET, "RK4", "floor")],
    ids=["rod", "blocks", "feet"],
)
def test_e_of_bodies_that_have_no_one_acceleration(body: str, integrator: str, other: str) -> None:
    option = OPTION.format(integrator=integrator, gravity="0 0 -9.81")
    bodies = body.format(contact=CONTACT.format(k=40000, b=60))
    text = f"<mujoco>{option}<worldbody>{FLOOR}{bodies}</worldbody></mujoco>"
    found = measure(text, f"geom:tip,{other}", speeds=[0.5], phases=[0.3], diagnose=False)
    (impact,), model = found.impacts, mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    gap = mujoco.mj_geomDistance(
        model, data, model.geom("tip").id, model.geom(other).id, 10, np.zeros(6)
    )
    moved = model.body("tip").jntadr[0]
    data.qpos[model.jnt_qposadr[moved] + 2] -= gap - 2.3 * model.opt.timestep * 0.5
    data.qvel[model.jnt_dofadr[moved] + 2] = -0.5
    into, out = bounce_by_distance(model, data, "tip", other)
    assert impact.restitution == pytest.approx(out / into, abs=1e-4)


def test_the_speed_that_the_contact_gives_is_said_beside_what_servos_leave_of_it() -> None:
    found = measured(robot("finger, stiff servos"), 1.5)
    (point,), text = found.curve, as_text(found)
    assert point.restitution_after_force - point.restitution > 0.2
    assert "after force" in text
    assert "between the contact's force and the touch plane" in text
    record = as_record(found)["curve"][0]
    assert record["restitution_after_force"] == point.restitution_after_force
    ball = f"""<mujoco><worldbody>{FLOOR}<body pos="0 0 .1"><freejoint/>
    <geom name="tip" size=".1" solref="-30000 -20"/></body></worldbody></mujoco>"""
    assert "after force" not in as_text(measured(ball, 1.5))


def test_a_launch_that_comes_much_faster_than_it_was_sent_is_warned_of() -> None:
    pressed = robot("wheel").replace('damping="60"/>', 'damping="60" springref="-.3"/>')
    assert "the bodies meet at" in as_text(measured(pressed, 0.5))
    assert "the bodies meet at" not in as_text(measured(robot("leg"), 0.5))


def test_the_energy_that_is_lost_is_what_the_contact_takes() -> None:
    """An arm that sags all the while, with the tray that the ball falls
    on, gains more than the ball has.
    """
    sagging = """<mujoco><option timestep="1e-3"/><worldbody>
    <body name="arm" pos="-1 0 1"><joint name="shoulder" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 .9 0 0" size=".05" mass="40" contype="0" conaffinity="0"/>
    <body name="tray" pos="1 0 0"><geom name="tray" type="box" size=".1 .1 .02" mass=".5"/></body></body>
    <body name="ball" pos="0 0 1.1"><freejoint/><geom name="ball" size=".03" mass=".1"
     solref="-20000 -8" friction=".4"/></body></worldbody>
    <actuator><position joint="shoulder" kp="20" kv="1"/></actuator></mujoco>"""
    found = measure(sagging, "ball,tray", speeds=[0.5], angle=0.5, phases=[0.3], diagnose=False)
    (impact,) = found.impacts
    assert 0.0 < impact.energy_lost < 1.0


HELD = f"""<mujoco><option timestep="2e-3" integrator="implicitfast" gravity="0 0 0"/>
<default><geom solimp=".9999 .9999 .001"/></default><worldbody>{FLOOR}
<body pos="0 0 .1"><joint name="lift" type="slide" axis="0 0 1"/>
<geom name="tip" size=".1" mass="1" solref="-1e-3 -935"/></body></worldbody>
<actuator><position joint="lift" kp="0" kv="7"/></actuator></mujoco>"""


def test_an_integrator_that_damps_the_bounce_by_the_servos_is_a_cause() -> None:
    held = measure(HELD, "geom:tip,floor", speeds=[0.5], restitution=0.87)
    assert [cause.code for cause in held.causes] == ["integrator"]
    assert "Euler" in held.causes[0].fix


def test_a_pair_that_never_touches_is_refused_with_what_stopped_it() -> None:
    pulled = HELD.replace('kp="0" kv="7"', 'kp="4000" kv="400" ctrlrange="0 1"')
    with pytest.raises(UserError, match=r"never touched.*actuators.*Start from another"):
        measure(pulled, "geom:tip,floor", speeds=[0.01], phases=1, height=0.01)


def test_a_robot_that_stands_in_the_floor_is_raised_up_to_a_limit() -> None:
    """The robot's foot starts 18 mm deep, as in keyframes of robots that stand on soft contacts."""
    standing = robot("leg").replace('name="trunk" pos="0 0 .6"', 'name="trunk" pos="0 0 .325"')
    found, free = measured(standing, 0.5), measured(robot("leg"), 0.5)
    assert found.curve[0].restitution == pytest.approx(free.curve[0].restitution, abs=1e-6)
    assert any("overlap by 0.018 m at the start: moved apart" in note for note in found.facts.notes)
    with pytest.raises(SceneError, match="inside 'floor'"):
        measured(standing.replace('pos="0 0 .325"', 'pos="0 0 .2"'), 0.5)


@pytest.mark.parametrize("kv", [12, 40])
def test_the_integrator_is_named_where_it_alone_takes_half_of_what_the_servos_cost(kv: int) -> None:
    held = measure(
        HELD.replace('kv="7"', f'kv="{kv}"'), "geom:tip,floor", speeds=[0.5], restitution=0.87
    )
    assert [cause.code for cause in held.causes] == ["actuators", "integrator"]
    before = 0.87 - held.curve[0].restitution
    assert held.causes[1].alone <= 0.55 * before
