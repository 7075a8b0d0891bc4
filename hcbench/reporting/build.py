"""Results in, a folder out: one page that works alone, its figure as a
file, its tables as CSV and JSON.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from hcbench.reporting import ranking, tables, wording
from hcbench.reporting.curves import csv_of
from hcbench.reporting.explorer import explorer, explorer_script
from hcbench.reporting.overview_figure import overview_figure
from hcbench.reporting.page import PAGE, Drawing, counted, draw, render
from hcbench.reporting.tables import Views, views
from hcbench.sim.install import add_commands
from hcbench.system.files import atomic_folder, write_text
from hcbench.terms import units
from hcbench.terms.resolution import STEPS_TO_COMPARE

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from hcbench.benchmark.results import Results
    from hcbench.reporting.view import View
    from hcbench.workers import WorkerPool


def build(
    results: Results,
    folder: Path,
    pool: WorkerPool | None = None,
    tick: Callable[[int, int], None] | None = None,
    moved_to: Path | None = None,
) -> Path:
    """Write the report of `results` into `folder` and return its page.
    All of it appears, or nothing.

    pool: draws the figures of a field's page, side by side; None: this process does.
    tick: called with (figures drawn, figures in all).
    moved_to: the folder that the caller moves the report to, for the page's links; None: none.

    The folder then has index.html, figures/overview.svg with its numbers as .csv, and the files of
    `Results.write`; for a
    study whose page is "field", what `field.page.build` writes. The same results give the same
    bytes.

    Raises UserError where a file that hcbench did not write is in the way, OutputError where the
    folder cannot be written.
    """
    if results.study.get("page") == "field":
        from hcbench.reporting.field import page

        return page.build(results, folder, pool, tick, moved_to)
    by_gravity = views(results)
    with atomic_folder(folder, PAGE) as scratch:
        (scratch / "figures").mkdir()
        save = partial(draw, folder=scratch / "figures", png=False, csv=csv_of)
        (overview,) = counted(map(save, [overview_drawing(by_gravity.main)]), 1, tick)
        results.write(scratch)
        write_text(scratch / PAGE, page_text(by_gravity, results, overview, moved_to or folder))
    return folder / PAGE


def overview_drawing(view: View) -> Drawing:
    """The one figure that needs no script: what stands in for the explorer, and in README.

    Its alternative text has the largest error of each run shown. Without such runs it is empty.
    """
    runs = ranking.overview_runs(view)
    errors = []
    for run in runs:
        score = view.score(run)
        if score is not None:
            error = wording.error(score["max_error_law"])
            errors.append(f"{run.title} at {run.step}: wrong by at most {error}.")
    at = f"{wording.alpha(view.main_alpha)}, {band_text(view)}"
    return Drawing(
        "overview",
        partial(overview_figure, view, runs) if runs else None,
        f"Restitution over impact speed at {at}. {' '.join(errors)}",
        "no setting ran over enough speeds for a curve",
    )


def page_text(
    by_gravity: Views, results: Results, overview: dict[str, Any], folder: Path | None = None
) -> str:
    """The page of a report as HTML text.

    by_gravity: `views` of the results. overview: what `draw` returns of `overview_drawing`.
    folder: the page's own.
    """
    view = by_gravity.main
    explored = explorer(by_gravity)
    return render(
        "report.html",
        script=explorer_script() if explored else None,
        folder=folder,
        explorer=explored,
        view=view,
        study=view.study,
        has_gravity=by_gravity.with_gravity is not None,
        overview=overview,
        provenance=_provenance(by_gravity, results),
        oblique_rows=tables.oblique(by_gravity.sliding),
        cup_rows=tables.rows(by_gravity, results),
        lost=wording.listed(tables.failed_impacts(by_gravity)),
        impact_count=len(results.table),
        rules=ranking,
        add_commands=add_commands,
    )


def band_text(view: View) -> str:
    """The impact speeds of the study: "0.025 … 0.51 m/s (1 … 20 in/s)"; of one in m/s, in m/s."""
    text = f"{_speed_span(view, 1.0)}{wording.NBSP}m/s"
    if view.in_inches:
        text += f" ({_speed_span(view, units.INCH)}{wording.NBSP}in/s)"
    return text


def _speed_span(view: View, unit: float) -> str:
    """Ends of the study's band, in two digits.

    unit: size of the unit that they are shown in, m/s.
    """
    low, high = view.band / unit
    return wording.span(f"{low:.2g}", f"{high:.2g}")


def _provenance(by_gravity: Views, results: Results) -> dict[str, str]:
    """Scene, law, speeds and counts of the study, by the names that the page gives them.

    by_gravity: the views of one study.
    """
    view = by_gravity.main
    study = view.study
    place = "the equivalent sphere on a flat plate"
    if study["form"] == "cup":
        place = "the true cup"
    exponent = f"{study['exponent']:g}"
    alphas = [f"{alpha:.3g} s/m ({alpha * units.INCH:.3g} s/in)" for alpha in view.alphas]
    bands = []
    gravities = []
    for shown in by_gravity.shown:
        bands.append(f"{band_text(shown)} {_under(shown)}")
        gravities.append(f"{shown.gravity:g} m/s²")
    return {
        "scene": f"{study['scene']} ({place})",
        "mass": f"{view.mass:.6g} kg ({view.mass / units.POUND:.3g} lb)",
        "relative radius": wording.length(float(study["relative_radius_m"])),
        "stiffness k": f"{study['stiffness']:.5g} N/m^{exponent}",
        "exponent n": exponent,
        "α": "; ".join(alphas),
        "impact speeds": "; ".join(bands),
        "gravity": wording.listed(gravities),
        "starts": f"{study['phases']} places in a time step where the contact starts",
        "impacts": str(len(results.table)),
        "loops": f"judged from {STEPS_TO_COMPARE} steps in contact on",
    }


def _under(view: View) -> str:
    return "dropped" if view.gravity else "without gravity"
