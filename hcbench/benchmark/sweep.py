"""Runs a sweep: hands parts to an executor, writes what comes back, and goes on where another has ended."""

from __future__ import annotations

import os
import time
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hcbench.benchmark.folder import Folder
from hcbench.benchmark.shards import Plan
from hcbench.benchmark.tables import PartBytes, Share
from hcbench.benchmark.worker import Patience, fly_part
from hcbench.errors import CannotRun, HcbenchError
from hcbench.workers import WorkerPool

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from hcbench.benchmark.study import Study

_AHEAD = 2  # parts handed out for each that is being flown
_SUMMARY_S = 5.0  # between two summaries
_GO_ON = "Then go on with --resume"
_TRIES = 2  # of a part whose executor fails it


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a sweep is. impacts, parts: in the folder. of: all of them. found: there when it began.

    damaged: parts that were, and are flown again.
    """

    impacts: int
    of: int
    parts: int
    found: int
    damaged: tuple[int, ...] = ()


def sweep(
    study: Study,
    folder: str | Path,
    *,
    jobs: int = 1,
    resume: bool = False,
    executor: Executor | None = None,
    scheduler: str | None = None,
    progress: Callable[[Progress], None] | None = None,
    patience: Patience | None = None,
) -> Progress:
    """Fly all of a study into a folder (a path, or an URL that fsspec opens).

    jobs: engines at once, where no executor is given: each in a process of its own. resume: go on with what
    is in the folder; parts that are whole are not flown again. executor: any of concurrent.futures' kind; it
    is left open. scheduler: the address of a Dask scheduler, instead. progress: called for each part.
    However it ends, killed included, what is in the folder is whole; a sweep that has been resumed leaves the
    same bytes as one that was never disturbed.
    Raises UserError for what the study asks wrongly and for a folder of something else, CannotRun where the
    folder is taken or the workers are not what they should be, OutputError where it cannot be written.
    """
    plan, place = Plan(study), Folder(os.fspath(folder))
    with _executing(executor, scheduler, jobs) as (own, width), place.locked():
        place.begin(plan, resume)
        run = _Run(plan, place, progress or (lambda _: None), patience or Patience())
        run.go(own, width)
        return run.progress()


@contextmanager
def _executing(
    executor: Executor | None, scheduler: str | None, jobs: int
) -> Iterator[tuple[Executor, Callable[[], int]]]:
    """An executor, and how many parts it flies at once."""
    if executor is not None:
        workers = int(getattr(executor, "_max_workers", jobs))
        yield executor, lambda: workers
    elif scheduler is not None:
        from hcbench.benchmark.cluster import connected

        with connected(scheduler) as found:
            yield found
    else:
        with WorkerPool(jobs) as pool:
            yield pool.threads, lambda: jobs


class _Run:
    """One sweep from what is in its folder to the end."""

    def __init__(
        self, plan: Plan, folder: Folder, tick: Callable[[Progress], None], patience: Patience
    ) -> None:
        self._plan, self._folder, self._tick, self._patience = plan, folder, tick, patience
        self._shares: list[Share] = []
        self._done: set[int] = set()
        self._impacts = 0
        damaged = []
        for number, shares in folder.checked(len(plan)):
            if shares is None:
                damaged.append(number)
            else:
                self._take(number, shares)
        self._found, self._damaged = len(self._done), tuple(damaged)
        self._told = 0.0

    def progress(self) -> Progress:
        """Now."""
        return Progress(self._impacts, self._plan.impacts, len(self._done), self._found, self._damaged)

    def go(self, executor: Executor, width: Callable[[], int]) -> None:
        """Fly what is not there."""
        todo = (number for number in range(len(self._plan)) if number not in self._done)
        flying: dict[Future[PartBytes], tuple[int, int]] = {}
        self._summarise(0.0)
        self._tick(self.progress())

        def send(number: int, tries: int) -> None:
            try:
                future = executor.submit(fly_part, self._plan.part(number), self._patience)
            except RuntimeError as error:  # broken, or shut down
                raise CannotRun("executor", str(error), "one that takes work", _GO_ON) from error
            flying[future] = number, tries

        with ExitStack() as stack:
            stack.callback(lambda: [future.cancel() for future in flying])
            while True:
                while len(flying) < _AHEAD * width() and (number := next(todo, None)) is not None:
                    send(number, 1)
                if not flying:
                    break
                for future in wait(flying, return_when=FIRST_COMPLETED).done:
                    number, tries = flying.pop(future)
                    if (part := self._result(future, number, tries)) is None:
                        send(number, tries + 1)
                    else:
                        self._folder.put(part)
                        self._take(number, list(part.shares))
                        self._summarise(_SUMMARY_S)
                        self._tick(self.progress())
        self._summarise(0.0)

    def _result(self, future: Future[PartBytes], number: int, tries: int) -> PartBytes | None:
        """None where the executor failed, not the part, and may be asked again."""
        try:
            return future.result()
        except HcbenchError:
            raise
        except Exception as error:
            if tries < _TRIES:
                return None
            what = " ".join(f"{type(error).__name__}: {error}".split())
            raise CannotRun(
                "executor", f"failed part {number} {tries} times: {what:.200}", "", _GO_ON
            ) from error

    def _take(self, number: int, shares: list[Share]) -> None:
        self._done.add(number)
        self._shares += shares
        self._impacts += self._plan.impacts_in(number)

    def _summarise(self, after: float) -> None:
        """Write the summary if the last one is older than `after` s."""
        if time.monotonic() - self._told >= after:
            self._folder.summarise(self._plan.settings, self._shares)
            self._told = time.monotonic()
