"""Reads the depth, force and approach rate of a pair off MuJoCo's data."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.pair import BOTH_SIDES
from hcbench.engines.mujoco.model.place import PairAtTouch
from hcbench.sim.model_under_test import Vector
from hcbench.sim.tangential import plate_frame
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats, Launch

# MuJoCo: how a placed pair is sent along the plate, and what it does there.

# Share of the motion asked for that joints may leave out.
_MISSED = 1e-9


class MujocoAlongPlate:
    """Sends one oblique launch along the plate, and reads what the pair does there.

    friction: on the moving body in the step that is read, N, (3,) in the world; `push` adds to it,
    `row` reads it and sets it to 0.
    """

    def __init__(self, place: PairAtTouch, launch: Launch, along: Vector | None) -> None:
        """Find the axes of the plate, and which degrees of freedom are the pair's.

        place: the pair at touch.
        launch: the oblique launch.
        along: direction of the plate's first axis, in the world; None: x, or y where that is normal
        to the plate.
        Raises UserError for one that is 0 or normal to the plate.
        """
        self.place = place
        self.pair = place.pair
        self.launch = launch
        self.axes = plate_frame(place.contact.normal, along)
        self.body = self.pair.first.body
        self.friction = np.zeros(3)
        # Moving body's centre, m, in the state in which the contact point was seen last.
        self._origin = np.zeros(3)
        # Then the energy is that of both bodies. Else it is that of the mover alone.
        self._only_contacts_act = not self.pair.more_than_contacts
        model = self.pair.model
        moving = [model.body_rootid[self.pair.first.body]]
        if self._only_contacts_act:
            moving.append(model.body_rootid[self.pair.second.body])
        self._moving = np.isin(model.body_rootid[model.dof_bodyid], moving)

    def send(self, data: Any, flight_time: float) -> None:
        """Add the launch's slip and spin to the motion of the body at release, and put the body back
        by the way that they move it until the touch.

        data: MjData at release, with the normal motion in it; its qpos and qvel change.
        flight_time: from release to touch, s.

        Raises UserError where the joints cannot make the motion.
        """
        mujoco = backend()
        model = self.pair.model
        launch = self.launch
        start = data.qpos.copy()
        data.qpos[:] = self.place.qpos
        mujoco.mj_kinematics(model, data)
        # Note the body's centre for the contact point, which is known of the pose at touch alone.
        self.seen(data)
        data.qpos[:] = start
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        # From the plate's axes to the world's: the centre's velocity, m/s, and the turn, rad/s.
        slip = np.array([*launch.slip, 0.0]) @ self.axes
        spin = np.array(launch.spin) @ self.axes
        asked = np.concatenate([slip, spin])
        jacobian = np.zeros((6, model.nv))
        centre = data.xipos[self.body].copy()
        mujoco.mj_jac(model, data, jacobian[:3], jacobian[3:], centre, self.body)
        dofs = self._dofs()
        # Velocities of the joints that come nearest to the slip and the spin of the body.
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
        """Degrees of freedom of the launched joint, the turns of a free joint included.

        A joint that launches normally has only the three translations of a free joint.
        """
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

    def push(self, frame: Floats, wrench: Floats, is_second: bool) -> None:
        """Add the friction of one contact to `friction`, N, that on the moving body in the world.

        frame: the contact's axes in MuJoCo's order: normal, then two tangents; (9,).
        wrench: MuJoCo's contact force along these axes, N, and torques; (6,).
        is_second: the moving geom is the contact's second.
        """
        # MuJoCo's force acts on the second geom, and its opposite on the first.
        pushed = wrench[1] * frame[3:6] + wrench[2] * frame[6:9]
        if is_second:
            self.friction = self.friction + pushed
        else:
            self.friction = self.friction - pushed

    def row(self, data: Any, velocity: Floats, point: Floats, rate: float) -> Floats:
        """Motion of the pair along the plate in one state, (8,): slip of the contact point (2, m/s),
        spin (3, rad/s), friction (2, N), and the kinetic energy without that of the approach (J).

        data: MjData with the kinematics of the state.
        velocity: of the state, (nv,).
        point: of the contact, m, (3,).
        rate: of approach, m/s.
        The friction that `push` added is used up.
        """
        model = self.pair.model
        # The axes: two in the plate, then the normal. All is of the moving body relative to the other.
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
        """Kinetic energy of the two bodies, J; where joints or servos act, that of the launched
        body's tree as seen from the other body.

        data: MjData with the kinematics.
        velocity: (nv,).
        point: of the contact, m, (3,), at which the other body's velocity is taken.
        """
        mujoco = backend()
        model = self.pair.model
        own = np.where(self._moving, velocity, 0.0)
        momentum = np.zeros(model.nv)
        mujoco.mj_mulM(model, data, momentum, own)
        energy = 0.5 * float(own @ momentum)
        if self._only_contacts_act:
            return energy
        # Seen from the other body, which moves by `frame`: E - m v_c · frame + m frame² / 2.
        root = int(model.body_rootid[self.body])
        # Jacobians of the tree's centre of mass, and of the other body's point.
        of_centre = np.zeros((3, model.nv))
        of_other = np.zeros((3, model.nv))
        mujoco.mj_jacSubtreeCom(model, data, of_centre, root)
        mujoco.mj_jac(model, data, of_other, None, point, self.pair.second.body)
        frame = of_other @ velocity  # m/s
        mass = float(model.body_subtreemass[root])  # kg
        return energy + mass * float(frame @ (0.5 * frame - of_centre @ own))


class _OwnContact(NamedTuple):
    """One of the pair's contacts in an MjData.

    number: among all contacts of the MjData.
    is_turned: the moving geom is its second, so that its normal leads from the other body.
    is_pyramid: its friction cone is a pyramid, so that its normal has two constraint rows.
    """

    number: int
    is_turned: bool
    is_pyramid: bool


class _SeenContacts(NamedTuple):
    """Contacts of the last `read`, as `_use_contact` needs them.

    own: those of the pair, one or more.
    points: of all contacts, m, (ncon, 3).
    frames: of all contacts, axes row after row, the normal first, (ncon, 9).
    distance: least of the pair, m.
    """

    own: list[_OwnContact]
    points: Floats
    frames: Floats
    distance: float


class PairReader:
    """Reads depth, force and rate of the pair off an MjData that belongs to one state.

    others: True if there were contacts besides the pair's in the state that was read last.
    """

    def __init__(
        self, model: Any, place: PairAtTouch, data: Any, along: MujocoAlongPlate | None
    ) -> None:
        """Begin with the contact at touch; until a step has one, its point and normal hold.

        place: the pair at touch.
        data: MjData of the first state, with its kinematics.
        along: reader of the motion along the plate; None for a normal launch.
        """
        mujoco = backend()
        self.model = model
        self.place = place
        self.along = along
        self.others = False
        self._pyramid = int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
        self._wrench = np.zeros(6)
        self._force_of = mujoco.mj_contactForce
        # The same bits as in C, and under every kernel of OpenBLAS.
        self._dot = mujoco.mju_dot
        self._point = place.contact.point
        self._normal = place.contact.normal
        self._row: Floats | None = None
        # Of the last contacts: the geoms of all, and the pair's own.
        self._geoms: list[list[int]] = []
        self._mine: list[_OwnContact] = []
        # None once the point and the normal are computed.
        self._unread: _SeenContacts | None = None
        self.row(data)

    @property
    def normal(self) -> Floats:
        """Normal of the last contact, from the moving body."""
        self._use_contact()
        return self._normal

    def contact_point(self, data: Any) -> Floats:
        """Point of the last contact in the world, m, (3,); in an oblique launch moved on with the
        centre of the body since then.

        data: MjData with the kinematics of the present state.
        """
        self._use_contact()
        if self.along is None:
            return self._point
        return self.along.moved_with(data, self._point)

    def row(self, data: Any) -> Floats:
        """(nv,) approach row at the last contact, from the kinematics in `data`."""
        if self._row is None or self.along is not None:
            point = self.contact_point(data)
            self._row = self.place.pair.approach_row(data, point, self._normal)
        return self._row

    def read(self, data: Any, velocity: Floats) -> tuple[float | None, float, float]:
        """Read the pair in one state: penetration beyond the onset of the contact, m, None without a
        contact; force, N, above 0 where it pushes apart; approach rate, m/s.

        data: MjData with contacts and forces of the state.
        velocity: of the state, (nv,).
        The contact's point and normal are kept for `normal` and `contact_point`; friction goes to
        `along`, the reader of oblique launches.
        """
        # The links have turned since the last step.
        self._row = None
        # Columns of all contacts: a look at one number of one contact takes as long.
        contacts = data.contact
        geoms = contacts.geom.tolist()
        if geoms != self._geoms:
            self._find_pair(geoms, contacts.dim.tolist())
        if not self._mine:
            return None, 0.0, self._dot(self.row(data), velocity)
        distances = contacts.dist.tolist()
        distance = min(distances[i] for i, _, _ in self._mine)
        force, parting = self._force_and_parting(data, contacts)
        self._unread = _SeenContacts(
            self._mine, contacts.pos.copy(), contacts.frame.copy(), distance
        )
        if self.along is not None:
            self.along.seen(data)
        penetration = self.place.contact.onset - distance
        if parting is not None:
            return penetration, force, -parting
        return penetration, force, self._dot(self.row(data), velocity)

    def _force_and_parting(self, data: Any, contacts: Any) -> tuple[float, float | None]:
        """Force of all contacts of the pair together, N, and the mean rate at which they part, m/s,
        None if no contact has a constraint row, and so a force.

        data: MjData with the forces of a state.
        contacts: all contacts of `data`.
        The friction of each of the pair's goes to `along`.
        """
        addresses = contacts.efc_address.tolist()
        rates = data.efc_vel
        force = 0.0
        parting = 0.0
        acting = 0
        for i, is_turned, is_pyramid in self._mine:
            address = addresses[i]
            # A contact without a constraint row has no force.
            if address < 0:
                continue
            self._force_of(self.model, data, i, self._wrench)
            force += self._wrench.item(0)
            rate = rates.item(address)
            if is_pyramid:
                # As the engine has it: the two edges of a pyramid lie evenly about the normal.
                rate = 0.5 * (rate + rates.item(address + 1))
            parting += rate
            acting += 1
            if self.along is not None:
                self.along.push(contacts.frame[i], self._wrench, is_turned)
        return force, parting / acting if acting else None

    def _find_pair(self, geoms: list[list[int]], dims: list[int]) -> None:
        """Find the pair's contacts among all, and keep them in `_mine` until other geoms touch; note
        in `others` whether there are contacts of others.

        geoms: numbers of the two geoms of each contact.
        dims: condim of each.
        """
        # 1 for geoms of the first part, 2 for those of the second; the two of a contact of the pair
        # add up to BOTH_SIDES.
        sides = self.place.pair.sides
        self._geoms = geoms
        self._mine = []
        for i, (a, b) in enumerate(geoms):
            if sides[a] + sides[b] == BOTH_SIDES:
                is_turned = bool(sides[a] == 2)
                is_pyramid = self._pyramid and dims[i] > 1
                self._mine.append(_OwnContact(i, is_turned, is_pyramid))
        self.others = len(self._mine) < len(geoms)

    def _use_contact(self) -> None:
        """Compute `_point` and `_normal` from the contacts of the last `read`, unless that is done:
        the mean of their points, and the normal of the first, from the moving body to the other.

        It is put off until one of them is asked for: most steps need neither.
        """
        if self._unread is None:
            return
        mine, points, frames, distance = self._unread
        first, is_turned, _ = mine[0]
        if len(mine) == 1:
            self._point = points[first]
        else:
            self._point = points[[i for i, _, _ in mine]].mean(axis=0)
        self._normal = frames[first, :3]
        if is_turned:
            self._normal = -self._normal
        # On the moving body's surface: MuJoCo has the point halfway to the other's.
        if self.along is not None:
            self._point = self._point - 0.5 * distance * self._normal
        self._unread = None

    def depth(self, data: Any, guess: float) -> float:
        """Penetration of two that have no contact, m, below 0 where they are apart: by MuJoCo's
        distance of the geoms, counted from that at touch; `guess` for shapes without a distance.

        data: MjData with the kinematics.
        guess: m.
        """
        if not math.isfinite(self.place.gap):
            return guess
        return self.place.gap - float(self.place.pair.nearest(data).distance)

    def other_geoms(self, data: Any) -> set[int]:
        """Numbers of the other geoms that touch the two bodies, or what hangs on them: geoms outside
        their trees, and geoms of these trees that touch each other.

        data: MjData with its contacts; the pair's own do not count, nor those without a constraint
        row.
        """
        sides = self.place.pair.sides
        in_tree = self.place.pair.in_trees
        geoms = data.contact.geom
        # A geom of -1 is none: the contact is that of a flex.
        acting = (data.contact.efc_address >= 0) & (geoms.min(axis=1) >= 0)
        geoms = geoms[acting & (sides[geoms].sum(axis=1) != BOTH_SIDES)]
        inside = in_tree[geoms]
        one_is_inside = inside.any(axis=1)[:, None]
        both_are_inside = inside.all(axis=1)[:, None]
        # The geom outside the trees; both, where the trees touch themselves.
        is_named = one_is_inside & (~inside | both_are_inside)
        return set(geoms[is_named].tolist())


def with_kinematics(data: Any, model: Any) -> Any:
    """`data` with its kinematics computed at its state."""
    mujoco = backend()
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data
