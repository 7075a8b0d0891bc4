"""Every figure of the report: how it is drawn, what it shows in words, or why there is nothing to draw."""

import math
from collections.abc import Callable, Sequence
from functools import partial

from matplotlib.figure import Figure

from hcbench.reporting import (
    bounce_figures,
    loop_figures,
    oblique_figure,
    restitution_figures,
    trend_figures,
    wording,
)
from hcbench.reporting.advice import band_text
from hcbench.reporting.conditions import Views
from hcbench.reporting.page import Drawing
from hcbench.reporting.ranking import overview_runs
from hcbench.reporting.restitution_figures import Column
from hcbench.reporting.view import REFERENCE, RunKey, View
from hcbench.resolution import STEPS_OF_A_LOOP


def drawings(by_gravity: Views) -> list[Drawing]:
    """All figures, in the page's order."""
    view, without_gravity = by_gravity.main, by_gravity.without_gravity
    shown = [_overview(view)]
    if by_gravity.with_gravity is not None:
        shown += [*_steps_of(by_gravity.with_gravity), _bounces(by_gravity.with_gravity)]
    shown.append(_oblique(by_gravity.sliding))
    if without_gravity is not None:
        classes = (False, True)
        panels = (
            "Restitution over impact speed without gravity, small panels, "
            f"{len(without_gravity.alphas)} α by engine."
        )
        errors = "Error of restitution over impact speed without gravity, log scale."
        shown += [
            *(
                _class(without_gravity, r, "restitution", restitution_figures.restitution_figure, panels)
                for r in classes
            ),
            *(_class(without_gravity, r, "error", restitution_figures.error_figure, errors) for r in classes),
            *_loops(without_gravity),
            _energy(without_gravity),
            _steps(without_gravity),
            *([_bounces(without_gravity)] if by_gravity.with_gravity is None else []),
        ]
    return shown


def _oblique(view: View | None) -> Drawing:
    rows = oblique_figure.oblique_rows(view) if view is not None else {}
    spans = {run: table["restitution"] for run, table in rows.items()}
    ranges = [
        f"{run.title} at {run.step}: e from {e.min():.2f} to {e.max():.2f}." for run, e in spans.items()
    ]
    return Drawing(
        "oblique",
        partial(oblique_figure.oblique_figure, rows) if rows else None,
        f"Restitution and friction over the angle of the slip. {' '.join(ranges)}",
        "the study launches nothing obliquely with friction",
    )


def _steps_of(view: View) -> list[Drawing]:
    """Restitution and error under gravity, a column a step."""
    columns = restitution_figures.columns_of_steps(view)
    runs = [run for column in columns for run in column.runs]
    what = "over impact speed under gravity, a panel for each engine and step"
    kinds = (
        ("restitution", "Restitution", restitution_figures.restitution_figure),
        ("error", "Error of restitution", restitution_figures.error_figure),
    )
    return [
        Drawing(
            f"{name}-gravity",
            partial(draw, view, columns) if runs else None,
            f"{words} {what}. {_largest_errors(view, runs)}",
            "no setting of this study was dropped",
        )
        for name, words, draw in kinds
    ]


def class_heading(view: View, resolved: bool) -> str:
    """Which steps a class holds."""
    return f"Steps {_limit(view, resolved)}; the law's contact lasts {wording.rough_time(view.contact_time)}"


def _limit(view: View, resolved: bool) -> str:
    limit = wording.rough_time(view.contact_time / STEPS_OF_A_LOOP)
    return f"up to {limit}" if resolved else f"above {limit}"


def loop_speeds(view: View) -> str:
    """At which speeds loops are shown, and for which α."""
    speeds = wording.speeds(sorted(view.study["loop_speeds"]), view.in_inches)
    return f"{speeds}, {wording.alpha_short(view.main_alpha)}"


def step_speed(view: View) -> str:
    """At which speed the time step is varied, and for which α."""
    speed = wording.speeds([view.study["step_speed"]], view.in_inches)
    return f"{speed}, {wording.alpha_short(view.main_alpha)}"


def _overview(view: View) -> Drawing:
    runs = overview_runs(view)
    at = f"{wording.alpha(view.main_alpha)}, {band_text(view)}"
    return Drawing(
        "overview",
        partial(restitution_figures.overview_figure, view, runs) if runs else None,
        f"Restitution over impact speed at {at}. {_largest_errors(view, runs)}",
        "no setting ran over enough speeds for a curve",
    )


def _class(
    view: View, resolved: bool, name: str, draw: Callable[[View, list[Column]], Figure], what: str
) -> Drawing:
    runs = [run for run in view.runs_by_resolution(resolved) if run.engine != REFERENCE]
    return Drawing(
        f"{name}-{'fine' if resolved else 'coarse'}",
        partial(draw, view, restitution_figures.columns_of_alphas(view, resolved)) if runs else None,
        f"{what} {_largest_errors(view, runs)}",
        f"no setting of this study ran over its band at a step {_limit(view, resolved)}",
    )


def _loops(view: View) -> list[Drawing]:
    runs = loop_figures.drawable(view)
    near = [run for run in runs if loop_figures.on_law_scale(view, run)]
    far = [run for run in runs if run not in near]
    return [
        Drawing(
            "loops",
            partial(loop_figures.loops_figure, view, near) if near else None,
            f"Force over penetration at {loop_speeds(view)}. {_loop_errors(view, near)}",
            "no setting's loops come near the law's in depth and force",
        ),
        Drawing(
            "loop-shapes",
            partial(loop_figures.shapes_figure, view, far) if far else None,
            f"Force over penetration, each over its own largest. {_loop_errors(view, far)}",
            "every loop drawn is of the law's size",
        ),
    ]


def _energy(view: View) -> Drawing:
    exponents = [
        f"{run.title}: p = {score['energy_exponent']:.2f}."
        for run in view.band_runs
        if (score := view.score(run)) is not None and math.isfinite(score["energy_exponent"])
    ]
    return Drawing(
        "energy",
        partial(trend_figures.energy_figure, view)
        if any(run.engine != REFERENCE for run in trend_figures.lossy_runs(view))
        else None,
        f"Energy lost over impact speed, log-log. {' '.join(exponents)}",
        "no setting ran over enough speeds and lost energy",
    )


def _steps(view: View) -> Drawing:
    curves, at = view.step_curves(), step_speed(view)
    ranges = [
        f"{run.title}: e from {e['low'].min():.3f} to {e['high'].max():.3f}." for run, e in curves.items()
    ]
    return Drawing(
        "steps",
        partial(trend_figures.steps_figure, view) if curves else None,
        f"Restitution over the time step at {at}. {' '.join(ranges)}",
        f"no setting ran at more than one step at {at}",
    )


def _bounces(view: View) -> Drawing:
    bounces = bounce_figures.drawn_bounces(view)
    heights = []
    for run, table in bounces.items():
        last = table.iloc[-1]
        ratio = float(last["height_m"]) / float(last["height_law_m"])
        of_law = f"{ratio:.2f} of the law's height after bounce {int(last['bounce'])}."
        heights.append(f"{run.title} at {run.step}: {of_law}")
    return Drawing(
        "trains",
        partial(bounce_figures.bounces_figure, view) if bounces else None,
        f"Heights of a drop's bounces under gravity. {' '.join(heights)}",
        "the study asks for no drop under gravity, or nothing bounced",
    )


def _largest_errors(view: View, runs: Sequence[RunKey]) -> str:
    """Curves in words: the largest errors at the main α."""
    return " ".join(
        f"{run.title} at {run.step}: wrong by at most {wording.error(score['max_error_law'])}."
        for run in runs
        if (score := view.score(run)) is not None
    )


def _loop_errors(view: View, runs: Sequence[RunKey]) -> str:
    """Loops in words: rms errors at the main α."""
    sentences = []
    for run in runs:
        score = view.score(run)
        if score is not None and score["loops"]:
            sentences.append(f"{run.title}: force wrong by {wording.percent(score['loop_rms'])} (rms).")
        else:
            sentences.append(f"{run.title}: too few samples for a score.")
    return " ".join(sentences)
