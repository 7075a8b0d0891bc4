"""Clicks in a recording, when each began, and why they may not be the ball's touches."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import butter, find_peaks, resample_poly, sosfilt

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.estimate import Estimate
    from hcbench.terms.impact import Floats

# Clicks in a recording, in bands above several frequencies, and when each began.

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from hcbench.fitting.recording import Recording
    from hcbench.terms.impact import Floats

    Indices = NDArray[np.int64]

# Lower and upper ends of the bands, Hz: ringing and speech are low and clicks reach high, but so
# does noise.
_BANDS = ((1200.0, None), (4000.0, None), (8000.0, None), (1200.0, 5000.0), (500.0, 2500.0))
# A click is louder for this long than the sound just before it, s.
_NEXT = 0.6e-3
# The sound before it is averaged over this time, s.
_LAST = 4e-3
# Ratio of the two energies from which on there is a click.
_RISE = 2.5
# A click has this multiple of the noise's energy, at least.
_OVER_NOISE = 6.0
# Shortest time between two clicks, s.
_APART = 6e-3
# Clicks that are kept, the loudest: the search takes their number squared.
_MOST_CLICKS = 150
# Correlation finds a click's time to a part of a sample.
_OVERSAMPLING = 4


@dataclass(frozen=True, slots=True)
class FrequencyBand:
    """Part of a sound in one band of frequencies (Hz), with its clicks.

    sound: (n,), filtered; rate: Hz.

    places, level: (m,), samples at which clicks are, and how loud each is, dB over the noise.
    """

    frequency: float
    sound: Floats
    rate: int
    places: Indices
    level: Floats

    @property
    def duration(self) -> float:
        """Duration of the sound, s."""
        return len(self.sound) / self.rate


def bands(recording: Recording) -> Iterator[FrequencyBand]:
    """The recording above each frequency that its rate allows."""
    for frequency, upper in _BANDS:
        if (upper or frequency) > 0.4 * recording.rate:
            continue
        filtered = _filtered(recording, frequency, upper)
        places, level = _clicks(filtered, recording.rate, recording.step)
        yield FrequencyBand(frequency, filtered, recording.rate, places, level)


def _filtered(recording: Recording, lower: float, upper: float | None) -> Floats:
    """The sound above `lower`, Hz, and below `upper`, if given: shape (n,), without a look
    ahead.
    """
    if upper is None:
        sections = butter(4, lower, "highpass", fs=recording.rate, output="sos")
    else:
        sections = butter(4, [lower, upper], "bandpass", fs=recording.rate, output="sos")
    return np.asarray(sosfilt(sections, recording.sound))


def _clicks(sound: Floats, rate: int, step: float) -> tuple[Indices, Floats]:
    """Samples at which something begins that is louder than before, and how
    loud it is, dB over the noise.
    """
    ahead = max(4, round(_NEXT * rate))
    back = round(_LAST * rate)
    # Computed in place: for a long recording these arrays take most of the memory.
    energy = np.zeros(len(sound) + 1)
    np.cumsum(np.square(sound, out=energy[1:]), out=energy[1:])
    after = np.subtract(energy[back + ahead : -1], energy[back : -1 - ahead])
    before = np.subtract(energy[back : -1 - ahead], energy[: -1 - ahead - back])
    del energy
    after /= ahead
    # A recording of few bits is silent between its steps: a step is added to the noise.
    noise = float(np.percentile(after[::4], 25)) + step**2 + 1e-30
    before /= back
    before += 0.3 * noise
    rise = np.divide(after, before, out=before)
    rise[after < _OVER_NOISE * noise] = 0.0
    peaks, _ = find_peaks(rise, height=_RISE, distance=max(1, round(_APART * rate)))
    loud = after[peaks]
    kept = np.sort(np.argsort(-loud)[:_MOST_CLICKS])
    return back + peaks[kept], 10.0 * np.log10(loud[kept] / noise)


class Timer:
    """Times of clicks: by Akaike's criterion (Maeda 1985), then by correlation with the train's
    mean.
    """

    def __init__(self, band: FrequencyBand, places: Indices) -> None:
        """Time the clicks of one train in a band.

        places: (n,), samples at which the train's clicks are.
        """
        self.band = band
        self._times: dict[int, float] = {}
        pieces = [self._piece(self._onset_of(int(p))) for p in places]
        shifts = np.zeros(len(pieces))
        # The template is the mean of the aligned pieces, and the pieces align to the template.
        for _ in range(3):
            aligned = map(_shifted, pieces, shifts)
            self.template = np.mean(list(aligned), axis=0)
            for k, piece in enumerate(pieces):
                shifts[k] = _shift_to(self.template, piece, self._reach)
            shifts -= np.median(shifts)

    def times(self, places: Indices) -> Floats:
        """Times of clicks at any places, s: shape (n,)."""
        return np.array([self._time(int(p)) for p in places]) / self.band.rate

    def _time(self, place: int) -> float:
        """Time of a click, in samples; each is found once."""
        if place not in self._times:
            onset = self._onset_of(place)
            shift = _shift_to(self.template, self._piece(onset), self._reach)
            self._times[place] = onset + shift / _OVERSAMPLING
        return self._times[place]

    @property
    def _reach(self) -> int:
        return round(0.25e-3 * self.band.rate) * _OVERSAMPLING

    def _onset_of(self, place: int) -> int:
        return _onset(self.band.sound, self.band.rate, place)

    def _piece(self, onset: int) -> Floats:
        """The click from 0.3 ms before its onset to 1.2 ms after, oversampled, of energy 1.

        onset: sample of the sound. A margin of 0.5 ms is kept at either end, for shifts.
        """
        before = round(0.3e-3 * self.band.rate)
        after = round(1.2e-3 * self.band.rate)
        margin = before + round(0.5e-3 * self.band.rate)
        piece = self.band.sound[max(0, onset - margin) : onset + after + margin]
        piece = np.pad(piece, (max(0, margin - onset), max(0, after + 2 * margin - len(piece))))
        fine = resample_poly(piece[: after + 2 * margin], _OVERSAMPLING, 1)
        return np.asarray(fine / (np.sqrt((fine**2).sum()) + 1e-30))


def _onset(sound: Floats, rate: int, place: int) -> int:
    """The sample that parts noise from click, near a sample `place` of the sound.

    It is the k at which k ln var(before) + (n - k) ln var(after) is least (Maeda 1985).

    sound: shape (samples,).
    rate: samples a second.
    """
    first = max(0, place - round(2.5e-3 * rate))
    window = sound[first : place + round(0.8e-3 * rate)]
    n = len(window)
    k = np.arange(4, n - 4)
    sums = np.cumsum(window)
    squares = np.cumsum(window**2)
    left = squares[k - 1] / k - (sums[k - 1] / k) ** 2
    right = (squares[-1] - squares[k - 1]) / (n - k) - ((sums[-1] - sums[k - 1]) / (n - k)) ** 2
    criterion = k * np.log(left + 1e-30) + (n - k) * np.log(right + 1e-30)
    return first + int(k[int(np.argmin(criterion))])


def _shifted(piece: Floats, shift: float) -> Floats:
    return np.asarray(np.interp(np.arange(len(piece)) + shift, np.arange(len(piece)), piece))


def _shift_to(template: Floats, piece: Floats, reach: int) -> float:
    """Delay of a piece against the template, in samples, refined by a parabola to fractions of one.

    template, piece: shape (n,).
    reach: largest delay, samples. A maximum at the end of the reach is not refined.
    """
    core = template[reach : len(template) - reach]
    score = np.correlate(piece, core, "valid")
    top = int(np.argmax(score))
    if not 0 < top < len(score) - 1:
        return float(top - reach)
    left, middle, right = score[top - 1 : top + 2]
    curvature = left - 2.0 * middle + right
    if curvature == 0.0:
        return float(top - reach)
    return float(top - reach + 0.5 * (left - right) / curvature)


# Touches heard in a recording, and why they may not be the ball's.

# Touches of a train that rivals the first one, at least.
_RIVAL_TOUCHES = 5
# Largest scatter of e of a rival.
_RIVAL_SCATTER = 0.03
# Standard deviations by which a rival's α differs, at least.
_RIVAL_APART = 3.0
# Share of the first train's α by which a rival's α differs, at least.
_RIVAL_SHARE = 0.02
# A lower score, as ln odds, is hardly more regular than noise.
_LEAST_SCORE = 10.0
# Touches that a fit needs.
_LEAST_TOUCHES = 6
# Largest scatter of e: that of a ball is 0.1 to 2 %.
_MOST_SCATTER = 0.02
# m/s: a fall of 1.8 m. A faster first impact needs a height that the user gives.
_MOST_SPEED = 6.0


# No law is chosen below this score: 1 in 20 of such trains is not the ball's.
_SURE_SCORE = 25.0


@dataclass(frozen=True, slots=True)
class Picks:
    """Touches heard.

    times: (n,), s.
    numbers: (n,), which touch each is, from 0: some may be unheard.

    level: (n,), dB over the noise.
    band: Hz, above which they were looked for.
    score: ln of the likelihood ratio of one ball against clutter.
    scatter, alpha: of a fit to them alone; None where they are too few.
    """

    times: Floats
    numbers: Indices
    level: Floats
    band: float
    score: float = math.inf
    scatter: float | None = None
    alpha: Estimate | None = None

    def taken(self, touches: range) -> Picks:
        """The picks of these touches of the list, counted from 1."""
        kept = np.isin(np.arange(1, len(self.times) + 1), touches)
        return replace(
            self, times=self.times[kept], numbers=self.numbers[kept], level=self.level[kept]
        )


def rivals(heard: Sequence[Picks]) -> list[Picks]:
    """Trains that may be the ball's as well as the first, and give another α."""
    best, others = heard[0], []
    for other in heard[1:]:
        if best.alpha is None or other.alpha is None or other.scatter is None:
            continue
        if len(other.times) < _RIVAL_TOUCHES or other.scatter > _RIVAL_SCATTER:
            continue
        off = abs(other.alpha.value - best.alpha.value)
        sd = math.hypot(other.alpha.uncertainty, best.alpha.uncertainty)
        if off > max(_RIVAL_APART * sd, _RIVAL_SHARE * best.alpha.value):
            others.append(other)
    return others


def reservation_of(heard: Sequence[Picks]) -> str:
    """Reason to choose no law although the first train is likely the ball's; "" without one."""
    best = heard[0]
    if best.score >= _SURE_SCORE:
        return ""
    odds = f"ln odds {best.score:.0f}"
    return f"the touches are likely, not surely, the ball's ({odds}): look at --page, then take --touches A"


def doubts_of(
    heard: Sequence[Picks], scatter: float, fastest: float, height_given: bool
) -> list[str]:
    """Reasons to doubt that the first train is the ball's; with any, the fit gives no number.

    scatter: of e, 1.
    fastest: impact speed, m/s.
    """
    best, reasons = heard[0], []
    if best.score < _LEAST_SCORE:
        reasons.append("the clicks are hardly more regular than noise")
    if len(best.times) < _LEAST_TOUCHES:
        reasons.append(f"only {len(best.times)} touches are heard, and {_LEAST_TOUCHES} are needed")
    if scatter > _MOST_SCATTER:
        reasons.append(
            f"e varies by {100 * scatter:.2g} % from bounce to bounce, a ball's by 0.1 to 2 %"
        )
    if fastest > _MOST_SPEED and not height_given:
        reasons.append(
            f"the first impact would be at {fastest:.2g} m/s; give --height for a fall that high"
        )
    if rivals(heard):
        reasons.append("another train of clicks gives another α")
    return reasons
