"""The laws as Bullet's plug-in: their physics in worlds that a user might
have, by plain stepSimulation.
"""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bullet_scenes
import numpy as np
import pytest

from hcbench.cli import run as run_command
from hcbench.contact import pybullet as contact
from hcbench.contact.pybullet import ConstantRestitution, Friction, HuntCrossley, Restitution
from hcbench.engines.pybullet.plugin import restitution_of
from hcbench.laws import closed_form
from hcbench.sim.read_impact import SpeedReading
from hcbench.system.errors import SettingError, UserError

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats

bullet = pytest.importorskip("pybullet", reason="no PyBullet for this Python")

MASS, STIFFNESS, ALPHA, RADIUS = 0.45359237, 3.4064e10, 0.008 / 0.0254, 0.0508
LAW = HuntCrossley(STIFFNESS, ALPHA)
SCENES = Path(__file__).parents[3] / "scenes"
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
        shape = bullet.createCollisionShape(
            bullet.GEOM_SPHERE, radius=RADIUS, physicsClientId=self.client
        )
        body = bullet.createMultiBody(
            mass,
            shape,
            basePosition=where,
            useMaximalCoordinates=maximal,
            physicsClientId=self.client,
        )
        bullet.changeDynamics(
            body, -1, linearDamping=0, angularDamping=0, physicsClientId=self.client
        )
        return int(body)

    def plate(self) -> int:
        shape = bullet.createCollisionShape(bullet.GEOM_PLANE, physicsClientId=self.client)
        return int(bullet.createMultiBody(0, shape, physicsClientId=self.client))

    def place(self, body: int, where: Any, velocity: Any, spin: Any = (0, 0, 0)) -> None:
        client = self.client
        bullet.resetBasePositionAndOrientation(body, where, (0, 0, 0, 1), physicsClientId=client)
        bullet.resetBaseVelocity(body, velocity, spin, physicsClientId=client)

    def add(self, law: Any, first: Any, second: Any, **more: Any) -> int:
        return contact.add(law, first, second, client=self.client, **more)

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            bullet.stepSimulation(physicsClientId=self.client)

    def until(self, over: Callable[[], bool], most: int = 20_000) -> None:
        for _ in range(most):
            self.step()
            if over():
                return
        raise AssertionError("it never ended")

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


def e_of(speed: float) -> float:
    return float(closed_form.restitution(ALPHA, speed))


def bounce(world: World, ball: int, h: float, speed: float, phase: float, ready: float) -> float:
    """E of one impact of the force law along z."""
    world.place(ball, (0, 0, ready + (2 + phase) * h * speed), (0, 0, -speed))
    world.until(
        lambda: (
            world.velocity(ball)[2] > 0
            and world.position(ball)[2] > ready + 2 * h * world.velocity(ball)[2]
        )
    )
    return float(world.velocity(ball)[2] / speed)


@MAXIMAL
@pytest.mark.parametrize("h", [1e-5, 2e-5])
def test_force_law_bounces_as_the_law_at_every_phase(world: World, maximal: bool, h: float) -> None:
    world.set(h)
    ball, plate = world.ball(MASS, maximal=maximal), world.plate()
    world.add(LAW, ball, plate)
    for speed in (0.0254, 0.2032, 0.508):
        for phase in PHASES[:: 2 if speed < 0.1 else 1]:
            assert bounce(world, ball, h, speed, phase, RADIUS) == pytest.approx(
                e_of(speed), abs=2e-6
            )


def test_force_law_at_a_fine_step(world: World) -> None:
    h = 1e-6
    world.set(h)
    ball, plate = world.ball(MASS), world.plate()
    world.add(LAW, ball, plate)
    for phase in (0.1, 0.6):
        assert bounce(world, ball, h, 0.2032, phase, RADIUS) == pytest.approx(
            e_of(0.2032), abs=1e-9
        )


def test_force_law_in_the_cup(world: World) -> None:
    world.set(1e-5)
    ball, plate = (
        bullet.loadURDF(str(SCENES / "steel-cup" / name), physicsClientId=world.client)
        for name in ("ball.urdf", "plate.urdf")
    )
    bullet.changeDynamics(ball, -1, linearDamping=0, angularDamping=0, physicsClientId=world.client)
    world.add(LAW, ball, plate, cup=(0.0508, 0, 0, 0.0508))
    for speed in (0.0254, 0.2032, 0.508):
        for phase in PHASES[::2]:
            e = bounce(world, ball, 1e-5, speed, phase, 0.0254)
            assert e == pytest.approx(e_of(speed), abs=2e-6)


@pytest.mark.parametrize(("h", "error"), [(1e-6, 1e-9), (1e-5, 4e-7)])
def test_the_mesh_of_a_cup_is_as_exact_though_bullet_sees_it_once_it_overlaps(
    world: World, h: float, error: float
) -> None:
    world.set(h)
    ball, plate = (
        bullet.loadURDF(str(SCENES / "steel-cup" / name), physicsClientId=world.client)
        for name in ("ball.urdf", "plate.urdf")
    )
    still = {"linearDamping": 0, "angularDamping": 0, "mass": MASS}
    bullet.changeDynamics(ball, -1, **still, physicsClientId=world.client)
    world.add(LAW, ball, plate)
    for speed, phase in ((0.0508, 0.3), (0.2, 0.6), (0.508, 0.1)):
        world.place(ball, (0, 0, 0.0254 + (2 + phase) * h * speed), (0, 0, -speed))
        for _ in range(int(4.5e-4 / h)):
            world.step()
        assert float(world.velocity(ball)[2]) / speed == pytest.approx(e_of(speed), abs=error)


def test_an_off_axis_hit_in_the_cup_keeps_its_angular_momentum(world: World) -> None:
    world.set(2e-6)
    ball, plate = world.ball(MASS), world.plate()  # of the plate only its frame is used
    centre, away = np.array([0, 0, 0.1]), np.array([np.sin(0.4), 0, -np.cos(0.4)])
    world.place(
        ball, centre + 0.049 * away, 0.3 * away + 0.2 * np.array([np.cos(0.4), 0, np.sin(0.4)])
    )
    start = np.cross(world.position(ball) - centre, world.velocity(ball))
    world.add(LAW, ball, plate, cup=(0.1, *centre), friction=0.0)

    def left() -> float:
        return 0.1 - RADIUS - float(np.linalg.norm(world.position(ball) - centre))

    world.until(lambda: left() <= 0)
    world.until(lambda: left() > 1e-6)
    out = (world.position(ball) - centre) / np.linalg.norm(world.position(ball) - centre)
    assert np.cross(world.position(ball) - centre, world.velocity(ball)) == pytest.approx(
        start, abs=1e-14
    )
    assert -(out @ world.velocity(ball)) / 0.3 == pytest.approx(e_of(0.3), abs=2e-3)


@MAXIMAL
def test_two_free_balls_of_unequal_mass(world: World, maximal: bool) -> None:
    one = world.ball(0.2, (0, 0, 0), maximal)
    two = world.ball(0.7, (2 * RADIUS + 1e-4, 0, 0), maximal)
    world.place(one, (0, 0, 0), (0.4, 0, 0))
    law, hardest = world.add(LAW, one, two), 0.0
    for _ in range(100):
        world.step()
        hardest = max(hardest, contact.force(law, client=world.client))
    v1, v2 = world.velocity(one), world.velocity(two)
    assert 0.2 * v1 + 0.7 * v2 == pytest.approx(np.array([0.08, 0, 0]), abs=1e-13)
    assert (v2 - v1)[0] / 0.4 == pytest.approx(e_of(0.4), abs=1e-6)
    assert hardest == pytest.approx(float(closed_form.force_max(LAW, 0.14 / 0.9, 0.4)), rel=2e-2)


def test_a_chain_of_three(world: World) -> None:
    masses = (0.3, 0.5, 0.4)
    balls = [world.ball(m, (i * (2 * RADIUS + 1e-5), 0, 0)) for i, m in enumerate(masses)]
    world.place(balls[0], (0, 0, 0), (0.5, 0, 0))
    world.add(LAW, balls[0], balls[1])
    world.add(LAW, balls[1], balls[2])
    world.step(600)
    speeds = [0.5, 0.0, 0.0]
    for i, j in ((0, 1), (1, 2)):
        mi, mj, closing = masses[i], masses[j], speeds[i] - speeds[j]
        push = (1 + e_of(closing)) * closing * mi * mj / (mi + mj)
        speeds[i], speeds[j] = speeds[i] - push / mi, speeds[j] + push / mj
    got = [float(world.velocity(ball)[0]) for ball in balls]
    assert np.dot(masses, got) == pytest.approx(0.15, abs=1e-13)
    assert got == pytest.approx(speeds, abs=5e-3)  # these two impacts overlap


@MAXIMAL
@pytest.mark.parametrize("friction", [0.0, Friction(0.3, 0.2), None])
def test_a_spinning_ball(world: World, maximal: bool, friction: Any) -> None:
    # None: the product of the bodies' own, .5 x .5, stays although Bullet's contact is off.
    one, two = world.ball(0.3, (0, 0, 0), maximal), world.ball(0.5, (0, 0, 0), maximal)
    world.place(one, (0, 0, 0), (0.4, 0, 0), (3, -7, 5))
    world.place(two, (2 * RADIUS + 1e-5, 0, 0), (0, 0, 0))
    world.add(LAW, one, two, friction=friction)
    world.step(100)
    v1, v2, w1, w2 = world.velocity(one), world.velocity(two), world.spin(one), world.spin(two)
    inertia = 0.4 * RADIUS**2
    angular = 0.3 * (np.cross(world.position(one), v1) + inertia * w1) + 0.5 * (
        np.cross(world.position(two), v2) + inertia * w2
    )
    assert 0.3 * v1 + 0.5 * v2 == pytest.approx(np.array([0.12, 0, 0]), abs=1e-13)
    assert angular == pytest.approx(0.3 * inertia * np.array([3, -7, 5]), abs=1e-9)
    if friction == 0.0:
        assert v1[1:] == pytest.approx([0, 0], abs=1e-12)
        assert w1 == pytest.approx([3, -7, 5], abs=1e-12)
    else:
        assert abs(v1[1:]).max() > 1e-3
        assert abs(w2).max() > 0.1


@MAXIMAL
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_restitution_law_gives_each_impact_its_own(
    world: World, gravity: float, maximal: bool
) -> None:
    for h in (1e-4, 1e-3, 4e-3):
        world.set(h, gravity)
        ball, plate = world.ball(MASS, maximal=maximal), world.plate()
        world.add(Restitution(ALPHA), ball, plate)
        for speed in (0.0508, 0.508):
            for phase in PHASES:
                world.place(ball, (0, 0, RADIUS + (1 + phase) * h * speed), (0, 0, -speed))
                while world.velocity(ball)[2] <= 0:
                    came = _motion(world, ball)
                    world.step()
                speed_in, speed_out = SpeedReading.TOUCH_PLANE.speeds(
                    came, _motion(world, ball), h * gravity, gravity
                )
                assert speed_out / speed_in == pytest.approx(e_of(float(speed_in[0])), abs=1e-12)


def _motion(world: World, ball: int) -> "tuple[Floats, Floats]":
    """Penetration and rate."""
    return RADIUS - world.position(ball)[2:], -world.velocity(ball)[2:]


@pytest.mark.parametrize("h", [1e-3, 2e-3, 1 / 240])
@MAXIMAL
def test_a_dropped_ball_leaves_by_the_law_at_any_distance_that_bullet_stops_it(
    world: World, maximal: bool, h: float
) -> None:
    """Bullet stops what would touch within a step; for maximal coordinates it tells no distance."""
    world.set(h, 9.81)
    ball, plate = world.ball(MASS, maximal=maximal), world.plate()
    world.add(Restitution(ALPHA), ball, plate)
    for height in np.linspace(0.02, 0.1, 15):
        world.place(ball, (0, 0, RADIUS + height), (0, 0, 0))
        while world.velocity(ball)[2] <= 0:
            came = _motion(world, ball)
            world.step()
        speeds = SpeedReading.TOUCH_PLANE.speeds(came, _motion(world, ball), h * 9.81, 9.81)
        assert speeds[1] / speeds[0] == pytest.approx(e_of(float(speeds[0][0])), abs=1e-9)


def test_a_bounce_train_loses_energy_in_every_impact_and_comes_to_rest(world: World) -> None:
    h = 1e-3
    world.set(h, 9.81)
    ball, plate = world.ball(MASS, (0, 0, RADIUS + 0.02)), world.plate()
    energy, at = [], []
    world.add(Restitution(20 * ALPHA), ball, plate)
    for _ in range(3000):
        world.step()
        v, z = float(world.velocity(ball)[2]), float(world.position(ball)[2])
        energy.append(
            0.5 * v**2 + 9.81 * z - 0.5 * h * 9.81 * v
        )  # what these steps conserve in flight
        at.append(z)
    assert np.diff(energy).max() < 1e-9
    assert np.ptp(at[-500:]) < 1e-9


@pytest.mark.parametrize("substeps", [0, 2, 5])
@MAXIMAL
def test_substeps_are_steps(world: World, substeps: int, maximal: bool) -> None:
    # Bullet adds external forces up over substeps; the plug-in takes back
    # what the ones before have had.
    for law, h in ((LAW, 1e-5), (Restitution(ALPHA), 1e-3)):
        world.set(h * max(substeps, 1))
        bullet.setPhysicsEngineParameter(numSubSteps=substeps, physicsClientId=world.client)
        ball, plate = world.ball(MASS, maximal=maximal), world.plate()
        world.add(law, ball, plate)
        for phase in PHASES[::3]:
            e = bounce(world, ball, h * max(substeps, 1), 0.2032, phase, RADIUS)
            assert e == pytest.approx(e_of(0.2032), abs=2e-6 if law is LAW else 1e-12)


def test_several_balls_at_once(world: World) -> None:
    speeds = np.linspace(0.05, 0.5, 20)
    plate = world.plate()
    balls = [world.ball(MASS, (0.2 * i, 0, RADIUS)) for i in range(20)]
    for i, ball in enumerate(balls):
        world.place(ball, (0.2 * i, 0, RADIUS + 3.3e-5 * speeds[i]), (0, 0, -speeds[i]))
        world.add(LAW, ball, plate)
    world.step(60)
    got = np.array([world.velocity(ball)[2] for ball in balls]) / speeds
    assert got == pytest.approx(closed_form.restitution(ALPHA, speeds), abs=5e-6)


def test_what_has_no_law_moves_bit_for_bit_as_before() -> None:
    tracks = []
    for has_law in (False, True):
        world = World(1e-3, 9.81)
        plate, loose, ball = (
            world.plate(),
            world.ball(1.0, (0, 0, 0.06)),
            world.ball(MASS, (1, 0, 2.0)),
        )
        bullet.changeDynamics(
            loose, -1, restitution=0.5, lateralFriction=0.4, physicsClientId=world.client
        )
        world.place(loose, (0, 0, 0.06), (0.3, 0, -1), (1, 2, 3))
        if has_law:
            world.add(Restitution(ALPHA), ball, plate)
        track = []
        for _ in range(150):
            world.step()
            track.append([*world.position(loose), *world.velocity(loose), *world.position(ball)])
        tracks.append(track)
        bullet.disconnect(world.client)
    assert tracks[0] == tracks[1]


def test_clients_have_laws_of_their_own() -> None:
    worlds = [World(1e-3), World(1e-3), World(1e-3)]
    balls = []
    for world, e in zip(worlds, (0.9, 0.4, None), strict=True):
        ball, plate = world.ball(MASS), world.plate()
        if e is not None:
            world.add(ConstantRestitution(e), ball, plate)
        world.place(ball, (0, 0, RADIUS + 1e-3), (0, 0, -1))
        balls.append(ball)
    for _ in range(5):  # in turns
        for world in worlds:
            world.step()
    got = [float(world.velocity(ball)[2]) for world, ball in zip(worlds, balls, strict=True)]
    assert got == pytest.approx([0.9, 0.4, 0.0], abs=1e-2)
    for world in worlds:
        bullet.disconnect(world.client)


def test_removing_a_law_gives_the_pair_back_to_bullet(world: World) -> None:
    world.set(1e-5)
    ball, plate = world.ball(MASS), world.plate()
    world.place(ball, (0, 0, RADIUS - 1e-4), (0, 0, 0))

    def touching() -> bool:
        bullet.performCollisionDetection(physicsClientId=world.client)
        return bool(bullet.getContactPoints(ball, plate, physicsClientId=world.client))

    assert touching()
    law = world.add(LAW, ball, plate)
    assert not touching()
    contact.remove(law, client=world.client)
    assert touching()
    with pytest.raises(SettingError, match="not in this client"):
        contact.remove(law, client=world.client)
    with pytest.raises(SettingError, match="not in this client"):
        contact.force(law, client=world.client)


def test_a_reset_or_a_removed_body_ends_the_law(world: World) -> None:
    world.set(1e-3)
    ball, plate = world.ball(MASS), world.plate()
    world.add(ConstantRestitution(0.9), ball, plate)
    world.set(1e-3)  # ids begin again, and mean other bodies
    other, _ = world.ball(MASS), world.plate()
    world.place(other, (0, 0, RADIUS), (0, 0, -1))
    world.step(2)
    assert world.velocity(other)[2] == pytest.approx(0, abs=1e-2)
    world.add(ConstantRestitution(0.9), other, 1)
    bullet.removeBody(other, physicsClientId=world.client)
    world.step()
    last = world.ball(MASS)
    world.place(last, (0, 0, RADIUS), (0, 0, -1))
    world.add(ConstantRestitution(0.7), last, 1)
    world.step(2)
    assert world.velocity(last)[2] == pytest.approx(0.7)


def test_after_a_reset_a_body_has_its_own_links(world: World) -> None:
    """Bullet's client kept the joints of the body that had its id before the reset."""
    for links in (1, 3):
        world.set(1e-3)
        shape = bullet.createCollisionShape(
            bullet.GEOM_SPHERE, radius=RADIUS, physicsClientId=world.client
        )
        row = [0.0, 0.0, 0.0]
        chain = bullet.createMultiBody(
            1.0, shape, basePosition=(0, 0, 1),
            linkMasses=[1.0] * links, linkCollisionShapeIndices=[shape] * links,
            linkVisualShapeIndices=[-1] * links, linkPositions=[[0, 0, -3 * RADIUS]] * links,
            linkOrientations=[[0, 0, 0, 1]] * links, linkInertialFramePositions=[row] * links,
            linkInertialFrameOrientations=[[0, 0, 0, 1]] * links, linkParentIndices=list(range(links)),
            linkJointTypes=[bullet.JOINT_REVOLUTE] * links, linkJointAxis=[[1, 0, 0]] * links,
            physicsClientId=world.client,
        )  # fmt: skip
        for link in range(-1, links):
            free = {"linearDamping": 0, "angularDamping": 0, "physicsClientId": world.client}
            bullet.changeDynamics(chain, link, **free)
        plate, last = world.plate(), links - 1
        world.add(ConstantRestitution(0.9), (chain, last), plate)
        world.place(chain, (0, 0, RADIUS * (1 + 3 * links)), (0, 0, -1))
        world.step()
        velocity = bullet.getLinkState(chain, last, 1, 1, physicsClientId=world.client)[6]
        assert velocity[2] == pytest.approx(0.9, abs=1e-9)


def test_a_mass_that_changes_is_seen(world: World) -> None:
    world.set(1e-3)
    one, two = world.ball(0.2, (0, 0, 0)), world.ball(0.7, (2 * RADIUS, 0, 0))
    world.add(ConstantRestitution(0.9), one, two)
    for mass in (0.2, 3.0):
        bullet.changeDynamics(one, -1, mass=mass, physicsClientId=world.client)
        bullet.changeDynamics(
            two, -1, physicsClientId=world.client
        )  # nothing: Bullet tells of body -1
        world.place(one, (0, 0, 0), (0.4, 0, 0))
        world.place(two, (2 * RADIUS, 0, 0), (0, 0, 0))
        world.step()
        assert (world.velocity(two) - world.velocity(one))[0] == pytest.approx(0.36, abs=1e-12)


# Oblique impacts, and several at once


def test_oblique_impacts_have_the_e_of_the_law_and_friction_within_its_cone() -> None:
    seen = np.array([bullet_scenes.oblique(seed) for seed in range(80)])
    assert (seen[:, 0] > 0).sum() > 50
    assert seen[:, 0].max() < 1e-9
    assert (seen[:, 1] - seen[:, 2]).max() < 1e-9
    assert seen[:, 3].max() < 1e-12


@pytest.mark.parametrize("slip", [0.2, 2.0])
def test_friction_is_the_pairs_own_unless_given(world: World, slip: float) -> None:
    world.set(1e-3)
    ball, plate = world.ball(MASS), world.plate()
    bullet.changeDynamics(
        ball, -1, lateralFriction=0.6, physicsClientId=world.client
    )  # and .5 of the plate
    for given, mu in ((None, 0.3), (0.1, 0.1), (0.0, 0.0)):
        world.place(ball, (0, 0, RADIUS), (slip, 0, -0.5))
        law = world.add(ConstantRestitution(0.8), ball, plate, friction=given)
        world.step()
        contact.remove(law, client=world.client)
        assert world.velocity(ball)[2] == pytest.approx(0.4, abs=1e-12)
        # Coulomb while it slides, 2/7 of the slip where it sticks.
        assert slip - world.velocity(ball)[0] == pytest.approx(
            min(mu * 0.9, slip * 2 / 7), rel=1e-9
        )


LAWS = (ConstantRestitution(1.0), ConstantRestitution(0.5), Restitution(ALPHA))
SCENES_AT_ONCE = {
    "row": partial(bullet_scenes.row, 5, 1e-3),
    "long row": partial(bullet_scenes.row, 10, 5e-3),
    "cradle": partial(bullet_scenes.cradle, 5, 2e-3),
    "rack": partial(bullet_scenes.rack, 2e-3),
    "stack": partial(bullet_scenes.stack, 3, 2e-3),
    "box that slides": partial(bullet_scenes.tumbling, 0, 2e-3, friction=0.0),
    "box that rubs": partial(bullet_scenes.tumbling, 1, 5e-3, friction=0.5),
    "pile": partial(bullet_scenes.pile, 3, 5e-3),
}


@pytest.mark.parametrize("law", LAWS, ids=str)
@pytest.mark.parametrize("name", SCENES_AT_ONCE)
def test_energy_never_grows(name: str, law: Any) -> None:
    assert bullet_scenes.rise(SCENES_AT_ONCE[name], law, 0.4) < 1e-9


def test_a_row_comes_out_as_impacts_of_two_at_a_time() -> None:
    for e in (1.0, 0.9):
        scene = bullet_scenes.row(5, 1e-3, ConstantRestitution(e))
        scene.step(30)
        speeds = scene.state()[1][:, 0]
        scene.close()
        assert speeds[-1] == pytest.approx(((1 + e) / 2) ** 4, rel=1e-9)
        assert speeds.sum() == pytest.approx(1.0, abs=1e-12)


def test_a_stack_of_five_stands() -> None:
    for h in (1e-3, 5e-3):
        scene = bullet_scenes.stack(5, h, ConstantRestitution(0.5))
        scene.step(round(2.0 / h))
        off = scene.state()[0] - np.outer(bullet_scenes.RADIUS * (2 * np.arange(5) + 1), [0, 0, 1])
        scene.close()
        assert np.abs(off).max() < 1e-3


def test_several_links_are_one_pair(world: World) -> None:
    world.set(1e-3)
    shape = bullet.createCollisionShape(
        bullet.GEOM_SPHERE, radius=0.05, physicsClientId=world.client
    )
    dumbbell = bullet.createMultiBody(
        1.0, shape, basePosition=[0, 0, 0.05], linkMasses=[1.0], linkCollisionShapeIndices=[shape],
        linkVisualShapeIndices=[-1], linkPositions=[[0.2, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
        linkInertialFramePositions=[[0, 0, 0]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
        linkParentIndices=[0], linkJointTypes=[bullet.JOINT_FIXED], linkJointAxis=[[0, 0, 1]],
        physicsClientId=world.client,
    )  # fmt: skip
    for link in (-1, 0):
        bullet.changeDynamics(
            dumbbell, link, linearDamping=0, angularDamping=0, physicsClientId=world.client
        )
    world.add(ConstantRestitution(0.7), (dumbbell, -2), world.plate())
    bullet.resetBaseVelocity(dumbbell, [0, 0, -1], [0, 0, 0], physicsClientId=world.client)
    world.step()
    assert world.velocity(dumbbell)[2] == pytest.approx(0.7, rel=1e-9)
    assert world.spin(dumbbell) == pytest.approx([0, 0, 0], abs=1e-9)


COMMANDS = [
    ("hunt_crossley alpha=.3", "stiffness= is missing"),
    ("hunt_crossley stiffness=3e10", "either alpha=, or law= and restitution="),
    ("hunt_crossley stiffness=3e10 alpha=-1", "alpha=-1: needs 0 ... inf"),
    ("hunt_crossley stiffness=3e10 alpha=x", "alpha=x: no number"),
    (
        "hunt_crossley stiffness=3e10 law=florez restitution=.8",
        'no law "florez", only: first-order',
    ),
    ("hunt_crossley stiffness=3e10 law=flores restitution=0", "needs one above 0"),
    ("hunt_crossley stiffness=3e10 alpha=.3 cup=.1", "cup=.1: needs radius,x,y,z"),
    ("hunt_crossley stiffness=3e10 alpha=.3 cup=.01,0,0,0", "smaller sphere"),
    ("restitution", "either alpha= or restitution="),
    ("restitution alpha=.3 restitution=.5", "either alpha= or restitution="),
    ("restitution restitution=1.5", "restitution=1.5: needs 0 ... 1"),
    ("restitution constant=1.5", "restitution=1.5: needs 0 ... 1"),
    ("restitution alpha=.3 reading=quick", "reading=quick: needs law or linear"),
    ("restitution alpha .3", 'key=value after "alpha"'),
    ("restitution alfa=.3", 'no key "alfa", only: alpha restitution'),
    ("bounce alpha=.3", 'no command "bounce", only: hunt_crossley'),
]


@pytest.mark.parametrize(("text", "says"), COMMANDS)
def test_a_wrong_command_says_what_is_wrong(
    world: World, text: str, says: str, capfd: pytest.CaptureFixture[str]
) -> None:
    ball, plate = world.ball(MASS), world.plate()
    plugin = contact.load(world.client)
    sides = [ball, -1, plate, -1]
    assert bullet.executePluginCommand(plugin, text, sides, physicsClientId=world.client) == -1
    assert says in capfd.readouterr().err


def test_an_earlier_name_of_a_key_is_read_and_named(
    world: World, capfd: pytest.CaptureFixture[str]
) -> None:
    ball, plate = world.ball(MASS), world.plate()
    plugin, sides = contact.load(world.client), [ball, -1, plate, -1]
    added = bullet.executePluginCommand(
        plugin, "restitution constant=.5", sides, physicsClientId=world.client
    )
    assert added >= 0
    assert "constant= is restitution= now" in capfd.readouterr().err
    assert restitution_of("restitution constant=.5") == ConstantRestitution(0.5)
    assert restitution_of("restitution restitution=.5") == ConstantRestitution(0.5)


def test_what_cannot_be_a_pair_is_refused(world: World) -> None:
    ball, plate = world.ball(MASS), world.plate()
    for first, second, says in (
        (ball, 99, "no body 99"),
        ((ball, 3), plate, "has no link 3"),
        ((ball, "hand"), plate, "link 'hand'"),
        (ball, ball, "given twice"),
        (plate, world.plate(), "can move"),
    ):
        with pytest.raises(SettingError, match=says):
            world.add(LAW, first, second)
    with pytest.raises(UserError, match="HuntCrossley"):
        world.add(0.3, ball, plate)
    with pytest.raises(SettingError, match="not connected"):
        contact.add(LAW, ball, plate, client=77)
    law = world.add(LAW, ball, plate)
    with pytest.raises(SettingError, match=f"law {law}: remove it first"):
        world.add(Restitution(ALPHA), plate, ball)


def test_a_step_too_coarse_names_one_that_is_not_and_the_other_kind(
    world: World, capfd: pytest.CaptureFixture[str]
) -> None:
    world.set(1e-3)
    ball, plate = world.ball(MASS), world.plate()
    with pytest.raises(SettingError, match=r"a step of 8e-06 s.*Restitution"):
        world.add(LAW, ball, plate)
    world.set(4e-5)
    ball, plate = world.ball(MASS), world.plate()
    world.add(LAW, ball, plate)
    world.place(ball, (0, 0, RADIUS + 1e-3), (0, 0, -60))
    world.step(10)
    assert "too coarse" in capfd.readouterr().err


def test_the_lightest_link_of_a_fixed_robot_sets_the_step_of_a_force(world: World) -> None:
    """By its base, which weighs nothing, the advice divided by 0 and left the law added."""
    world.set(1e-3)
    shape = bullet.createCollisionShape(
        bullet.GEOM_SPHERE, radius=0.05, physicsClientId=world.client
    )
    arm = bullet.createMultiBody(
        0.0, shape, basePosition=[0, 0, 0.5], linkMasses=[1.0], linkCollisionShapeIndices=[shape],
        linkVisualShapeIndices=[-1], linkPositions=[[0, 0, -0.2]],
        linkOrientations=[[0, 0, 0, 1]], linkInertialFramePositions=[[0, 0, 0]],
        linkInertialFrameOrientations=[[0, 0, 0, 1]], linkParentIndices=[0],
        linkJointTypes=[bullet.JOINT_PRISMATIC], linkJointAxis=[[0, 0, 1]],
        physicsClientId=world.client,
    )  # fmt: skip
    plate = world.plate()
    with pytest.raises(SettingError, match="too coarse"):
        world.add(LAW, (arm, -2), plate)
    world.add(ConstantRestitution(0.7), (arm, -2), plate)


@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("deep", [35e-6, 45e-6, 1e-3])
def test_contact_erp_lifts_a_deep_overlap_slowly_and_is_as_it_was_after_the_step(
    world: World, capfd: pytest.CaptureFixture[str], deep: float, substeps: int
) -> None:
    """Deep: more than four steps of falling, 39 um at 1 ms. What has no law is lifted whole again."""
    h, erp, slop = 1e-3, 0.08, 1e-5
    world.set(h * substeps, 9.81)
    bullet.setPhysicsEngineParameter(
        contactERP=erp, contactSlop=slop, numSubSteps=substeps, physicsClientId=world.client
    )
    whole = erp * (deep - slop) * (1 - erp) ** (substeps - 1) / h
    ball, plate = world.ball(MASS), world.plate()
    law = world.add(ConstantRestitution(0.5), ball, plate)
    world.place(ball, (0, 0, RADIUS - deep), (0, 0, 0))
    world.step()
    lifted = 3e-4 * (1 - slop / deep) if deep > 4 * 9.81 * h**2 else whole
    assert world.velocity(ball)[2] == pytest.approx(lifted, rel=1e-2)
    contact.remove(law, client=world.client)
    world.place(ball, (0, 0, RADIUS - deep), (0, 0, 0))
    world.step()
    assert world.velocity(ball)[2] == pytest.approx(whole, rel=1e-6)
    assert capfd.readouterr().err == ""


def test_contact_erp_stays_whole_for_pairs_without_a_law_and_the_others_are_named_once(
    world: World, capfd: pytest.CaptureFixture[str]
) -> None:
    for erp in (0.0, 0.08):
        world.set(1e-3, 9.81)
        bullet.setPhysicsEngineParameter(contactERP=erp, physicsClientId=world.client)
        ball, plate = world.ball(MASS, (0, 0, RADIUS - 1e-3)), world.plate()
        loose = world.ball(MASS, (1, 0, RADIUS - 1e-3))
        world.add(ConstantRestitution(0.5), ball, plate)
        world.step(2)  # Bullet tells of the other pair's contact after the first
        assert world.velocity(loose)[2] == pytest.approx(erp * (1 - 1e-2), abs=1e-4)
        said = capfd.readouterr().err
        assert said.count("and contactERP 0.08 lifts them and pairs without a law") == (erp > 0)


class Held:
    """A ball on the plate, at rest, and a heavier one beside and above it, without gravity."""

    MASSES = (1.0, 2.0)

    def __init__(self, maximal: bool, friction: float = 0.0) -> None:
        self.world = World(1e-3)
        self.balls = [
            self.world.ball(self.MASSES[0], (0, 0, RADIUS), maximal),
            self.world.ball(self.MASSES[1], (0.3, 0, 0.25), maximal),
        ]
        self.friction = friction

    def law(self, e: float) -> None:
        self.world.add(
            ConstantRestitution(e), self.balls[0], self.world.plate(), friction=self.friction
        )

    def hold(self, kind: int) -> int:
        middle = ([0.15, 0, 0.1], [-0.15, 0, -0.1])
        return int(
            bullet.createConstraint(
                *(self.balls[0], -1, self.balls[1], -1, kind, [1, 0, 0], *middle),
                physicsClientId=self.world.client,
            )
        )

    def throw(self, spin: float = 0.0) -> None:
        """Both as one, turning about the first."""
        turning = np.array([0, spin, 0])
        away = np.array([0.3, 0, 0.2])
        self.world.place(self.balls[0], (0, 0, RADIUS), (0.1, 0, -1), turning)
        second = np.array([0.1, 0, -1]) + np.cross(turning, away)
        self.world.place(self.balls[1], away + np.array([0, 0, RADIUS]), second, turning)

    def motion(self) -> "tuple[float, Floats]":
        """Kinetic energy, J, and momentum, kg m/s."""
        energy, momentum = 0.0, np.zeros(3)
        for mass, ball in zip(self.MASSES, self.balls, strict=True):
            v, spin = self.world.velocity(ball), self.world.spin(ball)
            energy += 0.5 * mass * (v @ v + 0.4 * RADIUS**2 * spin @ spin)
            momentum = momentum + mass * v
        return energy, momentum

    def close(self) -> None:
        bullet.disconnect(self.world.client)


HOLDS = [
    pytest.param(kind, maximal, id=f"{name}-{'maximal' if maximal else 'reduced'}")
    for name, kind in (("point", 5), ("fixed", 4), ("prismatic", 1))
    for maximal in (False, True)
    if not (name == "prismatic" and maximal)  # Bullet has none
]


@pytest.mark.parametrize(("kind", "maximal"), HOLDS)
@pytest.mark.parametrize("e", [0.0, 0.7, 1.0])
def test_bodies_that_a_constraint_holds_bounce_with_the_mass_of_both(
    kind: int, maximal: bool, e: float, capfd: pytest.CaptureFixture[str]
) -> None:
    """A constraint made after the first impact, which is of the ball alone, and taken away again."""
    held = Held(maximal)
    held.law(e)
    for holds in (False, True, False):
        number = held.hold(kind) if holds else None
        held.throw()
        energy, momentum = held.motion()
        held.world.step()
        after, pushed = held.motion()
        ball, other = held.balls
        assert held.world.velocity(ball)[2] == pytest.approx(e, abs=1e-9)
        assert pushed[:2] == pytest.approx(momentum[:2], abs=1e-9)
        assert (held.world.velocity(other)[2] == pytest.approx(-1)) == (not holds)
        if e == 1.0:
            assert after == pytest.approx(energy, rel=1e-9)
        else:
            assert after < energy
        if number is not None:
            bullet.removeConstraint(number, physicsClientId=held.world.client)
    held.close()
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(("kind", "maximal"), HOLDS)
def test_held_bodies_that_spin_bounce_without_gaining_energy(kind: int, maximal: bool) -> None:
    held = Held(maximal, friction=0.5)
    held.law(1.0)
    held.hold(kind)
    held.throw(spin=25.0)
    start = held.motion()[0]
    for _ in range(300):
        held.world.step()
        assert held.motion()[0] < start * (1 + 1e-6)
    held.close()


def test_a_pendulum_that_a_constraint_hangs_on_the_world_has_the_e_of_the_law(
    world: World,
) -> None:
    """A rod of 0.4 m on a pivot in the world meets a ball with the mass that its turning has."""
    ball = world.ball(MASS, (0, 0, 1))
    shape = bullet.createCollisionShape(
        bullet.GEOM_BOX, halfExtents=[0.01, 0.01, 0.2], physicsClientId=world.client
    )
    rod = bullet.createMultiBody(
        2.0, shape, basePosition=(-0.5, 0, 1.15), physicsClientId=world.client
    )
    bullet.changeDynamics(rod, -1, linearDamping=0, angularDamping=0, physicsClientId=world.client)
    bullet.createConstraint(
        *(rod, -1, -1, -1, bullet.JOINT_POINT2POINT, [0, 0, 0], [0, 0, 0.2], [-0.5, 0, 1.35]),
        physicsClientId=world.client,
    )
    bullet.setTimeStep(1e-3, physicsClientId=world.client)
    world.add(ConstantRestitution(0.8), ball, rod, friction=0.0)
    world.place(ball, (-0.5 + 0.01 + RADIUS + 5e-4, 0, 1.05), (-1, 0, 0))
    world.step(2)
    arm = 0.3  # of the hit below the pivot
    about = bullet.getDynamicsInfo(rod, -1, physicsClientId=world.client)[2][1] + 2.0 * 0.2**2
    heavy = about / arm**2
    assert world.velocity(ball)[0] == pytest.approx((0.8 * heavy - MASS) / (heavy + MASS), abs=1e-6)


def test_a_constraint_that_gives_way_is_named_whenever_it_is_made(
    capfd: pytest.CaptureFixture[str],
) -> None:
    says = "a gear or one with a maxForce below 500 N, which has no part in impacts"
    held = Held(maximal=False)
    held.law(0.7)
    held.throw()
    held.world.step()
    number = held.hold(bullet.JOINT_FIXED)
    held.throw()
    held.world.step()
    assert capfd.readouterr().err == ""
    bullet.changeConstraint(number, maxForce=10, physicsClientId=held.world.client)
    for _ in range(2):
        held.throw()
        held.world.step()
    said = capfd.readouterr().err
    assert said.count(f"body {held.balls[0]} is held by constraint {number}, {says}") == 1
    held.close()


def test_a_gear_is_named(world: World, capfd: pytest.CaptureFixture[str]) -> None:
    here, row = {"physicsClientId": world.client}, [0.0, 0.0, 0.0]
    shape = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=RADIUS, **here)
    robot = bullet.createMultiBody(
        1.0, shape, basePosition=(0, 0, 1), linkMasses=[1.0] * 2,
        linkCollisionShapeIndices=[shape] * 2, linkVisualShapeIndices=[-1] * 2,
        linkPositions=[[x, 0, -0.2] for x in (-0.2, 0.2)], linkOrientations=[[0, 0, 0, 1]] * 2,
        linkInertialFramePositions=[row] * 2, linkInertialFrameOrientations=[[0, 0, 0, 1]] * 2,
        linkParentIndices=[0, 0], linkJointTypes=[bullet.JOINT_REVOLUTE] * 2,
        linkJointAxis=[[0, 1, 0]] * 2, **here,
    )  # fmt: skip
    bullet.setTimeStep(1e-3, **here)
    world.add(ConstantRestitution(0.5), (robot, 0), world.plate())
    gear = bullet.createConstraint(
        robot, 0, robot, 1, bullet.JOINT_GEAR, [0, 1, 0], row, row, **here
    )
    bullet.changeConstraint(gear, gearRatio=-1, maxForce=1e4, **here)
    bullet.resetBasePositionAndOrientation(robot, [0, 0, 0.2 + RADIUS], [0, 0, 0, 1], **here)
    bullet.resetBaseVelocity(robot, [0, 0, -1], row, **here)
    world.step()
    assert capfd.readouterr().err.count(f"body {robot} is held by constraint {gear}, a gear") == 1


def leg(
    torque: float = 0.0, control: str = "none", upper: float = 3.0, floor: bool = True
) -> float:
    """Vertical speed (m/s) of a foot after a step of 1 ms in which it meets the floor at 1 m/s,
    e 0.6: a leg of 0.5 kg, 0.3 m long, turned by 0.6 rad under a base of 2 kg.

    torque: the largest of its motor, N m; upper: limit of the joint, rad.
    """
    world = World(1e-3)
    here = {"physicsClientId": world.client}
    box = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=[0.1, 0.05, 0.05], **here)
    foot = bullet.createCollisionShape(
        bullet.GEOM_SPHERE, radius=0.03, collisionFramePosition=[0, 0, -0.3], **here
    )
    robot = bullet.createMultiBody(
        2.0, box, basePosition=[0, 0, 0.3 * np.cos(0.6) + 0.03], linkMasses=[0.5],
        linkCollisionShapeIndices=[foot], linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]],
        linkOrientations=[[0, 0, 0, 1]], linkInertialFramePositions=[[0, 0, -0.15]],
        linkInertialFrameOrientations=[[0, 0, 0, 1]], linkParentIndices=[0],
        linkJointTypes=[bullet.JOINT_REVOLUTE], linkJointAxis=[[0, 1, 0]], **here,
    )  # fmt: skip
    for link in (-1, 0):
        free = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 0, "lateralFriction": 0.5}
        bullet.changeDynamics(robot, link, **free, **here)
    bullet.changeDynamics(robot, 0, jointLowerLimit=-3, jointUpperLimit=upper, **here)
    plate = world.plate()
    if not floor:
        bullet.resetBasePositionAndOrientation(plate, [0, 0, -5], [0, 0, 0, 1], **here)
    bullet.resetJointState(robot, 0, 0.6, 0, **here)
    bullet.resetBaseVelocity(robot, [0, 0, -1], [0, 0, 0], **here)
    bullet.setJointMotorControl2(robot, 0, bullet.VELOCITY_CONTROL, force=0, **here)
    if control == "torque":
        bullet.setJointMotorControl2(robot, 0, bullet.TORQUE_CONTROL, force=torque, **here)
    elif control == "position":
        bullet.setJointMotorControl2(
            robot, 0, bullet.POSITION_CONTROL, targetPosition=0.6, force=torque, **here
        )
    world.add(ConstantRestitution(0.6), (robot, 0), plate)
    world.step()
    state = bullet.getLinkState(robot, 0, 1, 1, **here)
    turn = np.array(bullet.getMatrixFromQuaternion(state[1])).reshape(3, 3)
    arm = turn @ [0, 0, -0.15] - [0, 0, 0.03]
    bullet.disconnect(world.client)
    return float((np.array(state[6]) + np.cross(state[7], arm))[2])


def test_a_motor_changes_the_e_of_a_foot_by_its_own_impulse_and_is_named(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """h J M^-1 torque, as it moves the foot in free flight, up to where it holds the joint."""
    alone, flight = leg(), leg(floor=False)
    assert alone == pytest.approx(0.6, abs=0.02)  # the foot turns on within the step
    assert capfd.readouterr().err == ""
    for torque, e in ((0.1, 0.6), (1.0, 0.58), (10.0, 0.44)):
        own = leg(torque, "torque", floor=False) - flight
        with_motor = leg(torque, "position")
        assert with_motor - alone == pytest.approx(-abs(own), rel=0.04)
        assert with_motor - alone + 0.6 == pytest.approx(e, abs=0.01)
        changed = "changes e of an impact by -0.16 within the step"
        assert capfd.readouterr().err.count(changed) == (torque == 10.0)
    assert leg(100.0, "position") == pytest.approx(0.01, abs=0.005)
    assert "a motor of body 0 changes e of an impact by -0.59" in capfd.readouterr().err


def test_a_limit_stops_a_joint_after_the_impact_and_is_named(
    capfd: pytest.CaptureFixture[str],
) -> None:
    assert leg(upper=0.7) == pytest.approx(0.6, abs=0.02)
    assert capfd.readouterr().err == ""
    assert leg(upper=0.6) == pytest.approx(0.01, abs=0.005)
    assert "a joint's limit of body 0 changes e of an impact by -0.59" in capfd.readouterr().err


def test_a_joint_that_an_impact_turns_faster_than_bullet_lets_it_is_named(
    world: World, capfd: pytest.CaptureFixture[str]
) -> None:
    """A hammer of 10 kg at 12 m/s gives a bob of 0.1 kg about 20 m/s, on an arm of 8 cm: 250 rad/s."""
    world.set(0.25e-3)
    shape = bullet.createCollisionShape(
        bullet.GEOM_SPHERE,
        radius=0.03,
        collisionFramePosition=[0, 0, -0.08],
        physicsClientId=world.client,
    )
    arm = bullet.createMultiBody(
        0, -1, basePosition=[0, 0, 1], linkMasses=[0.1], linkCollisionShapeIndices=[shape],
        linkVisualShapeIndices=[-1], linkPositions=[[0, 0, 0]], linkOrientations=[[0, 0, 0, 1]],
        linkInertialFramePositions=[[0, 0, -0.08]], linkInertialFrameOrientations=[[0, 0, 0, 1]],
        linkParentIndices=[0], linkJointTypes=[bullet.JOINT_REVOLUTE], linkJointAxis=[[0, 1, 0]],
        physicsClientId=world.client,
    )  # fmt: skip
    hammer = world.ball(10.0)
    world.place(hammer, (-0.2, 0, 0.92), (12, 0, 0))
    world.add(ConstantRestitution(0.9), (arm, 0), hammer)
    world.step(100)
    said = capfd.readouterr().err
    assert said.count("set a larger maxJointVelocity by changeDynamics") == 1


def test_a_written_script_says_first_how_to_get_the_library_elsewhere(tmp_path: Path) -> None:
    script = tmp_path / "drop.py"
    asked = ["--plugin", "--alpha", "0.3 s/m", "--timestep", "2 ms", "--speeds", "0.1:2 m/s"]
    assert run_command(["tune", "pybullet", *asked, "--write-scene", str(script)]) == 0
    lines = script.read_text(encoding="utf-8").splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("#"))
    assert "`hcbench plugin pybullet`" in f"{lines[first]} {lines[first + 1]}"
    (loaded,) = [line for line in lines if "loadPlugin(" in line]
    assert loaded == f"plugin = pybullet.loadPlugin({str(contact.library())!r})"
