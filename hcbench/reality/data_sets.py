"""Data sets of the study: their sources, and cells, each a setting of an engine on parts of a set."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from hcbench.reality import alumina, ball, cube, ellipse
from hcbench.reality.motion import SettingErrors
from hcbench.sim import registry
from hcbench.sim.remote import interpreter_of
from hcbench.sim.toss import ContactSetting, engines
from hcbench.system.errors import UserError
from hcbench.system.files import read_bytes
from hcbench.workers import WorkerPool, call

# Cells of the study: a setting of an engine on parts of a data set, run in a worker process.

SETS: dict[str, Any] = {"cube": cube, "ellipse": ellipse, "ball": ball, "alumina": alumina}

Tick = Callable[[int, int], None]
Job = TypeVar("Job", bound="Cell")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Cell:
    """A setting of an engine on parts of a data set.

    data: name of the set, one of SETS. engine: its name.
    setting: its key.
    values: of its parameters, in the order in which the setting has them.
    parts: numbers of the parts of the set, see its TRAINING and VALIDATION.
    folder: of the original data; None for those that are shipped.
    variant: of the data set: what of it is left as published, "" for nothing.
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
        """The setting itself."""
        (match,) = (each for each in self.module.SETTINGS if each.key == self.setting)
        setting: ContactSetting = match
        return setting

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

    sentence: what was measured. citation: of the publication. licence: of the data.
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
        "An acrylic cube of 105 mm is tossed onto a board 570 times, and tracked at 148 Hz until it rests.",
        "Pfrommer, Halm, Posa: ContactNets. Conference on Robot Learning, 2020, arXiv 2009.11193.",
        "BSD-3-Clause; its text is beside the shipped numbers.",
        "https://github.com/DAIRLab/contact-nets",
        "c3dc21c94577ff4ed99123f0b00bfe57bb2d1d90",
        cube.FOLDER,
        True,
    ),
    "ellipse": Source(
        "A plastic ellipse of 70 mm x 50 mm is dropped between two panes; 1718 impacts have velocities before"
        " and after.",
        "Fazeli, Donlon, Drumwright, Rodriguez: Empirical evaluation of common contact models for planar"
        " impact. ICRA 2017.",
        "BSD-3-Clause, of DAIRLab's copy; the original states none.",
        "https://github.com/DAIRLab/ImpactModeling",
        "f6c28898845da6d48efdd6c1c696db2fb3716edf",
        ellipse.FILE,
        True,
        "fafcb329cca4325659ca384bc9a3f43057608f21a178d37e45eefd6032ddf224",
    ),
    "ball": Source(
        "Table tennis balls with a measured spin bounce on a table; 109 bounces are seen well on both sides.",
        "Gossard, Tebbe, Ziegler, Zell: SpinDOE. IROS 2023, arXiv 2303.03879.",
        "None stated: not shipped.",
        "https://github.com/cogsys-tuebingen/spindoe",
        "e7046a84304c20ab53b3ead87d9f8ce96a050e0a",
        ball.FILE,
        False,
        ball.SHA256,
    ),
    "alumina": Source(
        "Alumina balls of 5 mm hit glass at 3.9 m/s and at any angle; 31 points are digitised from figures.",
        "Kharaz, Gorham, Salman: An experimental study of the elastic rebound of spheres. Powder Technology"
        " 120 (2001) 281.",
        "Facts; digitised in Kratos Multiphysics (BSD).",
        "https://github.com/KratosMultiphysics/Kratos",
        "650ccb263d910608aa74112ddb4c8fa45ca5ba96",
        "applications/DEMApplication/test_examples/basic_benchmarks/paper_data",
        True,
    ),
}


def find(name: str, data: Path | None) -> Path | None:
    """Folder of a data set's original repository: `data` itself, or a folder in it; None for
    neither, and for the set that is in no file.

    name: of the set. data: the user's folder; None for none.
    """
    if data is None or name == "alumina":
        return None
    path = SOURCES[name].path
    return next((each for each in (data, *sorted(data.glob("*"))) if (each / path).exists()), None)


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

    name: of the set, one of SOURCES. folder: of the original repository. Raises OSError for a file
    that cannot be read.
    """
    source = SOURCES[name]
    if not source.sha256:
        return False
    return hashlib.sha256(read_bytes(folder / source.path)).hexdigest() != source.sha256
