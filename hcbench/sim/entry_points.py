"""Entry points of the group hcbench.engines, and the adapters that they
load: what every process shares.
"""

from __future__ import annotations

import copy
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING

from hcbench.system.errors import EngineFailed, UserError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from hcbench.sim.engine import Engine

GROUP = "hcbench.engines"


@cache
def registered() -> dict[str, EntryPoint]:
    """The entry points of engines by their names, sorted, read once."""
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP), key=lambda e: e.name)}


def names() -> list[str]:
    """Names of the engines, sorted; nothing is imported."""
    return list(registered())


def entry_point(name: str) -> EntryPoint:
    """The entry point under which an engine is registered."""
    return registered()[name]


def adopt(values: Mapping[str, str]) -> None:
    """Register engines in a worker of an environment, where no package says that they are there.

    values: of the entry points, by their names.
    """
    for name, value in values.items():
        registered()[name] = EntryPoint(name, value, GROUP)


@cache
def adapter(name: str) -> Engine:
    """The adapter registered under `name`, without a version, whether the engine is installed or
    not.

    Raises UserError for an unknown name, EngineFailed for an entry point that holds no such engine.
    """
    if name not in registered():
        raise unknown("engine", name, registered())
    entry = registered()[name]
    slot = f"{GROUP} {name}"
    try:
        loaded = entry.load()()
    except Exception as error:
        raise EngineFailed(slot, f"could not be loaded: {error}", "") from error
    if (own := getattr(loaded, "name", None)) != name:
        raise EngineFailed(
            slot, f"{entry.value} has the name {own!r}", f"an Engine whose name is {name!r}"
        )
    return loaded  # type: ignore[no-any-return]


@cache
def here(name: str) -> Engine:
    """The engine of this process under a name that may state a version, such as "myengine@1.2".

    Under a version it is a copy with that name and title; the version is not compared with what is
    installed.
    Raises UserError for an unknown name, EngineFailed for an entry point that holds no such engine.
    """
    own = adapter(base_name(name))
    if name == own.name:
        return own
    made = copy.copy(own)
    made.name = name
    made.title = versioned_title(own, name)
    return made


def base_name(name: str) -> str:
    """The registered name in one that may state a version."""
    return name.partition("@")[0]


def versioned_title(adapter: Engine, name: str) -> str:
    """Return the engine's title with its version, as a report prints it under such a name."""
    return f"{adapter.title or adapter.name} {name.partition('@')[2]}".strip()


def unknown(kind: str, name: str, known: Iterable[str]) -> UserError:
    """The error to raise for a name that is not registered, with the nearest name.

    kind: what the name is of, such as "engine".
    known: the names that are registered.
    """
    from difflib import get_close_matches

    names = list(known)
    near = get_close_matches(name, names, 1)
    advice = "`hcbench engines` lists them"
    if kind == "recipe":
        advice = "`hcbench engines -v` lists them"
    if near:
        advice = f"Did you mean {near[0]!r}?"
    return UserError(kind, repr(name), f"one of: {', '.join(names) or 'none'}", advice)
