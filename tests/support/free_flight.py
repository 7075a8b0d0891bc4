"""Free flight: the speed at the touch plane, by what semi-implicit
steps keep, and how a body turns.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats


def speed_at_plane(gap: float, upwards: float, gravity: float, step: float) -> float:
    """Speed at the touch plane of a body `gap` m above it with a velocity
    upwards, m/s, at steps of `step` s.

    A step adds -g h to the velocity u and then h u to the height z: (u -
    g h/2)² + 2 g z stays the same.
    """
    return math.sqrt(max(0.0, (upwards - 0.5 * gravity * step) ** 2 + 2.0 * gravity * gap))


def turned_freely(inertia: Floats, w: Floats, step: float) -> Floats:
    """Angular velocity a step later, by Euler's equations, in body
    axes, shape (3,). inertia: (3, 3).
    """
    inverse, k = np.linalg.inv(inertia), step / 16

    def rate(w: Floats) -> Floats:
        return -inverse @ np.cross(w, inertia @ w)

    for _ in range(16):
        a = rate(w)
        b = rate(w + k / 2 * a)
        c = rate(w + k / 2 * b)
        w = w + k / 6 * (a + 2 * b + 2 * c + rate(w + k * c))
    return w


def before_turning(inertia: Floats, w: Floats, step: float) -> Floats:
    """The angular velocity from which free turning leads to `w` in a step, in body axes."""
    first = w.copy()
    for _ in range(12):
        first += w - turned_freely(inertia, first, step)
    return first
