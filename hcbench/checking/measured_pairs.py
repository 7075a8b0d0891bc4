"""Measured pairs (v, e) to judge a model by, from a file as `hcbench fit` reads them."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from hcbench.system.errors import UserError
from hcbench.terms import units

MOST = 500
Pairs = tuple[tuple[float, float], ...]


def read_pairs(path: Path) -> Pairs:
    """Pairs (v m/s, e) from a file, speeds rising: `speed [in/s],restitution`.

    Separators: comma, semicolon or tab; # begins a comment. Columns of uncertainties are left aside.
    Raises UserError with the file, the line, what it has and what was expected.
    """
    from hcbench.fitting.columns import columns_of
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


def parse_points(text: str) -> Pairs:
    """Pairs (v m/s, e) from 'v:e, v:e unit' or from a CSV file with the columns speed and restitution."""
    is_file = False
    with suppress(OSError):  # pairs are not the name of a file, and may be longer than one can be
        is_file = Path(text).is_file()
    if is_file:
        return read_pairs(Path(text))
    points = []
    unit = text.rsplit(":", 1)[-1].strip().partition(" ")[2]
    for pair in text.split(","):
        speed, colon, e = pair.strip().removesuffix(unit).strip().partition(":")
        if not colon:
            expected = "pairs like '0.1:0.95, 0.5:0.85 m/s' or a CSV file that exists"
            raise UserError("--points", repr(text), expected)
        v = units.parse(f"{speed} {unit}".strip(), "speed", "--points", above=0)
        points.append((v, units.parse(e, "restitution", "--points", least=0)))
    return tuple(points)
