"""Python environments that each hold one engine in one version, in the user's data folder.

uv makes one beside its place first; then it is renamed, so that none is there half-made. hcbench
itself is not copied there: a worker process in such an environment imports the very package that
started it (`hcbench.sim.remote`), so there is none that could be out of date.
"""

from __future__ import annotations

import ctypes
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import Any

from hcbench.system.errors import CannotRun, HcbenchError, OutputError, UserError
from hcbench.system.files import (
    json_text,
    parse_json,
    read_text,
    scratch_folder,
    user_folder,
    write_text,
)

# The command that installs a missing engine.
ADD = "hcbench engines add"


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


def installed(engine: str = "*") -> list[Environment]:
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
    matching = [e for e in installed(engine) if version in ("", e.version)]
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


def _put_in_place(made: Path, environment: Environment, scratch: Path) -> None:
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
    """The key by which a version sorts: 3.9 before 3.10, and 3.9rc1 before 3.9.1.

    A pair for each run of digits or of letters, (number, "") or (-1, letters).
    """
    order = []
    for part in re.findall(r"\d+|[a-z]+", version):
        if part.isdigit():
            order.append((int(part), ""))
        else:
            # A word sorts before any number: 3.9rc1 before 3.9.1.
            order.append((-1, part))
    return order


_END_WITH_PARENT = 1  # PR_SET_PDEATHSIG
# Lowest Python that hcbench runs on.
LOWEST_PYTHON = (3, 11)
_NO_NETWORK = re.compile(
    r"(?i)failed to fetch|error sending request|dns error|network (is|was) |timed? ?out"
)
_NO_WHEEL = re.compile(r"(?i)no (usable )?wheels|wheels are required|only found wheels")
_NO_VERSION = re.compile(
    r"(?i)there (is|are) no versions? of|was not found in the package registry"
)


def add(
    engine: str,
    package: str,
    requirements: Sequence[str],
    python: str,
    trial: Callable[[Environment], None],
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Environment:
    """Install an engine into an environment of its own, in place of one of the same version.

    engine: its name.
    package: the one whose version is the engine's.
    requirements: what to install, as pip writes it.
    python: a version or a path, of an installed interpreter.
    trial: uses the environment before it is moved into its place; what it raises ends all.
    progress: called with (steps done, steps in all).

    Raises UserError for a version that the package index does not have, or has no wheel of, and for
    a Python that is not on this machine or too old; CannotRun without uv, without a network, and
    for any other failure of uv; OutputError for a full disk and a folder that cannot be written.
    Then nothing is left of it.
    """
    parent = home()
    try:
        parent.mkdir(parents=True, exist_ok=True)
        with scratch_folder(parent) as scratch:
            folder = scratch / "environment"
            progress(0, 3)
            _make(folder, python)
            version_of_python = _python_version(folder)
            progress(1, 3)
            installing = ("pip", "install", "--no-build", "--python", str(folder), *requirements)
            _uv(*installing, folder=scratch, about=f"{engine} for Python {version_of_python}")
            progress(2, 3)
            version = _version_in(folder, package)
            size = _size(folder)
            made = Environment(
                engine=engine,
                version=version,
                python=version_of_python,
                size=size,
                requirements=tuple(requirements),
                folder=folder,
            )
            made.write()
            trial(made)
            placed = replace(made, folder=parent / made.name)
            _put_in_place(folder, placed, scratch)
            progress(3, 3)
    except OSError as error:
        raise OutputError(
            "engines", f"{parent}: {error.strerror or error}", "a folder that takes it"
        ) from None
    return placed


def interpreters() -> list[str]:
    """Versions of the Pythons on this machine, such as "3.12.4": those that uv finds,
    pyenv's, and this one; newest first. Raises CannotRun without uv.
    """
    done = _run_uv(["python", "list", "--only-installed"], Path.cwd())
    versions = {*re.findall(r"(?m)^cpython-(\d+\.\d+\.\d+)\S*\s", done.stdout), *_known_pythons()}
    return sorted(versions, key=_numbers, reverse=True)


def _known_pythons() -> dict[str, str]:
    """Version, such as "3.12.4", to path of the Python of this process, and of pyenv's from
    LOWEST_PYTHON on, whose shims hide all but one from uv.
    """
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    known = {}
    for path in pyenv.glob("3.*/bin/python"):
        version = path.parents[1].name
        is_release = re.fullmatch(r"\d+\.\d+\.\d+", version) is not None
        if is_release and _numbers(version) >= LOWEST_PYTHON:
            known[version] = str(path)
    known[platform.python_version()] = sys.executable
    return known


def _known(python: str) -> str:
    """Path of the newest installed Python of a version such as "3.13" or "3", as far as hcbench
    finds it itself (`_known_pythons`); "" where there is none, and for an argument that is a path.
    """
    if not re.fullmatch(r"\d+(\.\d+)*", python):
        return ""
    asked = _numbers(python)
    known = _known_pythons()
    fitting = [version for version in known if _numbers(version)[: len(asked)] == asked]
    if not fitting:
        return ""
    return known[max(fitting, key=_numbers)]


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(map(int, re.findall(r"\d+", version)))


def _make(folder: Path, python: str) -> None:
    """Make an empty environment of Python in a folder.

    python: a version or a path.

    Raises UserError for a Python that is not on this machine or is too old, OutputError for a full
    disk, CannotRun without uv and for any other failure of it.
    """
    interpreter = _known(python) or python
    done = _run_uv(["venv", "--relocatable", "--python", interpreter, str(folder)], folder.parent)
    if done.returncode:
        text = _one_line(done.stderr)
        if re.search(
            r"(?i)no interpreter found|not found|could not find|failed to inspect|invalid version",
            text,
        ):
            there = ", ".join(interpreters()) or "none"
            got = f"{python!r} is not on this machine"
            expected = f"one of: {there}, or a path"
            raise UserError("python", got, expected, f"Install it: uv python install {python}")
        raise _explained(text, f"an environment with Python {python}", folder.parent)
    if tuple(map(int, _python_version(folder).split(".")[:2])) < LOWEST_PYTHON:
        lowest = ".".join(map(str, LOWEST_PYTHON))
        raise UserError(
            "python", f"{python!r}, which is {_python_version(folder)}", f"{lowest} or later"
        )


def _uv(*arguments: str, folder: Path, about: str) -> None:
    done = _run_uv(arguments, folder)
    if done.returncode:
        raise _explained(_one_line(done.stderr), about, folder)


def _run_uv(arguments: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run uv in a folder, with the user's own settings of indexes, and interpreters of this machine
    only; return its exit code and output, also where it failed.

    arguments: words of the command after "uv".
    Raises CannotRun where uv is not installed.
    """
    try:
        import uv

        command = uv.find_uv_bin()
    except (ImportError, FileNotFoundError):
        raise CannotRun(
            "uv", "not installed", "the package that makes environments", "Try: pip install uv"
        ) from None
    return run_with_parent(
        [command, *arguments],
        # Elsewhere a project's own settings of uv would count, where the user happens to be.
        cwd=folder,
        env={**os.environ, "UV_PYTHON_DOWNLOADS": "never", "NO_COLOR": "1"},
    )


def run_with_parent(
    command: Sequence[str], cwd: Path, env: Mapping[str, str]
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end, without input, and return its exit code and output as text.

    On Linux it ends with this process, however that ends. OSError for a program that cannot be run.
    """
    library = ctypes.CDLL(None) if sys.platform == "linux" else None

    def begin() -> None:
        if library is not None:
            library.prctl(_END_WITH_PARENT, signal.SIGKILL)

    return subprocess.run(
        command,
        cwd=cwd,
        env=env,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=begin if library is not None else None,
    )


def _one_line(text: str) -> str:
    """A message of uv in one line, without its drawing."""
    words = re.sub(r"[×╰─▶│├┬]|(?m:^\s*(error|cause|hint):)|(?m:^(Using|warning:) .*)", " ", text)
    return " ".join(words.split())


def _explained(text: str, about: str, folder: Path) -> HcbenchError:
    """The error of hcbench for a failure of uv: OutputError for a full disk, UserError for a
    version or wheel that does not exist, CannotRun for all else.

    text: message of uv in one line.
    about: what was to be made, for the error.
    folder: on the disk whose free space is stated.
    """
    if "No space left" in text or "os error 28" in text:
        left = f"{shutil.disk_usage(folder).free >> 20} MiB left on the disk of {home()}"
        return OutputError("engines", f"no space for {about}: {left}", "more of it")
    if _NO_NETWORK.search(text):
        reason = "the network is off" if "disabled" in text else _first(r"\S+://[^\s)]+", text)
        return CannotRun("package index", f"cannot be reached for {about}: {reason}", "a network")
    if _NO_VERSION.search(text) and not _NO_WHEEL.search(text):
        got = _first(
            r"(?i)there (?:is|are) no versions? of \S+|\S+ was not found in the package registry",
            text,
        )
        return UserError("engine", f"{about}: {got}", "a version that the package index has")
    if _NO_WHEEL.search(text):
        return UserError(
            "engine",
            f"{about}: no wheel of it",
            "a version or a Python that has one",
            "Try --python",
        )
    return CannotRun("uv", f"{about}: {text}", "")


def _first(pattern: str, text: str) -> str:
    match = re.search(pattern, text)
    return match[0] if match else text


def _python_version(folder: Path) -> str:
    """Version of the Python that an environment was made with, as the environment's pyvenv.cfg has
    it.
    """
    match = re.search(
        r"(?m)^version_info = (\S+)", (folder / "pyvenv.cfg").read_text(encoding="utf-8")
    )
    assert match is not None, "uv says which"
    return match[1]


def _version_in(folder: Path, package: str) -> str:
    """Version of a package in an environment."""
    places = [str(place) for place in folder.glob("[Ll]ib/**/site-packages")]
    (distribution,) = metadata.Distribution.discover(name=package, path=places)
    return distribution.version


def _size(folder: Path) -> int:
    return sum(path.lstat().st_size for path in folder.rglob("*") if not path.is_symlink())
