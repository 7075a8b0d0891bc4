"""What is in a sweep's folder: its description, its parts, its summary; and what is wrong with any of it."""

from __future__ import annotations

import csv
import io
import json
import re
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from hcbench.benchmark.results import RUN_KEY
from hcbench.benchmark.shards import SCHEMA
from hcbench.benchmark.store import LOCK, open_files
from hcbench.benchmark.tables import SUMMARY, digest, shares_of, summed
from hcbench.errors import OutputError, UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from hcbench.benchmark.shards import Plan
    from hcbench.benchmark.tables import PartBytes, Share

SWEEP, SUMMARY_FILE, LOOPS, DAMAGED = "_sweep.json", "_summary.csv", "_loops", "_damaged"
_PART = re.compile(r"part-(\d{7})-([0-9a-f]{16})\.parquet")


class Folder:
    """A sweep's folder, by path or fsspec URL. Errors of the disk come out as OutputError."""

    def __init__(self, where: str) -> None:
        self.where = where
        self._files = open_files(where)

    @contextmanager
    def locked(self) -> Iterator[None]:
        """While no other sweep writes here; CannotRun where one does."""
        with ExitStack() as stack:
            with self._told("a folder that can be written to"):
                stack.enter_context(self._files.locked())
            yield

    @contextmanager
    def _told(self, expected: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(
                "folder", f"{self.where}: {reason}", expected, "Then go on with --resume"
            ) from None

    def description(self) -> dict[str, Any] | None:
        """What is swept here; None where there is no sweep. UserError for another schema."""
        with self._told("a folder that can be read"):
            if SWEEP not in self._files.names():
                return None
            content = self._files.read(SWEEP)
        try:
            found: dict[str, Any] = json.loads(content)
        except ValueError:
            found = {}
        if found.get("schema") != SCHEMA or found.get("kind") != "hcbench sweep":
            got = f"schema {found.get('schema')!r}" if found else "not JSON"
            raise UserError(
                "folder", f"{self.where}: {SWEEP} has {got}", f"schema {SCHEMA}", "Another hcbench made it"
            )
        return found

    def begin(self, plan: Plan, resume: bool) -> None:
        """Make the folder that of a plan, or see that it is. UserError for any other."""
        there, own = self.description(), plan.described()
        if there is None:
            strangers = [name for name in self._files.names() if name != LOCK]
            if strangers:
                raise UserError(
                    "folder", f"{self.where} holds {strangers[0]!r} and no sweep", "an empty or a new folder"
                )
            self.write(SWEEP, _json(own))
        elif (changed := _difference(there, json.loads(_json(own)))) is not None:
            raise UserError(
                "folder",
                f"{self.where} holds another sweep: {changed}",
                "the same study with the same versions",
                "Take another folder, or what that sweep was begun with",
            )
        elif not resume:
            raise UserError(
                "folder", f"{self.where} holds a sweep already", "a new folder", "Go on with it by --resume"
            )

    def parts(self, count: int) -> dict[int, str]:
        """The names of the parts that are there, by number. UserError for what is none of `count` parts."""
        found: dict[int, str] = {}
        with self._told("a folder that can be read"):
            tables = [name for name in self._files.names() if name.endswith(".parquet")]
        for name in tables:
            match = _PART.fullmatch(name)
            number = int(match[1]) if match else count
            if number >= count or number in found:
                raise UserError(
                    "folder",
                    f"{self.where} holds {name!r}, " + ("twice that part" if number in found else "no part"),
                    f"each of its {count} parts once and no other table",
                    "Move it elsewhere: pandas would read it too",
                )
            found[number] = name
        return found

    def checked(self, count: int) -> Iterator[tuple[int, list[Share] | None]]:
        """Every part of `count` that is there, by number: its share of the summary, or None if damaged.

        Damaged: cut short, edited or under another's number, it or its loops. It is put aside, out of the
        table.
        """
        loops = set(self._files.names(LOOPS))
        for number, name in sorted(self.parts(count).items()):
            with self._told("a folder that can be read and written to"):
                content = self._files.read(name)
                if name == _part_name(number, content):
                    kept, shares = shares_of(content)
                    loop = _loops_name(number, kept)
                    if not kept or (loop in loops and digest(self._files.read(f"{LOOPS}/{loop}")) == kept):
                        yield number, shares
                        continue
                self._files.move(name, f"{DAMAGED}/{name}")
            yield number, None

    def put(self, part: PartBytes) -> None:
        """A part, whole or not at all: it is there when its rows are, which come last."""
        if part.loops:
            self.write(f"{LOOPS}/{_loops_name(part.number, digest(part.loops))}", part.loops)
        self.write(_part_name(part.number, part.rows), part.rows)

    def summarise(self, settings: Sequence[Mapping[str, Any]], shares: Sequence[Share]) -> None:
        """Bring the summary up to date: one line a setting, α and step, in the study's order."""
        lines, nothing = summed(shares), {"impacts": 0}
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow([*RUN_KEY, *SUMMARY])
        for setting in settings:
            key = tuple(setting[name] for name in RUN_KEY)
            line = lines.get(key, nothing)
            writer.writerow([*key, *(line.get(name, "") for name in SUMMARY)])
        self.write(SUMMARY_FILE, text.getvalue().encode())

    def write(self, name: str, content: bytes) -> None:
        """A file, whole or not at all."""
        with self._told("room for it in a folder that can be written to"):
            self._files.write(name, content)

    def tables(self, count: int) -> Iterator[tuple[bytes, bytes]]:
        """Rows and kept loops of each part of `count`, in order. UserError for one that is damaged."""
        for number, name in sorted(self.parts(count).items()):
            with self._told("a folder that can be read"):
                content = self._files.read(name)
                kept = shares_of(content)[0] if name == _part_name(number, content) else None
                loops = self._files.read(f"{LOOPS}/{_loops_name(number, kept)}") if kept else b""
            if kept is None or (kept and digest(loops) != kept):
                raise UserError(
                    "folder",
                    f"{self.where}: {name} is cut short or edited",
                    "what a sweep wrote",
                    "Mend it by --resume",
                )
            yield content, loops


def _part_name(number: int, rows: bytes) -> str:
    # The number is in the digest too: a part given another's number is found out.
    return f"part-{number:07d}-{digest(f'{number}:'.encode() + rows)}.parquet"


def _loops_name(number: int, kept: str) -> str:
    return f"loops-{number:07d}-{kept}.parquet"


def _json(content: Mapping[str, Any]) -> bytes:
    return (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode()


def _difference(there: Mapping[str, Any], own: Mapping[str, Any]) -> str | None:
    """What sets two sweeps apart, in words; None for nothing."""
    if there["versions"] != own["versions"]:
        told = [
            f"{name} {there['versions'].get(name, 'none')} instead of {own['versions'].get(name, 'none')}"
            for name in sorted({*there["versions"], *own["versions"]})
            if there["versions"].get(name) != own["versions"].get(name)
        ]
        return ", ".join(told)
    for name in own["study"]:
        if there["study"].get(name) != own["study"][name]:
            return f"{name} {there['study'].get(name)!r:.60} instead of {own['study'][name]!r:.60}"
    for part, what in (("files", "the scene's files differ"), ("settings", "the settings differ")):
        if there[part] != own[part]:
            return what
    return None if there == own else "it is cut into other parts"
