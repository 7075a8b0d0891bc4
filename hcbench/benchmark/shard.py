"""Simulates one shard, or one sequence of bounces, wherever it is sent.

An executor is given `run_jobs`, of `run_shard` or `run_bounces`, and nothing else. Engines run in
a worker process. Where that crashes in a batch of launches, they are run one by one; what then
fails is CRASHED, with the reason.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, TypeVar

from hcbench.benchmark.batch import Batch, BatchResult, result_of, run_batch, run_one_by_one
from hcbench.benchmark.bounce_sequence import Drop, Dropped, simulate_bounces
from hcbench.benchmark.plan import Inputs, Shard, digests_of, versions_here
from hcbench.benchmark.tables import ShardFiles, parquet, shard_files
from hcbench.sim import registry
from hcbench.sim.columns import Impacts
from hcbench.sim.remote import interpreter_of
from hcbench.system.errors import CannotRun, EngineFailed, SceneError, UserError
from hcbench.terms.impact import Impact, Status
from hcbench.terms.scene import Scene, load_scene
from hcbench.workers import call, map_surviving_crashes, use_own_worker

if TYPE_CHECKING:
    from hcbench.benchmark.tables import Encode

Job = TypeVar("Job")
Result = TypeVar("Result")

# Launches of a shard's first batch, which shows how long contacts last.
_FIRST = 64
# Steps in contact of a batch, at most: 16 MB of loops.
_SAMPLES = 500_000
# s for one step of a drop: hundreds of times what it takes.
_STEP_S = 1e-3
# Crashes in a row: all phases of a few speeds, which fail together.
_GIVE_UP = 32


@dataclass(frozen=True, slots=True)
class Timeouts:
    """Time limits of an engine, s: `start` for anything at all, `each` for each impact on top of
    that.

    each: None for 4 s at steps of 1 µs or more; below, inversely proportional to the step. A ball
    at rest takes 1 s.
    """

    start: float = 60.0
    each: float | None = None

    def limit(self, timestep: float, impacts: int) -> float:
        """Time, s, that a worker gets for `impacts` impacts with a step of `timestep` s."""
        each = 4.0 * max(1.0, 1e-6 / timestep) if self.each is None else self.each
        return self.start + each * impacts


def run_jobs(
    function: Callable[[Job, Timeouts], Result], jobs: Sequence[Job], timeouts: Timeouts
) -> tuple[list[Result], float]:
    """Apply a function to each job; return the results and the time that all of them took, s."""
    began = time.perf_counter()
    return [function(job, timeouts) for job in jobs], time.perf_counter() - began


def run_shard(shard: Shard, timeouts: Timeouts, encode: Encode = parquet) -> ShardFiles:
    """Simulate a shard in a worker process, and return the bytes of its files.

    encode: makes the bytes of a table.

    A launch on which the engine raises, crashes or hangs is an impact CRASHED, with the reason.
    Raises UserError for what the engine refuses, CannotRun where versions or files are not those
    that the shard was planned with.
    """
    use_own_worker()
    engine = shard.grid.setting.engine
    scene = _scene_here(shard.inputs, engine)
    # An engine in an environment of its own has no package there that writes tables.
    if interpreter_of(registry.engine(engine)) is None:
        limit = timeouts.limit(shard.grid.setting.timestep, len(shard))
        # Smaller batches show which launch failed, and why.
        with suppress(EngineFailed):
            return call(simulate_shard, shard, scene, encode, limit=limit)
    return _in_batches(shard, scene, partial(_run, timeouts=timeouts), encode)


def simulate_shard(shard: Shard, scene: Scene, encode: Encode) -> ShardFiles:
    """Simulate a shard in this process; return its files.

    scene: the shard's, with its files as they lie here.
    encode: makes the bytes of a table.
    Raises UserError for what the engine refuses, and EngineFailed for anything else that it raises.
    """
    try:
        return _in_batches(shard, scene, run_batch, encode)
    except UserError:
        raise
    except Exception as error:
        raise EngineFailed("shard", f"{type(error).__name__}: {error}", "") from error


def _in_batches(
    shard: Shard, scene: Scene, run: Callable[[Batch], BatchResult], encode: Encode
) -> ShardFiles:
    """The files of a shard, simulated batch by batch, each as large as its loops fit in memory.

    run: simulates a batch.
    encode: makes the bytes of a table.

    Raises what `run` raises.
    """
    setting = shard.grid.setting
    launches = shard.grid.launches(shard.part)
    looped = shard.grid.looped(shard.part)
    size = _FIRST
    # A device takes all launches at once, and records no loop.
    if "device" in setting.options:
        size = len(launches)
    results: list[BatchResult] = []
    begin = 0
    while begin < len(launches):
        end = min(begin + size, len(launches))
        kept = [i - begin for i in looped if begin <= i < end]
        batch = Batch(scene, setting, launches[begin:end], kept, shard.oblique)
        results.append(run(batch))
        # The batch before tells how many samples a loop has; 1 is added since it may be none.
        mean_samples = results[-1].columns["samples"].mean()
        size = max(_FIRST, int(_SAMPLES // (1 + mean_samples)))
        begin = end
    return shard_files(shard, results, encode)


def _run(batch: Batch, timeouts: Timeouts) -> BatchResult:
    """Run a batch in a worker process, or where that fails each of its launches alone.

    A launch that fails alone is an impact CRASHED, with the reason; after _GIVE_UP of them in a row
    that killed the worker, the rest is CRASHED without a try.
    Raises UserError for what the engine refuses.
    """
    timestep = batch.setting.timestep
    where = interpreter_of(registry.engine(batch.setting.engine))
    try:
        return call(run_batch, batch, limit=timeouts.limit(timestep, len(batch.launches)), at=where)
    except UserError:
        raise
    except Exception:
        # Running each launch alone shows which one failed, and why.
        impacts = map_surviving_crashes(
            run_one_by_one,
            range(len(batch.launches)),
            batch,
            lost=lambda i, reason: Impact(batch.launches[i], Status.CRASHED, reason),
            limit=timeouts.limit(timestep, 1),
            give_up=_GIVE_UP,
            at=where,
        )
        return result_of(Impacts.of(impacts), batch)


def run_bounces(drop: Drop, timeouts: Timeouts) -> Dropped:
    """Simulate a drop in a worker process.

    Raises UserError for what the engine refuses, CannotRun where versions or files are not those of
    the plan, EngineFailed where the worker crashes or takes longer than its limit.
    """
    use_own_worker()
    scene = _scene_here(drop.inputs, drop.setting.engine)
    limit = timeouts.start + _STEP_S * drop.duration / drop.setting.timestep
    where = interpreter_of(registry.engine(drop.setting.engine))
    return call(simulate_bounces, scene, drop, limit=limit, at=where)


def _scene_here(inputs: Inputs, engine: str) -> Scene:
    """The scene of planned inputs, with its model files as they lie on this machine.

    inputs: as planned, perhaps on another machine.
    engine: its name.
    Raises CannotRun where versions or files are not those of the plan, and EngineMissing.
    """
    got = []
    planned = []
    for name, version in versions_here(engine).items():
        if inputs.versions.get(name) != version:
            got.append(f"{name} {version}")
            planned.append(f"{name} {inputs.versions.get(name, 'none')}")
    if got:
        advice = "Install the same everywhere"
        raise CannotRun("worker", f"has {', '.join(got)}", ", ".join(planned), advice)
    for scene in _candidates(inputs.scene):
        if digests_of(scene, engine) == inputs.digests[engine]:
            return dataclasses.replace(inputs.scene, models=scene.models)
    raise CannotRun(
        "worker",
        f"the files of scene {inputs.scene.name!r} are not there, or not the same",
        "those that the sweep was planned with",
        "Keep the scene's folder where every machine sees it under the same path",
    )


def _candidates(scene: Scene) -> Iterator[Scene]:
    """The scene where it lay when it was planned, else the built-in one of that name."""
    yield scene
    with suppress(SceneError):
        yield load_scene(scene.name)
