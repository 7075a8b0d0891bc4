"""PyBullet: the configuration in which a pair just touches, what moves there, and how."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.pybullet.user_model import Bullet, Loaded, Side, prismatic_above
from hcbench.errors import UserError
from hcbench.sim.touch import LEAST_APPROACH, require_apart, require_reachable, travel_by_distance

if TYPE_CHECKING:
    from hcbench.impact import Floats

_REACH = 1e4  # m: how far apart two may be found


@dataclass(frozen=True, slots=True)
class Mover:
    """What moves: a free base (joint None), or a prismatic joint with its axis in world coordinates."""

    body: int
    joint: int | None
    direction: Floats  # unit vector of the velocity that approaches
    words: str
    sign: float = 1.0  # of the joint's velocity that approaches


@dataclass(frozen=True, slots=True)
class Placement:
    """Where launches start from. links: of the two, those that touch. offset: how far the mover is moved from
    the world's own start, m along `mover.direction`. normal: from the first to the second. rate: approach
    speed for a speed of 1 m/s of the mover. overlap: of the two at the start, m.
    """

    first: Side
    second: Side
    mover: Mover
    lift: float
    offset: float
    normal: Floats
    point: Floats
    rate: float
    effective_mass: float
    overlap: float


def nearest(bullet: Bullet, first: Side, second: Side) -> Any:
    """PyBullet's closest point of the two; UserError where they have nothing to touch with."""
    links = {}
    if first.link is not None:
        links["linkIndexA"] = first.link
    if second.link is not None:
        links["linkIndexB"] = second.link
    points = bullet.getClosestPoints(first.body, second.body, _REACH, **links)
    if not points:
        raise UserError(
            "pair",
            f"{first.name!r} and {second.name!r} never touch: one has no collision geometry",
            "a <collision> element on both",
        )
    return min(points, key=lambda point: float(point[8]))


def place(loaded: Loaded, first: Side, second: Side) -> Placement:
    """Bring the two just to touch. Raises UserError with the reason where that cannot be done.

    In a world made of files both stand at the origin: the moving one is then raised above the other first.
    """
    bullet = loaded.bullet
    nearest(bullet, first, second)
    for moving, other in ((first, second), (second, first)):
        if _base_moves(bullet, moving):
            return _by_base(loaded, moving, other)
    for moving, other in ((first, second), (second, first)):
        link = _touching_link(bullet, moving, other)
        for joint in prismatic_above(bullet, moving.body, link):
            found = _by_joint(bullet, moving, other, joint)
            if found is not None:
                return found
    raise UserError(
        "pair",
        f"neither {first.name!r} nor {second.name!r} can be launched: both bases are fixed",
        "a base of mass above 0 that is not fixed, or a prismatic joint towards the other",
    )


def _base_moves(bullet: Bullet, side: Side) -> bool:
    return float(bullet.getDynamicsInfo(side.body, -1)[0]) > 0.0 and not _is_static(bullet, side.body)


def _is_static(bullet: Bullet, body: int) -> bool:
    """Whether the base is held: a velocity given to it does not stay."""
    before = bullet.getBaseVelocity(body)
    bullet.resetBaseVelocity(body, [0.0, 0.0, 1.0], [0.0, 0.0, 0.0])
    held = bool(bullet.getBaseVelocity(body)[0][2] == 0.0)
    bullet.resetBaseVelocity(body, *before)
    return held


def moves(bullet: Bullet, side: Side) -> bool:
    """Whether anything can move the side's link."""
    return bool(bullet.getNumJoints(side.body)) or _base_moves(bullet, side)


def _touching_link(bullet: Bullet, side: Side, other: Side) -> int:
    if side.link is not None:
        return side.link
    return int(nearest(bullet, side, other)[3])


def _normal(point: Any) -> Floats:
    """From the first to the second; PyBullet's points at the first from the second."""
    return -np.array(point[7], dtype=float)


def _size(bullet: Bullet, side: Side) -> float:
    low, high = bullet.getAABB(side.body, -1 if side.link is None else side.link)
    return float(np.linalg.norm(np.subtract(high, low)))


def shift_base(bullet: Bullet, body: int, move: Floats) -> None:
    """Move a body by its base."""
    position, turn = bullet.getBasePositionAndOrientation(body)
    bullet.resetBasePositionAndOrientation(body, np.add(position, move).tolist(), turn)


def _by_base(loaded: Loaded, first: Side, second: Side) -> Placement:
    bullet = loaded.bullet
    point = nearest(bullet, first, second)
    size = min(_size(bullet, first), _size(bullet, second))
    overlap, lift = max(0.0, -float(point[8])), 0.0
    if loaded.names:
        step = size
        while float(point[8]) <= 0.0 and lift < _REACH:
            shift_base(bullet, first.body, np.array([0.0, 0.0, step]))
            lift, step = lift + step, 2 * step
            point = nearest(bullet, first, second)
        overlap = 0.0
    require_apart(min(-overlap, float(point[8])), size, first.name, second.name)
    direction = _normal(point)
    mover = Mover(first.body, None, direction, f"{first.name!r} by its free base")
    start = np.array(bullet.getBasePositionAndOrientation(first.body)[0])

    def distance(travel: float) -> float:
        _, turn = bullet.getBasePositionAndOrientation(first.body)
        bullet.resetBasePositionAndOrientation(first.body, (start + travel * direction).tolist(), turn)
        return float(nearest(bullet, first, second)[8])

    offset = travel_by_distance(distance, size)
    point = nearest(bullet, first, second)
    return _finished(bullet, first, second, mover, point, lift, offset, overlap, 1.0)


def _by_joint(bullet: Bullet, first: Side, second: Side, joint: int) -> Placement | None:
    axis = _world_axis(bullet, first.body, joint)
    point = nearest(bullet, first, second)
    along = float(axis @ _normal(point))
    if abs(along) < LEAST_APPROACH:
        return None
    start = bullet.getJointState(first.body, joint)[0]
    size = min(_size(bullet, first), _size(bullet, second))
    overlap = max(0.0, -float(point[8]))
    require_apart(-overlap, size, first.name, second.name)

    def distance(travel: float) -> float:
        bullet.resetJointState(first.body, joint, start + travel, 0.0)
        return float(nearest(bullet, first, second)[8])

    offset = travel_by_distance(distance, size, along)
    point = nearest(bullet, first, second)
    name = bullet.getJointInfo(first.body, joint)[1].decode(errors="replace")
    sign = math.copysign(1.0, along)
    mover = Mover(first.body, joint, axis * sign, f"{first.name!r} by its joint {name!r}", sign)
    return _finished(bullet, first, second, mover, point, 0.0, offset, overlap, abs(along))


def _world_axis(bullet: Bullet, body: int, joint: int) -> Floats:
    info = bullet.getJointInfo(body, joint)
    turn = bullet.getLinkState(body, joint, computeForwardKinematics=1)[5]
    matrix = np.array(bullet.module.getMatrixFromQuaternion(turn)).reshape(3, 3)
    axis: Floats = matrix @ np.array(info[13], dtype=float)
    return axis / np.linalg.norm(axis)


def _finished(
    bullet: Bullet,
    first: Side,
    second: Side,
    mover: Mover,
    point: Any,
    lift: float,
    offset: float,
    overlap: float,
    rate: float,
) -> Placement:
    normal = _normal(point)
    middle = (np.array(point[5]) + np.array(point[6])) / 2
    touching = Side(first.name, first.body, int(point[3])), Side(second.name, second.body, int(point[4]))
    _require_room(bullet, mover.body, touching)
    mobility = sum(_mobility(bullet, side, normal, middle) for side in touching)
    mass = 1.0 / mobility if mobility > 0 else math.nan
    return Placement(*touching, mover, lift, offset, normal, middle, rate, mass, overlap)


def _mobility(bullet: Bullet, side: Side, normal: Floats, point: Floats) -> float:
    """J M^-1 J^T of one rigid body, 1/kg; of a body with links, that of the base's whole mass."""
    info = bullet.getDynamicsInfo(side.body, -1)
    if info[0] == 0.0 or _is_static(bullet, side.body):
        return _joint_mobility(bullet, side, normal)
    joints = bullet.getNumJoints(side.body)
    if joints:
        return 1.0 / sum(float(bullet.getDynamicsInfo(side.body, j)[0]) for j in range(-1, joints))
    position, turn = bullet.getBasePositionAndOrientation(side.body)
    _, inertial = bullet.module.multiplyTransforms(position, turn, info[3], info[4])
    matrix = np.array(bullet.module.getMatrixFromQuaternion(inertial)).reshape(3, 3)
    arm = matrix.T @ np.cross(point - np.array(position), normal)
    inertia = np.array(info[2], dtype=float)
    turning = np.divide(arm**2, inertia, out=np.zeros(3), where=inertia > 0)
    return float(1.0 / info[0] + turning.sum())


def _joint_mobility(bullet: Bullet, side: Side, normal: Floats) -> float:
    """Of a link on a prismatic joint of a fixed base: the masses that the joint carries, along its axis."""
    joints = prismatic_above(bullet, side.body, side.link if side.link is not None else -1)
    if not joints:
        return 0.0
    carried = [j for j in range(bullet.getNumJoints(side.body)) if joints[0] in _chain(bullet, side.body, j)]
    mass = sum(float(bullet.getDynamicsInfo(side.body, j)[0]) for j in carried)
    along = float(_world_axis(bullet, side.body, joints[0]) @ normal)
    return along**2 / mass if mass > 0 else 0.0


def _chain(bullet: Bullet, body: int, link: int) -> list[int]:
    found = []
    while link >= 0:
        found.append(link)
        link = bullet.getJointInfo(body, link)[16]
    return found


def _require_room(bullet: Bullet, mover: int, touching: tuple[Side, Side]) -> None:
    """Refuse a touch at which other parts of what moves would be deep in something."""
    pair = {(side.body, side.link) for side in touching}
    for i in range(bullet.getNumBodies()):
        other = bullet.getBodyUniqueId(i)
        if other == mover:
            continue
        for point in bullet.getClosestPoints(mover, other, 0.0):
            ends = {(mover, int(point[3])), (other, int(point[4]))}
            size = min(_size(bullet, Side("", body, link)) for body, link in ends)
            if ends != pair:
                names = touching[0].name, touching[1].name
                blocked = f"link {int(point[3])}", "another body"
                require_reachable(-float(point[8]), size, names, blocked)
