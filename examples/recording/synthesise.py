"""Synthetic measurements of a bouncing ball, by code that shares nothing with `hcbench fit`.

The law by root finding, flights by their formulas or by an ODE, scatter of each e, noise of measuring.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

Law = Callable[[float], float]
GRAVITY = 9.80665


def hunt_crossley(alpha: float, e0: float = 1.0) -> Law:
    """e over speed (m/s) of eq. (16): the root of d (1 + e) = ln(1 + d) - ln(1 - d e), d = (3/2) alpha v."""

    def e(speed: float) -> float:
        d = 1.5 * alpha * speed
        if d < 1e-6:
            return e0 * (1.0 - 2.0 / 3.0 * d)
        most = min(1.0, 1.0 / d) * (1.0 - 1e-15)
        return e0 * float(brentq(lambda e: d * (1 + e) - math.log1p(d) + math.log1p(-d * e), 1e-12, most))

    return e


def constant(e: float) -> Law:
    """The same e at all speeds."""
    return lambda speed: e


def viscoelastic(c: float) -> Law:
    """1 - C v^(1/5)."""
    return lambda speed: 1.0 - c * speed**0.2


def plastic(c: float) -> Law:
    """C v^(-1/4), at most 1."""
    return lambda speed: min(1.0, c * speed**-0.25)


def flights(
    law: Law,
    drop: float,
    scatter: float,
    rng: np.random.Generator,
    fly: Callable[[float], tuple[float, float]] | None = None,
    first: float | None = None,
) -> Iterator[tuple[float, float, float]]:
    """(touch speed, rebound speed, time aloft) of one bounce after the other, from a drop height in m.

    fly: the time aloft and the next touch speed of a launch speed; a vacuum's where it is None. first: the
    speed of the first touch, where it is not a vacuum's.
    """
    speed = math.sqrt(2 * GRAVITY * drop) if first is None else first
    while True:
        launch = speed * min(1.0, law(speed) * math.exp(scatter * rng.standard_normal()))
        aloft, touch = (2 * launch / GRAVITY, launch) if fly is None else fly(launch)
        yield speed, launch, aloft
        speed = touch


def touch_times(
    law: Law, drop: float, timing: float, scatter: float, rng: np.random.Generator, most: int = 20
) -> np.ndarray:
    """Times of touches with noise, s, as long as they are 20 ms (or ten of their noise) apart."""
    times = [math.sqrt(2 * drop / GRAVITY)]
    for _, _, aloft in flights(law, drop, scatter, rng):
        if aloft < max(0.02, 10 * timing) or len(times) == most:
            return np.array(times) + timing * rng.standard_normal(len(times))
        times.append(times[-1] + aloft)
    raise AssertionError


def bounce_heights(
    law: Law, drop: float, noise: float, scatter: float, rng: np.random.Generator, most: int = 20
) -> np.ndarray:
    """Heights of bounces with noise, m, as long as they are above ten times that."""
    heights: list[float] = []
    for _, launch, _ in flights(law, drop, scatter, rng):
        height = launch**2 / (2 * GRAVITY)
        if height < max(10 * noise, 1e-4) or len(heights) == most:
            return np.array(heights) + noise * rng.standard_normal(len(heights))
        heights.append(height)
    raise AssertionError


def flight_in_air(
    launch: float, mass: float, diameter: float, drag_coefficient: float, density: float = 1.204
) -> tuple[float, float]:
    """Time aloft and touch speed with drag, buoyancy and added mass, by an ODE."""
    displaced = density * math.pi / 6 * diameter**3
    inertia = mass + displaced / 2
    drag = 0.5 * density * drag_coefficient * math.pi / 4 * diameter**2

    def rate(t: float, y: np.ndarray) -> list[float]:
        return [y[1], (-(mass - displaced) * GRAVITY - drag * y[1] * abs(y[1])) / inertia]

    def floor(t: float, y: np.ndarray) -> float:
        return float(y[0]) if t > 0 else 1.0

    floor.terminal, floor.direction = True, -1.0  # type: ignore[attr-defined]
    done = solve_ivp(rate, (0, 10), [0.0, launch], events=floor, rtol=1e-10, atol=1e-12, max_step=0.02)
    return float(done.t_events[0][0]), float(-done.y_events[0][0][1])
