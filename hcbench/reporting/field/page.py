"""The field page: engines by condition, their errors over the step, their loops and features."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D

from hcbench.cases.score import measured
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.reporting.explorer import as_json, digits
from hcbench.reporting.field import cells
from hcbench.reporting.field.cells import MatrixCell, case_table, rows
from hcbench.reporting.field.view import PLUGIN, STOCK, Case, FieldView, band, headline, versions
from hcbench.reporting.page import PAGE, Drawing, counted, csv_of, draw, render, script
from hcbench.reporting.plot_style import (
    KIND_COLOURS,
    LAW,
    draw_loop,
    legend_below,
    log_axis,
    new_figure,
)
from hcbench.reporting.wording import engine_title, error, number, time
from hcbench.sim import registry
from hcbench.sim.install import add_commands
from hcbench.system.files import atomic_folder, write_text
from hcbench.system.text import time_step
from hcbench.terms.setting import Setting
from hcbench.tuning.model import snippet

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hcbench.benchmark.results import Results
    from hcbench.workers import WorkerPool

# Figures of the field page: a panel an engine.

# Panels side by side, at most.
_COLUMNS = 4
# Limits of the errors in figures: smaller and larger ones are drawn there.
_FLOOR = 1e-8
_CEILING = 30.0
_STOCK: dict[str, Any] = {"color": KIND_COLOURS["stock"], "marker": "X", "markersize": 5.0}
_BEST: dict[str, Any] = {"color": KIND_COLOURS["settings"], "marker": "s", "markersize": 3.5}
_PLUGIN: dict[str, Any] = {"color": KIND_COLOURS["exact"], "marker": "v", "markersize": 4.0}
_HEAVY: dict[str, Any] = {"linestyle": (0, (4, 1.6)), "markerfacecolor": "white"}
_CONSTANT: dict[str, Any] = {
    "color": KIND_COLOURS["constant"],
    "linewidth": 1.0,
    "linestyle": (0, (5, 2)),
}
_LAW: dict[str, Any] = {"color": LAW, "linewidth": 6, "solid_capstyle": "butt", "zorder": 1}


def drawings(view: FieldView) -> list[Drawing]:
    """The figures of a page: errors over the step, and loops, which are empty where no contact of
    the study is resolved.
    """
    missing = ""
    make_loops = partial(loops_figure, view)
    if not any(_with_loops(view)):
        missing = "no engine of this study resolves its contact"
    steps = "Error of e over the time step, a panel an engine."
    loops = "Force over penetration, a panel an engine."
    return [
        Drawing("field-steps", partial(steps_figure, view), steps),
        Drawing("field-loops", None if missing else make_loops, loops, missing),
    ]


def steps_figure(view: FieldView) -> Figure:
    """Largest error of e over the step (s), a panel an engine: nothing set, best setting,
    plug-in; without gravity and with, dashed. Errors beyond the panel are drawn at its edge.
    """
    figure, panels = _panels(view, view.engines)
    # Function that gives a case by engine, gravity (m/s²) and step (s), and the style of its line.
    kinds: list[tuple[Callable[[str, float, float], Case | None], dict[str, Any]]] = [
        (view.stock, _STOCK),
        (view.best, _BEST),
        (lambda engine, gravity, step: view.best(engine, gravity, step, PLUGIN), _PLUGIN),
    ]
    for engine, axes in panels:
        axes.plot(view.steps, [view.constant_error(step) for step in view.steps], **_CONSTANT)
        for pick, style in kinds:
            for gravity in view.gravities:
                steps = []
                errors = []
                for step in view.steps:
                    case = pick(engine, gravity, step)
                    if case is not None:
                        steps.append(step)
                        errors.append(view.off(case))
                line = {"linewidth": 1.3, **style}
                if gravity:
                    line |= _HEAVY
                axes.plot(steps, np.clip(errors, _FLOOR, _CEILING), **line)
        log_axis(axes, "x")
        log_axis(axes, "y")
        axes.set_xlim(min(view.steps) / 1.6, max(view.steps) * 1.6)
        axes.set_ylim(_FLOOR / 1.5, _CEILING)
    _label(panels, "time step, s", "error of e")
    legend = [
        Line2D([], [], label="nothing set", **_STOCK),
        Line2D([], [], label="best setting of its own", **_BEST),
        Line2D([], [], label="plug-in", **_PLUGIN),
    ]
    if any(view.gravities):
        legend.append(Line2D([], [], label="the same under gravity", **{**_BEST, **_HEAVY}))
    legend.append(Line2D([], [], label="best constant e", **_CONSTANT))
    legend_below(figure, legend)
    return figure


def loops_figure(view: FieldView) -> Figure:
    """Force, kN, over penetration, µm, at the study's speed for steps: each engine's best setting
    at the finest step that has a loop, the law's loop under it.
    """
    cases = dict(_with_loops(view))
    figure, panels = _panels(view, list(cases))
    study = view.study
    law = HuntCrossley(float(study["stiffness"]), view.alpha, float(study["exponent"]))
    loop = closed_form.loop(law, float(study["mass_kg"]), float(study["step_speed"]), 241)
    for engine, axes in panels:
        axes.plot(1e6 * loop.penetration, 1e-3 * loop.force, **_LAW)
        rows = view.loops[cases[engine]]
        x, force = (rows[name].to_numpy(dtype=float) for name in ("penetration_m", "force_n"))
        draw_loop(axes, 1e6 * x, 1e-3 * force, color=KIND_COLOURS["settings"], linewidth=1.2)
        axes.set_title(f"{view.title(engine)}\n{cases[engine].setting}", fontsize=8.5)
    _label(panels, "penetration, µm", "force, kN")
    return figure


def _with_loops(view: FieldView) -> Iterator[tuple[str, Case]]:
    """Each engine with its best setting at the finest step that has a loop, under the study's first
    gravity; without engines that have none.
    """
    for engine in view.engines:
        for step in view.steps:
            case = view.best(engine, view.gravities[0], step)
            if case is not None and case in view.loops and view.scores[case]["loops"]:
                yield engine, case
                break


def _panels(view: FieldView, engines: list[str]) -> tuple[Figure, list[tuple[str, Axes]]]:
    """A figure, and a panel for each engine with its title: up to _COLUMNS side by side."""
    columns = min(_COLUMNS, max(1, len(engines)))
    rows = math.ceil(len(engines) / columns)
    figure = new_figure(0.6 + 2.55 * columns, 0.8 + 2.2 * rows)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(engines) :]:
        axes.set_visible(False)
    for engine, axes in zip(engines, grid, strict=False):
        axes.set_title(view.title(engine), fontsize=9)
    return figure, list(zip(engines, grid, strict=False))


def _label(panels: list[tuple[str, Axes]], x: str, y: str) -> None:
    """Label the outer axes alone: y on the left, x on the lowest panel of each column.

    panels: engine and axes of each, in rows of _COLUMNS.
    x, y: the labels.
    """
    columns = min(_COLUMNS, len(panels))
    for i, (_, axes) in enumerate(panels):
        if i % columns == 0:
            axes.set_ylabel(y)
        if i >= len(panels) - columns:
            axes.set_xlabel(x)


# Panel behind a cell of the matrix: words, a curve, the text to paste and its source.


@dataclass(frozen=True, slots=True)
class StepMatrix:
    """The matrix at a step (s) under a gravity (m/s²).

    sentences: of `headline`.
    band: impact speeds, as text.
    constant: largest error of the best constant e, as text.
    rows: of `cells.rows`: engine -> column -> cell.
    """

    gravity: float
    step: float
    sentences: Sequence[str]
    band: str
    constant: str
    rows: Mapping[str, Mapping[str, MatrixCell]]


def tables(view: FieldView) -> list[StepMatrix]:
    """The matrix of engines by condition at every step, under every gravity, the least first."""
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
    """The setting that a case ran with. Raises AssertionError for a case of another study."""
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
    """Data for the page's script, as JSON: the tables, and each of their cases and texts once.

    made: the matrices, of `tables`. No name in it can end a script element of the page.
    """
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
    return as_json(content)


def _table(table: StepMatrix, numbers: dict[Case, int]) -> dict[str, Any]:
    """A table as the page's script takes it, by name.

    numbers: of the cases so far; new ones are added in place.
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
    """The panel of a case as the script takes it: title, sentences, e over impact speed (m/s), and
    the number of its text to paste, None for none. `low` and `high` are there where phases differ.

    texts: numbers of the texts so far; that of the case is added in place.
    """
    setting = "nothing set" if case.setting == STOCK else case.setting
    text = _text(view, case)
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


def _text(view: FieldView, case: Case) -> str:
    """The text to paste of a setting: where `hcbench tune` has an answer with it, that of the
    answer, which keeps friction; else of the setting as it ran, without friction.
    """
    choice = view.choice(case)
    if choice is None:
        return snippet(setting_of(view, case), "plane")
    return str(choice["text"])


def _lines(view: FieldView, case: Case) -> list[str]:
    """Sentences on a setting's error of e, its energy, and slow impacts; none on what is not known."""
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
    """The command that gives the same setting and its error; "" for nothing set."""
    if case.setting == STOCK:
        return ""
    low, high = view.speeds(case.timestep)[[0, -1]]
    what = f'--alpha "{view.alpha:.6g} s/m" --speeds "{low:.4g}:{high:.4g} m/s"'
    where = f"--timestep {time_step(case.timestep)} --gravity {case.gravity:g}"
    command = f"hcbench tune {case.engine} --recipe {case.setting} {what} {where}"
    if view.choice(case) is None:
        return f"{command} --friction 0"
    return command


COST = "cost.csv"
# The page opens with this step, s, or the nearest.
_USUAL_STEP = 1e-3
_SCRIPTS = ("explorer/law.js", "explorer/plot.js", "field.js")


def build(
    results: Results,
    folder: Path,
    pool: WorkerPool | None = None,
    tick: Callable[[int, int], None] | None = None,
    moved_to: Path | None = None,
) -> Path:
    """Write the field report into `folder` and return its page. All of it appears, or nothing.

    index.html, tables and figures are the same bytes for the same
    results; cost.csv is of this machine: engines are run for it once more.

    pool: draws figures side by side; None: this process does.
    tick: called with (figures drawn, figures in all).
    moved_to: the folder that the caller moves the report to, for the page's links; None: none.

    Raises UserError where a file that hcbench did not write is in the way, OutputError where the
    folder cannot be written.
    """
    view = FieldView(results)
    with atomic_folder(folder, PAGE) as scratch:
        results.write(scratch)
        (scratch / "figures").mkdir()
        png = not results.study.get("left_out")
        save = partial(draw, folder=scratch / "figures", png=png, csv=csv_of)
        plans = list(drawings(view))
        drawn = map(save, plans) if pool is None else pool.imap(save, plans)
        figures = list(counted(drawn, len(plans), tick))
        probes = _probes(view)
        write_text(scratch / COST, _costs(view, probes))
        by_engine = {case.engine: probe_of_engine for case, probe_of_engine in probes.items()}
        write_text(scratch / PAGE, page_text(view, figures, by_engine, moved_to or folder))
    return folder / PAGE


def _probes(view: FieldView) -> dict[Case, cells.Probe | None]:
    """Run the probe of computing time of each engine's usual setting; an engine without one is left
    out. None for a setting whose probe could not run.
    """
    probes = {}
    scene = cells.scene_of(view)
    for engine in view.engines:
        case = _usual_case(view, engine)
        if case is not None:
            probes[case] = cells.probe(setting_of(view, case), scene)
    return probes


def _usual_case(view: FieldView, engine: str) -> Case | None:
    """An engine's best setting without gravity at the step nearest to 1 ms, by ratio; where it has
    none at any step, its default; None where that did not run without gravity either.
    """
    steps = sorted(view.steps, key=_far_from_usual)
    for pick in (view.best, view.stock):
        for step in steps:
            case: Case | None = pick(engine, 0.0, step)
            if case is not None:
                return case
    return None


def _far_from_usual(step: float) -> float:
    return abs(math.log(step / _USUAL_STEP))


def _costs(view: FieldView, probes: Mapping[Case, cells.Probe | None]) -> str:
    """The table of computing time as CSV, in µs a ball and step.

    probes: by setting; None is left out.
    """
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    costs = []
    for case, of_case in probes.items():
        if of_case is not None:
            costs.append((view.title(case.engine), case.setting, case.timestep, of_case.cost))
    return cells.csv_of(costs, machine)


def page_text(
    view: FieldView,
    figures: list[dict[str, Any]],
    probes: dict[str, cells.Probe | None],
    folder: Path | None = None,
) -> str:
    """The field page as HTML text. It opens with the strongest gravity and the step nearest to 1
    ms.

    figures: what `draw` returns of each of `drawings`.
    probes: by engine; None where it could not run.
    folder: in which the page will lie, for the links of its header; None: it may go anywhere.
    """
    made = tables(view)
    usual = min(made, key=lambda table: (-table.gravity, _far_from_usual(table.step)))
    return render(
        "field.html",
        script=script(*_SCRIPTS),
        folder=folder,
        title="Which engines bounce right",
        view=view,
        table=usual,
        columns=cells.COLUMNS,
        grades=cells.GRADES,
        data=page_data(view, made),
        steps=[(time(h), h) for h in view.steps],
        versions=versions(view),
        figures={figure["name"]: figure for figure in figures},
        cases=case_table(measured()),
        features=cells.features(view, probes),
        feature_names=cells.FEATURES,
        missing=list(view.study["missing"]),
        add_commands=add_commands,
        STOCK=STOCK,
    )
