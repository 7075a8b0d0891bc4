"""Trees of bodies that fall: by which joints, and which of several is the robot."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest

import hcbench as hb
from hcbench.engines.mujoco.model.drop_test import ModelDropBench
from hcbench.engines.mujoco.model.falling import Base, base_of, robot_in
from hcbench.measuring.request import make_request
from hcbench.sim.landing import DROPS, SECONDS_TO_FALL
from hcbench.system.errors import UserError

G = 9.81
FLOOR = '<geom name="floor" type="plane" size="3 3 .1"/>'
SPRING = 'stiffness="900" damping="12"'
# A trunk on some joints, over a foot on a piston.
HOPPER = """<body name="trunk" pos="0 0 .4">{root}<geom type="box" size=".1 .05 .05" mass="3"/>
<body pos="0 0 -.1"><joint name="piston" type="slide" axis="0 0 1" range="-.1 .1" {piston}/>
<geom name="foot" pos="0 0 -.15" size=".03" mass=".2"/></body></body>"""
RAIL = '<joint name="rail" type="slide" axis="{0}" {1}/>'
VERTICAL = RAIL.format("0 0 1", "")
PLANAR = RAIL.format("1 0 0", "") + VERTICAL.replace("rail", "up")
PLANAR += '<joint name="pitch" type="hinge" axis="0 1 0"/>'
CUBE = (
    '<body name="cube" pos="1 0 .1"><freejoint/><geom type="box" size=".1 .1 .1" mass="50"/></body>'
)
SERVO = '<actuator><position joint="{0}" kp="2000" kv="60"/></actuator>'


def mjcf(root: str, piston: str = SPRING, more: str = "", rest: str = "") -> str:
    body = HOPPER.format(root=root, piston=piston)
    option = '<option timestep="1e-3" integrator="implicitfast"/>'
    return f"<mujoco>{option}<worldbody>{FLOOR}{body}{more}</worldbody>{rest}</mujoco>"


def opened(text: str) -> tuple[Any, Any]:
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def base(text: str) -> Base:
    return base_of(*opened(text), 1)


@pytest.mark.parametrize(
    ("root", "turns"),
    [
        ("<freejoint/>", True),
        (VERTICAL, False),
        (PLANAR, True),
        (f'{VERTICAL}<joint name="ball" type="ball"/>', True),
        (RAIL.format(".5 0 .87", ""), False),
    ],
)
def test_a_base_rises_by_the_height_and_tilts_by_the_angle(root: str, turns: bool) -> None:
    model, data = opened(mjcf(root))
    found = base_of(model, data, 1)
    assert (found.turns_by is not None, found.has_joints) == (turns, True)
    before = data.xpos[1].copy()
    found.lift(model, data, 0.1)
    found.tilt(model, data, (0.0, 1.0, 0.0), 0.2)
    mujoco.mj_kinematics(model, data)
    assert data.xpos[1][2] - before[2] == pytest.approx(0.1)
    # The axis z of the trunk in the world, turned about y.
    upright = data.xmat[1].reshape(3, 3)[:, 2]
    expected = (math.sin(0.2), 0.0, math.cos(0.2)) if turns else (0.0, 0.0, 1.0)
    np.testing.assert_allclose(upright, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (mjcf(""), "no joint of its base lets it"),
        (mjcf(RAIL.format("1 0 .5", "")), "no joint of its base lets it"),
        (mjcf(VERTICAL, rest=SERVO.format("rail")), "no joint of its base lets it"),
        (mjcf(RAIL.format("0 0 1", 'stiffness="500"')), "no joint of its base lets it"),
        (mjcf("<freejoint/>").replace('"trunk"', '"trunk" gravcomp="1"'), "other forces hold it"),
        (
            mjcf("<freejoint/>", rest='<equality><weld name="hook" body1="trunk"/></equality>'),
            "'hook' holds it",
        ),
    ],
)
def test_what_is_held_does_not_fall(text: str, words: str) -> None:
    with pytest.raises(UserError, match=f"'trunk' does not fall: .*{words}"):
        base(text)


def test_a_slide_is_lengthened_for_the_drop_and_has_to_reach_the_floor() -> None:
    ends = 'limited="true" range="{0} .05"'
    short, long = (mjcf(RAIL.format("0 0 1", ends.format(low))) for low in (-0.1, -0.5))
    with pytest.raises(UserError, match=r"the slide 'rail', -0\.1 \.\.\. 0\.05 m"):
        hb.land(short, heights="20 cm")
    own, endless = (hb.land(text, heights="40 cm").drops[0] for text in (long, mjcf(VERTICAL)))
    assert own.speed_in == pytest.approx(endless.speed_in, abs=1e-9)
    assert own.peak == pytest.approx(endless.peak, rel=1e-6)


@pytest.mark.parametrize("root", [VERTICAL, PLANAR, RAIL.format(".5 0 .87", "")])
def test_a_robot_without_a_free_base_lands_at_the_speed_of_its_fall(root: str) -> None:
    """Along a slide of an angle it has the whole speed of its height, downwards its sine."""
    (drop,) = hb.land(mjcf(root), heights="5 cm").drops
    sine = 0.87 / math.hypot(0.5, 0.87) if "0.5" in root or ".5 0" in root else 1.0
    assert drop.speed_in == pytest.approx(sine * math.sqrt(2 * G * 0.05), abs=2 * G * 1e-3)
    assert [foot.part for foot in drop.feet] == ["foot"]


def test_the_tree_that_actuators_drive_is_the_robot_and_another_is_dropped_by_name() -> None:
    text = mjcf("<freejoint/>", piston="", more=CUBE, rest=SERVO.format("piston"))
    landings = hb.land(text, heights="5 cm")
    assert landings.robot == "trunk"
    assert "2 trees of bodies fall; 'trunk' is dropped. --move body:NAME" in landings.notes[0]
    assert hb.land(text, heights="5 cm", move="body:cube").robot == "cube"
    with pytest.raises(UserError, match=r"no body 'cub'.*Did you mean 'cube'"):
        hb.land(text, heights="5 cm", move="body:cub")


def test_a_driven_tree_that_does_not_fall_is_told() -> None:
    model, data = opened(mjcf(VERTICAL, more=CUBE, rest=SERVO.format("rail")))
    found, notes = robot_in(model, data, None)
    assert model.body(found.root).name == "cube"
    assert notes == ["'cube' is dropped: 'trunk', which actuators drive, does not fall."]


def test_a_base_that_cannot_turn_is_not_tilted() -> None:
    with pytest.raises(UserError, match="the base 'trunk' cannot turn"):
        hb.land(mjcf(VERTICAL), heights="5 cm", tilt="5 deg")
    spec = mujoco.MjSpec.from_string(mjcf(VERTICAL))
    bench = ModelDropBench(spec, "hopper", [make_request("foot,floor")])
    assert list(bench.drops) == [drop for drop in DROPS if not drop.tilt]
    test = bench.test(SECONDS_TO_FALL, bench.drops)
    assert (test.drops, test.flat) == (12, 12)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_land_and_tune_read_the_same_contacts_under_each_integrator(integrator: str) -> None:
    """Under RK4 `land` read those of a step's last stage."""
    text = mjcf(VERTICAL).replace("implicitfast", integrator).replace("1e-3", "4e-3")
    (drop,) = hb.land(text, heights="10 cm").drops
    bench = ModelDropBench(mujoco.MjSpec.from_string(text), "hopper", [make_request("foot,floor")])
    flat = [each for each in DROPS if each.height == 0.1 and not each.tilt]
    test = bench.test(SECONDS_TO_FALL, flat)
    assert test.peak == pytest.approx(drop.over_phases("peak")[1], rel=1e-6)
    assert test.depth == pytest.approx(drop.over_phases("penetration")[1], rel=1e-6)
