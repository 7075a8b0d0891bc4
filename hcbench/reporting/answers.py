"""First screen of the page: the answer of `hcbench tune` for an engine, a step, a gravity and an α,
in words.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hcbench.reporting import wording
from hcbench.reporting.view import STOCK, RunKey, View

_VERBS = {"exact": "Attach", "settings": "Set", "constant": "Set"}


@dataclass(frozen=True, slots=True)
class PageChoice:
    """One of an answer's choices.

    say: one sentence with its error and band.
    error: the largest of e over the band, m/s.
    more: what else to know of it.
    text: to paste.
    shown: the runs to draw, its own and stock.
    """

    kind: str
    setting: str
    error: float
    band: Sequence[float]
    say: str
    more: Sequence[str]
    text: str
    shown: Sequence[RunKey]


def choices(view: View, answer: Mapping[str, Any]) -> list[PageChoice]:
    """The choices of an answer as the page shows them: the best first, then in `tune`'s order."""
    ordered = sorted(answer["choices"], key=lambda choice: choice["kind"] != answer["best"])
    return [_choice(view, answer, choice) for choice in ordered]


def _choice(view: View, answer: Mapping[str, Any], choice: Mapping[str, Any]) -> PageChoice:
    """One of an answer's choices as the page shows it.

    answer, choice: as JSON.
    """
    kind = str(choice["kind"])
    setting = str(choice["setting"])
    alpha = float(answer["alpha"])
    timestep = float(answer["timestep"])
    drawn = []
    for run in view.band_runs:
        here = run.engine == answer["engine"] and run.timestep == timestep
        if here and run.setting in (setting, STOCK) and view.score(run, alpha) is not None:
            drawn.append(run)
    drawn.sort(key=lambda run: run.setting != setting)
    return PageChoice(
        kind=kind,
        setting=setting,
        error=float(choice["max_error"]),
        band=[float(speed) for speed in choice["speeds_m_per_s"]],
        say=f"{_VERBS[kind]} {setting}: {choice['within']}.",
        more=list(_more(answer, choice)),
        text=str(choice["text"]),
        shown=drawn,
    )


def _more(answer: Mapping[str, Any], choice: Mapping[str, Any]) -> Iterator[str]:
    """Sentences on what else to know of a choice; some are empty.

    answer, choice: as JSON.
    """
    natives = [each["kind"] for each in answer["choices"] if each["kind"] != "exact"]
    if natives and choice["kind"] == natives[0]:
        yield answer["caution"]
    yield answer["band_note"]
    words = [f"{wording.sentence(choice['energy'])}."]
    if choice["rests"]:
        words.append("A body comes to rest.")
    else:
        words.append("A body does not come to rest.")
    if choice["passive"]["flat"] is False:
        words.append("A box on its face gains energy: for spheres only.")
    yield " ".join(words)
    if choice["needs"]:
        yield f"It needs {wording.listed(choice['needs'])}."
    for never in answer["never"]:
        yield f"Never use {never['setting']}: {never['why']}."


def answered(view: View) -> Iterator[Mapping[str, Any]]:
    """The answers to what a study ran over a band: its engines, steps and α."""
    ran = {(run.engine, run.timestep) for run in view.band_runs}
    for answer in view.answers.values():
        if (answer["engine"], answer["timestep"]) in ran and math.isclose(
            answer["gravity"], view.gravity
        ):
            yield answer


def answer_of(
    view: View, engine: str, timestep: float, alpha: float | None = None
) -> Mapping[str, Any] | None:
    """The one for an engine, a step and an α, else the main one; None where none is known."""
    return view.answers.get(
        (engine, timestep, f"{view.main_alpha if alpha is None else alpha:.9g}")
    )


def best_of(answer: Mapping[str, Any]) -> Mapping[str, Any]:
    """The choice that `tune` prints first."""
    best: Mapping[str, Any] = next(c for c in answer["choices"] if c["kind"] == answer["best"])
    return best


def choice_of(view: View, run: RunKey, alpha: float | None = None) -> Mapping[str, Any] | None:
    """An answer's choice whose setting a run has; None where it is none of its choices.

    alpha: s/m; None: the study's main one.
    """
    answer = answer_of(view, run.engine, run.timestep, alpha)
    if answer is None:
        return None
    choice: Mapping[str, Any]
    for choice in answer["choices"]:
        if choice["setting"] == run.setting:
            return choice
    return None


def error_of(view: View, run: RunKey, alpha: float | None = None) -> float:
    """Largest error of e against the law: as `tune` found it, else over the
    study's impacts; NaN for none.
    """
    score = view.score(run, alpha)
    if score is None:
        return math.nan
    choice = choice_of(view, run, alpha)
    if choice is None:
        return float(score["max_error_law"])
    return float(choice["max_error"])
