"""Energy lost over impact speed, and restitution over the time step."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from hcbench.laws import closed_form
from hcbench.report import style, wording
from hcbench.report.curves import law_handles, run_label
from hcbench.report.view import REFERENCE, Run, View

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hcbench.impact import Floats

_FLOOR = 1e-7  # errors below are drawn here
_TOP = 1.12  # of e: what bounces higher than this is an arrow at the frame


def lossy_runs(view: View) -> list[Run]:
    """Runs, coarse ones first, that lost energy at the main α, so that a log axis can show them."""
    shown = [*view.of_class(fine=False), *view.of_class(fine=True)]
    curves = {run: view.curve(run, view.main_alpha) for run in shown}
    return [run for run, curve in curves.items() if curve is not None and (curve.loss > 0).any()]


def energy_figure(view: View) -> Figure:
    """ΔE over v in log-log for the main α, one panel an engine, with guides of slope 2 and 3."""
    shown = lossy_runs(view)
    engines = list(dict.fromkeys(run.engine for run in shown if run.engine != REFERENCE))
    columns, rows = min(2, len(engines)), -(-len(engines) // 2)
    figure = style.new_figure(5.6 * max(columns, 1.4), 5.9 * rows)
    panels = [figure.add_subplot(rows, columns, i + 1) for i in range(len(engines))]
    v = np.geomspace(min(view.study["speeds"]) * 0.999, max(view.study["speeds"]) * 1.001, 60)
    loss = closed_form.energy_loss(view.law(view.main_alpha), float(view.study["mass_kg"]), v)
    for axes, engine in zip(panels, engines, strict=True):
        style.log_axis(axes, "x")
        style.log_axis(axes, "y")
        if (loss > 0).all():
            axes.plot(v, loss, color=style.LAW, linewidth=6, solid_capstyle="butt", zorder=1)
        runs = [run for run in shown if run.engine in (engine, REFERENCE)]
        handles = [_draw_loss(axes, view, run, runs, nth) for nth, run in enumerate(runs)]
        axes.set_title(wording.engine_name(engine))
        _speed_ticks(axes, v)
        labels = [str(h.get_label()) for h in handles]
        place: dict[str, Any] = {
            "loc": "upper left",
            "bbox_to_anchor": (0.0, -0.14),
            "ncols": 2,
            "fontsize": 8.5,
        }
        axes.legend(handles, labels, **place)
    least = min(axes.get_ylim()[0] for axes in panels)
    for axes in panels:
        _guides(axes, v, 0.3 * least)
    limits = [axes.get_ylim() for axes in panels]
    for axes in panels:
        axes.set_ylim(min(low for low, _ in limits), max(high for _, high in limits))
        axes.set_ylabel("energy lost in an impact ΔE, J")
    style.legend_below(figure, law_handles(linear=False))
    return figure


def _draw_loss(axes: Axes, view: View, run: Run, runs: list[Run], nth: int) -> Line2D:
    curve, score = view.curve(run, view.main_alpha), view.score(run, view.main_alpha)
    assert curve is not None
    look, lossy = view.look(run).line(linewidth=1.4), curve.loss > 0
    marks = style.every_few(int(lossy.sum()), nth)
    axes.plot(curve.speed[lossy], curve.loss[lossy], markevery=marks, zorder=3, **look)
    exponent = score["energy_exponent"] if score is not None else np.nan
    slope = f"p = {exponent:.2f}" if np.isfinite(exponent) else "p unknown"
    return Line2D([], [], label=f"{run_label(view, run, runs, engine=False)}: {slope}", **look)


def _guides(axes: Axes, v: Floats, level: float) -> None:
    """Two thin lines of slope 2 and 3 that start together, below everything else."""
    low, high = v[0], min(v[0] * 6, v[-1])
    for slope in (2, 3):
        end = level * (high / low) ** slope
        axes.plot([low, high], [level, end], color=style.LINEAR, linewidth=0.9, zorder=2)
        near: dict[str, Any] = {"textcoords": "offset points", "fontsize": 8.5, "color": style.LINEAR}
        axes.annotate(f"slope {slope}", (high, end), (4, -3), **near)


def _speed_ticks(axes: Axes, v: Floats) -> None:
    inside = [s for s in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0) if v[0] <= s <= v[-1]]
    axes.xaxis.set_major_locator(FixedLocator(inside))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("impact speed v, m/s")
    style.inch_axis(axes, "top", "in/s")
    top = axes.child_axes[-1].xaxis
    ticks = [s for s in (1, 2, 5, 10, 20, 50, 100) if v[0] * 0.99 <= s * wording.INCH <= v[-1] * 1.01]
    top.set_major_locator(FixedLocator(ticks))
    top.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    top.set_minor_locator(NullLocator())


def steps_figure(view: View) -> Figure:
    """e over the time step at one speed for the main α, with its band over the phases; and its error."""
    curves = {key: table for key, table in view.step_curves().items() if len(table) > 1}
    engines = list(dict.fromkeys(engine for engine, _ in curves))
    figure = style.new_figure(11.2, 1.1 + 2.9 * len(engines))
    grid = figure.subplots(len(engines), 2, sharex=True, sharey="col", squeeze=False)
    truth = float(closed_form.restitution(view.main_alpha, float(view.study["step_speed"])))
    spans = [table["timestep"] for table in curves.values()]
    ends = min(map(min, spans)) / 1.25, max(map(max, spans)) * 1.25
    handles: dict[str, Line2D] = {}
    least = [0.01]
    for (left, right), engine in zip(grid, engines, strict=True):
        left.axhline(truth, color=style.LAW, linewidth=6, zorder=1)
        for axes in (left, right):
            axes.axvspan(min(view.contact_time, ends[1]), ends[1], color="#f4f2ec", zorder=0, linewidth=0)
        mine = [(setting, table) for (name, setting), table in curves.items() if name == engine]
        for nth, (setting, table) in enumerate(mine):
            size = max(4.5, 7.5 - nth)  # where lines coincide, the ones below show as rings
            handles[f"{engine} {setting}"] = _draw_steps(left, view, engine, setting, table, size)
            least.append(_draw_step_error(right, view, engine, setting, table, truth, size))
        left.set_ylabel(f"{wording.engine_name(engine)}\nrestitution e")
        right.set_ylabel("error of e")
        style.log_axis(right, "y")
    grid[0, 0].set_ylim(-0.04, _TOP)
    grid[0, 1].set_ylim(max(_FLOOR, 10 ** np.floor(np.log10(0.7 * min(least)))), 3.0)
    for axes in grid[-1]:
        axes.set_xscale("log")
        axes.set_xlim(*ends)
        _time_ticks(axes, *ends)
        axes.set_xlabel("time step h")
    style.legend_below(figure, [*law_handles(linear=False), *handles.values()])
    return figure


def _draw_steps(
    axes: Axes, view: View, engine: str, setting: str, table: pd.DataFrame, size: float
) -> Line2D:
    look = view.looks[engine, setting]
    known = table.dropna()
    h, low, middle, top = (known[c].to_numpy(dtype=float) for c in ("timestep", "low", "middle", "high"))
    band = np.minimum(low, _TOP), np.minimum(top, _TOP)
    axes.fill_between(h, *band, color=look.colour, alpha=0.18, linewidth=0)
    axes.plot(h, middle, zorder=3, **look.line(linewidth=1.4, markersize=size))
    over = top > _TOP
    label = wording.setting_name(engine, setting)
    if over.any():
        axes.plot(h[over], np.full(over.sum(), _TOP - 0.03), "^", color=look.colour, markersize=7, zorder=4)
        label += f" (▲ up to e = {wording.small(float(top.max()))})"
    return Line2D([], [], label=label, **look.line(linewidth=1.4))


def _draw_step_error(
    axes: Axes, view: View, engine: str, setting: str, table: pd.DataFrame, truth: float, size: float
) -> float:
    """Draws the largest error over the phases; the least of them over the steps."""
    known = table.dropna()
    low, high = (known[c].to_numpy(dtype=float) for c in ("low", "high"))
    off = np.maximum(np.maximum(np.abs(low - truth), np.abs(high - truth)), 1.15 * _FLOOR)
    style_ = view.looks[engine, setting].line(linewidth=1.3, markersize=size)
    axes.plot(known["timestep"], off, zorder=3, **style_)
    return float(off.min(initial=1.0))


def _time_ticks(axes: Axes, low: float, high: float) -> None:
    ticks = [10.0**k for k in range(-9, 1) if low <= 10.0**k <= high]
    axes.xaxis.set_major_locator(FixedLocator(ticks))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: wording.time(value)))
    axes.xaxis.set_minor_locator(NullLocator())
