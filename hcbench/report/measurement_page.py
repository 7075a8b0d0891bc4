"""One page on one measurement: self-contained HTML that works offline and prints."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hcbench._text import number, sanitized, without_empty
from hcbench.measure.text import setting_text
from hcbench.report.page import Drawing, draw, render
from hcbench.report.plot_style import INK, LAW, LIMIT, MEASURED, draw_band, draw_loop, new_figure, speed_axis

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hcbench.measure.measurement import Measurement

_HEADER = (
    "launched m/s", "at touch m/s", "e", "spread", "asked", "wanted", "steps in contact", "failed",
)  # fmt: skip


def measurement_page(found: Measurement) -> str:
    """The page as HTML text."""
    facts = found.facts
    header, rows = without_empty(_HEADER, _rows(found), "failed")
    return render(
        "measurement.html",
        model=sanitized(facts.model),
        pair=[sanitized(name) for name in facts.pair],
        summary=_summary(found),
        curve=draw(Drawing("curve", lambda: _curve_figure(found))),
        loops=draw(Drawing("loops", (lambda: _loops_figure(found)) if found.loops else None)),
        header=header,
        rows=rows,
        failures=[
            f"{i.status.value} at {i.launch.speed:.4g} m/s: {sanitized(i.reason)}" for i in found.failed[:5]
        ],
        causes=found.causes,
        remedy=found.remedy,
        facts=_facts(found),
        notes=[sanitized(note) for note in facts.notes],
        scores=_scores(found),
    )


def _curve_figure(found: Measurement) -> Figure:
    """e over approach speed, its phases as a band, and what was asked and wanted."""
    points = [p for p in found.curve if not math.isnan(p.restitution)]
    speeds, e, low, high = (
        np.array([getattr(p, name) for p in points], dtype=float)
        for name in ("speed_in", "restitution", "lowest", "highest")
    )
    figure = new_figure(6.4, 3.6)
    axes = figure.subplots()
    if found.facts.asked:
        asked = dict(zip(found.request.speeds, found.facts.asked, strict=True))
        values = [asked[p.speed] for p in points]
        axes.plot(speeds, values, color=LAW, linewidth=4.0, label="asked by the model")
    if found.wanted is not None:
        wanted = found.wanted.at(speeds)
        axes.plot(speeds, wanted, color=LIMIT, linestyle=(0, (4, 2)), label="wanted")
    draw_band(axes, speeds, low, high, MEASURED.colour)
    axes.plot(speeds, e, label="measured", **MEASURED.line())
    axes.set_ylabel("restitution e", color=INK)
    axes.set_ylim(0.0, max(1.05, 1.05 * high.max(initial=0.0)))
    speed_axis(axes, inches=False)
    axes.legend(loc="best")
    return figure


def _loops_figure(found: Measurement) -> Figure:
    """Force over penetration, one loop a speed."""
    impacts = found.loops
    fastest = max(impact.speed_in for impact in impacts)
    figure = new_figure(6.4, 3.6)
    axes = figure.subplots()
    for impact in impacts:
        assert impact.loop is not None
        line = {"alpha": 0.25 + 0.75 * impact.speed_in / fastest, "label": f"{impact.speed_in:.3g} m/s"}
        draw_loop(axes, impact.loop.penetration * 1e6, impact.loop.force, color=MEASURED.colour, **line)
    axes.set_xlabel("penetration, µm")
    axes.set_ylabel("force, N")
    axes.legend(loc="best", title="impact speed")
    return figure


def _summary(found: Measurement) -> str:
    known = [p for p in found.curve if not math.isnan(p.restitution)]
    if not known:
        return "No impact of it could be measured."
    low, high = min(p.lowest for p in known), max(p.highest for p in known)
    band = f"{known[0].speed_in:.3g} ... {known[-1].speed_in:.3g} m/s"
    words = f"Restitution between {low:.3f} and {high:.3f} at impact speeds of {band}"
    if found.spread > 0:
        words += f", up to {found.spread:.2g} apart by where in a time step the touch falls"
    return words + ("." if not found.energy_gained else ". Energy is gained in some impacts.")


def _rows(found: Measurement) -> list[tuple[str, ...]]:
    asked = found.facts.asked or (math.nan,) * len(found.curve)
    rows: list[tuple[str, ...]] = []
    for p, a in zip(found.curve, asked, strict=True):
        known = found.wanted is not None and not math.isnan(p.speed_in)
        wanted = float(found.wanted.at(p.speed_in)) if found.wanted and known else math.nan
        rows.append(
            (
                f"{p.speed:.4g}",
                number(p.speed_in, ".4g"),
                number(p.restitution),
                number(p.highest - p.lowest, ".1e"),
                number(a),
                number(wanted),
                str(p.samples),
                str(p.failed or ""),
            )
        )
    return rows


def _facts(found: Measurement) -> list[tuple[str, str]]:
    facts = found.facts
    return [
        ("engine", f"{facts.engine} {facts.version}"),
        ("what moves", sanitized(facts.moved)),
        ("time step", f"{facts.timestep:.6g} s"),
        ("gravity", f"{' '.join(f'{g:.4g}' for g in facts.gravity)} m/s²"),
        ("effective mass", f"{found.effective_mass:.4g} kg"),
        ("asks for", sanitized(facts.asked_words)),
        *((name, sanitized(setting_text(value))) for name, value in facts.settings.items()),
    ]


def _scores(found: Measurement) -> list[tuple[str, str]]:
    score, law = found.score, found.law
    if score is None or law is None:
        return []
    rows = [
        ("α fitted", f"{score.alpha_fit:.4g} s/m, rms of e {score.alpha_fit_rms:.2g}"),
        (f"largest error against α = {law.alpha:.4g} s/m", f"{score.max_error_law:.4g}"),
        ("the same against 1 - α v", f"{score.max_error_linear:.4g}"),
        ("the best constant e would err", f"{score.constant_error_law:.4g}"),
        ("energy lost goes as v to the power", number(score.energy_exponent, ".3g")),
    ]
    if score.loops:
        rows += [
            ("loop: force, rms over the largest", f"{score.loop_rms:.3g}"),
            ("loop: area over the law's", number(score.area_ratio, ".3g")),
            ("loop: largest force over the law's", f"{score.force_ratio:.3g}"),
            ("loop: duration over the law's", f"{score.duration_ratio:.3g}"),
            ("loop: first force over the largest", f"{score.touch_force:.3g}"),
            ("loop: share of the impulse that pulls", f"{score.tension_share:.3g}"),
        ]
    return rows
