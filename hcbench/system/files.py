"""Files and folders that are written whole or not at all."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import math
import os
import shutil
import signal
import stat
import sys
import tempfile
import threading
import time
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, BinaryIO, Literal

from hcbench.system.errors import HcbenchError, OutputError, UserError

MANIFEST = "hcbench-files.json"
# Largest file that is read without a limit of its own, bytes.
MOST_BYTES = 64 << 20
_KIND = "hcbench files"
# Names of scratch folders begin and end with these.
_SCRATCH_BEGIN = ".hcbench-"
_SCRATCH_END = ".scratch"
_LEFT_S = 3600.0
# Signals that end a command.
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
# Errors of a path that is not, or leads through, what the user took it for.
_WRONG_PATH = {errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ELOOP}
# Suffixes of the files that hcbench writes into folders.
_SUFFIXES = (".html", ".svg", ".png", ".csv", ".json")


def user_folder(kind: Literal["cache", "data"]) -> Path:
    """The folder where hcbench keeps files of a kind for this user; it may not exist yet.

    It is the folder "hcbench" in $HCBENCH_CACHE or $HCBENCH_DATA, else in $XDG_CACHE_HOME or
    $XDG_DATA_HOME, else where the system has such files.
    """
    named = os.environ.get(f"HCBENCH_{kind.upper()}") or os.environ.get(f"XDG_{kind.upper()}_HOME")
    if named:
        base = Path(named)
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / {"cache": "Caches", "data": "Application Support"}[kind]
    else:
        base = Path.home() / {"cache": ".cache", "data": ".local/share"}[kind]
    return (base / "hcbench").absolute()


def json_text(content: Any) -> str:
    """JSON, stable, with null for what is not a finite number."""
    return json.dumps(_no_nan(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def parse_json(text: str | bytes) -> Any:
    """Parse JSON. Raises ValueError for invalid text, for text nested too deeply for Python, and
    for a key that an object has twice.
    """
    if isinstance(text, str):
        # Editors in Windows begin a file with a byte-order mark.
        text = text.removeprefix("\ufeff")
    try:
        return json.loads(text, object_pairs_hook=_keys_once)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _keys_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object of these pairs. Raises ValueError for a key that comes twice: Python would
    silently keep the last value.
    """
    content: dict[str, Any] = {}
    for key, value in pairs:
        if key in content:
            raise ValueError(f"the key {key[:60]!r} is there twice")
        content[key] = value
    return content


def _no_nan(content: Any) -> Any:
    """Content for JSON with None for each number that is not finite, and lists for tuples."""
    if isinstance(content, dict):
        return {key: _no_nan(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return list(map(_no_nan, content))
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content


def is_file(path: str | Path) -> bool:
    """True for a file, or a link to one; False also for a name that no file can have."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        # For example a name that is too long, or has a null character.
        return False


def is_folder(path: str | Path) -> bool:
    """True for a folder, or a link to one; False also for a name that no folder can have."""
    try:
        return Path(path).is_dir()
    except (OSError, ValueError):
        return False


def why_no_file(path: Path) -> str:
    """The reason why a path cannot be read as a file, as it follows its name: "is a folder"."""
    if path.is_dir():
        return "is a folder"
    if path.exists():
        return "is not a file that can be read again"
    return "is a link that leads to no file" if path.is_symlink() else "is not there"


class _UnreadableError(OSError):
    """An input that cannot be read. Its text is the reason alone, without the system's number."""

    def __str__(self) -> str:
        return str(self.strerror)


def open_input(path: Path) -> BinaryIO:
    """Open a user's file for reading, or a stream that this process was given: /dev/stdin, the
    shell's <(...).

    Raises OSError for a missing file, for a folder, and for any other pipe or device, which might
    never end; ValueError for a name with a null character.
    """
    status = path.stat()
    if stat.S_ISREG(status.st_mode):
        return path.open("rb")
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    with suppress(FileNotFoundError):
        for name in os.listdir("/dev/fd"):  # noqa: PTH208 - numbers, not files
            with suppress(OSError):
                if os.path.samestat(os.fstat(int(name)), status):
                    # Opened again by its name, a pipe waits for one more writer.
                    return os.fdopen(os.dup(int(name)), "rb")
    raise _UnreadableError(errno.EINVAL, "a pipe or a device, not a file")


# Streams that this process was given and has read: each kept open, so that no other gets its number
# in the file system, with what was in it.
_STREAMS: dict[tuple[int, int], tuple[BinaryIO, bytes]] = {}


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """The content of a file of at most `most` bytes, opened by `open_input`.

    A pipe can be read once: its content is kept, and each later call returns it again.

    Raises as `open_input`, and OSError for a longer file, regardless of the size that it states.
    """
    file = open_input(path)
    status = os.fstat(file.fileno())
    key = (status.st_dev, status.st_ino)
    if stat.S_ISREG(status.st_mode):
        with file:
            content = file.read(most + 1)
    elif key in _STREAMS:
        file.close()
        content = _STREAMS[key][1]
    else:
        content = file.read(MOST_BYTES + 1)
        _STREAMS[key] = (file, content)
    if len(content) > most:
        raise _UnreadableError(errno.EFBIG, f"has more than {most >> 20} MiB")
    return content


def read_text(path: Path, encoding: str = "utf-8-sig", most: int = MOST_BYTES) -> str:
    """The text of a file, by `read_bytes`, without the mark that editors in Windows begin it with."""
    return read_bytes(path, most).decode(encoding)


def require_small_archive(content: bytes) -> None:
    """Raise ValueError where the members of a zip file come to more than
    MOST_BYTES by the sizes that it states; zipfile.BadZipFile for another content.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(member.file_size for member in archive.infolist()) > MOST_BYTES:
            raise ValueError(f"unpacks to more than {MOST_BYTES >> 20} MiB")


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all. UserError, or OutputError, where it cannot be written."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes | Iterable[bytes], slot: str = "output") -> None:
    """Write a file whole or not at all, or through a device or pipe, and through links to either.

    content: or its pieces, one after the other.
    slot: of an error.
    Raises as `unwritable`: UserError for a path at which no file can be, OutputError where it
    cannot be written.
    """
    try:
        stream = _open_stream(path)
        if stream is None:
            _remove_left(path.resolve().parent)
            replace_file(path.resolve(), content)
        else:
            with stream:
                stream.writelines(_pieces(content))
    except OSError as error:
        raise unwritable(slot, path, error, "a place that can be written to") from None


def _remove_left(folder: Path) -> None:
    """Take away what killed processes were writing in a folder: files of `replace_file` that
    are older than any write lasts. What cannot be removed stays.
    """
    for left in folder.glob(".hcbench-*.new"):
        with suppress(OSError):
            if time.time() - left.lstat().st_mtime > _LEFT_S:
                left.unlink()


def _open_stream(path: Path) -> BinaryIO | None:
    """Open a device, a pipe or the shell's redirection for writing. None for a regular or a missing
    file, which the caller replaces as a whole. OSError for a folder and anything else.
    """
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    # /dev/stdout may lead to a file: replacing that file would cut the shell off from it.
    descriptor = standard_stream(status)
    if descriptor is not None:
        return os.fdopen(descriptor, "wb", closefd=False)
    if stat.S_ISCHR(status.st_mode) or stat.S_ISFIFO(status.st_mode):
        return path.open("wb")
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "neither a file, a character device nor a pipe")
    if not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    return None


def _pieces(content: bytes | Iterable[bytes]) -> Iterable[bytes]:
    """The pieces of a content; one where it is whole."""
    if isinstance(content, bytes):
        return [content]
    return content


def standard_stream(status: os.stat_result) -> int | None:
    """Descriptor of the standard stream that the shell sends to a file: 1 for output, 2 for errors;
    None for neither.

    status: of the file.
    """
    for descriptor in (1, 2):
        # The stream may be closed.
        with suppress(OSError):
            if os.path.samestat(os.fstat(descriptor), status):
                return descriptor
    return None


def replace_file(path: Path, content: bytes | Iterable[bytes], sync: bool = False) -> None:
    """Write a file whole or not at all: a neighbour first, which is then
    renamed; OSError where that fails.

    path: of a regular or a missing file; a link is replaced, not followed.
    content: or its pieces, one after the other.
    sync: wait until the content is on disk.
    """
    # Two processes, or two threads, never write the same neighbour.
    neighbour = path.parent / f".hcbench-{os.getpid()}-{threading.get_ident()}.new"
    try:
        with neighbour.open("wb") as file:
            file.writelines(_pieces(content))
            if sync:
                file.flush()
                os.fsync(file.fileno())
        neighbour.replace(path)
    except BaseException:
        neighbour.unlink(missing_ok=True)
        raise


def unwritable(
    slot: str, path: Path | str, error: OSError, expected: str, advice: str = ""
) -> HcbenchError:
    """The error of hcbench for a path that could not be written: a UserError where no file can be,
    an OutputError for a full disk, a permission and anything else.

    error: of the system.
    slot, expected, advice: of the new error.
    """
    if error.errno == errno.ENAMETOOLONG:
        return UserError(slot, f"{str(path)[:80]}...: {error.strerror}", "a shorter path")
    # A file that is missing in a folder that exists: the system makes none there, as in /proc.
    is_refused = error.errno == errno.ENOENT and Path(path).parent.is_dir()
    if error.errno in _WRONG_PATH and not is_refused:
        return UserError(slot, f"{path}: {error.strerror}", expected, advice)
    return OutputError(slot, f"{path}: {error.strerror or error}", expected, advice)


@contextmanager
def atomic_folder(folder: Path, *names: str) -> Iterator[Path]:
    """A scratch folder whose files move into `folder` when the block
    ends well; else nothing is left.

    names: files that it will write, as far as they are known before. Files that an earlier block
    wrote and this one did not are deleted, unless they were modified since: MANIFEST lists what was
    written, with a digest of each.

    Raises UserError, and nothing is written, where a file that is not of an earlier block, or a
    link within the folder, is in the way; UserError or OutputError as `unwritable`; OutputError
    where another process is writing into the folder.
    """
    made: list[Path] = []
    scratch: Path | None = None
    try:
        made = [p for p in (folder, *folder.parents) if not p.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        _require_ours(folder, names, _read_manifest(folder))
        with scratch_folder(folder, alone=True) as scratch:
            yield scratch
            with deferred_signals():
                _move_all(scratch, folder)
    except BaseException as error:
        for path in made:
            if path.exists() and not any(path.iterdir()):
                path.rmdir()
        if isinstance(error, OSError):
            raise unwritable(
                "output folder", folder, error, "a folder that can be written to"
            ) from None
        if isinstance(error, UserError | OutputError) and scratch and str(scratch) in error.got:
            # The user knows the output folder, where the file would be, and not the scratch folder.
            got = error.got.replace(str(scratch), str(folder))
            raise type(error)(error.slot, got, error.expected, error.advice) from None
        raise


@contextmanager
def scratch_folder(folder: Path, alone: bool = False) -> Iterator[Path]:
    """A new folder in `folder`, locked until the block ends and removed then; those that killed
    processes left there are removed too.

    alone: raises OutputError where another process, or block, has one there. OSError where none can
    be made.
    """
    # Locked, so that nobody takes the new one for left over before it is locked itself. A scratch
    # folder, in which another is made, is locked already.
    is_scratch = folder.name.endswith(_SCRATCH_END)
    with nullcontext() if is_scratch else _locked(folder):
        for left in folder.glob(f"{_SCRATCH_BEGIN}*{_SCRATCH_END}"):
            # One whose lock can be had has no owner any more.
            try:
                with suppress(FileNotFoundError), _locked(left, wait=False):
                    shutil.rmtree(left, ignore_errors=True)
            except OSError:
                if alone:
                    got = f"another command is writing into {folder}"
                    expected = "another folder"
                    raise OutputError("output folder", got, expected) from None
        scratch = Path(tempfile.mkdtemp(_SCRATCH_END, _SCRATCH_BEGIN, folder))
        lock = ExitStack()
        lock.enter_context(_locked(scratch))
    with lock:
        try:
            yield scratch
        finally:
            shutil.rmtree(scratch, ignore_errors=True)


@contextmanager
def _locked(folder: Path, wait: bool = True) -> Iterator[None]:
    """Hold the lock of a folder within the block; on Windows, which has no such locks, do nothing.

    wait: wait until the process that has the lock ends. Else OSError is raised where another one
    has it, and where the folder is a link, which another user may have put there.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    opening = os.O_RDONLY | os.O_DIRECTORY
    locking = fcntl.LOCK_EX
    if not wait:
        opening |= os.O_NOFOLLOW
        locking |= fcntl.LOCK_NB
    descriptor = os.open(folder, opening)
    try:
        fcntl.flock(descriptor, locking)
        yield
    finally:
        os.close(descriptor)


def _move_all(scratch: Path, folder: Path) -> None:
    """Move all files of a scratch folder into `folder`, and delete those that an earlier block of
    `atomic_folder` wrote there and this one did not, unless they were modified since.

    Raises UserError, and moves nothing, where a file that no block wrote is in the way; OSError
    where a file cannot be moved.
    """
    earlier = _read_manifest(folder)
    # An atomic_folder within this one leaves its own manifest.
    (scratch / MANIFEST).unlink(missing_ok=True)
    items = [item for item in sorted(scratch.rglob("*")) if item.is_file()]
    written = {item.relative_to(scratch).as_posix(): _digest(item) for item in items}
    _require_ours(folder, written, earlier)
    # Listed before they are there: however this ends, it is known later what is not someone else's.
    _write_manifest(folder, {**earlier, **written})
    for item, name in zip(items, written, strict=True):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        item.replace(folder / name)
    # What an earlier block wrote and this one did not: only files of a kind that reports have.
    for name in earlier.keys() - written.keys():
        stale = folder / name
        is_report_file = (
            stale.suffix in _SUFFIXES and stale.is_file() and not _is_behind_link(folder, name)
        )
        if is_report_file and _digest(stale) == earlier[name]:
            stale.unlink()
            if stale.parent != folder and not any(stale.parent.iterdir()):
                stale.parent.rmdir()
    _write_manifest(folder, written)


def _is_behind_link(folder: Path, name: str) -> bool:
    return (folder / name).resolve() != folder.resolve() / name


def _require_ours(folder: Path, names: Iterable[str], earlier: Mapping[str, str]) -> None:
    """Raise UserError where writing a file would replace one that no earlier block of
    `atomic_folder` wrote, or would go through a link out of the folder.

    names: of files to write, relative to the folder.
    earlier: digests of what was written, by name.
    """
    for name in (MANIFEST, *names):
        path = folder / name
        is_ours = path.is_file() and (name == MANIFEST or name in earlier)
        in_the_way = path.parent.is_file() or (path.exists() and not is_ours)
        if in_the_way or _is_behind_link(folder, name):
            raise UserError(
                "output folder",
                f"{path} is not of an earlier report",
                "a folder without it",
                "Move it away, or take another folder",
            )


def _write_manifest(folder: Path, files: dict[str, str]) -> None:
    write_text(folder / MANIFEST, json_text({"schema": 1, "kind": _KIND, "files": files}))


def _read_manifest(folder: Path) -> dict[str, str]:
    """{name, relative to `folder`: SHA-256 digest} of files that were written earlier; empty without
    a MANIFEST that can be read.
    """
    try:
        content = parse_json(read_text(folder / MANIFEST))
        if content["kind"] != _KIND:
            return {}
        digests = {}
        for name, digest in content["files"].items():
            path = Path(name)
            # Nothing outside the folder was written by hcbench.
            if not path.is_absolute() and ".." not in path.parts:
                digests[str(name)] = str(digest)
        return digests
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextmanager
def deferred_signals() -> Iterator[None]:
    """Let Ctrl-C, TERM, HUP and ALRM wait until the block is through; for moments, in the main
    thread. The first that came is then raised again. In another thread nothing changes.
    """
    pending: list[int] = []
    handlers: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        # SIGALRM is one of the others that comes again.
        for name in (*SIGNALS, "SIGALRM"):
            number = getattr(signal, name, None)
            if number is not None and callable(signal.getsignal(number)):
                handlers[number] = signal.signal(number, lambda n, _: pending.append(n))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if pending:
        signal.raise_signal(pending[0])
