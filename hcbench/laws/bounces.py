"""Successive bounces: flights under gravity joined by impacts."""

import math
from collections.abc import Callable

import numpy as np

from hcbench.impact import Floats, Impact, Trajectory

_REST_SPEED = 1e-6  # m/s: touching slower than this counts as rest


def successive_bounces(
    impact_at: Callable[[float], Impact], gravity: float, height: float, speed: float, times: Floats
) -> Trajectory:
    """The state at `times` (s after release, shape (n,)) of a body released `height` m up at `speed` m/s.

    impact_at: the impact at a touch speed (m/s), with its loop. gravity: m/s², 0 for one bounce only.
    At rest penetration, rate and force are 0: the static depth is negligible.
    """
    x, v, f = np.zeros_like(times), np.zeros_like(times), np.zeros_like(times)
    start, gap, rate = 0.0, height, speed
    while start <= times[-1]:
        touch = math.sqrt(rate**2 + 2 * gravity * gap) if rate > 0 or gap > 0 else -rate
        if touch < _REST_SPEED:
            return Trajectory(times, x, v, f)
        flight = (touch - rate) / gravity if gravity > 0 else gap / touch
        t = times - start
        flying = (t >= 0) & (t < flight)
        x[flying] = -gap + rate * t[flying] + 0.5 * gravity * t[flying] ** 2
        v[flying] = rate + gravity * t[flying]
        start += flight
        impact = impact_at(touch)
        loop = impact.loop
        assert loop is not None
        t = times - start
        inside = (t >= 0) & (t <= loop.time[-1])
        for out, values in ((x, loop.penetration), (v, loop.rate), (f, loop.force)):
            out[inside] = np.interp(t[inside], loop.time, values)
        start, gap, rate = start + loop.time[-1], 0.0, -impact.speed_out
        if gravity == 0:
            left = times > start
            x[left], v[left] = rate * (times[left] - start), rate
            break
    return Trajectory(times, x, v, f)
