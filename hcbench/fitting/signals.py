"""A signal over time in a file of text, as oscilloscopes, phones, plates and microcontrollers write it.

Tables of bounces have a row for each touch; a signal has one for each sample, evenly in time.
"""

from __future__ import annotations

import io
import itertools
import math
import re
import zipfile
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hcbench.fitting.column_names import (
    PIXELS,
    is_unit_of,
    meanings_of,
    plain_unit,
    role_of,
    split_header,
)
from hcbench.fitting.sheets import decoded
from hcbench.fitting.table import unit_scale
from hcbench.fitting.track import seen_fall
from hcbench.system.errors import UserError
from hcbench.system.files import require_small_archive
from hcbench.system.text import sanitized

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from hcbench.terms.impact import Floats

# Rows of a signal, at least: no table of touches has as many.
_LEAST_ROWS = 100
# Bytes of the largest file that is read.
_LARGEST = 64 << 20
# Lines in which the sign between cells and the columns of numbers are looked for.
_LOOKED_AT = 60
# Rows that may have cells about the file beside their numbers.
_LINES_WITH_CELLS_BESIDE = 30
# Lines above the numbers that may name a column or its unit.
_NAMING = 4
_SIGNS = ("\t", ";", ",", None)
_NUMBER = re.compile(r"\s*[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?\s*")
# "Sample Interval,1e-6", "dt = 1e-6"; the increment of Rigol stands below its name.
_INTERVAL = re.compile(
    r"(?:sampl\w*\s*(?:interval|period)|\bdt|increment)\W+([\d.]+(?:e[+-]?\d+)?)"
)
# "Sampling rate [Hz] 1000", "Sample Rate: 44100 Hz", "# rate: 44100 Hz".
_RATE = re.compile(r"\b(?:rate|frequency|fs)\b[\s:=,;\[\](]*(k?)(?:hz)?[\s:=,;\])]*([\d.]+)\s*(k?)")
# Share of the rows that are numbers, and of the steps of time that are alike.
_MOST = 0.95
# A step of time is alike if it differs from the usual one by at most this share.
_ALIKE = 0.6
# Durations, s, of a recording of bounces, and its fewest samples a second. They are so close to one
# another that only one unit of time goes with them.
_DURATIONS = (0.3, 100.0)
_LEAST_RATE = 40.0
# Times that tell whether they are even, at least.
_LEAST_EVENED = 10
# Samples were dropped where a step of time is as long as this many even ones or longer. Rounding
# makes none so long, up to 840 samples a second in whole milliseconds.
_GAP = 1.7
# A vector's size is taken where its pulses are this many times as clear as those of its axes.
_FAR_CLEARER = 2.0
# A fall to and from the largest height takes longer than this, s; no push does.
_LONGEST_PUSH = 0.26
# Share by which a rate from rounded times differs from a whole one.
_OF_RATE = 3e-5
# Roles of columns that say where the ball is, and its state: such a file has no signal.
_OF_PLACES = {"height", "height_in", "height_out", "penetration", "rate", "restitution"}


@dataclass(frozen=True, slots=True)
class Signal:
    """One quantity over time, sampled evenly.

    values: (n,), in its own unit.
    rate: samples a second.
    begin: time of the first, s.
    what: the column's name and unit, as the file has them.
    is_force: True for a force, and then `values` are in N.
    assumed: what the file does not say and its numbers leave no choice about.
    """

    name: str
    values: Floats
    rate: float
    begin: float
    what: str
    is_force: bool
    assumed: str = ""

    @property
    def times(self) -> Floats:
        """Time of each sample, s, (n,)."""
        return np.asarray(self.begin + np.arange(len(self.values)) / self.rate)


@dataclass(frozen=True, slots=True)
class _Column:
    """A column of numbers (n,), NaN for other cells, and the names and units above it."""

    numbers: Floats
    names: tuple[tuple[str, str], ...]

    def unit_of(self, quantity: str) -> str:
        """The unit of a quantity; "" for none."""
        return next((unit for _, unit in self.names if is_unit_of(unit, quantity)), "")

    @property
    def meanings(self) -> set[str]:
        """Meanings of all words above it."""
        return {meaning for name, _ in self.names for meaning in meanings_of(name)}

    @property
    def is_place(self) -> bool:
        """True for where the ball is, in a unit of length or in pixels."""
        roles = {role_of(name, unit) for name, unit in self.names}
        in_pixels = any(unit in PIXELS for _, unit in self.names)
        return bool(roles & _OF_PLACES) or in_pixels or bool(self.unit_of("position"))

    @property
    def what(self) -> str:
        """The name with the unit, for people."""
        name = next((name for name, _ in self.names if name), "the values")
        unit = next((unit for _, unit in self.names if unit), "")
        return f"{name} [{unit}]" if unit else name


def signal_in(path: Path) -> Signal | None:
    """The signal in a file of text, or in a zip archive of one; None for any other file, also for one
    that cannot be read.

    Of several columns that with the clearest pulses is taken.
    """
    try:
        status = path.stat()
        # A pipe can be read once.
        if not path.is_file() or status.st_size > _LARGEST:
            return None
    except (OSError, ValueError):
        return None
    return _signal_in(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=4)
def _signal_in(path: Path, changed: int, size: int) -> Signal | None:
    """Do as `signal_in`, once for a file that was last changed then (ns) and has that size (bytes)."""
    try:
        text = decoded(_unpacked(path.read_bytes()))
    except (OSError, UnicodeDecodeError, UserError, zipfile.BadZipFile):
        return None
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) < _LEAST_ROWS:
        return None
    layout = _layout_of(lines)
    if layout is None:
        return None
    first = _first_row(lines, layout)
    columns = _columns(lines, layout, first)
    if len(columns) == 0 or len(columns[0].numbers) < _LEAST_ROWS:
        return None
    if any(one.is_place for one in columns):
        return None
    head = "\n".join(_lines_about(lines, layout, first))
    return _of_columns(sanitized(path.name), columns, head.casefold())


def _unpacked(content: bytes) -> bytes:
    """The content of a file; of an archive with one table besides meta/, as phyphox exports it, that of
    the table; b"" for an archive with none or several.

    Raises UserError for a large archive, and BadZipFile or OSError for a damaged one.
    """
    if not content.startswith(b"PK\3\4"):
        return content
    require_small_archive(content)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = [one for one in archive.namelist() if one.endswith((".csv", ".txt"))]
        tables = [one for one in names if not one.startswith(("meta/", "__MACOSX"))]
        return archive.read(tables[0]) if len(tables) == 1 else b""


def _cells(line: str, separator: str | None) -> list[str]:
    """Cells of a line, parted by a sign, or by blanks for None; without quotes."""
    return [cell.strip().strip('"') for cell in line.strip("\r\n").split(separator)]


class _Layout(NamedTuple):
    """Form in which the lines of a file are parted into cells.

    separator: between cells; None for blanks.
    places: of the columns of numbers, from 0, rising.
    """

    separator: str | None
    places: list[int]


def _layout_of(lines: Sequence[str]) -> _Layout | None:
    """The sign between cells and the places of the columns of numbers, from lines of the second half;
    None where lines have no numbers or are not alike.
    """
    begin = len(lines) // 2
    step = max(1, (len(lines) - begin) // _LOOKED_AT)
    looked_at = lines[begin : len(lines) - 1 : step]
    # A column alone comes last: "1,5" may be one number, or two.
    alone: _Layout | None = None
    for sign in _SIGNS:
        rows = [_cells(line, sign) for line in looked_at]
        width = len(rows[0])
        alike = [row for row in rows if len(row) == width]
        if len(alike) < _MOST * len(rows):
            continue
        places = []
        for place in range(width):
            numeric = sum(1 for row in alike if _NUMBER.fullmatch(row[place]))
            if numeric >= _MOST * len(alike):
                places.append(place)
        # "1,5;2,5" has two numbers between semicolons, and three cells between commas.
        if places and width > 1:
            return _Layout(sign, places)
        if places and alone is None:
            alone = _Layout(sign, places)
    return alone


def _first_row(lines: Sequence[str], layout: _Layout) -> int:
    """The first line with a number in each column of numbers, and in the next line too; 0 for none."""

    def is_row(line: str) -> bool:
        cells = _cells(line, layout.separator)
        is_wide = len(cells) > layout.places[-1]
        return is_wide and all(_NUMBER.fullmatch(cells[place]) for place in layout.places)

    for at in range(len(lines) - 1):
        if is_row(lines[at]) and is_row(lines[at + 1]):
            return at
    return 0


def _columns(lines: Sequence[str], layout: _Layout, first: int) -> list[_Column]:
    """The columns of numbers from the line `first` on, with the names above; none where the lines are
    not one table.
    """
    import pandas as pd

    separator = layout.separator
    # A line far from the header and from the end.
    middle = lines[len(lines) // 2]
    has_comma = separator != "," and "," in middle
    try:
        frame = pd.read_csv(
            io.StringIO("\n".join(lines[first:])),
            sep=separator or r"\s+",
            header=None,
            usecols=list(layout.places),
            decimal="," if has_comma else ".",
            names=range(len(_cells(middle, separator))),
            on_bad_lines="skip",
            skipinitialspace=True,
            low_memory=False,
        )
    except ValueError:
        # Rows of very different widths: several tables, and no signal.
        return []
    names = _names_above(lines[max(0, first - _NAMING) : first], layout)
    columns = []
    for place in layout.places:
        numbers = pd.to_numeric(frame[place], errors="coerce").to_numpy(dtype=float)
        columns.append(_Column(numbers, names[place]))
    return columns


def _names_above(above: Sequence[str], layout: _Layout) -> dict[int, tuple[tuple[str, str], ...]]:
    """(name, unit) pairs above each column of numbers, by its place; the line next to them first.

    above: lines before the numbers. A line of units alone, "(ms),(mV)" or "second,Volt", gives pairs
    with an empty name.
    """
    found: dict[int, list[tuple[str, str]]] = {place: [] for place in layout.places}
    for line in reversed(above):
        cells = _cells(line.strip().lstrip("#%").strip("\r\n"), layout.separator)
        # A line that says something of the whole file has other cells.
        if len(cells) <= layout.places[-1]:
            continue
        over = {place: cells[place] for place in layout.places}
        if all(map(_NUMBER.fullmatch, over.values())):
            continue
        for place, cell in over.items():
            bare = plain_unit(cell.strip("()[] "))
            if _is_bare_unit(bare):
                found[place].append(("", bare))
            elif cell and not _NUMBER.fullmatch(cell):
                found[place].append(_split(cell))
    return {place: tuple(pairs) for place, pairs in found.items()}


def _split(cell: str) -> tuple[str, str]:
    """(name, unit) of a name with its unit: also of a unit that tables of bounces do not have."""
    name, unit = split_header(cell)
    if not unit:
        in_brackets = re.search(r"[(\[]\s*([^()\[\]]+)\s*[)\]]\s*$", cell)
        if in_brackets is not None:
            return cell[: in_brackets.start()].strip(), in_brackets[1]
        head, _, last = cell.rpartition("_")
        if head and is_unit_of(plain_unit(last), "time"):
            return head, plain_unit(last)
    return name, unit


def _is_bare_unit(text: str) -> bool:
    """True for a unit alone: of time, of force, or of a voltage."""
    is_known = is_unit_of(text, "time") or is_unit_of(text, "force")
    return is_known or text.casefold() in ("v", "mv", "volt", "volts", "µv", "a", "pa", "g")


def _lines_about(lines: Sequence[str], layout: _Layout, first: int) -> Iterator[str]:
    """Yield the lines that tell of the file: those above the numbers, and cells beside the first of
    them, as Tektronix writes them.
    """
    yield from lines[:first]
    for line in lines[first : first + _LINES_WITH_CELLS_BESIDE]:
        cells = enumerate(_cells(line, layout.separator))
        beside = [cell for place, cell in cells if place not in layout.places]
        if any(beside):
            yield ",".join(beside)


def _of_columns(name: str, columns: Sequence[_Column], head: str) -> Signal | None:
    """The signal in columns of numbers, that with the clearest pulses.

    name: what errors call the file.
    head: lines about it, in lower case.
    None without a time or a rate, for too few or equal samples, fewer than 40 a second, and for
    heights under an unknown name.
    """
    clocks = [one for one in columns if _is_even(one.numbers)]
    others = [one for one in columns if not any(one is clock for clock in clocks)]
    if not others:
        return None
    clocks.sort(key=lambda one: (not one.unit_of("time"), "time" not in one.meanings))
    timed = _sample_times(name, clocks, len(columns[0].numbers), _rate_in(head))
    if timed is None:
        return None
    chosen = _clearest(others)
    kept = np.isfinite(timed.times) & np.isfinite(chosen.numbers)
    times = timed.times[kept]
    values = chosen.numbers[kept]
    if len(times) < _LEAST_ROWS or not float(np.ptp(values)) > 0.0:
        return None
    if _flies(times, values):
        # A track under an unknown name.
        return None
    even = evened(times)
    if even is None:
        # Jitter of a phone's clock, and samples that were dropped.
        even = np.linspace(times[0], times[-1], len(times))
        values = np.interp(even, times, values)
    rate = 1.0 / float(even[1] - even[0])
    if rate < _LEAST_RATE:
        return None
    unit = chosen.unit_of("force")
    if unit:
        values = values * unit_scale(name, chosen.what, unit, "force")
    if math.isclose(rate, round(rate), rel_tol=_OF_RATE):
        # Times are rounded.
        rate = float(round(rate))
    return Signal(name, values, rate, float(times[0]), chosen.what, bool(unit), timed.assumed)


class _Timed(NamedTuple):
    """Times of samples, s, (n,), and what was assumed of their unit; "" for nothing."""

    times: Floats
    assumed: str


def _sample_times(
    name: str, clocks: Sequence[_Column], count: int, rate: float | None
) -> _Timed | None:
    """Times of the samples by the first of the clocks, or by their rate where there is none.

    count: of the samples.
    rate: samples a second, None where the file does not tell it.
    None where neither tells the times.
    """
    if clocks:
        return _in_seconds(name, clocks[0], rate)
    if rate is None:
        return None
    return _Timed(np.arange(count) / rate, "")


def _flies(times: Floats, values: Floats) -> bool:
    """Say whether values, (n,), are heights in any unit: parabolas as long as flights, not as pushes."""
    fall = abs(seen_fall(times, values))
    return fall > 0.0 and math.sqrt(8.0 * float(np.ptp(values)) / fall) > _LONGEST_PUSH


def evened(times: Floats) -> Floats | None:
    """Times of samples, (n,), that are even but for their rounding; None where they are not, where
    samples were dropped, and for fewer than _LEAST_EVENED times.

    A force over rounded times would have a wrong impulse.
    """
    if len(times) < _LEAST_EVENED:
        return None
    even = np.linspace(times[0], times[-1], len(times))
    step = float(even[1] - even[0])
    if float(np.diff(times).max()) >= _GAP * step:
        return None
    return even if float(np.abs(times - even).max()) <= _ALIKE * step else None


def _is_even(numbers: Floats) -> bool:
    """Say whether numbers (n,) rise in nearly even steps, as the times of samples do."""
    numbers = numbers[np.isfinite(numbers)]
    steps = np.diff(numbers)
    if len(numbers) < _LEAST_ROWS or (steps < 0.0).any():
        return False
    usual = float(numbers[-1] - numbers[0]) / len(steps)
    # Whole milliseconds may stand still for some samples.
    alike = np.abs(steps - float(np.median(steps))) <= _ALIKE * usual
    return usual > 0.0 and float(alike.mean()) >= _MOST


def _in_seconds(name: str, clock: _Column, rate: float | None) -> _Timed | None:
    """Times of a column in s; None where it has no unit, and none is likely.

    rate: samples a second where the file tells it, for a column that counts them.
    """
    numbers = clock.numbers
    unit = clock.unit_of("time")
    if unit:
        return _Timed(unit_scale(name, "time", unit, "time") * numbers, "")
    finite = numbers[np.isfinite(numbers)]
    span = float(finite[-1] - finite[0])
    counts_samples = math.isclose(span, len(finite) - 1, rel_tol=1e-6)
    if rate is not None and counts_samples:
        return _Timed((numbers - finite[0]) / rate, "")
    for unit, second in (("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)):
        duration = span / second
        is_fast = len(finite) > _LEAST_RATE * duration
        if _DURATIONS[0] < duration < _DURATIONS[1] and is_fast:
            is_plain = "time" in clock.meanings and unit == "s"
            return _Timed(numbers / second, "" if is_plain else f"its time read as {unit}")
    return None


def _rate_in(head: str) -> float | None:
    """Samples a second by the first interval or rate in lines about a file; None where they tell none.

    head: the lines, in lower case.
    """
    interval = _INTERVAL.search(head)
    if interval is not None and 1e-9 < float(interval[1]) < 1.0:
        return 1.0 / float(interval[1])
    # Rigol: the number stands below "increment".
    lines = [line.split(",") for line in head.splitlines()]
    for names, numbers in itertools.pairwise(lines):
        if "increment" in names and len(numbers) > names.index("increment"):
            text = numbers[names.index("increment")]
            if _NUMBER.fullmatch(text) and float(text) > 0.0:
                return 1.0 / float(text)
    rate = _RATE.search(head)
    if rate is None or not float(rate[2]) > 0.0:
        return None
    thousands = 1e3 if rate[1] or rate[3] else 1.0
    return thousands * float(rate[2])


def _clearest(columns: Sequence[_Column]) -> _Column:
    """The column with the clearest pulses; the size of a vector where that is far clearer than its axes,
    as of a sensor in a ball that turns.

    A size hides to which side a pulse goes: an axis is better where it shows the pulses.
    """
    vectors = _vectors(columns)
    if not vectors:
        return max(columns, key=lambda one: _clearness(one.numbers))
    # phyphox writes the size itself, too.
    axes = [one for vector in vectors for one in vector]
    clearest = max(axes, key=lambda one: _clearness(one.numbers))
    for vector in vectors:
        # Forces of a plate along its axes: the one of the push has the impulse.
        if any(one.unit_of("force") for one in vector):
            continue
        numbers = np.linalg.norm([one.numbers for one in vector], axis=0)
        if _clearness(numbers) > _FAR_CLEARER * _clearness(clearest.numbers):
            clearest = _Column(numbers, vector[-1].names)
    return clearest


def _vectors(columns: Sequence[_Column]) -> list[list[_Column]]:
    """The columns of each vector, whose names differ by x, y and z alone, such as "acc_x"."""
    by_axis: dict[tuple[frozenset[str], str], dict[str, _Column]] = {}
    for one in columns:
        for name, unit in one.names:
            axis = re.search(r"(?:\b|_|a)([xyz])$", name.strip().casefold())
            if axis is not None:
                vector = frozenset(meanings_of(name) - {"x", "y", "z", "vertical"}), unit
                by_axis.setdefault(vector, {})[axis[1]] = one
    return [list(axes.values()) for axes in by_axis.values() if len(axes) == len("xyz")]


def _clearness(values: Floats) -> float:
    """Largest distance of values (n,) from their median, over the median distance."""
    away = np.abs(values - np.nanmedian(values))
    usual = float(np.nanmedian(away))
    top = float(np.nanmax(away))
    return top / usual if usual > 0.0 else top
