"""Where a pair in PyBullet just touches, and what is moved to launch it from there."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.engines.pybullet.model import JOINT_NAME, JOINT_TYPE, PRISMATIC, BulletBody, contact_row
from hcbench.engines.pybullet.user_model import ANY_LINK, BodyPart, LoadedWorld
from hcbench.engines.pybullet.vectors import vector
from hcbench.errors import UserError
from hcbench.impact import Floats
from hcbench.sim.touch import LEAST_APPROACH, require_apart, require_reachable, travel_by_distance

_REACH = 1e4  # m: the largest distance between the two at the start
DISTANCE, NORMAL = 8, 7  # in PyBullet's closest points; the normal points at the first body


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


Mover = FreeBase | SlidingJoint


@dataclass(frozen=True, slots=True)
class BulletPlacement:
    """Where launches start from: the two touch once `mover` has travelled `travel` m.

    first, second: the links that touch, the moving one first. normal: unit vector from the first to the
    second. point: where they touch, m. effective_mass: along the normal, kg. lift: by how much the first
    was raised above the second to begin with, m. overlap: of the two at the start, m.
    """

    first: BodyPart
    second: BodyPart
    mover: Mover
    travel: float
    normal: Floats
    point: Floats
    effective_mass: float
    lift: float
    overlap: float

    def launch(self, bullet: BulletClient, speed: float, clearance: float) -> None:
        """Put the moving one `clearance` m before the touch, at `speed` m/s."""
        self.mover.put(bullet, self.travel - clearance, speed)


def place(world: LoadedWorld, first: BodyPart, second: BodyPart) -> BulletPlacement:
    """Bring the two just to touch. Raises UserError with the reason where that cannot be done.

    In a world made of files both stand at the origin: the moving one is then raised above the other first.
    """
    bullet = world.bullet
    for moving, other in ((first, second), (second, first)):
        if BulletBody(bullet, moving.body).mass > 0.0:
            lift = _lift(bullet, moving, other) if world.files else 0.0
            position, quaternion = bullet.getBasePositionAndOrientation(moving.body)
            normal, text = _normal(nearest(bullet, moving, other)), f"{moving.name!r} by its free base"
            mover = FreeBase(moving.body, text, np.array(position), quaternion, normal)
            return _touch(bullet, moving, other, mover, lift)
    for moving, other in ((first, second), (second, first)):
        for joint in _sliding_joints(bullet, moving, other):
            return _touch(bullet, moving, other, joint)
    raise UserError(
        "pair",
        f"neither {first.name!r} nor {second.name!r} can be launched: both bases are fixed",
        "a base of mass above 0 that is not fixed, or a prismatic joint towards the other",
    )


def nearest(bullet: BulletClient, first: BodyPart, second: BodyPart) -> Any:
    """PyBullet's closest point of the two; UserError where they have nothing to touch with."""
    points = bullet.getClosestPoints(first.body, second.body, _REACH, first.link, second.link)
    if not points:
        raise UserError(
            "pair",
            f"{first.name!r} and {second.name!r} never touch: one has no collision geometry",
            "a <collision> element on both",
        )
    return min(points, key=lambda point: float(point[DISTANCE]))


def _normal(point: Any) -> Floats:
    """From the first to the second."""
    return -np.array(point[NORMAL], dtype=float)


def _size(bullet: BulletClient, *parts: BodyPart) -> float:
    """The smallest diagonal of bounding boxes, m."""
    boxes = [bullet.getAABB(part.body, max(part.link, -1)) for part in parts]
    return min(float(np.linalg.norm(np.subtract(high, low))) for low, high in boxes)


def _lift(bullet: BulletClient, moving: BodyPart, other: BodyPart) -> float:
    """Raise a body until it is clear of the other; by how much, m."""
    lift, step = 0.0, _size(bullet, moving, other)
    position, quaternion = bullet.getBasePositionAndOrientation(moving.body)
    while float(nearest(bullet, moving, other)[DISTANCE]) <= 0.0 and lift < _REACH:
        lift, step = lift + step, 2 * step
        raised = np.add(position, [0.0, 0.0, lift]).tolist()
        bullet.resetBasePositionAndOrientation(moving.body, raised, quaternion)
    return lift


def _sliding_joints(bullet: BulletClient, moving: BodyPart, other: BodyPart) -> Iterator[SlidingJoint]:
    """Prismatic joints that carry the link that would touch, and bring it nearer; nearest first."""
    body, point = BulletBody(bullet, moving.body), nearest(bullet, moving, other)
    for number in body.ancestors(int(point[3]) if moving.link == ANY_LINK else moving.link):
        joint = body.joints[number]
        if joint[JOINT_TYPE] == PRISMATIC:
            approach = float(np.array(body.joint_axis(number)) @ _normal(point))
            if abs(approach) >= LEAST_APPROACH:
                text = f"{moving.name!r} by its joint {joint[JOINT_NAME].decode(errors='replace')!r}"
                start = bullet.getJointState(moving.body, number)[0]
                yield SlidingJoint(moving.body, text, number, start, approach)


def _touch(
    bullet: BulletClient, moving: BodyPart, other: BodyPart, mover: Mover, lift: float = 0.0
) -> BulletPlacement:
    size, start = _size(bullet, moving, other), float(nearest(bullet, moving, other)[DISTANCE])
    require_apart(start, size, moving.name, other.name)

    def distance(travel: float) -> float:
        mover.put(bullet, travel)
        return float(nearest(bullet, moving, other)[DISTANCE])

    travel = travel_by_distance(distance, size)
    point = nearest(bullet, moving, other)
    normal, middle = _normal(point), (np.array(point[5]) + np.array(point[6])) / 2
    first = BodyPart(moving.name, moving.body, int(point[3]))
    second = BodyPart(other.name, other.body, int(point[4]))
    _require_room(bullet, first, second)
    mass = _effective_mass(bullet, (first.body, first.link), (second.body, second.link), middle, normal)
    return BulletPlacement(first, second, mover, travel, normal, middle, mass, lift, max(0.0, -start))


def _effective_mass(
    bullet: BulletClient, first: tuple[int, int], second: tuple[int, int], point: Floats, normal: Floats
) -> float:
    """1 / (J M^-1 J^T) of two (body, link), kg; NaN where neither can move, or a joint's axis is unknown."""
    bodies = {number: BulletBody(bullet, number) for number, _ in (first, second)}
    one, two = ((bodies[number], link) for number, link in (first, second))
    inverse = contact_row(one, two, vector(point), vector(normal)).inverse_mass
    return 1.0 / inverse if inverse > 0.0 else math.nan


def _require_room(bullet: BulletClient, moving: BodyPart, other: BodyPart) -> None:
    """Refuse a touch at which other parts of what moves would be deep in something."""
    pair = {(moving.body, moving.link), (other.body, other.link)}
    for third in bullet.bodies():
        if third == moving.body:
            continue
        for point in bullet.getClosestPoints(moving.body, third, 0.0):
            ends = [BodyPart("", moving.body, int(point[3])), BodyPart("", third, int(point[4]))]
            if {(end.body, end.link) for end in ends} != pair:
                blocked = f"link {ends[0].link}", "another body"
                depth = -float(point[DISTANCE])
                require_reachable(depth, _size(bullet, *ends), (moving.name, other.name), blocked)
