"""Results in, a folder out: one page that works alone, its figure as a
file, its tables as CSV and JSON. The figure is the report in one picture: restitution over impact
speed of the settings that matter.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hcbench.laws import closed_form
from hcbench.measuring.curve import Curve
from hcbench.reporting import ranking, tables, wording
from hcbench.reporting.explorer import explorer, explorer_script
from hcbench.reporting.page import PAGE, Drawing, counted, csv_of, draw, render
from hcbench.reporting.plot_style import (
    LAW,
    SLATE,
    declutter,
    draw_band,
    marker_stride,
    set_ticks,
    speed_axis,
)
from hcbench.reporting.tables import Views, views
from hcbench.reporting.view import RunKey, View
from hcbench.sim.install import add_commands
from hcbench.system.files import atomic_folder, write_text
from hcbench.terms import units
from hcbench.terms.resolution import STEPS_TO_COMPARE

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from hcbench.benchmark.results import Results
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
    """The one figure that needs no script, yet to be drawn: it stands in for the explorer, and in
    README.

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

    by_gravity: `views` of the results.
    overview: what `draw` returns of `overview_drawing`.
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


# The report in one picture.

# Curves of e below this may have a frame of their own.
_FAR = 0.5
# They have one if they lie so far below the rest.
_GAP = 0.2
# A smaller range of e over the phases cannot be seen.
_BAND_SHOWN = 1e-4

_LINEAR: dict[str, Any] = {"color": SLATE, "linewidth": 1.0, "linestyle": (0, (2, 2))}


class _EndLabel(NamedTuple):
    """The name of a line, beside its end.

    end: e there.
    weight: of the font.
    """

    end: float
    text: str
    colour: str
    weight: str


class _Line(NamedTuple):
    """Curve of a run, and the place of the run among those of the figure, from 0."""

    nth: int
    run: RunKey
    curve: Curve

    @property
    def highest(self) -> float:
        """The largest e of any speed and phase."""
        return float(self.curve.highest.max())


def _draw_law(axes: Axes, view: View, alpha: float) -> None:
    """e of (16) as a broad pale band, 1 - αv dotted."""
    v = view.speeds
    e = closed_form.restitution(alpha, v)
    axes.plot(v, e, label="the law", color=LAW, linewidth=6, solid_capstyle="butt", zorder=1)
    axes.plot(v, 1 - alpha * v, label="1 - α v", zorder=2, **_LINEAR)


def _draw_curve(axes: Axes, view: View, run: RunKey, curve: Curve, nth: int) -> None:
    """Draw one setting: mean e over impact speed, m/s, with the band that the phases span, if it is
    wide enough to be seen.

    curve: of the setting.
    nth: place of the setting in the figure, which shifts its marks.
    """
    style = view.plot_style(run)
    if (curve.highest - curve.lowest > _BAND_SHOWN).any():
        draw_band(axes, curve.speed_in, curve.lowest, curve.highest, style.colour)
    marks = marker_stride(len(curve), nth)
    axes.plot(
        curve.speed_in,
        curve.restitution,
        label=run.title,
        markevery=marks,
        zorder=3,
        **style.line(),
    )


def overview_figure(view: View, runs: list[RunKey]) -> Figure:
    """Restitution over impact speed, m/s, in one picture: of the main α, the settings that matter,
    each named beside its line, and the law.

    runs: those to draw; one without a curve is left out. What lies far below the rest has a frame
    of its own at the bottom.
    """
    alpha = view.main_alpha
    fastest = view.speeds[-1]
    figure = Figure(figsize=(9.2, 4.8))
    lines = []
    for nth, run in enumerate(runs):
        curve = view.curve(run, alpha)
        if curve is not None:
            lines.append(_Line(nth, run, curve))
    # The least e of 1 - α v, and of the curves that come near the law.
    lowest = 1 - alpha * fastest
    for line in lines:
        if line.highest > _FAR:
            lowest = min(lowest, float(line.curve.lowest.min()))
    far = [line for line in lines if line.highest < lowest - _GAP]
    near = [line for line in lines if line not in far]
    # Left, bottom, width and height of the frames, as shares of the figure: the names of the lines
    # stand to the right.
    lower = 0.2 if far else 0.0
    axes = figure.add_axes((0.075, 0.115 + lower, 0.615, 0.765 - lower))
    _draw_law(axes, view, alpha)
    axes.set_ylim(max(0.0, lowest - 0.05 * (1.05 - lowest)), 1 + 0.15 * (1 - lowest))
    labels = [
        _EndLabel(float(closed_form.restitution(alpha, fastest)), "the law", SLATE, "bold"),
        _EndLabel(1 - alpha * fastest, "1 − αv", SLATE, "normal"),
    ]
    _draw_named(axes, view, near, labels)
    axes.set_ylabel("restitution e")
    if far:
        bottom = figure.add_axes((0.075, 0.115, 0.615, lower - 0.04), sharex=axes)
        top = max(0.1, 1.3 * max(line.highest for line in far))
        bottom.set_ylim(-0.15 * top, top)
        set_ticks(bottom.yaxis, [0.0, round(0.8 * top, 2)])
        _draw_named(bottom, view, far, [])
        axes.tick_params(labelbottom=False)
    speed_axis(axes, label=not far, inches=view.in_inches)
    if far:
        speed_axis(bottom, inches=False)
    axes.set_xlim(0, fastest * 1.005)
    return figure


def _draw_named(axes: Axes, view: View, lines: list[_Line], labels: list[_EndLabel]) -> None:
    """Draw curves, and beside them their names and those of other lines.

    labels: of other lines, which are drawn already.
    """
    all_labels = list(labels)
    for line in lines:
        run = line.run
        _draw_curve(axes, view, run, line.curve, line.nth)
        name = f"{wording.engine_title(run.engine)}, {run.name}, {run.step}"
        end = float(line.curve.restitution[-1])
        all_labels.append(_EndLabel(end, name, view.plot_style(run).colour, "normal"))
    _label_ends(axes, all_labels)


def _label_ends(axes: Axes, labels: list[_EndLabel]) -> None:
    """Write names in the right margin, each led to its line's end, none over another."""
    low, high = axes.get_ylim()
    # As shares of the frame's height, as are the places of the names.
    ends = (np.clip([label.end for label in labels], low, high) - low) / (high - low)
    # Height of a name, as a share of the figure's and then of the frame's.
    height = axes.get_position().height
    places = declutter(ends, 0.0444 / height, 0.0, 1.0)
    for end, place, label in zip(ends, places, labels, strict=True):
        axes.annotate(
            label.text,
            (1.0, end),
            (1.06, place),
            xycoords="axes fraction",
            textcoords="axes fraction",
            color=label.colour,
            fontweight=label.weight,
            va="center",
            arrowprops={
                "arrowstyle": "-",
                "color": label.colour,
                "linewidth": 0.7,
                "shrinkA": 0,
                "shrinkB": 0,
                "relpos": (0.0, 0.5),
            },
        )
