"""Data of the page's explorer: curves, loops, drops and answers, rounded to the digits that a
screen shows.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.catalogue.find import materials
from hcbench.reporting import tables
from hcbench.reporting.page import Script, script
from hcbench.reporting.plot_style import KIND_COLOURS
from hcbench.reporting.ranking import PageChoice, answered, choices
from hcbench.reporting.view import REFERENCE, RunKey, View
from hcbench.reporting.wording import engine_title
from hcbench.terms.units import STANDARD_GRAVITY
from hcbench.tuning.usual_errors import errors_of

if TYPE_CHECKING:
    from hcbench.reporting.tables import Views

_KEY = ["scene", "engine", "setting", "timestep_s", "alpha_s_per_m"]
# The page opens with this step, s, if the setting ran with it.
_USUAL_STEP = 2e-3


class PageConditions(NamedTuple):
    """Conditions that a reader chooses, by the names of the page's script.

    gravity: m/s².
    step: s.
    alpha: s/m.
    """

    gravity: float
    engine: str
    step: float
    alpha: float


@dataclass(frozen=True, slots=True)
class Explorer:
    """Values for the page's templates.

    data: JSON for the page's script.
    tabs: id -> title of the panels under the plots.
    choice: the best of the answer that the page opens with, as JSON.
    """

    data: str
    tabs: Mapping[str, str]
    choice: Mapping[str, Any] = field(default_factory=dict)


TABS = {
    "loop": "Force loop",
    "steps": "Error over step",
    "numbers": "What was measured",
    "text": "How it was set",
}
_SCRIPTS = ("law", "plot", "explorer", "answer", "panels", "ranking", "drop", "start")


def explorer_script() -> Script:
    """The script that draws the explorer."""
    return script(*(f"explorer/{name}.js" for name in _SCRIPTS))


class _KeptLoop(NamedTuple):
    """Loop of one impact.

    phase: where in a step the impact began, 0 to below 1.
    times: s.
    penetrations: m.
    forces: N.
    """

    phase: float
    times: list[float]
    penetrations: list[float]
    forces: list[float]


@dataclass(slots=True)
class LoopStore:
    """Loops, each once: many settings do the same for every α.

    stored: the loops, by their numbers.
    places: number of a loop, by its JSON.
    """

    stored: list[Any] = field(default_factory=list)
    places: dict[str, int] = field(default_factory=dict)

    def add(self, columns: Iterable[Sequence[float]]) -> int:
        """Store a loop, unless it is stored; return its number.

        columns: times (s), penetrations (m) and forces (N); four digits of each are kept.
        """
        loop = [digits(values, 4) for values in columns]
        place = self.places.setdefault(json.dumps(loop), len(self.stored))
        # It is new.
        if place == len(self.stored):
            self.stored.append(loop)
        return place


def explorer(by_gravity: Views) -> Explorer | None:
    """The explorer of a report, the interactive part of its page; None where no engine ran over a
    band of speeds.

    Its choice is the best of the answer that the page opens with, or, where `tune` has no answer
    there, the command that finds one.
    """
    data = explorer_data(by_gravity)
    if not data:
        return None
    start = data["start"]
    text = as_json(_sentences_once(data))
    for answer in data["answers"]:
        if all(answer[name] == value for name, value in start.items()):
            return Explorer(text, TABS, answer["choices"][0])
    return Explorer(text, TABS, _unknown(start))


def _sentences_once(data: Mapping[str, Any]) -> dict[str, Any]:
    """The data of the explorer with each sentence of its answers stored once, under `sentences`.

    In place of its sentences, `more`, a choice has their numbers there: an answer's choices share
    most of them, and the page stays small.
    """
    numbers: dict[str, int] = {}
    answers = []
    for answer in data["answers"]:
        packed = []
        for choice in answer["choices"]:
            more = [numbers.setdefault(sentence, len(numbers)) for sentence in choice["more"]]
            packed.append({**choice, "more": more})
        answers.append({**answer, "choices": packed})
    return {**data, "answers": answers, "sentences": list(numbers)}


def explorer_data(by_gravity: Views) -> dict[str, Any]:
    """Everything that the explorer's script reads, by the names of the script (`templates/explorer`),
    as plain values of JSON, SI; {} where no engine ran over a band of speeds.
    """
    ran = _conditions_run(by_gravity)
    if not ran:
        return {}
    view = by_gravity.main
    study = view.study
    without_gravity = by_gravity.without_gravity
    with_gravity = by_gravity.with_gravity
    loops = LoopStore()
    texts = tables.PastedTexts(by_gravity)
    answers: list[dict[str, Any]] = []
    runs: list[dict[str, Any]] = []
    # Columns of the ranking under each gravity.
    heads = {}
    fastest = 0.0
    for shown in by_gravity.shown:
        answers += [_answer(shown, answer) for answer in answered(shown)]
        runs += _runs(shown, loops, texts)
        heads[shown.gravity] = tables.heads(shown.gravity)
        fastest = max(fastest, float(shown.band[1]))
    # The page opens with an answer of `tune`, if there is any.
    of_answers = []
    for answer in answers:
        chosen = {name: answer[name] for name in PageConditions._fields}
        of_answers.append(PageConditions(**chosen))
    start = _start(of_answers or ran, view)
    scans = []
    if without_gravity is not None:
        scans = _scans(without_gravity)
    drop_gravity = STANDARD_GRAVITY
    if with_gravity is not None:
        drop_gravity = with_gravity.gravity
    return {
        "body": {"k": study["stiffness"], "n": study["exponent"], "m": view.mass},
        "alphas": view.alphas,
        "materials": list(_materials()),
        "band": [0.0, fastest],
        "gravities": list(heads),
        "engines": [[engine_title(engine), engine] for engine in view.engines],
        "start": start._asdict(),
        "hues": KIND_COLOURS,
        "answers": answers,
        "errors": _errors({answer["engine"] for answer in answers}),
        "runs": runs,
        "texts": texts.stored,
        "how": texts.settings,
        "ranking": tables.rankings(by_gravity),
        "heads": heads,
        "constants": tables.constants(by_gravity),
        "loops": loops.stored,
        "scans": scans,
        "dropHeight": study.get("train_height"),
        "dropGravity": drop_gravity,
        "drops": _drops(with_gravity or view),
    }


def _conditions_run(by_gravity: Views) -> list[PageConditions]:
    """Conditions of every run over a band of speeds that has a score, in the study's order; those of
    the reference, which is the law itself, are left out.
    """
    ran: list[PageConditions] = []
    for shown in by_gravity.shown:
        for run in shown.band_runs:
            if run.engine == REFERENCE:
                continue
            here = partial(PageConditions, shown.gravity, run.engine, run.timestep)
            ran += [here(alpha) for alpha in shown.alphas if shown.score(run, alpha) is not None]
    return ran


def as_json(content: Any) -> str:
    """Text for a script element of the page: no name in it can end the element."""
    text = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def _start(known: Sequence[PageConditions], view: View) -> PageConditions:
    """Conditions that the page opens with: the first engine at the step nearest to the usual one,
    by ratio, for the α nearest to the main one.

    known: conditions to choose from, one or more; of another gravity or engine only where the
    view's gravity and first engine have none.
    """

    def distance(where: PageConditions) -> tuple[float, float]:
        return abs(math.log(where.step / _USUAL_STEP)), abs(where.alpha - view.main_alpha)

    under_gravity = [where for where in known if where.gravity == view.gravity]
    of_main = [where for where in under_gravity if where.engine == view.engines[0]]
    return min(of_main or known, key=distance)


def _answer(view: View, answer: Mapping[str, Any]) -> dict[str, Any]:
    """An answer of `hcbench tune` as the script takes it, under the study's own α.

    answer: as JSON.
    Raises StopIteration for an α that the study does not have.
    """
    alpha = next(a for a in view.alphas if math.isclose(a, answer["alpha"], rel_tol=1e-9))
    return {
        "gravity": view.gravity,
        "engine": answer["engine"],
        "step": answer["timestep"],
        "alpha": alpha,
        "choices": [_choice(choice) for choice in choices(view, answer)],
    }


def _materials() -> Iterable[dict[str, Any]]:
    """Published pairs of materials with an α (s/m) or one e, as the script takes them."""
    for pair in materials():
        if not pair.points:
            yield {
                "id": pair.id,
                "label": f"{pair.name}: {pair.numbers} {pair.at}",
                "alpha": pair.alpha_s_per_m,
                "e": pair.restitution,
            }


def _errors(engines: Collection[str]) -> list[dict[str, Any]]:
    """The table of errors at any α, named as runs are."""
    return [{"step": row.pop("timestep"), **row} for row in map(dict, errors_of(engines))]


def _choice(choice: PageChoice) -> dict[str, Any]:
    """A choice of an answer as the script takes it; runs to draw by their names there."""
    return {
        "kind": choice.kind,
        "setting": choice.setting,
        "say": choice.say,
        "more": list(filter(None, choice.more)),
        "error": choice.error,
        "band": choice.band,
        "text": choice.text,
        "shown": [f"{run.engine} {run.label}" for run in choice.shown],
    }


def _unknown(start: Mapping[str, Any]) -> dict[str, Any]:
    """A choice in place of an unknown answer, as the script takes it: the command that finds one.

    start: engine, step (s), gravity (m/s²) and alpha (s/m), by name.
    """
    engine = start["engine"]
    alpha = f'--alpha "{start["alpha"]:g} s/m"'
    step = f'--timestep "{start["step"]:g} s"'
    command = f"hcbench tune {engine} {alpha} {step} --gravity {start['gravity']:g}"
    say = f"Ask for a setting of {engine_title(engine)}: this command finds it."
    return {"kind": "", "say": say, "more": [], "text": command}


def _runs(view: View, loops: LoopStore, texts: tables.PastedTexts) -> Iterable[dict[str, Any]]:
    """Curves of every setting, step (s) and α (s/m) of the engines that ran over a band; numbers in
    SI, by the names that the script reads. A speed without a kept loop has the loop number -1.

    loops: takes the loops in.
    texts: gives the numbers of the texts to paste.
    """
    kept = _kept_loops(view)
    for (run, alpha), folded in view.head_on.items():
        if run not in view.band_runs or run.engine == REFERENCE or view.curve(run, alpha) is None:
            continue
        curve = folded.curve
        of_run = kept.get((run, alpha), {})
        # Shown of each speed is the impact whose loop was kept, or else one half-way through a
        # step: the phase of the first kept loop stands for all speeds.
        shown = folded.half_way
        if of_run:
            phase = next(iter(of_run.values())).phase
            if abs(folded.of_loops.phase - phase) < abs(shown.phase - phase):
                shown = folded.of_loops
        # Number of the loop at each speed of the curve.
        numbers = [-1] * len(curve)
        for speed, loop in of_run.items():
            number = loops.add([loop.times, loop.penetrations, loop.forces])
            nearest = int(np.abs(curve.speed - speed).argmin())
            numbers[nearest] = number
        yield {
            **_drawn(view, run),
            "gravity": view.gravity,
            "step": run.timestep,
            "alpha": alpha,
            "phase": shown.phase,
            "text": texts.of(view, run, alpha),
            "asked": digits(curve.speed, 4),
            "v": digits(np.where(np.isfinite(shown.speed_in), shown.speed_in, curve.speed), 5),
            "e": places(shown.restitution, 5),
            "low": places(curve.lowest, 5),
            "high": places(curve.highest, 5),
            "error": digits(np.abs(curve.worst_phase), 3),
            "samples": shown.samples.tolist(),
            "loops": numbers,
        }


def _kept_loops(view: View) -> dict[tuple[RunKey, float], dict[float, _KeptLoop]]:
    """Loops of the main α: run and α -> launch speed (m/s) -> the loop at it; empty for results
    without loops.
    """
    columns = ["speed_m_per_s", "phase", "time_s", "penetration_m", "force_n"]
    loops: dict[tuple[RunKey, float], dict[float, _KeptLoop]] = {}
    if view.results.loops.empty:
        return loops
    main = np.isclose(view.results.loops["alpha_s_per_m"], view.main_alpha, rtol=1e-9)
    for key, rows in view.results.loops[main].groupby(_KEY, sort=False):
        of_run = loops.setdefault(_run_and_alpha(view, key), {})
        for speed, phase, time, x, force in rows[columns].itertuples(index=False, name=None):
            loop = of_run.setdefault(speed, _KeptLoop(phase, [], [], []))
            loop.times.append(time)
            loop.penetrations.append(x)
            loop.forces.append(force)
    return loops


def _run_and_alpha(view: View, key: Any) -> tuple[RunKey, float]:
    values = dict(zip(_KEY, key, strict=True))
    return view.run_of(values), float(values["alpha_s_per_m"])


def _drawn(view: View, run: RunKey) -> dict[str, str]:
    """Names of a run and the style of its line, as the script takes them."""
    style = view.plot_style(run)
    return {
        "engine": run.engine,
        "setting": run.label,
        "label": run.name,
        "title": run.title,
        "kind": style.kind,
        "marker": style.marker,
        "colour": style.colour,
        "dashes": " ".join(f"{1.6 * dash:.3g}" for dash in style.dashes),
    }


def _scans(view: View) -> list[dict[str, Any]]:
    """Largest errors of e over the time step at one speed, a record for each run, for the main α.

    Steps are s, rising. The reference, which is the law itself, is left out.
    """
    scans = []
    for run, points in view.step_curves().items():
        if run.engine == REFERENCE:
            continue
        steps = []
        errors = []
        for step, point in points:
            steps.append(step)
            errors.append(abs(point.worst_phase))
        scans.append(
            {
                "engine": run.engine,
                "setting": run.label,
                "alpha": view.main_alpha,
                "v": float(view.study["step_speed"]),
                "steps": steps,
                "error": digits(errors, 3),
            }
        )
    return scans


def _drops(view: View) -> list[dict[str, Any]]:
    """Touch and parting times (s) and heights (m) of dropped balls for the main α, a record for
    each run; `ended`: fewer than ten bounces, since the ball came to rest.

    A run without a table of bounces has empty lists. The reference, which is the law itself, is
    left out.
    """
    drops = []
    columns = {"touch": "touch_s", "parting": "parting_s", "height": "height_m"}
    for run in dict.fromkeys([*view.bounces, *view.rests]):
        if run.engine == REFERENCE:
            continue
        table = view.bounces.get(run)
        path: dict[str, list[float | None]] = {}
        for name, column in columns.items():
            path[name] = [] if table is None else digits(table[column], 5)
        drops.append(
            {
                "engine": run.engine,
                "setting": run.label,
                "step": run.timestep,
                "alpha": view.main_alpha,
                **path,
                "ended": len(path["touch"]) < 10,
            }
        )
    return drops


def digits(values: Iterable[float], count: int) -> list[float | None]:
    """Numbers rounded to `count` significant digits, None for what is not finite."""
    return [float(f"{v:.{count}g}") if math.isfinite(v) else None for v in values]


def places(values: Iterable[float], count: int) -> list[float | None]:
    """Numbers rounded to `count` decimals, None for what is not finite."""
    return [round(float(v), count) + 0.0 if math.isfinite(v) else None for v in values]
