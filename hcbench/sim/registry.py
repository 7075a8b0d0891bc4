"""Finds engines by entry points of the group hcbench.engines, built-in and third-party ones alike.

"myengine" is the engine beside hcbench, or the newest in an environment of its own where none is installed;
"myengine@1.2" is that version, wherever it is.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any

from hcbench._arguments import checked
from hcbench.environments import store
from hcbench.errors import EngineFailed, EngineMissing, UserError
from hcbench.sim.backend import UntriedVersionWarning
from hcbench.sim.engine import Engine, module_of
from hcbench.sim.remote import missing, remote, renamed
from hcbench.workers import environment, in_worker

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from hcbench.recipes.recipe import Recipe

GROUP = "hcbench.engines"


@cache
def _entry_points() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP), key=lambda e: e.name)}


def names() -> list[str]:
    """Names of the engines, sorted; nothing is imported."""
    return list(_entry_points())


@checked
def engine(name: str) -> Engine:
    """The engine registered under `name`, its backend not imported yet; UserError for an unknown name.

    name: with "@" and a version for one of several, which may be in an environment of its own.
    """
    base, at, version = name.partition("@")
    own = adapter(base)
    if environment():
        return renamed(own, name)
    if not at and version_beside(base):
        return own
    if found := store.find(base, version):
        return remote(own, name, found)
    if not at:
        return own
    return renamed(own, name) if version_beside(base) == version else missing(own, name)


def base_name(name: str) -> str:
    """The registered name in one that may say a version."""
    return name.partition("@")[0]


def version_beside(name: str) -> str:
    """The version of an engine that is installed beside hcbench; "" for none."""
    try:
        return adapter(name).version()
    except EngineMissing:
        return ""


def is_there(name: str) -> bool:
    """Whether an engine can run: beside hcbench or in an environment of its own."""
    try:
        return bool(engine(name).version())
    except EngineMissing:
        return False


def require(name: str) -> str:
    """The version of an engine; warns of one that was never tried. Raises EngineMissing."""
    found = engine(name)
    version = found.version()
    if found.backend and not in_worker() and (untried := found.backend.untried(version)):
        _warn(untried)
    return version


@cache  # once, whatever Python's own filters make of it
def _warn(untried: str) -> None:
    warnings.warn(untried, UntriedVersionWarning, stacklevel=3)


def entry_point(name: str) -> EntryPoint:
    """What an engine of a registered name comes by."""
    return _entry_points()[name]


def adopt(values: Mapping[str, str]) -> None:
    """Register engines in a worker of an environment, where no package says that they are there.

    values: of the entry points, by their names.
    """
    for name, value in values.items():
        _entry_points()[name] = EntryPoint(name, value, GROUP)


@cache
def adapter(name: str) -> Engine:
    """What hcbench knows of the engine registered under `name`, installed or not, without a version.

    Raises UserError for an unknown name, EngineFailed for an entry point that holds no such engine.
    """
    if name not in _entry_points():
        raise _unknown("engine", name, _entry_points())
    entry, slot = _entry_points()[name], f"{GROUP} {name}"
    try:
        found = entry.load()()
    except Exception as error:
        raise EngineFailed(slot, f"could not be loaded: {error}", "") from error
    if not isinstance(found, Engine) or getattr(found, "name", None) != name:
        got = f"{entry.value} has the name {getattr(found, 'name', None)!r}"
        raise EngineFailed(slot, got, f"an Engine whose name is {name!r}, as in its entry point")
    return found


def submodule(name: str, part: str) -> Any:
    """The module `part` in the package of an engine, as `two_blocks`; None where the engine has none."""
    return module_of(adapter(base_name(name)), part)


def preferred(name: str) -> list[Recipe]:
    """An engine's recipes, of each role the preferred one first; UserError for an unknown engine."""
    try:
        found = engine(name).recipes()
    except ImportError as error:
        raise EngineFailed(f"recipes of {name}", f"could not be loaded: {error}", "") from error
    return [recipe if recipe.engine == name else replace(recipe, engine=name) for recipe in found]


def recipes(name: str) -> dict[str, Recipe]:
    """An engine's recipes by their names, sorted; UserError for an unknown engine."""
    return {recipe.name: recipe for recipe in sorted(preferred(name), key=lambda recipe: recipe.name)}


def recipe_names() -> list[str]:
    """Names such as "engine.recipe" of every engine's recipes, sorted."""
    return sorted(f"{name}.{recipe}" for name in names() for recipe in recipes(name))


def recipe(name: str) -> Recipe:
    """The recipe with a name such as "engine.recipe"; UserError when it is unknown."""
    engine_name, _, recipe_name = name.rpartition(".")
    if base_name(engine_name) not in names() or recipe_name not in recipes(engine_name):
        raise _unknown("recipe", name, recipe_names())
    return recipes(engine_name)[recipe_name]


def _unknown(kind: str, name: str, registered: Iterable[str]) -> UserError:
    expected = f"one of: {', '.join(registered) or 'none'}"
    return UserError(kind, repr(name), expected, "`hcbench engines` lists them")
