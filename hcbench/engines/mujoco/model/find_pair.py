"""Pairs of a model: the one that a user names, and the list of all that can meet."""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.model.bodies import (
    FREE_DOFS,
    approach_row,
    body_name,
    can_meet,
    collision_filter,
    effective_mass,
    explicit_pairs,
    geom_name,
    geoms_of,
    joint_name,
)
from hcbench.engines.mujoco.model.pair import ContactPair, NamedGeoms, has_force_law
from hcbench.engines.mujoco.model.start_pose import start_pose
from hcbench.sim.model_under_test import CandidatePair, Request, choice_error, in_order
from hcbench.sim.packages import find_part, suggest_names
from hcbench.system.errors import UserError
from hcbench.system.text import joined_names, sanitized
from hcbench.terms.impact import Floats

# Parts of a MuJoCo model that the names of a pair mean, joints that move them, and reasons why
# some never meet.

# Joints of a robot that a message names.
_NAMED_JOINTS = 6


@dataclass(frozen=True, slots=True)
class MovingJoint:
    """Mover of a body: degrees of freedom of one body's free or slide
    joints, or of its whole robot.

    turns: whether hinges or balls are among them; the body then moves as a push
    at the contact would move it.
    """

    body: int
    dofs: tuple[int, ...]
    description: str
    turns: bool = False


def named_pair(model: Any, names: tuple[str, str]) -> ContactPair:
    """Find the pair of parts that two names mean, with those of their geoms that can meet.

    names: each that of a body, else of a geom; or "body:NAME", "geom:NUMBER" and the like.
    Raises UserError for unknown names, and for two parts that are the same or cannot collide.
    """
    first = _named_geoms(model, names[0], names[1])
    second = _named_geoms(model, names[1], names[0])
    if set(first.geoms) & set(second.geoms):
        got = f"{names[0]!r} and {names[1]!r} are the same"
        raise UserError("pair", got, "two different bodies or geoms")
    return require_collisions(ContactPair(model, first, second))


def _named_geoms(model: Any, name: str, other: str | None = None) -> NamedGeoms:
    """Find the part of a model with this name, and those of its geoms that can collide; all of its
    geoms if none can.

    name: of a body or geom, or "body:NAME", "geom:NUMBER" and the like. A body without geoms stands
    for the bodies that hang on it.
    other: name of the part that it is to touch, to list in an error what can; None for no list.

    Raises UserError where neither has geoms, for a flex, and for a name that the model does not
    have: it lists what can touch the other part, the nearest first.
    """
    if backend().mj_name2id(model, backend().mjtObj.mjOBJ_FLEX, name) >= 0:
        got = f"{name!r} is a soft body (flex), whose contacts are not measured"
        raise UserError("pair", got, "two rigid bodies or geoms")
    # Kind, name and number of all that the name may mean.
    parts = [("body", body_name(model, b), b) for b in range(model.nbody)]
    parts += [("geom", geom_name(model, g), g) for g in range(model.ngeom)]

    def is_bare_body(part: tuple[str, str, int]) -> bool:
        kind, _, number = part
        return kind == "body" and not model.body_geomnum[number]

    # A body without geoms comes last: of the same name, a geom is meant.
    parts.sort(key=is_bare_body)
    kind, number = find_part(parts, name, lambda: _partners(model, other) if other else [])
    if kind == "geom":
        return NamedGeoms(name, int(model.geom_bodyid[number]), (number,))
    geoms = geoms_of(model, number) or _carried_geoms(model, number)
    # Without one that collides all stay: a later error says what keeps them apart.
    solid = tuple(geom for geom in geoms if _collides(model, geom)) or geoms
    if not solid:
        raise UserError("pair", f"body {name!r} has no geoms", "a body that can touch something")
    return NamedGeoms(name, number, solid)


def _partners(model: Any, name: str) -> list[str]:
    """Names of the geoms that can touch a part, then of their bodies, in each case the nearest in
    the model's own pose first; geoms without a name are left out.

    name: of the part; [] where the model does not have it.
    """
    mujoco = backend()
    try:
        part = _named_geoms(model, name)
    except UserError:
        return []
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    # Distance of each geom that can touch the part from the nearest of the part's, m.
    distance_of: dict[int, float] = {}
    for pair in _collisions(model):
        # Either of the two may be the part's.
        for own, geom in (pair, pair[::-1]):
            if own in part.geoms and geom not in part.geoms:
                body = int(model.geom_bodyid[geom])
                both = (NamedGeoms("", body, (geom,)), NamedGeoms("", part.body, (own,)))
                distance = float(ContactPair(model, *both).nearest(data).distance)
                distance_of[geom] = min(distance, distance_of.get(geom, math.inf))
    geoms = sorted(distance_of, key=distance_of.__getitem__)
    names = [str(model.geom(geom).name) for geom in geoms]
    names += [str(model.body(int(model.geom_bodyid[geom])).name) for geom in geoms]
    return list(dict.fromkeys(filter(None, names)))


def _carried_geoms(model: Any, body: int) -> tuple[int, ...]:
    """Geoms of the bodies that hang on this one."""
    body_of = model.geom_bodyid.tolist()
    return tuple(geom for geom in range(model.ngeom) if body in _ancestors(model, body_of[geom]))


def _collides(model: Any, geom: int) -> bool:
    in_pair = geom in model.pair_geom1 or geom in model.pair_geom2
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom] or in_pair)


def only_pair(model: Any) -> tuple[str, str] | None:
    """Names of the only body that moves and of the only geom of the world, such as ("body:1",
    "geom:0"); None unless there is just one of each.

    Only bodies with geoms count, and geoms that can collide.
    """
    movers = [b for b in range(1, model.nbody) if geoms_of(model, b) and model.body_weldid[b]]
    others = [g for g in geoms_of(model, 0) if _collides(model, g)]
    if len(movers) != 1 or len(others) != 1:
        return None
    return f"body:{movers[0]}", f"geom:{others[0]}"


def _translations(model: Any, body: int) -> tuple[int, ...]:
    """Degrees of freedom of the body's own free or slide joints that translate, by number.

    Three of a free joint, one of each slide; () for a body on hinges and balls alone.
    """
    kinds = backend().mjtJoint
    dofs: list[int] = []
    for joint in _joints_of(model, body):
        kind = model.jnt_type[joint]
        dof = int(model.jnt_dofadr[joint])
        if kind == kinds.mjJNT_FREE:
            return (dof, dof + 1, dof + 2)
        if kind == kinds.mjJNT_SLIDE:
            dofs.append(dof)
    return tuple(dofs)


def _joints_of(model: Any, body: int) -> range:
    """Numbers of the body's own joints."""
    first = int(model.body_jntadr[body])
    return range(first, first + int(model.body_jntnum[body]))


def _ancestors(model: Any, body: int) -> Iterator[int]:
    """The body, what it hangs on, and so on; without the world."""
    while body > 0:
        yield body
        body = int(model.body_parentid[body])


def moving_joints(model: Any, body: int) -> list[MovingJoint]:
    """Ways to move a body towards another: by the free joint or slides of the body itself, then of
    each body that it hangs on, up to the root; and last, if a joint among these turns, by all joints
    of the robot. Empty for a body that cannot move.

    body: its number; 0, the world, cannot move.
    """
    joints = []
    for ancestor in _ancestors(model, body):
        if dofs := _translations(model, ancestor):
            free = model.jnt_type[model.body_jntadr[ancestor]] == backend().mjtJoint.mjJNT_FREE
            kind = "free joint" if free else "slide"
            words = f"body {body_name(model, ancestor)!r} on its {kind}"
            joints.append(MovingJoint(ancestor, dofs, words))
    chain = [a for a in _ancestors(model, body) if model.body_jntnum[a]]
    # A body with more degrees of freedom than translations turns.
    if any(model.body_dofnum[a] > len(_translations(model, a)) for a in chain):
        joints.append(_whole_tree(model, body, chain))
    return joints


def _whole_tree(model: Any, body: int, chain: list[int]) -> MovingJoint:
    """The mover of all degrees of freedom of the body's robot, those of its other limbs included.

    body: its number.
    chain: numbers of the bodies with joints from this one to the root, whose joints the mover's
    description names.
    """
    joints: list[int] = []
    for ancestor in chain:
        joints += _joints_of(model, ancestor)
    names = [joint_name(model, joint) for joint in joints]
    listed = ", ".join(names[:_NAMED_JOINTS])
    if len(names) > _NAMED_JOINTS:
        listed += ", ..."
    dofs = np.flatnonzero(model.body_rootid[model.dof_bodyid] == model.body_rootid[body])
    words = f"body {body_name(model, body)!r} on its joints ({listed})"
    return MovingJoint(body, tuple(dofs.tolist()), words, turns=True)


def chosen_joint(model: Any, body: int, move: str) -> MovingJoint | None:
    """Mover that `move` names if it carries this body, else None.

    move: "base:", "body:NAME" or "joint:NAME".
    Raises UserError for a name that the model does not have.
    """
    kind, _, name = move.partition(":")
    chain = list(_ancestors(model, body))
    if kind == "base":
        return _base_of(model, chain)
    if kind == "body":
        return _from_named_body(model, chain, name)
    return _named_joint(model, chain, name)


def _base_of(model: Any, chain: Sequence[int]) -> MovingJoint | None:
    """The free joint that moves the whole robot; None where its root has another one, or none.

    chain: numbers of a body and of those that it hangs on, up to the root; () for the world.
    """
    if not chain or model.body_dofnum[chain[-1]] != FREE_DOFS:
        return None
    root = chain[-1]
    words = f"the whole robot, by its base {body_name(model, root)!r}"
    return MovingJoint(root, _translations(model, root), words)


def _from_named_body(model: Any, chain: Sequence[int], name: str) -> MovingJoint | None:
    """Mover of a body by the joints of a named body that carries it and all joints between the two,
    which move as a push at the contact would move them; by the free joint of the named body alone
    if it has one. None where the named body does not carry the other, or no joint is between.

    chain: numbers of the body to move and of those that it hangs on, up to the root.
    Raises UserError for a name that no body has.
    """
    names = [body_name(model, b) for b in range(model.nbody)]
    # `body_name` gives them sanitized.
    name = sanitized(name)
    if name not in names:
        # Without the world, which is the first.
        raise UserError("move", f"no body {name!r}", *suggest_names(name, names[1:]))
    if (start := names.index(name)) not in chain:
        return None
    if model.body_dofnum[start] == FREE_DOFS:
        return MovingJoint(start, _translations(model, start), f"body {name!r} on its free joint")
    joints: list[int] = []
    # From the named body out to the one that is moved.
    for carrier in reversed(chain[: chain.index(start) + 1]):
        joints += _joints_of(model, carrier)
    return _of_joints(model, joints)


def _named_joint(model: Any, chain: Sequence[int], name: str) -> MovingJoint | None:
    """The mover of one joint; None where it does not carry the body.

    chain: numbers of the body and of those that it hangs on, up to the root.
    Raises UserError for a name that no joint has.
    """
    names = [joint_name(model, j) for j in range(model.njnt)]
    # `joint_name` gives them sanitized.
    name = sanitized(name)
    if name not in names:
        raise UserError("move", f"no joint {name!r}", *suggest_names(name, names))
    joint = names.index(name)
    if int(model.jnt_bodyid[joint]) not in chain:
        return None
    return _of_joints(model, [joint])


def _of_joints(model: Any, joints: list[int]) -> MovingJoint | None:
    """The mover of these joints together; None for no joint.

    joints: numbers, of one chain, from the root on. A single slide or free joint moves in
    translation alone.
    """
    if not joints:
        return None
    kinds = backend().mjtJoint
    words = ", ".join(joint_name(model, joint) for joint in joints)
    body = int(model.jnt_bodyid[joints[-1]])
    if len(joints) == 1:
        kind = int(model.jnt_type[joints[0]])
        text = f"body {body_name(model, body)!r} on its joint {words}"
        if kind == kinds.mjJNT_SLIDE:
            return MovingJoint(body, (int(model.jnt_dofadr[joints[0]]),), text)
        if kind == kinds.mjJNT_FREE:
            return MovingJoint(body, _translations(model, body), text)
    # Degrees of freedom of a joint; a hinge and a slide have one.
    dof_counts = {int(kinds.mjJNT_FREE): FREE_DOFS, int(kinds.mjJNT_BALL): 3}
    dofs: list[int] = []
    for joint in joints:
        first = int(model.jnt_dofadr[joint])
        count = dof_counts.get(int(model.jnt_type[joint]), 1)
        dofs += range(first, first + count)
    text = f"body {body_name(model, body)!r} on its joints ({words})"
    return MovingJoint(body, tuple(dofs), text, turns=True)


def immobile_error(pair: ContactPair) -> UserError:
    """The error to raise where neither part of a pair can be launched at the other: because both are
    fixed, or on hinges or balls alone.
    """
    states = []
    for part in (pair.first, pair.second):
        hinged = any(pair.model.body_jntnum[body] for body in _ancestors(pair.model, part.body))
        state = "does not move"
        if hinged:
            state = "is on hinges or balls only, which do not bring it nearer"
        states.append(f"{part.name!r} {state}")
    return UserError(
        "pair",
        " and ".join(states),
        "one of the two on joints that move it towards the other",
        "Add <freejoint/> to the body that shall bounce, or start from another --key or --qpos",
    )


def require_collisions(pair: ContactPair) -> ContactPair:
    """The pair, reduced to those geoms of each part that MuJoCo collides with a geom of the other.

    Raises UserError, with what keeps them apart, where it collides none.
    """
    model = pair.model
    first = pair.first
    second = pair.second
    every = itertools.product(first.geoms, second.geoms)
    meeting = [geoms for geoms in every if can_meet(model, geoms)]
    if not meeting or _disabling(model):
        # MuJoCo welds what stands still to the world, number 0: of two such that is the reason.
        if model.body_weldid[first.body] or model.body_weldid[second.body]:
            raise no_contact_error(pair)
        raise immobile_error(pair)
    of_first, of_second = zip(*meeting, strict=True)
    return ContactPair(
        model,
        NamedGeoms(first.name, first.body, tuple(dict.fromkeys(of_first))),
        NamedGeoms(second.name, second.body, tuple(dict.fromkeys(of_second))),
    )


def _disabling(model: Any) -> str:
    """The MJCF flag that disables contacts, or all constraints; "" where none does."""
    flags = backend().mjtDisableBit
    both = {"constraint": flags.mjDSBL_CONSTRAINT, "contact": flags.mjDSBL_CONTACT}
    off = [f'{name}="disable"' for name, bit in both.items() if model.opt.disableflags & bit]
    return f"<flag {' '.join(off)}/>" if off else ""


def no_contact_error(pair: ContactPair) -> UserError:
    """The error to raise for two parts between which MuJoCo makes no contact, however deep they are
    in each other.

    It says why for the first geom of each: a plug-in, a flag, a filter or their shapes.
    """
    geoms = pair.first.geoms[0], pair.second.geoms[0]
    if has_force_law(pair.model, geoms):
        got = f"{pair.first.name!r} and {pair.second.name!r} meet by the plug-in hcbench.hunt_crossley"
        advice = "Its e is the law's: docs/reference/plugins.md says up to which step"
        return UserError(
            "pair", got, "MuJoCo's own contact, or the plug-in hcbench.restitution", advice
        )
    reason = _why_apart(pair.model, geoms)
    got = f"{pair.first.name!r} and {pair.second.name!r} never touch: {reason.got}"
    return UserError("pair", got, reason.expected, reason.advice)


class _Reason(NamedTuple):
    """Reason why two geoms make no contact, in words for an error.

    got: what keeps them apart.
    expected: what would let them touch.
    advice: a sentence on the fix; "" where there is none to name.
    """

    got: str
    expected: str
    advice: str = ""


def _why_apart(model: Any, geoms: tuple[int, int]) -> _Reason:
    """Find the first reason why MuJoCo makes no contact of two geoms: a flag of the whole model, a
    filter of MuJoCo's, or else their shapes.

    geoms: numbers of the two.
    """
    if flag := _disabling(model):
        return _Reason(
            f"contacts are disabled, by {flag}", "contacts", f"Remove {flag} from <option>"
        )
    match collision_filter(model, *geoms):
        case "exclude":
            return _Reason("<exclude> names their bodies", "no <exclude> for them")
        case "masks":
            masks = []
            for geom in geoms:
                mask = f"{model.geom_contype[geom]}/{model.geom_conaffinity[geom]}"
                masks.append(f"{geom_name(model, geom)} has {mask}")
            return _Reason(
                got=f"contype/conaffinity do not match ({', '.join(masks)})",
                expected="contype of one to share a bit with conaffinity of the other",
                advice='Remove them, or write contype="1" conaffinity="1" on both',
            )
        case "welded":
            return _Reason("they are one rigid body", "two bodies that can move apart")
        case "parent":
            return _Reason("parent and child are filtered", "a <pair> of the two in <contact>")
        case "":
            one = _shape(model, geoms[0])
            other = _shape(model, geoms[1])
            return _Reason(
                got=f"MuJoCo made no contact of a {one} inside a {other}",
                expected="two geoms that it collides, that meet along their common normal",
            )


# The pair of geoms that a request means, and all that a MuJoCo model lets collide, with their
# poses.

# Two geoms, in ascending order.
_Geoms = tuple[int, ...]
# In masses of the whole model: along a normal of a larger effective mass
# only round-off moves the two.
_HEAVIEST = 1e4
# Keyframes that are looked at: each takes a collision detection of the whole model.
_POSES_MAX = 50


def find_pair(model: Any, request: Request, state: Any = None) -> ContactPair:
    """The pair of a request; without names, the only body that moves and the only thing it can
    meet.

    state: MjData to start from where there is a choice to list, or None.
    Raises UserError for names that mean no pair, and with a list where there is a choice.
    """
    names = request.pair or only_pair(model)
    if names is None:
        raise choice_error(list_pairs(model, request, state))
    return named_pair(model, names)


def list_pairs(model: Any, request: Request, state: Any = None) -> list[CandidatePair]:
    """Every pair of geoms that can meet; those that touch at the start first.

    state: MjData to start from, or None.

    Raises UserError for a start configuration that the model cannot have, for a model in which a
    flag disables contacts, and for one in which only soft bodies can meet.
    """
    mujoco = backend()
    if flag := _disabling(model):
        got = f"contacts are disabled, by {flag}"
        raise UserError("model", got, "contacts", f"Remove {flag} from <option>")
    with captured_warnings():
        data, _ = start_pose(model, request, state)
        mujoco.mj_forward(model, data)
        poses_of = _poses_of_touch(model)
        # Pairs of geoms that touch at the start, each in ascending order.
        touching_now = {tuple(sorted(c.geom.tolist())) for c in data.contact if c.dist <= 0.0}
        meeting = _collisions(model)
        if not meeting and model.nflex:
            got = "no two geoms can meet, and contacts of soft bodies (flex) are not measured"
            raise UserError("model", got, "two rigid parts that collide, one of which moves")
        described = [_described(model, data, a, b, touching_now, poses_of) for a, b in meeting]
        return in_order(described)


def _collisions(model: Any) -> list[tuple[int, int]]:
    """Numbers of the two geoms of each pair that MuJoCo collides: first one that moves, then one
    that is fixed; of two that both move or both are fixed, a plane comes last.
    """
    types = model.geom_contype
    affinities = model.geom_conaffinity
    # (ngeom, ngeom): MuJoCo asks for a common bit of one's type and the
    # other's affinity, either way.
    match = (types[:, None] & affinities[None, :]) | (types[None, :] & affinities[:, None])
    meet = set()
    # Above the diagonal: each two geoms once.
    for first, second in np.argwhere(np.triu(match, 1)).tolist():
        if not collision_filter(model, first, second):
            meet.add((first, second))
    for one, other in zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True):
        meet.add((min(one, other), max(one, other)))
    ordered = []
    for first, second in sorted(meet):
        if _rank(model, first) <= _rank(model, second):
            ordered.append((first, second))
        else:
            ordered.append((second, first))
    return ordered


def _rank(model: Any, geom: int) -> tuple[bool, int]:
    """A key by which geoms that move sort before fixed ones, and planes last."""
    body = int(model.geom_bodyid[geom])
    return not model.body_weldid[body], int(model.geom_type[geom] == backend().mjtGeom.mjGEOM_PLANE)


def _poses_of_touch(model: Any) -> dict[_Geoms, list[str]]:
    """Names of the poses in which two geoms touch, by the numbers of the two, ascending.

    The poses are the model's zero ("qpos0") and the first keyframes. The list is empty for two that
    only come within their margin.
    Raises UserError for a keyframe with an impossible pose.
    """
    names_of: dict[_Geoms, list[str]] = {}
    poses = ["qpos0", *(str(i) for i in range(min(model.nkey, _POSES_MAX)))]
    for key in poses:
        data, name = start_pose(model, Request(key=key))
        backend().mj_fwdPosition(model, data)
        for contact in data.contact:
            # MuJoCo has contacts within a margin, too; only those at 0 m or less touch.
            names = names_of.setdefault(tuple(sorted(contact.geom.tolist())), [])
            if contact.dist <= 0.0 and name not in names:
                names.append(name)
    return names_of


def _described(
    model: Any,
    data: Any,
    a: int,
    b: int,
    touching_now: set[_Geoms],
    poses_of: dict[_Geoms, list[str]],
) -> CandidatePair:
    """Two geoms as a candidate: names, effective mass (kg), signed distance (m) and contact in
    force; NaN for a mass or distance that MuJoCo cannot tell.

    data: MjData at the start, after mj_forward.
    a, b: numbers of the geoms, the one that moves first.
    touching_now: pairs of geoms that touch in `data`, ascending.
    poses_of: names of the poses in which two geoms touch, by the two, ascending.
    """
    body_a = int(model.geom_bodyid[a])
    body_b = int(model.geom_bodyid[b])
    name_a = geom_name(model, a)
    name_b = geom_name(model, b)
    first = NamedGeoms(name_a, body_a, (a,))
    second = NamedGeoms(name_b, body_b, (b,))
    near = ContactPair(model, first, second).nearest(data)
    # The two in ascending order, by which `touching_now` and `poses_of` have them.
    key = tuple(sorted((a, b)))
    normal = near.normal
    # Where the nearest points coincide there is no direction between them: take the contact's. The
    # effective mass is the same for either sign of it.
    if not normal.any():
        for contact in data.contact:
            if tuple(sorted(contact.geom.tolist())) == key:
                normal = contact.frame[:3]
                break
    distance = math.nan
    mass = math.nan
    if np.isfinite(near.distance):
        distance = float(near.distance)
        if normal.any():
            mass = _mass_along(model, data, (body_a, body_b), near.point, normal)
    # What a launch would move: the nearest mover of the first geom, else of the second.
    joints = moving_joints(model, body_a) + moving_joints(model, body_b)
    moved = "nothing"
    if joints:
        moved = joints[0].description
    return CandidatePair(
        bodies=(body_name(model, body_a), body_name(model, body_b)),
        geoms=(name_a, name_b),
        types=(_shape(model, a), _shape(model, b)),
        pair=joined_names([_unmistakable(model, a), _unmistakable(model, b)]),
        joint=moved,
        effective_mass=mass,
        distance=distance,
        touching=key in touching_now,
        touching_in=tuple(poses_of.get(key, ())),
        settings=contact_in_force(model, a, b),
    )


def _shape(model: Any, geom: int) -> str:
    """A geom's type as XML spells it."""
    return str(backend().mjtGeom(int(model.geom_type[geom])).name).removeprefix("mjGEOM_").lower()


def _mass_along(
    model: Any, data: Any, bodies: tuple[int, int], point: Floats, normal: Floats
) -> float:
    """Effective mass of two bodies along a normal, kg; NaN where no joint moves either along it.

    data: MjData with the kinematics.
    bodies: their numbers.
    point: where they meet, m, (3,).
    normal: unit vector, (3,).
    """
    first, second = bodies
    mass = effective_mass(model, data, approach_row(model, data, first, second, point, normal))
    # Bodies that cannot move along it have an infinite mass, or by round-off a huge one.
    heaviest = _HEAVIEST * float(model.body_mass.sum())
    return mass if mass < heaviest else math.nan


def _unmistakable(model: Any, geom: int) -> str:
    """Name of a geom, with the word "geom:" before it if a body has the same name."""
    name = str(geom_name(model, geom))
    bodies = {body_name(model, body) for body in range(model.nbody)}
    return f"geom:{name}" if name in bodies or "," in name else name


def contact_in_force(model: Any, a: int, b: int) -> dict[str, Any]:
    """solref, solimp, friction (sliding, torsional, rolling) and condim of two geoms' contact.

    a, b: numbers of the geoms, in either order.
    A <pair> has its own, the first of several; else they are MuJoCo's mixture of the two geoms'
    (Modeling, "Contact parameters").
    """
    if pairs := explicit_pairs(model, (a, b)):
        number = pairs[0]
        return {
            "solref": model.pair_solref[number].tolist(),
            "solimp": model.pair_solimp[number].tolist(),
            "friction": model.pair_friction[number][:3].tolist(),
            "condim": model.pair_dim[number].tolist(),
        }
    one, two = (a, b) if model.geom_priority[a] >= model.geom_priority[b] else (b, a)
    if model.geom_priority[one] > model.geom_priority[two]:
        # The geom of higher priority decides alone: it is mixed with itself.
        two = one
    both = [one, two]
    # mjMINVAL, as MuJoCo keeps a sum of two zeros from dividing by 0.
    weights = np.maximum(model.geom_solmix[both], 1e-15)
    share = float(weights[0] / weights.sum())
    solrefs = model.geom_solref[both]
    solimps = model.geom_solimp[both]
    is_direct = (solrefs[:, 0] <= 0.0).any()
    # MuJoCo averages two time constants, but takes the smaller of each
    # number where one is in direct form.
    solref = solrefs.min(axis=0) if is_direct else share * solrefs[0] + (1 - share) * solrefs[1]
    solimp = share * solimps[0] + (1 - share) * solimps[1]
    return {
        "solref": solref.tolist(),
        "solimp": solimp.tolist(),
        "friction": model.geom_friction[both].max(axis=0).tolist(),
        "condim": model.geom_condim[both].max().tolist(),
    }
