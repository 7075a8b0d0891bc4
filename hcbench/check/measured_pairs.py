"""Measured pairs (v, e) from a CSV with the unit of v in its header: `speed [in/s],restitution`."""

import csv
import io
import math
import re
from pathlib import Path

from hcbench import units
from hcbench._files import read_text
from hcbench._text import sanitized
from hcbench.errors import QuantityError, UserError

MOST = 500
_LARGEST = 1 << 20  # bytes
_NAMED = re.compile(r"\s*(?P<name>[^\[\](){}]*?)\s*[\[({]\s*(?P<unit>[^\])}]*?)\s*[\])}]\s*")
_RESTITUTION = ("e", "cor", "restitution", "coefficient of restitution")
_EXAMPLE = "Begin the file with a line like: speed [m/s],restitution"


def read_pairs(path: Path) -> tuple[tuple[float, float], ...]:
    """Pairs (v m/s, e) from a file, speeds rising. Separators: comma, semicolon or tab; # begins a comment.

    Raises UserError with the file, the line, what it has and what was expected.
    """
    try:
        text = read_text(path, "utf-8-sig", _LARGEST)
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        raise UserError("pairs", f"{path}: {why}", f"a CSV file of up to {MOST} pairs") from None
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    lines = [(n, line) for n, line in lines if not line.lstrip().startswith("#")]
    if not lines:
        raise UserError("pairs", f"{path} is empty", "a header and at least one pair", _EXAMPLE)
    separator = next((s for s in (";", "\t", ",") if s in lines[0][1]), ",")
    rows = [(n, next(csv.reader(io.StringIO(line), delimiter=separator))) for n, line in lines]
    speed_at, unit = _header(path, rows[0][1])
    pairs = dict[float, float]()
    for n, cells in rows[1:]:
        where = f"{path}, line {n}"
        if len(cells) != 2:
            raise UserError("pairs", f"{where}: {len(cells)} cells", "2")
        for cell in (cells[speed_at], cells[1 - speed_at]):
            if not math.isfinite(_float(cell)):
                raise UserError("pairs", f"{where}: {sanitized(cell.strip())!r}", "a number")
        speed = units.parse(f"{_float(cells[speed_at])!r} {unit}", "speed", where)
        e = _float(cells[1 - speed_at])
        if not speed > 0:
            raise UserError("pairs", f"{where}: speed {speed:g} m/s", "above 0")
        if not 0 <= e <= 1:
            raise UserError("pairs", f"{where}: restitution {e:g}", "0 ... 1")
        if speed in pairs:
            raise UserError("pairs", f"{where}: {speed:.6g} m/s stands there twice", "each speed once")
        pairs[speed] = e
    if not pairs:
        raise UserError("pairs", f"{path} has a header and no pairs", "at least one")
    if len(pairs) > MOST:
        raise UserError("pairs", f"{path} has {len(pairs)} pairs", f"up to {MOST}")
    return tuple(sorted(pairs.items()))


def _header(path: Path, cells: list[str]) -> tuple[int, str]:
    """(column of the speed, its unit)."""
    if len(cells) != 2:
        raise UserError("pairs", f"{path}: {len(cells)} columns", "2: speed and restitution", _EXAMPLE)
    names = [_NAMED.fullmatch(cell) for cell in cells]
    bare = [cell.strip().lower() for cell in cells]
    is_e = [
        b in _RESTITUTION or bool(m and m["name"].lower() in _RESTITUTION)
        for b, m in zip(bare, names, strict=True)
    ]
    at = 1 if is_e[0] and not is_e[1] else 0
    match = names[at]
    if not any(math.isnan(_float(cell)) for cell in cells):
        raise UserError("pairs", f"{path} has no header", "the unit of the speed in one", _EXAMPLE)
    if match is None or not match["unit"]:
        got = f"{path}: the header {sanitized(cells[at].strip())!r} names no unit"
        raise UserError("pairs", got, "a unit of speed", _EXAMPLE)
    try:
        units.parse(f"1 {match['unit']}", "speed", "pairs")
    except QuantityError:
        got = f"{path}: {sanitized(match['unit'])!r} is not a unit of speed"
        raise UserError("pairs", got, "m/s, in/s or the like", _EXAMPLE) from None
    return at, match["unit"]


def _float(text: str) -> float:
    """NaN for what is no number."""
    try:
        return float(text)
    except ValueError:
        return math.nan
