"""MuJoCo: the configuration in which a pair just touches, and the direction in which it is launched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.errors import SceneError, UserError
from hcbench.measure.mujoco_load import backend
from hcbench.measure.mujoco_pair import Carrier, Side, carriers, normal_between, why_immobile, why_no_contact

if TYPE_CHECKING:
    from hcbench.impact import Floats

_DEEPEST = 0.1  # of the smaller one's size: an overlap at the start up to which it is just moved out
_TOUCH_DEPTHS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)  # of its size: where contacts are looked for
_SIDEWAYS = 1e-3  # the least share of a joint's motion that must be along the normal
_ROUNDS = 60


@dataclass(frozen=True, slots=True)
class Contact:
    """The engine's contact of the pair at touch, averaged over its points; SI.

    normal: from the first side to the second. onset: distance at which its force begins to act.
    rows: (solref, solimp, geoms) of each point.
    """

    normal: Floats
    point: Floats
    onset: float
    distance: float
    rows: tuple[tuple[tuple[float, ...], tuple[float, ...], tuple[int, int]], ...]


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


def side_table(model: Any, first: Side, second: Side) -> Any:
    """(ngeom + 1,): 1 for geoms of the first side, 2 for the second's, 0 else; -1 indexes the last, a 0."""
    table = np.zeros(model.ngeom + 1, dtype=np.int8)
    table[list(first.geoms)], table[list(second.geoms)] = 1, 2
    return table


def approach_row(model: Any, data: Any, first: int, second: int, point: Floats, normal: Floats) -> Floats:
    """(nv,) J: the approach rate of the two bodies' points at `point` along `normal` is J @ qvel."""
    mujoco = backend()
    row = np.zeros(model.nv)
    jac = np.zeros((3, model.nv))
    for body, sign in ((first, 1.0), (second, -1.0)):
        if body:
            mujoco.mj_jac(model, data, jac, None, point, body)
            row += sign * (normal @ jac)
    return row


def read_contact(model: Any, data: Any, table: Any) -> Contact | None:
    """The pair's contact in `data`, None where it has none that acts."""
    rows, points, normals, distances, onsets = [], [], [], [], []
    for i in range(data.ncon):
        contact = data.contact[i]
        a, b = (int(g) for g in contact.geom)
        if table[a] + table[b] != 3 or contact.exclude:
            continue
        rows.append((tuple(map(float, contact.solref)), tuple(map(float, contact.solimp)), (a, b)))
        points.append(contact.pos.copy())
        normals.append(contact.frame[:3] * (1.0 if table[a] == 1 else -1.0))
        distances.append(float(contact.dist))
        onsets.append(float(contact.includemargin))
    if not rows:
        return None
    normal = np.mean(normals, axis=0)
    length = float(np.linalg.norm(normal))
    normal = normal / length if length > 0 else normals[0]
    return Contact(normal, np.mean(points, axis=0), max(onsets), min(distances), tuple(rows))


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
    if distance < -_DEEPEST * size:
        raise SceneError(
            "model",
            f"{first.name!r} starts {-distance:.4g} m inside {second.name!r}",
            "the two apart, or touching",
            "Move one away, or start from another keyframe",
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
            found = _touch(model, data, first, second, move, size)
            if found is None:
                raise why_no_contact(model, first, second)
            return _finished(
                model, data, (first, second) if sign > 0 else (second, first), carrier, *found, distance
            )
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
    if squared < _SIDEWAYS**2:
        return None
    out = np.zeros_like(row)
    out[list(carrier.dofs)] = along / squared
    return out


def _moved(model: Any, data: Any, qpos: Floats, move: Floats, far: float) -> None:
    """Put `data` at `qpos` moved `far` along `move`, contacts and mass matrix included."""
    mujoco = backend()
    data.qpos[:] = qpos
    mujoco.mj_integratePos(model, data.qpos, move, far)
    mujoco.mj_fwdPosition(model, data)


def _touch(
    model: Any, data: Any, first: Side, second: Side, move: Floats, size: float
) -> tuple[Floats, Floats, Contact] | None:
    """(qpos at touch, direction, contact); None where the engine makes no contact of the two."""
    qpos, far = data.qpos.copy(), 0.0
    for _ in range(_ROUNDS):  # one round for convex geoms and straight approaches
        _moved(model, data, qpos, move, far)
        distance, _, _ = normal_between(model, data, first, second)
        far += distance
        if abs(distance) < 1e-12 * size:
            break
    table = side_table(model, first, second)
    depth, contact = 0.0, None
    for share in _TOUCH_DEPTHS:
        depth = share * size
        _moved(model, data, qpos, move, far + depth)
        contact = read_contact(model, data, table)
        if contact is not None:
            break
    if contact is None:
        return None
    for _ in range(2):  # the engine's own collision function has the last word on where they touch
        far += contact.distance - contact.onset + depth
        _moved(model, data, qpos, move, far + depth)
        again = read_contact(model, data, table)
        contact = again or contact
    far += contact.distance - contact.onset + depth
    _moved(model, data, qpos, move, far)
    return data.qpos.copy(), move, contact


def _finished(
    model: Any,
    data: Any,
    sides: tuple[Side, Side],
    carrier: Carrier,
    qpos: Floats,
    move: Floats,
    contact: Contact,
    distance: float,
) -> Placement:
    mujoco = backend()
    moving, other = sides
    row = approach_row(model, data, moving.body, other.body, contact.point, contact.normal)
    normal = contact.normal
    if float(row @ move) < 0:  # the contact was read with the roles the other way round
        row, normal = -row, -normal
    direction = _direction(row, carrier)
    mass = np.zeros((1, model.nv))
    mujoco.mj_solveM(model, data, mass, row.reshape(1, -1))
    mobility = float(row @ mass[0])
    if direction is None or not mobility > 0:
        raise UserError(
            "pair", f"{moving.name!r} cannot move along the contact normal", "a joint that lets it"
        )
    turned = Contact(normal, contact.point, contact.onset, contact.distance, contact.rows)
    return Placement(
        moving, other, carrier, qpos, direction, turned, 1.0 / mobility, max(0.0, -float(distance))
    )
