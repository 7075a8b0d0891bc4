"""Steps balls in MuJoCo and reads penetration, rate and force off the states.

The force of a step is what it does to the ball's momentum, m (Δv/h - g): MuJoCo's own contact force to
rounding under Euler, implicit and implicitfast, evaluated in the state that the step starts from. Under
`discrete` it is evaluated at the step's end. Under RK4 the momentum tells the mean of four stages, so there
the force at the step's start is read off a sensor; the momentum still tells which steps the contact acted in.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.errors import SettingError

if TYPE_CHECKING:
    from hcbench.engines.mujoco.batch import Crowd
    from hcbench.engines.mujoco.world import Loaded
    from hcbench.impact import Floats

_ROUND_OFF = 16 * np.finfo(float).eps  # of what a step adds up: a smaller change of velocity is no force


def released(model: Loaded, gaps: Floats, speeds: Floats) -> Floats:
    """The full states at release, shape (b, nstate); SettingError for a height that a cup has no room for.

    gaps: clearances, m; speeds: towards the plate, m/s; shape (b,).
    """
    if model.clearance is not None and (high := gaps.max()) >= model.clearance:
        raise SettingError(
            "height",
            f"{float(high)!r} m above the cup",
            f"below |R2| - R1 = {model.clearance!r} m, where the centres meet",
            "Drop from lower, or in the form 'plane'",
        )
    states, (position, velocity) = np.tile(model.origin, (len(gaps), 1)), model.at
    states[:, position + 2] += gaps
    states[:, velocity + 2] = -speeds
    return states


@dataclass(frozen=True, slots=True)
class Bench:
    """What a crowd is stepped in: an MjData for each thread, and room for states, shape (n,), as new room is
    costly.
    """

    crowd: Crowd
    data: list[Any]
    room: Floats

    @classmethod
    def of(cls, model: Loaded, crowd: Crowd, threads: int, room: int) -> Bench:
        """With room for so many bytes of states, of each thread."""
        data = [model.mujoco.MjData(crowd.model) for _ in range(threads)]
        return cls(crowd, data, np.empty(threads * room // 8))


def record(
    model: Loaded, bench: Bench, states: Floats, most: int, warm: Floats | None = None
) -> tuple[Floats, Floats] | None:
    """Take up to `most` steps from states of shape (b, nstate), as many as there is room for.

    warm: where MuJoCo's solver starts from, shape (nv,).
    Penetration, rate and force at the start of each step, shape (3, b, n), NaN from where MuJoCo gave up,
    and the states after. None where it gave up on a whole crowd, for the sake of one ball in it.
    """
    crowd, packed = bench.crowd, bench.crowd.pack(states)
    count = max(1, min(most, bench.room.size // packed.size))
    shape = (len(packed), count, packed.shape[1])
    path, sensed = model.mujoco.rollout.rollout(
        crowd.model,
        bench.data[: len(packed)],
        packed,
        nstep=count,
        initial_warmstart=warm,
        state=bench.room[: packed.size * count].reshape(shape),
    )
    # MuJoCo meets what is not finite by starting the model over, and rollout by standing still.
    stopped = np.diff(path[:, :, 0], prepend=packed[:, :1]) <= 0.0
    gave_up = bool(stopped.any())
    if gave_up and crowd.size > 1:
        return None
    own = _Paths(crowd, states, path, sensed)
    with np.errstate(all="ignore"):  # what is not finite is told by the record
        seen = _on_plane(model, own) if model.clearance is None else _in_cup(model, own, model.clearance)
    if gave_up:
        seen[:, np.maximum.accumulate(stopped, axis=1)] = np.nan
    return seen, crowd.unpack(path[:, -1], states)


@dataclass(frozen=True, slots=True)
class _Paths:
    """The states before and after each step, and what was sensed in it, one number of each ball at a time."""

    crowd: Crowd
    start: Floats
    path: Floats
    sensed: Floats

    def state(self, kind: int, i: int) -> Floats:
        """Shape (b, n + 1). kind, i: 0 and 0 ... 6 for positions, 1 and 0 ... 5 for velocities."""
        found = np.empty((len(self.start), self.path.shape[1] + 1))
        found[:, 0] = self.start[:, self.crowd.at[kind] + i]
        after = self.crowd.columns(self.path, (kind, i), len(found))
        found[:, 1:] = found[:, :1] if after is None else after
        return found

    def felt(self, i: int) -> Floats:
        """A component of the acceleration that each ball's sensor feels, its model's last; shape (b, n)."""
        rows, n, _ = self.sensed.shape
        last = self.sensed[:, :, -3 * self.crowd.size :].reshape(rows, n, self.crowd.size, 3)
        return last[..., i].transpose(0, 2, 1).reshape(-1, n)[: len(self.start)]


def _on_plane(model: Loaded, own: _Paths) -> Floats:
    """Penetration is how far the centre is below where it touches."""
    z, vz = own.state(0, 2), own.state(1, 2)
    seen = np.empty((3, len(z), z.shape[1] - 1))
    np.subtract(model.origin[model.at[0] + 2], z[:, :-1], out=seen[0])
    np.negative(vz[:, :-1], out=seen[1])
    gained = np.diff(vz, axis=1)
    if fall := model.scene.gravity * model.timestep:
        gained += fall
    seen[2] = _force(model, gained, np.abs(vz), own.felt(2) if model.felt else None)
    return seen


def _in_cup(model: Loaded, own: _Paths, clearance: float) -> Floats:
    """Penetration is how far the centre is out of the sphere in which it is free: no engine in that."""
    touch = model.origin[model.at[0] : model.at[0] + 3]
    up = np.array([0.0, 0.0, 1.0])
    away = [own.state(0, i)[:, :-1] - (touch + clearance * up)[i] for i in range(3)]
    distance = np.sqrt(away[0] ** 2 + away[1] ** 2 + away[2] ** 2)
    deeper = [a / np.maximum(distance, np.finfo(float).tiny) for a in away]
    speeds = [own.state(1, i) for i in range(3)]

    def along(vector: list[Floats]) -> Floats:
        return np.asarray(deeper[0] * vector[0] + deeper[1] * vector[1] + deeper[2] * vector[2])

    fall = model.scene.gravity * model.timestep * up
    gained = -along([np.diff(v, axis=1) + fall[i] for i, v in enumerate(speeds)])
    felt = -along([own.felt(i) for i in range(3)]) if model.felt else None
    force = _force(model, gained, np.abs(speeds[0]) + np.abs(speeds[1]) + np.abs(speeds[2]), felt)
    return np.stack([distance - clearance, along([v[:, :-1] for v in speeds]), force])


def _force(model: Loaded, gained: Floats, speed: Floats, felt: Floats | None) -> Floats:
    """Normal force of each step, N, shape (b, n); exactly 0 where the contact did not act.

    gained: what the contact adds to the velocity that parts the bodies, m/s, (b, n). speed: sum of the
    velocity's absolute components, (b, n + 1). felt: acceleration by contact at the step's start, m/s².
    """
    h, g = model.timestep, model.scene.gravity
    noise = speed[:, :-1] + speed[:, 1:] + g * h
    noise *= _ROUND_OFF
    slowing = gained / h
    slowing[np.abs(gained) <= noise] = 0.0
    if felt is not None:
        # A step that touches or parts on its way has no force yet, or no more, where it starts.
        slowing = np.where((slowing != 0.0) & (np.abs(felt) > _ROUND_OFF * g), felt, slowing)
    slowing *= model.scene.mass
    return slowing
