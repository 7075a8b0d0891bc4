"""Brings a pair just to touch, by MuJoCo's own collision functions, and finds how to launch it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import (
    FREE_DOFS,
    effective_mass,
    geom_friction,
    geom_name,
    response,
)
from hcbench.engines.mujoco.model.find_pair import (
    MovingJoint,
    chosen_joint,
    immobile_error,
    moving_joints,
    no_contact_error,
)
from hcbench.engines.mujoco.model.pair import BOTH_SIDES, ContactPair, Nearest, PairContact
from hcbench.engines.mujoco.model.start_pose import (
    MOVED,
    joint_at_limit,
    require_joints_within_limits,
)
from hcbench.engines.mujoco.model.touch_search import TouchSearch, swing, swing_to_touch
from hcbench.sim.model_under_test import Vector
from hcbench.sim.touch import DEEPEST, LEAST_APPROACH, require_apart, require_reachable
from hcbench.system.errors import QuantityError, UserError
from hcbench.system.text import sanitized
from hcbench.terms.bounds import BOUNDS, admits_beyond_bounds
from hcbench.terms.impact import Floats

# Where a body comes from that meets the other from above, a unit vector away from the other.
ABOVE: Vector = (0.0, 0.0, 1.0)
# Depth, m, up to which a robot may stand in the floor at the start and is raised.
_RAISED = 0.1
# Gap, m, at the end of a way from which the two have passed each other.
_MISSED = 1e-6


@dataclass(frozen=True, slots=True)
class PairAtTouch:
    """A pair that just touches, the moving body first.

    joint: what moves it.
    qpos: (nq,), at touch.
    direction: (nv,), the velocity that approaches at 1 m/s.
    effective_mass: along the normal, kg.
    gravity: acceleration of the approach in free flight, by gravity and what the model's springs
    and actuators add to it, m/s².
    overlap: how deep the two were in each other at the start, m.
    gap: at touch, by MuJoCo's distance of the geoms, m; infinite for shapes whose distance it
    cannot compute.
    note: how they were brought together, where it was a choice.
    """

    pair: ContactPair
    joint: MovingJoint
    qpos: Floats
    direction: Floats
    contact: PairContact
    effective_mass: float
    gravity: float
    overlap: float
    gap: float
    note: str = ""


def require_plausible_contact(model: Any, place: PairAtTouch) -> None:
    """Raise QuantityError for a contact whose solref MuJoCo would replace, having numbers of
    different signs, or with more friction than any surface has.

    place: the pair at touch.
    With --beyond-bounds nothing is refused.
    """
    if admits_beyond_bounds():
        return
    for row in place.contact.rows:
        # A time constant and a damping ratio, or the negatives of a stiffness and a damping.
        first, second, *_ = row.solref
        if (first > 0) != (second > 0):
            names = " and ".join(geom_name(model, geom) for geom in row.geoms)
            got = f"{first:g} {second:g} of {names}, which MuJoCo replaces by its default"
            expected = "both positive (time, damping ratio), or none above 0 (-stiffness, -damping)"
            raise QuantityError("solref", got, expected)
    _, largest = BOUNDS["friction"]
    for geoms in dict.fromkeys(row.geoms for row in place.contact.rows):
        # The one in force: a <pair> has its own, whatever its geoms have.
        friction = geom_friction(model, geoms)
        if friction > largest:
            names = " and ".join(geom_name(model, geom) for geom in geoms)
            advice = "--beyond-bounds admits it, if it is meant"
            raise QuantityError(
                "friction", f"{friction:g} of geoms {names}", f"0 ... {largest:g}", advice
            )


def bring_to_touch(
    pair: ContactPair, data: Any, coming_from: Vector | None = None, move: str | None = None
) -> PairAtTouch:
    """Bring two parts just to touch, by moving the first (or, if it cannot, the second) along their
    common normal: the pair as it is to be launched.

    data: MjData at rest in the start configuration; changed.
    coming_from: unit vector from the other to the side from which the moving body comes; None: the
    nearest way.
    move: what may be moved, "base:", "body:NAME" or "joint:NAME"; None: the first that can.

    Raises SceneError where the two start deep in each other, UserError where joints start outside
    their limits, where no joint brings the two together, or where something else is in the way.
    """
    model = pair.model
    backend().mj_forward(model, data)
    near = pair.nearest(data)
    pair = pair.narrowed(near.geoms)
    require_joints_within_limits(model, data, (pair.first.body, pair.second.body))
    if not np.isfinite(near.distance):
        names = f"{pair.first.name!r} to {pair.second.name!r}"
        raise UserError("pair", f"no distance from {names} is known", "two solid geoms")
    if coming_from is not None:
        return _from_there(pair, data, coming_from, move)
    overlap = 0.0
    # A distance to a height field is rough: it does not tell an overlap.
    if pair.height_field < 0:
        overlap = max(0.0, -float(near.distance))
        # Robots may start a little in the floor; a loose body that is deep in it comes from above.
        near = _raised(pair, data, near)
        if near.distance < -DEEPEST * pair.size and _is_loose(pair):
            said = f"{pair.first.name!r} starts {-near.distance:.3g} m inside {pair.second.name!r}"
            above = _from_there(pair, data, ABOVE, move)
            return replace(above, note=f"{said}: met from above.")
        advice = "Move one away, or start from another keyframe or --qpos"
        require_apart(near.distance, pair.size, pair.first.name, pair.second.name, advice)
    if not near.normal.any():
        near = near._replace(normal=_guess_normal(pair, data))
    row = pair.approach_row(data, near.point, near.normal)
    return _by_some_joint(pair, data, _joints(pair, move), row, overlap)


def _by_some_joint(
    pair: ContactPair,
    data: Any,
    movers: Sequence[tuple[ContactPair, MovingJoint]],
    row: Floats,
    overlap: float,
) -> PairAtTouch:
    """Bring two parts together the nearest way, by the first mover that does so within the limits of
    its joints, or else by the first that does so at all.

    data: MjData at the start, and again when this returns.
    movers: (pair with the moving part first, mover) of each.
    row: Jacobian of the approach rate along the line between the two, (nv,).
    overlap: of the two at the start, m.

    Raises UserError where no mover brings them together: of the reasons that the movers give, that
    the two pass each other goes first.
    """
    # A miss goes first: it says more than what else is in the way.
    errors: list[UserError] = []
    strained: PairAtTouch | None = None
    for ordered, joint in movers:
        try:
            placed = _along_nearest(ordered, data, joint, row, overlap)
        except _PassedError as error:
            errors.insert(0, error)
        except UserError as error:
            errors.append(error)
        else:
            if placed is None:
                continue
            if not _is_strained(placed):
                return placed
            # A limit would turn the part back before it touches.
            strained = strained or placed
    if strained is not None:
        return strained
    if errors:
        raise errors[0]
    if any(not joint.turns for _, joint in movers):
        got = f"{pair.first.name!r} and {pair.second.name!r} slide past each other: no joint moves one"
        raise UserError("pair", f"{got} towards the other", "a joint along their common normal")
    raise immobile_error(pair)


def _is_strained(placed: PairAtTouch) -> bool:
    """Say whether a joint of the mover, with which a pair was brought to touch, is far beyond its
    limit there.

    placed: the pair at touch.
    """
    model = placed.pair.model
    at_touch = backend().MjData(model)
    at_touch.qpos[:] = placed.qpos
    joints = set(model.dof_jntid[list(placed.joint.dofs)].tolist())
    for joint in joints:
        if model.jnt_limited[joint] and joint_at_limit(model, at_touch, joint).is_far_beyond:
            return True
    return False


def _raised(pair: ContactPair, data: Any, near: Nearest) -> Nearest:
    """Move a robot on a free base out of the other part, if they overlap by no more than _RAISED, m;
    return the nearest points afterwards.

    data: MjData; changed.
    near: the nearest points of the two in `data`, which are returned where nothing is moved: for a
    deeper overlap, without a free base, and for a free body without joints, which the search for
    the touch moves out.
    Keyframes of standing robots often start a little inside the floor.
    """
    model = pair.model
    base = _free_base(pair)
    if not -_RAISED <= near.distance < 0.0 or base is None:
        return near
    move = _slide(pair.approach_row(data, near.point, near.normal), base)
    if _is_alone(pair, base) or move is None:
        return near
    # The distance is below 0: back along the approach.
    backend().mj_integratePos(model, data.qpos, move, float(near.distance))
    backend().mj_forward(model, data)
    # The normal of before: where two just touch the nearest points could give another one.
    return pair.nearest(data)._replace(normal=near.normal)


def _free_base(pair: ContactPair) -> MovingJoint | None:
    """The translation of the free joint that carries the first part; None without one."""
    base = next(iter(moving_joints(pair.model, pair.first.body)), None)
    if base is None or len(base.dofs) != 3 or base.turns:
        return None
    return base


def _is_loose(pair: ContactPair) -> bool:
    """Say whether the first part is on a free joint, and nothing hangs on its body by a joint."""
    base = _free_base(pair)
    return base is not None and _is_alone(pair, base)


def _is_alone(pair: ContactPair, base: MovingJoint) -> bool:
    """Say whether nothing hangs by a joint on the body that a free base carries."""
    model = pair.model
    tree = model.body_rootid[model.dof_bodyid] == model.body_rootid[base.body]
    return int(tree.sum()) <= FREE_DOFS


class _PassedError(UserError):
    """The two pass each other: reported before other reasons, which say less."""


def _joints(pair: ContactPair, move: str | None = None) -> list[tuple[ContactPair, MovingJoint]]:
    """Movers of the two parts: (pair with the moving part first, mover) of each joint, or robot as a
    whole, that can move one of them.

    move: the only mover that may be taken, "base:", "body:NAME" or "joint:NAME"; None: any.

    Raises UserError where that one carries neither of the two, or is not in the model.
    """
    orders = (pair, pair.swapped())
    if move is None:
        return [(p, joint) for p in orders for joint in moving_joints(p.model, p.first.body)]
    joints = []
    for ordered in orders:
        joint = chosen_joint(ordered.model, ordered.first.body, move)
        if joint is not None:
            joints.append((ordered, joint))
    if not joints:
        got = f"{move!r} moves neither {pair.first.name!r} nor {pair.second.name!r}"
        raise UserError("move", got, "a base, body or joint that carries one")
    return joints


def _along_nearest(
    pair: ContactPair, data: Any, joint: MovingJoint, row: Floats, overlap: float
) -> PairAtTouch | None:
    """Bring two parts together the nearest way by one mover; None where it does not move the one
    towards the other.

    pair: with the moving part first.
    joint: the mover.
    data: MjData at the start, and again when this returns.
    row: Jacobian of the approach rate along the line between the two, (nv,).
    overlap: of the two at the start, m.

    Raises UserError where MuJoCo makes no contact of them, or something holds them back or is in
    the way; its kind _PassedError where the two pass each other.
    """
    start = data.qpos.copy()
    try:
        # The velocity that approaches at 1 m/s: of an arc, where it ends near the touch.
        move = swing_to_touch(pair, data, joint.dofs, row) if joint.turns else _slide(row, joint)
        if move is None:
            return None
        search = TouchSearch(pair, data, move)
        contact = search.contact_at_touch()
        if contact is not None:
            return _at_touch(pair, data, joint, move, contact, overlap)
        if len(joint.dofs) == 3 and not joint.turns and search.gap < _MISSED:
            # A free body that reached the surface: only its nearest way was without a contact.
            data.qpos[:] = start
            note = "The nearest way ends at an edge, where the engine makes no contact: met from above."
            return replace(_from_there(pair, data, ABOVE), note=note)
        if search.gap < _MISSED:
            raise no_contact_error(pair)
        raise _passed_error(pair, data, search.gap)
    finally:
        data.qpos[:] = start
        backend().mj_fwdPosition(pair.model, data)


def _passed_error(pair: ContactPair, data: Any, gap: float) -> _PassedError:
    """The error to raise for two parts that pass each other without touching.

    data: MjData with the kinematics.
    gap: their nearest distance on the way, m.
    """
    heights = [float(data.geom_xpos[part.geoms[0]][2]) for part in (pair.first, pair.second)]
    return _PassedError(
        "pair",
        f"{pair.first.name!r} passes {pair.second.name!r} {gap:.3g} m away: its joints do not lead there "
        f"(their middles are at heights of {heights[0]:.3g} and {heights[1]:.3g} m)",
        "two that meet",
        "Start from another --key or --qpos, or name the other one first",
    )


def _from_there(
    pair: ContactPair, data: Any, coming_from: Vector, chosen: str | None = None
) -> PairAtTouch:
    """Bring two parts together along one direction, by a free joint or slides.

    data: MjData at the start; changed.
    coming_from: unit vector from the second part to the side from which the first comes; where the
    second is moved, it comes from the other side.
    chosen: the only mover that may, "base:", "body:NAME" or "joint:NAME"; None: any.
    Raises UserError where no joint moves one of them along it, they do not meet, or something else
    is in the way.
    """
    model = pair.model
    there = np.asarray(coming_from, dtype=float)
    for ordered, joint in _joints(pair, chosen):
        # The way of the moving part: the second part, if that moves, goes the opposite way.
        normal = -there if ordered.first.name == pair.first.name else there
        row = ordered.approach_row(data, data.geom_xpos[ordered.first.geoms[0]], normal)
        # Joints that turn do not lead along a line.
        move = None if joint.turns else _slide(row, joint)
        if move is None:
            continue
        start = data.qpos.copy()
        # Back until it is surely clear of the other, and from there to the touch.
        backend().mj_integratePos(model, data.qpos, move, -_clear_of(ordered, data, normal))
        contact = TouchSearch(ordered, data, move).contact_at_touch()
        # On its own line it misses the other: try the line through the other's middle.
        if contact is None:
            data.qpos[:] = start
            backend().mj_fwdPosition(model, data)
            _move_over(ordered, data, joint, normal)
            backend().mj_integratePos(model, data.qpos, move, -_clear_of(ordered, data, normal))
            contact = TouchSearch(ordered, data, move).contact_at_touch()
        if contact is not None:
            return _at_touch(ordered, data, joint, move, contact, overlap=0.0)
        raise UserError(
            "from",
            f"{ordered.first.name!r} does not meet {ordered.second.name!r} on a way along {_words(normal)}",
            "a direction from which they meet",
        )
    raise UserError(
        "from", "no free or slide joint moves one of the two along it", "another direction"
    )


def _words(vector: Floats) -> str:
    return " ".join(f"{x + 0.0:.3g}" for x in vector)


def _clear_of(pair: ContactPair, data: Any, normal: Floats) -> float:
    """Distance, m, by which the first part has to go back to be clear of the second, by their
    bounding spheres: enough, not the least.

    data: MjData with the kinematics.
    normal: unit vector along which the first approaches, (3,).
    """
    model = pair.model
    own_radius = max(float(model.geom_rbound[g]) for g in pair.first.geoms)
    middle = data.geom_xpos[pair.first.geoms[0]]
    back = 0.0
    for g in pair.second.geoms:
        # MuJoCo gives a plane the bounding radius 0.
        radius = float(model.geom_rbound[g])
        # How far, m, the first part's middle is beyond this geom's, on its way.
        beyond = float(normal @ (middle - data.geom_xpos[g]))
        # Twice its own radius: other geoms of the part may be ahead of the first.
        back = max(back, beyond + radius + 2.0 * own_radius)
    return back + 0.1 * pair.size


def _move_over(pair: ContactPair, data: Any, joint: MovingJoint, normal: Floats) -> None:
    """Move the first part sideways, until its middle is on the line along `normal` through the
    middle of the second; leave it where the joint cannot move it sideways.

    data: MjData; changed.
    normal: unit vector along which the first approaches, (3,).
    """
    model = pair.model
    first_middle = np.mean(data.geom_xpos[list(pair.first.geoms)], axis=0)
    second_middle = np.mean(data.geom_xpos[list(pair.second.geoms)], axis=0)
    way = second_middle - first_middle
    aside = way - normal * float(normal @ way)
    length = float(np.linalg.norm(aside))
    if length > 0:
        row = pair.approach_row(data, first_middle, aside / length)
        move = _slide(row, joint)
        if move is not None:
            backend().mj_integratePos(model, data.qpos, move, length)
            backend().mj_fwdPosition(model, data)


def _guess_normal(pair: ContactPair, data: Any) -> Floats:
    """Unit normal from the first to the second of two parts that just touch, (3,), where their
    nearest points coincide and give no direction.

    It is that of MuJoCo's contact; else of a plane; else along the line between the centres of the
    first geoms; else down.
    data: MjData with contacts.
    """
    contact = pair.contact(data)
    if contact is not None:
        return contact.normal
    for side, sign in ((pair.second, -1.0), (pair.first, 1.0)):
        if int(pair.model.geom_type[side.geoms[0]]) == int(backend().mjtGeom.mjGEOM_PLANE):
            # A plane's z axis points away from it.
            outward = data.geom_xmat[side.geoms[0]].reshape(3, 3)[:, 2]
            return np.asarray(sign * outward)
    line = data.geom_xpos[pair.second.geoms[0]] - data.geom_xpos[pair.first.geoms[0]]
    length = float(np.linalg.norm(line))
    return line / length if length > 0 else np.array([0.0, 0.0, -1.0])


def _slide(row: Floats, joint: MovingJoint) -> Floats | None:
    """Smallest velocity of the degrees of freedom of a mover with which the two approach at 1 m/s,
    (nv,); None where the mover hardly changes the approach rate.

    joint: the mover.
    row: Jacobian of the approach rate, (nv,).
    """
    along = row[list(joint.dofs)]
    squared = float(along @ along)
    # (m/s)² by a unit speed of the mover: as good as 0 where it moves along the surface.
    if squared < LEAST_APPROACH**2:
        return None
    direction = np.zeros_like(row)
    # Least squares: row @ direction is 1.
    direction[list(joint.dofs)] = along / squared
    return direction


def _acceleration_in_flight(model: Any, data: Any, row: Floats) -> float:
    """Acceleration with which two bodies at rest approach without a contact, m/s²: by gravity,
    springs and actuators.

    data: MjData of the pose; its accelerations are computed.
    row: Jacobian of the approach rate, (nv,). Contact is off, as one that just touches may already
    push, or adhere.
    """
    mujoco = backend()
    flags = model.opt.disableflags
    model.opt.disableflags = flags | int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    mujoco.mj_forward(model, data)
    model.opt.disableflags = flags
    return float(row @ data.qacc_smooth)


def _at_touch(
    pair: ContactPair,
    data: Any,
    joint: MovingJoint,
    move: Floats,
    contact: PairContact,
    overlap: float,
) -> PairAtTouch:
    """Describe a pair at touch as it is to be launched: direction, effective mass and acceleration
    of the approach.

    pair: with the moving body first.
    joint: the mover.
    data: MjData at touch.
    move: velocity along which the two were brought together, (nv,).
    contact: MuJoCo's, of the two.
    overlap: of the two at the start, m.

    Raises UserError where the contact's normal is not one that the joint can move along, where
    other parts are in the way, or where a tendon or an equality holds the two back.
    """
    model = pair.model
    normal = contact.normal
    row = pair.approach_row(data, contact.point, normal)
    # The contact's normal was read with the two bodies the other way round.
    if float(row @ move) < 0:
        row = -row
        normal = -normal
    # The velocity with which the two approach at 1 m/s along the contact's own normal, (nv,).
    direction = swing(model, data, row, joint.dofs) if joint.turns else _slide(row, joint)
    mass = effective_mass(model, data, row)
    if direction is None or not np.isfinite(mass):
        got = f"{pair.first.name!r} cannot move along the contact normal"
        raise UserError("pair", got, "a joint that lets it")
    _require_room(pair, data)
    # Motion by a unit push at the contact, (nv,).
    by_push = response(model, data, row)
    tethered = tether_error(model, data, by_push, (pair.first.name, pair.second.name))
    if tethered is not None:
        raise tethered
    gravity = _acceleration_in_flight(model, data, row)
    # MuJoCo's distance to a height field is not reliable.
    gap = np.inf
    if pair.height_field < 0:
        gap = float(pair.nearest(data).distance)
    return PairAtTouch(
        pair=pair,
        joint=joint,
        qpos=data.qpos.copy(),
        direction=direction,
        contact=replace(contact, normal=normal),
        effective_mass=mass,
        gravity=gravity,
        overlap=overlap,
        gap=gap,
    )


def _require_room(pair: ContactPair, data: Any) -> None:
    """Raise UserError if at touch another part of the robot that moves is deep in what does not move
    with it; the error names the two.

    pair: with the moving part first.
    data: MjData at touch, with its contacts. "Deep" is a share of the smaller geom's bounding
    radius.
    """
    model = pair.model
    names = (pair.first.name, pair.second.name)
    advice = ", or start from a keyframe or --qpos in which these do"
    roots = model.body_rootid[model.geom_bodyid]
    moves = roots == model.body_rootid[pair.first.body]
    for contact in data.contact:
        one, other = contact.geom.tolist()
        # A geom of -1 is none: the contact is that of a flex.
        if (
            min(one, other) < 0
            or contact.exclude
            or pair.sides[one] + pair.sides[other] == BOTH_SIDES
        ):
            continue
        # Both are of the robot, or neither is.
        if moves[one] == moves[other]:
            continue
        part, third = (one, other) if moves[one] else (other, one)
        # The smaller bounding radius, m; MuJoCo gives a plane the radius 0.
        size = min(r for r in (*model.geom_rbound[[part, third]], np.inf) if r > 0)
        blocked = (repr(geom_name(model, part)), repr(geom_name(model, third)))
        require_reachable(-contact.dist, size, names, blocked, advice)


def tether_error(
    model: Any, data: Any, by_push: Floats, names: tuple[str, str]
) -> UserError | None:
    """The error to raise where a tendon beyond its limit, or a stretched equality, holds two parts
    back from touching; None where no such constraint feels a push at the contact.

    data: MjData at touch, with its constraints.
    by_push: M^-1 J^T, the motion by a unit push at the contact, (nv,).
    names: of the two, the moving part first.
    """
    mujoco = backend()
    if not data.nefc:
        return None
    # How fast each constraint of the model moves by the push, (nefc,): those at 0 do not feel it.
    coupling = np.zeros(data.nefc)
    mujoco.mj_mulJacVec(model, data, coupling, by_push)
    round_off = 1e-9 * max(1.0, float(np.abs(by_push).max()))
    for i in np.flatnonzero(np.abs(coupling) > round_off):
        kind = int(data.efc_type[i])
        number = int(data.efc_id[i])  # of the tendon or the equality
        off = float(data.efc_pos[i])  # m: room to a tendon's limit, error of an equality
        if kind == mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON and off < -MOVED:
            what = f"tendon {sanitized(model.tendon(number).name) or number!r} would be {-off:.3g} m beyond"
            what += " its limit"
        elif kind == mujoco.mjtConstraint.mjCNSTR_EQUALITY and abs(off) > MOVED:
            name = sanitized(model.equality(number).name) or str(number)
            what = f"equality {name!r} would be off by {abs(off):.3g}"
        else:
            continue
        return UserError(
            "pair",
            f"{names[0]!r} is held back before it meets {names[1]!r}: {what}",
            "a pose from which the two can meet",
            "Give one by --key or --qpos, or another direction by --from",
        )
    return None
