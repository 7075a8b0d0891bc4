"""Moves a pair until MuJoCo's own contact of it begins: along a line,
or along the arc of its joints.
"""

from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import response
from hcbench.engines.mujoco.model.pair import ContactPair, PairContact
from hcbench.sim.touch import LEAST_APPROACH, travel_by_distance, travel_by_scan
from hcbench.terms.impact import Floats

# Depths at which contacts are looked for, in sizes of the smaller body.
_DEPTHS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
# Share of the approach that must be along the normal of a contact.
_OPPOSING = 0.5
# Cosine of the angle between two normals above which both are of the same touch.
_SAME_LINE = 0.9
# A way along an arc has so many rounds, each of at most this length, m.
_ROUNDS = 400
_STRIDE = 0.02
# Distance that counts as touching on the way, m.
_CLOSE = 1e-9


class TouchSearch:
    """Moves a pair along `move` to where its contact begins, from the configuration in `data`.

    data: MjData, changed by the search; it begins apart from, or a little in, the other.
    move: (nv,), the velocity that approaches at 1 m/s, so that travels along it are in m.
    start: (nq,), qpos before the search.
    """

    def __init__(self, pair: ContactPair, data: Any, move: Floats) -> None:
        self.pair = pair
        self.data = data
        self.move = move
        self.start = data.qpos.copy()
        # Distance between the two where the search ended, m.
        self.gap = np.inf

    def contact_at_touch(self) -> PairContact | None:
        """Move `data` to where MuJoCo's contact of the pair begins, and return that contact; None
        where MuJoCo makes none on the way.

        First by MuJoCo's distance of the geoms; where that leads to no contact whose normal opposes
        the motion, by a scan. Sets `gap`, the distance that is left, m.
        """
        travel = travel_by_distance(self._distance, self.pair.size)
        self.gap = self._distance(travel)
        first = self._first_opposing_contact(travel)
        # MuJoCo gives the distance of some shapes only roughly: its contact is scanned for.
        if first is None:
            before, behind = self._window()
            # m along the way; None where no contact begins in the window.
            begun = travel_by_scan(
                lambda t: self._contact(t) is not None, travel - before, travel + behind
            )
            first = None if begun is None else self._first_opposing_contact(begun)
            if begun is None or first is None:
                return None
            travel = begun
        # At `at`, m along the way, the two are about `depth`, m, in each other, and have a contact.
        depth, contact = first
        at = travel + depth
        # The engine's own collision function has the last word on where the two touch.
        for _ in range(2):
            nearer = at + contact.distance - contact.onset + depth
            if (seen := self._contact(nearer)) is None:
                break
            at = nearer
            contact = seen
        # The force begins at the onset.
        self._go(at + contact.distance - contact.onset)
        return contact

    def _go(self, travel: float) -> None:
        """Put `data` so far, m, along the motion, contacts and mass matrix included."""
        model = self.pair.model
        mujoco = backend()
        self.data.qpos[:] = self.start
        mujoco.mj_integratePos(model, self.data.qpos, self.move, travel)
        mujoco.mj_fwdPosition(model, self.data)

    def _contact(self, travel: float) -> PairContact | None:
        self._go(travel)
        return self.pair.contact(self.data)

    def _distance(self, travel: float) -> float:
        self._go(travel)
        return self.pair.nearest(self.data).distance

    def _first_opposing_contact(self, travel: float) -> tuple[float, PairContact] | None:
        """Find the smallest depth, m, of _DEPTHS beyond a travel at which the contact's normal
        opposes the motion: the depth and the contact; None where there is none.

        travel: at touch, m.
        Shallower contacts can have any normal, as rounding decides it.
        """
        for share in _DEPTHS:
            contact = self._contact(travel + share * self.pair.size)
            if contact is not None:
                row = self.pair.approach_row(self.data, contact.point, contact.normal)
                if abs(float(row @ self.move)) > _OPPOSING:
                    return share * self.pair.size, contact
        return None

    def _window(self) -> tuple[float, float]:
        """Distances before and behind the roughly known touch, m, within which MuJoCo's contact may
        begin.

        They are the size of the smaller shape; over a height field, whose distance is only known
        to its highest possible point, that of the other shape, and behind also the field's height.
        """
        pair = self.pair
        field = self.pair.height_field
        if field < 0:
            return pair.size, pair.size
        bound = max(float(pair.model.geom_rbound[geom]) for geom in pair.geoms if geom != field)
        return bound, 2 * bound + float(pair.model.hfield_size[pair.model.geom_dataid[field]][2])


def swing(model: Any, data: Any, row: Floats, dofs: tuple[int, ...]) -> Floats | None:
    """Velocity of some degrees of freedom as a push at the contact would move them, scaled to an
    approach at 1 m/s, (nv,); None where a push hardly moves the two together.

    data: MjData with its mass matrix and constraints computed.
    row: Jacobian J of the approach rate, (nv,).
    dofs: numbers of the degrees of freedom that may move.

    A push moves the robot along M^-1 J^T, as far as equalities let it; where `dofs` are not all of
    the robot's, the others are held.
    """
    move = np.zeros_like(row)
    # The tree of each degree of freedom: are there others in the trees of `dofs`?
    roots = model.body_rootid[model.dof_bodyid]
    if len(dofs) < int(np.isin(roots, roots[list(dofs)]).sum()):
        move[list(dofs)] = _push_on(model, data, row, dofs)
    else:
        push = _along_equalities(model, data, response(model, data, row))
        move[list(dofs)] = push[list(dofs)]
    rate = float(row @ move)
    # A share of the largest rate that a motion of this size could have along one degree of freedom.
    least = LEAST_APPROACH * float(np.abs(row).max()) * float(np.abs(move).max())
    return move / rate if rate > least else None


def _push_on(model: Any, data: Any, row: Floats, dofs: tuple[int, ...]) -> Floats:
    """Acceleration, (k,), of k degrees of freedom by a unit push, with the
    others of their tree at rest.

    data: MjData with its mass matrix.
    dofs: their numbers, in the order of the result.
    row: (nv,), Jacobian of the approach rate.
    """
    # Columns of the mass matrix, k of them: MuJoCo keeps it sparse.
    masses = np.zeros((len(dofs), len(dofs)))
    unit = np.zeros(model.nv)
    column = np.zeros(model.nv)
    for i, dof in enumerate(dofs):
        unit[:] = 0.0
        unit[dof] = 1.0
        backend().mj_mulM(model, data, column, unit)
        masses[:, i] = column[list(dofs)]
    return np.asarray(np.linalg.solve(masses, row[list(dofs)]))


def _along_equalities(model: Any, data: Any, push: Floats) -> Floats:
    """Motion by a push as far as equality constraints, such as coupled fingers, let it happen, (nv,).

    data: MjData with its constraints.
    push: the motion without them, M^-1 J^T, (nv,); it is returned where it moves no equality.
    """
    mujoco = backend()
    held = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    # E, the Jacobian of the equalities.
    rows = np.zeros((len(held), model.nv))
    for jacobian, i in zip(rows, held, strict=True):
        unit = np.zeros(data.nefc)
        unit[i] = 1.0
        mujoco.mj_mulJacTVec(model, data, jacobian, unit)
    if not len(held) or not (rows @ push).any():
        return push
    # Forces that take the motion along the equalities away again: (E M^-1 E^T) f = E push. Least
    # squares, as equalities may repeat each other.
    responses = np.array([response(model, data, jacobian) for jacobian in rows])
    forces = np.linalg.lstsq(rows @ responses.T, rows @ push, rcond=1e-9)[0]
    moved: Floats = push - forces @ responses
    return moved


def _normal_at_touch(pair: ContactPair, data: Any, normal: Floats) -> Floats:
    """The normal of MuJoCo's contact, where that between the nearest points of two parts that touch,
    (3,), is along another line: rounding alone makes it there.

    data: MjData with contacts.
    """
    contact = pair.contact(data)
    if contact is None or float(contact.normal @ normal) > _SAME_LINE:
        return normal
    return contact.normal


def swing_to_touch(
    pair: ContactPair, data: Any, dofs: tuple[int, ...], row: Floats
) -> Floats | None:
    """Bring two parts together along the arc of joints that turn, within the joints' limits, in
    strides of up to _STRIDE m.

    data: MjData; at the end its qpos is where they meet.
    dofs: numbers of the degrees of freedom that move.
    row: Jacobian of the approach rate at the start, (nv,).

    Returns the velocity with which they approach at 1 m/s where they meet, (nv,); None where the
    joints do not lead there, or not within _ROUNDS strides.
    """
    mujoco = backend()
    model = pair.model
    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    is_moved = np.isin(model.jnt_dofadr, dofs) & np.isin(model.jnt_type, kinds)
    limited = np.flatnonzero(is_moved & (model.jnt_limited != 0))
    places = model.jnt_qposadr[limited]
    # A joint that starts beyond its limit may stay there.
    lowest, highest = model.jnt_range[limited].T
    low = np.minimum(lowest, data.qpos[places])
    high = np.maximum(highest, data.qpos[places])
    move = None
    for _ in range(_ROUNDS):
        mujoco.mj_fwdPosition(model, data)
        near = pair.nearest(data)
        normal = near.normal
        # The two touch: there is no direction between them any more.
        if not normal.any():
            if move is None:
                move = swing(model, data, row, dofs)
            return move
        if abs(near.distance) < _CLOSE:
            normal = _normal_at_touch(pair, data, normal)
        move = swing(model, data, pair.approach_row(data, near.point, normal), dofs)
        if move is None or abs(near.distance) < _CLOSE:
            return move
        # At 1 m/s the distance is the time left, s; an overlap moves back.
        stride = float(np.clip(near.distance, -_STRIDE, _STRIDE))
        mujoco.mj_integratePos(model, data.qpos, move, stride)
        data.qpos[places] = np.clip(data.qpos[places], low, high)
    return None
