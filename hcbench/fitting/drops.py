"""Drops in one table: below one another, or side by side."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.cells import counts, is_missing
from hcbench.fitting.column_names import (
    QUANTITY_OF,
    is_beside,
    is_unit_of,
    meanings_of,
    numbers_bounces,
    role_of,
)
from hcbench.fitting.table import cell_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.fitting.table import Table
    from hcbench.terms.impact import Floats

    Rows = list[tuple[Sequence[str], int]]

# Rows after which another header begins another table.
LEAST_ROWS = 2
# Meanings of columns that have a time of a touch each.
_OF_TIMES = {"time", "interval", "touch", "bounce", "begin", "beside"}
# Share by which rebounds from one height differ, at most.
_SAME_REBOUND = 0.2
# Shares of the first height: of the first one of another drop, at least, and of the one before, at most.
_NEAR_FIRST = 0.85
_FAR_BELOW = 0.6
# Roles of impacts measured one by one, and those of them after the impact.
_AFTER = {"height_out", "speed_out", "energy_out"}
_OF_PAIRS = {"height_in", "speed", "speed_in", "energy_in", "restitution", "squared", *_AFTER}


def drops_of(table: Table) -> list[Table]:
    """The drops of a table, a table each; the table alone where it has one."""
    drops: list[Table] = []
    for part in _one_below_the_other(table):
        drops += _made_again(part) or _of_numbered(part) or _side_by_side(part)
    return drops


def _drop(table: Table, number: int, header: Sequence[tuple[str, str]], rows: Rows) -> Table:
    """A drop of a table: (cells, line) of its rows; rows in which nothing is given are left out.

    number: from 1, for its name; 0 where it is the only one.
    """
    kept = [(tuple(cells), line) for cells, line in rows if not all(map(is_missing, cells))]
    return replace(
        table,
        name=f"{table.name}, drop {number}" if number else table.name,
        header=tuple(header),
        cells=tuple(cells for cells, _ in kept),
        lines=tuple(line for _, line in kept),
    )


def _rows(table: Table, places: Sequence[int]) -> Rows:
    """(cells, line) of the rows of a table, with the columns at these places alone."""
    return [
        ([cell_of(row, i) for i in places], line)
        for row, line in zip(table.cells, table.lines, strict=True)
    ]


def _of_numbered(table: Table) -> list[Table]:
    """The drops of times, or of heights, under names that differ by their numbers: a column each where
    another column numbers the bounces, as of "Trial 1"; else a row each, as of "Bounce 0 (s)".

    Empty where there are none. phyphox writes its stopwatch and "(In)elastic collision" in rows, with
    0 for what was not heard.
    """
    goes_down = any(
        not unit and numbers_bounces(name) and counts(table.texts(at))
        for at, (name, unit) in enumerate(table.header)
    )
    trials = {"trial", "number", "drop"} if goes_down else set()
    # "Rebound height, trial 1", where no column has the height before.
    is_after = goes_down and not _OF_PAIRS.difference(_AFTER).intersection(
        role_of(*name) for name in table.header
    )
    for quantity, allowed in (("time", _OF_TIMES), ("position", {"height", "bounce"})):
        numbered = []
        for i, (name, unit) in enumerate(table.header):
            found = meanings_of(name)
            digits = [int(meaning) for meaning in found if meaning.isdigit()]
            words = found - set(map(str, digits))
            # "Rebound 1 (cm)", without "height", may be of a row that is a drop.
            after = {"after"} if is_after and "height" in words else set()
            if words and words <= allowed | trials | after and is_unit_of(unit, quantity):
                numbered.append((digits[0] if digits else -1, i))
        if len(numbered) < (2 if goes_down else 3) or len(dict(numbered)) < len(numbered):
            continue
        places = [i for _, i in sorted(numbered)]
        rows = _rows(table, places)
        if goes_down:
            each = [_rows(table, [i]) for i in places]
        else:
            each = [
                [([cell], line) for i, cell in enumerate(cells) if not i or table.number(cell)]
                for cells, line in rows
            ]
        return [
            _drop(table, k if len(each) > 1 else 0, [_series(table, quantity, place, one)], one)
            for k, (place, one) in enumerate(zip(itertools.cycle(places), each), 1)
        ]
    return []


def _series(table: Table, quantity: str, at: int, rows: Rows) -> tuple[str, str]:
    """The header of a column of times or heights, with the unit at a place; times that fall are those
    between touches.
    """
    numbers = [table.number(cell) for (cell,), _ in rows if not is_missing(cell)]
    name = "height"
    if quantity == "time":
        name = "interval" if (np.diff(numbers) < 0).all() else "time"
    return name, table.header[at][1]


def _one_below_the_other(table: Table) -> list[Table]:
    """The drops of a table of times or heights, where the readings begin again: after a line between
    rows, in another row of a column that numbers the drops, where the bounces are counted anew, or
    where a height is near the first one again. The table alone where none do.
    """
    roles = {role_of(*name) for name in table.header}
    # Rebounds alone are heights of one bounce after the other.
    is_of_pairs = bool(roles & (_OF_PAIRS - {"height_out"}))
    if len(roles & QUANTITY_OF.keys()) == 0 or is_of_pairs:
        return [table]
    texts = [_filled(table.texts(at)) for at in range(len(table.header))]
    drops = [at for at in range(len(texts)) if _numbers_drops(table.header[at], texts[at])]
    bounces = [
        at for at, (name, unit) in enumerate(table.header) if numbers_bounces(name) and not unit
    ]
    is_film = bool({"time", "frame", "sample"} & roles)
    heights = [
        table.numbers(at)
        for at, name in enumerate(table.header)
        if role_of(*name) in ("height", "height_out") and not is_film
    ]
    starts = [0]
    # Records of several lines, and files with an empty line after each, have no wider gaps.
    usual = float(np.median(np.diff(table.lines))) if len(table.lines) > 1 else 1.0
    for i in range(1, len(table.cells)):
        is_parted = table.lines[i] - table.lines[i - 1] > usual
        is_other = any(texts[at][i] != texts[at][i - 1] for at in drops)
        is_anew = any(texts[at][i] == texts[at][0] != texts[at][i - 1] for at in bounces)
        is_back = any(_is_back(each[starts[-1] : i + 1]) for each in heights)
        if (is_parted or is_other or is_anew or is_back) and _begins_again(table, starts[-1], i):
            starts.append(i)
    if len(starts) == 1:
        return [table]
    # The column that numbered the drops has done its work.
    kept = [at for at in range(len(texts)) if at not in drops]
    header = [table.header[at] for at in kept]
    rows = _rows(table, kept)
    parts = itertools.pairwise([*starts, len(rows)])
    return [_drop(table, k, header, rows[begin:end]) for k, (begin, end) in enumerate(parts, 1)]


def _is_back(heights: Floats) -> bool:
    """Say whether the last of several heights is near the first again, from far below: no reading that
    is missing, doubled or exchanged with the next makes such a rise.
    """
    first, before, last = heights[[0, -2, -1]]
    is_near = _NEAR_FIRST * first < last < first / _NEAR_FIRST
    return bool(is_near and before < _FAR_BELOW * first)


def _filled(texts: Sequence[str]) -> list[str]:
    """Cells, with that above in place of an empty one: a merged cell has its text in the first row."""
    filled: Iterator[str] = itertools.accumulate(texts, lambda above, text: text or above)
    return list(filled)


def _numbers_drops(header: tuple[str, str], texts: Sequence[str]) -> bool:
    """Say whether a column has one number, or name, for the rows of each drop.

    header: its name and unit. texts: its cells, none empty below another.
    """
    name, unit = header
    runs = [len(list(group)) for _, group in itertools.groupby(texts)]
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
    means = [role_of(*name) if "mean" not in meanings_of(name[0]) else "" for name in table.header]
    # The mean of the trials is not one of them.
    roles = means if len(_AFTER.intersection(means)) else [role_of(*name) for name in table.header]
    # Beside the height of the drop.
    later = _AFTER | ({"height"} if "height_in" in roles else set())
    after = [i for i, role in enumerate(roles) if role in later]
    before = [i for i, role in enumerate(roles) if role in _OF_PAIRS - _AFTER]
    if len(after) < 2 or len(before) != 1 or len({table.header[i][1] for i in after}) > 1:
        return []
    numbers = np.array([table.numbers(i) for i in after])
    is_near = (np.ptp(numbers, axis=0) < _SAME_REBOUND * np.abs(numbers).max(axis=0)).all()
    if not is_near or not (np.diff(numbers, axis=0) > 0).any():
        return []
    name = re.sub(r"\d+$", "1", table.header[after[0]][0])
    header = [table.header[before[0]], (name, table.header[after[0]][1])]
    each = zip(*(_rows(table, [before[0], i]) for i in after), strict=True)
    return [_drop(table, 0, header, [*itertools.chain(*each)])]


def _side_by_side(table: Table) -> list[Table]:
    """The drops of a table whose columns repeat, one table each; the table alone where none do."""
    first = next((name for name in table.header if role_of(*name) in QUANTITY_OF), ("", ""))
    starts = [i for i, name in enumerate(table.header) if name == first]
    if not first[0] or len(starts) < 2:
        return [table]
    # A column before them may number the bounces of all.
    shared = range(starts[0])
    if not all(is_beside(table.header[i][0]) for i in shared if table.header[i][0]):
        return [table]
    drops = []
    for k, (begin, end) in enumerate(itertools.pairwise([*starts, len(table.header)]), 1):
        places = [*shared, *range(begin, end)]
        drops.append(_drop(table, k, [table.header[i] for i in places], _rows(table, places)))
    if len({tuple(one for one in drop.header if one[0]) for drop in drops}) > 1:
        return [table]
    return drops
