"""Results in, a folder out: one page that works alone, its figures as files, its tables as CSV and JSON."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

from hcbench import units
from hcbench._files import atomic_folder, write_text
from hcbench.report import advice, ranking, tables
from hcbench.report.drawings import class_heading, drawings, loop_speeds, step_speed
from hcbench.report.page import PAGE, draw, render
from hcbench.report.view import View
from hcbench.report.wording import NBSP
from hcbench.scoring import CLAIMS, RESOLVED

if TYPE_CHECKING:
    from pathlib import Path

    from hcbench.benchmark.results import Results
    from hcbench.workers import WorkerPool


def build(results: Results, folder: Path, pool: WorkerPool | None = None) -> Path:
    """Write the report of `results` into `folder` and return its page. All of it appears, or nothing.

    pool: draws the figures, side by side; None: this process does.
    index.html; figures/*.svg, *.png; restitution.csv, loops.csv, scores.csv, summary.json.
    The same results give the same bytes. Raises OutputError where the folder cannot be written.
    """
    view = View(results)
    with atomic_folder(folder, PAGE) as scratch:
        results.write(scratch)
        (scratch / "figures").mkdir()
        save = partial(draw, folder=scratch / "figures")
        figures = list(map(save, drawings(view))) if pool is None else pool.map(save, drawings(view))
        write_text(scratch / PAGE, _page(view, figures))
    return folder / PAGE


def _page(view: View, figures: list[dict[str, Any]]) -> str:
    height = view.study.get("train_height")
    return render(
        "report.html",
        view=view,
        headline=advice.headline(view),
        plugins=advice.plugin_sentence(view),
        cards=advice.cards(view),
        band=advice.band_text(view),
        figures={figure["name"]: figure for figure in figures},
        headings={"coarse": class_heading(view, False), "fine": class_heading(view, True)},
        loop_speeds=loop_speeds(view),
        step_speed=step_speed(view),
        law_exponent=_law_exponent(view),
        drop=f"from {1e3 * float(height):.3g}{NBSP}mm" if height else "",
        rules=ranking,
        ranking=tables.ranking(view),
        lines_to_beat=tables.lines_to_beat(view),
        claims=CLAIMS,
        claim_rows=tables.claims(view),
        tables=tables,
        score_alphas=sorted(view.alphas, key=lambda alpha: (abs(alpha - view.main_alpha) > 1e-12, alpha)),
        settings=tables.settings(view),
        failed_impacts=tables.failed_impacts(view),
        alphas_in_both=[f"{alpha * units.INCH:.3g} s/in ({alpha:.3g} s/m)" for alpha in view.alphas],
        units=units,
        RESOLVED=RESOLVED,
    )


def _law_exponent(view: View) -> str:
    """The law's own p of ΔE ∝ vᵖ over the band; "" where no score tells it."""
    score = next((s for s in map(view.score, view.band_runs) if s is not None), None)
    if score is None or not math.isfinite(score["energy_exponent_law"]):
        return ""
    return f"{score['energy_exponent_law']:.2f}"
