"""Results in, a folder out: the page of the study, its figures, its tables and parameters.

The figures are errors by setting with the floors, and e of each impact over speed.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from hcbench.reality import cube, study
from hcbench.reality.data_sets import SETS, SOURCES
from hcbench.reality.evidence import (
    ALPHA,
    LATE,
    MEASURED,
    SIGN,
    SYNTHETIC,
    good,
    speeds_and_e,
)
from hcbench.reality.impacts import COLUMNS, ImpactRead
from hcbench.reality.poses import PAIRS, Own
from hcbench.reality.study import NO_ENGINE, TWIN_ALPHA, TWIN_E, RealityResults, SettingScore
from hcbench.reporting import wording
from hcbench.reporting.page import PAGE, Drawing, draw, render, script
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
from hcbench.reporting.wording import engine_title, listed
from hcbench.sim.toss import FRICTION, NOTHING, PLUGIN_E, RESTITUTION
from hcbench.system.errors import UserError
from hcbench.system.files import atomic_folder, json_text, write_text

# The page: the sets, errors by setting with floors, one toss, e over speed, corrections, verdicts.

# Decimals of a drawn position (m) and quaternion.
_PLACES = 4
_CAPTIONS = {
    "cube": "Mean distance of the centres over all frames of a toss, in per cent of the cube's width.",
    "ellipse": "Distance of the velocities after an impact, with the spin scaled by the radius of gyration.",
    "ball": "Error of the normal speed after a bounce.",
    "alumina": "Error of the tangential speed after over that before; e and friction are the paper's.",
}
# Variants of the cube's data, by the corrections that are made.
_SWITCH_KEYS = {
    "": "lengths|inertia",
    "lengths as published": "inertia",
    "inertia as published": "lengths",
    "lengths and inertia as published": "",
}
# A setting is compared with the others if its error is within this multiple of the least one.
_NEAR = 1.5


def page_text(results: RealityResults, folder: Path | None = None) -> str:
    """The page of the study as HTML text; parts without results are left out.

    folder: in which the page will lie, for the links of its header; None: it may go anywhere.
    """
    scores: dict[str, list[SettingScore]] = {}
    drawn = {}
    for name in results.request.sets:
        of_set = [score for score in results.scores if score.set == name]
        if of_set:
            scores[name] = of_set
            figure = partial(errors_figure, of_set, SETS[name].UNIT)
            drawn[name] = draw(Drawing(f"errors-{name}", figure))
    impacts = None
    if results.impacts:
        impacts = draw(Drawing("impacts", partial(impacts_figure, results.impacts, results.twins)))
    toss = _toss(results)
    # As JSON that no "<" in it can end early.
    toss_json = ""
    if toss:
        toss_json = Markup(json.dumps(toss).replace("<", "\\u003c"))
    page_script = None
    if toss or results.changed:
        page_script = script("reality.js")
    return render(
        "reality.html",
        script=page_script,
        folder=folder,
        toss=toss_json,
        sets=list(scores),
        sources=SOURCES,
        modules=SETS,
        scores=scores,
        name_of=name_of,
        drawn=drawn,
        impacts=impacts,
        slopes=results.slopes,
        verdicts=list(verdicts(results)),
        elastic=_elastic(results.scores),
        cube_switches=_cube_switches(results),
        ellipse_switches=results.switches,
        steps={name: wording.time(SETS[name].TIMESTEP) for name in scores},
        captions=_CAPTIONS,
        switch_keys=_SWITCH_KEYS,
        sign=SIGN,
        late=LATE,
        part=results.request.part,
        twin_e=TWIN_E,
        twin_alpha=TWIN_ALPHA,
    )


def _toss(results: RealityResults) -> dict[str, Any]:
    """Data for the page's script: poses of a toss, measured and simulated."""
    if not results.drawn:
        return {}
    poses = {name: np.round(poses_of, _PLACES).tolist() for name, poses_of in results.drawn.items()}
    return {"halfWidth": cube.HALF_WIDTH, "period": cube.PERIOD, "poses": poses}


def _of(
    scores: Sequence[SettingScore], data: str, setting: str, cone: str | None = None
) -> list[SettingScore]:
    """Scores of engines' settings of one name in a data set; floors are left out.

    data: name of the set.
    setting: name of the setting, in all engines that have it.
    cone: of friction; None for any.
    """
    chosen = []
    for score in scores:
        is_engine = score.engine != NO_ENGINE
        if (
            is_engine
            and score.set == data
            and score.setting == setting
            and cone in (None, score.cone)
        ):
            chosen.append(score)
    return chosen


def verdicts(results: RealityResults) -> Iterator[str]:
    """Conclusions from the data, and their limits, each with its numbers; only those that these
    results support.
    """
    scores = results.scores
    for pyramid in _of(scores, "cube", FRICTION, "pyramidal"):
        for cone in _of(scores, "cube", FRICTION, "elliptic"):
            if pyramid.engine == cone.engine and pyramid.error_low > cone.error_high:
                engine = name_of(pyramid).partition(",")[0]
                yield (
                    f"The pyramidal cone costs {engine} a factor"
                    f" {pyramid.error / cone.error:.1f} on the cube, with the friction of each identified:"
                    f" {_with_interval(pyramid)} against {_with_interval(cone)}."
                )
    near = _comparable(scores)
    # All intervals overlap where the highest low end is below the lowest high end.
    if len(near) > 2 and max(s.error_low for s in near) <= min(s.error_high for s in near):
        near_errors = [score.error for score in near]
        yield (
            f"No order among the {len(near)} identified settings of the cube can be told: their errors"
            f" are {min(near_errors):.1f} to {max(near_errors):.1f} % of a width, and all their intervals"
            " overlap."
        )
    stock_errors = [score.error for score in _of(scores, "cube", NOTHING)]
    if stock_errors and near:
        yield (
            f"With nothing set, engines are wrong by {min(stock_errors):.0f} to"
            f" {max(stock_errors):.0f} % of the cube's width; friction explains most of that."
        )
    yield from _noise_verdict(scores)
    yield from _slope_verdict(results)


def _comparable(scores: Sequence[SettingScore]) -> list[SettingScore]:
    """Scores of the engines' settings on the cube that are near the best: within _NEAR of its
    error.

    Without engines as they are with nothing set, and without pyramidal cones.
    """
    tried = []
    for score in scores:
        is_identified = score.engine != NO_ENGINE and score.setting != NOTHING
        if score.set == "cube" and is_identified and score.cone != "pyramidal":
            tried.append(score)
    best = min((score.error for score in tried), default=0.0)
    return [score for score in tried if score.error < _NEAR * best]


def _with_interval(score: SettingScore) -> str:
    return f"{score.error:.1f} % ({score.error_low:.1f} to {score.error_high:.1f})"


def _noise_verdict(scores: Sequence[SettingScore]) -> Iterator[str]:
    """Conclusion on the share of the noise in the cube's errors, a sentence; none without both
    floors.

    scores: of all sets. The cube's floors come in the order of `study._floors`: best law of each
    toss, noise of the start.
    """
    floors = [s for s in scores if s.set == "cube" and s.engine == NO_ENGINE]
    near = _comparable(scores)
    if len(floors) == 2 and near:
        each, noise = floors
        yield (
            "What is left on the cube is the laws', not the data's: noise of the start makes"
            f" {noise.error:.1f} %, and the best e and friction of every toss still leave {each.error:.1f} %."
        )


# README and docs/howto/reality.md say the same; a test compares it with the materials that ship.
PUBLISHED_SLOPES = (
    "Published measurements do: all nine pairs of materials with e at several speeds have a lower e at the"
    " fastest. One α of the law fits five of them better than one e does; one e fits four better."
    " `hcbench materials` lists them. Measure yours by `hcbench fit`, or take one e at your speed."
)


def _slope_verdict(results: RealityResults) -> Iterator[str]:
    """Conclusions on the slope of e over speed, with what is published; none without slopes.

    The first two are fixed words, true of the data that are published here: no set has shown a
    fall. The last one, on the law of one α, needs the tosses' slope and that of their twins under
    this law, and comes only where their intervals are apart.
    """
    if results.slopes:
        measured_slopes = [slope for slope in results.slopes if not slope.of.startswith(SYNTHETIC)]
        names = [slope.of.partition(",")[0] for slope in measured_slopes]
        yield (
            f"No set here shows that e falls with speed ({listed(names)}): a constant e, by the same reading"
            " or with the noise of the speed before, gives slopes of this size."
        )
        yield PUBLISHED_SLOPES
        slope_of = {slope.of: slope for slope in results.slopes}
        falling = slope_of.get(f"{SYNTHETIC}{ALPHA}")
        measured = slope_of.get(MEASURED)
        if falling and measured and falling.high < measured.low:
            yield (
                f"α = {TWIN_ALPHA} s/m, which has the cube's mean e, is contradicted by its slope: read so,"
                f" it gives {falling.slope:.2f} per m/s, and the tosses give {measured.slope:.2f}"
                f" ({measured.low:.2f} to {measured.high:.2f})."
            )


def _elastic(scores: Sequence[SettingScore]) -> list[tuple[str, list[SettingScore]]]:
    """Scores of the sets whose bodies bounce well, by set: floors, and the settings that the page
    compares. A set without such scores is left out.
    """
    wanted = (NOTHING, FRICTION, RESTITUTION, PLUGIN_E)
    rows = []
    for name in ("ellipse", "ball", "alumina"):
        of_set = []
        for score in scores:
            is_wanted = score.setting in wanted or "identified" in score.setting
            if score.set == name and (score.engine == NO_ENGINE or is_wanted):
                of_set.append(score)
        if of_set:
            rows.append((name, of_set))
    return rows


def _cube_switches(results: RealityResults) -> list[tuple[str, list[SettingScore]]]:
    """Scores with all corrections, then with parts of the data as published.

    Each variant of the data, by its name in `cube.VARIANTS`, and its scores; of the settings alone
    that ran with such parts. Empty where none did.
    """
    if not results.changed:
        return []

    def setting_of(score: SettingScore) -> tuple[str, str, str]:
        return score.engine, score.setting, score.cone

    changed: set[tuple[str, str, str]] = set()
    for scores in results.changed.values():
        changed.update(map(setting_of, scores))
    of_cube = [score for score in results.scores if score.set == "cube"]
    rows = [("", [score for score in of_cube if setting_of(score) in changed])]
    for variant, scores in results.changed.items():
        rows.append((variant, list(scores)))
    return rows


# Results in, a folder out: the page, scores.csv, the impacts that were read, and the parameters.

IMPACTS = "impacts.csv"
PARAMETERS = "parameters.json"


def build_own(own: Own, folder: Path) -> None:
    """Write the tables of a user's tosses into `folder`, all of them or none: all impacts,
    those for `hcbench fit`, scores.

    Raises UserError where a file that hcbench did not write is in the way, OutputError where the
    folder cannot be written.
    """
    with atomic_folder(folder, IMPACTS) as scratch:
        write_text(scratch / IMPACTS, impacts_text(own.impacts))
        write_text(scratch / PAIRS, pairs_text([impact for impact in own.impacts if impact.good]))
        write_text(scratch / study.FILE, study.csv_text(score for score, _ in own.scores))


def build(results: RealityResults, folder: Path) -> Path:
    """Write the study into `folder` and return its page. All of it appears, or nothing.

    The same results give the same bytes.
    Raises OutputError where the folder cannot be written, UserError where it holds a study of data
    sets that these results lack, or files that hcbench did not write.
    """
    if lost := study.sets_in(folder) - set(results.request.sets):
        raise UserError(
            "--out", f"{folder} holds a study with {', '.join(sorted(lost))}", "another folder"
        )
    with atomic_folder(folder, PAGE) as scratch:
        write_text(scratch / PAGE, page_text(results, folder))
        write_text(scratch / study.FILE, study.csv_text(results.scores))
        write_text(scratch / PARAMETERS, json_text(results.parameters))
        if results.impacts:
            write_text(scratch / IMPACTS, impacts_text(results.impacts))
            write_text(scratch / PAIRS, pairs_text(good(results.impacts)))
    return folder / PAGE


def impacts_text(impacts: Sequence[ImpactRead]) -> str:
    """Everything that was read of the impacts, as CSV with COLUMNS: a line each, six digits, SI."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for impact in impacts:
        row = []
        for value in astuple(impact):
            if isinstance(value, float):
                row.append(f"{value:.6g}")
            else:
                row.append(value)
        writer.writerow(row)
    return text.getvalue()


def pairs_text(impacts: Sequence[ImpactRead]) -> str:
    """Impact speeds, m/s, and e, as CSV that `hcbench fit` reads: a line for each impact."""
    text = "trial,speed [m/s],restitution,u_restitution\n"
    for impact in impacts:
        text += f"{impact.number},{impact.speed_in:.6g},{impact.e:.6g},{impact.u_e:.6g}\n"
    return text


# The figures of the page: errors by setting with the floors, and e of each impact over speed.

_BINS = 6
# Even steps on an axis, at most: so many that two ticks are on it.
_FEW_STEPS = 5


def name_of(score: SettingScore) -> str:
    """A setting, or a floor, as figures and tables call it: engine, setting and cone of
    friction.
    """
    words = score.setting
    if score.engine != NO_ENGINE:
        words = f"{engine_title(score.engine)}, {score.setting}"
    if score.cone:
        words += f", {score.cone} cone"
    return words


def errors_figure(scores: Sequence[SettingScore], unit: str) -> Figure:
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
    # An error of 0 has no place on a log axis.
    above_zero = [score.error for score in scores if score.error > 0.0]
    scale = ""
    if above_zero:
        log_axis(axes, "x")
        axes.set_xticks(*_ticks(min(above_zero), max(above_zero)))
        scale = " (log scale)"
    axes.set_xlabel(f"error, {unit}{scale}")
    if floors:
        axes.legend(loc="upper right")
    return figure


def _ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """(values, labels) of the ticks of a log axis, round numbers from 0.8 low to 1.3 high: 1, 2 and
    5 times a power of ten; where fewer than two are between, even steps.

    low, high: the least and the largest number of the axis, above 0.
    """
    first, last = 0.8 * low, 1.3 * high
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    values = []
    for power in powers:
        for digit in (1, 2, 5):
            value = float(digit * power)
            if first <= value <= last:
                values.append(value)
    if len(values) < 2:
        steps = MaxNLocator(_FEW_STEPS, steps=[1, 2, 5, 10]).tick_values(first, last)
        values = [float(value) for value in steps if first <= value <= last]
    return values, [f"{value:g}" for value in values]


def impacts_figure(read: Sequence[ImpactRead], twins: Mapping[str, Sequence[ImpactRead]]) -> Figure:
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
    uncertainty = [impact.u_e for impact in good(read)]
    style: dict[str, Any] = {"fmt": ".", "color": BLUE, "ecolor": GREY, "elinewidth": 0.8}
    axes.errorbar(speed, e, uncertainty, label="measured", **style)
    speed_axis(axes, inches=False)
    axes.set_ylabel("e of an impact")
    axes.set_ylim(0.0, 0.6)
    axes.legend(loc="upper right")
    return figure
