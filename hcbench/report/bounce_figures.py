"""Successive bounces: how high a dropped ball rises again and again, beside the law's heights."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from hcbench.report.plot_style import LAW, legend_below, new_figure, set_ticks
from hcbench.report.restitution_figures import law_handles

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hcbench.report.view import RunKey, View


def drawn_bounces(view: View) -> dict[RunKey, pd.DataFrame]:
    """Bounces of the main α, the law's own left out."""
    return {run: table for run, table in view.bounces.items() if not run.is_law}


def bounces_figure(view: View) -> Figure:
    """Heights over the number of the bounce, and the same over the law's."""
    figure = new_figure(11.2, 4.6)
    left, right = figure.subplots(1, 2)
    longest = max(view.bounces.values(), key=len)["height_law_m"].to_numpy(dtype=float)
    heights = np.concatenate([[float(view.study["train_height"])], longest])  # the drop itself as number 0
    numbers = np.arange(len(heights))
    left.plot(numbers, 1e3 * heights, color=LAW, linewidth=6, solid_capstyle="butt", zorder=1)
    right.axhline(1.0, color=LAW, linewidth=6, zorder=1)
    handles = law_handles(linear=False)
    for nth, (run, table) in enumerate(drawn_bounces(view).items()):
        style = view.plot_style(run).line(linewidth=1.4, markersize=max(4.5, 7.5 - nth))
        number = table["bounce"].to_numpy(dtype=float)
        height = table["height_m"].to_numpy(dtype=float)
        left.plot([0, *number], [1e3 * heights[0], *(1e3 * height)], zorder=3, **style)
        right.plot(number, height / table["height_law_m"].to_numpy(dtype=float), zorder=3, **style)
        handles.append(Line2D([], [], label=f"{run.title} ({run.step})", **style))
    _height_axis(left)
    right.set_ylabel("height over the law's")
    right.set_ylim(bottom=0)
    for axes in (left, right):
        axes.set_xlabel("bounce")
        axes.set_xlim(-0.3, numbers[-1] + 0.3)
        axes.xaxis.set_major_locator(MaxNLocator(11, integer=True))
    legend_below(figure, handles)
    return figure


def _height_axis(axes: Axes) -> None:
    """Log: a body that loses the same share each time goes down a straight line."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    ticks = [m * 10.0**k for k in range(-6, 6) for m in (1, 2, 5) if low <= m * 10.0**k <= high]
    set_ticks(axes.yaxis, ticks if len(ticks) < 10 else ticks[::3])
    axes.set_ylabel("height after the bounce, mm")
