"""MuJoCo: one launch of a placed pair, stepped as the user's own loop would step it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.impact import Impact, Launch, Status, Trajectory, impact_of
from hcbench.measure.mujoco_load import backend, listening
from hcbench.measure.mujoco_place import approach_row, side_table

if TYPE_CHECKING:
    from hcbench.impact import Floats
    from hcbench.measure.mujoco_place import Placement

MAX_STEPS = 200_000
_AT_REST = 1e-3  # of the speed in: slower than this for as long as the contact has lasted so far
_PATIENCE = 128  # steps in contact before the first look for rest
_FLIGHT_SLACK = 100  # steps beyond the expected flight in which the touch must come
_STAGE_NOISE = 1e-9  # of the largest change of speed: below it a step under RK4 had no contact in it


@dataclass(slots=True)
class _Track:
    """What is written down on the way; one entry a step, the state before it."""

    penetration: list[float] = field(default_factory=list)
    rate: list[float] = field(default_factory=list)
    force: list[float] = field(default_factory=list)
    free: list[float] = field(default_factory=list)  # approach acceleration without contact, RK4 only
    others: set[int] = field(default_factory=set)
    verdict: Status | None = None
    reason: str = ""
    touched: int = -1


class Flight:
    """Flies launches of one placement; the model is only read."""

    def __init__(self, model: Any, start: Any, place: Placement) -> None:
        mujoco = backend()
        self.model, self.start, self.place = model, start, place
        self.table = side_table(model, place.first, place.second)
        # RK4 leaves its last stage in the data: the state before the step is looked at beside it.
        self.staged = int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
        self.others: set[int] = set()

    def fly(self, launch: Launch) -> Impact:
        """One impact, as the engine makes it."""
        with listening():
            track = self._run(launch)
        self.others |= track.others
        h = float(self.model.opt.timestep)
        force, rate = np.array(track.force, np.float64), np.array(track.rate, np.float64)
        if track.verdict is not None:
            seen = int(np.count_nonzero(force)) if track.verdict is not Status.NO_TOUCH else 0
            return Impact(launch, track.verdict, track.reason, samples=seen)
        time = np.arange(len(rate), dtype=np.float64) * h
        impact = impact_of(launch, Trajectory(time, np.array(track.penetration, np.float64), rate, force))
        if impact.status is Status.RESTED and track.reason:
            return dataclasses.replace(impact, reason=track.reason)
        return impact

    def _hidden_force(self, track: _Track, h: float) -> float:
        """Mean force of the last whole step, where the state before it had none but a stage of it did."""
        change = (track.rate[-2] - track.rate[-1]) / h
        mean = change + track.free[-2]
        noise = _STAGE_NOISE * max(abs(v) for v in track.rate[-2:]) / h
        return self.place.effective_mass * mean if abs(mean) > noise else 0.0

    def _launched(self, launch: Launch) -> tuple[Any, float]:
        """(MjData at release, clearance)."""
        mujoco = backend()
        data = mujoco.MjData(self.model)
        mujoco.mj_copyData(data, self.model, self.start)
        gap = launch.gap(float(self.model.opt.timestep))
        data.qpos[:] = self.place.qpos
        mujoco.mj_integratePos(self.model, data.qpos, self.place.direction, -gap)
        data.qvel[:] = launch.speed * self.place.direction
        data.time = 0.0
        return data, gap

    def _run(self, launch: Launch) -> _Track:
        mujoco, model = backend(), self.model
        data, gap = self._launched(launch)
        seen = mujoco.MjData(model) if self.staged else data
        track, h = _Track(), float(model.opt.timestep)
        patience = _flight_steps(launch, gap, h, float(np.linalg.norm(model.opt.gravity)))
        contact = self.place.contact
        row = approach_row(
            model,
            _at(data, model),
            self.place.first.body,
            self.place.second.body,
            contact.point,
            contact.normal,
        )
        x = -gap
        for step in range(MAX_STEPS):
            if self.staged:
                _copy_state(model, data, seen)
                mujoco.mj_forward(model, seen)
            before = data.qvel.copy()
            mujoco.mj_step(model, data)
            if _unstable(data):
                track.verdict, track.reason = Status.DIVERGED, "MuJoCo found the state unstable and reset it"
                return track
            read = self._read(seen, track)
            if read is not None:
                x, force, row = read
            else:
                force, x = 0.0, min(x, 0.0) if track.touched >= 0 else x
            rate = float(row @ before)
            track.penetration.append(x)
            track.rate.append(rate)
            track.force.append(force)
            if self.staged:
                track.free.append(float(row @ seen.qacc_smooth))
                if step and track.force[-2] == 0.0:
                    track.force[-2] = self._hidden_force(track, h)
            if track.touched < 0 and any(track.force[-2:]):
                track.touched = step if force else step - 1
            if self._is_over(track, step, patience):
                return track
            x = x + h * rate
        track.verdict = Status.CRASHED
        track.reason = f"still in contact after {MAX_STEPS} steps ({MAX_STEPS * h:.3g} s)"
        return track

    def _read(self, data: Any, track: _Track) -> tuple[float, float, Floats] | None:
        """(penetration beyond the onset, force, approach row) of the pair's contact; None without one."""
        mujoco, place = backend(), self.place
        if not data.ncon:
            return None
        geoms = data.contact.geom
        mine = np.flatnonzero(self.table[geoms[:, 0]] + self.table[geoms[:, 1]] == 3)
        if mine.size < data.ncon and track.touched >= 0:
            track.others |= _others(self.model, data, mine, place)
        if not mine.size:
            return None
        total, wrench = 0.0, np.zeros(6)
        for i in mine:
            mujoco.mj_contactForce(self.model, data, int(i), wrench)
            total += wrench[0]
        point = data.contact.pos[mine].mean(axis=0)
        first = int(mine[0])
        normal = data.contact.frame[first, :3]
        if self.table[geoms[first, 0]] == 2:
            normal = -normal
        row = approach_row(self.model, data, place.first.body, place.second.body, point, normal)
        return place.contact.onset - float(data.contact.dist[mine].min()), float(total), row

    def _is_over(self, track: _Track, step: int, patience: int) -> bool:
        """Whether nothing more can happen to this impact; sets the verdict where there is none to compute."""
        if track.touched < 0:
            if step > patience or track.rate[-1] < 0:
                track.verdict = Status.NO_TOUCH
                track.reason = "turned back without a contact force of the pair"
                if track.rate[-1] >= 0:
                    track.reason = f"no contact force within {step} steps"
                return True
            return False
        if track.force[-1] == 0.0 and track.penetration[-1] <= 0.0 and track.rate[-1] < 0.0:
            return True
        lasted = step - track.touched
        if lasted >= _PATIENCE and lasted & (lasted - 1) == 0:  # at powers of two
            recent = max(abs(v) for v in track.rate[-lasted // 2 :])
            if recent < _AT_REST * abs(track.rate[track.touched]):
                track.reason = f"slower than {_AT_REST:g} of its impact speed for {lasted // 2} steps"
                return True
        return False


def _flight_steps(launch: Launch, gap: float, h: float, g: float) -> int:
    """Steps within which the touch must come."""
    flight = gap / launch.speed if launch.speed > 0 else 0.0
    fall = (2 * gap / g) ** 0.5 if g > 0 and launch.height is not None else 0.0
    return min(MAX_STEPS - 1, int(4 * max(flight, fall) / h) + _FLIGHT_SLACK)


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


def _unstable(data: Any) -> bool:
    """Whether the engine has met a state that it gave up on; it resets it unless told not to."""
    kinds = backend().mjtWarning
    bad = (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
    return any(data.warning[int(kind)].number for kind in bad)


def _others(model: Any, data: Any, mine: Any, place: Placement) -> set[int]:
    """Geoms that touch the moving tree, or the other one's, besides the pair."""
    roots = {int(model.body_rootid[b]) for b in (place.first.body, place.second.body) if b}
    found = set()
    for i in set(range(data.ncon)) - {int(i) for i in mine}:
        geoms = [int(g) for g in data.contact.geom[i]]
        if data.contact.efc_address[i] < 0 or min(geoms) < 0:
            continue
        in_tree = [int(model.body_rootid[model.geom_bodyid[g]]) in roots for g in geoms]
        if any(in_tree):
            found |= {g for g, inside in zip(geoms, in_tree, strict=True) if not inside or all(in_tree)}
    return found
