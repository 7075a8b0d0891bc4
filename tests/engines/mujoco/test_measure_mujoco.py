"""MuJoCo models of a user's own, measured: held against loops over
mj_step as the user would write them.
"""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from covering import every_pair

from hcbench.engines.mujoco.model import touch_search
from hcbench.engines.mujoco.scene.rows import SoftConstraint
from hcbench.laws import kelvin_voigt
from hcbench.laws.kelvin_voigt import Ending
from hcbench.measuring import Measurement, measure
from hcbench.measuring.text import as_text
from hcbench.reporting.measurement_page import measurement_page
from hcbench.system.errors import SceneError, UserError
from hcbench.terms.bounds import beyond_bounds
from hcbench.terms.impact import Impact, Status

SPRING = 'solref="-40000 -12" solimp=".9999 .9999 .001 .5 2"'
IMPULSE = 'solref="0 -950" solimp=".9999 .9999 .001 .5 2"'


def world(
    *,
    geom: str = SPRING,
    plate: str = "",
    option: str = "",
    joint: str = "<freejoint/>",
    z: float = 1.0,
    more: str = "",
) -> str:
    return f"""<mujoco><option {option}/><default><geom {geom}/></default><worldbody>
      <geom name="plate" type="plane" size="1 1 .1" {plate}/>
      <body name="ball" pos="0 0 {z}">{joint}<geom name="sphere" type="sphere" size=".1"/></body>
      {more}</worldbody></mujoco>"""


def at_plane(model: Any, z: float, w: float) -> float:
    """Speed at height 0 of the flight through height z with the velocity
    w upwards, by steps of Euler's.
    """
    g, h = -float(model.opt.gravity[2]), float(model.opt.timestep)
    return float(np.sqrt((w - g * h / 2) ** 2 + 2 * g * z))


def bounced(model: Any, height: float, speed: float, dof: int = 2) -> tuple[float, float]:
    """(speed in, speed out) of a ball let go above z = radius: the loop that a user writes."""
    data = mujoco.MjData(model)
    floor = 0.1 if model.nq > 1 else -0.9
    qpos = 2 if model.nq > 1 else 0
    data.qpos[qpos] = height if model.nq > 1 else height - 1.0
    data.qvel[dof] = -speed
    touched, into = False, speed
    for _ in range(400_000):
        before, z = float(data.qvel[dof]), float(data.qpos[qpos]) - floor
        mujoco.mj_step(model, data)
        force = np.zeros(6)
        acting = False
        for i in range(data.ncon):
            mujoco.mj_contactForce(model, data, i, force)
            acting = acting or force[0] != 0.0
        if acting and not touched:
            touched, into = True, at_plane(model, z, before)
        if touched and not acting and before > 0:
            return into, at_plane(model, z, before)
    raise AssertionError("never came back")


def only(found: Measurement) -> Impact:
    (impact,) = found.impacts
    assert impact.status is Status.PARTED, impact.reason
    return impact


@pytest.mark.parametrize(
    ("integrator", "contact", "gravity", "phase"),
    every_pair(
        ["Euler", "implicitfast", "implicit"],
        [(SPRING, 1e-3), (IMPULSE, 2e-3), ('solref=".01 .1"', 5e-4)],
        ["0 0 0", "0 0 -9.81"],
        [0.125, 0.7],
    ),
)
def test_e_is_that_of_a_loop_written_by_hand(
    integrator: str, contact: tuple[str, float], gravity: str, phase: float
) -> None:
    geom, timestep = contact
    option = f'integrator="{integrator}" gravity="{gravity}" timestep="{timestep}"'
    text = world(geom=geom, option=option)
    impact = only(measure(text, speeds=[0.7], phases=[phase], diagnose=False))
    into, out = bounced(
        mujoco.MjModel.from_xml_string(text), 0.1 + (2 + phase) * timestep * 0.7, 0.7
    )
    assert impact.speed_in == pytest.approx(into, rel=1e-9)
    assert impact.restitution == pytest.approx(out / into, abs=1e-9)


def test_a_slide_joint_is_as_good_as_a_free_one() -> None:
    option = 'gravity="0 0 -9.81" timestep="1e-3"'
    text = world(option=option, joint='<joint type="slide" axis="0 0 1"/>')
    impact = only(measure(text, speeds=[0.7], phases=[0.3], diagnose=False))
    into, out = bounced(mujoco.MjModel.from_xml_string(text), 0.1 + 2.3e-3 * 0.7, 0.7, dof=0)
    assert impact.restitution == pytest.approx(out / into, abs=1e-9)


def test_rk4_is_read_at_its_states_and_not_at_its_stages() -> None:
    text = world(option='integrator="RK4" gravity="0 0 0" timestep="1e-3"')
    impact = only(measure(text, speeds=[0.7], phases=[0.3], diagnose=False))
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[2], data.qvel[2] = 0.1 + 2.3e-3 * 0.7, -0.7
    while data.qvel[2] < 0 or data.qpos[2] < 0.1:
        mujoco.mj_step(model, data)
    assert impact.speed_in == pytest.approx(0.7, rel=1e-12)
    assert impact.restitution == pytest.approx(data.qvel[2] / 0.7, abs=1e-9)


def test_force_is_paired_with_the_state_it_acts_from() -> None:
    """Under Euler the impulse is the change of momentum, and the loop's area the energy lost."""
    found = measure(
        world(option='gravity="0 0 0" timestep="1e-5"'), speeds=[0.5], phases=[0.5], diagnose=False
    )
    impact, m = only(found), found.facts.effective_mass
    assert m == pytest.approx(4 / 3 * np.pi * 0.1**3 * 1000, rel=1e-12)
    loop = impact.loop
    assert loop is not None
    assert loop.force.sum() * 1e-5 == pytest.approx(
        m * (impact.speed_in + impact.speed_out), rel=1e-9
    )
    work = float((loop.force * (loop.rate - 0.5 * loop.force * 1e-5 / m)).sum() * 1e-5)
    assert work == pytest.approx(0.5 * m * (impact.speed_in**2 - impact.speed_out**2), rel=1e-9)
    hooke = loop.force / m - 40000 * 0.9999 * loop.penetration - 12 * loop.rate
    assert np.abs(hooke).max() < 1e-3 * loop.force.max() / m, (
        "F = k x + c v at one and the same state"
    )


def test_gravity_is_distinguished_from_the_launch() -> None:
    found = measure(world(geom=IMPULSE), speeds=[0.05], phases=[0.5], diagnose=False)
    (point,) = found.curve
    assert point.speed == 0.05
    model = mujoco.MjModel.from_xml_string(world(geom=IMPULSE))
    into, out = bounced(model, 0.1 + 2.5 * 0.002 * 0.05, 0.05)
    assert point.speed_in == pytest.approx(into, rel=1e-9)
    assert point.speed_in > np.sqrt(0.05**2 + 2 * 9.81 * 2.5 * 0.002 * 0.05)
    assert point.restitution == pytest.approx(out / into, abs=1e-9)


def test_gravity_and_step_can_be_set() -> None:
    found = measure(world(), speeds=[0.5], timestep="0.1 ms", gravity=0, diagnose=False)
    assert found.facts.gravity == (0.0, 0.0, 0.0)
    assert found.facts.timestep == pytest.approx(1e-4)
    assert only_speeds(found) == pytest.approx(0.5, rel=1e-12)


def only_speeds(found: Measurement) -> float:
    (speed,) = {round(i.speed_in, 12) for i in found.impacts}
    return speed


def test_two_moving_bodies_meet_with_their_reduced_mass() -> None:
    text = f"""<mujoco><option gravity="0 0 0" timestep="1e-5"/><default><geom {SPRING}/></default><worldbody>
      <body name="a" pos="0 0 1"><freejoint/><geom type="sphere" size=".1" mass="2"/></body>
      <body name="b" pos="0 .5 1.2"><freejoint/><geom type="sphere" size=".2" mass="3"/></body>
    </worldbody></mujoco>"""
    found = measure(text, ("a", "b"), speeds=[0.5], phases=[0.5], diagnose=False)
    assert found.facts.effective_mass == pytest.approx(1.2, rel=1e-12)
    line = np.array([0, 0.5, 0.2]) / np.hypot(0.5, 0.2)
    assert found.facts.normal == pytest.approx(tuple(line), abs=1e-9)
    promised = SoftConstraint((-40000, -12), (0.9999, 0.9999, 0.001, 0.5, 2.0), 1e-5).restitution(
        0.5
    )
    assert only(found).restitution == pytest.approx(promised, abs=2e-4)


@pytest.mark.parametrize("zeta", [0.01, 0.2, 0.9, 1.5, 30.0])
def test_a_contact_of_constant_impedance_is_a_spring_and_damper_that_cannot_pull(
    zeta: float,
) -> None:
    stiffness, impedance = 4e4, 0.83
    solref = (-stiffness * impedance, -2 * zeta * impedance * np.sqrt(stiffness / impedance))
    found = SoftConstraint(solref, (impedance, impedance, 0.001, 0.5, 2.0), 1e-5).restitution(0.7)
    assert found == pytest.approx(float(kelvin_voigt.restitution(zeta, Ending.FORCE)), abs=1e-8)


ARM = f"""<mujoco><default><geom {SPRING}/></default><option timestep="5e-4" gravity="0 0 -9.81"/><worldbody>
  <geom name="floor" type="plane" size="3 3 .1"/>
  <body name="table" pos="1 0 .2"><geom name="top" type="box" size=".3 .3 .2"/></body>
  <body name="base" pos="-1 0 .5"><joint name="shoulder" axis="0 1 0" damping="1"/>
    <geom type="capsule" fromto="0 0 0 .4 0 0" size=".05"/>
    <body pos=".4 0 0"><joint name="elbow" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".04"/></body></body>
  <body name="ball" pos="1 0 1"><freejoint/><geom name="ball" type="sphere" size=".05"/></body>
</worldbody><keyframe>
  <key name="aside" qpos="1.2 -.3 .9 .1 1 1 0 0 0"/><key name="above" qpos="0 0 1.1 0 .8 1 0 0 0"/>
</keyframe></mujoco>"""


def test_a_ball_in_a_larger_model_starts_from_its_keyframe() -> None:
    found = measure(ARM, ("ball", "top"), key="above", speeds=[0.8], phases=[0.5], diagnose=False)
    assert found.facts.settings["start"] == "keyframe 'above'"
    model = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 1)
    data.qpos[4] = 0.45 + 2.5 * 5e-4 * 0.8
    data.qvel[4] = -0.8
    while data.qvel[4] < 0 or data.qpos[4] < 0.45:
        mujoco.mj_step(model, data)
    out = at_plane(model, float(data.qpos[4]) - 0.45, float(data.qvel[4]))
    assert only(found).restitution == pytest.approx(out / only(found).speed_in, abs=1e-9)
    first = measure(ARM, ("ball", "top"), speeds=[0.8], phases=[0.5], diagnose=False)
    assert first.facts.settings["start"] == "keyframe 'aside'"


def test_a_foot_is_launched_with_the_robot_it_belongs_to() -> None:
    text = f"""<mujoco><default><geom {SPRING}/></default><worldbody>
      <geom name="floor" type="plane" size="3 3 .1"/>
      <body name="trunk" pos="0 0 1"><freejoint/><geom type="box" size=".2 .1 .1"/>
        <body name="foot" pos="0 0 -.4"><joint axis="0 1 0"/><geom type="sphere" size=".05"/></body></body>
    </worldbody></mujoco>"""
    found = measure(text, "foot,floor", speeds=[0.5], diagnose=False)
    assert found.facts.moved == "body 'trunk' on its free joint (--move chooses)"
    assert all(i.status is Status.PARTED for i in found.impacts)


def test_a_box_that_lands_flat_adds_its_contacts_up() -> None:
    text = world(option='gravity="0 0 0" timestep="1e-4"').replace(
        'type="sphere" size=".1"', 'type="box" size=".1 .1 .1"'
    )
    found = measure(text, speeds=[0.5], phases=[0.5], diagnose=False)
    impact = only(found)
    assert found.facts.settings["points of contact"] == 4
    assert impact.loop is not None
    gained = found.facts.effective_mass * (impact.speed_in + impact.speed_out)
    assert impact.loop.force.sum() * 1e-4 == pytest.approx(gained, rel=1e-6)


def test_contact_begins_where_the_margin_says() -> None:
    launch: Any = {"speeds": [0.5], "gravity": 0, "phases": 16, "diagnose": False}
    found = measure(world(geom=SPRING + ' margin=".01"'), **launch)
    plain = measure(world(geom=SPRING), **launch)
    model = mujoco.MjModel.from_xml_string(world(geom=SPRING + ' margin=".01"'))
    data = mujoco.MjData(model)
    data.qpos[2] = 0.1
    mujoco.mj_forward(model, data)
    assert found.facts.settings["acts from (m)"] == data.contact[0].includemargin > 0
    assert [i.restitution for i in found.impacts] == pytest.approx(
        [i.restitution for i in plain.impacts], abs=1e-9
    )


@pytest.mark.parametrize("shape", ["sphere", "ellipsoid", "box", "capsule"])
def test_a_height_field_is_met_where_the_engine_says(shape: str) -> None:
    """MuJoCo's distance to one is not to be relied on: the touch is found by its contacts."""
    text = f"""<mujoco><asset><hfield name="land" nrow="20" ncol="20" size="1 1 .1 .1"/></asset>
      <default><geom {IMPULSE}/></default><worldbody><geom name="land" type="hfield" hfield="land"/>
      <body name="stone" pos="0 0 1"><freejoint/><geom type="{shape}" size=".1 .1 .1"/></body>
      </worldbody></mujoco>"""
    found = measure(text, ("stone", "land"), speeds=[0.5], gravity=0, diagnose=False)
    assert found.facts.normal == pytest.approx((0, 0, -1), abs=1e-4)
    assert [i.restitution for i in found.impacts] == pytest.approx([0.9] * 4, abs=3e-4)


WALKER = f"""<mujoco><default><geom {SPRING}/></default><worldbody>
  <geom name="floor" type="plane" size="3 3 .1"/>
  <geom name="wall" type="box" pos="0 0 .8" size=".5 .5 .1"/>
  <body name="trunk" pos="0 0 1.2"><freejoint/><geom name="trunk" type="sphere" size=".1"/>
  <geom name="tail" type="sphere" size=".1" pos="0 0 -.1"/></body></worldbody></mujoco>"""


def test_what_is_in_the_way_is_named() -> None:
    with pytest.raises(
        UserError, match=r"'geom:trunk' cannot reach 'floor'.*'tail'.* inside 'floor'"
    ):
        measure(WALKER, ("geom:trunk", "floor"))


def test_other_contacts_are_reported_as_a_cause() -> None:
    """A dumb-bell that lands on both ends: what is measured of one end is not of that end alone."""
    text = world(option='timestep="1e-4"', geom=IMPULSE).replace(
        "</body>", '<geom name="other end" type="sphere" size=".1" pos="0 .5 0"/></body>'
    )
    found = measure(text, ("geom:sphere", "plate"), speeds=[0.5])
    said = "Other contacts acted during the impact: plate (by other parts than geom:sphere)."
    assert found.facts.notes[-1] == said
    assert "other-contacts" in [cause.code for cause in found.causes]


def test_a_model_and_a_spec_from_python_are_left_as_they_were() -> None:
    model = mujoco.MjModel.from_xml_string(world())
    before = np.array(model.opt.gravity), model.opt.timestep, np.array(model.geom_solref)
    kept = [
        i.restitution for i in measure(model, ("ball", "plate"), gravity=0, timestep=1e-4).impacts
    ]
    assert (model.opt.gravity == before[0]).all()
    assert model.opt.timestep == before[1]
    assert (model.geom_solref == before[2]).all()
    spec = mujoco.MjSpec.from_string(world())
    again = [
        i.restitution for i in measure(spec, ("ball", "plate"), gravity=0, timestep=1e-4).impacts
    ]
    text = [
        i.restitution for i in measure(world(), ("ball", "plate"), gravity=0, timestep=1e-4).impacts
    ]
    assert kept == again == text


def test_a_world_built_in_a_python_file(tmp_path: Path) -> None:
    built = tmp_path / "setup.py"
    built.write_text(
        f"import mujoco\n\ndef ball():\n    return mujoco.MjSpec.from_string('''{world(geom=IMPULSE)}''')\n"
    )
    found = measure(f"{built}:ball", speeds=[0.5], gravity=0, diagnose=False)
    assert found.curve[0].restitution == pytest.approx(0.9, abs=1e-9)


def test_includes_assets_defaults_and_keyframes_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "tetra.obj").write_text(
        "v 0 0 0\nv .2 0 0\nv 0 .2 0\nv .05 .05 .2\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    )
    (tmp_path / "parts" / "ball.xml").write_text(
        '<mujocoinclude><body name="ball" pos="0 0 2"><freejoint/>'
        '<geom class="hard" type="mesh" mesh="tetra"/></body></mujocoinclude>'
    )
    (tmp_path / "scene.xml").write_text(
        f"""<mujoco><compiler meshdir="parts"/>
        <default><default class="hard"><geom {SPRING}/></default></default>
        <asset><mesh name="tetra" file="tetra.obj"/></asset>
        <worldbody><geom name="plate" class="hard" type="plane" size="1 1 .1"/>
        <include file="parts/ball.xml"/></worldbody>
        <keyframe><key name="up" qpos="0 0 1 1 0 0 0"/></keyframe></mujoco>"""
    )
    found = measure(tmp_path / "scene.xml", "ball,plate", speeds=[0.5], diagnose=False)
    assert found.facts.settings["start"] == "keyframe 'up'"
    assert all(i.status is Status.PARTED for i in found.impacts)


def test_the_same_model_measured_again_gives_the_same_bits() -> None:
    runs = {
        repr([i.restitution for i in measure(world(), diagnose=False).impacts]) for _ in range(3)
    }
    assert len(runs) == 1


def test_a_ball_that_stays_is_rested_and_has_e_zero() -> None:
    found = measure(world(geom='solref=".02 1"'), speeds=[0.5], diagnose=False)
    assert {i.status for i in found.impacts} == {Status.RESTED}
    assert found.curve[0].restitution == 0.0


@pytest.mark.parametrize("speed", [1e9, 1e11])
@beyond_bounds()
def test_a_speed_that_mujoco_resets_at_once_has_no_e(speed: float) -> None:
    """At 1e11 m/s, which it resets before the first step, e came out as
    0.9, at the speed of the fall.
    """
    model = mujoco.MjModel.from_xml_string(world(geom=IMPULSE, option='gravity="0 0 -9.81"'))
    impacts = measure(model, "sphere,plate", speeds=speed, phases=2, diagnose=False).impacts
    assert {impact.status for impact in impacts} == {Status.DIVERGED}


@beyond_bounds()
def test_a_state_that_mujoco_resets_is_diverged_and_no_file_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    model = mujoco.MjModel.from_xml_string(
        world(geom='solref="-1e18 0"', option='timestep=".01" gravity="0 0 0"')
    )
    found = measure(model, ("ball", "plate"), speeds=[2.0], phases=1)
    (impact,) = found.impacts
    assert impact.status in (Status.DIVERGED, Status.PARTED)
    assert not list(tmp_path.iterdir())
    wild = mujoco.MjModel.from_xml_string(world(option='timestep=".01" gravity="0 0 -1e12"'))
    (impact,) = measure(wild, ("ball", "plate"), speeds=[2.0], phases=1, diagnose=False).impacts
    assert impact.status is Status.DIVERGED
    assert not list(tmp_path.iterdir())


@beyond_bounds()
def test_failures_have_a_column_where_there_are_any() -> None:
    wild = mujoco.MjModel.from_xml_string(world(option='timestep=".01" gravity="0 0 -1e12"'))
    for model, failed in ((wild, True), (world(), False)):
        found = measure(model, ("ball", "plate"), speeds=[2.0], phases=1, diagnose=False)
        assert bool(found.failed) == failed
        assert ("failed\n" in as_text(found)) == failed
        assert (">failed</th>" in measurement_page(found)) == failed
        assert ">steps in contact</th>" in measurement_page(found)


def test_a_free_body_that_starts_inside_the_other_is_met_from_above() -> None:
    inside, above = (
        measure(world(z=z), ("ball", "plate"), speeds=[1.0], phases=2, diagnose=False)
        for z in (0.03, 0.3)
    )
    assert inside.curve[0].restitution == above.curve[0].restitution
    assert "'ball' starts 0.07 m inside 'plate': met from above." in inside.facts.notes


def test_velocities_of_a_keyframe_are_said_to_be_left_out() -> None:
    key = '<keyframe><key name="run" qpos="0 0 1 1 0 0 0" qvel="1 0 0 0 0 0"/></keyframe></mujoco>'
    model = world().replace("</mujoco>", key)
    found = measure(model, ("ball", "plate"), key="run", speeds=[1.0], phases=1, diagnose=False)
    assert "start: keyframe 'run', at rest (its velocities are left out)" in as_text(found)


def test_velocities_of_a_state_file_are_said_to_be_left_out(tmp_path: Path) -> None:
    state = tmp_path / "state.json"
    pose = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    for speed, said in ((1.0, ", at rest (its velocities are left out)"), (0.0, "")):
        state.write_text(json.dumps({"qpos": pose, "qvel": [speed, *[0.0] * 5]}), encoding="utf-8")
        found = measure(
            world(), ("ball", "plate"), state=state, speeds=[1.0], phases=1, diagnose=False
        )
        assert f"start: qpos0 with qpos{said}\n" in as_text(found)


FREE = "<freejoint/>"
NO_TOUCH = 'contype="0" conaffinity="0"'


@pytest.mark.parametrize(
    ("text", "pair", "words"),
    [
        (world(), ("bal", "plate"), "Did you mean 'ball'"),
        (world(), ("ball", "sphere"), "are the same"),
        (world(joint=""), ("ball", "plate"), "does not move"),
        (world(joint='<joint type="hinge"/>'), ("ball", "plate"), "hinges"),
        (world(joint='<joint type="slide" axis="1 0 0"/>'), ("ball", "plate"), "slide past"),
        (world(plate=NO_TOUCH), ("ball", "plate"), "contype/conaffinity"),
        (
            world(z=0.03, joint='<joint type="slide" axis="0 0 1"/>'),
            ("ball", "plate"),
            "starts 0.07 m inside",
        ),
        (
            world(joint="", more='<flexcomp name="soft" type="grid" count="2 2 1" dim="2"/>'),
            None,
            "soft bodies",
        ),
        (
            world(option="").replace("<option />", '<option><flag contact="disable"/></option>'),
            None,
            'Remove <flag contact="disable"/> from <option>',
        ),
        (
            world(option="").replace("<option />", '<option><flag constraint="disable"/></option>'),
            None,
            'Remove <flag constraint="disable"/> from <option>',
        ),
        (
            world().replace(
                "</mujoco>", '<contact><exclude body1="ball" body2="world"/></contact></mujoco>'
            ),
            ("ball", "plate"),
            "<exclude>",
        ),
        (
            world(more=f'<body name="b2" pos="1 0 1">{FREE}<geom size=".1"/></body>'),
            None,
            "leaves a choice",
        ),
    ],
)
def test_what_cannot_be_measured_is_refused_with_the_reason(
    text: str, pair: Any, words: str
) -> None:
    with pytest.raises(UserError, match=words):
        measure(text, pair)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<not xml", "XML parse error"),
        ('<mujoco><include file="nowhere.xml"/></mujoco>', "nowhere.xml"),
        ('<mujoco><include file="../../../outside.xml"/></mujoco>', "outside.xml"),
        (world().replace('size=".1"/>', 'size=".1" mass="nan"/>'), "NaN"),
        (world().replace('size=".1"/>', 'size=".1" mass="-1"/>'), "negative"),
        (world().replace('size=".1"/>', 'size="nan"/>'), "nan"),
        (world(option='timestep="-1"'), "timestep"),
    ],
)
def test_a_bad_file_is_one_clear_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.xml"
    path.write_text(text)
    with pytest.raises(UserError, match=words) as caught:
        measure(path)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(SceneError, match="is not there"):
        measure("nowhere/ball.xml")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"pair": "ball"}, "two names"),
        ({"speeds": [0.5, 0.5]}, "twice"),
        ({"speeds": "-1 m/s"}, "above 0"),
        ({"speeds": "1 kg"}, "does not fit"),
        ({"phases": 0}, "phases"),
        ({"phases": [1.5]}, "below 1"),
        ({"gravity": "1,2"}, "three"),
        ({"gravity": "-1"}, "gravity: -1 m/s.2; expected 0 or more"),
        ({"timestep": 0}, "above 0"),
        ({"key": "nope"}, "qpos0"),
        ({"engine": "physx"}, "one of: .*mjx, mujoco, mujoco-warp, pybullet"),
        ({"restitution": 1.5}, "0 ... 1"),
    ],
)
def test_a_request_that_makes_no_sense(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(UserError, match=words):
        measure(world(), **arguments)


def test_unnamed_geoms_can_be_pointed_at() -> None:
    text = (
        world().replace('name="plate"', "").replace('name="sphere"', "").replace('name="ball"', "")
    )
    alone = measure(text, speeds=[0.5], diagnose=False)
    pointed = measure(text, "body:1,geom:0", speeds=[0.5], diagnose=False)
    assert [i.restitution for i in alone.impacts] == [i.restitution for i in pointed.impacts]
    assert alone.facts.pair == ("geom:1", "geom:0")


@pytest.mark.parametrize(
    ("solref", "solimp"),
    [
        ((0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)),
        ((0.02, 0.1), (0.9, 0.95, 0.001, 0.5, 2.0)),
        ((-1e4, -20.0), (0.2, 0.99, 0.01, 0.3, 3.0)),
    ],
)
def test_the_promise_is_what_the_engine_keeps_at_a_fine_step(
    solref: tuple[float, float], solimp: tuple[float, float, float, float, float]
) -> None:
    geom = f'solref="{solref[0]} {solref[1]}" solimp="{" ".join(map(str, solimp))}"'
    found = measure(
        world(geom=geom), speeds=[0.1, 1.0], phases=1, timestep=2e-5, gravity=0, diagnose=False
    )
    promised = SoftConstraint(solref, solimp, 2e-5).curve([0.1, 1.0])
    assert [p.restitution for p in found.curve] == pytest.approx(promised, abs=1e-3)


@pytest.mark.parametrize(("native", "is_rough"), [("enable", False), ("disable", True)])
def test_a_distance_that_is_no_way_is_named_as_rough(native: str, is_rough: bool) -> None:
    """MuJoCo's older collision of convex shapes tells a distance that falls by another way than the
    bodies approach.
    """
    model = f"""<mujoco><option gravity="0 0 0"><flag nativeccd="{native}"/></option>
    <asset><mesh name="m" vertex="0 0 .1 .1 0 -.05 -.1 .1 -.05 -.1 -.1 -.05"/></asset><worldbody>
    <geom name="peak" type="mesh" mesh="m"/>
    <body name="can" pos=".01 .005 .35"><freejoint/><geom type="cylinder" size=".03 .02"/></body>
    </worldbody></mujoco>"""
    found = measure(model, "can,peak", diagnose=False, rest=False, speeds=[0.5], phases=[0.3])
    assert any("rough for these shapes" in note for note in found.facts.notes) == is_rough


def test_nearest_points_at_touch_tell_no_normal() -> None:
    """There rounding makes the line between them; that of MuJoCo's contact counts."""
    up, aside = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    pair: Any = SimpleNamespace(contact=lambda _: SimpleNamespace(normal=up))
    np.testing.assert_array_equal(touch_search._normal_at_touch(pair, None, aside), up)
    tilted = np.array([0.1, 0.0, 0.995])
    np.testing.assert_array_equal(touch_search._normal_at_touch(pair, None, tilted), tilted)
