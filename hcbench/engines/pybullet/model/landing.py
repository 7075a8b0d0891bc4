"""PyBullet: a robot dropped on its floor, its joints held, and the floor read as a force plate."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.pybullet.backend import (
    BACKEND,
    DISTANCE,
    FORCE,
    LINK_A,
    MASS,
    NORMAL,
    POINT_A,
)
from hcbench.engines.pybullet.model.bodies import (
    FIXED,
    JOINT_TYPE,
    mass_and_volumes,
)
from hcbench.engines.pybullet.model.in_child import can_fork, run_aside
from hcbench.engines.pybullet.model.open import set_pose
from hcbench.sim.landing import (
    WINDOW_S,
    DropPlan,
    FootfallLog,
    Landing,
    Landings,
    latest_touch,
    over_phases,
    raised_for,
    take_off_speed,
)
from hcbench.sim.model_under_test import unit_notes
from hcbench.sim.touch import travel_by_distance
from hcbench.system.errors import EngineFailed, UserError
from hcbench.terms import units

if TYPE_CHECKING:
    from collections.abc import Callable

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
# Places in getLinkState: centre of mass and its motion.
_CENTRE, _VELOCITY, _SPIN = 0, 6, 7


def land(world: LoadedWorld, request: Request, drops: DropPlan) -> Landings:
    """Drop the robot of a world from each height (m) at each tilt (rad) of a plan, each time in a
    forked copy of this process: the world stays as it is.

    Raises UserError where the world has no robot or nothing to land on, for a keyframe, and for a
    client that is another process's; EngineFailed where a velocity is no longer finite.
    """
    bullet = world.bullet
    if not can_fork(bullet):
        got = "a client that no copy of this process has"
        raise UserError("model", got, "files, or a client by pybullet.DIRECT")
    if request.key is not None:
        raise UserError("key", repr(request.key), "no keyframe: PyBullet has none")

    def prepared() -> tuple[_DropBench, Callable[[], None], str]:
        """(the robot in its pose over its floor, what drives its joints, the drive in words); in a
        forked copy, whose world it changes.
        """
        if request.timestep is not None:
            bullet.setPhysicsEngineParameter(fixedTimeStep=request.timestep)
        if request.gravity is not None:
            bullet.setGravity(*request.gravity)
        set_pose(world, request)
        bench = _DropBench(world)
        return bench, *_drive_of(drops.controller, bench)

    def described() -> Landings:
        """The landings without a drop: names, mass, step and gravity, and notes on the robot's
        unit.
        """
        bench, _, words = prepared()
        floors = ", ".join(world.name_of(floor) for floor in bench.floors)
        start = ", ".join(["the pose of the world", *(joint for joint, _ in request.pose)])
        notes = unit_notes(bench.name, *mass_and_volumes(bullet, bench.robot))
        return Landings(
            "pybullet",
            BACKEND.version(),
            world.label,
            bench.name,
            floors,
            start,
            words,
            bench.mass,
            bench.h,
            bench.g,
            (),
            tuple(notes),
        )

    def dropped(height: float, tilt: float, phase: float) -> Landing:
        def landing() -> Landing:
            bench, drive, _ = prepared()
            return bench.landing(height, tilt, drive, phase)

        return run_aside(bullet, landing)

    landings = [
        over_phases(partial(dropped, height, tilt))
        for height in drops.heights
        for tilt in drops.tilts
    ]
    return replace(run_aside(bullet, described), drops=tuple(landings))


class _Motion(NamedTuple):
    """Centres of mass, m, velocities, m/s, and spins, rad/s, of the links, (n, 3) each; the base
    last, as Python counts -1.
    """

    centres: Floats
    velocities: Floats
    spins: Floats

    def at(self, link: int, point: Floats) -> Floats:
        """Velocity of a link's material point, m/s."""
        lever = point - self.centres[link]
        return np.asarray(self.velocities[link] + np.cross(self.spins[link], lever))


class _DropBench:
    """A robot with a free base, in its pose, over the fixed bodies of its world.

    robot: its body. name: of it. links: numbers. masses: kg, of the links and last the base. mass:
    of all, kg. floors: the fixed bodies. h: time step, s. g: gravity, m/s²; up: unit vector against
    it, (3,).
    Raises UserError for a world without one, without a floor, or without gravity.
    """

    def __init__(self, world: LoadedWorld) -> None:
        """Find the robot, of several with a free base the one with most joints, and its floors.

        Raises UserError for a world without a free base, without a floor, or without gravity.
        """
        self._world = world
        bullet = self.bullet = world.bullet
        masses = {body: bullet.getDynamicsInfo(body, -1)[MASS] for body in bullet.bodies()}
        free = [body for body, mass in masses.items() if mass > 0.0]
        self.floors = [body for body, mass in masses.items() if not mass > 0.0]
        if not free:
            got = "no body has a free base"
            raise UserError("model", got, "a robot with a free base, to be dropped")
        if not self.floors:
            got = f"{world.label}: nothing is fixed"
            raise UserError("model", got, "a floor, such as plane.urdf", "Give it as a second file")
        self.robot = max(free, key=lambda body: (bullet.getNumJoints(body), masses[body]))
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

    def motion(self) -> _Motion:
        """The present motion of the base and all links."""
        bullet = self.bullet
        centre, _ = bullet.getBasePositionAndOrientation(self.robot)
        velocity, spin = bullet.getBaseVelocity(self.robot)
        states: Any = ()
        if self.links:
            states = bullet.getLinkStates(
                self.robot, self.links, computeLinkVelocity=1, computeForwardKinematics=1
            )
        return _Motion(
            np.array([*(state[_CENTRE] for state in states), centre]),
            np.array([*(state[_VELOCITY] for state in states), velocity]),
            np.array([*(state[_SPIN] for state in states), spin]),
        )

    def rising(self, motion: _Motion) -> float:
        """Speed of the centre of mass upwards, m/s."""
        return float(self.masses @ motion.velocities @ self.up) / self.mass

    def landing(
        self, height: float, tilt: float, drive: Callable[[], None], phase: float
    ) -> Landing:
        """Drop the robot once, and read how it lands.

        height: of its lowest point over the floor, m. tilt: by which its base is turned about y,
        rad. drive: called before each step. phase: place of the touch in a step. Raises UserError
        where nothing is below the robot or it meets nothing, EngineFailed for a velocity that is
        not finite.
        """
        bullet = self.bullet
        position, attitude = bullet.getBasePositionAndOrientation(self.robot)
        turn = [0.0, math.sin(tilt / 2), 0.0, math.cos(tilt / 2)]
        _, turned = bullet.multiplyTransforms([0, 0, 0], turn, [0, 0, 0], attitude)

        def lower(travel: float) -> None:
            place = np.array(position) - travel * self.up
            bullet.resetBasePositionAndOrientation(self.robot, place.tolist(), turned)

        def distance(travel: float) -> float:
            """Distance of the lowered robot from the floor, m; UserError where nothing is below it.
            travel: by which it is lowered, m.
            """
            lower(travel)
            points = []
            for floor in self.floors:
                points += bullet.getClosestPoints(self.robot, floor, _SEEN)
            if not points:
                got = f"{self.name!r} has nothing below to land on"
                raise UserError("model", got, "a floor", "Give it as a second file")
            return float(min(point[DISTANCE] for point in points))

        more = raised_for(phase, height, self.g, self.h)
        lower(travel_by_distance(distance, 1.0) - height - more)
        bullet.resetBaseVelocity(self.robot, [0, 0, 0], [0, 0, 0])
        return self._fall(height, tilt, drive)

    def _fall(self, height: float, tilt: float, drive: Callable[[], None]) -> Landing:
        """Simulate a drop until WINDOW_S (s) after the first touch, and read it.

        height, m, tilt, rad: of the drop, for the result. drive: called before each step. Raises
        EngineFailed for a velocity that is not finite, UserError where nothing is met.
        """
        latest = latest_touch(height, self.g)
        forces: list[float] = []
        rising: list[float] = []
        feet: dict[int, FootfallLog] = {}
        first = math.nan
        for step in range(math.ceil((latest + WINDOW_S) / self.h)):
            drive()
            before = self.motion()
            then = step * self.h
            self.bullet.stepSimulation()
            speed = self.rising(before)
            if not math.isfinite(speed):
                got = f"a velocity is not finite {then:.3g} s after release"
                advice = "Try --controller pd:KP,KD or a smaller --timestep"
                raise EngineFailed("model", got, "a robot that its controller holds", advice)
            force = self._tread(before, then - first if feet else 0.0, feet)
            if not feet:
                if then > latest:
                    break
                continue
            if not forces:
                first = then
            forces.append(force)
            rising.append(speed)
            if then - first > WINDOW_S:
                break
        if not feet:
            got = f"the robot met nothing within {latest:.3g} s"
            raise UserError("model", got, "a floor that it collides with")
        pushed: Floats = np.array(forces)
        speed_out = take_off_speed(pushed, np.array(rising), self.h)
        time: Floats = np.arange(len(forces), dtype=np.float64) * self.h
        fallen = tuple(
            log.footfall(self._world.name_of(self.robot, link)) for link, log in feet.items()
        )
        weight = self.mass * self.g
        return Landing(height, tilt, -rising[0], speed_out, weight, fallen, time, pushed)

    def _tread(self, before: _Motion, time: float, feet: dict[int, FootfallLog]) -> float:
        """Force of the floors on the robot in the step just taken, N upwards: of the contacts'
        normal forces, as PyBullet tells no way of their friction.

        time: since the first touch, s. Each link's force, slip and depth are added to `feet`.
        """
        # (force N, depth m, speed towards the floor, speed along it) of each point, by link.
        parts: dict[int, list[tuple[float, float, float, float]]] = {}
        upward = 0.0
        for floor in self.floors:
            for contact in self.bullet.getContactPoints(self.robot, floor):
                if not contact[FORCE] > 0.0:
                    continue
                normal = np.array(contact[NORMAL])
                upward += contact[FORCE] * float(self.up @ normal)
                velocity = before.at(contact[LINK_A], np.array(contact[POINT_A]))
                away = float(normal @ velocity)
                slide = float(np.linalg.norm(velocity - away * normal))
                point = (contact[FORCE], -contact[DISTANCE], -away, slide)
                parts.setdefault(contact[LINK_A], []).append(point)
        for link, points in parts.items():
            force, depth, speed, slide = np.array(points).T
            if link not in feet:
                feet[link] = FootfallLog(time, float(speed.max()), float(slide.max()))
            slip = float(force @ slide / force.sum())
            feet[link].add(time, self.h, float(force.sum()), slip, float(depth.max()))
        return upward


def _drive_of(controller: Any, bench: _DropBench) -> tuple[Callable[[], None], str]:
    """(function that drives the joints before each step, what holds them in words).

    "pd": position motors of PyBullet hold the pose, each with its joint's effort. "pd:KP,KD":
    torques by these gains, N m/rad and N m s/rad. "ctrl": the motors as the world has them. A
    function is called with the client's number and the robot's, and drives the motors itself.
    Raises UserError for another controller.
    """
    bullet = bench.bullet
    robot = bench.robot
    joints = [link for link in bench.links if bullet.getJointInfo(robot, link)[JOINT_TYPE] != FIXED]
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
    for joint in joints:
        bullet.setJointMotorControl2(robot, joint, module.VELOCITY_CONTROL, force=0)

    def hold() -> None:
        for joint, angle in zip(joints, pose, strict=True):
            state = bullet.getJointState(robot, joint)
            torque = kp * (angle - state[_POSITION]) - kd * state[_SPEED]
            bullet.setJointMotorControl2(robot, joint, module.TORQUE_CONTROL, force=torque)

    return hold, f"PD holds {len(joints)} joints: {kp:g} N m/rad, {kd:g} N m s/rad"


def _gains(controller: str) -> tuple[float, float]:
    """(KP, KD) of the text "pd:KP,KD", N m/rad and N m s/rad, or for slides N/m and N s/m.

    controller: the text. Raises UserError for another text or another number of gains,
    QuantityError for one that is not a number from 0 up.
    """
    kind, _, text = controller.partition(":")
    gains = [units.parse(gain, "number", "controller", least=0.0) for gain in text.split(",")]
    if kind != "pd" or len(gains) != _GAINS:
        expected = "pd, pd:KP,KD, ctrl, or FILE.py:FUNCTION"
        raise UserError("controller", repr(controller)[:60], expected)
    return gains[0], gains[1]
