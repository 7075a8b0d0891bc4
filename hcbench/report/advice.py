"""Which setting to use when: sentences and cards that follow from the ranking."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hcbench.laws import closed_form
from hcbench.report import wording
from hcbench.report.ranking import (
    FOLLOWS_LAW,
    TIE,
    best,
    best_loops,
    error_ratio,
    loop_verdict,
    stock_runs,
    verdict,
)
from hcbench.report.view import RunKey, View
from hcbench.units import INCH

# What a headline says of the verdict.
_PROMISES = {
    FOLLOWS_LAW: "the bounce follows the law",
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
class Advice:
    """Runs that answer a question, and the numbers behind."""

    runs: Sequence[RunKey]
    because: str

    @property
    def title(self) -> str:
        """How the runs are named."""
        settings = wording.listed(list(dict.fromkeys(run.setting for run in self.runs)), "or")
        return f"{wording.engine_title(self.runs[0].engine)} {settings}, {steps_text(self.runs)}"


@dataclass(frozen=True, slots=True)
class AdviceCard:
    """One question of a user, advice for each engine that has some, and what holds for all."""

    question: str
    advice: Sequence[Advice]
    note: str = ""


def headline(view: View) -> list[str]:
    """Which setting to use when: a sentence for engines as they come, and one for each engine."""
    if not view.engines:
        return ["The law alone: no engine ran over a band of speeds in this study."]
    sentences = [_stock_sentence(view), *(_engine_sentence(view, engine) for engine in view.engines)]
    return [sentence for sentence in sentences if sentence]


def _stock_sentence(view: View) -> str:
    off = dict.fromkeys(run.engine for run in stock_runs(view) if error_ratio(view, run) > 1 + TIE)
    titles = [wording.engine_title(engine) for engine in off]
    if not titles:
        return ""
    if len(titles) == 1:
        return f"Out of the box {titles[0]} does not bounce like the law."
    return f"Out of the box neither {wording.listed(titles, 'nor')} bounces like the law."


def _engine_sentence(view: View, engine: str) -> str:
    """The best setting at each step that was tried, steps of one setting together."""
    runs = _settable(view, engine)
    promises: dict[str, dict[str, list[RunKey]]] = {}
    for step in _steps(runs):
        for run in best(view, [run for run in runs if run.timestep == step]):
            softer = _softer(view) if _depth(view, run) > _SOFT else ""
            promise = _PROMISES[verdict(view, run).restitution] + softer
            promises.setdefault(promise, {}).setdefault(run.setting, []).append(run)
    clauses = []
    for promise, settings in promises.items():
        where = [f"{setting} at {steps_text(runs)}" for setting, runs in settings.items()]
        clauses.append(f"{wording.listed(where, 'or')}: {promise}")
    return f"In {wording.engine_title(engine)} set {'; '.join(clauses)}." if clauses else ""


def _softer(view: View) -> str:
    """Of a contact that gravity presses in far deeper than the law's: what was measured goes without it."""
    weightless = not float(view.study["gravity"])
    return f",{' without gravity and' if weightless else ''} in a far softer contact"


def _depth(view: View, run: RunKey) -> float:
    """Largest penetration over the law's; NaN where no loop is resolved."""
    score = view.score(run)
    return math.nan if score is None else float(score["penetration_ratio"])


def _settable(view: View, engine: str) -> list[RunKey]:
    """The engine's runs that are numbers to set, no plug-ins, over as many α as any of them ran."""
    runs = [run for run in view.band_runs if run.engine == engine and not view.is_plugin(run)]
    most = max((len(view.scores(run)) for run in runs), default=0)
    return [run for run in runs if len(view.scores(run)) == most]


def plugin_sentence(view: View) -> str:
    """Plug-ins that follow the law, and where; "" where there are none."""
    settings: dict[str, list[RunKey]] = {}
    for run in view.band_runs:
        if view.is_plugin(run) and verdict(view, run).restitution == FOLLOWS_LAW:
            settings.setdefault(run.setting, []).append(run)
    if not settings:
        return ""
    where = []
    for name, runs in settings.items():
        engines = dict.fromkeys(run.engine for run in runs)
        titles = wording.listed([wording.engine_title(engine) for engine in engines])
        where.append(f"{name} at {steps_text(runs)} (in {titles})")
    many = len(where) > 1
    return f"The plug-in{'s' * many} {wording.listed(where)} follow{'s' * (not many)} the law."


def _steps(runs: Sequence[RunKey]) -> list[float]:
    return sorted({run.timestep for run in runs})


def steps_text(runs: Sequence[RunKey]) -> str:
    """ "1 ms"; "1 ms or 2 ms"; "1 µs … 2 ms" for more."""
    steps = [wording.time(h) for h in _steps(runs)]
    return wording.listed(steps, "or") if len(steps) < 3 else f"{steps[0]} … {steps[-1]}"


def band_text(view: View) -> str:
    """The impact speeds of the study: "1 … 20 in/s"."""
    low, high = (f"{speed / INCH:.3g}" for speed in view.band)
    return f"{wording.span(low, high)}{wording.NBSP}in/s"


def cards(view: View) -> list[AdviceCard]:
    """The page's advice; a question that nothing in this study answers is left out."""
    contact = wording.rough_time(view.contact_time)
    slow, fast = (f"{e:.2f}" for e in closed_form.restitution(view.main_alpha, view.band))
    all_cards = [
        _bounce_card(view, f"Long steps, blind to a contact of {contact}", resolved=False),
        _bounce_card(view, f"Short steps, which see the contact of {contact}", resolved=True),
        AdviceCard("The force matters, not only the bounce", _loop_advice(view)),
        AdviceCard("A plug-in in your own simulation", _plugin_advice(view)),
        AdviceCard(
            "Nothing set at all",
            [_stock_advice(view, run) for run in stock_runs(view)],
            f"The law: e = {wording.span(slow, fast)}.",
        ),
    ]
    return [card for card in all_cards if card.advice]


def _bounce_card(view: View, question: str, resolved: bool) -> AdviceCard:
    advice, line = [], math.nan
    for engine in view.engines:
        runs = [run for run in _settable(view, engine) if view.resolves_contact(run) == resolved]
        runs = best(view, runs)
        score = next((s for s in map(view.score, runs) if s is not None), None)
        if score is not None:
            line = score["constant_error_law"]
            advice.append(_bounce_advice(view, runs))
    at = f"{wording.alpha_short(view.main_alpha)}, {band_text(view)}"
    return AdviceCard(question, advice, f"At {at}. The best constant e is off by {wording.number(line)}.")


def _bounce_advice(view: View, runs: Sequence[RunKey]) -> Advice:
    scores = [score for score in map(view.score, runs) if score is not None]
    error = wording.number(max(score["max_error_law"] for score in scores)).lstrip("<")
    spread = max(score["phase_spread"] for score in scores)
    moved = f", {wording.number(spread)} between phases" if spread > 0.001 else ""
    because = f"e within {error} of the law{moved}: {verdict(view, runs[0]).restitution}."
    deep = [depth for run in runs if (depth := _depth(view, run)) > _SOFT]
    if deep:
        times = wording.span(f"{min(deep):.0f}", f"{max(deep):.0f}", " ")
        because += f" The contact is {times} times as deep as the law's: without gravity only, see the drop."
    return Advice(runs, because)


def _plugin_advice(view: View) -> list[Advice]:
    groups: dict[tuple[str, str], list[RunKey]] = {}
    for run in view.band_runs:
        if view.is_plugin(run) and view.score(run) is not None:
            groups.setdefault((run.engine, run.setting), []).append(run)
    return [_bounce_advice(view, runs) for runs in groups.values()]


def _loop_advice(view: View) -> list[Advice]:
    advice = []
    for engine in view.engines:
        runs = best_loops(view, _settable(view, engine))
        score = view.score(runs[0]) if runs else None
        if score is not None:
            force = f"Force off by {wording.percent(score['loop_rms'])} of its largest (rms)."
            advice.append(Advice(runs, f"{force} {_LOOP_MEANING[loop_verdict(view, runs[0])]}"))
    return advice


def _stock_advice(view: View, run: RunKey) -> Advice:
    curve = view.curve(run, view.main_alpha)
    if curve is None:
        return Advice([run], "No impact came back.")
    return Advice([run], f"e = {curve.range_text()}.")
