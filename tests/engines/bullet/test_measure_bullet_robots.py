"""PyBullet worlds as people write them: scripts without client ids,
fixed robots, poses, sides, pairs.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hcbench.laws.force import HuntCrossley
from hcbench.measuring import measure
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.system.errors import UserError
from hcbench.terms.impact import Launch
from hcbench.terms.scene import load_scene
from hcbench.workers import call

pytest.importorskip("pybullet")
pybullet_data = pytest.importorskip("pybullet_data")

SCRIPT = """
import pybullet as p
import pybullet_data
from pybullet_utils.bullet_client import BulletClient

def plain():
    p.connect(p.DIRECT)
    build(p)

def client():
    bullet = BulletClient(p.DIRECT)
    build(bullet)
    return bullet

def build(b):
    b.setAdditionalSearchPath(pybullet_data.getDataPath())
    b.setPhysicsEngineParameter(contactBreakingThreshold=0.02, numSubSteps=0)
    b.setGravity(0, 0, 0)
    b.loadURDF("plane.urdf")
    b.loadURDF("kuka_iiwa/model.urdf", useFixedBase=True)
    for joint in range(7):
        b.setJointMotorControl2(1, joint, b.VELOCITY_CONTROL, force=0)
        b.changeDynamics(1, joint, restitution=0.6, linearDamping=0, angularDamping=0, jointDamping=0)
    b.changeDynamics(0, -1, restitution=1)
    b.setPhysicsEngineParameter(restitutionVelocityThreshold=0, contactSlop=0, contactERP=0)
    b.loadURDF("sphere_small.urdf", [1, 1, 0.5])
"""
TIP = "body:1/lbr_iiwa_link_7,body:0"


@pytest.fixture
def script(tmp_path: Path) -> Path:
    path = tmp_path / "world.py"
    path.write_text(SCRIPT)
    return path


@pytest.mark.parametrize("function", ["plain", "client"])
def test_an_ordinary_script_is_measured_and_its_causes_are_tried(
    script: Path, function: str
) -> None:
    found = measure(f"{script}:{function}", "body:2,body:0", speeds=[0.5, 1.0], phases=2)
    assert "other-body" in {cause.code for cause in found.causes}
    assert all(np.isfinite(c.alone) for c in found.causes)


def test_a_script_has_the_first_client_to_itself_after_worlds_of_ours(script: Path) -> None:
    """In one worker process: a scene's world, the script, and a scene's world again."""
    target = Target(HuntCrossley(3.4e10, 0.3), 0.45, 1e-3, 0.1, 0.5)
    setting, scene = registry.recipe("pybullet.restitution")(target), load_scene("steel-plane")

    def e_of_scene() -> float:
        return registry.engine("pybullet").run(scene, setting, [Launch(0.3)])[0].restitution

    before = e_of_scene()
    found = measure(f"{script}:plain", "body:2,body:0", speeds=[0.5], phases=1, diagnose=False)
    assert found.curve[0].samples
    assert e_of_scene() == before


def test_a_script_that_failed_leaves_no_client_to_the_next(script: Path, tmp_path: Path) -> None:
    """Nor does a file that PyBullet refuses."""
    fails, bad = tmp_path / "fails.py", tmp_path / "bad.urdf"
    fails.write_text(
        "def world():\n import pybullet as p\n p.connect(p.DIRECT)\n p.loadURDF('none.urdf')\n"
    )
    bad.write_text('<robot name="r"><link name="a"/><link name="a"/></robot>')
    for broken in (f"{fails}:world", bad):
        with pytest.raises(UserError):
            measure(broken, "body:2,body:0", speeds=[0.5], phases=1, diagnose=False)
    found = measure(f"{script}:plain", "body:2,body:0", speeds=[0.5], phases=1, diagnose=False)
    assert found.curve[0].samples


def arm_by_hand(
    script: str, qpos: list[float], rates: list[float], speed: float, phase: float
) -> float:
    """e of the arm's tip on the plane: the loop that a user writes, over the tip's own velocity."""
    import runpy

    import pybullet as p

    from hcbench.engines.pybullet.backend import end_clients

    end_clients()  # the script's is the first
    runpy.run_path(script)["plain"]()
    for joint, (q, rate) in enumerate(zip(qpos, rates, strict=True)):
        p.resetJointState(1, joint, q - rate * (2 + phase) / 240 * speed, rate * speed)
    into, point = 0.0, np.zeros(3)
    try:
        for _ in range(400):
            before = tip_speed(p, point)
            states = p.getLinkState(1, 6, computeLinkVelocity=1, computeForwardKinematics=1)
            p.stepSimulation()
            contacts = [c for c in p.getContactPoints(1, 0, 6, -1) if c[9] > 0]
            if contacts and not into:
                point = np.array(contacts[0][5])
                v, w = np.array(states[6]), np.array(states[7])
                into = -float((v + np.cross(w, np.subtract(point, states[0])))[2])
            elif into and not contacts:
                return before / into
        raise AssertionError("it never left")
    finally:
        p.disconnect()


def tip_speed(p: Any, point: Any) -> float:
    state = p.getLinkState(1, 6, computeLinkVelocity=1, computeForwardKinematics=1)
    v, w = np.array(state[6]), np.array(state[7])
    return float((v + np.cross(w, np.subtract(point, state[0])))[2])


def placed(script: str) -> tuple[list[float], list[float]]:
    """Joint positions at touch and rates for an approach at 1 m/s, by hcbench."""
    import runpy

    from hcbench.engines.pybullet.backend import end_clients
    from hcbench.engines.pybullet.model.bodies import SwingingLink
    from hcbench.engines.pybullet.model.under_test import open_world
    from hcbench.measuring.request import make_request

    end_clients()
    make = runpy.run_path(script)["plain"]
    make()
    with open_world(None, make_request(TIP, speeds=[0.5]), make) as world:
        mover = world.place.mover
        assert isinstance(mover, SwingingLink)
        starts = [mover.starts[j] + mover.rates[j] * world.place.travel for j in range(7)]
        return starts, [mover.rates[j] for j in range(7)]


def test_a_fixed_arms_tip_is_that_of_a_loop_written_by_hand(script: Path) -> None:
    qpos, rates = call(placed, str(script), limit=60)
    for speed in (0.5, 1.0):
        found = measure(f"{script}:plain", TIP, speeds=[speed], phases=[0.5], diagnose=False)
        by_hand = call(arm_by_hand, str(script), qpos, rates, speed, 0.5, limit=60)
        assert found.curve[0].restitution == pytest.approx(by_hand, abs=1e-4)
        assert "by its joints" in found.facts.moved


def test_files_come_from_above_by_default() -> None:
    data = Path(pybullet_data.getDataPath())
    files = [data / "soccerball.urdf", data / "table" / "table.urdf"]
    above = measure(files, speeds=[0.5], phases=1, diagnose=False).facts
    assert above.normal == pytest.approx((0, 0, -1), abs=1e-6)
    assert above.point[2] == pytest.approx(0.625, abs=1e-3)
    assert any("approaches from above" in note for note in above.notes)
    side = measure(files, coming_from="+x", speeds=[0.5], phases=1, diagnose=False).facts
    assert side.normal[0] == pytest.approx(-1, abs=1e-6)


def test_joints_are_posed_by_name_and_held_within_limits(script: Path) -> None:
    found = measure(
        f"{script}:plain",
        TIP,
        qpos="lbr_iiwa_joint_2=80 deg",
        speeds=[0.5],
        phases=1,
        diagnose=False,
    )
    assert found.facts.effective_mass > 0
    with pytest.raises(UserError, match=r"lbr_iiwa_joint_2 by 51.9 deg.*from qpos"):
        measure(f"{script}:plain", TIP, qpos="lbr_iiwa_joint_2=3.0", speeds=[0.5])
    with pytest.raises(UserError, match="Did you mean 'lbr_iiwa_joint_2'"):
        measure(f"{script}:plain", TIP, qpos="lbr_iiwa_joint2=1", speeds=[0.5])


def test_without_a_pair_the_candidates_are_listed(script: Path) -> None:
    with pytest.raises(UserError, match=r"leaves a choice of .*hcbench measure"):
        measure(f"{script}:plain")
