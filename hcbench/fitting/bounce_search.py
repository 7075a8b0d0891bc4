"""Trains of bounces among clicks, some of which are echoes, knocks or rattle: the likeliest few.

A train's score is the log-likelihood ratio of its clicks being touches of one ball against clutter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hcbench.terms.impact import Floats

    Indices = NDArray[np.int64]

# Longest flight that the search tries, s: a ball that rises 7.6 m.
_LONGEST = 2.5
# Bounds of e from one flight to the next; above 1 for errors of the clicks' times.
_LEAST_E = 0.05
_MOST_E = 1.01
# dB: the rate of clutter that rivals a click counts clicks that are at most this much quieter.
_AS_LOUD = 3.0
# 1/s: clutter that the recording does not happen to show.
_UNSEEN = 0.3
# Share of the clicks of a signal that count as clutter as long as no train is known.
_OF_QUIET = 0.2
# Least score of a train in a signal.
_LEAST_OF_QUIET = -12.0
# Price of a click that a louder one precedes: the louder one is the touch, this one its echo.
_ECHO = 1.5
# Longest time from a touch to its echo, s.
_ECHO_WITHIN = 40e-3
# dB by which the touch is louder than its echo, at least.
_ECHO_OVER = 1.0
# e rises from one bounce to the next by about this times (1 - e)²: the ball comes slower.
_RISE = 0.4
# Standard deviation of that factor.
_RISE_SD = 0.35
# Scatter of e from bounce to bounce.
_SCATTER = 0.008
# Error of a click's time, s.
_TIMING = 2e-4
# Share of bounces that scatter more than the others.
_WILD = 0.1
# Those bounces scatter this many times as much.
_WILDER = 5.0
# dB: standard deviation of a touch's level about the one that its speed gives.
_LOUDNESS = 4.0
# dB: range over which the levels of clutter spread.
_LOUDEST = 30.0
# A squared deviation counts up to this, in squared standard deviations.
_CUT = 16.0
# Price of a touch that is not heard.
_UNHEARD = 3.0
# Touches of a train that may be unheard.
_MOST_UNHEARD = 2
# dB: a click within a flight speaks against the flight if it is at most this much quieter than the
# louder end.
_INSIDE = 2.0
# Clicks count so long after the start of a flight, s: earlier ones are echoes.
_INSIDE_FROM = 60e-3
# Clicks within a flight that count, at most.
_MOST_INSIDE = 4
# The last touch of a train adds at least this to the score: a chance click adds less.
_LEAST_GAIN = 2.0
# The same for a weak click: many of its kind are too weak to be seen.
_LEAST_OF_WEAK = 5.0
# The same in a signal, whose weakest pulses stand out from the noise.
_GAIN_IN_QUIET = 3.0
# Two trains with this share of their clicks in common are one train.
_SHARED = 0.7
# Two echoes are one reflection if their delays differ by less, s.
_SAME = 3e-4
# Flights that the search tries as the last of a train.
_ENDS = 3000


@dataclass(frozen=True, slots=True)
class Train:
    """Successive touches of one ball among the clicks of a recording.

    clicks: (n,), which of the clicks.
    numbers: (n,), which touch each is, from 0: some may be unheard.
    """

    clicks: Indices
    numbers: Indices
    score: float


def likeliest_trains(
    times: Floats, level: Floats, duration: float, shortest: float, most: int = 6
) -> list[Train]:
    """Trains of three clicks or more that share few of them, the likeliest first; empty without
    any.

    times: (n,), s, rising.
    level: (n,), dB.
    duration: of the recording, s.
    shortest: s, of a flight.
    most: trains to return, at most.
    """
    clutter = clutter_rate(level, level, duration)
    limits = _Limits(clutter, _TIMING, 0.0, _LEAST_GAIN, _LEAST_OF_WEAK)
    return _searched(times, level, shortest, most, limits)


def trains_in_quiet(
    times: Floats, level: Floats, duration: float, shortest: float, most: int, timing: float
) -> list[Train]:
    """Trains as `likeliest_trains` finds them, where most clicks are the ball's, as in a signal.

    timing: error of a click's time, s; the rest as there.
    Clutter is what the best train leaves, and not the train itself: the search runs twice. Trains that
    are less likely than clutter are among them, as other signs may speak for these.
    """
    clutter = _OF_QUIET * clutter_rate(level, level, duration)
    limits = _Limits(clutter, timing, _LEAST_OF_QUIET, _GAIN_IN_QUIET, _GAIN_IN_QUIET)
    found = _searched(times, level, shortest, 1, limits)
    if not found:
        return []
    clutter = clutter_rate(level, np.delete(level, found[0].clicks), duration)
    return _searched(times, level, shortest, most, replace(limits, clutter=clutter))


def clutter_rate(level: Floats, others: Floats, duration: float) -> Floats:
    """Clicks a second, (n,), that are as loud as each of these, dB, and may be taken for it.

    others: (m,), levels of those that count, dB.
    duration: of the recording, s.
    """
    as_loud = (level[:, None] - _AS_LOUD <= others).sum(axis=1)
    return np.asarray(as_loud / duration + _UNSEEN)


@dataclass(frozen=True, slots=True)
class _Limits:
    """Limits of what a search takes for clutter, and for a train.

    clutter: (n,), rate of clicks that may be taken for each, 1/s.
    timing: error of a click's time, s.
    score: above which a train counts.
    gain, gain_of_weak: least score that the last click adds.
    """

    clutter: Floats
    timing: float
    score: float
    gain: float
    gain_of_weak: float


def _searched(
    times: Floats, level: Floats, shortest: float, most: int, limits: _Limits
) -> list[Train]:
    """Trains of three clicks or more that share few of them, the likeliest first: dynamic programming
    over flights, each from a click i to a later click j.

    times, level: (n,), s and dB.
    shortest: s, of a flight.
    most: trains, at most.
    """
    if len(times) < 3:
        return []
    search = _Search(times, level, shortest, limits)
    for i in range(len(times)):
        search.extend(i)
    order = np.argsort(search.score, axis=None)[::-1][:_ENDS]
    trains: list[Train] = []
    seen = set()
    for flat in order:
        i, j = divmod(int(flat), len(times))
        if not search.score[i, j] > limits.score or len(trains) == most:
            break
        if (end := search.last_that_counts(i, j)) in seen:
            continue
        seen.add(end)
        train = search.walk_back(*end)
        if len(train.clicks) > 2 and not any(_shared(train, better) for better in trains):
            trains.append(train)
    return trains


def _shared(train: Train, better: Train) -> bool:
    common = int(np.isin(train.clicks, better.clicks).sum())
    return common >= _SHARED * min(len(train.clicks), len(better.clicks))


class _Search:
    """Scores of the best trains that end with the flight from click i to click j; arrays of shape
    (n, n).

    last: that flight, s; the second of two where a touch between them is unheard.
    e: of its last impact, NaN for none.
    before: the click at which the flight before began, -1 for none.
    score: ln of how much likelier the train is than clutter; -inf for none. worth: that of each
    click by itself, (n,).
    gap: whether a touch within the flight is unheard; unheard: how many are in the train.
    """

    def __init__(self, times: Floats, level: Floats, shortest: float, limits: _Limits) -> None:
        """Rate each click by itself, without any train yet; arguments as of `_searched`."""
        n = len(times)
        self.times = times
        self.level = level
        self.shortest = shortest
        self.limits = limits
        apart = times[:, None] - times
        louder = level > level[:, None] + _ECHO_OVER
        is_echo = ((apart > 0) & (apart < _ECHO_WITHIN) & louder).any(axis=1)
        # The rarer clicks as loud as this one are, the less likely it is clutter.
        self.worth = -np.log(limits.clutter) - _ECHO * is_echo
        self.score = np.full((n, n), -math.inf)
        self.last = np.zeros((n, n))
        self.e = np.full((n, n), math.nan)
        self.before = np.full((n, n), -1)
        self.gap = np.zeros((n, n), dtype=bool)
        self.unheard = np.zeros((n, n), dtype=np.int64)

    def extend(self, i: int) -> None:
        """Extend trains by all flights that begin at click i; the arrays of the class take the
        results.

        The trains that end at click i have to be known: clicks are taken in the order of time.
        """
        flight = self.times - self.times[i]
        to = np.flatnonzero((flight >= self.shortest) & (flight <= _LONGEST))
        if not to.size:
            return
        flight = flight[to]
        inside = self._inside(i, to)
        louder = np.maximum(self.level[to] - self.level[i], 0.0) / _LOUDNESS
        of_two = self.worth[i] + self.worth[to]
        # A train that begins with this flight, whose length may be any up to the longest.
        self.score[i, to] = of_two - math.log(_LONGEST) - 0.5 * np.minimum(louder**2, _CUT) - inside
        self.last[i, to] = flight
        # Clicks at which a flight to click i begins.
        heard = np.flatnonzero(self.score[:, i] > -math.inf)
        if heard.size:
            for gap in (False, True):
                self._extend_from(heard, i, to, flight, inside, gap)

    def _extend_from(
        self, heard: Indices, i: int, to: Indices, flight: Floats, inside: Floats, gap: bool
    ) -> None:
        """Extend trains that come to click i from clicks `heard` (h,) by flights to clicks `to`
        (t,).

        flight: (t,), s.
        inside: (t,), the price of clicks within it.
        gap: a touch within it is unheard.
        A train replaces the one known for a flight where its score is higher.
        """
        last = self.last[heard, i][:, None]
        e_before = self.e[heard, i][:, None]
        change = self.level[to] - self.level[i]
        ratio = flight / last
        e = ratio
        unheard = 0.0
        if gap:
            # Both flights last e + e² times the last: e is the root of that.
            e = 0.5 * (np.sqrt(1.0 + 4.0 * ratio) - 1.0)
            unheard = _UNHEARD
        gain = self._ln_step(e, e_before, last) + _ln_loud(change, e, gap) - unheard
        allowed = (e >= _LEAST_E) & (e <= _MOST_E)
        if gap:
            allowed &= (self.unheard[heard, i] < _MOST_UNHEARD)[:, None] & ~np.isnan(e_before)
        score = self.score[heard, i][:, None] + self.worth[to] + gain - inside
        score = np.where(allowed, score, -math.inf)
        best = score.argmax(axis=0)
        top = score[best, np.arange(len(to))]
        better = top > self.score[i, to]

        j = to[better]
        h = heard[best[better]]
        e_now = e[best, np.arange(len(to))][better]
        self.score[i, j] = top[better]
        self.e[i, j] = e_now
        self.before[i, j] = h
        self.last[i, j] = flight[better]
        if gap:
            # A gap is two flights with an unheard touch between; the later one is e times the
            # earlier.
            self.last[i, j] = flight[better] * (e_now / (1.0 + e_now))
        self.gap[i, j] = gap
        self.unheard[i, j] = self.unheard[h, i] + gap

    def _ln_step(self, e: Floats, e_before: Floats, flight_before: Floats) -> Floats:
        """ln of the density, 1/s, of a flight's length: e goes on smoothly; the first e may be any.

        e, e_before: that this flight means, and that of the impact before, NaN for none;
        flight_before: s. All broadcast.
        Most impacts scatter normally, a share _WILD of them _WILDER times as much.
        """
        is_first = np.isnan(e_before)
        e_before = np.where(is_first, 0.5, e_before)
        rise = (1.0 - e_before) ** 2
        sd = np.hypot(
            1.5 * np.hypot(_SCATTER, 2.5 * self.limits.timing / flight_before), _RISE_SD * rise
        )
        away = e - e_before - _RISE * rise
        smooth = np.logaddexp(
            math.log(1.0 - _WILD) + _ln_normal(away, sd),
            math.log(_WILD) + _ln_normal(away, _WILDER * sd),
        )
        return np.asarray(np.where(is_first, 0.0, smooth) - np.log(flight_before))

    def _inside(self, i: int, to: Indices) -> Floats:
        """The price, shape (t,), of clicks within the flight from i to each of `to`, shape (t,).

        Only clicks count that are nearly as loud as the louder end of the flight.
        """
        after = self.times > self.times[i] + _INSIDE_FROM
        limit = np.maximum(self.level[i], self.level[to]) - _INSIDE
        counted = (
            after
            & (self.times < self.times[to][:, None] - self.shortest)
            & (self.level > limit[:, None])
        )
        return np.asarray(np.minimum(counted.sum(axis=1), _MOST_INSIDE), dtype=float)

    def last_that_counts(self, i: int, j: int) -> tuple[int, int]:
        """The last flight of a train that ends with this one, without last clicks that add little.

        i, j: numbers of the clicks that begin and end the flight; so are the two returned.
        """
        # A click this weak is one of many: as many again are too weak to be seen.
        weak = self.level.min() + _AS_LOUD
        while (h := int(self.before[i, j])) >= 0:
            least = self.limits.gain
            if self.level[j] < weak:
                least = self.limits.gain_of_weak
            if self.score[i, j] - self.score[h, i] > least:
                break
            i, j = h, i
        return i, j

    def walk_back(self, i: int, j: int) -> Train:
        """The train that ends with the flight from click i to click j, without last clicks that are
        echoes.
        """
        score = float(self.score[i, j])
        # Clicks from the last to the first: the best train is found from its end.
        clicks = [j, i]
        gaps = []
        while True:
            # An unheard touch makes two flights of one.
            gaps.append(1 + int(self.gap[i, j]))
            h = int(self.before[i, j])
            if h < 0:
                break
            clicks.append(h)
            i, j = h, i
        at = np.array(clicks[::-1])
        numbers = np.concatenate([[0], np.cumsum(gaps[::-1])]).astype(np.int64)
        while len(at) > 2 and _ends_in_echo(self.times, at):
            at = at[:-1]
            numbers = numbers[:-1]
        return Train(at, numbers, score)


def _ln_normal(away: Floats, sd: Floats) -> Floats:
    return np.asarray(-0.5 * (away / sd) ** 2 - np.log(sd * math.sqrt(2.0 * math.pi)))


def _ln_loud(change: Floats, e: Floats, gap: bool) -> Floats:
    """ln of the odds of a touch against clutter by the change of level, dB: loudness goes as speed.

    change: of level over the flight, dB; e: that the flight would mean; both broadcast.
    gap: a touch within the flight is unheard.
    """
    impacts = 1.0
    if gap:
        # Another impact, unheard, lies between the two.
        impacts = 2.0
    away = (change - 20.0 * np.log10(np.maximum(e, 0.05)) * impacts) / _LOUDNESS
    return np.asarray(
        math.log(_LOUDEST / (_LOUDNESS * math.sqrt(2.0 * math.pi)))
        - 0.5 * np.minimum(away**2, _CUT)
    )


def _ends_in_echo(times: Floats, clicks: Indices) -> bool:
    """Say whether the last click of a train is an echo: clicks elsewhere follow two touches as
    closely.

    times: of all clicks, s.
    clicks: (n,), those of the train, 3 or more.
    """
    delay = times[clicks[-1]] - times[clicks[-2]]
    others = np.delete(times, clicks)
    if not others.size:
        return False
    off = np.abs(others[:, None] - times[clicks[:-2]] - delay).min(axis=0)
    return int((off < _SAME).sum()) >= 2
