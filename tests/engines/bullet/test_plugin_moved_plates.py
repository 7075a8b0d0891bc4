"""Bodies that a script moves: the plug-in bounces off them by their velocity, and names one that
moves without; and pairs that it refuses or names as they could not do what is asked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pybullet as bullet
import pytest

from hcbench.contact import pybullet as contact
from hcbench.contact.pybullet import ConstantRestitution, HuntCrossley
from hcbench.system.errors import SettingError

if TYPE_CHECKING:
    from hcbench.laws.contact_law import Law

RADIUS, H, E = 0.05, 1e-3, 0.5
NO_TURN = (0, 0, 0, 1)
MOVES = "a script moves body 1"


class Lift:
    """A ball above the top of a box of mass 0, at z = 0, with a law."""

    def __init__(self, maximal: bool = False, gravity: float = 0.0, law: Law | None = None) -> None:
        self.here = {"physicsClientId": bullet.connect(bullet.DIRECT)}
        bullet.setTimeStep(H, **self.here)
        bullet.setGravity(0, 0, -gravity, **self.here)
        self.ball = self.body(bullet.GEOM_SPHERE, 1.0, RADIUS + 1.05e-2, maximal, radius=RADIUS)
        self.plate = self.body(bullet.GEOM_BOX, 0.0, -0.1, maximal, halfExtents=[1, 1, 0.1])
        client = self.here["physicsClientId"]
        contact.add(law or ConstantRestitution(E), self.ball, self.plate, client=client)

    def body(self, kind: int, mass: float, height: float, maximal: bool, **size: Any) -> int:
        shape = bullet.createCollisionShape(kind, **size, **self.here)
        made = bullet.createMultiBody(
            mass,
            shape,
            basePosition=(0, 0, height),
            useMaximalCoordinates=maximal,
            **self.here,
        )
        free = {"linearDamping": 0, "angularDamping": 0, "lateralFriction": 1}
        bullet.changeDynamics(made, -1, **free, **self.here)
        return int(made)

    def put_plate(self, top: float) -> None:
        bullet.resetBasePositionAndOrientation(self.plate, (0, 0, top - 0.1), NO_TURN, **self.here)

    def give_plate(self, *velocity: float) -> None:
        bullet.resetBaseVelocity(self.plate, velocity, (0, 0, 0), **self.here)

    def step(self) -> None:
        bullet.stepSimulation(**self.here)

    def speed(self, axis: int = 2) -> float:
        return float(bullet.getBaseVelocity(self.ball, **self.here)[0][axis])

    def gap(self) -> float:
        heights = [
            bullet.getBasePositionAndOrientation(body, **self.here)[0][2]
            for body in (self.ball, self.plate)
        ]
        return float(heights[0] - RADIUS - heights[1] - 0.1)

    def close(self) -> None:
        bullet.disconnect(self.here["physicsClientId"])


@pytest.fixture
def lift() -> Iterator[Lift]:
    made = Lift()
    yield made
    made.close()


def test_a_ball_bounces_off_a_plate_at_the_speed_between_them(
    lift: Lift, capfd: pytest.CaptureFixture[str]
) -> None:
    for _ in range(30):
        lift.give_plate(0, 0, 1)
        lift.step()
    assert lift.speed() == pytest.approx(1 + E, rel=1e-9)
    assert capfd.readouterr().err == ""


def test_a_force_law_meets_a_moving_plate_at_the_speed_between_them() -> None:
    def leaves(plate: float, ball: float) -> float:
        lift = Lift(law=HuntCrossley(1e5, 0.315))
        bullet.resetBaseVelocity(lift.ball, (0, 0, ball), (0, 0, 0), **lift.here)
        for _ in range(200):
            lift.give_plate(0, 0, plate)
            lift.step()
        after = lift.speed()
        lift.close()
        return after

    assert leaves(0.5, 0.0) - 0.5 == pytest.approx(leaves(0.0, -0.5), rel=1e-6)


def test_a_ball_rides_on_a_plate_that_goes_up_and_down_and_to_the_side() -> None:
    lift = Lift(gravity=9.81)
    deepest = 0.0
    for k in range(3000):
        lift.give_plate(0.2, 0, 0.2 * math.sin(5 * k * H))
        lift.step()
        deepest = max(deepest, -lift.gap())
    assert abs(lift.gap()) < 1e-4
    assert deepest < 1e-3
    # It rolls on: friction has set its surface to the plate's speed.
    spin = bullet.getBaseVelocity(lift.ball, **lift.here)[1]
    assert lift.speed(0) - RADIUS * spin[1] == pytest.approx(0.2, abs=1e-3)
    lift.close()


@pytest.mark.parametrize("maximal", [False, True])
def test_a_plate_that_moves_without_a_velocity_is_named_once(
    maximal: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    lift = Lift(maximal, gravity=9.81)
    for k in range(100):
        lift.put_plate(k * H)
        lift.step()
    said = capfd.readouterr().err
    assert lift.gap() < -0.01
    assert said.count(MOVES) == 1
    assert "by resetBaseVelocity before each step" in said
    assert ("useMaximalCoordinates" in said) == maximal
    lift.close()


def test_a_plate_of_maximal_coordinates_is_named_whatever_velocity_it_has(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Bullet itself heeds none: the ball is only pushed by the overlap."""
    lift = Lift(maximal=True)
    for k in range(50):
        lift.put_plate(k * H)
        lift.give_plate(0, 0, 1)
        lift.step()
    assert capfd.readouterr().err.count(MOVES) == 1
    lift.close()


def test_a_plate_that_turns_without_a_velocity_is_named(
    lift: Lift, capfd: pytest.CaptureFixture[str]
) -> None:
    for k in range(40):
        turned = bullet.getQuaternionFromEuler((0, 0.02 * k, 0))
        bullet.resetBasePositionAndOrientation(lift.plate, (0.5, 0, -0.1), turned, **lift.here)
        lift.step()
    assert capfd.readouterr().err.count(MOVES) == 1


def test_a_plate_that_is_put_elsewhere_or_moves_by_its_velocity_is_not_named(
    capfd: pytest.CaptureFixture[str],
) -> None:
    lift = Lift(gravity=9.81)
    for k in range(600):
        if k % 200 == 0:
            lift.put_plate(1e-3 * (k // 200))
        if k > 500:  # both, which agree
            height = 0.05 * math.sin(4 * (k - 500) * H)
            lift.put_plate(2e-3 + height)
            lift.give_plate(0, 0, 0.2 * math.cos(4 * (k - 500) * H))
        lift.step()
    assert capfd.readouterr().err == ""
    lift.close()


def test_a_link_without_a_shape_is_refused() -> None:
    here = {"physicsClientId": bullet.connect(bullet.DIRECT)}
    client = here["physicsClientId"]
    ball = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=RADIUS, **here)
    floor = bullet.createMultiBody(
        0, bullet.createCollisionShape(bullet.GEOM_PLANE, **here), **here
    )
    arm = bullet.createMultiBody(
        1.0, -1, basePosition=(0, 0, 1),
        linkMasses=[1.0], linkCollisionShapeIndices=[ball], linkVisualShapeIndices=[-1],
        linkPositions=[[0, 0, 0.2]], linkOrientations=[NO_TURN], linkInertialFramePositions=[[0, 0, 0]],
        linkInertialFrameOrientations=[NO_TURN], linkParentIndices=[0],
        linkJointTypes=[bullet.JOINT_REVOLUTE], linkJointAxis=[[0, 1, 0]], **here,
    )  # fmt: skip
    for maximal in (False, True):
        bare = bullet.createMultiBody(
            1.0, -1, basePosition=(0, 0, 3), useMaximalCoordinates=maximal, **here
        )
        with pytest.raises(SettingError, match="has no collision shape, so nothing meets it"):
            contact.add(ConstantRestitution(E), bare, floor, client=client)
    with pytest.raises(SettingError, match="name a link that has one, or -2 for any"):
        contact.add(ConstantRestitution(E), arm, floor, client=client)
    assert contact.add(ConstantRestitution(E), (arm, -2), floor, client=client) >= 0
    bullet.disconnect(client)


def test_a_law_for_any_link_and_one_for_a_link_of_it_are_two_for_one_pair(lift: Lift) -> None:
    client = lift.here["physicsClientId"]
    for first, second in (
        ((lift.ball, -2), lift.plate),
        (lift.plate, (lift.ball, -2)),
        ((lift.plate, -2), (lift.ball, -2)),
    ):
        with pytest.raises(SettingError, match="have law 0: remove it first"):
            contact.add(HuntCrossley(1e6, 0.3), first, second, client=client)
    contact.remove(0, client=client)
    assert contact.add(ConstantRestitution(E), (lift.ball, -2), lift.plate, client=client) == 1
    with pytest.raises(SettingError, match="link -2 of body 0 and link -1 of body 1"):
        contact.add(ConstantRestitution(E), lift.ball, lift.plate, client=client)


def pile(masses: tuple[float, ...], iterations: int, h: float = 2e-3) -> None:
    """Boxes that fall onto each other for 1.5 s."""
    here = {"physicsClientId": bullet.connect(bullet.DIRECT)}
    client = here["physicsClientId"]
    bullet.setPhysicsEngineParameter(fixedTimeStep=h, numSolverIterations=iterations, **here)
    bullet.setGravity(0, 0, -9.81, **here)
    side = bullet.createCollisionShape(bullet.GEOM_BOX, halfExtents=[0.05] * 3, **here)
    floor = bullet.createCollisionShape(bullet.GEOM_PLANE, **here)
    bodies = [bullet.createMultiBody(0, floor, **here)]
    for i, mass in enumerate(masses):
        at = (0.003 * (i % 2), 0.002 * (i % 3), 0.06 + 0.11 * i)
        bodies.append(bullet.createMultiBody(mass, side, basePosition=at, **here))
        contact.add(ConstantRestitution(E), bodies[-1], bodies[-2], client=client)
    for _ in range(round(1.5 / h)):
        bullet.stepSimulation(**here)
    bullet.disconnect(client)


def test_boxes_that_bullets_solver_lets_sink_are_named_with_what_to_set(
    capfd: pytest.CaptureFixture[str],
) -> None:
    pile((1.0, 2.0, 4.0, 8.0), 50)
    said = capfd.readouterr().err
    assert said.count("sink into each other, now by") >= 1
    assert "stops after 50 iterations: set numSolverIterations=200" in said
    pile((1.0, 2.0, 4.0, 8.0), 200)
    assert "sink into each other" not in capfd.readouterr().err
