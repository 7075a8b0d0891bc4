"""Pose in which a pair in PyBullet just touches, and the mover that launches it from there."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hcbench.engines.pybullet.backend import (
    DISTANCE,
    LINK_A,
    LINK_B,
    NORMAL,
    POINT_A,
    POINT_B,
    BulletClient,
)
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
    bounding_boxes,
    contact_row,
    cross,
    rotate,
    vector,
)
from hcbench.engines.pybullet.model.in_child import run_aside
from hcbench.engines.pybullet.model.open import (
    ANY_LINK,
    BodyPart,
    LoadedWorld,
    require_joints_within_limits,
)
from hcbench.sim.model_under_test import Vector
from hcbench.sim.touch import LEAST_APPROACH, require_apart, require_reachable, travel_by_distance
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats

# Nearest points of two parts of a PyBullet world, and the face on which they meet.

# Largest distance between the two at the start, m.
REACH = 1e4
# A body tilted by this angle, rad, stands on the edge of its face; on a round surface the nearest
# point moves by its radius times the angle.
_TILT = 1e-3
# Directions of tilting: those of a square's corners, and those between.
_DIRECTIONS = 8
# Nearest points that move by a larger share of the smaller part's size belong to a face or an edge.
_FLAT = 0.02
# Overlap at which the contacts of a face are counted, m.
_PRESSED = 1e-6
_ORIGIN = (0.0, 0.0, 0.0)


def nearest(bullet: BulletClient, first: BodyPart, second: BodyPart) -> Any:
    """PyBullet's closest point of two parts, a tuple as getClosestPoints returns it.

    first, second: the two, each a link of a body or all of it.
    Raises UserError where one has no collision geometry.
    """
    points = bullet.getClosestPoints(first.body, second.body, REACH, first.link, second.link)
    if not points:
        raise UserError(
            "pair",
            f"{first.name!r} and {second.name!r} never touch: one has no collision geometry",
            "a <collision> element on both",
        )
    return min(points, key=lambda point: float(point[DISTANCE]))


def normal_of(point: Any) -> Floats:
    """Unit normal of a contact point, from the first body to the second."""
    return -np.array(point[NORMAL], dtype=float)


def middle_of(point: Any) -> Floats:
    """Point halfway between the two surfaces, m."""
    return np.asarray(0.5 * (np.array(point[POINT_A]) + np.array(point[POINT_B])))


@dataclass(frozen=True, slots=True)
class Face:
    """A face or an edge on which two parts meet.

    middle: m.
    points: how many contacts Bullet has there.
    """

    middle: Floats
    points: int


def find_face(bullet: BulletClient, moving: BodyPart, other: BodyPart, size: float) -> Face | None:
    """The face or edge on which two parts meet; None where they meet at a point.

    Bullet returns one point of a face, any of it. The moving body is therefore tilted about that
    point, a little in each direction: its nearest points then lie around the face. That moves the
    body, so callers run it in a copy, by `run_aside`.

    moving: stands where it touches the other.
    size: of the smaller part, m.
    """
    touching = nearest(bullet, moving, other)
    # m and unit vector, (3,) each.
    point = middle_of(touching)
    normal = normal_of(touching)
    position, quaternion = bullet.getBasePositionAndOrientation(moving.body)
    # Clear of the other at every tilt, where Bullet's distances are exact.
    arm = np.array(position) - point - _TILT * size * normal
    # Nearest points of the tilted body, m.
    rim = []
    for axis in _across(normal):
        tilt = [*(math.sin(0.5 * _TILT) * axis), math.cos(0.5 * _TILT)]
        _, tilted = bullet.multiplyTransforms(_ORIGIN, tilt, _ORIGIN, quaternion)
        start = point + np.array(rotate(tilt, vector(arm)))
        bullet.resetBasePositionAndOrientation(moving.body, start.tolist(), tilted)
        rim.append(middle_of(nearest(bullet, moving, other)))
    # From the first point to these, along the face, m, (_DIRECTIONS, 3).
    across = np.array(rim) - point
    across -= np.outer(across @ normal, normal)
    middle = across.mean(axis=0)
    if np.linalg.norm(across - middle, axis=1).max() < _FLAT * size:
        return None
    # How many contacts Bullet has there shows when the two overlap a little.
    pressed = np.array(position) + _PRESSED * normal
    bullet.resetBasePositionAndOrientation(moving.body, pressed.tolist(), quaternion)
    bullet.performCollisionDetection()
    contacts = bullet.getContactPoints(moving.body, other.body, moving.link, other.link)
    return Face(point + middle, len(contacts))


def _across(normal: Floats) -> list[Floats]:
    """Unit vectors, (3,) each, at right angles to a unit normal, _DIRECTIONS of them evenly around
    it.
    """
    # The axis of the world that is farthest from the normal.
    least = np.zeros(3)
    least[np.argmin(np.abs(normal))] = 1.0
    one = np.array(cross(vector(normal), vector(least)))
    one /= np.linalg.norm(one)
    other = np.array(cross(vector(normal), vector(one)))
    angles = [2.0 * math.pi * k / _DIRECTIONS for k in range(_DIRECTIONS)]
    return [math.cos(angle) * one + math.sin(angle) * other for angle in angles]


# Where a body comes from that meets the other from above, a unit vector away from the other.
ABOVE: Vector = (0.0, 0.0, 1.0)
LEAST_MOBILITY = 1e-9  # 1/kg
# Part of an endless plane that counts, m.
_BOUND = 1e3
# Degrees of freedom of a free base, which come before those of the joints.
_BASE_FREEDOMS = 6
# Places in getJointInfo.
_LOWER = 8
_UPPER = 9
# Most rounds of a way along an arc.
_ROUNDS = 300
# Length of a round of a way along an arc, m.
_STRIDE = 0.02
# Distance that counts as touching, m: Bullet's own are no better.
_CLOSE = 1e-7
# So far apart at the end of a way, in sizes of the smaller one, two have passed each other.
_MISSED = 1e-3


@dataclass(frozen=True, slots=True)
class BulletPlacement:
    """Start of the launches: the two touch once `mover` has travelled `travel` m.

    first, second: the links that touch, the moving body first.
    normal: unit vector from the first to the second.
    point: where they touch, m.
    effective_mass: along the normal, kg.
    overlap: of the two at the start, m.
    face: on which they meet, its middle is then `point`; None for a point.
    note: how they were brought together, where that was a choice.
    """

    first: BodyPart
    second: BodyPart
    mover: Mover
    travel: float
    normal: Floats
    point: Floats
    effective_mass: float
    overlap: float
    face: Face | None
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
    """Bring two parts of a world just to touch, and return from where and by what they are launched.

    It leaves the bodies where it moved them, also where it raises: call it by `run_aside`.

    coming_from: where the first comes from, a unit vector away from the second; None: the nearest
    way. It acts on free bases alone: given, no joint is tried. Bodies of several files all stand at
    the origin: there None means from above.
    move: what is launched: "base:", "joint:NAME" or "body:NAME" of a link; None: a free base, else
    a sliding joint, else several joints.

    Raises UserError where nothing can bring them together and for `coming_from` with a joint or
    link to move, SceneError where the two start deep in each other.
    """
    bullet = world.bullet
    by_joints = None if move == "base:" else move
    if by_joints is not None and coming_from is not None:
        raise UserError(
            "from",
            f"given with --move {by_joints!r}",
            "one of the two: joints have a way of their own",
        )
    for part in (first, second):
        require_joints_within_limits(bullet, part.body)
    note = ""
    if coming_from is None and len(world.files) > 1 and first.body != second.body:
        coming_from = ABOVE
        note = "Files stand at the origin: the first body approaches from above; --from chooses."
    if by_joints is not None:
        return _chosen(bullet, first, second, by_joints)
    # The first by its free base, else the second.
    for moving, other, sign in ((first, second, 1.0), (second, first, -1.0)):
        if BulletBody(bullet, moving.body).mass > 0.0 and moving.body != other.body:
            way = None
            if coming_from is not None:
                way = -sign * np.array(coming_from)
            mover = _free_base(bullet, moving, other, way)
            return _touch(bullet, moving, other, mover, note)
    # Joints bring a link along a way of their own: a direction that the user chose rules them out.
    if move is None and (coming_from is None or note):
        for moving, other in ((first, second), (second, first)):
            for joint in _sliding_joints(bullet, moving, other):
                return _touch(bullet, moving, other, joint)
            swinging = swing_to_touch(bullet, moving, other)
            if swinging is not None:
                return _touch(bullet, moving, other, swinging)
    raise UserError(
        "pair",
        f"neither {first.name!r} nor {second.name!r} can be launched: both bases are fixed, and no joint "
        "brings one to the other",
        "a base of mass above 0 that is not fixed, or a joint towards the other",
        "Start from another --qpos",
    )


def _free_base(
    bullet: BulletClient, moving: BodyPart, other: BodyPart, way: Floats | None
) -> FreeBase:
    """The mover that carries a body with a free base to another, as `FreeBase`.

    moving, other: the two parts, that which moves first.
    way: unit vector, (3,), of its motion, on which it starts clear of the other; None: the nearest
    way from where it stands.
    """
    position, quaternion = bullet.getBasePositionAndOrientation(moving.body)
    start = np.array(position)
    if way is None:
        way = normal_of(nearest(bullet, moving, other))
    else:
        start = _clear_start(bullet, moving, other, way, start)
    return FreeBase(moving.body, f"{moving.name!r} by its free base", start, quaternion, way)


def _chosen(bullet: BulletClient, first: BodyPart, second: BodyPart, move: str) -> BulletPlacement:
    """Bring two parts to touch by joints that the user chose.

    first, second: the two parts, in either order.
    move: "joint:NAME": that joint alone moves; "body:NAME": the joint of that link, and those
    between it and the link that touches.

    Raises UserError where it carries neither of the two or does not bring them together, SceneError
    where they start deep in each other.
    """
    kind, _, name = move.partition(":")
    place_of_name = LINK_NAME
    if kind == "joint":
        place_of_name = JOINT_NAME
    for moving, other in ((first, second), (second, first)):
        body = BulletBody(bullet, moving.body)
        point = nearest(bullet, moving, other)
        # Joints from the link that touches towards the base, each with the number of its link.
        carriers = body.ancestors(_touching_link(moving, point))
        names = [body.joints[j][place_of_name].decode(errors="replace") for j in carriers]
        if name not in names:
            continue
        at = names.index(name)
        if kind == "joint":
            chosen = [carriers[at]]
        else:
            chosen = carriers[: at + 1]
        free_to_move = [j for j in chosen if body.joints[j][JOINT_TYPE] != FIXED]
        for sliding in _sliding_joints(bullet, moving, other):
            if free_to_move == [sliding.joint]:
                return _touch(bullet, moving, other, sliding)
        swinging = swing_to_touch(bullet, moving, other, set(chosen))
        if swinging is not None:
            return _touch(bullet, moving, other, swinging)
    parts = f"{first.name!r} nor {second.name!r}"
    raise UserError(
        "move", f"{move!r} moves neither {parts}", "base:, or a joint or link that carries one"
    )


def _touching_link(moving: BodyPart, point: Any) -> int:
    """Number of the moving body's link that meets the other: the one asked for, else that of the
    nearest point, which PyBullet returned.
    """
    if moving.link == ANY_LINK:
        return int(point[LINK_A])
    return moving.link


def _clear_start(
    bullet: BulletClient, moving: BodyPart, other: BodyPart, direction: Floats, position: Floats
) -> Floats:
    """Position of a body's base, m, (3,), from which it comes along `direction`, clear of the other.

    The boxes around the two decide. Where they would pass by each other, the body is also moved
    across the way, until their centres are in line.

    moving, other: the two parts, that which moves first.
    direction: unit vector, (3,), towards the other.
    position: of the base now, m, (3,).
    """
    low, high = _bounds(bullet, moving)
    other_low, other_high = _bounds(bullet, other)
    # Axes along which the body does not come.
    across = np.abs(direction) < 0.5
    passes_by = (low > other_high) | (high < other_low)
    if passes_by[across].any():
        # From centre to centre, but only across the way.
        shift = ((other_low + other_high) - (low + high)) / 2
        position = position + shift - direction * float(direction @ shift)
    # Way back, m, until no corner of the one is past a corner of the other.
    behind = 0.0
    for corner in (low, high):
        for other_corner in (other_low, other_high):
            behind = max(behind, float(direction @ (corner - other_corner)))
    size = float(np.linalg.norm(high - low))
    return position - direction * (min(behind, REACH) + 0.1 * size)


def _bounds(bullet: BulletClient, part: BodyPart) -> tuple[Floats, Floats]:
    """Lowest and highest corner of the box around a part, m, (3,) each, in the world; cut at _BOUND
    m each way, as a plane has no end.
    """
    if part.link == ANY_LINK:
        boxes = bounding_boxes(bullet, part.body)
    else:
        boxes = np.array([bullet.getAABB(part.body, part.link)])
    low = boxes[:, 0].min(axis=0)
    high = boxes[:, 1].max(axis=0)
    return np.maximum(low, -_BOUND), np.minimum(high, _BOUND)


def swing_to_touch(
    bullet: BulletClient, moving: BodyPart, other: BodyPart, chosen: Collection[int] | None = None
) -> SwingingLink | None:
    """Bring a link of a robot to another part by the robot's joints, with its base at rest.

    Returns the mover that swings it there, and leaves the world at touch; None, with the joints back
    where they were, where they do not lead there, and for a robot with spherical or planar joints.

    moving, other: the two parts, that which moves first.
    chosen: numbers of the joints that may move; None: all.
    Raises UserError where one of the two has no collision geometry.
    """
    body = BulletBody(bullet, moving.body)
    if body.kind != "jointed":
        return None
    kinds = [joint[JOINT_TYPE] for joint in body.joints]
    if any(kind not in (REVOLUTE, PRISMATIC, FIXED) for kind in kinds):
        return None
    before = [bullet.getJointState(moving.body, j)[:2] for j in range(len(kinds))]
    swinging = _swung_to_touch(bullet, body, moving, other, chosen)
    if swinging is None:
        # The next try starts from the same pose.
        for j, (position, velocity) in enumerate(before):
            bullet.resetJointState(moving.body, j, position, velocity)
    return swinging


def _swung_to_touch(
    bullet: BulletClient,
    body: BulletBody,
    moving: BodyPart,
    other: BodyPart,
    chosen: Collection[int] | None,
) -> SwingingLink | None:
    """Return what `swing_to_touch` does; where that is None the joints stay where they came to.

    body: that of `moving`; its joints turn or slide.
    """
    # Small steps towards the nearest point, which moves along with the joints.
    for _ in range(_ROUNDS):
        body.refresh()
        point = nearest(bullet, moving, other)
        distance = float(point[DISTANCE])
        rates = _rates_towards(body, point, chosen)
        if rates is None:
            return None
        starts = {j: float(bullet.getJointState(moving.body, j)[0]) for j in rates}
        if abs(distance) < _CLOSE:
            shown = body.ancestors(int(point[LINK_A]))
            if chosen is not None:
                shown = [j for j in shown if j in rates]
            names = [body.joints[j][JOINT_NAME].decode(errors="replace") for j in shown]
            text = f"{moving.name!r} by its joints ({', '.join(names[:6])})"
            return SwingingLink(moving.body, text, starts, rates)
        step = float(np.clip(distance, -_STRIDE, _STRIDE))
        for j, start in starts.items():
            target = _within_limits(body.joints[j], start, start + rates[j] * step)
            bullet.resetJointState(moving.body, j, target)
    return None


def _rates_towards(
    body: BulletBody, point: Any, chosen: Collection[int] | None
) -> dict[int, float] | None:
    """Rates of joints, as after a push at a body's nearest point, at which that point approaches the
    other body at 1 m/s: joint -> rad/s or m/s; None where the joints cannot move it that way.

    point: the closest point of the two, as PyBullet returns it.
    chosen: numbers of the joints that may move; None: all.
    """
    link = int(point[LINK_A])
    normal = vector(normal_of(point))
    response = body.response(link, vector(np.array(point[POINT_A])), normal)
    if response is None:
        return None
    first_joint = 0
    # The first degrees of freedom are those of a free base.
    if body.mass > 0.0:
        first_joint = _BASE_FREEDOMS
    # By joint: its row of the Jacobian, m/rad or 1, and its acceleration by a push of 1 N.
    reaches, accelerations = (part[first_joint:] for part in response)
    moved = [j for j, joint in enumerate(body.joints) if joint[JOINT_TYPE] != FIXED]
    mobility = 0.0  # 1/kg
    by_joint = {}
    for j, reach, acceleration in zip(moved, reaches, accelerations, strict=True):
        if chosen is None or j in chosen:
            mobility += reach * acceleration
            by_joint[j] = float(acceleration)
    if mobility <= LEAST_MOBILITY:
        return None
    return {j: acceleration / mobility for j, acceleration in by_joint.items()}


def _within_limits(joint: Any, start: float, target: float) -> float:
    """Position of a joint, brought into its limits; one that starts beyond a limit may stay there.

    joint: as getJointInfo returns it.
    start, target: where it is and where it is to go, rad or m.
    """
    low = joint[_LOWER]
    high = joint[_UPPER]
    if low < high:
        return float(min(max(target, min(low, start)), max(high, start)))
    # With a lower limit that is not below the upper one PyBullet says that there is none.
    return target


def _size(bullet: BulletClient, *parts: BodyPart) -> float:
    """The shortest diagonal of the parts' bounding boxes, m."""
    boxes = [bullet.getAABB(part.body, max(part.link, -1)) for part in parts]
    return min(float(np.linalg.norm(np.subtract(high, low))) for low, high in boxes)


def _sliding_joints(
    bullet: BulletClient, moving: BodyPart, other: BodyPart
) -> Iterator[SlidingJoint]:
    """Movers by one sliding joint each, of those that carry the link that would touch and bring it
    nearer to the other; the joint nearest to that link first.

    Raises UserError where one of the two has no collision geometry.
    """
    body = BulletBody(bullet, moving.body)
    point = nearest(bullet, moving, other)
    for number in body.ancestors(_touching_link(moving, point)):
        joint = body.joints[number]
        if joint[JOINT_TYPE] != PRISMATIC:
            continue
        # Share of the joint's motion that goes towards the other part.
        approach = float(np.array(body.joint_axis(number)) @ normal_of(point))
        if abs(approach) >= LEAST_APPROACH:
            name = joint[JOINT_NAME].decode(errors="replace")
            text = f"{moving.name!r} by its joint {name!r}"
            start = bullet.getJointState(moving.body, number)[0]
            yield SlidingJoint(moving.body, text, number, start, approach)


def _touch(
    bullet: BulletClient, moving: BodyPart, other: BodyPart, mover: Mover, note: str = ""
) -> BulletPlacement:
    """Move a part by its mover until the two just touch, and return where that is.

    moving, other: the two parts, that which moves first.
    mover: of the first.
    note: how the mover was chosen, "" where it was not a choice.
    With a note, the bodies' files all stand at the origin: that they overlap there says nothing,
    and the result has an overlap of 0.

    Raises SceneError where they start deep in each other, UserError where they pass each other or
    another part is in the way, EngineFailed where PyBullet dies while it looks for a face.
    """
    mover.put(bullet, 0.0)
    size = _size(bullet, moving, other)
    start = float(nearest(bullet, moving, other)[DISTANCE])
    require_apart(start, size, moving.name, other.name)

    def distance(travel: float) -> float:
        """Distance of the two, m, with the mover `travel` m from its start."""
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
    normal = normal_of(point)
    first = replace(moving, link=int(point[LINK_A]))
    second = replace(other, link=int(point[LINK_B]))
    _require_room(bullet, first, second)
    face = None
    # Two links of one body tilt together.
    if moving.body != other.body:
        face = run_aside(bullet, lambda: find_face(bullet, first, second, size))
    middle = middle_of(point) if face is None else face.middle
    overlap = 0.0
    # Files that all stand at the origin overlap there, which says nothing.
    if not note:
        overlap = max(0.0, -start)
    return BulletPlacement(
        first=first,
        second=second,
        mover=mover,
        travel=travel,
        normal=normal,
        point=middle,
        effective_mass=_effective_mass(bullet, first, second, middle, normal),
        overlap=overlap,
        face=face,
        note=note,
    )


def _effective_mass(
    bullet: BulletClient, first: BodyPart, second: BodyPart, point: Floats, normal: Floats
) -> float:
    """Effective mass of two links along a contact's normal, 1 / (J M^-1 J^T), kg, in the world's
    present pose; NaN where neither can move, or the axis of a joint is unknown.

    first, second: the two links.
    point: of the contact, m, (3,).
    normal: unit vector, (3,).
    """
    # The two links of one body share it, as its response to both forces counts.
    bodies = {number: BulletBody(bullet, number) for number in (first.body, second.body)}
    row = contact_row(
        (bodies[first.body], first.link),
        (bodies[second.body], second.link),
        vector(point),
        vector(normal),
    )
    inverse = row.inverse_mass
    if inverse > 0.0:
        return 1.0 / inverse
    return math.nan


def _require_room(bullet: BulletClient, moving: BodyPart, other: BodyPart) -> None:
    """Refuse a pose in which links of the moving body, other than the one that touches, are deep in
    another body, by UserError.

    moving, other: the two links that touch in the world's present pose.
    """
    pair = {(moving.body, moving.link), (other.body, other.link)}
    for third in bullet.bodies():
        if third == moving.body:
            continue
        for point in bullet.getClosestPoints(moving.body, third, 0.0):
            moved = BodyPart("", moving.body, int(point[LINK_A]))
            in_way = BodyPart("", third, int(point[LINK_B]))
            if {(moved.body, moved.link), (in_way.body, in_way.link)} == pair:
                continue
            blocked = f"link {moved.link}", "another body"
            depth = -float(point[DISTANCE])
            size = _size(bullet, moved, in_way)
            require_reachable(depth, size, (moving.name, other.name), blocked)
