"""The study: each setting of each engine on each data set, the floors, and what corrections change."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hcbench.reality import evidence
from hcbench.reality.cube import VARIANTS
from hcbench.reality.data_sets import (
    SETS,
    Cell,
    Parameters,
    Tick,
    committed,
    identify,
    installed,
    outcome_of,
    parts_of,
    run_each,
    settings_of,
    values_of,
)
from hcbench.reality.evidence import Slope, Switch
from hcbench.reality.impacts import POSITION_NOISE, ROTATION_NOISE, ImpactRead, read_impacts
from hcbench.reality.motion import (
    Motion,
    SettingErrors,
    Tosses,
    at_times,
    interval,
    motion,
    quaternions,
    rotation,
)
from hcbench.sim.toss import FRICTION, PLUGIN_ALPHA, PLUGIN_E, Body, ContactSetting, TossModule
from hcbench.terms.impact import Floats
from hcbench.workers import WorkerPool, call

# The table scores.csv: the mean error of each setting on each data set, with its interval.

FILE = "scores.csv"
# Engine of the rows that are floors.
NO_ENGINE = "none"


@dataclass(frozen=True, slots=True)
class SettingScore:
    """A line of the table of scores: a mean error with its 95 % interval, error_low to error_high,
    over n tosses or bounces.

    set: name of the data set.
    engine: NO_ENGINE for a floor.
    setting: its name, or that of the floor.
    cone: of friction, where the engine has several; else "".
    unit: of the three errors.
    rotation_deg: mean angle between the attitudes, degrees, of tosses; None for other sets.
    """

    set: str
    engine: str
    setting: str
    cone: str
    error: float
    error_low: float
    error_high: float
    unit: str
    rotation_deg: float | None
    n: int


def of_cell(cell: Cell, outcome: SettingErrors) -> SettingScore:
    """Score of the engine's setting in a cell."""
    return of_outcome(cell.data, cell.engine, cell.contact.name, cell.contact.cone, outcome)


def of_outcome(
    data: str, engine: str, setting: str, cone: str, outcome: SettingErrors
) -> SettingScore:
    """The score of a setting or of a floor: its mean error with a 95 % interval.

    data: name of the data set, whose unit the errors have.
    engine: its name, NO_ENGINE for a floor.
    setting: name of the setting or the floor.
    cone: of friction, "" where there is no choice.
    outcome: errors, one a toss or bounce.
    """
    low, high = interval(outcome.errors)
    turned = None if outcome.rotations is None else float(np.degrees(outcome.rotations.mean()))
    mean = float(outcome.errors.mean())
    return SettingScore(
        set=data,
        engine=engine,
        setting=setting,
        cone=cone,
        error=mean,
        error_low=low,
        error_high=high,
        unit=SETS[data].UNIT,
        rotation_deg=turned,
        n=len(outcome.errors),
    )


def csv_text(scores: Iterable[SettingScore]) -> str:
    """The table scores.csv: a header of the fields of `SettingScore`, and a line for each score;
    numbers in five digits.
    """
    text = io.StringIO()
    names = [field.name for field in fields(SettingScore)]
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    for score in scores:
        row = asdict(score)
        for name, value in row.items():
            if isinstance(value, float):
                row[name] = f"{value:.5g}"
        writer.writerow(row)
    return text.getvalue()


def sets_in(folder: Path) -> set[str]:
    """Data sets of the study in a folder; empty without a study."""
    try:
        with (folder / FILE).open(encoding="utf-8", newline="") as file:
            return {row["set"] for row in csv.DictReader(file)}
    except (OSError, ValueError, KeyError, csv.Error):
        return set()


# Synthetic twins of measured tosses: the same starts under a known law, with the measured noise,
# as motions.
#
# What a reading finds in a twin, whose law is known, says what the same reading of the data is
# worth.

TIMESTEP = 2.5e-4  # s


def twins(
    module: TossModule, body: Body, setting: ContactSetting, values: Sequence[float],
    motions: Sequence[Motion], timestep: float = TIMESTEP, seed: int = 3,
) -> list[Motion]:  # fmt: skip
    """A twin of each motion: the same start and frames, by an engine's setting whose law is exact,
    with the noise of the measured poses.

    module: `toss` of the engine, which runs in this process.
    values: of the setting's parameters.
    timestep: s.
    seed: of the noise: the same gives the same twins.
    """
    noise = np.random.default_rng(seed)
    tosses = [measured_motion.toss(timestep) for measured_motion in motions]
    simulated = module.simulate(body, setting, values, timestep, tosses)
    made = []
    for measured, states in zip(motions, simulated, strict=True):
        place, turn = at_times(states, timestep, measured.time - measured.time[0])
        # The order of the draws is part of what the seed stands for: place, then attitude.
        place = place + noise.normal(0.0, POSITION_NOISE, place.shape)
        small_turn = Rotation.from_rotvec(noise.normal(0.0, ROTATION_NOISE, place.shape))
        shaken = quaternions(small_turn * rotation(turn))
        made.append(motion(measured.number, body, measured.time, place, shaken))
    return made


# Laws whose twins are read as the data are: the e that is read from the data,
# and the α that has this mean e.
TWIN_E = 0.235
TWIN_ALPHA = 2.6
_TWIN_FRICTION = 0.18
# Every so many tosses have a twin.
_TWIN_EVERY = 3


@dataclass(frozen=True, slots=True)
class RealityRequest:
    """Options of the study.

    sets: names of the data sets.
    folders: of the original data, by set; None, or none, for the data that are shipped.
    part: number of the part to judge; None: the validation parts.
    identify: whether to search the settings' parameters; else they are those that are shipped.
    """

    sets: Sequence[str]
    folders: Mapping[str, Path | None] = field(default_factory=dict)
    part: int | None = None
    identify: bool = False

    def cell(
        self, data: str, engine: str, setting: ContactSetting, values: tuple[float, ...] = ()
    ) -> Cell:
        """A setting of an engine on the parts of a data set that are to be judged.

        data, engine: names.
        values: of the setting's parameters, SI; () for none.
        """
        return Cell(
            data=data,
            engine=engine,
            setting=setting.key,
            values=values,
            parts=parts_of(data, self.part),
            folder=self.folders.get(data),
        )


@dataclass(frozen=True, slots=True)
class RealityResults:
    """Results of the study.

    changed: scores on a data set with parts of it left as published, by what is.
    impacts: read from the cube's tosses.
    twins: the same of synthetic ones, by law.
    slopes: of e over speed.
    switches: of the ellipse's corrections.
    drawn: poses of one toss at its frames, see `drawn_toss`.
    """

    request: RealityRequest
    parameters: Parameters
    scores: Sequence[SettingScore]
    changed: Mapping[str, Sequence[SettingScore]]
    impacts: Sequence[ImpactRead]
    twins: Mapping[str, Sequence[ImpactRead]]
    slopes: Sequence[Slope]
    switches: Sequence[Switch]
    drawn: Mapping[str, Floats]


def run(request: RealityRequest, pool: WorkerPool, tick: Tick | None = None) -> RealityResults:
    """Run the whole study: search parameters where that is asked for, run every setting on the data
    sets of the request, and read the impacts.

    tick: called with (cells done, cells in all), for the search and again for the runs.

    Engines that are not installed are left out: without any there are only floors.
    Raises UserError for a folder that is not of a set's data, and what an engine raises.
    """
    parameters = committed()
    if request.identify:
        parameters = identify(pool, request.sets, request.folders, tick)
    cells: list[Cell] = []
    for data in request.sets:
        cells.extend(_cells(request, parameters, data))
    with_variants = [cell for cell in cells if cell.data == "cube" and _has_variants(cell)]
    # The variant "" is the corrected data, of which `cells` are.
    changed = []
    for variant in filter(None, VARIANTS):
        changed += [replace(cell, variant=variant) for cell in with_variants]
    # All in one go: no worker waits for the last cell of another part.
    outcomes = run_each(pool, outcome_of, [*cells, *changed], tick)
    of_cells = outcomes[: len(cells)]
    of_changed = outcomes[len(cells) :]
    scores = [of_cell(cell, outcome) for cell, outcome in zip(cells, of_cells, strict=True)]
    by_variant: dict[str, list[SettingScore]] = {}
    for cell, outcome in zip(changed, of_changed, strict=True):
        by_variant.setdefault(cell.variant, []).append(of_cell(cell, outcome))
    for data in request.sets:
        scores += _floors(request, parameters, pool, data)
    impacts: Sequence[ImpactRead] = []
    twins: Mapping[str, Sequence[ImpactRead]] = {}
    drawn: Mapping[str, Floats] = {}
    if "cube" in request.sets:
        impacts, twins = _impacts(request, parameters, pool)
        drawn = drawn_toss(pool, cells)
    slopes = []
    if impacts:
        slopes = evidence.cube_slopes(impacts, twins)
    switches: list[Switch] = []
    if "ellipse" in request.sets:
        training, judged = _both_parts(request, "ellipse")
        slopes.append(evidence.ellipse_slope(judged))
        switches = evidence.ellipse_switches(training, judged)
    if "ball" in request.sets:
        _, judged = _both_parts(request, "ball")
        slopes.append(evidence.ball_slope(judged))
    return RealityResults(
        request=request,
        parameters=parameters,
        scores=scores,
        changed=by_variant,
        impacts=impacts,
        twins=twins,
        slopes=slopes,
        switches=switches,
        drawn=drawn,
    )


def _both_parts(request: RealityRequest, data: str) -> tuple[Any, Any]:
    """Motions or impacts of a data set, as its `cases` makes them: of the training part, and those
    that are judged.

    data: name of the set. The parts that are judged are the request's one, or the set's validation
    parts.
    Raises UserError for a folder that is not of the set's data.
    """
    module = SETS[data]
    folder = request.folders.get(data)
    training = module.cases(module.TRAINING, folder)
    return training, module.cases(parts_of(data, request.part), folder)


def drawn_toss(pool: WorkerPool, cells: Sequence[Cell]) -> dict[str, Floats]:
    """Poses at the frames of the first toss that is judged: "measured", and simulated, by the key of
    each setting of the first engine that has a plug-in. Shape (n, 7): position, m, and quaternion,
    w first.

    Empty where no cell of the cube is of such an engine.
    """
    plugged = {cell.engine for cell in cells if cell.contact.name == PLUGIN_E}
    engine = next((cell.engine for cell in cells if cell.engine in plugged), "")
    shown = [cell for cell in cells if cell.engine == engine and cell.data == "cube"]
    drawn: dict[str, Floats] = {}
    for cell, (measured, simulated) in zip(shown, run_each(pool, _poses, shown), strict=True):
        drawn.setdefault("measured", measured)
        drawn[cell.setting] = simulated
    return drawn


def _poses(cell: Cell) -> tuple[Floats, Floats]:
    """Measured and simulated poses of a cell's first toss, shape (n, 7) each: position, m, and
    quaternion, w first, at the measured frames. To be run in a worker process of the cell's engine.
    """
    tosses = Tosses(cell.cases.body, cell.cases.motions[:1])
    simulated = tosses.as_simulated(tosses.simulated(cell.module, cell.contact, cell.values))
    measured = tosses.motions[0]
    other = simulated.motions[0]
    return (
        np.concatenate([measured.position, measured.quaternion], axis=1),
        np.concatenate([other.position, other.quaternion], axis=1),
    )


def _cells(request: RealityRequest, parameters: Parameters, data: str) -> Iterator[Cell]:
    """A cell on the parts to judge for each setting of a data set whose parameters are known.

    data: name of the set.
    """
    for engine, setting in settings_of(data):
        values = values_of(parameters, data, request.cell(data, engine, setting))
        if values is not None:
            yield request.cell(data, engine, setting, values)


def _has_variants(cell: Cell) -> bool:
    return cell.contact.name in (FRICTION, PLUGIN_E) and cell.contact.cone != "pyramidal"


def _exact(data: str) -> tuple[str, ContactSetting, ContactSetting] | None:
    """The first installed engine whose plug-in sets e of every impact, with its settings of
    constant e and of α; None without one.

    data: name of a set, whose body the engine has to know.
    """
    for engine in installed():
        own = {}
        for name, setting in settings_of(data):
            if name == engine and setting.cone != "pyramidal":
                own[setting.name] = setting
        if PLUGIN_E in own and PLUGIN_ALPHA in own:
            return engine, own[PLUGIN_E], own[PLUGIN_ALPHA]
    return None


def _floors(
    request: RealityRequest, parameters: Parameters, pool: WorkerPool, data: str
) -> Iterator[SettingScore]:
    """Scores of what no engine gives: the best that a law can do, and what noise alone does.

    parameters: of all settings, as searched or committed.
    data: name of the set. Those of the cube need an engine with a plug-in: there are none without.
    Raises UserError for a folder that is not of the set's data, and what an engine raises.
    """
    outcomes: dict[str, Any] = {}
    exact = None
    if data == "cube":
        exact = _exact(data)
    if exact is not None:
        engine, constant, _ = exact
        frictions = evidence.FRICTIONS
        grid = [request.cell(data, engine, constant, (friction,)) for friction in frictions]
        outcomes[evidence.BEST_OF_EACH] = evidence.best(run_each(pool, evidence.of_friction, grid))
        values = values_of(parameters, data, request.cell(data, engine, constant))
        if values is not None:
            same = request.cell(data, engine, constant, values)
            (outcomes[evidence.NOISE],) = run_each(pool, evidence.of_noise, [same])
    elif data == "ellipse":
        outcomes = evidence.of_ellipse(*_both_parts(request, data))
    elif data == "ball":
        outcomes = evidence.of_ball(*_both_parts(request, data))
    elif data == "alumina":
        alumina = SETS[data]
        fixed = alumina.FIXED
        cases = alumina.cases(alumina.VALIDATION)
        outcomes[evidence.RIGID] = alumina.rigid(cases, fixed["restitution"], fixed["friction"])
    for name, outcome in outcomes.items():
        yield of_outcome(data, NO_ENGINE, name, "", outcome)


def _impacts(
    request: RealityRequest, parameters: Parameters, pool: WorkerPool
) -> tuple[list[ImpactRead], dict[str, list[ImpactRead]]]:
    """Impacts of the tosses that are judged and those of the training part, and of their twins,
    every third toss, by the name of their law; of the part alone where the request names one.

    parameters: of all settings, which give the twins their friction.
    There are no twins without an engine whose plug-in sets e.
    Raises UserError for a folder that is not of the cube's data, and what the engine raises.
    """
    parts: tuple[int, ...] = (*SETS["cube"].TRAINING, *SETS["cube"].VALIDATION)
    if request.part is not None:
        parts = (request.part,)
    folder = request.folders.get("cube")
    reading = pool.threads.submit(call, _read, parts, folder, limit=None)
    twins: dict[str, list[ImpactRead]] = {}
    exact = _exact("cube")
    if exact is not None:
        engine, constant, falling = exact
        # Of the cube, where none was searched.
        friction = _TWIN_FRICTION
        known = values_of(parameters, "cube", request.cell("cube", engine, constant))
        if known:
            _e, friction = known
        cells = [
            Cell(
                data="cube",
                engine=engine,
                setting=constant.key,
                values=(TWIN_E, friction),
                parts=parts,
                folder=folder,
            ),
            Cell(
                data="cube",
                engine=engine,
                setting=falling.key,
                values=(TWIN_ALPHA, friction),
                parts=parts,
                folder=folder,
            ),
        ]
        of_constant, of_falling = run_each(pool, _read_twins, cells)
        twins = {evidence.CONSTANT_E: of_constant, evidence.ALPHA: of_falling}
    return reading.result(), twins


def _read(parts: tuple[int, ...], folder: Path | None) -> list[ImpactRead]:
    """Read the impacts of the cube's tosses of some parts; in a worker process."""
    tosses = SETS["cube"].cases(parts, folder)
    return read_impacts(tosses.body, tosses.motions)


def _read_twins(cell: Cell) -> list[ImpactRead]:
    """Read the impacts of twins of every _TWIN_EVERY-th toss of a cell, under its setting; in a
    worker process of its engine.
    """
    measured = cell.cases.motions[::_TWIN_EVERY]
    made = twins(cell.module, cell.cases.body, cell.contact, cell.values, measured)
    return read_impacts(cell.cases.body, made)
