"""Measured pairs (v, e) to judge a model by, from a file as `hcbench fit` reads them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hcbench.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

MOST = 500


def read_pairs(path: Path) -> tuple[tuple[float, float], ...]:
    """Pairs (v m/s, e) from a file, speeds rising: `speed [in/s],restitution`.

    Separators: comma, semicolon or tab; # begins a comment. Columns of uncertainties are left aside.
    Raises UserError with the file, the line, what it has and what was expected.
    """
    from hcbench.fitting.read import columns_of
    from hcbench.fitting.table import read_lines, read_table

    columns = columns_of(read_table(path, read_lines(path)))
    role = "speed" if "speed" in columns.places else "speed_in"
    if {name for name in columns.places if not name.startswith("u_")} != {role, "restitution"}:
        names = ", ".join(name for name, _ in columns.table.header)
        raise UserError(columns.table.name, f"columns {names}", "speed [m/s],restitution")
    speed, e = columns.get(role), columns.get("restitution")
    columns.require(role, speed > 0, "a speed above 0")
    columns.require("restitution", (e >= 0) & (e <= 1), "0 ... 1")
    columns.require(role, [v not in speed[:i] for i, v in enumerate(speed)], "each speed once")
    if len(speed) > MOST:
        raise UserError(columns.table.name, f"{len(speed)} pairs", f"up to {MOST}")
    return tuple(sorted(zip(speed.tolist(), e.tolist(), strict=True)))
