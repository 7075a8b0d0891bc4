"""Flies launches in MuJoCo, side by side, as many in one model as pay.

None of that is felt: neither company nor threads nor where a chunk of steps ends changes a bit.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines import isolation
from hcbench.engines._mujoco_crowd import Crowd, can_crowd, crowd
from hcbench.engines._mujoco_load import guarded
from hcbench.engines._mujoco_record import record, released
from hcbench.engines._mujoco_watch import Watch
from hcbench.impact import Trajectory, impacts_of
from hcbench.reference import exact
from hcbench.reference.laws import HuntCrossley

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines._mujoco_load import Loaded
    from hcbench.impact import Floats, Impact, Launch

# Balls in a model: the dense Jacobian of more costs more than their company saves.
_FEW_ROWS, _CROWD, _CROWD_OF_ROWS = 4, 24, 8
_ALONE = 32  # launches flown side by side, one in a model: bounds memory
_GAIN_S, _COMPILE_S = 1.5e-6, 5e-3  # what company saves a ball-step, and costs to compile
_SHORT, _CHUNK_BYTES = 32, 2**21  # steps in a chunk: the fewest after the first; and how many fit


def fly(model: Loaded, launches: Sequence[Launch]) -> list[Impact]:
    """Each launch until it has parted or rests. Any number at once gives the same bits."""
    fleet = _Fleet.of(model)
    groups = fleet.groups(launches)
    threads = 1 if isolation.in_worker() else min(_cores(), len(groups))
    flights = [_Flight(fleet, [launches[i] for i in group]) for group in groups]
    with guarded(model.mujoco):
        if threads > 1:
            with ThreadPoolExecutor(threads) as pool:
                found = list(pool.map(_Flight.land, flights))
        else:
            found = [flight.land() for flight in flights]
    back: dict[int, Impact] = {}
    for group, impacts in zip(groups, found, strict=True):
        back.update(zip(group, impacts, strict=True))
    return [back[i] for i in range(len(launches))]


def follow(model: Loaded, launch: Launch, steps: int) -> Trajectory:
    """All of `steps` steps after one launch; NaN from where MuJoCo gave up."""
    alone, data = Crowd(model.model, 1, model.at), model.mujoco.MjData(model.model)
    states, done = released(model, launch)[None], 0
    path = np.full((3, 1, steps), np.nan)
    with guarded(model.mujoco):
        while done < steps:
            count = min(steps - done, _CHUNK_BYTES // states.nbytes)
            warm = data.qacc_warmstart.copy()  # as one unbroken run has it
            seen = record(model, alone, data, states, count, warm)
            assert seen is not None
            path[:, :, done : done + count], states = seen
            done = done + count if np.isfinite(seen[0]).all() else steps
    return Trajectory(np.arange(steps, dtype=np.float64) * model.timestep, *path[:, 0])


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(slots=True)
class _Fleet:
    """A model and the crowds made of it.

    most: balls that pay in one model. seen: steps that the last flight took.
    """

    model: Loaded
    most: int
    crowds: dict[int, Crowd] = field(default_factory=dict)
    seen: int = 0

    @classmethod
    def of(cls, model: Loaded) -> _Fleet:
        """Of no crowd yet but that of one. The model's solver starts each step from scratch from now on."""
        model.model.opt.disableflags |= model.mujoco.mjtDisableBit.mjDSBL_WARMSTART
        rows = max(model.model.npair, model.model.ntendon)
        most = _CROWD if rows <= _FEW_ROWS else _CROWD_OF_ROWS
        crowds = not model.plugged and can_crowd(model.mujoco, model.model, model.root)
        return cls(model, most if crowds else 1, {1: Crowd(model.model, 1, model.at)})

    def crowd(self, size: int) -> Crowd:
        """The model of so many balls."""
        if size not in self.crowds:
            own = self.model
            self.crowds[size] = crowd(own.mujoco, own.root, own.model.opt.disableflags, size, own.at)
        return self.crowds[size]

    def groups(self, launches: Sequence[Launch]) -> list[list[int]]:
        """Which launches fly together: alike, as then they take equally long."""
        total = len(launches)
        order = sorted(range(total), key=lambda i: (launches[i].height or 0.0, launches[i].speed))
        most = self.most if self.size(total, self.expected(launches)) > 1 else _ALONE
        count = max(1, math.ceil(total / most), min(_cores(), total // _CROWD_OF_ROWS))
        share = max(1, math.ceil(total / count))
        return [order[i : i + share] for i in range(0, total, share)]

    def size(self, balls: int, steps: int) -> int:
        """How many of `balls` to put into one model for the `steps` to come."""
        return min(balls, self.most) if balls * steps * _GAIN_S > _COMPILE_S else 1

    def expected(self, launches: Sequence[Launch]) -> int:
        """Steps that a flight takes: of the one before, else by elastic contact of the scene's stiffness."""
        if self.seen or not launches:
            return self.seen
        scene, h, slowest = self.model.scene, self.model.timestep, launches[0]
        gap = slowest.gap(h)
        speed = math.sqrt(slowest.speed**2 + 2.0 * scene.gravity * gap)
        if not speed:
            return _SHORT
        law = HuntCrossley(scene.stiffness, 0.0, scene.exponent)
        contact = float(exact.duration(law, scene.mass, speed))
        return math.ceil((contact + 2.0 * gap / (slowest.speed + speed)) / h) + 8


class _Flight:
    """Launches that fly side by side, from release until each has ended."""

    def __init__(self, fleet: _Fleet, launches: Sequence[Launch]) -> None:
        self._fleet, self._launches = fleet, launches
        self._flying = np.arange(len(launches))
        self._states = np.stack([released(fleet.model, launch) for launch in launches])
        self._watch = Watch.over(fleet.model, launches)
        self._history: list[Floats] = []
        self._landed: dict[int, Impact] = {}

    def land(self) -> list[Impact]:
        """All of it; one impact for each launch, in order."""
        model, count = self._fleet.model, self._fleet.expected(self._launches)
        crowd = self._fleet.crowd(self._fleet.size(len(self._launches), count))
        data, together = model.mujoco.MjData(crowd.model), True
        while self._flying.size:
            seen = record(model, crowd, data, self._states, min(count, self._fitting(crowd)))
            if seen is None:
                together = False
            else:
                self._states = seen[1]
                self._end(seen[0])
                count = max(_SHORT, self._watch.steps // 8)
            size = self._company(crowd.size) if together else 1
            if size != crowd.size:
                crowd = self._fleet.crowd(size)
                data = model.mujoco.MjData(crowd.model)
        self._fleet.seen = self._watch.steps
        return [self._landed[i] for i in range(len(self._launches))]

    def _fitting(self, crowd: Crowd) -> int:
        """Steps whose states fit into a chunk."""
        return max(1, _CHUNK_BYTES // crowd.pack(self._states).nbytes)

    def _company(self, now: int) -> int:
        """The size of the crowd to go on in: half empty ones give way to smaller."""
        size = self._fleet.size(max(1, self._flying.size), self._watch.steps)
        return now if now >= size > now // 2 else min(1 << (size - 1).bit_length(), self._fleet.most)

    def _end(self, seen: Floats) -> None:
        """Take in a chunk, shape (3, b, n), and let those land that have ended."""
        counts = self._watch.add(*seen)
        self._history.append(seen)
        ended = counts > 0
        if not ended.any():
            return
        x, v, f = np.concatenate([chunk[:, ended] for chunk in self._history], axis=2)[:, :, : counts.max()]
        time = np.arange(x.shape[1]) * self._fleet.model.timestep
        which = self._flying[ended]
        impacts = impacts_of([self._launches[i] for i in which], time, x, v, f, counts[ended])
        self._landed.update(zip(which.tolist(), impacts, strict=True))
        going = ~ended
        self._flying, self._states = self._flying[going], self._states[going]
        self._history = [chunk[:, going] for chunk in self._history]
        self._watch.keep(going)
