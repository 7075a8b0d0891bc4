"""Searches report their progress; one that is interrupted hands out the best that it has found."""

from __future__ import annotations

from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from hcbench.terms.impact import Floats

    Progress = Callable[[int, int], None]
    Errors = Callable[[Floats], Floats]
    LimitedErrors = Callable[[Floats, Floats], Floats]

_MUTATION = (0.4, 0.9)
_CROSSED = 0.9
_progress: ContextVar[Progress | None] = ContextVar("progress", default=None)


class SearchInterrupted(KeyboardInterrupt):
    """An interrupt in the middle of a search, with the best result until then.

    best: what is searched for; from a recipe, a Setting.
    error: its largest error of e, by the search's own model of the contact.
    done, budget: evaluations until then, and at most.
    """

    def __init__(self, best: Any, error: float, done: int, budget: int) -> None:
        super().__init__(f"the search was cut short after {done} of at most {budget} evaluations")
        self.best = best
        self.error = error
        self.done = done
        self.budget = budget

    def __reduce__(self) -> tuple[Any, ...]:
        # KeyboardInterrupt's own pickling calls __init__ with the message alone.
        return type(self), (self.best, self.error, self.done, self.budget)


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
    """Replace the best result of a SearchInterrupted by `make` of it, and let the exception pass."""
    try:
        yield
    except SearchInterrupted as interrupt:
        interrupt.best = make(interrupt.best)
        raise


class Search:
    """Counts the evaluations of a search, reports them and remembers the best."""

    def __init__(self, budget: int) -> None:
        self._budget = budget
        self._done = 0
        self._best: tuple[float, Floats] | None = None

    def add(self, evaluations: int) -> None:
        """Count evaluations that are done or will not be needed."""
        self._done += evaluations
        if (progress := _progress.get()) is not None:
            progress(min(self._done, self._budget), self._budget)

    def record(self, parameters: Floats, errors: Floats) -> None:
        """Count evaluations: errors of e, shape (n,), at parameters of shape (n, k).

        NaN is the worst.
        """
        errors = np.nan_to_num(errors, nan=np.inf)
        i = int(np.argmin(errors))
        if self._best is None or errors[i] < self._best[0]:
            self._best = float(errors[i]), np.array(parameters[i])
        self.add(len(errors))

    def recorded(self, errors: Errors) -> LimitedErrors:
        """The same function, of parameters (n, k), whose evaluations are counted and remembered."""

        def evaluate(parameters: Floats, _: Floats) -> Floats:
            off = errors(parameters)
            self.record(parameters, off)
            return off

        return evaluate

    @contextmanager
    def interrupt_with_best(self) -> Iterator[None]:
        """Turn a KeyboardInterrupt in the block into SearchInterrupted, once there is a best."""
        try:
            yield
        except KeyboardInterrupt:
            if self._best is None:
                raise
            error, parameters = self._best
            done = min(self._done, self._budget)
            raise SearchInterrupted(parameters, error, done, self._budget) from None


def evolve(
    errors: LimitedErrors,
    members: Floats,
    generations: int,
    bounds: tuple[Floats, Floats],
    random: np.random.Generator,
    towards_best: bool = False,
) -> Floats:
    """Members, shape (n, k), after so many generations, the one with the least error first.

    Differential evolution (Storn & Price 1997), binomial crossing, a whole generation in one call
    of `errors`, (n, k) to (n,): SciPy's takes longer to import than this to search. `errors` has
    limits (n,) too, above which any number will do.

    bounds: lowest and highest, (k,).
    towards_best: mutants differ from the best member, which is faster and finds less; else from
    their own.
    """
    worst = errors(members, np.full(len(members), np.inf))
    count, size = members.shape
    lowest, highest = bounds
    each = np.arange(count)
    for _ in range(generations):
        one, other = members[random.integers(0, count, (2, count))]
        base = members
        if towards_best:
            base = members[worst.argmin()]
        mutants = base + random.uniform(*_MUTATION) * (one - other)
        crossed = random.random(members.shape) < _CROSSED
        # At least one parameter of each mutant is crossed.
        crossed[each, random.integers(0, size, count)] = True
        trials = np.where(crossed, mutants, members)
        outside = (trials < lowest) | (trials > highest)
        trials = np.where(outside, random.uniform(lowest, highest, members.shape), trials)
        off = errors(trials, worst)
        better = off <= worst
        members = np.where(better[:, None], trials, members)
        worst = np.where(better, off, worst)
    return members[worst.argsort()]
