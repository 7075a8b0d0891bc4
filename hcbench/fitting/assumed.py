"""Names and units that a table lacks, where its numbers leave no choice."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.cells import counts
from hcbench.fitting.column_names import (
    PIXELS,
    QUANTITY_OF,
    is_beside,
    is_unit_of,
    meanings_of,
    role_of,
)
from hcbench.fitting.track import seen_fall
from hcbench.system.errors import UserError
from hcbench.terms import units
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hcbench.fitting.table import Table
    from hcbench.terms.impact import Floats

# Flights of a ball, s. Read in ms or minutes, none of them would be one.
_SHORTEST = 5e-3
_LONGEST = 3.0
# The first flight of a train is at least this long, s.
_FIRST = 0.03
# Share of flights that are shorter than the one before, at least.
_SHRINKING = 0.7
# Times, the shortest flight over the one before, and the scatter of that share, that leave no doubt.
_SURE = 6
_LEAST_SHARE = 0.3
_ROUGH = 0.05
# Meanings of names that tell no quantity.
_OPEN = {"touch", "bounce", "number", "total", *map(str, range(10))}
# Quantities of a single column that a user may name.
_ASKED = {"times": "time", "heights": "position"}
# Roles beside which a column in a unit of force is not taken for the force.
_HELD = {"force", "height"}
_AXES = ({"x"}, {"y"}, {"z"})
# Share by which the acceleration of a phone at rest differs from g, at most.
_NEAR_REST = 0.05
# Columns that tell when the rows of a track are, and rows in which a fall is seen, at least.
_CLOCKS = ("time", "frame", "sample")
_LEAST_OF_FALL = 12
# Share of g by which free fall may miss it where metres and seconds are assumed.
_NEAR_G = 0.2


@dataclass(frozen=True, slots=True)
class _SortedColumns:
    """Columns with numbers of a table, each by its place from 0, sorted by what their names tell.

    known: the role of each whose name and unit have one, such as "time"; not of whole numbers that
    count on without a unit.
    bare: those whose names tell no quantity, such as "touch" or none, and that do not count on.
    unknown: others whose names have no role; a unit may tell their quantity.
    """

    table: Table
    known: Mapping[int, str]
    bare: Sequence[int]
    unknown: Sequence[int]

    @classmethod
    def of(cls, table: Table) -> _SortedColumns:
        """Sort the columns of a table."""
        known: dict[int, str] = {}
        bare: list[int] = []
        unknown: list[int] = []
        for place, (name, unit) in enumerate(table.header):
            if not table.has_number(place):
                continue
            role = role_of(name, unit)
            if role:
                if role in QUANTITY_OF and (unit or not counts(table.texts(place))):
                    known[place] = role
            elif meanings_of(name) <= _OPEN and not counts(table.texts(place)):
                bare.append(place)
            elif not is_beside(name):
                unknown.append(place)
        return cls(table, known, bare, unknown)

    @property
    def has_names(self) -> bool:
        """True if the table has a name or a unit anywhere."""
        return any(map(any, self.table.header))

    def of_role(self, role: str) -> list[int]:
        """Places of the known columns with a role."""
        return [place for place, known_role in self.known.items() if known_role == role]

    def of_unit(self, quantity: str) -> list[int]:
        """Places of the unknown columns in a unit of a quantity."""
        return [i for i in self.unknown if self.is_in(i, quantity)]

    def is_in(self, place: int, quantity: str) -> bool:
        """Say whether a column has a unit of a quantity."""
        return is_unit_of(self.table.unit_of(place, quantity), quantity)

    def clocks(self) -> list[int]:
        """Places of the columns that may be a time."""
        bare = [i for i in self.bare if not self.is_in(i, "position")]
        return self.of_role("time") or [*self.of_unit("time"), *([] if self.known else bare)]

    def heights(self) -> list[int]:
        """Places of the columns that may be a height; none beside a force."""
        if "force" in self.known.values():
            return []
        by_unit = self.of_unit("position")
        return self.of_role("height") or [*by_unit, *([] if self.has_names else self.bare)]

    def in_si(self, place: int, quantity: str) -> Floats:
        """Numbers of a column in SI; as they stand where it has no unit of the quantity."""
        if self.is_in(place, quantity):
            return self.table.in_unit(place, quantity)
        return self.table.numbers(place)


def completed(table: Table, asked: str | None) -> tuple[Table, str]:
    """A table with the names and units that it lacks, where its numbers leave no choice, and a sentence
    of what was assumed; "" for nothing.

    asked: the kind of data, where the user says it. A time and a place in m and s that fall with g are
    a track; times of which each flight is shorter than the one before are those of touches.
    Raises UserError for numbers without any name that are neither.
    """
    _require_places(table)
    columns = _SortedColumns.of(table)
    known = columns.known
    clocks = columns.clocks()
    tracks = _tracks(columns)
    trains = [clock for clock in clocks if is_train(columns.in_si(clock, "time"))]
    if not columns.has_names and len(trains) == len(columns.bare) == 2:
        begin, end = columns.bare
        if _are_labels(table, begin, end):
            header = (*table.header[:end], ("stop", ""), *table.header[end + 1 :])
            table = replace(table, header=header)
            trains = trains[:1]
    elif _has_other_unknown(columns, clocks):
        # Beside columns of which nothing is known, a time must leave no doubt.
        trains = [clock for clock in trains if is_sure_train(columns.in_si(clock, "time"))]
    if asked in _ASKED and not known:
        return _with_names(table, _taken_as(columns, asked), f"--as {asked} says so")
    if len({place for _, place in tracks}) == 1:
        clock, place = tracks[0]
        return _with_names(table, {clock: "time", place: "height"}, "it falls with g")
    of_force = columns.of_unit("force")
    if clocks and len(of_force) == 1 and not _HELD & {*known.values()}:
        return _with_names(table, {of_force[0]: "force"}, "no other column is in its unit")
    is_only_train = len(trains) == 1 and known.keys() <= {*trains}
    if is_only_train and (known or trains[0] in columns.bare):
        why = "each flight is shorter than the one before"
        return _with_names(table, {trains[0]: "time"}, why)
    if not columns.has_names:
        got = f"begins with the numbers {', '.join(table.cells[0])!r:.60}"
        raise UserError(table.name, got, "a header")
    return _with_names(table, {}, "")


def _tracks(columns: _SortedColumns) -> list[tuple[int, int]]:
    """(place of the time, place of the height) of each pair of columns that falls with g."""
    found = []
    for clock, place in itertools.product(columns.clocks(), columns.heights()):
        if clock == place:
            continue
        times = columns.in_si(clock, "time")
        heights = columns.in_si(place, "position")
        if falls_with_g(times, heights):
            found.append((clock, place))
    return found


def _has_other_unknown(columns: _SortedColumns, clocks: list[int]) -> bool:
    """Say whether a column of which nothing is known stands beside the one that may be the time."""
    if len(columns.unknown) + len(columns.bare) > 1:
        return True
    return bool(columns.unknown) and clocks != columns.unknown


def scaled_by_fall(table: Table, gravity: float) -> tuple[Table, str]:
    """A track in pixels with the scale at which its flights fall with g, m/s², and a sentence of it; the
    table as it is, and "", where it has a scale, or no flights are seen.

    The speeds are as right as the times: of a film in slow motion they are wrong without a word.
    """
    in_pixels = {role_of(name): i for i, (name, unit) in enumerate(table.header) if unit in PIXELS}
    if table.pixel is not None or "height" not in in_pixels:
        return table, ""
    times = _times_of_rows(table)
    if times is None:
        return table, ""
    heights = table.numbers(in_pixels["height"])
    given = np.isfinite(times) & np.isfinite(heights)
    if given.sum() < _LEAST_OF_FALL or (np.diff(times[given]) <= 0.0).any():
        return table, ""
    # px/s²
    fall = abs(seen_fall(times[given], heights[given]))
    if not fall:
        return table, ""
    said = f"no scale is given: 1 px is {1e3 * gravity / fall:.4g} mm if its flights fall with g"
    return replace(table, pixel=gravity / fall), said


def _times_of_rows(table: Table) -> Floats | None:
    """Times of the rows of a track, s, (n,), by its first column of times, frames or samples.

    None without such a column, and where neither its unit nor the rate of the frames is known.
    """
    clock = next((i for i, one in enumerate(table.header) if role_of(*one) in _CLOCKS), None)
    if clock is None:
        return None
    if table.unit_of(clock, "time"):
        return table.in_unit(clock, "time")
    if table.frequency is None:
        return None
    return np.asarray(table.numbers(clock) / table.frequency)


def _require_places(table: Table) -> None:
    """Raise UserError for x, y and z without units that are accelerations: a phone at rest measures g."""
    axes = [
        place
        for place, (name, unit) in enumerate(table.header)
        if not unit and meanings_of(name) in _AXES
    ]
    if len(axes) != len(_AXES):
        return
    size = np.linalg.norm([table.numbers(place) for place in axes], axis=0)
    if abs(np.nanmedian(size) / STANDARD_GRAVITY - 1.0) < _NEAR_REST:
        names = ", ".join(table.header[place][0] for place in axes)
        advice = "Write the times of its peaks under 'touch time [s]'"
        raise UserError(table.name, f"accelerations in the columns {names}", "places", advice)


def _are_labels(table: Table, begin: int, end: int) -> bool:
    """Say whether two columns are the begin and the end of labels: the end is the begin, or later.

    Labels have a word as well, unless each ends where it begins.
    """
    lasts = table.numbers(end) - table.numbers(begin)
    return bool((lasts >= 0).all() and (len(table.header) > 2 or not lasts.any()))


def _taken_as(columns: _SortedColumns, asked: str) -> dict[int, str]:
    """The role of the one column that has a unit of the kind that the user names; {} for several.

    asked: a key of _ASKED. Times that fall all the way are intervals.
    """
    quantity = _ASKED[asked]
    alone = [i for i in (*columns.unknown, *columns.bare) if columns.is_in(i, quantity)]
    if len(alone) != 1:
        return {}
    role = asked.removesuffix("s")
    if role == "time" and (np.diff(columns.table.numbers(alone[0])) < 0).all():
        role = "interval"
    return {alone[0]: role}


def _with_names(table: Table, taken: Mapping[int, str], why: str) -> tuple[Table, str]:
    """A table with the roles of some columns as their names, in SI where they have no unit, and a
    sentence of what it lacked; "" where it lacked nothing.

    taken: {place of a column: its role}.
    why: the end of the sentence.
    """
    header = list(table.header)
    said = []
    for place, role in taken.items():
        name, unit = header[place]
        quantity = QUANTITY_OF[role]
        has_unit = table.unit_of(place, quantity)
        if role_of(name, unit) == role and has_unit:
            continue
        unit = unit or has_unit or units.QUANTITIES[quantity].unit
        header[place] = (role, unit)
        shown = f"{name!r}" if name else f"column {place + 1}"
        said.append(f"{shown} read as the {role} in {unit}")
    completed_table = replace(table, header=tuple(header))
    if not said:
        return completed_table, ""
    return completed_table, f"{' and '.join(said)}: {why}"


def is_train(times: Floats) -> bool:
    """Say whether numbers, (n,), are times of touches in seconds: flights that a ball has, most of them
    shorter than the one before. False for fewer than four; NaN are left out.
    """
    times = times[np.isfinite(times)]
    if len(times) < 4:
        return False
    flights = np.diff(times)
    if not ((flights > _SHORTEST) & (flights < _LONGEST)).all() or flights.max() < _FIRST:
        return False
    # Whole numbers may count frames.
    if np.array_equal(times, np.round(times)):
        return False
    return float(np.mean(np.diff(flights) < 0.0)) >= _SHRINKING


def is_sure_train(times: Floats) -> bool:
    """Say whether numbers are times of bounces whatever stands beside them: each flight is shorter than
    the one before by a share that changes smoothly.

    times: (n,), of one unit, whichever it is.
    """
    if not is_train(times) or len(times) < _SURE:
        return False
    shares = np.diff(times)[1:] / np.diff(times)[:-1]
    line = np.polyfit(np.arange(len(shares)), shares, 1)
    off = shares - np.polyval(line, np.arange(len(shares)))
    return bool(shares.max() < 1.0 and shares.min() > _LEAST_SHARE and off.std() < _ROUGH)


def falls_with_g(times: Floats, heights: Floats) -> bool:
    """Say whether a track falls with g in metres and seconds, upwards or downwards.

    times, heights: (n,). False for fewer than 12 rows with both, and for times that do not rise.
    """
    given = np.isfinite(times) & np.isfinite(heights)
    times = times[given]
    heights = heights[given]
    if len(times) < _LEAST_OF_FALL or (np.diff(times) <= 0).any():
        return False
    return abs(abs(seen_fall(times, heights)) / STANDARD_GRAVITY - 1.0) < _NEAR_G
