"""Runs a study: plans its settings, flies them in worker processes, scores what comes back.

The same study gives the same bytes for any number of jobs: work is cut by the study alone, and results are
put back in the study's order.
"""

from __future__ import annotations

import dataclasses
import platform
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import as_completed
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from hcbench import scoring
from hcbench.benchmark.batch import columns_of
from hcbench.benchmark.results import IMPACT_COLUMNS, LOOP_COLUMNS, RUN_KEY, TRAIN_COLUMNS, Results
from hcbench.impact import Impact, Launch, Status
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.sim import registry
from hcbench.tune.target import Target
from hcbench.workers import WorkerDied, WorkerPool, call

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    import pandas as pd

    from hcbench.benchmark.study import Run, Study
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.tune.recipe import Recipe

LOOP_SAMPLES = 400  # kept of one loop; what a figure can show


@dataclass(frozen=True, slots=True)
class Launches(Sequence[Launch]):
    """Every speed at every phase, the phases of one speed together; made when asked, as there may be many."""

    speeds: tuple[float, ...]
    phases: tuple[float, ...]

    def __len__(self) -> int:
        return len(self.speeds) * len(self.phases)

    @overload
    def __getitem__(self, index: int) -> Launch: ...
    @overload
    def __getitem__(self, index: slice) -> list[Launch]: ...
    def __getitem__(self, index: int | slice) -> Launch | list[Launch]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        speed, phase = divmod(range(len(self))[index], len(self.phases))
        return Launch(self.speeds[speed], self.phases[phase])


TaskKey = tuple[str, Launches]


@dataclass(frozen=True, slots=True)
class Task:
    """One setting to fly. Loops come back for the launches in `keep` only."""

    scene: Scene
    setting: Setting
    launches: Launches
    keep: tuple[Launch, ...]

    @property
    def key(self) -> TaskKey:
        """Equal for equal work."""
        return self.setting.key, self.launches


@dataclass(frozen=True, slots=True)
class Row:
    """A setting made for one α, and the task that flies it; several rows may share a task."""

    alpha: float
    recipe: Recipe
    task: Task


def run_study(study: Study, jobs: int = 1, progress: Callable[[int, int], None] | None = None) -> Results:
    """Run all of a study and score it.

    progress: called with (impacts done, impacts in all) as they come in.
    Raises UserError for what the study asks wrongly, and EngineMissing, before anything runs.
    """
    with WorkerPool(jobs) as pool:
        return run_with(pool, study, progress)


def run_with(pool: WorkerPool, study: Study, progress: Callable[[int, int], None] | None = None) -> Results:
    """The same by processes that have more to do before or after."""
    rows = plan(study, pool)
    tasks = {row.task.key: row.task for row in rows}
    return gather(study, rows, fly(list(tasks.values()), pool, progress))


def gather(study: Study, rows: Sequence[Row], impacts: Mapping[TaskKey, Sequence[Impact]]) -> Results:
    """Score the impacts of each row's task, and put all of it into tables."""
    import pandas as pd  # here, as the processes that fly need none of it

    tables: dict[str, list[Any]] = {"impacts": [], "loops": [], "scores": []}
    for row in rows:
        setting, found = row.task.setting, impacts[row.task.key]
        law = HuntCrossley(study.scene.stiffness, row.alpha, study.scene.exponent)
        key = (study.scene.name, setting.engine, setting.name, row.alpha, setting.timestep)
        tables["impacts"].append(pd.DataFrame(impact_columns(key, columns_of(found), law)))
        tables["loops"] += [
            loop_table(key, i) for i in found if i.launch in row.task.keep and i.loop is not None
        ]
        tables["scores"].append((*key, *dataclasses.astuple(scoring.score(found, law, study.scene.mass))))
    return Results(
        study=study.described(),
        settings=[setting_record(study.scene.name, row) for row in rows],
        versions=versions(run.engine for run in study.runs),
        impacts=pd.concat(tables["impacts"], ignore_index=True),
        loops=pd.concat(tables["loops"], ignore_index=True)
        if tables["loops"]
        else pd.DataFrame(columns=LOOP_COLUMNS),
        scores=pd.DataFrame(tables["scores"], columns=[*RUN_KEY, *scoring.SCORE_FIELDS]),
        trains=_train_table(study, rows),
    )


def _train_table(study: Study, rows: Sequence[Row]) -> pd.DataFrame:
    """Bounce trains of the settings at the study's train step, for its main α."""
    import pandas as pd

    from hcbench.benchmark.bounce_sequence import bounce_trains

    law = HuntCrossley(study.scene.stiffness, study.main_alpha, study.scene.exponent)
    settings = {
        row.task.setting.key: row.task.setting
        for row in rows
        if row.alpha == study.main_alpha and row.task.setting.timestep == study.train_step
    }
    found = []
    if study.train_height is not None:
        found = bounce_trains(
            study.scene, [(law, setting) for setting in settings.values()], study.train_height
        )
    name = study.scene.name
    return pd.DataFrame(
        [(name, s.engine, s.name, alpha, s.timestep, *rest) for alpha, s, *rest in found],
        columns=TRAIN_COLUMNS,
    )


def plan(study: Study, pool: WorkerPool | None = None) -> list[Row]:
    """A study's settings, each for one α and step. Rows of settings that do not depend on α share a task.

    pool: makes them, side by side; None: this process does. Raises UserError for what the study asks wrongly,
    and EngineMissing.
    """
    asked = [(i, target) for i, run in enumerate(study.runs) for target in _targets(study, run)]
    for run in study.runs:
        registry.recipe(_recipe(run))
        registry.engine(run.engine).version()  # a missing engine is said before anything runs
    orders = [(_recipe(study.runs[i]), target) for i, target in asked]
    if pool is None:
        settings = [_made(order) for order in orders]
    else:
        # Runs of few rows first: that they are few is mostly because each takes a search.
        rows_of = Counter(i for i, _ in asked)
        turn = sorted(range(len(asked)), key=lambda k: rows_of[asked[k][0]])
        by_turn = dict(zip(turn, pool.map(_made, [orders[k] for k in turn]), strict=True))
        settings = [by_turn[k] for k in range(len(asked))]
    return [
        _row(study, study.runs[i], target, setting)
        for (i, target), setting in zip(asked, settings, strict=True)
    ]


def _recipe(run: Run) -> str:
    return f"{run.engine}.{run.recipe}"


def _targets(study: Study, run: Run) -> list[Target]:
    scene, low, high = study.scene, min(study.speeds), max(study.speeds)
    laws = [HuntCrossley(scene.stiffness, alpha, scene.exponent) for alpha in run.alphas]
    return [Target(law, scene.mass, timestep, low, high) for timestep in run.timesteps for law in laws]


def _made(order: tuple[str, Target]) -> Setting:
    recipe, target = order
    return registry.recipe(recipe)(target)


def _row(study: Study, run: Run, target: Target, setting: Setting) -> Row:
    phases = (np.arange(study.phases) + 0.5) / study.phases
    kept = [v for v in study.loop_speeds if run.speeds == study.speeds]
    launches = Launches(tuple(sorted({*run.speeds, *kept})), tuple(phases.tolist()))
    keep = tuple(Launch(v, float(phases[study.phases // 2])) for v in kept)
    return Row(target.law.alpha, registry.recipe(_recipe(run)), Task(study.scene, setting, launches, keep))


def fly(
    tasks: Sequence[Task], pool: WorkerPool, progress: Callable[[int, int], None] | None = None
) -> dict[TaskKey, list[Impact]]:
    """Fly tasks; impacts by task key."""
    total, out = sum(len(task.launches) for task in tasks), {}
    # Longest first, so that no worker starts the longest last.
    order = sorted(tasks, key=lambda task: -len(task.launches) / task.setting.timestep)
    waiting = {pool.threads.submit(_fly_surviving, task): task for task in order}
    for future in as_completed(waiting):
        out[waiting[future].key] = future.result()
        if progress is not None:
            progress(sum(map(len, out.values())), total)
    return out


def _fly_surviving(task: Task) -> list[Impact]:
    """A task that its process died on is tried once more; what dies again is CRASHED."""
    for _ in range(2):
        with suppress(WorkerDied):
            return call(_fly_one, task, limit=None)
    reason = "the engine's process died on it, twice"
    return [Impact(launch, Status.CRASHED, reason) for launch in task.launches]


def _fly_one(task: Task) -> list[Impact]:
    impacts = registry.engine(task.setting.engine).run(task.scene, task.setting, task.launches)
    return [i if i.launch in task.keep else dataclasses.replace(i, loop=None) for i in impacts]


def impact_columns(key: tuple[Any, ...], columns: Mapping[str, Any], law: HuntCrossley) -> dict[str, Any]:
    """IMPACT_COLUMNS: `columns_of` impacts, with the values of RUN_KEY and the truth of that key's law."""
    speed = columns["speed_in_m_per_s"]
    known = np.isfinite(speed)
    by_law = np.full(len(speed), np.nan)
    by_law[known] = closed_form.restitution(law.alpha, speed[known])
    truth = {"restitution_law": by_law, "restitution_linear": 1.0 - law.alpha * speed}
    found = {**dict(zip(RUN_KEY, key, strict=True)), **columns, **truth}
    return {name: found[name] for name in IMPACT_COLUMNS}


def loop_table(key: tuple[Any, ...], impact: Impact) -> pd.DataFrame:
    """LOOP_COLUMNS of one impact, thinned to what a figure can show. key: the values of RUN_KEY."""
    import pandas as pd

    loop = impact.loop
    assert loop is not None
    every = np.unique(
        np.linspace(0, len(loop.time) - 1, min(LOOP_SAMPLES, len(loop.time))).round().astype(int)
    )
    columns = (loop.time[every], loop.penetration[every], loop.rate[every], loop.force[every])
    head = (*key, impact.launch.speed, impact.launch.phase)
    return pd.DataFrame(dict(zip(LOOP_COLUMNS, (*head, *columns), strict=True)))


def setting_record(scene: str, row: Row) -> dict[str, Any]:
    """A row's key, its setting and what its recipe says of it."""
    setting = row.task.setting
    key = dict(zip(RUN_KEY, (scene, setting.engine, setting.name, row.alpha, setting.timestep), strict=True))
    return {**key, "options": setting.options, "summary": row.recipe.summary, "notes": list(row.recipe.notes)}


def versions(engines: Iterable[str]) -> dict[str, str]:
    """Of everything that makes a result what it is: package or engine, and version."""
    packages = {name: version(name) for name in ("hcbench", "matplotlib", "numpy", "scipy")}
    return {
        **packages,
        "python": platform.python_version(),
        **{n: registry.engine(n).version() for n in sorted(set(engines))},
    }
