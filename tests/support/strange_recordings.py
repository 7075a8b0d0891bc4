"""Strange tables of bounces with their truth: other laws, coarse rounding, disturbed readings.

Shares no code with `hcbench fit`. A table is drawn from a design: kind of data, law, noise and
rounding, number of touches, and at most one disturbance. `judged` says what a fit made of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from measured_bounces import synthesise
from scipy.integrate import solve_ivp

import hcbench as hb
from hcbench.fitting.result import band
from hcbench.system.errors import UserError

Rng = np.random.Generator
Law = Callable[[float], float]
G = synthesise.GRAVITY

KINDS = ("times", "heights", "pairs", "speeds", "track")
LAWS = ("alpha", "alpha", "alpha with e0", "constant", "light ball", "sticky", "soft", "plastic")
DISTURBANCES = ("none", "none", "none", "missed", "doubled", "swapped", "knocked", "before")


# Disturbances that a kind of data can have.
_APPLIES = {
    "times": ("missed", "doubled", "knocked", "before"),
    "heights": ("missed", "doubled", "swapped", "knocked"),
    "pairs": ("swapped", "knocked"),
    "speeds": ("swapped", "knocked"),
    "track": ("knocked",),
}


@dataclass(frozen=True, slots=True)
class Truth:
    """law: of LAWS. alpha: s/m, None where e does not fall as the law says; e: of a constant."""

    law: str
    e_of: Law
    alpha: float | None = None
    e: float | None = None
    # (mass in kg, diameter in m) of a light ball, in air.
    ball: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Strange:
    """One table: its text, what a user says besides, and the truth.

    touches: how many the table has. fair: a careful person could answer.
    """

    kind: str
    disturbance: str
    truth: Truth
    text: str
    options: dict[str, Any] = field(default_factory=dict)
    touches: int = 0
    fair: bool = True

    @property
    def what(self) -> str:
        value = self.truth.alpha if self.truth.alpha is not None else self.truth.e
        number = f"{value:.3g}" if value is not None else ""
        return f"{self.kind}, {self.truth.law} {number}, {self.touches}, {self.disturbance}"


def _law(name: str, rng: Rng) -> Truth:
    if name == "constant":
        e = float(rng.uniform(0.3, 0.95))
        return Truth(name, synthesise.constant(e), e=e)
    if name == "light ball":
        e = float(rng.uniform(0.7, 0.93))
        balls = ((2.7e-3, 40e-3), (24e-3, 42e-3), (57e-3, 66e-3), (9e-3, 27e-3), (1.2e-3, 12e-3))
        return Truth(name, synthesise.constant(e), e=e, ball=balls[int(rng.integers(5))])
    if name == "plastic":
        c = float(rng.uniform(0.5, 0.8))
        return Truth(name, synthesise.plastic(c))
    if name == "soft":
        # e falls to 0 with the speed, as where a viscous layer or plastic work takes the rest.
        top = float(rng.uniform(0.7, 0.95))
        at = float(rng.uniform(0.1, 0.3))
        return Truth(name, lambda v: top * (1.0 - math.exp(-v / at)))
    alpha = float(np.exp(rng.uniform(math.log(0.02), math.log(2.5 if name == "alpha" else 0.5))))
    if name == "sticky":
        stick = float(rng.uniform(0.1, 0.25))
        plain = synthesise.hunt_crossley(alpha)
        return Truth(name, lambda v: plain(v) * math.sqrt(max(1.0 - (stick / v) ** 2, 0.0)), alpha)
    e0 = float(rng.uniform(0.85, 0.99)) if name == "alpha with e0" else 1.0
    return Truth(name, synthesise.hunt_crossley(alpha, e0), alpha)


def _bounces(
    truth: Truth, rng: Rng, scatter: float, most: int, knocked: int | None
) -> tuple[float, list[float], list[float], list[float]]:
    """Drop height, m; and of each bounce the speed in and out, m/s, and the time aloft, s."""
    drop = float(rng.uniform(0.25, 1.2))
    fly = None
    first = math.sqrt(2 * G * drop)
    if truth.ball is not None:
        mass, diameter = truth.ball
        # Terminal speed squared, without buoyancy: 1 % hardly changes the first touch.
        terminal = 2 * mass * G / (1.204 * 0.47 * math.pi / 4 * diameter**2)
        first = math.sqrt(-terminal * math.expm1(-2 * G * drop / terminal))

        def fly(launch: float) -> tuple[float, float]:
            return synthesise.flight_in_air(launch, mass, diameter, 0.47)

    before: list[float] = []
    after: list[float] = []
    aloft: list[float] = []
    law = truth.e_of
    for speed, launch, time in synthesise.flights(law, drop, scatter, rng, fly, first):
        if len(before) == most or time < 0.03 or launch < 1e-3:
            break
        if knocked == len(before):
            # The ball hits something: one bounce loses far more than the others.
            kept = float(rng.uniform(0.5, 0.8))
            later = (x for x in synthesise.flights(law, 1.0, scatter, rng, fly, launch * kept))
            before.append(speed)
            after.append(launch * kept)
            aloft.append(2 * launch * kept / G)
            for s, w, t in later:
                if len(before) >= most or t < 0.03:
                    break
                before.append(s)
                after.append(w)
                aloft.append(t)
            break
        before.append(speed)
        after.append(launch)
        aloft.append(time)
    return drop, before, after, aloft


def _disturbed(values: np.ndarray, how: str, rng: Rng) -> np.ndarray:
    """Readings in a row with one of them missed, doubled, or two neighbours swapped."""
    n = len(values)
    at = int(rng.integers(1, max(n - 1, 2)))
    if how == "missed" and n > 4:
        return np.delete(values, at)
    if how == "doubled" and n > 3:
        return np.insert(values, at, values[at])
    if how == "swapped" and n > 3:
        changed = values.copy()
        changed[[at - 1, at]] = changed[[at, at - 1]]
        return changed
    return values


def _csv(header: str, *columns: np.ndarray, digits: int = 6) -> str:
    rows = [",".join(f"{x:.{digits}f}" for x in row) for row in zip(*columns, strict=True)]
    return "\n".join([header, *rows]) + "\n"


def strange(seed: int) -> Strange:
    """The table of a seed: its place in the design goes with the seed, its numbers are drawn."""
    rng = np.random.default_rng([45, seed])
    kind = KINDS[seed % len(KINDS)]
    name = LAWS[seed // len(KINDS) % len(LAWS)]
    how = DISTURBANCES[int(rng.integers(len(DISTURBANCES)))]
    while True:
        truth = _law(name, rng)
        most = int(rng.integers(5, 26))
        scatter = float(np.exp(rng.uniform(math.log(2e-3), math.log(1e-2))))
        knocked = None
        if how == "knocked":
            knocked = int(rng.integers(1, max(most - 3, 2)))
        drop, before, after, aloft = _bounces(truth, rng, scatter, most, knocked)
        if len(before) >= 4:
            break
    v, w, t = np.array(before), np.array(after), np.array(aloft)
    options: dict[str, Any] = {}
    if truth.ball is not None and rng.random() < 0.3:
        mass, diameter = truth.ball
        options = {"mass": f"{1e3 * mass:g} g", "diameter": f"{1e3 * diameter:g} mm"}
    if kind in ("times", "heights") and how == "none" and rng.random() < 0.4:
        options["height"] = f"{100 * drop:.1f} +- 0.2 cm"
    how = how if how in _APPLIES[kind] else "none"
    if kind == "times":
        text, n = _times(t, how, rng)
    elif kind == "heights":
        text, n = _heights(w, truth, how, rng)
    elif kind == "track":
        text, n = _track(drop, w, t, truth, rng)
    else:
        text, n = _single(kind, v, w, how, rng)
    whole = {"none": 5, "missed": 7, "doubled": 7, "swapped": 7, "knocked": 7, "before": 7}
    return Strange(kind, how, truth, text, options, n, n >= whole[how])


def _times(aloft: np.ndarray, how: str, rng: Rng) -> tuple[str, int]:
    """Touch times with noise, rounded as a stopwatch or a program writes them."""
    times = rng.uniform(0.3, 2.0) + np.concatenate([[0.0], np.cumsum(aloft)])
    digits = int(rng.choice([2, 3, 3, 4, 5]))
    noise = min(float(np.exp(rng.uniform(math.log(2e-5), math.log(1e-3)))), 0.01 * aloft[-1])
    kept = np.concatenate([[True], aloft > 8 * 10.0**-digits])
    times = (times + noise * rng.standard_normal(len(times)))[kept]
    n = len(times)
    if how == "doubled" and n > 3:
        at = int(rng.integers(1, n))
        times = np.sort(np.append(times, times[at] + rng.uniform(0.012, 0.04)))
    elif how == "before":
        times = np.insert(times, 0, times[0] - rng.uniform(0.1, 1.0) * (times[1] - times[0]))
    elif how == "missed":
        times = _disturbed(times, how, rng)
    times = np.unique(times.round(digits))
    return _csv("time [s]", times, digits=digits), n


def _heights(launch: np.ndarray, truth: Truth, how: str, rng: Rng) -> tuple[str, int]:
    """Heights of bounces by eye or film, rounded to a tenth of a millimetre up to half a centimetre."""
    tops = launch**2 / (2 * G)
    if truth.ball is not None:
        tops = np.array([_apex(w, truth.ball) for w in launch])
    unit = float(rng.choice([1e-4, 1e-3, 1e-3, 5e-3]))
    noise = float(rng.uniform(0.3, 1.0)) * unit
    tops = tops[tops > 4 * unit]
    heights = tops + noise * rng.standard_normal(len(tops))
    heights = _disturbed(heights, how if how in ("missed", "doubled", "swapped") else "none", rng)
    heights = np.maximum((heights / unit).round(), 1.0) * unit
    return _csv("height [m]", heights, digits=4), len(heights)


def _in_air(speed: float, ball: tuple[float, float], times: np.ndarray) -> np.ndarray:
    """Heights over its start of a ball launched at a speed, m, at times since then, s: an ODE."""
    mass, diameter = ball
    displaced = 1.204 * math.pi / 6 * diameter**3
    drag = 0.5 * 1.204 * 0.47 * math.pi / 4 * diameter**2

    def rate(_t: float, y: np.ndarray) -> list[float]:
        pull = -(mass - displaced) * G - drag * y[1] * abs(y[1])
        return [y[1], pull / (mass + displaced / 2)]

    end = max(float(times.max(initial=0.0)), 1e-3)
    return np.asarray(solve_ivp(rate, (0, end), [0.0, speed], t_eval=times, rtol=1e-8).y[0])


def _apex(launch: float, ball: tuple[float, float]) -> float:
    """Height of a flight with drag, m."""
    return float(_in_air(launch, ball, np.linspace(0, launch / 8, 200)).max())


def _single(kind: str, v: np.ndarray, w: np.ndarray, how: str, rng: Rng) -> tuple[str, int]:
    """Impacts one by one, speeds with an error of 0.2 to 2 %; one row swapped where asked for."""
    error = float(np.exp(rng.uniform(math.log(2e-3), math.log(2e-2))))
    v_read = v * (1 + error * rng.standard_normal(len(v)))
    w_read = w * (1 + error * rng.standard_normal(len(w)))
    if kind == "pairs":
        e = np.minimum(w_read / v_read, 1.0)
        if how == "swapped":
            at = int(rng.integers(0, len(v) - 1))
            e[[at, at + 1]] = e[[at + 1, at]]
        return _csv("speed [m/s],restitution", v_read, e, digits=4), len(v)
    w_read = np.minimum(w_read, v_read)
    if how == "swapped":
        at = int(rng.integers(0, len(v)))
        v_read[at], w_read[at] = w_read[at], v_read[at]
    how = how if how in ("swapped", "knocked") else "none"
    return _csv("v_in [m/s],v_out [m/s]", v_read, w_read, digits=4), len(v)


def _track(
    drop: float, launch: np.ndarray, aloft: np.ndarray, truth: Truth, rng: Rng
) -> tuple[str, int]:
    """A film from the hand on, 60 to 240 frames a second, rest after the last bounce, y down often."""
    rate = float(rng.choice([60, 120, 240]))
    # A flight of fewer frames cannot be told from noise.
    seen = int(np.argmin(np.append(aloft > 6 / rate, False)))
    launch, aloft = launch[:seen], aloft[:seen]
    fall = math.sqrt(2 * drop / G)
    path = drop - 0.5 * G * np.linspace(0, fall, 400) ** 2
    clock = np.linspace(0, fall, 400)
    if truth.ball is not None:
        clock = np.linspace(0, 1.3 * fall, 400)
        path = drop + _in_air(0.0, truth.ball, clock)
        fall = float(np.interp(0.0, -path, clock))
    touches = np.concatenate([[fall], fall + np.cumsum(aloft)])
    still = float(rng.choice([0.0, 0.2, 1.0]))
    t = np.arange(0, still + touches[-1] + 0.02, 1 / rate)
    at = t - still
    y = np.interp(at, clock, path)
    for k, w in enumerate(launch):
        inside = (at >= touches[k]) & (at < touches[k + 1])
        since = at[inside] - touches[k]
        if truth.ball is None:
            y[inside] = w * since - 0.5 * G * since**2
        elif since.size:
            y[inside] = _in_air(w, truth.ball, since)
    y[at >= touches[-1]] = 0.0
    y = y + float(rng.uniform(3e-4, 2e-3)) * rng.standard_normal(len(y))
    if rng.random() < 0.4:
        y = 0.8 - y
    return _csv("time [s],y [m]", t, y, digits=4), len(touches)


@dataclass(frozen=True, slots=True)
class Verdict:
    """The outcome of a fit of a table.

    outcome: "right", "undecided" (no law, and its interval holds the truth), "wide", "silent" (no
    number), "refused", "wrong", or "crash". held: of a number given, its interval holds the truth.
    half: half width of the interval over the value.
    """

    outcome: str
    held: bool | None
    half: float | None
    note: str


_FAMILY = ("hunt-crossley", "hunt-crossley with e0", "hunt-crossley, with or without e0")


def judged(one: Strange, folder: Path) -> Verdict:
    """The verdict on what `hb.fit` says of a table, which is written into a folder."""
    path = folder / "strange.csv"
    path.write_text(one.text, encoding="utf-8")
    try:
        found = hb.fit(path, **one.options)
    except UserError as error:
        return Verdict("refused", None, None, str(error)[:150])
    except Exception as error:  # the judge of crashes
        return Verdict("crash", None, None, repr(error)[:150])
    truth = one.truth
    law = found.law
    note = f"{law}, α {_of(found.alpha)}, e {_of(found.restitution)}, s_e {found.best.scatter:.3f}"
    note += f", doubts {found.doubts}, lack {found.lack.odds:.2g}"
    value, estimate = truth.alpha, found.alpha
    if truth.law in ("constant", "light ball"):
        value, estimate = truth.e, found.restitution
        is_named = law == "constant"
    elif truth.law == "plastic":
        is_named = law == "plastic"
    else:
        is_named = law in _FAMILY and truth.law.startswith("alpha")
    held = half = None
    if value is not None and estimate is not None and estimate.value > 0:
        held = estimate.low <= value <= estimate.high
        half = (estimate.high - estimate.low) / 2 / estimate.value
        near = abs(estimate.value / value - 1) <= 0.05
    if truth.law in ("soft", "sticky"):
        return _outside(one, found, held, half, note)
    if law is not None and not is_named:
        return Verdict("wrong", held, half, note)
    if value is None:
        return Verdict("right" if law else "undecided", None, None, note)
    if held is None:
        return Verdict("silent", None, None, note)
    if not held and not near:
        return Verdict("wrong" if law else "miss", held, half, note)
    if half is not None and half > 0.3:
        return Verdict("wide", held, half, note)
    return Verdict("right" if law else "undecided", held, half, note)


# A law that is not the true one may be named where it is true to this, in e: none can tell.
_NOT_SEEN = 0.02


def _outside(one: Strange, found: Any, held: bool | None, half: float | None, note: str) -> Verdict:
    """The verdict where no law of the list is true: naming one is right where e differs by nothing
    that shows, and α holds.
    """
    if found.law is None:
        return Verdict("right" if held is not False else "miss", held, half, note)
    speeds, _, low, high = band(found)
    true = np.array([one.truth.e_of(float(v)) for v in speeds])
    off = np.maximum(np.maximum(low - true, true - high), 0.0).max()
    is_seen = off > _NOT_SEEN or held is False
    return Verdict("wrong" if is_seen else "right", held, half, f"{note}, off {off:.3f}")


def _of(estimate: object) -> str:
    if estimate is None:
        return "-"
    return f"{estimate.value:.4g} [{estimate.low:.4g}, {estimate.high:.4g}]"  # type: ignore[attr-defined]


def tables(count: int, first: int = 0) -> Iterator[Strange]:
    """The tables of so many seeds."""
    return map(strange, range(first, first + count))
