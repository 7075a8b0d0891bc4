"""Names and units that a table lacks, where its numbers leave no choice."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.cells import counts
from hcbench.fitting.column_names import QUANTITY_OF, is_beside, is_unit_of, meanings_of, role_of
from hcbench.fitting.track import seen_fall
from hcbench.system.errors import UserError
from hcbench.terms import units
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Mapping

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
_OPEN = {"touch", "bounce", "number", *map(str, range(10))}
# Quantities of a single column that a user may name.
_ASKED = {"times": "time", "heights": "position"}
# Share of g by which free fall may miss it where metres and seconds are assumed.
_NEAR_G = 0.2


def completed(table: Table, asked: str | None) -> tuple[Table, str]:
    """A table with the names and units that it lacks, where its numbers leave no choice, and a sentence
    of what was assumed; "" for nothing.

    asked: the kind of data, where the user says it. A time and a place in m and s that fall with g are
    a track; times of which each flight is shorter than the one before are those of touches.
    Raises UserError for numbers without any name that are neither.
    """
    roles = [role_of(*one) for one in table.header]
    known = {i: role for i, role in enumerate(roles) if role in QUANTITY_OF and table.has_number(i)}
    known = {
        i: role for i, role in known.items() if table.header[i][1] or not counts(table.texts(i))
    }
    others = [i for i, role in enumerate(roles) if not role and table.has_number(i)]
    # Names that tell no quantity, such as "touch", and those that tell something else.
    bare = [i for i in others if meanings_of(table.header[i][0]) <= _OPEN]
    bare = [i for i in bare if not counts(table.texts(i))]
    unknown = [i for i in others if i not in bare and not is_beside(table.header[i][0])]
    has_names = any(map(any, table.header))

    def of_unit(quantity: str) -> list[int]:
        return [i for i in unknown if is_unit_of(table.unit_of(i, quantity), quantity)]

    def si(at: int, quantity: str) -> Floats:
        has_unit = table.unit_of(at, quantity)
        return table.in_unit(at, quantity) if has_unit else table.numbers(at)

    clocks = [i for i, role in known.items() if role == "time"]
    clocks = clocks or [*of_unit("time"), *(bare if not known else ())]
    heights = [i for i, role in known.items() if role == "height"]
    places = heights or [*of_unit("position"), *(() if has_names else bare)]
    pairs = itertools.product(clocks, () if "force" in known.values() else places)
    tracks = [(c, p) for c, p in pairs if c != p and falls_with_g(si(c, "time"), si(p, "position"))]
    trains = [c for c in clocks if is_train(si(c, "time"))]
    if not has_names and len(trains) == len(bare) == 2:
        # Labels have a begin, an end and a word; the end is the begin, or later.
        lasts = table.numbers(bare[1]) - table.numbers(bare[0])
        if (lasts >= 0).all() and (len(roles) > 2 or not lasts.any()):
            table = replace(
                table, header=(*table.header[: bare[1]], ("stop", ""), *table.header[bare[1] + 1 :])
            )
            trains = trains[:1]
    elif len(unknown) + len(bare) > 1 or (unknown and clocks != unknown):
        trains = [c for c in trains if is_sure_train(si(c, "time"))]
    taken: dict[int, str] = {}
    why = ""
    if asked in _ASKED and not known:
        alone = of_unit(_ASKED[asked])
        taken = dict.fromkeys(alone if len(alone) == 1 else [], asked.removesuffix("s"))
        if taken == {i: "time" for i in alone if (np.diff(table.numbers(i)) < 0).all()}:
            taken = dict.fromkeys(taken, "interval")
        why = f"--as {asked} says so"
    elif len({place for _, place in tracks}) == 1:
        taken = dict(zip(tracks[0], ("time", "height"), strict=True))
        why = "it falls with g"
    elif clocks and len(of_unit("force")) == 1 and not {"force", "height"} & {*known.values()}:
        taken = dict.fromkeys(of_unit("force"), "force")
        why = "no other column is in its unit"
    elif len(trains) == 1 and known.keys() <= {*trains} and (known or trains[0] in bare):
        taken = dict.fromkeys(trains, "time")
        why = "each flight is shorter than the one before"
    elif not has_names:
        got = f"begins with the numbers {', '.join(table.cells[0])!r:.60}"
        raise UserError(table.name, got, "a header")
    return _with_names(table, taken, why)


def _with_names(table: Table, taken: Mapping[int, str], why: str) -> tuple[Table, str]:
    """A table with the roles of some columns as their names, in SI where they have no unit, and a
    sentence of what it lacked.
    """
    header = list(table.header)
    said = []
    for at, role in taken.items():
        name, unit = header[at]
        has_unit = table.unit_of(at, QUANTITY_OF[role])
        if role_of(name, unit) == role and has_unit:
            continue
        header[at] = (role, unit or has_unit or units.QUANTITIES[QUANTITY_OF[role]].unit)
        called = f"{name!r}" if name else f"column {at + 1}"
        said.append(f"{called} read as the {role} in {header[at][1]}")
    return replace(table, header=tuple(header)), f"{' and '.join(said)}: {why}" if said else ""


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


def is_sure_train(times: Floats) -> bool:
    """Say whether numbers are times of bounces whatever stands beside them: each flight is shorter than
    the one before by a share that changes smoothly.
    """
    if not is_train(times) or len(times) < _SURE:
        return False
    shares = np.diff(times)[1:] / np.diff(times)[:-1]
    line = np.polyfit(np.arange(len(shares)), shares, 1)
    off = shares - np.polyval(line, np.arange(len(shares)))
    return bool(shares.max() < 1.0 and shares.min() > _LEAST_SHARE and off.std() < _ROUGH)


def falls_with_g(times: Floats, heights: Floats) -> bool:
    """Say whether a track falls with g in metres and seconds, upwards or downwards."""
    given = np.isfinite(times) & np.isfinite(heights)
    times, heights = times[given], heights[given]
    if len(times) < 12 or (np.diff(times) <= 0).any():
        return False
    return abs(abs(seen_fall(times, heights)) / STANDARD_GRAVITY - 1.0) < _NEAR_G
