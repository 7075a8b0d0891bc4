"""Results in, a folder out: one page that works alone, its figures as files, its tables as CSV and JSON."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

from hcbench import units
from hcbench._files import atomic_folder, write_text
from hcbench.reporting import advice, cup_table, ranking, tables, wording
from hcbench.reporting.conditions import Views, views
from hcbench.reporting.drawings import class_heading, drawings, loop_speeds, step_speed
from hcbench.reporting.explorer import explorer, explorer_script
from hcbench.reporting.page import PAGE, draw, render
from hcbench.reporting.view import View
from hcbench.reporting.wording import NBSP
from hcbench.scoring import CLAIMS, RESOLVED

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from hcbench.benchmark.results import Results
    from hcbench.workers import WorkerPool


def build(results: Results, folder: Path, pool: WorkerPool | None = None) -> Path:
    """Write the report of `results` into `folder` and return its page. All of it appears, or nothing.

    pool: draws the figures, side by side; None: this process does.
    index.html; figures/*.svg, *.png; restitution.csv, loops.csv, scores.csv, summary.json.
    The same results give the same bytes. Raises OutputError where the folder cannot be written.
    """
    if results.study.get("page") == "field":
        from hcbench.reporting.field import page

        return page.build(results, folder, pool)
    found = views(results)
    with atomic_folder(folder, PAGE) as scratch:
        (scratch / "figures").mkdir()
        save = partial(draw, folder=scratch / "figures", png=not results.study.get("left_out"))
        figures = (map if pool is None else pool.imap)(save, drawings(found))
        results.write(scratch)  # while they are drawn
        write_text(scratch / PAGE, page_text(found, results, figures))
    return folder / PAGE


def page_text(found: Views, results: Results, figures: Iterable[dict[str, Any]]) -> str:
    """The page. figures: what `draw` returns of each of `drawings`, asked for last."""
    view, free = found.main, found.free or found.main
    height, cup = view.study.get("train_height"), cup_table.rows(found, results)
    settings = tables.settings(found)
    explored = explorer(found, settings)
    return render(
        "report.html",
        script=explorer_script() if explored else None,
        explorer=explored,
        settings=settings,
        found=found,
        view=view,
        free=free,
        headline=advice.headline(view),
        plugins=advice.plugin_sentence(view),
        cards=advice.cards(view),
        free_cards=advice.cards_of_contact(free) if found.heavy else [],
        band=advice.band_text(view),
        free_band=advice.band_text(free),
        figures={figure["name"]: figure for figure in figures},
        headings={"coarse": class_heading(free, False), "fine": class_heading(free, True)},
        loop_speeds=loop_speeds(free),
        step_speed=step_speed(free),
        law_exponent=_law_exponent(free),
        drop=f"from {1e3 * float(height):.3g}{NBSP}mm" if height else "",
        rules=ranking,
        tables=tables,
        cup_rows=cup,
        claims=CLAIMS,
        score_alphas=sorted(view.alphas, key=lambda alpha: (abs(alpha - view.main_alpha) > 1e-12, alpha)),
        friction=_friction(found),
        impact_count=len(results.impacts),
        gravity_text=_gravity_text(found),
        drop_heights=_drop_heights(view),
        flat_runs=any(run.place for run in view.band_runs),
        off_axis=wording.length(float(results.impacts["off_axis_m"].max())) if cup else "",
        alphas_in_both=[f"{alpha:.3g} s/m ({alpha * units.INCH:.3g} s/in)" for alpha in view.alphas],
        units=units,
        RESOLVED=RESOLVED,
    )


def _friction(found: Views) -> str:
    """The coefficients with which bodies slid."""
    rows = found.sliding.results.impacts["friction"] if found.sliding else ()
    return wording.listed([f"{value:g}" for value in sorted(set(rows))])


def _gravity_text(found: Views) -> str:
    """Whether there is any, and how much."""
    heavy = f"{found.heavy.gravity:g} m/s²" if found.heavy else ""
    return " and ".join(filter(None, [heavy, "none: free flight at the plate" if found.free else ""]))


def _drop_heights(view: View) -> str:
    """From where bodies fall to meet the band: "1 … 13 mm"."""
    if not view.gravity:
        return ""
    low, high = (wording.length(float(v) ** 2 / (2.0 * view.gravity)) for v in view.band)
    return f"from {low} to {high}"


def _law_exponent(view: View) -> str:
    """The law's own p of ΔE ∝ vᵖ over the band; "" where no score tells it."""
    score = next((s for s in map(view.score, view.band_runs) if s is not None), None)
    if score is None or not math.isfinite(score["energy_exponent_law"]):
        return ""
    return f"{score['energy_exponent_law']:.2f}"
