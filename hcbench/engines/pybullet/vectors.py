"""Three numbers at a time, as tuples: a tenth of what small arrays cost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

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
