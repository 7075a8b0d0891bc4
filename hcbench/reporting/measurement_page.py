"""One page on one measurement: self-contained HTML that works offline and prints."""

import math

import numpy as np
from matplotlib.figure import Figure

from hcbench.measuring.measurement import Measurement
from hcbench.measuring.text import motion_notes, setting_text
from hcbench.reporting.explorer import explorer_script
from hcbench.reporting.measurement_explorer import explorer_of
from hcbench.reporting.page import Drawing, draw, render
from hcbench.reporting.plot_style import (
    INK,
    LAW,
    LIMIT,
    MEASURED,
    draw_band,
    draw_loop,
    new_figure,
    speed_axis,
)


def measurement_page(measurement: Measurement) -> str:
    """The page as HTML text."""
    asked = measurement.facts.asked or (math.nan,) * len(measurement.curve)
    explored = explorer_of(measurement)
    return render(
        "measurement.html",
        script=explorer_script() if explored else None,
        explorer=explored,
        measurement=measurement,
        summary=summary(measurement),
        notes=(*measurement.facts.notes, *motion_notes(measurement)),
        curve=draw(Drawing("curve", lambda: curve_figure(measurement))),
        loops=draw(Drawing("loops", (lambda: _loops_figure(measurement)) if measurement.loops else None)),
        points=list(zip(measurement.curve, asked, strict=True)),
        settings={name: setting_text(value) for name, value in measurement.facts.settings.items()},
    )


def summary(measurement: Measurement) -> str:
    """The result in a sentence."""
    points = [p for p in measurement.curve if not math.isnan(p.restitution)]
    if not points:
        return "No impact of it could be measured."
    low, high = min(p.lowest for p in points), max(p.highest for p in points)
    band = f"{points[0].speed_in:.3g} ... {points[-1].speed_in:.3g} m/s"
    text = f"Restitution between {low:.3f} and {high:.3f} at impact speeds of {band}"
    if measurement.spread > 0:
        text += f". It varies by up to {measurement.spread:.2g} with where in a time step the contact starts"
    return text + (". The contact adds energy in some impacts." if measurement.energy_gained else ".")


def curve_figure(measurement: Measurement) -> Figure:
    """e over approach speed, its phases as a band, and what was asked and wanted."""
    points = [p for p in measurement.curve if not math.isnan(p.restitution)]
    speeds, e, low, high = (
        np.array([getattr(p, name) for p in points], dtype=float)
        for name in ("speed_in", "restitution", "lowest", "highest")
    )
    figure = new_figure(6.4, 3.6)
    axes = figure.subplots()
    if measurement.facts.asked:
        asked = dict(zip(measurement.request.speeds, measurement.facts.asked, strict=True))
        values = [asked[p.speed] for p in points]
        axes.plot(speeds, values, color=LAW, linewidth=4.0, label="what the model asks for")
    if measurement.wanted is not None:
        wanted = measurement.wanted.at(speeds)
        axes.plot(speeds, wanted, color=LIMIT, linestyle=(0, (4, 2)), label="target")
    draw_band(axes, speeds, low, high, MEASURED.colour)
    axes.plot(speeds, e, label="measured", **MEASURED.line())
    axes.set_ylabel("restitution e", color=INK)
    axes.set_ylim(0.0, max(1.05, 1.05 * high.max(initial=0.0)))
    speed_axis(axes, inches=False)
    axes.legend(loc="best")
    return figure


def _loops_figure(measurement: Measurement) -> Figure:
    """Force over penetration, one loop a speed."""
    fastest = max(impact.speed_in for impact in measurement.loops)
    figure = new_figure(6.4, 3.6)
    axes = figure.subplots()
    for impact in measurement.loops:
        assert impact.loop is not None
        line = {"alpha": 0.25 + 0.75 * impact.speed_in / fastest, "label": f"{impact.speed_in:.3g} m/s"}
        draw_loop(axes, impact.loop.penetration * 1e6, impact.loop.force, color=MEASURED.colour, **line)
    axes.set_xlabel("penetration, µm")
    axes.set_ylabel("force, N")
    axes.legend(loc="best", title="impact speed")
    return figure
