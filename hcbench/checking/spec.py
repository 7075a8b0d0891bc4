"""A check as a user writes it, on the command line, in a file or in a test, and what is to be run for it."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast

from pydantic import BeforeValidator, ConfigDict, StrictBool

from hcbench import units
from hcbench._text import sanitized
from hcbench.checking.baseline import Baseline, read_baseline
from hcbench.checking.measured_pairs import read_pairs
from hcbench.errors import QuantityError, UserError
from hcbench.fields import FileTable, mistake
from hcbench.impact import Floats
from hcbench.laws.restitution import (
    ConstantRestitution,
    MeasuredRestitution,
    Reading,
    Restitution,
    RestitutionCurve,
)
from hcbench.measuring.measure import LONGEST_LIMIT_S
from hcbench.measuring.request import make_request
from hcbench.sim.model_under_test import Request

MAX_ERROR = 0.02
MAX_DRIFT = 1e-4  # of e from a baseline: far above rounding, far below what anybody sees


def _no_truth_value(value: Any) -> Any:
    """The value, of NumPy or not; true and false are no numbers, alone or in a list."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if any(isinstance(each, bool) for each in (value if isinstance(value, list | tuple) else [value])):
        raise mistake("a number, or text with a unit")
    return value


# What a baseline says of launches: fields of a check, and of a request.
_LAUNCHES = {"speeds": "speeds", "phases": "phases", "height": "height", "angle": "angles", "spin": "spin"}
_Plain = BeforeValidator(_no_truth_value)
Quantity = Annotated[float | str, _Plain]  # in SI, or text with a unit
Quantities = Annotated[float | str | list[float | str], _Plain]


class SharedSpec(FileTable):
    """What several checks may share. None: left out. limit: time after which a model counts as hung."""

    model_config = ConfigDict(
        alias_generator=lambda name: name.removeprefix("coming_").replace("_", "-"), populate_by_name=True
    )

    max_error: Quantity | None = None
    speeds: Quantities | None = None
    phases: Annotated[int | list[float], _Plain] | None = None
    timestep: Quantity | None = None
    gravity: Quantities | None = None
    key: str | None = None
    height: Quantity | None = None
    qpos: str | None = None
    state: Path | None = None
    coming_from: str | None = None  # "from" in files
    actuators: StrictBool = True
    angle: Quantities | None = None
    along: Quantities | None = None
    spin: Quantities | None = None
    engine: str | None = None
    limit: Quantity | None = None


class CheckSpec(SharedSpec):
    """One check: text with units, or plain numbers in SI.

    model: a file, two files, or "file.py:function". At most one of alpha, restitution, pairs (a CSV) and
    baseline. reading: "law" for e of eq. (16), "linear" for 1 - α v.
    """

    model: str | tuple[str, ...]
    name: str | None = None
    pair: str | tuple[str, ...] | None = None
    alpha: Quantity | None = None
    reading: str = "law"
    restitution: Quantity | None = None
    pairs: Path | None = None
    baseline: Path | None = None

    @property
    def models(self) -> tuple[str, ...]:
        """The files."""
        return (self.model,) if isinstance(self.model, str) else self.model


@dataclass(frozen=True, slots=True)
class Check:
    """One model held against one thing: `wanted` or `baseline`; neither: only measured, for a new baseline.

    source: as in `measure`.
    max_error: largest |e - wanted| allowed at any speed and phase. limit: s, after which it counts as hung;
    None: as `measure` has it.
    """

    name: str
    source: Any
    request: Request
    wanted: RestitutionCurve | None
    baseline: Baseline | None
    max_error: float
    engine: str | None
    limit: float | None

    @property
    def against(self) -> str:
        """What the model is held against, in words."""
        if self.baseline is not None:
            return f"the baseline of {self.baseline.engine} {self.baseline.version}"
        return self.wanted.description if self.wanted is not None else "nothing: measured only"

    @property
    def allowed(self) -> float:
        """Largest error allowed; NaN where there is nothing to err against."""
        return math.nan if self.wanted is None and self.baseline is None else self.max_error


def plan(spec: CheckSpec) -> Check:
    """Look at names, units and files before anything runs. Raises UserError, and its kinds."""
    if spec.reading != "law" and spec.alpha is None:
        raise UserError("target", f"{spec.reading!r}, a reading of α", "an α beside it")
    name = sanitized(spec.name if spec.name is not None else " + ".join(Path(m).name for m in spec.models))
    against = [k for k in ("alpha", "restitution", "pairs", "baseline") if getattr(spec, k) is not None]
    if len(against) > 1:
        raise UserError(name, f"{' and '.join(against)} are given", "one thing to hold the model against")
    wanted = _wanted(spec)
    speeds = spec.speeds
    if isinstance(wanted, MeasuredRestitution):
        if speeds is None:
            speeds = wanted.speeds.tolist()
        else:
            _require_inside(units.parse_values(speeds, "speed", "speeds"), wanted)
    request = make_request(
        spec.pair,
        speeds,
        spec.phases,
        spec.timestep,
        spec.gravity,
        spec.key,
        spec.height,
        qpos=spec.qpos,
        state=spec.state,
        coming_from=spec.coming_from,
        actuators=spec.actuators,
        angle=spec.angle,
        along=spec.along,
        spin=spec.spin,
    )
    baseline = None if spec.baseline is None else read_baseline(spec.baseline, name)
    if baseline is not None:
        request = _as_written(baseline, request, spec)
    source = spec.models[0] if len(spec.models) == 1 else spec.models
    max_error = read_max_error(spec.max_error, MAX_ERROR if baseline is None else MAX_DRIFT)
    return Check(name, source, request, wanted, baseline, max_error, spec.engine, read_limit(spec.limit))


def _as_written(baseline: Baseline, request: Request, spec: CheckSpec) -> Request:
    """The request with the launches of a baseline. Raises UserError where others were asked for."""
    written = baseline.request(request)
    for name, field in _LAUNCHES.items():
        asked, has = getattr(request, field), getattr(written, field)
        if getattr(spec, name) is not None and asked != has:
            raise UserError(name, f"other launches than the baseline's, which has {has}", "those, or none")
    return written


def read_max_error(value: Quantity | None, default: float = MAX_ERROR) -> float:
    """The largest error allowed. Raises QuantityError outside 0 ... 1."""
    if value is None:
        return default
    max_error = units.parse(value, "number", "max-error")
    if not 0 <= max_error <= 1:
        raise QuantityError("max-error", f"{max_error:g}", "0 ... 1, a difference in e")
    return max_error


def read_limit(value: Quantity | None) -> float | None:
    """The time after which a model counts as hung, s; None where nobody says. Raises QuantityError."""
    if value is None:
        return None
    limit = units.parse(value, "timestep", "limit")
    if not 0 < limit <= LONGEST_LIMIT_S:
        raise QuantityError("limit", f"{limit:g} s", f"above 0 s, up to {LONGEST_LIMIT_S:g} s")
    return limit


def _wanted(spec: CheckSpec) -> RestitutionCurve | None:
    if spec.alpha is not None:
        alpha, uncertainty = units.parse_uncertain(spec.alpha, "alpha", "alpha")
        return Restitution(alpha, cast("Reading", spec.reading), uncertainty)
    if spec.restitution is not None:
        return ConstantRestitution(units.parse(spec.restitution, "number", "restitution"))
    if spec.pairs is not None:
        return MeasuredRestitution(read_pairs(spec.pairs))
    return None


def _require_inside(speeds: Floats, pairs: MeasuredRestitution) -> None:
    low, high = pairs.speeds[0], pairs.speeds[-1]
    outside = [v for v in speeds.tolist() if not low <= v <= high]
    if outside:
        raise UserError(
            "speeds", f"{outside[0]:g} m/s", f"within the measured pairs, {low:g} ... {high:g} m/s"
        )
