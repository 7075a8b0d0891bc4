"""Mover and pose of the launches: --move, a free base by name, the state of a simulation."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from hcbench.measuring import Measurement, measure
from hcbench.system.errors import UserError

# A chassis with a wheel on a suspension that hangs on the chassis alone;
# no gravity, nothing else acts.
ROVER = """<mujoco><option timestep="1e-4" gravity="0 0 0"/><worldbody>
<geom name="ground" type="plane" size="3 3 .1"/><body name="chassis" pos="0 0 .4"><freejoint/>
<geom type="box" size=".3 .2 .05" mass="20" contype="0" conaffinity="0"/>
<body name="arm" pos=".3 0 -.1"><joint name="swing" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 .1 0 0" size=".01" mass="1" contype="0" conaffinity="0"/>
<body name="upright" pos=".1 0 0"><joint name="suspension" type="slide" axis="0 0 1"/>
<geom name="tyre" type="sphere" size=".1" mass="3" solref="-80000 -40"/></body></body></body>
</worldbody></mujoco>"""
URDF = """<robot name="lander"><link name="trunk"><inertial><mass value="4"/>
<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="foot"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><geometry><sphere radius=".1"/></geometry></collision></link>
<joint name="leg" type="prismatic"><parent link="trunk"/><child link="foot"/><origin xyz="0 0 -.3"/>
<axis xyz="0 0 1"/><limit lower="-.2" upper=".2" effort="100" velocity="10"/></joint></robot>"""
PLANE = """<robot name="plane"><link name="plane"><inertial><mass value="0"/>
<inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial><collision><origin xyz="0 0 -1"/>
<geometry><box size="9 9 2"/></geometry></collision></link></robot>"""


def launched(move: str | None, **more: Any) -> Measurement:
    return measure(
        ROVER, "geom:tyre,ground", speeds=[0.5], phases=[0.3], diagnose=False, move=move, **more
    )


def test_move_launches_the_wheel_the_leg_or_the_whole_robot() -> None:
    """The impulse on the wheel is the same; what the rest of the robot does before it is not."""
    words = {
        None: "'upright' on its slide (--move chooses)",
        "joint:suspension": "'upright' on its joint suspension",
        "body:upright": "'upright' on its joint suspension",
        " body: upright ": "'upright' on its joint suspension",
        "body:arm": "'upright' on its joints (swing, suspension)",
        "base:": "the whole robot, by its base 'chassis'",
    }
    masses = set()
    for move, description in words.items():
        found = launched(move)
        assert description in found.facts.moved
        assert found.curve[0].speed_in == pytest.approx(0.5, rel=1e-3)
        masses.add(round(found.facts.effective_mass, 2))
    assert len(masses) == 1


def test_a_joint_is_found_by_its_name_as_the_model_has_it_and_as_it_is_shown() -> None:
    tabbed = ROVER.replace('"suspension"', '"sus&#9;pension"')
    for name in ("sus\tpension", "sus?pension"):
        found = measure(
            tabbed,
            "geom:tyre,ground",
            speeds=[0.5],
            phases=[0.3],
            diagnose=False,
            move=f"joint:{name}",
            qpos={name: 0.1},
        )
        assert "'upright' on its joint sus?pension" in found.facts.moved


@pytest.mark.parametrize(
    ("move", "words"),
    [
        ("joint:nope", "no joint 'nope'"),
        ("body:nope", "no body 'nope'"),
        ("body: ", "base:, body:NAME or joint:NAME"),
        ("wheel", "base:, body:NAME or joint:NAME"),
        ("base:chassis", "base:, body:NAME or joint:NAME"),
    ],
)
def test_what_cannot_be_moved_is_refused(move: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        launched(move)


def test_a_body_that_carries_neither_is_refused() -> None:
    spare = ROVER.replace(
        "</worldbody>", '<body name="spare"><freejoint/><geom size=".1"/></body></worldbody>'
    )
    with pytest.raises(UserError, match="moves neither"):
        measure(spare, "geom:tyre,ground", speeds=[0.5], move="body:spare", diagnose=False)


@pytest.mark.parametrize(
    "qpos", ["base=0.5, 0, 0.3", "chassis=0.5 0 0.3", {"base": [0.5, 0, 0.3, 1, 0, 0, 0]}]
)
def test_a_free_base_without_a_joints_name_is_put_where_the_user_says(qpos: Any) -> None:
    assert launched("base:", qpos=qpos).facts.point[0] == pytest.approx(0.9)


def test_the_pose_of_a_running_simulation_is_taken() -> None:
    model = mujoco.MjModel.from_xml_string(ROVER)
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[:] = 0.7, 1.0
    for found in (
        measure(model, "geom:tyre,ground", speeds=[0.5], diagnose=False, state=data),
        measure((model, data), "geom:tyre,ground", speeds=[0.5], diagnose=False),
    ):
        assert found.facts.point[0] == pytest.approx(1.1)
    assert np.all(data.qvel == 1.0)
    with pytest.raises(UserError, match="such as an MjData"):
        launched(None, state=3.0)


@pytest.mark.needs_engine("pybullet")
def test_pybullet_launches_the_base_or_the_leg(tmp_path: Path) -> None:
    (tmp_path / "lander.urdf").write_text(URDF)
    (tmp_path / "plane.urdf").write_text(PLANE)
    files = [tmp_path / "lander.urdf", tmp_path / "plane.urdf"]
    for move, qpos, words in (
        ("base:", None, "by its free base"),
        ("joint:leg", "base=0, 0, 0.5", "by its joint 'leg'"),
        ("body:foot", "base=0, 0, 0.5", "by its joint 'leg'"),
    ):
        found = measure(files, speeds=[0.5], phases=1, diagnose=False, move=move, qpos=qpos)
        assert words in found.facts.moved
        assert found.curve[0].speed_in > 0
    with pytest.raises(UserError, match="moves neither"):
        measure(files, speeds=[0.5], diagnose=False, move="joint:hip", qpos="base=0, 0, 0.5")


def test_a_joint_with_a_name_longer_than_is_shown_moves_by_it() -> None:
    name = 100 * "s"
    text = ROVER.replace('name="suspension"', f'name="{name}"')
    moved = measure(
        text, "geom:tyre,ground", speeds=[0.5], phases=[0.3], diagnose=False, move=f"joint:{name}"
    )
    own = launched("joint:suspension")
    assert moved.facts.effective_mass == own.facts.effective_mass
