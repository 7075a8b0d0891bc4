"""Judge of a run: its exit code, its one line of an error, and numbers of bouncing bodies."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from hcbench.terms.bounds import BOUNDS

_NOT_FINITE = re.compile(r"(?<![\w./-])[-+]?(?:nan|inf)(?![\w./-])")
_LARGEST_E = 1.0005
_ARE_TARGETS = ("restitution_linear", "restitution_standard_uncertainty", "off")


def faults(arguments: list[str], code: int, out: str, err: str) -> list[str]:
    """Faults of a run that ended; empty if all is as it should be."""
    found = []
    if "Traceback" in out + err:
        found.append("traceback")
    if "hcbench: unexpected" in err:
        found.append("unexpected")
    if code not in (0, 1, 2, 3):
        found.append(f"exit code {code}")
    if code in (2, 3) and not err.strip() and not out.strip():
        found.append("no message")
    if any(len(line) > 320 for line in err.splitlines() if line.startswith("hcbench: ")):
        found.append("a message of more than 320 characters")
    if code == 0 and "--help" not in arguments:
        found += list(_implausible(arguments, out))
    return found


def _implausible(arguments: list[str], out: str) -> Iterator[str]:
    if match := _NOT_FINITE.search(out):
        yield f"not finite: {out[max(0, match.start() - 60) : match.end() + 20]!r}"
    if "--json" not in arguments or "--beyond-bounds" in arguments:
        return
    try:
        content = json.loads(out)
    except ValueError:
        yield "not JSON"
        return
    gains = "gain" in out
    for path, value in _numbers(content):
        name = path.rpartition(".")[2]
        is_e = name.startswith("restitution") and not name.startswith(_ARE_TARGETS)
        if is_e and not gains and not -1e-9 <= value <= _LARGEST_E:
            yield f"{path} = {value}"
        for quantity, unit in (("speed", "m_per_s"), ("mass", "kg")):
            if quantity in name and unit in name and abs(value) > 1.2 * BOUNDS[quantity][1]:
                yield f"{path} = {value}"


def _numbers(content: Any, path: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(content, dict):
        for key, value in content.items():
            yield from _numbers(value, f"{path}.{key}")
    elif isinstance(content, list):
        for value in content:
            yield from _numbers(value, path)
    elif isinstance(content, int | float) and not isinstance(content, bool):
        yield path, float(content)
