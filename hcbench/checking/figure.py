"""The error curves of checks as a PNG."""

import math

from matplotlib.axes import Axes

from hcbench.checking.outcome import Outcome, Report
from hcbench.reporting.page import png_bytes
from hcbench.reporting.plot_style import (
    LAW,
    LIMIT,
    MEASURED,
    figure_defaults,
    new_figure,
    speed_axis,
)
from hcbench.system.text import sanitized


def errors_png(report: Report) -> bytes:
    """A picture of the errors of e, measured less target, over approach speed, m/s: a panel a
    check; the bytes of a PNG.

    Checks without points are left out; without any, the picture says so.
    """
    outcomes = [outcome for outcome in report.outcomes if outcome.rows]
    with figure_defaults():
        figure = new_figure(6.4, max(1, len(outcomes)) * 2.6)
        if not outcomes:
            axes = figure.subplots()
            axes.set_axis_off()
            axes.text(0.5, 0.5, "nothing was measured", ha="center", va="center")
        for i, outcome in enumerate(outcomes, 1):
            _error_panel(figure.add_subplot(len(outcomes), 1, i), outcome)
        return png_bytes(figure)


def _error_panel(axes: Axes, outcome: Outcome) -> None:
    """Plot the error of e in the worst phase over approach speed, m/s, between its limits."""
    speeds = []
    errors = []
    for row in outcome.rows:
        if not math.isnan(row.worst_phase):
            speeds.append(row.speed_in)
            errors.append(row.worst_phase)
    axes.axhline(0.0, color=LAW, linewidth=2.0)
    for sign in (-1, 1):
        axes.axhline(sign * outcome.max_error, color=LIMIT, linestyle=(0, (4, 2)), linewidth=1.0)
    axes.plot(speeds, errors, **MEASURED.line())
    axes.set_title(f"{sanitized(outcome.name)}: {outcome.verdict.value}", loc="left")
    axes.set_ylabel("e - target, worst phase")
    speed_axis(axes, inches=False)
