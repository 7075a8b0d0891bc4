"""Drops in one table: below one another, or side by side."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

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
    from collections.abc import Sequence

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


class _NumberedColumns(NamedTuple):
    """Columns of one quantity whose names differ by a number.

    quantity: "time" or "position".
    places: in the order of the numbers.
    """

    quantity: str
    places: list[int]


def _of_numbered(table: Table) -> list[Table]:
    """The drops of times, or of heights, under names that differ by their numbers: a column each where
    another column numbers the bounces, as of "Trial 1"; else a row each, as of "Bounce 0 (s)".

    Empty where there are none. phyphox writes its stopwatch and "(In)elastic collision" in rows, with
    0 for what was not heard.
    """
    goes_down = any(
        not unit and numbers_bounces(name) and counts(table.texts(place))
        for place, (name, unit) in enumerate(table.header)
    )
    found = _numbered_columns(table, goes_down)
    if found is None:
        return []
    series: list[Rows] = []
    if goes_down:
        series += [_rows(table, [place]) for place in found.places]
    else:
        for cells, line in _rows(table, found.places):
            # The first bounce may be at 0 s.
            heard = [cell for i, cell in enumerate(cells) if i == 0 or table.number(cell)]
            series.append([([cell], line) for cell in heard])
    drops = []
    for k, rows in enumerate(series):
        # Rows of one kind have more series than columns: the units are those of the columns in turn.
        unit = table.header[found.places[k % len(found.places)]][1]
        header = (_name_of_series(table, found.quantity, rows), unit)
        drops.append(_drop(table, k + 1 if len(series) > 1 else 0, [header], rows))
    return drops


def _numbered_columns(table: Table, goes_down: bool) -> _NumberedColumns | None:
    """The columns of times, else of heights, under names that differ by their numbers; None for none.

    goes_down: each column is a drop, and rows are bounces; else the columns are the bounces, three or
    more, of a drop in each row.
    """
    words_of_drops = {"trial", "number", "drop"} if goes_down else set()
    # "Rebound height, trial 1", where no column has the height before.
    has_before = any(role_of(*name) in _OF_PAIRS - _AFTER for name in table.header)
    for quantity, allowed in (("time", _OF_TIMES), ("position", {"height", "bounce"})):
        place_of: dict[int, int] = {}
        count = 0
        for place, (name, unit) in enumerate(table.header):
            found = meanings_of(name)
            digits = {meaning for meaning in found if meaning.isdigit()}
            words = found - digits
            of_rebounds: set[str] = set()
            # "Rebound 1 (cm)", without "height", may be of a row that is a drop.
            if goes_down and not has_before and "height" in words:
                of_rebounds = {"after"}
            is_reading = bool(words) and words <= allowed | words_of_drops | of_rebounds
            if is_reading and is_unit_of(unit, quantity):
                place_of[min(map(int, digits), default=-1)] = place
                count += 1
        has_one_each = count == len(place_of)
        if has_one_each and count >= (2 if goes_down else 3):
            return _NumberedColumns(quantity, [place_of[number] for number in sorted(place_of)])
    return None


def _name_of_series(table: Table, quantity: str, rows: Rows) -> str:
    """The name of a column of times or heights: "height", "time", or "interval" for times that fall.

    quantity: "time" or "position".
    rows: of one cell each.
    """
    if quantity != "time":
        return "height"
    numbers = [table.number(cell) for (cell,), _ in rows if not is_missing(cell)]
    return "interval" if (np.diff(numbers) < 0).all() else "time"


def _one_below_the_other(table: Table) -> list[Table]:
    """The drops of a table of times or heights, where the readings begin again: after a line between
    rows, in another row of a column that numbers the drops, where the bounces are counted anew, or
    where a height is near the first one again. The table alone where none do.
    """
    roles = {role_of(*name) for name in table.header}
    # Rebounds alone are heights of one bounce after the other.
    is_of_pairs = bool(roles & (_OF_PAIRS - {"height_out"}))
    if not roles & QUANTITY_OF.keys() or is_of_pairs:
        return [table]
    columns = range(len(table.header))
    texts = [_filled(table.texts(place)) for place in columns]
    of_drops = [place for place in columns if _numbers_drops(table.header[place], texts[place])]
    starts = _starts_of_drops(table, texts, of_drops, roles)
    if len(starts) == 1:
        return [table]
    # The column that numbered the drops has done its work.
    kept = [place for place in columns if place not in of_drops]
    header = [table.header[place] for place in kept]
    rows = _rows(table, kept)
    parts = itertools.pairwise([*starts, len(rows)])
    return [_drop(table, k, header, rows[begin:end]) for k, (begin, end) in enumerate(parts, 1)]


def _starts_of_drops(
    table: Table, texts: Sequence[Sequence[str]], of_drops: Sequence[int], roles: set[str]
) -> list[int]:
    """The first row of each drop, from 0; [0] where the readings do not begin again.

    texts: the cells of each column, none empty below another.
    of_drops: places of the columns that number the drops.
    roles: of the columns.
    """
    of_bounces = [
        place
        for place, (name, unit) in enumerate(table.header)
        if numbers_bounces(name) and not unit
    ]
    heights = []
    # A film has many heights of one flight, and rises again after each touch.
    if not {"time", "frame", "sample"} & roles:
        heights = [
            table.numbers(place)
            for place, name in enumerate(table.header)
            if role_of(*name) in ("height", "height_out")
        ]
    # Records of several lines, and files with an empty line after each, have no wider gaps.
    usual_gap = float(np.median(np.diff(table.lines))) if len(table.lines) > 1 else 1.0
    starts = [0]
    for i in range(1, len(table.cells)):
        is_parted = table.lines[i] - table.lines[i - 1] > usual_gap
        is_other_drop = any(texts[at][i] != texts[at][i - 1] for at in of_drops)
        is_counted_anew = any(texts[at][i] == texts[at][0] != texts[at][i - 1] for at in of_bounces)
        is_back = any(_is_back(each[starts[-1] : i + 1]) for each in heights)
        is_sign = is_parted or is_other_drop or is_counted_anew or is_back
        if is_sign and _begins_again(table, starts[-1], i):
            starts.append(i)
    return starts


def _is_back(heights: Floats) -> bool:
    """Say whether the last of several heights is near the first again, from far below: no reading that
    is missing, doubled or exchanged with the next makes such a rise.

    heights: (n,), two or more, in any unit; NaN is never near.
    """
    first, before, last = heights[[0, -2, -1]]
    is_near = _NEAR_FIRST * first < last < first / _NEAR_FIRST
    return bool(is_near and before < _FAR_BELOW * first)


def _filled(texts: Sequence[str]) -> list[str]:
    """Cells, with that above in place of an empty one: a merged cell has its text in the first row."""
    filled = []
    above = ""
    for text in texts:
        above = text or above
        filled.append(above)
    return filled


def _numbers_drops(header: tuple[str, str], texts: Sequence[str]) -> bool:
    """Say whether a column has one number, or name, for the rows of each drop.

    header: its name and unit.
    texts: its cells, none empty below another.
    """
    name, unit = header
    runs = [len(list(group)) for _, group in itertools.groupby(texts)]
    is_named = bool(meanings_of(name)) and meanings_of(name) <= {"number", "trial", "drop"}
    return is_named and not unit and len(runs) > 1 and min(runs) >= LEAST_ROWS


def _begins_again(table: Table, begin: int, at: int) -> bool:
    """Say whether a column that rose, or fell, from row `begin` on does the other in row `at`: that
    of the time, where there is one, else any.
    """
    roles = [role_of(*name) for name in table.header]
    clocks = [place for place, role in enumerate(roles) if role in ("time", "frame", "sample")]
    for place in clocks or range(len(roles)):
        before = table.numbers(place)[begin:at]
        ways = np.sign(np.diff(before))
        step = np.sign(table.number(cell_of(table.cells[at], place)) - before[-1])
        if len(ways) and ways[0] and (ways == ways[0]).all() and step == -ways[0]:
            return True
    return False


def _made_again(table: Table) -> list[Table]:
    """The table with a row for each of several rebounds from one height that are numbered as trials:
    one table, or none where they may be successive bounces, each below the one before.
    """
    roles = [role_of(*name) for name in table.header]
    # The mean of the trials is not one of them, unless there are only means.
    single = [
        "" if "mean" in meanings_of(name) else role
        for role, (name, _) in zip(roles, table.header, strict=True)
    ]
    if _AFTER.intersection(single):
        roles = single
    # Beside the height of the drop.
    after_roles = _AFTER | ({"height"} if "height_in" in roles else set())
    after = [place for place, role in enumerate(roles) if role in after_roles]
    before = [place for place, role in enumerate(roles) if role in _OF_PAIRS - _AFTER]
    if len(after) < 2 or len(before) != 1 or len({table.header[i][1] for i in after}) > 1:
        return []
    # Of each trial, a row of rebounds: from one height they are alike, and some rise.
    rebounds = np.array([table.numbers(place) for place in after])
    largest = np.abs(rebounds).max(axis=0)
    are_alike = (np.ptp(rebounds, axis=0) < _SAME_REBOUND * largest).all()
    if not are_alike or not (np.diff(rebounds, axis=0) > 0).any():
        return []
    name, unit = table.header[after[0]]
    header = [table.header[before[0]], (re.sub(r"\d+$", "1", name), unit)]
    trials = [_rows(table, [before[0], place]) for place in after]
    # All trials from the first height, then those from the next.
    rows = list(itertools.chain.from_iterable(zip(*trials, strict=True)))
    return [_drop(table, 0, header, rows)]


def _side_by_side(table: Table) -> list[Table]:
    """The drops of a table whose columns repeat, one table each; the table alone where none do.

    A table begins with each column that has the name of the first one of data. Columns before that
    number the bounces of all.
    """
    first = next((name for name in table.header if role_of(*name) in QUANTITY_OF), ("", ""))
    starts = [place for place, name in enumerate(table.header) if name == first]
    if not first[0] or len(starts) < 2:
        return [table]
    shared = range(starts[0])
    names_before = [table.header[place][0] for place in shared]
    if not all(is_beside(name) for name in names_before if name):
        return [table]
    drops = []
    for k, (begin, end) in enumerate(itertools.pairwise([*starts, len(table.header)]), 1):
        places = [*shared, *range(begin, end)]
        header = [table.header[place] for place in places]
        drops.append(_drop(table, k, header, _rows(table, places)))
    named = {tuple(name for name in drop.header if name[0]) for drop in drops}
    if len(named) > 1:
        # Two quantities of one name, and no drops.
        return [table]
    return drops
