"""Processes that work is handed to. What comes of it does not depend on how many there are."""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from types import ModuleType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from hcbench._files import undisturbed
from hcbench.errors import CannotRun
from hcbench.workers import process

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

T = TypeVar("T")


class Crew:
    """Up to `jobs` processes, started with the first work and there until the block is left."""

    def __init__(self, jobs: int) -> None:
        self._jobs = max(1, jobs)
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        pool, self._pool = self._pool, None
        if pool is None:
            return
        if kind is not None:
            # Nobody waits for what is in flight; a process may be in it for long.
            for process in list((pool._processes or {}).values()):
                process.kill()
        pool.shutdown(wait=kind is None, cancel_futures=True)

    def each(self, work: Callable[[Any], T], items: Sequence[Any]) -> Iterator[tuple[int, T]]:
        """(index, work(item)) as they come in. Items in flight when a process died are left out."""
        # An interrupt waits: a process that is just being started would outlive us, and complain.
        with _without_main(), undisturbed():
            pool = self._pool = self._pool or ProcessPoolExecutor(
                self._jobs, mp_context=get_context("spawn"), initializer=process.enter_worker
            )
            waiting = {}
            with suppress(BrokenProcessPool):  # a process may die before all is handed out
                for i, item in enumerate(items):
                    waiting[pool.submit(work, item)] = i
        for future in as_completed(waiting):
            try:
                yield waiting[future], future.result()
            except BrokenProcessPool:
                self._pool = None

    def all(self, work: Callable[[Any], T], items: Sequence[Any]) -> list[T]:
        """[work(item), ...]; CannotRun where a process died."""
        found = dict(self.each(work, items))
        if len(found) < len(items):
            raise CannotRun("worker", "a process died", "it to end by itself", "Is there memory enough?")
        return [found[i] for i in range(len(items))]


@contextmanager
def _without_main() -> Iterator[None]:
    """Processes started in here do not run the user's script again: it needs no main guard for us."""
    own = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = own
