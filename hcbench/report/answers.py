"""The page's answers: which setting to use when, in sentences and cards that follow from the findings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hcbench.report import wording
from hcbench.report.findings import TIE, band, best, best_loops, loop_words, ratio, stock_runs, verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.report.view import Run, View

# What a headline says of the verdict.
_PROMISES = {
    "follows the law": "the bounce follows the law",
    "better than any constant e": "closer to the law than any constant e",
    "as good as one constant e can be": "the best one e for all speeds",
    "worse than the best constant e": "still worse than the best constant e",
}
_SOFT = 3.0  # times the law's depth, from where on a bounce that follows the law is not all that matters
_LOOP_MEANING = {
    "loop right": "The loop is the law's.",
    "loop near": "The loop is near the law's.",
    "loop wrong": "That is another law's loop.",
    "loop softer": "A softer contact than the law's.",
    "loop harder": "A harder contact than the law's.",
}


@dataclass(frozen=True, slots=True)
class Answer:
    """Runs that answer a question, how they are named, and the numbers behind."""

    runs: Sequence[Run]
    title: str
    because: str


@dataclass(frozen=True, slots=True)
class Card:
    """One question of a user, an answer for each engine that has one, and what holds for all."""

    question: str
    answers: Sequence[Answer]
    note: str = ""


def headline(view: View) -> list[str]:
    """Which setting to use when: a sentence for engines as they come, and one for each engine."""
    if not view.engines:
        return ["The law alone: no engine ran over a band of speeds in this study."]
    said = [_stock_sentence(view), *(_advice(view, engine) for engine in view.engines)]
    return [sentence for sentence in said if sentence]


def _stock_sentence(view: View) -> str:
    bad = list(dict.fromkeys(r.engine for r in stock_runs(view) if ratio(view, r) > 1 + TIE))
    named = [wording.engine_name(engine) for engine in bad]
    if not named:
        return ""
    if len(named) == 1:
        return f"Out of the box {named[0]} does not bounce like the law."
    return f"Out of the box neither {wording.listed(named, 'nor')} bounces like the law."


def _advice(view: View, engine: str) -> str:
    """The best setting at each step that was tried, steps of one setting together."""
    mine = _settable(view, engine)
    picked = [run for step in _steps(mine) for run in best(view, [r for r in mine if r.timestep == step])]
    promises: dict[str, dict[str, list[Run]]] = {}
    for run in picked:
        softer = _softer(view) if depth(view, run) > _SOFT else ""
        promise = _PROMISES[verdict(view, run).restitution] + softer
        promises.setdefault(promise, {}).setdefault(run.setting, []).append(run)
    clauses = []
    for promise, settings in promises.items():
        where = [f"{setting} at {steps_named(runs)}" for setting, runs in settings.items()]
        clauses.append(f"{wording.listed(where, 'or')}: {promise}")
    return f"In {wording.engine_name(engine)} set {'; '.join(clauses)}." if clauses else ""


def _softer(view: View) -> str:
    """Of a contact that gravity presses in far deeper than the law's: what was measured goes without it."""
    weightless = not float(view.study["gravity"])
    return f",{' without gravity and' if weightless else ''} in a far softer contact"


def depth(view: View, run: Run) -> float:
    """Largest penetration over the law's; NaN where no loop is resolved."""
    score = view.score(run, view.main_alpha)
    return math.nan if score is None else float(score["penetration_ratio"])


def _settable(view: View, engine: str) -> list[Run]:
    """The engine's runs that are numbers to set, no plug-ins, over as many α as any of them ran."""
    mine = [run for run in view.band_runs if run.engine == engine and not view.is_plugin(run)]
    most = max((_alphas(view, run) for run in mine), default=0)
    return [run for run in mine if _alphas(view, run) == most]


def _alphas(view: View, run: Run) -> int:
    return sum(view.score(run, alpha) is not None for alpha in view.alphas)


def plugin_sentence(view: View) -> str:
    """Plug-ins that follow the law, and where; "" where there are none."""
    good = [
        run
        for run in view.band_runs
        if view.is_plugin(run) and verdict(view, run).restitution == "follows the law"
    ]
    if not good:
        return ""
    settings: dict[str, list[Run]] = {}
    for run in good:
        settings.setdefault(run.setting, []).append(run)
    where = []
    for name, runs in settings.items():
        engines = wording.listed([wording.engine_name(e) for e in dict.fromkeys(run.engine for run in runs)])
        where.append(f"{name} at {steps_named(runs)} (in {engines})")
    many = len(where) > 1
    return f"The plug-in{'s' * many} {wording.listed(where)} follow{'s' * (not many)} the law."


def _steps(runs: Sequence[Run]) -> list[float]:
    return sorted({run.timestep for run in runs})


def steps_named(runs: Sequence[Run]) -> str:
    """ "1 ms"; "1 ms or 2 ms"; "1 µs … 2 ms" for more."""
    steps = [wording.time(h) for h in _steps(runs)]
    return wording.listed(steps, "or") if len(steps) < 3 else f"{steps[0]} … {steps[-1]}"


def cards(view: View) -> list[Card]:
    """The page's answers; a question that nothing in this study answers is left out."""
    inside = wording.about(view.contact_time)
    asked = [
        _bounce_card(view, f"Long steps, blind to a contact of {inside}", fine=False),
        _bounce_card(view, f"Short steps, which see the contact of {inside}", fine=True),
        _loop_card(view),
        _plugin_card(view),
        Card("Nothing set at all", [_stock_answer(view, run) for run in stock_runs(view)], _law_note(view)),
    ]
    return [card for card in asked if card.answers]


def _title(runs: Sequence[Run]) -> str:
    settings = wording.listed(list(dict.fromkeys(run.setting for run in runs)), "or")
    return f"{wording.engine_name(runs[0].engine)} {settings}, {steps_named(runs)}"


def _bounce_card(view: View, question: str, fine: bool) -> Card:
    answers, line = [], math.nan
    for engine in view.engines:
        runs = best(view, [run for run in _settable(view, engine) if view.is_fine(run) == fine])
        scores = [s for s in (view.score(run, view.main_alpha) for run in runs) if s is not None]
        if scores:
            line = scores[0]["constant_error_law"]
            answers.append(_bounce_answer(view, runs))
    at = f"{wording.alpha_short(view.main_alpha)}, {band(view)}"
    return Card(question, answers, f"At {at}. The best constant e is off by {wording.small(line)}.")


def _bounce_answer(view: View, runs: Sequence[Run]) -> Answer:
    scores = [s for s in (view.score(run, view.main_alpha) for run in runs) if s is not None]
    error = wording.small(max(s["max_error_law"] for s in scores)).lstrip("<")
    spread = max(s["phase_spread"] for s in scores)
    moved = f", {wording.small(spread)} between phases" if spread > 0.001 else ""
    said = verdict(view, runs[0]).restitution
    deep = [depth(view, run) for run in runs if depth(view, run) > _SOFT]
    span = (
        ""
        if not deep
        else f"{min(deep):.0f}" + (f" … {max(deep):.0f}" if round(max(deep)) > round(min(deep)) else "")
    )
    soft = (
        f" The contact is {span} times as deep as the law's: without gravity only, see the drop."
        if deep
        else ""
    )
    return Answer(runs, _title(runs), f"e within {error} of the law{moved}: {said}.{soft}")


def _plugin_card(view: View) -> Card:
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in view.band_runs:
        if view.is_plugin(run) and view.score(run, view.main_alpha) is not None:
            groups.setdefault(run[:2], []).append(run)
    return Card("A plug-in in your own simulation", [_bounce_answer(view, runs) for runs in groups.values()])


def _loop_card(view: View) -> Card:
    answers = []
    for engine in view.engines:
        runs = best_loops(view, _settable(view, engine))
        score = view.score(runs[0], view.main_alpha) if runs else None
        if score is not None:
            off = f"Force off by {wording.percent(score['loop_rms'])} of its largest (rms)."
            answers.append(Answer(runs, _title(runs), f"{off} {_LOOP_MEANING[loop_words(view, runs[0])]}"))
    return Card("The force matters, not only the bounce", answers)


def _stock_answer(view: View, run: Run) -> Answer:
    curve = view.curve(run, view.main_alpha)
    if curve is None:
        return Answer([run], _title([run]), "No impact came back.")
    low, high = curve.low.min(), curve.high.max()
    span = f"{low:.2f}" if high - low < 0.005 else f"{low:.2f}{wording.NBSP}…{wording.NBSP}{high:.2f}"
    return Answer([run], _title([run]), f"e = {span}.")


def _law_note(view: View) -> str:
    slow, fast = view.truth(view.main_alpha, view.band)
    return f"The law: e = {slow:.2f}{wording.NBSP}…{wording.NBSP}{fast:.2f}."
