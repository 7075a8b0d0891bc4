"""One page on one measurement: self-contained HTML that works offline and prints."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from hcbench.laws import closed_form
from hcbench.measuring.curve import Curve
from hcbench.measuring.landing import CHANCE, by_drop, headline, labels, span
from hcbench.measuring.measurement import Measurement
from hcbench.measuring.text import motion_notes, setting_text
from hcbench.reporting.explorer import (
    TABS,
    Explorer,
    LoopStore,
    as_json,
    digits,
    explorer_script,
    places,
)
from hcbench.reporting.page import Drawing, draw, render
from hcbench.reporting.plot_style import (
    COLOURS,
    DASHES,
    INK,
    LAW,
    LIMIT,
    MEASURED,
    draw_band,
    draw_loop,
    new_figure,
    speed_axis,
)
from hcbench.sim.landing import Landings
from hcbench.system.text import LONGEST_NOTE
from hcbench.terms.impact import LOOP_TOLERANCE, Impact


def measurement_page(measurement: Measurement) -> str:
    """The page on one measurement as HTML text; parts for which it has no impacts are left out."""
    explored = explorer_of(measurement)
    make_loops = None
    if measurement.loops:
        make_loops = partial(_loops_figure, measurement)
    # Of several angles, each has a point at every speed.
    asked = measurement.asked_at
    points = [(p, f"{math.degrees(p.angle):.4g}", asked[p.speed]) for p in measurement.curve]
    return render(
        "measurement.html",
        script=explorer_script() if explored else None,
        explorer=explored,
        measurement=measurement,
        summary=summary(measurement),
        notes=(*measurement.facts.notes, *motion_notes(measurement)),
        longest=LONGEST_NOTE,
        curve=draw(Drawing("curve", partial(curve_figure, measurement))),
        loops=draw(Drawing("loops", make_loops)),
        points=points,
        settings={name: setting_text(value) for name, value in measurement.facts.settings.items()},
    )


def summary(measurement: Measurement) -> str:
    """The result in up to three sentences: e over its speeds, how far the phase changes it, and
    whether the contact adds energy.
    """
    curve = measurement.curve.measured()
    if not len(curve):
        return "No impact of it could be measured."
    low = curve.lowest.min()
    high = curve.highest.max()
    band = f"{curve.speed_in[0]:.3g} ... {curve.speed_in[-1]:.3g} m/s"
    text = f"Restitution between {low:.3f} and {high:.3f} at impact speeds of {band}."
    if measurement.spread > 0:
        spread = f"{measurement.spread:.2g}"
        text += f" It varies by up to {spread} with where in a time step the contact starts."
    if measurement.energy_gained:
        text += " The contact adds energy in some impacts."
    return text


def curve_figure(measurement: Measurement) -> Figure:
    """e over approach speed, m/s: the mean and a band over the phases; also, where there is one, e
    that the model's settings ask for, and the target.
    """
    curve = measurement.curve.measured()
    speeds = curve.speed_in
    figure = new_figure(6.4, 3.6)
    axes = figure.subplots()
    if measurement.facts.asked:
        asked = measurement.asked_at
        values = [asked[speed] for speed in curve.speed.tolist()]
        axes.plot(speeds, values, color=LAW, linewidth=4.0, label="what the model asks for")
    if measurement.wanted is not None:
        wanted = measurement.wanted.at(speeds)
        axes.plot(speeds, wanted, color=LIMIT, linestyle=(0, (4, 2)), label="target")
    draw_band(axes, speeds, curve.lowest, curve.highest, MEASURED.colour)
    axes.plot(speeds, curve.restitution, label="measured", **MEASURED.line())
    axes.set_ylabel("restitution e", color=INK)
    axes.set_ylim(0.0, max(1.05, 1.05 * curve.highest.max(initial=0.0)))
    speed_axis(axes, inches=False)
    axes.legend(loc="best")
    return figure


def _loops_figure(measurement: Measurement) -> Figure:
    """Force, N, over penetration, µm or mm: one loop or more, one a speed, the faster the darker."""
    # m, m/s.
    deepest = 0.0
    fastest = 0.0
    for impact in measurement.loops:
        assert impact.loop is not None
        deepest = max(deepest, float(impact.loop.penetration.max()))
        fastest = max(fastest, impact.speed_in)
    scale = 1e6
    unit = "µm"
    if deepest >= 1e-3:
        scale = 1e3
        unit = "mm"
    figure = new_figure(6.4, 3.6)
    axes = figure.subplots()
    for impact in measurement.loops:
        assert impact.loop is not None
        line = {
            "alpha": 0.25 + 0.75 * impact.speed_in / fastest,
            "label": f"{impact.speed_in:.3g} m/s",
        }
        draw_loop(
            axes, impact.loop.penetration * scale, impact.loop.force, color=MEASURED.colour, **line
        )
    axes.set_xlabel(f"penetration, {unit}")
    axes.set_ylabel("force, N")
    axes.legend(loc="best", title="impact speed")
    return figure


# In inches, as Matplotlib takes them.
_PANEL = 3.4, 2.4


def landing_page(robots: Sequence[Landings]) -> str:
    """The page on landings as HTML text.

    robots: landings of one robot or more, from the same heights and tilts.
    """
    names = labels(robots)
    headlines: list[str] = []
    for landings in robots:
        headlines += headline(landings)
    return render(
        "landing.html",
        title=" and ".join(names),
        headlines=headlines,
        several=len(robots) > 1,
        drops=list(by_drop(robots, names)),
        span=span,
        chance=CHANCE,
        forces=draw(Drawing("forces", lambda: force_figure(robots))),
    )


def force_figure(robots: Sequence[Landings]) -> Figure:
    """Force of the floor over weight, over time in ms: a column a robot, a row a tilt, a line a
    height.

    robots: landings of one robot or several, all from the same drops; the tilts are those of the
    first one.
    """
    tilts = list(dict.fromkeys(drop.tilt for drop in robots[0].drops))
    panel_width, panel_height = _PANEL
    width = max(6.4, panel_width * len(robots))
    figure = new_figure(width, 0.9 + panel_height * len(tilts))
    grid = figure.subplots(len(tilts), len(robots), squeeze=False, sharex=True, sharey=True)
    for row, tilt in zip(grid, tilts, strict=True):
        for axes, landings, name in zip(row, robots, labels(robots), strict=True):
            drops = [drop for drop in landings.drops if drop.tilt == tilt]
            for i, drop in enumerate(drops):
                style = {"color": COLOURS[i % len(COLOURS)], "linestyle": DASHES[i % len(DASHES)]}
                height = f"{100 * drop.height:.3g} cm"
                axes.plot(1e3 * drop.time, drop.force / drop.weight, label=height, **style)
            words = []
            if len(robots) > 1:
                words.append(name)
            if len(tilts) > 1:
                words.append(f"tilt {np.degrees(tilt):.3g}°")
            axes.set_title(", ".join(words), fontsize=9)
    for axes in grid[:, 0]:
        axes.set_ylabel("force / weight")
    for axes in grid[-1]:
        axes.set_xlabel("time from touch, ms")
    grid[0, -1].legend(loc="best", title="drop")
    return figure


def explorer_of(measurement: Measurement) -> Explorer | None:
    """Build the explorer of one measurement; its data are in SI, by the names that `explorer_data`
    has for them. Impacts along the normal alone are shown.

    None without a law to compare with, without a measured impact along the normal, or if no contact
    has steps enough for a loop.
    """
    law = measurement.law
    facts = measurement.facts
    measured = measurement.curve.measured()
    head_on = measured.take(measured.angle == 0.0)
    # An oblique impact has another e at the same speed: only loops along the normal are shown.
    along_normal = [impact for impact in measurement.impacts if impact.launch.angle == 0.0]
    with_loop = replace(measurement, impacts=tuple(along_normal)).loops
    if law is None or not len(head_on) or not with_loop:
        return None
    loops = LoopStore()
    gravity = float(np.linalg.norm(facts.gravity))
    where = {"engine": facts.engine, "step": facts.timestep, "gravity": gravity, "alpha": law.alpha}
    runs = [{**where, **_measured(with_loop, head_on, loops)}]
    if facts.asked:
        asked = measurement.asked_at
        values = [asked[speed] for speed in head_on.speed.tolist()]
        runs.append({**where, **_asked(head_on, values)})
    for run in runs:
        error = np.abs(np.array(run["e"]) - closed_form.restitution(law.alpha, np.array(run["v"])))
        run["error"] = digits(error, 3)
        run["largest"] = float(f"{error.max():.3g}")
    shown = [f"{facts.engine} {run['setting']}" for run in runs]
    data = {
        "body": {"k": law.stiffness, "n": law.exponent, "m": measurement.effective_mass},
        "alphas": [law.alpha],
        "gravities": [gravity],
        "band": [0.0, 1.02 * float(head_on.speed_in.max())],
        "engines": [[facts.engine, facts.engine]],
        "start": where,
        "answers": [{**where, "choices": [{"kind": "", "shown": shown}]}],
        "runs": runs,
        "loops": loops.stored,
        "scans": [],
        "dropHeight": None,
        "drops": [],
    }
    return Explorer(as_json(data), {name: TABS[name] for name in ("loop", "numbers")})


def _measured(impacts: Sequence[Impact], curve: Curve, loops: LoopStore) -> dict[str, Any]:
    """The measured curve as the page's script takes it. Each speed with a loop shows the impact of
    that loop; one without has the mean e of its phases, 0 steps and the loop number -1.

    impacts: with loops, at most one for each speed of the curve, and one at least.
    curve: points along the normal.
    loops: takes the loops in.
    """
    with_loop = {impact.launch.speed: impact for impact in impacts}
    phases = []
    e = []
    samples = []
    loop_numbers = []
    for point in curve:
        impact = with_loop.get(point.speed)
        if impact is None:
            e.append(point.restitution)
            samples.append(0)
            loop_numbers.append(-1)
        else:
            phases.append(impact.launch.phase)
            e.append(impact.restitution)
            samples.append(impact.samples)
            loop_numbers.append(_add(loops, impact))
    return {
        **_line("measured", MEASURED.colour, curve),
        "phase": phases[0],
        "e": places(e, 5),
        "low": places(curve.lowest, 5),
        "high": places(curve.highest, 5),
        "samples": samples,
        "loops": loop_numbers,
    }


def _asked(curve: Curve, e: Sequence[float]) -> dict[str, Any]:
    """Curve of e that the model's settings ask for, without loops.

    e: one for each point of the measured curve.
    """
    values = places(e, 5)
    return {
        **_line("what the model asks for", LIMIT, curve),
        "phase": 0.5,
        "samples": [0] * len(e),
        "loops": [-1] * len(e),
        "e": values,
        "low": values,
        "high": values,
        "dashes": "6 3",
    }


def _line(name: str, colour: str, curve: Curve) -> dict[str, Any]:
    """Names, colour and speeds (m/s) of a curve, as the script takes them.

    name: of the line.
    curve: its points give launch and impact speeds.
    """
    return {
        "setting": name,
        "label": name,
        "title": name,
        "colour": colour,
        "dashes": "",
        "asked": digits(curve.speed, 4),
        "v": digits(curve.speed_in, 5),
    }


def _add(loops: LoopStore, impact: Impact) -> int:
    assert impact.loop is not None
    loop = impact.loop.simplified(LOOP_TOLERANCE)
    return loops.add((loop.time.tolist(), loop.penetration.tolist(), loop.force.tolist()))
