"""Synthetic measurements of a bouncing ball, by code that shares nothing with `hcbench fit`.

The law by root finding, flights by their formulas or by an ODE, scatter
of each e, noise of measuring.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.io import wavfile
from scipy.optimize import brentq

Law = Callable[[float], float]
GRAVITY = 9.80665


def hunt_crossley(alpha: float, e0: float = 1.0) -> Law:
    """e over speed (m/s) of eq. (16): the root of d (1 + e) = ln(1 + d) -
    ln(1 - d e), d = (3/2) alpha v.
    """

    def e(speed: float) -> float:
        d = 1.5 * alpha * speed
        if d < 1e-6:
            return e0 * (1.0 - 2.0 / 3.0 * d)
        most = min(1.0, 1.0 / d) * (1.0 - 1e-15)
        return e0 * float(
            brentq(lambda e: d * (1 + e) - math.log1p(d) + math.log1p(-d * e), 1e-12, most)
        )

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
    """(touch speed, rebound speed, time aloft) of one bounce after the
    other, from a drop height in m.

    fly: the time aloft and the next touch speed of a launch speed; a vacuum's where it is None.
    first: the speed of the first touch, where it is not a vacuum's.
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
    done = solve_ivp(
        rate, (0, 10), [0.0, launch], events=floor, rtol=1e-10, atol=1e-12, max_step=0.02
    )
    return float(done.t_events[0][0]), float(-done.y_events[0][0][1])


@dataclass(frozen=True, slots=True)
class Surface:
    """Sound of a plate. click: length of a first pulse at 1 m/s, s.
    modes: (Hz, s, share of the click).
    """

    click: float
    modes: tuple[tuple[float, float, float], ...]
    echo: float


SURFACES = {
    "stone": Surface(8e-5, ((5200.0, 3e-3, 0.5), (9100.0, 4e-3, 0.4), (13700.0, 3e-3, 0.2)), 0.2),
    "wood": Surface(3e-4, ((900.0, 12e-3, 0.8), (2300.0, 8e-3, 0.5), (4700.0, 5e-3, 0.4)), 0.3),
    "tile": Surface(
        1.2e-4, ((3100.0, 10e-3, 0.5), (6800.0, 15e-3, 0.4), (11200.0, 6e-3, 0.3)), 0.3
    ),
    "plate": Surface(
        6e-5,
        ((2100.0, 80e-3, 0.5), (4900.0, 50e-3, 0.5), (8300.0, 30e-3, 0.4), (12900.0, 20e-3, 0.3)),
        0.15,
    ),
}


def pink_noise(count: int, rng: np.random.Generator) -> np.ndarray:
    """Noise of rms 1 whose power goes as 1/f."""
    spectrum = np.fft.rfft(rng.standard_normal(count))
    spectrum /= np.sqrt(np.maximum(np.arange(len(spectrum)), 20))
    noise = np.fft.irfft(spectrum, count)
    return np.asarray(noise / noise.std())


def recording(
    times: np.ndarray,
    speeds: np.ndarray,
    surface: Surface,
    decibels: float,
    rng: np.random.Generator,
    rate: int = 44100,
) -> np.ndarray:
    """Sound of touches at times (s) and speeds (m/s): -1 ... 1, from time 0
    to half a second after the last.

    decibels: peak of the first click over the rms of the noise.
    """
    clock = np.arange(int((times[-1] + 0.5) * rate)) / rate
    sound = np.zeros(len(clock))
    echoes = [(0, 1.0)]
    echoes += [
        (round(rng.uniform(1e-3, 30e-3) * rate), surface.echo * rng.uniform(0.2, 1.0))
        for _ in range(6)
    ]
    for time, speed in zip(times, speeds, strict=True):
        begin = np.searchsorted(clock, time)
        t = clock[begin : begin + int(0.4 * rate)] - time
        length = surface.click * speed**-0.2
        heard = np.where(t < length, np.sin(np.pi * t / length), 0.0)
        for frequency, decay, share in surface.modes:
            gain = share * rng.uniform(0.5, 1.5)
            heard += gain * np.sin(2 * np.pi * frequency * t) * np.exp(-t / decay)
        for delay, gain in echoes:
            sound[begin + delay : begin + delay + len(t)] += (
                gain * speed * heard[: len(sound) - begin - delay]
            )
    noise = pink_noise(len(clock), rng) * speeds[0] * 10 ** (-decibels / 20)
    whole = sound + noise
    return np.asarray(0.9 * whole / np.abs(whole).max())


def drop_recording(
    law: Law,
    drop: float,
    scatter: float,
    surface: str,
    decibels: float,
    rng: np.random.Generator,
    shortest: float = 0.03,
    seconds: float = 5.0,
) -> tuple[np.ndarray, np.ndarray]:
    """(sound, times of its touches) of a ball let go from a height in m,
    until flights are `shortest` s.
    """
    times, speeds = [rng.uniform(0.4, 0.8)], []
    for speed, _, aloft in flights(law, drop, scatter, rng):
        speeds.append(speed)
        if aloft < shortest or times[-1] + aloft > seconds:
            break
        times.append(times[-1] + aloft)
    at, v = np.array(times), np.array(speeds)
    return recording(at, v, SURFACES[surface], decibels, rng), at


def track(
    law: Law,
    drop: float,
    scatter: float,
    noise: float,
    frames: float,
    rng: np.random.Generator,
    seconds: float = 2.5,
) -> tuple[np.ndarray, np.ndarray]:
    """(times, heights with noise) of a film with `frames` a second, from before the ball is let go."""
    held, fall = 0.1, math.sqrt(2 * drop / GRAVITY)
    clock = np.arange(0.0, seconds, 1 / frames) + rng.uniform(0, 1 / frames)
    height = np.where(clock < held, drop, drop - 0.5 * GRAVITY * (clock - held) ** 2)
    touch = held + fall
    for _, launch, aloft in flights(law, drop, scatter, rng):
        t = clock - touch
        height = np.where(t >= 0, launch * t - 0.5 * GRAVITY * t**2, height)
        touch += aloft
        if touch > seconds or aloft < 1e-3:
            break
    height = np.where(clock > touch, 0.0, height)
    return clock, height + noise * rng.standard_normal(len(clock))


def main() -> None:
    """Write the recording of the example: alpha 0.3 s/m, from 40 cm
    on a tile, e scattered by 0.4 %.
    """
    sound, _ = drop_recording(hunt_crossley(0.3), 0.4, 4e-3, "tile", 40.0, np.random.default_rng(3))
    wavfile.write(sys.argv[1], 44100, np.round(32767 * sound).astype(np.int16))


if __name__ == "__main__":
    main()
