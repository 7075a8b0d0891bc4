"""Parameters of engines' settings, by a search from three starts on
the training part of a data set.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, groupby
from pathlib import Path
from typing import Any

import numpy as np

from hcbench.reality.data_sets import SETS, Cell, Tick, outcome_of, run_each, settings_of
from hcbench.reality.motion import least
from hcbench.system.errors import EngineFailed
from hcbench.system.files import read_text
from hcbench.terms.impact import Floats
from hcbench.workers import WorkerPool

COMMITTED = Path(__file__).parent / "data" / "parameters.json"
STARTS = 3
# Simulations of a search from one start, by the number of parameters.
_EVALUATIONS = {1: 14, 2: 30, 3: 50}
# First step of the search, in the logarithm of each parameter.
_FIRST_STEP = 0.3
# Error of a scene that the engine cannot simulate.
_FAILED = 1e3

# Data set -> engine -> key of a setting -> name of a parameter -> value.
Parameters = Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]]


def committed() -> Parameters:
    """The parameters that a search of `identify` ended with, as shipped."""
    parameters: Parameters = json.loads(read_text(COMMITTED))
    return parameters


def values_of(parameters: Parameters, data: str, cell: Cell) -> tuple[float, ...] | None:
    """Values of the parameters of a cell's setting, in their order; None where one is not known.

    parameters: set -> engine -> setting -> name -> value, as `identify` gives them. What the data
    set fixes comes before them.
    """
    searched = parameters.get(data, {}).get(cell.engine, {}).get(cell.setting, {})
    known = {**searched, **SETS[data].FIXED}
    values = []
    for parameter in cell.contact.parameters:
        if parameter.name not in known:
            return None
        values.append(known[parameter.name])
    return tuple(values)


def identify(
    pool: WorkerPool,
    sets: Iterable[str],
    folders: Mapping[str, Path | None],
    tick: Tick | None = None,
) -> Parameters:
    """Parameters by three searches for each setting, to four digits.

    A mean error over a hundred tosses is rough in its parameters, as a corner may land or miss. The
    result is the minimum of a parabola fitted to the best third of all tries, not the luckiest try.

    sets: names of the data sets. folders: where their data are; None for those that are shipped.
    tick: called with (searches done, searches in all). Raises UserError for a folder that is not of
    a set's data; what an engine raises but EngineFailed, which counts as a bad try.
    """
    cells: list[Cell] = []
    for data in sets:
        cells.extend(_starts(data, folders.get(data)))
    # Longest first, so that no worker is left with a long one at the end.
    longest = sorted(cells, key=lambda cell: -len(cell.values))
    tries = dict(zip(longest, run_each(pool, search, longest, tick), strict=True))
    parameters: dict[str, Any] = {}
    for (data, engine, key), group in groupby(cells, lambda cell: cell.key):
        of_setting = list(group)
        first = of_setting[0]
        tries_of_setting = chain.from_iterable(tries[cell] for cell in of_setting)
        best = best_values(first, list(tries_of_setting))
        rounded = {}
        for parameter, value in zip(first.contact.parameters, best, strict=True):
            rounded[parameter.name] = float(f"{value:.4g}")
        parameters.setdefault(data, {}).setdefault(engine, {})[key] = rounded
    return parameters


def _starts(data: str, folder: Path | None) -> Iterator[Cell]:
    """A cell for each start of each setting that has parameters to search, on the training part;
    the starts of one setting follow one another.

    data: name of the set. folder: where its data are; None for those that are shipped.
    """
    module = SETS[data]
    for engine, setting in settings_of(data):
        if all(parameter.name in module.FIXED for parameter in setting.parameters):
            continue
        for i in range(STARTS):
            start = tuple(parameter.starts[i] for parameter in setting.parameters)
            yield Cell(data, engine, setting.key, start, module.TRAINING, folder)


def search(cell: Cell) -> list[tuple[Floats, float]]:
    """Tries of a search from the cell's values towards a least mean error: the natural logarithms
    of the parameters that move, shape (k,), and the error.

    To be run in a worker process of the cell's engine. A try that the engine fails at, or whose
    errors are not finite, has the error _FAILED.
    """
    tries: list[tuple[Floats, float]] = []

    def error(u: Floats) -> float:
        """Mean error of the bounces or tosses with some parameters; the try is noted.

        u: natural logarithms of the parameters that move, shape (k,).
        """
        try:
            mean = float(np.mean(outcome_of(replace(cell, values=_values(cell, u))).errors))
        except EngineFailed:
            mean = _FAILED
        if not np.isfinite(mean):
            mean = _FAILED
        tries.append((u.copy(), mean))
        return mean

    start = np.log([cell.values[i] for i in _moving(cell)])
    least(error, start, _FIRST_STEP, _EVALUATIONS[len(start)])
    return tries


def _moving(cell: Cell) -> list[int]:
    """Indices of the parameters of a cell that are not known otherwise."""
    fixed = SETS[cell.data].FIXED
    return [i for i, parameter in enumerate(cell.contact.parameters) if parameter.name not in fixed]


def _values(cell: Cell, u: Floats) -> tuple[float, ...]:
    """Values of all parameters of a cell's setting, in their order.

    u: natural logarithms of those that move, shape (k,). A value is at most the parameter's
    largest.
    """
    fixed = SETS[cell.data].FIXED
    moved = dict(zip(_moving(cell), u, strict=True))
    values = []
    for i, parameter in enumerate(cell.contact.parameters):
        if i in moved:
            values.append(min(float(np.exp(moved[i])), parameter.most))
        else:
            values.append(fixed[parameter.name])
    return tuple(values)


def best_values(cell: Cell, tries: Sequence[tuple[Floats, float]]) -> tuple[float, ...]:
    """A cell's parameters by tries of its searches."""
    return _values(cell, smooth_least(tries))


def smooth_least(tries: Sequence[tuple[Floats, float]]) -> Floats:
    """Minimum of a parabola fitted to the best third of the tries, shape (n,); the best try if
    those are too few, if the parabola has no minimum, or if that is outside of their ranges.

    tries: (point, shape (n,), and its score), one or more.
    """
    points, scores = map(np.array, zip(*tries, strict=True))
    better = np.argsort(scores, kind="stable")[: max(len(tries) // 3, 1)]
    points = points[better]
    best: Floats = points[0]
    low = points.min(axis=0)
    high = points.max(axis=0)
    scale = np.maximum(high - low, 1e-12)
    x = (points - best) / scale
    n = x.shape[1]
    # Columns of c + b x + x A x / 2, A symmetric: of A its upper triangle, with half of the
    # diagonal. With its transpose added below, the triangle is A.
    rows, cols = np.triu_indices(n)
    columns = np.concatenate([np.ones((len(x), 1)), x, x[:, rows] * x[:, cols]], axis=1)
    # Twice as many tries as coefficients, so that the fit smooths.
    if len(x) < 2 * columns.shape[1]:
        return best
    coefficients = np.linalg.lstsq(columns, scores[better], rcond=None)[0]
    slope = coefficients[1 : 1 + n]
    curvature = np.zeros((n, n))
    curvature[rows, cols] = coefficients[1 + n :]
    curvature = curvature + curvature.T
    if np.linalg.eigvalsh(curvature)[0] <= 0.0:
        return best
    at: Floats = best + scale * np.linalg.solve(curvature, -slope)
    if ((low <= at) & (at <= high)).all():
        return at
    return best
