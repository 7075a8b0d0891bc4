"""Measured pairs (v, e) from a CSV with the unit of v in its header: `speed [in/s],restitution`."""

from __future__ import annotations

import csv
import io
import math
import re
from typing import TYPE_CHECKING

from hcbench import units
from hcbench._text import sanitized
from hcbench.errors import QuantityError, UserError

if TYPE_CHECKING:
    from pathlib import Path

MOST = 500
_LARGEST = 1 << 20  # bytes
_NAMED = re.compile(r"\s*(?P<name>[^\[\](){}]*?)\s*[\[({]\s*(?P<unit>[^\])}]*?)\s*[\])}]\s*")
_RESTITUTION = ("e", "cor", "restitution", "coefficient of restitution")
_EXAMPLE = "Begin the file with a line like: speed [m/s],restitution"


def read_pairs(path: Path) -> tuple[tuple[float, float], ...]:
    """(v m/s, e) from a file, in order of speed. Separators: comma, semicolon or tab; # begins a remark.

    Raises UserError that names the file, the line, what stood there and what should.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise UserError("pairs", f"{path} has more than {_LARGEST >> 20} MiB", f"up to {MOST} pairs")
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
        raise UserError("pairs", f"{path}: {why}", "a CSV file") from None
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    lines = [(n, line) for n, line in lines if not line.lstrip().startswith("#")]
    if not lines:
        raise UserError("pairs", f"{path} is empty", "a header and at least one pair", _EXAMPLE)
    separator = next((s for s in (";", "\t", ",") if s in lines[0][1]), ",")
    rows = [(n, next(csv.reader(io.StringIO(line), delimiter=separator))) for n, line in lines]
    speed_at, unit = _header(path, rows[0][1])
    pairs = dict[float, float]()
    for n, cells in rows[1:]:
        if len(cells) != 2:
            raise UserError("pairs", f"{path}, line {n}: {len(cells)} cells", "2")
        speed = _number(path, n, cells[speed_at])
        e = _number(path, n, cells[1 - speed_at])
        speed = units.parse(f"{speed!r} {unit}", "speed", f"{path}, line {n}")
        if not speed > 0:
            raise UserError("pairs", f"{path}, line {n}: speed {speed:g} m/s", "above 0")
        if not 0 <= e <= 1:
            raise UserError("pairs", f"{path}, line {n}: restitution {e:g}", "0 ... 1")
        if speed in pairs:
            raise UserError(
                "pairs", f"{path}, line {n}: {speed:.6g} m/s stands there twice", "each speed once"
            )
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
    if all(_is_number(cell) for cell in cells):
        raise UserError("pairs", f"{path} has no header", "the unit of the speed in one", _EXAMPLE)
    if match is None or not match["unit"]:
        raise UserError(
            "pairs",
            f"{path}: the header {sanitized(cells[at].strip())!r} names no unit",
            "a unit of speed",
            _EXAMPLE,
        )
    try:
        units.parse(f"1 {match['unit']}", "speed", "pairs")
    except QuantityError:
        raise UserError(
            "pairs",
            f"{path}: {sanitized(match['unit'])!r} is not a unit of speed",
            "m/s, in/s or the like",
            _EXAMPLE,
        ) from None
    return at, match["unit"]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(path: Path, line: int, text: str) -> float:
    if not _is_number(text) or not math.isfinite(float(text)):
        raise UserError("pairs", f"{path}, line {line}: {sanitized(text.strip())!r}", "a number")
    return float(text)
