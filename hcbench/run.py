"""Runs a study: plans its settings, flies them in worker processes, scores what comes back.

The same study gives the same bytes for any number of jobs: work is cut by the study alone, and results are
put back in the study's order.
"""

from __future__ import annotations

import dataclasses
import platform
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib.metadata import version
from multiprocessing import get_context
from types import ModuleType
from typing import TYPE_CHECKING, Any, overload

import numpy as np
import pandas as pd

from hcbench import compare
from hcbench.engines import isolation, registry
from hcbench.engines.stretch import columns_of
from hcbench.impact import Impact, Launch, Status
from hcbench.reference import exact
from hcbench.reference.laws import HuntCrossley
from hcbench.results import IMPACT_COLUMNS, LOOP_COLUMNS, RUN_KEY, TRAIN_COLUMNS, Results
from hcbench.trains import bounce_trains
from hcbench.tune.target import Target

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.study import Run, Study
    from hcbench.tune.target import Recipe

RECIPES = "hcbench.recipes"
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
    rows = plan(study)
    tasks = {row.task.key: row.task for row in rows}
    return gather(study, rows, fly(list(tasks.values()), jobs, progress))


def gather(study: Study, rows: Sequence[Row], impacts: Mapping[TaskKey, Sequence[Impact]]) -> Results:
    """Score the impacts of each row's task, and put all of it into tables."""
    tables: dict[str, list[Any]] = {"impacts": [], "loops": [], "scores": []}
    for row in rows:
        setting, found = row.task.setting, impacts[row.task.key]
        law = HuntCrossley(study.scene.stiffness, row.alpha, study.scene.exponent)
        key = (study.scene.name, setting.engine, setting.name, row.alpha, setting.timestep)
        tables["impacts"].append(pd.DataFrame(impact_columns(key, columns_of(found), law)))
        tables["loops"] += [
            loop_table(key, i) for i in found if i.launch in row.task.keep and i.loop is not None
        ]
        tables["scores"].append((*key, *dataclasses.astuple(compare.score(found, law, study.scene.mass))))
    return Results(
        study=study.described(),
        settings=[setting_record(study.scene.name, row) for row in rows],
        versions=versions(run.engine for run in study.runs),
        impacts=pd.concat(tables["impacts"], ignore_index=True),
        loops=pd.concat(tables["loops"], ignore_index=True)
        if tables["loops"]
        else pd.DataFrame(columns=LOOP_COLUMNS),
        scores=pd.DataFrame(tables["scores"], columns=[*RUN_KEY, *compare.SCORE_FIELDS]),
        trains=_train_table(study, rows),
    )


def _train_table(study: Study, rows: Sequence[Row]) -> pd.DataFrame:
    """Bounce trains of the settings at the study's train step, for its main α."""
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


def plan(study: Study) -> list[Row]:
    """A study's settings, each for one α and step. Rows of settings that do not depend on α share a task.

    Raises UserError for what the study asks wrongly, and EngineMissing.
    """
    return [row for run in study.runs for row in _plan(study, run)]


def _plan(study: Study, run: Run) -> list[Row]:
    recipe: Recipe = registry.load(RECIPES, f"{run.engine}.{run.recipe}")
    registry.engine(run.engine).version()  # a missing engine is said before anything runs
    scene, phases = study.scene, (np.arange(study.phases) + 0.5) / study.phases
    kept = [v for v in study.loop_speeds if run.speeds == study.speeds]
    launches = Launches(tuple(sorted({*run.speeds, *kept})), tuple(phases.tolist()))
    keep = tuple(Launch(v, float(phases[study.phases // 2])) for v in kept)
    rows = []
    for timestep in run.timesteps:
        for alpha in run.alphas:
            law = HuntCrossley(scene.stiffness, alpha, scene.exponent)
            target = Target(law, scene.mass, timestep, min(study.speeds), max(study.speeds))
            rows.append(Row(alpha, recipe, Task(scene, recipe(target), launches, keep)))
    return rows


def fly(
    tasks: Sequence[Task], jobs: int, progress: Callable[[int, int], None] | None = None
) -> dict[TaskKey, list[Impact]]:
    """Fly tasks in `jobs` worker processes; impacts by task key.

    Tasks left over when a worker died are tried once more, each alone; what dies again is CRASHED.
    """
    total, out = sum(len(task.launches) for task in tasks), {}

    def fly_batch(batch: Sequence[Task]) -> None:
        for key, found in _fly_together(batch, jobs):
            out[key] = found
            if progress is not None:
                progress(sum(map(len, out.values())), total)

    # Longest first, so that no worker starts the longest last.
    fly_batch(sorted(tasks, key=lambda task: -len(task.launches) / task.setting.timestep))
    for task in [task for task in tasks if task.key not in out]:
        fly_batch([task])
    for task in [task for task in tasks if task.key not in out]:
        reason = "the engine's process died on it, twice"
        out[task.key] = [Impact(launch, Status.CRASHED, reason) for launch in task.launches]
    return out


def _fly_together(tasks: Sequence[Task], jobs: int) -> Iterator[tuple[TaskKey, list[Impact]]]:
    """Impacts by task key as they come in; tasks whose worker died are left out."""
    context = get_context("spawn")
    with ProcessPoolExecutor(
        max(1, min(jobs, len(tasks))), mp_context=context, initializer=isolation.enter_worker
    ) as pool:
        with _without_main():
            waiting = {pool.submit(_fly_one, task): task.key for task in tasks}
        try:
            for future in as_completed(waiting):
                with suppress(BrokenProcessPool):
                    yield waiting[future], future.result()
        except BaseException:
            # Nobody waits for what is in flight; a worker may be in it for long.
            for process in list((pool._processes or {}).values()):
                process.kill()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


@contextmanager
def _without_main() -> Iterator[None]:
    """Processes started in here do not run the user's script again: it needs no main guard for us."""
    own = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = own


def _fly_one(task: Task) -> list[Impact]:
    impacts = registry.engine(task.setting.engine).drop(task.scene, task.setting, task.launches)
    return [i if i.launch in task.keep else dataclasses.replace(i, loop=None) for i in impacts]


def impact_columns(key: tuple[Any, ...], columns: Mapping[str, Any], law: HuntCrossley) -> dict[str, Any]:
    """IMPACT_COLUMNS: `columns_of` impacts, with the values of RUN_KEY and the truth of that key's law."""
    speed = columns["speed_in_m_per_s"]
    known = np.isfinite(speed)
    by_law = np.full(len(speed), np.nan)
    by_law[known] = exact.restitution(law.alpha, speed[known])
    truth = {"restitution_law": by_law, "restitution_linear": 1.0 - law.alpha * speed}
    found = {**dict(zip(RUN_KEY, key, strict=True)), **columns, **truth}
    return {name: found[name] for name in IMPACT_COLUMNS}


def loop_table(key: tuple[Any, ...], impact: Impact) -> pd.DataFrame:
    """LOOP_COLUMNS of one impact, thinned to what a figure can show. key: the values of RUN_KEY."""
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
    return {**key, "options": setting.options, "summary": row.recipe.summary, "notes": list(row.recipe.holds)}


def versions(engines: Iterable[str]) -> dict[str, str]:
    """Of everything that makes a result what it is: package or engine, and version."""
    packages = {name: version(name) for name in ("hcbench", "matplotlib", "numpy", "scipy")}
    return {
        **packages,
        "python": platform.python_version(),
        **{n: registry.engine(n).version() for n in sorted(set(engines))},
    }
