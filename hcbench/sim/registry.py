"""Finds engines by entry points of the group hcbench.engines: ours and others come in by the same door."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any

from hcbench._arguments import checked
from hcbench.errors import EngineFailed, UserError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from hcbench.sim.engine import Engine
    from hcbench.tune.recipe import Recipe

GROUP = "hcbench.engines"


@cache
def _entry_points() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP), key=lambda e: e.name)}


def names() -> list[str]:
    """Names of the engines, sorted; nothing is imported."""
    return list(_entry_points())


@checked
def engine(name: str) -> Engine:
    """The engine registered under `name`, its backend not imported yet; UserError for an unknown name."""
    return _engine(name)


@cache
def _engine(name: str) -> Engine:
    if name not in _entry_points():
        raise _unknown("engine", name, _entry_points())
    try:
        adapter = _entry_points()[name].load()()
    except Exception as error:
        raise EngineFailed(f"{GROUP} {name}", f"could not be loaded: {error}", "") from error
    assert adapter.name == name, f"engine {adapter.name!r} is registered as {name!r}"
    return adapter  # type: ignore[no-any-return]


def submodule(name: str, part: str) -> Any:
    """The module `part` in the package of an engine, as `two_blocks`; None where the engine has none."""
    return engine(name).module(part)


def recipes(name: str) -> dict[str, Recipe]:
    """An engine's recipes by their names, sorted; UserError for an unknown engine."""
    try:
        preferred_first = engine(name).recipes()
    except ImportError as error:
        raise EngineFailed(f"recipes of {name}", f"could not be loaded: {error}", "") from error
    return {recipe.name: recipe for recipe in sorted(preferred_first, key=lambda recipe: recipe.name)}


def recipe_names() -> list[str]:
    """Names such as "engine.recipe" of every engine's recipes, sorted."""
    return sorted(f"{name}.{recipe}" for name in names() for recipe in recipes(name))


def recipe(name: str) -> Recipe:
    """The recipe with a name such as "engine.recipe"; UserError when it is unknown."""
    engine_name, _, recipe_name = name.partition(".")
    if engine_name not in names() or recipe_name not in recipes(engine_name):
        raise _unknown("recipe", name, recipe_names())
    return recipes(engine_name)[recipe_name]


def _unknown(kind: str, name: str, registered: Iterable[str]) -> UserError:
    expected = f"one of: {', '.join(registered) or 'none'}"
    return UserError(kind, repr(name), expected, "`hcbench engines` lists them")
