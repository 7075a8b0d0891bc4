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
    """The matrix at a step. sentences: of `headline`. rows: of `cells.rows`."""

    gravity: float
    step: float
    sentences: Sequence[str]
    band: str
    constant: str
    rows: Mapping[str, Mapping[str, MatrixCell]]


def tables(view: FieldView) -> list[StepMatrix]:
    """The matrix of engines by condition at every step, with gravity and without."""
    return [
        StepMatrix(
            gravity,
            step,
            headline(view, gravity, step),
            band(view, step),
            error(view.constant_error(step)),
            rows(view, gravity, step),
        )
        for gravity in view.gravities
        for step in view.steps
    ]


def setting_of(view: FieldView, case: Case) -> Setting:
    """The setting that a case ran with."""
    for record in view.results.settings:
        key = (record["engine"], record["setting"], record["gravity_m_per_s2"], record["timestep_s"])
        if key == tuple(case):
            return Setting(case.engine, case.setting, case.timestep, record["options"])
    raise AssertionError(f"{case} is of the study")


def page_data(view: FieldView, made: Iterable[StepMatrix]) -> str:
    """Data for the page's script, as JSON: the tables, and each of their cases and texts once."""
    cases: dict[Case, int] = {}
    texts: dict[str, int] = {}
    shown = []
    for table in made:
        cells = [
            [engine, [_cell(cell, cases) for cell in row.values()]] for engine, row in table.rows.items()
        ]
        words = {"sentences": table.sentences, "band": table.band, "constant": table.constant}
        shown.append({"gravity": table.gravity, "step": table.step, **words, "rows": cells})
    recipes = {f"{case.engine} {case.setting}": view.recipe(case) for case in cases}
    content = {
        "alpha": view.alpha,
        "titles": {engine: engine_title(registry.base_name(engine)) for engine in view.engines},
        "tables": shown,
        "recipes": {key: [one.summary, *one.notes] for key, one in recipes.items() if one is not None},
        "cases": [_case(view, case, texts) for case in cases],
        "texts": list(texts),
    }
    return json.dumps(content, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")


def _cell(cell: MatrixCell, cases: dict[Case, int]) -> list[Any]:
    """A cell as the script takes it: text, line below, grade, sort key, number of its case, note."""
    order = None if cell.order is None or not math.isfinite(cell.order) else float(f"{cell.order:.4g}")
    number_of_case = None if cell.case is None else cases.setdefault(cell.case, len(cases))
    return [cell.text, cell.below, cell.grade, order, number_of_case, cell.note]


def _case(view: FieldView, case: Case, texts: dict[str, int]) -> dict[str, Any]:
    """e over speed (m/s): its mean, and its range over the launches where they differ."""
    curve = view.curve(case)
    speed, low, mean, high = (
        digits(values, 5) for values in (curve.speed_in, curve.lowest, curve.restitution, curve.highest)
    )
    setting = "nothing set" if case.setting == STOCK else case.setting
    text = snippet(setting_of(view, case), "plane")
    return {
        "title": f"{view.title(case.engine)}, {setting}, {time(case.timestep)}",
        "recipe": f"{case.engine} {case.setting}",
        "lines": _lines(view, case),
        "text": texts.setdefault(text, len(texts)) if text else None,
        "source": _source(view, case),
        "speed": speed,
        "mean": mean,
        **({} if low == high else {"low": low, "high": high}),
    }


def _lines(view: FieldView, case: Case) -> list[str]:
    """Sentences on a setting's error of e, its energy, and slow impacts."""
    off, down = view.off(case), view.stays_down(case)
    lines = []
    if math.isfinite(off):
        lines.append(f"At {band(view, case.timestep)}, e is wrong by at most {error(off)}.")
    if view.gains(case):
        lines.append(f"It adds energy: e up to {number(view.restitution(case)[1])}.")
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
