"""Names and units that a table lacks, where its numbers leave no choice."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.table import Table, cell_of
from hcbench.fitting.track import seen_fall
from hcbench.system.errors import UserError
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats

# Flights of a ball, s. Read in ms or minutes, none of them would be one.
_SHORTEST = 5e-3
_LONGEST = 3.0
# The first flight of a train is at least this long, s.
_FIRST = 0.03
# Share of flights that are shorter than the one before, at least.
_SHRINKING = 0.7
# Seconds of the units that cells without a header may have.
_TIMES = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6}
# Share of g by which free fall may miss it where metres and seconds are assumed.
_NEAR_G = 0.2


def named(table: Table) -> tuple[Table, str]:
    """A table with the names that it lacks, and a sentence of what was assumed; "" where it has names.

    A column of times of touches, alone or beside words as programs write labels; or a track in metres
    and seconds, which falls with g. Raises UserError for other numbers without names.
    """
    if any(name or unit for name, unit in table.header):
        return table, ""
    columns = [table.numbers(i) for i in range(len(table.header))]
    numeric = [i for i in range(len(columns)) if np.isfinite(columns[i]).any()]
    counted = [i for i in numeric if _counts(columns[i])]
    kept = [i for i in numeric if i not in counted]
    begins = kept[:1]
    # Labels have a begin, an end and a word; the end is the begin, or later.
    is_label = False
    if len(kept) == 2:
        lasts = columns[kept[1]] - columns[kept[0]]
        is_label = bool((lasts >= 0).all()) and (len(columns) > 2 or not lasts.any())
    unit = table.unit_of(begins[0], "time") if begins else ""
    if (
        (len(kept) == 1 or is_label)
        and unit in _TIMES
        and is_train(_TIMES[unit] * columns[begins[0]])
    ):
        header = [("", "")] * len(columns)
        header[begins[0]] = ("time", unit or "s")
        for i in kept[1:]:
            header[i] = ("stop", "s")
        return replace(
            table, header=tuple(header)
        ), f"no header: read as times of touches in {unit or 's'}"
    if len(kept) == 2 and falls_with_g(columns[kept[0]], columns[kept[1]]):
        header = [("", "")] * len(columns)
        header[kept[0]], header[kept[1]] = ("time", "s"), ("height", "m")
        return replace(
            table, header=tuple(header)
        ), "no header: read as a track in s and m, as it falls with g"
    shown = ", ".join(cell_of(table.cells[0], i) for i in range(len(columns)))
    raise UserError(table.name, f"begins with the numbers {shown!r:.60}", "a header")


def with_units(table: Table, places: dict[str, int]) -> tuple[Table, str]:
    """A table with seconds and metres where its header has no unit and its numbers say so, and a
    sentence of what was assumed; "" for nothing.

    places: columns by role. Times of touches are seconds where no other unit gives flights of a ball;
    a track is in metres and seconds where it falls with g.
    """
    time, height = places.get("time"), places.get("height")
    if time is None:
        return table, ""
    lacking = [
        at
        for at, quantity in ((time, "time"), (height, "position"))
        if at is not None and not table.unit_of(at, quantity)
    ]
    if not lacking:
        return table, ""
    times = table.numbers(time) if time in lacking else table.column(time, "time")
    if height is None:
        is_sure = len(places) == 1 and is_train(times)
        said = "no unit: read as s, as flights of a ball are"
    else:
        is_sure = table.unit_of(height, "position") in ("", "m") and falls_with_g(
            times, table.numbers(height)
        )
        said = "no unit: read as s and m, as the track falls with g"
    if not is_sure:
        return table, ""
    header = list(table.header)
    for at in lacking:
        header[at] = (header[at][0], "s" if at == time else "m")
    return replace(table, header=tuple(header)), said


def is_train(times: Floats) -> bool:
    """Say whether numbers are times of touches in seconds: flights that a ball has, most of them
    shorter than the one before.
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


def falls_with_g(times: Floats, heights: Floats) -> bool:
    """Say whether a track falls with g in metres and seconds, upwards or downwards."""
    given = np.isfinite(times) & np.isfinite(heights)
    times, heights = times[given], heights[given]
    if len(times) < 12 or (np.diff(times) <= 0).any():
        return False
    return abs(abs(seen_fall(times, heights)) / STANDARD_GRAVITY - 1.0) < _NEAR_G


def _counts(numbers: Floats) -> bool:
    """Say whether a column counts the rows."""
    return (
        len(numbers) > 1 and bool(np.all(np.diff(numbers) == 1)) and float(numbers[0]) in (0.0, 1.0)
    )
