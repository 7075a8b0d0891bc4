"""Results in, a folder out: one page that works alone, its figures as files, its tables as CSV and JSON."""

from __future__ import annotations

import base64
from functools import partial
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from hcbench._files import filled_folder, write_bytes, write_text
from hcbench.report import answers, findings, style, tables, wording
from hcbench.report.figures import Drawing, drawings
from hcbench.report.view import View
from hcbench.scoring import CLAIMS

if TYPE_CHECKING:
    from pathlib import Path

    from hcbench.benchmark.results import Results
    from hcbench.workers import WorkerPool

PAGE = "index.html"


def build(results: Results, folder: Path, pool: WorkerPool | None = None) -> Path:
    """Write the report of `results` into `folder` and return its page. All of it appears, or nothing.

    pool: draws the figures, side by side; None: this process does.
    index.html; figures/*.svg, *.png; restitution.csv, loops.csv, scores.csv, summary.json.
    The same results give the same bytes. Raises OutputError where the folder cannot be written.
    """
    view = View(results)
    with filled_folder(folder) as scratch:
        results.write(scratch)
        (scratch / "figures").mkdir()
        save, wanted = partial(_save, scratch / "figures"), drawings(view)
        figures = list(map(save, wanted)) if pool is None else pool.map(save, wanted)
        write_text(scratch / PAGE, render(view, figures))
    return folder / PAGE


def _save(folder: Path, drawing: Drawing) -> dict[str, Any]:
    """Draw once, save as SVG and PNG, and hand back what the page needs of it."""
    told = {"section": drawing.section, "name": drawing.name, "title": drawing.title, "why": drawing.why}
    if drawing.draw is None:
        return {**told, "source": ""}
    with style.drawing():
        figure = drawing.draw()
        svg, png = style.svg_bytes(figure), style.png_bytes(figure)
    write_bytes(folder / f"{drawing.name}.svg", svg)
    write_bytes(folder / f"{drawing.name}.png", png)
    width, height = (round(96 * inches) for inches in figure.get_size_inches())
    source = "data:image/svg+xml;base64," + base64.b64encode(svg).decode("ascii")
    size = {"width": width, "height": height}
    return {**told, **size, "source": source, "caption": drawing.caption, "alt": drawing.alt}


def render(view: View, figures: list[dict[str, Any]]) -> str:
    """The page as text."""
    environment = Environment(
        loader=PackageLoader("hcbench.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    cards = [
        {
            "question": card.question,
            "answers": [
                {
                    "run": tables.run_cell(view, answer.runs[0]),
                    "title": answer.title,
                    "because": answer.because,
                }
                for answer in card.answers
            ],
            "note": card.note,
        }
        for card in answers.cards(view)
    ]
    return environment.get_template("page.html").render(
        title=view.study["title"],
        headline=answers.headline(view),
        plugins=answers.plugin_sentence(view),
        band=findings.band(view),
        main_alpha=wording.alpha(view.main_alpha),
        contact_time=wording.about(view.contact_time),
        cards=cards,
        figures=figures,
        alphas=[wording.alpha_short(alpha) for alpha in view.alphas],
        ranking=tables.ranking(view),
        lines_to_beat=tables.lines_to_beat(view),
        follows=wording.percent(findings.FOLLOWS),
        loop_right=wording.percent(findings.LOOP_RIGHT),
        loop_near=wording.percent(findings.LOOP_NEAR),
        claims=CLAIMS,
        claim_rows=tables.claims(view),
        scores=tables.scores(view),
        settings=tables.settings(view),
        lost=tables.lost(view),
        impacts=len(view.results.impacts),
        provenance=tables.provenance(view),
        versions=[(wording.engine_name(k), v) for k, v in view.results.versions.items()],
    )
