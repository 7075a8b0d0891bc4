"""Parts of a MuJoCo model that the names of a pair mean, joints that move them, and reasons why
some never meet.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import (
    body_name,
    collision_filter,
    explicit_pairs,
    geom_name,
    geoms_of,
    joint_name,
)
from hcbench.engines.mujoco.model.pair import ContactPair, NamedGeoms
from hcbench.engines.mujoco.model.plugin_contact import has_force_law
from hcbench.errors import UserError
from hcbench.sim.names import find_part, suggest_names

_FREE_DOFS = 6


@dataclass(frozen=True, slots=True)
class MovingJoint:
    """Mover of a body: degrees of freedom of one body's free or slide joints, or of its whole
    robot.

    turns: whether hinges or balls are among them; the body then moves as a push at the contact would move it.
    """

    body: int
    dofs: tuple[int, ...]
    description: str
    turns: bool = False


def named_pair(model: Any, names: tuple[str, str]) -> ContactPair:
    """The pair that two names mean: bodies first, then geoms, or as "body:NAME" or "geom:NUMBER" says."""
    first, second = (_named_geoms(model, name) for name in names)
    if set(first.geoms) & set(second.geoms):
        got = f"{names[0]!r} and {names[1]!r} are the same"
        raise UserError("pair", got, "two different bodies or geoms")
    return require_collisions(ContactPair(model, first, second))


def _named_geoms(model: Any, name: str) -> NamedGeoms:
    parts = [("body", body_name(model, b), b) for b in range(model.nbody)]
    parts += [("geom", geom_name(model, g), g) for g in range(model.ngeom)]
    parts.sort(key=lambda part: part[0] == "body" and not model.body_geomnum[part[2]])  # else its geom
    kind, number = find_part(parts, name)
    if kind == "geom":
        return NamedGeoms(name, int(model.geom_bodyid[number]), (number,))
    geoms = geoms_of(model, number) or tuple(
        geom for geom in range(model.ngeom) if number in _ancestors(model, int(model.geom_bodyid[geom]))
    )
    solid = tuple(geom for geom in geoms if _collides(model, geom)) or geoms
    if not solid:
        raise UserError("pair", f"body {name!r} has no geoms", "a body that can touch something")
    return NamedGeoms(name, number, solid)


def _collides(model: Any, geom: int) -> bool:
    in_pair = geom in model.pair_geom1 or geom in model.pair_geom2
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom] or in_pair)


def only_pair(model: Any) -> tuple[str, str] | None:
    """The names of the only body that moves and of the only fixed geom; None where there is a choice."""
    movers = [b for b in range(1, model.nbody) if geoms_of(model, b) and model.body_weldid[b]]
    others = [g for g in geoms_of(model, 0) if _collides(model, g)]
    unique = len(movers) == 1 and len(others) == 1
    return (f"body:{movers[0]}", f"geom:{others[0]}") if unique else None


def _translations(model: Any, body: int) -> tuple[int, ...]:
    """Degrees of freedom of the body's own free or slide joints that translate."""
    kinds = backend().mjtJoint
    dofs: list[int] = []
    for joint in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
        kind, dof = model.jnt_type[joint], int(model.jnt_dofadr[joint])
        if kind == kinds.mjJNT_FREE:
            return (dof, dof + 1, dof + 2)
        if kind == kinds.mjJNT_SLIDE:
            dofs.append(dof)
    return tuple(dofs)


def _ancestors(model: Any, body: int) -> Iterator[int]:
    """The body, what it hangs on, and so on; without the world."""
    while body > 0:
        yield body
        body = int(model.body_parentid[body])


def moving_joints(model: Any, body: int) -> list[MovingJoint]:
    """Movers of this body, nearest first."""
    joints = []
    for ancestor in _ancestors(model, body):
        if dofs := _translations(model, ancestor):
            free = model.jnt_type[model.body_jntadr[ancestor]] == backend().mjtJoint.mjJNT_FREE
            kind = "free joint" if free else "slide"
            words = f"body {body_name(model, ancestor)!r} on its {kind}"
            joints.append(MovingJoint(ancestor, dofs, words))
    chain = [a for a in _ancestors(model, body) if model.body_jntnum[a]]
    if any(model.body_dofnum[a] > len(_translations(model, a)) for a in chain):
        numbers = [model.body_jntadr[a] + j for a in chain for j in range(model.body_jntnum[a])]
        names = ", ".join(joint_name(model, int(j)) for j in numbers[:6]) + ", ..." * (len(numbers) > 6)
        tree = np.flatnonzero(model.body_rootid[model.dof_bodyid] == model.body_rootid[body])
        words = f"body {body_name(model, body)!r} on its joints ({names})"
        joints.append(MovingJoint(body, tuple(tree.tolist()), words, turns=True))
    return joints


def chosen_joint(model: Any, body: int, move: str) -> MovingJoint | None:
    """Mover that `move` names, "base:", "body:NAME" or "joint:NAME", if it carries this body; else
    None.

    Of a body its joints and all between it and this body move, as a push at the contact would move them.
    Raises UserError for a name that the model does not have.
    """
    kind, _, name = move.partition(":")
    chain = list(_ancestors(model, body))
    if kind == "base":
        if not chain or model.body_dofnum[chain[-1]] != _FREE_DOFS:
            return None
        words = f"the whole robot, by its base {body_name(model, chain[-1])!r}"
        return MovingJoint(chain[-1], _translations(model, chain[-1]), words)
    if kind == "body":
        names = [body_name(model, b) for b in range(model.nbody)]
        if name not in names:
            raise UserError("move", f"no body {name!r}", *suggest_names(name, names[1:]))
        if (start := names.index(name)) not in chain:
            return None
        if model.body_dofnum[start] == _FREE_DOFS:
            return MovingJoint(start, _translations(model, start), f"body {name!r} on its free joint")
        chain = chain[: chain.index(start) + 1]
        joints = [int(model.body_jntadr[b]) + j for b in chain[::-1] for j in range(model.body_jntnum[b])]
    else:
        names = [joint_name(model, j) for j in range(model.njnt)]
        if name not in names:
            raise UserError("move", f"no joint {name!r}", *suggest_names(name, names))
        joints = [names.index(name)]
        if int(model.jnt_bodyid[joints[0]]) not in chain:
            return None
    return _of_joints(model, joints)


def _of_joints(model: Any, joints: list[int]) -> MovingJoint | None:
    """These joints together, of one chain; None for no joint."""
    kinds = backend().mjtJoint
    if not joints:
        return None
    words = ", ".join(joint_name(model, j) for j in joints)
    bodies = [int(model.jnt_bodyid[j]) for j in joints]
    if len(joints) == 1 and int(model.jnt_type[joints[0]]) in (kinds.mjJNT_FREE, kinds.mjJNT_SLIDE):
        dofs = _translations(model, bodies[0])
        if int(model.jnt_type[joints[0]]) == kinds.mjJNT_SLIDE:
            dofs = (int(model.jnt_dofadr[joints[0]]),)
        return MovingJoint(bodies[0], dofs, f"body {body_name(model, bodies[0])!r} on its joint {words}")
    widths = {int(kinds.mjJNT_FREE): 6, int(kinds.mjJNT_BALL): 3}
    dofs = tuple(
        int(model.jnt_dofadr[j]) + i for j in joints for i in range(widths.get(int(model.jnt_type[j]), 1))
    )
    return MovingJoint(
        bodies[-1], dofs, f"body {body_name(model, bodies[-1])!r} on its joints ({words})", True
    )


def immobile_error(pair: ContactPair) -> UserError:
    """The error where neither of the two can be launched."""
    states = []
    for part in (pair.first, pair.second):
        hinged = any(pair.model.body_jntnum[body] for body in _ancestors(pair.model, part.body))
        turns = "is on hinges or balls only, which do not bring it nearer"
        states.append(f"{part.name!r} {turns if hinged else 'does not move'}")
    return UserError(
        "pair",
        " and ".join(states),
        "one of the two on joints that move it towards the other",
        "Add <freejoint/> to the body that shall bounce, or start from another --key or --qpos",
    )


def require_collisions(pair: ContactPair) -> ContactPair:
    """The pair with those geoms only that MuJoCo collides; UserError with what keeps all of them apart."""
    model = pair.model
    mine = [(a, b) for a in pair.first.geoms for b in pair.second.geoms]
    off = backend().mjtDisableBit.mjDSBL_CONTACT | backend().mjtDisableBit.mjDSBL_CONSTRAINT
    meet = [geoms for geoms in mine if explicit_pairs(model, geoms) or not collision_filter(model, *geoms)]
    if not meet or model.opt.disableflags & off:
        fixed = not any(model.body_weldid[part.body] for part in (pair.first, pair.second))
        raise immobile_error(pair) if fixed else no_contact_error(pair)
    sides = [
        NamedGeoms(side.name, side.body, tuple(dict.fromkeys(geoms[i] for geoms in meet)))
        for i, side in enumerate((pair.first, pair.second))
    ]
    return ContactPair(model, *sides)


def no_contact_error(pair: ContactPair) -> UserError:
    """MuJoCo reports no contact between the two, however deep they are in each other."""
    model, mujoco = pair.model, backend()
    geoms = pair.first.geoms[0], pair.second.geoms[0]
    kinds = [mujoco.mjtGeom(int(model.geom_type[g])).name.removeprefix("mjGEOM_").lower() for g in geoms]
    masks = [f"{geom_name(model, g)} has {model.geom_contype[g]}/{model.geom_conaffinity[g]}" for g in geoms]
    off = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    if has_force_law(model, geoms):
        got = f"{pair.first.name!r} and {pair.second.name!r} meet by the plug-in hcbench.hunt_crossley"
        advice = "Its e is the law's: docs/reference/plugins.md says up to which step"
        return UserError("pair", got, "MuJoCo's own contact, or the plug-in hcbench.restitution", advice)
    reason = "disabled" if model.opt.disableflags & off else collision_filter(model, *geoms)
    got, *expected = {
        "disabled": ("contacts are disabled", 'no <flag contact="disable"/>'),
        "exclude": ("<exclude> names their bodies", "no <exclude> for them"),
        "masks": (
            f"contype/conaffinity do not match ({', '.join(masks)})",
            "contype of one to share a bit with conaffinity of the other",
            'Remove them, or write contype="1" conaffinity="1" on both',
        ),
        "welded": ("they are one rigid body", "two bodies that can move apart"),
        "parent": ("parent and child are filtered", "a <pair> of the two in <contact>"),
        "": (
            f"MuJoCo made no contact of a {kinds[0]} inside a {kinds[1]}",
            "two geoms that it collides, that meet along their common normal",
        ),
    }[reason]
    return UserError("pair", f"{pair.first.name!r} and {pair.second.name!r} never touch: {got}", *expected)
