"""A fit in a notebook: its table and its curve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import singledispatch
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from hcbench.benchmark.results import Results
from hcbench.fitting.result import FitResult, band, headline, odds_text
from hcbench.fitting.which_law import LAWS
from hcbench.laws.impact_law import ImpactLaw, ImpactLaws
from hcbench.measuring.measurement import Measurement
from hcbench.reporting import measurement_page, wording
from hcbench.reporting.build import overview_figure
from hcbench.reporting.page import Drawing, draw, render
from hcbench.reporting.plot_style import (
    INK,
    LAW,
    MEASURED,
    draw_band,
    figure_defaults,
    new_figure,
    speed_axis,
)
from hcbench.reporting.ranking import advised, overview_runs
from hcbench.reporting.tables import views
from hcbench.sim import registry
from hcbench.system import text as _text
from hcbench.tuning.answer import Answer
from hcbench.tuning.evaluate import held_out_launches
from hcbench.tuning.model import snippet
from hcbench.tuning.tuned import Tuned

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from matplotlib.axes import Axes


def as_html(result: FitResult) -> str:
    """The result, every law with its odds, and readings to check, as HTML tables."""
    facts = _rows(headline(result).items())
    laws = _rows(
        (fit.law.name, LAWS[fit.law.name].formula, odds_text(odds))
        for fit, odds in zip(result.fits, result.odds, strict=True)
    )
    head = "<thead><tr><th>law</th><th>e</th><th>odds</th></tr></thead>"
    notes = ""
    for flag in result.flags:
        notes += f"<p>check: {escape(flag.file)}, {escape(flag.touch)}</p>"
    return f"<table>{facts}</table><table>{head}{laws}</table>{notes}"


def _rows(rows: Iterable[tuple[str, ...]]) -> str:
    """HTML of a table's body: a line of cells for each of the rows, escaped."""
    lines = []
    for row in rows:
        cells = "".join(f"<td>{escape(cell)}</td>" for cell in row)
        lines.append(f"<tr>{cells}</tr>")
    body = "".join(lines)
    return f"<tbody>{body}</tbody>"


def draw_curve(axes: Axes, result: FitResult, of_law: str, of_data: Sequence[str]) -> None:
    """Draw e over impact speed, m/s: the data as one reads them off, the likeliest law with its 95
    % band.

    of_law: colour of the law.
    of_data: colours of the data, one a file, from the first again where they are too few.
    """
    speeds, e, low, high = band(result)
    axes.fill_between(speeds, low, high, color=of_law, alpha=0.18, linewidth=0)
    axes.plot(speeds, e, color=of_law, label=f"{result.best.law.name}, 95 % band")
    for i, s in enumerate(result.sets):
        colour = of_data[i % len(of_data)]
        axes.plot(*s.pairs(), linestyle="none", marker="o", color=colour, label=s.name)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("impact speed v, m/s")
    axes.set_ylabel("restitution e")
    axes.legend(loc="best")


# Results as a notebook shows them: a figure, and HTML of the results with that figure in it.


def figure_of(result: Any) -> Figure:
    """Draw the main figure of a result, in hcbench's style, regardless of matplotlib's settings.

    Raises TypeError for a type that no function below draws.
    """
    with figure_defaults():
        return _figure(result)


@singledispatch
def html_of(result: Any) -> str:
    """A result in words and its main figure, as HTML that loads nothing.

    Raises TypeError for a type that no function below draws and describes.
    """
    words = _words(result)
    figure = draw(Drawing("figure", lambda: _figure(result), words.title))
    return render(
        "notebook.html", title=words.title, facts=words.facts, paste=words.paste, figure=figure
    )


@singledispatch
def _figure(result: Any) -> Figure:
    raise TypeError(f"no figure of {type(result).__name__}")


class _Words(NamedTuple):
    """The text about a result.

    facts: by their names.
    paste: text for the user's model.
    """

    title: str
    facts: dict[str, str]
    paste: str = ""


@singledispatch
def _words(result: Any) -> _Words:
    raise TypeError(f"no words for {type(result).__name__}")


html_of.register(FitResult)(as_html)


@_figure.register
def _(result: FitResult) -> Figure:
    figure = new_figure(6.4, 3.6)
    draw_curve(figure.subplots(), result, LAW, [f"C{i}" for i in range(7)])
    return figure


_figure.register(Measurement)(measurement_page.curve_figure)


@_words.register
def _(measurement: Measurement) -> _Words:
    """The pair, its e and the causes that were found; to paste are the corrections of these."""
    # The last line, where the two meet, is left out.
    title, *where, _ = measurement.headline
    causes = wording.listed([cause.title for cause in measurement.causes])
    facts = {
        "where": ", ".join(where),
        "result": measurement_page.summary(measurement),
        "why": causes,
    }
    return _Words(title, facts, "\n".join(cause.fix for cause in measurement.causes))


@_figure.register
def _(tuned: Tuned) -> Figure:
    """e at the launches that a setting was judged by, simulated again, its largest error as a band,
    and the target; the legend has the bias of all launches. Raises what the engine raises.
    """
    target = tuned.target
    launches = [launch for launch in held_out_launches(target) if not launch.is_oblique]
    impacts = registry.engine(tuned.setting.engine).run(tuned.scene, tuned.setting, launches)
    measured = sorted((i.speed_in, i.restitution) for i in impacts if i.is_measured)
    speed, e = np.array(measured, dtype=float).reshape(-1, 2).T
    speeds = np.linspace(target.speed_min, target.speed_max, 100)
    figure = new_figure(6.4, 3.6)
    axes = figure.subplots()
    wanted = target.curve.at(speeds)
    axes.plot(speeds, wanted, color=LAW, linewidth=6.0, label="target")
    if math.isfinite(tuned.error):
        draw_band(axes, speeds, wanted - tuned.error, wanted + tuned.error, LAW)
    dots = MEASURED.line(linestyle="none", markersize=2.5)
    judged = tuned.evaluation
    bias = f"mean error {judged.mean_error:+.2g}, {100 * judged.below:.0f} % below the target"
    axes.plot(speed, e, label=f"{tuned.setting.name}, all phases: {bias}", **dots)
    axes.set_ylabel("restitution e", color=INK)
    speed_axis(axes, inches=False)
    axes.legend(loc="best")
    return figure


@_figure.register
def _(answer: Answer) -> Figure:
    return _figure(answer.tuned)


@_words.register
def _(answer: Answer) -> _Words:
    """The best choice, the others, and what to know of them; to paste is the best choice's text."""
    best = answer.best
    others = [choice.line for choice in answer.choices if choice is not best]
    facts = {
        "answer": best.line,
        "instead": wording.listed(others, "or"),
        "never": "; ".join(f"{never.setting}: {never.why}" for never in answer.never),
        "needs": wording.listed(best.needs),
        "band": answer.band_note,
    }
    title = f"{wording.engine_title(answer.engine)}: {best.setting.name}"
    return _Words(title, facts, best.text)


@_words.register
def _(tuned: Tuned) -> _Words:
    """The setting, its largest error beside that of the best constant e, and how it rests."""
    target = tuned.target
    constant = wording.error(tuned.evaluation.constant_error)
    rests = (
        f"comes to rest, {wording.length(tuned.rest.penetration)} deep"
        if tuned.rests
        else "does not rest"
    )
    facts = {
        "why": tuned.why,
        "largest error of e": f"{wording.error(tuned.error)}; that of the best constant e: {constant}",
        "conditions": f"step {wording.time(target.timestep)}, gravity {target.gravity:.4g} m/s², "
        f"{target.speed_min:.3g} to {target.speed_max:.3g} m/s",
        "at rest": rests,
        "advice": " ".join(tuned.advice),
    }
    title = f"{wording.engine_title(tuned.setting.engine)}: {tuned.setting.name}"
    return _Words(title, facts, snippet(tuned.setting, tuned.scene.form))


@_figure.register
def _(law: ImpactLaw) -> Figure:
    return _laws_figure([law], [LAW])


@_figure.register
def _(laws: ImpactLaws) -> Figure:
    colours = [f"C{i % 10}" for i in range(len(laws.laws))]
    return _laws_figure(laws.laws, colours)


def _laws_figure(laws: Sequence[ImpactLaw], colours: Sequence[str]) -> Figure:
    """e of each law over impact speeds up to 2 m/s, and dashed its 1 - α v, from which it parts.

    colours: one for each law.
    """
    figure = new_figure(6.4, 3.6)
    axes = figure.subplots()
    speeds = np.linspace(0.0, 2.0, 101)
    for law, colour in zip(laws, colours, strict=True):
        axes.plot(speeds, law.e(speeds), color=colour, label=f"law, α = {law.alpha:.4g} s/m")
        straight = 1.0 - law.alpha * speeds
        label = "1 - α v" if law is laws[-1] else None
        axes.plot(speeds, straight, color=colour, linewidth=1.0, linestyle=(0, (4, 2)), label=label)
    axes.set_ylim(0.0, 1.0)
    axes.set_ylabel("restitution e", color=INK)
    axes.legend(loc="lower left", fontsize=8.5)
    speed_axis(axes, inches=False)
    return figure


@_words.register
def _(laws: ImpactLaws) -> _Words:
    title, *lines = laws._lines()
    return _Words(title, dict(line.split(": ", 1) for line in lines))


@_words.register
def _(law: ImpactLaw) -> _Words:
    title, *lines = law._lines()
    facts = {}
    for line in lines:
        e, _, speed = line.partition(" at ")
        facts[speed] = e
    return _Words(title, facts)


@_figure.register
def _(results: Results) -> Figure:
    view = views(results).main
    return overview_figure(view, overview_runs(view))


@_words.register
def _(results: Results) -> _Words:
    """Title of the study, its advice in short, and the versions that ran; nothing to paste."""
    view = views(results).main
    facts = {
        "in short": " ".join(advised(view)),
        "impacts": str(len(results.table)),
        "versions": ", ".join(f"{name} {number}" for name, number in results.versions.items()),
    }
    return _Words(_text.sanitized(str(results.study["title"])), facts)
