"""What each setting does where the body slides: e of the normal direction, and friction, over the slip."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hcbench.report.plot_style import COLOURS, LAW, LIMIT, legend_below, new_figure
from hcbench.report.view import RunKey, View

_SPEEDS = 6  # that a figure shows, at most, of each setting
_TOP = 1.2  # of e: from here on the axis is stretched, as nothing may bounce that high
_MARKERS = "osD^vP"


def oblique_runs(view: View) -> list[RunKey]:
    """Runs with something to show: some launch for the main α slid."""
    return [run for run in view.runs if (view.oblique(run)["slip_in_m_per_s"].abs() > 0).any()]


def oblique_figure(view: View, runs: Sequence[RunKey]) -> Figure:
    """A row a setting. On the left e over the slip of the contact point, the law's e of each speed as a pale
    line; on the right the impulse of friction over the normal one, Coulomb's law as a pale line.
    """
    figure = new_figure(9.6, 0.9 + 2.5 * len(runs))
    speeds = _shown_speeds(pd.concat([view.oblique(run) for run in runs]))
    for (left, right), run in zip(figure.subplots(len(runs), 2, squeeze=False), runs, strict=True):
        rows = view.oblique(run)
        for i, speed in enumerate(speeds):
            one = rows[rows["speed_m_per_s"] == speed].sort_values("slip_in_m_per_s", key=abs)
            points = {"color": COLOURS[i], "marker": _MARKERS[i], "linestyle": "", "zorder": 3 + i}
            slip = one["slip_in_m_per_s"].abs()
            for axes, seen, law in (
                (left, "restitution", "restitution_law"),
                (right, "impulse_ratio", "impulse_ratio_coulomb"),
            ):
                axes.plot(slip, one[law], color=LAW, linewidth=4, solid_capstyle="butt", zorder=1)
                axes.plot(slip, one[seen], markersize=4.5, markerfacecolor="none", **points)
        _finish(left, right, rows, f"{run.title}, step {run.step}")
    points = [
        Line2D([], [], color=COLOURS[i], marker=_MARKERS[i], markerfacecolor="none", linestyle="", label=text)
        for i, text in enumerate(f"{speed:.3g} m/s along the normal" for speed in speeds)
    ]
    law_line = Line2D([], [], color=LAW, linewidth=4, label="eq. (16), and Coulomb's law")
    legend_below(figure, [*points, law_line])
    return figure


def _shown_speeds(rows: pd.DataFrame) -> list[float]:
    """Launch speeds along the normal, m/s: all, or as many evenly among them."""
    speeds = np.sort(rows["speed_m_per_s"].astype(float).unique())
    return speeds[np.unique(np.linspace(0, len(speeds) - 1, _SPEEDS).round().astype(int))].tolist()


def _finish(left: Axes, right: Axes, rows: pd.DataFrame, title: str) -> None:
    highest = float(rows["restitution"].max())
    if highest > _TOP:
        left.set_yscale("symlog", linthresh=_TOP, linscale=2.0)
        left.axhline(1.0, color=LIMIT, linewidth=1.0, linestyle=(0, (4, 2)))
        left.annotate(f"up to {highest:.2g}", (1.0, 1.0), (-4, -4), "axes fraction", "offset points",
                      ha="right", va="top", fontsize=8.5, color=LIMIT)  # fmt: skip
        ticks = [0.0, 0.25, 0.5, 0.75, 1.0, *(t for t in (2.0, 5.0, 10.0, 20.0, 50.0) if t < 1.2 * highest)]
        left.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
        left.minorticks_off()
        left.set_ylim(0.0, 1.25 * highest)
    else:
        left.set_ylim(0.0, 1.08)
    left.set_title(title, loc="left")
    left.set_ylabel("restitution e, normal")
    right.set_ylabel("friction / normal impulse")
    for axes in (left, right):
        axes.set_xlabel("slip of the contact point, m/s")
