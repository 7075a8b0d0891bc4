"""Quality of `hcbench fit` on synthetic measurements by generators that share no code with it.

    python benchmarks/bench_fit.py [--trials 500] [--recordings 20] [--only times|sound|laws|...]

Drops of 0.3 ... 1 m. Each row is printed as it is done; about forty minutes of
one core at 500 trials a cell.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "examples" / "recording"))
sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "support"))
import noisy_rooms
import synthesise as synth

from hcbench.fitting.datasets import Dataset, TouchTimes
from hcbench.fitting.estimate import fit_law
from hcbench.fitting.fit import fit
from hcbench.fitting.heights import Heights, SpeedPairs
from hcbench.fitting.linear import LawFit
from hcbench.fitting.listening import listen
from hcbench.fitting.recording import Recording
from hcbench.fitting.setup import Known, MeasurementSetup
from hcbench.fitting.track import track_of
from hcbench.fitting.which_law import LAWS
from hcbench.system.errors import UserError

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
    law, setup = (
        synth.hunt_crossley(alpha),
        MeasurementSetup(gravity=EXACT.gravity, height=Known(0.3, 1e-6)),
    )
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
                picks = listen(Recording("r", wave, 44100), EXACT)[0]
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
    return (
        f"{100 * np.median(off):.2f} %; {100 * off.max():.2f} %; {held.mean():.3f} of {len(held)}"
    )


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


def bounces(
    law: synth.Law, scatter: float, timing: float, count: int, rng: np.random.Generator
) -> Dataset:
    """Times of this many touches after a drop of 0.3 to 1 m."""
    speed, times_ = float(np.sqrt(2 * synth.GRAVITY * rng.uniform(0.3, 1.0))), [0.0]
    for _ in range(count - 1):
        speed *= law(speed) * (1 + scatter * rng.normal())
        times_.append(times_[-1] + 2 * speed / synth.GRAVITY)
    return TouchTimes("t", EXACT, np.array(times_) + timing * rng.normal(size=count))


def answers(what: str, must: str, alpha: float, make: Make, n: int) -> None:
    """Statistics of n data sets: how many have an α, how often its
    interval holds, which laws are chosen.
    """
    rng, held, chosen, none = np.random.default_rng(30), 0, 0, 0
    off: list[float] = []
    for _ in range(n):
        fitted = fit([make(rng)])
        chosen += fitted.law is not None
        none += fitted.law is None and fitted.lack.is_certain
        if fitted.alpha is not None:
            held += fitted.alpha.low <= alpha <= fitted.alpha.high
            off.append(fitted.alpha.value / alpha - 1)
    share = (
        f"{held / len(off):.3f} of {len(off)}, bias {100 * np.mean(off):+.1f} %" if off else "no α"
    )
    row(what, must, f"{share}; law chosen {chosen}, none of these {none} of {n}")


def doubt(n: int) -> None:
    """A constant loss, large scatter, outliers, and laws that are not in the list."""
    for alpha, e0, scatter, timing, count in (
        (0.2, 0.98, 0.005, 2e-4, 12), (0.3, 0.97, 0.005, 2e-4, 9),
        (0.15, 0.99, 0.005, 2e-4, 12), (0.2, 0.98, 0.01, 1e-3, 8),
    ):  # fmt: skip
        what = f"e0 {e0:g}, α {alpha:g}, {100 * scatter:g} %, {1e3 * timing:g} ms, {count} touches"
        law = synth.hunt_crossley(alpha, e0)
        answers(what, "0.93", alpha, partial(bounces, law, scatter, timing, count), n)
    for scatter, outliers in (
        (0.05, 0.0),
        (0.2, 0.0),
        (0.35, 0.0),
        (0.5, 0.0),
        (0.05, 0.05),
        (0.2, 0.05),
    ):
        what = f"40 pairs, e scatters by {100 * scatter:g} %" + (
            "; 5 % outliers" if outliers else ""
        )
        answers(what, "0.93", 0.5, partial(scattered_pairs, scatter, outliers), n)
    for what, law in {"adhesion": adhesion, "e rises by 0.1 a decade": rising}.items():
        must = "none of these, or an interval that holds"
        answers(f"{what}, 6 to 20 touches", must, 0.15, partial(some_bounces, law), n)
        answers(f"{what}, until 0.25 m/s", "none of these", 0.15, partial(to_rest, law), n)


def adhesion(speed: float) -> float:
    return float(np.sqrt(max(1 - (0.1 / speed) ** 2, 0.01))) * synth.hunt_crossley(0.15)(speed)


def rising(speed: float) -> float:
    return min(1.0, 0.8 + 0.1 * float(np.log10(speed)))


def some_bounces(law: synth.Law, rng: np.random.Generator) -> Dataset:
    return bounces(law, 0.005, 2e-4, int(rng.integers(6, 21)), rng)


def to_rest(law: synth.Law, rng: np.random.Generator) -> Dataset:
    """Bounces down to 0.25 m/s, 26 touches at most."""
    speed, count = float(np.sqrt(2 * synth.GRAVITY * 0.6)), 1
    while speed > 0.25 and count < 26:
        speed, count = speed * law(speed), count + 1
    return bounces(law, 0.005, 2e-4, count, rng)


def scattered_pairs(scatter: float, outliers: float, rng: np.random.Generator) -> Dataset:
    law, v = synth.hunt_crossley(0.5), rng.uniform(0.2, 3.0, 40)
    share = np.where(
        rng.random(40) < outliers, rng.uniform(0.1, 0.5, 40), 1 + scatter * rng.normal(size=40)
    )
    e = np.clip(np.array([law(s) for s in v]) * share, 0, 1.15)
    return SpeedPairs("p", EXACT, v, e, np.zeros(40), np.zeros(40))


def drops(n: int) -> None:
    """Ten drops whose α differ by 4 %; and four of which one is of another ball."""
    held = named = false = 0
    for seed in range(n):
        rng = np.random.default_rng(seed)
        alphas = 0.2 * np.exp(0.04 * rng.normal(size=10))
        alpha = fit([bounces(synth.hunt_crossley(a), 0.003, 1e-4, 14, rng) for a in alphas]).alpha
        held += alpha is not None and alpha.low <= 0.2 <= alpha.high
        four = [
            bounces(synth.hunt_crossley(a), 0.003, 1e-4, 14, rng) for a in (0.15, 0.15, 0.15, 0.3)
        ]
        four = [
            TouchTimes(f"{i}", EXACT, s.times)
            for i, s in enumerate(four)
            if isinstance(s, TouchTimes)
        ]
        warnings = [w for w in fit(four).warnings if "does not go with" in w]
        named += any(w.startswith("3 ") for w in warnings)
        false += any(not w.startswith("3 ") for w in warnings)
    row("ten drops that differ by 4 %", "11 of 12", f"{held} of {n} hold")
    row("one odd file of four", "named", f"{named} of {n} named; another named {false}")


def rooms(kind: str, heard: Iterator[noisy_rooms.Heard], must: str) -> None:
    """Recordings in rooms that no rule of the search has seen."""
    n = held = chosen = wrong = near = 0
    off, cost = [], []
    for one in heard:
        n, start = n + 1, time.process_time()
        recording = Recording("r", np.round(32767 * one.sound) / 32768, noisy_rooms.RATE, 2.0**-15)
        try:
            trains = listen(recording, MeasurementSetup())
            best = trains[0]
            if len(best.times) < 4:
                continue
            data = TouchTimes(
                "r", MeasurementSetup(), best.times, best.numbers, best, recording, tuple(trains)
            )
            fitted = fit([data])
        except UserError:
            continue
        finally:
            cost.append(time.process_time() - start)
        if fitted.alpha is None:
            continue
        off.append(abs(fitted.alpha.value / one.alpha - 1))
        holds = fitted.alpha.low <= one.alpha <= fitted.alpha.high
        held += holds
        near += off[-1] <= 0.05
        chosen += fitted.law is not None
        wrong += fitted.law is not None and off[-1] > 0.05 and not holds
    row(
        f"sound, {kind}: answered; within 5 %; median error; interval holds", must,
        f"{len(off)} of {n}; {near}; {100 * np.median(off):.2f} %; {held / len(off):.3f}",
    )  # fmt: skip
    row(
        f"sound, {kind}: law chosen, and wrong by over 5 % outside its interval", "1 % at most",
        f"{wrong} of {chosen} ({100 * wrong / max(chosen, 1):.2f} %)",
    )  # fmt: skip
    row(
        f"sound, {kind}: CPU time a recording, mean; longest",
        "2 s",
        f"{np.mean(cost):.2f}; {max(cost):.2f} s",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--recordings", type=int, default=20)
    parser.add_argument("--only", choices=list(_PARTS))
    asked = parser.parse_args()
    print(f"{asked.trials} trials a cell. α: bias / rms / coverage of the 95 % interval\n")
    print("| what | must | is |\n|---|---|---|")
    for name, part in _PARTS.items():
        if asked.only in (None, name):
            part(asked)


def all_times(asked: argparse.Namespace) -> None:
    n = asked.trials
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
        cell(
            f"heights ± 1 mm from 0.3 m, α {alpha:g}",
            f"rms {rms:g} %",
            alpha,
            heights(alpha),
            4 * n,
        )
    for alpha in (0.05, 0.3, 1.0):
        cell(
            f"pairs, 20, scatter 0.005, v to 1 %, α {alpha:g}",
            "coverage 0.93 ... 0.97",
            alpha,
            pairs(alpha),
            n,
        )


def all_laws(asked: argparse.Namespace) -> None:
    n = asked.trials
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


_PARTS: dict[str, Callable[[argparse.Namespace], None]] = {
    "times": all_times,
    "sound": lambda asked: sound(asked.recordings),
    "laws": all_laws,
    "doubt": lambda asked: doubt(asked.trials),
    "drops": lambda asked: drops(asked.trials // 10),
    "quiet": lambda _: rooms("quiet rooms", noisy_rooms.quiet(680, 401), "0.93"),
    "disturbed": lambda _: rooms("disturbed rooms", noisy_rooms.disturbed(570, 402), "0.90"),
}

if __name__ == "__main__":
    main()
