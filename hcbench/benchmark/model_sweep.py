"""Sweeps of a user's model: rows of contact parameters are measured, and written as a Parquet dataset.

A part is a pure function of its rows and of the model, and one file, named by a digest of them. A
file that is there is not measured again; files appear whole or not at all. So any number of
processes, on any machines, may write to one folder, and a sweep that ended goes on.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from hcbench.benchmark.plan import versions_here
from hcbench.benchmark.run import imap_unordered, workers_for
from hcbench.benchmark.shard import Timeouts
from hcbench.benchmark.store import DESCRIPTION, GO_ON, OF_A_MODEL, open_files, output_errors
from hcbench.benchmark.tables import digest, metadata_in, parquet, require_parquet
from hcbench.benchmark.vary import TIMESTEP, read_parameters, read_shard, rows_of
from hcbench.measuring.curve import curve_of, impacts_of
from hcbench.measuring.measure import LIMIT_S, Job, run_job, source_of
from hcbench.measuring.request import is_python, make_request, read_limit
from hcbench.measuring.rest import ANY_REST
from hcbench.sim import registry
from hcbench.sim.capabilities import VariesContacts
from hcbench.sim.remote import interpreter_of
from hcbench.system.errors import CannotRun, UserError
from hcbench.system.files import json_text, parse_json
from hcbench.system.outputs import input_files
from hcbench.system.text import sanitized
from hcbench.terms.bounds import admits_beyond_bounds, beyond_bounds
from hcbench.terms.records import CURVE_POINT, REST, keys, record
from hcbench.workers import map_surviving_crashes, use_own_worker

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from concurrent.futures import Executor
    from contextlib import AbstractContextManager

    from hcbench.benchmark.store import Files
    from hcbench.sim.capabilities import VariedContact
    from hcbench.sim.model_under_test import Facts, Request
    from hcbench.terms.impact import Floats, Launch
    from hcbench.terms.options import BodyPair, LaunchOptions, Quantity

SCHEMA = 1
PART_ROWS = 100
# Of each point of `measure`: a sweep has no target.
_POINT = tuple(f for f in CURVE_POINT if f.name not in ("target", "error", "error_worst_phase"))
# Columns of the pair at rest.
_REST = tuple(f"rest_{key}" for key in keys(REST))
_COLUMN_OF = {TIMESTEP: "timestep_s"}
# Key of a file's metadata: what came of its rows.
_COUNTS = "hcbench.counts"


@dataclass(frozen=True, slots=True)
class _SweepJob(Job):
    """Properties that all parts of a sweep have in common.

    names: of the parameters.
    files: digest of the model.
    versions: of what the bytes depend on.
    """

    names: tuple[str, ...] = ()
    files: str = ""
    versions: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class SweepPart:
    """Some rows of parameters, which are measured together.

    first: number of the first row in the sweep.
    rows: (n, number of parameters).
    name: of the file.
    """

    job: _SweepJob
    first: int
    rows: Floats
    name: str

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class ModelSweep:
    """State of a sweep, or of its shard.

    rows: of parameters, measured until now.
    of: all.
    parts: files written by this sweep.
    there: files that were there when it began.
    damaged: names of those that were cut short and are measured again.
    points: speeds (and angles) of all rows.
    without_e: those without an e, of rows that were refused or crashed the engine, too.
    lowest, highest: e of all points.
    """

    rows: int
    of: int
    parts: int = 0
    there: int = 0
    damaged: tuple[str, ...] = ()
    points: int = 0
    without_e: int = 0
    lowest: float = math.inf
    highest: float = -math.inf

    def with_part(self, rows: int, content: bytes) -> ModelSweep:
        """The state with one more file.

        rows: of parameters, in the file.
        content: bytes of the file, whose metadata have its counts.
        Raises ValueError, OSError or KeyError where it is cut short.
        """
        counts = json.loads(metadata_in(content)[_COUNTS])
        return replace(
            self,
            rows=self.rows + rows,
            points=self.points + counts["points"],
            without_e=self.without_e + counts["without_e"],
            lowest=min(self.lowest, counts["lowest"]),
            highest=max(self.highest, counts["highest"]),
        )


def sweep_model(
    model: str | Path,
    pair: BodyPair | None,
    vary: Sequence[str],
    folder: str | Path,
    *,
    samples: int | None = None,
    seed: int = 0,
    shard: str = "1/1",
    part_rows: int = PART_ROWS,
    rest: bool = False,
    engine: str | None = None,
    limit: Quantity | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    executor: Executor | None = None,
    progress: Callable[[ModelSweep], None] | None = None,
    **launch: Unpack[LaunchOptions],
) -> ModelSweep:
    """Measure a pair of a user's model under rows of contact parameters, into a folder (a path, or
    an URL that fsspec opens).

    model, pair, engine, limit, launch: as `measure` takes them; the model is a file, MJCF text or
    "FILE.py:FUNCTION".
    vary: "NAME=VALUES" of each parameter, as `read_parameter` reads it.
    samples: rows to draw at random, from `seed`; None: the grid.
    shard: "3/20" measures each 20th part, from the third on.
    part_rows: rows in a file.
    rest: whether to measure the pair at rest, too.
    jobs, scheduler, executor: as `benchmark.run.sweep` takes them.
    progress: called at the start and after each part.

    However it ends, killed included, the files in the folder are whole, and the same call goes on.
    Raises UserError for what the model, the options or the folder ask wrongly, before anything is
    written; CannotRun where pyarrow is missing or the workers fail; OutputError where the folder
    cannot be written.
    """
    require_parquet()
    number, shards = read_shard(shard)
    if part_rows < 1:
        raise UserError("part-rows", str(part_rows), "1 or more")
    parameters = read_parameters(vary)
    rows = rows_of(parameters, samples, seed)
    files = open_files(os.fspath(folder))
    source = _source(model)
    job = _SweepJob(
        source=source,
        engine=engine,
        request=make_request(pair, **launch),
        wanted=None,
        tolerance=0.0,
        diagnose=False,
        rest=ANY_REST if rest else None,
        names=tuple(parameter.name for parameter in parameters),
        files=_model_digest(source),
        beyond_bounds=admits_beyond_bounds(),
    )
    seconds = read_limit(limit)
    facts = run_job(partial(_tried, row=rows[0].tolist()), job, seconds)
    job = replace(job, engine=engine or facts.engine)
    job = replace(job, versions=tuple(sorted(versions_here(job.engine or "").items())))
    described = _described(job, facts, rows, part_rows)
    every = _parts(job, rows, part_rows, described)
    with _output_errors(files):
        there = _begin(files, described, {part.name for part in every})
    now, missing = _state_of(files, every[number::shards], there)
    report = progress or (lambda _: None)
    report(now)
    if not missing:
        return now
    least = getattr(registry.engine(facts.engine), "limit", 0.0)
    timeouts = Timeouts(start=seconds or max(LIMIT_S, least))
    with workers_for(executor, scheduler, jobs) as workers:
        for part, content in imap_unordered(workers, measure_part, missing, timeouts):
            with _output_errors(files):
                _require_ours(files, described)
                files.write(part.name, content)
            now = replace(now.with_part(len(part.rows), content), parts=now.parts + 1)
            report(now)
    return now


def _source(model: object) -> str:
    """A model as every worker finds it: an absolute path, "FILE.py:FUNCTION", or MJCF text.

    Raises UserError for an object, which no other process can open.
    """
    if not isinstance(model, str | Path):
        expected = "a file, MJCF text or FILE.py:FUNCTION, which workers can open"
        raise UserError("model", f"a {type(model).__name__}", expected)
    is_text = isinstance(model, str) and model.lstrip().startswith("<")
    return str(model) if is_text else str(Path(model).absolute())


def _model_digest(source: str) -> str:
    """A digest of a model's text, or of its file and all files that it names.

    Of contents alone, so that a model may lie in another folder on another machine.
    """
    contents = [hashlib.sha256(path.read_bytes()).hexdigest() for path in input_files(source)]
    function = source.rpartition(":")[2] if is_python(source) else ""
    text = source if not contents else function
    return digest("\n".join([text, *sorted(contents)]).encode())


def _tried(job: Job, row: Sequence[float]) -> Facts:
    """Open the model with a row of parameters, in a worker; return its facts.

    Raises UserError where the engine cannot vary its contacts or has no such parameter, and as
    `VariedContact.open`.
    """
    assert isinstance(job, _SweepJob)
    varied = _varied(job)
    for name in job.names:
        if name not in (TIMESTEP, *varied.parameters):
            raise UserError("vary", name, f"one of: {', '.join((*varied.parameters, TIMESTEP))}")
    with varied.open(*_launch(job, row)) as model:
        return model.facts()


def _varied(job: _SweepJob) -> VariedContact:
    """The model of a job, to be opened with any row. Raises UserError where its engine does not
    vary contacts.
    """
    engine, source, rebuild = source_of(job)
    if not isinstance(engine, VariesContacts):
        some = [name for name in registry.names() if _varies(name)]
        raise UserError("engine", repr(engine.name), f"one that varies contacts: {', '.join(some)}")
    return engine.varied(source, job.request, rebuild)


def _varies(name: str) -> bool:
    return isinstance(registry.adapter(name), VariesContacts)


def _launch(job: _SweepJob, row: Sequence[float]) -> tuple[Request, dict[str, float]]:
    """The launches of a row, and its parameters of the contact."""
    values = dict(zip(job.names, row, strict=True))
    timestep = values.pop(TIMESTEP, job.request.timestep)
    return replace(job.request, timestep=timestep), values


def _described(job: _SweepJob, facts: Facts, rows: Floats, part_rows: int) -> dict[str, Any]:
    """The content of the folder's description: equal for sweeps whose parts are equal.

    facts: of the model and its pair.
    rows: of all parts, (n, parameters).
    part_rows: rows a part.
    """
    launches = {name: value for name, value in asdict(job.request).items() if value is not None}
    return {
        "schema": SCHEMA,
        "kind": OF_A_MODEL,
        "model": facts.model,
        "files": job.files,
        "engine": job.engine,
        "versions": dict(job.versions),
        "pair": list(facts.pair),
        "launches": launches,
        "at_rest": job.rest is not None,
        "parameters": list(job.names),
        "rows": len(rows),
        "rows_digest": digest(rows.tobytes()),
        "rows_in_a_part": part_rows,
    }


def _parts(
    job: _SweepJob, rows: Floats, size: int, described: Mapping[str, Any]
) -> list[SweepPart]:
    """All parts of a sweep, in order, each of `size` rows or, the last, fewer.

    rows: of parameters, (n, parameters).
    described: as of `_described`.
    """
    common = {name: value for name, value in described.items() if not name.startswith("rows")}
    prefix = json_text(common)
    parts = []
    for first in range(0, len(rows), size):
        own = rows[first : first + size]
        number = digest(f"{prefix}{first}:".encode() + own.tobytes())
        name = f"part-{first:08d}-{number}.parquet"
        parts.append(SweepPart(job, first, own, name))
    return parts


def _output_errors(files: Files) -> AbstractContextManager[None]:
    expected = "room for it in a folder that can be read and written to"
    return output_errors(files.where, expected, GO_ON)


def _begin(files: Files, described: Mapping[str, Any], wanted: set[str]) -> set[str]:
    """Make the folder that of a sweep, or see that it is; return the names of its parts that are
    there.

    described: as of `_described`.
    wanted: names of all its parts.
    Raises UserError for a folder of other files, and for one of another sweep.
    """
    files.require_folder()
    names = files.names()
    content = json_text(described)
    if DESCRIPTION in names:
        difference = _other_model_sweep(files.read(DESCRIPTION), content)
        if difference:
            got = f"{files.where} holds another sweep: {difference}"
            advice = "Take another folder, or what that sweep was begun with"
            raise UserError("folder", got, "the same model, parameters and versions", advice)
    strangers = [name for name in names if name not in wanted and not name.startswith(("_", "."))]
    if strangers:
        got = f"{files.where} holds {strangers[0]!r}, no part of this sweep"
        raise UserError("folder", got, "an empty or a new folder", "pandas would read it too")
    if DESCRIPTION not in names:
        files.write(DESCRIPTION, content.encode())
    return wanted.intersection(names)


def _state_of(
    files: Files, parts: Sequence[SweepPart], there: set[str]
) -> tuple[ModelSweep, list[SweepPart]]:
    """The state of a sweep when it begins, and its parts that are missing or cut short.

    there: names of the files in the folder.
    """
    now = ModelSweep(rows=0, of=sum(len(part.rows) for part in parts))
    missing: list[SweepPart] = []
    for part in parts:
        if part.name not in there:
            missing.append(part)
            continue
        with _output_errors(files):
            content = files.read(part.name)
        try:
            now = replace(now.with_part(len(part.rows), content), there=now.there + 1)
        except (ValueError, OSError, KeyError):
            missing.append(part)
            now = replace(now, damaged=(*now.damaged, part.name))
    return now, missing


def _require_ours(files: Files, described: Mapping[str, Any]) -> None:
    """Raise CannotRun where another sweep began in the folder at the same moment as this one, and
    wrote its description last.
    """
    difference = _other_model_sweep(files.read(DESCRIPTION), json_text(described))
    if difference:
        got = f"{files.where} was taken by another sweep: {difference}"
        raise CannotRun("folder", got, "a folder for each sweep", "Take another folder")


def _other_model_sweep(there: bytes, here: str) -> str:
    """The first difference between two sweeps of a model, in words; "" for none.

    there, here: their descriptions as JSON: in the folder, which may be damaged, and as asked for.
    """
    try:
        old = parse_json(there)
    except ValueError:
        old = {}
    if not isinstance(old, dict):
        old = {}
    return _first_difference(old, parse_json(here))


def _first_difference(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """The first entry of two tables that differs, in words, by its name in the innermost table; ""
    for none.
    """
    for name in dict.fromkeys((*new, *old)):
        before = old.get(name)
        value = new.get(name)
        if before == value:
            continue
        words = sanitized(name.replace("_", " "))
        if isinstance(before, dict) and isinstance(value, dict):
            return f"{words}: {_first_difference(before, value)}"
        return f"{words} {sanitized(f'{before!r:.60} instead of {value!r:.60}')}"
    return ""


def measure_part(part: SweepPart, timeouts: Timeouts) -> bytes:
    """Measure the rows of a part in a worker process; return the bytes of its file.

    They depend on the part alone, and in the last digits on the kind of processor.

    timeouts: `start` is the processor time of one row, s. A row on which the engine crashes or
    hangs has the status "crashed", with the reason.
    Raises CannotRun where versions or the model's files are not those that the sweep was planned
    with, and UserError where the model cannot be opened.
    """
    use_own_worker()
    job = part.job
    engine = registry.engine(job.engine or "")
    _require_same(job)
    measured = map_surviving_crashes(
        _measured_rows,
        part.rows.tolist(),
        job,
        lost=lambda _, reason: [_without_e("crashed", reason)],
        limit=timeouts.start,
        at=interpreter_of(engine),
    )
    return _table(part, measured)


def _require_same(job: _SweepJob) -> None:
    """Raise CannotRun where this machine has other versions or another model."""
    here = versions_here(job.engine or "")
    other = [name for name, version in job.versions if here.get(name) != version]
    if other:
        planned = dict(job.versions)
        got = ", ".join(f"{name} {here.get(name, 'none')}" for name in other)
        expected = ", ".join(f"{name} {planned[name]}" for name in other)
        raise CannotRun("worker", f"has {got}", expected, "Install the same everywhere")
    if _model_digest(job.source) != job.files:
        got = f"{sanitized(job.source)} is not there, or not the same"
        advice = "Keep the model where every machine sees it under the same path"
        raise CannotRun("worker", got, "the model that the sweep was planned with", advice)


def _measured_rows(
    rows: Sequence[Sequence[float]], job: _SweepJob
) -> Iterator[list[dict[str, Any]]]:
    """Yield the records of each row: one for each speed and angle."""
    with beyond_bounds(job.beyond_bounds):
        varied = _varied(job)
        for row in rows:
            yield _measured(varied, job, row)


def _measured(varied: VariedContact, job: _SweepJob, row: Sequence[float]) -> list[dict[str, Any]]:
    """The points that `measure` prints of the model with a row's parameters.

    varied: the model, whose pair can be changed.
    row: values of the job's parameters. One record without an e, with its reason, where the row is
    refused or the engine fails.
    """
    request, values = _launch(job, row)
    try:
        with varied.open(request, values) as model:
            impacts = impacts_of(model, request)
            lies = model.at_rest() if job.rest else None
    except UserError as error:
        return [_without_e("refused", str(error))]
    except Exception as error:
        return [_without_e("crashed", f"{type(error).__name__}: {error}")]
    at_rest: dict[str, Any] = dict.fromkeys(_REST, math.nan)
    if lies is not None:
        at_rest = dict(zip(_REST, record(REST, lies).values(), strict=True))
    reasons: dict[Launch, str] = {}
    for impact in impacts:
        if not impact.is_measured:
            reasons.setdefault(impact.launch.at_any_phase, impact.reason)
    places = dict.fromkeys(impact.launch.at_any_phase for impact in impacts)
    points = []
    for place, point in zip(places, curve_of(impacts), strict=True):
        status = "failed" if math.isnan(point.restitution) else "measured"
        # A launch at one phase may have failed although others have an e.
        reason = reasons.get(place, "")
        points.append({**record(_POINT, point), **at_rest, "status": status, "reason": reason})
    return points


def _without_e(status: str, reason: str) -> dict[str, Any]:
    """The record of a row that has no point."""
    nothing: dict[str, Any] = dict.fromkeys((*keys(_POINT), *_REST), math.nan)
    return {**nothing, "samples": 0, "failed": 0, "status": status, "reason": reason}


def _table(part: SweepPart, measured: Sequence[list[dict[str, Any]]]) -> bytes:
    """Encode what was measured as the bytes of a file: one row for each point, with the number of
    its row of parameters, these, and the results. The metadata have counts of the points and the
    range of e.

    measured: the records of each row of parameters.
    """
    job = part.job
    results = [f.key for f in _POINT if job.request.is_oblique or not f.oblique]
    if job.rest:
        results += _REST
    results += ["status", "reason"]
    names = ["row"]
    for parameter in job.names:
        name = _COLUMN_OF.get(parameter, parameter)
        # A parameter may have the name of what is measured.
        if name in results:
            name += "_set"
        names.append(name)
    names += results
    columns: dict[str, list[Any]] = {name: [] for name in names}
    for number, (row, points) in enumerate(
        zip(part.rows.tolist(), measured, strict=True), part.first
    ):
        for point in points:
            values = (number, *row, *(point[name] for name in results))
            for column, value in zip(columns.values(), values, strict=True):
                column.append(value)
    e = np.array(columns["restitution"])
    known = e[np.isfinite(e)]
    counts = {
        "points": len(e),
        "without_e": len(e) - len(known),
        "lowest": float(known.min(initial=math.inf)),
        "highest": float(known.max(initial=-math.inf)),
    }
    metadata = {_COUNTS: json.dumps(counts).encode()}
    return parquet([columns], list(columns), metadata)
