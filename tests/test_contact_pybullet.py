"""Hunt-Crossley contact inside PyBullet: the law's physics in worlds that a user might have."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hcbench.contact import pybullet as contact
from hcbench.contact.pybullet import Friction, HuntCrossley, Restitution
from hcbench.engines.pybullet.plugin import solve
from hcbench.errors import EngineFailed, SettingError
from hcbench.laws import closed_form

bullet = pytest.importorskip("pybullet", reason="no PyBullet for this Python")

MASS, STIFFNESS, ALPHA, RADIUS = 0.45359237, 3.4064e10, 0.008 / 0.0254, 0.0508
LAW = HuntCrossley(STIFFNESS, ALPHA)
SCENES = Path(__file__).parents[1] / "scenes"
PHASES = [0.06 + i / 8 for i in range(8)]
MAXIMAL = pytest.mark.parametrize("maximal", [False, True], ids=["multibody", "maximal"])


class World:
    """A client of its own: an empty world without damping."""

    def __init__(self, h: float, gravity: float = 0.0) -> None:
        self.client = bullet.connect(bullet.DIRECT)
        self.set(h, gravity)

    def set(self, h: float, gravity: float = 0.0) -> None:
        bullet.resetSimulation(physicsClientId=self.client)
        bullet.setTimeStep(h, physicsClientId=self.client)
        bullet.setGravity(0, 0, -gravity, physicsClientId=self.client)
        bullet.setPhysicsEngineParameter(numSubSteps=0, physicsClientId=self.client)

    def ball(self, mass: float, where: Any = (0, 0, RADIUS), maximal: bool = False) -> int:
        shape = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=RADIUS, physicsClientId=self.client)
        body = bullet.createMultiBody(
            mass, shape, basePosition=where, useMaximalCoordinates=maximal, physicsClientId=self.client
        )
        bullet.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=self.client)
        return int(body)

    def plate(self) -> int:
        shape = bullet.createCollisionShape(bullet.GEOM_PLANE, physicsClientId=self.client)
        return int(bullet.createMultiBody(0, shape, physicsClientId=self.client))

    def place(self, body: int, where: Any, velocity: Any, spin: Any = (0, 0, 0)) -> None:
        client = self.client
        bullet.resetBasePositionAndOrientation(body, where, (0, 0, 0, 1), physicsClientId=client)
        bullet.resetBaseVelocity(body, velocity, spin, physicsClientId=client)

    def position(self, body: int) -> Any:
        return np.array(bullet.getBasePositionAndOrientation(body, physicsClientId=self.client)[0])

    def velocity(self, body: int) -> Any:
        return np.array(bullet.getBaseVelocity(body, physicsClientId=self.client)[0])

    def spin(self, body: int) -> Any:
        return np.array(bullet.getBaseVelocity(body, physicsClientId=self.client)[1])


@pytest.fixture
def world() -> Iterator[World]:
    made = World(1e-5)
    yield made
    bullet.disconnect(made.client)


def bounce(world: World, law: Any, ball: int, h: float, speed: float, phase: float, ready: float) -> float:
    """E of one impact of the force law along z."""
    world.place(ball, (0, 0, ready + (2 + phase) * h * speed), (0, 0, -speed))
    for _ in range(5000):
        touches = law.step()
        out = world.velocity(ball)[2]
        if out > 0 and not any(touch.force for touch in touches):
            return float(out / speed)
    raise AssertionError("the ball never left")


def until(law: Any, over: Callable[[], bool], most: int = 20_000) -> None:
    for _ in range(most):
        law.step()
        if over():
            return
    raise AssertionError("it never ended")


@MAXIMAL
@pytest.mark.parametrize("h", [1e-5, 2e-5])
def test_force_law_bounces_as_the_law_at_every_phase(world: World, maximal: bool, h: float) -> None:
    world.set(h)
    ball, plate = world.ball(MASS, maximal=maximal), world.plate()
    with contact.attach([(ball, plate)], LAW, client=world.client) as law:
        for speed in (0.0254, 0.2032, 0.508):
            for phase in PHASES[:: 2 if speed < 0.1 else 1]:
                e = bounce(world, law, ball, h, speed, phase, RADIUS)
                assert e == pytest.approx(float(closed_form.restitution(ALPHA, speed)), abs=5e-6)


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "python"])
def test_force_law_at_a_fine_step_and_in_python(
    world: World, compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not compiled:
        monkeypatch.setattr(solve, "_compiled_euler_force", lambda: None)
    h = 1e-6
    world.set(h)
    ball, plate = world.ball(MASS), world.plate()
    with contact.attach([(ball, plate)], LAW, client=world.client) as law:
        for phase in (0.1, 0.6):
            e = bounce(world, law, ball, h, 0.2032, phase, RADIUS)
            assert e == pytest.approx(float(closed_form.restitution(ALPHA, 0.2032)), abs=1e-9)


@pytest.mark.parametrize("gap", ["analytic", "distance field"])
def test_force_law_in_the_cup(world: World, gap: str) -> None:
    # Bullet reports distance fields only once they overlap: the step that touches goes by without a force.
    world.set(1e-5)
    ball, plate = (
        bullet.loadURDF(str(SCENES / "steel-cup" / name), physicsClientId=world.client)
        for name in ("ball.urdf", "plate.urdf")
    )
    bullet.changeDynamics(ball, -1, linearDamping=0, angularDamping=0, physicsClientId=world.client)
    exactly = contact.cup(0.0254, 0.0508, (0, 0, 0.0508)) if gap == "analytic" else None
    with contact.attach([(ball, plate)], LAW, client=world.client, gap=exactly) as law:
        for speed in (0.0254, 0.2032, 0.508):
            for phase in PHASES[::2]:
                e = bounce(world, law, ball, 1e-5, speed, phase, 0.0254)
                assert e == pytest.approx(float(closed_form.restitution(ALPHA, speed)), abs=5e-6)


def test_an_off_axis_hit_in_the_cup_keeps_its_angular_momentum(world: World) -> None:
    world.set(2e-6)
    ball = world.ball(MASS)
    plate = world.plate()  # only its frame is used
    centre, away = np.array([0, 0, 0.1]), np.array([np.sin(0.4), 0, -np.cos(0.4)])
    world.place(ball, centre + 0.049 * away, 0.3 * away + 0.2 * np.array([np.cos(0.4), 0, np.sin(0.4)]))
    start = np.cross(world.position(ball) - centre, world.velocity(ball))
    gap = contact.cup(RADIUS, 0.1, (0, 0, 0.1))
    with contact.attach([(ball, plate)], LAW, client=world.client, gap=gap) as law:

        def left() -> float:
            return 0.1 - RADIUS - float(np.linalg.norm(world.position(ball) - centre))

        until(law, lambda: left() <= 0)
        until(law, lambda: left() > 1e-6)
    out = (world.position(ball) - centre) / np.linalg.norm(world.position(ball) - centre)
    assert np.cross(world.position(ball) - centre, world.velocity(ball)) == pytest.approx(start, abs=1e-14)
    assert -(out @ world.velocity(ball)) / 0.3 == pytest.approx(
        float(closed_form.restitution(ALPHA, 0.3)), abs=2e-3
    )


@MAXIMAL
def test_two_free_balls_of_unequal_mass(world: World, maximal: bool) -> None:
    one = world.ball(0.2, (0, 0, 0), maximal)
    two = world.ball(0.7, (2 * RADIUS + 1e-4, 0, 0), maximal)
    world.place(one, (0, 0, 0), (0.4, 0, 0))
    deepest = 0.0
    with contact.attach([(one, two)], LAW, client=world.client) as law:
        for _ in range(100):
            for touch in law.step():
                deepest = max(deepest, touch.penetration)
                assert 1 / touch.inverse_mass == pytest.approx(0.2 * 0.7 / 0.9)
    v1, v2 = world.velocity(one), world.velocity(two)
    assert 0.2 * v1 + 0.7 * v2 == pytest.approx(np.array([0.08, 0, 0]), abs=1e-13)
    assert (v2 - v1)[0] / 0.4 == pytest.approx(float(closed_form.restitution(ALPHA, 0.4)), abs=1e-6)
    assert deepest == pytest.approx(float(closed_form.penetration_max(LAW, 0.14 / 0.9, 0.4)), rel=1e-2)


def test_a_chain_of_three(world: World) -> None:
    masses = (0.3, 0.5, 0.4)
    balls = [world.ball(m, (i * (2 * RADIUS + 1e-5), 0, 0)) for i, m in enumerate(masses)]
    world.place(balls[0], (0, 0, 0), (0.5, 0, 0))
    with contact.attach([(balls[0], balls[1]), (balls[1], balls[2])], LAW, client=world.client) as law:
        for _ in range(600):
            law.step()
    speeds = [0.5, 0.0, 0.0]
    for i, j in ((0, 1), (1, 2)):
        mi, mj, closing = masses[i], masses[j], speeds[i] - speeds[j]
        push = (1 + float(closed_form.restitution(ALPHA, closing))) * closing * mi * mj / (mi + mj)
        speeds[i], speeds[j] = speeds[i] - push / mi, speeds[j] + push / mj
    got = [float(world.velocity(ball)[0]) for ball in balls]
    assert np.dot(masses, got) == pytest.approx(0.15, abs=1e-13)
    assert got == pytest.approx(speeds, abs=5e-3)  # these two impacts overlap


@MAXIMAL
def test_a_spinning_ball(world: World, maximal: bool) -> None:
    one, two = world.ball(0.3, (0, 0, 0), maximal), world.ball(0.5, (0, 0, 0), maximal)
    for friction in (None, Friction(0.3, 0.2)):
        world.place(one, (0, 0, 0), (0.4, 0, 0), (3, -7, 5))
        world.place(two, (2 * RADIUS + 1e-5, 0, 0), (0, 0, 0))
        with contact.attach([(one, two)], LAW, client=world.client, friction=friction) as law:
            for _ in range(100):
                law.step()
        v1, v2, w1, w2 = world.velocity(one), world.velocity(two), world.spin(one), world.spin(two)
        inertia = 0.4 * RADIUS**2
        angular = 0.3 * (np.cross(world.position(one), v1) + inertia * w1) + 0.5 * (
            np.cross(world.position(two), v2) + inertia * w2
        )
        assert 0.3 * v1 + 0.5 * v2 == pytest.approx(np.array([0.12, 0, 0]), abs=1e-13)
        assert angular == pytest.approx(0.3 * inertia * np.array([3, -7, 5]), abs=1e-9)
        if friction is None:
            assert v1[1:] == pytest.approx([0, 0], abs=1e-12)
            assert w1 == pytest.approx([3, -7, 5], abs=1e-12)
        else:
            assert abs(v1[1:]).max() > 1e-3
            assert abs(w2).max() > 0.1


def test_a_robots_link_hits_with_the_effective_mass_of_its_joints(world: World) -> None:
    client = world.client
    turn = np.array([0.3, 0.2, 0.1, 0.9]) / np.linalg.norm([0.3, 0.2, 0.1, 0.9])
    for base in (0.0, 1.2):
        world.set(1e-5)
        shape = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=0.05, physicsClientId=client)
        robot = bullet.createMultiBody(
            base, shape, basePosition=[0.1, 0.2, 0.3], baseOrientation=turn, linkMasses=[0.5, 0.3],
            linkCollisionShapeIndices=[shape, shape], linkVisualShapeIndices=[-1, -1],
            linkPositions=[[0.2, 0, 0], [0.2, 0.05, 0]], linkOrientations=[[0, 0, 0, 1]] * 2,
            linkInertialFramePositions=[[0.03, 0.02, 0.01]] * 2,
            linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
            linkParentIndices=[0, 1], linkJointTypes=[bullet.JOINT_REVOLUTE] * 2,
            linkJointAxis=[[0, 0, 1], [0, 1, 0]], physicsClientId=client,
        )  # fmt: skip
        for link in range(-1, 2):
            bullet.changeDynamics(
                robot, link, linearDamping=0, angularDamping=0, jointDamping=0, physicsClientId=client
            )
        for joint, angle in ((0, 0.3), (1, -0.4)):
            bullet.setJointMotorControl2(
                robot, joint, bullet.VELOCITY_CONTROL, force=0, physicsClientId=client
            )
            bullet.resetJointState(robot, joint, angle, 0, physicsClientId=client)
        state = bullet.getLinkState(robot, 1, computeForwardKinematics=1, physicsClientId=client)
        shift = bullet.getCollisionShapeData(robot, 1, physicsClientId=client)[0][5]
        tip = np.array(bullet.multiplyTransforms(state[0], state[1], shift, (0, 0, 0, 1))[0])
        ball = world.ball(0.1)
        world.place(ball, tip + np.array([0, 0, 0.05 + RADIUS + 2.3e-6]), (0, 0, -0.3))
        with contact.attach([((robot, 1), (ball, -1))], Restitution(ALPHA), client=client) as law:
            while world.velocity(ball)[2] < -0.299:
                law.step()
            state = bullet.getLinkState(
                robot, 1, computeLinkVelocity=1, computeForwardKinematics=1, physicsClientId=client
            )
            point = world.position(ball) - [0, 0, RADIUS]
            surface = np.array(state[6]) + np.cross(state[7], point - np.array(state[0]))
            parting = world.velocity(ball)[2] - surface[2]
        assert parting / 0.3 == pytest.approx(float(closed_form.restitution(ALPHA, 0.3)), abs=1e-4)


@MAXIMAL
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_restitution_law_gives_each_impact_its_own(world: World, gravity: float, maximal: bool) -> None:
    for h in (1e-4, 1e-3, 4e-3):
        world.set(h, gravity)
        ball, plate = world.ball(MASS, maximal=maximal), world.plate()
        with contact.attach([(ball, plate)], Restitution(ALPHA), client=world.client) as law:
            for speed in (0.0508, 0.508):
                for phase in PHASES:
                    world.place(ball, (0, 0, RADIUS + (1 + phase) * h * speed), (0, 0, -speed))
                    before = speed
                    while world.velocity(ball)[2] <= 0:
                        before = -float(world.velocity(ball)[2])
                        law.step()
                    e = float(world.velocity(ball)[2]) / before
                    assert e == pytest.approx(float(closed_form.restitution(ALPHA, before)), abs=1e-12)


def test_a_bounce_train_loses_energy_in_every_impact_and_comes_to_rest(world: World) -> None:
    h = 1e-3
    world.set(h, 9.81)
    ball, plate = world.ball(MASS, (0, 0, RADIUS + 0.02)), world.plate()
    energy, at = [], []
    with contact.attach([(ball, plate)], Restitution(20 * ALPHA), client=world.client) as law:
        for _ in range(3000):
            law.step()
            v, z = float(world.velocity(ball)[2]), float(world.position(ball)[2])
            energy.append(0.5 * v**2 + 9.81 * z - 0.5 * h * 9.81 * v)  # what these steps conserve in flight
            at.append(z)
    assert np.diff(energy).max() < 1e-12
    assert np.ptp(at[-500:]) < 1e-12


def test_a_stack_rests_and_bears_what_the_law_cannot_see(world: World) -> None:
    world.set(2e-3, 9.81)
    ball, top, plate = world.ball(MASS), world.ball(2.0, (0, 0, 3 * RADIUS)), world.plate()
    heights = []
    with contact.attach([(ball, plate), (top, ball)], Restitution(ALPHA), client=world.client) as law:
        for i in range(600):
            if i > 300:  # a push that no contact of the law knows of
                bullet.applyExternalForce(
                    top,
                    -1,
                    (0, 0, -30),
                    world.position(top),
                    bullet.WORLD_FRAME,
                    physicsClientId=world.client,
                )
            law.step()
            heights.append(world.position(ball)[2])
    assert heights[0] == pytest.approx(RADIUS, abs=1e-4)
    assert heights[299] == pytest.approx(heights[100], abs=1e-12)
    assert heights[-1] == pytest.approx(heights[299], abs=2e-4)
    assert heights[-1] == pytest.approx(heights[-50], abs=1e-12)


def test_twenty_balls_at_once(world: World) -> None:
    speeds = np.linspace(0.05, 0.5, 20)
    plate = world.plate()
    balls = [world.ball(MASS, (0.2 * i, 0, RADIUS)) for i in range(20)]
    for i, ball in enumerate(balls):
        world.place(ball, (0.2 * i, 0, RADIUS + 3.3e-5 * speeds[i]), (0, 0, -speeds[i]))
    with contact.attach([(ball, plate) for ball in balls], LAW, client=world.client) as law:
        for _ in range(60):
            law.step()
    got = np.array([world.velocity(ball)[2] for ball in balls]) / speeds
    assert got == pytest.approx(closed_form.restitution(ALPHA, speeds), abs=5e-6)


def test_what_is_not_attached_moves_bit_for_bit_as_before() -> None:
    tracks = []
    for attached in (False, True):
        world = World(1e-3, 9.81)
        plate, loose, ball = world.plate(), world.ball(1.0, (0, 0, 0.06)), world.ball(MASS, (1, 0, 2.0))
        bullet.changeDynamics(loose, -1, restitution=0.5, lateralFriction=0.4, physicsClientId=world.client)
        world.place(loose, (0, 0, 0.06), (0.3, 0, -1), (1, 2, 3))
        law = contact.attach([(ball, plate)], Restitution(ALPHA), client=world.client) if attached else None
        track = []
        for _ in range(150):
            if law is not None:
                law.step()
            else:
                bullet.stepSimulation(physicsClientId=world.client)
            track.append([*world.position(loose), *world.velocity(loose), *world.position(ball)])
        tracks.append(track)
        bullet.disconnect(world.client)
    assert tracks[0] == tracks[1]


def test_detaching_gives_the_pair_back_to_bullet(world: World) -> None:
    world.set(1e-3)
    ball, plate = world.ball(MASS), world.plate()
    world.place(ball, (0, 0, RADIUS - 1e-4), (0, 0, 0))

    def touching() -> bool:
        bullet.performCollisionDetection(physicsClientId=world.client)
        return bool(bullet.getContactPoints(ball, plate, physicsClientId=world.client))

    assert touching()
    law = contact.attach([(ball, plate)], Restitution(ALPHA), client=world.client)
    assert not touching()
    law.detach()
    law.detach()
    assert touching()
    with contact.attach([(ball, plate)], Restitution(ALPHA), client=world.client, collide_after=False):
        pass
    assert not touching()


def test_what_cannot_be_attached_is_refused(world: World) -> None:
    ball, plate = world.ball(MASS), world.plate()
    client: dict[str, Any] = {"client": world.client}
    with pytest.raises(SettingError, match="body 99"):
        contact.attach([(ball, 99)], LAW, **client)
    with pytest.raises(SettingError, match="link 3"):
        contact.attach([((ball, 3), plate)], LAW, **client)
    with pytest.raises(SettingError, match="two bodies"):
        contact.attach([(ball,)], LAW, **client)
    with pytest.raises(SettingError, match="same"):
        contact.attach([(ball, ball)], LAW, **client)
    with pytest.raises(SettingError, match="cannot move"):
        contact.attach([(plate, world.plate())], LAW, **client)
    with pytest.raises(SettingError, match="twice"):
        contact.attach([(ball, plate), (plate, ball)], LAW, **client)
    with pytest.raises(SettingError, match="at least one"):
        contact.attach([], LAW, **client)
    with pytest.raises(SettingError, match="HuntCrossley"):
        contact.attach([(ball, plate)], 0.3, **client)  # type: ignore[arg-type]
    with pytest.raises(SettingError, match="not connected"):
        contact.attach([(ball, plate)], LAW, client=77)
    with pytest.raises(SettingError, match="ball_radius"):
        contact.cup(0.1, 0.05)
    bullet.setPhysicsEngineParameter(numSubSteps=4, physicsClientId=world.client)
    with pytest.raises(SettingError, match="numSubSteps"):
        contact.attach([(ball, plate)], LAW, **client)
    bullet.setPhysicsEngineParameter(numSubSteps=0, physicsClientId=world.client)
    with contact.attach([(ball, plate)], LAW, **client), pytest.raises(SettingError, match="twice"):
        contact.attach([(plate, ball)], LAW, **client)
    with contact.attach([(ball, plate)], LAW, **client):
        pass  # and again after


def test_a_step_too_coarse_names_one_that_is_not_and_the_other_kind(world: World) -> None:
    world.set(1e-3)
    ball, plate = world.ball(MASS), world.plate()
    with pytest.raises(SettingError, match=r"a step of 8e-06 s.*Restitution"):
        contact.attach([(ball, plate)], LAW, client=world.client)
    world.set(4e-5)
    ball, plate = world.ball(MASS), world.plate()
    world.place(ball, (0, 0, RADIUS + 1e-3), (0, 0, -60))
    with (
        pytest.raises(EngineFailed, match="too fast for the step"),
        contact.attach([(ball, plate)], LAW, client=world.client) as law,
    ):
        for _ in range(10):
            law.step()


def test_a_state_that_is_not_finite_is_told_and_the_pair_given_back(world: World) -> None:
    ball, plate = world.ball(MASS), world.plate()
    with (
        pytest.raises(EngineFailed, match="finite state"),
        contact.attach([(ball, plate)], LAW, client=world.client) as law,
    ):
        world.place(ball, (0, 0, RADIUS - 1e-6), (0, 0, float("nan")))
        law.step()
    with contact.attach([(ball, plate)], LAW, client=world.client):
        pass
