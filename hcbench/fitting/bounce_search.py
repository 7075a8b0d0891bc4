"""The longest train of bounces among clicks, some of which are echoes, knocks or rattle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hcbench.impact import Floats

    Indices = NDArray[np.int64]

_LONGEST = 2.5  # s, of a flight: 7.6 m high
_LEAST_E, _MOST_E = 0.05, 1.01
# e from one bounce to the next: as every law has it, it rises by less than (1 - e)², as eq. (16) does at low
# speeds; around that, what it scatters by, and what short flights are mistimed by.
_SCATTER = 0.05
_SAME = 3e-4  # s
_QUIETER = 10.0  # dB that a touch may be quieter than its speed has it
_LOUDER = 8.0  # dB that a touch may be louder than the one before, though slower
_UNHEARD_PRICE = 4.5  # paid back by four touches after it: at the end of a train nothing is skipped
_LOUD = 40.0  # dB over the noise that count as one touch more


@dataclass(slots=True)
class _PartialTrain:
    """The best train that ends with the flight between two clicks.

    last: its last flight, s: the second of two where a touch between them is unheard. e: of its last impact,
    NaN for none.
    """

    score: float
    last: float
    e: float
    before: tuple[int, int] | None
    skipped: bool


def longest_train(times: Floats, level: Floats, shortest: float) -> tuple[Indices, Indices, float]:
    """Clicks of the best train, the number of each touch from 0, and its score.

    times: (n,), s, rising. level: (n,), dB. shortest: s, of a flight. One touch of a train may be unheard.
    Dynamic programming over flights: e lies between 0.05 and 1 and changes little from bounce to bounce.
    """
    worth = 1.0 + np.clip(level, 0.0, None) / _LOUD
    steps: dict[tuple[int, int], _PartialTrain] = {}
    for j in range(len(times)):
        for i in range(j - 1, -1, -1):
            flight = times[j] - times[i]
            if flight > _LONGEST:
                break
            if flight >= shortest and level[j] < level[i] + _LOUDER:
                steps[i, j] = _best_step(i, j, flight, steps, times, level, worth)
    if not steps:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), 0.0
    last = max(steps, key=lambda pair: steps[pair].score)
    clicks, numbers = _walk_back(last, steps)
    while len(clicks) > 2 and _ends_in_echo(times, clicks):
        clicks, numbers = clicks[:-1], numbers[:-1]
    return clicks, numbers, steps[last].score


def _ends_in_echo(times: Floats, clicks: Indices) -> bool:
    """Whether the last click follows its touch as fast as clicks outside the train follow two others."""
    delay = times[clicks[-1]] - times[clicks[-2]]
    others = np.delete(times, clicks)
    if not others.size:
        return False
    off = np.abs(others[:, None] - times[clicks[:-2]] - delay).min(axis=0)
    return int((off < _SAME).sum()) >= 2


def _most_rise(e: float) -> float:
    return _SCATTER + (1.0 - e) ** 2


def _best_step(
    i: int,
    j: int,
    flight: float,
    steps: dict[tuple[int, int], _PartialTrain],
    times: Floats,
    level: Floats,
    worth: Floats,
) -> _PartialTrain:
    best = _PartialTrain(float(worth[i] + worth[j]), flight, math.nan, None, False)
    for h in range(i - 1, -1, -1):
        earlier = steps.get((h, i))
        if earlier is None:
            if times[i] - times[h] > _LONGEST:
                break
            continue
        ratio = flight / earlier.last
        options = [(ratio, False)]
        if not earlier.skipped and ratio > _LEAST_E:  # flight and next flight: e + e² of the last one
            options.append((0.5 * (math.sqrt(1.0 + 4.0 * ratio) - 1.0), True))
        for e, skipped in options:
            if not _LEAST_E <= e <= _MOST_E or (skipped and math.isnan(earlier.e)):
                continue
            if level[j] < level[i] + 20.0 * math.log10(e) - _QUIETER:
                continue
            if not math.isnan(earlier.e) and not -_SCATTER <= e - earlier.e <= _most_rise(earlier.e):
                continue
            score = earlier.score + float(worth[j]) - _UNHEARD_PRICE * skipped
            if score > best.score:
                last = flight * e / (1.0 + e) if skipped else flight
                best = _PartialTrain(score, last, e, (h, i), skipped or earlier.skipped)
    return best


def _walk_back(last: tuple[int, int], steps: dict[tuple[int, int], _PartialTrain]) -> tuple[Indices, Indices]:
    """The clicks of the train that ends with a flight, and the number of each touch."""
    clicks, gaps = [last[1], last[0]], []
    pair: tuple[int, int] = last
    while True:
        step = steps[pair]
        if step.before is None:
            gaps.append(1)
            break
        earlier = steps[step.before]
        gaps.append(2 if step.skipped and not earlier.skipped else 1)
        clicks.append(step.before[0])
        pair = step.before
    numbers = np.concatenate([[0], np.cumsum(gaps[::-1])])
    return np.array(clicks[::-1]), numbers.astype(np.int64)
