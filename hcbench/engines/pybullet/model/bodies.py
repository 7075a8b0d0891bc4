"""PyBullet's bodies: how points of their links move, and the effective mass that a contact feels.

Bullet's own calculateMassMatrix and calculateJacobian are not used: they are right neither for spherical
joints nor for axes that are not unit vectors, and need link frames, which it returns in single precision.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.engines.pybullet.vectors import Vector, add_scaled, cross, rotate, rotate_inverse, vector
from hcbench.terms.impact import Floats

# pybullet.JOINT_...: places in getJointInfo follow
REVOLUTE, PRISMATIC, SPHERICAL, PLANAR, FIXED = range(5)
JOINT_NAME, JOINT_TYPE, LINK_NAME, AXIS, PARENT = 1, 2, 12, 13, 16

_FREEDOMS = {REVOLUTE: 1, PRISMATIC: 1, SPHERICAL: 3, PLANAR: 3, FIXED: 0}
_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_ZERO, _UNKNOWN = (0.0, 0.0, 0.0), (math.nan, math.nan, math.nan)

# How a unit force at a contact acts on a body: what it is along each degree of freedom, and M^-1 times that.
Response = tuple[Sequence[float], Sequence[float]]


class BulletBody:
    """A body of a client with all its links: `kind` is "fixed", "free" (one rigid body) or "jointed".

    Links are numbered as in PyBullet, -1 is the base. Masses and inertias are read when it is made, the state
    then and by `refresh`.
    """

    def __init__(self, bullet: BulletClient, number: int) -> None:
        self.bullet, self.number = bullet, number
        self.joints = [bullet.getJointInfo(number, j) for j in range(bullet.getNumJoints(number))]
        # a fixed base has mass 0
        self.mass, _, self.inertia = bullet.getDynamicsInfo(number, -1)[:3]
        jointed = any(joint[JOINT_TYPE] != FIXED for joint in self.joints) or (
            self.mass > 0.0 and self.joints
        )
        self.kind = "jointed" if jointed else "free" if self.mass > 0.0 else "fixed"
        self._tree = JointTree(self) if jointed else None
        self.refresh()

    def refresh(self) -> None:
        """Read position and velocity of the base; links are read when they are needed."""
        self.position, self.quaternion = self.bullet.getBasePositionAndOrientation(self.number)
        self.velocity, self.spin = self.bullet.getBaseVelocity(self.number)
        if self._tree is not None:
            self._tree.outdated = True

    def ancestors(self, link: int) -> list[int]:
        """The link itself and those that carry it, without the base, nearest first."""
        chain = []
        while link >= 0:
            chain.append(link)
            link = self.joints[link][PARENT]
        return chain

    def pose(self, link: int) -> tuple[Vector, Sequence[float]]:
        """Position and quaternion of a link's centre of mass frame."""
        if link < 0:
            return vector(self.position), self.quaternion
        state = self._link_state(link)
        return vector(state[0]), state[1]

    def _link_state(self, link: int) -> Any:
        return self.bullet.getLinkState(self.number, link, computeLinkVelocity=1, computeForwardKinematics=1)

    def velocity_at(self, link: int, point: Sequence[float]) -> Vector:
        """Velocity of a link's material point, m/s."""
        if self.kind == "fixed":
            return 0.0, 0.0, 0.0
        if link < 0:
            centre, v, w = self.position, self.velocity, self.spin
        else:
            state = self._link_state(link)
            centre, v, w = state[0], state[6], state[7]
        return add_scaled(v, 1.0, cross(w, add_scaled(point, -1.0, centre)))

    def spin_of(self, link: int) -> Vector:
        """Angular velocity of a link, rad/s."""
        if self.kind == "fixed":
            return 0.0, 0.0, 0.0
        return vector(self.spin if link < 0 else self._link_state(link)[7])

    def joint_axis(self, joint: int) -> Vector:
        """A joint's axis in the world, as long as in the model."""
        return rotate(self.pose(joint)[1], self.joints[joint][AXIS])

    def response(self, link: int, point: Vector, direction: Vector) -> Response | None:
        """Acceleration by a unit force at `point` along `direction`; None for a body that cannot
        move.
        """
        if self.kind == "fixed":
            return None
        if self._tree is not None:
            return self._tree.response(link, point, direction)
        torque = rotate_inverse(self.quaternion, cross(add_scaled(point, -1.0, self.position), direction))
        solved = [part / self.mass for part in direction]
        solved += [part / i if i > 0.0 else 0.0 for part, i in zip(torque, self.inertia, strict=True)]
        return (*direction, *torque), solved

    def push(self, link: int, point: Vector, force: Vector) -> None:
        """Add a force for the step that comes next."""
        if self.kind != "fixed":
            world = self.bullet.module.WORLD_FRAME
            self.bullet.applyExternalForce(self.number, link, force, point, world)


class JointTree:
    """Jacobians and mass matrix of a body with joints.

    Each degree of freedom is a twist, its angular velocity `w` and its velocity `v` at the world's origin, of
    the links that it carries. The mass matrix is M = Σ m Jv^T Jv + Jw^T I Jw over the links.
    """

    def __init__(self, body: BulletBody) -> None:
        self._body, self.outdated = body, True
        links = range(-1, len(body.joints))
        infos = [body.bullet.getDynamicsInfo(body.number, link) for link in links]
        self._inertia = np.sqrt([(info[0], info[0], info[0], *info[2]) for info in infos])
        self._pivots = [
            rotate_inverse(info[4], add_scaled((0.0, 0.0, 0.0), -1.0, info[3])) for info in infos[1:]
        ]
        carried = {link: {-1, *body.ancestors(link)} for link in links}
        self._owners = [-1] * 6 * (body.mass > 0.0)
        self._owners += [
            j for j, joint in enumerate(body.joints) for _ in range(_FREEDOMS[joint[JOINT_TYPE]])
        ]
        self._carries = np.array([[owner in carried[link] for owner in self._owners] for link in links])

    def response(self, link: int, point: Vector, direction: Vector) -> Response:
        """The response of this body to a push, as `BulletBody.response`."""
        if self.outdated:
            self._read()
        row = self._carries[link + 1] * (self._v @ direction + self._w @ cross(point, direction))
        return row.tolist(), (self._inverse_mass @ row).tolist()

    def _read(self) -> None:
        """Twists and mass matrix in the body's present state."""
        body = self._body
        states = body.bullet.getLinkStates(body.number, range(len(body.joints)), computeForwardKinematics=1)
        twists = _base_twists(body.position) if body.mass > 0.0 else []
        for joint, state, pivot in zip(body.joints, states, self._pivots, strict=True):
            twists += _joint_twists(joint, state[0], state[1], pivot)
        self._w, self._v = np.array(twists, dtype=float).transpose(1, 0, 2)
        poses = [(body.position, body.quaternion), *(state[:2] for state in states)]
        crosses = np.array([((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)) for (x, y, z), _ in poses])
        matrix = body.bullet.module.getMatrixFromQuaternion
        rotations = np.array([matrix(quaternion) for _, quaternion in poses]).reshape(-1, 3, 3)
        # Velocities of centres of mass and angular velocities about main axes: (links, freedoms, 6).
        jacobian = np.concatenate([self._v + self._w @ crosses, self._w @ rotations], axis=2)
        jacobian *= self._inertia[:, None]
        rows = (jacobian * self._carries[:, :, None]).transpose(0, 2, 1).reshape(-1, len(self._owners))
        self._inverse_mass, self.outdated = _inverse(rows.T @ rows), False


def _base_twists(centre: Sequence[float]) -> list[tuple[Any, Any]]:
    """(w, v) of the degrees of freedom of a free base."""
    return [(axis, cross(centre, axis)) for axis in _AXES] + [(_ZERO, axis) for axis in _AXES]


def _joint_twists(
    joint: Any, centre: Sequence[float], quaternion: Sequence[float], pivot: Vector
) -> list[tuple[Any, Any]]:
    """(w, v) of each degree of freedom of a joint. centre, quaternion: of its link; pivot: in that frame."""
    kind = joint[JOINT_TYPE]
    if kind == PLANAR:
        return [(_UNKNOWN, _UNKNOWN)] * 3  # PyBullet does not return its axis
    where = add_scaled(centre, 1.0, rotate(quaternion, pivot))
    if kind == SPHERICAL:
        return [(axis, cross(where, axis)) for axis in _AXES]
    axis = rotate(quaternion, joint[AXIS])
    return {REVOLUTE: [(axis, cross(where, axis))], PRISMATIC: [(_ZERO, axis)], FIXED: []}[kind]


def _inverse(mass_matrix: Floats) -> Floats:
    """M^-1; a degree of freedom that carries no inertia does not move, as in Bullet."""
    idle = np.diag(np.where(np.diagonal(mass_matrix) == 0.0, 1.0, 0.0))
    return np.asarray(np.linalg.inv(mass_matrix + idle) - idle)


@dataclass(frozen=True, slots=True)
class ContactRow:
    """Response of two bodies to a unit force on the first at a contact, and its opposite on the
    second.
    """

    bodies: tuple[BulletBody, BulletBody]
    responses: tuple[Response | None, Response | None]

    def acceleration(self, other: ContactRow) -> float:
        """Relative acceleration along this row by the unit force of another, 1/kg."""
        total = 0.0
        for i, body in enumerate(self.bodies):
            for j, its in enumerate(other.bodies):
                one, two = self.responses[i], other.responses[j]
                if body is its and one is not None and two is not None:
                    part = sum(a * b for a, b in zip(one[0], two[1], strict=True))
                    total += part if i == j else -part
        return float(total)

    @property
    def inverse_mass(self) -> float:
        """1 / effective mass = J M^-1 J^T, 1/kg; 0 where neither can move."""
        return self.acceleration(self)


def contact_row(
    first: tuple[BulletBody, int], second: tuple[BulletBody, int], point: Vector, direction: Vector
) -> ContactRow:
    """The row of two (body, link) that touch at `point`, for forces along `direction`."""
    (one, _), (two, _) = sides = (first, second)
    return ContactRow((one, two), tuple(body.response(link, point, direction) for body, link in sides))  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True)
class FreeBase:
    """A body that is moved as a whole. position (m), quaternion: where it starts. direction: unit vector."""

    body: int
    description: str
    position: Floats
    quaternion: Sequence[float]
    direction: Floats

    def put(self, bullet: BulletClient, travel: float, speed: float = 0.0) -> None:
        """Put it `travel` m nearer than it starts, at `speed` m/s towards the other."""
        position = self.position + self.direction * travel
        bullet.resetBasePositionAndOrientation(self.body, position.tolist(), self.quaternion)
        bullet.resetBaseVelocity(self.body, (self.direction * speed).tolist(), [0.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class SlidingJoint:
    """A prismatic joint that moves a link. start: its position. approach: m towards the other for 1 of it."""

    body: int
    description: str
    joint: int
    start: float
    approach: float

    def put(self, bullet: BulletClient, travel: float, speed: float = 0.0) -> None:
        """Put the link `travel` m nearer than it starts, at `speed` m/s towards the other."""
        bullet.resetJointState(
            self.body, self.joint, self.start + travel / self.approach, speed / self.approach
        )


@dataclass(frozen=True, slots=True)
class SwingingLink:
    """Joints that together move a link as a push at its contact would. starts: their positions at touch.
    rates: their velocities for an approach at 1 m/s.
    """

    body: int
    description: str
    starts: Mapping[int, float]
    rates: Mapping[int, float]

    def put(self, bullet: BulletClient, travel: float, speed: float = 0.0) -> None:
        """Put the link `travel` m nearer than it starts, at `speed` m/s towards the other."""
        for joint, start in self.starts.items():
            rate = self.rates[joint]
            bullet.resetJointState(self.body, joint, start + rate * travel, rate * speed)


Mover = FreeBase | SlidingJoint | SwingingLink
