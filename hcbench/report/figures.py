"""Every figure of the report: where it stands, what it shows, how it is drawn, or why it is not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from hcbench.report import bounces, curves, findings, loops, trends, wording
from hcbench.report.view import INSIDE, REFERENCE

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.figure import Figure

    from hcbench.report.view import Run, View


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure to be drawn. draw: None where the study has nothing to show, and `why` says so.

    section: id of the page's section. alt: what the figure shows, for who cannot see it.
    """

    section: str
    name: str
    title: str
    caption: str
    alt: str
    draw: Callable[[], Figure] | None
    why: str = ""


def drawings(view: View) -> list[Drawing]:
    """All figures, in the page's order."""
    return [
        _overview(view),
        *(_restitution(view, fine) for fine in (False, True)),
        *(_error(view, fine) for fine in (False, True)),
        *_loops(view),
        _energy(view),
        _steps(view),
        _trains(view),
    ]


def class_heading(view: View, fine: bool) -> str:
    """Which steps a class holds."""
    limit, contact = wording.about(view.contact_time / INSIDE), wording.about(view.contact_time)
    ends = f"up to {limit}" if fine else f"above {limit}"
    return f"Steps {ends}; the law's contact lasts {contact}"


def _overview(view: View) -> Drawing:
    runs = findings.overview_runs(view)
    at = f"{wording.alpha(view.main_alpha)}, {findings.band(view)}"
    return Drawing(
        "overview",
        "overview",
        "In one picture",
        f"Restitution over impact speed at {at}. Pale grey: the law. A line on it bounces like the law; a"
        " level line is one e for all speeds. Shaded: where one speed gives several e, by where in the time"
        " step the touch falls.",
        f"Restitution over impact speed at {at}. {_alt_restitution(view, runs)}",
        partial(curves.overview_figure, view, runs) if runs else None,
        "no setting ran over enough speeds for a curve",
    )


def _class(view: View, fine: bool) -> tuple[list[Run], str, str, str]:
    """Runs of a class, its name for files, for headings, and why it may be empty."""
    runs = [run for run in view.of_class(fine) if run.engine != REFERENCE]
    heading = class_heading(view, fine)
    limit = wording.about(view.contact_time / INSIDE)
    why = f"no setting of this study ran over its band at a step {'up to' if fine else 'above'} {limit}"
    return runs, "fine" if fine else "coarse", heading, why


def _restitution(view: View, fine: bool) -> Drawing:
    runs, name, heading, why = _class(view, fine)
    return Drawing(
        "restitution",
        f"restitution-{name}",
        heading,
        "Restitution over impact speed, a column for each α, a row for each engine. Pale grey: eq. (16);"
        " dotted: 1 − αv. The frame is set by the law: ▼ names what lies below it.",
        f"Restitution over impact speed, small panels, {len(view.alphas)} α by engine. "
        + _alt_restitution(view, runs),
        partial(curves.restitution_figure, view, fine) if runs else None,
        why,
    )


def _error(view: View, fine: bool) -> Drawing:
    runs, name, heading, why = _class(view, fine)
    return Drawing(
        "error",
        f"error-{name}",
        heading,
        "Largest |e − e of eq. (16)| over the phases, at each speed. The dashed line is what the best"
        " constant e is off by at worst: below it at every speed, a setting is better than any constant."
        " Errors under 10⁻⁷ are drawn on the lower edge.",
        "Error of restitution over impact speed, log scale. " + _alt_restitution(view, runs),
        partial(curves.error_figure, view, fine) if runs else None,
        why,
    )


def _loops(view: View) -> list[Drawing]:
    runs = loops.drawable(view)
    near = [run for run in runs if loops.on_law_scale(view, run)]
    far = [run for run in runs if run not in near]
    speeds = wording.listed([f"{float(v) / wording.INCH:.3g}" for v in sorted(view.study["loop_speeds"])])
    at = f"{speeds} in/s, {wording.alpha_short(view.main_alpha)}"
    return [
        Drawing(
            "loops",
            "loops",
            "Fig. 4 of the paper, redrawn",
            f"Contact force over penetration at {at}; in grey the law at the same speeds. A loop that covers"
            " its grey one has the law's force at every instant; its area is the energy lost.",
            f"Force over penetration at {at}. {_alt_loops(view, near)}",
            partial(loops.loops_figure, view, near) if near else None,
            "no setting's loops come near the law's in depth and force",
        ),
        Drawing(
            "loops",
            "loop-shapes",
            "Softer or harder than the law",
            "Settings whose contact is another size than the law's: each loop over its own largest depth and"
            " force, to compare shapes. A first point far above zero is a shock at touch.",
            "Force over penetration, each over its own largest. " + _alt_loops(view, far),
            partial(loops.shapes_figure, view, far) if far else None,
            "every loop drawn is of the law's size",
        ),
    ]


def _energy(view: View) -> Drawing:
    score = next((s for s in (view.score(r, view.main_alpha) for r in view.band_runs) if s is not None), None)
    known = score is not None and math.isfinite(score["energy_exponent_law"])
    own = f" The law's own p over this band is {score['energy_exponent_law']:.2f}." if score and known else ""
    engines = [run for run in trends.lossy_runs(view) if run.engine != REFERENCE]
    return Drawing(
        "energy",
        "energy",
        "Energy lost over impact speed",
        f"Log-log, at {wording.alpha(view.main_alpha)}; p is the slope, from ΔE ∝ vᵖ. The paper asks for 3,"
        f" eq. (3); every constant e gives 2.{own}",
        "Energy lost over impact speed, log-log. "
        + " ".join(
            f"{wording.setting_name(r.engine, r.setting)}: p = {s['energy_exponent']:.2f}."
            for r, s in ((run, view.score(run, view.main_alpha)) for run in view.band_runs)
            if s is not None and math.isfinite(s["energy_exponent"])
        ),
        partial(trends.energy_figure, view) if engines else None,
        "no setting ran over enough speeds and lost energy",
    )


def _steps(view: View) -> Drawing:
    tables = {key: table for key, table in view.step_curves().items() if len(table) > 1}
    at = f"{wording.inches_per_second(view.study['step_speed'])}, {wording.alpha_short(view.main_alpha)}"
    return Drawing(
        "steps",
        "steps",
        "Restitution over the time step",
        f"At {at}. Left: median e, and shaded the band that the phases span; right: largest error over"
        f" the phases. Tinted: steps longer than the law's contact of {wording.about(view.contact_time)}.",
        f"Restitution over the time step at {at}. "
        + " ".join(
            f"{wording.setting_name(*key)}: e from {table['low'].min():.3f} to {table['high'].max():.3f}."
            for key, table in tables.items()
        ),
        partial(trends.steps_figure, view) if tables else None,
        f"no setting ran at more than one step at {at}",
    )


def _trains(view: View) -> Drawing:
    found = bounces.drawn_trains(view)
    height = view.study.get("train_height")
    drop = f"from {1e3 * float(height):.3g}{wording.NBSP}mm" if height else ""
    told = []
    for run, table in found.items():
        last = table.iloc[-1]
        name = f"{wording.setting_name(run.engine, run.setting)} at {wording.time(run.timestep)}"
        ratio = float(last["height_m"]) / float(last["height_law_m"])
        told.append(f"{name}: {ratio:.2f} of the law's height after bounce {int(last['bounce'])}.")
    at = wording.alpha_short(view.main_alpha)
    return Drawing(
        "trains",
        "trains",
        "Bounce after bounce",
        f"A drop {drop} under gravity at {at}. Left: height after each bounce, log scale; right: over the"
        " law's height. By the law a ball loses ever less as it slows; one e for all speeds goes down a"
        " straight line. A line ends where its ball rests or its time is up.",
        f"Heights of a bounce train under gravity. {' '.join(told)}",
        partial(bounces.trains_figure, view) if found else None,
        "the study asks for no drop under gravity, or nothing bounced",
    )


def _alt_restitution(view: View, runs: Sequence[Run]) -> str:
    """The figure's content in words: largest errors at the main α."""
    said = []
    for run in runs:
        score = view.score(run, view.main_alpha)
        if score is not None:
            name = f"{wording.setting_name(run.engine, run.setting)} at {wording.time(run.timestep)}"
            said.append(f"{name}: off the law by up to {wording.small(score['max_error_law'])}.")
    return " ".join(said)


def _alt_loops(view: View, runs: Sequence[Run]) -> str:
    said = []
    for run in runs:
        score = view.score(run, view.main_alpha)
        name = wording.setting_name(run.engine, run.setting)
        if score is not None and score["loops"]:
            said.append(f"{name}: {wording.percent(score['loop_rms'])} off in force (rms).")
        else:
            said.append(f"{name}: too few samples for a score.")
    return " ".join(said)
