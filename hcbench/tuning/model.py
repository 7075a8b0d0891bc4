"""Tunes pairs of a user's own model: settings of its engine tried in it, under its own step and gravity."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench._arguments import checked
from hcbench.errors import EngineFailed, UserError
from hcbench.laws.require import require
from hcbench.laws.restitution import RestitutionCurve
from hcbench.measuring.measure import LONGEST_LIMIT_S, Job, run_job, source_of
from hcbench.sim import simulate
from hcbench.sim.capabilities import TunesModels
from hcbench.sim.model_under_test import Facts, ModelSetting, Request
from hcbench.sim.promise import Promise
from hcbench.tuning.tune import MAX_ERROR

LIMIT_S = 600.0  # for one model, which takes some seconds on an idle machine
_TRIED_SPEEDS, _TRIED_PHASES = 6, 4
_HELD_OUT_SPEEDS, _HELD_OUT_PHASES = 7, 8


@dataclass(frozen=True, slots=True)
class TunedPair:
    """How a setting does for one pair.

    points: (mean speed at touch m/s, e wanted there, lowest e, highest e) at held-out speeds, 8 phases each.
    max_error: the largest |e - wanted| of these; 1 where an impact has no e.
    """

    facts: Facts
    max_error: float
    points: tuple[tuple[float, float, float, float], ...]


@dataclass(frozen=True, slots=True)
class TunedModel:
    """A setting for pairs in their own model, and how it does there.

    paste: lines for the model or script. written: the whole model with them, "" where the engine has no such
    text.
    """

    name: str
    paste: str
    written: str
    notes: tuple[str, ...]
    pairs: tuple[TunedPair, ...]

    @property
    def max_error(self) -> float:
        """The largest of all pairs."""
        return max(pair.max_error for pair in self.pairs)


@dataclass(frozen=True, slots=True)
class _TuneJob(Job):
    """others: requests of further pairs. max_error: of e, within which the simplest setting will do."""

    others: tuple[Request, ...] = ()
    max_error: float = MAX_ERROR


@checked
def tune_model(
    source: Any,
    requests: Sequence[Request],
    wanted: RestitutionCurve,
    engine: str | None = None,
    max_error: float = MAX_ERROR,
    limit: float = LIMIT_S,
) -> TunedModel:
    """The simplest of the engine's settings whose e is within `max_error` of what is wanted, for all pairs at
    once; or else the nearest.

    requests: one a pair; their speeds span the band. Files are run in a worker. UserError for a pair that
    cannot meet.
    """
    if len(requests) == 0:
        raise UserError("requests", "none", "one a pair")
    require("max_error", max_error, 0 <= max_error <= 1, "0 ... 1, a difference in e")
    require("limit", limit, 0 < limit <= LONGEST_LIMIT_S, f"above 0 s, up to {LONGEST_LIMIT_S:g} s")
    first, *others = requests
    job = _TuneJob(
        source=source,
        engine=engine,
        request=first,
        wanted=wanted,
        tolerance=0.0,
        diagnose=False,
        others=tuple(others),
        max_error=max_error,
    )
    return run_job(_tuned, job, limit)


def _tuned(job: Job) -> TunedModel:
    assert isinstance(job, _TuneJob)
    assert job.wanted is not None
    wanted, requests = job.wanted, (job.request, *job.others)
    engine, source, rebuild = source_of(job)
    if not isinstance(engine, TunesModels):
        expected = "an engine that tunes models of users"
        raise UserError("engine", repr(engine.name), expected, f"{source!r}")
    tries: list[tuple[float, ModelSetting]] = []
    for setting in engine.model_settings(source, requests, wanted, rebuild):
        tried = [
            _tuned_pair(setting, request, _speeds(request, held_out=False), _TRIED_PHASES, wanted)
            for request in requests
        ]
        tries.append((max(pair.max_error for pair in tried), setting))
        if tries[-1][0] <= job.max_error:
            break
    _, setting = min(tries, key=lambda each: each[0])
    pairs = tuple(
        _tuned_pair(setting, request, _speeds(request, held_out=True), _HELD_OUT_PHASES, wanted)
        for request in requests
    )
    if not all(math.isfinite(pair.max_error) for pair in pairs):
        got = f"launches with the setting {setting.name!r} gave no restitution"
        raise EngineFailed("model", got, "a bounce from each", "Try other --speeds, or a smaller --timestep")
    notes = dict.fromkeys((*setting.notes, *(note for pair in pairs for note in pair.facts.notes)))
    paste, written = setting.paste, setting.written
    if setting.promised is not None:
        bands = [(min(request.speeds), max(request.speeds)) for request in requests]
        each = zip(pairs, bands, strict=True)
        promises = [Promise(setting.name, 1, wanted, pair.max_error, band) for pair, band in each]
        paste, written = (setting.promised(text, promises) if text else "" for text in (paste, written))
    return TunedModel(setting.name, paste, written, tuple(notes), pairs)


def _speeds(request: Request, held_out: bool) -> list[float]:
    """Speeds over the band of a request, m/s; held out: those that lie between others."""
    low, high = min(request.speeds), max(request.speeds)
    speeds = np.geomspace(low, high, 2 * _HELD_OUT_SPEEDS + 1 if held_out else _TRIED_SPEEDS)
    return [float(v) for v in dict.fromkeys(speeds[1::2] if held_out else speeds)]


def _tuned_pair(
    setting: ModelSetting, request: Request, speeds: list[float], phases: int, wanted: RestitutionCurve
) -> TunedPair:
    """Launched at these speeds, at phases over the whole step."""
    each = tuple((i + 0.4) / phases for i in range(phases))
    worst, points = 0.0, []
    with setting.open(request) as model:
        for speed in speeds:
            launches = dataclasses.replace(request, speeds=(speed,), phases=each).launches()
            impacts = simulate.impacts_in(model, launches)
            restitutions = [i.restitution for i in impacts]
            touched = [i.speed_in for i in impacts if math.isfinite(i.speed_in)]
            v = float(np.mean(touched)) if touched else speed
            points.append((v, float(wanted.at(v)), min(restitutions), max(restitutions)))
            errors = [abs(i.restitution - float(wanted.at(i.speed_in))) for i in impacts]
            worst = max(worst, *(math.inf if math.isnan(error) else error for error in errors))
        return TunedPair(model.facts(), worst, tuple(points))
