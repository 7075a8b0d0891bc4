"""A search that can be watched and cut short: what it has found until then is not lost."""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from hcbench.impact import Floats

    Tick = Callable[[int, int], None]

_watcher: ContextVar[Tick | None] = ContextVar("watcher", default=None)


class SearchCut(KeyboardInterrupt):
    """An interrupt in the middle of a search, with the best until then.

    best: whatever the search is for; from a recipe, a Setting. error: its largest error of e, by the search's
    own model of the contact. done, budget: evaluations until then, and at most.
    """

    def __init__(self, best: Any, error: float, done: int, budget: int) -> None:
        super().__init__(f"the search was cut short after {done} of at most {budget} evaluations")
        self.best, self.error, self.done, self.budget = best, error, done, budget


@contextmanager
def watched(tick: Tick | None) -> Iterator[None]:
    """Searches in the block tell `tick` how many evaluations are done, and how many there may be at most."""
    token = _watcher.set(tick)
    try:
        yield
    finally:
        _watcher.reset(token)


@contextmanager
def giving(make: Callable[[Any], Any]) -> Iterator[None]:
    """Turn what a search that is cut short has found into what the caller hands out."""
    try:
        yield
    except SearchCut as cut:
        cut.best = make(cut.best)
        raise


class Count:
    """Counts the evaluations of a search."""

    def __init__(self, budget: int) -> None:
        self._budget, self._done = budget, 0

    def add(self, evaluations: int) -> None:
        """So many more are done, or will not be needed."""
        self._done += evaluations
        if (tick := _watcher.get()) is not None:
            tick(min(self._done, self._budget), self._budget)


class Search(Count):
    """Counts the evaluations of a search and keeps the best of them."""

    def __init__(self, budget: int) -> None:
        super().__init__(budget)
        self._best: tuple[float, Floats] | None = None

    def saw(self, genes: Floats, errors: Floats) -> None:
        """Note errors of e, shape (n,), of genes of shape (n, parameters). NaN is the worst."""
        errors = np.nan_to_num(errors, nan=np.inf)
        i = int(np.argmin(errors))
        if self._best is None or errors[i] < self._best[0]:
            self._best = float(errors[i]), np.array(genes[i])
        self.add(len(errors))

    @contextmanager
    def kept(self) -> Iterator[None]:
        """An interrupt in the block is SearchCut, with the best genes so far, once there are any."""
        try:
            yield
        except KeyboardInterrupt:
            if self._best is None:
                raise
            error, genes = self._best
            raise SearchCut(genes, error, min(self._done, self._budget), self._budget) from None
