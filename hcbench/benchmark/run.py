"""Runs a study: hands its shards to worker processes or a Dask cluster, and stores what comes back.

The same study gives the same bytes for any number of jobs and any executor, and wherever it was
interrupted. The cluster may have any scheduler, however its workers came to be.
"""

from __future__ import annotations

import logging
import math
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import hcbench
from hcbench.benchmark.bounce_sequence import bounce_table, plan_drops
from hcbench.benchmark.plan import Plan, make_plan
from hcbench.benchmark.results import Results
from hcbench.benchmark.shard import Timeouts, run_bounces, run_jobs, run_shard
from hcbench.benchmark.store import GO_ON, Store, TemporaryFiles, open_files
from hcbench.benchmark.study import Study
from hcbench.benchmark.tables import Totals, arrays, load_parquet, parquet, require_parquet
from hcbench.system.errors import CannotRun, HcbenchError
from hcbench.terms.arguments import checked
from hcbench.terms.options import Jobs
from hcbench.workers import WorkerPool, can_fork

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

    impacts, shards: numbers of those in the store.
    of: the number of all impacts of the study.
    resumed: how many whole shards the store had when the run began.
    damaged: numbers of the shards that the store had and that were damaged; they are run again.
    """

    impacts: int
    of: int
    shards: int
    resumed: int
    damaged: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Workers:
    """Processes that run a study.

    width: returns the number of tasks that run at once.
    mapper: like `map`, for recipes.
    task_s: time that a task should take, s: short jobs are put together until they take so long. 0
    gives each job a task of its own.
    advice: what an error tells the user to do after the executor failed.
    start: returns which start of the executor's own scheduler takes the tasks now: one that was
    started again has lost those before.
    """

    executor: Executor
    width: Callable[[], int]
    mapper: Callable[..., Iterable[Any]] = map
    task_s: float = 0.0
    advice: str = GO_ON
    start: Callable[[], str] = str


@checked
def run_study(
    study: Study, jobs: Jobs = 1, progress: Callable[[int, int], None] | None = None
) -> Results:
    """Run all of a study and score it.

    jobs: engines at once, each in a worker process.
    progress: called with (impacts done, impacts in all) while it runs.

    Raises UserError for what the study asks wrongly, and EngineMissing, before any impact is
    simulated; then UserError for what an engine refuses, CannotRun where the workers fail, and
    OutputError where the temporary folder cannot take the results.
    """
    with WorkerPool(jobs) as pool:
        return run_in_pool(pool, study, progress)


def run_in_pool(
    pool: WorkerPool, study: Study, progress: Callable[[int, int], None] | None = None
) -> Results:
    """Run a study in a pool of processes that has other work before or after; return its results,
    which read their rows from a temporary folder.

    progress: called with (impacts done, impacts in all).
    Raises UserError for what the study asks wrongly or an engine refuses, EngineMissing, CannotRun
    where the workers fail, and OutputError where the temporary folder cannot take the results; the
    folder is then removed.
    """
    from hcbench.benchmark.read import results_in

    def report(now: Progress) -> None:
        if progress is not None:
            progress(now.impacts, now.of)

    workers = Workers(pool.threads, lambda: pool.jobs, pool.map, advice="")
    plan = make_plan(study, pool.map)
    files = TemporaryFiles()
    try:
        run_plan(
            plan,
            Store(files),
            workers,
            resume=False,
            report_progress=report,
            timeouts=Timeouts(),
            encode=arrays,
        )
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
    progress: called once at the start, and after each shard.
    timeouts: time limits of an engine; None for the defaults of `Timeouts`.

    However it ends, killed included, what is in the folder is whole; a sweep that has been resumed
    leaves the same bytes as one that was never disturbed.
    Raises UserError for what the study asks wrongly and for a folder of something else, CannotRun
    where pyarrow or an engine is missing, the folder is taken or the workers are not what they
    should be, OutputError where the folder cannot be written.
    """
    require_parquet()
    store = Store(open_files(os.fspath(folder)))
    # A plan may take a minute of searches: not for a folder that is none.
    store.require_folder()
    with workers_for(executor, scheduler, jobs) as workers:
        plan = make_plan(study, workers.mapper)
        with store.locked():
            return run_plan(
                plan, store, workers, resume, progress or (lambda _: None), timeouts or Timeouts()
            )


@contextmanager
def workers_for(executor: Executor | None, scheduler: str | None, jobs: int) -> Iterator[Workers]:
    """The executor of a sweep: one that is given, a Dask cluster, or a pool of our own.

    executor: stays open after the block; the cluster's client and our pool do not.
    scheduler: address of a Dask scheduler.
    jobs: processes of our pool, and tasks at once of an executor that does not tell its width.
    Raises CannotRun where the cluster cannot be reached, has no worker, or goes away.
    """
    if executor is not None:
        # Executors of the standard library have the number here, and in no public name.
        width = int(getattr(executor, "_max_workers", jobs))
        yield Workers(executor, lambda: width)
    elif scheduler is not None:
        with connected(scheduler) as cluster:
            yield cluster
    else:
        with WorkerPool(jobs) as pool:
            # While this process is still one thread, whose copies import nothing again. What
            # fails here, the workers report.
            if can_fork():
                with suppress(ImportError):
                    load_parquet()
            pool.begin("importlib", "import_module", run_shard.__module__)
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
    """Run the shards of a plan that are not in the store; return the state at the end.

    store: where finished shards are, and where those to come are written.
    resume: go on with a store that has the sweep already.
    report_progress: called once at the start, and after each shard.
    timeouts: time limits of an engine.
    encode: makes the bytes of a table.

    Raises UserError for a store of another sweep, or of this one without `resume`, and for what an
    engine refuses; CannotRun where the workers fail; OutputError where the store cannot be read or
    written.
    """
    store.create_or_verify(plan, resume)
    # Numbers of the shards that are whole, and of those that are run again.
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
        # The summary of each α counts the same impacts.
        impacts += summaries[0]["impacts"]
    now = Progress(
        impacts=impacts,
        of=plan.impacts,
        shards=len(done),
        resumed=len(done),
        damaged=tuple(damaged),
    )

    def write_summary() -> float:
        """Bring the summary up to date; return when, s of time.monotonic."""
        store.write_summary(plan.records, totals)
        return time.monotonic()

    written = write_summary()
    report_progress(now)
    if plan.study.train_height is not None and store.bounces() is None:
        drops = plan_drops(plan, workers.mapper)
        # Drops end in any order; the file has them in that of the plan.
        end_of = {}
        for drop, end in imap_unordered(workers, run_bounces, drops, timeouts):
            end_of[id(drop)] = end
        dropped = [(drop, end_of[id(drop)]) for drop in drops]
        store.write_bounces(bounce_table(dropped, plan.study.main_alpha, encode))
    missing = (number for number in range(len(plan)) if number not in done)
    run = partial(run_shard, encode=encode)
    for shard, files in imap_unordered(workers, run, map(plan.shard, missing), timeouts):
        store.write_shard(files, len(plan))
        totals.add(files.summaries)
        now = replace(now, impacts=now.impacts + len(shard), shards=now.shards + 1)
        if time.monotonic() - written >= _SUMMARY_S:
            written = write_summary()
        report_progress(now)
    write_summary()
    return now


def imap_unordered(
    workers: Workers,
    function: Callable[[Job, Timeouts], Result],
    jobs: Iterable[Job],
    timeouts: Timeouts,
) -> Iterator[tuple[Job, Result]]:
    """Run jobs in worker processes, and yield (job, its result) as they finish.

    function: called with a job and the timeouts, in a worker.
    jobs: taken when they are handed out, a few ahead of the workers. A task is one job or several:
    as many as take `workers.task_s`, judged by the task before.

    Raises HcbenchErrors of `function` at once. A task with any other error, such as a worker's
    death, is tried again; CannotRun where that fails too, and where the executor is shut down.
    Tasks that have not begun are cancelled then, and where the caller stops to iterate.
    """
    waiting = iter(jobs)
    jobs_a_task = 1
    # Of each task that is handed out: its jobs, and the number of the try, from 1. A task returns
    # the results of its jobs and the time that they took, s.
    running: dict[Future[tuple[list[Result], float]], tuple[list[Job], int]] = {}

    def submit(task: list[Job], tries: int) -> None:
        """Hand a task out to a worker.

        tries: number of the try, from 1.
        Raises CannotRun where the executor takes no work any more.
        """
        try:
            running[workers.executor.submit(run_jobs, function, task, timeouts)] = task, tries
        except RuntimeError as error:
            # The executor is broken, or shut down.
            raise CannotRun(
                "executor", str(error), "one that takes work", workers.advice
            ) from error

    def submit_all_again() -> None:
        """Hand out anew, as the same tries, all tasks that were handed out."""
        lost = list(running.items())
        running.clear()
        for future, (task, tries) in lost:
            future.cancel()
            submit(task, tries)

    start = workers.start()
    try:
        while True:
            if (now := workers.start()) != start:
                # What was sent to the scheduler before it started again would never end.
                start = now
                submit_all_again()
            # So many tasks that no worker waits, as long as there are jobs.
            while len(running) < _AHEAD * workers.width() and (
                task := list(islice(waiting, jobs_a_task))
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
                        raise _failed_often(task[0], error, workers.advice) from error
                    submit(task, tries + 1)
                else:
                    yield from zip(task, results, strict=True)
                    # As many jobs as take the time of a task, if they take as long as these.
                    in_time = len(task) * workers.task_s / max(seconds, 1e-9)
                    jobs_a_task = int(min(max(in_time, 1), _TOGETHER))
    finally:
        for future in running:
            future.cancel()


def _failed_often(job: object, error: Exception, advice: str) -> CannotRun:
    """The error to raise for a task that failed _TRIES times.

    job: the task's first.
    error: of the last try.
    """
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    return CannotRun("executor", f"failed {job} {_TRIES} times: {reason:.200}", "", advice)


# A Dask cluster as an executor.

# Addresses that Dask can read: any other leaves it a client that cannot even be closed.
_ADDRESS = re.compile(r"inproc://\S+|(\w+://)?[^\s/]+:\d+")
# Seconds to wait for the scheduler, and then for its first worker.
_CONNECT_S = 10.0
_WORKERS_S = 60.0
# s between two counts of the workers: each costs an answer of the scheduler.
_COUNT_S = 1.0
_INSTALL = "pip install distributed pyarrow"


@contextmanager
def connected(address: str) -> Iterator[Workers]:
    """Connect to a Dask scheduler, whose workers run a study; the connection ends with the block.

    address: such as "tcp://host:8786".

    Raises CannotRun without Dask's package, without an answer, without a worker, where a worker has
    another hcbench, and where the scheduler or the last worker goes away.
    """
    try:
        from distributed import Client
    except ImportError:
        raise CannotRun(
            "scheduler", "Dask is not installed", "its package", f"Try: {_INSTALL}"
        ) from None
    try:
        if not _ADDRESS.fullmatch(address):
            raise ValueError("not an address with a port")
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CannotRun(
            "scheduler",
            f"{address or repr(address)} does not answer: {reason:.100}",
            "the address of a running Dask scheduler, like tcp://host:8786",
        ) from None
    with _quiet():
        try:
            _require_workers(client, address)
            cluster = _Cluster(client, address)
            executor = client.get_executor(pure=False)
            yield Workers(executor, cluster.width, task_s=_TASK_S, start=cluster.start)
        except Exception:
            if client.status == "running":
                raise
            got = f"{address} went away, and did not come back within {_CONNECT_S:g} s"
            raise CannotRun(
                "scheduler", got, "one that lasts as long as the sweep", GO_ON
            ) from None
        finally:
            client.close()


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence Dask's lines about a lost scheduler, and about answers to tasks that an interrupt
    cancelled: the error that is raised says it.
    """
    names = ("distributed", "distributed.client", "tornado.application")
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


class _Cluster:
    """The answers of a Dask scheduler, which is asked at most once in _COUNT_S.

    client: Dask's.
    address: of its scheduler, for errors.
    """

    def __init__(self, client: Any, address: str) -> None:
        """Begin without having asked; `client` is Dask's, `address` that of its scheduler."""
        self._client = client
        self._address = address
        # The last answer: threads of all workers, and the scheduler's own name.
        self._threads = 1
        self._name = ""
        # When it last answered, and when it last had a worker, s of time.monotonic.
        self._asked = -math.inf
        self._seen = time.monotonic()

    def width(self) -> int:
        """The number of tasks that the workers run at once, 1 or more.

        Raises CannotRun if there has been no worker for _WORKERS_S.
        """
        now = self._ask()
        # A worker that was lost may come back: for a while one task counts.
        if self._threads:
            self._seen = now
        elif now - self._seen >= _WORKERS_S:
            raise _without_workers(self._address, GO_ON)
        return max(1, self._threads)

    def start(self) -> str:
        """The name that the scheduler gave itself as it started."""
        self._ask()
        return self._name

    def _ask(self) -> float:
        """Ask the scheduler for its threads and name, if the last answer is older than _COUNT_S.

        Returns the time now, s of time.monotonic. Without an answer the last one is kept.
        """
        now = time.monotonic()
        if now - self._asked >= _COUNT_S:
            # Without an answer Dask connects again, or gives up and closes the client.
            with suppress(OSError):
                self._threads = sum(self._client.ncores().values())
                self._name = str(self._client.scheduler_info()["id"])
                self._asked = now
        return now


def _without_workers(address: str, advice: str) -> CannotRun:
    got = f"{address} has no workers after {_WORKERS_S:g} s"
    return CannotRun("scheduler", got, "one at least", advice)


def _require_workers(client: Any, address: str) -> None:
    """Wait for the first worker of a cluster, and check the version of hcbench on all.

    client: Dask's.
    address: of its scheduler, for the error.
    Raises CannotRun without a worker within _WORKERS_S, and for a worker without hcbench or with
    another version.
    """
    try:
        client.wait_for_workers(1, timeout=_WORKERS_S)
    except OSError:
        # OSError is the base of TimeoutError.
        raise _without_workers(address, "Start some: `dask worker`") from None
    here = hcbench.__version__
    # In the standard library's words: a worker without hcbench can say so.
    for worker, there in client.run(version, "hcbench", on_error="return").items():
        if there != here:
            got = "no hcbench" if isinstance(there, Exception) else f"hcbench {there}"
            raise CannotRun(
                "worker", f"{worker} has {got}", f"hcbench {here}", f"On every worker: {_INSTALL}"
            )
