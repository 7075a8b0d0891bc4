"""Answers of `hcbench tune` for the conditions of a study's runs, and each run's place among them."""

import math
from collections.abc import Mapping
from typing import Any

from hcbench.reporting.view import RunKey, View


def answer_of(
    view: View, engine: str, timestep: float, alpha: float | None = None
) -> Mapping[str, Any] | None:
    """The one for an engine, a step and an α, else the main one; None where none is known."""
    return view.answers.get((engine, timestep, f"{view.main_alpha if alpha is None else alpha:.9g}"))


def best_of(answer: Mapping[str, Any]) -> Mapping[str, Any]:
    """The choice that `tune` prints first."""
    best: Mapping[str, Any] = next(c for c in answer["choices"] if c["kind"] == answer["best"])
    return best


def choice_of(view: View, run: RunKey, alpha: float | None = None) -> Mapping[str, Any] | None:
    """An answer's choice whose setting a run has; None where it is none of its choices."""
    answer = answer_of(view, run.engine, run.timestep, alpha)
    choices = [] if answer is None else answer["choices"]
    return next((choice for choice in choices if choice["setting"] == run.setting), None)


def error_of(view: View, run: RunKey, alpha: float | None = None) -> float:
    """Largest error of e against the law: as `tune` found it, else over the study's impacts; NaN for none."""
    score, choice = view.score(run, alpha), choice_of(view, run, alpha)
    if score is None:
        return math.nan
    return float(score["max_error_law"] if choice is None else choice["max_error"])
