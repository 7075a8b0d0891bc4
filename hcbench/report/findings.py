"""What the page says in words, derived from the scores by rules that the page states too."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hcbench.report import words
from hcbench.report.view import REFERENCE, Run, View

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

STOCK = "stock"  # the setting with nothing set
FOLLOWS = 0.1  # of the best constant's error: from here down a setting follows the law
_TIE, _ROUND_OFF = 0.02, 1e-6  # relative, and of the best constant's: errors this near are one
_NO_LINE = 1e-6  # of e: a law without damping leaves a constant nothing to be off by
_BOUNCE_WORDS = {
    "good": "better than any constant e",
    "even": "as good as one constant e can be",
    "bad": "worse than the best constant e",
}
LOOP_RIGHT, LOOP_NEAR = 0.01, 0.05  # rms over the largest force


@dataclass(frozen=True, slots=True)
class Verdict:
    """How one run did, in words. grade: "good", "even", "bad", for colour beside the words."""

    restitution: str
    grade: str
    loop: str


@dataclass(frozen=True, slots=True)
class Card:
    """One question of a user, the runs that answer it best, and the numbers behind."""

    question: str
    runs: Sequence[Run]
    answer: str
    because: str


def over_line(score: Mapping[str, Any]) -> float:
    """Largest error against (16) over the best constant's: above 1 a constant would do better."""
    return float(score["max_error_law"]) / max(float(score["constant_error_law"]), _NO_LINE)


def grade(ratio: float) -> str:
    """ "good", "even" or "bad" against the best constant."""
    return "good" if ratio < 1 - _TIE else "even" if ratio <= 1 + _TIE else "bad"


def ratio(view: View, run: Run) -> float:
    """`over_line` of the worst α; inf for a run that gained energy, lost impacts or has no score."""
    found = []
    for alpha in view.alphas:
        score = view.score(run, alpha)
        if score is None or not math.isfinite(score["max_error_law"]):
            continue
        if score["failed"] or score["energy_gained"]:
            return math.inf
        found.append(over_line(score))
    return max(found, default=math.inf)


def verdict(view: View, run: Run) -> Verdict:
    """The words for one run."""
    scores = [s for s in (view.score(run, alpha) for alpha in view.alphas) if s is not None]
    worst = ratio(view, run)
    if any(score["energy_gained"] for score in scores):
        bounce = "gains energy", "bad"
    elif any(score["failed"] for score in scores):
        bounce = "loses impacts", "bad"
    elif worst <= FOLLOWS:
        bounce = "follows the law", "good"
    else:
        bounce = _BOUNCE_WORDS[grade(worst)], grade(worst)
    return Verdict(*bounce, loop=_loop_words(view, run))


def _loop_words(view: View, run: Run) -> str:
    score = view.score(run, view.main_alpha)
    if score is None or not score["loops"]:
        return "no loop to judge"
    off = score["loop_rms"]
    return "loop right" if off <= LOOP_RIGHT else "loop near" if off <= LOOP_NEAR else "loop wrong"


def best(view: View, runs: Sequence[Run]) -> list[Run]:
    """The set runs with the least ratio; more than one where they tie; none where nothing can be ranked.

    An engine as it comes is no advice: a user who asks has that already.
    """
    ranked = {r: ratio(view, r) for r in runs if r.engine != REFERENCE and r.setting != STOCK}
    least = min(ranked.values(), default=math.inf)
    return [run for run, r in ranked.items() if math.isfinite(r) and r <= least * (1 + _TIE) + _ROUND_OFF]


def best_loops(view: View) -> list[Run]:
    """The set run with the smallest rms distance in force at the main α."""
    off = {}
    for run in view.band_runs:
        score = view.score(run, view.main_alpha)
        judged = score is not None and score["loops"] and not score["energy_gained"]
        if score is not None and judged and run.engine != REFERENCE and run.setting != STOCK:
            off[run] = score["loop_rms"]
    least = min(off.values(), default=math.inf)
    return [run for run, value in off.items() if value <= least * (1 + _TIE)]


def stock_runs(view: View) -> list[Run]:
    """Engines as they come."""
    return [run for run in view.band_runs if run.setting == STOCK]


def names(runs: Sequence[Run], last: str = "or") -> str:
    """ "MuJoCo impulse or PyBullet restitution"; "MuJoCo or PyBullet spring-damper"."""
    engines: dict[str, list[str]] = {}
    for run in runs:
        engines.setdefault(run.setting, []).append(words.engine_name(run.engine))
    said = [f"{words.listed(list(dict.fromkeys(e)), last)} {setting}" for setting, e in engines.items()]
    return words.listed(said, last)


def headline(view: View) -> str:
    """Which setting to use when, in two or three sentences."""
    coarse, fine = (best(view, [r for r in view.band_runs if view.is_fine(r) == f]) for f in (False, True))
    advice = [f"at a step of {_steps(runs)} set {names(runs)}" for runs in (coarse, fine) if runs]
    said = [_stock_sentence(view)]
    if advice:
        sentence = "; ".join(advice).replace("; at a step of", "; at", 1)
        said.append(f"{sentence[0].upper()}{sentence[1:]}.")
    picked = coarse + fine
    if picked and all(ratio(view, run) >= 1 - _TIE for run in picked):
        said.append("Each gives one e for all speeds; none follows the law.")
    if not view.engines:
        said.append("The law alone: no engine ran over a band of speeds in this study.")
    return " ".join(sentence for sentence in said if sentence)


def _stock_sentence(view: View) -> str:
    bad = list(dict.fromkeys(r.engine for r in stock_runs(view) if ratio(view, r) > 1 + _TIE))
    named = [words.engine_name(engine) for engine in bad]
    if not named:
        return ""
    if len(named) == 1:
        return f"Out of the box {named[0]} does not bounce like the law."
    return f"Out of the box neither {words.listed(named, 'nor')} bounces like the law."


def _steps(runs: Sequence[Run]) -> str:
    return words.listed([words.time(h) for h in sorted({run.timestep for run in runs})], "or")


def cards(view: View) -> list[Card]:
    """The page's answers, best first; a question without an answer in this study is left out."""
    inside = words.about(view.contact_time)
    groups = [
        (f"Long steps, blind to a contact of {inside}", False),
        (f"Short steps, which see the contact of {inside}", True),
    ]
    out = []
    for question, fine in groups:
        runs = best(view, [run for run in view.band_runs if view.is_fine(run) == fine])
        if runs:
            out.append(Card(question, runs, f"{names(runs)}, {_steps(runs)}", _because(view, runs)))
    loops = best_loops(view)
    if loops:
        out.append(
            Card("The force matters, not only the bounce", loops, names(loops), _loop_reason(view, loops))
        )
    stock = stock_runs(view)
    if stock:
        out.append(Card("Nothing set at all", stock, names(stock, "and"), _stock_reason(view, stock)))
    return out


def _because(view: View, runs: Sequence[Run]) -> str:
    score = view.score(runs[0], view.main_alpha)
    if score is None:
        return ""
    error, line = score["max_error_law"], score["constant_error_law"]
    at = f"at {words.alpha_short(view.main_alpha)}, {band(view)}"
    text = f"e is within {words.small(error).lstrip('<')} of the law {at}. "
    text += {
        "good": f"The best constant e is off by {words.small(line)}.",
        "even": "That is all that one constant e can do.",
        "bad": f"The best constant e would be within {words.small(line)}.",
    }[verdict(view, runs[0]).grade]
    spread = max((view.score(r, view.main_alpha) or {}).get("phase_spread", math.nan) for r in runs)
    if spread > 0.001:
        text += f" Where in the step the touch falls moves it by {words.small(spread)}."
    return text


def _loop_reason(view: View, runs: Sequence[Run]) -> str:
    score = view.score(runs[0], view.main_alpha) or {}
    off = score["loop_rms"]
    text = f"Forces are {words.percent(off)} of the largest away from the law's (rms over the loop). "
    text += {
        "loop right": "The loop is the law's.",
        "loop near": "The loop is near the law's.",
        "loop wrong": "That is the nearest there is here, and it is another law's loop.",
    }[_loop_words(view, runs[0])]
    return text


def _stock_reason(view: View, runs: Sequence[Run]) -> str:
    said = []
    for run in runs:
        curve = view.curve(run, view.main_alpha)
        if curve is None:
            said.append(f"{words.engine_name(run.engine)}: no impact came back.")
            continue
        low, high = curve.low.min(), curve.high.max()
        span = f"{low:.2f}" if high - low < 0.005 else f"{low:.2f} … {high:.2f}"
        said.append(f"{words.engine_name(run.engine)} at {words.time(run.timestep)}: e = {span}.")
    truth = view.curve(runs[0], view.main_alpha)
    if truth is not None:
        ends = view.truth(view.main_alpha, truth.speed[[0, -1]])
        said.append(f"The law: {ends[0]:.2f} … {ends[1]:.2f}.")
    return " ".join(said)


def band(view: View) -> str:
    """ "1 … 20 in/s"."""
    speeds = [float(v) / words.INCH for v in view.study["speeds"]]
    if min(speeds) == max(speeds):
        return f"{speeds[0]:.3g}{words.NBSP}in/s"
    return f"{min(speeds):.3g}{words.NBSP}…{words.NBSP}{max(speeds):.3g}{words.NBSP}in/s"


def overview_runs(view: View) -> list[Run]:
    """What the one-picture figure shows: engines as they come, and each engine's best in either class."""
    picked = stock_runs(view)
    for fine in (False, True):
        for engine in view.engines:
            group = [r for r in view.of_class(fine) if r.engine == engine and r not in picked]
            picked += best(view, group)[:1]
    return list(dict.fromkeys(picked))
