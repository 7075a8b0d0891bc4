"""Tunes a pair of a user's own model: settings of its engine tried in it, under its own step and gravity."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench.errors import UserError
from hcbench.laws.restitution import RestitutionCurve
from hcbench.measure.measure import LIMIT_S, Job, run_job, source_of
from hcbench.sim import simulate
from hcbench.sim.model_under_test import Facts, ModelSetting, Request

_TRIED_SPEEDS, _TRIED_PHASES = 4, 4
_HELD_OUT_SPEEDS, _HELD_OUT_PHASES = 7, 8


@dataclass(frozen=True, slots=True)
class TunedModel:
    """A setting for a pair in its own model, and how it does there.

    paste: lines for the model or script. written: the whole model with them, "" where the engine has no such
    text. points: (launch speed m/s, e wanted, lowest e, highest e) at held-out speeds, 8 phases each.
    max_error: the largest |e - wanted| of these; 1 where an impact has no e. constant: the one e aimed at.
    """

    facts: Facts
    name: str
    paste: str
    written: str
    notes: tuple[str, ...]
    constant: float
    max_error: float
    points: tuple[tuple[float, float, float, float], ...]


def tune_model(
    source: Any,
    request: Request,
    wanted: RestitutionCurve,
    engine: str | None = None,
    limit: float = LIMIT_S,
) -> TunedModel:
    """The setting of all that the engine offers for the pair whose e is nearest to what is wanted.

    request: its speeds span the band. Files are run in a worker. UserError for a pair that cannot meet.
    """
    return run_job(_tuned, Job(source, engine, request, wanted, 0.0, False), limit)


def _tuned(job: Job) -> TunedModel:
    wanted, request = job.wanted, job.request
    assert wanted is not None
    engine, source, rebuild = source_of(job)
    low, high = min(request.speeds), max(request.speeds)
    band = np.geomspace(low, high, _TRIED_SPEEDS if high > low else 1)
    e = wanted.at(np.geomspace(low, high, 50))
    constant = float((e.min() + e.max()) / 2)
    best: tuple[float, ModelSetting] | None = None
    for setting in engine.model_settings(source, request, constant, rebuild):
        error = _max_error(setting, band.tolist(), _TRIED_PHASES, wanted)[0]
        if best is None or error < best[0]:
            best = error, setting
    if best is None:
        raise UserError("tune", "no setting of this engine fits the pair", "a pair of another model")
    setting = best[1]
    held_out = np.geomspace(low, high, 2 * _HELD_OUT_SPEEDS + 1)[1::2].tolist() if high > low else [low]
    error, points, facts = _max_error(setting, held_out, _HELD_OUT_PHASES, wanted)
    notes = (*setting.notes, *facts.notes)
    return TunedModel(facts, setting.name, setting.paste, setting.written, notes, constant, error, points)


def _max_error(
    setting: ModelSetting, speeds: list[float], phases: int, wanted: RestitutionCurve
) -> tuple[float, tuple[tuple[float, float, float, float], ...], Facts]:
    """(largest |e - wanted|, (speed, e wanted, lowest e, highest e) of each speed, facts)."""
    each = tuple((i + 0.4) / phases for i in range(phases))
    worst, points = 0.0, []
    with setting.open() as model:
        for speed in speeds:
            launches = dataclasses.replace(setting.request, speeds=(speed,), phases=each).launches()
            impacts = simulate.impacts_in(model, launches)
            found = [i.restitution for i in impacts]
            goal = float(wanted.at(speed))
            points.append((speed, goal, min(found), max(found)))
            errors = [abs(i.restitution - float(wanted.at(i.speed_in))) for i in impacts]
            worst = max(worst, *(1.0 if math.isnan(error) else error for error in errors))
        return worst, tuple(points), model.facts()
