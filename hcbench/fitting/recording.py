"""Sound recordings, one channel of them: WAV read here, what phones write by PyAV."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.io import wavfile

from hcbench.system.errors import UserError
from hcbench.system.text import sanitized

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from hcbench.terms.impact import Floats

# A recording up to this length, s, is searched whole, without windows.
_WHOLE = 24.0
# Of a longer recording, the window of this length, s, with the best train is taken.
_WINDOW = 20.0
# Windows overlap by this time, s, so that one of them holds the whole train.
_OVERLAP = 8.0
# Samples that are read at once: a long recording never lies in memory whole.
_BLOCK = 1 << 18
_PHONES = (".m4a", ".mp4", ".mov", ".aac", ".opus", ".ogg", ".oga", ".mp3", ".flac", ".3gp", ".caf", ".amr",
           ".wma", ".webm", ".mkv")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Recording:
    """Sound of one channel, or a window of it.

    sound: (n,), one channel, -1 ... 1.
    rate: Hz.
    step: between two values that a sample can have.
    begin: when in the file it begins, s.
    """

    name: str
    sound: Floats
    rate: int
    step: float = 0.0
    begin: float = 0.0


def is_sound(path: Path) -> bool:
    """Say whether a file begins like a WAV file, or has a suffix of phone recordings."""
    try:
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
    """Read WAV (integers of 8 to 32 bits or floats) or a phone's format; of several channels the
    loudest.

    score: how likely a part holds bounces.
    begin, end: s, the part to read. Of more than 24 s the 20 s with the best score; no more than
    that is held in memory.

    Raises UserError for other files and for files without a sound.
    """
    name = sanitized(path.name)
    source = _Compressed(path) if _is_of_phone(path) else _Wav(path)
    if source.rate < 8000:
        raise UserError(name, f"{source.rate} samples a second", "8000 or more")
    first = round(begin * source.rate)
    last = math.inf
    if end is not None:
        last = round(end * source.rate)
    if last <= first:
        raise UserError("--to", f"{end:g} s", f"after --from, {begin:g} s")
    kept = round(_WINDOW * source.rate)
    gone = kept - round(_OVERLAP * source.rate)
    # Shape (channels, samples).
    window = np.zeros((0, 0))
    # The window's first sample, counted from the start of the file.
    at = first
    best: Recording | None = None
    top = -math.inf
    for block in source.blocks(first, last):
        if window.size:
            window = np.concatenate([window, block], axis=1)
        else:
            # Only the first block tells the number of channels.
            window = block
        if not np.isfinite(block).all():
            raise UserError(name, "samples that are not finite", "a recording")
        if window.shape[1] > _WHOLE * source.rate:
            part = _one_channel(source, name, window[:, :kept], at)
            likely = score(part)
            if likely > top:
                top = likely
                best = part
            window = window[:, gone:].copy()
            at += gone
    if best is None and (not window.size or window.shape[1] < 0.2 * source.rate):
        got = f"{window.shape[-1] / source.rate:.2g} s of sound"
        raise UserError(name, got, "a recording of several bounces")
    rest = _one_channel(source, name, window, at)
    if best is None or score(rest) > top:
        return rest
    return best


def _one_channel(source: _Wav | _Compressed, name: str, sound: Floats, at: int) -> Recording:
    """The loudest channel of sound (channels, samples) that begins with sample `at` of a file."""
    loudest = sound[0]
    if len(sound) > 1:
        loudest = sound[int(np.argmax([channel.std() for channel in sound]))]
    if not loudest.std() > 0 and at == 0:
        raise UserError(name, "silence", "a recording of several bounces")
    return Recording(name, loudest - loudest.mean(), source.rate, source.step, at / source.rate)


class _Wav:
    """Blocks of a WAV file, mapped into memory where its samples allow."""

    def __init__(self, path: Path) -> None:
        """Open the file. Raises UserError for what is not a WAV recording.

        Samples are scaled to -1 ... 1; `step` is the size of their last bit on that scale.
        """
        with _reading(path, "WAV", "a WAV recording, PCM or float"), warnings.catch_warnings():
            # SciPy warns of chunks that it does not know, such as a title.
            warnings.simplefilter("ignore")
            try:
                self.rate, samples = wavfile.read(path, mmap=True)
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
        """(n, channels); from the file itself, as pages of a map would stay in memory."""
        if self._file is None:
            return np.asarray(self._samples[first:last])
        path, offset, dtype = self._file
        channels = self._samples.shape[1]
        count = (last - first) * channels
        begin = offset + first * channels * dtype.itemsize
        return np.fromfile(path, dtype, count, offset=begin).reshape(-1, channels)


class _Compressed:
    """Blocks of a recording as phones write it: AAC, Opus, MP3 and others, decoded by PyAV."""

    step = 0.0

    def __init__(self, path: Path) -> None:
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
        """(channels, n), from one sample to another."""
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
    """Damaged files raise what they like."""
    try:
        yield
    except (UserError, GeneratorExit):
        raise
    except Exception as error:
        what = str(error).rstrip(".")
        raise UserError(path.name, f"cannot be read as {kind}: {what}", expected) from None
