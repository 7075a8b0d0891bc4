"""A robot of PyBullet dropped on its floor: against a loop of plain PyBullet that reads momentum."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bullet_hopper import FLOOR, INERTIA, ROBOT

import hcbench as hb
from hcbench.cli import run
from hcbench.system.errors import UserError
from hcbench.workers import process

p = pytest.importorskip("pybullet")
BulletClient = pytest.importorskip("pybullet_utils.bullet_client").BulletClient
pytestmark = pytest.mark.skipif(not process.CAN_FORK, reason="needs a system that forks")

G = 9.81


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    """A robot of a trunk on a foot, and a floor whose top is half a metre up."""
    (tmp_path / "hopper.urdf").write_text(ROBOT)
    (tmp_path / "floor.urdf").write_text(FLOOR)
    return [str(tmp_path / "hopper.urdf"), str(tmp_path / "floor.urdf")]


def dropped(files: list[str], height: float) -> tuple[float, float]:
    """(speed of the centre of mass at the first push, m/s; largest force over the weight): what the
    momentum of trunk and foot, both moving along z, changes by beside gravity.
    """
    world = BulletClient(p.DIRECT)
    robot = world.loadURDF(files[0], [0, 0, 0.5 + 0.22 + height])
    world.loadURDF(files[1])
    world.setGravity(0, 0, -G)
    world.setJointMotorControl2(robot, 0, p.POSITION_CONTROL, targetPosition=0, force=400)
    forces, speeds = [], []
    for _ in range(120):
        before = _speed(world, robot)
        world.stepSimulation()
        speeds.append(before)
        forces.append(1.0 + 240.0 * (_speed(world, robot) - before) / G)
    first = int(np.argmax(np.array(forces) > 0.1))
    return -speeds[first], max(forces)


def _speed(world: Any, robot: int) -> float:
    foot = world.getLinkState(robot, 0, computeLinkVelocity=1, computeForwardKinematics=1)[6]
    return float((2.0 * world.getBaseVelocity(robot)[0][2] + 0.5 * foot[2]) / 2.5)


def test_a_landing_is_that_of_a_plain_loop(files: list[str]) -> None:
    """The floor's force comes from contacts here and from momentum there, which Bullet damps."""
    landings = hb.land(files, heights=[0.05, 0.2], gravity=G)
    assert (landings.engine, landings.robot, landings.floor) == (
        "pybullet",
        "hopper.urdf",
        "floor.urdf",
    )
    assert landings.mass == pytest.approx(2.5)
    for drop in landings.drops:
        speed, peak = dropped(files, drop.height)
        assert drop.speed_in == pytest.approx(speed, rel=1e-3)
        assert drop.peak == pytest.approx(peak, rel=0.02)
        assert drop.feet[0].part == "foot"
        assert 0.0 < drop.penetration < 0.05
    assert landings.drops[1].peak > landings.drops[0].peak


def test_a_landing_has_the_drops_that_touch_later_in_a_step(files: list[str]) -> None:
    drop = hb.land(files, heights=0.05, gravity=G).drops[0]
    more = 0.5 / 240.0 * (2.0 * G * 0.05) ** 0.5
    same = hb.land(files, heights=0.05 + more, gravity=G).drops[0]
    assert drop.others[1].peak == pytest.approx(same.peak, rel=1e-6)
    assert drop.over_phases("peak")[1] > drop.over_phases("peak")[0]


def test_gains_a_function_and_the_worlds_motors_hold_the_joints(files: list[str]) -> None:
    called = []

    def drive(client: int, robot: int) -> None:
        called.append((client, robot))

    stiff = hb.land(files, heights=0.1, gravity=G, controller="pd:5000,50").drops[0]
    assert stiff.speed_in == pytest.approx((2 * G * 0.1) ** 0.5, rel=0.02)
    assert hb.land(files, heights=0.1, gravity=G, controller=drive).drops[0].peak > 1.0
    assert hb.land(files, heights=0.1, gravity=G, controller="ctrl").drops[0].peak > 1.0


@pytest.mark.parametrize(
    ("which", "options", "words"),
    [
        ((0, 1), {}, "gravity"),
        ((0,), {"gravity": G, "engine": "pybullet"}, "fixed"),
        ((1,), {"gravity": G, "engine": "pybullet"}, "free base"),
        ((0, 1), {"gravity": G, "controller": "pd:1"}, "controller"),
        ((0, 1), {"gravity": G, "key": "home"}, "keyframe"),
    ],
)
def test_what_cannot_land_is_said(
    files: list[str], which: tuple[int, ...], options: dict[str, Any], words: str
) -> None:
    with pytest.raises(UserError, match=words):
        hb.land([files[i] for i in which], heights=0.1, **options)


def test_two_urdfs_are_one_robot_and_its_floor(
    files: list[str], capsys: pytest.CaptureFixture[Any]
) -> None:
    assert run(["land", *files, "--heights", "5 cm", "--gravity", "9.81"]) == 0
    out = capsys.readouterr().out
    assert "hopper.urdf (2.5 kg)" in out
    assert "position motors hold 1 joints" in out


def test_a_robot_whose_legs_are_under_a_thin_floor_lands_on_its_foot(
    files: list[str], tmp_path: Path
) -> None:
    """Many URDFs have their origin in the base: at height 0 the legs are under a slab."""
    slab = FLOOR.replace('size="9 9 1"', 'size="9 9 .05"')
    (tmp_path / "slab.urdf").write_text(slab)
    robot = files[0]
    high = hb.land(
        [robot, str(tmp_path / "slab.urdf")], heights=[0.1], gravity=G, qpos="base=0,0,3"
    )
    through = hb.land(
        [robot, str(tmp_path / "slab.urdf")], heights=[0.1], gravity=G, qpos="base=0,0,0.1"
    )
    (of_high,) = high.drops
    (of_through,) = through.drops
    assert [foot.part for foot in of_through.feet] == [foot.part for foot in of_high.feet]
    assert of_through.peak == pytest.approx(of_high.peak, rel=0.02)


def test_a_robot_with_something_in_its_way_is_refused(files: list[str], tmp_path: Path) -> None:
    """The speed at its touch was 0, and e a division by it."""
    lid = FLOOR.replace('size="9 9 1"', 'size=".3 .3 .1"').replace(
        "<collision>", '<collision><origin xyz="0 0 1.0"/>'
    )
    (tmp_path / "lid.urdf").write_text(lid)
    with pytest.raises(UserError, match="free way down to a floor"):
        hb.land([*files, str(tmp_path / "lid.urdf")], heights=[0.1], gravity=G, qpos="base=0,0,0.9")


@pytest.fixture
def two_that_fall(files: list[str], tmp_path: Path) -> Any:
    """A client with the robot over its floor, and a ball of 0.4 kg beside it."""
    ball = tmp_path / "ball.urdf"
    ball.write_text(
        '<robot name="marble"><link name="shell"><inertial><mass value=".4"/>'
        + INERTIA.format(i=1e-4)
        + '</inertial><collision><geometry><sphere radius=".05"/></geometry></collision></link></robot>'
    )
    world = BulletClient(p.DIRECT)
    world.setGravity(0, 0, -G)
    world.loadURDF(files[0], [0, 0, 1])
    world.loadURDF(files[1])
    world.loadURDF(str(ball), [2, 0, 1])
    return world


@pytest.mark.parametrize(
    ("move", "robot", "mass"),
    [
        ("body:marble", "body:2", 0.4),
        ("body:2", "body:2", 0.4),
        ("body:shell", "body:2", 0.4),
        ("body:foot", "body:0", 2.5),
        ("joint:leg", "body:0", 2.5),
        ("base:", "body:0", 2.5),
    ],
)
def test_another_body_is_dropped_by_its_name(
    two_that_fall: Any, move: str, robot: str, mass: float
) -> None:
    landings = hb.land(two_that_fall, heights=0.1, move=move)
    assert landings.robot == robot
    assert landings.mass == pytest.approx(mass)
    assert landings.drops[0].speed_in == pytest.approx((2.0 * G * 0.1) ** 0.5, rel=0.02)
    # A user who chose is not told of a choice.
    assert not any("--move" in note for note in landings.notes) or move == "base:"


def test_of_several_bodies_that_fall_the_others_are_named(two_that_fall: Any) -> None:
    landings = hb.land(two_that_fall, heights=0.1)
    (note,) = [note for note in landings.notes if "--move" in note]
    assert note.startswith("2 bodies fall; 'body:0' is dropped.")
    assert note.endswith("drops another: 'body:2'.")


@pytest.mark.parametrize(
    ("move", "words"),
    [
        ("body:hoper", "move: no body 'hoper'.*hopper"),
        ("joint:knee", "move: no joint 'knee'.*leg"),
        ("body:floor", "move: 'floor.urdf' is fixed; expected one that falls: hopper.urdf"),
    ],
)
def test_a_body_that_cannot_be_dropped_is_said(files: list[str], move: str, words: str) -> None:
    with pytest.raises(UserError, match=words):
        hb.land(files, heights=0.1, gravity=G, move=move)
