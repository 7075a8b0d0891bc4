"""From a recording to the touches of one ball, and how sure it is that these are they.

Several trains of clicks are kept, each is fitted, and the choice among
them is by how smoothly e goes on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.bounce_search import likeliest_trains, trains_in_quiet
from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.estimate import alpha_of, fit_law
from hcbench.fitting.misfits import flagged_touches, gains_by_moving
from hcbench.fitting.pulses import bands_of, pulses_of
from hcbench.fitting.recording import Picks, bands
from hcbench.fitting.which_law import LAWS, PLAIN, WITH_E0
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from hcbench.fitting.bounce_search import Train
    from hcbench.fitting.linear import LawFit
    from hcbench.fitting.recording import FrequencyBand, Indices, Recording
    from hcbench.fitting.setup import Known, MeasurementSetup
    from hcbench.terms.impact import Floats

# A train ends where its touches come faster than this, s.
SHORTEST = 0.02
# Longest contact of a ball that bounces, s: large soft ones take the longest.
LONGEST_CONTACT = 0.05
# Pulses that an error names.
_SHOWN = 6
# Error of a click's time in a signal, s, at least.
_TIMING = 2e-4
# Trains that are kept for a comparison.
_MOST = 6
# Clicks of two frequency bands within this time are one touch, s.
_SAME = 2e-3
# Two trains with this share of their touches in common are one.
_SHARED = 0.7
# A click this near to a touch may be the touch in its place, s.
_NEAR = 45e-3
# dB by which such a click may be quieter.
_QUIETER = 15.0
# dB: an earlier click that is at most this much quieter is likely the touch, the later one its
# echo.
_NOT_MUCH_QUIETER = 6.0
# Rounds in which touches are exchanged for clicks near them.
_SWAPS = 4
# Exchanges that each round fits: the likeliest by a first-order estimate.
_TRIED = 2
# Scatter of e from which on a touch may be left out.
_ROUGH = 8e-3
# Leaving out a touch must divide the scatter by this.
_SMOOTHER = 1.6
# First clicks that may be knocks instead of the ball's, at most.
_KNOCKS = 2
# Leaving out such clicks must divide the scatter by this.
_FAR_SMOOTHER = 2.0
# Touches that must remain where some are left out.
_LEAST_LEFT = 5
# A train with at least this share of the best score may replace the best train.
_CLOSE = 0.7
# Such a train must scatter by at most this share of the best one.
_SMOOTH = 0.5
# A train below this share of the best score does not rival the best one.
_HALF = 0.5


def listen(recording: Recording, setup: MeasurementSetup) -> list[Picks]:
    """Find the trains of touches that may be the ball's, the most likely first.

    Raises UserError for fewer than three clicks that can be bounces of one ball, and where no law
    can be fitted to them.
    """
    trains = _trains(recording)
    if not trains:
        raise _no_train(recording)
    try:
        return _ranked([_Heard.of(band, train, setup, recording) for band, train in trains])
    except (ArithmeticError, ValueError):
        got = "clicks that no law of bounces describes"
        raise UserError(recording.name, got, "flights that shrink, as of a ball") from None


def _no_train(recording: Recording) -> UserError:
    """The error for a recording without a train of bounces: of a signal, with its pulses."""
    expected = "touches of one ball, each flight shorter than the one before"
    if not recording.what:
        advice = "Record nearer to the plate and in quiet, or give the times in a file"
        return UserError(recording.name, "no train of bounces is heard", expected, advice)
    found = max(pulses_of(recording), key=lambda band: len(band.times), default=None)
    if found is None:
        got = f"no pulses in {recording.what!r}"
        return UserError(recording.name, got, expected, "Look at the signal, or name another file")
    times = recording.begin + found.times
    shown = ", ".join(f"{time:.3f}" for time in times[:_SHOWN])
    more = ", ..." if len(times) > _SHOWN else ""
    got = f"pulses in {recording.what!r} at {shown}{more} s, and no train of bounces among them"
    return UserError(recording.name, got, expected, "Record one ball that bounces alone")


def _ranked(heard: list[_Heard]) -> list[Picks]:
    """The trains, the one to take first, as `Picks`.

    heard: one or more, the likeliest first. A train that is nearly as likely and smoother takes the
    first place.
    """
    best = heard[0].improved()
    others = []
    for one in heard[1:]:
        is_close = one.train.score > _CLOSE * best.train.score
        # A fit takes long: only trains that may replace the best one get it.
        if is_close:
            others.append(one.improved())
        else:
            others.append(one)
    order = [best, *others]
    for place, other in enumerate(others):
        is_close = other.train.score > _CLOSE * best.train.score
        is_smoother = other.scatter < _SMOOTH * best.scatter
        is_long = len(other.places) >= 0.5 * len(best.places)
        if is_close and is_smoother and is_long:
            order = [other, best, *others[:place], *others[place + 1 :]]
            break
    return [one.picks() for one in order]


def quick_score(recording: Recording) -> float:
    """Score of the likeliest train in the first band alone; 0 for none."""
    band = next(bands(recording))
    trains = likeliest_trains(band.places / band.rate, band.level, band.duration, SHORTEST, 1)
    if not trains:
        return 0.0
    return trains[0].score


def _trains(recording: Recording) -> list[tuple[FrequencyBand, Train]]:
    """Trains in all bands, each with its band, the likeliest first; empty without any.

    Those that share their clicks with a likelier one are left out, and those much less likely than
    the first.
    """
    trains = []
    for band in bands_of(recording):
        times = band.places / band.rate
        if recording.what:
            timing = max(band.resolution, _TIMING)
            found = trains_in_quiet(times, band.level, band.duration, SHORTEST, _MOST, timing)
        else:
            found = likeliest_trains(times, band.level, band.duration, SHORTEST, _MOST)
        trains += [(band, train) for train in found]
    kept: list[tuple[FrequencyBand, Train]] = []
    # Times of the clicks of each that is kept, s.
    kept_times: list[Floats] = []
    for band, train in sorted(trains, key=lambda one: -one[1].score):
        if len(kept) == _MOST:
            break
        times = band.places[train.clicks] / band.rate
        if not any(_is_same(times, likelier) for likelier in kept_times):
            kept.append((band, train))
            kept_times.append(times)
    if not kept:
        return []
    top = kept[0][1].score
    return [one for one in kept if one[1].score >= min(_HALF * top, top)]


def _is_same(times: Floats, better: Floats) -> bool:
    near = np.abs(times[:, None] - better).min(axis=1) < _SAME
    return bool(near.sum() >= _SHARED * min(len(times), len(better)))


@dataclass(frozen=True, slots=True)
class _Heard:
    """One train, timed, and the law with e0 fitted to it.

    places: sample of each touch's click.
    numbers: which touch each is, from 0.
    reference: speed of the fit, m/s.
    fit: None where there are too few touches, or where no law fits them.
    """

    band: FrequencyBand
    train: Train
    timer: Callable[[Indices], Floats]
    setup: MeasurementSetup
    name: str
    places: Indices
    numbers: Indices
    reference: float
    fit: LawFit | None
    # Start of the recording in its file, s.
    begin: float

    @classmethod
    def of(
        cls, band: FrequencyBand, train: Train, setup: MeasurementSetup, recording: Recording
    ) -> _Heard:
        """A train of a recording with its law fitted; without a fit if it has too few touches.

        The reference speed, m/s, lies in the middle of the impact speeds.
        """
        places = band.places[train.clicks]
        start = cls(
            band=band,
            train=train,
            timer=band.timer(places),
            setup=with_contact(setup, band.contact_time),
            name=recording.name,
            places=places,
            numbers=train.numbers,
            reference=1.0,
            fit=None,
            begin=recording.begin,
        )
        if len(places) < setup.least_touches:
            return start
        speeds, _ = start.data().pairs()
        if not len(speeds):
            return start
        return replace(start, reference=float(np.exp(np.log(speeds).mean()))).fitted()

    def data(self) -> TouchTimes:
        return TouchTimes(self.name, self.setup, self.timer(self.places), self.numbers)

    def fitted(self) -> _Heard:
        """The train with the law with e0 fitted to it; without a fit where no law fits."""
        try:
            with np.errstate(all="ignore"):
                return replace(self, fit=fit_law(LAWS[WITH_E0], [self.data()], self.reference))
        except (ArithmeticError, ValueError):
            # No law fits this train.
            return replace(self, fit=None)

    @property
    def evidence(self) -> float:
        """Evidence of the likelier law: e0 alone would bend to a
        reflection in place of the first touch.
        """
        if self.fit is None:
            return -math.inf
        return max(self.fit.log_evidence, self.plain().log_evidence)

    @property
    def scatter(self) -> float:
        """s_e of the fit; infinite without one."""
        if self.fit is None:
            return math.inf
        return self.fit.scatter

    def improved(self) -> _Heard:
        """The train with reflections that were taken for touches exchanged; a touch that spoils all
        left out.

        The train itself where it has too few touches for a fit.
        """
        if self.fit is None:
            return self
        # Knocks go first: swaps would fit the ball's touches to them.
        now = self.without_knocks()
        for _ in range(_SWAPS):
            if (swapped := now.swapped()) is None:
                break
            now = swapped
        if now.scatter > _ROUGH:
            left_out = min((now.without(k) for k in now.suspects()), key=lambda one: one.scatter)
            if left_out.scatter * _SMOOTHER < now.scatter:
                now = left_out
        return now.without_knocks()

    def without_knocks(self) -> _Heard:
        """The train without first clicks that make the others scatter, two at most. It is the train
        itself where no click does, where fewer than five touches would be left, and where the law
        with e0 does not fit the rest.

        The scatter s_e about the law without e0 judges, because e0 bends to such clicks.
        Raises ArithmeticError or ValueError where that law cannot be fitted.
        """
        rough = self.plain().scatter
        for count in range(1, _KNOCKS + 1):
            if len(self.places) - count < _LEAST_LEFT:
                break
            later = replace(
                self, places=self.places[count:], numbers=self.numbers[count:] - self.numbers[count]
            )
            # Many touches of this train are unheard.
            if len(later.data().pairs()[0]) < _LEAST_LEFT - 2:
                break
            if later.plain().scatter * _FAR_SMOOTHER < rough:
                fitted = later.fitted()
                if fitted.fit is not None:
                    return fitted
        return self

    def plain(self) -> LawFit:
        with np.errstate(all="ignore"):
            return fit_law(LAWS[PLAIN], [self.data()], self.reference)

    def suspects(self) -> list[int]:
        """Places in the train of the first two touches, of the flagged ones and of the two worst.

        Each is named once. The train has to have a fit.
        """
        assert self.fit is not None
        data = self.data()
        off = np.abs(self.fit.measured_off()[0])
        worst = np.argsort(-off)[:2].tolist()
        names = data.rows()
        flagged = [
            names.index(f.touch) for f in flagged_touches(self.fit, [data]) if f.touch in names
        ]
        return list(dict.fromkeys([0, 1, *flagged, *worst]))

    def swapped(self) -> _Heard | None:
        """The train with one suspect exchanged for a click near it, if that makes it likelier; else
        None.

        The train has to have a fit.
        """
        assert self.fit is not None
        data = self.data()
        touches = []
        swaps = []
        is_preferred = []
        for k in self.suspects():
            for place, may_be_it in self._clicks_near(k):
                touches.append(k)
                swaps.append(place)
                is_preferred.append(may_be_it)
        if not swaps:
            return None
        prior = np.where(is_preferred, 1.0, -1.0)
        moves = self.timer(np.array(swaps)) - data.times[touches]
        gains = gains_by_moving(self.fit, data, touches, moves) + prior
        for i in np.argsort(-gains)[:_TRIED]:
            if not gains[i] > 0.0:
                continue
            places = self.places.copy()
            places[touches[i]] = swaps[i]
            other = replace(self, places=places).fitted()
            # The gain is of first order: the fit decides.
            if other.evidence - self.evidence + prior[i] > 0.0:
                return other
        return None

    def _clicks_near(self, k: int) -> Iterator[tuple[int, bool]]:
        """Clicks that may be touch k in place of the one taken, and True for those likely to be.

        k: place in the train. A click is given by its sample; none passes the touches before and
        after.
        An echo comes after its touch: so a click before, not much quieter, is likely to be the
        touch.
        """
        clicks = self.band.places
        level = self.band.level
        place = self.places[k]
        # Level of this touch's own click, dB.
        own = float(level[np.searchsorted(clicks, place)])
        # Samples between which it may lie: the touches before and after, or the recording's ends.
        after = -1
        if k > 0:
            after = int(self.places[k - 1])
        before = len(self.band.sound)
        if k + 1 < len(self.places):
            before = int(self.places[k + 1])
        near = (
            (np.abs(clicks - place) < _NEAR * self.band.rate) & (clicks > after) & (clicks < before)
        )
        near &= (level > own - _QUIETER) & (clicks != place)
        for other, loud in zip(clicks[near], level[near], strict=True):
            yield int(other), bool(other < place and loud > own - _NOT_MUCH_QUIETER)

    def without(self, k: int) -> _Heard:
        """The train without one touch."""
        if len(self.places) <= _LEAST_LEFT:
            return self
        places = np.delete(self.places, k)
        numbers = np.delete(self.numbers, k)
        return replace(self, places=places, numbers=numbers - numbers[0]).fitted()

    def picks(self) -> Picks:
        """Touches of the train: times in s from the start of the file, levels in dB, and α of its
        fit.

        Scatter and α are None for a train with too few touches.
        """
        times = self.timer(self.places)
        level = self.band.level[np.searchsorted(self.band.places, self.places)]
        left_out, beside = self.band.others(self.places)
        scatter = alpha = None
        if self.fit is not None:
            scatter = self.fit.scatter
            alpha = alpha_of(self.plain(), self.fit)
        return Picks(
            times=self.begin + times,
            numbers=self.numbers,
            level=level,
            band=self.band.frequency,
            score=self.train.score,
            scatter=scatter,
            alpha=alpha,
            contact_time=self.band.contact_time,
            resolution=self.band.resolution,
            sizes=self.band.sizes(self.places),
            left_out=left_out,
            beside=beside,
        )


def with_contact(setup: MeasurementSetup, seen: Known | None) -> MeasurementSetup:
    """The setup with the duration of the first impact that pulses show, unless the user gives one.

    A contact that is longer than a ball's is left out.
    """
    is_given = setup.contact_time.value > 0.0
    if seen is None or is_given or seen.value > LONGEST_CONTACT:
        return setup
    return replace(setup, contact_time=seen)
