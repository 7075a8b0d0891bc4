"""Numbers in text without a table: logs, records of several lines, markup, and lists in programs.

Lines with the same words and other numbers are records, and each number in them is a column: it has
the words before it as its name, and the unit after it.
"""

from __future__ import annotations

import itertools
import re
from collections import defaultdict
from typing import TYPE_CHECKING, NamedTuple

from hcbench.fitting.column_names import (
    QUANTITY_OF,
    is_unit,
    is_unit_of,
    meanings_of,
    plain_unit,
    role_of,
    split_header,
)
from hcbench.fitting.separators import listed_names

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.fitting.separators import Row

_CLOCK = r"\d+(?::\d+){1,3}(?:[.,]\d+)?"
_PLAIN = r"[-+]?(?:\d+(?:[.,]\d+)?|\.\d+)(?:[eEdD][-+]?\d+)?"
_STAMP = r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?"
_NUMBER = re.compile(rf"(?<![\w.])(?:{_STAMP}|{_CLOCK}|{_PLAIN})(?![\w.]*\d)")
# A list of numbers in a program or its output: "[0.32, 0.61, 0.85]", one a line, in rows of six.
_BETWEEN = r"[\s,;\[\](){}]+"
_IN_LIST = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?"
_LIST = re.compile(rf"(?<![\w.]){_IN_LIST}(?:{_BETWEEN}{_IN_LIST}(?![\w.])){{3,}}")
_WORD = re.compile(r"[^\W\d_][\w]*(?:\s*[\[(]\s*[^\W\d][\w/^-]*\s*[\])])?")
# Words between the name of a list and its numbers.
_OF_PROGRAMS = frozenset(
    [
        "array",
        "np",
        "numpy",
        "c",
        "list",
        "tuple",
        "series",
        "out",
        "in",
        "double",
        "float",
        "vector",
    ]
)
_OPENING = tuple("=:([{")
# Letters before a list that may have its name, and words of them.
_BEFORE = 200
_MOST_WORDS = 8
# Lines with the same words that are records, at least; lines and characters of a line at most.
_LEAST = 3
_MOST_LINES = 100_000
_MOST_CHARACTERS = 400
_MASK = "\0"


class _WrittenNumber(NamedTuple):
    """A number in a line: its text, and the words before and after it."""

    number: str
    before: str
    after: str


class _Columns(NamedTuple):
    """Names of columns, their rows, and the lines before them."""

    names: tuple[str, ...] = ()
    rows: tuple[Row, ...] = ()
    before: tuple[Row, ...] = ()

    def known(self) -> int:
        """Number of columns with data."""
        roles = {role_of(*split_header(name)) for name in self.names}
        return len(roles & {*QUANTITY_OF, "frame", "sample"})


def rows_in_text(text: str) -> tuple[Row, ...]:
    """A header and rows of the numbers in a text, below what the text says before them; empty where
    no name of a column is known.
    """
    text = re.sub(r"\bnp\.(?:float|int)\d+\(([^()]*)\)", r"\1", text)
    lines = _lines(text)
    if len(lines) > _MOST_LINES or any(len(line) > _MOST_CHARACTERS for _, line in lines):
        return ()
    found = max(_of_records(lines), _of_lists(text), key=_Columns.known)
    if not found.known():
        return ()
    return (*found.before, (found.rows[0][0], found.names), *found.rows)


def _lines(text: str) -> list[tuple[int, str]]:
    """Numbers and text of the lines that are not empty; each tag of XML is a line."""
    is_markup = text.lstrip().startswith("<")
    if is_markup:
        # The ends of elements say nothing.
        text = re.sub(r"</[^<>]*>", "", text)
    return [
        (number, part.strip())
        for number, line in enumerate(text.splitlines(), 1)
        for part in (re.split(r"(?<=.)(?=<)", line) if is_markup else [line])
        if part.strip()
    ]


def _of_records(lines: Sequence[tuple[int, str]]) -> _Columns:
    """Columns of records of one or more lines each, by the line with which they begin."""
    alike: defaultdict[str, list[int]] = defaultdict(list)
    for at, (_, line) in enumerate(lines):
        alike[_masked(line)].append(at)
    named = [list(_named(line)) for _, line in lines]
    ways = [_records(lines, named, starts) for starts in alike.values() if len(starts) >= _LEAST]
    return max(ways, key=lambda way: (way.known(), len(way.rows)), default=_Columns())


def _masked(line: str) -> str:
    """A line with a mark in place of each number, and of words in quotes."""
    return re.sub(r"\d+", "0", re.sub(r"([\"'])[^\"'=<>]*\1", "'0'", _NUMBER.sub(_MASK, line)))


def _records(
    lines: Sequence[tuple[int, str]],
    named: Sequence[list[tuple[str, str]]],
    starts: Sequence[int],
) -> _Columns:
    """Columns of records that begin at these lines: those that all of them have.

    named: (name, number) of each number in each line.
    """
    records: list[dict[str, str]] = []
    first = lines[starts[0]][1]
    # "points [1]:" is over the lines of its record.
    over = re.sub(r"[\W\d]+", " ", first).strip() if first.endswith(":") else ""
    has_words = False
    for begin, end in itertools.pairwise([*starts, len(lines)]):
        record: dict[str, str] = {}
        for (_, line), numbers in zip(lines[begin:end], named[begin:end], strict=True):
            has_words = has_words or "-->" in line or any(map(str.isalpha, line))
            for name, number in numbers:
                called = f"{over} {name}" if role_of(f"{over} {name}") in QUANTITY_OF else name
                # Numbers of one name differ by their places.
                called = called if called not in record else f"{called} {len(record)}"
                record.setdefault(called, number)
        _join_stamp(record)
        records.append(record)
    names = tuple(name for name in records[0] if all(name in record for record in records))
    before = [(number, (_plain(line),)) for number, line in lines[: starts[0]]]
    rows = [
        (lines[start][0], tuple(record[name] for name in names))
        for start, record in zip(starts, records, strict=True)
    ]
    listed = listed_names([line for _, line in lines[: starts[0] + 1]], len(names))
    if not listed and not has_words:
        # Numbers alone are a table, whose header says what they are.
        return _Columns()
    return _Columns(listed or names, tuple(rows), tuple(before))


def _join_stamp(record: dict[str, str]) -> None:
    """Replace the seconds and nanoseconds of a stamp of ROS by its time in s, with all its digits."""
    for whole, part in (("secs", "nsecs"), ("sec", "nanosec")):
        if whole in record and part in record:
            record["stamp [s]"] = f"{record.pop(whole)}.{int(record.pop(part)):09d}"


def _named(line: str) -> Iterator[tuple[str, str]]:
    """(name, number) of each number in a line: "bounce 1: 62.2 cm" has the bounce and its height."""
    name = ""
    clocks = 0
    for part in _parts(line):
        words = _plain(part.before)
        unit = re.match(r"\s*[\[(]?([^\W\d_][^\s,;<>\"')\]]*|[\"'″′%])", part.after)
        if ":" in part.number:
            # Of a label, the begin and the end.
            words = words if role_of(words) else ("start", "stop")[min(clocks, 1)]
            clocks += 1
        elif meanings_of(words) or not name:
            name = words
        else:
            words = name
        is_quoted = part.before.endswith(("'", '"'))
        is_with_unit = unit is not None and not is_quoted and is_unit(plain_unit(unit[1]))
        # <time unit="s">
        words = re.sub(r"\s+units? = (\S+)$", r" [\1]", words)
        # <value name="height (cm)">
        words = re.sub(r"^\w+ (?:name|label|title|key) = ", "", words)
        yield (f"{words} [{unit[1]}]" if is_with_unit and unit else words), part.number


def _parts(line: str) -> Iterator[_WrittenNumber]:
    """The numbers in a line."""
    found = list(_NUMBER.finditer(line))
    ends = [0, *(match.end() for match in found)]
    starts = [*(match.start() for match in found), len(line)]
    for i, match in enumerate(found):
        yield _WrittenNumber(match[0], line[ends[i] : starts[i]], line[ends[i + 1] : starts[i + 1]])


def _plain(text: str) -> str:
    """Words without the signs of programs and markup about them; one sign "=" stays between words."""
    words = re.sub(r"->|</?|[>\"'|]+", " ", re.sub(r"\s*=\s*[\"']?", " = ", text))
    return words.strip(" :=,;([{-@\t")


def _of_lists(text: str) -> _Columns:
    """Columns of the lists of numbers in a text, each with the last name before it that is known."""
    columns: dict[str, list[str]] = {}
    for found in _LIST.finditer(text):
        # A list is in brackets, or after a sign: numbers below a header are a table.
        if text[: found.start()].rstrip()[-1:] not in _OPENING:
            continue
        rest = text[found.end() : found.end() + _BEFORE].partition("\n")[0]
        name = _name_of(text[max(0, found.start() - _BEFORE) : found.start()], rest)
        if name:
            columns.setdefault(name, re.findall(_IN_LIST, found[0]))
    count = max(map(len, columns.values()), default=0)
    padded = [[*numbers, *[""] * (count - len(numbers))] for numbers in columns.values()]
    return _Columns(tuple(columns), tuple((1, row) for row in zip(*padded, strict=True)))


def _name_of(before: str, after: str) -> str:
    """The last name of a column before a list, with a unit that stands near it; "" for none."""
    words = [word for word in _WORD.findall(before) if word.lower() not in _OF_PROGRAMS]
    words = words[-_MOST_WORDS:]
    for word in reversed(words):
        role = role_of(*split_header(word))
        if role not in QUANTITY_OF:
            continue
        # Of several lists, each has its unit after it.
        near = [*re.findall(r"[^\W\d_][\w/]*", after), *reversed(words)]
        unit = next((one for one in near if is_unit_of(plain_unit(one), QUANTITY_OF[role])), "")
        return word if split_header(word)[1] or not unit else f"{word} [{unit}]"
    return ""
