"""MuJoCo: which geoms the two names mean, which of them moves, and why a pair cannot touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model import body_name, collision_filter, geom_name, geoms_of
from hcbench.errors import UserError
from hcbench.sim.names import find_part

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.impact import Floats


@dataclass(frozen=True, slots=True)
class Side:
    """One of the two: its name as asked for, its body, and the geoms that count."""

    name: str
    body: int
    geoms: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Carrier:
    """What moves a side: the translational degrees of freedom of one body's free or slide joints."""

    body: int
    dofs: tuple[int, ...]
    words: str


def _collides(model: Any, geom: int) -> bool:
    in_pair = bool((model.pair_geom1 == geom).any() or (model.pair_geom2 == geom).any())
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom]) or in_pair


def find_sides(model: Any, pair: tuple[str, str] | None) -> tuple[Side, Side]:
    """The two sides that the names mean: bodies first, then geoms; "body:NAME", "geom:NAME" or a number
    instead of a name say which. Without names, the only body that moves and the only thing it can meet.
    """
    if pair is None:
        return _only_pair(model)
    first, second = (_side(model, name) for name in pair)
    if set(first.geoms) & set(second.geoms):
        raise UserError("pair", f"{pair[0]!r} and {pair[1]!r} are the same", "two different bodies or geoms")
    return first, second


def _side(model: Any, name: str) -> Side:
    parts = [("body", body_name(model, b), b) for b in range(model.nbody)]
    parts += [("geom", geom_name(model, g), g) for g in range(model.ngeom)]
    parts.sort(key=lambda part: part[0] == "body" and not model.body_geomnum[part[2]])  # else its geom
    kind, number = find_part(parts, name)
    if kind == "geom":
        return Side(name, int(model.geom_bodyid[number]), (number,))
    all_geoms = geoms_of(model, number)
    solid = tuple(g for g in all_geoms if _collides(model, g)) or all_geoms
    if not solid:
        raise UserError("pair", f"body {name!r} has no geoms", "a body that can touch something")
    return Side(name, number, solid)


def _only_pair(model: Any) -> tuple[Side, Side]:
    movers = [b for b in range(1, model.nbody) if geoms_of(model, b) and _joints(model, b)]
    others = [g for g in range(model.ngeom) if model.geom_bodyid[g] == 0 and _collides(model, g)]
    if len(movers) == 1 and len(others) == 1:
        return _side(model, f"body:{movers[0]}"), _side(model, f"geom:{others[0]}")
    moving = ", ".join(body_name(model, b) for b in movers[:8]) or "none"
    fixed = ", ".join(geom_name(model, g) for g in others[:8]) or "none"
    raise UserError(
        "pair",
        f"none given, and the model leaves a choice (bodies that move: {moving}; fixed geoms: {fixed})",
        "the names of two bodies or geoms",
        "Write for example --pair ball,plate",
    )


def _joints(model: Any, body: int) -> tuple[int, ...]:
    """Degrees of freedom of the body's own free or slide joints that translate."""
    mujoco = backend()
    dofs: list[int] = []
    for j in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
        kind, at = model.jnt_type[j], int(model.jnt_dofadr[j])
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            return (at, at + 1, at + 2)
        if kind == mujoco.mjtJoint.mjJNT_SLIDE:
            dofs.append(at)
    return tuple(dofs)


def carriers(model: Any, body: int) -> list[Carrier]:
    """What could move this body, nearest first."""
    found = []
    while body > 0:
        dofs = _joints(model, body)
        if dofs:
            kind = (
                "free joint" if len(dofs) == 3 and model.jnt_type[model.body_jntadr[body]] == 0 else "slide"
            )
            found.append(Carrier(body, dofs, f"body {body_name(model, body)!r} on its {kind}"))
        body = int(model.body_parentid[body])
    return found


def why_immobile(model: Any, sides: Sequence[Side]) -> UserError:
    """Neither side can be launched."""
    states = []
    for side in sides:
        hinged = model.body_dofnum[model.body_weldid[side.body]] > 0 or _has_joint_above(model, side.body)
        states.append(f"{side.name!r} {'is on hinges or balls only' if hinged else 'does not move'}")
    return UserError(
        "pair",
        " and ".join(states),
        "one of the two on a free or slide joint, able to move towards the other",
        "Add <freejoint/> to the body that shall bounce",
    )


def _has_joint_above(model: Any, body: int) -> bool:
    while body > 0:
        if model.body_jntnum[body]:
            return True
        body = int(model.body_parentid[body])
    return False


def why_no_contact(model: Any, first: Side, second: Side) -> UserError:
    """Said when the two overlap and the engine reports no contact between them."""
    mujoco = backend()
    names = f"{first.name!r} and {second.name!r}"
    disabled = model.opt.disableflags & (
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    )
    a, b = first.geoms[0], second.geoms[0]
    reason = collision_filter(model, a, b)
    if disabled:
        return UserError(
            "pair", f"{names} never touch: contacts are disabled", 'no <flag contact="disable"/>'
        )
    if reason == "exclude":
        return UserError(
            "pair", f"{names} never touch: <exclude> names their bodies", "no <exclude> for them"
        )
    if reason == "masks":
        words = [
            f"{geom_name(model, g)} has {model.geom_contype[g]}/{model.geom_conaffinity[g]}" for g in (a, b)
        ]
        return UserError(
            "pair",
            f"{names} never touch: contype/conaffinity do not match ({', '.join(words)})",
            "contype of one to share a bit with conaffinity of the other",
            'Remove them, or write contype="1" conaffinity="1" on both',
        )
    if reason == "welded":
        return UserError(
            "pair", f"{names} never touch: they are one rigid body", "two bodies that can move apart"
        )
    if reason == "parent":
        return UserError(
            "pair", f"{names} never touch: parent and child are filtered", "a <pair> of the two in <contact>"
        )
    kinds = [mujoco.mjtGeom(int(model.geom_type[g])).name.removeprefix("mjGEOM_").lower() for g in (a, b)]
    return UserError(
        "pair",
        f"{names} never touch: MuJoCo made no contact of a {kinds[0]} inside a {kinds[1]}",
        "two geoms that it collides, that meet along their common normal",
    )


def normal_between(model: Any, data: Any, first: Side, second: Side) -> tuple[float, Floats, Floats]:
    """(signed distance m, unit normal from first to second, midpoint) of the nearest two geoms of the sides.

    The normal is 0 where the two touch without a direction to tell.
    """
    mujoco = backend()
    field = height_field(model, first, second)
    if field >= 0:
        return _above_field(model, data, first, second, field)
    best = (np.inf, np.zeros(3), np.zeros(3))
    ends = np.zeros(6)
    reach = 10.0 * float(model.stat.extent) + 10.0
    for a in first.geoms:
        for b in second.geoms:
            distance = mujoco.mj_geomDistance(model, data, a, b, reach, ends)
            if distance < min(best[0], reach):
                span = (ends[3:] - ends[:3]) * np.sign(distance)
                length = float(np.linalg.norm(span))
                normal = span / length if length > 1e-12 else np.zeros(3)
                best = (distance, normal, (ends[3:] + ends[:3]) / 2)
    return best


def height_field(model: Any, first: Side, second: Side) -> int:
    """The height field among the two, -1 without one: MuJoCo's own distance to it is not to be relied on."""
    kind = int(backend().mjtGeom.mjGEOM_HFIELD)
    return next((g for g in (*first.geoms, *second.geoms) if int(model.geom_type[g]) == kind), -1)


def _above_field(
    model: Any, data: Any, first: Side, second: Side, field: int
) -> tuple[float, Floats, Floats]:
    """As `normal_between`, roughly: from the other's bounding sphere down to the field's highest point."""
    up = data.geom_xmat[field].reshape(3, 3)[:, 2]
    on_field = field in second.geoms
    other = (first if on_field else second).geoms[0]
    centre, top = data.geom_xpos[other], model.hfield_size[model.geom_dataid[field]][2]
    height = float(up @ (centre - data.geom_xpos[field])) - float(model.geom_rbound[other]) - float(top)
    return height, -up if on_field else up.copy(), centre.copy()
