"""Which setting to use when: sentences and cards that follow from the ranking."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

from hcbench.laws import closed_form
from hcbench.reporting import wording
from hcbench.reporting.advised import error_of, scenes_of
from hcbench.reporting.ranking import (
    FOLLOWS_LAW,
    best,
    best_loops,
    error_ratio,
    lacks,
    loop_verdict,
    stock_runs,
    tie,
    verdict,
)
from hcbench.reporting.view import RunKey, View
from hcbench.units import INCH

# What a headline says of the verdict.
_PROMISES = {
    FOLLOWS_LAW: "the bounce follows the law",
    "better than any constant e": "closer to the law than any constant e",
    "as good as the best constant e": "the best constant e",
    "worse than the best constant e": "further from the law than the best constant e",
}
_SOFT = 3.0  # times the law's depth, beyond which the depth of a contact matters too
_SOFTER = ", without gravity and in a far softer contact"  # gravity would press it in far deeper
_LOOP_MEANING = {
    "loop right": "The loop is the law's.",
    "loop near": "The loop is near the law's.",
    "loop wrong": "The loop is that of another law.",
    "loop softer": "A softer contact than the law's.",
    "loop harder": "A harder contact than the law's.",
}


@dataclass(frozen=True, slots=True)
class Advice:
    """Runs that answer a question, with their numbers."""

    runs: Sequence[RunKey]
    because: str

    @property
    def title(self) -> str:
        """How the runs are named."""
        settings = wording.listed(list(dict.fromkeys(run.label for run in self.runs)), "or")
        return f"{wording.engine_title(self.runs[0].engine)} {settings}, {steps_text(self.runs)}"


@dataclass(frozen=True, slots=True)
class AdviceCard:
    """One question of a user, advice for each engine that has some, and what holds for all."""

    question: str
    advice: Sequence[Advice]
    note: str = ""


def headline(view: View) -> list[str]:
    """Which setting to use when: a sentence for engines with nothing set, and one for each engine."""
    if not view.engines:
        return ["The law alone: no engine ran over a band of speeds in this study."]
    sentences = [_stock_sentence(view), *(_engine_sentence(view, engine) for engine in view.engines)]
    return [sentence for sentence in sentences if sentence]


def _stock_sentence(view: View) -> str:
    off = dict.fromkeys(run.engine for run in stock_runs(view) if error_ratio(view, run) > 1 + tie(view))
    titles = [wording.engine_title(engine) for engine in off]
    if not titles:
        return ""
    if len(titles) == 1:
        return f"With nothing set {titles[0]} does not bounce like the law."
    return f"With nothing set neither {wording.listed(titles, 'nor')} bounces like the law."


def _engine_sentence(view: View, engine: str) -> str:
    """The best setting at each step that was tried, steps of one setting together."""
    runs = _settable(view, engine)
    promises: dict[str, dict[str, list[RunKey]]] = {}
    for step in _steps(runs):
        for run in best(view, [run for run in runs if run.timestep == step]):
            softer = _SOFTER if _depth(view, run) > _SOFT and not view.gravity else ""
            promise = _PROMISES[verdict(view, run).restitution] + softer
            promises.setdefault(promise, {}).setdefault(run.label, []).append(run)
    clauses = []
    for promise, settings in promises.items():
        where = [f"{setting} at {steps_text(runs)}" for setting, runs in settings.items()]
        error = _error_text(view, list(chain.from_iterable(settings.values())))
        over = _over(view, list(chain.from_iterable(settings.values())))
        within = f" (wrong by at most {error}, {over})" if view.gravity else ""
        clauses.append(f"{wording.listed(where, 'or')}: {promise}{within}")
    title = wording.engine_title(engine)
    if not clauses and runs and view.gravity:
        return f"In {title} no setting of this study both bounces and rests under gravity."
    return f"In {title} set {'; '.join(clauses)}." if clauses else ""


def _error_text(view: View, runs: Sequence[RunKey]) -> str:
    """The largest error of some runs at the main α."""
    return wording.number(max(error_of(view, run) for run in runs)).lstrip("<")


def _depth(view: View, run: RunKey) -> float:
    """Largest penetration over the law's; NaN where no loop is resolved."""
    score = view.score(run)
    return math.nan if score is None else float(score["penetration_ratio"])


def _settable(view: View, engine: str) -> list[RunKey]:
    """The engine's runs that are numbers to set, no plug-ins; without gravity over as many α as any ran."""
    runs = [run for run in view.band_runs if run.engine == engine and not view.is_plugin(run)]
    most = 0 if view.gravity else max((len(view.scores(run)) for run in runs), default=0)
    return [run for run in runs if len(view.scores(run)) >= most]


def plugin_sentence(view: View) -> str:
    """Plug-ins that follow the law, and where; "" where there are none."""
    settings: dict[str, list[RunKey]] = {}
    for run in view.band_runs:
        outcome = verdict(view, run)
        if view.is_plugin(run) and outcome.restitution == FOLLOWS_LAW and not outcome.lacks:
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
    """ "1 ms"; "1 ms, 2 ms or 1/240 s"; "1 µs … 2 ms" for more."""
    steps = [wording.time(h) for h in _steps(runs)]
    return wording.listed(steps, "or") if len(steps) < 4 else f"{steps[0]} … {steps[-1]}"


def band_text(view: View) -> str:
    """The impact speeds of the study: "0.025 … 0.51 m/s (1 … 20 in/s)"; of one in m/s, in m/s."""
    metres, inches = (wording.span(*(f"{v / unit:.2g}" for v in view.band)) for unit in (1.0, INCH))
    also = f" ({inches}{wording.NBSP}in/s)" if view.in_inches else ""
    return f"{metres}{wording.NBSP}m/s{also}"


def cards(view: View) -> list[AdviceCard]:
    """The page's advice; a question that nothing in this study answers is left out."""
    slow, fast = (f"{e:.2f}" for e in closed_form.restitution(view.main_alpha, view.band))
    contact = wording.rough_time(view.contact_time)
    if view.gravity:
        all_cards = [_step_card(view, step) for step in _steps(view.band_runs)]
    else:
        long = f"Long steps, which do not resolve a contact of {contact}"
        all_cards = [_bounce_card(view, long, resolved=False), *_contact_cards(view)]
    all_cards += [
        AdviceCard("A plug-in in your own simulation", _plugin_advice(view)),
        AdviceCard("Do not use under gravity", [_warning(view, run) for run in _spoilt(view)]),
        AdviceCard("With nothing set", _stock_advice(view), f"The law: e = {wording.span(slow, fast)}."),
    ]
    return [card for card in all_cards if card.advice]


def _contact_cards(view: View) -> list[AdviceCard]:
    contact = wording.rough_time(view.contact_time)
    return [
        _bounce_card(view, f"Short steps, which resolve the contact of {contact}", resolved=True),
        AdviceCard("Where the force matters, not only the bounce", _loop_advice(view)),
    ]


def cards_of_contact(view: View) -> list[AdviceCard]:
    """Advice about the contact alone, without gravity, on a page that judges steps under gravity."""
    plugins = [advice for advice in _plugin_advice(view) if all(map(view.resolves_contact, advice.runs))]
    cards = [*_contact_cards(view), AdviceCard("A plug-in for steps that resolve the contact", plugins)]
    return [replace(card, question=f"Without gravity: {card.question}") for card in cards if card.advice]


def _step_card(view: View, step: float) -> AdviceCard:
    """The best setting of each engine at one step under gravity."""
    advice, line = [], math.nan
    for engine in view.engines:
        runs = best(view, [run for run in _settable(view, engine) if run.timestep == step])
        score = next((s for s in map(view.score, runs) if s is not None), None)
        if score is not None:
            line = score["constant_error_law"]
            advice.append(_bounce_advice(view, runs))
    at = f"At {wording.alpha_short(view.main_alpha)}, {view.band_text(step)}"
    note = f"{at}. The best constant e is wrong by {wording.number(line)}."
    return AdviceCard(f"Under gravity at a step of {wording.time(step)}", advice, note)


def _spoilt(view: View) -> list[RunKey]:
    """Settings of a user's choice that lack something under gravity."""
    return [run for run in view.band_runs if lacks(view, run) and run not in stock_runs(view)]


def _warning(view: View, run: RunKey) -> Advice:
    outcome = verdict(view, run)
    error = f"e wrong by at most {_error_text(view, [run])}" if view.score(run) else outcome.restitution
    return Advice([run], f"{wording.sentence(wording.listed([error, *outcome.lacks]))}.")


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
    return AdviceCard(question, advice, f"At {at}. The best constant e is wrong by {wording.number(line)}.")


def _bounce_advice(view: View, runs: Sequence[RunKey]) -> Advice:
    scores = [score for score in map(view.score, runs) if score is not None]
    error = wording.error(max(error_of(view, run) for run in runs)).lstrip("<")
    spread = max(score["phase_spread"] for score in scores)
    moved = f" (varies by {wording.number(spread)} with the phase)" if spread > 0.001 else ""
    because = (
        f"e within {error} of the law{moved}, {_over(view, runs)}: {verdict(view, runs[0]).restitution}."
    )
    if all(scenes_of(view, run) for run in runs):
        because += f" Energy never grew in {sum(scenes_of(view, run) for run in runs)} launches and drops."
    rests = [rest for run in runs if (rest := view.rests.get(run)) is not None]
    if rests:
        because += f" It comes to rest, {wording.length(max(abs(rest.depth) for rest in rests))} deep."
    deep = [depth for run in runs if (depth := _depth(view, run)) > _SOFT]
    if deep and not view.gravity:
        times = wording.span(f"{min(deep):.0f}", f"{max(deep):.0f}", " ")
        because += f" The contact is {times} times as deep as the law's: use it without gravity only."
    return Advice(runs, because)


def _over(view: View, runs: Sequence[RunKey]) -> str:
    """The impact speeds of some runs: those of their step, or of several, each of which may cut them."""
    bands = list(dict.fromkeys(view.band_text(run.timestep) for run in runs))
    return bands[0] if len(bands) == 1 else f"{band_text(view)}, from 1.6 g h of each step on"


def _plugin_advice(view: View) -> list[Advice]:
    groups: dict[tuple[str, ...], list[RunKey]] = {}
    for run in view.band_runs:
        if view.is_plugin(run) and view.score(run) is not None and not lacks(view, run):
            words = verdict(view, run).restitution if view.gravity else ""
            groups.setdefault((run.engine, run.setting, words), []).append(run)
    return [_bounce_advice(view, runs) for runs in groups.values()]


def _loop_advice(view: View) -> list[Advice]:
    advice = []
    for engine in view.engines:
        runs = best_loops(view, _settable(view, engine))
        score = view.score(runs[0]) if runs else None
        if score is not None:
            force = f"Force wrong by {wording.percent(score['loop_rms'])} of its largest (rms)."
            advice.append(Advice(runs, f"{force} {_LOOP_MEANING[loop_verdict(view, runs[0])]}"))
    return advice


def _stock_advice(view: View) -> list[Advice]:
    """Engines with nothing set; steps with the same result together."""
    same: dict[tuple[str, str], list[RunKey]] = {}
    for run in stock_runs(view):
        curve = view.curve(run, view.main_alpha)
        text = f"e = {curve.range_text()}." if curve else "No body came back."
        stays = " It stays on the plate." if curve and not curve.high.any() else ""
        same.setdefault((run.engine, text + stays), []).append(run)
    return [Advice(runs, text) for (_, text), runs in same.items()]
