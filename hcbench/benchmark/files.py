"""Where a sweep's folder can be: a file system of this machine, memory, or anything else that fsspec opens.

Files appear whole or not at all, and one sweep at a time writes. On this machine's file systems the lock ends
with the process that holds it, however that ends; elsewhere (s3://, gs://) it is a file that its owner keeps
fresh, and that is given up when it is not.
"""

from __future__ import annotations

import json
import os
import secrets
import socket
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from hcbench.errors import CannotRun, UserError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from contextlib import AbstractContextManager

LOCK = "_lock"
_FRESHEN_S, _STALE_S = 30.0, 300.0  # how often a lock file is written, and how old it is when nobody does


class Files(Protocol):
    """The files of a folder, by names relative to it. OSError for what cannot be done."""

    def names(self, folder: str = "") -> list[str]:
        """Of the files in it, or in a folder in it; sorted."""
        ...

    def read(self, name: str) -> bytes:
        """A file's content."""
        ...

    def write(self, name: str, content: bytes) -> None:
        """Write a file, whole or not at all."""
        ...

    def move(self, name: str, to: str) -> None:
        """Give a file another name."""
        ...

    def locked(self) -> AbstractContextManager[None]:
        """While no other sweep writes here; CannotRun where one does."""
        ...


def open_files(where: str) -> Files:
    """The folder that a path or an fsspec URL means; nothing is made yet."""
    if "://" not in where:
        return LocalFiles(Path(where))
    import fsspec

    try:
        system, root = fsspec.core.url_to_fs(where)
    except (ImportError, ValueError) as error:
        raise UserError("folder", f"{where}: {error}", "a path, or an URL that fsspec opens") from None
    local = "file" in (system.protocol if isinstance(system.protocol, tuple) else (system.protocol,))
    return LocalFiles(Path(root)) if local else RemoteFiles(system, root)


def files_in_memory() -> Files:
    """A new folder in memory."""
    from fsspec.implementations.memory import MemoryFileSystem

    system = MemoryFileSystem(skip_instance_cache=True)
    system.store, system.pseudo_dirs = {}, [""]  # in place of those that all instances share
    return RemoteFiles(system, "/study")


class LocalFiles:
    """On a file system of this machine, a shared one included."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def names(self, folder: str = "") -> list[str]:
        """As Files."""
        path = self._root / folder
        return sorted(entry.name for entry in os.scandir(path) if entry.is_file()) if path.is_dir() else []

    def read(self, name: str) -> bytes:
        """As Files."""
        return (self._root / name).read_bytes()

    def write(self, name: str, content: bytes) -> None:
        """As Files; on disk when it returns."""
        path = self._root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        neighbour = path.with_name(f".{path.name}.new")  # nobody else's, under the lock
        try:
            with neighbour.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            neighbour.replace(path)
        except BaseException:
            neighbour.unlink(missing_ok=True)
            raise

    def move(self, name: str, to: str) -> None:
        """As Files."""
        (self._root / to).parent.mkdir(parents=True, exist_ok=True)
        (self._root / name).replace(self._root / to)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """As Files."""
        import fcntl

        self._root.mkdir(parents=True, exist_ok=True)
        path = self._root / LOCK
        with path.open("a+") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.seek(0)
                raise _taken(str(self._root), file.read()) from None
            file.truncate(0)
            file.write(json.dumps(_myself()))
            file.flush()
            for new in [*self._root.glob(".*.new"), *self._root.glob("*/.*.new")]:
                new.unlink()  # what a killed sweep was writing
            try:
                yield
            finally:
                with suppress(OSError):
                    path.unlink()


class RemoteFiles:
    """Anywhere that fsspec can write, where a file appears when all of it is there."""

    def __init__(self, system: Any, root: str) -> None:
        self._system, self._root = system, root.rstrip("/")

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}" if name else self._root

    def names(self, folder: str = "") -> list[str]:
        """As Files."""
        try:
            entries = self._system.ls(self._path(folder), detail=True, refresh=True)
        except FileNotFoundError:
            return []
        return sorted(entry["name"].rpartition("/")[2] for entry in entries if entry["type"] == "file")

    def read(self, name: str) -> bytes:
        """As Files."""
        content: bytes = self._system.cat_file(self._path(name))
        return content

    def write(self, name: str, content: bytes) -> None:
        """As Files."""
        self._system.makedirs(self._path(name).rpartition("/")[0], exist_ok=True)
        self._system.pipe_file(self._path(name), content)

    def move(self, name: str, to: str) -> None:
        """As Files."""
        self._system.makedirs(self._path(to).rpartition("/")[0], exist_ok=True)
        self._system.mv(self._path(name), self._path(to))

    @contextmanager
    def locked(self) -> Iterator[None]:
        """As Files, by a file that a thread keeps fresh."""
        me = {**_myself(), "token": secrets.token_hex(8)}
        self._claim(me)
        done = threading.Event()

        def freshen() -> None:
            while not done.wait(_FRESHEN_S):
                with suppress(OSError):
                    self.write(LOCK, json.dumps({**me, "time": time.time()}).encode())

        keeper = threading.Thread(target=freshen, daemon=True)
        keeper.start()
        try:
            yield
        finally:
            done.set()
            keeper.join()
            with suppress(OSError):
                self._system.rm_file(self._path(LOCK))

    def _claim(self, me: dict[str, Any]) -> None:
        if LOCK in self.names():
            owner = self.read(LOCK).decode("utf-8", "replace")
            with suppress(ValueError, KeyError, TypeError):
                if time.time() - json.loads(owner)["time"] < _STALE_S:
                    raise _taken(self._root, owner)
        self.write(LOCK, json.dumps(me).encode())
        if json.loads(self.read(LOCK)).get("token") != me["token"]:  # another was as quick
            raise _taken(self._root, "")


def _myself() -> dict[str, Any]:
    return {"host": socket.gethostname(), "pid": os.getpid(), "time": time.time()}


def _taken(where: str, owner: str) -> CannotRun:
    try:
        content = json.loads(owner)
        who = f"another sweep, process {content['pid']} on {content['host']}, is writing there"
    except (ValueError, KeyError, TypeError):
        who = "another sweep is writing there"
    return CannotRun(
        "folder", f"{where}: {who}", "one sweep at a time", "Wait for it, or take another folder"
    )
