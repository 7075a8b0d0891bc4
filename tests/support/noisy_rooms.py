"""Recordings of a bouncing ball as rooms and phones spoil them; shares no code with `hcbench fit`.

A drop is heard as clicks of struck modes on one of five surfaces, with early reflections and a
decaying tail. Noise lies over it, and where asked for a disturbance: knocks, talk, a second
ball, a phone's automatic gain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from measured_bounces import synthesise
from scipy.signal import butter, fftconvolve, lfilter, sosfilt

Rng = np.random.Generator
Sound = np.ndarray
RATE = 44100


@dataclass(frozen=True, slots=True)
class Floor:
    """contact: s, at 1 m/s. modes: (Hz, s, share). speeds: range of α in s/m that suits it."""

    contact: float
    modes: tuple[tuple[float, float, float], ...]
    alpha: tuple[float, float]


FLOORS = {
    "stone": Floor(90e-6, ((2600, 3e-3, 0.5), (6100, 2e-3, 0.5), (9700, 1.5e-3, 0.4)), (0.06, 0.3)),
    "tile": Floor(110e-6, ((1900, 9e-3, 0.6), (4700, 6e-3, 0.4), (8800, 3e-3, 0.3)), (0.08, 0.4)),
    "glass": Floor(80e-6, ((3400, 25e-3, 0.5), (7900, 14e-3, 0.4)), (0.06, 0.3)),
    "steel": Floor(
        70e-6, ((1500, 60e-3, 0.4), (4100, 35e-3, 0.4), (9300, 16e-3, 0.3)), (0.08, 0.4)
    ),
    "wood": Floor(260e-6, ((420, 14e-3, 0.8), (1350, 7e-3, 0.5), (3100, 4e-3, 0.3)), (0.3, 0.9)),
}


@dataclass(frozen=True, slots=True)
class Heard:
    """sound: one channel. touches: true times, s. alpha: s/m. what: how it was made."""

    sound: Sound
    touches: np.ndarray
    alpha: float
    what: str


def struck(floor: Floor, times: np.ndarray, speeds: np.ndarray, count: int, rng: Rng) -> Sound:
    """Each touch as a push of the contact's length that sets the floor's modes ringing."""
    sound = np.zeros(count)
    for at, speed in zip(times, speeds, strict=True):
        begin = int(np.ceil(at * RATE))
        t = (np.arange(begin, min(begin + int(0.35 * RATE), count)) - at * RATE) / RATE
        length = floor.contact * max(speed, 0.02) ** -0.2
        heard = 0.6 * np.where(t < length, np.sin(np.pi * t / length) ** 2, 0.0)
        for frequency, decay, share in floor.modes:
            # A push of this length hardly reaches modes much faster than itself.
            reach = 1.0 / (1.0 + (frequency * length) ** 4 / 4.0)
            phase = rng.uniform(0, 2 * np.pi)
            level = share * reach * rng.uniform(0.6, 1.4)
            heard += (
                level
                * np.exp(-t / decay)
                * (np.sin(2 * np.pi * frequency * t + phase) - np.sin(phase))
            )
        sound[begin : begin + len(t)] += speed * rng.uniform(0.85, 1.15) * heard
    return sound


def in_room(sound: Sound, echo: float, tail: float, rng: Rng) -> Sound:
    """Eight early reflections within 45 ms, up to `echo` of the direct
    sound, and a tail of `tail` s.
    """
    answer = np.zeros(int((0.05 + 2 * tail) * RATE) + 1)
    answer[0] = 1.0
    for gain in echo * rng.uniform(0.15, 1.0, 8):
        answer[int(rng.uniform(1e-3, 45e-3) * RATE)] += gain * rng.choice([-1, 1])
    t = np.arange(len(answer)) / RATE
    diffuse = rng.standard_normal(len(answer)) * np.exp(-6.9 * t / tail) * (t > 8e-3)
    answer += echo * 0.25 * diffuse / np.sqrt((diffuse**2).sum())
    return np.asarray(fftconvolve(sound, answer)[: len(sound)])


def coloured(count: int, exponent: float, rng: Rng) -> Sound:
    """Noise whose power falls as f^-exponent, of standard deviation 1."""
    f = np.fft.rfftfreq(count, 1 / RATE)
    shape = np.maximum(f, 30.0) ** (-exponent / 2)
    noise = np.fft.irfft(shape * np.fft.rfft(rng.standard_normal(count)), count)
    return np.asarray(noise / noise.std())


def ventilated(count: int, rng: Rng) -> Sound:
    """Broad noise of a fan that swells, with the mains and its harmonics."""
    t = np.arange(count) / RATE
    swell = 1 + 0.4 * np.sin(2 * np.pi * rng.uniform(0.2, 0.7) * t + rng.uniform(0, 6))
    hum = sum(np.sin(2 * np.pi * 50 * k * t + rng.uniform(0, 6)) / k for k in range(1, 9))
    noise = swell * coloured(count, 1.3, rng) + 0.7 * hum
    return np.asarray(noise / noise.std())


NOISES: dict[str, Callable[[int, Rng], Sound]] = {
    "white": lambda count, rng: rng.standard_normal(count),
    "pink": lambda count, rng: coloured(count, 1.0, rng),
    "brown": lambda count, rng: coloured(count, 2.0, rng),
    "fan": ventilated,
}


def knock(rng: Rng) -> Sound:
    """A knuckle or a box: one or two low modes and a click."""
    t = np.arange(int(0.12 * RATE)) / RATE
    sound = np.exp(-t / rng.uniform(0.2e-3, 1.5e-3)) * rng.standard_normal(len(t))
    for _ in range(3):
        sound += np.exp(-t / rng.uniform(4e-3, 25e-3)) * np.sin(
            2 * np.pi * rng.uniform(150, 4500) * t
        )
    return np.asarray(sound / np.abs(sound).max())


def talk(count: int, rng: Rng) -> Sound:
    """Syllables: harmonics under formants, some begun by a plosive or a hiss."""
    sound, at = np.zeros(count), int(rng.uniform(0, 0.3) * RATE)
    while at < count - RATE // 2:
        t = np.arange(int(rng.uniform(0.08, 0.3) * RATE)) / RATE
        pitch = rng.uniform(90, 220)
        voice = lfilter([1.0], [1.0, -0.95], np.sign(np.sin(2 * np.pi * pitch * t)))
        voice = sosfilt(
            butter(2, [300, rng.uniform(1500, 3500)], "bandpass", fs=RATE, output="sos"), voice
        )
        syllable = (
            voice / np.abs(voice).max() * np.sin(np.pi * np.linspace(0, 1, len(t))).clip(0) ** 0.5
        )
        if rng.random() < 0.4:
            burst = rng.standard_normal(int(0.02 * RATE)) * np.exp(
                -np.arange(int(0.02 * RATE)) / (3e-3 * RATE)
            )
            syllable[: len(burst)] += rng.uniform(0.1, 0.5) * burst
        sound[at : at + len(t)] += rng.uniform(0.4, 1.0) * syllable
        at += len(t) + int(rng.exponential(0.12) * RATE)
    return np.asarray(sound / np.abs(sound).max())


def automatic_gain(sound: Sound, rng: Rng) -> Sound:
    """A phone turns itself down after a loud sound and slowly up again, and clips."""
    block = 128
    power = (
        np.sqrt((sound[: len(sound) // block * block].reshape(-1, block) ** 2).mean(axis=1)) + 1e-9
    )
    attack, release = np.exp(-block / RATE / 4e-3), np.exp(-block / RATE / rng.uniform(0.1, 0.6))
    level, gains = power[:20].mean(), []
    for now in power:
        level = max(now, 1e-9) + (level - now) * (attack if now > level else release)
        gains.append((level + 0.02 * power.max()) ** -rng.choice([0.45]))
    gain = np.interp(np.arange(len(sound)), np.arange(len(gains)) * block, gains)
    return np.asarray(np.clip(sound * gain / np.abs(sound * gain).max() * 1.4, -1, 1))


DISTURBANCES = (
    "knock before", "knock among", "knock after", "several knocks", "talk", "second ball", "gain",
    "clipped", "reverberant", "few bounces", "dropouts", "handling",
)  # fmt: skip


def drop(
    floor: str,
    noise: str,
    decibels: float,
    disturbance: str | None,
    rng: Rng,
    alpha: float | None = None,
) -> Heard:
    """One drop from 0.3 to 1 m with e scattered by 0.3 to 0.8 %, recorded for some seconds.

    decibels: the loudest sample of the first click over the standard deviation of the noise.
    """
    chosen = FLOORS[floor]
    alpha = float(np.exp(rng.uniform(*np.log(chosen.alpha)))) if alpha is None else alpha
    times, speeds = touches(alpha, rng)
    if disturbance == "few bounces":
        kept = int(rng.integers(3, 6))
        times, speeds = times[:kept], speeds[:kept]
    count = int((times[-1] + rng.uniform(0.4, 1.0)) * RATE)
    sound = struck(chosen, times, speeds, count, rng)
    top = np.abs(sound).max()
    if disturbance is not None:
        sound = sound + top * extra(disturbance, chosen, times, count, rng)
    hard = disturbance == "reverberant"
    sound = in_room(sound, rng.uniform(0.5, 0.9) if hard else rng.uniform(0.05, 0.45),
                    rng.uniform(0.4, 0.8) if hard else rng.uniform(0.08, 0.3), rng)  # fmt: skip
    sound = sound + NOISES[noise](count, rng) * top * 10 ** (-decibels / 20)
    if disturbance == "gain":
        sound = automatic_gain(sound, rng)
    if disturbance == "clipped":
        sound = np.clip(sound, -0.15 * top, 0.15 * top)
    if disturbance == "dropouts":
        for at in rng.choice(times[1:], min(3, len(times) - 1), replace=False):
            begin = int((at - rng.uniform(0, 0.02)) * RATE)
            sound[begin : begin + int(0.03 * RATE)] *= 0.01
    sound = 0.9 * sound / np.abs(sound).max()
    return Heard(sound, times, alpha, f"{floor}, {noise}, {decibels:g} dB, {disturbance}")


def touches(alpha: float, rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """Times of touches from a random begin on, and the impact speeds, until flights are 25 ms."""
    law, scatter = synthesise.hunt_crossley(alpha), rng.uniform(3e-3, 8e-3)
    times, speeds = [rng.uniform(0.3, 2.5)], []
    for speed, _, aloft in synthesise.flights(law, rng.uniform(0.3, 1.0), scatter, rng):
        speeds.append(speed)
        if aloft < 0.025 or times[-1] + aloft - times[0] > 4.0:
            return np.array(times), np.array(speeds)
        times.append(times[-1] + aloft)
    raise AssertionError


def extra(disturbance: str, floor: Floor, times: np.ndarray, count: int, rng: Rng) -> Sound:
    """Sounds besides the ball, over the loudest sample of its first click."""
    sound = np.zeros(count)

    def put(at: float, what: Sound) -> None:
        begin = int(at * RATE)
        if 0 <= begin < count:
            sound[begin : begin + len(what)] += what[: count - begin]

    if disturbance == "knock before":
        put(times[0] - rng.uniform(0.1, min(2.4, times[0])), rng.uniform(0.4, 1.5) * knock(rng))
    elif disturbance == "knock among":
        put(rng.uniform(times[0], times[-1]), rng.uniform(0.2, 1.2) * knock(rng))
    elif disturbance == "knock after":
        put(times[-1] + rng.uniform(0.05, 0.4), rng.uniform(0.2, 1.2) * knock(rng))
    elif disturbance == "several knocks":
        for at in rng.uniform(0.05, count / RATE - 0.1, 4):
            put(at, rng.uniform(0.1, 1.0) * knock(rng))
    elif disturbance == "talk":
        sound += rng.uniform(0.1, 0.5) * talk(count, rng)
    elif disturbance == "second ball":
        other, speeds = touches(float(rng.uniform(0.05, 0.5)), rng)
        other += times[0] + rng.uniform(-0.3, 0.6) - other[0]
        kept = (other > 0.01) & (other < count / RATE - 0.01)
        if kept.any():
            ball = struck(floor, other[kept], speeds[kept], count, rng)
            sound += rng.uniform(0.2, 0.7) * ball / np.abs(ball).max()
    elif disturbance == "handling":
        for _ in range(8):
            length = int(rng.uniform(0.02, 0.2) * RATE)
            rub = coloured(length, 1.0, rng) * np.hanning(length) ** 0.5
            put(rng.uniform(0, count / RATE - 0.25), 0.1 * rub)
    return sound


def quiet(count: int, seed: int) -> Iterator[Heard]:
    """Recordings without a disturbance: all floors and noises, 10 to 40 dB."""
    rng, levels = np.random.default_rng(seed), (40.0, 30.0, 25.0, 20.0, 15.0, 10.0)
    cells = [(f, n, d) for d in levels for n in NOISES for f in FLOORS]
    chosen = [cells[i % len(cells)] for i in rng.permutation(max(count, len(cells)))[:count]]
    return (drop(f, n, d, None, rng) for f, n, d in chosen)


def disturbed(count: int, seed: int) -> Iterator[Heard]:
    """Recordings with one disturbance each, at 20 to 40 dB."""
    rng, floors = np.random.default_rng(seed), list(FLOORS)
    return (
        drop(
            floors[int(rng.integers(5))], list(NOISES)[int(rng.integers(4))], float(rng.uniform(20, 40)),
            DISTURBANCES[i % len(DISTURBANCES)], rng,
        )
        for i in range(count)
    )  # fmt: skip
