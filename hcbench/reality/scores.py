"""The table scores.csv: the mean error of each setting on each data set, with its interval."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from hcbench.reality.cells import SETS, Cell
from hcbench.reality.motion import interval
from hcbench.reality.outcome import SettingErrors

FILE = "scores.csv"
# Engine of the rows that are floors.
NO_ENGINE = "none"


@dataclass(frozen=True, slots=True)
class SettingScore:
    """A line: a mean error with its 95 % interval over n tosses or bounces.

    cone: of friction, where the engine has several.
    rotation_deg: mean angle, of tosses.
    """

    set: str
    engine: str
    setting: str
    cone: str
    error: float
    error_low: float
    error_high: float
    unit: str
    rotation_deg: float | None
    n: int


def of_cell(cell: Cell, outcome: SettingErrors) -> SettingScore:
    """Score of the engine's setting in a cell."""
    return of_outcome(cell.data, cell.engine, cell.contact.name, cell.contact.cone, outcome)


def of_outcome(
    data: str, engine: str, setting: str, cone: str, outcome: SettingErrors
) -> SettingScore:
    """The score of a setting or of a floor."""
    low, high = interval(outcome.errors)
    turned = None if outcome.rotations is None else float(np.degrees(outcome.rotations.mean()))
    mean = float(outcome.errors.mean())
    return SettingScore(
        data, engine, setting, cone, mean, low, high, SETS[data].UNIT, turned, len(outcome.errors)
    )


def csv_text(scores: Iterable[SettingScore]) -> str:
    """The table.

    A line each, with a header; numbers in five digits.
    """
    text = io.StringIO()
    names = [field.name for field in fields(SettingScore)]
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    for score in scores:
        row = asdict(score)
        for name, value in row.items():
            if isinstance(value, float):
                row[name] = f"{value:.5g}"
        writer.writerow(row)
    return text.getvalue()


def sets_in(folder: Path) -> set[str]:
    """Data sets of the study in a folder; empty without a study."""
    try:
        with (folder / FILE).open(encoding="utf-8", newline="") as file:
            return {row["set"] for row in csv.DictReader(file)}
    except (OSError, ValueError, KeyError, csv.Error):
        return set()
