"""Flies launches in MuJoCo and reads penetration, rate and force off the states.

The force of a step is what it does to the ball's momentum, m (Δv/h - g): MuJoCo's own contact force to
rounding under Euler, implicit and implicitfast, evaluated in the state that the step starts from. Under
`discrete` it is evaluated at the step's end. Under RK4 the momentum tells the mean of four stages, so there
the force at the step's start is read off a sensor; the momentum still tells which steps the contact acted in.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines._mujoco_load import guarded
from hcbench.errors import SettingError
from hcbench.impact import Trajectory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines._mujoco_load import Loaded
    from hcbench.impact import Floats, Launch

_GROUP = 32  # launches flown together: bounds memory
_CONTACT_S = 0.5  # how long a ball may stay in contact before it counts as resting there
_AT_REST = 1e-6  # of its impact speed, over a whole chunk of steps: a bounce turns around in far fewer
_ROUND_OFF = 16 * np.finfo(float).eps  # of what a step adds up: a smaller change of velocity is no force
_FEW, _SHORT, _LONG = 16, 32, 8192  # steps in a chunk


def fly(model: Loaded, launches: Sequence[Launch]) -> list[Trajectory]:
    """Each launch until it has parted or rests. Any number at once gives the same bits."""
    groups = [launches[i : i + _GROUP] for i in range(0, len(launches), _GROUP)]
    with guarded(model.mujoco):
        return [trajectory for group in groups for trajectory in _fly(model, group)]


def follow(model: Loaded, launch: Launch, steps: int) -> Trajectory:
    """All of `steps` steps after one launch; NaN from where MuJoCo gave up."""
    with guarded(model.mujoco):
        return _fly(model, [launch], steps)[0]


def _fly(model: Loaded, launches: Sequence[Launch], steps: int | None = None) -> list[Trajectory]:
    """Step all launches side by side; without a number of `steps`, each until there is no more to see."""
    data = model.mujoco.MjData(model.model)
    state = np.stack([_released(model, launch) for launch in launches])
    watches = [_Watch.over(model, launch) for launch in launches]
    flying, done = list(range(len(launches))), 0
    while flying:
        # The same chunks for every launch: each starts MuJoCo's solver cold, which moves last bits.
        count = _chunk(done) if steps is None else min(_chunk(done), steps - done)
        path, sensed = model.mujoco.rollout.rollout(model.model, data, state, nstep=count)
        path = np.concatenate([state[:, None], path], axis=1)
        for i, record in zip(flying, _observe(model, path, sensed), strict=True):
            watches[i].add(record)
        done += count
        going = [not watches[i].ended if steps is None else done < steps for i in flying]
        flying = [i for i, go in zip(flying, going, strict=True) if go]
        state = path[going, -1]
    return [watch.trajectory(model.timestep) for watch in watches]


def _chunk(done: int) -> int:
    """Steps to take next: few at first, where a coarse step has parted already, then a share of what was."""
    return min(max(_SHORT if done >= _SHORT else _FEW, done // 8), _LONG)


def _released(model: Loaded, launch: Launch) -> Floats:
    """The full state at release, shape (nstate,)."""
    gap = launch.gap(model.timestep)
    if model.clearance is not None and gap >= model.clearance:
        raise SettingError(
            "height",
            f"{gap!r} m above the cup",
            f"below |R2| - R1 = {model.clearance!r} m, where the centres meet",
            "Drop from lower, or in the form 'plane'",
        )
    state, (position, velocity) = model.origin.copy(), model.at
    state[position + 2] += gap
    state[velocity + 2] = -launch.speed
    return state


def _observe(model: Loaded, path: Floats, sensed: Floats) -> Floats:
    """Penetration, rate and force of each step, shape (b, 3, n).

    path: states, shape (b, n + 1, nstate). sensed: sensors at the first n of them, shape (b, n, nsensordata).
    """
    position, velocity = (path[:, :, i : i + 3] for i in model.at)
    with np.errstate(all="ignore"):  # what is not finite is told by the record
        x, v, deeper = _overlap(model, position[:, :-1], velocity[:, :-1])
        force = _force(model, velocity, deeper, sensed[:, :, -3:])
    record = np.stack([x, v, force], axis=1)
    # MuJoCo meets what is not finite by starting the model over, and rollout by standing still.
    stopped = np.maximum.accumulate(np.diff(path[:, :, 0], axis=1) <= 0.0, axis=1)
    record[np.broadcast_to(stopped[:, None], record.shape)] = np.nan
    return record


def _overlap(model: Loaded, position: Floats, velocity: Floats) -> tuple[Floats, Floats, Floats]:
    """Penetration, its rate, and the unit vector that leads deeper, by geometry: no engine."""
    touch = model.origin[model.at[0] : model.at[0] + 3]
    if model.clearance is None:
        return touch[2] - position[:, :, 2], -velocity[:, :, 2], np.array([0.0, 0.0, -1.0])
    away = position - (touch + np.array([0.0, 0.0, model.clearance]))
    distance = np.sqrt((away**2).sum(axis=2))
    deeper = away / np.maximum(distance, np.finfo(float).tiny)[:, :, None]
    return distance - model.clearance, (deeper * velocity).sum(axis=2), deeper


def _force(model: Loaded, velocity: Floats, deeper: Floats, felt: Floats) -> Floats:
    """Normal force of each step, N; exactly 0 where the contact did not act."""
    h, g = model.timestep, model.scene.gravity
    change = np.diff(velocity, axis=1)
    change[:, :, 2] += g * h
    lost = -(change * deeper).sum(axis=2)
    speed = np.abs(velocity).sum(axis=2)
    noise = _ROUND_OFF * (speed[:, :-1] + speed[:, 1:] + g * h)
    slowing = np.where(np.abs(lost) <= noise, 0.0, lost / h)
    if model.felt:
        at_start = -(felt * deeper).sum(axis=2)
        # A step that touches or parts on its way has no force yet, or no more, where it starts.
        in_contact = (slowing != 0.0) & (np.abs(at_start) > _ROUND_OFF * g)
        slowing = np.where(in_contact, at_start, slowing)
    return np.asarray(model.scene.mass * slowing)


@dataclass(slots=True)
class _Watch:
    """What one launch has done so far, and whether there is more to see.

    patience: steps after which it counts as resting, or as never touching. rest_speed: m/s.
    """

    patience: int
    rest_speed: float
    records: list[Floats]
    touched: bool = False
    given_up: bool = False
    ended: bool = False
    steps: int = 0

    @classmethod
    def over(cls, model: Loaded, launch: Launch) -> _Watch:
        """A watch over one launch that has not begun."""
        h, gap = model.timestep, launch.gap(model.timestep)
        speed = math.sqrt(launch.speed**2 + 2.0 * model.scene.gravity * gap)  # at touch
        if gap and not speed:
            raise SettingError("speed", "0 m/s without gravity", "a speed above 0, or gravity to fall by")
        flight = 2.0 * gap / (launch.speed + speed) if gap else 0.0
        patience = math.ceil(1.5 * flight / h) + math.ceil(_CONTACT_S / h) + 100
        return cls(patience, _AT_REST * speed, [])

    def add(self, record: Floats) -> None:
        """One more chunk of penetration, rate and force, shape (3, n)."""
        if self.given_up:  # what follows is the flight of a model that has been started over
            record = np.full_like(record, np.nan)
        self.records.append(record)
        self.steps += record.shape[1]
        x, v, f = record
        acting = np.flatnonzero(f)
        start = 0 if self.touched else int(acting[0]) if acting.size else len(f)
        self.touched = self.touched or acting.size > 0
        parted = ((x <= 0.0) & (v < 0.0) & (f == 0.0))[start:].any()  # as impact_of has it
        resting = self.touched and len(v) >= _SHORT and (np.abs(v) <= self.rest_speed).all()
        self.given_up = not np.isfinite(record).all()
        self.ended = bool(parted or resting or self.given_up or self.steps >= self.patience)

    def trajectory(self, timestep: float) -> Trajectory:
        """All of it."""
        record = np.concatenate(self.records, axis=1)
        return Trajectory(np.arange(record.shape[1]) * timestep, *record)
