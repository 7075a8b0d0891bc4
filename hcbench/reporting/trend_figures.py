"""Energy lost over impact speed, and restitution over the time step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D

from hcbench.laws import closed_form
from hcbench.reporting import wording
from hcbench.reporting.plot_style import (
    LAW,
    SLATE,
    PlotStyle,
    draw_band,
    legend_below,
    log_axis,
    marker_stride,
    new_figure,
    second_axis,
    set_ticks,
)
from hcbench.reporting.restitution_figures import law_handles, step_suffix
from hcbench.reporting.view import REFERENCE, RunKey, View, engines_of
from hcbench.units import INCH

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hcbench.impact import Floats

_FLOOR = 1e-7  # errors below are drawn here
_TOP = 1.12  # of e: what bounces higher than this is an arrow at the frame


def lossy_runs(view: View) -> list[RunKey]:
    """Runs, coarse ones first, that lost energy at the main α, so that a log axis can show them."""
    shown = [*view.runs_by_resolution(False), *view.runs_by_resolution(True)]
    curves = {run: view.curve(run, view.main_alpha) for run in shown}
    return [run for run, curve in curves.items() if curve is not None and (curve.loss > 0).any()]


def energy_figure(view: View) -> Figure:
    """ΔE over v in log-log for the main α, one panel an engine, with guides of slope 2 and 3."""
    shown = lossy_runs(view)
    engines = engines_of(shown)
    columns, rows = min(2, len(engines)), -(-len(engines) // 2)
    figure = new_figure(5.6 * max(columns, 1.4), 5.9 * rows)
    panels = [figure.add_subplot(rows, columns, i + 1) for i in range(len(engines))]
    v = np.geomspace(view.band[0] * 0.999, view.band[1] * 1.001, 60)
    loss = closed_form.energy_loss(view.law(view.main_alpha), view.mass, v)
    for axes, engine in zip(panels, engines, strict=True):
        log_axis(axes, "x")
        log_axis(axes, "y")
        if (loss > 0).all():
            axes.plot(v, loss, color=LAW, linewidth=6, solid_capstyle="butt", zorder=1)
        runs = [run for run in shown if run.engine in (engine, REFERENCE)]
        handles = [_draw_loss(axes, view, run, runs, nth) for nth, run in enumerate(runs)]
        axes.set_title(wording.engine_title(engine))
        _speed_ticks(axes, v, view.in_inches)
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, -0.14), ncols=2, fontsize=8.5)
    least = min(axes.get_ylim()[0] for axes in panels)
    for axes in panels:
        _draw_guides(axes, v, 0.3 * least)
    limits = [axes.get_ylim() for axes in panels]
    for axes in panels:
        axes.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))
        axes.set_ylabel("energy lost in an impact ΔE, J")
    legend_below(figure, law_handles(linear=False))
    return figure


def _draw_loss(axes: Axes, view: View, run: RunKey, runs: list[RunKey], nth: int) -> Line2D:
    curve, score = view.curve(run, view.main_alpha), view.score(run)
    assert curve is not None
    style, lossy = view.plot_style(run).line(linewidth=1.4), curve.loss > 0
    marks = marker_stride(int(lossy.sum()), nth)
    axes.plot(curve.speed[lossy], curve.loss[lossy], markevery=marks, zorder=3, **style)
    exponent = score["energy_exponent"] if score is not None else np.nan
    slope = f"p = {exponent:.2f}" if np.isfinite(exponent) else "p unknown"
    return Line2D([], [], label=f"{run.label}{step_suffix(run, runs)}: {slope}", **style)


def _draw_guides(axes: Axes, v: Floats, level: float) -> None:
    """Two thin lines of slope 2 and 3 that start together, below everything else."""
    low, high = v[0], min(v[0] * 6, v[-1])
    for slope in (2, 3):
        end = level * (high / low) ** slope
        axes.plot([low, high], [level, end], color=SLATE, linewidth=0.9, zorder=2)
        axes.annotate(
            f"slope {slope}", (high, end), (4, -3), textcoords="offset points", fontsize=8.5, color=SLATE
        )


def _speed_ticks(axes: Axes, v: Floats, in_inches: bool) -> None:
    ticks = [s for s in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0) if v[0] <= s <= v[-1]]
    set_ticks(axes.xaxis, ticks)
    axes.set_xlabel("impact speed v, m/s")
    if not in_inches:
        return
    second_axis(axes, "top", "in/s")
    inches = [s for s in (1, 2, 5, 10, 20, 50, 100) if v[0] * 0.99 <= s * INCH <= v[-1] * 1.01]
    set_ticks(axes.child_axes[-1].xaxis, inches)


def steps_figure(view: View) -> Figure:
    """e over the time step at one speed for the main α, with its band over the phases; and its error."""
    curves = view.step_curves()
    engines = list(dict.fromkeys(run.engine for run in curves))
    figure = new_figure(11.2, 1.1 + 2.9 * len(engines))
    grid = figure.subplots(len(engines), 2, sharex=True, sharey="col", squeeze=False)
    law = float(closed_form.restitution(view.main_alpha, float(view.study["step_speed"])))
    steps = np.concatenate([table["timestep"].to_numpy(dtype=float) for table in curves.values()])
    ends = float(steps.min()) / 1.25, float(steps.max()) * 1.25
    handles, errors = [], [0.01]
    for (left, right), engine in zip(grid, engines, strict=True):
        left.axhline(law, color=LAW, linewidth=6, zorder=1)
        for axes in (left, right):
            axes.axvspan(min(view.contact_time, ends[1]), ends[1], color="#f4f2ec", zorder=0, linewidth=0)
        shown = [(run, table) for run, table in curves.items() if run.engine == engine]
        for nth, (run, table) in enumerate(shown):
            size = max(4.5, 7.5 - nth)  # where lines coincide, the ones below show as rings
            handle, error = _draw_steps(left, right, run.title, view.plot_style(run), table, law, size)
            handles.append(handle)
            errors.append(error)
        left.set_ylabel(f"{wording.engine_title(engine)}\nrestitution e")
        right.set_ylabel("error of e")
        log_axis(right, "y")
    grid[0, 0].set_ylim(-0.04, _TOP)
    grid[0, 1].set_ylim(max(_FLOOR, 10 ** np.floor(np.log10(0.7 * min(errors)))), 3.0)
    for axes in grid[-1]:
        axes.set_xscale("log")
        axes.set_xlim(*ends)
        set_ticks(axes.xaxis, [10.0**k for k in range(-9, 1) if ends[0] <= 10.0**k <= ends[1]], wording.time)
        axes.set_xlabel("time step h")
    legend_below(figure, [*law_handles(linear=False), *handles])
    return figure


def _draw_steps(
    left: Axes, right: Axes, title: str, style: PlotStyle, table: pd.DataFrame, law: float, size: float
) -> tuple[Line2D, float]:
    """Draw e over the step, and its largest error over the phases; the legend's entry and the least error."""
    columns = table.dropna()
    h, low, middle, top = (columns[c].to_numpy(dtype=float) for c in ("timestep", "low", "middle", "high"))
    draw_band(left, h, np.minimum(low, _TOP), np.minimum(top, _TOP), style.colour)
    left.plot(h, middle, zorder=3, **style.line(linewidth=1.4, markersize=size))
    over = top > _TOP
    if over.any():
        left.plot(h[over], np.full(over.sum(), _TOP - 0.03), "^", color=style.colour, markersize=7, zorder=4)
        title += f" (▲ up to e = {wording.number(float(top.max()))})"
    error = np.maximum(np.maximum(np.abs(low - law), np.abs(top - law)), 1.15 * _FLOOR)
    right.plot(h, error, zorder=3, **style.line(linewidth=1.3, markersize=size))
    return Line2D([], [], label=title, **style.line(linewidth=1.4)), float(error.min(initial=1.0))
