"""Tables of the page as rows of text; the page only lays them out."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

import numpy as np

from hcbench.reporting import wording
from hcbench.reporting.answers import error_of
from hcbench.reporting.conditions import Views
from hcbench.reporting.ranking import error_ratio, grade, lacks, lies_still, over_constant, verdict
from hcbench.reporting.view import REFERENCE, RunKey, View
from hcbench.terms.setting import Setting
from hcbench.tuning.model import snippet

Cells: TypeAlias = dict[str, Any]
_MARKS = {"good": "✓", "even": "=", "bad": "✗", "none": ""}
# The paper's claims of a sound contact, as words for a column.
_CLAIMS = {
    "starts_at_zero": "starts at zero",
    "no_tension": "never pulls",
    "sharp_at_origin": "ends sharply",
    "cubic_loss": "loss as the law's",
}
HEADS = {
    True: ("deepest in a bounce", "penetration at rest"),
    False: ("steps in contact", "loop, rms of force", "p of ΔE ∝ vᵖ", *_CLAIMS.values()),
}


def rankings(by_gravity: Views) -> list[Cells]:
    """`ranking` under each gravity."""
    return [row for view in by_gravity.shown for row in ranking(view, by_gravity.with_gravity)]


def ranking(view: View, with_gravity: View | None = None) -> list[Cells]:
    """Runs over a band, best first; their error for each α, numbers under
    `HEADS` of the gravity, a verdict.

    with_gravity: the same study under gravity, for what a setting lacks there.
    """
    runs = [run for run in view.band_runs if run.engine != REFERENCE]
    # Ties stay in the study's order.
    runs.sort(key=lambda run: (bool(lacks(view, run)), round(error_ratio(view, run), 3)))
    return [_ranking_row(view, run, with_gravity) for run in runs]


def _ranking_row(view: View, run: RunKey, with_gravity: View | None) -> Cells:
    """A row of `ranking`.

    with_gravity: the same study under gravity, if it has it.
    """
    outcome = verdict(view, run)
    score = view.score(run) or {}
    if view.gravity:
        cells = _of_drop(view, run)
        also = list(outcome.lacks)
    else:
        cells = _of_contact(score)
        also = [outcome.loop]
        if with_gravity is not None and (lacking := lacks(with_gravity, run)):
            also.append(f"under gravity {wording.listed(lacking)}")
    return {
        "engine": run.engine,
        "setting": run.label,
        "title": run.title,
        "step": run.timestep,
        "gravity": view.gravity,
        "errors": {f"{alpha:.9g}": _error_cell(view, run, alpha) for alpha in view.alphas},
        "chance": wording.error(score.get("phase_spread", math.nan)),
        "cells": cells,
        "grade": outcome.grade,
        "verdict": outcome.restitution,
        "also": "; ".join(filter(None, also)),
    }


def _of_drop(view: View, run: RunKey) -> list[str]:
    """Cells under HEADS of a run under gravity."""
    rest = view.rests.get(run)
    lying = "–"
    if rest is not None and lies_still(view, run):
        lying = wording.length(rest.depth)
    return [wording.length(view.depths.get(run, math.nan)), lying]


def _of_contact(score: Mapping[str, Any]) -> list[str]:
    """Cells under HEADS of a run without gravity; "–" for what its score has no number of."""
    loop = "–"
    if score.get("loops"):
        loop = wording.percent(score["loop_rms"])
    p = "–"
    exponent = score.get("energy_exponent", math.nan)
    if math.isfinite(exponent):
        p = f"{exponent:.2f}"
    return [
        str(score.get("samples_min", "–")),
        loop,
        p,
        *(_claim(score.get(claim)) for claim in _CLAIMS),
    ]


def _claim(value: Any) -> str:
    """True, False or None, in memory or as it was read back from a file."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    return "✓" if str(value) == "True" else "✗"


def _error_cell(view: View, run: RunKey, alpha: float) -> list[str]:
    """An error, its mark and its grade against the best constant e."""
    error = error_of(view, run, alpha)
    against = "none"
    if math.isfinite(error):
        against = grade(view, over_constant(view, run, alpha))
    return [wording.error(error), _MARKS[against], against]


def constants(by_gravity: Views) -> list[Cells]:
    """Largest error of the best constant e for each α, over the launches of a step's runs."""
    rows = []
    for view in by_gravity.shown:
        runs_at: dict[float, list[RunKey]] = {}
        for run in view.band_runs:
            runs_at.setdefault(run.timestep, []).append(run)
        for step, runs in sorted(runs_at.items()):
            errors = {f"{alpha:.9g}": _constant(view, runs, alpha) for alpha in view.alphas}
            rows.append({"gravity": view.gravity, "step": step, "errors": errors})
    return rows


def _constant(view: View, runs: Iterable[RunKey], alpha: float) -> str:
    """Error of the best constant e for one α (s/m): that of the first run
    which has a score; "–" for none.
    """
    for run in runs:
        score = view.score(run, alpha)
        if score is not None:
            return wording.error(score["constant_error_law"])
    return "–"


class PastedTexts:
    """The texts to paste of all runs, every text once."""

    def __init__(self, by_gravity: Views) -> None:
        """Texts to paste for the settings of one study.

        by_gravity: the study.
        """
        self.stored: list[str] = []
        self.settings: dict[str, Cells] = {}
        self._places: dict[tuple[float, RunKey, float], int] = {}
        numbers: dict[str, int] = {}
        for view in by_gravity.shown:
            for record in view.results.settings:
                run = view.run_of(record)
                about = {"summary": record["summary"], "notes": list(record.get("notes", []))}
                self.settings.setdefault(f"{run.engine} {run.label}", about)
                # A reader has a ball on a floor, even where the study has a cup.
                text = snippet(Setting(*run[:3], record["options"]), "plane")
                if numbers.setdefault(text, len(self.stored)) == len(self.stored):
                    self.stored.append(text)
                self._places[view.gravity, run, float(record["alpha_s_per_m"])] = numbers[text]

    def of(self, view: View, run: RunKey, alpha: float) -> int:
        """Number of a run's text; -1 without one."""
        return self._places.get((view.gravity, run, alpha), -1)


def oblique(view: View | None) -> list[Cells]:
    """Runs for the main α with friction in which some body slid: largest
    errors over all angles of launch.

    view: of the rough impacts; None where there are none. e is that of the normal direction;
    friction is the impulse over the normal one, against Coulomb's law.
    """
    if view is None:
        return []
    runs: dict[RunKey, list[tuple[float, float, float]]] = {}
    for run, one in view.of_main_alpha():
        if one.friction is not None:
            _, largest_e = one.restitution
            runs.setdefault(run, []).append((one.off, one.friction, largest_e))
    rows = []
    for run, worst in runs.items():
        off, friction, e = np.fmax.reduce(worst).tolist()
        rows.append(
            {
                "run": run,
                "e": wording.error(off),
                "friction": wording.error(friction),
                "largest_e": f"{e:.3g}",
            }
        )
    return rows


def failed_impacts(by_gravity: Views) -> list[str]:
    """Impacts without a bounce, counted by what became of them."""
    counts = Counter[str]()
    for view in by_gravity.shown:
        here = Counter[str]()
        for one in view.folded.values():
            here.update(one.status)
        counts.update(dict(here.most_common()))
    counts.pop("parted", None)
    return [f"{count} {_ENDINGS.get(status, status)}" for status, count in counts.items()]


_ENDINGS = {
    "rested": "came to rest in contact",
    "unfinished": "neither parted nor came to rest",
    "no-touch": "never touched",
    "diverged": "diverged",
    "crashed": "ended with their engine's crash",
}
