"""How well each run follows the law, by rules that the page states too; which runs are the best."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hcbench.report.view import REFERENCE, RunKey, View

STOCK = "stock"  # the setting with nothing set
FOLLOWS = 0.1  # of the best constant's error: from here down a setting follows the law
TIE, _ROUND_OFF = 0.02, 1e-6  # relative, and of the best constant's: errors this near are one
_NO_LINE = 1e-6  # of e: a law without damping leaves a constant nothing to be off by
FOLLOWS_LAW = "follows the law"
_AGAINST_CONSTANT = {
    "good": "better than any constant e",
    "even": "as good as one constant e can be",
    "bad": "worse than the best constant e",
}
LOOP_RIGHT, LOOP_NEAR = 0.01, 0.05  # rms over the largest force
_OTHER_SIZE = 2.0  # times the law's depth: a contact of another size, whatever its shape


@dataclass(frozen=True, slots=True)
class RunVerdict:
    """How one run did, in words. grade: "good", "even", "bad", for colour beside the words."""

    restitution: str
    grade: str
    loop: str


def over_constant(score: Mapping[str, Any]) -> float:
    """Largest error against (16) over the best constant's: above 1 a constant would do better."""
    return float(score["max_error_law"]) / max(float(score["constant_error_law"]), _NO_LINE)


def grade(ratio: float) -> str:
    """ "good", "even" or "bad" against the best constant."""
    return "good" if ratio < 1 - TIE else "even" if ratio <= 1 + TIE else "bad"


def error_ratio(view: View, run: RunKey) -> float:
    """`over_constant` of the worst α; inf for a run that gained energy, lost impacts or has no score."""
    scores = [score for score in view.scores(run) if math.isfinite(score["max_error_law"])]
    if any(score["failed"] or score["energy_gained"] for score in scores):
        return math.inf
    return max(map(over_constant, scores), default=math.inf)


def verdict(view: View, run: RunKey) -> RunVerdict:
    """The words for one run."""
    scores, ratio, loop = view.scores(run), error_ratio(view, run), loop_verdict(view, run)
    if any(score["energy_gained"] for score in scores):
        return RunVerdict("gains energy", "bad", loop)
    if any(score["failed"] for score in scores):
        return RunVerdict("loses impacts", "bad", loop)
    if ratio <= FOLLOWS:
        return RunVerdict(FOLLOWS_LAW, "good", loop)
    return RunVerdict(_AGAINST_CONSTANT[grade(ratio)], grade(ratio), loop)


def loop_verdict(view: View, run: RunKey) -> str:
    """What there is to say of a run's loops at the main α."""
    score = view.score(run)
    if score is None or not score["loops"]:
        return "no loop to judge"
    rms, depth = score["loop_rms"], score["penetration_ratio"]
    if rms <= LOOP_NEAR:
        return "loop right" if rms <= LOOP_RIGHT else "loop near"
    if depth > _OTHER_SIZE:
        return "loop softer"
    return "loop harder" if depth < 1 / _OTHER_SIZE else "loop wrong"


def best(view: View, runs: Sequence[RunKey]) -> list[RunKey]:
    """Of runs that are set, those with the least error: several where they tie, none where none has one."""
    return _least(runs, lambda run: error_ratio(view, run), _ROUND_OFF)


def best_loops(view: View, runs: Sequence[RunKey]) -> list[RunKey]:
    """Of runs that are set, those with the smallest rms distance in force at the main α."""

    def rms(run: RunKey) -> float:
        score = view.score(run)
        judged = score is not None and score["loops"] and not score["energy_gained"]
        return float(score["loop_rms"]) if score is not None and judged else math.inf

    return _least(runs, rms)


def _least(runs: Sequence[RunKey], error: Callable[[RunKey], float], margin: float = 0.0) -> list[RunKey]:
    """An engine as it comes is no advice: a user who asks has that already."""
    errors = {run: error(run) for run in runs if run.engine != REFERENCE and run.setting != STOCK}
    least = min(errors.values(), default=math.inf)
    return [run for run, e in errors.items() if math.isfinite(e) and e <= least * (1 + TIE) + margin]


def stock_runs(view: View) -> list[RunKey]:
    """Engines as they come."""
    return [run for run in view.band_runs if run.setting == STOCK]


def overview_runs(view: View) -> list[RunKey]:
    """What the one-picture figure shows: engines as they come, and each engine's best in either class."""
    picked = stock_runs(view)
    for resolved in (False, True):
        for engine in view.engines:
            shown = [run for run in view.runs_by_resolution(resolved) if run.engine == engine]
            picked += best(view, [r for r in shown if r not in picked and not view.is_plugin(r)])[:1]
    return list(dict.fromkeys(picked))
