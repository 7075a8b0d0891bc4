"""Recorded trajectories as an engine: measured data, or a test's own,
through the door that engines use.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import hcbench
from hcbench.sim.engine import Engine
from hcbench.sim.read_impact import impact_of
from hcbench.system.errors import SettingError
from hcbench.system.files import read_text
from hcbench.terms.impact import Impact, Launch, Trajectory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

COLUMNS = ("time_s", "penetration_m", "rate_m_per_s", "force_n")
# Printed times are rounded; impact_of needs one step for all.
_STEP_SPREAD = 0.01


class RecordedEngine(Engine):
    """An engine that hands back the impact that a file holds: what was recorded is what
    counts, not what was asked for.

    Option "file": a CSV with the columns time_s, penetration_m, rate_m_per_s, force_n (others are
    ignored), even in time, signs as in `terms.impact`; the body is clear of the plate in the
    first row and, if it parts, in the last. Or a list of files, one for each launch. Relative
    paths are from the working folder.
    """

    name = "recorded"

    def version(self) -> str:
        """The version of hcbench."""
        return str(hcbench.__version__)

    def impacts(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """The recorded impact for each launch, in order; the scene does not enter.

        Raises SettingError for an option other than "file", and for a file that is not a recording.
        """
        files = _files(setting, len(launches))
        trajectories = {file: read(Path(file)) for file in dict.fromkeys(files)}
        return [
            impact_of(launch, trajectories[file])
            for file, launch in zip(files, launches, strict=True)
        ]


def _files(setting: Setting, count: int) -> list[str]:
    """Path of the file of each of `count` launches; one file stands for all.

    Raises SettingError for any other option, and for another number of files.
    """
    unknown = [name for name in setting.options if name != "file"]
    if unknown:
        raise SettingError("recorded option", repr(unknown[0]), "'file'")
    given = setting.options.get("file")
    if isinstance(given, str):
        return [given] * count
    if isinstance(given, list | tuple) and given and all(isinstance(file, str) for file in given):
        if len(given) != count:
            raise SettingError(
                "recorded option 'file'",
                f"{len(given)} files for {count} launches",
                "one each, or a single one",
            )
        return list(given)
    got = "missing" if given is None else repr(given)
    raise SettingError("recorded option 'file'", got, "the path of a CSV file, or a list of them")


def read(file: Path) -> Trajectory:
    """The trajectory in a CSV file with the columns time_s, penetration_m, rate_m_per_s and force_n;
    others are ignored.

    Raises SettingError for a file that cannot be read, lacks a column, has something else than a
    number there, or whose times do not rise in even steps; it names file, line and column.
    """
    slot = f"recording {file}"
    columns = f"the columns {', '.join(COLUMNS)}"
    try:
        rows = list(csv.DictReader(io.StringIO(read_text(file), newline="")))
        header = list(rows[0]) if rows else []
    except (OSError, ValueError, csv.Error) as error:
        raise SettingError(
            slot, f"could not be read: {error}", f"a CSV file with {columns}"
        ) from error
    if not rows:
        raise SettingError(slot, "no rows", f"a line of names and two rows or more, {columns}")
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise SettingError(slot, f"no column {missing[0]!r} among {header}", columns)
    # In the order of a Trajectory's fields: time, s; penetration, m; its rate, m/s; force, N.
    values = np.empty((len(COLUMNS), len(rows)))
    for i, row in enumerate(rows):
        values[:, i] = [_number(slot, i, name, row[name]) for name in COLUMNS]
    _check_times(slot, values[0])
    return Trajectory(*values)


def _number(slot: str, index: int, name: str, text: str | None) -> float:
    """A number of the file, SI. Raises SettingError with the line and the column for a text that is
    none.

    slot: names the file in errors.
    index: of the row, from 0.
    name: of the column.
    text: None for a row that ends before it.
    """
    try:
        return float(text or "")
    except ValueError:
        # The names are on line 1.
        raise SettingError(
            slot, f"{text!r} on line {index + 2}, column {name!r}", "a number, SI"
        ) from None


def _check_times(slot: str, time: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    """Raise SettingError for times that do not rise in even steps, or are fewer than two.

    slot: names the file in errors.
    time: s, (n,).
    """
    if len(time) < 2:
        raise SettingError(slot, "one row", "two rows or more, even in time")
    if not np.isfinite(time).all():
        raise SettingError(slot, "a time_s that is not finite", "times that rise in even steps")
    steps = np.diff(time)
    mean = float(time[-1] - time[0]) / len(steps)
    if not (mean > 0 and (np.abs(steps - mean) <= _STEP_SPREAD * mean).all()):
        raise SettingError(
            slot,
            f"time_s in steps of {steps.min():.6g} ... {steps.max():.6g} s",
            "times that rise in even steps",
            "Resample it first",
        )
