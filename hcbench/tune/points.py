"""Measured pairs (v, e) from a CSV file whose header names the units."""

from __future__ import annotations

import csv
import re
from itertools import pairwise
from typing import TYPE_CHECKING

from hcbench import units
from hcbench.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

_HEADER = re.compile(r"\s*(speed|v|v_i|restitution|e)\s*[\[(]?\s*([^\])]*?)\s*[\])]?\s*", re.IGNORECASE)


def read_points(path: Path) -> tuple[tuple[float, float], ...]:
    """Pairs (v m/s, e), sorted by v, of a CSV with a header like `speed [m/s],restitution`.

    Raises UserError with the line for anything else: no header, no unit, text, duplicate speeds, no rows.
    """
    try:
        rows = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(str(path), f"{error}", "a CSV file") from None
    rows = [row for row in rows if any(cell.strip() for cell in row)]
    expected = "a header like `speed [m/s],restitution`"
    heads = [_HEADER.fullmatch(cell) for cell in rows[0]] if rows else []
    names = ["v" if m and m[1].lower() in ("speed", "v", "v_i") else "e" if m else "" for m in heads]
    if sorted(name for name in names if name) != ["e", "v"]:
        raise UserError(f"{path}: line 1", ",".join(rows[0]) if rows else "an empty file", expected)
    at_v, at_e = names.index("v"), names.index("e")
    unit = (heads[at_v] or [""] * 3)[2]
    if not unit:
        raise UserError(f"{path}: line 1", f"no unit for {rows[0][at_v].strip()!r}", expected)
    pairs = []
    for number, row in enumerate(rows[1:], 2):
        if len(row) <= max(at_v, at_e):
            raise UserError(f"{path}: line {number}", ",".join(row), f"{len(names)} columns")
        speed = units.parse(f"{row[at_v].strip()} {unit}", "speed", f"{path}: line {number}")
        pairs.append((speed, units.parse(row[at_e].strip(), "number", f"{path}: line {number}")))
    if not pairs:
        raise UserError(str(path), "no rows under the header", "at least one pair of v and e")
    pairs.sort()
    for (one, _), (two, _) in pairwise(pairs):
        if one == two:
            raise UserError(str(path), f"the speed {one:g} m/s twice", "each speed once")
    return tuple(pairs)
