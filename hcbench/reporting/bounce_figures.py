"""Successive bounces: how high a dropped ball rises again and again, beside the law's heights."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from hcbench.reporting import wording
from hcbench.reporting.plot_style import LAW, legend_below, new_figure, set_ticks
from hcbench.reporting.restitution_figures import law_handles

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hcbench.reporting.view import RunKey, View

_LOWEST, _TOP = 1e-2, 2.0  # mm, and times the law's height: what goes lower or higher leaves the frame


def drawn_bounces(view: View) -> dict[RunKey, pd.DataFrame]:
    """Bounces of the main α, the law's own left out."""
    return {run: table for run, table in view.bounces.items() if not run.is_law}


def bounces_figure(view: View) -> Figure:
    """Heights over the number of the bounce, and the same over the law's; a column a step."""
    drawn = drawn_bounces(view)
    steps = sorted({run.timestep for run in drawn})
    figure = new_figure(11.2, 4.6 if len(steps) == 1 else 6.6)
    grid = figure.subplots(2, len(steps), sharex=True, sharey="row", squeeze=False)
    if len(steps) == 1:
        figure.clear()
        grid = figure.subplots(1, 2).reshape(2, 1)
    longest = max(view.bounces.values(), key=len)["height_law_m"].to_numpy(dtype=float)
    heights = np.concatenate([[float(view.study["train_height"])], longest])  # the drop itself as number 0
    handles = {line.get_label(): line for line in law_handles(linear=False)}
    for (upper, lower), step in zip(grid.T, steps, strict=True):
        upper.plot(range(len(heights)), 1e3 * heights, color=LAW, linewidth=6, zorder=1)
        lower.axhline(1.0, color=LAW, linewidth=6, zorder=1)
        upper.set_title(f"step {wording.time(step)}")
        for nth, (run, table) in enumerate(item for item in drawn.items() if item[0].timestep == step):
            style = view.plot_style(run).line(linewidth=1.4, markersize=max(4.5, 7.5 - nth))
            number = table["bounce"].to_numpy(dtype=float)
            height = table["height_m"].to_numpy(dtype=float)
            upper.plot([0, *number], [1e3 * heights[0], *(1e3 * height)], zorder=3, **style)
            lower.plot(number, height / table["height_law_m"].to_numpy(dtype=float), zorder=3, **style)
            handles[run.title] = Line2D([], [], label=run.title, **style)
        for axes in (upper, lower):
            axes.set_xlim(-0.3, len(heights) - 0.7)
            axes.xaxis.set_major_locator(MaxNLocator(11, integer=True))
        lower.set_xlabel("bounce")
    _height_axis(grid[0, 0])
    grid[1, 0].set_ylabel("height over the law's")
    grid[1, 0].set_ylim(0.0, min(_TOP, grid[1, 0].get_ylim()[1]))
    legend_below(figure, list(handles.values()))
    return figure


def _height_axis(axes: Axes) -> None:
    """Log: a body that loses the same share each time goes down a straight line."""
    axes.set_yscale("log")
    axes.set_ylim(bottom=max(_LOWEST, axes.get_ylim()[0]))
    low, high = axes.get_ylim()
    ticks = [m * 10.0**k for k in range(-6, 6) for m in (1, 2, 5) if low <= m * 10.0**k <= high]
    set_ticks(axes.yaxis, ticks if len(ticks) < 10 else ticks[::3])
    axes.set_ylabel("height after the bounce, mm")
