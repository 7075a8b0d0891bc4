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
        """A column of the file."""
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
        """The standard uncertainties of a column, 0 where none are given."""
        name = f"u_{role}"
        if name not in self.places:
            return self.table.uncertainty(self.places[role], QUANTITY_OF[role])
        values = self.get(name)
        self.require(name, values >= 0, "0 or more")
        return values

    def require(self, role: str, good: ArrayLike, expected: str) -> None:
        """Raise UserError for the first row that is not good."""
        bad = np.flatnonzero(~np.asarray(good, dtype=bool))
        if bad.size and role in self.places:
            i = int(bad[0])
            cell = cell_of(self.table.cells[i], self.places[role]).strip()
            name = self.table.header[self.places[role]][0]
            where = f"{self.table.name}, line {self.table.lines[i]}"
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


def columns_of(table: Table, asked: str | None = None) -> DataColumns:
    """Identify the columns by the names in the header; columns that do not concern bounces are left
    out.

    asked: the kind of data, where the user says it.

    Raises UserError for two columns of one quantity that differ, for rows of several balls, for a
    column of numbers without a name that does not count the rows, and for one that may change what
    the only known one means: beside times whose flights do not shrink, and heights that no column
    counts.
    """
    roles: dict[str, list[int]] = {}
    unknown: list[int] = []
    # Columns that say what the rows are, by numbers or by words, such as "person": bounces have
    # other names.
    of_rows: list[int] = []
    of_things: list[int] = []
    for i, (name, unit) in enumerate(table.header):
        role = role_of(name, unit)
        cells = table.texts(i)
        if not table.has_number(i) and (not role or not any(table.is_given(i))):
            _require_one_ball(table, i)
            if name and not is_beside(name) and len(set(cells)) == len(cells) > _LEAST_NAMED:
                of_things.append(i)
        elif role:
            roles.setdefault(role, []).append(i)
        elif (not is_beside(name) or _is_of_trial(name)) and (name or not counts(cells)):
            # pandas gives the index of the rows no name.
            unknown.append(i)
            of_rows += [i] if counts(cells) else []
    _leave_counters(table, roles)
    table = _with_lone_uncertainty(table, roles, unknown)
    _part_numbered(table, roles)
    _part_by_others(table, roles)
    places: dict[str, int] = {}
    for role, at in roles.items():
        places[role] = at[0] if len(at) == 1 else _one_of(table, role, at, roles)
    columns = DataColumns(table, places)
    kind = asked or kind_of(columns.roles)
    if kind == "heights":
        unknown, of_rows = unknown + of_things, of_rows + of_things
    is_doubtful = kind is None or (
        kind in _ALONE and kind != asked and (of_rows or not _is_sure(columns, unknown))
    )
    nameless = [i for i in unknown if not table.header[i][0]]
    if nameless:
        # More numbers in a row than names, such as two for "1,5": which is whose cannot be told.
        advice = "Name each column, and write 1.5 or put semicolons between the cells"
        raise UserError(table.name, "a column without a name", EXPECTED_COLUMNS, advice)
    if unknown and is_doubtful:
        got = f"a column {table.header[unknown[0]][0]!r}"
        raise UserError(table.name, got, EXPECTED_COLUMNS, _advice(table, roles, unknown))
    return columns


def _is_of_trial(name: str) -> bool:
    """Say whether a column has the readings of one of several trials, such as "Run 2"."""
    found = meanings_of(name)
    return "trial" in found and any(map(str.isdigit, found))


def _advice(table: Table, roles: dict[str, list[int]], unknown: list[int]) -> str:
    """Advice on columns with unknown names: the kind to ask for, where one of them may be the data.

    roles: {role: numbers of its columns}. unknown: numbers of the columns with unknown names.
    """
    if any(_is_of_trial(table.header[i][0]) for i in unknown):
        return "Name each column by what it has too, such as 'rebound height, trial 1 [cm]'"
    gates = [i for i in unknown if is_unit_of(table.unit_of(i, "time"), "time")]
    if len({part for i in gates for part in meanings_of(table.header[i][0]) & _SIDES}) > 1:
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
    """(name, numbers) of each column beside the data that gives each row a whole number of its own."""
    table = columns.table
    for at, (name, unit) in enumerate(table.header):
        is_data = at in {columns.places[role] for role in columns.roles & columns.places.keys()}
        if unit or is_data or any(":" in text for text in table.texts(at)):
            continue
        numbers = table.numbers(at)
        is_whole = bool(np.isfinite(numbers).all()) and np.array_equal(numbers, np.round(numbers))
        if is_whole and len(set(numbers.tolist())) == len(numbers):
            yield name, numbers


def _require_one_ball(table: Table, at: int) -> None:
    """Raise UserError where a column of text names several balls or plates."""
    if not is_group(table.header[at][0]):
        return
    named = list(dict.fromkeys(cell for row in table.cells if (cell := cell_of(row, at))))
    if len(named) > 1:
        got = f"{len(named)} of {table.header[at][0]!r}: {', '.join(named[:3])}"
        raise UserError(table.name, got, "one ball on one plate", "Put each into a file of its own")


def _is_sure(columns: DataColumns, unknown: Sequence[int]) -> bool:
    """Say whether a column alone is of bounces beside any other: times that are a train of them, or
    heights whose bounces are counted, where all that is unknown falls along with them.
    """
    table = columns.table
    for role in {"time", "interval"} & columns.places.keys():
        at = columns.places[role]
        numbers = table.in_unit(at, "time") if table.unit_of(at, "time") else table.numbers(at)
        return is_sure_train(np.cumsum([0.0, *numbers]) if role == "interval" else numbers)
    falling = all((np.diff(table.numbers(i)) < 0).all() for i in unknown)
    return falling and any(
        numbers_bounces(name) and counts(table.texts(i)) for i, (name, _) in enumerate(table.header)
    )


def _leave_counters(table: Table, roles: dict[str, list[int]]) -> None:
    """Leave out columns such as "interval" that count the rows, beside others that have a unit or do
    not count.

    roles: {role: numbers of its columns}, changed in place.
    """
    of_data = {role: at for role, at in roles.items() if role in QUANTITY_OF}
    kept = {
        role: [i for i in at if table.unit_of(i, QUANTITY_OF[role]) or not counts(table.texts(i))]
        for role, at in of_data.items()
    }
    for role in of_data if any(kept.values()) else ():
        roles[role] = kept[role]
        if not kept[role]:
            del roles[role]


def _with_lone_uncertainty(table: Table, roles: dict[str, list[int]], unknown: list[int]) -> Table:
    """The table with the unit of the column before in each column that is named "SD" or "±" alone:
    it is the uncertainty of that column.

    roles: {role: numbers of its columns}. unknown: numbers of the columns without a role.
    """
    header = list(table.header)
    for i in [i for i in unknown if meanings_of(header[i][0]) == {"uncertainty"}]:
        of = next((role for role, at in roles.items() if i - 1 in at and role in QUANTITY_OF), "")
        unit = header[i][1] or table.unit_of(i - 1, QUANTITY_OF[of]) if of else ""
        if of and f"u_{of}" not in roles and (not unit or is_unit_of(unit, QUANTITY_OF[of])):
            header[i] = (header[i][0], unit)
            roles[f"u_{of}"] = [i]
            unknown.remove(i)
    return replace(table, header=tuple(header))


def _part_numbered(table: Table, roles: dict[str, list[int]]) -> None:
    """Take two columns that differ by a number, such as h1 and h2, for before and after the impact."""
    for role in ("height", "speed"):
        at = roles.get(role, [])
        names = [table.header[i][0] for i in at]
        found = [[*filter(str.isdigit, meanings_of(one))] for one in names]
        numbered = sorted(
            (int(digits[0]), i) for digits, i in zip(found, at, strict=True) if digits
        )
        is_again = any(map(_is_of_trial, names))
        if len(numbered) == len(at) == 2 and numbered[1][0] - numbered[0][0] == 1 and not is_again:
            del roles[role]
            roles |= {f"{role}_in": [numbered[0][1]], f"{role}_out": [numbered[1][1]]}


def _part_by_others(table: Table, roles: dict[str, list[int]]) -> None:
    """Take columns for what they mean beside the others: a height beside that of the drop is one of a
    rebound.

    roles: {role: numbers of its columns}, changed in place.
    """
    is_film = bool({"time", "frame", "sample"} & roles.keys())
    if "height_in" in roles and "height" in roles and "height_out" not in roles and not is_film:
        roles["height_out"] = roles.pop("height")
    if "height_out" in roles and not {"height_in", "height"} & roles.keys():
        roles["height"] = roles.pop("height_out")
    if "speed" in roles and "speed_out" in roles and "speed_in" not in roles:
        roles["speed_in"] = roles.pop("speed")
    if "force" in roles and "penetration" not in roles:
        sideways = [i for i, (name, _) in enumerate(table.header) if meanings_of(name) == {"x"}]
        if sideways:
            roles["penetration"] = sideways
    if "height" in roles and "force" not in roles:
        # The place of the ball sideways.
        roles.pop("penetration", None)


def _one_of(table: Table, role: str, at: list[int], roles: dict[str, list[int]]) -> int:
    """The column to take of several with one role: any of equal ones, and the height that falls freely.

    at: numbers of the several. roles: {role: numbers of its columns}. Raises UserError where they differ.
    """
    clock = next((roles[one][0] for one in ("time", "frame", "sample") if one in roles), None)
    if role == "height" and clock is not None:
        upright = [
            i for i in at if meanings_of(table.header[i][0]) & {"z", "y", "vertical", "height"}
        ]
        falling = [i for i in upright or at if _falls(table, clock, i)]
        if len(falling) == 1:
            return falling[0]
    if role in QUANTITY_OF or role.removeprefix("u_") in QUANTITY_OF:
        quantity = QUANTITY_OF[role.removeprefix("u_")]
        rising = [i for i in at if (np.diff(table.numbers(i)) > 0).all()]
        if role == "time" and len(rising) == 1:
            # Beside the times of flights.
            return rising[0]
        if role == "time":
            # Of a message, the time of measuring, and not that of its arrival.
            at = sorted(at, key=lambda i: "stamp" not in table.header[i][0])
        if all(_are_same(table, quantity, a, b) for a, b in itertools.pairwise(at)):
            return at[0]
    elif role in ("frame", "sample"):
        return at[0]
    raise UserError(table.name, f"two columns of {role.replace('u_', 'uncertainty of ')}", "one")


def _are_same(table: Table, quantity: str, a: int, b: int) -> bool:
    """Say whether two columns are one quantity in two units or from two zeros of time."""
    try:
        one, other = table.column(a, quantity), table.column(b, quantity)
    except UserError:
        return False
    if quantity == "time":
        one, other = one - one[0], other - other[0]
    return bool(np.allclose(one, other, rtol=_SAME, atol=_SAME * float(np.ptp(one))))


def _falls(table: Table, time: int, height: int) -> bool:
    """Say whether a column of places falls freely over time, whatever its unit."""
    times, heights = table.numbers(time), table.numbers(height)
    given = np.isfinite(times) & np.isfinite(heights)
    if given.sum() < 2 or (np.diff(times[given]) <= 0).any():
        return False
    return seen_fall(times[given], heights[given]) != 0.0
