"""The field page: engines by condition, their errors over the step, their loops and features."""

from __future__ import annotations

import math
import os
import platform
from functools import partial
from typing import TYPE_CHECKING, Any

from hcbench.cases.score import measured
from hcbench.reporting.field import cells, features, probe
from hcbench.reporting.field.case_table import case_table
from hcbench.reporting.field.figures import drawings
from hcbench.reporting.field.headline import versions
from hcbench.reporting.field.panel import page_data, setting_of, tables
from hcbench.reporting.field.view import STOCK, Case, FieldView
from hcbench.reporting.page import PAGE, counted, draw, render, script
from hcbench.reporting.wording import time
from hcbench.sim.install import add_commands
from hcbench.system.files import atomic_folder, write_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from hcbench.benchmark.results import Results
    from hcbench.workers import WorkerPool

COST = "cost.csv"
# The page opens with this step, s, or the nearest.
_USUAL_STEP = 1e-3
_SCRIPTS = ("explorer/law.js", "explorer/plot.js", "field.js")


def build(
    results: Results,
    folder: Path,
    pool: WorkerPool | None = None,
    tick: Callable[[int, int], None] | None = None,
) -> Path:
    """Write the field report into `folder` and return its page. All of it appears, or nothing.

    index.html, tables and figures are the same bytes for the same
    results; cost.csv is of this machine.

    pool: draws figures side by side; tick: takes how many are drawn, and of how many.
    """
    view = FieldView(results)
    with atomic_folder(folder, PAGE) as scratch:
        results.write(scratch)
        (scratch / "figures").mkdir()
        save = partial(draw, folder=scratch / "figures", png=not results.study.get("left_out"))
        plans = list(drawings(view))
        drawn = map(save, plans) if pool is None else pool.imap(save, plans)
        figures = list(counted(drawn, len(plans), tick))
        probes = _probes(view)
        write_text(scratch / COST, _costs(view, probes))
        by_engine = {case.engine: probe_of_engine for case, probe_of_engine in probes.items()}
        write_text(scratch / PAGE, page_text(view, figures, by_engine))
    return folder / PAGE


def _probes(view: FieldView) -> dict[Case, probe.Probe | None]:
    """Each engine's best setting at the step nearest to 1 ms, else its default, with its features.

    None for a setting whose probe could not run.
    """
    probes = {}
    scene = probe.scene_of(view)
    for engine in view.engines:
        case = _usual_case(view, engine)
        if case is not None:
            probes[case] = probe.probe(setting_of(view, case), scene)
    return probes


def _usual_case(view: FieldView, engine: str) -> Case | None:
    """An engine's best setting without gravity at the step nearest to 1 ms, else its default."""
    steps = sorted(view.steps, key=_far_from_usual)
    for pick in (view.best, view.stock):
        for step in steps:
            case: Case | None = pick(engine, 0.0, step)
            if case is not None:
                return case
    return None


def _far_from_usual(step: float) -> float:
    return abs(math.log(step / _USUAL_STEP))


def _costs(view: FieldView, probes: Mapping[Case, probe.Probe | None]) -> str:
    """The table of computing time as CSV: engine, setting, step in s, and the cost by balls."""
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    costs = []
    for case, of_case in probes.items():
        if of_case is not None:
            costs.append((view.title(case.engine), case.setting, case.timestep, of_case.cost))
    return probe.csv_of(costs, machine)


def page_text(
    view: FieldView, figures: list[dict[str, Any]], probes: dict[str, probe.Probe | None]
) -> str:
    """The page.

    figures: what `draw` returns of each of `drawings`.
    probes: by engine.
    """
    made = tables(view)
    usual = min(made, key=lambda table: (-table.gravity, _far_from_usual(table.step)))
    return render(
        "field.html",
        script=script(*_SCRIPTS),
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
        features=features.features(view, probes),
        feature_names=features.FEATURES,
        missing=list(view.study["missing"]),
        add_commands=add_commands,
        STOCK=STOCK,
    )
