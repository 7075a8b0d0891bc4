"""A ball over a plate in MuJoCo: launches are stepped side by side, as
many in one model as is worth it.

Results are bit-identical for any batch size, thread count and length of chunks.
"""

from __future__ import annotations

import copy
import math
import os
from collections import Counter
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from hcbench.engines.mujoco.backend import captured_warnings
from hcbench.engines.mujoco.model.bodies import speed_reading
from hcbench.engines.mujoco.scene.batch import (
    BatchedModel,
    batch_kind,
    compile_batch,
    has_one_constraint,
)
from hcbench.engines.mujoco.scene.record import Workspace, record, states_at_release
from hcbench.sim.columns import Launches
from hcbench.sim.world import Record, Simulation, World
from hcbench.workers import in_worker

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.engines.mujoco.scene.scene_model import SceneModel
    from hcbench.sim.world import Flags
    from hcbench.terms.impact import Launch

# Launches at once for each thread where each has a model of its own: more
# would take too much memory.
_ALONE = 32
# Models in a simulation of one thread: reading it costs as much for one model as for all.
_ROUNDS = 8
# Simulations at once: one is looked at while the other one is stepped.
_CONCURRENT = 2


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True, slots=True)
class Batching:
    """Limits for balls that share models, memory and threads: they change the time
    of results, never a bit of one.

    few_rows, balls, balls_of_many_rows, balls_of_one_row: the most balls in a model by its
    contact's rows: the dense Jacobian of more costs more than sharing saves.
    saved, compiling: s that a shared model saves a ball-step, and costs to compile.
    chunk_bytes: of states, for each thread.
    cores: threads at once.
    """

    few_rows: int = 4
    balls: int = 24
    balls_of_many_rows: int = 8
    balls_of_one_row: int = 80
    saved: float = 1.5e-6
    compiling: float = 5e-3
    chunk_bytes: int = 2**21
    cores: int = field(default_factory=_cores)


BATCHING = Batching()


@dataclass(slots=True)
class BatchPool:
    """A model, its batched versions, and their free workspaces.

    max_batch: the most balls that are worth putting into one model.
    threads: models that are stepped at once.
    unbatched: ball-steps until now that a model of so many balls would have had.
    """

    model: SceneModel
    max_batch: int
    threads: int
    sliding: bool
    batches: dict[int, BatchedModel] = field(default_factory=dict)
    unbatched: Counter[int] = field(default_factory=Counter)
    free_workspaces: dict[int, list[Workspace]] = field(default_factory=dict)

    @classmethod
    def of(cls, model: SceneModel) -> BatchPool:
        """Without batches yet. The model's solver starts each step from scratch from now on."""
        model.model.opt.disableflags |= model.mujoco.mjtDisableBit.mjDSBL_WARMSTART
        kind = batch_kind(model)
        rows = max(model.model.npair, model.model.ntendon)
        if kind == "alone":
            most = 1
        elif kind == "sliding" and has_one_constraint(model.model):
            most = BATCHING.balls_of_one_row
        elif rows <= BATCHING.few_rows:
            most = BATCHING.balls
        else:
            most = BATCHING.balls_of_many_rows
        # Other workers have the other cores.
        threads = 1 if in_worker() else BATCHING.cores
        return cls(model, most, threads, kind == "sliding")

    def whole(self) -> BatchedModel:
        """The model of one ball as it was authored: free, with all else it has."""
        return BatchedModel(self.model.model, 1, self.model.at, sliding=False)

    def batch(self, size: int) -> BatchedModel:
        """The model of so many balls."""
        if size not in self.batches:
            one = size == 1 and not self.sliding
            self.batches[size] = (
                self.whole() if one else compile_batch(self.model, size, self.sliding)
            )
        return self.batches[size]

    @contextmanager
    def workspace(self, batch: BatchedModel) -> Iterator[Workspace]:
        """Memory in which a batch is stepped, for one user at a time."""
        if batch is not self.batches.get(batch.size):
            yield Workspace.of(self.model, batch, 1, BATCHING.chunk_bytes)
            return
        free = self.free_workspaces.setdefault(batch.size, [])
        try:
            workspace = free.pop()
        except IndexError:
            workspace = Workspace.of(self.model, batch, self.threads, BATCHING.chunk_bytes)
        yield workspace
        free.append(workspace)

    def is_worth_batching(self, size: int, ball_steps: int) -> bool:
        """Say whether so many steps, with those before them, are worth
        compiling a model of `size` balls for.
        """
        if self.max_batch == 1 or size == 1:
            return False
        self.unbatched[size] += ball_steps
        return self.unbatched[size] * BATCHING.saved > BATCHING.compiling

    def size_for(self, balls: int, now: int, steps: int) -> int:
        """Number of balls in a model for `balls` launches and about `steps` more steps.

        now: balls in a model until now, 0 at release. A few launches of many are better off alone.
        """
        # Several models are stepped at once.
        for_each_thread = math.ceil(balls / self.threads)
        share = min(self.max_batch, max(for_each_thread, min(balls, BATCHING.balls_of_many_rows)))
        if now == 0:
            if self.is_worth_batching(share, balls * steps):
                return share
            return min((size for size in list(self.batches) if size >= share), default=1)
        if now > 1 and share <= now // 8:
            return 1
        fitting = min(1 << (share - 1).bit_length(), self.max_batch)
        if (now == 1 < share or share <= now // 2) and self.is_worth_batching(
            fitting, balls * steps
        ):
            return fitting
        return now


class MujocoWorld(World):
    """A ball over a plate, as a scene and a setting have it; resources are given back at its end."""

    diverged = "MuJoCo gave up: a position, velocity or acceleration was not finite or above 1e10"

    def __init__(self, pool: BatchPool) -> None:
        self.pool = pool
        scene = pool.model.scene
        self.timestep = pool.model.timestep
        self.gravity = scene.normal_gravity
        self.mass = scene.mass
        self.speed_reading = speed_reading(pool.model.model)
        in_a_thread = _ALONE
        if pool.max_batch > 1:
            in_a_thread = pool.max_batch
        self.places = pool.threads * in_a_thread
        self.concurrent = _CONCURRENT
        if pool.threads == 1:
            self.concurrent = 1
            # Nothing looks at one simulation while another is stepped: fewer, larger are faster.
            self.places *= _ROUNDS
        self._resources = ExitStack()
        self._resources.enter_context(captured_warnings())

    def release(self, launches: Sequence[Launch]) -> MujocoSimulation:
        """Launches under way from their starting points."""
        return MujocoSimulation(self.pool, launches)

    def follow(self, launch: Launch) -> FollowedLaunch:
        """One launch, bit for bit as a loop over mj_step takes it."""
        return FollowedLaunch(self.pool.model, launch)

    def close(self) -> None:
        """Let MuJoCo warn as before."""
        self._resources.close()


class MujocoSimulation(Simulation):
    """Launches under way in one or more models."""

    def __init__(self, pool: BatchPool, launches: Sequence[Launch]) -> None:
        self._pool = pool
        self._states = states_at_release(pool.model, launches)
        off_axis = pool.model.scene.off_axis > 0.0
        self._leaves_axis = off_axis or bool(Launches.of(launches).is_oblique.any())
        self._alone = False
        self._size = 0
        self._steps = 0

    def advance(self, steps: int) -> Record:
        """Up to `steps` steps, as many as there is room for."""
        while True:
            with self._pool.workspace(self._next_batch(steps)) as workspace:
                oblique = self._leaves_axis
                recorded = record(self._pool.model, workspace, self._states, steps, oblique=oblique)
            if recorded is not None:
                seen, self._states = recorded
                self._steps += seen.shape[2]
                x, v, f = seen[:3]
                tangential = None
                if oblique:
                    tangential = seen[3:]
                return Record(x, v, f, tangential, seen)
            # MuJoCo gave up on a whole batch for the sake of one ball: from here on each is alone.
            self._alone = True

    def _next_batch(self, steps: int) -> BatchedModel:
        """The batch for the coming steps: its size follows how many launches are left."""
        if self._leaves_axis:
            return self._pool.whole()
        if self._alone:
            self._size = 1
        else:
            self._size = self._pool.size_for(len(self._states), self._size, max(self._steps, steps))
        return self._pool.batch(self._size)

    def keep(self, which: Flags) -> None:
        """Go on with these only."""
        self._states = self._states[which]


class FollowedLaunch(Simulation):
    """One launch in the model as it was authored, whose solver starts
    each step from the one before.
    """

    def __init__(self, model: SceneModel, launch: Launch) -> None:
        authored = copy.copy(model.model)
        authored.opt.disableflags &= ~int(model.mujoco.mjtDisableBit.mjDSBL_WARMSTART)
        batch = BatchedModel(authored, 1, model.at, sliding=False)
        self._model = model
        self._workspace = Workspace.of(model, batch, 1, BATCHING.chunk_bytes)
        self._states = states_at_release(model, [launch])

    def advance(self, steps: int) -> Record:
        """Up to `steps` steps, as many as there is room for."""
        # An unbroken run would start its next step from here.
        warm = self._workspace.data[0].qacc_warmstart.copy()
        recorded = record(self._model, self._workspace, self._states, steps, warm)
        assert recorded is not None, "only a batch of several is given up as a whole"
        seen, self._states = recorded
        return Record(*seen)

    def keep(self, which: Flags) -> None:
        """Keep the one launch that there is."""
