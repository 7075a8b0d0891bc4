"""First screen of the page: the answers of `hcbench tune`, and the ranking of the runs."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hcbench.reporting import wording
from hcbench.reporting.view import REFERENCE, STOCK, RunKey, View
from hcbench.terms.resolution import FOLLOWS, ROUND_OFF_SCORE

# First screen of the page: the answer of `hcbench tune` for an engine, a step, a gravity and an α,
# in words.

_VERBS = {"exact": "Attach", "settings": "Set", "constant": "Set"}


@dataclass(frozen=True, slots=True)
class PageChoice:
    """One of an answer's choices, for the page's first screen.

    kind: "exact", "settings" or "constant".
    setting: its name.
    error: the largest of e over the band.
    band: lowest and highest impact speed, m/s.
    say: one sentence with its error and band.
    more: sentences on what else to know of it; some are empty.
    text: to paste.
    shown: the runs to draw, its own first and then stock.
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

    view: results under the answer's gravity.
    answer, choice: as the JSON of `hcbench tune`.
    """
    kind = str(choice["kind"])
    setting = str(choice["setting"])
    alpha = float(answer["alpha"])
    timestep = float(answer["timestep"])
    # The run with this setting, and the engine with nothing set, as far as the study has them.
    drawn = []
    for run in view.band_runs:
        here = run.engine == answer["engine"] and run.timestep == timestep
        if here and run.setting in (setting, STOCK) and view.score(run, alpha) is not None:
            drawn.append(run)
    drawn.sort(key=lambda run: run.setting != setting)
    bodies = ", for spheres" if choice["passive"]["flat"] is False else ""
    return PageChoice(
        kind=kind,
        setting=setting,
        error=float(choice["max_error"]),
        band=[float(speed) for speed in choice["speeds_m_per_s"]],
        say=f"{_VERBS[kind]} {setting}: {choice['within']}{bodies}.",
        more=list(_more(answer, choice)),
        text=str(choice["text"]),
        shown=drawn,
    )


def _more(answer: Mapping[str, Any], choice: Mapping[str, Any]) -> Iterator[str]:
    """Sentences on what else to know of a choice; some are empty.

    answer, choice: as the JSON of `hcbench tune`.
    """
    # The answer's caution is about the engine's own contact: the first choice of it says it.
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
    """The answers of `hcbench tune`, as JSON, under the view's gravity, for the engines and steps
    that ran over a band of speeds.
    """
    ran = {(run.engine, run.timestep) for run in view.band_runs}
    for answer in view.answers.values():
        if (answer["engine"], answer["timestep"]) in ran and math.isclose(
            answer["gravity"], view.gravity
        ):
            yield answer


def answer_of(
    view: View, engine: str, timestep: float, alpha: float | None = None
) -> Mapping[str, Any] | None:
    """The answer of `tune`, as JSON, for an engine, a step and an α; None where no answer is known.

    timestep: s.
    alpha: s/m; None for the view's main one.
    """
    return view.answers.get(
        (engine, timestep, f"{view.main_alpha if alpha is None else alpha:.9g}")
    )


def best_of(answer: Mapping[str, Any]) -> Mapping[str, Any]:
    """The choice that `tune` prints first."""
    best: Mapping[str, Any] = next(c for c in answer["choices"] if c["kind"] == answer["best"])
    return best


def choice_of(view: View, run: RunKey, alpha: float | None = None) -> Mapping[str, Any] | None:
    """Find the choice, as JSON, that has the setting of a run, in the answer for its engine and
    step; None without such an answer or choice.

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
    study's impacts; NaN where the run has no score.

    alpha: s/m; None: the study's main one.
    """
    score = view.score(run, alpha)
    if score is None:
        return math.nan
    choice = choice_of(view, run, alpha)
    if choice is None:
        return float(score["max_error_law"])
    return float(choice["max_error"])


# Ranking of the runs by their agreement with the law, by rules that the page states too.

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

    restitution: on its e.
    loop: on its force loops.
    grade: "good", "even", "bad", for colour beside the words.
    lacks: what keeps it from being used under gravity.
    """

    restitution: str
    grade: str
    loop: str
    lacks: tuple[str, ...] = ()


def over_constant(view: View, run: RunKey, alpha: float) -> float:
    """Largest error of e against the law, divided by that of the best constant e: above 1 a
    constant would do better. NaN for a run without a score.

    alpha: of the law, s/m.
    """
    score = view.score(run, alpha)
    if score is None:
        return math.nan
    of_constant = float(score["constant_error_law"])
    return error_of(view, run, alpha) / max(of_constant, _NO_LINE)


def grade(view: View, ratio: float) -> str:
    """ "good" for an error below that of the best constant e, "even" for one about as large, else
    "bad".

    ratio: of the largest error to the best constant's; NaN is "bad".
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
    """The number by which runs are ranked, the least first: the error against the law over that of
    the best constant e, see `over_constant`. Under gravity of the main α, else of the worst α.

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
    """The scores that a verdict goes by: under gravity that of the main α, which settings are
    fitted for there; else those of all α. Empty where there is none.
    """
    if not view.gravity:
        return view.scores(run)
    score = view.score(run)
    if score is None:
        return []
    return [score]


def lacks(view: View, run: RunKey) -> tuple[str, ...]:
    """Reasons not to use a run under gravity, in words; empty for none, and if it ran without
    gravity.

    It does not come to rest, sinks too deep at rest, or goes too deep in a bounce.
    """
    reasons = []
    # None for a run that was not dropped.
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
    """The verdict on one run, against the best constant e and the law.

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
    """Verdict on a run's loops at the main α, in words: by the distance of the force from the
    law's, then by the depth. "no loop to judge" without a score or a resolved loop.
    """
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
    """Select the runs with the least error among those that have a setting and lack nothing (see
    `lacks`): several if they tie, none if there is no such run.

    If all are of one engine at one step, and `tune` has an answer for that, the runs with its
    setting instead, if any.
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

    error: of a run, for comparison; one without a finite error is left out.
    margin: of that error, that counts as a tie besides the share TIE.
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
    """A sentence on engines with nothing set that do not bounce like the law, if any, and one on
    each engine's best setting at each step.
    """
    sentences = []
    # Titles of the engines, each once.
    wrong = {}
    for run in stock_runs(view):
        if error_ratio(view, run) > 1 + tie(view):
            wrong[run.engine] = wording.engine_title(run.engine)
    if wrong:
        titles = wording.listed(list(wrong.values()))
        do = "does" if len(wrong) == 1 else "do"
        sentences.append(f"With nothing set {titles} {do} not bounce like the law.")
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
    """Runs of the overview figure, each once: engines with nothing set, and each engine's best.

    Under gravity, at the shortest step of each engine with nothing set: the best by an engine's own
    settings, and the best by its plug-in. Else without plug-ins: the best that does not resolve the
    contact, and the best that does.
    """
    picked = stock_runs(view)
    # Of each group, the best of each engine is picked.
    groups: list[list[RunKey]] = []
    if view.gravity:
        picked = _at_shortest_step(picked)
        for step in {run.timestep for run in picked}:
            at_step = [run for run in view.band_runs if run.timestep == step]
            groups.append(at_step)
    else:
        groups.append(view.runs_by_resolution(resolved=False))
        groups.append(view.runs_by_resolution(resolved=True))
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
