"""Nearest points of two parts of a PyBullet world, and the face on which they meet."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench.engines.pybullet.backend import DISTANCE, NORMAL, POINT_A, POINT_B, BulletClient
from hcbench.engines.pybullet.model.bodies import cross, rotate, vector
from hcbench.engines.pybullet.model.open import BodyPart
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats

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
    """PyBullet's closest point of the two; UserError where they have nothing to touch with."""
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
    """The face or edge on which two parts meet, None where they meet at a point; moves the body.

    Of a face Bullet returns one point, by how its search ended. The body is therefore tilted about
    that point, a little in each direction: its nearest points then lie around the face.

    size: of the smaller part, m. The moving body stands where it touches.
    """
    touching = nearest(bullet, moving, other)
    point = middle_of(touching)
    normal = normal_of(touching)
    position, quaternion = bullet.getBasePositionAndOrientation(moving.body)
    # Clear of the other at every tilt, where Bullet's distances are exact.
    arm = np.array(position) - point - _TILT * size * normal
    rim = []
    for axis in _across(normal):
        tilt = [*(math.sin(0.5 * _TILT) * axis), math.cos(0.5 * _TILT)]
        _, tilted = bullet.multiplyTransforms(_ORIGIN, tilt, _ORIGIN, quaternion)
        start = point + np.array(rotate(tilt, vector(arm)))
        bullet.resetBasePositionAndOrientation(moving.body, start.tolist(), tilted)
        rim.append(middle_of(nearest(bullet, moving, other)))
    across = np.array(rim) - point
    across -= np.outer(across @ normal, normal)
    middle = across.mean(axis=0)
    if np.linalg.norm(across - middle, axis=1).max() < _FLAT * size:
        return None
    pressed = np.array(position) + _PRESSED * normal
    bullet.resetBasePositionAndOrientation(moving.body, pressed.tolist(), quaternion)
    bullet.performCollisionDetection()
    contacts = bullet.getContactPoints(moving.body, other.body, moving.link, other.link)
    return Face(point + middle, len(contacts))


def _across(normal: Floats) -> list[Floats]:
    """Unit vectors across the normal, evenly around it."""
    least = np.zeros(3)
    least[np.argmin(np.abs(normal))] = 1.0
    one = np.array(cross(vector(normal), vector(least)))
    one /= np.linalg.norm(one)
    other = np.array(cross(vector(normal), vector(one)))
    angles = [2.0 * math.pi * k / _DIRECTIONS for k in range(_DIRECTIONS)]
    return [math.cos(angle) * one + math.sin(angle) * other for angle in angles]
