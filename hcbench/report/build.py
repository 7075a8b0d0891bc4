"""Results in, a folder out: one page that works alone, its figures as files, its tables as CSV and JSON."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

from hcbench._files import atomic_folder, write_text
from hcbench.report import advice, ranking, tables, wording
from hcbench.report.drawings import class_heading, drawings, loop_speeds, step_speed
from hcbench.report.page import PAGE, draw, render
from hcbench.report.view import View
from hcbench.scoring import CLAIMS

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
    with atomic_folder(folder) as scratch:
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
        title=view.study["title"],
        headline=advice.headline(view),
        plugins=advice.plugin_sentence(view),
        cards=[_card(view, card) for card in advice.cards(view)],
        figures={figure["name"]: figure for figure in figures},
        headings={"coarse": class_heading(view, False), "fine": class_heading(view, True)},
        band=advice.band_text(view),
        main_alpha=wording.alpha(view.main_alpha),
        main_alpha_short=wording.alpha_short(view.main_alpha),
        alphas=[wording.alpha_short(alpha) for alpha in view.alphas],
        contact_time=wording.rough_time(view.contact_time),
        loop_speeds=loop_speeds(view),
        step_speed=step_speed(view),
        law_exponent=_law_exponent(view),
        drop=f"from {1e3 * float(height):.3g}{wording.NBSP}mm" if height else "",
        ranking=tables.ranking(view),
        lines_to_beat=tables.lines_to_beat(view),
        follows=wording.percent(ranking.FOLLOWS),
        loop_right=wording.percent(ranking.LOOP_RIGHT),
        loop_near=wording.percent(ranking.LOOP_NEAR),
        claims=CLAIMS,
        claim_rows=tables.claims(view),
        scores=tables.scores(view),
        settings=tables.settings(view),
        failed_impacts=tables.failed_impacts(view),
        impacts=len(view.results.impacts),
        provenance=tables.provenance(view),
        versions=[(wording.engine_title(k), v) for k, v in view.results.versions.items()],
    )


def _card(view: View, card: advice.AdviceCard) -> dict[str, Any]:
    answers = [
        {"run": tables.run_cell(view, a.runs[0]), "title": a.title, "because": a.because} for a in card.advice
    ]
    return {"question": card.question, "answers": answers, "note": card.note}


def _law_exponent(view: View) -> str:
    """The law's own p of ΔE ∝ vᵖ over the band; "" where no score tells it."""
    score = next((s for s in map(view.score, view.band_runs) if s is not None), None)
    if score is None or not math.isfinite(score["energy_exponent_law"]):
        return ""
    return f"{score['energy_exponent_law']:.2f}"
