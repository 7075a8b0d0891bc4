"""The files of a sweep: on a file system of this machine, in memory, or
anywhere else that fsspec opens.

Files appear whole or not at all, and one sweep at a time writes. On this machine's file systems the
lock ends with the process that holds it, however that ends; elsewhere (s3://, gs://) and on Windows
it is a file that its owner keeps fresh, and that is given up when it is not.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import socket
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from fsspec.core import url_to_fs
from fsspec.implementations.local import LocalFileSystem

from hcbench.system.errors import CannotRun, OutputError, UserError
from hcbench.system.files import parse_json, replace_file

LOCK = "_lock"
# Time between two writes of a lock file, and age at which its owner has ended.
_FRESHEN_S = 30.0
_STALE_S = 300.0


class Files:
    """The files of a folder, by names relative to it. OSError for what cannot be done."""

    def __init__(self, system: Any, root: str, where: str) -> None:
        """The files below `root`, on any file system that fsspec knows.

        system: of fsspec, where the folder is `root`.
        where: how the user calls it.
        """
        self._system = system
        self._root = root.rstrip("/")
        self.where = where
        # Content of the lock file while this object holds it; its time is that of the last write.
        self._mine: dict[str, Any] = {}

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}" if name else self._root

    def _path_to_write(self, name: str) -> str:
        path = self._path(name)
        self._system.makedirs(path.rpartition("/")[0], exist_ok=True)
        return path

    def names(self, folder: str = "") -> list[str]:
        """Names of the files in this folder or in one below it, sorted; none without such a folder."""
        return self._entries(folder, directories=False)

    def folders(self) -> list[str]:
        """The names of the folders in it, sorted."""
        return self._entries("", directories=True)

    def _entries(self, folder: str, directories: bool) -> list[str]:
        """Sorted names of the files, or of the folders, in a folder; none where it does not
        exist.
        """
        try:
            entries = self._system.ls(self._path(folder), detail=True, refresh=True)
        except (FileNotFoundError, NotADirectoryError):
            return []
        chosen = [
            entry["name"] for entry in entries if (entry["type"] == "directory") is directories
        ]
        return sorted(name.rstrip("/").rpartition("/")[2] for name in chosen)

    def read(self, name: str) -> bytes:
        """A file's content."""
        content: bytes = self._system.cat_file(self._path(name))
        return content

    def write(self, name: str, content: bytes) -> None:
        """Write a file, whole or not at all; CannotRun where another sweep has taken the lock."""
        if self._mine and _is_stale(self._mine):
            # This machine slept, or was stopped.
            self._claim(self._mine)
        self._system.pipe_file(self._path_to_write(name), content)

    def move(self, name: str, to: str) -> None:
        """Give a file another name."""
        self._system.mv(self._path(name), self._path_to_write(to))

    @contextmanager
    def locked(self) -> Iterator[None]:
        """While no other sweep writes here; CannotRun where one does."""
        mine = {**_myself(), "token": secrets.token_hex(8)}
        self._claim(mine)
        self._mine = mine
        done = threading.Event()

        def freshen() -> None:
            while not done.wait(_FRESHEN_S):
                # The next write of the sweep raises CannotRun where another has the lock.
                with suppress(OSError, CannotRun):
                    self._claim(mine)

        thread = threading.Thread(target=freshen, daemon=True)
        thread.start()
        try:
            yield
        finally:
            done.set()
            thread.join()
            with suppress(OSError, ValueError):
                if self._has_lock(mine):
                    self._system.rm_file(self._path(LOCK))
            self._mine = {}

    def _claim(self, mine: dict[str, Any]) -> None:
        """Write the lock file of this sweep; CannotRun if another sweep holds it.

        mine: its content, with a token of its own; its time becomes that of this write.
        """
        if LOCK in self.names():
            owner = self.read(LOCK).decode("utf-8", "replace")
            with suppress(ValueError, KeyError, TypeError):
                other = parse_json(owner)
                if not _is_stale(other) and other.get("token") != mine["token"]:
                    raise _taken(self.where, owner)
        content = {**mine, "time": time.time()}
        self._system.pipe_file(self._path_to_write(LOCK), json.dumps(content).encode())
        # Another sweep wrote its lock at the same time, and the last to write has it.
        if not self._has_lock(mine):
            raise _taken(self.where, "")
        mine.update(content)

    def _has_lock(self, mine: dict[str, Any]) -> bool:
        return bool(parse_json(self.read(LOCK)).get("token") == mine["token"])


class LocalFiles(Files):
    """On a file system of this machine, a shared one included."""

    def write(self, name: str, content: bytes) -> None:
        """Write a file, whole or not at all; it is on disk then."""
        replace_file(Path(self._path_to_write(name)), content, sync=True)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """While no other sweep writes here; CannotRun where one does."""
        with super().locked() if sys.platform == "win32" else self._flocked():
            for unfinished in Path(self._root).rglob(".*.new"):
                # A killed sweep leaves the file that it was writing.
                unfinished.unlink()
            yield

    @contextmanager
    def _flocked(self) -> Iterator[None]:
        """The lock of POSIX, which ends with its process."""
        import fcntl

        path = Path(self._path_to_write(LOCK))
        while True:
            with path.open("a+", encoding="utf-8") as file:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    file.seek(0)
                    raise _taken(self.where, file.read()) from None
                if not _is_at(file.fileno(), path):
                    # The owner removed the file meanwhile: a lock without a name keeps no sweep
                    # out.
                    continue
                try:
                    file.truncate(0)
                    file.write(json.dumps(_myself()))
                    file.flush()
                    yield
                finally:
                    with suppress(OSError):
                        path.unlink()
                return


def open_files(where: str) -> Files:
    """The files in a folder, by path or fsspec URL; nothing is made yet.

    Raises UserError for a URL that fsspec does not open, or whose package is not installed.
    """
    if "://" not in where:
        return LocalFiles(LocalFileSystem(), str(Path(where).absolute()), where)
    try:
        system, root = url_to_fs(where)
    except (ImportError, ValueError) as error:
        raise UserError(
            "folder", f"{where}: {error}", "a path, or an URL that fsspec opens"
        ) from None
    protocols = system.protocol
    if not isinstance(protocols, tuple):
        protocols = (protocols,)
    if "file" in protocols:
        return LocalFiles(system, root, where)
    return Files(system, root, where)


class TemporaryFiles(Files):
    """Files of a new temporary folder; it goes with the last that holds
    this object, or with this process.
    """

    def __init__(self) -> None:
        """Raises OutputError where no temporary folder can be made."""
        try:
            root = tempfile.mkdtemp(prefix="hcbench-")
        except OSError as error:
            got = error.strerror or str(error)
            expected = "a temporary folder that can be written to"
            raise OutputError("TMPDIR", got, expected) from None
        super().__init__(LocalFileSystem(), root, root)
        self.remove = weakref.finalize(self, shutil.rmtree, root, ignore_errors=True)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle it as `Files`: another process reads the folder as long as it exists."""
        return Files, (self._system, self._root, self.where)


def _is_stale(lock: dict[str, Any]) -> bool:
    """Say whether a lock was not written for so long that its owner has ended."""
    return bool(time.time() - lock["time"] >= _STALE_S)


def _is_at(descriptor: int, path: Path) -> bool:
    """Say whether an open file is still the one of this path."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


def _myself() -> dict[str, Any]:
    return {"host": socket.gethostname(), "pid": os.getpid(), "time": time.time()}


def _taken(where: str, owner: str) -> CannotRun:
    """The error for a folder that another sweep writes to.

    owner: content of the lock file, which a killed sweep may have left incomplete.
    """
    try:
        content = parse_json(owner)
        who = f"another sweep, process {content['pid']} on {content['host']}, is writing there"
    except (ValueError, KeyError, TypeError):
        who = "another sweep is writing there"
    return CannotRun(
        "folder", f"{where}: {who}", "one sweep at a time", "Wait for it, or take another folder"
    )
