"""A motion recorded in plain PyBullet: the speeds of its touchdowns, against a loop of our own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bullet_hopper import FLOOR, ROBOT

import hcbench as hb
from hcbench.cli import run
from hcbench.system.errors import UserError
from hcbench.workers import process

p = pytest.importorskip("pybullet")
BulletClient = pytest.importorskip("pybullet_utils.bullet_client").BulletClient
pytestmark = pytest.mark.skipif(not process.CAN_FORK, reason="needs a system that forks")

STEP = 1 / 240


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("world")
    (folder / "hopper.urdf").write_text(ROBOT)
    (folder / "floor.urdf").write_text(FLOOR)
    return [str(folder / "hopper.urdf"), str(folder / "floor.urdf")]


def hops(files: list[str]) -> tuple[dict[str, np.ndarray[Any, Any]], list[float], list[float]]:
    """(states of a robot that hops along a floor, fall and slide speed, m/s, of its foot before each
    touch): the foot's motion by differences of its place, contacts by its height over the floor.
    """
    world: Any = BulletClient(p.DIRECT)
    robot = world.loadURDF(files[0], [0, 0, 0.5 + 0.22 + 0.1])
    floor = world.loadURDF(files[1])
    world.setGravity(0, 0, -9.81)
    world.changeDynamics(robot, 0, restitution=0.7, lateralFriction=0)
    world.changeDynamics(floor, -1, restitution=1)
    world.setPhysicsEngineParameter(contactERP=0, restitutionVelocityThreshold=0)
    world.setJointMotorControl2(robot, 0, p.POSITION_CONTROL, targetPosition=0, force=400)
    world.resetBaseVelocity(robot, [0.3, 0, 0])
    qpos, qvel, place = [], [], []
    for _ in range(360):
        joint = world.getJointState(robot, 0)[:2]
        where, turn = world.getBasePositionAndOrientation(robot)
        speed, spin = world.getBaseVelocity(robot)
        qpos.append([*where, *turn, joint[0]])
        qvel.append([*speed, *spin, joint[1]])
        foot = world.getLinkState(robot, 0, computeForwardKinematics=1)[0]
        place.append((foot[0], foot[2] - 0.02 - 0.5))
        world.stepSimulation()
    world.disconnect()
    x, height = np.array(place).T
    on = height <= 1e-4
    begins = [i for i in range(2, 360) if on[i] and not on[i - 1] and not on[i - 2]]
    falls = [
        float(max(height[i - 2] - height[i - 1], height[i - 1] - height[i]) / STEP) for i in begins
    ]
    slides = [float((x[i - 1] - x[i - 2]) / STEP) for i in begins]
    return {"qpos": np.array(qpos), "qvel": np.array(qvel)}, falls, slides


def test_a_recorded_motion_has_the_touchdowns_of_a_plain_loop(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded, falls, slides = hops(files)
    # Later it hops, step by step, as Bullet's restitution does.
    count = sum(fall > 0.3 for fall in falls)
    assert count >= 2
    assert all(fall > 0.3 for fall in falls[:count])
    motion = hb.measure_trajectory(files, recorded)
    (foot,) = motion.feet
    assert (foot.part, foot.other, motion.states) == ("foot", "floor.urdf", 360)
    # A difference of places has the mean of a step, in which gravity adds 0.04 m/s.
    assert foot.speed[:count] == pytest.approx(falls[:count], abs=0.05)
    assert foot.slide[:count] == pytest.approx(slides[:count], abs=0.02)
    assert sum(foot.speed > 0.3) == count
    assert motion.interval == pytest.approx(STEP)
    arrays: dict[str, Any] = dict(recorded)
    np.savez(tmp_path / "states.npz", **arrays)
    asked = ["--pair", "floor,foot", "--trajectory", str(tmp_path / "states.npz")]
    assert run(["measure", *files, *asked]) == 0
    assert f"foot  floor.urdf     {len(foot.time)}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda a: {"qpos": a["qpos"][:, :7], "qvel": a["qvel"]}, "x y z w, 1 joints"),
        (lambda a: {"qpos": 0 * a["qpos"], "qvel": a["qvel"]}, "quaternion"),
        (lambda a: {"qpos": a["qpos"]}, "no 'qvel'"),
    ],
)
def test_states_that_no_body_has_are_refused(files: list[str], change: Any, words: str) -> None:
    states = {"qpos": np.ones((3, 8)), "qvel": np.ones((3, 7))}
    with pytest.raises(UserError, match=words):
        hb.measure_trajectory(files, change(states))
