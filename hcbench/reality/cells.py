"""Cells of the study: a setting of an engine on parts of a data set, run in a worker process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from hcbench.reality import alumina, ball, cube, ellipse
from hcbench.reality.outcome import SettingErrors
from hcbench.sim import registry
from hcbench.sim.remote import interpreter_of
from hcbench.sim.toss import ContactSetting, engines
from hcbench.system.errors import UserError
from hcbench.workers import WorkerPool, call

SETS: dict[str, Any] = {"cube": cube, "ellipse": ellipse, "ball": ball, "alumina": alumina}

Tick = Callable[[int, int], None]
Job = TypeVar("Job", bound="Cell")
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Cell:
    """A setting of an engine on parts of a data set.

    setting: its key.
    values: of its parameters.
    folder: of the original data.
    variant: of the data set.
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
        """Module `scene.toss` of the engine."""
        return registry.submodule(self.engine, "scene.toss")

    @property
    def cases(self) -> Any:
        """Measured motions or bounces of the cell's data set."""
        return _cases(self.data, self.parts, self.folder, self.variant)


@lru_cache(maxsize=8)
def _cases(data: str, parts: tuple[int, ...], folder: Path | None, variant: str) -> Any:
    """Kept: a worker process meets the same many times."""
    return SETS[data].cases(parts, folder, variant)


def outcome_of(cell: Cell) -> SettingErrors:
    """Errors of a cell's setting, computed in a worker process."""
    outcome: SettingErrors = SETS[cell.data].outcome(
        cell.module, cell.contact, cell.values, cell.cases
    )
    return outcome


def require_sets(names: str) -> list[str]:
    """Names of data sets, from a list with commas; UserError for an unknown one."""
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
        module: Any = registry.submodule(engine, "scene.toss")
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
    """The results of cells, in order, each where its engine is."""

    def one(cell: Job) -> Result:
        return call(function, cell, limit=None, at=interpreter_of(registry.engine(cell.engine)))

    results = []
    for done, result in enumerate(pool.threads.map(one, cells), 1):
        results.append(result)
        if tick is not None:
            tick(done, len(cells))
    return results
