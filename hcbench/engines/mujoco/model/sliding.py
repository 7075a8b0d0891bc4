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

# Share of the motion asked for that joints may leave out.
_MISSED = 1e-9


class MujocoAlongPlate:
    """One launch along the plate.

    friction: on the moving body in the step that is read, N, in the world.
    """

    def __init__(self, place: PairAtTouch, launch: Launch, along: Vector | None) -> None:
        self.place = place
        self.pair = place.pair
        self.launch = launch
        self.axes = plate_frame(place.contact.normal, along)
        self.body = self.pair.first.body
        self.friction = np.zeros(3)
        # Moving body's centre, m, in the state in which the contact point was seen last.
        self._origin = np.zeros(3)
        self._alone = not self.pair.more_than_contacts
        model = self.pair.model
        moving = [model.body_rootid[self.pair.first.body]]
        if self._alone:
            moving.append(model.body_rootid[self.pair.second.body])
        self._moving = np.isin(model.body_rootid[model.dof_bodyid], moving)

    def send(self, data: Any, flight_time: float) -> None:
        """Add slip (m/s) and spin (rad/s) to the motion, and put the body
        back by their way in the flight.

        flight_time: from release to touch, s. Raises UserError where the
        joints cannot make the motion.
        """
        mujoco = backend()
        model = self.pair.model
        launch = self.launch
        start = data.qpos.copy()
        data.qpos[:] = self.place.qpos
        mujoco.mj_kinematics(model, data)
        # The contact point is known beforehand at touch.
        self.seen(data)
        data.qpos[:] = start
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        slip = np.array([*launch.slip, 0.0]) @ self.axes
        spin = np.array(launch.spin) @ self.axes
        asked = np.concatenate([slip, spin])
        jacobian = np.zeros((6, model.nv))
        centre = data.xipos[self.body].copy()
        mujoco.mj_jac(model, data, jacobian[:3], jacobian[3:], centre, self.body)
        dofs = self._dofs()
        motion = np.linalg.lstsq(jacobian[:, dofs], asked, rcond=None)[0]
        missed = np.abs(jacobian[:, dofs] @ motion - asked).max()
        if missed > _MISSED * np.abs(asked).max():
            slot, what = ("spin", "turn") if any(launch.spin) else ("angle", "move along the plate")
            got = f"{self.place.joint.description} cannot {what} as launched"
            raise UserError(slot, got, "a free joint, or slides along the plate")
        velocity = np.zeros(model.nv)
        velocity[dofs] = motion
        mujoco.mj_integratePos(model, data.qpos, velocity, -flight_time)
        data.qvel[:] += velocity

    def _dofs(self) -> list[int]:
        """Degrees of freedom of the launched joint, the turns of a free joint included."""
        model = self.pair.model
        dofs = list(self.place.joint.dofs)
        joint = int(model.dof_jntid[dofs[0]])
        if int(model.jnt_type[joint]) == int(backend().mjtJoint.mjJNT_FREE):
            return list(range(dofs[0], dofs[0] + 6))
        return dofs

    def moved_with(self, data: Any, point: Floats) -> Floats:
        """A contact point as the moving body's centre has carried it along since it was seen."""
        return np.asarray(point + data.xipos[self.body] - self._origin)

    def seen(self, data: Any) -> None:
        """Note that a contact point was seen in this state."""
        self._origin = data.xipos[self.body].copy()

    def push(self, frame: Floats, wrench: Floats, turned: bool) -> None:
        """Add the friction of one contact.

        frame: its axes, (9,).
        turned: the moving geom is its second.
        """
        pushed = wrench[1] * frame[3:6] + wrench[2] * frame[6:9]
        if turned:
            self.friction = self.friction + pushed
        else:
            self.friction = self.friction - pushed

    def row(self, data: Any, velocity: Floats, point: Floats, rate: float) -> Floats:
        """Motion along the plate, shape (8,): slip 2 m/s, spin 3 rad/s,
        friction 2 N, other energy J.

        velocity: (nv,).
        point: of the contact, m.
        rate: of approach, m/s; its energy is left out.
        """
        model = self.pair.model
        slip = [self.pair.approach_row(data, point, axis) @ velocity for axis in self.axes[:2]]
        spin = np.zeros(3)
        for sign, body in ((1.0, self.pair.first.body), (-1.0, self.pair.second.body)):
            turns = np.zeros((3, model.nv))
            backend().mj_jacBody(model, data, None, turns, body)
            spin += sign * (turns @ velocity)
        energy = (
            self._kinetic_energy(data, velocity, point) - 0.5 * self.place.effective_mass * rate**2
        )
        friction = self.axes[:2] @ self.friction
        self.friction = np.zeros(3)
        return np.array([*slip, *(self.axes @ spin), *friction, energy])

    def _kinetic_energy(self, data: Any, velocity: Floats, point: Floats) -> float:
        """Kinetic energy of the two bodies, J; where joints act, of the
        launched one against the other.
        """
        mujoco = backend()
        model = self.pair.model
        own = np.where(self._moving, velocity, 0.0)
        momentum = np.zeros(model.nv)
        mujoco.mj_mulM(model, data, momentum, own)
        energy = 0.5 * float(own @ momentum)
        if self._alone:
            return energy
        # Seen from the other body, which moves by `frame`: E - m v_c · frame + m frame² / 2.
        root = int(model.body_rootid[self.body])
        of_centre = np.zeros((3, model.nv))
        of_other = np.zeros((3, model.nv))
        mujoco.mj_jacSubtreeCom(model, data, of_centre, root)
        mujoco.mj_jac(model, data, of_other, None, point, self.pair.second.body)
        frame = of_other @ velocity
        mass = float(model.body_subtreemass[root])
        return energy + mass * float(frame @ (0.5 * frame - of_centre @ own))
