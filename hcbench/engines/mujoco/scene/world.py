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
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import captured_warnings
from hcbench.engines.mujoco.model.bodies import speed_reading
from hcbench.engines.mujoco.scene.batch import (
    BatchedModel,
    batch_kind,
    compile_batch,
    has_one_constraint,
)
from hcbench.sim.columns import Launches
from hcbench.sim.tangential import rows_of_ball
from hcbench.sim.world import Record, Simulation, World
from hcbench.system.errors import SettingError
from hcbench.terms.resolution import ROUND_OFF_STEP
from hcbench.workers import in_worker

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.engines.mujoco.scene.scene_model import SceneModel
    from hcbench.sim.world import Flags
    from hcbench.terms.impact import Floats, Launch

# Steps balls in MuJoCo and reads penetration, rate and force off the states.
#
# The force of a step is what it does to the ball's momentum, m (Δv/h - g): MuJoCo's own contact
# force to rounding under Euler, implicit and implicitfast, evaluated in the state that the step
# starts from. Under `discrete` it is evaluated at the step's end. Under RK4 the momentum tells the
# mean of four stages, so there the force at the step's start is read off a sensor; the momentum
# still tells which steps the contact acted in.

# In sums of what a step adds up: a smaller change of velocity counts as no force.
_ROUND_OFF = ROUND_OFF_STEP * np.finfo(float).eps


def states_at_release(model: SceneModel, launches: Sequence[Launch]) -> Floats:
    """MuJoCo's full states of a scene's ball at the release of each launch, (b, nstate): it is above
    the touch by the launch's clearance, and moves with its velocity.

    launches: b of them.
    Raises SettingError for a height that a cup has no room for.
    """
    columns = Launches.of(launches)
    gaps = columns.clearance(model.timestep)  # m, (b,)
    if model.clearance is not None and (high := gaps.max()) >= model.clearance:
        raise SettingError(
            "height",
            f"{float(high)!r} m above the cup",
            f"below |R2| - R1 = {model.clearance!r} m, where the centres meet",
            "Drop from lower, or in the form 'plane'",
        )
    states = np.tile(model.origin, (len(gaps), 1))
    position, velocity = model.at
    # Unit vector away from the plate.
    away = np.array(model.scene.normal)
    states[:, position : position + 3] += model.scene.touch_offset + np.outer(gaps, away)
    states[:, velocity : velocity + 3] = np.outer(-columns.speed, away)
    if columns.is_oblique.any():
        # The plate's axes are the world's x and y.
        states[:, velocity : velocity + 2] += columns.slip
        states[:, velocity + 3 : velocity + 6] = columns.spin
    return states


@dataclass(frozen=True, slots=True)
class Workspace:
    """Memory in which a batch is stepped: an MjData for each thread, and a buffer for states, shape
    (n,). Allocating one is costly.
    """

    batch: BatchedModel
    data: list[Any]
    buffer: Floats

    @classmethod
    def of(cls, model: SceneModel, batch: BatchedModel, threads: int, room: int) -> Workspace:
        """A workspace for `threads` threads, with `room` bytes for the states of each."""
        data = [model.mujoco.MjData(batch.model) for _ in range(threads)]
        return cls(batch, data, np.empty(threads * room // 8))


def record(
    model: SceneModel,
    workspace: Workspace,
    states: Floats,
    most: int,
    warm: Floats | None = None,
    oblique: bool = False,
) -> tuple[Floats, Floats] | None:
    """Step b balls from their states, and read each step.

    states: (b, nstate).
    most: of steps to take; fewer, but one at least, where the workspace has no room for more.
    workspace: of models that hold several balls each; its buffer, of one packed state at least, is
    overwritten.
    warm: accelerations from which MuJoCo's solver starts, (nv,) of such a model; None: from those
    without contact.
    oblique: read the motion along the plate, too.

    Returns what n steps show, (3 or 11, b, n): penetration (m), rate (m/s) and force (N), then the
    eight rows of `Record.tangential`, NaN from where MuJoCo gave up; and the states after them, (b,
    nstate), of no use where it gave up. Returns None where MuJoCo gave up on a whole batch, because
    of one ball in it.
    """
    batch = workspace.batch
    packed = workspace.batch.pack(states)
    count = max(1, min(most, workspace.buffer.size // packed.size))
    path = workspace.buffer[: packed.size * count].reshape(len(packed), count, -1)
    first_warm = None
    if warm is not None:
        first_warm = warm[None]
    sensed = np.empty((len(packed), count, batch.model.nsensordata))
    model.mujoco.rollout.rollout(
        [batch.model] * len(packed),
        workspace.data[: len(packed)],
        packed,
        # MuJoCo's checks take as long as two steps.
        skip_checks=True,
        nstep=count,
        initial_warmstart=first_warm,
        state=path,
        sensordata=sensed,
    )
    # MuJoCo meets what is not finite by starting the model over, and rollout by standing still: in
    # both cases the time, the first number of a state, does not go on.
    stopped = np.diff(path[:, :, 0], prepend=packed[:, :1]) <= 0.0
    gave_up = bool(stopped.any())
    if gave_up and batch.size > 1:
        return None
    paths = _Paths(batch, states, path, sensed)
    # Numbers that are not finite belong into the record.
    with np.errstate(all="ignore"):
        if model.clearance is None:
            seen = _on_plane(model, paths)
        else:
            seen = _in_cup(model, paths, model.clearance)
        if oblique:
            seen = np.concatenate([seen, _along_plate(model, paths)])
    if gave_up:
        # From the first such step on.
        seen[:, np.maximum.accumulate(stopped, axis=1)] = np.nan
    return seen, batch.unpack(path[:, -1], states)


# Kinds of numbers in a state.
_POSITION = 0
_VELOCITY = 1


@dataclass(frozen=True, slots=True)
class _Paths:
    """States of b balls before the first step and after each of n, and what was sensed in it, SI;
    its methods return one number of each ball.

    start, path, sensed: as MuJoCo keeps them, of batches of balls.
    """

    batch: BatchedModel
    start: Floats
    path: Floats
    sensed: Floats

    def state(self, kind: int, i: int) -> Floats:
        """One number of each ball's state before the first step and after each, (b, n + 1), SI.

        kind, i: _POSITION and 0 ... 6 for the position and quaternion, or _VELOCITY and 0 ... 5 for
        the velocity and spin.
        """
        values = np.empty((len(self.start), self.path.shape[1] + 1))
        values[:, 0], after = self.around(kind, i)
        values[:, 1:] = values[:, :1] if after is None else after
        return values

    def around(self, kind: int, i: int) -> tuple[Floats, Floats | None]:
        """One number of each ball before the first step, (b,), and after each, (b, n); None in
        place of the latter where it never changes. kind, i: as of `state`.
        """
        start = self.start[:, self.batch.at[kind] + i]
        return start, self.batch.columns(self.path, (kind, i), len(start))

    def vector(self, kind: int, i: int, count: int = 3) -> Floats:
        """`count` numbers of a state from `i` on, (b, n + 1, count). kind, i: as of `state`."""
        return np.stack([self.state(kind, k) for k in range(i, i + count)], axis=-1)

    def acceleration(self, i: int) -> Floats:
        """A component of the acceleration that each ball's sensor reads,
        the model's last; shape (b, n).
        """
        rows, n, _ = self.sensed.shape
        last = self.sensed[:, :, -3 * self.batch.size :].reshape(rows, n, self.batch.size, 3)
        return last[..., i].transpose(0, 2, 1).reshape(-1, n)[: len(self.start)]


def _on_plane(model: SceneModel, paths: _Paths) -> Floats:
    """Penetration, m, its rate, m/s, and normal force, N, of each step, (3, b, n), on a plane.

    Penetration and rate are those at the step's start; penetration is how far the centre is below
    where it touches.

    paths: states and sensors of b balls before the steps and after each of n.
    """
    start_z, z = paths.around(_POSITION, 2)
    start_vz, vz = paths.around(_VELOCITY, 2)
    assert z is not None, "a ball can move along the normal"
    assert vz is not None, "a ball can move along the normal"
    touch = model.origin[model.at[0] + 2]
    seen = np.empty((3, *z.shape))
    depth, rate, gained = seen
    # Of all rows in one go: rows apart are slower by far. What this writes into a row's first step
    # is the end of the row before, so the first steps are written after it.
    np.subtract(touch, z.ravel()[:-1], out=depth.ravel()[1:])
    np.negative(vz.ravel()[:-1], out=rate.ravel()[1:])
    np.subtract(vz.ravel()[1:], vz.ravel()[:-1], out=gained.ravel()[1:])
    depth[:, 0] = touch - start_z
    rate[:, 0] = -start_vz
    gained[:, 0] = vz[:, 0] - start_vz
    fall = model.scene.gravity * model.timestep
    if fall:
        gained += fall
    sensed = paths.acceleration(2) if model.sensed else None
    force = _force(model, gained, (rate, vz[:, -1]), sensed)
    # The force is worked out in place where it can be.
    if force is not gained:
        seen[2] = force
    return seen


def _along_plate(model: SceneModel, paths: _Paths) -> Floats:
    """Motion of the balls along the plate at each step's start, (8, b, n): slip (2, m/s), spin (3,
    rad/s), friction (2, N), and the kinetic energy without that of the approach (J).

    paths: states and sensors of b balls before the steps and after each of n.
    """
    velocity = paths.vector(_VELOCITY, 0)  # (b, n + 1, 3)
    quaternion = paths.vector(_POSITION, 3, 4)[:, :-1]  # w x y z
    body_spin = paths.vector(_VELOCITY, 3)[:, :-1]
    scalar = quaternion[..., :1]
    axis = quaternion[..., 1:]
    # MuJoCo has the spin in the body's own frame: in the world it is q s q*, of the unit quaternion
    # q = (scalar, axis).
    spin = body_spin + 2.0 * np.cross(axis, np.cross(axis, body_spin) + scalar * body_spin)
    # Acceleration by the contact alone, m/s², and the unit vector into the plate, (b, n, 3) each.
    acceleration = np.diff(velocity, axis=1) / model.timestep + [0.0, 0.0, model.scene.gravity]
    if model.clearance is None:
        deeper = np.broadcast_to([0.0, 0.0, -1.0], acceleration.shape)
    else:
        _, outwards = _from_centre(model, paths, model.clearance)
        deeper = np.stack(outwards, axis=-1)
    return rows_of_ball(model.scene, velocity[:, :-1], spin, deeper, acceleration)


def _from_centre(model: SceneModel, paths: _Paths, clearance: float) -> tuple[Floats, list[Floats]]:
    """Place of the balls in a cup at each step's start: the distance of their centre from that of
    the cup, m, (b, n), and the unit vector from the cup's centre to theirs, its components (b, n).

    paths: states and sensors of b balls before the steps and after each of n.
    clearance: |R2| - R1 of the cup, m.
    """
    touch = model.origin[model.at[0] : model.at[0] + 3]
    centre = touch + np.array([0.0, 0.0, clearance])
    away = [paths.state(_POSITION, i)[:, :-1] - centre[i] for i in range(3)]
    distance = np.sqrt(away[0] ** 2 + away[1] ** 2 + away[2] ** 2)
    return distance, [a / np.maximum(distance, np.finfo(float).tiny) for a in away]


def _in_cup(model: SceneModel, paths: _Paths, clearance: float) -> Floats:
    """Penetration, m, its rate, m/s, and normal force, N, of each step, (3, b, n), in a cup.

    Penetration is how far a ball's centre is out of the sphere in which it is free: geometry, not
    what MuJoCo reports.

    paths: states and sensors of b balls before the steps and after each of n.
    clearance: |R2| - R1 of the cup, m, the radius of that sphere.
    """
    distance, deeper = _from_centre(model, paths, clearance)
    vx = paths.state(_VELOCITY, 0)
    vy = paths.state(_VELOCITY, 1)
    vz = paths.state(_VELOCITY, 2)

    def along(vector: list[Floats]) -> Floats:
        """Component of vectors out of the sphere, (b, n), of their three components, (b, n) each."""
        return np.asarray(deeper[0] * vector[0] + deeper[1] * vector[1] + deeper[2] * vector[2])

    # Velocity that the contact adds in each step, m/s, (b, n): what gravity takes off is put back.
    fall = model.scene.gravity * model.timestep
    gained = -along([np.diff(vx, axis=1), np.diff(vy, axis=1), np.diff(vz, axis=1) + fall])
    sensed = None
    if model.sensed:
        sensed = -along([paths.acceleration(i) for i in range(3)])
    speed = np.abs(vx) + np.abs(vy) + np.abs(vz)
    force = _force(model, gained, (speed[:, :-1], speed[:, -1]), sensed)
    rate = along([vx[:, :-1], vy[:, :-1], vz[:, :-1]])
    return np.stack([distance - clearance, rate, force])


def _force(
    model: SceneModel, gained: Floats, speed: tuple[Floats, Floats], sensed: Floats | None
) -> Floats:
    """Normal force of each step by the change of momentum, N, (b, n); exactly 0 where the change is
    not more than round-off, so that the contact did not act.

    gained: velocity apart that the contact adds in each step, m/s, (b, n); overwritten.
    speed: the velocity, of either sign, or the sum of its absolute components, by which round-off
    is judged: before each step, (b, n), and after the last one, (b,), m/s.
    sensed: acceleration by contact at the step's start, m/s², (b, n), under RK4; else None.
    """
    h = model.timestep
    g = model.scene.gravity
    before = speed[0].ravel()
    last = speed[1]
    fastest = max(-before.min(), before.max(), np.abs(last).max())
    # Round-off is computed only for changes so small that they may be no more than that.
    near = np.flatnonzero(np.abs(gained) <= (fastest + fastest + g * h) * _ROUND_OFF)
    ball, step = np.divmod(near, gained.shape[1])
    # The speed after a step is that before the next. Counted from the end, no index is out of range.
    after = np.where(step + 1 < gained.shape[1], before[near + 1 - before.size], last[ball])
    noise = np.abs(before[near]) + np.abs(after) + g * h
    noise *= _ROUND_OFF
    flat = gained.ravel()  # a view of the same numbers
    flat[near[np.abs(flat[near]) <= noise]] = 0.0
    acceleration = np.divide(gained, h, out=gained)
    if sensed is not None:
        # A step that touches or parts on its way has no force yet, or no more, where it starts.
        is_pressed = (acceleration != 0.0) & (np.abs(sensed) > _ROUND_OFF * g)
        acceleration = np.where(is_pressed, sensed, acceleration)
    acceleration *= model.scene.mass
    return acceleration


# Launches at once for each thread where each has a model of its own: more
# would take too much memory.
_ALONE = 32
# Models in a simulation of one thread: reading it costs as much for one model as for all.
_ROUNDS = 24
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
    sliding: balls in batches move on a slide along z, not freely.
    batches, free_workspaces: by number of balls.
    unbatched: by number of balls, the ball-steps until now that a model of them would have had.
    least_taken: as of the `World`s that launched the model's balls until now.
    """

    model: SceneModel
    max_batch: int
    threads: int
    sliding: bool
    batches: dict[int, BatchedModel] = field(default_factory=dict)
    unbatched: Counter[int] = field(default_factory=Counter)
    free_workspaces: dict[int, list[Workspace]] = field(default_factory=dict)
    least_taken: int = 0

    @classmethod
    def of(cls, model: SceneModel) -> BatchPool:
        """Make a pool for a scene's balls, without any batches yet: it decides how many balls may
        share a model without a change of their bits, and how many threads step models.

        Changes the model: its solver starts each step from scratch from now on.
        """
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
        """The compiled model of `size` balls; it is compiled when it is first asked for, and kept."""
        if size not in self.batches:
            one = size == 1 and not self.sliding
            self.batches[size] = (
                self.whole() if one else compile_batch(self.model, size, self.sliding)
            )
        return self.batches[size]

    @contextmanager
    def workspace(self, batch: BatchedModel) -> Iterator[Workspace]:
        """Lend memory in which a batch is stepped, to one user at a time; it is kept for the next
        one, unless the batch is not one of the pool's.
        """
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
        """Say whether a model of `size` balls would save more time than it takes to compile, by the
        steps that it would have had until now and those to come; and add the latter to the count.

        ball_steps: steps that are still to come, times the balls that take them.
        """
        if self.max_batch == 1 or size == 1:
            return False
        self.unbatched[size] += ball_steps
        return self.unbatched[size] * BATCHING.saved > BATCHING.compiling

    def size_for(self, balls: int, now: int, steps: int) -> int:
        """Choose how many balls a model has for launches that are under way.

        balls: launches that are left.
        now: balls in a model until now, 0 at release.
        steps: that are probably still to come. The number changes only where the time that it saves
        is worth compiling another model; a few launches left of many go on alone. No number changes
        a bit of the results.
        """
        # Several models are stepped at once: each gets its share, but not too few to be worth it.
        for_each_thread = math.ceil(balls / self.threads)
        share = min(self.max_batch, max(for_each_thread, min(balls, BATCHING.balls_of_many_rows)))
        if now == 0:
            if self.is_worth_batching(share, balls * steps):
                return share
            # The smallest compiled model that holds them.
            return min((size for size in list(self.batches) if size >= share), default=1)
        if now > 1 and share <= now // 8:
            return 1
        # The next power of 2, so that few different models are compiled.
        fitting = min(1 << (share - 1).bit_length(), self.max_batch)
        if (now == 1 < share or share <= now // 2) and self.is_worth_batching(
            fitting, balls * steps
        ):
            return fitting
        return now


class MujocoWorld(World):
    """A ball over a plate in MuJoCo, as a scene and a setting have it.

    MuJoCo's warnings are kept from the user until `close`.
    """

    diverged = "MuJoCo gave up: a position, velocity or acceleration was not finite or above 1e10"

    def __init__(self, pool: BatchPool) -> None:
        """Find how many launches a simulation holds at best (`places`), and how many simulations may
        be under way (`concurrent`); keep MuJoCo's warnings from the user.

        pool: of the scene's model and its batches.
        """
        self.pool = pool
        scene = pool.model.scene
        self.timestep = pool.model.timestep
        self.gravity = scene.normal_gravity
        self.mass = scene.mass
        self.speed_reading = speed_reading(pool.model.model)
        # A sweep has one pool for the worlds of many batches.
        self.least_taken = pool.least_taken
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
        """Let MuJoCo warn as before, and tell the pool what launches took."""
        self.pool.least_taken = self.least_taken
        self._resources.close()


class MujocoSimulation(Simulation):
    """Launches under way in one or more models."""

    def __init__(self, pool: BatchPool, launches: Sequence[Launch]) -> None:
        """Put each launch where it begins. Raises SettingError for a height that a cup has no room
        for.
        """
        self._pool = pool
        self._states = states_at_release(pool.model, launches)
        off_axis = pool.model.scene.off_axis > 0.0
        self._leaves_axis = off_axis or bool(Launches.of(launches).is_oblique.any())
        # True once MuJoCo gave up on a whole batch: from then on each launch is alone.
        self._alone = False
        # Balls in a model now, and steps taken.
        self._size = 0
        self._steps = 0

    def advance(self, steps: int) -> Record:
        """Take up to `steps` steps, as many as there is room for, and return their record.

        A launch that MuJoCo gave up is NaN from there on.
        """
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
        """The model for the coming steps, with as many balls as suit the launches that are left.

        steps: that are asked for.
        """
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
        """Put the launch where it begins. Raises SettingError for a height that a cup has no room
        for.
        """
        # The warm start, which batches have off, is part of how mj_step goes on.
        authored = copy.copy(model.model)
        authored.opt.disableflags &= ~int(model.mujoco.mjtDisableBit.mjDSBL_WARMSTART)
        batch = BatchedModel(authored, 1, model.at, sliding=False)
        self._model = model
        self._workspace = Workspace.of(model, batch, 1, BATCHING.chunk_bytes)
        self._states = states_at_release(model, [launch])

    def advance(self, steps: int) -> Record:
        """Take up to `steps` steps, as many as there is room for, and return their record."""
        # An unbroken run would start its next step from here.
        warm = self._workspace.data[0].qacc_warmstart.copy()
        recorded = record(self._model, self._workspace, self._states, steps, warm)
        assert recorded is not None, "only a batch of several is given up as a whole"
        seen, self._states = recorded
        return Record(*seen)

    def keep(self, which: Flags) -> None:
        """Keep the one launch that there is."""
