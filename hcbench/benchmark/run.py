"""Runs a study: hands its shards to worker processes, and writes what comes back into a store.

The same study gives the same bytes for any number of jobs and any executor,
and wherever it was interrupted.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from hcbench.benchmark.bounce_sequence import bounce_table, plan_drops
from hcbench.benchmark.plan import Plan, make_plan
from hcbench.benchmark.results import Results
from hcbench.benchmark.shard import Timeouts, run_bounces, run_jobs, run_shard
from hcbench.benchmark.store import GO_ON, Store, TemporaryFiles, open_files
from hcbench.benchmark.study import Study
from hcbench.benchmark.tables import Totals, arrays, parquet, require_parquet
from hcbench.system.errors import CannotRun, HcbenchError
from hcbench.terms.arguments import checked
from hcbench.terms.options import Jobs
from hcbench.workers import WorkerPool

if TYPE_CHECKING:
    from hcbench.benchmark.tables import Encode

Job = TypeVar("Job")
Result = TypeVar("Result")

# Tasks handed out for each one that runs: no worker waits for its next.
_AHEAD = 2
# Jobs of a task, at most.
_TOGETHER = 16
# Length of a task on a cluster, s: each task costs the scheduler milliseconds.
_TASK_S = 1.0
# Seconds between two summaries.
_SUMMARY_S = 5.0
# Seconds between two looks at the workers while nothing comes back.
_LOOK_S = 1.0
# Tries of a task that its executor fails.
_TRIES = 2


@dataclass(frozen=True, slots=True)
class Progress:
    """State of a run.

    impacts, shards: in the store, and `of` the number of all impacts.

    resumed: shards that existed when it began.
    damaged: those that were, and are run again.
    """

    impacts: int
    of: int
    shards: int
    resumed: int
    damaged: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Workers:
    """Processes that run a study.

    width: number of tasks at once.
    mapper: like `map`, for recipes.

    task_s: how long a task may take, s, that has several jobs.
    advice: what to do after it failed.
    """

    executor: Executor
    width: Callable[[], int]
    mapper: Callable[..., Iterable[Any]] = map
    task_s: float = 0.0
    advice: str = GO_ON


@checked
def run_study(
    study: Study, jobs: Jobs = 1, progress: Callable[[int, int], None] | None = None
) -> Results:
    """Run all of a study and score it.

    progress: called with (impacts done, impacts in all) while it runs.
    Raises UserError for what the study asks wrongly, and EngineMissing, before anything runs.
    """
    with WorkerPool(jobs) as pool:
        return run_in_pool(pool, study, progress)


def run_in_pool(
    pool: WorkerPool, study: Study, progress: Callable[[int, int], None] | None = None
) -> Results:
    """Run a study as `run_study` does, in a pool of processes that has other work before or after."""
    from hcbench.benchmark.read import results_in

    def report(now: Progress) -> None:
        if progress is not None:
            progress(now.impacts, now.of)

    workers = Workers(pool.threads, lambda: pool.jobs, pool.map, advice="")
    plan = make_plan(study, pool.map)
    files = TemporaryFiles()
    try:
        run_plan(plan, Store(files), workers, False, report, Timeouts(), arrays)
        return results_in(Store(files), pool.map)
    except BaseException:
        files.remove()
        raise


def sweep(
    study: Study,
    folder: str | Path,
    *,
    jobs: int = 1,
    resume: bool = False,
    executor: Executor | None = None,
    scheduler: str | None = None,
    progress: Callable[[Progress], None] | None = None,
    timeouts: Timeouts | None = None,
) -> Progress:
    """Run all of a study into a folder (a path, or an URL that fsspec opens).

    jobs: engines at once, where no executor is given: each in a process of its own.
    resume: go on with what is in the folder; shards that are whole are not run again.
    executor: any of concurrent.futures' kind; it is left open.
    scheduler: the address of a Dask scheduler, instead.
    progress: called for each shard.

    However it ends, killed included, what is in the folder is whole; a sweep that has been resumed
    leaves the same bytes as one that was never disturbed. Raises UserError for what the study asks
    wrongly and for a folder of something else, CannotRun where the folder is taken or the workers
    are not what they should be, OutputError where it cannot be written.
    """
    require_parquet()
    store = Store(open_files(os.fspath(folder)))
    with _workers(executor, scheduler, jobs) as workers:
        plan = make_plan(study, workers.mapper)
        with store.locked():
            return run_plan(
                plan, store, workers, resume, progress or (lambda _: None), timeouts or Timeouts()
            )


@contextmanager
def _workers(executor: Executor | None, scheduler: str | None, jobs: int) -> Iterator[Workers]:
    """The executor of a sweep: one that is given, a Dask cluster, or a pool of our own."""
    if executor is not None:
        width = int(getattr(executor, "_max_workers", jobs))
        yield Workers(executor, lambda: width)
    elif scheduler is not None:
        from hcbench.benchmark.cluster import connected

        with connected(scheduler) as (cluster, threads):
            yield Workers(cluster, threads, task_s=_TASK_S)
    else:
        with WorkerPool(jobs) as pool:
            yield Workers(pool.threads, lambda: jobs, pool.map)


def run_plan(
    plan: Plan,
    store: Store,
    workers: Workers,
    resume: bool,
    report_progress: Callable[[Progress], None],
    timeouts: Timeouts,
    encode: Encode = parquet,
) -> Progress:
    """Run what is not in the store.

    encode: makes the bytes of a table.

    store: where finished parts are, and where those to come are written.
    resume: go on with a store that has parts. Raises UserError for such a store without it.
    report_progress: called after each part.
    timeouts: time limits of an engine, s.
    """
    store.create_or_verify(plan, resume)
    done = set[int]()
    damaged = list[int]()
    totals = Totals()
    impacts = 0
    for number, summaries in store.verified(len(plan)):
        if summaries is None:
            damaged.append(number)
            continue
        done.add(number)
        totals.add(summaries)
        impacts += summaries[0]["impacts"]
    now = Progress(impacts, plan.impacts, len(done), len(done), tuple(damaged))

    def write_summary() -> float:
        store.write_summary(plan.records, totals)
        return time.monotonic()

    written = write_summary()
    report_progress(now)
    if plan.study.train_height is not None and store.bounces() is None:
        drops = plan_drops(plan, workers.mapper)
        # Drops end in any order; the file has them in that of the plan.
        end_of = {}
        for drop, end in _imap_unordered(workers, run_bounces, drops, timeouts):
            end_of[id(drop)] = end
        dropped = [(drop, end_of[id(drop)]) for drop in drops]
        store.write_bounces(bounce_table(dropped, plan.study.main_alpha, encode))
    missing = (number for number in range(len(plan)) if number not in done)
    run = partial(run_shard, encode=encode)
    for shard, files in _imap_unordered(workers, run, map(plan.shard, missing), timeouts):
        store.write_shard(files, len(plan))
        totals.add(files.summaries)
        now = replace(now, impacts=now.impacts + len(shard), shards=now.shards + 1)
        if time.monotonic() - written >= _SUMMARY_S:
            written = write_summary()
        report_progress(now)
    write_summary()
    return now


def _imap_unordered(
    workers: Workers,
    function: Callable[[Job, Timeouts], Result],
    jobs: Iterable[Job],
    timeouts: Timeouts,
) -> Iterator[tuple[Job, Result]]:
    """(job, its result), the first to finish first. Few are handed out
    ahead; what failed is tried again.
    """
    waiting, together = iter(jobs), 1
    running: dict[Future[tuple[list[Result], float]], tuple[list[Job], int]] = {}

    def submit(task: list[Job], tries: int) -> None:
        try:
            running[workers.executor.submit(run_jobs, function, task, timeouts)] = task, tries
        except RuntimeError as error:
            # The executor is broken, or shut down.
            raise CannotRun(
                "executor", str(error), "one that takes work", workers.advice
            ) from error

    try:
        while True:
            while len(running) < _AHEAD * workers.width() and (
                task := list(islice(waiting, together))
            ):
                submit(task, 1)
            if not running:
                return
            for future in wait(running, _LOOK_S, FIRST_COMPLETED).done:
                task, tries = running.pop(future)
                try:
                    results, seconds = future.result()
                except HcbenchError:
                    raise
                except Exception as error:
                    if tries == _TRIES:
                        reason = " ".join(f"{type(error).__name__}: {error}".split())
                        got = f"failed {task[0]} {tries} times: {reason:.200}"
                        raise CannotRun("executor", got, "", workers.advice) from error
                    submit(task, tries + 1)
                else:
                    yield from zip(task, results, strict=True)
                    more = len(task) * workers.task_s / max(seconds, 1e-9)
                    together = int(min(max(more, 1), _TOGETHER))
    finally:
        for future in running:
            future.cancel()
