"""Statements of a text about the numbers beside it: the scale of a picture, the decimal sign, a unit."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from hcbench.fitting.column_names import (
    PIXELS,
    QUANTITIES_OF_COLUMNS,
    is_unit,
    is_unit_of,
    meanings_of,
    plain_unit,
    split_header,
)
from hcbench.fitting.table import unit_scale
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_NUMBER = r"(?<![\w.,])(?P<{}>\d+(?:[.,]\d+)?)"
_PIXEL = rf"(?<![^\W_])(?:{'|'.join(sorted(PIXELS, reverse=True))})(?![^\W_])"
_UNIT = r"(?P<unit>[^\W\d_]+)"
_IS = r"\s*(?:=|≙|≈|:|is|are|equals?|corresponds?\s+to|entspricht|entsprechen)\s*"
_PER = r"[\s_]*(?:/|(?<![^\W_])(?:per|pro|par|por|je)(?![^\W_]))[\s_]*"
_VALUE = r"[\"']?\s*[=:]?\s*"
# "412 px = 1 m", "1 m = 412 px", "412 px/m", "0.8 mm/px", "pixels_per_metre: 412", "mm per px = 0.8".
_SCALES = [
    re.compile(form, re.IGNORECASE)
    for form in (
        rf"{_NUMBER.format('pixels')}\s*{_PIXEL}{_IS}{_NUMBER.format('length')}\s*{_UNIT}",
        rf"{_NUMBER.format('length')}\s*{_UNIT}{_IS}{_NUMBER.format('pixels')}\s*{_PIXEL}",
        rf"{_NUMBER.format('pixels')}\s*{_PIXEL}{_PER}{_UNIT}",
        rf"{_NUMBER.format('length')}\s*{_UNIT}{_PER}{_PIXEL}",
        rf"{_PIXEL}{_PER}{_UNIT}{_VALUE}{_NUMBER.format('pixels')}",
        rf"(?<![^\W_]){_UNIT}{_PER}{_PIXEL}{_VALUE}{_NUMBER.format('length')}",
    )
]
# A number with a decimal sign and a unit or a degree: "25,0 mm", "1,50°". Three digits after the
# sign may be thousands.
_WITH_UNIT = re.compile(
    r"(?<![\w.,])\d+([.,])(?:\d{1,2}|\d{4,})(?![\d.,])\s*(°|[^\W\d_][^\W\d_/]*)"
)
# Units that columns do not have, but sentences beside them.
_OTHER_UNITS = {"°", "g", "kg", "mg", "г", "кг", "deg", "grad"}
# "read in centimetres", "in cm".
_IN_UNIT = re.compile(r"\b(?:in|en)\s+([^\W\d_][^\W\d_/]*(?:/\w+)?)(?=[)\]\s.,;:]|$)(?!\W*\d)")
_MEANT = {"position": "height", "time": "time", "speed": "speed"}
# Words beside a quantity that make it another one than that of the column.
_OTHER_THINGS = {"drop", "upper edge", "changed", "group"}


def metres_of_pixel(text: str) -> float | None:
    """Metres of one pixel, by the scale that a text states: "412 px = 1 m", "mm per pixel: 2.4".

    None for no scale, one with a 0, or several that differ.
    """
    found = set()
    for form in _SCALES:
        for match in form.finditer(text):
            given = match.groupdict()
            unit = plain_unit(given["unit"])
            if not is_unit_of(unit, "position"):
                continue
            # One that is left out is 1: "px per mm".
            pixels = float((given.get("pixels") or "1").replace(",", "."))
            length = float((given.get("length") or "1").replace(",", "."))
            if pixels and length:
                metre = unit_scale("scale", "scale", unit, "position")
                # The same scale in another unit differs in the last digits.
                found.add(float(f"{length * metre / pixels:.9g}"))
    return found.pop() if len(found) == 1 else None


def decimal_signs(text: str) -> set[str]:
    """The decimal signs of numbers with a unit in a text: "," of "25,0 mm"."""
    return {
        sign
        for sign, unit in _WITH_UNIT.findall(text)
        if unit in _OTHER_UNITS or is_unit(plain_unit(unit))
    }


def require_one_unit(
    name: str, header: Sequence[tuple[str, str]], above: Sequence[Sequence[str]]
) -> None:
    """Raise UserError where a line above a table names another unit of a quantity than its header.

    name: what errors call the file.
    header: names with their units.
    above: the rows above.
    """
    for column, unit in header:
        quantity = next((of for of in QUANTITIES_OF_COLUMNS if is_unit_of(unit, of)), "")
        if not quantity:
            continue
        for line, other in _units_said(above, quantity):
            if unit_scale(name, column, other, quantity) != unit_scale(
                name, column, unit, quantity
            ):
                got = f"{column!r} in {unit}, and {line!r}"
                raise UserError(name, got, "one unit", "Leave the wrong one out")


def _units_said(above: Sequence[Sequence[str]], quantity: str) -> Iterator[tuple[str, str]]:
    """Yield (line, unit) of each line of one cell that names a unit of a quantity, and means the
    quantity of the table: "all heights in centimetres", and not "dropped from a height in feet".
    """
    for cells in above:
        if len(cells) != 1:
            continue
        line = cells[0]
        found = meanings_of(split_header(line)[0]) | meanings_of(line)
        if _MEANT.get(quantity) not in found or found & _OTHER_THINGS:
            continue
        for unit in map(plain_unit, _IN_UNIT.findall(line)):
            if is_unit_of(unit, quantity):
                yield line, unit
