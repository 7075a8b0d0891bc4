"""Text exports of two programs that have no units in their headers, or none where one looks for them.

Tracker (physlets.org/tracker): tabs, the track's name in the first line, `t x y` in the second, metres and
seconds. phyphox, "(In)elastic collision": one row with the times of six touches; its "retained" energy is e².
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.table import Table, table_of
from hcbench.system.errors import UserError
from hcbench.system.text import sanitized

if TYPE_CHECKING:
    from pathlib import Path

    from hcbench.terms.impact import Floats

_BOUNCE = re.compile(r"bounce (\d+)")


def tracker_table(path: Path, lines: list[tuple[int, str]]) -> Table | None:
    """The columns t and y of a Tracker export in metres and seconds; None where it is none.

    Raises UserError for several tracks in one file.
    """
    rows = [(n, line.rstrip("\r\n").split("\t")) for n, line in lines]
    at = next((i for i, (_, row) in enumerate(rows[:4]) if "t" in row and "y" in row), None)
    if at is None:
        return None
    header, below = rows[at][1], rows[at + 1 :]
    if below and below[0][1][0].strip().isalpha():  # units follow: no Tracker
        return None
    if lines[0][1].startswith("#multi:"):
        raise UserError(path.name, "several tracks", "one", "Export the ball's track alone")
    places = header.index("t"), header.index("y")
    cells = []
    numbers = []
    for n, row in below:
        cell_t, cell_y = (row[place] if place < len(row) else "" for place in places)
        # Frames without the ball have a time and no place.
        if cell_t.strip() and cell_y.strip():
            cells.append((cell_t, cell_y))
            numbers.append(n)
    has_commas = any("," in cell_t or "," in cell_y for cell_t, cell_y in cells)
    return Table(
        name=sanitized(path.name),
        header=(("t", "s"), ("y", "m")),
        cells=tuple(cells),
        lines=tuple(numbers),
        decimal="," if has_commas else ".",
    )


def phyphox_times(path: Path, lines: list[tuple[int, str]]) -> Floats | None:
    """Times of touches of an export of phyphox' "(In)elastic collision", s; None where it is none.

    Touches that were not heard are 0 or NaN there.
    """
    first = lines[0][1].lower()
    if '"bounce 0' not in first and not first.startswith("bounce 0"):
        return None
    table = table_of(path, lines[:2])
    row = table.cells[0]
    places = []  # (number of the bounce, column)
    for column, (name, _) in enumerate(table.header):
        if match := _BOUNCE.fullmatch(name):
            places.append((int(match[1]), column))
    times = [table.number(row[column]) for _, column in sorted(places) if column < len(row)]
    # The first bounce is at 0; any other 0 was not heard.
    heard = [t for k, t in enumerate(times) if math.isfinite(t) and (t > 0.0 or k == 0)]
    return np.array(heard)
