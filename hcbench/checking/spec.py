"""A check: how a user writes it on the command line, in a file or in a
test, and the measurement it needs.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast, get_type_hints

from pydantic import BeforeValidator, ConfigDict, create_model, model_validator

from hcbench.checking.baseline import read_pairs
from hcbench.checking.outcome import Limit, read_limits
from hcbench.laws.restitution import (
    MeasuredRestitution,
    RestitutionCurve,
)
from hcbench.measuring.measurement import Wanted
from hcbench.measuring.request import make_request, read_limit, request_for
from hcbench.measuring.rest import RestLimits
from hcbench.sim.model_under_test import Request
from hcbench.system.errors import UserError
from hcbench.system.text import sanitized
from hcbench.terms import units
from hcbench.terms.fields import FileTable, mistake
from hcbench.terms.impact import Launch
from hcbench.terms.options import (
    LAUNCHES,
    OPTIONS,
    RENAMED,
    CheckOptions,
    LaunchOptions,
    Quantity,
    SharedOptions,
    hint_at,
)

if TYPE_CHECKING:
    from hcbench.checking.baseline import Baseline
    from hcbench.sim.landing import DropPlan

MAX_ERROR = 0.02
# Largest change of e from a baseline: far above round-off, far below what can be seen.
MAX_DRIFT = 1e-4


def _no_truth_value(value: Any) -> Any:
    """A number or text, converted from NumPy's types to Python's.

    Raises Pydantic's error of `mistake` for true and false, which Python would take for 1 and 0.
    """
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, bool):
        raise mistake("a number, or text with a unit")
    return value


_Number = Annotated[float | str, BeforeValidator(_no_truth_value)]
# Types of keys in a file, by their types in Python. Others, and those of launches, are read later.
_IN_FILES: dict[Any, Any] = {
    str | None: str | None,
    Quantity | None: _Number | None,
    str | Path | None: Path | None,
    Literal["law", "linear"]: str,
}


def _keys(declared: type) -> dict[str, Any]:
    """The keys of a table of a file, each with its type and default."""
    keys = {}
    for name, hint in get_type_hints(declared).items():
        in_file = Any if name in LAUNCHES else _IN_FILES.get(hint, Any)
        keys[name] = (in_file, OPTIONS[name].default)
    return keys


# Type checkers know no fields that are derived at run time.
if TYPE_CHECKING:
    _SharedTable = FileTable
else:
    _SharedTable = create_model("_SharedTable", __base__=FileTable, **_keys(SharedOptions))


class SharedSpec(_SharedTable):
    """Options that several checks may share, as `SharedOptions` states them."""

    model_config = ConfigDict(
        alias_generator=lambda name: OPTIONS[name].flag if name in OPTIONS else name,
        populate_by_name=True,
    )

    @property
    def launch(self) -> LaunchOptions:
        """The options of launches, as given."""
        return cast("LaunchOptions", {name: getattr(self, name) for name in LAUNCHES})


if TYPE_CHECKING:
    _CheckTable = SharedSpec
else:
    _CheckTable = create_model("_CheckTable", __base__=SharedSpec, **_keys(CheckOptions))


class CheckSpec(_CheckTable):
    """One check: text with units, or plain numbers in SI; its options
    as `CheckOptions` states them.

    model: a file, two files, or "file.py:function".
    """

    model: str | tuple[str, ...]
    name: str | None = None
    pair: str | tuple[str, ...] | None = None

    @model_validator(mode="before")
    @classmethod
    def _take_old_names(cls, fields: Any) -> Any:
        """The fields by their names of today; a FutureWarning for each old one."""
        if not isinstance(fields, dict):
            return fields
        named = dict(fields)
        for old in RENAMED.keys() & fields.keys():
            hint_at(old, RENAMED[old])
            named.setdefault(RENAMED[old], named.pop(old))
        return named

    if TYPE_CHECKING:

        def __init__(self, **fields: Any) -> None: ...

    @property
    def models(self) -> tuple[str, ...]:
        """The files of the models."""
        return (self.model,) if isinstance(self.model, str) else self.model

    @property
    def options(self) -> CheckOptions:
        """All options, as given."""
        return cast("CheckOptions", {name: getattr(self, name) for name in OPTIONS})


@dataclass(frozen=True, slots=True)
class Check:
    """One model compared with one target: `wanted` or `baseline`; neither: only measured, for a new
    baseline.

    source: a file, several, or an object, as in `measure`.
    engine: None for the first that opens it.
    request: the pair, its pose and the launches.
    targets: options that the user gave a target by.
    max_error: largest |e - wanted| allowed at any speed and phase.
    limit: s, after which it counts as hung; None: see `measure`.
    limits: on landings of a robot, which `drops` says how to drop, or on a recorded motion, the
    file `trajectory`; in place of a target for e.
    rest: limits of the pair at rest, None without.
    """

    name: str
    source: Any
    request: Request
    wanted: RestitutionCurve | None
    baseline: "Baseline | None"
    max_error: float
    engine: str | None
    limit: float | None
    limits: tuple[Limit, ...] = ()
    drops: "DropPlan | None" = None
    trajectory: Path | None = None
    rest: RestLimits | None = None
    targets: tuple[str, ...] = ()

    @property
    def against(self) -> str:
        """Phrase of the target that the model is compared with."""
        if self.limits:
            return ", ".join(limit.text for limit in self.limits)
        if self.rest is not None and self.wanted is None and self.baseline is None:
            return self.rest.text
        if self.baseline is not None:
            return f"the baseline of {self.baseline.engine} {self.baseline.version}"
        if self.wanted is None:
            return "nothing: measured only"
        return self.wanted.description

    @property
    def allowed(self) -> float:
        """Largest error allowed; NaN where there is nothing to err against."""
        return math.nan if self.wanted is None and self.baseline is None else self.max_error


def plan(spec: CheckSpec) -> Check:
    """Read names, units and files of a check before anything runs: its target, its launches, and its
    limits. The speeds are those of the target where that has some and the user gave none.

    Raises UserError for several targets, for options that exclude each other and for files that
    cannot be read; QuantityError for text that is not a quantity. The model is not opened.
    """
    options = spec.options
    name = _name(spec)
    targets = _targets(spec, name)
    wanted = _wanted(options)
    known = None
    if options["material"] is not None:
        from hcbench.catalogue.find import find

        known = find(options["material"])
        wanted = known.curve(options["target"])
    launch = spec.launch
    request = request_for(make_request(spec.pair, **launch), launch["speeds"], known)
    if known is None and isinstance(wanted, MeasuredRestitution):
        if launch["speeds"] is None:
            request = replace(request, speeds=tuple(wanted.speeds.tolist()))
        _require_inside(request.speeds, wanted)
    # A baseline has the launches that it was written with, and is held to a smaller error.
    baseline = None
    default_error = MAX_ERROR
    if options["baseline"] is not None:
        from hcbench.checking.baseline import read_baseline

        baseline = read_baseline(Path(options["baseline"]), name)
        request = _as_written(baseline, request, launch)
        default_error = MAX_DRIFT
    max_error = read_max_error(options["max_error"], default_error)
    trajectory: Path | None = None
    if options["trajectory"] is not None:
        trajectory = Path(options["trajectory"])
    limits, drops = _limits(options)
    limit = read_limit(options["limit"])
    rest = read_rest_limits(options["max_depth"], options["max_vibration"])
    if rest is not None and limits:
        raise UserError("require", "given with a limit at rest", "one of the two")
    source: str | tuple[str, ...] = spec.models
    if len(spec.models) == 1:
        source = spec.models[0]
    return Check(
        name=name,
        source=source,
        request=request,
        wanted=wanted,
        baseline=baseline,
        max_error=max_error,
        engine=options["engine"],
        limit=limit,
        limits=limits,
        drops=drops,
        trajectory=trajectory,
        rest=rest,
        targets=targets,
    )


def _name(spec: CheckSpec) -> str:
    """The name that a user gave, or the names of the model's files."""
    if spec.name is not None:
        return sanitized(spec.name)
    return sanitized(" + ".join(Path(model).name for model in spec.models))


def _targets(spec: CheckSpec, name: str) -> tuple[str, ...]:
    """Names of the options that give a target: at most one for e or limits, and those at rest.

    name: of the check.
    Raises UserError for more, and for a reading of α without an α.
    """
    has_alpha = spec.options["alpha"] is not None or spec.options["material"] is not None
    if spec.options["target"] != "law" and not has_alpha:
        got = f"{spec.options['target']!r} given without an α"
        raise UserError("target", got, "--alpha, which it reads")
    targets = ("material", "alpha", "restitution", "points", "baseline", "require")
    given = [target for target in targets if getattr(spec, target) is not None]
    if len(given) > 1:
        raise UserError(name, f"{' and '.join(given)} are given", "one target")
    at_rest = [name for name in ("max_depth", "max_vibration") if getattr(spec, name) is not None]
    return (*given, *at_rest)


def _limits(options: CheckOptions) -> "tuple[tuple[Limit, ...], DropPlan | None]":
    """Limits on landings or on a recorded motion, and how to drop the robot for the former.

    Without limits () and None; None for how to drop, too, where they are on a motion.
    Raises UserError for options of a drop or of a motion without limits, for both together, for a
    name that has no limit and for an unknown controller; QuantityError for a limit, a height or a
    tilt that is not such a quantity.
    """
    falls: dict[str, Any] = {name: options[name] for name in ("heights", "tilt", "controller")}
    given = {name: value for name, value in falls.items() if value is not None}
    is_of_motion = options["trajectory"] is not None
    if options["require"] is None:
        # Options that mean nothing without limits.
        of_limits = list(given)
        if is_of_motion:
            of_limits.append("trajectory")
        if of_limits:
            raise UserError(
                of_limits[0], "given without limits", "--require 'e < 0.3, slip < 5 mm' too"
            )
        return (), None
    if is_of_motion and given:
        first = next(iter(given))
        raise UserError("trajectory", f"given with {first}", "one of the two")
    limits = read_limits(options["require"], of_landing=not is_of_motion)
    if is_of_motion:
        return limits, None
    from hcbench.measuring.landing import make_drops

    return limits, make_drops(**given)


def _as_written(baseline: "Baseline", request: Request, given: LaunchOptions) -> Request:
    """The request with the launches of a baseline, so that both are of the same launches.

    given: the options of launches that the user wrote.
    Raises UserError where they mean other launches.
    """
    written = baseline.request(request)
    # A launch has its angle in fewer digits than a user's degrees in rad.
    angles = tuple(Launch.at_angle(angle, 1.0).angle for angle in request.angle)
    asked = replace(request, angle=angles)
    for name, value in given.items():
        has = getattr(written, name, None)
        if value is not None and has != getattr(asked, name, None):
            raise UserError(
                name, f"other launches than the baseline's: {_numbers(has)}", "those, or none"
            )
    return written


def _numbers(value: Any) -> str:
    """Numbers of a launch, SI, as a message has them: "0.5, 1"."""
    if isinstance(value, tuple):
        return ", ".join(map(_numbers, value))
    return "none" if value is None else f"{value:.6g}"


def read_max_error(value: Quantity | None, default: float = MAX_ERROR) -> float:
    """The largest error allowed. Raises QuantityError outside 0 ... 1."""
    if value is None:
        return default
    return units.parse_max_error(value)


def read_rest_limits(depth: Quantity | None, vibration: Quantity | None) -> RestLimits | None:
    """Limits of the penetration, m, and vibration, m/s, at rest; None where neither is limited.

    depth, vibration: numbers in SI, or text with units.
    Raises QuantityError for a value below 0 and for text that is not a quantity.
    """
    if depth is None and vibration is None:
        return None
    deepest = math.inf
    if depth is not None:
        deepest = units.parse(depth, "length", "max-depth", least=0.0)
    fastest = math.inf
    if vibration is not None:
        fastest = units.parse(vibration, "speed", "max-vibration", least=0.0)
    return RestLimits(deepest, fastest, of_user=True)


def _wanted(options: CheckOptions) -> RestitutionCurve | None:
    """The target e(v) of α, of one e or of a file of pairs; None without any.

    Raises UserError for an e outside 0 ... 1 and for a file that cannot be read as pairs,
    QuantityError for text that is not a quantity.
    """
    if options["points"] is not None:
        return MeasuredRestitution(read_pairs(Path(options["points"])))
    if options["alpha"] is None and options["restitution"] is None:
        return None
    return Wanted(options["alpha"], options["restitution"], reading=options["target"])


def _require_inside(speeds: Sequence[float], pairs: MeasuredRestitution) -> None:
    """Raise UserError for a speed, m/s, that is outside those of the pairs."""
    low = pairs.speeds[0]
    high = pairs.speeds[-1]
    for speed in speeds:
        if not low <= speed <= high:
            expected = f"within the measured pairs, {low:g} ... {high:g} m/s"
            raise UserError("speeds", f"{speed:g} m/s", expected)
