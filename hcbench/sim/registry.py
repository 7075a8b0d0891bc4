"""Finds engines by entry points of the group hcbench.engines, built-in and third-party ones alike.

"myengine" is the engine beside hcbench, or the newest in an environment of its own where none is
installed; "myengine@1.2" is that version, wherever it is.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from hcbench import environments
from hcbench.sim import backend, entry_points
from hcbench.sim.engine import Engine, module_of
from hcbench.sim.entry_points import here, unknown
from hcbench.sim.remote import missing, remote
from hcbench.system.errors import EngineFailed, EngineMissing
from hcbench.terms.arguments import checked
from hcbench.workers import environment

if TYPE_CHECKING:
    from hcbench.recipes.recipe import Recipe

names = entry_points.names
adapter = entry_points.adapter
base_name = entry_points.base_name


@checked
def engine(name: str) -> Engine:
    """The engine registered under `name`; its backend is not imported yet.

    name: "myengine" is the engine installed beside hcbench; else the newest in an environment of
    its own; else one whose `version` raises EngineMissing. "myengine@1.2" is that version, wherever
    it is installed; if it is not, an engine that raises EngineMissing at each use.
    Raises UserError for an unknown name, EngineFailed for an entry point that holds no engine.
    """
    base, at, version = name.partition("@")
    own = adapter(base)
    if environment():
        return here(name)
    if not at and version_beside(base):
        return own
    if installed := environments.find(base, version):
        return remote(own, name, installed)
    if not at:
        return own
    return here(name) if version_beside(base) == version else missing(own, name)


def version_beside(name: str) -> str:
    """The version of an engine that is installed beside hcbench; "" for none."""
    try:
        return adapter(name).version()
    except EngineMissing:
        return ""


def is_there(name: str) -> bool:
    """Say whether an engine can run: installed with hcbench or in an environment of its own."""
    try:
        return bool(engine(name).version())
    except EngineMissing:
        return False


def require(name: str) -> str:
    """The version of an engine; warns of one that was never tried. Raises EngineMissing."""
    return backend.require(engine(name))


def submodule(name: str, part: str) -> Any:
    """The module `part` in the package of an engine, as `two_blocks`;
    None where the engine has none.
    """
    return module_of(adapter(base_name(name)), part)


def preferred(name: str) -> list[Recipe]:
    """An engine's recipes, of each role the preferred one first; UserError for an unknown engine."""
    try:
        own = engine(name).recipes()
    except ImportError as error:
        raise EngineFailed(f"recipes of {name}", f"could not be loaded: {error}", "") from error
    return [recipe if recipe.engine == name else replace(recipe, engine=name) for recipe in own]


def recipes(name: str) -> dict[str, Recipe]:
    """An engine's recipes by their names, sorted; UserError for an unknown engine."""
    return {
        recipe.name: recipe for recipe in sorted(preferred(name), key=lambda recipe: recipe.name)
    }


def recipe_names() -> list[str]:
    """Names such as "engine.recipe" of every engine's recipes, sorted."""
    return sorted(f"{name}.{recipe}" for name in names() for recipe in recipes(name))


def recipe(name: str) -> Recipe:
    """The recipe with a name such as "engine.recipe"; UserError when it is unknown."""
    engine_name, _, recipe_name = name.rpartition(".")
    if base_name(engine_name) not in names() or recipe_name not in recipes(engine_name):
        raise unknown("recipe", name, recipe_names())
    return recipes(engine_name)[recipe_name]
