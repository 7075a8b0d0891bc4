"""PyBullet: the configuration in which a pair just touches, what moves there, and how."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.pybullet.model import KIND, NAME, PRISMATIC, BulletBody, contact_row
from hcbench.engines.pybullet.user_model import Bullet, Loaded, Side
from hcbench.engines.pybullet.vectors import vector
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
        if BulletBody(bullet, moving.body).mass > 0.0:
            return _by_base(loaded, moving, other)
    for moving, other in ((first, second), (second, first)):
        body, link = BulletBody(bullet, moving.body), _touching_link(bullet, moving, other)
        for joint in body.ancestors(link):
            if body.joints[joint][KIND] == PRISMATIC:
                found = _by_joint(body, moving, other, joint)
                if found is not None:
                    return found
    raise UserError(
        "pair",
        f"neither {first.name!r} nor {second.name!r} can be launched: both bases are fixed",
        "a base of mass above 0 that is not fixed, or a prismatic joint towards the other",
    )


def moves(bullet: Bullet, side: Side) -> bool:
    """Whether anything can move the side's link."""
    return BulletBody(bullet, side.body).kind != "fixed"


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


def _by_joint(body: BulletBody, first: Side, second: Side, joint: int) -> Placement | None:
    bullet = body.bullet
    axis = np.array(body.joint_axis(joint))
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
    name = body.joints[joint][NAME].decode(errors="replace")
    sign = math.copysign(1.0, along)
    mover = Mover(first.body, joint, axis * sign, f"{first.name!r} by its joint {name!r}", sign)
    return _finished(bullet, first, second, mover, point, 0.0, offset, overlap, abs(along))


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
    links = int(point[3]), int(point[4])
    touching = Side(first.name, first.body, links[0]), Side(second.name, second.body, links[1])
    _require_room(bullet, mover.body, touching)
    mass = _effective_mass(bullet, (first.body, links[0]), (second.body, links[1]), middle, normal)
    return Placement(*touching, mover, lift, offset, normal, middle, rate, mass, overlap)


def _effective_mass(
    bullet: Bullet, first: tuple[int, int], second: tuple[int, int], point: Floats, normal: Floats
) -> float:
    """1 / (J M^-1 J^T) of two (body, link), kg; NaN where neither can move, or PyBullet does not tell how."""
    bodies = {number: BulletBody(bullet, number) for number, _ in (first, second)}
    one, two = ((bodies[number], link) for number, link in (first, second))
    inverse = contact_row(one, two, vector(point), vector(normal)).inverse_mass
    return 1.0 / inverse if inverse > 0.0 else math.nan


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
