"""Panel behind a cell of the matrix: words, a curve, the text to paste and its source."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hcbench.reporting.explorer import digits
from hcbench.reporting.field.cells import MatrixCell, rows
from hcbench.reporting.field.headline import band, headline
from hcbench.reporting.field.view import STOCK, Case, FieldView
from hcbench.reporting.wording import engine_title, error, number, time
from hcbench.sim import registry
from hcbench.system.text import time_step
from hcbench.terms.setting import Setting
from hcbench.tuning.model import snippet

if TYPE_CHECKING:
    from collections.abc import Iterable


@dataclass(frozen=True, slots=True)
class StepMatrix:
    """The matrix at a step.

    sentences: of `headline`.
    rows: of `cells.rows`.
    """

    gravity: float
    step: float
    sentences: Sequence[str]
    band: str
    constant: str
    rows: Mapping[str, Mapping[str, MatrixCell]]


def tables(view: FieldView) -> list[StepMatrix]:
    """The matrix of engines by condition at every step, with gravity and without."""
    made = []
    for gravity in view.gravities:
        for step in view.steps:
            matrix = StepMatrix(
                gravity=gravity,
                step=step,
                sentences=headline(view, gravity, step),
                band=band(view, step),
                constant=error(view.constant_error(step)),
                rows=rows(view, gravity, step),
            )
            made.append(matrix)
    return made


def setting_of(view: FieldView, case: Case) -> Setting:
    """The setting that a case ran with."""
    for record in view.results.settings:
        key = (
            record["engine"],
            record["setting"],
            record["gravity_m_per_s2"],
            record["timestep_s"],
        )
        if key == tuple(case):
            return Setting(case.engine, case.setting, case.timestep, record["options"])
    raise AssertionError(f"{case} is of the study")


def page_data(view: FieldView, made: Iterable[StepMatrix]) -> str:
    """Data for the page's script, as JSON: the tables, and each of their cases and texts once."""
    numbers: dict[Case, int] = {}
    shown = [_table(table, numbers) for table in made]
    recipes = {}
    for case in numbers:
        recipe = view.recipe(case)
        if recipe is not None:
            recipes[f"{case.engine} {case.setting}"] = [recipe.summary, *recipe.notes]
    texts: dict[str, int] = {}
    content = {
        "alpha": view.alpha,
        "titles": {engine: engine_title(registry.base_name(engine)) for engine in view.engines},
        "tables": shown,
        "recipes": recipes,
        "cases": [_case(view, case, texts) for case in numbers],
        "texts": list(texts),
    }
    return json.dumps(content, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def _table(table: StepMatrix, numbers: dict[Case, int]) -> dict[str, Any]:
    """A table as the script takes it.

    numbers: of the cases so far; new ones are added.
    """
    table_rows = []
    for engine, row in table.rows.items():
        table_rows.append([engine, [_cell(cell, numbers) for cell in row.values()]])
    return {
        "gravity": table.gravity,
        "step": table.step,
        "sentences": table.sentences,
        "band": table.band,
        "constant": table.constant,
        "rows": table_rows,
    }


def _cell(cell: MatrixCell, numbers: dict[Case, int]) -> list[Any]:
    """A cell as the script takes it: text, line below, grade, sort key, number of its case, note.

    numbers: of the cases so far; that of the cell is added.
    """
    order = None
    if cell.order is not None and math.isfinite(cell.order):
        order = float(f"{cell.order:.4g}")
    number_of_case = None
    if cell.case is not None:
        number_of_case = numbers.setdefault(cell.case, len(numbers))
    return [cell.text, cell.below, cell.grade, order, number_of_case, cell.note]


def _case(view: FieldView, case: Case, texts: dict[str, int]) -> dict[str, Any]:
    """e over speed (m/s): its mean, and its range over the launches where they differ.

    texts: numbers of the texts to paste so far; that of the case is added.
    """
    setting = "nothing set" if case.setting == STOCK else case.setting
    text = snippet(setting_of(view, case), "plane")
    number_of_text = None
    if text:
        number_of_text = texts.setdefault(text, len(texts))
    curve = view.curve(case)
    low = digits(curve.lowest, 5)
    high = digits(curve.highest, 5)
    content = {
        "title": f"{view.title(case.engine)}, {setting}, {time(case.timestep)}",
        "recipe": f"{case.engine} {case.setting}",
        "lines": _lines(view, case),
        "text": number_of_text,
        "source": _source(view, case),
        "speed": digits(curve.speed_in, 5),
        "mean": digits(curve.restitution, 5),
    }
    if low != high:
        content["low"] = low
        content["high"] = high
    return content


def _lines(view: FieldView, case: Case) -> list[str]:
    """Sentences on a setting's error of e, its energy, and slow impacts."""
    off = view.off(case)
    down = view.stays_down(case)
    lines = []
    if math.isfinite(off):
        lines.append(f"At {band(view, case.timestep)}, e is wrong by at most {error(off)}.")
    if view.gains(case):
        lines.append(f"It adds energy: e up to {number(view.largest_e(case))}.")
    elif case.setting != STOCK and math.isfinite(off):
        lines.append(f"Energy never grew in {view.scenes(case)} launches.")
    if math.isinf(down):
        lines.append("A body stays down after every impact.")
    elif down:
        lines.append(f"A body stays down after an impact below {down:.3g} m/s.")
    return lines


def _source(view: FieldView, case: Case) -> str:
    """The command that gives the same setting and its error."""
    if case.setting == STOCK:
        return ""
    low, high = view.speeds(case.timestep)[[0, -1]]
    what = f'--alpha "{view.alpha:.6g} s/m" --speeds "{low:.4g}:{high:.4g} m/s"'
    where = f"--timestep {time_step(case.timestep)} --gravity {case.gravity:g}"
    return f"hcbench tune {case.engine} --recipe {case.setting} {what} {where}"
