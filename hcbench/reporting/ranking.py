"""Ranking of the runs by their agreement with the law, by rules that the page states too."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hcbench.reporting import wording
from hcbench.reporting.answers import answer_of, best_of, choice_of, error_of
from hcbench.reporting.view import REFERENCE, STOCK, RunKey, View
from hcbench.terms.resolution import FOLLOWS, ROUND_OFF_SCORE

# Errors that differ relatively by less are one.
TIE = 0.02
# The same under gravity, where the phases of the fall alone scatter e.
TIE_HEAVY = 0.25
# Errors of the best constant e below this leave nothing to compare with: the law has no damping.
_NO_LINE = 1e-6
FOLLOWS_LAW = "follows the law"
_AGAINST_CONSTANT = {
    "good": "better than any constant e",
    "even": "as good as the best constant e",
    "bad": "worse than the best constant e",
}
# Limits of the rms difference of a loop, as a share of the largest force.
LOOP_RIGHT = 0.01
LOOP_NEAR = 0.05
# Under gravity, at rest after a drop: depth and motion in units of g h², what
# gravity moves a body in a step.
REST_DEPTH = 10.0
REST_MOTION = 1.0
# Multiple of v h at the top speed: a contact that acts from one step to the next needs that depth.
DEEP = 2.5
# From this multiple of the law's depth a contact has another size, regardless of its shape.
_OTHER_SIZE = 2.0


@dataclass(frozen=True, slots=True)
class RunVerdict:
    """Verdict on one run, in words.

    grade: "good", "even", "bad", for colour beside the words.

    lacks: what keeps it from being used under gravity.
    """

    restitution: str
    grade: str
    loop: str
    lacks: tuple[str, ...] = ()


def over_constant(view: View, run: RunKey, alpha: float) -> float:
    """Largest error against the law over the best constant's: above 1 a constant
    would do better; NaN for no score.
    """
    score = view.score(run, alpha)
    line = math.nan if score is None else float(score["constant_error_law"])
    return error_of(view, run, alpha) / max(line, _NO_LINE)


def grade(view: View, ratio: float) -> str:
    """ "good", "even" or "bad" against the best constant.

    ratio: of the largest error to the best constant's.
    """
    if ratio < 1 - TIE:
        return "good"
    if ratio <= 1 + tie(view):
        return "even"
    return "bad"


def tie(view: View) -> float:
    """Up to what share above the best constant's error a setting counts as good as it."""
    return TIE_HEAVY if view.gravity else TIE


def error_ratio(view: View, run: RunKey) -> float:
    """`over_constant` of the main α under gravity, else of the worst α.

    inf for a run that gained energy, lost impacts or has no score.
    """
    if any(score["failed"] or score["energy_gained"] for score in _judged(view, run)):
        return math.inf
    alphas = view.alphas
    if view.gravity:
        alphas = [view.main_alpha]
    ratios = [over_constant(view, run, alpha) for alpha in alphas]
    return max(filter(math.isfinite, ratios), default=math.inf)


def _judged(view: View, run: RunKey) -> list[Mapping[str, Any]]:
    """The scores that a verdict goes by: under gravity settings are fitted for the main α."""
    if not view.gravity:
        return view.scores(run)
    score = view.score(run)
    if score is None:
        return []
    return [score]


def lacks(view: View, run: RunKey) -> tuple[str, ...]:
    """Reasons not to use a run under gravity, in words; empty if it ran without gravity."""
    reasons = []
    rest = view.rests.get(run)
    if rest is not None:
        if not lies_still(view, run):
            advised = choice_of(view, run)
            # One that `tune` saw at rest after 30 s is slow to come to rest.
            rests_later = advised is not None and advised["rests"]
            if not rests_later:
                reasons.append("does not come to rest")
        elif rest.depth > REST_DEPTH * view.gravity * run.timestep**2:
            reasons.append(f"sinks {wording.length(rest.depth)} at rest")
    if view.gravity:
        depth = view.depths.get(run, math.nan)
        if depth / (view.band[1] * run.timestep) > DEEP:
            reasons.append(f"goes {wording.length(depth)} deep in a bounce")
    return tuple(reasons)


def lies_still(view: View, run: RunKey) -> bool:
    """Say whether a run's body had come to rest at the end of its drop."""
    rest = view.rests.get(run)
    return rest is not None and rest.motion <= REST_MOTION * view.gravity * run.timestep**2


def verdict(view: View, run: RunKey) -> RunVerdict:
    """The words for one run.

    Energy that is gained weighs most, then lost impacts, then the error against the best
    constant's.
    """
    scores = _judged(view, run)
    loop = loop_verdict(view, run)
    wanting = lacks(view, run)
    if any(score["energy_gained"] for score in scores):
        return RunVerdict("gains energy", "bad", loop, wanting)
    if any(score["failed"] for score in scores):
        return RunVerdict("loses impacts", "bad", loop, wanting)
    ratio = error_ratio(view, run)
    against_constant = grade(view, ratio)
    words = _AGAINST_CONSTANT[against_constant]
    if ratio <= FOLLOWS:
        words = FOLLOWS_LAW
    shown_grade = against_constant
    if wanting:
        shown_grade = "bad"
    return RunVerdict(words, shown_grade, loop, wanting)


def loop_verdict(view: View, run: RunKey) -> str:
    """Verdict on a run's loops at the main α, in words."""
    score = view.score(run)
    if score is None or not score["loops"]:
        return "no loop to judge"
    rms = score["loop_rms"]
    depth = score["penetration_ratio"]
    if rms <= LOOP_RIGHT:
        return "loop right"
    if rms <= LOOP_NEAR:
        return "loop near"
    if depth > _OTHER_SIZE:
        return "loop softer"
    if depth < 1 / _OTHER_SIZE:
        return "loop harder"
    return "loop wrong"


def best(view: View, runs: Sequence[RunKey]) -> list[RunKey]:
    """Select the runs with the least error among those that are set and lack nothing: several if
    they tie.

    If `tune` has advised a setting for their one step, those with that setting.
    """
    conditions = {(run.engine, run.timestep) for run in runs}
    if len(conditions) == 1:
        (condition,) = conditions
        answer = answer_of(view, *condition)
        if answer is not None:
            setting = best_of(answer)["setting"]
            advised = [run for run in runs if run.setting == setting]
            if advised:
                return advised
    usable = [run for run in runs if not lacks(view, run)]
    return _least(usable, lambda run: error_ratio(view, run), ROUND_OFF_SCORE)


def _least(
    runs: Sequence[RunKey], error: Callable[[RunKey], float], margin: float = 0.0
) -> list[RunKey]:
    """Select the runs with the least error, engines with nothing set left out: a user who asks has
    those already.

    margin: of e, that counts as a tie besides the share TIE. Runs without a finite error are left
    out.
    """
    errors = {}
    for run in runs:
        if run.engine != REFERENCE and run.setting != STOCK:
            errors[run] = error(run)
    least = min(errors.values(), default=math.inf)
    tied = least * (1 + TIE) + margin
    return [run for run, value in errors.items() if math.isfinite(value) and value <= tied]


def stock_runs(view: View) -> list[RunKey]:
    """Engines with nothing set."""
    return [run for run in view.band_runs if run.setting == STOCK]


def advised(view: View) -> list[str]:
    """A sentence on engines with nothing set, and one on each engine's best setting at each step."""
    sentences = []
    # Titles of the engines, each once.
    wrong = {}
    for run in stock_runs(view):
        if error_ratio(view, run) > 1 + tie(view):
            wrong[run.engine] = wording.engine_title(run.engine)
    if wrong:
        titles = wording.listed(list(wrong.values()), "nor")
        sentences.append(f"With nothing set {titles} does not bounce like the law.")
    runs_at: dict[tuple[str, float], list[RunKey]] = {}
    for run in view.band_runs:
        if run.setting != STOCK:
            runs_at.setdefault((run.engine, run.timestep), []).append(run)
    for runs in runs_at.values():
        for run in best(view, runs)[:1]:
            error = wording.error(error_of(view, run))
            words = verdict(view, run).restitution
            sentences.append(f"{run.title}, step {run.step}: wrong by at most {error}, {words}.")
    return sentences


def overview_runs(view: View) -> list[RunKey]:
    """Runs of the overview figure: engines with nothing set, and each engine's best.

    Under gravity at its shortest step, else in either class of steps.
    """
    picked = stock_runs(view)
    groups: list[list[RunKey]] = []
    if view.gravity:
        picked = _at_shortest_step(picked)
        for step in {run.timestep for run in picked}:
            at_step = [run for run in view.band_runs if run.timestep == step]
            groups.append(at_step)
    else:
        groups.append(view.runs_by_resolution(False))
        groups.append(view.runs_by_resolution(True))
    for group in groups:
        for engine in view.engines:
            by_settings = []
            by_plugin = []
            for run in group:
                if run.engine != engine or run in picked:
                    continue
                if view.is_plugin(run):
                    by_plugin.append(run)
                else:
                    by_settings.append(run)
            picked += best(view, by_settings)[:1]
            if view.gravity:
                picked += best(view, by_plugin)[:1]
    return list(dict.fromkeys(picked))


def _at_shortest_step(runs: Sequence[RunKey]) -> list[RunKey]:
    """Those at the shortest step of their engine."""
    shortest: dict[str, float] = {}
    for run in runs:
        shortest[run.engine] = min(run.timestep, shortest.get(run.engine, math.inf))
    return [run for run in runs if run.timestep == shortest[run.engine]]
