"""What the page says in words, derived from the scores by rules that the page states too."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hcbench.report import wording
from hcbench.report.view import REFERENCE, Run, View

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

STOCK = "stock"  # the setting with nothing set
FOLLOWS = 0.1  # of the best constant's error: from here down a setting follows the law
TIE, _ROUND_OFF = 0.02, 1e-6  # relative, and of the best constant's: errors this near are one
_NO_LINE = 1e-6  # of e: a law without damping leaves a constant nothing to be off by
_BOUNCE_WORDS = {
    "good": "better than any constant e",
    "even": "as good as one constant e can be",
    "bad": "worse than the best constant e",
}
LOOP_RIGHT, LOOP_NEAR = 0.01, 0.05  # rms over the largest force
_OTHER = 2.0  # times the law's depth: a contact of another size, whatever its shape


@dataclass(frozen=True, slots=True)
class Verdict:
    """How one run did, in words. grade: "good", "even", "bad", for colour beside the words."""

    restitution: str
    grade: str
    loop: str


def over_line(score: Mapping[str, Any]) -> float:
    """Largest error against (16) over the best constant's: above 1 a constant would do better."""
    return float(score["max_error_law"]) / max(float(score["constant_error_law"]), _NO_LINE)


def grade(ratio: float) -> str:
    """ "good", "even" or "bad" against the best constant."""
    return "good" if ratio < 1 - TIE else "even" if ratio <= 1 + TIE else "bad"


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
    return Verdict(*bounce, loop=loop_words(view, run))


def loop_words(view: View, run: Run) -> str:
    """What there is to say of a run's loops at the main α."""
    score = view.score(run, view.main_alpha)
    if score is None or not score["loops"]:
        return "no loop to judge"
    off, deeper = score["loop_rms"], score["penetration_ratio"]
    if off <= LOOP_NEAR:
        return "loop right" if off <= LOOP_RIGHT else "loop near"
    return "loop softer" if deeper > _OTHER else "loop harder" if deeper < 1 / _OTHER else "loop wrong"


def best(view: View, runs: Sequence[Run]) -> list[Run]:
    """Of runs that are set, those with the least ratio: several where they tie, none where none has one.

    An engine as it comes is no advice: a user who asks has that already.
    """
    ranked = {r: ratio(view, r) for r in runs if r.engine != REFERENCE and r.setting != STOCK}
    least = min(ranked.values(), default=math.inf)
    return [run for run, r in ranked.items() if math.isfinite(r) and r <= least * (1 + TIE) + _ROUND_OFF]


def best_loops(view: View, runs: Sequence[Run]) -> list[Run]:
    """Of runs that are set, those with the smallest rms distance in force at the main α."""
    off = {}
    for run in runs:
        score = view.score(run, view.main_alpha)
        judged = score is not None and score["loops"] and not score["energy_gained"]
        if score is not None and judged and run.engine != REFERENCE and run.setting != STOCK:
            off[run] = score["loop_rms"]
    least = min(off.values(), default=math.inf)
    return [run for run, value in off.items() if value <= least * (1 + TIE)]


def stock_runs(view: View) -> list[Run]:
    """Engines as they come."""
    return [run for run in view.band_runs if run.setting == STOCK]


def band(view: View) -> str:
    """ "1 … 20 in/s"."""
    speeds = [float(v) / wording.INCH for v in view.study["speeds"]]
    if min(speeds) == max(speeds):
        return f"{speeds[0]:.3g}{wording.NBSP}in/s"
    return f"{min(speeds):.3g}{wording.NBSP}…{wording.NBSP}{max(speeds):.3g}{wording.NBSP}in/s"


def overview_runs(view: View) -> list[Run]:
    """What the one-picture figure shows: engines as they come, and each engine's best in either class."""
    picked = stock_runs(view)
    for fine in (False, True):
        for engine in view.engines:
            shown = [r for r in view.of_class(fine) if r.engine == engine]
            group = [r for r in shown if r not in picked and not view.is_plugin(r)]
            picked += best(view, group)[:1]
    return list(dict.fromkeys(picked))
