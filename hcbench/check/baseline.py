"""A baseline: the bounce of a model as it was when it was good, to hold later ones against."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hcbench.errors import UserError
from hcbench.impact import Launch, Status

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from hcbench.measure.measurement import Measurement

SCHEMA = 1
KIND = "hcbench baseline"


@dataclass(frozen=True, slots=True)
class Baseline:
    """One check's measured bounce. impacts: (launch, status, e), e NaN where there was none."""

    engine: str
    version: str
    timestep: float
    impacts: tuple[tuple[Launch, str, float], ...]

    @property
    def speeds(self) -> tuple[float, ...]:
        """Launch speeds, in order."""
        return tuple(dict.fromkeys(launch.speed for launch, _, _ in self.impacts))


def write_baseline(path: Path, measured: Mapping[str, Measurement]) -> None:
    """Write what was measured, by the names of the checks, whole or not at all."""
    from hcbench._files import json_text, write_text

    content = {
        "schema": SCHEMA,
        "kind": KIND,
        "checks": {name: _record(found) for name, found in sorted(measured.items())},
    }
    write_text(path, json_text(content))


def _record(found: Measurement) -> dict[str, Any]:
    facts = found.facts
    return {
        "engine": facts.engine,
        "version": facts.version,
        "timestep_s": facts.timestep,
        "impacts": [
            {
                "speed_m_per_s": i.launch.speed,
                "phase": i.launch.phase,
                "height_m": i.launch.height,
                "status": i.status.value,
                "restitution": i.restitution,
            }
            for i in found.impacts
        ],
    }


def read_baseline(path: Path, name: str) -> Baseline:
    """What a baseline file says of one check. Raises UserError for a file of another kind or schema, for one
    that was damaged, and for a check that is not in it.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        todo = "Write one with --write-baseline"
        raise UserError("baseline", f"{path}: {error.strerror}", "a file", todo) from None
    except ValueError:
        raise UserError("baseline", f"{path} is not JSON", "what --write-baseline wrote") from None
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise UserError("baseline", f"{path} is no baseline", "what --write-baseline wrote")
    if content.get("schema") != SCHEMA:
        raise UserError(
            "baseline",
            f"{path} has schema {content.get('schema')!r}",
            f"schema {SCHEMA}",
            "Write it again with this version of hcbench",
        )
    checks = content.get("checks")
    checks = checks if isinstance(checks, dict) else {}
    record = checks.get(name)
    if record is None and len(checks) == 1:  # one model: its name may have changed
        (record,) = checks.values()
    if record is None:
        known = ", ".join(map(str, checks)) or "none"
        raise UserError("baseline", f"{path} has nothing on {name!r}", f"one of: {known}")
    try:
        return _parsed(record)
    except (KeyError, TypeError, ValueError, AttributeError):
        raise UserError(
            "baseline", f"{path}: the record of {name!r} is damaged", "what was written"
        ) from None


def _parsed(record: Mapping[str, Any]) -> Baseline:
    impacts: Sequence[Mapping[str, Any]] = record["impacts"]
    parsed = []
    for entry in impacts:
        speed, phase, height = float(entry["speed_m_per_s"]), float(entry["phase"]), entry["height_m"]
        e = math.nan if entry["restitution"] is None else float(entry["restitution"])
        if not (0 < speed < math.inf and 0 <= phase < 1):
            raise ValueError("launch")
        launch = Launch(speed, phase, None if height is None else float(height))
        parsed.append((launch, Status(entry["status"]).value, e))
    if not parsed:
        raise ValueError("impacts")
    return Baseline(str(record["engine"]), str(record["version"]), float(record["timestep_s"]), tuple(parsed))
