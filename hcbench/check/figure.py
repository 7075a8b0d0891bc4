"""Curves of checks and measurements, drawn: e over approach speed, and the error beneath."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hcbench._text import sanitized
from hcbench.measure.text import kept_loops
from hcbench.report.style import INK, LAW, drawing, new_figure, png_bytes, speed_axis, svg_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hcbench.check.model import Outcome, Report
    from hcbench.measure.measurement import Measurement

_MEASURED = "#0072B2"
_LIMIT = "#D55E00"


def report_png(report: Report) -> bytes:
    """The error curves of all checks, one panel each, as PNG."""
    outcomes = [o for o in report.outcomes if o.rows]
    with drawing():
        figure = new_figure(6.4, max(1, len(outcomes)) * 2.6)
        if not outcomes:
            axes = figure.subplots()
            axes.set_axis_off()
            axes.text(0.5, 0.5, "nothing was measured", ha="center", va="center")
        for axes, outcome in zip(_column(figure, len(outcomes)), outcomes, strict=True):
            _error_panel(axes, outcome)
        return png_bytes(figure)


def _column(figure: Figure, count: int) -> list[Axes]:
    return list(figure.subplots(count, 1, squeeze=False)[:, 0]) if count else []


def _error_panel(axes: Axes, outcome: Outcome) -> None:
    rows = [r for r in outcome.rows if not math.isnan(r.error)]
    axes.axhline(0.0, color=LAW, linewidth=2.0)
    for sign in (-1, 1):
        axes.axhline(sign * outcome.max_error, color=_LIMIT, linestyle=(0, (4, 2)), linewidth=1.0)
    axes.plot([r.speed_in for r in rows], [r.error for r in rows], "o-", color=_MEASURED)
    axes.set_title(f"{sanitized(outcome.name)}: {outcome.verdict.value}", loc="left")
    axes.set_ylabel("e - wanted")
    speed_axis(axes, inches=False)


def curve_svg(found: Measurement) -> bytes:
    """e over approach speed of one measurement, its phases as a band, and what was asked and wanted."""
    points = [p for p in found.curve if not math.isnan(p.restitution)]
    speeds = [p.speed_in for p in points]
    with drawing():
        figure = new_figure(6.4, 3.6)
        axes = figure.subplots()
        if found.facts.asked:
            asked = dict(zip(found.request.speeds, found.facts.asked, strict=True))
            values = [asked[p.speed] for p in points]
            axes.plot(speeds, values, color=LAW, linewidth=4.0, label="asked by the model")
        if found.wanted is not None:
            axes.plot(
                speeds,
                found.wanted.at(np.array(speeds)),
                color=_LIMIT,
                linestyle=(0, (4, 2)),
                label="wanted",
            )
        low, high = [p.lowest for p in points], [p.highest for p in points]
        axes.fill_between(speeds, low, high, color=_MEASURED, alpha=0.2, linewidth=0)
        axes.plot(speeds, [p.restitution for p in points], "o-", color=_MEASURED, label="measured")
        axes.set_ylabel("restitution e", color=INK)
        axes.set_ylim(0.0, max(1.05, *(1.05 * h for h in high)) if high else 1.05)
        speed_axis(axes, inches=False)
        axes.legend(loc="best")
        return svg_bytes(figure)


def loops_svg(found: Measurement) -> bytes | None:
    """Force over penetration, one loop a speed; None where no contact took steps enough to show one."""
    loops = [(impact, impact.loop) for impact in kept_loops(found)]
    if not loops:
        return None
    fastest = max(impact.speed_in for impact, _ in loops)
    with drawing():
        figure = new_figure(6.4, 3.6)
        axes = figure.subplots()
        for impact, loop in loops:
            assert loop is not None
            shade = 0.25 + 0.75 * impact.speed_in / fastest
            label = f"{impact.speed_in:.3g} m/s"
            axes.plot(loop.penetration * 1e6, loop.force, color=_MEASURED, alpha=shade, label=label)
        axes.set_xlabel("penetration, µm")
        axes.set_ylabel("force, N")
        axes.legend(loc="best", title="impact speed")
        return svg_bytes(figure)
