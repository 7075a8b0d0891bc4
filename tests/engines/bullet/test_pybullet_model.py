"""One body has one effective mass: the plug-in's and measure's are
Bullet's own force over acceleration.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hcbench.contact import pybullet as contact
from hcbench.engines.pybullet.backend import BulletClient
from hcbench.engines.pybullet.model.open import BodyPart
from hcbench.engines.pybullet.model.open import LiveWorld as World
from hcbench.engines.pybullet.model.place import swing_to_touch
from hcbench.measuring import measure
from hcbench.measuring.measure import pairs
from hcbench.measuring.request import make_request
from hcbench.sim import registry
from hcbench.sim.capabilities import opener
from hcbench.system.errors import SettingError, UserError

bullet = pytest.importorskip("pybullet", reason="no PyBullet for this Python")

H = 1e-6  # s: short, so that a step from rest does not leave the state that it starts from
TURN = (0.1, 0.2, -0.1, 0.9695359714832659)
SPHERE = '<collision><origin xyz="0.03 0.02 -0.04"/><geometry><sphere radius="0.05"/></geometry></collision>'


def link(name: str, mass: float, inertia: str, com: str = "0 0 0", turn: str = "0 0 0") -> str:
    ixx, iyy, izz = inertia.split()
    return (
        f'<link name="{name}"><inertial><origin xyz="{com}" rpy="{turn}"/><mass value="{mass}"/><inertia '
        f'ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(
    kind: str, parent: str, child: str, origin: str, axis: str = "0 1 0", turn: str = "0 0 0"
) -> str:
    return (
        f'<joint name="{child}_joint" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{origin}" rpy="{turn}"/><axis xyz="{axis}"/>'
        '<limit lower="-5" upper="5" effort="0" velocity="100"/></joint>'
    )


ROUND, LONG, FLAT = "1e-3 1e-3 1e-3", "2e-2 1e-2 2.5e-2", "1e-3 2e-3 2.5e-3"
HINGED = (
    link("base", 1, ROUND)
    + link("arm", 3, "1e-6 1e-6 1e-6")
    + joint("continuous", "base", "arm", "0.2 0 0")
)
SKEW = (
    link("base", 1, FLAT, "0.01 0.02 0.03", "0.3 0.2 0.1"),
    link("arm", 3, LONG, "0.2 0.05 0.01", "1 0.2 0.4"),
)
WRIST = (
    link("base", 1, FLAT)
    + link("arm", 2, LONG, "0.1 0.05 0.01", "0.4 0.2 1")
    + link("hand", 0.5, FLAT, "0.02 0.05 0.01", "0.3 0.2 0.4")
    + joint("prismatic", "base", "arm", "0.05 -0.02 -0.1", "0 0.6 -0.8")
    + joint("revolute", "arm", "hand", "0.3 0.02 -0.1", "0.48 -0.6 0.64", "0.1 0.3 -0.2")
)
MODELS = {
    "hinged arm": HINGED,
    "skew hinge": "".join(SKEW)
    + joint("continuous", "base", "arm", "0.05 -0.02 -0.1", turn="0.4 0.3 0.2"),
    "spherical": "".join(SKEW)
    + joint("spherical", "base", "arm", "0.05 -0.02 -0.1", turn="0.4 0.3 0.2"),
    "welded": "".join(SKEW) + joint("fixed", "base", "arm", "0.05 -0.02 -0.1", turn="0.4 0.3 0.2"),
    "slide and hinge": WRIST,
    "long axes": WRIST.replace("0 0.6 -0.8", "0 3 -4").replace("0.48 -0.6 0.64", "12 -15 16"),
}
# (model, whether the base is fixed, link that touches)
CASES = [(model, False, part) for model in MODELS for part in (-1, 0)] + [
    ("slide and hinge", False, 1),
    ("slide and hinge", True, 0),
    ("slide and hinge", True, 1),
    ("long axes", True, 1),
]


class Scene:
    """A robot just inside a plate, at rest, nothing but its joints
    holding it: in a client of its own.
    """

    def __init__(self, path: Path, fixed: bool, part: int) -> None:
        self.client, self.part = bullet.connect(bullet.DIRECT), part
        self.here = {"physicsClientId": self.client}
        bullet.setPhysicsEngineParameter(fixedTimeStep=H, numSubSteps=0, **self.here)
        plane = bullet.createCollisionShape(bullet.GEOM_PLANE, **self.here)
        self.plate = bullet.createMultiBody(0, plane, **self.here)
        flags = bullet.URDF_USE_INERTIA_FROM_FILE
        self.robot = bullet.loadURDF(
            str(path), [0.3, 0.2, 2], TURN, useFixedBase=fixed, flags=flags, **self.here
        )
        joints = bullet.getNumJoints(self.robot, **self.here)
        for j in range(joints):
            kind = bullet.getJointInfo(self.robot, j, **self.here)[2]
            if kind == bullet.JOINT_SPHERICAL:
                bullet.setJointMotorControlMultiDof(
                    self.robot,
                    j,
                    bullet.POSITION_CONTROL,
                    targetPosition=[0, 0, 0, 1],
                    force=[0, 0, 0],
                    **self.here,
                )
                bullet.resetJointStateMultiDof(
                    self.robot, j, [0.3, 0.1, 0.2, 0.9273618495495703], **self.here
                )
            elif kind != bullet.JOINT_FIXED:
                bullet.setJointMotorControl2(
                    self.robot, j, bullet.VELOCITY_CONTROL, force=0, **self.here
                )
                bullet.resetJointState(self.robot, j, 0.05 * (j + 1), **self.here)
        for j in range(-1, joints):
            bullet.changeDynamics(
                self.robot, j, linearDamping=0, angularDamping=0, jointDamping=0, **self.here
            )
        self.lower(self.nearest()[8] + 1e-7)

    def nearest(self) -> Any:
        return bullet.getClosestPoints(self.robot, self.plate, 10.0, self.part, -1, **self.here)[0]

    def lower(self, height: float) -> None:
        position, turn = bullet.getBasePositionAndOrientation(self.robot, **self.here)
        bullet.resetBasePositionAndOrientation(
            self.robot, [*position[:2], position[2] - height], turn, **self.here
        )

    def velocity(self, point: Any) -> Any:
        if self.part < 0:
            centre = bullet.getBasePositionAndOrientation(self.robot, **self.here)[0]
            linear, turning = bullet.getBaseVelocity(self.robot, **self.here)
        else:
            state = bullet.getLinkState(
                self.robot,
                self.part,
                computeLinkVelocity=1,
                computeForwardKinematics=1,
                **self.here,
            )
            centre, linear, turning = state[0], state[6], state[7]
        return np.array(linear) + np.cross(turning, np.subtract(point, centre))

    def force_over_acceleration(self) -> float:
        """Force over acceleration of one step in which 1 N acts where the two touch, kg."""
        point = self.nearest()[5]
        self.lower(-1.0)
        point = np.add(point, [0, 0, 1.0]).tolist()
        bullet.applyExternalForce(
            self.robot, self.part, [0, 0, 1], point, bullet.WORLD_FRAME, **self.here
        )
        bullet.stepSimulation(**self.here)
        return float(H / self.velocity(point)[2])

    def felt_by(self, law: int) -> float:
        """The mass (kg) that a law of e = .3 finds where the two touch, by its force in an impact."""
        before = bullet.saveState(**self.here)
        if bullet.getDynamicsInfo(self.robot, -1, **self.here)[0] > 0.0:
            bullet.resetBaseVelocity(self.robot, [0, 0, -0.5], [0, 0, 0], **self.here)
        else:
            for way in (1, -1):  # one of them approaches
                for j in range(self.part + 1):
                    bullet.resetJointState(self.robot, j, 0.05 * (j + 1), 0.2 * way, **self.here)
                if self.velocity(self.nearest()[5])[2] < 0.0:
                    break
        point = self.nearest()[5]
        approach = -self.velocity(point)[2]
        bullet.stepSimulation(**self.here)
        assert self.velocity(point)[2] == pytest.approx(0.3 * approach, rel=1e-5)
        force = contact.force(law, client=self.client)
        contact.remove(law, client=self.client)
        bullet.restoreState(before, **self.here)
        return float(force * H / (1.3 * approach))


@pytest.fixture
def scene(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Scene]:
    model, fixed, part = request.param
    path = tmp_path / "robot.urdf"
    name = f'<link name="{("base", "arm", "hand")[part + 1]}">'
    path.write_text(f'<robot name="robot">{MODELS[model].replace(name, name + SPHERE)}</robot>')
    made = Scene(path, fixed, part)
    yield made
    bullet.disconnect(made.client)


@pytest.mark.parametrize("scene", CASES, indirect=True, ids=[f"{m}, {f}, {p}" for m, f, p in CASES])
def test_effective_mass_is_force_over_acceleration(scene: Scene) -> None:
    pair = ((scene.robot, scene.part), (scene.plate, -1))
    law = contact.add(contact.ConstantRestitution(0.3), *pair, client=scene.client, friction=0.0)
    felt = scene.felt_by(law)
    world = World(scene.client, pair[0], scene.plate)
    with opener(registry.engine("pybullet")).open(
        world, make_request(speeds=[0.5], phases=[0.5])
    ) as model:
        facts = model.facts()
    expected = scene.force_over_acceleration()
    assert felt == pytest.approx(expected, rel=1e-6)
    assert facts.effective_mass == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("scene", [("hinged arm", False, -1)], indirect=True)
def test_what_hangs_on_a_hinge_is_not_all_felt(scene: Scene) -> None:
    assert scene.force_over_acceleration() < 2.0, "of 4 kg"


def test_two_links_of_one_body_have_their_reduced_mass(tmp_path: Path) -> None:
    rail = joint("prismatic", "base", "arm", "0 0 -0.0999999", "0 0 1")
    links = (link("base", 1, ROUND), link("arm", 3, ROUND))
    path = tmp_path / "slider.urdf"
    path.write_text(
        f'<robot name="robot">{"".join(links).replace("</inertial>", "</inertial>" + SPHERE)}{rail}</robot>'
    )
    client = bullet.connect(bullet.DIRECT)
    here = {"physicsClientId": client}
    bullet.setPhysicsEngineParameter(fixedTimeStep=H, numSubSteps=0, **here)
    flags = bullet.URDF_USE_SELF_COLLISION | bullet.URDF_USE_SELF_COLLISION_INCLUDE_PARENT
    robot = bullet.loadURDF(str(path), flags=flags, **here)
    bullet.setJointMotorControl2(robot, 0, bullet.VELOCITY_CONTROL, force=0, **here)
    bullet.resetJointState(robot, 0, 0.0, 0.5, **here)
    law = contact.add(contact.ConstantRestitution(0.3), (robot, -1), (robot, "arm"), client=client)
    bullet.stepSimulation(**here)
    felt = contact.force(law, client=client) * H / (1.3 * 0.5)
    bullet.disconnect(client)
    assert felt == pytest.approx(1 * 3 / 4, rel=1e-5)


def test_a_planar_joint_has_no_known_effective_mass(tmp_path: Path) -> None:
    path = tmp_path / "planar.urdf"
    arm = link("arm", 3, ROUND).replace("</inertial>", "</inertial>" + SPHERE)
    parts = link("base", 1, ROUND), arm, joint("planar", "base", "arm", "0 0 -0.2")
    path.write_text(f'<robot name="robot">{"".join(parts)}</robot>')
    client = bullet.connect(bullet.DIRECT)
    here = {"physicsClientId": client}
    plate = bullet.createMultiBody(
        0, bullet.createCollisionShape(bullet.GEOM_PLANE, **here), **here
    )
    robot = bullet.loadURDF(str(path), [0, 0, 2], **here)
    found = measure(World(client, robot, plate), speeds=[0.5], phases=[0.5], diagnose=False)
    with pytest.raises(SettingError, match="planar joint"):
        contact.add(contact.Restitution(0.3), (robot, 0), plate, client=client)
    bullet.disconnect(client)
    assert np.isnan(found.facts.effective_mass)
    assert found.measured


def test_joints_that_do_not_lead_to_the_other_are_put_back(tmp_path: Path) -> None:
    """The next try, of the other body's joints, began at the pose in which this one had ended."""
    path = tmp_path / "arm.urdf"
    arm = link("arm", 3, ROUND).replace("</inertial>", "</inertial>" + SPHERE)
    parts = link("base", 1, ROUND), arm, joint("revolute", "base", "arm", "0 0 0")
    path.write_text(f'<robot name="robot">{"".join(parts)}</robot>')
    client = bullet.connect(bullet.DIRECT)
    here = {"physicsClientId": client}
    ball = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=0.1, **here)
    far = bullet.createMultiBody(0, ball, basePosition=[2, 0, 0], **here)
    robot = bullet.loadURDF(str(path), useFixedBase=True, **here)
    bullet.resetJointState(robot, 0, 0.3, 0.2, **here)
    one, other = BodyPart("arm", robot, 0), BodyPart("ball", far, -1)
    assert swing_to_touch(BulletClient(client), one, other) is None
    position, velocity = bullet.getJointState(robot, 0, **here)[:2]
    bullet.disconnect(client)
    assert (position, velocity) == (0.3, 0.2)


@pytest.fixture
def ball_over_floor() -> Iterator[int]:
    """A client with a ball in maximal coordinates, of which PyBullet tells no shapes, and a floor."""
    import pybullet

    client = pybullet.connect(pybullet.DIRECT)
    ball = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.1, physicsClientId=client)
    floor = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
    pybullet.createMultiBody(
        1.0, ball, basePosition=[0, 0, 1], useMaximalCoordinates=True, physicsClientId=client
    )
    pybullet.createMultiBody(0.0, floor, physicsClientId=client)
    yield client
    pybullet.disconnect(client)


def test_pairs_lists_a_body_in_maximal_coordinates(ball_over_floor: int) -> None:
    """PyBullet tells nothing of its shapes: the list ended in its error."""
    (found,) = pairs(ball_over_floor)
    assert found.types == ("shape", "plane")
    assert found.distance == pytest.approx(0.9)


def test_pairs_leaves_soft_bodies_out(ball_over_floor: int) -> None:
    import pybullet

    data = pytest.importorskip("pybullet_data")
    cloth = Path(data.getDataPath()) / "cloth_z_up.obj"
    pybullet.resetSimulation(pybullet.RESET_USE_DEFORMABLE_WORLD, physicsClientId=ball_over_floor)
    pybullet.loadSoftBody(str(cloth), mass=1.0, useMassSpring=1, physicsClientId=ball_over_floor)
    assert list(pairs(ball_over_floor)) == []


def test_true_is_no_client(ball_over_floor: int) -> None:
    with pytest.raises(UserError, match=r"^model: a bool; expected"):
        pairs(True)
