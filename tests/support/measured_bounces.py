"""Measurements to fit: touch times, files, recordings, and how often an interval holds."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import wavfile

from hcbench.fitting.estimate import fit_law
from hcbench.fitting.setup import Known, MeasurementSetup
from hcbench.fitting.which_law import LAWS

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "recording"))
import synthesise

__all__ = ["EXACT", "TRIALS", "G", "synthesise", "times_of", "trials", "wav", "write"]

G = Known(9.80665)
EXACT = MeasurementSetup(gravity=G)
TRIALS = 40


def times_of(law: synthesise.Law, seed: int, **more: float) -> np.ndarray:
    what: Any = {"drop": 0.3, "timing": 2e-4, "scatter": 5e-3, "most": 15, **more}
    return np.asarray(synthesise.touch_times(law, rng=np.random.default_rng(seed), **what))


def trials(make: Any, truth: float, count: int = TRIALS) -> tuple[float, float]:
    """(rms error of α, share of 95 % intervals that hold it)."""
    off, held = [], 0
    for seed in range(count):
        data = make(seed)
        found = fit_law(
            LAWS["hunt-crossley"], [data], float(np.exp(np.log(data.pairs()[0]).mean()))
        )
        values = np.array(
            [
                LAWS["hunt-crossley"].describe(tuple(p), found.reference)["alpha"]
                for p in found.posterior.parameters
            ]
        )
        low, middle, high = found.posterior.quantiles(values, (0.025, 0.5, 0.975))
        off.append(middle / truth - 1)
        held += low <= truth <= high
    return float(np.sqrt(np.mean(np.square(off)))), held / count


def write(folder: Path, text: str, name: str = "data.csv") -> str:
    (folder / name).write_text(text, encoding="utf-8")
    return str(folder / name)


def wav(path: Path, kind: str, sound: np.ndarray, rate: int = 44100) -> Path:
    """A recording in one of the formats that phones and programs write."""
    if kind == "24":
        whole = np.round(sound * (2**23 - 1)).astype("<i4")
        data = whole.view(np.uint8).reshape(-1, 4)[:, :3].tobytes()
        head = (
            b"RIFF"
            + (36 + len(data)).to_bytes(4, "little")
            + b"WAVEfmt "
            + (16).to_bytes(4, "little")
        )
        head += (
            b"\1\0\1\0"
            + rate.to_bytes(4, "little")
            + (3 * rate).to_bytes(4, "little")
            + b"\3\0\x18\0"
        )
        path.write_bytes(head + b"data" + len(data).to_bytes(4, "little") + data)
        return path
    both = np.stack([0.01 * sound, sound], axis=1)
    samples: dict[str, Any] = {
        "8": np.round(127 * sound + 128).astype(np.uint8),
        "16": np.round(32767 * sound).astype(np.int16),
        "float": sound.astype(np.float32),
        "stereo": np.round(32767 * both).astype(np.int16),
    }
    wavfile.write(path, rate, samples[kind])
    return path
