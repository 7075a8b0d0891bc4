"""Restitution over impact speed, and how far it is off: every setting, every α."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hcbench import scoring
from hcbench.laws import closed_form
from hcbench.report import wording
from hcbench.report.plot_style import (
    INK,
    LAW,
    SLATE,
    declutter,
    draw_band,
    legend_below,
    log_axis,
    marker_stride,
    new_figure,
    speed_axis,
)
from hcbench.report.view import REFERENCE, Curve, RunKey, View, engines_of

_FLOOR = 1e-7  # errors below are drawn here: no figure needs to tell 1e-12 from 1e-15
_BAND_SHOWN = 1e-4  # of e: a smaller spread over the phases is not to be seen

_CONSTANT: dict[str, Any] = {"color": INK, "linewidth": 1.0, "linestyle": (0, (5, 2))}
_LINEAR: dict[str, Any] = {"color": SLATE, "linewidth": 1.0, "linestyle": (0, (2, 2))}


def law_handles(linear: bool = True) -> list[Line2D]:
    """Legend entries of the law and of 1 - αv."""
    law = Line2D([], [], color=LAW, linewidth=6, label="the law, eq. (16)")
    return [law, Line2D([], [], **_LINEAR, label="1 − αv, eq. (2)")] if linear else [law]


def step_suffix(run: RunKey, group: list[RunKey]) -> str:
    """The step of a run, where the group does not share one."""
    shared = len({other.timestep for other in group if other.engine != REFERENCE}) == 1
    return "" if shared or run.engine == REFERENCE else f" ({run.step})"


def _handles(view: View, runs: list[RunKey]) -> list[Line2D]:
    """Legend entries of runs."""
    return [
        Line2D([], [], label=run.title + step_suffix(run, runs), **view.plot_style(run).line(linewidth=1.6))
        for run in runs
    ]


def _draw_law(axes: Axes, view: View, alpha: float) -> None:
    """e of (16) as a broad pale band, 1 - αv dotted."""
    v = view.speeds
    e = closed_form.restitution(alpha, v)
    axes.plot(v, e, color=LAW, linewidth=6, solid_capstyle="butt", zorder=1)
    axes.plot(v, 1 - alpha * v, zorder=2, **_LINEAR)


def _draw_curve(axes: Axes, view: View, run: RunKey, curve: Curve, nth: int) -> None:
    """One setting: median over phases, with the band that the phases span."""
    style = view.plot_style(run)
    if (curve.high - curve.low > _BAND_SHOWN).any():
        draw_band(axes, curve.speed, curve.low, curve.high, style.colour)
    marks = marker_stride(len(curve.speed), nth)
    axes.plot(curve.speed, curve.middle, markevery=marks, zorder=3, **style.line())


class _Panel(NamedTuple):
    """One engine and α of a figure, with the curves to draw: (number of its line, run, curve)."""

    axes: Axes
    alpha: float
    curves: list[tuple[int, RunKey, Curve]]


def _shown(view: View, resolved: bool) -> list[RunKey]:
    """Engines' runs of a class; the reference's contrasts go with those that resolve the contact."""
    runs = view.runs_by_resolution(resolved)
    contrasts = [run for run in runs if run.engine == REFERENCE]
    return [run for run in runs if run not in contrasts] + (contrasts if resolved else [])


def _panels(view: View, runs: list[RunKey], label: str, sharey: Any) -> tuple[Figure, list[_Panel]]:
    """A row an engine, a column an α."""
    engines = engines_of(runs)
    figure = new_figure(0.6 + 2.65 * max(len(view.alphas), 2), 0.9 + 2.55 * len(engines))
    grid = figure.subplots(len(engines), len(view.alphas), sharex=True, sharey=sharey, squeeze=False)
    panels = []
    for row, engine in enumerate(engines):
        shown = [run for run in runs if run.engine in (engine, REFERENCE)]
        grid[row, 0].set_ylabel(f"{wording.engine_title(engine)}\n{label}")
        for axes, alpha in zip(grid[row], view.alphas, strict=True):
            curves = [(nth, run, view.curve(run, alpha)) for nth, run in enumerate(shown)]
            panels.append(_Panel(axes, alpha, [(n, r, curve) for n, r, curve in curves if curve is not None]))
            speed_axis(axes, label=row == len(engines) - 1, inches=row == 0)
            if row == 0:
                axes.set_title(wording.alpha_short(alpha), pad=8)
    return figure, panels


def restitution_figure(view: View, resolved: bool) -> Figure:
    """e over v: a row an engine, a column an α; the frame is set by the law, and what misses it is named."""
    runs = _shown(view, resolved)
    figure, panels = _panels(view, runs, "restitution e", sharey="col")
    drawn: set[RunKey] = set()
    for axes, alpha, curves in panels:
        _draw_law(axes, view, alpha)
        bottom = _set_frame(axes, view, alpha)
        missed = [(run, curve) for _, run, curve in curves if (curve.high < bottom).all()]
        for nth, run, curve in curves:
            if (run, curve) not in missed:
                _draw_curve(axes, view, run, curve, nth)
                drawn.add(run)
        for nth, (run, curve) in enumerate(missed):
            axes.annotate(
                f"▼ {run.setting}: e = {curve.range_text(' ')}",
                (0.03, 0.03 + 0.075 * nth),
                xycoords="axes fraction",
                color=view.plot_style(run).colour,
                fontsize=8.5,
                zorder=4,
            )
    legend_below(figure, law_handles() + _handles(view, [run for run in runs if run in drawn]))
    return figure


def _set_frame(axes: Axes, view: View, alpha: float) -> float:
    """Limits that show the law; the lower one of e."""
    lowest = max(0.0, 1 - alpha * view.speeds[-1])  # 1 - αv lies below the law
    depth = max(1 - lowest, 0.02)
    axes.set_ylim(lowest - 0.35 * depth, 1 + 0.12 * depth)
    axes.set_xlim(0, view.speeds[-1] * 1.02)
    return float(axes.get_ylim()[0])


def error_figure(view: View, resolved: bool) -> Figure:
    """|e - e of (16)| over v, worst phase, log scale, over the best that one constant e can do."""
    runs = _shown(view, resolved)
    figure, panels = _panels(view, runs, "error of e", sharey=True)
    lowest = 1.0
    for axes, alpha, curves in panels:
        _, line = scoring.best_constant(alpha, np.array(view.study["speeds"]))
        axes.axhline(line, zorder=2, **_CONSTANT)
        for nth, run, curve in curves:
            error = np.maximum(curve.error, 1.3 * _FLOOR)
            lowest = min(lowest, float(error.min()))
            marks = marker_stride(len(curve.speed), nth)
            style = view.plot_style(run).line(linewidth=1.3)
            axes.plot(curve.speed, error, markevery=marks, zorder=3, **style)
        log_axis(axes, "y")
        axes.set_xlim(0, view.speeds[-1] * 1.02)
    panels[0].axes.set_ylim(max(_FLOOR, 10 ** np.floor(np.log10(lowest))), 2)
    constant = Line2D([], [], label="best constant e: the line to beat", **_CONSTANT)
    legend_below(figure, [constant, *_handles(view, runs)])
    return figure


def overview_figure(view: View, runs: list[RunKey]) -> Figure:
    """The page in one picture: the main α, the settings that matter, each named beside its line."""
    alpha, figure = view.main_alpha, Figure(figsize=(9.2, 4.8))
    axes = figure.add_axes((0.075, 0.115, 0.615, 0.765))
    _draw_law(axes, view, alpha)
    v_end = view.speeds[-1]
    labels = [
        (float(closed_form.restitution(alpha, v_end)), "the law, eq. (16)", SLATE, "bold"),
        (1 - alpha * v_end, "1 − αv, eq. (2)", SLATE, "normal"),
    ]
    curves = [(nth, run, view.curve(run, alpha)) for nth, run in enumerate(runs)]
    least = []
    for nth, run, curve in curves:
        if curve is not None:
            _draw_curve(axes, view, run, curve, nth)
            colour = view.plot_style(run).colour
            labels.append((float(curve.middle[-1]), f"{run.title}, {run.step}", colour, "normal"))
            least.append(float(curve.low.min()))
    ends = [end for end, *_ in labels]
    lowest = max(0.0, min([*ends, *least]))
    axes.set_ylim(lowest - 0.05 * (1.05 - lowest), max(1.03, min(1.3, max(ends) + 0.03)))
    axes.set_xlim(0, v_end * 1.005)
    _label_ends(axes, labels)
    speed_axis(axes)
    axes.set_ylabel("restitution e")
    return figure


def _label_ends(axes: Axes, labels: list[tuple[float, str, str, str]]) -> None:
    """Names in the right margin, each led to its line's end, none over another."""
    low, high = axes.get_ylim()
    ends = (np.clip([label[0] for label in labels], low, high) - low) / (high - low)
    places = declutter(ends, 0.058, 0.0, 1.0)
    for end, place, (_, text, colour, weight) in zip(ends, places, labels, strict=True):
        axes.annotate(
            text,
            (1.0, end),
            (1.06, place),
            xycoords="axes fraction",
            textcoords="axes fraction",
            color=colour,
            fontweight=weight,
            va="center",
            arrowprops={
                "arrowstyle": "-",
                "color": colour,
                "linewidth": 0.7,
                "shrinkA": 0,
                "shrinkB": 0,
                "relpos": (0.0, 0.5),
            },
        )
