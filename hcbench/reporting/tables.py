"""Tables of the page as rows of text; the page only lays them out."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from hcbench.benchmark.results import CONDITIONS, RUN_KEY, Key, Results
from hcbench.reporting import wording
from hcbench.reporting.ranking import (
    error_of,
    error_ratio,
    grade,
    lacks,
    lies_still,
    over_constant,
    verdict,
)
from hcbench.reporting.view import REFERENCE, RunKey, View
from hcbench.terms.setting import Setting
from hcbench.tuning.model import snippet

if TYPE_CHECKING:
    import pandas as pd

# Results of one study under each of its gravities, and a cup compared with its equivalent flat
# plate.

_RUN = ["engine", "setting", "timestep_s"]


class Views(NamedTuple):
    """The same study under its strongest gravity, without gravity, one of which may be None, and
    where bodies slid.

    sliding: the impacts with friction, under every gravity; None where there are none.
    """

    with_gravity: View | None
    without_gravity: View | None
    sliding: View | None = None

    @property
    def shown(self) -> list[View]:
        """The views with gravity and without, those that there are."""
        return [view for view in (self.with_gravity, self.without_gravity) if view is not None]

    @property
    def main(self) -> View:
        """View that resembles a user's own scene: under gravity, if the study has it."""
        return self.shown[0]


def views(results: Results) -> Views:
    """The views of a study: under its strongest gravity, without gravity, and of the impacts with
    friction; None for one that it does not have.
    """
    gravities = {float(record["gravity_m_per_s2"]) for record in results.settings}
    strongest = max(gravities, default=0.0)
    with_gravity = None
    if strongest:
        with_gravity = View(under(results, strongest))
    without_gravity = None
    if 0.0 in gravities or not gravities:
        without_gravity = View(under(results, 0.0))
    friction = RUN_KEY.index("friction")
    rough = results.table.only([key for key in results.table.folded if key[friction] > 0.0])
    sliding = None
    if len(rough):
        sliding = View(replace(results, table=rough))
    return Views(with_gravity, without_gravity, sliding)


def under(results: Results, gravity: float) -> Results:
    """Select the results under a gravity, m/s², on the axis and with the least friction.

    A run that was made in several scenes is taken in the study's own, else in the first of them.
    The study's gravity is then this one; if that is another than its own, its speeds are those
    launched, and it has no loop speeds.
    """
    import pandas as pd

    # A row for each setting, α and step that ran.
    rows = pd.DataFrame(results.settings, columns=["scene", *CONDITIONS, *_RUN])
    plain = (rows["gravity_m_per_s2"] == gravity) & (rows["off_axis_m"] == 0.0)
    plain &= rows["friction"] == rows["friction"][plain].min()
    foreign = rows["scene"] != results.study["scene"]
    # One row a run: where it ran in the study's own scene and in another,
    # the sort puts its own first.
    chosen = rows[plain].assign(foreign=foreign).sort_values("foreign", kind="stable")
    chosen = chosen.drop_duplicates(_RUN).drop(columns="foreign")
    chosen_values = set(chosen.itertuples(index=False, name=None))

    def is_chosen(values: Mapping[str, Any]) -> bool:
        """Say whether a setting's record, or key as a mapping, is of a chosen run."""
        return tuple(values[name] for name in chosen.columns) in chosen_values

    def pick(table: pd.DataFrame) -> pd.DataFrame:
        """Rows of the chosen runs; pandas joins by all columns that both tables have."""
        if table.empty:
            return table
        return table.merge(chosen)

    settings = [record for record in results.settings if is_chosen(record)]
    keys = [key for key in results.table.folded if is_chosen(dict(zip(RUN_KEY, key, strict=True)))]
    table = results.table.only(keys)
    study = dict(results.study)
    if gravity != study["gravity"]:
        # The study's band is that of its own gravity: here it is what was launched.
        launched: set[float] = set()
        for one in table.folded.values():
            launched.update(one.curve.speed.tolist())
        study |= {"gravity": gravity, "speeds": sorted(launched), "loop_speeds": []}
    return replace(
        results,
        study=study,
        settings=settings,
        table=table,
        loops=pick(results.loops),
        scores=pick(results.scores),
        trains=pick(results.trains),
        rests=pick(results.rests),
    )


# The same settings on the axis of the cup, off it, and on the equivalent flat plate: differences
# of e.

_RUN_AT_GRAVITY = ["gravity_m_per_s2", "engine", "setting", "timestep_s"]
_SCENE = RUN_KEY.index("scene")
_OFF_AXIS = RUN_KEY.index("off_axis_m")
_LAUNCH = ["speed_m_per_s", "phase"]


def rows(by_gravity: Views, results: Results) -> list[dict[str, Any]]:
    """Runs of the main α at several places: the largest error of e on the cup's axis, and at each
    other place the largest difference of e from there, launch by launch.

    Keys of a row: run, dropped, error, off_axis and flat; the last three are text. Empty for a
    study that is not of a cup.
    """
    study = results.study
    view = by_gravity.main
    if study["form"] != "cup":
        return []
    shown = []
    for run, keys in _keys_by_run(results, view.main_alpha).items():
        # Nothing to compare: it ran on the axis alone.
        if all(key[_SCENE] == study["scene"] and key[_OFF_AXIS] == 0.0 for key in keys):
            continue
        gravity = run[_RUN_AT_GRAVITY.index("gravity_m_per_s2")]
        group = results.table.rows(keys)
        in_cup = group["scene"] == study["scene"]
        on_axis = group["off_axis_m"] == 0.0
        by_launch = group.set_index(_LAUNCH)["restitution"]
        axis = by_launch[(in_cup & on_axis).to_numpy()]
        off_axis = by_launch[(in_cup & ~on_axis).to_numpy()]
        flat = by_launch[(~in_cup).to_numpy()]
        if len(axis) and (len(off_axis) or len(flat)):
            shown.append(
                {
                    "run": view.run_of({**group.iloc[0].to_dict(), "scene": study["scene"]}),
                    "dropped": float(gravity) > 0,
                    "error": _error(group[in_cup & on_axis]),
                    "off_axis": _difference(axis, off_axis),
                    "flat": _difference(axis, flat),
                }
            )
    return shown


def _keys_by_run(results: Results, alpha: float) -> dict[tuple[Any, ...], list[Key]]:
    """Keys of the impacts without friction for one α at every place, by the values of
    _RUN_AT_GRAVITY.

    alpha: s/m.
    """
    runs: dict[tuple[Any, ...], list[Key]] = {}
    for key in results.table.folded:
        values = dict(zip(RUN_KEY, key, strict=True))
        if values["friction"] == 0.0 and math.isclose(values["alpha_s_per_m"], alpha, rel_tol=1e-9):
            run = tuple(values[name] for name in _RUN_AT_GRAVITY)
            runs.setdefault(run, []).append(key)
    return runs


def _error(rows: pd.DataFrame) -> str:
    return wording.error(float((rows["restitution"] - rows["restitution_law"]).abs().max()))


def _difference(axis: pd.Series, other: pd.Series) -> str:
    """Largest difference of e between launches made at both places; "–" where there are none.

    axis, other: e by launch speed and phase, by which pandas pairs them.
    """
    return wording.error(float((other - axis).dropna().abs().max())) if len(other) else "–"


Cells: TypeAlias = dict[str, Any]
_MARKS = {"good": "✓", "even": "=", "bad": "✗", "none": ""}
# The paper's claims of a sound contact, as words for a column.
_CLAIMS = {
    "starts_at_zero": "starts at zero",
    "no_tension": "never pulls",
    "sharp_at_origin": "ends sharply",
    "cubic_loss": "loss as the law's",
}
_HEADS_OF_DROPS = ("deepest in a bounce", "penetration at rest")
_HEADS_OF_CONTACTS = (
    "steps in contact",
    "loop, rms of force",
    "p of ΔE ∝ vᵖ",
    *_CLAIMS.values(),
)


def heads(gravity: float) -> tuple[str, ...]:
    """Heads of the columns of numbers in `ranking` under a gravity, m/s²."""
    if gravity > 0:
        return _HEADS_OF_DROPS
    return _HEADS_OF_CONTACTS


def rankings(by_gravity: Views) -> list[Cells]:
    """`ranking` under each gravity."""
    rows: list[Cells] = []
    for view in by_gravity.shown:
        rows += ranking(view, by_gravity.with_gravity)
    return rows


def ranking(view: View, with_gravity: View | None = None) -> list[Cells]:
    """Runs over a band, best first; their error for each α, numbers under
    `heads` of the gravity, a verdict. Those that lack something under gravity come last.

    with_gravity: the same study under gravity, for what a setting lacks there; None without it.
    """
    runs = [run for run in view.band_runs if run.engine != REFERENCE]
    # Ties stay in the study's order.
    runs.sort(key=lambda run: (bool(lacks(view, run)), round(error_ratio(view, run), 3)))
    return [_ranking_row(view, run, with_gravity) for run in runs]


def _ranking_row(view: View, run: RunKey, with_gravity: View | None) -> Cells:
    """A row of `ranking`, by the names that the page's script reads.

    `step` is in s, `errors` has a cell for each α in nine digits, and `cells` are under `heads`.
    with_gravity: the same study under gravity; None without it.
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
    """Cells under `heads` of a run under gravity: its largest depth, and its depth at rest, "–" where
    it did not come to rest.
    """
    rest = view.rests.get(run)
    lying = "–"
    if rest is not None and lies_still(view, run):
        lying = wording.length(rest.depth)
    return [wording.length(view.depths.get(run, math.nan)), lying]


def _of_contact(score: Mapping[str, Any]) -> list[str]:
    """Cells under `heads` of a run without gravity; "–" for what its score has no number of.

    score: with the names of SCORE_FIELDS; empty for a run without one.
    """
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
    """Largest error of the best constant e for each α, over the launches of a step's runs: a row
    for each gravity and step, with gravity (m/s²), step (s) and errors by α in nine digits.
    """
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
    """Error of the best constant e for one α, as a cell: that of the first run which has a score;
    "–" for none.

    alpha: s/m.
    """
    for run in runs:
        score = view.score(run, alpha)
        if score is not None:
            return wording.error(score["constant_error_law"])
    return "–"


class PastedTexts:
    """The texts to paste of all runs, every text once.

    stored: the texts, by their numbers.
    settings: summary and notes of each recipe, by engine and setting: "engine label".
    """

    def __init__(self, by_gravity: Views) -> None:
        """Make the texts to paste for the settings of one study, under every gravity that the page
        shows, for a ball on a floor.
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
                setting = Setting(run.engine, run.setting, run.timestep, record["options"])
                # A reader has a ball on a floor, even where the study has a cup.
                text = snippet(setting, "plane")
                if text not in numbers:
                    numbers[text] = len(self.stored)
                    self.stored.append(text)
                self._places[view.gravity, run, float(record["alpha_s_per_m"])] = numbers[text]

    def of(self, view: View, run: RunKey, alpha: float) -> int:
        """Number of a run's text; -1 without one."""
        return self._places.get((view.gravity, run, alpha), -1)


def oblique(view: View | None) -> list[Cells]:
    """Runs for the main α with friction in which some body slid: largest
    errors over all angles of launch.

    view: of the impacts with friction; None where there are none. e is that of the normal
    direction; friction is the impulse over the normal one, against Coulomb's law. Keys of a row:
    run, and as text e, friction and largest_e.
    """
    if view is None:
        return []
    # Of each run, for each gravity and friction: error of e, error of friction, largest e.
    runs: dict[RunKey, list[tuple[float, float, float]]] = {}
    for run, one in view.of_main_alpha():
        if one.friction is not None:
            _, largest_e = one.restitution
            runs.setdefault(run, []).append((one.off, one.friction, largest_e))
    rows = []
    for run, worst in runs.items():
        # The largest of each; NaN counts as none.
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
    """Impacts without a bounce, counted by what became of them: "3 diverged", one text a status.

    The commonest comes first, under each gravity.
    """
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
