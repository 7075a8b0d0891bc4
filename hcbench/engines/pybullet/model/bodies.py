"""PyBullet's bodies: how points of their links move, and the effective mass that a contact feels.

Bullet's own calculateMassMatrix and calculateJacobian are not used: they are right
neither for spherical joints nor for axes that are not unit vectors, and need link frames,
which it returns in single precision.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.pybullet.backend import (
    FRAME_POSITION,
    FRAME_QUATERNION,
    INERTIA,
    MASS,
    BulletClient,
)
from hcbench.terms.impact import Floats

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Three numbers at a time, as tuples: a tenth of what small arrays cost.

Vector = tuple[float, float, float]


def vector(values: Sequence[float] | NDArray[np.float64]) -> Vector:
    """The first three of `values`."""
    return float(values[0]), float(values[1]), float(values[2])


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Sequence[float], b: Sequence[float]) -> Vector:
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def add_scaled(a: Sequence[float], s: float, b: Sequence[float]) -> Vector:
    """a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


def rotate(q: Sequence[float], a: Sequence[float]) -> Vector:
    """A rotated by the unit quaternion q = (x, y, z, w)."""
    t = cross(q, a)
    t = (2.0 * t[0], 2.0 * t[1], 2.0 * t[2])
    u = cross(q, t)
    return a[0] + q[3] * t[0] + u[0], a[1] + q[3] * t[1] + u[1], a[2] + q[3] * t[2] + u[2]


def rotate_inverse(q: Sequence[float], a: Sequence[float]) -> Vector:
    """A rotated by the inverse of q."""
    return rotate((-q[0], -q[1], -q[2], q[3]), a)


# Kinds of joints, pybullet.JOINT_...
REVOLUTE, PRISMATIC, SPHERICAL, PLANAR, FIXED = range(5)
# Places in getJointInfo.
JOINT_NAME = 1
JOINT_TYPE = 2
LINK_NAME = 12
AXIS = 13
PARENT = 16
# Kinds of bodies: rigid bodies proper, which Bullet does not step as multibodies; and cloth.
MAXIMAL_COORDINATES = 1
SOFT_BODY = 3
# Places in getLinkState: position, attitude and motion of the centre of mass.
_CENTRE = 0
_QUATERNION = 1
_VELOCITY = 6
_SPIN = 7

# The box about an endless plane is larger, m³.
_ENDLESS = 1e15
_FREEDOMS = {REVOLUTE: 1, PRISMATIC: 1, SPHERICAL: 3, PLANAR: 3, FIXED: 0}
_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_ZERO = (0.0, 0.0, 0.0)
_UNKNOWN = (math.nan, math.nan, math.nan)

# How a unit force at a contact acts on a body: what it is along each degree of
# freedom, and M^-1 times that.
Response = tuple[Sequence[float], Sequence[float]]


class BulletBody:
    """A body of a client with all its links: `kind` is "fixed", "free"
    (one rigid body) or "jointed".

    number: PyBullet's id of the body.
    Links are numbered as in PyBullet, -1 is the base. Masses and inertias are read when it is made,
    the state then and by `refresh`.
    """

    def __init__(self, bullet: BulletClient, number: int) -> None:
        """Read masses, inertias, joints and the present state of a body of the client."""
        self.bullet = bullet
        self.number = number
        self.joints = [bullet.getJointInfo(number, j) for j in range(bullet.getNumJoints(number))]
        base = bullet.getDynamicsInfo(number, -1)
        # Of the base, kg and kg m² along its axes. A fixed base has a mass of 0.
        self.mass = base[MASS]
        self.inertia = base[INERTIA]
        can_bend = any(joint[JOINT_TYPE] != FIXED for joint in self.joints)
        # A free body with fixed joints has more than one inertia: its tree adds them up.
        has_links = self.mass > 0.0 and bool(self.joints)
        self._tree: JointTree | None = None
        if can_bend or has_links:
            self.kind = "jointed"
            self._tree = JointTree(self)
        elif self.mass > 0.0:
            self.kind = "free"
        else:
            self.kind = "fixed"
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
        """Position, m, and quaternion (x, y, z, w) of a link's centre of mass frame."""
        if link < 0:
            return vector(self.position), self.quaternion
        state = self._link_state(link)
        return vector(state[_CENTRE]), state[_QUATERNION]

    def _link_state(self, link: int) -> Any:
        return self.bullet.getLinkState(
            self.number, link, computeLinkVelocity=1, computeForwardKinematics=1
        )

    def velocity_at(self, link: int, point: Sequence[float]) -> Vector:
        """Velocity of a link's material point, m/s, in the world.

        point: in the world, m, (3,).
        The base's state is that of the last `refresh`, a link's the present one.
        """
        if self.kind == "fixed":
            return _ZERO
        if link < 0:
            centre = self.position
            velocity = self.velocity
            spin = self.spin
        else:
            state = self._link_state(link)
            centre = state[_CENTRE]
            velocity = state[_VELOCITY]
            spin = state[_SPIN]
        arm = add_scaled(point, -1.0, centre)
        return add_scaled(velocity, 1.0, cross(spin, arm))

    def spin_of(self, link: int) -> Vector:
        """Angular velocity of a link, rad/s."""
        if self.kind == "fixed":
            return _ZERO
        if link < 0:
            return vector(self.spin)
        return vector(self._link_state(link)[_SPIN])

    def joint_axis(self, joint: int) -> Vector:
        """A joint's axis in the world, as long as in the model."""
        _, quaternion = self.pose(joint)
        return rotate(quaternion, self.joints[joint][AXIS])

    def response(self, link: int, point: Vector, direction: Vector) -> Response | None:
        """Response of the body to a unit force on a link: J, by which the force reaches each degree
        of freedom, and the acceleration M^-1 J^T of each; None for a fixed body.

        link: number, -1 the base.
        point: where the force acts, m, in the world.
        direction: of the force, unit vector, in the world.
        The degrees of freedom are 6 of a free base, then those of the joints. NaN where a joint's
        axis is unknown.
        """
        if self.kind == "fixed":
            return None
        if self._tree is not None:
            return self._tree.response(link, point, direction)
        # In the frame of the main axes, in which the inverse inertia is diagonal.
        arm = add_scaled(point, -1.0, self.position)
        torque = rotate_inverse(self.quaternion, cross(arm, direction))
        accelerations = [part / self.mass for part in direction]
        for part, inertia in zip(torque, self.inertia, strict=True):
            # Bullet does not turn a body about an axis without inertia.
            about = 0.0
            if inertia > 0.0:
                about = part / inertia
            accelerations.append(about)
        return (*direction, *torque), accelerations

    def push(self, link: int, point: Vector, force: Vector) -> None:
        """Add a force, N, at a point of a link, m, in the world, for the step that comes next."""
        if self.kind != "fixed":
            world = self.bullet.module.WORLD_FRAME
            self.bullet.applyExternalForce(self.number, link, force, point, world)


class JointTree:
    """Jacobians and mass matrix of a body with joints.

    Each degree of freedom is a twist, its angular velocity `w` and its velocity `v` at
    the world's origin, of the links that it carries. The mass matrix is M = Σ m Jv^T
    Jv + Jw^T I Jw over the links.
    """

    def __init__(self, body: BulletBody) -> None:
        """Read what does not change with the pose: inertias, where each joint is in its link, and
        which degrees of freedom move which links.
        """
        self._body = body
        # True where the pose changed since Jacobians and masses were worked out.
        self.outdated = True
        links = range(-1, len(body.joints))
        infos = [body.bullet.getDynamicsInfo(body.number, link) for link in links]
        # (links, 6): the roots of m, m, m and the three of I, which scale
        # a link's rows of the Jacobian.
        inertias = []
        for info in infos:
            mass = info[MASS]
            inertias.append((mass, mass, mass, *info[INERTIA]))
        self._inertia = np.sqrt(inertias)
        # Each joint's origin in its link's centre of mass frame, m.
        self._pivots = []
        for info in infos[1:]:
            back = add_scaled(_ZERO, -1.0, info[FRAME_POSITION])
            self._pivots.append(rotate_inverse(info[FRAME_QUATERNION], back))
        # The joint of each degree of freedom; -1 for the base's.
        self._owners: list[int] = []
        if body.mass > 0.0:
            self._owners += [-1] * 6
        for number, joint in enumerate(body.joints):
            self._owners += [number] * _FREEDOMS[joint[JOINT_TYPE]]
        # (links, freedoms): True where a degree of freedom moves a link.
        carries = []
        for link in links:
            carriers = {-1, *body.ancestors(link)}
            carries.append([owner in carriers for owner in self._owners])
        self._carries = np.array(carries)

    def response(self, link: int, point: Vector, direction: Vector) -> Response:
        """The response of this body to a push, as `BulletBody.response`."""
        if self.outdated:
            self._read()
        along = self._v @ direction + self._w @ cross(point, direction)
        row = self._carries[link + 1] * along
        return row.tolist(), (self._inverse_mass @ row).tolist()

    def _read(self) -> None:
        """Compute the twists and the inverse mass matrix in the body's present state."""
        body = self._body
        states = body.bullet.getLinkStates(
            body.number, range(len(body.joints)), computeForwardKinematics=1
        )
        twists = []
        if body.mass > 0.0:
            twists += _base_twists(body.position)
        for joint, state, pivot in zip(body.joints, states, self._pivots, strict=True):
            twists += _joint_twists(joint, state[_CENTRE], state[_QUATERNION], pivot)
        # Of each degree of freedom, spin and velocity at the world's origin: (freedoms, 3) each.
        self._w, self._v = np.array(twists, dtype=float).transpose(1, 0, 2)
        centres = [body.position]
        quaternions = [body.quaternion]
        for state in states:
            centres.append(state[_CENTRE])
            quaternions.append(state[_QUATERNION])
        # w @ crosses is w x centre.
        crosses = np.array([((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)) for x, y, z in centres])
        matrix = body.bullet.module.getMatrixFromQuaternion
        rotations = np.array([matrix(quaternion) for quaternion in quaternions]).reshape(-1, 3, 3)
        # Velocities of centres of mass and angular velocities about main
        # axes: (links, freedoms, 6).
        jacobian = np.concatenate([self._v + self._w @ crosses, self._w @ rotations], axis=2)
        jacobian *= self._inertia[:, None]
        carried = jacobian * self._carries[:, :, None]
        rows = carried.transpose(0, 2, 1).reshape(-1, len(self._owners))
        self._inverse_mass = _inverse(rows.T @ rows)
        self.outdated = False


def _base_twists(centre: Sequence[float]) -> list[tuple[Any, Any]]:
    """(w, v) of the degrees of freedom of a free base."""
    return [(axis, cross(centre, axis)) for axis in _AXES] + [(_ZERO, axis) for axis in _AXES]


def _joint_twists(
    joint: Any, centre: Sequence[float], quaternion: Sequence[float], pivot: Vector
) -> list[tuple[Any, Any]]:
    """Twists of the degrees of freedom of a joint, in the world: for each the spin w and the velocity
    v at the world's origin of the links that it moves, at a rate of 1.

    joint: PyBullet's info.
    centre (m), quaternion (x, y, z, w): of its link's frame at the centre of mass.
    pivot: the joint's origin in that frame, m. NaN for a planar joint, whose axis PyBullet does not
    return.
    """
    kind = joint[JOINT_TYPE]
    if kind == FIXED:
        return []
    if kind == PLANAR:
        # PyBullet does not return the axis of such a joint.
        return [(_UNKNOWN, _UNKNOWN)] * 3
    where = add_scaled(centre, 1.0, rotate(quaternion, pivot))
    if kind == SPHERICAL:
        return [(axis, cross(where, axis)) for axis in _AXES]
    axis = rotate(quaternion, joint[AXIS])
    if kind == PRISMATIC:
        return [(_ZERO, axis)]
    return [(axis, cross(where, axis))]


def _inverse(mass_matrix: Floats) -> Floats:
    """M^-1; a degree of freedom that carries no inertia does not move, as in Bullet."""
    idle = np.diag(np.where(np.diagonal(mass_matrix) == 0.0, 1.0, 0.0))
    return np.asarray(np.linalg.inv(mass_matrix + idle) - idle)


@dataclass(frozen=True, slots=True)
class ContactRow:
    """Responses of two bodies to a unit force at a contact.

    bodies: of the contact.
    responses: of each, as `BulletBody.response` returns it, to the same force, that on the first;
    the second feels its opposite, for which `acceleration` changes the sign. None for a body that
    cannot move.
    """

    bodies: tuple[BulletBody, BulletBody]
    responses: tuple[Response | None, Response | None]

    def acceleration(self, other: ContactRow) -> float:
        """Relative acceleration along this row by the unit force of another, 1/kg.

        J M^-1 J'^T, over the bodies that the two rows share: 0 if they share none.
        other: responses of two bodies, which may be others, to the other force.
        """
        total = 0.0
        for i, own_body in enumerate(self.bodies):
            for j, other_body in enumerate(other.bodies):
                response = self.responses[i]
                push = other.responses[j]
                if own_body is not other_body or response is None or push is None:
                    continue
                reach, _ = response
                _, accelerations = push
                part = sum(a * b for a, b in zip(reach, accelerations, strict=True))
                # The second body feels the opposite force, and its motion counts the other way.
                if i == j:
                    total += part
                else:
                    total -= part
        return float(total)

    @property
    def inverse_mass(self) -> float:
        """1 / effective mass = J M^-1 J^T, 1/kg; 0 where neither can move."""
        return self.acceleration(self)


def contact_row(
    first: tuple[BulletBody, int], second: tuple[BulletBody, int], point: Vector, direction: Vector
) -> ContactRow:
    """Responses of two bodies to a unit force at the point where they touch, as a `ContactRow`:
    from them follow their effective mass along the direction, and how one contact moves another.

    first, second: (body, number of its link, -1 the base) each.
    point: where they touch, m, in the world.
    direction: unit vector, in the world, of the force on the first.
    The response of the second is to a force along the same direction; `ContactRow.acceleration`
    changes its sign. A response is None for a fixed body, and NaN where the axis of a joint is
    unknown.
    """
    first_body, first_link = first
    second_body, second_link = second
    responses = (
        first_body.response(first_link, point, direction),
        second_body.response(second_link, point, direction),
    )
    return ContactRow((first_body, second_body), responses)


@dataclass(frozen=True, slots=True)
class FreeBase:
    """A body that is moved as a whole.

    position (m), quaternion: where it starts.

    direction: unit vector.
    """

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
    """A prismatic joint that moves a link.

    start: its position.
    approach: m towards the other for 1 of it.
    """

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
    """Joints that together move a link as a push at its contact would.

    starts: their positions at touch.
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


def bounding_boxes(bullet: BulletClient, body: int) -> Floats:
    """Bounding boxes of the base of a body and of its links: (links + 1, 2, 3), lower and upper corner
    in the world, m.
    """
    links = range(-1, bullet.getNumJoints(body))
    return np.array([bullet.getAABB(body, link) for link in links])


def mass_and_volumes(bullet: BulletClient, body: int) -> tuple[float, float, float]:
    """Mass of a body with all its links, kg, and two volumes in its present pose, m³: the sum of
    those of the boxes about each link, and that of the box about all; 0 where a box has no end.
    """
    links = range(-1, bullet.getNumJoints(body))
    mass = sum(bullet.getDynamicsInfo(body, link)[MASS] for link in links)
    boxes = bounding_boxes(bullet, body)
    each = float(np.prod(boxes[:, 1] - boxes[:, 0], axis=1).sum())
    around = float(np.prod(boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)))
    if not around < _ENDLESS:
        return mass, 0.0, 0.0
    return mass, each, around
