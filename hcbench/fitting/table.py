"""Columns of numbers with units in their header, from text files as
spreadsheets and phones write them.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
import re
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.column_names import explained
from hcbench.system.errors import QuantityError, UserError
from hcbench.system.files import is_file, read_bytes
from hcbench.system.text import sanitized
from hcbench.terms import units
from hcbench.terms.bounds import beyond_bounds, require_bounds

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from hcbench.terms.impact import Floats


# Largest file that is read, bytes.
_LARGEST = 16 << 20
# Smallest measured value of bounces, SI; its inverse is the largest.
_SMALLEST = 1e-12
# Units of a picture or of print: no lengths of the scene.
_NO_LENGTHS = ("px", "pixel", "pixels", "dot", "pt")
# Units of a column that is a ratio, such as e.
NO_UNIT = ("", "1", "-", "–")
# A "#" after a number starts a comment; in a header it may be part of a name, as in "bounce #".
_COMMENT = re.compile(r"(?<=[\d.])\s+#.*")
_NAMED = re.compile(
    r"\s*(?P<name>[^\[\]{}]*?)\s*"
    r"(?:\[\s*(?P<square>[^\]]*?)\s*\]|\(\s*(?P<round>[^()]*?)\s*\)|\{\s*(?P<curly>[^{}]*?)\s*\})\s*"
)


@dataclass(frozen=True, slots=True)
class Table:
    """A table as the file has it: names, units and cells of text.

    name: what errors call the file.
    header: names in lower case with their units, "" for none.
    cells: text, a row each; lines: their numbers in the file.
    decimal: the sign in numbers.
    """

    name: str
    header: tuple[tuple[str, str], ...]
    cells: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    decimal: str = "."

    def number(self, text: str) -> float:
        """A cell as a number; NaN for what is none."""
        # Python's float takes "1_0" for 10.
        if "_" in text:
            return math.nan
        try:
            return float(text.strip().replace(self.decimal, "."))
        except ValueError:
            return math.nan

    def column(self, at: int, quantity: str) -> Floats:
        """Return a column in SI. Raises UserError for a cell that is not a finite number and for a
        missing unit.
        """
        name, unit = self.header[at]
        scale = unit_scale(self.name, name, unit, quantity)
        values = np.empty(len(self.cells))
        for i, (row, line) in enumerate(zip(self.cells, self.lines, strict=True)):
            cell = cell_of(row, at)
            values[i] = self.number(cell)
            if not math.isfinite(values[i]):
                where = f"{self.name}, line {line}"
                raise UserError(where, f"{cell.strip()!r} under {name!r}", "a number")
            if values[i] and not _SMALLEST <= abs(values[i] * scale) <= 1.0 / _SMALLEST:
                where = f"{self.name}, line {line}"
                got = f"{cell.strip()} under {name!r}"
                raise UserError(
                    where, got, f"0, or {_SMALLEST:g} ... {1 / _SMALLEST:g} in SI units"
                )
        require_bounds(
            f"{self.name}: {name}",
            (values * scale).tolist(),
            quantity,
            units.QUANTITIES[quantity].unit,
            0.0,
        )
        return values * scale


@contextmanager
def computed(name: str) -> Iterator[None]:
    """Numbers that no computation carries are the file's mistake.

    name: what the error calls the file.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except (ArithmeticError, ValueError) as error:
        # ValueError is the base of NumPy's LinAlgError.
        got = "numbers that lead to no finite result"
        raise UserError(
            name, got, "bounces of one ball on one plate", "Look at the units"
        ) from error


def unit_scale(file: str, name: str, unit: str, quantity: str) -> float:
    """Return one unit of a column in SI. Raises UserError for a missing unit and for one that does
    not fit.
    """
    example = units.QUANTITIES[quantity].example.split()[-1]
    si_unit = units.QUANTITIES[quantity].unit
    if not si_unit and unit in NO_UNIT:
        return 1.0
    if not unit and si_unit:
        advice = f"Write it with one, such as: {name} [{example}]"
        raise UserError(file, f"the header {name!r} names no unit", "one in brackets", advice)
    try:
        if unit in _NO_LENGTHS:
            raise QuantityError(file, unit, "a length")
        with beyond_bounds():
            return units.parse(f"1 {unit}", quantity, file)
    except QuantityError:
        got = f"{unit!r} under {name!r} is not such a unit"
        expected = "none: it is a ratio"
        if si_unit:
            expected = f"one that converts to {si_unit}"
        raise UserError(file, got, expected) from None


def read_lines(path: Path) -> list[tuple[int, str]]:
    """Lines that have something in them, with their numbers. Raises UserError for what is not text."""
    name = path.name
    try:
        text = _decoded(path)
    except FileNotFoundError:
        raise UserError(str(path), "does not exist", "a file of measurements") from None
    except UnicodeDecodeError:
        # A damaged archive still begins as one.
        if path.read_bytes().startswith(b"PK\3\4"):
            advice = "Unpack it and give its .csv"
            raise UserError(name, "a zip archive", "a file of numbers", advice) from None
        expected = "text in columns, or .wav"
        # A recording is read in parts, which no pipe gives.
        advice = "" if is_file(path) else "Save what the pipe brings to a file, and give that"
        raise UserError(
            name, "is neither UTF-8 text nor a WAV recording", expected, advice
        ) from None
    except OSError as error:
        raise UserError(name, error.strerror or str(error), "a file that can be read") from None
    except ValueError as error:
        # ValueError: a name with a null character.
        raise UserError(name, str(error), "a file that can be read") from None
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        with explained(name, ()):
            raise UserError(name, "is empty", "a header and rows of numbers")
    return lines


def _decoded(path: Path) -> str:
    """UTF-8, UTF-16 with or without its mark, and what spreadsheets in Windows write.

    Raises UnicodeDecodeError for what is not text, OSError for what cannot be read, and ValueError
    for
    a file beyond 16 MiB.
    """
    # Read once: a pipe cannot be read again.
    raw = read_bytes(path, _LARGEST)
    try:
        text = raw.decode("utf-8-sig")
        if "\0" not in text:
            return text
        # Latin letters in UTF-16 without its mark: each second byte is 0,
        # and all of it is valid UTF-8.
        if raw[1:2] == b"\0":
            return raw.decode("utf-16-le")
        return raw.decode("utf-16-be")
    except UnicodeDecodeError:
        if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
            text = raw.decode("utf-16")
            if any(letter.isdecimal() for letter in text):
                return text
        if any(byte < 9 for byte in raw):
            raise
        return raw.decode("cp1252")


def read_table(path: Path, lines: list[tuple[int, str]]) -> Table:
    """A table with one header line. Separators: comma, semicolon, tab,
    |, blanks; # begins a comment.

    A header may be the last comment before the numbers, as `numpy.savetxt` writes it. Raises
    UserError with the file, the line, what it has and what was expected.
    """
    kept: list[tuple[int, str]] = []
    comment = None
    for number, line in lines:
        if line.lstrip().startswith("#"):
            if not kept:
                comment = (number, line.strip().removeprefix("#").strip())
            continue
        kept.append((number, _COMMENT.sub("", line)))
    if comment is not None and kept and _is_header_of(comment[1], kept[0][1]):
        kept.insert(0, comment)
    return table_of(path, kept)


def _is_header_of(comment: str, first: str) -> bool:
    """Say whether a comment names the cells of the first line of numbers.

    comment: without its "#". first: the first line of numbers.
    """
    if not _ONLY_NUMBERS.fullmatch(first):
        return False
    # The first of the signs that either has is the separator: both need as many of it.
    for sign in ("\t", ";", ","):
        if sign in comment or sign in first:
            if comment.count(sign) != first.count(sign):
                return False
            break
    last = re.split(r"[\t;,]", comment)[-1].strip()
    name, _ = split_header(last)
    return any(letter.isalpha() for letter in name)


def table_of(path: Path, lines: list[tuple[int, str]]) -> Table:
    """The table in these lines, each with its number in the file.

    Raises UserError, `explained`, for lines without a header or without rows, a row with more cells
    than the header has, and numbers that can be read in two ways.
    """
    name = sanitized(path.name)
    with explained(name, ()):
        table = _parted(name, lines)
    with explained(name, table.header):
        _require_rows(table)
        _require_one_meaning(table)
    return plain(table)


def _parted(name: str, lines: list[tuple[int, str]]) -> Table:
    """The table in these lines, its cells as they are.

    name: what errors call the file. lines: each with its number in the file.
    Raises UserError for lines without a header, and for a cell that is too long.
    """
    if not lines:
        raise UserError(name, "has comments only", "a header and rows of numbers")
    if len(lines) > 2 and _is_title(lines[0][1], lines[1][1]):
        lines = lines[1:]
    lines = _without_pipes(lines)
    numbers = [n for n, _ in lines]
    texts = [text for _, text in lines]
    separator = _separator(texts)
    if separator not in "".join(texts):
        texts = _without_blanks(texts)
        separator = _separator(texts)
    rows = []
    for number, text in zip(numbers, texts, strict=True):
        rows.append(_cells(name, number, text, separator))
    joined = joined_header(rows)
    if joined is not None:
        begin, header = joined
        rows = [header, *rows[begin:]]
        numbers = [numbers[0], *numbers[begin:]]
    header, *cells = rows
    decimal = "."
    # Where commas do not part the cells, a comma in a cell is for a point.
    if separator != "," and "," in "".join(itertools.chain(*cells)):
        decimal = ","
    table = Table(
        name=name,
        header=tuple(map(split_header, header)),
        cells=tuple(cells),
        lines=tuple(numbers[1:]),
        decimal=decimal,
    )
    if all(math.isfinite(table.number(cell)) for cell in header if cell.strip()):
        raise UserError(name, f"begins with the numbers {texts[0].strip()!r:.60}", "a header")
    return table


def _require_rows(table: Table) -> None:
    """Raise UserError for a table without rows, and for a row with more cells than the header has."""
    if not table.cells:
        raise UserError(table.name, "has a header and no rows", "rows of numbers")
    width = len(table.header)
    for row, line in zip(table.cells, table.lines, strict=True):
        beyond = "".join(row[width:])
        if beyond.strip():
            raise UserError(
                f"{table.name}, line {line}", f"{len(row)} cells", f"{width}, as the header has"
            )


def _require_one_meaning(table: Table) -> None:
    """Raise UserError for numbers whose commas or points may be decimal signs or part thousands.

    In a file there is one decimal sign. A comma before three digits is one only where another comma
    of the file can be nothing else, as in 0,5.
    """
    with_comma: list[str] = []
    with_point: list[str] = []
    for row in table.cells:
        for cell in row:
            number = cell.strip().rstrip("% ")
            if not _looks_numeric(number) and _uncertain(number) is None:
                continue
            if "," in number:
                with_comma.append(number)
            if "." in number:
                with_point.append(number)
    advice = "Write numbers without a sign between the thousands"
    if with_comma and with_point:
        got = f"{with_comma[0]!r} and {with_point[0]!r}"
        raise UserError(table.name, got, "one decimal sign in the file", advice)
    if with_comma and all(_THOUSANDS.fullmatch(number) for number in with_comma):
        whole = with_comma[0].replace(",", "")
        decimal = with_comma[0].replace(",", ".")
        expected = f"{whole} or {decimal}, whichever it is"
        raise UserError(table.name, repr(with_comma[0]), expected, advice)


def _cells(name: str, number: int, text: str, separator: str) -> tuple[str, ...]:
    """Cells of one line. Raises UserError where one of them is too long to be a number or a name."""
    try:
        return tuple(next(csv.reader(io.StringIO(text), delimiter=separator)))
    except csv.Error as error:
        raise UserError(f"{name}, line {number}", str(error), "cells of numbers") from None


def _separator(texts: list[str]) -> str:
    """The sign between the cells of a table, by its first line; ";" for one
    column with commas for points.
    """
    first, *others = texts
    single = re.compile(r"\s*[-+]?\d+,\d+\s*")
    if "," not in first and all(map(single.fullmatch, others)):
        return ";"
    for sign in ("\t", ";"):
        if sign in first:
            return sign
    return ","


def _without_pipes(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """Lines of a table of Markdown or of a database, with tabs for "|" and without rules."""
    if "|" not in lines[0][1]:
        return lines
    kept: list[tuple[int, str]] = []
    for number, text in lines:
        if not _RULE.fullmatch(text):
            cells = text.strip().strip("|").split("|")
            kept.append((number, "\t".join(cell.strip() for cell in cells)))
    return kept


def _without_blanks(texts: list[str]) -> list[str]:
    """Lines of numbers between blanks, with tabs for the blanks; other lines as they are.

    Names in the header may have single blanks where there are two and more between the columns.
    """
    header, *rows = texts
    cells = list(map(str.split, rows))
    widths = set(map(len, cells))
    is_of_numbers = all(map(_looks_numeric, itertools.chain(*cells)))
    if len(widths) != 1 or widths == {1} or not is_of_numbers:
        return texts
    # A unit in brackets belongs to the name before it.
    for blanks in (r"\s{2,}(?![\[(])", r"\s+(?![\[(])"):
        names = re.split(blanks, header.strip())
        if {len(names)} == widths:
            return list(map("\t".join, [names, *cells]))
    return texts


def _is_title(first: str, second: str) -> bool:
    """Say whether a line is a name alone, over a header of several columns."""
    titles = [cell for cell in re.split(r"[\t;,]", first) if cell.strip()]
    below = list(map(str.strip, re.split(r"[\t;,]", second)))
    if len(titles) != 1 or len(below) < 2:
        return False
    # A name begins with neither a digit nor a sign.
    return all(re.match(r"[^\d+-]", cell) for cell in below)


def split_header(cell: str) -> tuple[str, str]:
    """(name in lower case, unit) of "name [unit]", "name (unit)" or "name
    {unit}"; the unit "" for none.
    """
    match = _NAMED.fullmatch(cell)
    if match is None:
        return with_unit(cell.lower(), "")
    brackets = match.group("square", "round", "curly")
    # One of the three has matched; its text may be empty.
    unit = next(text for text in brackets if text is not None)
    return with_unit(match["name"].lower(), unit)


_LATEST = re.compile(r"^(?:latest|run \d+|data set(?: \d+)?|set \d+|mass [a-z]|ball)\s*:\s*")
_UNITS = frozenset(
    [
        "s",
        "ms",
        "us",
        "µs",
        "min",
        "m",
        "mm",
        "cm",
        "um",
        "µm",
        "km",
        "in",
        "ft",
        "m/s",
        "cm/s",
        "mm/s",
        "km/h",
        "mph",
        "ft/s",
        "in/s",
        "mps",
        "kph",
        "kmh",
        "knots",
        "sec",
        "secs",
        "second",
        "seconds",
        "msec",
        "millimeter",
        "millimeters",
        "centimeter",
        "centimeters",
        "meter",
        "meters",
        "metre",
        "metres",
        "meter/second",
        "meters/second",
        "inch",
        "inches",
        "feet",
        "n",
        "kn",
        "mn",
        "%",
    ]
)
_RULE = re.compile(r"[\s|:+-]+")
_BEFORE_UNIT = re.compile(r"\s*/\s*|_|\s*,\s*|\s+in\s+|\s+")
# "m s^-1" and "m*s^-1" are m/s.
_BY_POWER = re.compile(r"([a-zµ]+)[\s*]([sh])\^-1")
_NUMBER = r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?"
_ONLY_NUMBERS = re.compile(r"[-+\d.,;\teE\s±()%]*\d[-+\d.,;\teE\s±()%]*")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}")
_UNCERTAIN = re.compile(rf"\s*({_NUMBER})\s*(?:±|\+-|\+/-)\s*({_NUMBER})\s*")
_SHORT = re.compile(r"\s*([-+]?\d*[.,]?(\d*))\((\d+)\)\s*")


def with_unit(name: str, unit: str) -> tuple[str, str]:
    """(name, unit) of "t/s", "time_s", "time, s", "height in cm"; "Latest: " is left out."""
    # Keyboards have the Greek letter, Unicode the sign of micro too.
    name, unit = (text.replace("\N{GREEK SMALL LETTER MU}", "µ") for text in (name, unit))
    name = _LATEST.sub("", name.strip()).strip().rstrip("/").strip()
    if unit:
        return name, unit
    # The first sign after which all is a unit: "speed_m_s" has m/s, not s.
    for sign in _BEFORE_UNIT.finditer(name, 1):
        unit = _BY_POWER.sub(r"\1/\2", units.usual_unit(name[sign.end() :]))
        if unit in _UNITS:
            return name[: sign.start()].strip(), unit
    return name, ""


def plain(table: Table) -> Table:
    """The table without shares in per cent and with an uncertainty in a column of its own.

    Cells such as `0.20 ± 0.01`, `0.960(5)`, and commas for points in single columns.
    """
    header = list(table.header)
    names = [name for name, _ in table.header]
    columns = _transposed(table)
    for i, (name, unit) in enumerate(table.header):
        split = _split_uncertainties(columns[i])
        if split is not None and f"u_{name}" not in names:
            columns[i], uncertainties = split
            names.append(f"u_{name}")
            header.append((f"u_{name}", unit))
            columns.append(uncertainties)
        columns[i] = [_with_point(table, cell) for cell in columns[i]]
    for i, (name, unit) in enumerate(header):
        cells = columns[i]
        if unit == "%" or (cells and all(cell.strip().endswith("%") for cell in cells)):
            header[i] = (name, "")
            columns[i] = list(map(_share, cells))
    rows = tuple(zip(*columns, strict=True))
    return replace(table, header=tuple(header), cells=rows, decimal=".")


def _split_uncertainties(cells: list[str]) -> tuple[list[str], list[str]] | None:
    """Values, and their standard uncertainties; None where a cell has none."""
    values = []
    uncertainties = []
    for cell in cells:
        pair = _uncertain(cell)
        if pair is None:
            return None
        values.append(pair[0])
        uncertainties.append(pair[1])
    return values, uncertainties


def cell_of(row: Sequence[str], at: int) -> str:
    """The text of a cell; "" where the row is too short to have it."""
    if at >= len(row):
        return ""
    return row[at]


def _transposed(table: Table) -> list[list[str]]:
    """The cells column by column; "" for those that a short row lacks."""
    columns: list[list[str]] = [[] for _ in table.header]
    for row in table.cells:
        for i, column in enumerate(columns):
            column.append(cell_of(row, i))
    return columns


def _with_point(table: Table, cell: str) -> str:
    """The cell with a point for the decimal sign; other text as it is."""
    if math.isfinite(table.number(cell)):
        return cell.replace(table.decimal, ".")
    single = re.fullmatch(r"\s*[-+]?\d+,\d+(?:[eE][-+]?\d+)?\s*%?\s*", cell)
    if single is None:
        return cell
    return cell.replace(",", ".")


def _share(cell: str) -> str:
    """A share in per cent as a ratio; other text as it is."""
    try:
        return f"{float(cell.strip().rstrip('%').replace(',', '.')) / 100.0:.12g}"
    except ValueError:
        return cell


def _uncertain(cell: str) -> tuple[str, str] | None:
    """Value and standard uncertainty of `0.20 ± 0.01` or `0.960(5)`."""
    if (match := _UNCERTAIN.fullmatch(cell)) is not None:
        return match[1].replace(",", "."), match[2].replace(",", ".")
    if (match := _SHORT.fullmatch(cell)) is not None and match[1]:
        digits = len(match[2])
        return match[1].replace(",", "."), f"{int(match[3]) * 10.0**-digits:.12g}"
    return None


def joined_header(rows: list[tuple[str, ...]]) -> tuple[int, tuple[str, ...]] | None:
    """Return the first row of numbers and the header, if the units have a line of their own; else
    None.

    As Logger Pro writes it: names, short names and units in three lines; or names and units in two.
    """
    for count in (3, 2):
        widths = set(map(len, rows[: count + 1]))
        if len(rows) <= count or len(widths) != 1:
            continue
        names = rows[0]
        below = [cell.strip().strip("()[]").lower() for cell in rows[count - 1]]
        # A ratio has no unit.
        of_quantities = [cell for cell in below if cell not in NO_UNIT]
        has_units = bool(of_quantities) and all(map(_is_unit, of_quantities))
        if has_units and not any(map(_looks_numeric, names)):
            pairs = zip(names, below, strict=True)
            return count, tuple(f"{name.strip()} [{unit}]" for name, unit in pairs)
    return None


def _looks_numeric(cell: str) -> bool:
    return re.fullmatch(rf"\s*{_NUMBER}\s*", cell) is not None


def _is_unit(text: str) -> bool:
    """True for the unit of a column of times, places, speeds or forces."""
    if text not in _UNITS:
        return False
    for quantity in ("time", "position", "speed", "force"):
        try:
            units.parse(f"1 {text}", quantity, "unit")
        except QuantityError:
            continue
        return True
    return False
