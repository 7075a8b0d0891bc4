"""Recipes: functions from targets to one engine's settings, with the
properties by which one is chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.recipes.target import Target, TargetKind, require_kind
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Status
from hcbench.terms.setting import Setting

# Searches report their progress; one that is interrupted hands out the best that it has found.

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from hcbench.terms.impact import Floats

    Progress = Callable[[int, int], None]
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
    """Let searches in the block call `progress(done, budget)`: evaluations so far, and at most.

    None: no reports.
    """
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
        """Count n evaluations, and remember the one with the least error.

        parameters: (n, k).
        errors: of e at them, (n,); NaN is the worst.
        """
        errors = np.nan_to_num(errors, nan=np.inf)
        i = int(np.argmin(errors))
        # The best so far is (its error, its parameters).
        if self._best is None or errors[i] < self._best[0]:
            self._best = float(errors[i]), np.array(parameters[i])
        self.add(len(errors))

    def recorded(self, errors: LimitedErrors) -> LimitedErrors:
        """The same function of parameters, (n, k), and limits, (n,), to errors of e, (n,), that
        also counts its evaluations and remembers the best parameters.
        """

        def evaluate(parameters: Floats, limits: Floats) -> Floats:
            """The errors, which are recorded."""
            found = errors(parameters, limits)
            self.record(parameters, found)
            return found

        return evaluate

    @contextmanager
    def interrupt_with_best(self) -> Iterator[None]:
        """Turn a KeyboardInterrupt in the block into SearchInterrupted, once there is a best.

        Its best are parameters, shape (k,).
        """
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
    """Search the parameters with the least error by differential evolution (Storn & Price 1997)
    with binomial crossing, a whole generation in one call of `errors`.

    errors: of members, (n, k), and limits, (n,), to the error of each, (n,); above its limit a
    member is not needed, and any number above it will do.
    members: the first generation, (n, k).
    bounds: lowest and highest parameters, (k,) each.
    towards_best: mutants start from the best member, which is faster and finds less; else each from
    its own.
    Returns the last generation, (n, k), the member with the least error first.
    SciPy's takes longer to import than this to search.
    Raises what `errors` raises.
    """
    least = errors(members, np.full(len(members), np.inf))
    count, size = members.shape
    lowest, highest = bounds
    numbers = np.arange(count)
    # The order of the random draws must stay: searches with a seed would end elsewhere.
    for _ in range(generations):
        # Two random members for each.
        one, other = members[random.integers(0, count, (2, count))]
        base = members
        if towards_best:
            base = members[least.argmin()]
        # The factor is drawn anew in each generation.
        mutants = base + random.uniform(*_MUTATION) * (one - other)
        crossed = random.random(members.shape) < _CROSSED
        # At least one parameter of each mutant is crossed.
        crossed[numbers, random.integers(0, size, count)] = True
        trials = np.where(crossed, mutants, members)
        # What is out of bounds is drawn from within.
        outside = (trials < lowest) | (trials > highest)
        trials = np.where(outside, random.uniform(lowest, highest, members.shape), trials)
        found = errors(trials, least)
        better = found <= least
        members = np.where(better[:, None], trials, members)
        least = np.where(better, found, least)
    return members[least.argsort()]


class Role(StrEnum):
    """Property of the target that a recipe's settings match."""

    # Nothing: the engine's default.
    STOCK = "stock"
    # One restitution for all speeds.
    CONSTANT_E = "constant-e"
    # Any restitution that falls with speed.
    FALLING_E = "falling-e"
    # The restitution of eq. (16).
    LAW = "law"
    # That restitution, and the law's force over penetration.
    LAW_AND_LOOP = "law-and-loop"


@dataclass(frozen=True, slots=True)
class Integrators:
    """Integrators that a recipe works with, its default first.

    reason: why others break it.
    """

    names: tuple[str, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class Recipe:
    """Makes a setting of one engine from a target.

    engine, name: "myengine", "impulse".
    summary: what it does to e and to the loop, in one sentence.
    function: a target, and an integrator where `integrators` names some, to the setting's options;
    raises SettingError for a target that it cannot serve.
    notes: where it holds and what a user must know, a sentence each.
    native: the engine's own contact is set; else a law stands in for it, as a plug-in does.
    one_step: the bounce happens in a single step, of any length: forces and times mean nothing.
    kinds: of targets that it serves.
    instead: recipes to use for others, as a message says it.
    forms: of scenes that can have such a contact.
    steps_min: in the law's shortest contact; "auto" tries it from there on, and not at all without
    `by_auto`.
    within: how far e may be from what the role promises; 0: what `hcbench.testing` asks of all.
    ends: how every launch ends, of an engine that by default does not bounce a body at all.
    steps_min_with_gravity: as `steps_min`, under gravity, for a recipe that is softer than the law
    below it.
    exact_above: e to the impact speed over g h from which a law in place of the contact is exact,
    so that it needs no run; None where that is unknown.
    """

    engine: str
    name: str
    role: Role
    function: Callable[..., Mapping[str, Any]]
    summary: str
    notes: tuple[str, ...] = ()
    native: bool = True
    one_step: bool = False
    kinds: tuple[TargetKind, ...] = ("law", "linear", "points")
    instead: str = ""
    integrators: Integrators | None = None
    forms: tuple[str, ...] = ("plane", "cup")
    steps_min: float = 0.0
    steps_min_with_gravity: float = 0.0
    by_auto: bool = True
    within: float = 0.0
    ends: Status | None = None
    exact_above: Callable[[float], float] | None = None

    def __call__(self, target: Target, integrator: str | None = None) -> Setting:
        """Make the setting for a target.

        integrator: one of `integrators`, None for the first.
        Raises SettingError where the recipe cannot serve the target or the integrator;
        SearchInterrupted with the best setting so far where an interrupt ends its search.
        """
        if integrator is not None:
            self._require_integrator(integrator)
        require_kind(target, self.name, self.kinds, self.instead)
        with map_result(lambda options: self._setting(target, options)):
            options = (
                self.function(target) if integrator is None else self.function(target, integrator)
            )
        return self._setting(target, options)

    def _setting(self, target: Target, options: Mapping[str, Any]) -> Setting:
        return Setting(self.engine, self.name, target.timestep, options)

    def _require_integrator(self, integrator: str) -> None:
        """Raise SettingError for an integrator that the recipe does not work with."""
        if self.integrators is None:
            expected = "none: it has no choice of one"
            raise SettingError("integrator", f"{integrator!r} for {self.name!r}", expected)
        if integrator not in self.integrators.names:
            got = f"{integrator!r} with {self.name!r}: {self.integrators.reason}"
            raise SettingError("integrator", got, f"one of: {', '.join(self.integrators.names)}")


def first(
    recipes: Iterable[Recipe], role: Role, form: str, steps: float = 0.0, native: bool = True
) -> Recipe | None:
    """First recipe of a role for a scene of this form; None if there is none.

    recipes: in the order of preference.
    steps: time steps in the law's shortest contact; the recipe must not need more.
    native: true for the engine's own contact, false for a law in its place.
    """
    for recipe in recipes:
        fits = form in recipe.forms and recipe.steps_min <= steps
        if fits and recipe.role is role and recipe.native == native:
            return recipe
    return None


def on_a_plane(
    engine: str, name: str, role: Role, function: Callable[..., Mapping[str, Any]], **more: Any
) -> Callable[..., Recipe]:
    """Function of a summary and notes that makes a recipe of these fields, for scenes with a plane
    alone; with it, a table of recipes ends each entry with its sentences.

    engine, name, role, function: of the recipe; the function makes options of a target.
    more: other fields of `Recipe`.
    """
    return lambda summary, *notes: Recipe(
        engine, name, role, function, summary, notes, forms=("plane",), **more
    )


def stock(engine: str, summary: str, *notes: str, **more: Any) -> Recipe:
    """The engine with nothing set but the step.

    more: of `Recipe`.
    """
    return Recipe(engine, "stock", Role.STOCK, lambda target: {}, summary, notes, **more)
