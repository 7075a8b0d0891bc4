"""One page on how robots land: self-contained HTML with the force of the floor over time."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from hcbench.measuring.landing import by_drop, headline, labels
from hcbench.reporting.page import Drawing, draw, render
from hcbench.reporting.plot_style import COLOURS, DASHES, new_figure
from hcbench.sim.landing import Landings

_PANEL = 3.4, 2.4  # inches


def landing_page(robots: Sequence[Landings]) -> str:
    """The page as HTML text. robots: dropped in the same way."""
    names = labels(robots)
    return render(
        "landing.html",
        title=" and ".join(names),
        headlines=[line for landings in robots for line in headline(landings)],
        several=len(robots) > 1,
        drops=list(by_drop(robots, names)),
        forces=draw(Drawing("forces", lambda: force_figure(robots))),
    )


def force_figure(robots: Sequence[Landings]) -> Figure:
    """Force of the floor over weight, over time: a column a robot, a row a tilt, a line a height."""
    tilts = list(dict.fromkeys(drop.tilt for drop in robots[0].drops))
    width = max(6.4, _PANEL[0] * len(robots))
    figure = new_figure(width, 0.9 + _PANEL[1] * len(tilts))
    grid = figure.subplots(len(tilts), len(robots), squeeze=False, sharex=True, sharey=True)
    for row, tilt in zip(grid, tilts, strict=True):
        for axes, landings, name in zip(row, robots, labels(robots), strict=True):
            drops = [drop for drop in landings.drops if drop.tilt == tilt]
            for i, drop in enumerate(drops):
                style = {"color": COLOURS[i % len(COLOURS)], "linestyle": DASHES[i % len(DASHES)]}
                axes.plot(
                    1e3 * drop.time, drop.force / drop.weight, label=f"{100 * drop.height:.3g} cm", **style
                )
            words = [name] * (len(robots) > 1) + [f"tilt {np.degrees(tilt):.3g}°"] * (len(tilts) > 1)
            axes.set_title(", ".join(words), fontsize=9)
    for axes in grid[:, 0]:
        axes.set_ylabel("force / weight")
    for axes in grid[-1]:
        axes.set_xlabel("time from touch, ms")
    grid[0, -1].legend(loc="best", title="drop")
    return figure
