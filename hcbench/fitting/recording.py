"""Sound recordings, one channel of them: WAV read here, what phones write by PyAV."""

from __future__ import annotations

import io
import itertools
import math
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.system.errors import UserError
from hcbench.system.files import why_no_file
from hcbench.system.text import sanitized

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from hcbench.fitting.linear import Estimate
    from hcbench.fitting.setup import Known
    from hcbench.terms.impact import Floats

# Samples a second in which clicks can be heard.
LEAST_RATE = 8000
# A recording up to this length, s, is searched whole, without windows.
_WHOLE = 24.0
# Of a longer recording, the window of this length, s, with the best train is taken.
_WINDOW = 20.0
# Windows overlap by this time, s, so that one of them holds the whole train.
_OVERLAP = 8.0
# Samples that are read at once: a long recording never lies in memory whole.
_BLOCK = 1 << 18
# Bytes at the beginning of a WAV file in which its samples begin, and the largest file without
# their true number.
_LARGEST_HEAD = 1 << 16
_LARGEST_PIPED = 256 << 20
_PHONES = (".m4a", ".mp4", ".mov", ".aac", ".opus", ".ogg", ".oga", ".mp3", ".flac", ".3gp", ".caf", ".amr",
           ".wma", ".webm", ".mkv")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Recording:
    """Sound of one channel, or a window of it, or another signal over time.

    sound: (n,), one channel, -1 ... 1; of a signal, in its own unit.
    rate: Hz.
    step: between two values that a sample can have.
    begin: when in the file it begins, s.
    what: name and unit of a signal; "" for sound.
    """

    name: str
    sound: Floats
    rate: float
    step: float = 0.0
    begin: float = 0.0
    what: str = ""


def is_sound(path: Path) -> bool:
    """Say whether a file begins like a WAV file, or has a suffix of phone recordings.

    False for a pipe, and for a file that cannot be read.
    """
    try:
        if not path.is_file():
            # A pipe can be read once; a recording is read in parts.
            return False
        with path.open("rb") as file:
            head = file.read(12)
    except (OSError, ValueError):
        # ValueError: a name with a null character.
        return False
    return (head[:4] in (b"RIFF", b"RIFX", b"RF64") and head[8:12] == b"WAVE") or _is_of_phone(path)


def _is_of_phone(path: Path) -> bool:
    return path.suffix.lower() in _PHONES


def read_recording(
    path: Path, score: Callable[[Recording], float], begin: float = 0.0, end: float | None = None
) -> Recording:
    """Read WAV (integers of 8 to 32 bits or floats) or a phone's format; the loudest channel of
    several.

    score: how likely a part holds bounces.
    begin, end: s, the part to read; None: to the end. Of more than 24 s the 20 s with the best
    score; no more than that is held in memory.
    Raises UserError for other files, for a rate below 8000 Hz, an `end` before `begin`, less than
    0.2 s, silence, and samples that are not finite.
    """
    name = sanitized(path.name)
    if path.exists() and not path.is_file():
        raise UserError(name, why_no_file(path), "a recording")
    source = _Compressed(path) if _is_of_phone(path) else _Wav(path)
    if source.rate < LEAST_RATE:
        raise UserError(name, f"{source.rate} samples a second", f"{LEAST_RATE} or more")
    first = round(begin * source.rate)
    last = math.inf if end is None else round(end * source.rate)
    if last <= first:
        raise UserError("--to", f"{end:g} s", f"after --from, {begin:g} s")
    best: Recording | None = None
    best_score = -math.inf
    for part in _parts_of(source, name, first, last):
        # A recording that is searched whole needs no score.
        is_whole = best is None and part.is_last
        likely = math.inf if is_whole else score(part.recording)
        if likely > best_score:
            best_score = likely
            best = part.recording
    assert best is not None, "the last part is one"
    return best


class _RecordingPart(NamedTuple):
    """A part of a recording; the last one has what is left."""

    recording: Recording
    is_last: bool


def _parts_of(
    source: _Wav | _Compressed, name: str, first: int, last: float
) -> Iterator[_RecordingPart]:
    """Yield a recording in parts of 20 s that overlap by 8 s, and what is left, up to 24 s.

    first, last: samples, of which the last may be infinite.
    Raises UserError for samples that are not finite, and for less than 0.2 s in all.
    """
    kept = round(_WINDOW * source.rate)
    gone = kept - round(_OVERLAP * source.rate)
    # Shape (channels, samples).
    window = np.zeros((0, 0))
    # The window's first sample, counted from the start of the file.
    at = first
    for block in source.blocks(first, last):
        # Only the first block tells the number of channels.
        window = np.concatenate([window, block], axis=1) if window.size else block
        if not np.isfinite(block).all():
            raise UserError(name, "samples that are not finite", "a recording")
        if window.shape[1] > _WHOLE * source.rate:
            yield _RecordingPart(_one_channel(source, name, window[:, :kept], at), is_last=False)
            window = window[:, gone:].copy()
            at += gone
    is_alone = at == first
    if is_alone and (not window.size or window.shape[1] < 0.2 * source.rate):
        got = f"{window.shape[-1] / source.rate:.2g} s of sound"
        raise UserError(name, got, "a recording of several bounces")
    yield _RecordingPart(_one_channel(source, name, window, at), is_last=True)


def _one_channel(source: _Wav | _Compressed, name: str, sound: Floats, at: int) -> Recording:
    """The loudest channel of sound (channels, samples) that begins with sample `at` of a file.

    Its mean is taken out.
    Raises UserError for silence, unless the part begins later in the file.
    """
    loudest = sound[0]
    if len(sound) > 1:
        loudest = sound[int(np.argmax([channel.std() for channel in sound]))]
    if not loudest.std() > 0 and at == 0:
        raise UserError(name, "silence", "a recording of several bounces")
    return Recording(name, loudest - loudest.mean(), source.rate, source.step, at / source.rate)


class _Wav:
    """Blocks of a WAV file, mapped into memory where its samples allow.

    _middle, _top: numbers of the file that stand for silence, and for 1 above it.
    """

    def __init__(self, path: Path) -> None:
        """Open the file. Raises UserError for what is not a WAV recording.

        rate: samples a second. step: of a sample as it is stored, where `blocks` scales all to
        -1 ... 1; 0 for floating point. SciPy stores 24 bits in the upper bits of 32.
        """
        from scipy.io import wavfile

        with _reading(path, "WAV", "a WAV recording, PCM or float"), warnings.catch_warnings():
            # SciPy warns of chunks that it does not know, such as a title.
            warnings.simplefilter("ignore")
            mended = _with_true_length(path)
            try:
                self.rate, samples = wavfile.read(mended or path, mmap=mended is None)
            except ValueError:
                # Samples of 24 bits cannot be mapped into memory.
                self.rate, samples = wavfile.read(path)
            except UnboundLocalError:
                # SciPy's own, where a chunk is missing.
                raise ValueError("it lacks its format or its samples") from None
        if samples.ndim == 1:
            # One channel.
            self._samples = samples[:, None]
        else:
            self._samples = samples
        self._file: tuple[Path, int, np.dtype[Any]] | None = None
        if isinstance(samples, np.memmap):
            self._file = (path, samples.offset, samples.dtype)
        if samples.dtype.kind == "f":
            self.step = 0.0
            self._middle = 0.0
            self._top = 1.0
        else:
            self.step = 2.0 ** (1 - 8 * samples.dtype.itemsize)
            self._middle = 0.0
            self._top = float(np.iinfo(samples.dtype).max)
            # WAV has 8 bits without a sign, and all others with one.
            if samples.dtype == np.uint8:
                self._middle = 128.0
                self._top = 128.0

    def blocks(self, first: int, last: float) -> Iterator[Floats]:
        """(channels, n), from one sample to another."""
        last = int(min(last, len(self._samples)))
        for at in range(first, last, _BLOCK):
            block = np.asarray(self._read(at, min(at + _BLOCK, last)).T, dtype=float)
            yield (block - self._middle) / self._top

    def _read(self, first: int, last: int) -> NDArray[Any]:
        """Samples `first` up to `last`, (n, channels), as they are stored.

        They come from the file itself, as pages of a map would stay in memory.
        """
        if self._file is None:
            return np.asarray(self._samples[first:last])
        path, offset, dtype = self._file
        channels = self._samples.shape[1]
        count = (last - first) * channels
        begin = offset + first * channels * dtype.itemsize
        return np.fromfile(path, dtype, count, offset=begin).reshape(-1, channels)


def _with_true_length(path: Path) -> io.BytesIO | None:
    """A WAV file whose header states more samples than there are, with their true number; None for
    other files.

    A program that writes to a pipe cannot go back to state it, and writes the largest number.
    Raises ValueError for a file that is too large to be held.
    """
    with path.open("rb") as file:
        head = file.read(_LARGEST_HEAD)
    # After "RIFF", a length and "WAVE" come chunks: a name, a length, and so many bytes.
    at = 12
    frame = 1
    while head[:4] == b"RIFF" and at + 8 <= len(head):
        stated = int.from_bytes(head[at + 4 : at + 8], "little")
        if head[at : at + 4] == b"fmt ":
            frame = int.from_bytes(head[at + 20 : at + 22], "little") or 1
        if head[at : at + 4] != b"data":
            at += 8 + stated + stated % 2
            continue
        there = path.stat().st_size - at - 8
        if stated <= there:
            return None
        if there > _LARGEST_PIPED:
            raise ValueError(f"its header states {stated} bytes of sound; {there} are there")
        there -= there % frame
        content = bytearray(path.read_bytes()[: at + 8 + there])
        content[at + 4 : at + 8] = there.to_bytes(4, "little")
        content[4:8] = (len(content) - 8).to_bytes(4, "little")
        return io.BytesIO(bytes(content))
    return None


class _Compressed:
    """Blocks of a recording as phones write it: AAC, Opus, MP3 and others, decoded by PyAV."""

    step = 0.0

    def __init__(self, path: Path) -> None:
        """Open the file, and read its rate, samples a second.

        Raises UserError where PyAV is missing, and for a file that it cannot read or that has no
        sound.
        """
        self._path = path
        self.name = sanitized(path.name)
        try:
            import av
        except ImportError:
            advice = (
                "Install the reader: pip install av, "
                f"or convert it: ffmpeg -i {self.name} {path.stem}.wav"
            )
            raise UserError(
                self.name, f"a {path.suffix.lower()} file", "PyAV, which reads it", advice
            ) from None
        self._av = av
        with _reading(path, "sound", "a recording"), av.open(str(path)) as file:
            if not file.streams.audio:
                raise UserError(self.name, "no sound in it", "a recording with sound")
            self.rate = int(file.streams.audio[0].codec_context.sample_rate)

    def blocks(self, first: int, last: float) -> Iterator[Floats]:
        """Sound of shape (channels, n) each, from sample `first` up to `last`, which may be inf.

        Raises UserError where the file is damaged.
        """
        at = 0
        held = []
        waiting = 0
        with _reading(self._path, "sound", "a recording"), self._av.open(str(self._path)) as file:
            to_float = self._av.AudioResampler(format="fltp")
            for decoded in file.decode(audio=0):
                for frame in to_float.resample(decoded):
                    block = frame.to_ndarray().astype(float)
                    n = block.shape[1]
                    begin = max(first - at, 0)
                    stop = int(min(max(last - at, 0), n))
                    if begin < stop:
                        held.append(block[:, begin:stop])
                        waiting += stop - begin
                    at += n
                    if waiting >= _BLOCK:
                        yield np.concatenate(held, axis=1)
                        held, waiting = [], 0
                if at >= last:
                    break
        if held:
            yield np.concatenate(held, axis=1)


@contextmanager
def _reading(path: Path, kind: str, expected: str) -> Iterator[None]:
    """Raise UserError for any error within the block: damaged files raise what they like.

    kind, expected: words for the message. UserError itself passes.
    """
    try:
        yield
    except (UserError, GeneratorExit):
        raise
    except Exception as error:
        what = str(error).rstrip(".")
        raise UserError(path.name, f"cannot be read as {kind}: {what}", expected) from None


# Clicks in a recording, when each began, and why they may not be the ball's touches.

# Clicks in a recording, in bands above several frequencies, and when each began.

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from hcbench.terms.impact import Floats

    Indices = NDArray[np.int64]

# Lower and upper ends of the bands, Hz: ringing and speech are low and clicks reach high, but so
# does noise.
_BANDS = ((1200.0, None), (4000.0, None), (8000.0, None), (1200.0, 5000.0), (500.0, 2500.0))
# Edges of the bands whose evidence for an onset is summed, Hz.
_EDGES = (500.0, 1200.0, 2500.0, 5000.0, 10000.0, 18000.0)
# An onset is louder for one of these times than the sound before it, s: clicks ring or do not.
_LONG = (0.7e-3, 3e-3)
# The sound before it is averaged over this time, s.
_LAST_OF_ALL = 8e-3
# Evidence, as ln of a likelihood, from which on there is an onset.
_ONSET = 12.0
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
    rate: float
    places: Indices
    level: Floats

    @property
    def duration(self) -> float:
        """Duration of the sound, s."""
        return len(self.sound) / self.rate

    @property
    def contact_time(self) -> Known | None:
        """Duration of the first impact, s, where the clicks show it: those of sound do not."""
        return None

    @property
    def resolution(self) -> float:
        """Error of a click's time, s, that cannot be smaller."""
        return 0.0

    def timer(self, places: Indices) -> Callable[[Indices], Floats]:
        """A function from samples of clicks to their times, s, made for the train at `places`."""
        return Timer(self, places).times

    def sizes(self, places: Indices) -> Floats | None:
        """Areas of the pulses at `places` over time, (k,); None where clicks have none."""
        return None

    def others(self, places: Indices) -> tuple[int, int]:
        """Clicks that may be another ball's, between the touches at `places` and beside them: of sounds,
        none are sure.
        """
        return 0, 0


def bands(recording: Recording) -> Iterator[FrequencyBand]:
    """The recording in each band of frequencies that its rate allows, the first of _BANDS first."""
    for frequency, upper in _BANDS:
        if (upper or frequency) > 0.4 * recording.rate:
            continue
        filtered = _filtered(recording, frequency, upper)
        places, level = _clicks(filtered, recording.rate, recording.step)
        yield FrequencyBand(frequency, filtered, recording.rate, places, level)
    yield _all_bands(recording)


def _all_bands(recording: Recording) -> FrequencyBand:
    """The recording with a noise alike at all frequencies, and onsets by the evidence of all bands.

    An onset counts in each band as the ln of the likelihood that its energy has risen, above what
    was before and above the noise; the sum over bands has one threshold, which white noise passes
    about once in a recording. Long clicks count over a longer time.
    """
    rate = recording.rate
    sound = np.zeros(len(recording.sound))
    evidence = np.zeros(len(recording.sound))
    power = np.zeros(len(recording.sound))
    for lower, upper in itertools.pairwise(_EDGES):
        if lower > 0.3 * rate:
            break
        top = upper
        if upper > 0.45 * rate:
            top = 0.45 * rate
        part = _filtered(recording, lower, top)
        energy = np.concatenate([[0.0], np.cumsum(part**2)])
        before = _mean_over(energy, -round(_LAST_OF_ALL * rate))
        noise = float(np.median(before)) + recording.step**2 + 1e-30
        sound += part / math.sqrt(noise)
        band = np.zeros(len(part))
        for duration in _LONG:
            after = _mean_over(energy, round(duration * rate))
            rise = np.maximum(after / np.maximum(before, noise), 1.0)
            # Half the number of independent values of the energy: band times duration.
            half = (top - lower) * duration
            band = np.maximum(band, half * (rise - 1.0 - np.log(rise)))
        evidence += band
        power += np.maximum(_mean_over(energy, round(_LONG[0] * rate)) / noise - 1.0, 0.0)
    from scipy.signal import find_peaks

    peaks, _ = find_peaks(evidence, height=_ONSET, distance=max(1, round(_APART * rate)))
    # The evidence of a loud click begins a window before it: its power is largest within.
    level = 10.0 * np.log10(np.maximum(power[peaks], 1e-3))
    kept = np.sort(np.argsort(-evidence[peaks])[:_MOST_CLICKS])
    return FrequencyBand(_EDGES[0], sound, rate, peaks[kept], level[kept])


def _mean_over(energy: Floats, samples: int) -> Floats:
    """Mean energy of the `samples` samples from each on; before each if that is below 0; (n,).

    energy: sums from the start, (n + 1,).
    """
    n = len(energy) - 1
    at = np.arange(n)
    first = np.clip(at + min(samples, 0), 0, n)
    last = np.clip(at + max(samples, 0), 0, n)
    # The first samples have nothing before them.
    return np.asarray((energy[last] - energy[first]) / np.maximum(last - first, 1))


def _filtered(recording: Recording, lower: float, upper: float | None) -> Floats:
    """Sound above `lower`, Hz, and below `upper`, if given: shape (n,), without a look ahead."""
    from scipy.signal import butter, sosfilt

    if upper is None:
        sections = butter(4, lower, "highpass", fs=recording.rate, output="sos")
    else:
        sections = butter(4, [lower, upper], "bandpass", fs=recording.rate, output="sos")
    return np.asarray(sosfilt(sections, recording.sound))


def _clicks(sound: Floats, rate: float, step: float) -> tuple[Indices, Floats]:
    """Samples at which something begins that is louder than before, and its level, dB over the
    noise.

    sound: (n,), filtered.
    rate: Hz.
    step: between two values that a sample can have.
    Returns two arrays of shape (m,), in order of time: the loudest _MOST_CLICKS.
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
    from scipy.signal import find_peaks

    peaks, _ = find_peaks(rise, height=_RISE, distance=max(1, round(_APART * rate)))
    loud = after[peaks]
    kept = np.sort(np.argsort(-loud)[:_MOST_CLICKS])
    return back + peaks[kept], 10.0 * np.log10(loud[kept] / noise)


class Timer:
    """Timer of a train's clicks: by Akaike's criterion (Maeda 1985), then by correlation with the train's
    mean.
    """

    def __init__(self, band: FrequencyBand, places: Indices) -> None:
        """Make the template of one train's clicks, against which any click of the band is timed.

        places: (n,), samples at which the train's clicks are, one at least: ValueError without any.
        The template, (m,), is a click as `_piece` cuts it out: _OVERSAMPLING values a sample, from
        0.8 ms before the click's onset to 2 ms after.
        """
        if not len(places):
            raise ValueError("no click to make a template of")
        self.band = band
        # Times of the clicks that were timed, in samples and fractions of one, by their places.
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
        """The click from 0.3 ms before its onset to 1.2 ms after, with a margin of 0.5 ms before
        and 0.8 ms after for shifts: _OVERSAMPLING values a sample, scaled to a sum of squares of 1.

        onset: sample of the sound. Beyond the sound's ends the click is 0.
        """
        from scipy.signal import resample_poly

        before = round(0.3e-3 * self.band.rate)
        after = round(1.2e-3 * self.band.rate)
        margin = before + round(0.5e-3 * self.band.rate)
        piece = self.band.sound[max(0, onset - margin) : onset + after + margin]
        piece = np.pad(piece, (max(0, margin - onset), max(0, after + 2 * margin - len(piece))))
        fine = resample_poly(piece[: after + 2 * margin], _OVERSAMPLING, 1)
        return np.asarray(fine / (np.sqrt((fine**2).sum()) + 1e-30))


def _onset(sound: Floats, rate: float, place: int) -> int:
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

# ln of the odds that a train is the ball's and its fit right: an offset, what the score adds, and what
# ln of the scatter of e over that of a usual ball takes off. Fitted to 392 trains of drops in rooms,
# quiet and disturbed, and of garbage (`noisy_rooms`).
_OFFSET, _OF_SCORE, _OF_SCATTER = -0.45, 0.218, -1.22
_USUAL_SCATTER = 3e-3
# Chances below which no number is given, and no law is chosen: of 282 such trains above the
# second none was wrong.
_LIKELY = 0.85
_SURE = 0.98


@dataclass(frozen=True, slots=True)
class Picks:
    """Touches heard.

    times: (n,), s.
    numbers: (n,), which touch each is, from 0: some may be unheard.

    level: (n,), dB over the noise.
    band: Hz, above which they were looked for; 0 for pulses of a signal.
    score: ln of the likelihood ratio of one ball against clutter.
    scatter, alpha: of a fit to them alone; None where they are too few.
    contact_time: of the first impact, s; resolution: least error of a time, s; sizes: (n,), areas of
    the pulses over time. None, 0 and None for sound.
    left_out, beside: pulses between the first touch and the last, and before and after them, that are
    nearly as large as the least touch; 0 for sound.
    """

    times: Floats
    numbers: Indices
    level: Floats
    band: float
    score: float = math.inf
    scatter: float | None = None
    alpha: Estimate | None = None
    contact_time: Known | None = None
    resolution: float = 0.0
    sizes: Floats | None = None
    left_out: int = 0
    beside: int = 0

    def taken(self, touches: range) -> Picks:
        """The picks of these touches of the list, counted from 1."""
        kept = np.isin(np.arange(1, len(self.times) + 1), touches)
        return replace(
            self,
            times=self.times[kept],
            numbers=self.numbers[kept],
            level=self.level[kept],
            sizes=None if self.sizes is None else self.sizes[kept],
        )


def chance_of(train: Picks, scatter: float = 0.0) -> float:
    """Chance that a train is the ball's, and its fit right, in 0 ... 1.

    scatter: of e, as a share.
    """
    from scipy.special import expit

    rough = math.log(max(scatter / _USUAL_SCATTER, 1.0))
    return float(expit(_OFFSET + _OF_SCORE * train.score + _OF_SCATTER * rough))


def reservation_of(heard: Sequence[Picks]) -> str:
    """Reason to choose no law although the first train is likely the ball's; "" without one."""
    chance = chance_of(heard[0])
    if chance >= _SURE:
        return ""
    return (
        f"the touches are the ball's with a chance of {100 * chance:.0f} %: look at --page, then take "
        "--touches A"
    )


def doubts_of(heard: Sequence[Picks], scatter: float) -> list[str]:
    """Reason to doubt that the first train is the ball's; with one, the fit gives no number.

    scatter: of e, 1.
    """
    chance = chance_of(heard[0], scatter)
    if chance >= _LIKELY:
        return []
    count = len(heard[0].times)
    return [f"the {count} touches heard are the ball's with a chance of {100 * chance:.0f} % only"]
