"""Installs engines into environments of their own: what each needs, and a bounce to try it."""

from __future__ import annotations

import re
import sys
from importlib import metadata
from typing import TYPE_CHECKING, NamedTuple

from hcbench import environments
from hcbench.environments import ADD
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.sim import entry_points, registry
from hcbench.sim.remote import interpreter, worker_requirements
from hcbench.system.errors import CannotRun, EngineFailed, HcbenchError, UserError
from hcbench.terms.impact import Launch, Status
from hcbench.terms.scene import load_scene
from hcbench.workers import call

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from hcbench.environments import Environment
    from hcbench.sim.backend import Backend

# Limit of a trial bounce, s: engines that compile their kernels first take a minute.
_TRIAL_S = 300.0
# Time step, s, and speed, m/s, of that bounce.
_TRIAL_STEP = 1e-3
_TRIAL_SPEED = 0.4
_VERSION = re.compile(r"\d[\w.+!-]*")


def add(
    name: str,
    python: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Environment:
    """Install an engine into an environment of its own, or return one installed that fits the
    request.

    name: "myengine", for the newest version, or "myengine@1.2".
    python: a version or path of an interpreter; None for that of this process, or the newest that
    the engine has wheels for.
    progress: called with (steps done, steps in all).
    Raises UserError for what is not to be had, CannotRun for what does not run, OutputError.
    """
    base, at, version = name.partition("@")
    backend = _backend(base)
    if at and not _VERSION.fullmatch(version):
        raise UserError("engine", repr(name), f"a version after the @, such as {base}@1.2")
    if python == "":
        raise UserError("python", "''", "a version or a path", "Leave the option out for this one")
    asked = requirements(base, backend, version)
    present = environments.find(base, version) if at else None
    if present and set(asked) <= set(present.requirements) and python in (None, present.python):
        return present
    return environments.add(
        base, backend.package, asked, python or _own_python(backend), _try, progress
    )


def _own_python(backend: Backend) -> str:
    """The Python of this process, or the newest that an engine has wheels for."""
    newest = tuple(int(part) for part in backend.newest_python.split(".") if part)
    if newest and sys.version_info[:2] > newest:
        return backend.newest_python
    return sys.executable


def add_commands(names: Iterable[str]) -> list[str]:
    """The commands that add engines, as few as may be: those that need the same Python together."""
    by_python: dict[str, list[str]] = {}
    for name in names:
        backend = registry.engine(registry.base_name(name)).backend
        python = ""
        if backend is not None:
            python = backend.newest_python
        by_python.setdefault(python, []).append(name)
    commands = []
    for python, group in sorted(by_python.items()):
        command = f"{ADD} {' '.join(group)}"
        if python:
            command += f" --python {python}"
        commands.append(command)
    return commands


def names() -> list[str]:
    """Engines that have a package to install."""
    return [name for name in registry.names() if registry.engine(name).backend is not None]


class PackageFiles(NamedTuple):
    """Files of a package in this Python environment: their size, in bytes, and their folder."""

    size: int
    folder: str


def files_of(name: str) -> PackageFiles:
    """Files of an engine's package in this Python environment; of size 0 and in the folder "" for an
    engine without a package, or where that is not installed.

    Raises UserError for an unknown engine.
    """
    backend = registry.engine(name).backend
    if backend is None:
        return PackageFiles(0, "")
    size = 0
    folder = ""
    for package in filter(None, (backend.package, backend.instead)):
        for distribution in metadata.Distribution.discover(name=package):
            size += sum(file.size or 0 for file in distribution.files or ())
            folder = str(distribution.locate_file(""))
    return PackageFiles(size, folder)


def _backend(name: str) -> Backend:
    """The Python package behind an engine. Raises UserError for an engine that needs none."""
    backend = registry.engine(name).backend
    if backend is None:
        raise UserError(
            "engine", repr(name), "one that has a package to install", "This one needs none"
        )
    return backend


def requirements(name: str, backend: Backend, version: str) -> list[str]:
    """Requirements of an engine's environment as lines for pip: those of hcbench's worker, those of
    the engine's adapter, and last the engine's package.

    name: of the engine.
    version: of its package; "" for any from the oldest tried on.
    """
    adapter = entry_points.entry_point(name).dist
    # An adapter that is in no package declares nothing.
    declared = (adapter and adapter.requires) or ()
    is_own = adapter is not None and adapter.name == "hcbench"
    lines = list(worker_requirements())
    # The engine's package; the adapter may declare it with extras, such as "package[viewer]".
    asked = backend.package
    for line in declared:
        needed, _, marker = line.partition(";")
        needed = needed.strip()
        marker, of_extra = _without_extra(marker, name)
        # Needed: lines of the extra named as the engine, and those without an extra; but hcbench's
        # own without an extra are among the worker's already.
        is_needed = of_extra or not (is_own or "extra" in marker)
        package = re.split(r"[^\w.-]", needed, maxsplit=1)[0]
        if package == "hcbench" or not is_needed:
            continue
        if package == backend.package:
            asked = re.split(r"[^\w.\[\],-]", needed, maxsplit=1)[0]
        else:
            lines.append("; ".join(filter(None, (needed, marker))))
    if version:
        lines.append(f"{asked}=={version}")
    else:
        lines.append(f"{asked}>={backend.oldest}")
    return lines


def _without_extra(marker: str, extra: str) -> tuple[str, bool]:
    """(a requirement's marker as it is where an extra is asked for, whether it names that extra).

    marker: such as "python_version < '3.13' and extra == 'myengine'"; "" for none.
    """
    condition = rf"extra\s*==\s*['\"]{re.escape(extra)}['\"]"
    # Most tools that build packages write it last.
    without, found = re.subn(rf"(\band\s+)?{condition}\s*$", "", marker)
    if not found:
        # Within parentheses or before others something true has to stand in its place.
        without, found = re.subn(condition, "python_version >= '3'", marker)
    return without.strip(), found > 0


def _try(made: Environment) -> None:
    """Let a ball bounce in a new environment in every recipe.

    made: the environment, with the engine installed in it.
    Raises CannotRun where that fails, whatever the reason.
    """
    there = interpreter(made)
    try:
        reason = call(_failed_bounce, made.engine, limit=_TRIAL_S, at=there)
    except Exception as error:
        reason = (
            f"{error}" if isinstance(error, HcbenchError) else f"{type(error).__name__}: {error}"
        )
    if reason:
        backend = _backend(made.engine)
        tried = f"It was left out: {backend.oldest} ... {backend.newest} were tried"
        raise CannotRun(f"engine {made.name!r}", f"installs, and does not run: {reason}", "", tried)


def _failed_bounce(name: str) -> str:
    """Bounce a ball with each recipe of an engine; return the first failure as text, or "" if all
    recipes work.

    name: of the engine, in the version that is installed in this process.
    All recipes are tried because a version may lack a feature that only some of them use. A refusal
    by hcbench, such as a step too long for a recipe or a plug-in without a compiler, does not
    count.
    Raises EngineFailed, and whatever else the engine raises.
    """
    scene = load_scene("steel-plane")
    law = HuntCrossley(scene.stiffness, 0.3, scene.exponent)
    target = Target(law, scene.mass, _TRIAL_STEP, _TRIAL_SPEED, _TRIAL_SPEED)
    engine = registry.engine(name)
    for recipe in registry.preferred(name):
        try:
            (impact,) = engine.run(scene, recipe(target), [Launch(_TRIAL_SPEED, 0.5)])
        except EngineFailed:
            raise
        except (UserError, CannotRun):
            continue
        if impact.status is Status.CRASHED:
            return f"{recipe.name}: {impact.reason}"
    return ""
