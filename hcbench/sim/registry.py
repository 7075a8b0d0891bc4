"""Finds engines and recipes by entry points: built-ins and plug-ins come in by the same door."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from hcbench.errors import EngineFailed, UserError

if TYPE_CHECKING:
    from hcbench.sim.engine import Engine

GROUP = "hcbench.engines"


@cache
def _found(group: str) -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in sorted(entry_points(group=group), key=lambda e: e.name)}


def names(group: str = GROUP) -> list[str]:
    """Registered names, sorted; nothing is imported."""
    return list(_found(group))


def load(group: str, name: str) -> Any:
    """The object behind an entry point; UserError when the name is unknown."""
    try:
        entry = _found(group)[name]
    except KeyError:
        known = ", ".join(_found(group)) or "none"
        kind = group.rpartition(".")[2].rstrip("s")
        raise UserError(kind, repr(name), f"one of: {known}", "`hcbench engines` lists them") from None
    try:
        return entry.load()
    except Exception as error:
        raise EngineFailed(f"{group} {name}", f"could not be loaded: {error}", "") from error


@cache
def engine(name: str) -> Engine:
    """The engine registered under `name`; its backend is not imported yet."""
    made = load(GROUP, name)()
    assert made.name == name, f"engine {made.name!r} is registered as {name!r}"
    return made  # type: ignore[no-any-return]


def submodule(name: str, part: str) -> Any:
    """The module `part` in the package of an engine, as `two_blocks`; None where the engine has none."""
    package = type(engine(name)).__module__.rpartition(".")[0]
    return import_module(f"{package}.{part}") if package and find_spec(f"{package}.{part}") else None
