"""Compiles the contact's C once for each installed engine, and keeps the result in the user's cache folder.

The layout of MuJoCo's structs comes from the headers that its wheel ships. A C compiler is looked for under
$CC, then as cc, gcc and clang, then as the `ziglang` package. HCBENCH_COMPILED=0 turns all of this off.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

_HERE = Path(__file__).parent
_SOURCES = (
    "laws/exact_step.c",
    "laws/touch_speed.c",
    "laws/impacts.c",
    "laws/published.c",
    "engines/mujoco/plugin/plugin.c",
    "engines/mujoco/plugin/touch.c",
    "engines/mujoco/plugin/force.c",
    "engines/mujoco/plugin/restitution.c",
)
_FLAGS = ("-O2", "-std=gnu11", "-fPIC", "-shared", "-ffp-contract=off")
_LIMIT_S = 120.0


class NotCompiled(Exception):  # noqa: N818 - reads as what happened
    """No compiled path here; the message says why."""


def compiler() -> list[str]:
    """The command that compiles C; NotCompiled where there is none."""
    if os.environ.get("HCBENCH_COMPILED", "1") == "0":
        raise NotCompiled("HCBENCH_COMPILED=0 turns compiled contact off")
    if os.environ.get("CC"):
        return shlex.split(os.environ["CC"])
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc"]
    raise NotCompiled("no C compiler found (looked for $CC, cc, gcc, clang and the package ziglang)")


def _cache() -> Path:
    base = os.environ.get("HCBENCH_CACHE") or os.environ.get("XDG_CACHE_HOME")
    if base:
        return Path(base) / "hcbench"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "hcbench"
    return Path.home() / ".cache" / "hcbench"


def _private(folder: Path) -> bool:
    """Whether `folder` exists, is ours alone and takes files: nobody else may leave a library there."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
    except (OSError, RuntimeError):
        return False
    mine = not hasattr(os, "getuid") or (status.st_uid == os.getuid() and not status.st_mode & 0o022)
    return mine and os.access(folder, os.W_OK)


def _folder() -> Path:
    folder = _cache()
    return folder if _private(folder) else Path(tempfile.mkdtemp(prefix="hcbench-"))


def _compile(command: list[str], source: Path, target: Path) -> None:
    # Built beside its place and renamed into it: another process may be building the same.
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        built = Path(folder) / target.name
        try:
            run = subprocess.run(
                [*command, str(source), "-o", str(built), "-lm"],
                capture_output=True,
                text=True,
                timeout=_LIMIT_S,
                check=False,
            )
        except (OSError, subprocess.SubprocessError) as error:
            raise NotCompiled(f"{command[0]} could not be run: {error}") from error
        if run.returncode:
            last = (run.stderr.strip().splitlines() or ["no message"])[-1]
            raise NotCompiled(f"{command[0]} failed: {last}")
        built.replace(target)


def library(source: str, flags: tuple[str, ...] = (), headers: tuple[Path, ...] = ()) -> ctypes.CDLL:
    """The compiled `source` of this package, from the cache where it has been compiled before.

    Raises NotCompiled with the reason.
    """
    command = [*compiler(), *_FLAGS, *flags]
    key = hashlib.sha256(repr((sys.platform, platform.machine(), command)).encode())
    for path in (*(_HERE / name for name in _SOURCES), *headers):
        key.update(path.read_bytes())
    target = _folder() / f"{Path(source).stem.strip('_')}-{key.hexdigest()[:20]}.so"
    if not target.exists():
        _compile(command, _HERE / source, target)
    try:
        return ctypes.CDLL(str(target))
    except OSError as error:
        raise NotCompiled(f"{target} could not be loaded: {error}") from error


@functools.cache
def law_library() -> ctypes.CDLL:
    """The laws alone, no engine."""
    return library("laws/impacts.c")
