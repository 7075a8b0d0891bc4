"""Bounce trains: how high a dropped ball rises again and again, beside the law's heights."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from hcbench.report import style, wording
from hcbench.report.curves import law_handles
from hcbench.report.view import REFERENCE, TRUTH, View

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hcbench.report.view import Run


def drawn_trains(view: View) -> dict[Run, pd.DataFrame]:
    """Trains of the main α that came to a bounce, the law's own left out."""
    return {run: table for run, table in view.trains.items() if run[:2] != (REFERENCE, TRUTH)}


def law_heights(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Bounce numbers and the law's heights, m, the drop itself as number 0; from the longest train."""
    longest = max(view.trains.values(), key=len)
    start = float(view.study["train_height"])
    heights = np.concatenate([[start], longest["height_law_m"].to_numpy(dtype=float)])
    return np.arange(len(heights)), heights


def trains_figure(view: View) -> Figure:
    """Heights over the number of the bounce, and the same over the law's."""
    trains = drawn_trains(view)
    figure = style.new_figure(11.2, 4.6)
    left, right = figure.subplots(1, 2)
    numbers, truth = law_heights(view)
    left.plot(numbers, 1e3 * truth, color=style.LAW, linewidth=6, solid_capstyle="butt", zorder=1)
    right.axhline(1.0, color=style.LAW, linewidth=6, zorder=1)
    handles = []
    for nth, (run, table) in enumerate(trains.items()):
        look = view.look(run).line(linewidth=1.4, markersize=max(4.5, 7.5 - nth))
        number = table["bounce"].to_numpy(dtype=float)
        height = table["height_m"].to_numpy(dtype=float)
        left.plot([0, *number], [1e3 * truth[0], *(1e3 * height)], zorder=3, **look)
        right.plot(number, height / table["height_law_m"].to_numpy(dtype=float), zorder=3, **look)
        label = f"{wording.setting_name(run.engine, run.setting)} ({wording.time(run.timestep)})"
        handles.append(Line2D([], [], label=label, **look))
    _height_axis(left)
    right.set_ylabel("height over the law's")
    right.set_ylim(bottom=0)
    for axes in (left, right):
        axes.set_xlabel("bounce")
        axes.set_xlim(-0.3, numbers[-1] + 0.3)
        axes.xaxis.set_major_locator(MaxNLocator(11, integer=True))
    style.legend_below(figure, [*law_handles(linear=False), *handles])
    return figure


def _height_axis(axes: Axes) -> None:
    """Log: a body that loses the same share each time goes down a straight line."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    ticks = [m * 10.0**k for k in range(-6, 6) for m in (1, 2, 5) if low <= m * 10.0**k <= high]
    axes.yaxis.set_major_locator(FixedLocator(ticks if len(ticks) < 10 else ticks[::3]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylabel("height after the bounce, mm")
