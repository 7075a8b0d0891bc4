"""`measure` and `pairs`: calls from a user's model to its restitution over speed, and to its pairs."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeGuard, TypeVar, Unpack

from hcbench.catalogue.target import target_material
from hcbench.laws.restitution import RestitutionCurve
from hcbench.measuring.contact import contact_in, contact_over_steps
from hcbench.measuring.curve import impacts_of
from hcbench.measuring.diagnose import diagnose, goal_of
from hcbench.measuring.measurement import TOLERANCE, Cause, Measurement, Wanted
from hcbench.measuring.request import (
    call_python,
    is_python,
    make_request,
    read_limit,
    request_for,
)
from hcbench.measuring.rest import ANY_REST, RestLimits, at_rest, rest_causes
from hcbench.sim import registry
from hcbench.sim.capabilities import OpensModels
from hcbench.sim.engine import Engine
from hcbench.sim.model_under_test import (
    CandidatePair,
    Facts,
    ModelUnderTest,
    Request,
    as_records,
    as_table,
)
from hcbench.sim.packages import EXPAND_XACRO
from hcbench.sim.remote import interpreter_of
from hcbench.system.errors import EngineFailed, HcbenchError, SceneError, UserError
from hcbench.system.process import memory_limit
from hcbench.system.text import Shown, sanitized
from hcbench.terms.arguments import checked
from hcbench.terms.bounds import admits_beyond_bounds, beyond_bounds, require
from hcbench.terms.impact import Impact, Status
from hcbench.terms.options import (
    BodyPair,
    Folders,
    Joints,
    LaunchOptions,
    MaterialName,
    ModelSource,
    PoseState,
    Quantity,
)
from hcbench.workers import WorkerDied, begin, call

# `measure`: one call from a user's model to its restitution over speed, and the causes of its
# errors.

Answer = TypeVar("Answer")

# Least time limit of one model, s: on an idle machine a model takes a second or two.
LIMIT_S = 60.0
# Memory that any model may take, bytes.
LEAST_MEMORY = 4 << 30
# A model may take this share of the machine's memory if that is more than LEAST_MEMORY.
MEMORY_SHARE = 0.8
_FROM_USD = "Isaac Sim's URDF exporter makes a URDF of a USD file"


@dataclass(frozen=True, slots=True)
class Job:
    """One measurement: a model, the launches and what they are held against.

    source: see `measure`; only files cross to the worker, objects stay here.
    engine: name of one; None: the first that opens such a model.
    request: the pair, its pose and the launches.
    wanted: the target e(v), None for none.
    tolerance: error of e from which causes are looked for, if `diagnose`.
    beyond_bounds: whether numbers beyond physical bounds are admitted.
    rest: limits of the pair at rest; None: not measured.
    contact: whether to measure what the contact means.
    """

    source: Any
    engine: str | None
    request: Request
    wanted: RestitutionCurve | None
    tolerance: float
    diagnose: bool
    beyond_bounds: bool = field(default=False, kw_only=True)
    rest: RestLimits | None = field(default=None, kw_only=True)
    contact: bool = field(default=False, kw_only=True)


@checked
def measure(
    model: ModelSource,
    pair: BodyPair | None = None,
    *,
    engine: str | None = None,
    material: MaterialName | None = None,
    alpha: Quantity | None = None,
    restitution: Quantity | None = None,
    points: Sequence[tuple[float, float]] = (),
    tolerance: float = TOLERANCE,
    diagnose: bool = True,
    rest: bool = True,
    contact: bool = False,
    limit: Quantity | None = None,
    **launch: Unpack[LaunchOptions],
) -> Measurement:
    """Measure how a pair bounces in your own model, as `hcbench measure` does.

    Parameters
    ----------
    model : path, text or object
        A path to MJCF, URDF or MJB; two paths, for a pair of URDFs; MJCF text; "file.py:function", which
        returns a model; or an object that an engine opens (`Engine.opens`), such as a compiled model, or an
        environment or client in the pose that it is in. hcbench measures files in a process of their own,
        objects in this one, and leaves them as they were.
    pair : text or two names, optional
        Two bodies or geoms (URDF: links or files), first the one that moves; "a,b" or ("a", "b").
    engine : text, optional
        The name of one; the first that opens such a model by default.
    material, alpha, restitution, points : optional
        At most one target: a pair of materials that `materials` lists; α, s/m or with a unit; one e for
        all speeds; or pairs of impact speed, m/s, and e.
    tolerance : float
        |e - target| from which hcbench looks for causes, if `diagnose`.
    rest : bool
        Whether hcbench measures the pair at rest, too.
    contact : bool
        Whether hcbench measures what the contact means in a robot's words, too: its stiffness and damping,
        the loads that it carries, friction, landings, and the largest stable step.
    limit : float, text or quantity of Pint's, optional
        Time, s, after which a model in a file counts as hung; 60 s, or what the engine takes to compile.
    **launch
        Speeds, pose and all else of the launches, as `LaunchOptions` describes them.

    Returns
    -------
    Measurement
        e over impact speed in `curve`, and `causes` of a difference from the target; `contact` where you
        asked for it.

    Raises
    ------
    UserError
        With the reason for what cannot be measured.
    EngineFailed
        For an engine that crashed or hung on it.

    Examples
    --------
    >>> import hcbench as hb
    >>> found = hb.measure("ball.xml", "ball,plate", speeds="0.2:1:3 m/s", restitution=0.9)
    >>> [round(point.restitution, 2) for point in found.curve]
    [0.9, 0.9, 0.9]

    """
    require("tolerance", tolerance, 0 <= tolerance <= 1, "0 ... 1, a difference in e")
    goal = None
    known = target_material(
        material, alpha=alpha, restitution=restitution, points=tuple(points) or None
    )
    if known is not None:
        goal = known.curve()
    elif alpha is not None or restitution is not None or points:
        goal = Wanted(alpha, restitution, points)
    most = None
    if rest:
        most = RestLimits() if diagnose else ANY_REST
    request = request_for(make_request(pair, **launch), launch.get("speeds"), known)
    job = Job(
        source=model,
        engine=engine,
        request=request,
        wanted=goal,
        tolerance=tolerance,
        diagnose=diagnose,
        rest=most,
        contact=contact,
    )
    return run_job(_measured, job, read_limit(limit))


def measure_job(job: Job, limit: float | None = None) -> Measurement:
    """Measure one pair, in a worker for a model in a file.

    limit: s of the clock, after which the worker counts as hung; None: LIMIT_S of processor time,
    or the engine's own where that is longer.
    Raises EngineFailed where the worker died or hung; UserError and SceneError for a model that
    does not open or a pair that cannot be measured.
    """
    return run_job(_measured, job, limit)


def run_job(work: Callable[[Job], Answer], job: Job, limit: float | None) -> Answer:
    """Return `work(job)`: for a model in files called in a worker process, which may crash, hang or
    run out of memory; for an object called here.

    limit: s of the clock, after which the worker counts as hung; None: LIMIT_S of processor time,
    or the engine's own where that is longer.

    Raises EngineFailed where the worker died or hung, and what `work` raises.
    """
    source = _as_files(job.source)
    if source is None:
        return work(job)
    name = job.engine
    engine = None
    where = None
    # The function of a Python file is called in the worker: only there is the model known.
    if name is not None or not is_python(source):
        engine = _engine_for(source, name)
        name = engine.name
        where = interpreter_of(engine)
    # A time that the user gives is one by the clock. The default leaves a busy machine more.
    longest = limit or math.inf
    limit = limit or max(LIMIT_S, getattr(engine, "limit", 0.0))
    try:
        job = replace(job, source=source, engine=name, beyond_bounds=admits_beyond_bounds())
        answer: Answer = call(_in_worker, work, job, limit=limit, longest=longest, at=where)
        return answer
    except WorkerDied as death:
        got = f"{_label(source)}: the engine's process was lost: {death.got}"
        advice = "A slow one gets more time by --limit"
        raise EngineFailed("model", got, "a model that runs", advice) from None


def begin_measuring(models: Sequence[str], engine: Any) -> None:
    """Let a worker process of a command import what measuring these files takes, as a copy of this
    process, which reads on. Without files, and for a TOML file or a missing one, nothing begins.

    models: paths.
    engine: name of one; None for the first that opens them. An error is not raised here, but where
    the model is opened. An engine in an environment of its own is not begun.
    """
    first = Path(models[0] if models else "")
    if not first.is_file() or first.suffix.lower() == ".toml" or "@" in str(engine):
        return
    # The error is raised again where the model is needed.
    with suppress(HcbenchError):
        opener = _engine_for(_as_files(tuple(models)), engine)
        if interpreter_of(opener) is None:
            begin(__name__, "prepare", opener.name)


def prepare(name: str) -> None:
    """Import what measuring in an engine of this name takes; in a worker, ahead of its first job."""
    registry.submodule(name, "model.under_test")
    if (backend := registry.adapter(name).backend) is not None:
        backend.module()


def _as_files(model: Any) -> str | tuple[str, ...] | None:
    """The path or text of a model, or a tuple of several paths, which can be sent to a worker; None
    for an object of an engine.

    A list of one file is that file.
    """
    if isinstance(model, list | tuple) and len(model) == 1:
        # One file is opened by the engine of its kind, not by one that opens several files.
        model = model[0]
    if isinstance(model, str | Path):
        return str(model)
    if (
        isinstance(model, list | tuple)
        and model
        and all(isinstance(part, str | Path) for part in model)
    ):
        return tuple(map(str, model))
    return None


def _label(source: str | tuple[str, ...]) -> str:
    """The name of a model in messages: its paths, or "MJCF text"."""
    parts = [source] if isinstance(source, str) else source
    if parts[0].lstrip().startswith("<"):
        return sanitized("MJCF text")
    return sanitized(" + ".join(parts))


def _in_worker(work: Callable[[Job], Answer], job: Job) -> Answer:
    """Return `work(job)`, in the worker process, within the memory that a model may take.

    Raises HcbenchErrors of `work` as they are; UserError for names that are not in UTF-8;
    EngineFailed for any other error, and for a model that needs more memory.
    """
    try:
        with memory_limit(_memory()), beyond_bounds(job.beyond_bounds):
            return work(job)
    except MemoryError:
        needs = f"{_label(job.source)} needs more than {_memory() >> 30} GiB of memory"
        raise EngineFailed("model", needs, "a model that fits") from None
    except HcbenchError:
        raise
    # Engines take files in any encoding, and some hand out names as text.
    except UnicodeDecodeError as error:
        got = f"{_label(job.source)} has the byte {error.object[error.start]:#x}, not UTF-8"
        raise UserError("model", got, "names in UTF-8", "Save the file as UTF-8") from None
    except Exception as error:
        reason = f"{_label(job.source)}: {type(error).__name__}: {sanitized(error)}"
        raise EngineFailed("model", reason, "a model that the engine can run") from error


def _measured(job: Job) -> Measurement:
    """Measure the pair of a job: launch it, lay it down, look for causes of what is not as wanted,
    and find what its contact means, where the job asks for that.

    Raises UserError for a pair that cannot be opened, or that never touched if no cause was found;
    EngineFailed for an engine that fails on it.
    """
    request = job.request
    causes: tuple[Cause, ...] = ()
    # What is left with all causes fixed, a sentence.
    remedy = ""
    engine, source, rebuild = source_of(job)
    with engine.open(source, request, rebuild) as model:
        impacts = impacts_of(model, request)
        facts = model.facts()
        is_as_chosen = _is_as_chosen(facts, impacts, job.wanted)
        if facts.promise is not None:
            facts = replace(facts, notes=(facts.promise.note(impacts), *facts.notes))
        # Measured before the trials, which end what a user's function made.
        rest, suspects = at_rest(model, job.rest, impacts)
        contact = contact_in(model, request) if job.contact else None
        if job.diagnose and not is_as_chosen:
            goal = goal_of(facts.asked, request.speeds, job.wanted)
            causes, remedy = diagnose(model, impacts, goal, job.wanted, job.tolerance)
        of_rest = rest_causes(model, rest, job.rest, suspects)
    if not causes:
        _require_touch(impacts, facts)
    # Landings and other steps need the model anew: after it is closed.
    if contact is not None:

        def at_step(timestep: float) -> ModelUnderTest:
            """The same pair at another step, s."""
            again = rebuild() if rebuild else source
            return engine.open(again, replace(request, timestep=timestep), rebuild)

        contact = replace(contact, peaks=engine.landing_peaks(source, request))
        contact = contact_over_steps(contact, request, facts.timestep, at_step)
    return Measurement(
        facts=facts,
        request=request,
        impacts=tuple(impacts),
        wanted=job.wanted,
        causes=causes,
        remedy=remedy,
        rest=rest,
        rest_causes=of_rest,
        contact=contact,
    )


def _is_as_chosen(facts: Facts, impacts: Sequence[Impact], wanted: RestitutionCurve | None) -> bool:
    """True if hcbench wrote this contact, nothing that it promised by has changed, the impacts keep
    its promise, and the user wants no other e(v): then there are no causes to look for.

    impacts: of the model, held against the promise.
    wanted: the target, None for none.
    """
    promise = facts.promise
    if promise is None or facts.changed:
        return False
    has_e = any(impact.is_measured for impact in impacts)
    return has_e and promise.is_kept(impacts) and wanted in (None, promise.curve)


def _require_touch(impacts: Sequence[Impact], facts: Facts) -> None:
    """Raise UserError with what stopped the launches where none arrived."""
    if any(impact.status is not Status.NO_TOUCH for impact in impacts):
        return
    got = f"{' and '.join(map(sanitized, facts.pair))} never touched: {impacts[0].reason}"
    advice = "Start from another --key or --qpos, from another side (--from), or faster (--speeds)"
    raise UserError("pair", got, "a launch that arrives", advice)


def _memory() -> int:
    """Bytes that a model may take on any machine: an engine reserves more than it uses."""
    try:
        installed = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return LEAST_MEMORY
    return max(LEAST_MEMORY, int(MEMORY_SHARE * installed))


def source_of(job: Job) -> tuple[OpensModels, Any, Callable[[], Any] | None]:
    """Find the engine that opens the model of a job.

    Returns the engine, the model, and a function that makes the model again; None in its place for
    a model that can be opened again as it is.
    A source "file.py:function" is called here, once, and its result is the model.
    Raises UserError where that fails, where no engine opens the model or the engine that is named
    does not open models; SceneError for a file that no engine opens.
    """
    source = job.source
    rebuild = None
    if isinstance(source, str) and is_python(source):
        rebuild = partial(call_python, source)
        for engine in _openers():
            engine.make_room()
        source = rebuild()
    return _engine_for(source, job.engine), source, rebuild


def _engine_for(source: Any, name: str | None) -> OpensModels:
    """The engine of that name, or for None the first that opens such a model.

    source: paths, text or an object.
    Raises UserError for a name that is not that of an engine that opens models, and for an object
    that no engine opens; SceneError for a file that no engine opens.
    """
    if name is not None:
        if registry.base_name(name) in registry.names():
            opener = registry.engine(name)
            if _opens(opener):
                return opener
        raise UserError(
            "engine", repr(name), f"one of: {', '.join(engine.name for engine in _openers())}"
        )
    # Only engines that open such a model are asked for their version, which takes time.
    for each in registry.names():
        adapter = registry.adapter(each)
        if _opens(adapter) and adapter.accepts(source):
            engine = registry.engine(each)
            if _opens(engine):
                return engine
    if isinstance(source, str | Path):
        raise _model_file_error(source)
    got = f"a {type(source).__name__}"
    if source is None:
        got = "a function that returned None"
    raise UserError("model", got, f"a path, {_objects()}")


def _model_file_error(source: str | Path) -> SceneError:
    """The error to raise for a path that no engine opens, with advice by its suffix.

    source: the path; the file need not exist.
    """
    # A dict keeps each suffix once, in order.
    suffixes: dict[str, None] = {}
    for engine in _openers():
        suffixes |= dict.fromkeys(engine.suffixes)
    reason = "is not the name of a model file" if Path(source).exists() else "is not there"
    suffix = Path(source).suffix.lower()
    advice = ""
    if suffix.startswith(".usd"):
        advice = _FROM_USD
    elif suffix == ".xacro":
        advice = EXPAND_XACRO
    return SceneError("model", f"{source} {reason}", f"a model file: {', '.join(suffixes)}", advice)


def _openers() -> Iterator[OpensModels]:
    """The engines that open models of users, each imported when it is its turn."""
    return filter(_opens, map(registry.engine, registry.names()))


def _opens(engine: Engine) -> TypeGuard[OpensModels]:
    return isinstance(engine, OpensModels) and bool(engine.suffixes or engine.opens)


def _objects() -> str:
    return ", ".join(words for engine in _openers() for words in engine.opens)


# `hcbench.pairs`: which parts of a user's model can meet.


@dataclass(frozen=True, repr=False)
class CandidatePairs(Shown):
    """The parts of a model that can meet: those that touch first, then the nearest."""

    pairs: tuple[CandidatePair, ...]

    def __iter__(self) -> Iterator[CandidatePair]:
        return iter(self.pairs)

    def __len__(self) -> int:
        return len(self.pairs)

    def __getitem__(self, number: int) -> CandidatePair:
        return self.pairs[number]

    def _lines(self) -> list[str]:
        return as_table(self.pairs).splitlines()

    def _rows(self) -> list[dict[str, Any]]:
        return as_records(self.pairs)


@checked
def pairs(
    model: ModelSource,
    *,
    engine: str | None = None,
    limit: Quantity | None = None,
    key: str | None = None,
    qpos: Joints | None = None,
    state: PoseState | None = None,
    package: Folders | None = None,
) -> CandidatePairs:
    """List which parts of your model can meet, and which do, as `hcbench pairs` does.

    Parameters
    ----------
    model, engine, limit, key, qpos, state, package
        As `measure` takes them.

    Returns
    -------
    CandidatePairs
        A sequence; `pair` of each is what `measure`, `tune` and `check` take. Effective masses are in kg,
        distances in m.

    Raises
    ------
    UserError
        With the reason for a model that cannot be opened.

    Examples
    --------
    >>> import hcbench as hb
    >>> [(each.pair, each.touching) for each in hb.pairs("ball.xml")]
    [('geom:ball,plate', False)]

    """
    request = make_request(None, key=key, qpos=qpos, state=state, package=package)
    job = Job(model, engine, request, None, TOLERANCE, diagnose=False)
    return CandidatePairs(tuple(list_pairs(job, read_limit(limit))))


def list_pairs(job: Job, limit: float | None = None) -> list[CandidatePair]:
    """List the parts of the model that can meet; those that touch at the start first."""
    return run_job(_listed, job, limit)


def _listed(job: Job) -> list[CandidatePair]:
    engine, source, rebuild = source_of(job)
    return engine.pairs(source, job.request, rebuild)
