"""How good `hcbench fit` is, on synthetic measurements by generators that share no code with it.

    python benchmarks/bench_fit.py [--trials 500] [--recordings 20]

Drops of 0.3 ... 1 m. Each row is printed as it is done; about ten minutes of one core at 500 trials a cell.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "examples" / "recording"))
import synthesise as synth

from hcbench.fitting.candidates import LAWS
from hcbench.fitting.datasets import Dataset, TouchTimes
from hcbench.fitting.estimate import LawFit, fit_law
from hcbench.fitting.fit import fit
from hcbench.fitting.heights import Heights
from hcbench.fitting.listening import find_touches
from hcbench.fitting.pairs import SpeedPairs
from hcbench.fitting.recording import Recording
from hcbench.fitting.setup import Known, MeasurementSetup
from hcbench.fitting.track import track_of

EXACT = MeasurementSetup(gravity=Known(synth.GRAVITY))
Make = Callable[[np.random.Generator], Dataset]
TRUTHS = {
    "hunt-crossley 0.05": synth.hunt_crossley(0.05),
    "hunt-crossley 0.3": synth.hunt_crossley(0.3),
    "hunt-crossley 1": synth.hunt_crossley(1.0),
    "constant 0.9": synth.constant(0.9),
    "constant 0.7": synth.constant(0.7),
    "viscoelastic 0.1": synth.viscoelastic(0.1),
    "viscoelastic 0.25": synth.viscoelastic(0.25),
    "plastic 0.8": synth.plastic(0.8),
}


def row(what: str, must: str, measured: str) -> None:
    print(f"| {what} | {must} | {measured} |", flush=True)


def interval(law_fit: LawFit) -> list[float]:
    """2.5 %, 50 % and 97.5 % of α."""
    points = law_fit.posterior.parameters
    alpha = np.array([law_fit.law.describe(tuple(p), law_fit.reference)["alpha"] for p in points])
    return law_fit.posterior.quantiles(alpha, (0.025, 0.5, 0.975))


def of(data: Dataset) -> list[float]:
    reference = float(np.exp(np.log(data.pairs()[0]).mean()))
    return interval(fit_law(LAWS["hunt-crossley"], [data], reference))


def summary(truth: float | Sequence[float], intervals: Sequence[list[float]]) -> str:
    low, middle, high = np.array(intervals).T
    off, held = middle / truth - 1, (low <= truth) & (truth <= high)
    return f"{100 * off.mean():+.2f} / {100 * np.sqrt((off**2).mean()):.3g} % / {held.mean():.3f}"


def cell(what: str, must: str, alpha: float, make: Make, trials: int) -> None:
    rng = np.random.default_rng(20)
    row(what, must, summary(alpha, [of(make(rng)) for _ in range(trials)]))


def times(alpha: float, timing: float, scatter: float, most: int = 25) -> Make:
    law = synth.hunt_crossley(alpha)

    def make(rng: np.random.Generator) -> Dataset:
        drop = rng.uniform(0.3, 1.0)
        return TouchTimes("t", EXACT, synth.touch_times(law, drop, timing, scatter, rng, most))

    return make


def heights(alpha: float) -> Make:
    law, setup = synth.hunt_crossley(alpha), MeasurementSetup(gravity=EXACT.gravity, height=Known(0.3, 1e-6))
    return lambda rng: Heights("h", setup, synth.bounce_heights(law, 0.3, 1e-3, 0.0, rng))


def pairs(alpha: float) -> Make:
    law = synth.hunt_crossley(alpha)

    def make(rng: np.random.Generator) -> Dataset:
        v = rng.uniform(0.1, 2.0, 20)
        e = np.array([law(s) for s in v]) * (1 + 0.005 * rng.standard_normal(20))
        read = v * (1 + 0.01 * rng.standard_normal(20))
        return SpeedPairs("p", EXACT, read, e, 0.01 * read, np.zeros(20))

    return make


def tracks(alpha: float, frames: float) -> Make:
    law = synth.hunt_crossley(alpha)
    return lambda rng: track_of("f", EXACT, *synth.track(law, 0.5, 4e-3, 1e-3, frames, rng))


def sound(recordings: int) -> None:
    false = missed = heard = 0
    truth, intervals, exact, slowest = [], [], [], 0.0
    for i, surface in enumerate(synth.SURFACES):
        for decibels in (50.0, 40.0, 30.0):
            rng = np.random.default_rng(100 * i + int(decibels))
            for _ in range(recordings):
                alpha, drop = rng.choice([0.05, 0.1, 0.2, 0.3, 0.5]), rng.uniform(0.3, 1.0)
                wave, at = synth.drop_recording(
                    synth.hunt_crossley(alpha), drop, 3e-3, surface, decibels, rng
                )
                start = time.process_time()
                picks = find_touches(Recording("r", wave, 44100))
                slowest = max(slowest, time.process_time() - start)
                nearest = np.abs(picks.times[:, None] - at).argmin(axis=1)
                off = picks.times - at[nearest]
                good = np.abs(off - np.median(off)) < 3e-3
                false += int((~good).sum())
                heard += int(good.sum())
                missed += int(np.ptp(nearest[good])) + 1 - len(set(nearest[good]))
                truth.append(alpha)
                intervals.append(of(TouchTimes("r", EXACT, picks.times, picks.numbers, picks)))
                exact.append(of(TouchTimes("r", EXACT, at[np.unique(nearest)], np.unique(nearest))))
    row(
        "sound, 4 surfaces x 3 noise levels: false touches; missed inside",
        "0; 3 of 3000",
        f"{false}; {missed} of {heard}",
    )
    row("sound: α median; worst; coverage", "0.5 %; 1.7 %; 0.93", of_sound(truth, intervals))
    row("the same drops, each touch timed exactly", "", of_sound(truth, exact))
    row("sound: the slowest recording of 5 s", "1 s", f"{slowest:.2f} s")


def of_sound(truth: Sequence[float], intervals: Sequence[list[float]]) -> str:
    low, middle, high = np.array(intervals).T
    off, held = np.abs(middle / truth - 1), (low <= truth) & (truth <= high)
    return f"{100 * np.median(off):.2f} %; {100 * off.max():.2f} %; {held.mean():.3f} of {len(held)}"


def laws(timing: float, scatter: float, most: int, trials: int) -> str:
    decided = wrong = likeliest = count = 0
    rng = np.random.default_rng(7)
    for name, law in TRUTHS.items():
        for _ in range(-(-trials // len(TRUTHS))):
            data = synth.touch_times(law, 0.3, timing, scatter, rng, most)
            if len(data) < 4:
                continue
            fitted = fit([TouchTimes("t", EXACT, data)])
            kind = name.partition(" ")[0]
            count += 1
            decided += (fitted.law or "").startswith(kind)
            wrong += fitted.law is not None and not fitted.law.startswith(kind)
            likeliest += fitted.fits[0].law.name.startswith(kind)
    left = count - decided - wrong
    return f"decided {decided}, left open {left}, wrong {wrong} of {count}; likeliest right {likeliest}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--recordings", type=int, default=20)
    asked = parser.parse_args()
    n = asked.trials
    print(f"{n} trials a cell. α: bias / rms / coverage of the 95 % interval\n")
    print("| what | must | is |\n|---|---|---|")
    for alpha, rms in ((0.05, 2.0), (0.2, 1.2), (0.5, 1.2), (1.0, 1.2)):
        must = f"0.2 / {rms:g} % / 0.92 ... 0.97"
        cell(f"times, 0.2 ms, 0.5 %, α {alpha:g}", must, alpha, times(alpha, 2e-4, 5e-3), n)
    cell(
        "times, 0.2 ms, 0.5 %, α 0.2, 9 touches",
        "0.2 / 1.2 % / 0.92 ... 0.97",
        0.2,
        times(0.2, 2e-4, 5e-3, 9),
        n,
    )
    cell("timing only, 50 µs, α 0.2", "rms 0.05 %", 0.2, times(0.2, 5e-5, 0.0), n)
    for alpha, rms in ((0.05, 0.6), (0.3, 1.0), (1.0, 3.0)):
        cell(f"heights ± 1 mm from 0.3 m, α {alpha:g}", f"rms {rms:g} %", alpha, heights(alpha), 4 * n)
    for alpha in (0.05, 0.3, 1.0):
        cell(
            f"pairs, 20, scatter 0.005, v to 1 %, α {alpha:g}",
            "coverage 0.93 ... 0.97",
            alpha,
            pairs(alpha),
            n,
        )
    sound(asked.recordings)
    for timing, scatter in ((5e-5, 2e-3), (2e-4, 5e-3)):
        what = f"law, to 15 touches, {1e3 * timing:g} ms, {100 * scatter:g} %"
        row(what, "right in all", laws(timing, scatter, 15, n))
    row("law, six touches, 1 ms, 1 %", "wrong under 1 %", laws(1e-3, 1e-2, 6, n))
    for frames in (60.0, 240.0):
        for alpha in (0.1, 0.4, 1.0):
            what = f"track, {frames:g} frames/s, 1 mm, 0.4 %, α {alpha:g}"
            cell(what, "rms 1.2 %", alpha, tracks(alpha, frames), n)
    data = times(0.05, 2e-4, 2e-3, 30)(np.random.default_rng(1))
    fit([data])
    start = time.process_time()
    fit([data])
    row("one fit of 30 touches, all laws", "0.2 s", f"{time.process_time() - start:.2f} s")


if __name__ == "__main__":
    main()
