"""One page on one fit: self-contained HTML that works offline and prints."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.candidates import LAWS
from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.notebook import draw_curve
from hcbench.fitting.text import headline, next_lines, odds_text, with_uncertainty
from hcbench.reporting.page import Drawing, draw, render
from hcbench.reporting.plot_style import COLOURS, INK, LIMIT, MEASURED, SLATE, new_figure, speed_axis

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hcbench.fitting.result import FitResult

_WINDOW = 8e-4  # s about each pick
_MOST_SAMPLES = 4000  # of the waveform drawn


def fit_page(result: FitResult, engine: str) -> str:
    """The page as HTML text. engine: for the line to type next."""
    alpha = result.budget.parameter == "alpha"
    return render(
        "fit.html",
        result=result,
        facts=headline(result),
        curve=draw(Drawing("curve", lambda: _curve_figure(result))),
        residuals=draw(Drawing("residuals", lambda: _residual_figure(result))),
        sounds=[
            draw(Drawing(f"sound-{i}", lambda s=s: _sound_figure(s)))  # type: ignore[misc]
            for i, s in enumerate(result.sets)
            if isinstance(s, TouchTimes) and s.recording is not None
        ],
        laws=[
            (fit.law.name, LAWS[fit.law.name].formula, f"{fit.log_evidence:.2f}", odds_text(odds))
            for fit, odds in zip(result.fits, result.odds, strict=True)
        ],
        budget=[(row.source, row.kind, f"{row.share:.2g}") for row in result.budget.rows],
        parameter="α, s/m" if alpha else result.budget.parameter,
        next_lines=next_lines(result, engine),
        title=f"α = {with_uncertainty(result.alpha.value, result.alpha.uncertainty)} s/m"
        if result.alpha is not None and result.law is not None
        else f"law: {result.law or 'cannot tell'}",
    )


def _curve_figure(result: FitResult) -> Figure:
    """e over impact speed: the data as one reads them off, the law with its 95 % band."""
    figure = new_figure(6.4, 3.6)
    axes = figure.subplots()
    draw_curve(axes, result, LIMIT, COLOURS)
    axes.yaxis.label.set_color(INK)
    speed_axis(axes, inches=False)
    return figure


def _residual_figure(result: FitResult) -> Figure:
    """The change of each e that the data make likeliest, and what is left of measuring, over their noise."""
    figure = new_figure(6.4, 3.4)
    upper, lower = figure.subplots(2, 1)
    fit = result.best
    for i, (s, latent, model, off_law, noise) in enumerate(
        zip(result.sets, fit.latent, fit.models, fit.measured_off(), fit.noise, strict=True)
    ):
        style = {"linestyle": "none", "marker": "o", "color": COLOURS[i % len(COLOURS)], "markersize": 3.5}
        left = off_law / (noise * model.shape)
        off = latent if s.needs_gravity else model.residual  # single impacts are their own readings
        upper.plot(100.0 * off, label=s.name, **style)
        lower.plot(np.clip(left, -10, 10), **style)
    for axes, scale, label in ((upper, 100.0 * fit.scatter, "e off, %"), (lower, 1.0, "measured off, σ")):
        axes.axhline(0.0, color=SLATE, linewidth=0.8)
        axes.axhspan(-2.0 * scale, 2.0 * scale, color=MEASURED.colour, alpha=0.1, linewidth=0)
        axes.set_ylabel(label)
    upper.set_xlabel("impact")
    lower.set_xlabel("reading")
    return figure


def _sound_figure(s: TouchTimes) -> Figure:
    """The waveform with the touches found, and the first of them from near."""
    assert s.recording is not None
    sound, rate, begin = s.recording.sound, s.recording.rate, s.recording.begin
    figure = new_figure(6.4, 4.2)
    grid = figure.add_gridspec(2, 4)
    whole = figure.add_subplot(grid[0, :])
    part = -(-len(sound) // _MOST_SAMPLES)
    blocks = np.pad(sound, (0, -len(sound) % part)).reshape(-1, part)
    t = s.recording.begin + np.arange(len(blocks)) * part / rate
    whole.fill_between(t, blocks.min(axis=1), blocks.max(axis=1), color=SLATE, linewidth=0.3)
    for time in s.times:
        whole.axvline(time, color=LIMIT, linewidth=0.7)
    whole.set_xlabel("time, s")
    numbers = range(len(s.times)) if s.numbers is None else s.numbers
    for i, (number, time) in enumerate(list(zip(numbers, s.times, strict=True))[:4]):
        axes = figure.add_subplot(grid[1, i])
        first, last = (
            max(0, round((time - begin - _WINDOW) * rate)),
            round((time - begin + 2 * _WINDOW) * rate),
        )
        axes.plot(
            (begin + np.arange(first, min(last, len(sound))) / rate - time) * 1e3,
            sound[first:last],
            color=SLATE,
        )
        axes.axvline(0.0, color=LIMIT, linewidth=0.9)
        axes.set_title(f"touch {number + 1}", loc="left")
        axes.set_xlabel("ms")
        axes.set_yticklabels([])
    return figure
