"""What each setting does where the body slides: e of the normal direction, and friction, over the slip."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hcbench.reporting.plot_style import COLOURS, LAW, LIMIT, legend_below, new_figure, set_ticks
from hcbench.reporting.view import RunKey, View

_SPEEDS = 6  # that a figure shows, at most, of each setting
_TOP = 1.2  # of e: where some bounce higher, the axis is logarithmic from here on
_MARKERS = "osD^vP"


def oblique_rows(view: View) -> dict[RunKey, pd.DataFrame]:
    """Impacts for the main α of runs with friction in which some body slid; none without oblique launches.

    slip_deg is added: the angle from the normal at which the contact point arrives.
    """
    impacts = view.results.impacts
    if "angle_rad" not in impacts:
        return {}
    main = np.isclose(impacts["alpha_s_per_m"].astype(float), view.main_alpha, rtol=1e-9)
    shown = impacts[main & (impacts["friction"] > 0)].copy()
    slope = shown["slip_in_m_per_s"].abs() / shown["speed_in_m_per_s"]
    shown["slip_deg"] = np.degrees(np.arctan(slope.astype(float)))
    groups = shown.groupby(["scene", "engine", "setting", "timestep_s"], sort=False)
    rows = {view.run_of(table.iloc[0].to_dict()): table for _, table in groups}
    return {run: table for run, table in rows.items() if (table["slip_deg"] > 0).any()}


def oblique_figure(rows: Mapping[RunKey, pd.DataFrame]) -> Figure:
    """A row a setting, of `oblique_rows`. On the left e over the angle of the slip, the law's e at each speed
    as a pale line; on the right the impulse of friction over the normal one, Coulomb's law as a pale line.
    """
    figure = new_figure(9.6, 0.9 + 2.4 * len(rows))
    speeds = _shown_speeds(pd.concat(rows.values()))
    panels = figure.subplots(len(rows), 2, squeeze=False, sharex=True)
    for (left, right), (run, table) in zip(panels, rows.items(), strict=True):
        for i, speed in enumerate(speeds):
            one = table[table["speed_m_per_s"] == speed]
            points: dict[str, Any] = {"color": COLOURS[i], "marker": _MARKERS[i], "zorder": 3 + i}
            for axes, seen, law in (
                (left, "restitution", "restitution_law"),
                (right, "impulse_ratio", "impulse_ratio_coulomb"),
            ):
                line = one.groupby("angle_rad")[["slip_deg", law]].mean().sort_values("slip_deg")
                axes.plot(line["slip_deg"], line[law], color=LAW, linewidth=4, solid_capstyle="butt")
                axes.plot(
                    one["slip_deg"], one[seen], markersize=4.5, markerfacecolor="none", linestyle="", **points
                )
        _finish(left, right, table, run)
    for axes in panels[-1]:
        axes.set_xlabel("angle of the slip, atan(slip / normal speed), degrees")
        set_ticks(axes.xaxis, range(0, 91, 15))
    handles = [
        Line2D([], [], color=COLOURS[i], marker=_MARKERS[i], markerfacecolor="none", linestyle="", label=text)
        for i, text in enumerate(f"{speed:.3g} m/s along the normal" for speed in speeds)
    ]
    law_line = Line2D([], [], color=LAW, linewidth=4, label="the law, and Coulomb's law")
    legend_below(figure, [*handles, law_line])
    return figure


def _shown_speeds(rows: pd.DataFrame) -> list[float]:
    """Launch speeds along the normal, m/s: all, or as many evenly among them."""
    speeds = np.sort(rows["speed_m_per_s"].astype(float).unique())
    shown = np.unique(np.linspace(0, len(speeds) - 1, _SPEEDS).round().astype(int))
    return [float(speed) for speed in speeds[shown]]


def _finish(left: Axes, right: Axes, rows: pd.DataFrame, run: RunKey) -> None:
    highest, title = float(rows["restitution"].max()), f"{run.title}, step {run.step}"
    if highest > _TOP:
        left.set_yscale("symlog", linthresh=_TOP, linscale=2.0)
        left.axhline(1.0, color=LIMIT, linewidth=1.0, linestyle=(0, (4, 2)))
        set_ticks(left.yaxis, [0.0, 0.25, 0.5, 0.75, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0])
        left.set_ylim(0.0, 1.25 * highest)
        title += f": e up to {highest:.2g}"
    else:
        left.set_ylim(0.0, 1.08)
    left.set_title(title, loc="left")
    left.set_ylabel("restitution e, normal")
    right.set_ylabel("friction / normal impulse")
