"""MuJoCo: one launch of a placed pair, stepped as the user's own loop would step it."""

from __future__ import annotations

import copy
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings, forget_resets, resets
from hcbench.engines.mujoco.model.bodies import geom_name
from hcbench.engines.mujoco.model.pair_reader import PairReader, with_kinematics
from hcbench.engines.mujoco.model.plugin_contact import WithoutContact, restitution_law
from hcbench.engines.mujoco.model.sliding import MujocoAlongPlate
from hcbench.engines.mujoco.model.speed_shares import NAMES, SpeedShares, strange_share
from hcbench.impact import TANGENTIAL_ROWS
from hcbench.sim.world import Record, Simulation

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hcbench.engines.mujoco.model.place import PairAtTouch
    from hcbench.impact import Floats, Launch
    from hcbench.sim.model_under_test import Vector
    from hcbench.sim.world import Flags


class _Step(NamedTuple):
    """The state before a step; free: the rate after it without contact, RK4 near a touch only, else NaN."""

    x: float
    rate: float
    force: float
    free: float
    along: Floats | None  # what `Record.tangential` has, oblique launches only


_NEAR = 4.0  # steps of the way to the touch plane, within which distances are looked at without a contact
_STAGE_REACH = 1.05  # steps of its approach, within which a stage of RK4 may touch
_STAGE_NOISE = 1e-9  # of the largest change of speed: below it a step under RK4 had no contact in it


class MujocoUserSimulation(Simulation):
    """One launch of a placed pair; the model is only read.

    others: geoms that touched the two in launches until now; those of this one are added.
    shares: of the speed at touch, what the approach lost to each cause, in the launch until now in which
        joints and actuators took the most; kept up.
    along: the way that oblique launches take. gravity: as a `World` has it, m/s².
    """

    def __init__(
        self,
        model: Any,
        start: Any,
        place: PairAtTouch,
        launch: Launch,
        others: set[int],
        shares: dict[str, float],
        along: Vector | None = None,
        gravity: float = 0.0,
    ) -> None:
        self._mujoco = mujoco = backend()
        self._model, self._place = model, place
        self._h = float(model.opt.timestep)
        self._data = copy.copy(start)
        clearance = launch.clearance_in_phase(self._h, gravity)
        self._data.qpos[:] = place.qpos
        mujoco.mj_integratePos(model, self._data.qpos, place.direction, -clearance)
        self._data.qvel[:] = launch.speed * place.direction
        self._data.time = 0.0
        forget_resets(self._data)
        self._along = MujocoAlongPlate(place, launch, along) if launch.is_oblique else None
        if self._along is not None:
            self._along.send(self._data, launch.flight_time(self._h, gravity))
        # RK4 leaves its last stage in the data: the state before the step is looked at beside it.
        self._staged = int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
        self._seen = mujoco.MjData(model) if self._staged else self._data
        self._free: Any = mujoco.MjData(model) if self._staged else None
        self._reader = PairReader(model, place, with_kinematics(self._data, model), self._along)
        self._x, self._rate, self._touched, self._steps = -clearance, launch.speed, False, 0
        self._last: _Step | None = None  # RK4 only: waits for the one after it
        plugged = restitution_law(model, place.contact.rows[0][2]) is not None
        self._beside = WithoutContact(model) if plugged else None
        self._noise = _STAGE_NOISE
        self._others, self._shares = others, shares
        tells = not self._staged and place.pair.more_than_contacts
        self._causes = SpeedShares(model, place.pair.sides) if tells else None
        self._touch_speed, self._apart = math.nan, False  # apart: what follows is no part of the impact
        self._in_tree = place.pair.in_trees
        self._first_touch: dict[int, int] = {}  # geoms that touched the two, and in which step first

    def advance(self, steps: int) -> Record:
        """Steps as the user's own loop would take them; the last is NaN where MuJoCo reset the state."""
        rows: list[_Step] = []
        with captured_warnings():
            while len(rows) < steps and (not rows or math.isfinite(rows[-1].rate)):
                step = self._step()
                if not self._staged:
                    rows.append(step)
                    continue
                if self._last is not None:
                    rows.append(self._with_hidden_force(self._last, step))
                self._last = step
        x, v, f = np.array([(row.x, row.rate, row.force) for row in rows]).T[:, None]
        seen = [row.along for row in rows if row.along is not None]
        return Record(x, v, f, np.array(seen).T[:, None] if seen else None)

    def keep(self, which: Flags) -> None:
        """Keep the one launch that there is."""

    def note(self, steps: int) -> str:
        """Which contacts besides the pair's acted in the first steps."""
        touched = {geom for geom, step in self._first_touch.items() if step < steps}
        self._others |= touched
        names = ", ".join(sorted(geom_name(self._model, geom) for geom in touched)[:4])
        if self._causes is not None and not self._touched:
            taken = dict(zip(NAMES, self._causes.taken.tolist(), strict=True))
            name = max(taken, key=lambda cause: taken[cause])
            return f"what slowed it most: {name}" if taken[name] > 0 else ""
        return f"other contacts acted: {names}" if names else ""

    def close(self) -> None:
        """Return the speed lost to each cause."""
        if self._causes is not None and self._touched and self._touch_speed > 0:
            shares = dict(zip(NAMES, (self._causes.taken / self._touch_speed).tolist(), strict=True))
            if not self._shares or strange_share(shares) > strange_share(self._shares):
                self._shares |= shares

    def _step(self) -> _Step:
        mujoco, model, data, seen = self._mujoco, self._model, self._data, self._seen
        if self._staged:
            _copy_state(model, data, seen)
            mujoco.mj_forward(model, seen)
        before, then = data.qvel.copy(), data.time
        if self._beside is not None:
            _copy_state(model, data, self._beside.data)
        self._take_step(data)
        self._steps += 1
        if data.time <= then or (self._steps == 1 and resets(data)):
            unknown = None if self._along is None else np.full(TANGENTIAL_ROWS, math.nan)
            return _Step(math.nan, math.nan, math.nan, math.nan, unknown)
        depth, force, rate = self._reader.read(seen, before)
        if depth is not None:
            force, self._x = self._force(force, seen), depth
        elif self._steps > 1:
            # As the integrator has moved it: by the new velocity, under RK4 by the mean.
            self._x += self._h * (0.5 * (self._rate + rate) if self._staged else rate)
            if abs(self._x) < _NEAR * self._h * max(abs(rate), abs(self._rate)):
                self._x = self._reader.depth(seen, self._x)
            self._x = min(self._x, 0.0) if self._touched else self._x
        self._rate = rate
        near = self._staged and force == 0.0 and self._x + _STAGE_REACH * self._h * max(rate, 0.0) > 0.0
        free = self._rate_without_contact() if near else math.nan
        along = None
        if self._along is not None:
            along = self._along.row(seen, before, self._reader.contact_point(seen), rate)
        step = _Step(self._x, rate, force, free, along)
        self._apart |= self._touched and force == 0.0 and self._x <= 0.0 and rate < 0.0
        if self._causes is not None and not self._apart and (force != 0.0 or not self._touched):
            if force != 0.0 and not self._touched:
                self._causes.taken[:], self._touch_speed = 0.0, rate
            self._causes.add(seen, self._reader.row(seen))
        self._touched |= force != 0.0
        if seen.ncon > self._reader.count:
            for geom in _others(seen, self._place.pair.sides, self._in_tree):
                self._first_touch.setdefault(geom, self._steps - 1)
        return step

    def _take_step(self, data: Any) -> None:
        """Move `data` on by a step, with the constraints and forces of the state before it left in it."""
        self._mujoco.mj_step(self._model, data)

    def _force(self, solved: float, seen: Any) -> float:
        """The pair's force in the step just taken, N. solved: by MuJoCo's solver. seen: the state before."""
        if self._beside is None:
            return solved
        return self._beside.force(self._reader.row(seen), self._data.qvel, self._place.effective_mass)

    def _rate_without_contact(self) -> float:
        """The approach rate after the step from the state in `_seen`, had no contact acted in it."""
        model, data = self._model, self._free
        _copy_state(model, self._seen, data)
        flags = model.opt.disableflags
        model.opt.disableflags = flags | int(self._mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self._mujoco.mj_step(model, data)
        model.opt.disableflags = flags
        reader = self._reader
        point = reader.contact_point(with_kinematics(data, model))
        return float(self._place.pair.approach_row(data, point, reader.normal) @ data.qvel)

    def _with_hidden_force(self, step: _Step, after: _Step) -> _Step:
        """A step with its mean force, where a stage of RK4 had one but the state before had none."""
        if step.force != 0.0 or math.isnan(step.free):
            return step
        mean = (step.free - after.rate) / self._h
        noise = self._noise * max(abs(step.rate), abs(after.rate)) / self._h
        if not abs(mean) > noise:
            return step
        self._touched = True
        return step._replace(force=self._place.effective_mass * mean)


def _copy_state(model: Any, source: Any, target: Any) -> None:
    mujoco = backend()
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, source, state, kind)
    mujoco.mj_setState(model, target, state, kind)


def _others(data: Any, sides: NDArray[np.int8], in_tree: NDArray[np.bool_]) -> set[int]:
    """Geoms that touch the moving tree, or the other one's, besides the pair. in_tree: (ngeom + 1,)."""
    geoms = data.contact.geom
    acting = (data.contact.efc_address >= 0) & (geoms.min(axis=1) >= 0)
    geoms = geoms[acting & (sides[geoms].sum(axis=1) != 3)]
    inside = in_tree[geoms]
    theirs = inside.any(axis=1)[:, None] & (~inside | inside.all(axis=1)[:, None])
    return set(geoms[theirs].tolist())
