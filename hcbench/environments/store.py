"""Store of engine environments: a folder each, with a record of its contents."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hcbench.system.errors import OutputError
from hcbench.system.files import (
    json_text,
    parse_json,
    read_text,
    scratch_folder,
    user_folder,
    write_text,
)

RECORD = "hcbench-engine.json"
# Version of the record: one of another hcbench is not read.
_SCHEMA = 1


@dataclass(frozen=True, slots=True)
class Environment:
    """One engine in one version, installed in an environment of its own.

    version: of the engine's package.
    python: the interpreter's version.
    size: bytes of its files.
    requirements: what was asked for, as pip writes it.
    folder: where it is.
    """

    engine: str
    version: str
    python: str
    size: int
    requirements: tuple[str, ...]
    folder: Path

    @property
    def name(self) -> str:
        """The name that settings use: "myengine@1.2"."""
        return f"{self.engine}@{self.version}"

    @property
    def executable(self) -> Path:
        """The Python of this environment."""
        windows = self.folder / "Scripts" / "python.exe"
        return windows if windows.exists() else self.folder / "bin" / "python"

    def write(self) -> None:
        """Put the record into the folder. Raises UserError or OutputError as `write_text`."""
        content = {
            "schema": _SCHEMA,
            "engine": self.engine,
            "version": self.version,
            "python": self.python,
            "size_bytes": self.size,
            "requirements": self.requirements,
        }
        write_text(self.folder / RECORD, json_text(content))


def home() -> Path:
    """The folder that has the environments; it may not be there yet."""
    return user_folder("data") / "engines"


def environments(engine: str = "*") -> list[Environment]:
    """Environments that are complete, of all engines or of one, by engine and version."""
    whole = []
    for folder in home().glob(f"{engine}@*"):
        with suppress(OSError, ValueError, KeyError, TypeError):
            whole.append(_read(folder))
    return sorted(whole, key=lambda environment: (environment.engine, _order(environment.version)))


def find(engine: str, version: str = "") -> Environment | None:
    """The environment of an engine in a version; the newest for the version "".

    None where there is none.
    """
    matching = [e for e in environments(engine) if version in ("", e.version)]
    return matching[-1] if matching else None


def remove(environment: Environment) -> None:
    """Take an environment away: by one rename first, so that none is left in part even where this
    process is killed. Raises OutputError where its folder cannot be moved.
    """
    try:
        with scratch_folder(home()) as scratch:
            environment.folder.rename(scratch / "removed")
    except OSError as error:
        raise OutputError(environment.name, f"{environment.folder}: {error.strerror}", "") from None


def replace(made: Path, environment: Environment, scratch: Path) -> None:
    """Move an environment that was made beside into its place. OSError where that fails."""
    with suppress(FileNotFoundError):
        environment.folder.rename(scratch / "replaced")
    made.rename(environment.folder)


def _read(folder: Path) -> Environment:
    """The environment of a folder, by its record.

    Raises OSError for a folder without a record; ValueError, KeyError or TypeError for a record of
    another form or of another folder.
    """
    record: Mapping[str, Any] = parse_json(read_text(folder / RECORD))
    if record["schema"] != _SCHEMA:
        raise ValueError("of another hcbench")
    environment = Environment(
        engine=str(record["engine"]),
        version=str(record["version"]),
        python=str(record["python"]),
        size=int(record["size_bytes"]),
        requirements=tuple(map(str, record["requirements"])),
        folder=folder,
    )
    if (
        folder.name != environment.name
        or not f"{environment.name}{environment.python}".isprintable()
    ):
        raise ValueError("not in its place")
    return environment


def _order(version: str) -> list[tuple[int, str]]:
    """The key by which a version sorts: 3.9 before 3.10, and 3.9rc1 before 3.9.1."""
    order = []
    for part in re.findall(r"\d+|[a-z]+", version):
        if part.isdigit():
            order.append((int(part), ""))
        else:
            # A word sorts before any number: 3.9rc1 before 3.9.1.
            order.append((-1, part))
    return order
