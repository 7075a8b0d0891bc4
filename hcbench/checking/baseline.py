"""A baseline: the measured bounce of a model, stored so that later
versions can be compared with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    StrictFloat,
    ValidationError,
    model_validator,
)

from hcbench.measuring.measurement import Measurement
from hcbench.sim.model_under_test import Request
from hcbench.system.errors import QuantityError, UserError
from hcbench.system.files import is_file, json_text, parse_json, read_text
from hcbench.system.outputs import write_output
from hcbench.terms import units
from hcbench.terms.bounds import BOUNDS
from hcbench.terms.impact import FORMER_E, Launch, Status
from hcbench.terms.records import BASELINE_IMPACT, record

# Schema 1 has FORMER_E.
SCHEMA = 2
KIND = "hcbench baseline"
_KEYS = {field.name: field.key for field in BASELINE_IMPACT}
_Number = Annotated[StrictFloat, Field(allow_inf_nan=False)]


class BaselineImpact(BaseModel):
    """One impact by the keys of BASELINE_IMPACT; restitution NaN where
    there was none, null in the file.

    speed: at launch, m/s.
    phase: in a step, 0 to 1.
    height: of a drop, m, else None.
    slip, spin: at launch, m/s and rad/s, in the directions of `Launch`.
    """

    model_config = ConfigDict(frozen=True, defer_build=True, alias_generator=_KEYS.__getitem__)

    speed: _Number = Field(gt=0, le=BOUNDS["speed"][1])
    phase: _Number = Field(ge=0, lt=1)
    height: Annotated[_Number, Field(gt=0, le=BOUNDS["length"][1])] | None
    slip: tuple[_Number, _Number] = (0.0, 0.0)
    spin: tuple[_Number, _Number, _Number] = (0.0, 0.0, 0.0)
    status: Status
    restitution: Annotated[StrictFloat, BeforeValidator(lambda e: math.nan if e is None else e)]

    @model_validator(mode="after")
    def _require_restitution(self) -> Self:
        """Refuse an e where none was measured, and none where one was, by ValueError."""
        if self.status in (Status.PARTED, Status.RESTED):
            is_right = 0 <= self.restitution < math.inf
        else:
            is_right = math.isnan(self.restitution)
        if not is_right:
            raise ValueError("a restitution where one was measured, and only there")
        return self

    @property
    def launch(self) -> Launch:
        """The launch of the impact."""
        return Launch(self.speed, self.phase, self.height, self.slip, self.spin)


class Baseline(BaseModel):
    """One check's measured bounce."""

    model_config = ConfigDict(frozen=True, defer_build=True)

    engine: str
    version: str
    timestep_s: _Number = Field(gt=0, le=BOUNDS["timestep"][1])
    impacts: tuple[BaselineImpact, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _require_something_measured(self) -> Self:
        """Raise ValueError for a record without any e, for a launch that it has twice, and for
        launches that differ in more than speed, phase and angle: one request cannot make those.
        """
        first = self.impacts[0]
        launches = [impact.launch for impact in self.impacts]
        # One request has one height and one spin.
        sent = []
        for launch in launches:
            speed = launch.speed
            try:
                one = Launch.at_angle(launch.angle, speed, launch.phase, first.height, first.spin)
            except QuantityError as error:
                # A slip too fast for any angle. Pydantic takes a ValueError for damage.
                raise ValueError(str(error)) from None
            sent.append(one)
        if len(set(sent)) < len(sent) or sent != launches:
            raise ValueError("each launch once, and all of one request")
        if all(math.isnan(impact.restitution) for impact in self.impacts):
            raise ValueError("at least one restitution")
        return self

    def request(self, base: Request | None = None) -> Request:
        """`base` with the launches that were made; None for a request without other options.

        Each phase of the baseline is launched at each speed, also phases that only some speeds had.
        """
        first = self.impacts[0]
        # A dict keeps each value once, in order.
        speeds: dict[float, None] = {}
        phases: dict[float, None] = {}
        angles: dict[float, None] = {}
        for impact in self.impacts:
            speeds[impact.speed] = None
            phases[impact.phase] = None
            angles[impact.launch.angle] = None
        return replace(
            base or Request(),
            speeds=tuple(speeds),
            phases=tuple(phases),
            angle=tuple(angles),
            height=first.height,
            spin=first.spin,
            adapt_phases=False,
        )

    @property
    def by_launch(self) -> dict[Launch, BaselineImpact]:
        """The impact of each launch."""
        return {impact.launch: impact for impact in self.impacts}


def write_baseline(path: Path, measured: Mapping[str, Measurement], force: bool = False) -> None:
    """Write what was measured, by the names of the checks, whole or not at all."""
    records = {name: _record(measurement) for name, measurement in sorted(measured.items())}
    content = json_text({"schema": SCHEMA, "kind": KIND, "checks": records})
    write_output(path, content, "--write-baseline", force)


def _record(measurement: Measurement) -> dict[str, Any]:
    """A measurement for the file: engine, its version, step in s, and each impact.

    Raises Pydantic's ValidationError for what no baseline can have, such as no e at all.
    """
    facts = measurement.facts
    impacts = []
    for impact in measurement.impacts:
        columns = record(BASELINE_IMPACT, impact)
        impacts.append(BaselineImpact.model_validate(columns))
    return Baseline(
        engine=facts.engine,
        version=facts.version,
        timestep_s=facts.timestep,
        impacts=tuple(impacts),
    ).model_dump(exclude_defaults=True, by_alias=True)


def read_baseline(path: Path, name: str) -> Baseline:
    """The baseline of one check in a file.

    name: of the check; a file with one check has that one under any name.
    Raises UserError for a file that cannot be read, for one of another kind or schema, for one
    that was damaged, and for a check that is not among several.
    """
    try:
        content = parse_json(read_text(path))
    except OSError as error:
        advice = "Write one with --write-baseline"
        raise UserError("baseline", f"{path}: {error.strerror}", "a file", advice) from None
    except ValueError:
        raise UserError("baseline", f"{path} is not JSON", "what --write-baseline wrote") from None
    if not isinstance(content, dict) or content.get("kind") != KIND:
        raise UserError("baseline", f"{path} is not a baseline", "what --write-baseline wrote")
    schema = content.get("schema")
    if schema != SCHEMA:
        got = f"{path} has schema {schema!r}"
        if schema == 1:
            got += f", {FORMER_E}"
        advice = "Renew it: hcbench check MODEL --write-baseline FILE --force"
        raise UserError("baseline", got, f"schema {SCHEMA}", advice)
    checks = content.get("checks")
    if not isinstance(checks, dict):
        checks = {}
    entry = checks.get(name)
    # A file with one model: its name may have changed since.
    if entry is None and len(checks) == 1:
        (entry,) = checks.values()
    if entry is None:
        names = ", ".join(map(str, checks)) or "none"
        raise UserError("baseline", f"{path} has nothing on {name!r}", f"one of: {names}")
    try:
        return Baseline.model_validate(entry)
    except ValidationError:
        raise UserError(
            "baseline", f"{path}: the record of {name!r} is damaged", "what was written"
        ) from None


MOST = 500
Pairs = tuple[tuple[float, float], ...]


def read_pairs(path: Path) -> Pairs:
    """Pairs (v m/s, e) from a file, speeds rising: `speed [in/s],restitution`.

    The file is read as `fit` reads tables. Columns of uncertainties are left aside.
    Raises UserError with the file, the line, what it has and what was expected: for other columns,
    a speed not above 0 or given twice, an e outside 0 ... 1, and more than MOST pairs.
    """
    from hcbench.fitting.assumed import completed
    from hcbench.fitting.column_names import is_beside
    from hcbench.fitting.columns import columns_of
    from hcbench.fitting.sheets import read_sheets
    from hcbench.fitting.tables import tables_of

    if not path.exists() or path.is_dir():
        raise UserError("points", f"{str(path)!r:.80} is not a file", "a file of pairs (v, e)")
    # Of a workbook the first sheet counts, and its first table.
    sheet, *_ = read_sheets(path)
    first, *_ = tables_of(sheet)
    table, _ = completed(first, None)
    columns = columns_of(table)
    # The table has the speed by one of two names.
    role = "speed_in"
    if "speed" in columns.places:
        role = "speed"
    values = {name for name in columns.places if not name.startswith("u_")}
    # Columns of numbers with a name that means nothing here.
    has_others = False
    for i, (name, _) in enumerate(table.header):
        is_taken = i in columns.places.values()
        if not is_taken and table.has_number(i) and name and not is_beside(name):
            has_others = True
    if values != {role, "restitution"} or has_others:
        names = ", ".join(name for name, _ in columns.table.header)
        raise UserError(columns.table.name, f"columns {names}", "speed [m/s],restitution")
    speed = columns.get(role)
    e = columns.get("restitution")
    columns.require(role, speed > 0, "a speed above 0")
    columns.require("restitution", (e >= 0) & (e <= 1), "0 ... 1")
    columns.require(role, [v not in speed[:i] for i, v in enumerate(speed)], "each speed once")
    if len(speed) > MOST:
        raise UserError(columns.table.name, f"{len(speed)} pairs", f"up to {MOST}")
    return tuple(sorted(zip(speed.tolist(), e.tolist(), strict=True)))


def parse_points(text: str) -> Pairs:
    """Pairs (v m/s, e) from 'v:e, v:e unit' or from a CSV file with the columns speed and restitution.

    Raises UserError for text in neither form, QuantityError for its numbers and unit.
    """
    if is_file(text):
        return read_pairs(Path(text))
    points = []
    # The unit of all speeds stands behind the last e; others may be repeated behind theirs.
    _, _, last = text.rpartition(":")
    _, _, unit = last.strip().partition(" ")
    for pair in text.split(","):
        speed, colon, e = pair.strip().removesuffix(unit).strip().partition(":")
        if not colon:
            expected = "pairs like '0.1:0.95, 0.5:0.85 m/s' or a CSV file that exists"
            raise UserError("--points", repr(text), expected)
        v = units.parse(f"{speed} {unit}".strip(), "speed", "--points", above=0)
        points.append((v, units.parse(e, "restitution", "--points", least=0)))
    return tuple(points)
