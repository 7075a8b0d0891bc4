"""Restitution over impact speed, and how far it is off: every setting, every α."""

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hcbench import scoring
from hcbench.laws import closed_form
from hcbench.reporting import wording
from hcbench.reporting.curve import Curve
from hcbench.reporting.plot_style import (
    INK,
    LAW,
    SLATE,
    declutter,
    draw_band,
    legend_below,
    log_axis,
    marker_stride,
    new_figure,
    set_ticks,
    speed_axis,
)
from hcbench.reporting.view import REFERENCE, RunKey, View, engines_of

_FLOOR = 1e-7  # errors below are drawn here: no figure needs to tell 1e-12 from 1e-15
_FAR, _GAP = 0.5, 0.2  # of e: what never comes above, and so far below the rest, has its own frame
_BAND_SHOWN = 1e-4  # of e: a smaller range over the phases cannot be seen

_CONSTANT: dict[str, Any] = {"color": INK, "linewidth": 1.0, "linestyle": (0, (5, 2))}
_LINEAR: dict[str, Any] = {"color": SLATE, "linewidth": 1.0, "linestyle": (0, (2, 2))}


class Column(NamedTuple):
    """A column of panels: its title, its α, s/m, and the runs that it shows."""

    title: str
    alpha: float
    runs: list[RunKey]


def columns_of_alphas(view: View, resolved: bool) -> list[Column]:
    """Engines' runs of a class, for each α; the reference's contrasts go with the fine steps."""
    runs = view.runs_by_resolution(resolved)
    contrasts = [run for run in runs if run.engine == REFERENCE]
    shown = [run for run in runs if run not in contrasts] + (contrasts if resolved else [])
    return [Column(wording.alpha_short(alpha), alpha, shown) for alpha in view.alphas]


def columns_of_steps(view: View) -> list[Column]:
    """Engines' runs at each step, for the main α."""
    runs = [run for run in view.band_runs if run.engine != REFERENCE]
    steps = sorted({run.timestep for run in runs})
    alpha = view.main_alpha
    return [
        Column(f"step {wording.time(h)}", alpha, [run for run in runs if run.timestep == h]) for h in steps
    ]


def law_handles(linear: bool = True) -> list[Line2D]:
    """Legend entries of the law and of 1 - αv."""
    law = Line2D([], [], color=LAW, linewidth=6, label="the law")
    return [law, Line2D([], [], **_LINEAR, label="1 − αv")] if linear else [law]


def step_suffix(run: RunKey, group: list[RunKey]) -> str:
    """The step of a run, where the group does not share one."""
    shared = len({other.timestep for other in group if other.engine != REFERENCE}) == 1
    return "" if shared or run.engine == REFERENCE else f" ({run.step})"


def _handles(view: View, columns: list[Column], drawn: set[RunKey]) -> list[Line2D]:
    """Legend entries of what was drawn; with the step where a column has several."""
    handles = {}
    for column in columns:
        for run in filter(drawn.__contains__, column.runs):
            text = run.title + step_suffix(run, column.runs)
            handles[text] = Line2D([], [], label=text, **view.plot_style(run).line(linewidth=1.6))
    return list(handles.values())


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
    """One engine and column of a figure, with the curves to draw: (number of its line, run, curve)."""

    axes: Axes
    alpha: float
    curves: list[tuple[int, RunKey, Curve]]


def _panels(view: View, columns: list[Column], label: str, sharey: Any) -> tuple[Figure, list[_Panel]]:
    """A row an engine."""
    engines = engines_of(run for column in columns for run in column.runs)
    figure = new_figure(0.6 + 2.65 * max(len(columns), 2), 0.9 + 2.55 * len(engines))
    grid = figure.subplots(len(engines), len(columns), sharex=True, sharey=sharey, squeeze=False)
    panels = []
    for row, engine in enumerate(engines):
        grid[row, 0].set_ylabel(f"{wording.engine_title(engine)}\n{label}")
        for axes, (title, alpha, runs) in zip(grid[row], columns, strict=True):
            shown = [run for run in runs if run.engine in (engine, REFERENCE)]
            curves = [(nth, run, view.curve(run, alpha)) for nth, run in enumerate(shown)]
            panels.append(_Panel(axes, alpha, [(n, r, curve) for n, r, curve in curves if curve is not None]))
            speed_axis(axes, label=row == len(engines) - 1, inches=row == 0 and view.in_inches)
            if row == 0:
                axes.set_title(title, pad=8)
    return figure, panels


def restitution_figure(view: View, columns: list[Column]) -> Figure:
    """e over v: a row an engine; the frame is set by the law, and what misses it is named."""
    figure, panels = _panels(view, columns, "restitution e", sharey="col")
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
                f"▼ {run.label}: e = {curve.range_text(' ')}",
                (0.03, 0.03 + 0.075 * nth),
                xycoords="axes fraction",
                color=view.plot_style(run).colour,
                fontsize=8.5,
                zorder=4,
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
            )
    legend_below(figure, law_handles() + _handles(view, columns, drawn))
    return figure


def _set_frame(axes: Axes, view: View, alpha: float) -> float:
    """Limits that show the law; the lower one of e."""
    lowest = max(0.0, 1 - alpha * view.speeds[-1])  # 1 - αv lies below the law
    depth = max(1 - lowest, 0.02)
    axes.set_ylim(lowest - 0.35 * depth, 1 + 0.12 * depth)
    axes.set_xlim(0, view.speeds[-1] * 1.02)
    return float(axes.get_ylim()[0])


def error_figure(view: View, columns: list[Column]) -> Figure:
    """|e - e of (16)| over v, worst phase, log scale, over the best that one constant e can do."""
    figure, panels = _panels(view, columns, "error of e", sharey=True)
    drawn: set[RunKey] = set()
    lowest = 1.0
    for axes, alpha, curves in panels:
        _, line = scoring.best_constant(alpha, np.array(view.study["speeds"]))
        axes.axhline(line, zorder=2, **_CONSTANT)
        for nth, run, curve in curves:
            drawn.add(run)
            error = np.maximum(curve.error, 1.3 * _FLOOR)
            lowest = min(lowest, float(error.min()))
            marks = marker_stride(len(curve.speed), nth)
            style = view.plot_style(run).line(linewidth=1.3)
            axes.plot(curve.speed, error, markevery=marks, zorder=3, **style)
        log_axis(axes, "y")
        axes.set_xlim(0, view.speeds[-1] * 1.02)
    panels[0].axes.set_ylim(max(_FLOOR, 10 ** np.floor(np.log10(lowest))), 2)
    constant = Line2D([], [], label="best constant e", **_CONSTANT)
    legend_below(figure, [constant, *_handles(view, columns, drawn)])
    return figure


def overview_figure(view: View, runs: list[RunKey]) -> Figure:
    """The page in one picture: the main α, the settings that matter, each named beside its line.

    What lies far below the rest has a frame of its own at the bottom.
    """
    alpha, figure, v_end = view.main_alpha, Figure(figsize=(9.2, 4.8)), view.speeds[-1]
    curves = [
        (nth, run, curve) for nth, run in enumerate(runs) if (curve := view.curve(run, alpha)) is not None
    ]
    lowest = min([1 - alpha * v_end, *(float(c.low.min()) for _, _, c in curves if c.high.max() > _FAR)])
    far = [item for item in curves if item[2].high.max() < lowest - _GAP]
    lower = 0.2 if far else 0.0
    axes = figure.add_axes((0.075, 0.115 + lower, 0.615, 0.765 - lower))
    _draw_law(axes, view, alpha)
    axes.set_ylim(max(0.0, lowest - 0.05 * (1.05 - lowest)), 1 + 0.15 * (1 - lowest))
    labels = [
        (float(closed_form.restitution(alpha, v_end)), "the law", SLATE, "bold"),
        (1 - alpha * v_end, "1 − αv", SLATE, "normal"),
    ]
    _draw_named(axes, view, [item for item in curves if item not in far], labels)
    axes.set_ylabel("restitution e")
    if far:
        bottom = figure.add_axes((0.075, 0.115, 0.615, lower - 0.04), sharex=axes)
        top = max(0.1, 1.3 * max(float(curve.high.max()) for _, _, curve in far))
        bottom.set_ylim(-0.15 * top, top)
        set_ticks(bottom.yaxis, [0.0, round(0.8 * top, 2)])
        _draw_named(bottom, view, far, [])
        axes.tick_params(labelbottom=False)
    speed_axis(axes, label=not far, inches=view.in_inches)
    if far:
        speed_axis(bottom, inches=False)
    axes.set_xlim(0, v_end * 1.005)
    return figure


def _draw_named(
    axes: Axes,
    view: View,
    curves: list[tuple[int, RunKey, Curve]],
    labels: list[tuple[float, str, str, str]],
) -> None:
    """Curves, and beside them their names and those of other lines."""
    for nth, run, curve in curves:
        _draw_curve(axes, view, run, curve, nth)
        name = (f"{run.title}, {run.step}", view.plot_style(run).colour, "normal")
        labels = [*labels, (float(curve.middle[-1]), *name)]
    _label_ends(axes, labels)


def _label_ends(axes: Axes, labels: list[tuple[float, str, str, str]]) -> None:
    """Names in the right margin, each led to its line's end, none over another."""
    low, high = axes.get_ylim()
    ends = (np.clip([label[0] for label in labels], low, high) - low) / (high - low)
    height = axes.get_position().height
    places = declutter(ends, 0.0444 / height, 0.0, 1.0)
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
