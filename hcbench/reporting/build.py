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
from hcbench.reporting.page import PAGE, counted, draw, render
from hcbench.reporting.view import View
from hcbench.reporting.wording import NBSP
from hcbench.resolution import STEPS_TO_COMPARE
from hcbench.scoring import CLAIMS
from hcbench.sim.install import add_commands

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from hcbench.benchmark.results import Results
    from hcbench.workers import WorkerPool


def build(
    results: Results,
    folder: Path,
    pool: WorkerPool | None = None,
    tick: Callable[[int, int], None] | None = None,
) -> Path:
    """Write the report of `results` into `folder` and return its page. All of it appears, or nothing.

    pool: draws the figures, side by side; None: this process does. tick: called with figures (drawn, of all).
    index.html; figures/*.svg, *.png; restitution.csv, loops.csv, scores.csv, summary.json.
    The same results give the same bytes. Raises OutputError where the folder cannot be written.
    """
    if results.study.get("page") == "field":
        from hcbench.reporting.field import page

        return page.build(results, folder, pool, tick)
    by_gravity = views(results)
    with atomic_folder(folder, PAGE) as scratch:
        (scratch / "figures").mkdir()
        save = partial(draw, folder=scratch / "figures", png=not results.study.get("left_out"))
        plans = list(drawings(by_gravity))
        figures = counted((map if pool is None else pool.imap)(save, plans), len(plans), tick)
        results.write(scratch)  # while they are drawn
        write_text(scratch / PAGE, page_text(by_gravity, results, figures))
    return folder / PAGE


def page_text(by_gravity: Views, results: Results, figures: Iterable[dict[str, Any]]) -> str:
    """The page. figures: what `draw` returns of each of `drawings`, asked for last."""
    view, without_gravity = by_gravity.main, by_gravity.without_gravity or by_gravity.main
    height, cup = view.study.get("train_height"), cup_table.rows(by_gravity, results)
    settings = tables.settings(by_gravity)
    explored = explorer(by_gravity)
    return render(
        "report.html",
        script=explorer_script() if explored else None,
        explorer=explored,
        settings=settings,
        by_gravity=by_gravity,
        view=view,
        without_gravity=without_gravity,
        headline=advice.headline(view),
        plugins=advice.plugin_sentence(view),
        cards=advice.cards(view),
        contact_cards=advice.cards_of_contact(without_gravity) if by_gravity.with_gravity else [],
        band=advice.band_text(view),
        band_without_gravity=advice.band_text(without_gravity),
        figures={figure["name"]: figure for figure in figures},
        headings={
            name: class_heading(without_gravity, resolved)
            for name, resolved in (("coarse", False), ("fine", True))
        },
        loop_speeds=loop_speeds(without_gravity),
        step_speed=step_speed(without_gravity),
        law_exponent=_law_exponent(without_gravity),
        drop=f"from {1e3 * float(height):.3g}{NBSP}mm" if height else "",
        rules=ranking,
        tables=tables,
        cup_rows=cup,
        claims=CLAIMS,
        score_alphas=sorted(view.alphas, key=lambda alpha: (abs(alpha - view.main_alpha) > 1e-12, alpha)),
        friction=_friction(by_gravity),
        impact_count=len(results.impacts),
        gravity_text=_gravity_text(by_gravity),
        drop_heights=_drop_heights(view),
        flat_runs=any(run.place for run in view.band_runs),
        off_axis=_off_axis(results) if cup else "",
        alphas_in_both=[f"{alpha:.3g} s/m ({alpha * units.INCH:.3g} s/in)" for alpha in view.alphas],
        units=units,
        add_commands=add_commands,
        RESOLVED=STEPS_TO_COMPARE,
    )


def _friction(by_gravity: Views) -> str:
    """The coefficients with which bodies slid."""
    rows = by_gravity.sliding.results.impacts["friction"] if by_gravity.sliding else ()
    return wording.listed([f"{value:g}" for value in sorted(set(rows))])


def _off_axis(results: Results) -> str:
    """The largest distance from the cup's axis; "" where all impacts were on it."""
    largest = float(results.impacts["off_axis_m"].max())
    return wording.length(largest) if largest > 0 else ""


def _gravity_text(by_gravity: Views) -> str:
    """Whether there is any, and how much."""
    with_gravity = f"{by_gravity.with_gravity.gravity:g} m/s²" if by_gravity.with_gravity else ""
    without_gravity = "none: free flight at the plate" if by_gravity.without_gravity else ""
    return " and ".join(filter(None, [with_gravity, without_gravity]))


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
