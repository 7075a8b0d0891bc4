"""Times of impacts from a sound recording: clicks, the train of bounces among them, and when each began."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.io import wavfile
from scipy.signal import butter, find_peaks, resample_poly, sosfilt

from hcbench._text import sanitized
from hcbench.errors import UserError
from hcbench.fitting.bounce_search import longest_train

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from hcbench.impact import Floats

    Indices = NDArray[np.int64]

_BANDS = (1200.0, 4000.0, 8000.0)  # Hz: ringing and speech are low, clicks reach high
_NEXT, _LAST = 0.6e-3, 4e-3  # s: a click is what is louder for this long than before it
_RISE = 2.5
_OVER_NOISE = 6.0
_APART = 6e-3  # s
_MOST_CLICKS = 150
_LONGEST = 120.0  # s
_OVERSAMPLING = 4


@dataclass(frozen=True, slots=True)
class Recording:
    """sound: (n,), one channel, -1 ... 1. rate: Hz. step: between two values that a sample can have."""

    name: str
    sound: Floats
    rate: int
    step: float = 0.0


@dataclass(frozen=True, slots=True)
class Picks:
    """Touches heard. times: (n,), s. numbers: (n,), which touch each is, from 0: one may be unheard.

    level: (n,), dB over the noise. band: Hz, above which they were looked for.
    """

    times: Floats
    numbers: Indices
    level: Floats
    band: float


def is_wav(path: Path) -> bool:
    """Whether a file begins as WAV files do, under any name; False where it cannot be read."""
    try:
        with path.open("rb") as file:
            head = file.read(12)
    except OSError:
        return False
    return head[:4] in (b"RIFF", b"RIFX", b"RF64") and head[8:12] == b"WAVE"


def read_recording(path: Path) -> Recording:
    """A WAV file: integers of 8 to 32 bits or floats; of several channels the loudest.

    Raises UserError for what is no such file, has no sound, or is too long.
    """
    name = sanitized(path.name)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # chunks that it does not know
            rate, samples = wavfile.read(path)
    except Exception as error:  # damaged headers raise what they like
        what = sanitized(error).rstrip(".")
        raise UserError(name, f"cannot be read as WAV: {what}", "a WAV recording, PCM or float") from None
    sound = np.atleast_2d(np.asarray(samples).T).astype(float)
    if samples.dtype.kind != "f":
        middle = 128.0 if samples.dtype == np.uint8 else 0.0
        sound = (sound - middle) / (middle or float(np.iinfo(samples.dtype).max))
    if not np.isfinite(sound).all():
        raise UserError(name, "samples that are not finite", "a recording")
    if not sound.size or not rate or sound.shape[1] < 0.2 * rate:
        raise UserError(
            name, f"{sound.shape[-1] / max(rate, 1):.2g} s of sound", "a recording of several bounces"
        )
    if sound.shape[1] > _LONGEST * rate:
        got = f"{sound.shape[1] / rate:.0f} s of sound"
        raise UserError(name, got, f"up to {_LONGEST:g} s", "Cut out the bounces of one drop")
    if rate < 8000:
        raise UserError(name, f"{rate} samples a second", "8000 or more")
    loudest = sound[int(np.argmax(sound.std(axis=1)))]
    if not loudest.std() > 0:
        raise UserError(name, "silence", "a recording of several bounces")
    step = 0.0 if samples.dtype.kind == "f" else 2.0 ** (1 - 8 * samples.dtype.itemsize)
    return Recording(name, loudest - loudest.mean(), int(rate), step)


def find_touches(recording: Recording, shortest: float = 0.02) -> Picks:
    """The longest train of bounces, timed. shortest: s between touches, below which the train ends.

    Raises UserError where there are not three clicks that can be bounces of one ball.
    """
    best: tuple[float, Any] = (0.0, None)
    for band in _BANDS:
        if band > 0.4 * recording.rate:
            break
        filtered = _high_pass(recording, band)
        places, level = _clicks(filtered, recording.rate, recording.step)
        train, numbers, score = longest_train(places / recording.rate, level, shortest)
        if score > best[0]:
            best = score, (places[train], level[train], numbers, band, filtered)
    if best[1] is None or len(best[1][0]) < 3:
        raise UserError(
            recording.name,
            "no train of bounces is heard",
            "clicks of one ball, each flight shorter than the one before",
            "Record nearer to the plate and in quiet, or give the times in a file",
        )
    places, level, numbers, band, filtered = best[1]
    times = _timed(filtered, recording.rate, places)
    return Picks(times, numbers, level, band)


def _high_pass(recording: Recording, band: float) -> Floats:
    filtered = sosfilt(butter(4, band, "highpass", fs=recording.rate, output="sos"), recording.sound)
    return np.asarray(filtered)


def _clicks(sound: Floats, rate: int, step: float) -> tuple[Indices, Floats]:
    """Samples at which something begins that is louder than before, and how loud it is, dB over the noise."""
    ahead, back = max(4, round(_NEXT * rate)), round(_LAST * rate)
    energy = np.concatenate([[0.0], np.cumsum(sound**2)])
    at = np.arange(back, len(sound) - ahead)
    after = (energy[at + ahead] - energy[at]) / ahead
    before = (energy[at] - energy[at - back]) / back
    noise = float(np.percentile(after, 25)) + step**2 + 1e-30  # few bits are silent between steps
    rise = after / (before + 0.3 * noise)
    rise[after < _OVER_NOISE * noise] = 0.0
    peaks, _ = find_peaks(rise, height=_RISE, distance=max(1, round(_APART * rate)))
    loud = after[peaks]
    kept = np.sort(np.argsort(-loud)[:_MOST_CLICKS])
    return at[peaks[kept]], 10.0 * np.log10(loud[kept] / noise)


def _timed(sound: Floats, rate: int, places: Indices) -> Floats:
    """When each click began, s: by Akaike's criterion (Maeda 1985), then by correlation with their mean."""
    onsets = np.array([_onset(sound, rate, int(p)) for p in places])
    before, after = round(0.3e-3 * rate), round(1.2e-3 * rate)
    reach = round(0.25e-3 * rate) * _OVERSAMPLING
    pieces = []
    for onset in onsets:
        margin = before + round(0.5e-3 * rate)
        piece = sound[max(0, onset - margin) : onset + after + margin]
        piece = np.pad(piece, (max(0, margin - onset), max(0, after + 2 * margin - len(piece))))[
            : after + 2 * margin
        ]
        fine = resample_poly(piece, _OVERSAMPLING, 1)
        pieces.append(fine / (np.sqrt((fine**2).sum()) + 1e-30))
    shifts = np.zeros(len(pieces))
    for _ in range(3):
        template = np.mean([_shifted(p, s) for p, s in zip(pieces, shifts, strict=True)], axis=0)
        shifts = np.array([_shift_to(template, p, reach) for p in pieces])
        shifts -= np.median(shifts)
    return np.asarray((onsets + shifts / _OVERSAMPLING) / rate)


def _onset(sound: Floats, rate: int, place: int) -> int:
    """The sample that parts noise from click: where k ln var(before) + (n - k) ln var(after) is least."""
    first = max(0, place - round(2.5e-3 * rate))
    window = sound[first : place + round(0.8e-3 * rate)]
    n = len(window)
    k = np.arange(4, n - 4)
    sums, squares = np.cumsum(window), np.cumsum(window**2)
    left = squares[k - 1] / k - (sums[k - 1] / k) ** 2
    right = (squares[-1] - squares[k - 1]) / (n - k) - ((sums[-1] - sums[k - 1]) / (n - k)) ** 2
    criterion = k * np.log(left + 1e-30) + (n - k) * np.log(right + 1e-30)
    return first + int(k[int(np.argmin(criterion))])


def _shifted(piece: Floats, shift: float) -> Floats:
    return np.asarray(np.interp(np.arange(len(piece)) + shift, np.arange(len(piece)), piece))


def _shift_to(template: Floats, piece: Floats, reach: int) -> float:
    """By how many samples a piece lies after the template, to fractions of one."""
    core = template[reach : len(template) - reach]
    score = np.correlate(piece, core, "valid")
    top = int(np.argmax(score))
    if not 0 < top < len(score) - 1:
        return float(top - reach)
    left, middle, right = score[top - 1 : top + 2]
    curvature = left - 2.0 * middle + right
    return top - reach + (0.5 * (left - right) / curvature if curvature else 0.0)
