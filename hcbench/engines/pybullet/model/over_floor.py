"""PyBullet: a robot over the fixed bodies of its world: how far above them, how it moves, and what
drives its joints while it lands.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.pybullet.backend import DISTANCE, MASS, POINT_A
from hcbench.engines.pybullet.model.bodies import FIXED, JOINT_TYPE, bounding_boxes
from hcbench.engines.pybullet.model.open import set_pose
from hcbench.sim.touch import travel_by_distance
from hcbench.system.errors import UserError
from hcbench.terms import units

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.engines.pybullet.model.open import LoadedWorld
    from hcbench.sim.model_under_test import Request
    from hcbench.terms.impact import Floats

# Farther from the floor PyBullet is not asked, m.
_SEEN = 1e3
# Places in getJointInfo and getJointState.
_EFFORT = 10
_POSITION, _SPEED = 0, 1
# KP and KD.
_GAINS = 2
# Places in getLinkState: centre of mass, attitude, and their motion.
CENTRE, QUATERNION, VELOCITY, SPIN = 0, 1, 6, 7


class LinkMotion(NamedTuple):
    """Centres of mass, m, velocities, m/s, and spins, rad/s, of a robot's links, (n, 3) each.

    The base comes last, so that the index -1, PyBullet's number of a base, finds it.
    """

    centres: Floats
    velocities: Floats
    spins: Floats

    def at(self, link: int, point: Floats) -> Floats:
        """Velocity of a link's material point, m/s, (3,). point: m, in the world."""
        lever = point - self.centres[link]
        return np.asarray(self.velocities[link] + np.cross(self.spins[link], lever))


class WorldOverFloor:
    """A robot with a free base, in its pose, over the fixed bodies of its world.

    robot: its body.
    name: of it.
    links: numbers.
    masses: kg, of the links and last the base.
    mass: of all, kg.
    floors: the fixed bodies.
    falling: those with a free base.
    h: time step, s.
    g: gravity, m/s²; up: unit vector against it, (3,).
    Raises UserError for a world without one, without a floor, or without gravity.
    """

    def __init__(self, world: LoadedWorld, robot: int | None = None) -> None:
        """Find the robot, of several with a free base the one with most joints, and its floors.

        robot: its number; None to find it.
        Raises UserError for a world without a free base, without a floor, or without gravity, and
        for a robot that is fixed.
        """
        self._world = world
        bullet = self.bullet = world.bullet
        masses = {body: bullet.getDynamicsInfo(body, -1)[MASS] for body in bullet.bodies()}
        self.falling = [body for body, mass in masses.items() if mass > 0.0]
        self.floors = [body for body, mass in masses.items() if not mass > 0.0]
        if not self.falling:
            got = "no body has a free base"
            raise UserError("model", got, "a robot with a free base, to be dropped")
        if not self.floors:
            got = f"{world.label}: nothing is fixed"
            raise UserError("model", got, "a floor, such as plane.urdf", "Give it as a second file")
        if robot is None:
            robot = max(self.falling, key=lambda body: (bullet.getNumJoints(body), masses[body]))
        elif robot not in self.falling:
            got = f"{world.name_of(robot)!r} is fixed"
            expected = f"one that falls: {', '.join(map(world.name_of, self.falling))}"
            raise UserError("move", got, expected)
        self.robot: int = robot
        self.name = world.name_of(self.robot)
        self.links = list(range(bullet.getNumJoints(self.robot)))
        # Of the links, and of the base at the end.
        self.masses: Floats = np.array(
            [bullet.getDynamicsInfo(self.robot, link)[MASS] for link in [*self.links, -1]]
        )
        self.mass = float(self.masses.sum())
        parameters = bullet.getPhysicsEngineParameters()
        self.h = float(parameters["fixedTimeStep"])
        gravity = np.array([parameters[f"gravityAcceleration{axis}"] for axis in "XYZ"])
        self.g = float(np.linalg.norm(gravity))
        if self.g == 0.0:
            got = "the world has none"
            raise UserError("gravity", got, "a gravity that lets the robot fall", "--gravity 9.81")
        self.up = -gravity / self.g

    def motion(self) -> LinkMotion:
        """Read the present motion of the links of the robot and of its base."""
        bullet = self.bullet
        centre, _ = bullet.getBasePositionAndOrientation(self.robot)
        velocity, spin = bullet.getBaseVelocity(self.robot)
        states: Any = ()
        if self.links:
            states = bullet.getLinkStates(
                self.robot, self.links, computeLinkVelocity=1, computeForwardKinematics=1
            )
        return LinkMotion(
            np.array([*(state[CENTRE] for state in states), centre]),
            np.array([*(state[VELOCITY] for state in states), velocity]),
            np.array([*(state[SPIN] for state in states), spin]),
        )

    def rising(self, motion: LinkMotion) -> float:
        """Speed of the centre of mass upwards, m/s."""
        return float(self.masses @ motion.velocities @ self.up) / self.mass

    def _to_clear_slabs(self) -> float:
        """The way up, m, that the robot has to go to be above each floor through which it reaches: its
        base is above the middle of the floor, its lowest point below the underside. 0 for a robot
        that reaches through none.

        Many URDFs have their origin in the base: at height 0 the legs are under a thin slab, and the
        robot would come to rest on its base.
        """
        lowest, _ = self._extent(self.robot)
        position, _ = self.bullet.getBasePositionAndOrientation(self.robot)
        base = float(np.array(position) @ self.up)
        way = 0.0
        for floor in self.floors:
            underside, top = self._extent(floor)
            reaches_through = lowest < underside and base > 0.5 * (underside + top)
            if reaches_through and self._is_over(floor):
                way = max(way, top - lowest)
        return way

    def _extent(self, body: int) -> tuple[float, float]:
        """Lowest and highest end of a body's bounding boxes, m, along `up`."""
        boxes = bounding_boxes(self.bullet, body)
        # Of a box: the corner nearest to the ground, and the one farthest from it.
        low = np.where(self.up > 0.0, boxes[:, 0], boxes[:, 1]) @ self.up
        high = np.where(self.up > 0.0, boxes[:, 1], boxes[:, 0]) @ self.up
        return float(low.min()), float(high.max())

    def _is_over(self, floor: int) -> bool:
        """Say whether the bounding boxes of the robot and of a floor overlap, seen from above."""
        robot = bounding_boxes(self.bullet, self.robot)
        other = bounding_boxes(self.bullet, floor)
        begins_before = robot[:, 0].min(axis=0) < other[:, 1].max(axis=0)
        ends_behind = other[:, 0].min(axis=0) < robot[:, 1].max(axis=0)
        overlaps = begins_before & ends_behind
        # The axis along which the robot falls does not count.
        return bool((overlaps | (np.abs(self.up) > 0.5)).all())

    def put(self, height: float, turn: Sequence[float]) -> Floats:
        """Put the robot at rest with its lowest point at a height over the floor.

        height: m.
        turn: quaternion x y z w by which its base is turned in the world, from its present
        attitude.
        Returns the lowest point, m, (3,).
        Raises UserError where nothing is below the robot.
        """
        bullet = self.bullet
        position, attitude = bullet.getBasePositionAndOrientation(self.robot)
        _, turned = bullet.multiplyTransforms([0, 0, 0], turn, [0, 0, 0], attitude)

        def lower(travel: float) -> None:
            """Put the turned base `travel` m below where it stood."""
            place = np.array(position) - travel * self.up
            bullet.resetBasePositionAndOrientation(self.robot, place.tolist(), turned)

        def nearest(travel: float) -> Any:
            """The point of getClosestPoints nearest to a floor, with the robot lowered by `travel` m.
            Raises UserError where nothing is below it.
            """
            lower(travel)
            points = []
            for floor in self.floors:
                points += bullet.getClosestPoints(self.robot, floor, _SEEN)
            if not points:
                got = f"{self.name!r} has nothing below to land on"
                raise UserError("model", got, "a floor", "Give it as a second file")
            return min(points, key=lambda point: point[DISTANCE])

        # From above, down to the floor, and up again by the height.
        above = self._to_clear_slabs()
        to_floor = travel_by_distance(lambda by: float(nearest(by - above)[DISTANCE]), 1.0) - above
        travel = to_floor - height
        lowest = np.array(nearest(travel)[POINT_A])
        bullet.resetBaseVelocity(self.robot, [0, 0, 0], [0, 0, 0])
        return lowest


def prepare(world: LoadedWorld, request: Request) -> None:
    """Give a world the time step, s, gravity, m/s², and pose of a request.

    Raises UserError for a keyframe, which PyBullet does not have, and for a pose that does not fit
    the world.
    """
    if request.key is not None:
        raise UserError("key", repr(request.key), "no keyframe: PyBullet has none")
    if request.timestep is not None:
        world.bullet.setPhysicsEngineParameter(fixedTimeStep=request.timestep)
    if request.gravity is not None:
        world.bullet.setGravity(*request.gravity)
    set_pose(world, request)


def turn_about(axis: Sequence[float], angle: float) -> list[float]:
    """Quaternion x y z w of a turn about an axis of the world, a unit vector, by an angle, rad."""
    sine = math.sin(angle / 2)
    return [*(sine * along for along in axis), math.cos(angle / 2)]


def drive_of(controller: Any, over_floor: WorldOverFloor) -> tuple[Callable[[], None], str]:
    """Set up what holds a robot's joints while it lands: returns a function to call before each step,
    and the drive in words.

    controller: "pd": position motors of PyBullet hold the present pose, each with its joint's
    effort; "pd:KP,KD": torques towards that pose by these gains, N m/rad and N m s/rad; "ctrl": the
    motors as the world has them; or a function, called before each step with the numbers of the
    client and of the robot, that drives the motors itself.
    Raises UserError for another controller, QuantityError for a gain that is not a number from 0.
    """
    bullet = over_floor.bullet
    robot = over_floor.robot
    joints = [
        link for link in over_floor.links if bullet.getJointInfo(robot, link)[JOINT_TYPE] != FIXED
    ]
    pose = [bullet.getJointState(robot, joint)[_POSITION] for joint in joints]
    module = bullet.module
    if callable(controller):
        return lambda: controller(bullet.client, robot), "a function drives its joints"
    if controller == "ctrl":
        return lambda: None, "the motors of the world drive its joints"
    if controller == "pd":
        for joint, angle in zip(joints, pose, strict=True):
            effort = bullet.getJointInfo(robot, joint)[_EFFORT]
            # 0 where the file names no effort: PyBullet's default force acts then.
            force = {"force": effort} if effort > 0.0 else {}
            bullet.setJointMotorControl2(
                robot, joint, module.POSITION_CONTROL, targetPosition=angle, **force
            )
        return lambda: None, f"position motors hold {len(joints)} joints"
    kp, kd = _gains(controller)
    # PyBullet's default motors would hold the joints beside the torques.
    for joint in joints:
        bullet.setJointMotorControl2(robot, joint, module.VELOCITY_CONTROL, force=0)

    def hold() -> None:
        """Set the torques of the coming step."""
        for joint, angle in zip(joints, pose, strict=True):
            state = bullet.getJointState(robot, joint)
            torque = kp * (angle - state[_POSITION]) - kd * state[_SPEED]
            bullet.setJointMotorControl2(robot, joint, module.TORQUE_CONTROL, force=torque)

    return hold, f"PD holds {len(joints)} joints: {kp:g} N m/rad, {kd:g} N m s/rad"


def _gains(controller: str) -> tuple[float, float]:
    """Gains KP and KD of the text "pd:KP,KD", N m/rad and N m s/rad, or for slides N/m and N s/m.

    Raises UserError for another text or another number of gains, QuantityError for a gain that is
    not a number from 0 up.
    """
    kind, _, text = controller.partition(":")
    gains = [units.parse(gain, "number", "controller", least=0.0) for gain in text.split(",")]
    if kind != "pd" or len(gains) != _GAINS:
        expected = "pd, pd:KP,KD, ctrl, or FILE.py:FUNCTION"
        raise UserError("controller", repr(controller)[:60], expected)
    return gains[0], gains[1]
