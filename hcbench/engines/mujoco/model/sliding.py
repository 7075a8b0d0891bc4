"""MuJoCo: how a placed pair is sent along the plate, and what it does there."""

from __future__ import annotations

from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.place import PairAtTouch
from hcbench.sim.model_under_test import Vector
from hcbench.sim.tangential import plate_frame
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats, Launch

_MISSED = 1e-9  # of the motion asked for, that joints may leave out


class MujocoAlongPlate:
    """One launch along the plate. friction: on the moving body in the step that is read, N, in the world."""

    def __init__(self, place: PairAtTouch, launch: Launch, along: Vector | None) -> None:
        self.place, self.pair, self.launch = place, place.pair, launch
        self.axes = plate_frame(place.contact.normal, along)
        self.body, self.friction, self._origin = self.pair.first.body, np.zeros(3), np.zeros(3)
        self._alone = not self.pair.more_than_contacts
        launched = (self.pair.first, self.pair.second) if self._alone else (self.pair.first,)
        root = self.pair.model.body_rootid
        self._moving = np.isin(root[self.pair.model.dof_bodyid], [root[part.body] for part in launched])

    def send(self, data: Any, flight_time: float) -> None:
        """Add slip and spin to the motion, and put the body back by what they move it in the flight, s."""
        mujoco, model, launch = backend(), self.pair.model, self.launch
        start = data.qpos.copy()
        data.qpos[:] = self.place.qpos
        mujoco.mj_kinematics(model, data)
        self.seen(data)  # at touch: where the contact point that is known beforehand is
        data.qpos[:] = start
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        asked = np.concatenate([np.array([*launch.slip, 0.0]) @ self.axes, np.array(launch.spin) @ self.axes])
        jacobian, centre = np.zeros((6, model.nv)), data.xipos[self.body].copy()
        mujoco.mj_jac(model, data, jacobian[:3], jacobian[3:], centre, self.body)
        dofs = self._dofs()
        motion = np.linalg.lstsq(jacobian[:, dofs], asked, rcond=None)[0]
        if np.abs(jacobian[:, dofs] @ motion - asked).max() > _MISSED * np.abs(asked).max():
            slot, what = ("spin", "turn") if any(launch.spin) else ("angle", "move along the plate")
            got = f"{self.place.joint.description} cannot {what} as launched"
            raise UserError(slot, got, "a free joint, or slides along the plate")
        velocity = np.zeros(model.nv)
        velocity[dofs] = motion
        mujoco.mj_integratePos(model, data.qpos, velocity, -flight_time)
        data.qvel[:] += velocity

    def _dofs(self) -> list[int]:
        """Degrees of freedom of the launched joint, the turns of a free joint included."""
        model, dofs = self.pair.model, list(self.place.joint.dofs)
        joint = int(model.dof_jntid[dofs[0]])
        free = int(model.jnt_type[joint]) == int(backend().mjtJoint.mjJNT_FREE)
        return list(range(dofs[0], dofs[0] + 6)) if free else dofs

    def moved_with(self, data: Any, point: Floats) -> Floats:
        """A contact point as the moving body's centre has carried it along since it was seen."""
        return np.asarray(point + data.xipos[self.body] - self._origin)

    def seen(self, data: Any) -> None:
        """Note that a contact point was seen in this state."""
        self._origin = data.xipos[self.body].copy()

    def push(self, frame: Floats, wrench: Floats, turned: bool) -> None:
        """Add the friction of one contact. frame: its axes, (9,). turned: the moving geom is its second."""
        pushed = wrench[1] * frame[3:6] + wrench[2] * frame[6:9]
        self.friction = self.friction + (pushed if turned else -pushed)

    def row(self, data: Any, velocity: Floats, point: Floats, rate: float) -> Floats:
        """Motion along the plate, see `Record.tangential`, shape (8,). rate: of approach, m/s."""
        model, pair, mujoco = self.pair.model, self.pair, backend()
        rows = [pair.approach_row(data, point, axis) for axis in self.axes[:2]]
        spin = np.zeros(3)
        for sign, body in ((1.0, pair.first.body), (-1.0, pair.second.body)):
            turns = np.zeros((3, model.nv))
            mujoco.mj_jacBody(model, data, None, turns, body)
            spin += sign * (turns @ velocity)
        energy = self._kinetic_energy(data, velocity, point) - 0.5 * self.place.effective_mass * rate**2
        friction, self.friction = self.axes[:2] @ self.friction, np.zeros(3)
        return np.array([*(row @ velocity for row in rows), *(self.axes @ spin), *friction, energy])

    def _kinetic_energy(self, data: Any, velocity: Floats, point: Floats) -> float:
        """Kinetic energy of the two bodies, J; where joints act, of the launched one against the other."""
        model, mujoco, centre = self.pair.model, backend(), np.zeros((3, self.pair.model.nv))
        own, momentum = np.where(self._moving, velocity, 0.0), np.zeros(model.nv)
        mujoco.mj_mulM(model, data, momentum, own)
        energy = 0.5 * float(own @ momentum)
        if self._alone:
            return energy
        root, seen_from = int(model.body_rootid[self.body]), np.zeros((3, model.nv))
        mujoco.mj_jacSubtreeCom(model, data, centre, root)
        mujoco.mj_jac(model, data, seen_from, None, point, self.pair.second.body)
        frame = seen_from @ velocity
        return energy + float(model.body_subtreemass[root]) * float(frame @ (0.5 * frame - centre @ own))
