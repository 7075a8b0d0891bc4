"""Drops in one table: below one another, or side by side."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.cells import is_missing
from hcbench.fitting.column_names import (
    QUANTITY_OF,
    is_unit_of,
    meanings_of,
    numbers_bounces,
    role_of,
)
from hcbench.fitting.separators import counts
from hcbench.fitting.table import cell_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.table import Table

# Rows after which another header begins another table.
LEAST_ROWS = 2
# Meanings of columns that have a time of a touch each.
_OF_TIMES = {"time", "touch", "bounce", "begin", "beside"}
# Share by which rebounds from one height differ, at most.
_SAME_REBOUND = 0.2
# Roles of impacts measured one by one, and those of them after the impact.
_AFTER = {"height_out", "speed_out"}
_OF_PAIRS = {"height_in", "speed", "speed_in", "restitution", "squared", *_AFTER}


def drops_of(table: Table) -> list[Table]:
    """The drops of a table, a table each; the table alone where it has one."""
    drops: list[Table] = []
    for part in _one_below_the_other(table):
        drops += _in_a_row(part) or _made_again(part) or _side_by_side(part)
    return drops


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
    # Records of several lines, and files with an empty line after each, have no wider gaps.
    usual = float(np.median(np.diff(table.lines))) if len(table.lines) > 1 else 1.0
    for i in range(1, len(table.cells)):
        is_parted = table.lines[i] - table.lines[i - 1] > usual or any(
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
    return is_named and not unit and len(runs) > 1 and min(runs) >= LEAST_ROWS


def _begins_again(table: Table, begin: int, at: int) -> bool:
    """Say whether a column that rose, or fell, in the rows before does the other in row `at`: that
    of the time, where there is one.
    """
    names = [role_of(*name) for name in table.header]
    clocks = [i for i, role in enumerate(names) if role in ("time", "frame", "sample")]
    for column in clocks or range(len(names)):
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
