"""MuJoCo: one launch of a placed pair, stepped as the user's own loop would step it."""

from __future__ import annotations

import copy
import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.model import approach_row, geom_name
from hcbench.engines.mujoco.touch import side_table
from hcbench.impact import Impact, Launch, Status
from hcbench.sim.recorder import MAX_STEPS, Track, patience

if TYPE_CHECKING:
    from hcbench.engines.mujoco.place import Placement
    from hcbench.impact import Floats

_STAGE_NOISE = 1e-9  # of the largest change of speed: below it a step under RK4 had no contact in it


class Flight:
    """Flies launches of one placement; the model is only read."""

    def __init__(self, model: Any, start: Any, place: Placement) -> None:
        mujoco = backend()
        self.model, self.start, self.place = model, start, place
        self.table = side_table(model, place.first, place.second)
        # RK4 leaves its last stage in the data: the state before the step is looked at beside it.
        self.staged = int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
        self.others: set[int] = set()  # geoms that touched the two meanwhile
        self._free: list[float] = []  # approach acceleration without contact, RK4 only

    def fly(self, launch: Launch) -> Impact:
        """One impact, as the engine makes it."""
        with captured_warnings():
            track = self._run(launch)
        return self._told(track.impact(launch))

    def _told(self, impact: Impact) -> Impact:
        """With the name of what was in the way, where something was."""
        if impact.status not in (Status.NO_TOUCH, Status.DIVERGED) or not self.others:
            return impact
        names = ", ".join(sorted(geom_name(self.model, g) for g in self.others)[:4])
        return dataclasses.replace(impact, reason=f"{impact.reason}; other contacts acted: {names}")

    def _hidden_force(self, track: Track, h: float) -> float:
        """Mean force of the last whole step, where the state before it had none but a stage of it did."""
        change = (track.rate[-2] - track.rate[-1]) / h
        mean = change + self._free[-2]
        noise = _STAGE_NOISE * max(abs(v) for v in track.rate[-2:]) / h
        return self.place.effective_mass * mean if abs(mean) > noise else 0.0

    def _launched(self, launch: Launch) -> tuple[Any, float]:
        """(MjData at release, clearance)."""
        mujoco = backend()
        data = copy.copy(self.start)
        gap = launch.gap(float(self.model.opt.timestep))
        data.qpos[:] = self.place.qpos
        mujoco.mj_integratePos(self.model, data.qpos, self.place.direction, -gap)
        data.qvel[:] = launch.speed * self.place.direction
        data.time = 0.0
        return data, gap

    def _run(self, launch: Launch) -> Track:
        mujoco, model = backend(), self.model
        data, gap = self._launched(launch)
        seen = mujoco.MjData(model) if self.staged else data
        h = float(model.opt.timestep)
        self._free = []
        g = float(np.linalg.norm(model.opt.gravity))
        track = Track(h, fall=g * h)
        wait = patience(launch.speed, gap, launch.height is not None, h, g)
        reader = _Reader(model, self.place, _at(data, model))
        x = -gap
        for step in range(MAX_STEPS):
            if self.staged:
                _copy_state(model, data, seen)
                mujoco.mj_forward(model, seen)
            before, then = data.qvel.copy(), data.time
            mujoco.mj_step(model, data)
            if data.time <= then:
                track.verdict, track.reason = Status.DIVERGED, "MuJoCo found the state unstable and reset it"
                return track
            depth, force, rate = reader.read(seen, before)
            x = depth if depth is not None else min(x, 0.0) if track.touched >= 0 else x
            track.penetration.append(x)
            track.rate.append(rate)
            track.force.append(force)
            if self.staged:
                self._free.append(float(reader.row(seen) @ seen.qacc_smooth))
                if step and track.force[-2] == 0.0:
                    track.force[-2] = self._hidden_force(track, h)
            if track.touched < 0 and any(track.force[-2:]):
                track.touched = step if force else step - 1
            if seen.ncon > reader.count:
                self.others |= _others(model, seen, self.table, self.place)
            if track.is_over(wait):
                return track
            x = x + h * rate
        track.give_up()
        return track


class _Reader:
    """Reads depth, force and rate of the pair off an MjData that belongs to one state."""

    def __init__(self, model: Any, place: Placement, data: Any) -> None:
        mujoco = backend()
        self.model, self.place, self.count = model, place, 0
        self.table = side_table(model, place.first, place.second).tolist()
        self.pyramid = int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
        self.wrench = np.zeros(6)
        self.force_of = mujoco.mj_contactForce
        self.point, self.normal = place.contact.point, place.contact.normal
        self._row: Floats | None = None
        self.row(data)

    def row(self, data: Any) -> Floats:
        """(nv,) approach row at the last contact, from the kinematics in `data`."""
        if self._row is None:
            first, second = self.place.first.body, self.place.second.body
            self._row = approach_row(self.model, data, first, second, self.point, self.normal)
        return self._row

    def read(self, data: Any, velocity: Floats) -> tuple[float | None, float, float]:
        """(penetration beyond the onset, None without a contact; force; approach rate)."""
        mine = []
        for i in range(data.ncon):
            contact = data.contact[i]
            a, b = contact.geom.tolist()
            if self.table[a] + self.table[b] == 3:
                mine.append((i, contact, self.table[a] == 2))
        self.count = len(mine)
        if not mine:
            return None, 0.0, float(self.row(data) @ velocity)
        force, distance, acting = 0.0, math.inf, []
        for i, contact, _ in mine:
            distance = min(distance, contact.dist)
            address = contact.efc_address
            if address >= 0:
                self.force_of(self.model, data, i, self.wrench)
                force += float(self.wrench[0])
                acting.append(self._parting_rate(data, address, contact.dim))
        self.point = mine[0][1].pos.copy() if len(mine) == 1 else np.mean([c.pos for _, c, _ in mine], axis=0)
        _, contact, turned = mine[0]
        self.normal = -contact.frame[:3] if turned else contact.frame[:3].copy()
        self._row = None
        rate = -sum(acting) / len(acting) if acting else float(self.row(data) @ velocity)
        return self.place.contact.onset - distance, force, rate

    def _parting_rate(self, data: Any, address: int, dim: int) -> float:
        """Rate along the normal, as the engine has it: the two edges of a pyramid lie evenly about it."""
        velocity = data.efc_vel
        if dim == 1 or not self.pyramid:
            return float(velocity[address])
        return 0.5 * float(velocity[address] + velocity[address + 1])


def _at(data: Any, model: Any) -> Any:
    """`data` with its kinematics computed at its state."""
    mujoco = backend()
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data


def _copy_state(model: Any, source: Any, target: Any) -> None:
    mujoco = backend()
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, source, state, kind)
    mujoco.mj_setState(model, target, state, kind)


def _others(model: Any, data: Any, table: Any, place: Placement) -> set[int]:
    """Geoms that touch the moving tree, or the other one's, besides the pair."""
    roots = {int(model.body_rootid[b]) for b in (place.first.body, place.second.body) if b}
    found = set()
    for i in range(data.ncon):
        geoms = [int(g) for g in data.contact.geom[i]]
        if data.contact.efc_address[i] < 0 or min(geoms) < 0 or table[geoms[0]] + table[geoms[1]] == 3:
            continue
        in_tree = [int(model.body_rootid[model.geom_bodyid[g]]) in roots for g in geoms]
        if any(in_tree):
            found |= {g for g, inside in zip(geoms, in_tree, strict=True) if not inside or all(in_tree)}
    return found
