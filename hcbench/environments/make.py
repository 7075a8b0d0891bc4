"""Makes an environment with uv: beside its place first, then by a rename,
so that none is there half-made.
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
from dataclasses import replace
from importlib import metadata
from pathlib import Path

from hcbench.environments import store
from hcbench.environments.store import Environment
from hcbench.system.errors import CannotRun, HcbenchError, OutputError, UserError
from hcbench.system.files import scratch_folder

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

    engine: its name. package: the one whose version is the engine's.
    requirements: what to install, as pip writes it.
    python: a version or a path, of an installed interpreter.
    trial: uses the environment before it is moved into its place; what it raises ends all.
    progress: called with (steps done, steps in all).

    Raises UserError for a version that the package index does not have, or has no wheel of, and for
    a Python that is not on this machine or too old; CannotRun without uv, without a network, and
    for any other failure of uv; OutputError for a full disk and a folder that cannot be written.
    Then nothing is left of it.
    """
    home = store.home()
    try:
        home.mkdir(parents=True, exist_ok=True)
        with scratch_folder(home) as scratch:
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
                engine, version, version_of_python, size, tuple(requirements), folder
            )
            made.write()
            trial(made)
            placed = replace(made, folder=home / made.name)
            store.replace(folder, placed, scratch)
            progress(3, 3)
    except OSError as error:
        raise OutputError(
            "engines", f"{home}: {error.strerror or error}", "a folder that takes it"
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
    """Path of the newest of the `_known_pythons` of a version such as "3.13" or "3"; "" for none of
    them, and for an argument that is a path.
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
    """Make an empty environment in a folder.

    python: a version or a path.

    Raises UserError for a Python that is not on this machine or is too old, CannotRun without uv,
    and as `_explained` says for any other failure of uv.
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

    text: message of uv in one line. about: what was to be made, for the error. folder: on the disk
    whose free space is stated.
    """
    if "No space left" in text or "os error 28" in text:
        left = f"{shutil.disk_usage(folder).free >> 20} MiB left on the disk of {store.home()}"
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
