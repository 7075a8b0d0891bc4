"""Compiles the contact laws' C once for each installed engine; keeps the
result in the user's cache folder.

A C compiler is looked for under $CC, then as cc, gcc and clang, then as the `ziglang` package.
"""

from __future__ import annotations

import atexit
import ctypes
import errno
import functools
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from hcbench.system.errors import CannotRun, UserError
from hcbench.system.files import replace_file, user_folder

_HERE = Path(__file__).parents[1]
FLAGS = ("-O3", "-std=gnu11", "-fPIC", "-shared", "-ffp-contract=off")
_A_COMPILER = "a C compiler, such as cc, gcc or clang"
_GET_ONE = "Install one, or: pip install 'hcbench[plugin]'"
_WORKING = "a C compiler that works"
_ANOTHER = "Name another by $CC, or: pip install 'hcbench[plugin]' and CC='python -m ziglang cc'"
# A program that loads the library which its argument names.
_LOAD = "import ctypes, sys; ctypes.CDLL(sys.argv[1])"
# s: a new ziglang builds its own C library before the first compilation.
_LIMIT_S = 600.0


class NotCompiled(CannotRun):
    """No compiled library here; the message says why."""

    def __init__(self, reason: str, expected: str = _A_COMPILER, advice: str = _GET_ONE) -> None:
        super().__init__("contact plug-ins", reason, expected, advice)


def compiler() -> list[str]:
    """Return the command that compiles C, with the arguments that $CC has and none of hcbench's.

    Raises NotCompiled if none is found, UserError if $CC cannot be parsed.
    """
    if named := os.environ.get("CC"):
        reason = "it names none"
        command: list[str] = []
        try:
            command = shlex.split(named)
        except ValueError as error:
            reason = str(error)
        if not command or not command[0]:
            expected = "a compiler, as the shell would read it"
            raise UserError("$CC", f"{named!r}: {reason}", expected, "Unset it, or: CC=gcc")
        return command
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    if importlib.util.find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "cc"]
    raise NotCompiled(
        "no C compiler found (looked for $CC, cc, gcc, clang and the package ziglang)"
    )


def is_private(folder: Path) -> bool:
    """Say whether `folder` exists and this user alone can write to it: no other may leave a library
    there. Creates it if missing; False where that fails.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = folder.stat()
    except (OSError, RuntimeError):
        return False
    return _is_ours(status) and os.access(folder, os.W_OK)


def _is_ours(status: os.stat_result) -> bool:
    """Say whether a file or folder belongs to this user, and no other user may write to it."""
    return not hasattr(os, "getuid") or (
        status.st_uid == os.getuid() and not status.st_mode & 0o022
    )


def is_whole(library: Path) -> bool:
    """Say whether a compiled library is unchanged: it belongs to this user and has the digest
    stored beside it, in a file that this user alone can write too. False for a missing one.
    """
    digest = library.with_suffix(".sha256")
    try:
        for path in (library, digest):
            # Of the path itself: a link may lead anywhere.
            status = path.lstat()
            if not stat.S_ISREG(status.st_mode) or not _is_ours(status):
                return False
        return digest.read_text(encoding="ascii") == _digest(library)
    except (OSError, ValueError):
        return False


def _digest(library: Path) -> str:
    return hashlib.sha256(library.read_bytes()).hexdigest()


@functools.cache
def _temporary_folder() -> Path:
    """A folder for where no cache can be written to; it goes when this process ends."""
    folder = Path(tempfile.mkdtemp(prefix="hcbench-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _folder() -> Path:
    folder = user_folder("cache")
    return folder if is_private(folder) else _temporary_folder()


def _compile(command: list[str], target: Path) -> None:
    """Compile a library, and put it at `target`, whole or not at all, and then its digest beside it:
    without that no library counts as whole.

    command: the compiler's, without its output.
    target: in an existing folder.
    Raises NotCompiled with what the compiler said, why it could not be run, or that what it wrote
    does not load; OSError where the file cannot be written.
    """
    # As errors call the compiler.
    name = command[0]
    if named := os.environ.get("CC"):
        name = f"CC={named}"
    # Built beside its place and renamed into it: another process may be building the same.
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        built = Path(folder) / target.name
        try:
            status, said = _run([*command, "-o", str(built)], folder)
        except subprocess.TimeoutExpired as error:
            raise NotCompiled(f"{name} ran for {_LIMIT_S:g} s", _WORKING, _ANOTHER) from error
        except (OSError, subprocess.SubprocessError) as error:
            raise NotCompiled(f"{name} could not be run: {error}", _WORKING, _ANOTHER) from error
        if status:
            raise _failure(name, said, target.parent)
        if not built.is_file():
            reason = f"{name} ended without an error and wrote no library"
            raise NotCompiled(reason, _WORKING, _ANOTHER)
        # In a process of its own: a library that this one has loaded stays, and a bad one may end it.
        try:
            status, said = _run([sys.executable, "-I", "-S", "-c", _LOAD, str(built)], folder)
        except subprocess.TimeoutExpired as error:
            reason = f"{name} wrote a library that did not load within {_LIMIT_S:g} s"
            raise NotCompiled(reason, _WORKING, _ANOTHER) from error
        if status:
            lines = said.strip().splitlines() or [f"status {status}"]
            why = lines[-1].removeprefix("OSError: ").removeprefix(f"{built}: ")
            reason = f"{name} wrote what does not load as a library: {why}"
            raise NotCompiled(reason, _WORKING, _ANOTHER)
        # Set regardless of the umask: hcbench loads no library that others may write to.
        built.chmod(0o755)
        digest = _digest(built).encode()
        # Without fsync a machine that stops now would leave a name without content.
        with built.open("rb+") as file:
            os.fsync(file.fileno())
        built.replace(target)
    replace_file(target.with_suffix(".sha256"), digest, sync=True)


def environment(folder: str) -> dict[str, str]:
    """Environment of a compiler's process whose temporary files go to `folder`."""
    kept = {**os.environ, "TMPDIR": folder}
    if not kept.get("HOME") and not kept.get("XDG_CACHE_HOME"):
        # zig refuses to run without a place for its cache; where there is a home, it finds its own.
        kept.setdefault("ZIG_GLOBAL_CACHE_DIR", folder)
    return kept


def _run(command: list[str], folder: str) -> tuple[int, str]:
    """Exit status of a process, the compiler or the Python that loads what it built, and what it wrote
    to stderr; however this ends, none of its processes is left.

    folder: takes its temporary files, which a compiler that is killed leaves behind.
    Raises OSError where it cannot be run, subprocess.TimeoutExpired after _LIMIT_S.
    """
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        env=environment(folder),
        # A group of its own, since gcc starts cc1, as and ld: a time limit ends all of them.
        start_new_session=True,
    ) as process:
        try:
            said = process.communicate(timeout=_LIMIT_S)[1]
        except BaseException:
            _kill_group(process)
            raise
    return process.returncode, said


def _kill_group(process: subprocess.Popen[str]) -> None:
    """Kill a compiler and the processes that it started."""
    # Windows has no process groups of this kind.
    if not hasattr(os, "killpg"):
        process.kill()
        return
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def _failure(name: str, said: str, folder: Path) -> NotCompiled:
    """The error for what a compiler said: its first one, as the last line often only counts them.

    name: of the compiler.
    said: its messages.
    folder: where the library was to be written.
    """
    if os.strerror(errno.ENOSPC) in said:
        reason = f"{name} failed in {folder}: {os.strerror(errno.ENOSPC)}"
        return NotCompiled(reason, "room for the library", "Or name another folder: HCBENCH_CACHE")
    lines = said.strip().splitlines() or ["no message"]
    errors = [line for line in lines if "error:" in line]
    first = lines[-1]
    if errors:
        first = errors[0]
    return NotCompiled(f"{name} failed: {first}", _WORKING, _ANOTHER)


def build(
    source: str, flags: Sequence[str] = (), link: Sequence[str] = (), headers: Sequence[Path] = ()
) -> Path:
    """The shared library made of the C file `source` of this package; compiled
    unless the cache has it whole.

    source: relative to the package, such as "laws/impacts.c".
    flags, link: for the compiler, before and after the source.
    headers: of others; where they change, so does the library. So it does with the command, the
    machine, and any C of the source's folder and of the laws.

    Raises NotCompiled with the reason, UserError if $CC cannot be parsed.
    """
    path = _HERE / source
    command = [*compiler(), *FLAGS, *flags, str(path), *link, "-lm"]
    key = hashlib.sha256(repr((sys.platform, platform.machine(), command)).encode())
    for part in (
        *sorted(path.parent.glob("*.[ch]")),
        *sorted((_HERE / "laws").glob("*.[ch]")),
        *headers,
    ):
        key.update(part.read_bytes())
    target = _folder() / f"{path.parent.parent.name}-{path.stem}-{key.hexdigest()[:20]}.so"
    if not is_whole(target):
        _compile(command, target)
    return target


def loaded(source: str) -> Path | None:
    """The library made of `source` that this process has loaded, in any version that is in the
    cache; None without one, and on systems that cannot tell.

    source: as of `build`.
    """
    mode = getattr(os, "RTLD_NOLOAD", 0)
    if not mode:
        # This system cannot ask for a library without loading it.
        return None
    path = _HERE / source
    libraries = user_folder("cache").glob(f"{path.parent.parent.name}-{path.stem}-*.so")
    for library in libraries:
        try:
            ctypes.CDLL(str(library), mode=mode)
        except OSError:
            continue
        return library
    return None


@functools.cache
def law_library() -> ctypes.CDLL:
    """The laws alone, no engine."""
    return ctypes.CDLL(str(build("laws/impacts.c")))
