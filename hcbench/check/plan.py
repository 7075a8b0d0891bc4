"""From what a user asks to a `Check`: names, units and files are looked at before anything runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench import units
from hcbench._text import sanitized
from hcbench.check.baseline import read_baseline
from hcbench.check.model import MAX_DRIFT, MAX_ERROR, Check
from hcbench.check.pairs import read_pairs
from hcbench.errors import QuantityError, UserError
from hcbench.laws.restitution import ConstantRestitution, MeasuredRestitution, Restitution
from hcbench.measure.measure import LIMIT_S
from hcbench.measure.request import make_request

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.impact import Floats
    from hcbench.laws.restitution import Reading, RestitutionCurve

_LONGEST = 1e6  # s


@dataclass(frozen=True, slots=True)
class Ask:
    """One check as a user writes it: text with units, plain numbers SI, None for what was left out.

    models: a file, two files, or "file.py:function". At most one of alpha, restitution, pairs (a CSV) and
    baseline. reading: "law" for e of eq. (16), "linear" for 1 - α v.
    """

    models: tuple[str, ...]
    name: str | None = None
    pair: str | Sequence[str] | None = None
    alpha: Any = None
    reading: Reading = "law"
    restitution: Any = None
    pairs: Path | None = None
    baseline: Path | None = None
    max_error: Any = None
    speeds: Any = None
    phases: int | Sequence[float] | None = None
    timestep: Any = None
    gravity: Any = None
    key: str | None = None
    height: Any = None
    engine: str | None = None
    limit: Any = None


def plan(ask: Ask) -> Check:
    """The check. Raises UserError, and its kinds, for what cannot be meant."""
    name = sanitized(ask.name if ask.name is not None else " + ".join(Path(m).name for m in ask.models))
    given = [k for k in ("alpha", "restitution", "pairs", "baseline") if getattr(ask, k) is not None]
    if len(given) > 1:
        raise UserError(name, f"{' and '.join(given)} are given", "one thing to hold the model against")
    wanted = _wanted(ask)
    baseline = None if ask.baseline is None else read_baseline(ask.baseline, name)
    speeds = ask.speeds
    if isinstance(wanted, MeasuredRestitution):
        if speeds is None:
            speeds = wanted.speeds.tolist()
        else:
            _require_inside(units.parse_values(speeds, "speed", "speeds"), wanted)
    phases = ask.phases
    if baseline is not None:
        phases = list(dict.fromkeys(launch.phase for launch, _, _ in baseline.impacts))
    request = make_request(ask.pair, speeds, phases, ask.timestep, ask.gravity, ask.key, ask.height)
    default = MAX_ERROR if baseline is None else MAX_DRIFT
    max_error = default if ask.max_error is None else units.parse(ask.max_error, "number", "max-error")
    if not 0 <= max_error <= 1:
        raise QuantityError("max-error", f"{max_error:g}", "0 ... 1, a difference in e")
    limit = LIMIT_S if ask.limit is None else units.parse(ask.limit, "timestep", "limit")
    if not 0 < limit <= _LONGEST:
        raise QuantityError("limit", f"{limit:g} s", "above 0 s")
    source = ask.models[0] if len(ask.models) == 1 else tuple(ask.models)
    return Check(name, source, request, wanted, baseline, max_error, ask.engine, limit)


def _wanted(ask: Ask) -> RestitutionCurve | None:
    if ask.alpha is not None:
        return Restitution(units.parse(ask.alpha, "alpha", "alpha"), ask.reading)
    if ask.restitution is not None:
        return ConstantRestitution(units.parse(ask.restitution, "number", "restitution"))
    if ask.pairs is not None:
        return MeasuredRestitution(read_pairs(ask.pairs))
    return None


def _require_inside(speeds: Floats, pairs: MeasuredRestitution) -> None:
    low, high = pairs.speeds[0], pairs.speeds[-1]
    outside = [v for v in speeds.tolist() if not low <= v <= high]
    if outside:
        raise UserError(
            "speeds", f"{outside[0]:g} m/s", f"within the measured pairs, {low:g} ... {high:g} m/s"
        )
