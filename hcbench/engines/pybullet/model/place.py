"""Pose in which a pair in PyBullet just touches, and the mover that launches it from there."""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.engines.pybullet.model.bodies import (
    FIXED,
    JOINT_NAME,
    JOINT_TYPE,
    LINK_NAME,
    PRISMATIC,
    REVOLUTE,
    BulletBody,
    FreeBase,
    Mover,
    SlidingJoint,
    SwingingLink,
    contact_row,
)
from hcbench.engines.pybullet.model.open import ANY_LINK, BodyPart, LoadedWorld
from hcbench.engines.pybullet.model.start_pose import require_joints_within_limits
from hcbench.engines.pybullet.vectors import vector
from hcbench.sim.model_under_test import Vector
from hcbench.sim.touch import LEAST_APPROACH, require_apart, require_reachable, travel_by_distance
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats

ABOVE: Vector = (0.0, 0.0, 1.0)
LEAST_MOBILITY = 1e-9  # 1/kg
_BOUND = 1e3  # m: the part of an endless plane that counts
_REACH = 1e4  # m: the largest distance between the two at the start
_BASE_FREEDOMS = 6
_ROUNDS, _STRIDE = 300, 0.02  # m: of a way along an arc, in each round
_CLOSE = 1e-7  # m: Bullet's distances are no better
# Of the smaller one's size: so far apart at the end of a way, two have passed each other
_MISSED = 1e-3
# In PyBullet's closest points; the normal points at the first body
DISTANCE, NORMAL = 8, 7


@dataclass(frozen=True, slots=True)
class BulletPlacement:
    """Start of the launches: the two touch once `mover` has travelled `travel` m.

    first, second: the links that touch, the moving body first. normal: unit vector from the first to the
    second. point: where they touch, m. effective_mass: along the normal, kg. overlap: of the two at
    the start, m. note: how they were brought together, where that was a choice.
    """

    first: BodyPart
    second: BodyPart
    mover: Mover
    travel: float
    normal: Floats
    point: Floats
    effective_mass: float
    overlap: float
    note: str = ""

    def launch(self, bullet: BulletClient, speed: float, clearance: float) -> None:
        """Put the moving body `clearance` m before the touch, at `speed` m/s."""
        self.mover.put(bullet, self.travel - clearance, speed)


def place(
    world: LoadedWorld,
    first: BodyPart,
    second: BodyPart,
    coming_from: Vector | None = None,
    move: str | None = None,
) -> BulletPlacement:
    """Bring the two just to touch. Raises UserError with the reason where that cannot be done.

    coming_from: where the first comes from, a unit vector away from the second; None: the nearest way. In a
        world made of files all stand at the origin: the first body then approaches from above.
    move: what is launched, as a request has it; None: a free base, else a joint, else several.
    """
    bullet = world.bullet
    for part in (first, second):
        require_joints_within_limits(bullet, part.body)
    note = ""
    if coming_from is None and len(world.files) > 1 and first.body != second.body:
        coming_from = ABOVE
        note = "Files stand at the origin: the first body approaches from above; --from chooses."
    if move is not None and move != "base:":
        return _chosen(bullet, first, second, move)
    for moving, other, sign in ((first, second, 1.0), (second, first, -1.0)):
        if BulletBody(bullet, moving.body).mass > 0.0 and moving.body != other.body:
            text = f"{moving.name!r} by its free base"
            position, quaternion = bullet.getBasePositionAndOrientation(moving.body)
            if coming_from is None:
                direction = _normal(nearest(bullet, moving, other))
            else:
                direction = -sign * np.array(coming_from)
                position = _clear_start(bullet, moving, other, direction, np.array(position))
            mover = FreeBase(moving.body, text, np.array(position), quaternion, direction)
            return _touch(bullet, moving, other, mover, note)
    if move is None and (coming_from is None or note):
        for moving, other in ((first, second), (second, first)):
            for joint in _sliding_joints(bullet, moving, other):
                return _touch(bullet, moving, other, joint)
            if (swinging := swing_to_touch(bullet, moving, other)) is not None:
                return _touch(bullet, moving, other, swinging)
    raise UserError(
        "pair",
        f"neither {first.name!r} nor {second.name!r} can be launched: both bases are fixed, and no joint "
        "brings one to the other",
        "a base of mass above 0 that is not fixed, or a joint towards the other",
        "Start from another --qpos",
    )


def _chosen(bullet: BulletClient, first: BodyPart, second: BodyPart, move: str) -> BulletPlacement:
    """Launch by the joint that `move` names, or the joints of that link and of those up to the touch."""
    kind, _, name = move.partition(":")
    place_of = JOINT_NAME if kind == "joint" else LINK_NAME
    for moving, other in ((first, second), (second, first)):
        body, point = BulletBody(bullet, moving.body), nearest(bullet, moving, other)
        chain = body.ancestors(int(point[3]) if moving.link == ANY_LINK else moving.link)
        names = [body.joints[j][place_of].decode(errors="replace") for j in chain]
        if name not in names:
            continue
        at = names.index(name)
        chosen = chain[at : at + 1] if kind == "joint" else chain[: at + 1]
        for sliding in _sliding_joints(bullet, moving, other):
            if [sliding.joint] == [j for j in chosen if body.joints[j][JOINT_TYPE] != FIXED]:
                return _touch(bullet, moving, other, sliding)
        if (swinging := swing_to_touch(bullet, moving, other, set(chosen))) is not None:
            return _touch(bullet, moving, other, swinging)
    parts = f"{first.name!r} nor {second.name!r}"
    raise UserError("move", f"{move!r} moves neither {parts}", "base:, or a joint or link that carries one")


def _clear_start(
    bullet: BulletClient, moving: BodyPart, other: BodyPart, direction: Floats, position: Floats
) -> Floats:
    """Position from which a body comes along `direction`: clear of the other, over it if it must."""
    boxes = [_bounds(bullet, part) for part in (moving, other)]
    (low, high), (low2, high2) = boxes
    across = np.abs(direction) < 0.5
    if ((low > high2) | (high < low2))[across].any():
        shift = ((low2 + high2) - (low + high)) / 2
        position = position + shift - direction * float(direction @ shift)
    behind = max(float(direction @ (a - b)) for a in (low, high) for b in (low2, high2))
    size = float(np.linalg.norm(high - low))
    return position - direction * (min(max(behind, 0.0), _REACH) + 0.1 * size)


def _bounds(bullet: BulletClient, part: BodyPart) -> tuple[Floats, Floats]:
    """The box around a part, within reach."""
    links = range(-1, bullet.getNumJoints(part.body)) if part.link == ANY_LINK else [part.link]
    boxes = np.array([bullet.getAABB(part.body, link) for link in links])
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    return np.maximum(low, -_BOUND), np.minimum(high, _BOUND)


def swing_to_touch(
    bullet: BulletClient, moving: BodyPart, other: BodyPart, chosen: Collection[int] | None = None
) -> SwingingLink | None:
    """Bring a link of a robot to the other by its joints, or by those chosen, with its base at rest; None
    where they do not lead there.
    """
    body = BulletBody(bullet, moving.body)
    if body.kind != "jointed":
        return None
    kinds = [joint[JOINT_TYPE] for joint in body.joints]
    scalar = [j for j, kind in enumerate(kinds) if kind in (REVOLUTE, PRISMATIC)]
    if any(kind not in (REVOLUTE, PRISMATIC, FIXED) for kind in kinds):
        return None
    for _ in range(_ROUNDS):
        body.refresh()
        point = nearest(bullet, moving, other)
        distance, normal = float(point[DISTANCE]), vector(_normal(point))
        response = body.response(int(point[3]), vector(np.array(point[5])), normal)
        if response is None:
            return None
        rows = zip(scalar, *(part[_BASE_FREEDOMS * (body.mass > 0.0) :] for part in response), strict=True)
        along = {j: (reach, rate) for j, reach, rate in rows if chosen is None or j in chosen}
        mobility = sum(reach * rate for reach, rate in along.values())
        if mobility <= LEAST_MOBILITY:
            return None
        rates = {j: float(rate) / mobility for j, (_, rate) in along.items()}
        starts = {j: float(bullet.getJointState(moving.body, j)[0]) for j in along}
        shown = [j for j in body.ancestors(int(point[3])) if j in along or chosen is None]
        names = [body.joints[j][JOINT_NAME].decode(errors="replace") for j in shown]
        text = f"{moving.name!r} by its joints ({', '.join(names[:6])})"
        if abs(distance) < _CLOSE:
            return SwingingLink(moving.body, text, starts, rates)
        step = float(np.clip(distance, -_STRIDE, _STRIDE))
        for j in along:
            low, high = body.joints[j][8:10]
            target = starts[j] + rates[j] * step
            bounded = min(max(target, min(low, starts[j])), max(high, starts[j])) if low < high else target
            bullet.resetJointState(moving.body, j, bounded)
    return None


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
    """Unit normal of a contact point, from the first body to the second."""
    return -np.array(point[NORMAL], dtype=float)


def _size(bullet: BulletClient, *parts: BodyPart) -> float:
    """The smallest diagonal of bounding boxes, m."""
    boxes = [bullet.getAABB(part.body, max(part.link, -1)) for part in parts]
    return min(float(np.linalg.norm(np.subtract(high, low))) for low, high in boxes)


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
    bullet: BulletClient, moving: BodyPart, other: BodyPart, mover: Mover, note: str = ""
) -> BulletPlacement:
    mover.put(bullet, 0.0)
    size, start = _size(bullet, moving, other), float(nearest(bullet, moving, other)[DISTANCE])
    require_apart(start, size, moving.name, other.name)

    def distance(travel: float) -> float:
        mover.put(bullet, travel)
        return float(nearest(bullet, moving, other)[DISTANCE])

    travel = travel_by_distance(distance, size)
    if distance(travel) > _MISSED * size:
        raise UserError(
            "pair",
            f"{moving.name!r} passes {other.name!r} {distance(travel):.3g} m away",
            "a direction from which they meet",
            "Give one by --from, or a pose by --qpos",
        )
    point = nearest(bullet, moving, other)
    normal, middle = _normal(point), (np.array(point[5]) + np.array(point[6])) / 2
    first = BodyPart(moving.name, moving.body, int(point[3]))
    second = BodyPart(other.name, other.body, int(point[4]))
    _require_room(bullet, first, second)
    mass = _effective_mass(bullet, (first.body, first.link), (second.body, second.link), middle, normal)
    overlap = 0.0 if note else max(0.0, -start)
    return BulletPlacement(first, second, mover, travel, normal, middle, mass, overlap, note)


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
