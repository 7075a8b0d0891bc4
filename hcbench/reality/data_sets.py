"""Data sets of the study: their sources; cells, each a setting of an engine on parts of a set; and
the search of the settings' parameters.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, groupby
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from hcbench.reality import alumina, ball, cube, ellipse
from hcbench.reality.motion import SettingErrors, least
from hcbench.sim import registry
from hcbench.sim.remote import interpreter_of
from hcbench.sim.toss import ContactSetting, engines
from hcbench.system.errors import EngineFailed, UserError
from hcbench.system.files import read_bytes, read_text
from hcbench.terms.impact import Floats
from hcbench.workers import WorkerPool, call

# Cells of the study: a setting of an engine on parts of a data set, run in a worker process.

SETS: dict[str, Any] = {"cube": cube, "ellipse": ellipse, "ball": ball, "alumina": alumina}

Tick = Callable[[int, int], None]
Job = TypeVar("Job", bound="Cell")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Cell:
    """A setting of an engine on parts of a data set.

    data: name of the set, one of SETS.
    engine: its name.
    setting: its key.
    values: of its parameters, in the order in which the setting has them.
    parts: numbers of the parts of the set, see its TRAINING and VALIDATION.
    folder: of the original data; None for those that are shipped.
    variant: of the data set: the part that is left as published, "" for nothing.
    """

    data: str
    engine: str
    setting: str
    values: tuple[float, ...]
    parts: tuple[int, ...]
    folder: Path | None = None
    variant: str = ""

    @property
    def key(self) -> tuple[str, str, str]:
        """Data set, engine and setting."""
        return self.data, self.engine, self.setting

    @property
    def contact(self) -> ContactSetting:
        """The setting itself, by its key. Raises KeyError for one that the engine does not have."""
        settings: dict[str, ContactSetting] = {one.key: one for one in self.module.SETTINGS}
        return settings[self.setting]

    @property
    def module(self) -> Any:
        """Module `toss` of the engine."""
        return registry.submodule(self.engine, "toss")

    @property
    def cases(self) -> Any:
        """Measured motions or bounces of the cell's data set."""
        return _cases(self.data, self.parts, self.folder, self.variant)


@lru_cache(maxsize=8)
def _cases(data: str, parts: tuple[int, ...], folder: Path | None, variant: str) -> Any:
    """Kept: a worker process meets the same many times."""
    return SETS[data].cases(parts, folder, variant)


def outcome_of(cell: Cell) -> SettingErrors:
    """Errors of a cell's setting. To be run in a worker process of its engine.

    Raises UserError for a folder that is not of the set's data, and what the engine raises.
    """
    outcome: SettingErrors = SETS[cell.data].outcome(
        cell.module, cell.contact, cell.values, cell.cases
    )
    return outcome


def require_sets(names: str) -> list[str]:
    """Names of data sets, each once, from a list with commas such as "cube, ball".

    Raises UserError for a name that is not in SETS.
    """
    chosen = list(dict.fromkeys(name.strip() for name in names.split(",")))
    for name in chosen:
        if name not in SETS:
            raise UserError(
                "--sets", repr(name), f"some of {', '.join(SETS)}, with commas between them"
            )
    return chosen


def installed() -> list[str]:
    """Engines that can simulate a toss and are installed."""
    return [name for name, _ in engines() if registry.is_there(name)]


def settings_of(data: str) -> Iterator[tuple[str, ContactSetting]]:
    """(engine, setting) of what can be tried on a data set, by the engines that are installed.

    data: name of the set. A set without a training part has only settings whose parameters it
    fixes.
    """
    known = SETS[data]
    for engine in installed():
        module: Any = registry.submodule(engine, "toss")
        if known.body().shape not in module.SHAPES:
            continue
        for setting in module.SETTINGS:
            if known.TRAINING or all(p.name in known.FIXED for p in setting.parameters):
                yield engine, setting


def parts_of(data: str, part: int | None) -> tuple[int, ...]:
    """Parts to judge: one, or a set's validation parts."""
    own: tuple[int, ...] = SETS[data].VALIDATION
    return own if part is None or not SETS[data].TRAINING else (part,)


def run_each(
    pool: WorkerPool,
    function: Callable[[Job], Result],
    cells: Sequence[Job],
    tick: Tick | None = None,
) -> list[Result]:
    """The results of cells, in order, each computed in a worker process of its engine.

    function: crosses to that process by its name.
    tick: called with (results so far, results in all). Raises what the function raises, and
    WorkerDied where an engine crashes.
    """

    def one(cell: Job) -> Result:
        return call(function, cell, limit=None, at=interpreter_of(registry.engine(cell.engine)))

    results = []
    for done, result in enumerate(pool.threads.map(one, cells), 1):
        results.append(result)
        if tick is not None:
            tick(done, len(cells))
    return results


# Sources of the data sets: a description, citation, licence and files of each.


@dataclass(frozen=True, slots=True)
class Source:
    """A data set's origin.

    sentence: what was measured.
    citation: of the publication.
    licence: of the data.
    repository, commit: of the original.
    path: of its file, or folder of files, in the repository.
    shipped: whether hcbench has it.
    sha256: of the file at `path`; "" for a folder.
    """

    sentence: str
    citation: str
    licence: str
    repository: str
    commit: str
    path: str
    shipped: bool
    sha256: str = ""


SOURCES = {
    "cube": Source(
        sentence=(
            "An acrylic cube of 105 mm is tossed onto a board 570 times, and tracked at 148"
            " Hz until it rests."
        ),
        citation=(
            "Pfrommer, Halm, Posa: ContactNets. Conference on Robot Learning, 2020, arXiv"
            " 2009.11193."
        ),
        licence="BSD-3-Clause; its text is beside the shipped numbers.",
        repository="https://github.com/DAIRLab/contact-nets",
        commit="c3dc21c94577ff4ed99123f0b00bfe57bb2d1d90",
        path=cube.FOLDER,
        shipped=True,
    ),
    "ellipse": Source(
        sentence=(
            "A plastic ellipse of 70 mm x 50 mm is dropped between two panes; 1718 impacts"
            " have velocities before"
            " and after."
        ),
        citation=(
            "Fazeli, Donlon, Drumwright, Rodriguez: Empirical evaluation of common contact"
            " models for planar"
            " impact. ICRA 2017."
        ),
        licence="BSD-3-Clause, of DAIRLab's copy; the original states none.",
        repository="https://github.com/DAIRLab/ImpactModeling",
        commit="f6c28898845da6d48efdd6c1c696db2fb3716edf",
        path=ellipse.FILE,
        shipped=True,
        sha256="fafcb329cca4325659ca384bc9a3f43057608f21a178d37e45eefd6032ddf224",
    ),
    "ball": Source(
        sentence=(
            "Table tennis balls with a measured spin bounce on a table; 109 bounces are seen"
            " well on both sides."
        ),
        citation="Gossard, Tebbe, Ziegler, Zell: SpinDOE. IROS 2023, arXiv 2303.03879.",
        licence="None stated: not shipped.",
        repository="https://github.com/cogsys-tuebingen/spindoe",
        commit="e7046a84304c20ab53b3ead87d9f8ce96a050e0a",
        path=ball.FILE,
        shipped=False,
        sha256=ball.SHA256,
    ),
    "alumina": Source(
        sentence=(
            "Alumina balls of 5 mm hit glass at 3.9 m/s and at any angle; 31 points are"
            " digitised from figures."
        ),
        citation=(
            "Kharaz, Gorham, Salman: An experimental study of the elastic rebound of"
            " spheres. Powder Technology"
            " 120 (2001) 281."
        ),
        licence="Facts; digitised in Kratos Multiphysics (BSD).",
        repository="https://github.com/KratosMultiphysics/Kratos",
        commit="650ccb263d910608aa74112ddb4c8fa45ca5ba96",
        path="applications/DEMApplication/test_examples/basic_benchmarks/paper_data",
        shipped=True,
    ),
}


def find(name: str, data: Path | None) -> Path | None:
    """Folder of a data set's original repository: `data` itself, or a folder in it; None for
    neither, and for the set that is in no file.

    name: of the set.
    data: the user's folder; None for none.
    """
    if data is None or name == "alumina":
        return None
    path = SOURCES[name].path
    return next(
        (folder for folder in (data, *sorted(data.glob("*"))) if (folder / path).exists()), None
    )


def missing(name: str) -> str:
    """Description of the files to download before a data set can be used, for an error; "" for one
    that is shipped.

    name: of the set, one of SOURCES.
    """
    source = SOURCES[name]
    if source.shipped:
        return ""
    return (
        f"a folder with {source.path} of {source.repository} "
        f"({source.commit[:7]}, SHA-256 {source.sha256})"
    )


def differs(name: str, folder: Path) -> bool:
    """Say whether a data set's file differs from the one that the parameters and numbers here
    belong to; False for a set of many files.

    name: of the set, one of SOURCES.
    folder: of the original repository.
    Raises OSError for a file that cannot be read.
    """
    source = SOURCES[name]
    if not source.sha256:
        return False
    return hashlib.sha256(read_bytes(folder / source.path)).hexdigest() != source.sha256


# Parameters of engines' settings, by a search from three starts on the training part of a data
# set.

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

    parameters: set -> engine -> setting -> name -> value.
    data: name of the set. What the data set fixes goes before them.
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

    sets: names of the data sets.
    folders: where their data are; None for those that are shipped.
    tick: called with (searches done, searches in all).
    Raises UserError for a folder that is not of a set's data; what an engine raises but
    EngineFailed, which counts as a bad try.
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

    data: name of the set.
    folder: where its data are; None for those that are shipped.
    """
    module = SETS[data]
    for engine, setting in settings_of(data):
        if all(parameter.name in module.FIXED for parameter in setting.parameters):
            continue
        for i in range(STARTS):
            start = tuple(parameter.starts[i] for parameter in setting.parameters)
            yield Cell(
                data=data,
                engine=engine,
                setting=setting.key,
                values=start,
                parts=module.TRAINING,
                folder=folder,
            )


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
    # (m, n) and (m,) of m tries.
    points, scores = map(np.array, zip(*tries, strict=True))
    better = np.argsort(scores, kind="stable")[: max(len(tries) // 3, 1)]
    points = points[better]
    best: Floats = points[0]
    low = points.min(axis=0)
    high = points.max(axis=0)
    # In shares of the ranges, from the best try.
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
    # The least eigenvalue comes first.
    if np.linalg.eigvalsh(curvature)[0] <= 0.0:
        return best
    at: Floats = best + scale * np.linalg.solve(curvature, -slope)
    if ((low <= at) & (at <= high)).all():
        return at
    return best
