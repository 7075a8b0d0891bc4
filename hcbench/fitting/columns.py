"""Roles of a table's columns: what its names say, and what they mean beside one another."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.assumed import is_sure_train
from hcbench.fitting.cells import counts
from hcbench.fitting.column_names import (
    DATA_KINDS,
    EXPECTED_COLUMNS,
    QUANTITY_OF,
    is_beside,
    is_group,
    is_unit_of,
    meanings_of,
    numbers_bounces,
    role_of,
)
from hcbench.fitting.table import cell_of
from hcbench.fitting.track import seen_fall
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import ArrayLike

    from hcbench.fitting.recording import Indices
    from hcbench.fitting.table import Table
    from hcbench.terms.impact import Floats

# Two columns of one quantity are the same where they differ by no more than this share: rounding.
_SAME = 2e-3
# Rows with a name each, at least, that are something else than bounces.
_LEAST_NAMED = 2
_SIDES = {"before", "after"}
# Kinds of one column: any other column of numbers may change what it means.
_ALONE = ("times", "heights")


@dataclass(frozen=True, slots=True)
class DataColumns:
    """The columns of a table by role, which is what they are, such as "time": SI, shape (n,);
    uncertainties under "u_" and the role.

    places: {role: number of the table's column}.
    assumed: what the file does not say and its numbers leave no choice about; "" for nothing.
    """

    table: Table
    places: dict[str, int]
    assumed: str = ""

    def get(self, role: str) -> Floats:
        """A column of the file in SI, (n,); "time" also of frames that are counted, s.

        role: one of `roles`, or "u_" and a role.
        Raises UserError for a cell that is not a number.
        """
        bare = role.removeprefix("u_")
        if role == "time" and role not in self.places:
            return self._counted_time()
        return self.table.column(self.places[role], QUANTITY_OF[bare])

    def _counted_time(self) -> Floats:
        """Times of frames or samples that are counted, or of rows where nothing counts them, s."""
        assert self.table.frequency is not None
        for role in ("frame", "sample"):
            if role in self.places:
                return self.table.column(self.places[role], "number") / self.table.frequency
        return np.arange(len(self.table.cells)) / self.table.frequency

    @property
    def roles(self) -> frozenset[str]:
        """Roles that the table has, uncertainties apart; "time" also where rows, frames or samples
        are counted at a known frequency.
        """
        found = {role for role in self.places if role in QUANTITY_OF}
        has_count = self.table.frequency is not None and "interval" not in found
        has_series = bool({"frame", "sample"} & self.places.keys()) or bool({"force"} & found)
        if has_count and has_series:
            found.add("time")
        return frozenset(found)

    def uncertainty(self, role: str) -> Floats:
        """The standard uncertainties of a column, SI, (n,), 0 where none are given.

        They stand in a column of their own, or in the cells, as in "0.20 ± 0.01".
        Raises UserError for one below 0.
        """
        name = f"u_{role}"
        if name not in self.places:
            return self.table.uncertainty(self.places[role], QUANTITY_OF[role])
        values = self.get(name)
        self.require(name, values >= 0, "0 or more")
        return values

    def require(self, role: str, good: ArrayLike, expected: str) -> None:
        """Raise UserError for the first row that is not good, with its line and its cell.

        good: (n,), True for each row that is. A role without a column of its own has no cell to
        show, and is not refused.
        """
        bad = np.flatnonzero(~np.asarray(good, dtype=bool))
        if bad.size and role in self.places:
            row = int(bad[0])
            cell = cell_of(self.table.cells[row], self.places[role]).strip()
            name = self.table.header[self.places[role]][0]
            where = f"{self.table.name}, line {self.table.lines[row]}"
            raise UserError(where, f"{name} {cell}", expected)

    def taken(self, rows: Iterable[int]) -> DataColumns:
        """These rows alone, in this order."""
        kept = tuple(rows)
        table = replace(
            self.table,
            cells=tuple(self.table.cells[i] for i in kept),
            lines=tuple(self.table.lines[i] for i in kept),
        )
        return replace(self, table=table)


@dataclass(frozen=True, slots=True)
class _ColumnsByName:
    """The columns of a table, each by its place from 0, sorted by what their names tell.

    roles: {role: places of its columns}.
    unknown: columns of numbers under a name without a role, which may change what the others mean.
    counting: those of `unknown` that count the rows.
    naming: columns with a text of its own in each row, such as "person": rows may be no bounces.
    """

    roles: dict[str, list[int]]
    unknown: list[int]
    counting: list[int]
    naming: list[int]


def columns_of(table: Table, asked: str | None = None) -> DataColumns:
    """Identify the columns by the names in the header; columns that do not concern bounces are left
    out.

    asked: the kind of data, where the user says it.

    Raises UserError for two columns of one quantity that differ, for rows of several balls, for a
    column of numbers without a name that does not count the rows, and for one that may change what
    the only known one means: beside times whose flights do not shrink, and heights that no column
    counts.
    """
    named = _columns_by_name(table)
    roles = named.roles
    _leave_out_counters(table, roles)
    table = _with_lone_uncertainty(table, roles, named.unknown)
    _take_as_before_and_after(table, roles)
    _take_by_others(table, roles)
    places: dict[str, int] = {}
    for role, several in roles.items():
        places[role] = _column_to_take(table, role, roles) if len(several) > 1 else several[0]
    columns = DataColumns(table, places)
    _require_no_other_meaning(columns, named, asked)
    return columns


def _columns_by_name(table: Table) -> _ColumnsByName:
    """Sort the columns of a table by their names. Raises UserError for a text that names several balls."""
    found = _ColumnsByName({}, [], [], [])
    for place, (name, unit) in enumerate(table.header):
        role = role_of(name, unit)
        cells = table.texts(place)
        is_text = not table.has_number(place)
        # A column of data may be empty, to be refused later.
        if is_text and not (role and any(table.is_given(place))):
            _require_one_ball(table, place)
            differs = len(set(cells)) == len(cells) > _LEAST_NAMED
            if name and not is_beside(name) and differs:
                found.naming.append(place)
        elif role:
            found.roles.setdefault(role, []).append(place)
        elif is_beside(name) and not _is_of_trial(name):
            continue
        # pandas gives the index of the rows no name.
        elif name or not counts(cells):
            found.unknown.append(place)
            if counts(cells):
                found.counting.append(place)
    return found


def _require_no_other_meaning(
    columns: DataColumns, named: _ColumnsByName, asked: str | None
) -> None:
    """Raise UserError where a column that is not understood may change what the known ones mean.

    named: the columns by name, less those that the known ones explain.
    asked: the kind of data, where the user says it.
    """
    table = columns.table
    kind = asked or kind_of(columns.roles)
    unknown = named.unknown
    others = named.counting
    if kind == "heights":
        # "person, height": the height of each person.
        unknown = unknown + named.naming
        others = others + named.naming
    if not all(table.header[place][0] for place in unknown):
        # More numbers in a row than names, such as two for "1,5": which is whose cannot be told.
        advice = "Name each column, and write 1.5 or put semicolons between the cells"
        raise UserError(table.name, "a column without a name", EXPECTED_COLUMNS, advice)
    is_of_one_column = kind in _ALONE and kind != asked
    is_doubtful = kind is None or (
        is_of_one_column and (bool(others) or not _is_surely_of_bounces(columns, unknown))
    )
    if unknown and is_doubtful:
        got = f"a column {table.header[unknown[0]][0]!r}"
        advice = _advice_on_unknown(table, named.roles, unknown)
        raise UserError(table.name, got, EXPECTED_COLUMNS, advice)


def _is_of_trial(name: str) -> bool:
    """Say whether a column has the readings of one of several trials, such as "Run 2"."""
    found = meanings_of(name)
    return "trial" in found and any(map(str.isdigit, found))


def _advice_on_unknown(table: Table, roles: dict[str, list[int]], unknown: list[int]) -> str:
    """Advice on columns with unknown names: the kind to ask for, where one of them may be the data.

    roles: {role: places of its columns}.
    unknown: places of the columns with unknown names.
    """
    if any(_is_of_trial(table.header[place][0]) for place in unknown):
        return "Name each column by what it has too, such as 'rebound height, trial 1 [cm]'"
    # Light gates: the time in which the ball passes one on its way down, and on its way up.
    sides: set[str] = set()
    for place in unknown:
        if is_unit_of(table.unit_of(place, "time"), "time"):
            sides |= meanings_of(table.header[place][0]) & _SIDES
    if len(sides) > 1:
        return (
            "Write speeds, such as a width over the time that it takes, as v_in [m/s],v_out [m/s]"
        )
    for kind, quantity, meaning in (
        ("times", "time", "the times of touches or the times between them"),
        ("heights", "position", "the heights of one bounce after the other"),
    ):
        alone = [i for i in unknown if is_unit_of(table.unit_of(i, quantity), quantity)]
        if len(alone) == 1 and not QUANTITY_OF.keys() & roles.keys():
            return f"Say --as {kind} if {table.header[alone[0]][0]!r} has {meaning}"
    return "Leave other columns out"


def kind_of(roles: frozenset[str]) -> str | None:
    """The kind of data that columns of these roles are; None for none."""
    return next((kind for needed, kind in DATA_KINDS.items() if needed <= roles), None)


def require_one_drop(columns: DataColumns) -> None:
    """Raise UserError where a column beside bounces numbers the drops, or measurements made again."""
    again = {"trial", "drop"} if "time" in columns.roles else {"trial", "drop", "sample"}
    for name, numbers in _numbers_of_rows(columns):
        if meanings_of(name) & again and len(numbers) > 1:
            got = f"a row for each {name!r}"
            raise UserError(columns.table.name, got, "successive bounces of one drop")


def bounce_numbers(columns: DataColumns) -> Indices:
    """Number of the bounce or touch of each row, from 0: by a column that numbers them, or by the rows."""
    for name, numbers in _numbers_of_rows(columns):
        if numbers_bounces(name):
            return np.asarray(numbers - numbers.min(), dtype=int)
    return np.arange(len(columns.table.cells))


def row_order(columns: DataColumns) -> Indices | None:
    """The order of rows by their numbers, where a column numbers them and they do not rise; else None."""
    for name, numbers in _numbers_of_rows(columns):
        found = meanings_of(name)
        is_count = bool(found) and found <= {"number", "bounce", "touch", "drop"}
        if is_count and (np.diff(numbers) < 0).any():
            return np.argsort(numbers)
    return None


def _numbers_of_rows(columns: DataColumns) -> Iterator[tuple[str, Floats]]:
    """Yield (name, numbers (n,)) of each column that gives each row a whole number of its own.

    Data, columns with a unit, and times of the clock number nothing.
    """
    table = columns.table
    places_of_data = {columns.places[role] for role in columns.roles & columns.places.keys()}
    for place, (name, unit) in enumerate(table.header):
        if unit or place in places_of_data or any(":" in text for text in table.texts(place)):
            continue
        numbers = table.numbers(place)
        is_whole = bool(np.isfinite(numbers).all()) and np.array_equal(numbers, np.round(numbers))
        if is_whole and len(set(numbers.tolist())) == len(numbers):
            yield name, numbers


def _require_one_ball(table: Table, place: int) -> None:
    """Raise UserError where a column of text names several balls or plates."""
    if not is_group(table.header[place][0]):
        return
    cells = (cell_of(row, place) for row in table.cells)
    balls = list(dict.fromkeys(filter(None, cells)))
    if len(balls) > 1:
        got = f"{len(balls)} of {table.header[place][0]!r}: {', '.join(balls[:3])}"
        raise UserError(table.name, got, "one ball on one plate", "Put each into a file of its own")


def _is_surely_of_bounces(columns: DataColumns, unknown: Sequence[int]) -> bool:
    """Say whether one column is of bounces, whatever the unknown ones are: times that are a train of
    them, or heights whose bounces are counted, where all that is unknown falls along with them.

    unknown: places of the columns that are not understood.
    """
    table = columns.table
    for role in ("time", "interval"):
        place = columns.places.get(role)
        if place is None:
            continue
        in_si = bool(table.unit_of(place, "time"))
        numbers = table.in_unit(place, "time") if in_si else table.numbers(place)
        if role == "interval":
            numbers = np.cumsum([0.0, *numbers])
        return is_sure_train(numbers)
    all_fall = all((np.diff(table.numbers(place)) < 0).all() for place in unknown)
    return all_fall and any(
        numbers_bounces(name) and counts(table.texts(place))
        for place, (name, _) in enumerate(table.header)
    )


def _leave_out_counters(table: Table, roles: dict[str, list[int]]) -> None:
    """Leave out columns such as "interval" that count the rows, beside others that have a unit or do
    not count.

    roles: {role: places of its columns}, changed in place. Nothing changes where all columns count.
    """
    kept: dict[str, list[int]] = {}
    for role in roles.keys() & QUANTITY_OF.keys():
        quantity = QUANTITY_OF[role]
        kept[role] = [
            place
            for place in roles[role]
            if table.unit_of(place, quantity) or not counts(table.texts(place))
        ]
    if not any(kept.values()):
        return
    for role, places in kept.items():
        roles[role] = places
        if not places:
            del roles[role]


def _with_lone_uncertainty(table: Table, roles: dict[str, list[int]], unknown: list[int]) -> Table:
    """The table with the unit of the column before in each column that is named "SD" or "±" alone:
    it is the uncertainty of that column.

    roles: {role: places of its columns}.
    unknown: places of the columns without a role. Such a column gets a role, "u_height", and is no
    more unknown: both are changed in place.
    """
    header = list(table.header)
    lone = [place for place in unknown if meanings_of(header[place][0]) == {"uncertainty"}]
    for place in lone:
        before = (
            role for role, places in roles.items() if place - 1 in places and role in QUANTITY_OF
        )
        role = next(before, "")
        if not role or f"u_{role}" in roles:
            continue
        name, unit = header[place]
        unit = unit or table.unit_of(place - 1, QUANTITY_OF[role])
        if unit and not is_unit_of(unit, QUANTITY_OF[role]):
            continue
        header[place] = (name, unit)
        roles[f"u_{role}"] = [place]
        unknown.remove(place)
    return replace(table, header=tuple(header))


def _take_as_before_and_after(table: Table, roles: dict[str, list[int]]) -> None:
    """Take two columns that differ by a number, such as h1 and h2, for before and after the impact.

    roles: {role: places of its columns}, changed in place. Numbers of trials, "height, trial 2", part
    nothing.
    """
    for role in ("height", "speed"):
        places = roles.get(role, [])
        names = [table.header[place][0] for place in places]
        if len(places) != 2 or any(map(_is_of_trial, names)):
            continue
        numbered = []
        for name, place in zip(names, places, strict=True):
            digits = [int(meaning) for meaning in meanings_of(name) if meaning.isdigit()]
            if digits:
                numbered.append((min(digits), place))
        if len(numbered) != 2:
            continue
        (first, before), (second, after) = sorted(numbered)
        if second - first == 1:
            del roles[role]
            roles[f"{role}_in"] = [before]
            roles[f"{role}_out"] = [after]


def _take_by_others(table: Table, roles: dict[str, list[int]]) -> None:
    """Give columns the roles that they have beside the others: a height beside that of the drop is one
    of a rebound, and x beside a force is the penetration.

    roles: {role: places of its columns}, changed in place.
    """
    is_film = bool({"time", "frame", "sample"} & roles.keys())
    if "height_in" in roles and "height" in roles and "height_out" not in roles and not is_film:
        roles["height_out"] = roles.pop("height")
    if "height_out" in roles and not {"height_in", "height"} & roles.keys():
        roles["height"] = roles.pop("height_out")
    if "speed" in roles and "speed_out" in roles and "speed_in" not in roles:
        roles["speed_in"] = roles.pop("speed")
    if "force" in roles and "penetration" not in roles:
        named_x = [i for i, (name, _) in enumerate(table.header) if meanings_of(name) == {"x"}]
        if named_x:
            roles["penetration"] = named_x
    if "height" in roles and "force" not in roles:
        # The place of the ball sideways.
        roles.pop("penetration", None)


def _column_to_take(table: Table, role: str, roles: dict[str, list[int]]) -> int:
    """The place of the column to take of several with one role: any of equal ones, the height that
    falls freely, and the time that rises.

    roles: {role: places of its columns}.
    Raises UserError where they differ.
    """
    places = roles[role]
    clock = next((roles[one][0] for one in ("time", "frame", "sample") if one in roles), None)
    if role == "height" and clock is not None:
        falling = _falling_columns(table, clock, places)
        if len(falling) == 1:
            return falling[0]
    if role in ("frame", "sample"):
        return places[0]
    quantity = QUANTITY_OF.get(role.removeprefix("u_"))
    if quantity is not None:
        if role == "time":
            rising = [i for i in places if (np.diff(table.numbers(i)) > 0).all()]
            if len(rising) == 1:
                # Beside the times of flights.
                return rising[0]
            # Of a message of ROS, the time of measuring, and not that of its arrival.
            places = sorted(places, key=lambda place: "stamp" not in table.header[place][0])
        if all(_are_same(table, quantity, a, b) for a, b in itertools.pairwise(places)):
            return places[0]
    raise UserError(table.name, f"two columns of {role.replace('u_', 'uncertainty of ')}", "one")


def _falling_columns(table: Table, clock: int, places: Sequence[int]) -> list[int]:
    """Those of several columns that fall freely over time: of the upright ones, where names tell them.

    clock: place of the time. A track has a column for each direction.
    """
    upright = [
        place
        for place in places
        if meanings_of(table.header[place][0]) & {"z", "y", "vertical", "height"}
    ]
    return [place for place in upright or places if _falls(table, clock, place)]


def _are_same(table: Table, quantity: str, a: int, b: int) -> bool:
    """Say whether the columns at two places are one quantity in two units, or times from two zeros.

    False where one has a cell that is not a number, or no unit.
    """
    try:
        one = table.column(a, quantity)
        other = table.column(b, quantity)
    except UserError:
        return False
    if quantity == "time":
        one = one - one[0]
        other = other - other[0]
    return bool(np.allclose(one, other, rtol=_SAME, atol=_SAME * float(np.ptp(one))))


def _falls(table: Table, clock: int, place: int) -> bool:
    """Say whether a column falls freely over the one of the time, whatever its unit; rows without a
    number in both are left out.
    """
    times = table.numbers(clock)
    heights = table.numbers(place)
    given = np.isfinite(times) & np.isfinite(heights)
    if given.sum() < 2 or (np.diff(times[given]) <= 0).any():
        return False
    return seen_fall(times[given], heights[given]) != 0.0
