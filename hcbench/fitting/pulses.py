"""Touches as pulses of a signal: pushes on a plate, shakes of a table, bursts of a sensor's voltage.

Sounds ring at kilohertz, and their onsets are heard in bands of frequency (`recording`). A pulse is
found at any rate of samples: by the energy that it has over the quiet about it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.recording import LEAST_RATE, FrequencyBand, bands
from hcbench.fitting.setup import Known

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from hcbench.fitting.recording import Indices, Recording
    from hcbench.terms.impact import Floats

# The zero of a signal is its median over this time, s: longer than pulses, shorter than drift.
_OF_ZERO = 0.16
# Samples a second in which the zero is looked for.
_ZERO_RATE = 2000.0
# Times over which energy is averaged, s: bursts of ultrasound, rings, pushes.
_LENGTHS = (0.2e-3, 1.5e-3, 5e-3)
# Chance that noise of a sample passes for a pulse.
_CHANCE = 1e-7
# Energy of a pulse over that of the third quarter of all samples, at least.
_OVER_USUAL = 2.0
# The same over the largest energy: a signal without noise has ripples of rounding.
_OF_LARGEST = 1e-6
# Times above the limit that are nearer than this, s, or than so many samples, are one pulse.
_ONE = 14e-3
_ONE_SAMPLES = 2
# Samples of a pulse count for its time and its shape from this share of its energy on.
_COUNTED = 0.02
# Share of a push, in time, in which its energy counts: sin^3 is above 0.02 there.
_COUNTED_SHARE = 0.82
# Samples of a push that show how long it lasts, at least.
_RESOLVED = 4.0
# Share of the pulses that go to one side where they are pushes.
_MOST_OF_THEM = 0.7
# dB by which a pulse of another ball may be smaller than the least touch.
_SMALLER = 6.0
# A touch rings for so long at most, s.
_RINGS = 45e-3
# Pulses that are kept, the largest.
_MOST = 150
# A push goes to one side: of its size, at least this share.
_ONE_SIDED = 0.8
# Mean of a push over its largest value, sin^1.5: between Hertz's and a half sine.
_MEAN_SHARE = 0.556
# Error of a pulse's time, as a share of the time between two samples.
_OF_SAMPLE = 0.2
# Standard uncertainty of a contact's duration by the area of its push, as a share.
_OF_CONTACT = 0.1


@dataclass(frozen=True, slots=True)
class Pulses(FrequencyBand):
    """A signal with its zero removed and the pulses in it, as a band with clicks.

    times: (m,), s, the middle of each pulse's energy.
    size: (m,), each pulse's area over time, in the signal's unit times s.
    contact: duration of the largest push, s; NaN where pulses swing to both sides.
    """

    times: Floats
    size: Floats
    contact: float

    @property
    def contact_time(self) -> Known | None:
        """Duration of the largest push, s; None where pulses swing to both sides."""
        if math.isnan(self.contact):
            return None
        if self.contact * self.rate < _RESOLVED:
            # A hard ball's tap, smeared over a sample or two, looks the same.
            return Known(0.5 * self.contact, 0.5 * self.contact)
        return Known(self.contact, _OF_CONTACT * self.contact)

    @property
    def resolution(self) -> float:
        """Error of a pulse's time, s, that cannot be smaller: a part of a sample."""
        return _OF_SAMPLE / self.rate

    def timer(self, places: Indices) -> Callable[[Indices], Floats]:
        """A function from samples of pulses to their times, s: the same for any train."""

        def times(at: Indices) -> Floats:
            return np.asarray(self.times[np.searchsorted(self.places, at)])

        return times

    def sizes(self, places: Indices) -> Floats | None:
        """Areas of the pulses at `places` over time, (k,); None where they swing to both sides."""
        if math.isnan(self.contact):
            return None
        return np.asarray(self.size[np.searchsorted(self.places, places)])

    def others(self, places: Indices) -> tuple[int, int]:
        """Pulses between the first and the last of `places`, and before and after these, that are nearly
        as large as the least of them and do not ring on after one: another ball's, or another thing's.
        """
        least = float(self.level[np.searchsorted(self.places, places)].min())
        after = self.places[:, None] - places
        rings = ((after >= 0) & (after < _RINGS * self.rate)).any(axis=1)
        counted = (self.level >= least - _SMALLER) & ~rings
        within = (self.places > places[0]) & (self.places < places[-1])
        return int((counted & within).sum()), int((counted & ~within).sum())


def bands_of(recording: Recording) -> Iterator[FrequencyBand]:
    """Bands with the clicks of a recording, where its rate allows, and with the pulses of a signal."""
    if recording.rate >= LEAST_RATE:
        yield from bands(recording)
    if recording.what:
        yield from pulses_of(recording)


def pulses_of(signal: Recording) -> Iterator[Pulses]:
    """The signal with its pulses, for each time over which energy is averaged; without any where a
    signal has none.
    """
    away = signal.sound - _zero(signal.sound, signal.rate)
    noise = 1.4826 * float(np.median(np.abs(away)))
    # Coarse numbers stand still in quiet: then their step is all that is known of the noise.
    steps = np.abs(np.diff(np.unique(signal.sound)))
    if len(steps):
        noise = max(noise, 0.3 * float(steps.min()))
    widths = {max(1, round(length * signal.rate)) for length in _LENGTHS}
    for width in sorted(widths):
        found = _with_width(away, signal.rate, noise, width)
        if found is not None:
            yield found


def _zero(values: Floats, rate: float) -> Floats:
    """The zero of a signal at each sample, (n,): its running median, through drift and steps."""
    from scipy.ndimage import median_filter

    block = max(1, int(rate / _ZERO_RATE))
    count = len(values) // block
    coarse = np.median(values[: count * block].reshape(count, block), axis=1)
    width = max(5, round(_OF_ZERO * rate / block)) | 1
    middle = median_filter(coarse, size=min(width, count), mode="nearest")
    at = (np.arange(count) + 0.5) * block - 0.5
    return np.interp(np.arange(len(values)), at, middle)


def _with_width(away: Floats, rate: float, noise: float, width: int) -> Pulses | None:
    """The pulses whose energy, averaged over `width` samples, stands out; None for none.

    away: the signal without its zero, (n,).
    rate: Hz.
    noise: its standard deviation in quiet, above 0.
    width: in samples.
    """
    from scipy.ndimage import uniform_filter1d
    from scipy.special import chdtri

    energy = uniform_filter1d(away**2, width, mode="nearest")
    limit = noise**2 * float(chdtri(width, _CHANCE)) / width
    usual = float(np.percentile(energy, 75))
    limit = max(limit, _OVER_USUAL * usual, _OF_LARGEST * float(energy.max()))
    above = np.flatnonzero(energy > limit)
    if not above.size:
        return None
    gap = max(_ONE_SAMPLES, round(_ONE * rate))
    parts = np.split(above, np.flatnonzero(np.diff(above) > gap) + 1)
    runs = [slice(max(0, part[0] - width), part[-1] + 1 + width) for part in parts]
    tops = np.array([energy[run].max() for run in runs])
    kept = np.sort(np.argsort(-tops)[:_MOST])
    pulses = [_Pulse.of(away, runs[k]) for k in kept]
    places = np.array([pulse.place for pulse in pulses])
    return Pulses(
        frequency=0.0,
        sound=away,
        rate=rate,
        places=places,
        level=10.0 * np.log10(tops[kept] / noise**2),
        times=np.array([pulse.middle for pulse in pulses]) / rate,
        size=np.array([abs(pulse.area) for pulse in pulses]) / rate,
        contact=_contact(pulses) / rate,
    )


def _contact(pulses: Sequence[_Pulse]) -> float:
    """Samples that the largest push takes; NaN where most pulses swing to both sides."""
    largest = max(pulses, key=lambda pulse: abs(pulse.area))
    one_sided = float(np.mean([pulse.is_one_sided for pulse in pulses]))
    if one_sided < _MOST_OF_THEM:
        return math.nan
    # A push that is clipped is too flat for the first, and noise too wide for the second.
    return min(abs(largest.area) / (_MEAN_SHARE * largest.top), largest.count / _COUNTED_SHARE)


@dataclass(frozen=True, slots=True)
class _Pulse:
    """One pulse, in samples and the signal's unit.

    place: sample of the largest value.
    middle: that of its energy's middle, with a fraction.
    area: sum over its samples.
    top: largest value, of either sign.
    count: of samples that count.
    """

    place: int
    middle: float
    area: float
    top: float
    count: int
    is_one_sided: bool

    @classmethod
    def of(cls, away: Floats, run: slice) -> _Pulse:
        """The pulse in a run of samples of the signal without its zero."""
        piece = away[run]
        energy = piece**2
        place = int(np.argmax(energy))
        counted = energy > _COUNTED * energy[place]
        at = np.arange(len(piece))
        middle = float((at * energy)[counted].sum() / energy[counted].sum())
        area = float(piece.sum())
        is_one_sided = abs(area) > _ONE_SIDED * float(np.abs(piece).sum())
        return cls(
            place=run.start + place,
            middle=run.start + middle,
            area=area,
            top=math.sqrt(float(energy[place])),
            count=int(counted.sum()),
            is_one_sided=is_one_sided,
        )
