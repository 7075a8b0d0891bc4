"""A sweep's folder: its contents, and the files that hold them."""

from __future__ import annotations

import csv
import errno
import io
import json
import os
import re
import secrets
import shutil
import socket
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from fsspec.core import url_to_fs
from fsspec.implementations.local import LocalFileSystem

from hcbench.benchmark.plan import SCHEMA, Plan
from hcbench.benchmark.results import RUN_KEY
from hcbench.benchmark.tables import SUMMARY, ShardFiles, Summary, Totals, digest, metadata_of
from hcbench.system.errors import CannotRun, OutputError, UserError
from hcbench.system.files import parse_json, replace_file, unwritable
from hcbench.system.text import sanitized
from hcbench.terms.fields import ResultTable, validate
from hcbench.terms.impact import FORMER_E

# The files of a sweep: on a file system of this machine, in memory, or anywhere else that fsspec
# opens.
#
# Files appear whole or not at all, and one sweep at a time writes. On this machine's file systems
# the lock ends with the process that holds it, however that ends; elsewhere (s3://, gs://) and on
# Windows it is a file that its owner keeps fresh, and that is given up when it is not.

LOCK = "_lock"
# Time between two writes of a lock file, and age at which its owner has ended.
_FRESHEN_S = 30.0
_STALE_S = 300.0


class Files:
    """The files of a folder, by names relative to it. OSError for what cannot be done; CannotRun,
    from `locked` and `write`, where another sweep has the lock.
    """

    def __init__(self, system: Any, root: str, where: str) -> None:
        """The files of a folder, on any file system that fsspec knows; nothing is opened yet.

        system: fsspec's object for the file system.
        root: path of the folder on it.
        where: path or URL of the folder as the user wrote it, for errors.
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
        """Sorted names of the files, or with `directories` of the folders, in a folder; none where
        it does not exist. Names are those within the folder, not paths. OSError for what cannot be
        read.
        """
        try:
            entries = self._system.ls(self._path(folder), detail=True, refresh=True)
        except (FileNotFoundError, NotADirectoryError):
            return []
        names = []
        for entry in entries:
            is_directory = entry["type"] == "directory"
            if is_directory is directories:
                names.append(_base(entry["name"].rstrip("/")))
        return sorted(names)

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

    def require_folder(self) -> None:
        """Raise FileExistsError where the folder's name is that of a file."""
        if self._system.isfile(self._root):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST))

    @contextmanager
    def locked(self) -> Iterator[None]:
        """While no other sweep writes here: by a lock file that a thread keeps fresh.

        Raises CannotRun where another sweep has written the file within _STALE_S, OSError where it
        cannot be written. Where another sweep took the lock meanwhile, for example since this
        machine slept, the next `write` raises CannotRun.
        """
        mine = {**_myself(), "token": secrets.token_hex(8)}
        self._claim(mine)
        self._mine = mine
        done = threading.Event()

        def freshen() -> None:
            while not done.wait(_FRESHEN_S):
                # The next write of the sweep raises CannotRun where another has the lock.
                # One damaged reading does not let the lock go stale.
                with suppress(OSError, ValueError, CannotRun):
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
        """Write the lock file of this sweep, in place of one that is stale or damaged.

        `locked` calls it once, and its thread again and again, to keep the file fresh.
        mine: its content, with a token of its own; its time becomes that of this write.
        Raises CannotRun if another sweep holds the lock, OSError where it cannot be read or
        written, ValueError where what was read back is damaged.
        """
        if LOCK in self.names():
            owner = self.read(LOCK).decode("utf-8", "replace")
            # A file that is not JSON, or has no time, is what a killed sweep left.
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
    """Files of a folder on a file system of this machine, a shared one included."""

    def write(self, name: str, content: bytes) -> None:
        """Write a file, whole or not at all; it is on disk then."""
        replace_file(Path(self._path_to_write(name)), content, sync=True)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """While no other sweep writes here; files that a killed one left unfinished are removed.

        Raises CannotRun where another sweep writes, OSError where the folder cannot be written.
        """
        with super().locked() if sys.platform == "win32" else self._flocked():
            for unfinished in Path(self._root).rglob(".*.new"):
                # A killed sweep leaves the file that it was writing.
                unfinished.unlink()
            yield

    @contextmanager
    def _flocked(self) -> Iterator[None]:
        """While this process has the lock of POSIX on the lock file, which ends with the process.

        Raises CannotRun where another process has it, OSError where the file cannot be made.
        """
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
    """The files in a folder, local or remote; nothing is made yet, but some remote systems connect.

    where: a path or an fsspec URL.
    Raises UserError for a URL that fsspec does not open, or whose package is not installed,
    OutputError where its system cannot be reached.
    """
    if "://" not in where:
        return LocalFiles(LocalFileSystem(), str(Path(where).absolute()), where)
    try:
        system, root = url_to_fs(where)
    except OSError as error:
        # ftp:// and gist:// connect here.
        raise unwritable("folder", where, error, "a folder that can be reached") from None
    except Exception as error:
        # Each system raises errors of its own for an URL that lacks something, as github:// does.
        expected = "a path, or an URL that fsspec opens"
        raise UserError("folder", f"{where}: {sanitized(str(error))}", expected) from None
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
    """The error for a folder that another sweep writes to; it is returned, not raised.

    where: the folder.
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


# Contents of a sweep's folder: description, shards, summary; damaged ones are detected.

# Files and folders of a sweep beside its shards.
DESCRIPTION = "_sweep.json"
# What the description of `model_sweep` says it is.
OF_A_MODEL = "hcbench sweep of a model"
SUMMARY_FILE = "_summary.csv"
LOOPS = "_loops"
DAMAGED = "_damaged"
GO_ON = "Then go on with --resume"
_SHARD = re.compile(r"(?:\d{4,}/)?part-(\d{7})-([0-9a-f]{16})\.parquet")
_FOLDER = re.compile(r"\d{4,}")
# Shards of a folder, at most; of more, each thousand has a folder of its own.
_IN_A_FOLDER = 1000
_BOUNCES = re.compile(r"_bounces-([0-9a-f]{16})\.parquet")


@contextmanager
def output_errors(where: str, expected: str, advice: str) -> Iterator[None]:
    """Turn an error of the operating system into an OutputError that names a sweep's folder."""
    try:
        yield
    except OSError as error:
        raise unwritable("folder", where, error, expected, advice) from None


class Store:
    """The results of a study, shard by shard, in the files of a folder.

    Raises OutputError for errors of the disk, UserError for a path that cannot be a folder.
    """

    def __init__(self, files: Files) -> None:
        self.where = files.where
        self._files = files
        # A report starts anew and has nothing to resume.
        self._advice = "" if isinstance(files, TemporaryFiles) else GO_ON

    @contextmanager
    def locked(self) -> Iterator[None]:
        """While no other sweep writes here; CannotRun where one does."""
        with ExitStack() as stack:
            with self._output_errors("a folder that can be written to"):
                stack.enter_context(self._files.locked())
            yield

    def require_folder(self) -> None:
        """Raise OutputError where the folder's name is that of a file."""
        with self._output_errors("a folder that can be written to"):
            self._files.require_folder()

    def _output_errors(self, expected: str) -> AbstractContextManager[None]:
        return output_errors(self.where, expected, self._advice)

    def description(self) -> dict[str, Any] | None:
        """Read the description of the sweep, as a dict of JSON values; None for a folder without
        one.

        Its keys are those of `Plan.described`.
        Raises UserError for a file of another schema, or that is not what a sweep wrote;
        OutputError where it cannot be read.
        """
        with self._output_errors("a folder that can be read"):
            if DESCRIPTION not in self._files.names():
                return None
            text = self._files.read(DESCRIPTION)
        try:
            content = parse_json(text)
        except ValueError:
            content = {}
        description: dict[str, Any] = content if isinstance(content, dict) else {}
        self._require_schema(description)
        validate(ResultTable, description, UserError, f"{self.where}/{DESCRIPTION}: {{}}")
        parts = description.get("parts")
        if not _are_starts(description.get("parts_of_settings"), parts):
            got = f"{self.where}: {DESCRIPTION} has parts {parts!r:.40}"
            raise UserError("folder", got, "what a sweep wrote")
        return description

    def _require_schema(self, description: Mapping[str, Any]) -> None:
        """Raise UserError for a description of another schema, with the hcbench that wrote it."""
        schema = description.get("schema")
        if schema == SCHEMA and description.get("kind") == "hcbench sweep":
            return
        if description.get("kind") == OF_A_MODEL:
            got = f"{self.where} holds a sweep of a model, which has no page"
            raise UserError("folder", got, "that of a study", "pandas.read_parquet reads it")
        got = "no table in JSON"
        if description:
            got = f"schema {schema!r:.40}"
        if schema in (1, 2):
            got += f", {FORMER_E}"
        by = "unknown"
        versions = description.get("versions")
        if isinstance(versions, dict):
            by = sanitized(versions.get("hcbench"))
        advice = f"hcbench {by} wrote it: finish it with that one, or sweep into a new folder"
        raise UserError(
            "folder", f"{self.where}: {DESCRIPTION} has {got}", f"schema {SCHEMA}", advice
        )

    def create_or_verify(self, plan: Plan, resume: bool) -> None:
        """Make the folder that of a plan, or see that it is.

        Raises UserError for a folder of other files, of a sweep by another plan, or of this one
        without `resume`; OutputError where it cannot be read or written.
        """
        there = self.description()
        content = _json(plan.described())
        if there is None:
            strangers = [name for name in self._files.names() if name != LOCK]
            if strangers:
                got = f"{self.where} holds {strangers[0]!r} and no sweep"
                raise UserError("folder", got, "an empty or a new folder")
            self._write(DESCRIPTION, content)
            return
        # The content is written and read again, since JSON has no tuples.
        difference = _other_study(there, json.loads(content))
        if difference is not None:
            raise UserError(
                "folder",
                f"{self.where} holds another sweep: {difference}",
                "the same study with the same versions",
                "Take another folder, or what that sweep was begun with",
            )
        if not resume:
            got = f"{self.where} holds a sweep already"
            raise UserError("folder", got, "a new folder", "Go on with it by --resume")

    def verified(self, count: int) -> Iterator[tuple[int, list[Summary] | None]]:
        """Each of `count` shards that exists, by number: its part of
        the summary, or None if damaged.

        Damaged: cut short, edited or under another's number, it or its loops. It
        is moved into the folder DAMAGED, so that it counts no more.

        Raises UserError for a table that is not one of these shards, OutputError where the folder
        cannot be read or written.
        """
        for number, name in self._shards(count).items():
            summary = None
            with self._output_errors("a folder that can be read and written to"):
                tables = self._read_shard(number, name)
                if tables is None:
                    self._files.move(name, f"{DAMAGED}/{_base(name)}")
            if tables is not None:
                impacts, _loops = tables
                _loops_digest, summary = metadata_of(impacts)
            yield number, summary

    def shards(self, count: int) -> dict[int, str]:
        """The names of all of `count` shards, by number.

        Raises UserError where a shard is missing or there twice, and for a table that is not one of
        them; OutputError where the folder cannot be read.
        """
        shards = self._shards(count)
        if len(shards) < count:
            got = f"{self.where} holds {len(shards)} of {count} parts"
            raise UserError("folder", got, "a finished sweep", "Finish it by --resume")
        return shards

    def tables(self, number: int, name: str) -> tuple[bytes, bytes]:
        """Impacts and kept loops of a shard, bytes of a table each; no bytes where it kept no
        loops.

        number: of the shard.
        name: of its file.
        Raises UserError for a shard that is damaged, OutputError where it cannot be read.
        """
        with self._output_errors("a folder that can be read"):
            tables = self._read_shard(number, name)
        if tables is None:
            got = f"{self.where}: {name}, or its loops, is cut short or edited"
            raise UserError("folder", got, "what a sweep wrote", "Mend it by --resume")
        return tables

    def _shards(self, count: int) -> dict[int, str]:
        """The names of the existing shards, by number.

        count: shards of the plan, numbered from 0. Bounces, and files that are not tables, are
        passed over.
        Raises UserError for a table that is not one of the shards, and for a shard that is there
        twice; OutputError where the folder cannot be read.
        """
        shards: dict[int, str] = {}
        with self._output_errors("a folder that can be read"):
            names = self._files.names()
            for folder in filter(_FOLDER.fullmatch, self._files.folders()):
                names += [f"{folder}/{name}" for name in self._files.names(folder)]
        for name in names:
            if not name.endswith(".parquet") or _BOUNCES.fullmatch(name):
                continue
            # A table of another name is none of the parts.
            number = count
            if match := _SHARD.fullmatch(name):
                number = int(match[1])
            if number >= count or number in shards:
                what = "no part"
                if number in shards:
                    what = "twice that part"
                raise UserError(
                    "folder",
                    f"{self.where} holds {name!r}, {what}",
                    f"each of its {count} parts once and no other table",
                    "Move it elsewhere: pandas would read it too",
                )
            shards[number] = name
        return shards

    def _read_shard(self, number: int, name: str) -> tuple[bytes, bytes] | None:
        """A shard's impacts and kept loops, bytes of a table each, b"" where it kept no loops; None
        if damaged.

        number: of the shard.
        name: of its file. Damaged: a digest is not the one in the name of the file, or the file of
        loops is missing. OSError where a file cannot be read.
        """
        impacts = self._files.read(name)
        if _base(name) != _shard_name(number, impacts):
            return None
        loops_digest, _ = metadata_of(impacts)
        if not loops_digest:
            return impacts, b""
        with suppress(FileNotFoundError):
            folder = name.removesuffix(_base(name))
            loops = self._files.read(f"{LOOPS}/{folder}{_loops_name(number, loops_digest)}")
            if digest(loops) == loops_digest:
                return impacts, loops
        return None

    def write_shard(self, shard: ShardFiles, count: int) -> None:
        """Write one of `count` shards, completely or not at all: it exists
        when its impacts do, written last. Raises OutputError.
        """
        folder = f"{shard.number // _IN_A_FOLDER:04d}/" if count > _IN_A_FOLDER else ""
        if shard.loops:
            name = _loops_name(shard.number, digest(shard.loops))
            self._write(f"{LOOPS}/{folder}{name}", shard.loops)
        self._write(folder + _shard_name(shard.number, shard.impacts), shard.impacts)

    def bounces(self) -> bytes | None:
        """The table of bounces under gravity, as `write_bounces` got it; None where there is none
        that is whole. Raises OutputError where the folder cannot be read.
        """
        with self._output_errors("a folder that can be read"):
            for name in filter(_BOUNCES.fullmatch, self._files.names()):
                table = self._files.read(name)
                if name == _bounces_name(table):
                    return table
        return None

    def write_bounces(self, table: bytes) -> None:
        """The table of bounces under gravity. A damaged file in its place is moved aside."""
        with self._output_errors("a folder that can be read and written to"):
            for name in filter(_BOUNCES.fullmatch, self._files.names()):
                self._files.move(name, f"{DAMAGED}/{name}")
        self._write(_bounces_name(table), table)

    def write_summary(self, settings: Sequence[Mapping[str, Any]], totals: Totals) -> None:
        """Bring the summary up to date: one line a setting, α and step, in the study's order.

        settings: records with the keys of RUN_KEY, one for each line.
        totals: sums of all shards until now. A setting of which no shard is done yet gets 0 impacts
        and empty cells.
        Raises OutputError.
        """
        lines = totals.lines()
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([*RUN_KEY, *SUMMARY])
        for setting in settings:
            key = tuple(setting[name] for name in RUN_KEY)
            line = lines.get(key, {"impacts": 0})
            writer.writerow([*key, *(line.get(name, "") for name in SUMMARY)])
        self._write(SUMMARY_FILE, text.getvalue().encode())

    def _write(self, name: str, content: bytes) -> None:
        """A file, whole or not at all."""
        with self._output_errors("room for it in a folder that can be written to"):
            self._files.write(name, content)


def _shard_name(number: int, impacts: bytes) -> str:
    # The number is in the digest too: a shard given another's number is found out.
    return f"part-{number:07d}-{digest(f'{number}:'.encode() + impacts)}.parquet"


def _loops_name(number: int, loops_digest: str) -> str:
    return f"loops-{number:07d}-{loops_digest}.parquet"


def _base(name: str) -> str:
    return name.rpartition("/")[2]


def _bounces_name(table: bytes) -> str:
    return f"_bounces-{digest(table)}.parquet"


def _json(content: Mapping[str, Any]) -> bytes:
    return (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()


def _are_starts(starts: Any, parts: Any) -> bool:
    """Say whether `starts` are numbers of the grids' first parts, rising from 0, with the number of
    all parts at the end.

    parts: the number of all parts, above 0. Both arguments may be anything that JSON has.
    """
    if not isinstance(starts, list) or len(starts) < 2:
        return False
    # The type is compared, since True is an int too.
    if not all(type(number) is int for number in (*starts, parts)):
        return False
    return starts == sorted(starts) and starts[0] == 0 and starts[-1] == parts and parts > 0


def _other_study(there: Mapping[str, Any], here: Mapping[str, Any]) -> str | None:
    """Name the first difference between two sweeps of a study, for an error; None without one.

    there, here: descriptions, plain values of JSON: of the folder, and of the plan.
    """
    old = there["versions"]
    new = here["versions"]
    if old != new:
        differences = []
        for name in sorted({*old, *new}):
            before = old.get(name, "none")
            now = new.get(name, "none")
            if before != now:
                differences.append(f"{name} {before} instead of {now}")
        return ", ".join(differences)
    # Some fields are left out where they are empty: either study may have one that the other lacks.
    for name in here["study"] | there["study"]:
        before = there["study"].get(name)
        now = here["study"].get(name)
        if before != now:
            return f"{name} {before!r:.60} instead of {now!r:.60}"
    if there["files"] != here["files"]:
        return "the scene's files differ"
    if there["settings"] != here["settings"]:
        return "the settings differ"
    if there != here:
        return "it is cut into other parts"
    return None
