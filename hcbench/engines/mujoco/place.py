"""MuJoCo: the configuration in which a pair just touches, and the direction in which it is launched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model import approach_row, effective_mass, geom_name
from hcbench.engines.mujoco.pair import (
    Carrier,
    Side,
    carriers,
    height_field,
    normal_between,
    why_immobile,
    why_no_contact,
)
from hcbench.engines.mujoco.touch import Approach, Contact, read_contact, side_table
from hcbench.errors import UserError
from hcbench.sim.touch import LEAST_APPROACH, require_apart, require_reachable

if TYPE_CHECKING:
    from hcbench.impact import Floats


@dataclass(frozen=True, slots=True)
class Placement:
    """Where a launch starts from.

    qpos: (nq,), at touch. direction: (nv,), of the velocity that approaches at 1 m/s. start: what the rest of
    the model is held at. overlap: how deep the two were in each other in the model's own start, m.
    """

    first: Side
    second: Side
    carrier: Carrier
    qpos: Floats
    direction: Floats
    contact: Contact
    effective_mass: float
    overlap: float


def place(model: Any, data: Any, first: Side, second: Side) -> Placement:
    """Bring the two just to touch, by moving the first (or else the second) along their common normal.

    data: at rest in the start configuration. Raises UserError with the reason where that cannot be done.
    """
    mujoco = backend()
    mujoco.mj_forward(model, data)
    distance, normal, point = normal_between(model, data, first, second)
    size = _size(model, first, second)
    if not np.isfinite(distance):
        raise UserError(
            "pair", f"no distance from {first.name!r} to {second.name!r} is known", "two solid geoms"
        )
    if height_field(model, first, second) < 0:
        require_apart(
            distance, size, first.name, second.name, "Move one away, or start from another keyframe"
        )
    if not normal.any():
        normal = _guess_normal(model, data, first, second)
    sideways = False
    for moving, sign in ((first, 1.0), (second, -1.0)):
        for carrier in carriers(model, moving.body):
            row = approach_row(model, data, first.body, second.body, point, normal)
            move = _direction(row, carrier)
            if move is None:
                sideways = True
                continue
            found = Approach(model, data, first, second, move, size).touch()
            if found is None:
                raise why_no_contact(model, first, second)
            sides = (first, second) if sign > 0 else (second, first)
            return _finished(model, data, sides, carrier, move, *found, float(distance))
    if sideways:
        raise UserError(
            "pair",
            f"{first.name!r} and {second.name!r} slide past each other: no joint moves one towards the other",
            "a free or slide joint along their common normal",
        )
    raise why_immobile(model, (first, second))


def _size(model: Any, first: Side, second: Side) -> float:
    bounds = [float(model.geom_rbound[g]) for g in (*first.geoms, *second.geoms)]
    return min([b for b in bounds if b > 0], default=0.1)


def _guess_normal(model: Any, data: Any, first: Side, second: Side) -> Floats:
    """For two that touch exactly at the start: the engine's own contact, or the line between centres."""
    contact = read_contact(model, data, side_table(model, first, second))
    if contact is not None:
        return contact.normal
    line = data.geom_xpos[second.geoms[0]] - data.geom_xpos[first.geoms[0]]
    length = float(np.linalg.norm(line))
    return line / length if length > 0 else np.array([0.0, 0.0, -1.0])


def _direction(row: Floats, carrier: Carrier) -> Floats | None:
    """The least velocity of the carrier's joints that approaches at 1 m/s; None where none does."""
    along = row[list(carrier.dofs)]
    squared = float(along @ along)
    if squared < LEAST_APPROACH**2:
        return None
    out = np.zeros_like(row)
    out[list(carrier.dofs)] = along / squared
    return out


def _finished(
    model: Any,
    data: Any,
    sides: tuple[Side, Side],
    carrier: Carrier,
    move: Floats,
    qpos: Floats,
    contact: Contact,
    distance: float,
) -> Placement:
    moving, other = sides
    row = approach_row(model, data, moving.body, other.body, contact.point, contact.normal)
    normal = contact.normal
    if float(row @ move) < 0:  # the contact was read with the roles the other way round
        row, normal = -row, -normal
    direction = _direction(row, carrier)
    mass = effective_mass(model, data, row)
    if direction is None or not np.isfinite(mass):
        raise UserError(
            "pair", f"{moving.name!r} cannot move along the contact normal", "a joint that lets it"
        )
    _require_room(model, data, moving, other)
    turned = Contact(normal, contact.point, contact.onset, contact.distance, contact.rows)
    overlap = max(0.0, -distance) if height_field(model, moving, other) < 0 else 0.0
    return Placement(moving, other, carrier, qpos, direction, turned, mass, overlap)


def _require_room(model: Any, data: Any, moving: Side, other: Side) -> None:
    """Refuse a touch at which other parts of what moves would be deep in something."""
    table = side_table(model, moving, other)
    root = int(model.body_rootid[moving.body])
    for i in range(data.ncon):
        contact = data.contact[i]
        a, b = (int(g) for g in contact.geom)
        if min(a, b) < 0 or contact.exclude or table[a] + table[b] == 3:
            continue
        inside = [g for g in (a, b) if int(model.body_rootid[model.geom_bodyid[g]]) == root]
        if len(inside) == 1:
            size = min(r for r in (model.geom_rbound[a], model.geom_rbound[b], np.inf) if r > 0)
            mine, third = (repr(geom_name(model, g)) for g in ((a, b) if inside[0] == a else (b, a)))
            todo = ", or start from a keyframe in which these do"
            require_reachable(-contact.dist, size, (moving.name, other.name), (mine, third), todo)
