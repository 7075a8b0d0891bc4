"""Cells of the field page's matrix, the table of cases, and the table of features with the probe of
computing time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, cast

from hcbench.cases.score import EngineScore, newest, regressions
from hcbench.reporting import wording
from hcbench.reporting.field.view import CONSTANT, NO_BOUNCE, OWN, PLUGIN, SETTINGS, STOCK, Case
from hcbench.reporting.ranking import LOOP_NEAR
from hcbench.reporting.wording import NBSP, engine_title, listed, number, percent, span
from hcbench.sim import registry
from hcbench.sim.capabilities import DescribesContact, Feature, Features, OpensModels
from hcbench.sim.engine import SteppedEngine
from hcbench.sim.remote import adapter_of, interpreter_of
from hcbench.system.errors import HcbenchError
from hcbench.terms.impact import Launch
from hcbench.terms.scene import load_scene
from hcbench.workers import call, redirect_output

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.reporting.field.view import FieldView
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting


# Table of the engines' features: each cell from the run, or from the engine's own folder with its
# source.

# Probes of a field report besides the impacts: repeatability to the bit, alone and together, and
# cost.

BALLS = (1, 100)
_LAUNCHES = (Launch(0.1, 0.25), Launch(0.2, 0.5), Launch(0.4, 0.75))
# Launch speed of the balls whose cost is measured, m/s.
_SPEED = 0.4
# Steps of one measurement of the cost.
_STEPS = 100
# Processor time of a probe, s: an engine that runs longer counts as hung.
_LIMIT_S = 240.0
# Duration of one measurement, about, s.
_REPEAT_S = 0.3


@dataclass(frozen=True, slots=True)
class Probe:
    """Probe of one setting.

    repeats: whether the same launches give the same bits again.
    alone: whether each launch alone gives the same bits as together with the others.
    cost: number of balls that were simulated together -> s a ball and step.
    """

    repeats: bool
    alone: bool
    cost: dict[int, float]


def probe(setting: Setting, scene: Scene) -> Probe | None:
    """Probe a setting in the worker process of its engine; None for an engine that hcbench does not
    step, and where it fails: missing, refusing, crashed or slower than _LIMIT_S.
    """
    engine = registry.engine(setting.engine)
    if not isinstance(adapter_of(engine), SteppedEngine):
        return None
    try:
        return call(_probe_here, setting, scene, limit=_LIMIT_S, at=interpreter_of(engine))
    except HcbenchError:
        return None


def _probe_here(setting: Setting, scene: Scene) -> Probe:
    """Probe of a setting, in this process, which is the engine's worker: whether its bits repeat, and
    its cost in s a ball and step, by the number of balls that were simulated together.

    Raises what the engine raises.
    """
    engine = cast("SteppedEngine", registry.engine(setting.engine))
    first = list(map(_bits, engine.run(scene, setting, _LAUNCHES)))
    again = list(map(_bits, engine.run(scene, setting, _LAUNCHES)))
    alone = []
    for launch in _LAUNCHES:
        (impact,) = engine.run(scene, setting, [launch])
        alone.append(_bits(impact))
    cost: dict[int, float] = {}
    # An engine with a process of its own prints from native code.
    quiet = redirect_output() if engine.own_process else nullcontext()
    with quiet:
        for balls in BALLS:
            cost |= _cost(engine, setting, scene, balls)
    return Probe(first == again, first == alone, cost)


def _bits(impact: object) -> bytes:
    import pickle

    return pickle.dumps(replace(impact, loop=None, launch=None))  # type: ignore[type-var]


def _cost(engine: SteppedEngine, setting: Setting, scene: Scene, balls: int) -> dict[int, float]:
    """Number of balls that were simulated together -> s a ball and
    step, the least of several times.

    balls: how many are wanted; a world that has fewer places takes as many as it has. Each ball is
    launched in another phase.
    Raises what the engine raises.
    """
    with engine.load(scene, setting, _SPEED) as world:
        together = min(balls, world.places)
        launches = [Launch(_SPEED, (i + 0.5) / together) for i in range(together)]
        # The least is that which other programs of the machine disturbed least.
        least = float("inf")
        begun = time.perf_counter()
        while least == float("inf") or time.perf_counter() - begun < _REPEAT_S:
            with closing(world.release(launches)) as simulation:
                start = time.perf_counter()
                done = 0
                while done < _STEPS:
                    steps = simulation.advance(_STEPS - done).force.shape[1]
                    done += steps
                seconds = time.perf_counter() - start
            least = min(least, seconds / (_STEPS * together))
    return {together: least}


def scene_of(view: FieldView) -> Scene:
    """Load the study's own scene, without gravity."""
    return replace(load_scene(str(view.study["scene"])), gravity=0.0)


def csv_of(costs: Sequence[tuple[str, str, float, dict[int, float]]], machine: str) -> str:
    """The costs as CSV: a line for each number of balls, in µs a ball and step.

    costs: (engine, setting, step in s, as `Probe.cost`).
    machine: a description, for a comment at the top.
    """
    lines = [
        f"# CPU and load of one machine at one time: {machine}",
        "engine,setting,timestep_s,balls,us_a_ball_step",
    ]
    for engine, name, step, cost in costs:
        for balls, seconds in cost.items():
            lines.append(f"{engine},{name},{step:g},{balls},{1e6 * seconds:.3g}")
    return "\n".join(lines) + "\n"


RUN = "this run"
_FOLDER = "hcbench's adapter"
FEATURES = {
    "law": "its own law",
    "exponent": "exponent",
    "threshold": "bounces from",
    "numbers": "numbers",
    "bits": "same bits again",
    "licence": "licence",
}


def energy_note(engine: str) -> Feature | None:
    """Note on an e above 1 in an engine, from the engine's folder; None without one."""
    adapter = registry.adapter(registry.base_name(engine))
    if not isinstance(adapter, DescribesContact) or adapter.features is None:
        return None
    return adapter.features.energy


def features(
    view: FieldView, probes: Mapping[str, Probe | None]
) -> list[tuple[str, list[Feature]]]:
    """(engine, its cells in the order of FEATURES) of each engine of the page.

    probes: by engine; None, or none, for one that could not be probed.
    """
    return [(engine, _feature_cells(view, engine, probes.get(engine))) for engine in view.engines]


def _feature_cells(view: FieldView, engine: str, probe: Probe | None) -> list[Feature]:
    """Cells of an engine, in the order of FEATURES; "–" for one that nothing is known of. What was
    seen in this run goes before what the engine's folder states.

    engine: with its version.
    probe: None where it could not run.
    """
    base = registry.base_name(engine)
    adapter = registry.adapter(base)
    # An engine that steps another's models has that engine's contact, except what its notes say.
    contact = registry.adapter(getattr(adapter, "model_engine", base))
    cells: dict[str, Feature] = {}
    if isinstance(contact, DescribesContact) and contact.features is not None:
        for field in fields(Features):
            stated = getattr(contact.features, field.name)
            if stated is not None:
                cells[field.name] = stated
    nothing = Feature("–", "")
    cells["numbers"] = Feature(f"float{adapter.bits}", _FOLDER)
    # Without a probe nothing ran here that could be the source.
    source = ""
    if probe is not None:
        source = RUN
    cells["bits"] = Feature(_bits_text(probe), source)
    cells["threshold"] = _threshold(cells.get("threshold", nothing), _slowest_bounce(view, engine))
    return [cells.get(name, nothing) for name in FEATURES]


def _threshold(stated: Feature, seen: str) -> Feature:
    """Slowest bounce: the stated one, followed by the one seen in this run."""
    if not seen:
        return stated
    return Feature(
        f"{stated.text}; {seen}".removeprefix("–; "), f"{stated.source}; {RUN}".strip("; ")
    )


def _bits_text(probe: Probe | None) -> str:
    """Text of the cell on whether a run repeats to the bit; "–" without a probe."""
    if probe is None:
        return "–"
    if not probe.repeats:
        return "no"
    if probe.alone:
        return "yes, alone or together"
    return "yes; alone others"


def _slowest_bounce(view: FieldView, engine: str) -> str:
    """From which speed on the engine bounces with nothing set, at the step of 1 ms or the nearest.

    "" where it did not run so, or bounces at every speed.
    """
    gravity = view.gravities[0]
    steps = [step for step in view.steps if view.stock(engine, gravity, step)]
    if not steps:
        return ""
    nearest = min(steps, key=lambda step: abs(math.log(step / 1e-3)))
    case = view.stock(engine, gravity, nearest)
    assert case is not None
    curve = view.curve(case)
    bounces = curve.speed[curve.highest >= NO_BOUNCE]
    if not len(bounces):
        return "nothing set: at no speed"
    slowest = float(bounces.min())
    lowest = float(view.speeds(case.timestep)[0])
    if slowest <= lowest * (1 + 1e-9):
        return ""
    return f"nothing set: {slowest:.2g}{NBSP}m/s"


# The matrix: what each engine does under each condition at a step, a number and a word a cell.

COLUMNS = {
    STOCK: "nothing set",
    CONSTANT: "one e",
    SETTINGS: "settings",
    PLUGIN: "plug-in",
    "energy": "energy",
    "slow": "slow impacts",
    "loop": "force loop",
    "files": "files it reads",
    "version": "version",
}
# Meaning of each colour, in the legend.
GRADES = {
    "good": ("✓", "follows the law: the error of e is below a tenth of the best constant e's"),
    "even": ("≈", "about as wrong as the best constant e, or less"),
    "bad": ("✗", "more wrong than the best constant e"),
    "none": (
        "",
        "no number: “–” hcbench has no such setting for the engine; “not run” at this step",
    ),
}
# An e below this does not look like a bounce.
_SEEN = 0.005
_ELSEWHERE = "hcbench has such a setting; this study ran it at other steps only."
_NO_SETTING = "hcbench has no such setting for this engine."
_LOST = {"diverged": "loses the ball", "no-touch": "no contact", "crashed": "crashes"}


@dataclass(frozen=True, slots=True)
class MatrixCell:
    """One cell of a table of the page.

    text: its words.
    below: a second, smaller line.
    grade: its colour, one of GRADES.
    order: number to sort its column by; None is last.
    case: the one that it is of, shown on a click.
    note: a sentence shown on a click.
    """

    text: str
    below: str = ""
    grade: str = "none"
    order: float | None = None
    case: Case | None = None
    note: str = ""


def rows(view: FieldView, gravity: float, timestep: float) -> dict[str, dict[str, MatrixCell]]:
    """Cells by column, see COLUMNS, of each engine that ran under a condition, by engine.

    gravity: m/s².
    timestep: s. First the engines that are nearest to the law by settings whose e falls with speed,
    then by one e, then by a plug-in.
    """
    made: dict[str, dict[str, MatrixCell]] = {}
    for engine in view.engines:
        if view.cases(engine, gravity, timestep, *OWN, PLUGIN, STOCK):
            made[engine] = _row(view, engine, gravity, timestep)

    def order(engine: str) -> list[float]:
        """Errors of an engine by which the rows are sorted, the first one deciding; infinite where
        a cell has none.
        """
        orders = []
        for column in (SETTINGS, CONSTANT, PLUGIN):
            value = made[engine][column].order
            # Cells without a number come last.
            if value is None:
                value = math.inf
            orders.append(value)
        return orders

    return {engine: made[engine] for engine in sorted(made, key=order)}


def _row(view: FieldView, engine: str, gravity: float, timestep: float) -> dict[str, MatrixCell]:
    """One engine's cells by column, see COLUMNS, under one condition.

    engine: with its version.
    gravity: m/s².
    timestep: s. Of each kind of setting the best one has the cell.
    """
    here = (engine, gravity, timestep)
    own = view.best(*here)
    plugin = view.best(*here, PLUGIN)
    version = view.results.versions.get(engine, "–")
    return {
        STOCK: _stock(view, view.stock(*here), view.stock(engine, view.gravities[0], timestep)),
        **{kind: _error(view, here, kind) for kind in (*OWN, PLUGIN)},
        "energy": _energy(view, engine, view.cases(*here, STOCK, *OWN, PLUGIN)),
        "slow": _slow(view, own, plugin),
        "loop": _loop(view, own or plugin),
        "files": _files(engine),
        "version": MatrixCell(version, note="The version that this run measured."),
    }


def _stock(view: FieldView, here: Case | None, without_gravity: Case | None) -> MatrixCell:
    """Cell of the engine with nothing set: the range of its e over speeds and phases, or in words
    why it has none.

    here: that run under the table's gravity; None where there is none: `without_gravity` stands in.
    """
    case = here or without_gravity
    if case is None:
        return MatrixCell("not run", note=_ELSEWHERE)
    below = "" if here else "without gravity"
    low, high = view.restitution(case)
    lost = view.lost(case)
    if lost:
        return MatrixCell(_LOST.get(lost, "never leaves"), below, "bad", case=case)
    error = view.error(case)
    if high < _SEEN:
        return MatrixCell("no bounce", below, "bad", error, case)
    e = span(f"{low:.2f}", f"{high:.2f}")
    return MatrixCell(f"e {e}", below, grade(view, case), error, case)


def _error(view: FieldView, here: tuple[str, float, float], kind: str) -> MatrixCell:
    """Cell of the largest error of e of the best setting of a kind, and which setting that is. Its
    note names settings that are nearer by e, but add energy or lose impacts.

    here: engine, gravity (m/s²), time step (s).
    kind: CONSTANT, SETTINGS or PLUGIN.
    """
    engine, gravity, timestep = here
    # The best that loses no impact and gains no energy; None where none does.
    case = view.best(engine, gravity, timestep, kind)
    tried = view.cases(engine, gravity, timestep, kind)
    if not tried:
        if any(other.engine == engine and view.kind(other) == kind for other in view.scores):
            return MatrixCell("not run", note=_ELSEWHERE)
        return MatrixCell("–", note=_NO_SETTING)
    least = math.inf
    if case is not None:
        least = view.error(case)
    # Named are those that fail but would be the best by e alone. One that never bounced has NaN for
    # its largest error; it is named, too.
    nearer = []
    for other in tried:
        is_failing = math.isinf(view.error(other))
        if is_failing and not view.off(other) >= least:
            nearer.append(other)
    note = ""
    if nearer:
        names = [left_out(view, other) for other in nearer]
        note = f"Left out: {listed(names)}."
    if case is None:
        first = nearer[0]
        text = "loses the ball"
        if view.gains(first):
            text = "adds energy"
        return MatrixCell(text, first.setting, "bad", case=first, note=note)
    return MatrixCell(wording.error(least), case.setting, grade(view, case), least, case, note)


def left_out(view: FieldView, case: Case) -> str:
    """A setting that is not the best, and why."""
    if view.gains(case):
        return f"{case.setting}, which adds energy (e up to {number(view.largest_e(case))})"
    return f"{case.setting}, which loses impacts"


def _energy(view: FieldView, engine: str, cases: list[Case]) -> MatrixCell:
    """Cell that says whether any setting of the engine adds energy at this step.

    cases: of the engine at this step. The engine's own note on its energy, with its source, is in
    the cell's note.
    """
    about = energy_note(engine)
    note = ""
    if about:
        note = f"{about.text} ({about.source})."
    gains = list(filter(view.gains, cases))
    if not gains:
        launches = sum(map(view.scenes, cases))
        none = "No launch of a setting of this engine ended with more energy than it began with."
        return MatrixCell(
            "never grows", f"{launches} launches", "good", 0.0, note=f"{none} {note}".strip()
        )
    worst = max(gains, key=view.largest_e)
    high = view.largest_e(worst)
    return MatrixCell(f"e up to {number(high)}", worst.setting, "bad", high, worst, note)


def _slow(view: FieldView, own: Case | None, plugin: Case | None) -> MatrixCell:
    """Cell of the impact speed below which a body stays down, m/s: the higher one of two settings;
    "–" where neither ran.

    own: the engine's best setting, plugin: its best plug-in; None for one that did not run.
    """
    downs = [(view.stays_down(case), case) for case in (own, plugin) if case is not None]
    if not downs:
        return MatrixCell("–")
    # 0 where all impacts bounce, infinite where none does.
    down, case = max(downs)
    if not down:
        return MatrixCell("all bounce", "", "good", 0.0, case)
    if math.isinf(down):
        return MatrixCell("none bounces", case.setting, "bad", None, case)
    return MatrixCell(f"rest below {down:.2g}{NBSP}m/s", case.setting, "bad", down, case)


def _loop(view: FieldView, case: Case | None) -> MatrixCell:
    """Cell that says whether the force over penetration of the best setting follows the law, too.

    case: the best setting; None for none. The distance is the root mean square over the law's
    largest force.
    """
    if case is None:
        return MatrixCell("–")
    score = view.scores[case]
    if not score["loops"]:
        recipe = view.recipe(case)
        below = "not resolved"
        if recipe is not None and recipe.one_step:
            below = "one step a bounce"
        return MatrixCell("none", below, case=case)
    rms = float(score["loop_rms"])
    if rms <= LOOP_NEAR:
        return MatrixCell("the law's", f"within {percent(rms)}", "good", rms, case)
    return MatrixCell("another", f"wrong by {percent(rms)}", "bad", rms, case)


def _files(engine: str) -> MatrixCell:
    """Cell of the kinds of files that hcbench opens with an engine; "–" for none.

    engine: its name, with a version or without.
    """
    adapter = registry.adapter(registry.base_name(engine))
    if not isinstance(adapter, OpensModels):
        return MatrixCell(
            "–", note="hcbench opens no model with this engine: it builds the scenes in it."
        )
    names = listed([name.removeprefix(".") for name in adapter.suffixes])
    return MatrixCell(
        names, note="Models that `hcbench measure`, `tune` and `check` open with this engine."
    )


def grade(view: FieldView, case: Case) -> str:
    """Grade of a case, one of GRADES: its error of e against the best constant e's."""
    if view.follows_law(case):
        return "good"
    if view.error(case) <= 1.25 * view.constant_error(case.timestep):
        return "even"
    return "bad"


# The cases on the page: which engines pass them, whose restitution is obeyed, and why a case
# fails.

_VERDICTS = {
    "pass": ("pass", "good"),
    "fail": ("fail", "bad"),
    "error": ("error", "bad"),
    "unsupported": ("–", "none"),
}
# Fate of the restitution that is asked for: in a cell, its grade, and in a sentence.
_OBEDIENCE = {
    "obeyed": ("obeyed", "good", "obeyed by {}"),
    "soft": ("soft", "even", "obeyed deep in the floor by {}"),
    "threshold": ("above {}", "even", "obeyed above some speed by {}"),
    "mixed": ("in part", "bad", "obeyed in part by {}"),
    "ignored": ("ignored", "bad", "ignored by {}"),
}


@dataclass(frozen=True, slots=True)
class CaseTable:
    """Verdicts of the conformance cases on each engine.

    sentence: on which engines obey a restitution that is set.
    titles: of the cases, by id.
    rows: of each engine its name with its version, and its cells.
    why: id -> engine with its version -> reason of a verdict.
    changes: sentences on what another version of an engine changed.
    """

    sentence: str
    titles: dict[str, str]
    rows: Sequence[tuple[str, Sequence[MatrixCell]]]
    why: dict[str, dict[str, str]]
    changes: Sequence[str]


def case_table(scores: Sequence[EngineScore]) -> CaseTable:
    """The table of the engines that were measured, in their newest version: those that pass most
    first.

    scores: of one engine in one version each, as `cases.score.measured` gives them.
    """
    ranked = sorted(newest(scores), key=lambda one: (-one.passed, one.engine))
    titles: dict[str, str] = {}
    why: dict[str, dict[str, str]] = {}
    for one in ranked:
        for verdict in one.verdicts:
            case = verdict["case"]
            titles[case] = verdict["title"]
            reasons = why.setdefault(case, {})
            if verdict["why"]:
                reasons[_name(one)] = verdict["why"]
    rows = [(_name(one), list(_cells(one))) for one in ranked]
    return CaseTable(_sentence(ranked), titles, rows, why, regressions(scores))


def _name(one: EngineScore) -> str:
    return f"{_title(one)} {one.version}".strip()


def _title(one: EngineScore) -> str:
    title = engine_title(one.engine)
    return title[:1].upper() + title[1:]


def _sentence(scores: Sequence[EngineScore]) -> str:
    """Sentence that sorts engines, each in one version, by their obedience to a set restitution."""
    parts = []
    for word, (_, _, phrase) in _OBEDIENCE.items():
        engines = [_title(one) for one in scores if one.restitution == word]
        if engines:
            parts.append(phrase.format(listed(engines)))
    return f"The restitution that is set is {'; '.join(parts)}."


def _cells(one: EngineScore) -> Iterable[MatrixCell]:
    """Cells of one engine: how it obeys a restitution, how many cases pass, then each verdict."""
    text, grade, _ = _OBEDIENCE.get(one.restitution or "", ("–", "none", ""))
    yield MatrixCell(text.format(f"{one.threshold:.2g}{NBSP}m/s"), grade=grade)
    yield MatrixCell(f"{one.passed} of {len(one.verdicts)}")
    for verdict in one.verdicts:
        text, grade = _VERDICTS[verdict["verdict"]]
        yield MatrixCell(text, grade=grade)
