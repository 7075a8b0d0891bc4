"""Text exports of two programs that have no units in their headers, or none where one looks for them.

Tracker (physlets.org/tracker): tabs, the track's name in the first line, `t x y` in the second, metres and
seconds. phyphox, "(In)elastic collision": one row with the times of six touches; its "retained" energy is e².
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np

from hcbench._text import sanitized
from hcbench.errors import UserError
from hcbench.fitting.table import Table, table_of

if TYPE_CHECKING:
    from pathlib import Path

    from hcbench.impact import Floats

_BOUNCE = re.compile(r"bounce (\d+)")


def tracker_table(path: Path, lines: list[tuple[int, str]]) -> Table | None:
    """The columns t and y of a Tracker export in metres and seconds; None where it is none.

    Raises UserError for several tracks in one file.
    """
    rows = [(n, line.rstrip("\r\n").split("\t")) for n, line in lines]
    at = next((i for i, (_, row) in enumerate(rows[:4]) if "t" in row and "y" in row), None)
    if at is None or (
        at + 1 < len(rows) and rows[at + 1][1][0].strip().isalpha()
    ):  # units follow: no Tracker
        return None
    if lines[0][1].startswith("#multi:"):
        raise UserError(path.name, "several tracks", "one", "Export the ball's track alone")
    header = rows[at][1]
    places = header.index("t"), header.index("y")
    cells = [(n, tuple(row[p] if p < len(row) else "" for p in places)) for n, row in rows[at + 1 :]]
    filled = [(n, row) for n, row in cells if all(cell.strip() for cell in row)]
    comma = any("," in cell for _, row in filled for cell in row)
    names = (("t", "s"), ("y", "m"))
    return Table(
        sanitized(path.name),
        names,
        tuple(row for _, row in filled),
        tuple(n for n, _ in filled),
        "," if comma else ".",
    )


def phyphox_times(path: Path, lines: list[tuple[int, str]]) -> Floats | None:
    """Times of touches of an export of phyphox' "(In)elastic collision", s; None where it is none.

    Touches that were not heard are 0 or NaN there.
    """
    if '"bounce 0' not in lines[0][1].lower() and not lines[0][1].lower().startswith("bounce 0"):
        return None
    table = table_of(path, lines[:2])
    places = [(int(m[1]), i) for i, (name, _) in enumerate(table.header) if (m := _BOUNCE.fullmatch(name))]
    times = [table.number(table.cells[0][i]) for _, i in sorted(places) if i < len(table.cells[0])]
    return np.array([t for k, t in enumerate(times) if math.isfinite(t) and (t > 0.0 or k == 0)])
