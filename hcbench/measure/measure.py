"""`measure`: one call from a model to what it does, and why."""

from __future__ import annotations

import dataclasses
import os
import re
import runpy
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench._text import sanitized
from hcbench.errors import EngineFailed, HcbenchError, SceneError, UserError
from hcbench.laws.restitution import ConstantRestitution
from hcbench.measure.diagnose import diagnose, goal_of
from hcbench.measure.measurement import TOLERANCE, Measurement
from hcbench.measure.request import make_request
from hcbench.sim import registry, simulate
from hcbench.sim.model_under_test import Request
from hcbench.workers import WorkerDied, call

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.impact import Impact
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.sim.engine import Engine
    from hcbench.sim.model_under_test import ModelUnderTest

LIMIT_S = 60.0  # for one model, on a machine under load too: it takes a second or two
LEAST_MEMORY = 4 << 30  # bytes that any model may take
MEMORY_SHARE = 0.8  # of the machine's, beyond that
SO_MANY_STEPS = 500  # in contact: the phase of the touch is then worth a part in a thousand

_PYTHON = re.compile(r"(?P<file>.+\.py):(?P<function>[A-Za-z_]\w*)")


@dataclass(frozen=True, slots=True)
class Job:
    """One measurement. source: see `measure`; only files cross to the worker, objects stay here."""

    source: Any
    engine: str | None
    request: Request
    wanted: RestitutionCurve | None
    tolerance: float
    diagnose: bool


def measure(
    model: Any,
    pair: Sequence[str] | str | None = None,
    *,
    speeds: Any = None,
    phases: int | Sequence[float] | None = None,
    timestep: Any = None,
    gravity: Any = None,
    key: str | None = None,
    height: Any = None,
    engine: str | None = None,
    wanted: RestitutionCurve | float | None = None,
    tolerance: float = TOLERANCE,
    diagnose: bool = True,
    limit: float = LIMIT_S,
) -> Measurement:
    """Measure the bounce of a pair of the user's own model.

    model: a path to MJCF, URDF or MJB; two paths, for a pair of URDFs; "file.py:function", which returns a
        model; MJCF text; or an MjModel, MjSpec, or PyBullet world (`hcbench.measure.pybullet.World`).
        Files are measured in a process of their own; objects in this one, and left as they were.
    pair: names of two bodies or geoms (URDF: links or files), the moving one first; "a,b" or ("a", "b").
    speeds: launch speeds, m/s or text like "1:20 in/s".
    phases: how many, or which, of a time step; None: 4, and fewer where they cannot matter.
    timestep: s. gravity: m/s^2, a vector or a number along -z. key: keyframe. height: clearance, m.
    engine: "mujoco" or "pybullet"; None: by what the model is.
    wanted: e to hold it against, for the causes. tolerance: |e - wanted| from which causes are looked for.
    limit: s, after which a model in a file counts as hung.
    Raises UserError (and its kinds) with the reason for what cannot be measured, EngineFailed for an engine
    that crashed or hung on it.
    """
    request = make_request(pair, speeds, phases, timestep, gravity, key, height)
    goal = ConstantRestitution(wanted) if isinstance(wanted, int | float) else wanted
    return measure_job(Job(model, engine, request, goal, tolerance, diagnose), limit)


def measure_job(job: Job, limit: float = LIMIT_S) -> Measurement:
    """Measure: files in a worker process that may crash, hang or run out of memory; objects here."""
    source = _as_files(job.source)
    if source is None:
        model = _open(job.source, job.engine, job.request)
        return _measured(model, job.request, job.wanted, job.tolerance, job.diagnose)
    job = dataclasses.replace(job, source=source)
    try:
        return call(_in_worker, job, limit=limit)
    except WorkerDied as death:
        raise EngineFailed(
            "model",
            f"{_label(source)}: the engine's process was lost: {death.got}",
            "a model that runs",
            "A slow one gets more time by --limit",
        ) from None


def _label(source: str | tuple[str, ...]) -> str:
    parts = [source] if isinstance(source, str) else list(source)
    return sanitized("MJCF text" if parts[0].lstrip().startswith("<") else " + ".join(parts))


def _as_files(model: Any) -> str | tuple[str, ...] | None:
    """What crosses to the worker: paths or text; None for an object of an engine."""
    if isinstance(model, str):
        return model
    if isinstance(model, Path):
        return str(model)
    if isinstance(model, list | tuple) and model and all(isinstance(part, str | Path) for part in model):
        return tuple(str(part) for part in model)
    return None


def _in_worker(job: Job) -> Measurement:
    with _memory_limit():
        try:
            model = _open(job.source, job.engine, job.request)
            return _measured(model, job.request, job.wanted, job.tolerance, job.diagnose)
        except MemoryError:
            needs = f"{_label(job.source)} needs more than {_memory() >> 30} GiB of memory"
            raise EngineFailed("model", needs, "a model that fits") from None
        except HcbenchError:
            raise
        except Exception as error:
            words = f"{_label(job.source)}: {type(error).__name__}: {sanitized(error)}"
            raise EngineFailed("model", words, "a model that the engine can run") from error


def _memory() -> int:
    """Bytes that a model may take, whatever the machine: an engine reserves more than it uses."""
    try:
        there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return LEAST_MEMORY
    return max(LEAST_MEMORY, int(MEMORY_SHARE * there))


@contextmanager
def _memory_limit() -> Iterator[None]:
    """Hold this process to `_memory` more than it has, where the system knows such a limit."""
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except (ImportError, OSError):
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = pages * resource.getpagesize() + _memory()
    limits = [wanted] + [x for x in (soft, hard) if x != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min(limits), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _open(source: Any, engine: str | None, request: Request) -> ModelUnderTest:
    again = None
    if isinstance(source, str) and (match := _PYTHON.fullmatch(source)):
        again = partial(_call_python, match["file"], match["function"])
        source = again()
    return _engine_for(source, engine).open(source, request, again)


def _engine_for(source: Any, name: str | None) -> Engine:
    """The engine of that name, or the first that opens such a model."""
    engines = [registry.engine(known) for known in registry.names()]
    able = [engine for engine in engines if engine.suffixes or engine.opens]
    if name is not None:
        for engine in able:
            if engine.name == name:
                return engine
        raise UserError("engine", repr(name), " or ".join(engine.name for engine in able))
    for engine in able:
        if engine.accepts(source):
            return engine
    files = ", ".join(suffix for engine in able for suffix in engine.suffixes)
    if isinstance(source, str | Path):
        is_there = "is not the name of a model file" if Path(source).exists() else "is not there"
        raise SceneError("model", f"{source} {is_there}", f"a model file: {files}")
    objects = ", ".join(words for engine in able for words in engine.opens)
    raise UserError("model", f"a {type(source).__name__}", f"a path, {objects}")


def _call_python(file: str, name: str) -> Any:
    """What the function of a Python file returns."""
    path = Path(file)
    if not path.is_file():
        raise UserError("model", f"{path} is not there", "a Python file")
    try:
        function = runpy.run_path(str(path))[name]
    except KeyError:
        raise UserError("model", f"{path} has no {name!r}", "the name of a function in it") from None
    except (HcbenchError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        raise UserError("model", f"{path}: {type(error).__name__}: {error}", "a file that runs") from None
    try:
        made = function()
    except (HcbenchError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        words = f"{path}:{name}: {type(error).__name__}: {error}"
        raise UserError("model", words, "a function without arguments that returns a model") from None
    if made is None:
        raise UserError("model", f"{path}:{name} returned None", "an MjModel, an MjSpec, or a PyBullet World")
    return made


def _impacts(model: ModelUnderTest, request: Request) -> list[Impact]:
    """All launches; of a request that skips redundant phases only those that can differ."""
    launches = request.launches()
    if not request.thrifty:
        return simulate.impacts_in(model, launches)
    each = len(request.phases)
    impacts = []
    for i, impact in enumerate(simulate.impacts_in(model, launches[::each])):
        more = launches[i * each + 1 : (i + 1) * each] if impact.samples < SO_MANY_STEPS else []
        impacts += [impact, *simulate.impacts_in(model, more)]
    return impacts


def _measured(
    model: ModelUnderTest, request: Request, wanted: RestitutionCurve | None, tolerance: float, why: bool
) -> Measurement:
    with model:
        impacts = _impacts(model, request)
        facts = model.facts()
        goal = goal_of(facts.asked, request.speeds, wanted)
        causes, remedy = diagnose(model, impacts, goal, wanted, tolerance) if why else ((), "")
    return Measurement(facts, request, tuple(impacts), wanted, causes, remedy)
