"""Ways in which programs and people write a table, made one: names with units in brackets, plain numbers."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING

from hcbench.system.errors import QuantityError
from hcbench.terms import units

if TYPE_CHECKING:
    from hcbench.fitting.table import Table

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
        "ft/s",
        "in/s",
        "n",
        "kn",
        "mn",
        "%",
    ]
)
_SUFFIX = re.compile(r"(.+?)(?:\s*/\s*|_|\s*,\s*|\s+in\s+|\s+)([^\s/,_]+(?:/s|/h)?)")
_NUMBER = r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?"
_UNCERTAIN = re.compile(rf"\s*({_NUMBER})\s*(?:±|\+-|\+/-)\s*({_NUMBER})\s*")
_SHORT = re.compile(r"\s*([-+]?\d*[.,]?(\d*))\((\d+)\)\s*")


def with_unit(name: str, unit: str) -> tuple[str, str]:
    """(name, unit) of "t/s", "time_s", "time, s", "height in cm"; "Latest: " is left out."""
    name = _LATEST.sub("", name.strip()).strip().rstrip("/").strip()
    if unit:
        return name, unit.replace("\N{GREEK SMALL LETTER MU}", "µ")
    match = _SUFFIX.fullmatch(name)
    if match is None or match[2] not in _UNITS:
        return name, ""
    return match[1].strip(), match[2]


def plain(table: Table) -> Table:
    """The table without shares in per cent and with an uncertainty in a column of its own.

    Cells such as `0.20 ± 0.01`, `0.960(5)`, and commas for points in single columns.
    """
    header = list(table.header)
    columns = _transposed(table)
    for i, (name, unit) in enumerate(table.header):
        pairs = [_uncertain(cell) for cell in columns[i]]
        uncertain = [pair for pair in pairs if pair is not None]
        has_column = any(other == f"u_{name}" for other, _ in header)
        if len(uncertain) == len(pairs) and not has_column:
            columns[i] = [value for value, _ in uncertain]
            header.append((f"u_{name}", unit))
            columns.append([uncertainty for _, uncertainty in uncertain])
        columns[i] = [_with_point(table, cell) for cell in columns[i]]
    for i, (name, unit) in enumerate(header):
        cells = columns[i]
        if unit == "%" or (cells and all(cell.strip().endswith("%") for cell in cells)):
            header[i] = (name, "")
            columns[i] = [_share(cell) for cell in cells]
    rows = tuple(zip(*columns, strict=True))
    return replace(table, header=tuple(header), cells=rows, decimal=".")


def _transposed(table: Table) -> list[list[str]]:
    """The cells column by column; "" for those that a short row lacks."""
    columns: list[list[str]] = [[] for _ in table.header]
    for row in table.cells:
        for i, column in enumerate(columns):
            column.append(row[i] if i < len(row) else "")
    return columns


def _with_point(table: Table, cell: str) -> str:
    if math.isfinite(table.number(cell)):
        return cell.replace(table.decimal, ".")
    single = re.fullmatch(r"\s*[-+]?\d+,\d+(?:[eE][-+]?\d+)?\s*%?\s*", cell)
    return cell.replace(",", ".") if single else cell


def _share(cell: str) -> str:
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
        widths = {len(row) for row in rows[: count + 1]}
        if len(rows) <= count or len(widths) != 1:
            continue
        names = rows[0]
        below = [cell.strip().strip("()[]").lower() for cell in rows[count - 1]]
        has_units = all(_is_unit(cell) for cell in below)
        if has_units and not any(_looks_numeric(cell) for cell in names):
            pairs = zip(names, below, strict=True)
            return count, tuple(f"{name.strip()} [{unit}]" for name, unit in pairs)
    return None


def _looks_numeric(cell: str) -> bool:
    return re.fullmatch(rf"\s*{_NUMBER}\s*", cell) is not None


def _is_unit(text: str) -> bool:
    if text not in _UNITS:
        return False
    for quantity in ("time", "position", "speed", "force"):
        try:
            units.parse(f"1 {text}", quantity, "unit")
        except QuantityError:
            continue
        return True
    return False
