"""Flies launches in MuJoCo, side by side, as many in one model as pay.

None of that is felt: neither company nor threads nor where a chunk of steps ends changes a bit.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.mujoco.backend import captured_warnings
from hcbench.engines.mujoco.batch import Crowd, crowd, kind_of
from hcbench.engines.mujoco.record import Bench, record, released
from hcbench.engines.mujoco.slide_joint import holds_one_row
from hcbench.errors import SettingError
from hcbench.impact import Trajectory, impacts_of
from hcbench.laws import closed_form
from hcbench.sim.stop import Watch
from hcbench.workers import in_worker

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.engines.mujoco.world import Loaded
    from hcbench.impact import Floats, Impact, Launch

# Balls in a model: the dense Jacobian of more costs more than their company saves.
_FEW_ROWS, _CROWD, _CROWD_OF_ROWS = 4, 24, 8
_CROWD_OF_ONE_ROW = 80
_ALONE = 32  # launches flown side by side, one in a model: bounds memory
_GAIN_S, _COMPILE_S = 1.5e-6, 5e-3  # what company saves a ball-step, and costs to compile
_ABREAST = 2  # flights: one is looked at while the other one is stepped
_MOST_STEPS = 2_000_000  # of one launch, whatever the step
_CONTACT_S = 0.5  # how long a ball may stay in contact before it counts as resting there
_AT_REST, _STILL = 1e-6, 32  # of its impact speed, for so many steps: a bounce turns around in far fewer
_SHORT, _CHUNK_BYTES = 8, 2**21  # steps in a chunk: the fewest, and how many fit


def fly(fleet: Fleet, launches: Sequence[Launch]) -> list[Impact]:
    """Each launch until it has parted or rests. Any number at once gives the same bits."""
    groups = fleet.groups(launches)
    flights = [_Flight(fleet, [launches[i] for i in group]) for group in groups]
    back: dict[int, Impact] = {}
    with captured_warnings(), ThreadPoolExecutor(_ABREAST) as pool:
        each = map if fleet.wide == 1 else pool.map
        for group, landed in zip(groups, each(_Flight.land, flights), strict=True):
            back.update(zip(group, landed, strict=True))
    return [back[i] for i in range(len(launches))]


def follow(model: Loaded, launch: Launch, steps: int) -> Trajectory:
    """All of `steps` steps after one launch; NaN from where MuJoCo gave up."""
    bench = Bench.of(model, Crowd(model.model, 1, model.at, sliding=False), 1, _CHUNK_BYTES)
    gaps, speeds = np.array([launch.gap(model.timestep)]), np.array([launch.speed])
    states, done = released(model, gaps, speeds), 0
    path = np.full((3, 1, steps), np.nan)
    with captured_warnings():
        while done < steps:
            warm = bench.data[0].qacc_warmstart.copy()  # as one unbroken run has it
            seen = record(model, bench, states, steps - done, warm)
            assert seen is not None
            count = seen[0].shape[2]
            path[:, :, done : done + count], states = seen
            done = done + count if np.isfinite(seen[0]).all() else steps
    return Trajectory(np.arange(steps, dtype=np.float64) * model.timestep, *path[:, 0])


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _watch(model: Loaded, gaps: Floats, speeds: Floats) -> Watch:
    """Raises SettingError for a launch that cannot arrive."""
    h = model.timestep
    at_touch = np.sqrt(speeds**2 + 2.0 * model.scene.gravity * gaps)
    if ((gaps > 0.0) & (at_touch == 0.0)).any():
        raise SettingError("speed", "0 m/s without gravity", "a speed above 0, or gravity to fall by")
    flight = np.divide(2.0 * gaps, speeds + at_touch, out=np.zeros_like(gaps), where=gaps > 0.0)
    patience = np.ceil(1.5 * flight / h) + math.ceil(_CONTACT_S / h) + 100
    return Watch.over(np.minimum(patience, _MOST_STEPS), _AT_REST * at_touch, _STILL)


@dataclass(slots=True)
class Fleet:
    """A model, the crowds made of it, and benches of theirs that nobody uses.

    most: balls that pay in one model. wide: models that are stepped at once. seen: steps that the last flight
    took.
    """

    model: Loaded
    most: int
    wide: int
    sliding: bool
    seen: int = 0
    crowds: dict[int, Crowd] = field(default_factory=dict)
    idle: dict[int, list[Bench]] = field(default_factory=dict)

    @classmethod
    def of(cls, model: Loaded) -> Fleet:
        """Of no crowd yet but that of one. The model's solver starts each step from scratch from now on."""
        model.model.opt.disableflags |= model.mujoco.mjtDisableBit.mjDSBL_WARMSTART
        kind, rows = kind_of(model), max(model.model.npair, model.model.ntendon)
        most = 1 if kind == "alone" else _CROWD if rows <= _FEW_ROWS else _CROWD_OF_ROWS
        if kind == "sliding" and holds_one_row(model.model):
            most = _CROWD_OF_ONE_ROW
        alone = {} if kind == "sliding" else {1: Crowd(model.model, 1, model.at, sliding=False)}
        wide = 1 if in_worker() else _cores()
        return cls(model, most, wide, kind == "sliding", crowds=alone)

    def crowd(self, size: int) -> Crowd:
        """The model of so many balls."""
        if size not in self.crowds:
            self.crowds[size] = crowd(self.model, size, self.sliding)
        return self.crowds[size]

    @contextmanager
    def bench(self, crowd: Crowd) -> Iterator[Bench]:
        """What a crowd is stepped in, for one user at a time."""
        idle = self.idle.setdefault(crowd.size, [])
        try:
            bench = idle.pop()
        except IndexError:
            bench = Bench.of(self.model, crowd, self.wide, _CHUNK_BYTES)
        yield bench
        idle.append(bench)

    def groups(self, launches: Sequence[Launch]) -> list[list[int]]:
        """Which launches fly together: alike, as then they take equally long."""
        total = len(launches)
        order = sorted(range(total), key=lambda i: (launches[i].height or 0.0, launches[i].speed))
        together = total > 1 and self.pays(total, self.expected(launches))
        share = math.ceil(
            total / max(1, math.ceil(total / ((self.most if together else _ALONE) * self.wide)))
        )
        if together:
            self.crowd(self.shared(share))
        return [order[i : i + share] for i in range(0, total, max(1, share))]

    def shared(self, balls: int) -> int:
        """How many of so many balls go into one model, as there are several at once."""
        return min(self.most, max(math.ceil(balls / self.wide), min(balls, _CROWD_OF_ROWS)))

    def pays(self, balls: int, steps: int) -> bool:
        """Whether so many steps of so many balls are worth a crowd."""
        return self.most > 1 and balls * steps * _GAIN_S > _COMPILE_S

    def expected(self, launches: Sequence[Launch]) -> int:
        """Steps that a flight takes: of the one before, else by elastic contact of the scene's stiffness."""
        if self.seen or not launches:
            return self.seen
        scene, h, slowest = self.model.scene, self.model.timestep, launches[0]
        gap = slowest.gap(h)
        speed = math.sqrt(slowest.speed**2 + 2.0 * scene.gravity * gap)
        if not speed:
            return _SHORT
        contact = closed_form.elastic_duration(scene.stiffness, scene.exponent, scene.mass, speed)
        return math.ceil((contact + 2.0 * gap / (slowest.speed + speed)) / h) + _SHORT


class _Flight:
    """Launches that fly side by side, from release until each has ended."""

    def __init__(self, fleet: Fleet, launches: Sequence[Launch]) -> None:
        self._fleet, self._launches = fleet, launches
        self._flying = np.arange(len(launches))
        gaps = np.array([launch.gap(fleet.model.timestep) for launch in launches])
        speeds = np.array([launch.speed for launch in launches])
        self._states = released(fleet.model, gaps, speeds)
        self._watch = _watch(fleet.model, gaps, speeds)
        self._history: list[Floats] = []
        self._landed: dict[int, Impact] = {}
        self._longest = 0

    def land(self) -> list[Impact]:
        """All of it; one impact for each launch, in order."""
        fleet, count = self._fleet, self._fleet.expected(self._launches)
        fits = [size for size in list(fleet.crowds) if size >= fleet.shared(len(self._launches))]
        size, together = min(fits, default=1), True
        while self._flying.size:
            crowd = fleet.crowd(size)
            with fleet.bench(crowd) as bench:
                seen = record(fleet.model, bench, self._states, count)
            if seen is None:
                together = False
            else:
                self._states = seen[1]
                self._end(seen[0])
                # A share of what was: nobody knows how long a contact lasts that is longer than expected.
                count = max(_SHORT, self._watch.steps // 8)
            size = self._company(size) if together else 1
        fleet.seen = self._longest
        return [self._landed[i] for i in range(len(self._launches))]

    def _company(self, now: int) -> int:
        """How many balls the model to go on in should have: a few of many are better off alone."""
        left, most = self._fleet.shared(self._flying.size), self._fleet.most
        if now > 1 and left <= now // 8:
            return 1
        if (now == 1 < left or left <= now // 2) and self._fleet.pays(left, self._watch.steps):
            return min(1 << (left - 1).bit_length(), most)
        return now

    def _end(self, seen: Floats) -> None:
        """Take in a chunk, shape (3, b, n), and let those land that have ended."""
        counts = self._watch.add(*seen)
        self._history.append(seen)
        ended = counts > 0
        if not ended.any():
            return
        going, self._longest = ~ended, int(counts.max())
        if going.any() or len(self._history) > 1:
            seen = np.concatenate([chunk[:, ended] for chunk in self._history], axis=2)
        time = np.arange(self._longest, dtype=np.float64) * self._fleet.model.timestep
        which = self._flying[ended].tolist()
        launches = [self._launches[i] for i in which]
        x, v, f = seen[:, :, : self._longest]
        impacts = impacts_of(launches, time, x, v, f, counts[ended])
        self._landed.update(zip(which, impacts, strict=True))
        self._flying, self._states = self._flying[going], self._states[going]
        self._history = [chunk[:, going] for chunk in self._history]
        self._watch.keep(going)
