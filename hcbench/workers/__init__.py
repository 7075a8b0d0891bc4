"""Worker processes. Engines that keep globals, print or crash run in
these, never in the user's process.

`call` runs a function in a worker process, which is started when first needed and kept. Code that
runs in a process of hcbench's own already says so by `mark_as_worker`, and what it `call`s is run
in place. A `WorkerPool` has several worker processes; what comes back does not depend on how many.

A worker is a fresh interpreter, which does not run the user's main module again: scripts need no
`if __name__ == "__main__"`. Those that a command begins are copies of its process, which import
nothing again. Functions and values cross by pickle, functions by their module's name.
"""

import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any, Self, TypeVar

from hcbench.system.errors import CannotRun
from hcbench.workers.process import (
    Interpreter,
    Worker,
    WorkerDied,
    can_fork,
    use_own_worker,
    worker_of_thread,
)
from hcbench.workers.serve import (
    captured_output,
    environment,
    in_worker,
    mark_as_worker,
    redirect_output,
)

__all__ = [
    "Interpreter",
    "WorkerDied",
    "WorkerPool",
    "begin",
    "call",
    "can_fork",
    "captured_output",
    "environment",
    "in_worker",
    "map_surviving_crashes",
    "mark_as_worker",
    "redirect_output",
    "use_own_worker",
]

Job = TypeVar("Job")
Result = TypeVar("Result")

# More processes than these for each core run nothing sooner, and each takes its memory: a million
# of them would end the machine.
_MOST_A_CORE = 2


def call(
    function: Callable[..., Result],
    *args: Any,
    limit: float | None,
    longest: float = math.inf,
    at: Interpreter | None = None,
) -> Result:
    """Call `function(*args)` in the worker process of this thread and return its result.

    In a worker process of that interpreter already, it is called in place, without limits.

    limit: s of its processor time; a process that is idle for as long counts as hung, too. None:
    it is waited for for ever, and `longest` does not count.
    longest: s of the clock, with a limit; infinity for none.
    at: the interpreter of another environment; None for this process' own.

    Raises what the function raises; WorkerDied where the process did not start, crashed or passed a limit;
    EngineMissing where the environment is gone; CannotRun where the pool of this thread was closed.
    """
    if _is_here(at):
        return function(*args)
    result: Result
    (result,) = worker_of_thread().at(at).run(_yield_result, (function, *args), limit, longest)
    return result


def begin(module: str, function: str, *args: Any) -> None:
    """Start the worker process that `call` will use, and let it call a function of a module first;
    in a worker process already, do nothing.

    It is for work that takes a worker a while, such as the import of an engine, while this process
    goes on. Nothing is waited for; what the function raises is dropped.

    module, function: their names.
    args: of the function; they have to be picklable.
    """
    if not in_worker():
        worker_of_thread().begin(module, function, *args)


def _is_here(at: Interpreter | None) -> bool:
    """Say whether this process already is a worker of that interpreter."""
    return in_worker() and (at is None or at.name == environment())


def _yield_result(function: Callable[..., Result], *args: Any) -> Iterator[Result]:
    yield function(*args)


def map_surviving_crashes(
    function: Callable[..., Iterator[Result]],
    jobs: Sequence[Job],
    *args: Any,
    lost: Callable[[Job, str], Result],
    limit: float,
    together: int = 1,
    give_up: int = 3,
    at: Interpreter | None = None,
) -> list[Result]:
    """One result for each job, in order, run in a worker process; what
    crashes or hangs it costs one job.

    function: `function(jobs, *args)` yields one result for each job, in order.
    lost: makes the result of a job that the worker died on, from the job and the reason.
    limit: s of processor time for each job. together: how many jobs `function` has under way at a
    time;
        those that a crash interrupted are run one by one, to find the one that causes it.
    give_up: crashes in a row, with no result in between, after which no other job is tried.
    at: as for `call`.

    Raises what the function raises, EngineMissing and CannotRun as `call`. In a worker process
    already, it is called in place, where a crash ends that process.
    """
    if _is_here(at):
        return list(function(jobs, *args))
    worker = worker_of_thread().at(at)
    results: list[Result] = []
    crashes_in_a_row = 0
    # Jobs before this one were under way at a crash: each of them is run alone.
    suspects_end = 0
    while (done := len(results)) < len(jobs):
        is_alone = done < suspects_end
        batch = jobs[done : done + 1] if is_alone else jobs[done:]
        time_limit = limit if is_alone else limit * together
        try:
            results += worker.run(function, (batch, *args), time_limit)
            assert len(results) == done + len(batch), (
                f"{len(results) - done} results of {len(batch)} jobs"
            )
            crashes_in_a_row = 0
        except WorkerDied as death:
            # What it had sent until then is kept.
            results += death.results
            if death.results:
                crashes_in_a_row = 0
            # Any of the jobs that were under way may have caused it.
            if together > 1 and not is_alone:
                suspects_end = len(results) + together
                continue
            crashes_in_a_row += 1
            # The job after the last result is lost; none is left where it died after its last one.
            if len(results) < len(jobs):
                results.append(lost(jobs[len(results)], death.got))
            if crashes_in_a_row == give_up:
                reason = f"not tried: the engine died on the {give_up} before it ({death.got})"
                results += [lost(job, reason) for job in jobs[len(results) :]]
    return results


class WorkerPool:
    """Up to `jobs` worker processes, each with a thread of this process that waits for it.

    jobs: at most two a core are started.
    threads: an executor; what its functions `call` runs in the worker process of their thread.
    Left by an exception, the pool kills its processes regardless of what they do.
    """

    def __init__(self, jobs: int) -> None:
        self.jobs = max(1, min(jobs, _MOST_A_CORE * (os.cpu_count() or 1)))
        # Commands without a pool do not wait for this import.
        from concurrent.futures import ThreadPoolExecutor

        self._workers = [Worker() for _ in range(self.jobs)]
        idle = iter(self._workers)
        self.threads = ThreadPoolExecutor(self.jobs, initializer=lambda: use_own_worker(next(idle)))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.threads.shutdown(wait=kind is None, cancel_futures=True)
        for worker in self._workers:
            worker.close()
        self.threads.shutdown()

    def begin(self, module: str, function: str, *args: Any) -> None:
        """Start all processes, and let each call a function of a module first, as `begin` does."""
        if in_worker():
            return
        for worker in self._workers:
            worker.begin(module, function, *args)

    def map(self, function: Callable[[Job], Result], jobs: Iterable[Job]) -> list[Result]:
        """[function(job), ...], each run in a worker process. CannotRun where one died."""
        return list(self.imap(function, jobs))

    def imap(self, function: Callable[[Job], Result], jobs: Iterable[Job]) -> Iterator[Result]:
        """Map as `map` does, begun at once; each result is waited for where it is asked for."""
        return self._results(self.threads.map(partial(call, function, limit=None), jobs))

    def _results(self, results: Iterator[Result]) -> Iterator[Result]:
        """Yield results as they come, in the order of the jobs. Raises what a job raises, and
        CannotRun where a process died.
        """
        try:
            yield from results
        except WorkerDied as death:
            reason = f"a process died: {death.got}"
            raise CannotRun(
                "worker", reason, "it to end by itself", "Is there memory enough?"
            ) from None
