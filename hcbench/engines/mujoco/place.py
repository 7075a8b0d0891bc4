"""Brings a pair just to touch, by MuJoCo's own collision functions, and finds how to launch it."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.find_pair import MovingJoint, immobile_error, moving_joints, no_contact_error
from hcbench.engines.mujoco.model import effective_mass, geom_name
from hcbench.engines.mujoco.pair import ContactPair, PairContact
from hcbench.errors import UserError
from hcbench.impact import Floats
from hcbench.sim.touch import (
    LEAST_APPROACH,
    require_apart,
    require_reachable,
    travel_by_distance,
    travel_by_scan,
)

_DEPTHS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)  # of the smaller one's size: where contacts are looked for
_OPPOSING = 0.5  # of the approach, that must be along the normal of a contact


@dataclass(frozen=True, slots=True)
class PairAtTouch:
    """A pair that just touches, the moving one first.

    joint: what moves it. qpos: (nq,), at touch. direction: (nv,), the velocity that approaches at 1 m/s.
    effective_mass: along the normal, kg. overlap: how deep the two were in each other at the start, m.
    """

    pair: ContactPair
    joint: MovingJoint
    qpos: Floats
    direction: Floats
    contact: PairContact
    effective_mass: float
    overlap: float


def bring_to_touch(pair: ContactPair, data: Any) -> PairAtTouch:
    """Bring the two just to touch, by moving the first (or else the second) along their common normal.

    data: at rest in the start configuration. Raises UserError with the reason where that cannot be done.
    """
    backend().mj_forward(pair.model, data)
    distance, normal, point = pair.nearest(data)
    names = pair.first.name, pair.second.name
    if not np.isfinite(distance):
        raise UserError("pair", f"no distance from {names[0]!r} to {names[1]!r} is known", "two solid geoms")
    overlap = 0.0
    if pair.height_field < 0:
        require_apart(distance, pair.size, *names, "Move one away, or start from another keyframe")
        overlap = max(0.0, -float(distance))
    if not normal.any():
        normal = _guess_normal(pair, data)
    row = pair.approach_row(data, point, normal)
    joints = [(p, joint) for p in (pair, pair.swapped()) for joint in moving_joints(p.model, p.first.body)]
    for ordered, joint in joints:
        move = _direction(row, joint)
        if move is not None:
            contact = _TouchSearch(pair, data, move).contact_at_touch()
            if contact is None:
                raise no_contact_error(pair)
            return _at_touch(ordered, data, joint, move, contact, overlap)
    if joints:
        got = f"{names[0]!r} and {names[1]!r} slide past each other: no joint moves one towards the other"
        raise UserError("pair", got, "a free or slide joint along their common normal")
    raise immobile_error(pair)


def _guess_normal(pair: ContactPair, data: Any) -> Floats:
    """For two that touch exactly at the start: that of MuJoCo's contact, or the line between centres."""
    contact = pair.contact(data)
    if contact is not None:
        return contact.normal
    line = data.geom_xpos[pair.second.geoms[0]] - data.geom_xpos[pair.first.geoms[0]]
    length = float(np.linalg.norm(line))
    return line / length if length > 0 else np.array([0.0, 0.0, -1.0])


def _direction(row: Floats, joint: MovingJoint) -> Floats | None:
    """The least velocity of a joint that approaches at 1 m/s; None where none does."""
    along = row[list(joint.dofs)]
    squared = float(along @ along)
    if squared < LEAST_APPROACH**2:
        return None
    direction = np.zeros_like(row)
    direction[list(joint.dofs)] = along / squared
    return direction


class _TouchSearch:
    """Moves a pair along `move`, from the configuration that `data` is in, to where its contact begins."""

    def __init__(self, pair: ContactPair, data: Any, move: Floats) -> None:
        self.pair, self.data, self.move, self.start = pair, data, move, data.qpos.copy()

    def contact_at_touch(self) -> PairContact | None:
        """The contact, with `data` at touch; None where MuJoCo makes no contact of the two."""
        travel = travel_by_distance(self._distance, self.pair.size)
        first = self._first_opposing_contact(travel)
        if first is None:  # MuJoCo gives the distance of some shapes only roughly
            before, behind = self._window()
            begun = travel_by_scan(lambda t: self._contact(t) is not None, travel - before, travel + behind)
            first = None if begun is None else self._first_opposing_contact(begun)
            if begun is None or first is None:
                return None
            travel = begun
        depth, contact = first
        for _ in range(2):  # the engine's own collision function has the last word on where they touch
            travel += contact.distance - contact.onset + depth
            contact = self._contact(travel + depth) or contact
        self._go(travel + (contact.distance - contact.onset + depth))
        return contact

    def _go(self, travel: float) -> None:
        """Put `data` so far along the motion, contacts and mass matrix included."""
        model, mujoco = self.pair.model, backend()
        self.data.qpos[:] = self.start
        mujoco.mj_integratePos(model, self.data.qpos, self.move, travel)
        mujoco.mj_fwdPosition(model, self.data)

    def _contact(self, travel: float) -> PairContact | None:
        self._go(travel)
        return self.pair.contact(self.data)

    def _distance(self, travel: float) -> float:
        self._go(travel)
        return self.pair.nearest(self.data)[0]

    def _first_opposing_contact(self, travel: float) -> tuple[float, PairContact] | None:
        """(depth, contact) at the smallest depth whose contact's normal opposes the motion.

        Shallower contacts can have any normal.
        """
        for share in _DEPTHS:
            contact = self._contact(travel + share * self.pair.size)
            if contact is not None:
                row = self.pair.approach_row(self.data, contact.point, contact.normal)
                if abs(float(row @ self.move)) > _OPPOSING:
                    return share * self.pair.size, contact
        return None

    def _window(self) -> tuple[float, float]:
        """How far before and behind the rough distance a contact may begin, m."""
        pair, field = self.pair, self.pair.height_field
        if field < 0:
            return pair.size, pair.size
        bound = max(float(pair.model.geom_rbound[geom]) for geom in pair.geoms if geom != field)
        return bound, 2 * bound + float(pair.model.hfield_size[pair.model.geom_dataid[field]][2])


def _at_touch(
    pair: ContactPair, data: Any, joint: MovingJoint, move: Floats, contact: PairContact, overlap: float
) -> PairAtTouch:
    """pair: with the moving one first. data: at touch."""
    normal = contact.normal
    row = pair.approach_row(data, contact.point, normal)
    if float(row @ move) < 0:  # the contact was read with the two the other way round
        row, normal = -row, -normal
    direction, mass = _direction(row, joint), effective_mass(pair.model, data, row)
    if direction is None or not np.isfinite(mass):
        got = f"{pair.first.name!r} cannot move along the contact normal"
        raise UserError("pair", got, "a joint that lets it")
    _require_room(pair, data)
    contact = replace(contact, normal=normal)
    return PairAtTouch(pair, joint, data.qpos.copy(), direction, contact, mass, overlap)


def _require_room(pair: ContactPair, data: Any) -> None:
    """Refuse a touch at which other parts of what moves would be deep in something."""
    model, sides, names = pair.model, pair.sides, (pair.first.name, pair.second.name)
    root = model.body_rootid[pair.first.body]
    for contact in data.contact:
        geoms = contact.geom.tolist()
        if min(geoms) < 0 or contact.exclude or sides[geoms].sum() == 3:
            continue
        # The one that moves with the pair first.
        geoms.sort(key=lambda geom: model.body_rootid[model.geom_bodyid[geom]] != root)
        moves = [model.body_rootid[model.geom_bodyid[geom]] == root for geom in geoms]
        if moves == [True, False]:
            size = min(r for r in (*model.geom_rbound[geoms], np.inf) if r > 0)
            part, third = (repr(geom_name(model, geom)) for geom in geoms)
            todo = ", or start from a keyframe in which these do"
            require_reachable(-contact.dist, size, names, (part, third), todo)
