"""Readings of a table and the touches that they are: one may be missing, extra, wrong or exchanged.

A table as it stands and its likeliest changes are compared by a quick score first, by how smoothly
e goes over speed. `fit` then compares the few that are left by their evidence.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.datasets import TouchTimes, rounding_of
from hcbench.fitting.heights import Heights, SpeedPairs

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.recording import Indices
    from hcbench.terms.impact import Floats

# ln of the prior odds of each change, at one place of the table, against none.
_MISSING = math.log(0.02)
_EXTRA = math.log(0.01)
_WRONG = math.log(0.01)
_EXCHANGED = math.log(0.01)
# The same of one impact that is far off the others, such as of a ball that hits something.
ODD_IMPACT = math.log(0.05)
# The same of one with a far larger e, which no ball has.
ODD_GAIN = math.log(1e-3)
# Changes that one table may need.
_MOST_CHANGES = 4
# Readings of a table that `fit` compares by their evidence, besides the table as it stands.
_KEPT = 4
# A reading is kept if the ln of its quick score is at most this much below the best.
_CLOSE = 8.0
# Impacts that a quick score needs.
_LEAST_IMPACTS = 3
# From this e on, the speeds in and out were written into each other's columns.
_MOST_GAIN = 1.1
# Scatter of ln e that is there in the best of tables.
_SMOOTHEST = 4e-3


@dataclass(frozen=True, slots=True)
class TableReading:
    """One way to read a table.

    changes: of the table, in words; none for the table as it stands.
    log_prior: ln of the prior odds against the table as it stands, and of the density of readings
    that are left out.
    """

    data: Dataset
    changes: tuple[str, ...] = ()
    log_prior: float = 0.0


def readings_of(s: Dataset) -> list[TableReading]:
    """Likely readings of a table, the table as it stands first; that alone where it goes smoothly.

    Recordings and tracks have a search of their own, and are returned as they are.
    """
    if isinstance(s, SpeedPairs):
        return [_turned(s)]
    whole = TableReading(s)
    if not _is_table(s):
        return [whole]
    best = (_smoothness(s), whole)
    seen = [best]
    for _ in range(_MOST_CHANGES):
        tried = [(_smoothness(c.data) + c.log_prior, c) for c in _changed(best[1])]
        if not tried:
            break
        tried.sort(key=lambda one: -one[0])
        seen += tried[:_KEPT]
        if not tried[0][0] > best[0]:
            break
        best = tried[0]
    seen.sort(key=lambda one: -one[0])
    kept = [whole]
    for score, reading in seen:
        is_close = score > best[0] - _CLOSE
        if is_close and reading.changes and len(kept) <= _KEPT:
            kept.append(reading)
    # A table as good as any of its changes needs no comparison.
    if _smoothness(s) > best[0] - 1e-9:
        return [whole]
    return kept


def _turned(s: SpeedPairs) -> TableReading:
    """Pairs of speeds, with those exchanged whose ball would gain energy."""
    gains = s.twice & (s.restitution > _MOST_GAIN)
    if not gains.any():
        return TableReading(s)
    after = s.restitution * s.speed
    turned = replace(
        s,
        speed=np.where(gains, after, s.speed),
        restitution=np.where(gains, 1.0 / s.restitution, s.restitution),
        drops=None,
    )
    pairs = [f"{v:.4g} and {w:.4g} m/s" for v, w in zip(s.speed[gains], after[gains], strict=True)]
    return TableReading(turned, tuple(f"the speeds {pair} are exchanged" for pair in pairs))


def _is_table(s: Dataset) -> bool:
    if isinstance(s, TouchTimes):
        return s.picks is None
    return isinstance(s, Heights)


def _changed(reading: TableReading) -> Iterator[TableReading]:
    """Every reading that one more change makes."""
    s = reading.data
    assert isinstance(s, TouchTimes | Heights)
    if isinstance(s, TouchTimes):
        values = s.times
        unit = " s"
    else:
        values = s.heights
        unit = " m"
    n = len(values)
    numbers = s.which
    least = s.setup.least_touches - int(isinstance(s, Heights)) + 1
    # A reading that is left out may be anywhere.
    density = -math.log(float(np.ptp(values)))
    shown = [f"{value:.4g}{unit}" for value in values]

    def made(kept: Floats, count: Indices, what: str, log_prior: float) -> TableReading:
        if isinstance(s, TouchTimes):
            data: Dataset = replace(s, times=kept, numbers=count)
        else:
            data = replace(s, heights=kept, numbers=count)
        return TableReading(data, (*reading.changes, what), reading.log_prior + log_prior)

    for i in range(n - 1):
        later = np.where(np.arange(n) > i, 1, 0)
        what = f"a touch between {shown[i]} and {shown[i + 1]} is missing"
        if isinstance(s, Heights):
            what = f"a bounce between the heights {shown[i]} and {shown[i + 1]} is missing"
        yield made(values, numbers + later, what, _MISSING)
    if n > least:
        for i in range(n):
            kept = np.delete(values, i)
            left = np.delete(numbers, i)
            later = np.where(np.arange(n - 1) >= i, 1, 0)
            what = f"the reading {shown[i]} is not a touch of the ball"
            yield made(kept, left - later, what, _EXTRA + density)
            if 0 < i < n - 1:
                yield made(kept, left, f"the reading {shown[i]} is wrong", _WRONG + density)
    if isinstance(s, Heights):
        for i in range(n - 1):
            order = np.arange(n)
            order[[i, i + 1]] = order[[i + 1, i]]
            what = f"the heights {shown[i]} and {shown[i + 1]} are exchanged"
            yield made(values[order], numbers, what, _EXCHANGED)


def _smoothness(s: Dataset) -> float:
    """ln of the likelihood of the data, about, if ln e is a line over speed; higher is smoother.

    One impact may be far off, at a price.
    """
    speed, log_e, error = _impacts(s)
    if len(speed) < _LEAST_IMPACTS:
        return -math.inf
    best = _line_score(speed, log_e, error)
    if len(speed) > _LEAST_IMPACTS + 2:
        # A ball that hits something loses more; nothing makes it gain.
        for i in np.flatnonzero(log_e < np.median(log_e)):
            keep = np.arange(len(speed)) != i
            score = _line_score(speed[keep], log_e[keep], error[keep])
            best = max(best, score + ODD_IMPACT)
    return best


def _line_score(speed: Floats, log_e: Floats, error: Floats) -> float:
    """ln of the likelihood of ln e (n,) about its line over speed, with these relative errors.

    speed: (n,), above 0, in any unit.
    error: (n,), the standard error of each ln e.
    Errors are larger by the one factor, 1 or more, that the data show.
    """
    n = len(speed)
    columns = np.stack([np.ones(n), speed / speed.max()], axis=1)[:, : 1 + int(n > 3)]
    line = np.linalg.lstsq(columns / error[:, None], log_e / error, rcond=1e-9)[0]
    away = (log_e - columns @ line) / error
    degrees = n - columns.shape[1]
    larger = max(1.0, float((away**2).sum()) / max(degrees, 1))
    # An e above 1 means another reading is right.
    gain = float(np.maximum(columns @ line - 0.01, 0.0).sum())
    log_density = -np.log(error * math.sqrt(2.0 * math.pi * larger)) - 0.5 * away**2 / larger
    return float(log_density.sum()) - 20.0 * gain


def _impacts(s: Dataset) -> tuple[Floats, Floats, Floats]:
    """Speeds (m/s), ln e, and the relative error of e of impacts, shape (k,) each.

    Flights on both sides of a touch that is missing are one: their e is the one that all of them
    would have alike.
    """
    g = s.setup.ballistics.gravity
    if isinstance(s, TouchTimes):
        flights = np.diff(s.times) - s.setup.contact_time.value
        steps = np.diff(s.which)
        of_time = 1.5 * rounding_of(s.times)
        return _from_flights(np.maximum(flights, 1e-6), steps, of_time, g)
    assert isinstance(s, Heights)
    launch = np.sqrt(2.0 * g * s.heights)
    ratio: Floats = np.log(launch[1:] / launch[:-1]) / np.diff(s.which)
    of_height = rounding_of(s.heights) / s.heights
    error: Floats = np.hypot(0.5 * np.hypot(of_height[1:], of_height[:-1]), _SMOOTHEST)
    return np.sqrt(launch[1:] * launch[:-1]), ratio, error


def _from_flights(
    flights: Floats, steps: Floats, error: float, gravity: float
) -> tuple[Floats, Floats, Floats]:
    """Speed, m/s, ln e, and its relative error of the impacts between flights, shape (n-1,) each.

    flights: s, (n,), each above 0; `steps` (n,) says of how many flights in a row each consists.
    error: of a time, s. e is at least 1e-6.
    """
    simple = (steps[1:] == 1) & (steps[:-1] == 1)
    usual = 0.7
    if simple.any():
        usual = float(np.clip(np.median((flights[1:] / flights[:-1])[simple]), 0.1, 0.99))
    last = flights[0] * usual ** (steps[0] - 1) / sum(usual**k for k in range(int(steps[0])))
    speed, log_e, relative = [], [], []
    for flight, count in zip(flights[1:].tolist(), steps[1:].tolist(), strict=True):
        e = _common_e(flight / last, count)
        speed.append(0.5 * gravity * last)
        log_e.append(math.log(e))
        relative.append(math.hypot(error * (1.0 / last + 1.0 / flight), _SMOOTHEST))
        last *= e**count
    return np.array(speed), np.array(log_e), np.array(relative)


def _common_e(ratio: float, count: int) -> float:
    """The e at which `count` flights in a row last `ratio` times the one before: a Newton search."""
    e = ratio
    if count > 1:
        e = min(ratio / count, 1.0)
        for _ in range(20):
            powers = [e**k for k in range(count + 1)]
            slope = sum(k * powers[k - 1] for k in range(1, count + 1))
            e = max(e - (sum(powers[1:]) - ratio) / slope, 1e-3)
    return max(e, 1e-6)
