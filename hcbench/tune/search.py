"""Searches report their progress; one that is interrupted hands out the best that it has found."""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from hcbench.impact import Floats

    Progress = Callable[[int, int], None]

_progress: ContextVar[Progress | None] = ContextVar("progress", default=None)


class SearchInterrupted(KeyboardInterrupt):
    """An interrupt in the middle of a search, with the best result until then.

    best: whatever is searched for; from a recipe, a Setting. error: its largest error of e, by the search's
    own model of the contact. done, budget: evaluations until then, and at most.
    """

    def __init__(self, best: Any, error: float, done: int, budget: int) -> None:
        super().__init__(f"the search was cut short after {done} of at most {budget} evaluations")
        self.best, self.error, self.done, self.budget = best, error, done, budget


@contextmanager
def report_progress(progress: Progress | None) -> Iterator[None]:
    """Searches in the block call `progress(done, budget)`: evaluations so far, and at most."""
    token = _progress.set(progress)
    try:
        yield
    finally:
        _progress.reset(token)


@contextmanager
def map_result(make: Callable[[Any], Any]) -> Iterator[None]:
    """In a SearchInterrupted that leaves the block, replace the best result by `make` of it."""
    try:
        yield
    except SearchInterrupted as interrupt:
        interrupt.best = make(interrupt.best)
        raise


class Search:
    """Counts the evaluations of a search, reports them and remembers the best."""

    def __init__(self, budget: int) -> None:
        self._budget, self._done = budget, 0
        self._best: tuple[float, Floats] | None = None

    def add(self, evaluations: int) -> None:
        """Count evaluations that are done or will not be needed."""
        self._done += evaluations
        if (progress := _progress.get()) is not None:
            progress(min(self._done, self._budget), self._budget)

    def record(self, parameters: Floats, errors: Floats) -> None:
        """Count evaluations: errors of e, shape (n,), at parameters of shape (n, k). NaN is the worst."""
        errors = np.nan_to_num(errors, nan=np.inf)
        i = int(np.argmin(errors))
        if self._best is None or errors[i] < self._best[0]:
            self._best = float(errors[i]), np.array(parameters[i])
        self.add(len(errors))

    @contextmanager
    def return_best_on_interrupt(self) -> Iterator[None]:
        """Turn a KeyboardInterrupt in the block into SearchInterrupted, once there is a best."""
        try:
            yield
        except KeyboardInterrupt:
            if self._best is None:
                raise
            error, parameters = self._best
            done = min(self._done, self._budget)
            raise SearchInterrupted(parameters, error, done, self._budget) from None
