"""The Python package behind an engine: whether it is there, its module, and the versions tried."""

from __future__ import annotations

import re
import warnings
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module, metadata
from typing import TYPE_CHECKING, Any

from hcbench.environments import ADD
from hcbench.system.errors import EngineMissing, foreign_errors
from hcbench.workers import in_worker

if TYPE_CHECKING:
    from hcbench.sim.engine import Engine


class UntriedVersionWarning(UserWarning):
    """An engine's package has a version that hcbench was never run with."""


@dataclass(frozen=True, slots=True)
class Backend:
    """One of an engine's packages.

    engine: the engine's name.
    package: as the package index has it.
    oldest, newest: versions between which it was tried, as many numbers of them as matter.
    install: the command; "" for pip with that package.
    instead: a package that has the same module.
    newest_python: the last that its wheels are for; "" for any.
    """

    engine: str
    package: str
    oldest: str
    newest: str
    install: str = ""
    instead: str = ""
    newest_python: str = ""

    def add_command(self, name: str = "") -> str:
        """The command that adds the engine in its own environment.

        name: may have a version, "engine@1.2".
        """
        python = f" --python {self.newest_python}" if self.newest_python else ""
        return f"{ADD} {name or self.engine}{python}"

    @property
    def command(self) -> str:
        """The command that installs the engine."""
        return self.install or f"pip install {self.package}"

    def version(self) -> str:
        """The installed version; nothing is imported. Raises EngineMissing."""
        for package in filter(None, (self.package, self.instead)):
            with suppress(metadata.PackageNotFoundError):
                return installed_version(package)
        raise self._missing("not installed", "its wheel")

    def module(self, name: str = "") -> Any:
        """Import the package's module `name`; by default the module named like the package.

        Raises EngineMissing where it cannot be imported.
        """
        try:
            return import_module(name or self.package)
        except ImportError as error:
            raise self._missing(f"cannot be imported: {error}") from None

    def _missing(self, got: str, expected: str = "") -> EngineMissing:
        advice = f"Try: {self.add_command()}, or: {self.command}"
        return EngineMissing(f"engine {self.engine!r}", got, expected, advice)

    def untried(self, version: str) -> str:
        """Warning that hcbench was not tested with `version`; "" if the version is within the
        tested ones.
        """
        oldest = _numbers(self.oldest)
        newest = _numbers(self.newest)
        given = _numbers(version)
        if oldest <= given[: len(oldest)] and given[: len(newest)] <= newest:
            return ""
        tried = self.oldest if self.oldest == self.newest else f"{self.oldest} ... {self.newest}"
        return f"{self.package} {version} was never tried with hcbench; {tried} was"

    def explained_errors(self) -> AbstractContextManager[None]:
        """Context in which errors of a package in an untested version become EngineFailed, in one
        line, with the advice to install a tested version.

        Errors of a tested version pass unchanged: they are hcbench's own faults.
        Raises EngineMissing, before the block, where the package is not installed.
        """
        untried = self.untried(self.version())
        if not untried:
            return nullcontext()
        return foreign_errors(f"engine {self.engine!r}", advice=f"{untried}: install one of those")


# Reading a version takes milliseconds, and every setting asks for it.
@cache
def installed_version(package: str) -> str:
    """Version of a package of this environment. PackageNotFoundError for none."""
    return metadata.version(package)


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", version.partition("+")[0])[:3])


def require(engine: Engine) -> str:
    """The version of an engine; warns of one that was never tried. Raises EngineMissing."""
    version = engine.version()
    if engine.backend and not in_worker() and (untried := engine.backend.untried(version)):
        _warn(untried)
    return version


# Once, regardless of Python's own filters.
@cache
def _warn(untried: str) -> None:
    warnings.warn(untried, UntriedVersionWarning, stacklevel=4)
