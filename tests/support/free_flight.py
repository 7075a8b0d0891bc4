"""The speed at the touch plane, by what semi-implicit steps keep in free flight: for loops by hand."""

from __future__ import annotations

import math


def speed_at_plane(gap: float, upwards: float, gravity: float, step: float) -> float:
    """Of a body `gap` m above its touch with a velocity upwards, m/s, at steps of `step` s.

    A step adds -g h to the velocity u and then h u to the height z: (u - g h/2)² + 2 g z stays the same.
    """
    return math.sqrt(max(0.0, (upwards - 0.5 * gravity * step) ** 2 + 2.0 * gravity * gap))
