"""Parameters of engines' settings, by a search from three starts on the training part of a data set."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from hcbench._files import read_text
from hcbench.errors import EngineFailed
from hcbench.impact import Floats
from hcbench.reality.cells import SETS, Cell, Tick, outcome_of, run_each, settings_of
from hcbench.reality.search import least
from hcbench.workers import WorkerPool

COMMITTED = Path(__file__).parent / "data" / "parameters.json"
STARTS = 3
_EVALUATIONS = {1: 14, 2: 30, 3: 50}  # of a search from one start, by the number of parameters
_FIRST_STEP = 0.3  # in the logarithm of each
_FAILED = 9.0  # score of what an engine cannot simulate

# Of a data set, an engine and a setting's key: values by the names of parameters.
Parameters = Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]]


def committed() -> Parameters:
    """Those that a search of `identify` ended with, as shipped."""
    parameters: Parameters = json.loads(read_text(COMMITTED))
    return parameters


def values_of(parameters: Parameters, data: str, cell: Cell) -> tuple[float, ...] | None:
    """A cell's values; None where they are not known."""
    known = dict(parameters.get(data, {}).get(cell.engine, {}).get(cell.setting, {})) | SETS[data].FIXED
    names = [p.name for p in cell.contact.parameters]
    return tuple(known[name] for name in names) if all(name in known for name in names) else None


def identify(
    pool: WorkerPool, sets: Iterable[str], folders: Mapping[str, Path | None], tick: Tick | None = None
) -> Parameters:
    """The best of three searches for each setting; to four digits."""
    cells = [
        Cell(data, engine, setting.key, start, SETS[data].TRAINING, folders.get(data))
        for data in sets
        for engine, setting in settings_of(data)
        if any(p.name not in SETS[data].FIXED for p in setting.parameters)
        for start in (tuple(p.starts[i] for p in setting.parameters) for i in range(STARTS))
    ]
    longest = sorted(cells, key=lambda cell: -len(cell.values))
    searched = dict(zip(longest, run_each(pool, search, longest, tick), strict=True))
    parameters: dict[str, Any] = {}
    for (data, engine, key), group in groupby(cells, lambda cell: (cell.data, cell.engine, cell.setting)):
        best = min((searched[cell] for cell in group), key=lambda pair: pair[1])[0]
        rounded = {name: float(f"{value:.4g}") for name, value in best.items()}
        parameters.setdefault(data, {}).setdefault(engine, {})[key] = rounded
    return parameters


def search(cell: Cell) -> tuple[dict[str, float], float]:
    """Parameters near the cell's values with the least mean score, and that score; in a worker process."""
    fixed: dict[str, float] = SETS[cell.data].FIXED
    names = [p.name for p in cell.contact.parameters]
    moving = [i for i, name in enumerate(names) if name not in fixed]
    most = np.array([cell.contact.parameters[i].most for i in moving])

    def values(u: Floats) -> dict[str, float]:
        return (
            dict(zip(names, cell.values, strict=True))
            | fixed
            | dict(zip((names[i] for i in moving), np.minimum(np.exp(u), most).tolist(), strict=True))
        )

    def score(u: Floats) -> float:
        given = values(u)
        try:
            mean = float(np.mean(outcome_of(replace(cell, values=tuple(given[n] for n in names))).scores))
        except EngineFailed:
            return _FAILED
        return mean if np.isfinite(mean) else _FAILED

    start = np.log([cell.values[i] for i in moving])
    best, worth = least(score, start, _FIRST_STEP, _EVALUATIONS[len(moving)])
    return values(best), worth
