"""Tables in a sheet: which rows are the header, where the numbers begin, and the lines before it."""

from __future__ import annotations

import itertools
import math
import re
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.cells import NumberStyle, is_missing, looks_numeric, style_of
from hcbench.fitting.column_names import (
    NO_UNIT,
    QUANTITIES_OF_COLUMNS,
    QUANTITY_OF,
    explained,
    is_unit,
    is_unit_of,
    meanings_of,
    numbers_bounces,
    of_file,
    plain_unit,
    role_of,
    split_header,
)
from hcbench.fitting.separators import counts, listed_names
from hcbench.system.errors import QuantityError, UserError
from hcbench.terms import units
from hcbench.terms.bounds import beyond_bounds, require_bounds

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.fitting.cells import NumberCell
    from hcbench.fitting.separators import Row
    from hcbench.fitting.sheets import Sheet
    from hcbench.terms.impact import Floats

# Smallest measured value of bounces, SI; its inverse is the largest.
_SMALLEST = 1e-12
# Units of a picture or of print: no lengths of the scene.
_NO_LENGTHS = ("px", "pixel", "pixels", "dot", "pt")
# Times beyond this, in any unit, count from a date: the first of them is taken off.
_OF_A_DATE = 1e6
# Seconds since 1970 in the years 2001 and 2096.
_EARLIEST = 1e9
_LATEST = 4e9
# Rows above the numbers that may have names or units.
_MOST_HEADER_ROWS = 6
# Rows after which another header begins another table.
_LEAST_ROWS = 2
# A name that computes with its quantity: "2t", "100 h", "1 - e"; "t/2", "h / 10^-2"; "h + 6"; "e^3".
_COMPUTES = re.compile(
    r"\d+(?:[.,]\d+)?\s*[×x*·/−–-]?\s*(?!(?:st|nd|rd|th|er|re|te|ter|o|a)\b)[^\W\d_].*"
    r"|.*[×*·/]\s*\d+(?:[.,]\d+)?(?:\s*\^\s*[-−]?\d+)?"
    r"|.*(?:\s[-−–]\s*|\+\s*)\d+(?:[.,]\d+)?"
    r"|.*\^\s*(?!2\b)\d.*"
)
# Words before a number over the rows above.
_SUMS = (
    "sum",
    "total",
    "min",
    "max",
    "minimum",
    "maximum",
    "count",
    "range",
    "summe",
    "somme",
    "suma",
    "var",
    "variance",
)
# Meanings of columns that have a time of a touch each.
_OF_TIMES = {"time", "touch", "bounce", "begin", "beside"}
# Share by which rebounds from one height differ, at most.
_SAME_REBOUND = 0.2
# Roles of impacts measured one by one, and those of them after the impact.
_AFTER = {"height_out", "speed_out"}
_OF_PAIRS = {"height_in", "speed", "speed_in", "restitution", "squared", *_AFTER}
# Quantities whose units a line before the table may name.
_UNITS_OF = {"unit of length": "position", "unit of time": "time"}
_POINTS = NumberStyle()
_RATE_IN_WORDS = re.compile(r"(\d+(?:[.,]\d+)?)\s*(?:fps|hz|frames\s*(?:per|/)\s*s)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Table:
    """A table as the file has it: names, units and cells of text.

    name: what errors call the file.
    header: names in lower case with their units, "" for none.
    cells: text, a row each; lines: their numbers in the file.
    style: of the numbers. frequency: of frames or samples, Hz; None for none.
    units: those of a quantity that lines before the table name, such as {"position": "mm"}.
    """

    name: str
    header: tuple[tuple[str, str], ...]
    cells: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    style: NumberStyle = _POINTS
    frequency: float | None = None
    units: tuple[tuple[str, str], ...] = ()

    def number(self, text: str) -> float:
        """A cell as a number; NaN for what is none."""
        cell = self.style.read(text)
        return math.nan if cell is None else cell.value

    def numbers(self, at: int) -> Floats:
        """A column as it stands, in its own unit, (n,); NaN for other text."""
        return np.array([self.number(text) for text in self.texts(at)])

    def texts(self, at: int) -> list[str]:
        """The cells of a column, as the file has them."""
        return [cell_of(row, at) for row in self.cells]

    def in_unit(self, at: int, quantity: str) -> Floats:
        """A column in SI, (n,); NaN for other text. Raises UserError for a missing unit."""
        return np.asarray(self._scale(at, quantity) * self.numbers(at))

    def has_number(self, at: int) -> bool:
        """Say whether any cell of a column is a number."""
        return bool(np.isfinite(self.numbers(at)).any())

    def is_given(self, at: int) -> list[bool]:
        """For each row, True where the column has a cell that does not say "missing"."""
        return [not is_missing(text) for text in self.texts(at)]

    def column(self, at: int, quantity: str) -> Floats:
        """Return a column in SI. Raises UserError for a cell that is not a finite number and for a
        missing unit.
        """
        cells = self._read(at)
        self._require_plain(at, quantity, cells)
        return self._in_si(at, quantity, [cell.value for cell in cells])

    def _require_plain(self, at: int, quantity: str, cells: Sequence[NumberCell]) -> None:
        """Raise UserError for a name that computes with its quantity, and for one of its cells whose
        unit is not that of the header.
        """
        name, unit = self.header[at]
        if _COMPUTES.fullmatch(name):
            got = f"{name!r} computes with its quantity"
            advice = "Write the quantity itself, under its name and unit alone"
            raise UserError(self.name, got, "a plain name", advice)
        if not unit:
            return
        scale = self._scale(at, quantity)
        for cell, text, line in zip(cells, self.texts(at), self.lines, strict=True):
            # A time of the clock is in seconds under any header.
            if not cell.unit or ":" in text:
                continue
            written = plain_unit(cell.unit)
            if written != unit and unit_scale(self.name, name, written, quantity) != scale:
                got = f"{text.strip()!r} under {name!r} in {unit}"
                raise UserError(f"{self.name}, line {line}", got, f"a number in {unit}")

    def uncertainty(self, at: int, quantity: str) -> Floats:
        """Standard uncertainties that cells such as "0.20 ± 0.01" have, in SI; 0 for none."""
        each = [cell.uncertainty for cell in self._read(at)]
        return np.asarray(self._scale(at, quantity) * np.nan_to_num(np.array(each)))

    def _read(self, at: int) -> list[NumberCell]:
        """The cells of a column as numbers. Raises UserError for one that is none."""
        found = []
        for row, line in zip(self.cells, self.lines, strict=True):
            text = cell_of(row, at)
            cell = self.style.read(text)
            if cell is None or math.isinf(cell.value) or math.isinf(cell.uncertainty):
                where = f"{self.name}, line {line}"
                raise UserError(where, f"{text.strip()!r} under {self.header[at][0]!r}", "a number")
            found.append(cell)
        return found

    def unit_of(self, at: int, quantity: str) -> str:
        """The unit of a column: of its header, of its cells, or of a line before the table."""
        unit = self.header[at][1]
        if not unit:
            written = {
                cell.unit for row in self.cells if (cell := self.style.read(cell_of(row, at)))
            }
            if len(written) == 1:
                unit = plain_unit(next(iter(written)))
        unit = unit or dict(self.units).get(quantity, "")
        if not unit and quantity == "time":
            unit = self._unit_of_dates(at)
        return unit

    def _unit_of_dates(self, at: int) -> str:
        """The unit in which a column counts from 1970, as computers do; "" where it does not."""
        first = abs(self.number(cell_of(self.cells[0], at))) if self.cells else 0.0
        for unit, second in (("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)):
            if _EARLIEST * second < first < _LATEST * second:
                return unit
        return ""

    def _scale(self, at: int, quantity: str) -> float:
        """One unit of a column in SI. Raises UserError for a missing one, and one that does not fit."""
        return unit_scale(self.name, self.header[at][0], self.unit_of(at, quantity), quantity)

    def _in_si(self, at: int, quantity: str, each: list[float]) -> Floats:
        """A column's numbers in SI. Raises UserError for one that no measurement has."""
        scale = self._scale(at, quantity)
        values = np.array(each)
        if quantity == "time" and len(values) and values.min() > _OF_A_DATE:
            values = values - values.min()
        name = self.header[at][0]
        for value, row, line in zip(values, self.cells, self.lines, strict=True):
            if value and not _SMALLEST <= abs(value * scale) <= 1.0 / _SMALLEST:
                where = f"{self.name}, line {line}"
                got = f"{cell_of(row, at).strip()} under {name!r}"
                expected = f"0, or {_SMALLEST:g} ... {1 / _SMALLEST:g} in SI units"
                raise UserError(where, got, expected)
        si_unit = units.QUANTITIES[quantity].unit
        require_bounds(f"{self.name}: {name}", (values * scale).tolist(), quantity, si_unit, 0.0)
        return np.asarray(values * scale)


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
    if not si_unit and unit.lower() in NO_UNIT:
        return 1.0
    if not si_unit and unit == "%":
        return 0.01
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


def tables_of(sheet: Sheet) -> list[Table]:
    """The tables of a sheet: one below the other, and drops side by side.

    Raises UserError, `explained`, for a sheet without numbers, a row with more cells than the header
    has, and numbers that can be read in two ways.
    """
    rows = [(line, tuple(cell.strip() for cell in cells)) for line, cells in sheet.rows]
    turned = _turned(rows)
    if len(turned) > len(rows) or not any(_is_data(cells) for _, cells in rows):
        rows = turned
    is_of_tracker = any("multi" in cells[0].split(":") for _, cells in rows[:3])
    tables: list[Table] = []
    parts = list(_parts(rows))
    # Remarks below a table may begin with names.
    of_numbers = [part for part in parts if any(_is_data(cells) for _, cells in part)]
    for part in of_numbers or parts:
        above = [cells for line, cells in rows if line < part[0][0] and not _is_data(cells)]
        table = _table(sheet.name, part, above)
        for drop in _one_below_the_other(table):
            tables += _in_a_row(drop) or _made_again(drop) or _side_by_side(drop)
    if is_of_tracker and len(tables) > 1:
        raise UserError(sheet.name, "several tracks", "one", "Export the ball's track alone")
    return tables


def _is_data(cells: Sequence[str]) -> bool:
    """Say whether a row has numbers of a table: half of its cells, and no name first."""
    given = [cell for cell in cells if not is_missing(cell)]
    numeric = sum(map(looks_numeric, given))
    if not numeric or 2 * numeric < len(given):
        return False
    if looks_numeric(given[0]):
        return True
    return role_of(*split_header(given[0])) not in QUANTITY_OF and not of_file(given[0])


def _turned(rows: list[Row]) -> list[Row]:
    """Rows and columns exchanged where each row has a name and then numbers; else as they are."""
    named: list[tuple[int, list[str]]] = []
    others: list[Row] = []
    for line, cells in rows:
        first, *rest = [*cells]
        match = re.fullmatch(r"(.*\D)\s*[:=]\s*\[?\s*(\S*)", first)
        if match is not None and role_of(*split_header(match[1])) in QUANTITY_OF:
            first, rest = match[1], [match[2], *rest] if match[2] else rest
        numeric = sum(map(looks_numeric, rest))
        is_named = bool(first) and not looks_numeric(first)
        if (
            is_named
            and numeric > 1
            and 2 * numeric > sum(1 for cell in rest if not is_missing(cell))
        ):
            named.append((line, [first, *(cell.strip("[]") for cell in rest)]))
        else:
            others.append((line, cells))
    has_role = any(role_of(*split_header(cells[0])) in QUANTITY_OF for _, cells in named)
    # Under a header of several names a row with a name is a row of that table.
    is_under_header = any(
        sum(role_of(*split_header(cell)) in QUANTITY_OF for cell in cells) > 1
        for _, cells in others
    )
    if not named or not has_role or is_under_header:
        return rows
    turned = itertools.zip_longest(*(cells for _, cells in named), fillvalue="")
    line = named[0][0]
    return [*others, *((line, tuple(cells)) for cells in turned)]


def _parts(rows: list[Row]) -> Iterator[list[Row]]:
    """Tables one below the other: after rows of numbers, a row of names begins another one."""
    part: list[Row] = []
    count = 0
    for line, cells in rows:
        is_data = _is_data(cells)
        if not is_data and count >= _LEAST_ROWS and _names(cells):
            yield part
            part, count = [], 0
        part.append((line, cells))
        count += is_data
    yield part


def _names(cells: Sequence[str]) -> int:
    """Number of names of columns in a row."""
    return sum(
        role_of(*split_header(cell)) != "" for cell in cells if cell and not looks_numeric(cell)
    )


def _table(name: str, rows: list[Row], above: list[tuple[str, ...]]) -> Table:
    """The table in these rows, below others. Raises UserError, `explained`, where there is none."""
    begin, end = _block(name, rows)
    width = max(len(_trimmed(cells)) for _, cells in rows[begin:end])
    # "Run 2", alone in its line, parts drops.
    body = [row for row in rows[begin:end] if not _is_label(row[1], width)]
    header, before = _header(rows[:begin], body, width)
    # "frame (240 fps)" has the rate in the header.
    frequency, written = _said_before([*above, *before, tuple(" ".join(one) for one in header)])
    for at, (called, unit) in enumerate(header):
        if _RATE_IN_WORDS.search(unit) and any(":" in cells[at] for _, cells in body if cells[at:]):
            got = f"frames in the times under {called!r}"
            raise UserError(name, got, "seconds with decimals, or numbers of frames")
    header = tuple((one, "" if _RATE_IN_WORDS.fullmatch(unit) else unit) for one, unit in header)
    if "x" in written:
        header = tuple(
            (written["x"], unit) if meanings_of(name) == {"x"} else (name, unit)
            for name, unit in header
        )
    table = Table(
        name=name,
        header=header,
        cells=tuple(cells for _, cells in body),
        lines=tuple(line for line, _ in body),
        frequency=frequency,
        units=tuple(written.items()),
    )
    with explained(name, table.header):
        table = _in_one_unit(replace(table, style=_style(table)))
        for row, line in zip(table.cells, table.lines, strict=True):
            if any(row[len(header) :]):
                got = f"{len(row)} cells"
                raise UserError(f"{name}, line {line}", got, f"{len(header)}, as the header has")
    return table


def _block(name: str, rows: list[Row]) -> tuple[int, int]:
    """First and last rows of the numbers: the longest run of rows of numbers, and what
    belongs to it before and after.

    Rows that sum up, such as "mean,0.8", end it. Raises UserError where no row has numbers.
    """
    is_data = [_is_data(cells) for _, cells in rows]
    longest, start, at = 0, 0, 0
    for has_numbers, group in itertools.groupby(is_data):
        count = len(list(group))
        if has_numbers and count >= longest:
            longest, start = count, at
        at += count
    if not longest:
        header = next((tuple(map(split_header, cells)) for _, cells in rows if _names(cells)), ())
        got = "has a header and no rows" if header else "has no numbers"
        with explained(name, header):
            raise UserError(name, got, "a header and rows of numbers")
    above = max((i for i in range(start) if _names(rows[i][1])), default=-1)
    width = len(_trimmed(rows[start][1]))
    begin = next(
        i for i in range(above + 1, start + 1) if is_data[i] and len(_trimmed(rows[i][1])) == width
    )
    end = next((i for i in range(start, len(rows)) if _sums_up(rows[i][1])), len(rows))
    return begin, end


def _sums_up(cells: Sequence[str]) -> bool:
    """Say whether a row begins with "mean", "sd" or another word for a number over the rows above."""
    return re.fullmatch(r"[^\W\d_][\w\s.]*:?", cells[0]) is not None and (
        (meanings_of(cells[0]) <= {"mean", "uncertainty", "filler"} and bool(meanings_of(cells[0])))
        or cells[0].strip(": ").lower() in _SUMS
    )


def _trimmed(cells: Sequence[str]) -> tuple[str, ...]:
    """Cells without the empty ones at their end."""
    count = len(cells)
    while count and not cells[count - 1]:
        count -= 1
    return tuple(cells[:count])


def _header(
    above: list[Row], body: list[Row], width: int
) -> tuple[tuple[tuple[str, str], ...], list[tuple[str, ...]]]:
    """Names with units over rows of numbers, and the rows above that are none of it.

    body: the rows of numbers; width: their cells. Names may have a row of units below them, a row
    of groups above them, as motion capture writes it, or be missing: then all are "".
    """
    rows = [_trimmed(cells) for _, cells in above]
    near = [
        i
        for i in range(max(0, len(rows) - _MOST_HEADER_ROWS), len(rows))
        if (not _is_said(rows[i]) and _fits(rows[i], body, width))
        or (_are_units(rows[i]) and len(rows[i]) <= width)
    ]
    # A title has words of a header, and no units.
    units = {i: sum(bool(split_header(cell)[1]) for cell in rows[i]) for i in near}
    at = max(
        near, key=lambda i: (_names(rows[i]), len(rows[i]) == width, units[i], -i), default=None
    )
    if at is not None and not _names(rows[at]):
        # No name is known: the row next to the numbers is the header, unless it is a title.
        at = next(
            (i for i in reversed(near) if not _are_units(rows[i]) and len(rows[i]) == width), None
        )
    if at is None:
        listed = listed_names([" ".join(row) for row in rows], width)
        return tuple(map(split_header, listed or [""] * width)), rows
    names = _padded(rows[at], body, width)
    # Numbers beyond the last name may be halves of numbers with commas: no name is made up for them.
    is_short = any(any(cells[len(rows[at]) :]) for _, cells in body)
    if is_short and len(names) > len(rows[at]) and names[0]:
        names = rows[at]
    header = [split_header(name) for name in names]
    used = {at}
    below = next((i for i in near if i != at and _are_units(rows[i])), None)
    if below is not None:
        used.add(below)
        written = _padded(rows[below], body, width)
        for i, unit in enumerate(map(plain_unit, written[: len(header)])):
            if not header[i][1] and unit.lower() not in NO_UNIT:
                header[i] = (header[i][0], unit)
    groups = [i for i in near if i < at and i not in used and len(rows[i]) >= width - 1]
    if groups and len(set(header)) < len(header):
        group = _padded(rows[groups[-1]], body, width)
        header = [
            (f"{of} {name}".lower() if of else name, unit)
            for of, (name, unit) in zip(group, header, strict=True)
        ]
    return tuple(header), [row for i, row in enumerate(rows) if i not in used]


def _is_said(cells: tuple[str, ...]) -> bool:
    """Say whether a row is a name of the whole file and its value, as programs write above tables."""
    return len(cells) == 2 and bool(of_file(cells[0])) and not role_of(*split_header(cells[0]))


def _fits(cells: tuple[str, ...], body: list[Row], width: int) -> bool:
    """Say whether a row may name the columns of the numbers below it."""
    if not any(any(map(str.isalpha, cell)) for cell in cells) or any(map(looks_numeric, cells)):
        return False
    if len(cells) == width or (len(cells) == width - 1 and _is_counted(body)):
        return True
    return _names(cells) > 0 and (width == 1 or len(cells) > 1)


def _is_counted(body: list[Row]) -> bool:
    """Say whether the first column counts or names the rows: pandas gives it no name."""
    first = [cells[0] for _, cells in body]
    if not any(map(looks_numeric, first)):
        return True
    return counts(first)


def _padded(cells: tuple[str, ...], body: list[Row], width: int) -> tuple[str, ...]:
    """The cells of a row above the numbers, as many as there are columns."""
    if len(cells) == width - 1 and _is_counted(body):
        return ("", *cells)
    return (*cells, *[""] * (width - len(cells)))


def _are_units(cells: Sequence[str]) -> bool:
    """Say whether a row has units alone."""
    given = [cell.strip("()[] ") for cell in cells if cell.strip("()[] ").lower() not in NO_UNIT]
    return bool(given) and all(map(is_unit, given))


def _said_before(rows: list[tuple[str, ...]]) -> tuple[float | None, dict[str, str]]:
    """The frequency of frames or samples, Hz, and units by quantity, that lines before a table name."""
    frequency = None
    written: dict[str, str] = {}
    for i, cells in enumerate(rows):
        text = "\t".join(cells)
        parts = [part.strip() for part in re.split(r"[\t:=;,]", text) if part.strip()]
        for name, value in itertools.pairwise(parts):
            meaning = of_file(name)
            number = re.match(r"\d+(?:\.\d+)?", value)
            if meaning == "frequency" and number is not None:
                frequency = frequency or float(number[0])
            elif meaning in _UNITS_OF and is_unit(plain_unit(value)):
                written[_UNITS_OF[meaning]] = plain_unit(value)
            elif meaning == "units" and value.lower() in ("si", "mks"):
                written |= {"time": "s", "position": "m", "speed": "m/s", "force": "N"}
            elif meaning == "units":
                unit = plain_unit(value)
                written |= {of: unit for of in QUANTITIES_OF_COLUMNS if is_unit_of(unit, of)}
            elif meaning == "dimension of x" and role_of(value.lower()) == "time":
                # LabVIEW counts its x in s and names it x_value.
                written |= {"x": "time", "time": "s"}
        match = _RATE_IN_WORDS.search(text)
        if match is not None:
            frequency = frequency or float(match[1].replace(",", "."))
        # Vicon: the rate is alone in the line below "Trajectories" or "Devices".
        is_of_vicon = i and rows[i - 1][:1] in (("Trajectories",), ("Devices",), ("Model Outputs",))
        if is_of_vicon and len(cells) == 1 and re.fullmatch(r"\d+(?:\.\d+)?", cells[0]):
            frequency = float(cells[0])
    return frequency, written


def _style(table: Table) -> NumberStyle:
    """The style of a table's numbers. Raises UserError for those that can be read in two ways."""
    return style_of(table.name, [table.texts(i) for i in range(len(table.header))])


def _in_one_unit(table: Table) -> Table:
    """The table with the cells of each column in one unit: that of the header, or of the first cell."""
    cells = [list(row) for row in table.cells]
    header = list(table.header)
    for at, (name, unit) in enumerate(table.header):
        read = [table.style.read(text) for text in table.texts(at)]
        written = [plain_unit(cell.unit) if cell and cell.unit else "" for cell in read]
        first = next(filter(None, written), "")
        wanted = unit or first
        quantity = next((of for of in QUANTITIES_OF_COLUMNS if is_unit_of(wanted, of)), "")
        is_mixed = any(one and one != wanted for one in written) and quantity
        if not is_mixed or not all(is_unit_of(one, quantity) for one in filter(None, written)):
            continue
        if not unit and not all(written[i] for i, cell in enumerate(read) if cell):
            # Whether the cells without a unit have that of the others, nothing says.
            continue
        for i, cell in enumerate(read):
            if cell and written[i] and written[i] != wanted:
                ratio = units.parse(f"1 {written[i]}", quantity, name) / units.parse(
                    f"1 {wanted}", quantity, name
                )
                cells[i][at] = _as_text(cell, ratio, table.style)
            elif cell and not unit:
                cells[i][at] = _as_text(cell, 1.0, table.style)
        header[at] = (name, wanted)
    return replace(table, header=tuple(header), cells=tuple(map(tuple, cells)))


def _as_text(cell: NumberCell, ratio: float, style: NumberStyle) -> str:
    """A cell in another unit, `ratio` of which is one of its own."""
    numbers = [
        f"{one * ratio:.12g}" for one in (cell.value, cell.uncertainty) if not math.isnan(one)
    ]
    return " ± ".join(numbers).replace(".", style.decimal)


def _in_a_row(table: Table) -> list[Table]:
    """The times, or the heights, that a table has in a row for each drop, under names with numbers:
    "Bounce 0 (s), Bounce 1 (s), ..."; empty where it has none.

    phyphox writes its stopwatch and "(In)elastic collision" so, with 0 for what was not heard.
    """
    for quantity, allowed in (("time", _OF_TIMES), ("position", {"height", "bounce"})):
        numbered = []
        for i, (name, unit) in enumerate(table.header):
            found = meanings_of(name)
            digits = [int(meaning) for meaning in found if meaning.isdigit()]
            words = found - set(map(str, digits))
            is_trial = words <= {*allowed, "trial", "number"} and _is_counted_by_bounces(table)
            if words and (words <= allowed or is_trial) and is_unit_of(unit, quantity):
                numbered.append((digits[0] if digits else -1, i))
        least = 2 if _is_counted_by_bounces(table) else 3
        if len(numbered) < least or len({number for number, _ in numbered}) < len(numbered):
            continue
        places = [i for _, i in sorted(numbered)]
        if _is_counted_by_bounces(table):
            return _a_column_each(table, places, quantity)
        drops = []
        for k, (row, line) in enumerate(zip(table.cells, table.lines, strict=True), 1):
            cells = [cell_of(row, i) for i in places]
            heard = [cell for cell in cells[1:] if table.number(cell) and not is_missing(cell)]
            called = table.name if len(table.cells) == 1 else f"{table.name}, drop {k}"
            header = (("time" if quantity == "time" else "height", table.header[places[0]][1]),)
            column = tuple((cell,) for cell in [cells[0], *heard])
            drops.append(
                replace(
                    table, name=called, header=header, cells=column, lines=(line,) * len(column)
                )
            )
        return drops
    return []


def _is_counted_by_bounces(table: Table) -> bool:
    """Say whether a column numbers the rows as bounces: then the others go down, a drop each."""
    return any(
        not unit and numbers_bounces(name) and counts(table.texts(at))
        for at, (name, unit) in enumerate(table.header)
    )


def _a_column_each(table: Table, places: Sequence[int], quantity: str) -> list[Table]:
    """A table for each of the columns at these places, without the cells that are missing.

    quantity: of the columns; times that fall are those between touches.
    """
    drops = []
    for k, at in enumerate(places, 1):
        rows = [
            (row[at], line)
            for row, line in zip(table.cells, table.lines, strict=True)
            if not is_missing(cell_of(row, at))
        ]
        name = "height"
        if quantity == "time":
            falls = (np.diff([table.number(text) for text, _ in rows]) < 0).all()
            name = "interval" if falls else "time"
        drops.append(
            replace(
                table,
                name=f"{table.name}, drop {k}",
                header=((name, table.header[at][1]),),
                cells=tuple((cell,) for cell, _ in rows),
                lines=tuple(line for _, line in rows),
            )
        )
    return drops


def _is_label(cells: Sequence[str], width: int) -> bool:
    """Say whether a row of a table of `width` columns has a word alone, such as "Run 2"."""
    given = _trimmed(cells)
    if len(given) != 1 or looks_numeric(given[0]):
        return False
    words = {meaning for meaning in meanings_of(given[0]) if not meaning.isdigit()}
    return width > 1 or (bool(words) and words <= {"number", "trial", "drop"})


def _one_below_the_other(table: Table) -> list[Table]:
    """The drops of a table of times or heights, where a line between rows, or a column that numbers
    the drops, parts them and the readings begin again; the table alone where none do.
    """
    roles = {role_of(*name) for name in table.header}
    if len(roles & QUANTITY_OF.keys()) == 0 or roles & _OF_PAIRS:
        return [table]
    texts = [table.texts(at) for at in range(len(table.header))]
    drops = [texts[at] for at in range(len(texts)) if _numbers_drops(table, at)]
    starts = [0]
    for i in range(1, len(table.cells)):
        is_parted = table.lines[i] - table.lines[i - 1] > 1 or any(
            each[i] != each[i - 1] for each in drops
        )
        if is_parted and _begins_again(table, starts[-1], i):
            starts.append(i)
    if len(starts) == 1:
        return [table]
    # The column that numbered the drops has done its work.
    kept = [at for at in range(len(texts)) if texts[at] not in drops]
    return [
        replace(
            table,
            name=f"{table.name}, drop {k}",
            header=tuple(table.header[at] for at in kept),
            cells=tuple(tuple(cell_of(row, at) for at in kept) for row in table.cells[begin:end]),
            lines=table.lines[begin:end],
        )
        for k, (begin, end) in enumerate(itertools.pairwise([*starts, len(table.cells)]), 1)
    ]


def _numbers_drops(table: Table, at: int) -> bool:
    """Say whether a column has one number, or name, for the rows of each drop."""
    name, unit = table.header[at]
    runs = [len(list(group)) for _, group in itertools.groupby(table.texts(at))]
    is_named = bool(meanings_of(name)) and meanings_of(name) <= {"number", "trial", "drop"}
    return is_named and not unit and len(runs) > 1 and min(runs) >= _LEAST_ROWS


def _begins_again(table: Table, begin: int, at: int) -> bool:
    """Say whether a column that rose, or fell, in the rows before does the other in row `at`."""
    for column in range(len(table.header)):
        before = table.numbers(column)[begin:at]
        way = np.sign(np.diff(before))
        step = np.sign(table.number(cell_of(table.cells[at], column)) - before[-1])
        if len(way) and way[0] and (way == way[0]).all() and step == -way[0]:
            return True
    return False


def _made_again(table: Table) -> list[Table]:
    """The table with a row for each of several rebounds from one height that are numbered as trials;
    empty where they may be successive bounces, each below the one before.
    """
    after = [i for i, name in enumerate(table.header) if role_of(*name) in _AFTER]
    before = [i for i, name in enumerate(table.header) if role_of(*name) in _OF_PAIRS - _AFTER]
    if len(after) < 2 or len(before) != 1 or len({table.header[i][1] for i in after}) > 1:
        return []
    numbers = np.array([table.numbers(i) for i in after])
    is_near = (np.ptp(numbers, axis=0) < _SAME_REBOUND * np.abs(numbers).max(axis=0)).all()
    if not is_near or not (np.diff(numbers, axis=0) > 0).any():
        return []
    name = re.sub(r"\d+", "", table.header[after[0]][0]).strip()
    rows = [
        ((cell_of(row, before[0]), cell_of(row, i)), line)
        for row, line in zip(table.cells, table.lines, strict=True)
        for i in after
    ]
    return [
        replace(
            table,
            header=(table.header[before[0]], (name, table.header[after[0]][1])),
            cells=tuple(row for row, _ in rows),
            lines=tuple(line for _, line in rows),
        )
    ]


def _side_by_side(table: Table) -> list[Table]:
    """The drops of a table whose columns repeat, one table each; the table alone where none do."""
    names = [name for name in table.header if name[0]]
    first = names[0] if names else ("", "")
    starts = [i for i, name in enumerate(table.header) if name == first]
    if not first[0] or len(starts) < 2 or role_of(*first) not in QUANTITY_OF:
        return [table]
    drops = []
    for k, (begin, end) in enumerate(itertools.pairwise([*starts, len(table.header)]), 1):
        rows = [(row[begin:end], line) for row, line in zip(table.cells, table.lines, strict=True)]
        kept = [(row, line) for row, line in rows if not all(map(is_missing, row))]
        drops.append(
            replace(
                table,
                name=f"{table.name}, drop {k}",
                header=table.header[begin:end],
                cells=tuple(row for row, _ in kept),
                lines=tuple(line for _, line in kept),
            )
        )
    if len({tuple(one for one in drop.header if one[0]) for drop in drops}) > 1:
        return [table]
    return drops


def cell_of(row: Sequence[str], at: int) -> str:
    """The text of a cell; "" where the row is too short to have it."""
    if at >= len(row):
        return ""
    return row[at]
