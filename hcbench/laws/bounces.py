"""Successive bounces: flights under gravity joined by impacts."""

import math
from collections.abc import Callable

import numpy as np

from hcbench.terms.impact import Floats, Impact, Trajectory

# A body that touches more slowly than this is at rest, m/s.
_REST_SPEED = 1e-6
# Impacts whose speeds differ by less share one loop: a ball that loses nothing bounces thousands of
# times.
_SAME_IMPACT = 1e-3


def successive_bounces(
    impact_at: Callable[[float], Impact], gravity: float, height: float, speed: float, times: Floats
) -> Trajectory:
    """The state at `times` (s after release, shape (n,)) of a body
    released `height` m up at `speed` m/s.

    speed: towards the plate; the penetration is below 0 in flight.
    impact_at: the impact at a touch speed (m/s), with its loop.
    gravity: m/s², 0 for one bounce only.

    At rest penetration, rate and force are 0: the static depth is negligible. An impact
    slower than the last computed one by less than 1e-3 has its loop, and loses speed in the
    ratio of v²: (1 - e) v is α v² there.
    """
    x = np.zeros_like(times)
    v = np.zeros_like(times)
    f = np.zeros_like(times)
    # Start of the flight, s.
    start = 0.0
    gap = height
    rate = speed
    impact = None
    while start <= times[-1]:
        if rate > 0 or gap > 0:
            touch = math.sqrt(rate**2 + 2 * gravity * gap)
        else:
            # The body leaves the plate and, without gravity or height to fall, comes back as fast.
            touch = -rate
        if touch < _REST_SPEED:
            return Trajectory(times, x, v, f)
        flight = (touch - rate) / gravity if gravity > 0 else gap / touch
        flying = slice(*np.searchsorted(times, [start, start + flight]))
        t = times[flying] - start
        x[flying] = -gap + rate * t + 0.5 * gravity * t**2
        v[flying] = rate + gravity * t
        start += flight
        if impact is None or abs(impact.speed_in - touch) > _SAME_IMPACT * touch:
            impact = impact_at(touch)
        loop = impact.loop
        assert loop is not None
        end = start + loop.time[-1]
        inside = slice(*np.searchsorted(times, [start, end]))
        since = times[inside] - start
        x[inside] = np.interp(since, loop.time, loop.penetration)
        v[inside] = np.interp(since, loop.time, loop.rate)
        f[inside] = np.interp(since, loop.time, loop.force)
        lost = (impact.speed_in - impact.speed_out) * (touch / impact.speed_in) ** 2
        start = end
        gap = 0.0
        rate = lost - touch
        if gravity == 0:
            left = times >= start
            x[left] = rate * (times[left] - start)
            v[left] = rate
            break
    return Trajectory(times, x, v, f)
