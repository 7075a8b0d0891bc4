"""The figures of the page: errors by setting with the floors, and e of each impact over speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hcbench.reality.evidence import good, speeds_and_e
from hcbench.reality.impacts import ImpactRead
from hcbench.reality.study import NO_ENGINE, SettingScore
from hcbench.reporting.plot_style import (
    BLUE,
    GREEN,
    GREY,
    LIMIT,
    ORANGE,
    SLATE,
    draw_band,
    log_axis,
    new_figure,
    speed_axis,
)
from hcbench.reporting.wording import engine_title
from hcbench.sim.toss import NOTHING

_BINS = 6


def name_of(score: SettingScore) -> str:
    """A setting as figures and tables call it."""
    words = score.setting
    if score.engine != NO_ENGINE:
        words = f"{engine_title(score.engine)}, {score.setting}"
    if score.cone:
        words += f", {score.cone} cone"
    return words


def errors(scores: Sequence[SettingScore], unit: str) -> Figure:
    """Errors of settings, a row each, the best one on top, with their 95 % intervals; floors are
    vertical lines.

    scores: of one data set, with one setting or floor at least; up to two floors are drawn.
    unit: of the errors.
    """
    settings = []
    floors = []
    for score in scores:
        if score.engine == NO_ENGINE:
            floors.append(score)
        else:
            settings.append(score)
    settings.sort(key=lambda score: score.error, reverse=True)
    figure = new_figure(8.2, 0.9 + 0.3 * len(settings))
    axes = figure.add_subplot()
    for row, score in enumerate(settings):
        colour = BLUE
        if score.setting == NOTHING:
            colour = LIMIT
        axes.plot([score.error_low, score.error_high], [row, row], color=colour, linewidth=2.0)
        axes.plot(score.error, row, "o", color=colour, markersize=5)
    for floor, (colour, dashes) in zip(floors, ((GREEN, "--"), (SLATE, ":")), strict=False):
        axes.axvline(floor.error, color=colour, linestyle=dashes, label=floor.setting)
    axes.set_yticks(range(len(settings)), [name_of(score) for score in settings])
    log_axis(axes, "x")
    all_errors = [score.error for score in scores]
    ticks, labels = _ticks(min(all_errors), max(all_errors))
    axes.set_xticks(ticks, labels)
    axes.set_xlabel(f"error, {unit} (log scale)")
    if floors:
        axes.legend(loc="upper right")
    return figure


def _ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """Round numbers (1, 2 and 5 times a power of ten) of a log axis from low to high, and their
    labels.
    """
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    values = []
    for power in powers:
        for digit in (1, 2, 5):
            value = float(digit * power)
            if 0.8 * low <= value <= 1.3 * high:
                values.append(value)
    return values, [f"{value:g}" for value in values]


def impacts(read: Sequence[ImpactRead], twins: Mapping[str, Sequence[ImpactRead]]) -> Figure:
    """e of each impact over its speed, m/s, with its standard uncertainty.

    read: measured ones, of which the good ones are drawn; at least one is good.
    twins: impacts read from simulated motions, by the name of their law; up to two are drawn. The
    band is the middle half of their e in each of _BINS classes of speed.
    """
    figure = new_figure(8.2, 4.4)
    axes = figure.add_subplot()
    speed, e = speeds_and_e(read)
    # Classes with as many measured impacts each.
    edges = np.quantile(speed, np.linspace(0.0, 1.0, _BINS + 1))
    for (law, of_twin), colour in zip(twins.items(), (GREEN, ORANGE), strict=False):
        twin_speed, twin_e = speeds_and_e(of_twin)
        middle = []
        quartiles = []
        for low, high in pairwise(edges):
            inside = twin_e[(twin_speed >= low) & (twin_speed <= high)]
            # Fewer have no quartiles.
            if len(inside) > 2:
                middle.append(0.5 * (high + low))
                quartiles.append(
                    [np.quantile(inside, 0.25), np.median(inside), np.quantile(inside, 0.75)]
                )
        lower, median, upper = np.array(quartiles).reshape(-1, 3).T
        draw_band(axes, np.array(middle), lower, upper, colour)
        axes.plot(middle, median, color=colour, label=f"synthetic, {law}")
    uncertainty = [each.u_e for each in good(read)]
    style: dict[str, Any] = {"fmt": ".", "color": BLUE, "ecolor": GREY, "elinewidth": 0.8}
    axes.errorbar(speed, e, uncertainty, label="measured", **style)
    speed_axis(axes, inches=False)
    axes.set_ylabel("e of an impact")
    axes.set_ylim(0.0, 0.6)
    axes.legend(loc="upper right")
    return figure
