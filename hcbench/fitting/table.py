"""Tables: names, units, and cells of text that are read as numbers in SI."""

from __future__ import annotations

import math
import re
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.cells import (
    NumberCell,
    NumberStyle,
    has_last_unit_only,
    in_unit,
    is_missing,
)
from hcbench.fitting.column_names import (
    NO_UNIT,
    PIXELS,
    plain_unit,
)
from hcbench.system.errors import QuantityError, UserError
from hcbench.terms import units
from hcbench.terms.bounds import beyond_bounds, require_bounds

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.terms.impact import Floats

# Smallest measured value of bounces, SI; its inverse is the largest.
_SMALLEST = 1e-12
# Units of print: no lengths of the scene.
_NO_LENGTHS = (*PIXELS, "dot", "pt")
_ADVICE_OF_PIXELS = "Write the scale into a line above the table, such as '412 px = 1 m'"
# Times beyond this, in any unit, count from a date: the first of them is taken off.
_OF_A_DATE = 1e6
# Seconds since 1970 in the years 2001 and 2096.
_EARLIEST = 1e9
_LATEST = 4e9
# A name that computes with its quantity: "2t", "100 h", "1 - e"; "t/2", "h / 10^-2"; "h + 6"; "e^3".
_COMPUTES = re.compile(
    r"\d+(?:[.,]\d+)?\s*[×x*·/−–-]?\s*(?!(?:st|nd|rd|th|er|re|te|ter|o|a)\b)[^\W\d_].*"
    r"|.*[×*·/]\s*\d+(?:[.,]\d+)?(?:\s*\^\s*[-−]?\d+)?"
    r"|.*(?:\s[-−–]\s*|\+\s*)\d+(?:[.,]\d+)?"
    r"|.*\^\s*(?!2\b)\d.*"
)
_POINTS = NumberStyle()


@dataclass(frozen=True, slots=True)
class Table:
    """A table as the file has it: names, units and cells of text.

    name: what errors call the file.
    header: names in lower case with their units, "" for none.
    cells: text, a row each; lines: their numbers in the file.
    style: of the numbers.
    frequency: of frames or samples, Hz; None for none.
    units: those of a quantity that lines before the table name, such as {"position": "mm"}.
    pixel: metres of one pixel, by the scale that the file states; None for none.
    """

    name: str
    header: tuple[tuple[str, str], ...]
    cells: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    style: NumberStyle = _POINTS
    frequency: float | None = None
    units: tuple[tuple[str, str], ...] = ()
    pixel: float | None = None

    def number(self, text: str) -> float:
        """A cell as a number; NaN for what is none."""
        cell = self.style.read(text)
        return math.nan if cell is None else cell.value

    def numbers(self, at: int) -> Floats:
        """A column as it stands, in its own unit, (n,); NaN for other text."""
        return np.array([math.nan if cell is None else cell.value for cell in self._cells(at)])

    def _cells(self, at: int) -> list[NumberCell | None]:
        """The cells of a column as numbers, None for other text: those with a unit in that of the header,
        or of the first cell.
        """
        read = [self.style.read(text) for text in self.texts(at)]
        units_of_cells = (plain_unit(cell.unit) for cell in read if cell and cell.unit)
        unit = self.header[at][1] or next(units_of_cells, "")
        return [cell and in_unit(cell, unit) for cell in read]

    def texts(self, at: int) -> list[str]:
        """The cells of a column, as the file has them."""
        return [cell_of(row, at) for row in self.cells]

    def in_unit(self, at: int, quantity: str) -> Floats:
        """A column in SI, (n,); NaN for other text. Raises UserError for a missing unit."""
        return np.asarray(self.scale(at, quantity) * self.numbers(at))

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
        scale = self.scale(at, quantity)
        for cell, text, line in zip(cells, self.texts(at), self.lines, strict=True):
            # A time of the clock is in seconds under any header.
            if not cell.unit or ":" in text:
                continue
            written = plain_unit(cell.unit)
            if has_last_unit_only(text):
                # "81 ± 2 mm" under cm: whether the 81 is in mm, nothing says.
                as_written = self.style.read(text)
                written = plain_unit(as_written.unit) if as_written else unit
            if written != unit and unit_scale(self.name, name, written, quantity) != scale:
                got = f"{text.strip()!r} under {name!r} in {unit}"
                raise UserError(f"{self.name}, line {line}", got, f"a number in {unit}")

    def uncertainty(self, at: int, quantity: str) -> Floats:
        """Standard uncertainties that cells such as "0.20 ± 0.01" have, in SI; 0 for none."""
        each = [cell.uncertainty for cell in self._read(at)]
        return np.asarray(self.scale(at, quantity) * np.nan_to_num(np.array(each)))

    def _read(self, at: int) -> list[NumberCell]:
        """The cells of a column as numbers. Raises UserError for a cell that is not a number.

        at: number of the column.
        """
        found = []
        for cell, text, line in zip(self._cells(at), self.texts(at), self.lines, strict=True):
            if cell is None or math.isinf(cell.value) or math.isinf(cell.uncertainty):
                where = f"{self.name}, line {line}"
                raise UserError(where, f"{text.strip()!r} under {self.header[at][0]!r}", "a number")
            found.append(cell)
        return found

    def unit_of(self, at: int, quantity: str) -> str:
        """The unit of a column: of its header, of its cells, or of a line before the table."""
        unit = self.header[at][1]
        if not unit:
            written = {plain_unit(cell.unit) for cell in self._cells(at) if cell}
            # Whether the cells without a unit have that of the others, nothing says.
            if len(written) == 1:
                unit = next(iter(written))
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

    def scale(self, at: int, quantity: str) -> float:
        """One unit of a column in SI. Raises UserError for a missing one, and one that does not fit."""
        if self.pixel is not None and quantity == "position" and self.header[at][1] in PIXELS:
            return self.pixel
        return unit_scale(self.name, self.header[at][0], self.unit_of(at, quantity), quantity)

    def _in_si(self, at: int, quantity: str, each: list[float]) -> Floats:
        """A column's numbers in SI, times of a date from the first. Raises UserError for a number
        that no measurement has.

        at: number of the column.
        each: its numbers, in its unit.
        """
        scale = self.scale(at, quantity)
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
    """Raise UserError for errors of arithmetic in the block, as they are the file's numbers' fault.

    name: what the error calls the file. NumPy's warnings are silent.
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
    """Return the size of a column's unit in SI.

    file: what errors call it.
    name, unit: of the column.
    quantity: one of `units.QUANTITIES`.
    Raises UserError for a missing unit and for one that does not fit.
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
        advice = _ADVICE_OF_PIXELS if unit in PIXELS else ""
        raise UserError(file, got, expected, advice) from None


def cell_of(row: Sequence[str], at: int) -> str:
    """The text of a cell; "" where the row is too short to have it."""
    if at >= len(row):
        return ""
    return row[at]
