"""Ranking of the runs by their agreement with the law, by rules that the page states too."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hcbench.reporting import wording
from hcbench.reporting.advised import answer_of, best_of, choice_of, error_of
from hcbench.reporting.view import REFERENCE, STOCK, RunKey, View
from hcbench.terms.resolution import FOLLOWS, ROUND_OFF_SCORE

TIE = 0.02  # relative: errors this near are one
TIE_HEAVY = 0.25  # under gravity, where phases of the fall alone scatter e
# Of e: a law without damping leaves a constant nothing to be off by
_NO_LINE = 1e-6
FOLLOWS_LAW = "follows the law"
_AGAINST_CONSTANT = {
    "good": "better than any constant e",
    "even": "as good as the best constant e",
    "bad": "worse than the best constant e",
}
LOOP_RIGHT, LOOP_NEAR = 0.01, 0.05  # rms over the largest force
# Under gravity, at rest after a drop: depth and motion in units of g h², what gravity moves a body in a step.
REST_DEPTH, REST_MOTION = 10.0, 1.0
# Times v h at the top speed, which any contact needs that acts from one step to the next
DEEP = 2.5
# Times the law's depth: a contact of another size, regardless of its shape
_OTHER_SIZE = 2.0


@dataclass(frozen=True, slots=True)
class RunVerdict:
    """Verdict on one run, in words. grade: "good", "even", "bad", for colour beside the words.

    lacks: what keeps it from being used under gravity.
    """

    restitution: str
    grade: str
    loop: str
    lacks: tuple[str, ...] = ()


def over_constant(view: View, run: RunKey, alpha: float) -> float:
    """Largest error against the law over the best constant's: above 1 a constant would do better; NaN for no
    score.
    """
    score = view.score(run, alpha)
    line = math.nan if score is None else float(score["constant_error_law"])
    return error_of(view, run, alpha) / max(line, _NO_LINE)


def grade(view: View, ratio: float) -> str:
    """ "good", "even" or "bad" against the best constant."""
    return "good" if ratio < 1 - TIE else "even" if ratio <= 1 + tie(view) else "bad"


def tie(view: View) -> float:
    """Up to what share above the best constant's error a setting counts as good as it."""
    return TIE_HEAVY if view.gravity else TIE


def error_ratio(view: View, run: RunKey) -> float:
    """`over_constant` of the main α under gravity, else of the worst α.

    inf for a run that gained energy, lost impacts or has no score.
    """
    if any(score["failed"] or score["energy_gained"] for score in _judged(view, run)):
        return math.inf
    alphas = [view.main_alpha] if view.gravity else view.alphas
    ratios = [over_constant(view, run, alpha) for alpha in alphas]
    return max((ratio for ratio in ratios if math.isfinite(ratio)), default=math.inf)


def _judged(view: View, run: RunKey) -> list[Mapping[str, Any]]:
    """The scores that a verdict goes by: under gravity settings are fitted for the main α."""
    score = view.score(run)
    if view.gravity:
        return [] if score is None else [score]
    return view.scores(run)


def lacks(view: View, run: RunKey) -> tuple[str, ...]:
    """Reasons not to use a run under gravity, in words; empty if it ran without gravity."""
    rest, reasons = view.rests.get(run), []
    if rest is not None:
        advised = choice_of(view, run)
        if not lies_still(view, run):  # one that `tune` saw at rest after 30 s is slow to
            reasons += [] if advised is not None and advised["rests"] else ["does not come to rest"]
        elif rest.depth > REST_DEPTH * view.gravity * run.timestep**2:
            reasons.append(f"sinks {wording.length(rest.depth)} at rest")
    deep = view.depths.get(run, math.nan) / (view.band[1] * run.timestep)
    if view.gravity and deep > DEEP:
        reasons.append(f"goes {wording.length(view.depths[run])} deep in a bounce")
    return tuple(reasons)


def lies_still(view: View, run: RunKey) -> bool:
    """Say whether a run's body had come to rest at the end of its drop."""
    rest = view.rests.get(run)
    return rest is not None and rest.motion <= REST_MOTION * view.gravity * run.timestep**2


def verdict(view: View, run: RunKey) -> RunVerdict:
    """The words for one run."""
    scores, ratio, loop = _judged(view, run), error_ratio(view, run), loop_verdict(view, run)
    wanting = lacks(view, run)
    if any(score["energy_gained"] for score in scores):
        return RunVerdict("gains energy", "bad", loop, wanting)
    if any(score["failed"] for score in scores):
        return RunVerdict("loses impacts", "bad", loop, wanting)
    words = FOLLOWS_LAW if ratio <= FOLLOWS else _AGAINST_CONSTANT[grade(view, ratio)]
    return RunVerdict(words, "bad" if wanting else grade(view, ratio), loop, wanting)


def loop_verdict(view: View, run: RunKey) -> str:
    """Verdict on a run's loops at the main α, in words."""
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
    """Select the runs with the least error among those that are set and lack nothing: several if
    they tie.

    If `tune` has advised a setting for their one step, those with that setting.
    """
    known = {(run.engine, run.timestep): answer_of(view, run.engine, run.timestep) for run in runs}
    if len(known) == 1 and (answer := next(iter(known.values()))) is not None:
        advised = [run for run in runs if run.setting == best_of(answer)["setting"]]
        if advised:
            return advised
    usable = [run for run in runs if not lacks(view, run)]
    return _least(usable, lambda run: error_ratio(view, run), ROUND_OFF_SCORE)


def _least(runs: Sequence[RunKey], error: Callable[[RunKey], float], margin: float = 0.0) -> list[RunKey]:
    """Select the runs with the least error, engines with nothing set left out: a user who asks has
    those already.
    """
    errors = {run: error(run) for run in runs if run.engine != REFERENCE and run.setting != STOCK}
    least = min(errors.values(), default=math.inf)
    return [run for run, e in errors.items() if math.isfinite(e) and e <= least * (1 + TIE) + margin]


def stock_runs(view: View) -> list[RunKey]:
    """Engines with nothing set."""
    return [run for run in view.band_runs if run.setting == STOCK]


def advised(view: View) -> list[str]:
    """A sentence on engines with nothing set, and one on each engine's best setting at each step."""
    wrong = dict.fromkeys(run.engine for run in stock_runs(view) if error_ratio(view, run) > 1 + tie(view))
    titles = wording.listed([wording.engine_title(engine) for engine in wrong], "nor")
    sentences = [f"With nothing set {titles} does not bounce like the law."] if titles else []
    runs = [run for run in view.band_runs if run not in stock_runs(view)]
    for engine, step in dict.fromkeys((run.engine, run.timestep) for run in runs):
        for run in best(view, [run for run in runs if (run.engine, run.timestep) == (engine, step)])[:1]:
            error = wording.error(error_of(view, run))
            words = verdict(view, run).restitution
            sentences.append(f"{run.title}, step {run.step}: wrong by at most {error}, {words}.")
    return sentences


def overview_runs(view: View) -> list[RunKey]:
    """Runs of the overview figure: engines with nothing set, and each engine's best.

    Under gravity at its shortest step, else in either class of steps.
    """
    picked = stock_runs(view)
    if view.gravity:
        picked = [run for run in picked if run.timestep == min(o.timestep for o in picked if o[0] == run[0])]
        groups = [[r for r in view.band_runs if r.timestep == h] for h in {run.timestep for run in picked}]
    else:
        groups = [view.runs_by_resolution(resolved) for resolved in (False, True)]
    for group in groups:
        for engine in view.engines:
            shown = [run for run in group if run.engine == engine and run not in picked]
            picked += best(view, [run for run in shown if not view.is_plugin(run)])[:1]
            if view.gravity:
                picked += best(view, [run for run in shown if view.is_plugin(run)])[:1]
    return list(dict.fromkeys(picked))
