"""One page on one fit: self-contained HTML that works offline and prints."""

from __future__ import annotations

import base64
import io
import math
import re
import shlex
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.io import wavfile

from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.result import headline, odds_text, trains_of, with_uncertainty
from hcbench.fitting.which_law import LAWS
from hcbench.reporting.notebook import draw_curve
from hcbench.reporting.page import Drawing, draw, render
from hcbench.reporting.plot_style import (
    COLOURS,
    INK,
    LIMIT,
    MEASURED,
    SLATE,
    new_figure,
    speed_axis,
)
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hcbench.fitting.recording import Recording
    from hcbench.fitting.replay import Replay
    from hcbench.fitting.result import FitResult
    from hcbench.terms.impact import Floats

# s before each pick of a touch that are drawn; twice as much after it.
_WINDOW = 8e-4
# s of sound before the first touch and after the last.
_BESIDE = 0.3
# Dots an inch of a picture.
_DOTS = 150
# Points of the drawn waveform, at most.
_MOST_SAMPLES = 4000


def fit_page(
    result: FitResult, next_lines: Sequence[str], typed: Sequence[str], scene: Replay | None = None
) -> str:
    """The page on one fit as HTML text.

    next_lines: commands that go on from here, to print.
    typed: the words after `hcbench` that led here.
    scene: touches of one that bounces as the recording did, to be drawn; None for none.
    """
    # Figures of the recordings, and what was heard in them, of those that are recordings.
    sounds = []
    heard = []
    for i, data in enumerate(result.sets):
        if not isinstance(data, TouchTimes):
            continue
        if data.recording is not None:
            sounds.append(draw(Drawing(f"sound-{i}", partial(_sound_figure, data))))
        if data.heard:
            heard.append(_heard(i, data, typed))
    laws = []
    for fit, odds in zip(result.fits, result.odds, strict=True):
        formula = LAWS[fit.law.name].formula
        laws.append((fit.law.name, formula, f"{fit.log_evidence:.2f}", odds_text(odds)))
    parameter = result.budget.parameter
    if parameter == "alpha":
        parameter = "α, s/m"
    elif parameter == "restitution":
        parameter = "e"
    return render(
        "fit.html",
        result=result,
        facts=headline(result),
        curve=draw(Drawing("curve", partial(_curve_figure, result))),
        residuals=draw(Drawing("residuals", partial(_residual_figure, result))),
        sounds=sounds,
        media=bool(heard),
        heard=heard,
        laws=laws,
        budget=[(row.source, row.kind, f"{row.share:.2g}") for row in result.budget.rows],
        parameter=parameter,
        next_lines=next_lines,
        scene=scene and draw(Drawing("scene", partial(_scene_figure, scene))),
        title=_title(result),
    )


def _title(result: FitResult) -> str:
    """α with its uncertainty; the law alone where there is no α or no one law."""
    if result.alpha is None or result.law is None:
        return f"law: {result.law or 'cannot tell'}"
    return f"α = {with_uncertainty(result.alpha.value, result.alpha.uncertainty)} s/m"


def _curve_figure(result: FitResult) -> Figure:
    """e over impact speed: the data as one reads them off, the law with its 95 % band."""
    figure = new_figure(6.4, 3.6)
    axes = figure.subplots()
    draw_curve(axes, result, LIMIT, COLOURS)
    axes.yaxis.label.set_color(INK)
    speed_axis(axes, inches=False)
    return figure


def curve_picture(result: FitResult, suffix: str) -> bytes:
    """e over impact speed with its 95 % band, as a file of this suffix: ".png" or ".svg".

    Raises UserError for another suffix.
    """
    # A file without the date or a version of its writer is the same on every day.
    metadata = {".png": {"Software": None}, ".svg": {"Date": None}}.get(suffix.lower())
    if metadata is None:
        raise UserError("--picture", f"the suffix {suffix!r}", ".png or .svg")
    content = io.BytesIO()
    figure = _curve_figure(result)
    figure.savefig(content, format=suffix.lower()[1:], dpi=_DOTS, metadata=metadata)
    return content.getvalue()


def _residual_figure(result: FitResult) -> Figure:
    """Two panels, a dot each. Upper: the likeliest difference of the e of each impact from the law,
    in per cent. Lower: the error that is left of each reading, over its standard deviation, cut off
    at ±10. On either, a band of two standard deviations.
    """
    figure = new_figure(6.4, 3.4)
    upper, lower = figure.subplots(2, 1)
    fit = result.best
    columns = zip(result.sets, fit.latent, fit.models, fit.measured_off(), fit.noise, strict=True)
    for i, (data, latent, model, off_law, noise) in enumerate(columns):
        style = {
            "linestyle": "none",
            "marker": "o",
            "color": COLOURS[i % len(COLOURS)],
            "markersize": 3.5,
        }
        # The reading's error that the fit leaves, over its standard deviation.
        left = off_law / (noise * model.shape)
        # The likeliest ln(e of the impact / e of the law). Where each reading is of one impact, it
        # cannot be told from the reading's error: that is drawn.
        off = latent if data.needs_gravity else model.residual
        upper.plot(_numbers(data.touches(), len(off)), 100.0 * off, label=data.name, **style)
        lower.plot(_numbers(data.rows(), len(left)), np.clip(left, -10, 10), **style)
    # Each panel with one standard deviation in its unit.
    for axes, scale, label in (
        (upper, 100.0 * fit.scatter, "error of e, %"),
        (lower, 1.0, "error, σ"),
    ):
        axes.axhline(0.0, color=SLATE, linewidth=0.8)
        axes.axhspan(-2.0 * scale, 2.0 * scale, color=MEASURED.colour, alpha=0.1, linewidth=0)
        axes.set_ylabel(label)
    for axes, label in ((upper, "impact"), (lower, "reading")):
        axes.set_xlabel(label)
        axes.xaxis.get_major_locator().set_params(integer=True)
    return figure


def _numbers(names: list[str], count: int) -> list[int]:
    """Numbers of impacts or readings, as messages name them ("touch 9"); from 1 on without names."""
    found = [re.match(r"\D*(\d+)", name) for name in names]
    if len(found) != count or not all(found):
        return list(range(1, count + 1))
    return [int(match[1]) for match in found if match]


def _scene_figure(scene: Replay) -> Figure:
    """The recorded touches over those of the scene, s, and how late each of the scene's is, ms."""
    figure = new_figure(6.4, 3.0)
    upper, lower = figure.subplots(2, 1, sharex=True)
    trains = ((scene.recorded, 1.0, SLATE, "recorded"), (scene.simulated, 0.0, LIMIT, "scene"))
    for touches, level, colour, label in trains:
        upper.vlines(touches, level, level + 0.9, color=colour, linewidth=1.2, label=label)
    upper.set_yticks([0.45, 1.45], ["scene", "recorded"])
    late = scene.simulated - scene.recorded[: len(scene.simulated)]
    lower.plot(scene.recorded[: len(late)], 1e3 * late, color=LIMIT, marker="o", markersize=3.0)
    lower.axhline(0.0, color=SLATE, linewidth=0.8)
    lower.set_ylabel("late, ms")
    lower.set_xlabel("time from the second touch, s")
    return figure


def _sound_figure(heard: TouchTimes) -> Figure:
    """The waveform over time, s, with the touches found, and the first four of them, or fewer, from
    near, in ms about each.

    heard: touches with their recording.
    """
    assert heard.recording is not None
    sound = heard.recording.sound
    # Samples a second, and time of the first, s.
    rate = heard.recording.rate
    begin = heard.recording.begin
    figure = new_figure(6.4, 4.2)
    grid = figure.add_gridspec(2, 4)
    _draw_waveform(figure.add_subplot(grid[0, :]), heard.recording, 0, len(sound), heard.times)
    numbers = range(len(heard.times)) if heard.numbers is None else heard.numbers
    touches = list(zip(numbers, heard.times, strict=True))
    for i, (number, touch) in enumerate(touches[:4]):
        axes = figure.add_subplot(grid[1, i])
        # Samples from one _WINDOW before the touch to two after it.
        first = max(0, round((touch - begin - _WINDOW) * rate))
        last = round((touch - begin + 2 * _WINDOW) * rate)
        time = begin + np.arange(first, min(last, len(sound))) / rate
        axes.plot((time - touch) * 1e3, sound[first:last], color=SLATE)
        axes.axvline(0.0, color=LIMIT, linewidth=0.9)
        axes.set_title(f"touch {number + 1}", loc="left")
        axes.set_xlabel("ms")
        axes.set_yticklabels([])
    return figure


def _draw_waveform(
    axes: Axes, recording: Recording, first: int, last: int, touches: Iterable[float]
) -> None:
    """Draw samples of a recording over time, with a line at each touch.

    first, last: numbers of the first sample, and of the one after the last.
    touches: s, in the time of the recording's file.
    """
    sound = recording.sound[first:last]
    # The least and the largest of every `stride` samples, so that no peak is lost.
    stride = math.ceil(len(sound) / _MOST_SAMPLES)
    blocks = np.pad(sound, (0, -len(sound) % stride)).reshape(-1, stride)
    time = recording.begin + (first + np.arange(len(blocks)) * stride) / recording.rate
    axes.fill_between(time, blocks.min(axis=1), blocks.max(axis=1), color=SLATE, linewidth=0.3)
    for touch in touches:
        axes.axvline(touch, color=LIMIT, linewidth=0.7)
    axes.set_xlabel("time, s")


class _Train(NamedTuple):
    """A train of touches that was heard, for the page's template.

    letter: as `--touches` takes it.
    figure: what `draw` returns.
    command: that fits this train.
    """

    letter: str
    description: str
    figure: dict[str, Any]
    command: str


class _HeardRecording(NamedTuple):
    """A recording with what was heard in it.

    sound: a WAV file in base 64.
    """

    name: str
    sound: str
    trains: list[_Train]


def _heard(i: int, heard: TouchTimes, typed: Sequence[str]) -> _HeardRecording:
    """The part of a recording that holds its trains of touches, and each of these.

    i: number of the recording, for the names of its figures.
    heard: touches with their recording, in which one train or more was heard.
    typed: the words after `hcbench` that led here; the command adds `--touches` to them.
    """
    trains = []
    for about, picks in zip(trains_of(heard), heard.heard, strict=True):
        letter, count, first, last, alpha, *_ = about
        figure = draw(Drawing(f"heard-{i}-{letter}", partial(_train_figure, heard, picks.times)))
        description = f"{count} touches from {first} to {last}"
        if alpha:
            description += f", α = {alpha}"
        command = f"hcbench {shlex.join(typed)} --touches {letter}"
        trains.append(_Train(letter, description, figure, command))
    return _HeardRecording(heard.name, _played(heard), trains)


def _around(heard: TouchTimes) -> tuple[int, int]:
    """Number of the first sample of the part about all trains of a recording, _BESIDE s longer at
    either end, and of the one after its last.
    """
    assert heard.recording is not None
    times = np.concatenate([picks.times for picks in heard.heard]) - heard.recording.begin
    first = round((times.min() - _BESIDE) * heard.recording.rate)
    last = round((times.max() + _BESIDE) * heard.recording.rate)
    return max(0, first), min(last, len(heard.recording.sound))


def _played(heard: TouchTimes) -> str:
    """The part of the sound that holds the trains, at full level: a WAV file in base 64."""
    assert heard.recording is not None
    first, last = _around(heard)
    part = heard.recording.sound[first:last]
    # Silence has no level to raise.
    loudest = max(float(np.abs(part).max()), 1e-12)
    samples = np.round(32767 * part / loudest).astype(np.int16)
    file = io.BytesIO()
    wavfile.write(file, round(heard.recording.rate), samples)
    return base64.b64encode(file.getvalue()).decode("ascii")


def _train_figure(heard: TouchTimes, touches: Floats) -> Figure:
    """The part that is played, over time, with the touches, s, (n,), of one train."""
    assert heard.recording is not None
    first, last = _around(heard)
    figure = new_figure(6.4, 1.8)
    _draw_waveform(figure.subplots(), heard.recording, first, last, touches)
    return figure
