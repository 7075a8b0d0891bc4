"""Restitution over impact speed, and how far it is off: every setting, every α."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hcbench import scoring
from hcbench.laws import closed_form
from hcbench.report import style, wording
from hcbench.report.view import REFERENCE, Curve, Run, View

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FLOOR = 1e-7  # errors below are drawn here: no figure needs to tell 1e-12 from 1e-15

_CONSTANT: dict[str, Any] = {"color": style.INK, "linewidth": 1.0, "linestyle": (0, (5, 2))}


def law_handles(linear: bool = True) -> list[Line2D]:
    """Legend entries of the law and of 1 - αv."""
    law = Line2D([], [], color=style.LAW, linewidth=6, label="the law, eq. (16)")
    line = Line2D([], [], color=style.LINEAR, linewidth=1.0, linestyle=(0, (2, 2)), label="1 − αv, eq. (2)")
    return [law, line] if linear else [law]


def run_label(view: View, run: Run, group: list[Run], engine: bool = True) -> str:
    """The setting's name, with its step where the group does not share one."""
    name = wording.setting_name(run.engine, run.setting) if engine else run.setting
    shared = len({other.timestep for other in group if other.engine != REFERENCE}) == 1
    return name if shared or run.engine == REFERENCE else f"{name} ({wording.time(run.timestep)})"


def run_handles(view: View, runs: list[Run]) -> list[Line2D]:
    """Legend entries of runs."""
    return [
        Line2D([], [], label=run_label(view, run, runs), **view.look(run).line(linewidth=1.6)) for run in runs
    ]


def draw_law(axes: Axes, view: View, alpha: float) -> None:
    """e of (16) as a broad pale band, 1 - αv dashed."""
    v = view.speeds
    axes.plot(
        v, closed_form.restitution(alpha, v), color=style.LAW, linewidth=6, solid_capstyle="butt", zorder=1
    )
    axes.plot(v, 1 - alpha * v, color=style.LINEAR, linewidth=1.0, linestyle=(0, (2, 2)), zorder=2)


def draw_curve(axes: Axes, view: View, run: Run, curve: Curve, nth: int = 0) -> None:
    """One setting: median over phases, with the band that the phases span."""
    look = view.look(run)
    if (curve.high - curve.low > 1e-4).any():
        axes.fill_between(curve.speed, curve.low, curve.high, color=look.colour, alpha=0.18, linewidth=0)
    marks = style.every_few(len(curve.speed), nth)
    axes.plot(curve.speed, curve.middle, markevery=marks, zorder=3, **look.line())


def restitution_figure(view: View, fine: bool) -> Figure:
    """e over v: a row an engine, a column an α; the frame is set by the law, and what misses it is named."""
    runs = _shown(view, fine)
    engines = list(dict.fromkeys(run.engine for run in runs if run.engine != REFERENCE))
    figure = style.new_figure(_width(view), 0.9 + 2.55 * len(engines))
    grid = figure.subplots(len(engines), len(view.alphas), sharex=True, sharey="col", squeeze=False)
    drawn: set[Run] = set()
    for row, engine in enumerate(engines):
        for column, alpha in enumerate(view.alphas):
            axes: Axes = grid[row, column]
            _frame(axes, view, alpha)
            missed = []
            for nth, run in enumerate(r for r in runs if r.engine in (engine, REFERENCE)):
                curve = view.curve(run, alpha)
                if curve is None:
                    continue
                if (curve.high < axes.get_ylim()[0]).all():
                    missed.append((run, curve))
                else:
                    draw_curve(axes, view, run, curve, nth)
                    drawn.add(run)
            _name_missed(axes, view, missed)
            _label_panel(axes, view, row, column, len(engines), engine, alpha)
    style.legend_below(figure, law_handles() + run_handles(view, [run for run in runs if run in drawn]))
    return figure


def _shown(view: View, fine: bool) -> list[Run]:
    """Engines' runs of a class; the reference's contrasts ride along with fine steps, where they belong."""
    runs = view.of_class(fine)
    return [r for r in runs if r.engine != REFERENCE] + [r for r in runs if r.engine == REFERENCE and fine]


def _width(view: View) -> float:
    return 0.6 + 2.65 * max(len(view.alphas), 2)


def _frame(axes: Axes, view: View, alpha: float) -> None:
    draw_law(axes, view, alpha)
    lowest = max(0.0, 1 - alpha * view.speeds[-1])  # 1 - αv lies below the law
    depth = max(1 - lowest, 0.02)
    axes.set_ylim(lowest - 0.35 * depth, 1 + 0.12 * depth)
    axes.set_xlim(0, view.speeds[-1] * 1.02)


def _name_missed(axes: Axes, view: View, missed: list[tuple[Run, Curve]]) -> None:
    for nth, (run, curve) in enumerate(missed):
        low, high = curve.low.min(), curve.high.max()
        span = f"{low:.2f}" if high - low < 0.005 else f"{low:.2f} … {high:.2f}"
        axes.annotate(
            f"▼ {run.setting}: e = {span}",
            (0.03, 0.03 + 0.075 * nth),
            xycoords="axes fraction",
            color=view.look(run).colour,
            fontsize=8.5,
            zorder=4,
        )


def _label_panel(axes: Axes, view: View, row: int, column: int, rows: int, engine: str, alpha: float) -> None:
    style.speed_axis(axes, label=row == rows - 1, inches=row == 0)
    if row == 0:
        axes.set_title(wording.alpha_short(alpha), pad=8)
    if column == 0:
        axes.set_ylabel(f"{wording.engine_name(engine)}\nrestitution e")


def error_figure(view: View, fine: bool) -> Figure:
    """|e - e of (16)| over v, worst phase, log scale, over the best that one constant e can do."""
    runs = _shown(view, fine)
    engines = list(dict.fromkeys(run.engine for run in runs if run.engine != REFERENCE))
    figure = style.new_figure(_width(view), 0.9 + 2.55 * len(engines))
    grid = figure.subplots(len(engines), len(view.alphas), sharex=True, sharey=True, squeeze=False)
    lowest = 1.0
    for row, engine in enumerate(engines):
        for column, alpha in enumerate(view.alphas):
            axes: Axes = grid[row, column]
            _, line = scoring.best_constant(alpha, np.array(view.study["speeds"]))
            axes.axhline(line, zorder=2, **_CONSTANT)
            for nth, run in enumerate(r for r in runs if r.engine in (engine, REFERENCE)):
                curve = view.curve(run, alpha)
                if curve is None:
                    continue
                error = np.maximum(curve.error, 1.3 * _FLOOR)
                lowest = min(lowest, float(error.min()))
                look = view.look(run).line(linewidth=1.3)
                marks = style.every_few(len(curve.speed), nth)
                axes.plot(curve.speed, error, markevery=marks, zorder=3, **look)
            style.log_axis(axes, "y")
            _label_panel(axes, view, row, column, len(engines), engine, alpha)
            axes.set_xlim(0, view.speeds[-1] * 1.02)
    for axes in grid[:, 0]:
        axes.set_ylabel(axes.get_ylabel().replace("restitution e", "error of e"))
    grid[0, 0].set_ylim(max(_FLOOR, 10 ** np.floor(np.log10(lowest))), 2)
    constant = Line2D([], [], label="best constant e: the line to beat", **_CONSTANT)
    style.legend_below(figure, [constant, *run_handles(view, runs)])
    return figure


def overview_figure(view: View, runs: list[Run]) -> Figure:
    """The page in one picture: the main α, the settings that matter, each named beside its line."""
    alpha, figure = view.main_alpha, Figure(figsize=(9.2, 4.8))
    axes = figure.add_axes((0.075, 0.115, 0.615, 0.765))
    draw_law(axes, view, alpha)
    v_end = view.speeds[-1]
    labels = [
        (float(closed_form.restitution(alpha, v_end)), "the law, eq. (16)", style.LINEAR, "bold"),
        (1 - alpha * v_end, "1 − αv, eq. (2)", style.LINEAR, "normal"),
    ]
    for nth, run in enumerate(runs):
        curve = view.curve(run, alpha)
        if curve is None:
            continue
        draw_curve(axes, view, run, curve, nth)
        text = f"{wording.setting_name(run.engine, run.setting)}, {wording.time(run.timestep)}"
        labels.append((float(curve.middle[-1]), text, view.look(run).colour, "normal"))
    ends = [end for end, *_ in labels]
    shown = [curve for curve in (view.curve(run, alpha) for run in runs) if curve is not None]
    lowest = max(0.0, min([*ends, *(float(curve.low.min()) for curve in shown)]))
    axes.set_ylim(lowest - 0.05 * (1.05 - lowest), max(1.03, min(1.3, max(ends) + 0.03)))
    axes.set_xlim(0, v_end * 1.005)
    _label_ends(axes, labels)
    style.speed_axis(axes)
    axes.set_ylabel("restitution e")
    return figure


def _label_ends(axes: Axes, labels: list[tuple[float, str, str, str]]) -> None:
    """Names in the right margin, each led to its line's end, none over another."""
    low, high = axes.get_ylim()
    ends = (np.clip([label[0] for label in labels], low, high) - low) / (high - low)
    places = style.spread_apart(ends, 0.058, 0.0, 1.0)
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
