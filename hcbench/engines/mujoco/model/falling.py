"""Trees of bodies that gravity lets fall: the joints of their bases, and which tree is the robot."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.model.bodies import body_name, joint_name
from hcbench.engines.mujoco.model.find_pair import named_pair, only_pair
from hcbench.engines.mujoco.model.over_floor import drive_of
from hcbench.engines.mujoco.model.start_pose import MOVED
from hcbench.sim.landing import HEIGHTS, latest_touch
from hcbench.sim.packages import suggest_names
from hcbench.system.errors import UserError
from hcbench.system.text import sanitized

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.sim.model_under_test import Request
    from hcbench.terms.impact import Floats

# Cosine of the angle between a slide and gravity from which the slide carries a base down: on a rail
# of 45 degrees a fall takes 1.4 times as long, within the time for which a touch is waited.
_STEEP = math.cos(math.radians(45.5))
# Share of a drop that a base must fall without contact: what servos or springs hold falls less.
_FALLS = 0.9
# A slide is lengthened by this beyond what a drop needs, m.
_ROOM = 1.0
# Names of trees that a note lists, at most.
_SHOWN = 5
_PAIRS = "pairs of one tree, which can fall, with what stands still"
_EXPECTED = "a base on a free joint, or on a slide of 45 degrees or steeper that nothing holds"


@dataclass(frozen=True, slots=True)
class Base:
    """The base of a tree of bodies that falls: how it rises and tilts.

    root: number of the root body of the tree.
    slide: number of the slide by which it falls, None for a free joint.
    rise: velocities of the model that raise the tree by 1 m/s without turning it, (nv,), with what
    it holds.
    turns_by: number of the joint by which it tilts, None where it cannot turn.
    has_joints: whether the tree has joints beside those of its base.
    held: numbers of the free joints of bodies that it holds, which rise and tilt with it.
    """

    root: int
    slide: int | None
    rise: Floats
    turns_by: int | None
    has_joints: bool
    held: tuple[int, ...] = ()

    def lift(self, model: Any, data: Any, height: float) -> None:
        """Raise the tree in the pose of `data` by a height, m; below 0 to lower it."""
        backend().mj_integratePos(model, data.qpos, self.rise, height)

    def release(self, model: Any, data: Any, to_touch: float, height: float) -> None:
        """Raise the tree in the pose of `data` from its touch with the floor to a height, m.

        to_touch: way up to the touch, m.
        A slide that ends below the release is lengthened in the model, and stays so: only the
        landing is of interest.
        Raises UserError where the slide does not reach the floor.
        """
        self.lift(model, data, to_touch)
        if self.slide is not None and self._beyond_slide(model, data):
            low, high = model.jnt_range[self.slide].tolist()
            got = f"the slide {joint_name(model, self.slide)!r}, {low:.3g} ... {high:.3g} m"
            raise UserError("model", got, "a slide that lets the robot down to the floor")
        self.lift(model, data, height)
        beyond = self._beyond_slide(model, data)
        if beyond:
            end = 1 if beyond > 0.0 else 0
            model.jnt_range[self.slide, end] += beyond + math.copysign(_ROOM, beyond)

    def _beyond_slide(self, model: Any, data: Any) -> float:
        """Way by which the pose of `data` is beyond the limits of the slide, m, below 0 at the lower
        one; 0 within them, and without limits.
        """
        slide = self.slide
        if slide is None or not model.jnt_limited[slide]:
            return 0.0
        position = float(data.qpos[int(model.jnt_qposadr[slide])])
        beyond = position - float(np.clip(position, *model.jnt_range[slide]))
        return beyond if abs(beyond) > MOVED else 0.0

    def tilt(self, model: Any, data: Any, axis: tuple[float, float, float], angle: float) -> None:
        """Turn the tree in the pose of `data` by an angle, rad; nothing for a base that cannot turn.

        axis: unit vector in the world about which a free or ball joint turns; a hinge turns about
        its own axis, the way that is nearer.
        """
        joint = self.turns_by
        if joint is None:
            return
        mujoco = backend()
        address = int(model.jnt_qposadr[joint])
        kind = int(model.jnt_type[joint])
        mujoco.mj_kinematics(model, data)
        turn = np.zeros(4)
        if kind == int(mujoco.mjtJoint.mjJNT_HINGE):
            is_opposite = float(data.xaxis[joint] @ np.array(axis)) < 0.0
            by = -angle if is_opposite else angle
            mujoco.mju_axisAngle2Quat(turn, data.xaxis[joint], by)
            self._tilt_held(model, data, turn)
            data.qpos[address] += by
            return
        mujoco.mju_axisAngle2Quat(turn, np.array(axis), angle)
        self._tilt_held(model, data, turn)
        if kind == int(mujoco.mjtJoint.mjJNT_FREE):
            address += 3
        if kind == int(mujoco.mjtJoint.mjJNT_BALL):
            turn = _in_frame_of_ball(model, data, joint, turn)
        _turn(data.qpos[address : address + 4], turn)

    def _tilt_held(self, model: Any, data: Any, turn: Floats) -> None:
        """Turn what the tree holds about the anchor of the joint by which it tilts.

        data: MjData with the kinematics.
        turn: quaternion w x y z in the world, (4,).
        """
        mujoco = backend()
        anchor = data.xanchor[self.turns_by]
        for joint in self.held:
            address = int(model.jnt_qposadr[joint])
            place = data.qpos[address : address + 3]
            arm = np.zeros(3)
            mujoco.mju_rotVecQuat(arm, place - anchor, turn)
            place[:] = anchor + arm
            _turn(data.qpos[address + 3 : address + 7], turn)


def _turn(attitude: Floats, turn: Floats) -> None:
    """Turn an attitude, a quaternion w x y z, (4,), in place: it becomes turn * attitude."""
    turned = np.zeros(4)
    backend().mju_mulQuat(turned, turn, attitude)
    attitude[:] = turned


def _in_frame_of_ball(model: Any, data: Any, joint: int, turn: Floats) -> Floats:
    """A turn in the world, written in the frame from which a ball joint counts its attitude: the
    quaternion w x y z, (4,), by which to multiply the joint's own from the left.

    data: MjData with the kinematics.
    joint: number of the ball joint.
    turn: quaternion w x y z, (4,), in the world.
    The body's attitude in the world is f q, with the frame f and the joint's own q. Turned by t it
    is t f q = f (f* t f) q: the result is f* t f.
    """
    mujoco = backend()
    address = int(model.jnt_qposadr[joint])
    attitude = data.xquat[int(model.jnt_bodyid[joint])]
    conjugate = np.zeros(4)
    # f = (f q) q*.
    frame = np.zeros(4)
    mujoco.mju_negQuat(conjugate, data.qpos[address : address + 4])
    mujoco.mju_mulQuat(frame, attitude, conjugate)
    turned_frame = np.zeros(4)
    mujoco.mju_mulQuat(turned_frame, turn, frame)
    in_frame = np.zeros(4)
    mujoco.mju_negQuat(conjugate, frame)
    mujoco.mju_mulQuat(in_frame, conjugate, turned_frame)
    return in_frame


def base_of(model: Any, start: Any, root: int) -> Base:
    """Find how a tree of bodies falls.

    start: MjData of the pose from which it falls, with its kinematics and mass matrix.
    root: number of the tree's root body.
    Raises UserError for a model without gravity, and for a tree that does not fall: it says what
    keeps it.
    """
    up = _up(model)
    joints = _base_joints(model, root)
    kinds = backend().mjtJoint
    of_kind: dict[int, list[int]] = {}
    for joint in joints:
        of_kind.setdefault(int(model.jnt_type[joint]), []).append(joint)
    rise = np.zeros(model.nv)
    slide = None
    turning = of_kind.get(int(kinds.mjJNT_FREE), [])
    if turning:
        dof = int(model.jnt_dofadr[turning[0]])
        rise[dof : dof + 3] = up
    else:
        slides = of_kind.get(int(kinds.mjJNT_SLIDE), [])
        slide = max(slides, key=lambda each: abs(float(start.xaxis[each] @ up)), default=None)
        along = 0.0 if slide is None else float(start.xaxis[slide] @ up)
        if slide is None or abs(along) < _STEEP:
            raise _no_fall(model, root, "no joint of its base lets it")
        rise[int(model.jnt_dofadr[slide])] = 1.0 / along
        hinges = of_kind.get(int(kinds.mjJNT_HINGE), [])
        # A turn about the vertical does not tilt.
        leaning = [each for each in hinges if abs(float(start.xaxis[each] @ up)) < _STEEP]
        turning = of_kind.get(int(kinds.mjJNT_BALL), []) + leaning
    in_tree = int((model.body_rootid[model.jnt_bodyid] == root).sum())
    held = _held_joints(model, start, root)
    for joint in held:
        dof = int(model.jnt_dofadr[joint])
        rise[dof : dof + 3] = up
    base = Base(root, slide, rise, next(iter(turning), None), in_tree > len(joints), held)
    _require_fall(model, start, base, up)
    return base


def _held_joints(model: Any, start: Any, root: int) -> tuple[int, ...]:
    """Numbers of the free joints of loose bodies that a tree holds in the pose: they touch it, and
    nothing that stands still.

    start: MjData of the pose, with its contacts.
    root: number of the tree's root body.
    """
    held = set()
    on_floor = set()
    for contact in start.contact:
        if contact.efc_address < 0:
            continue
        bodies = model.geom_bodyid[contact.geom]
        one, other = model.body_rootid[bodies].tolist()
        if root in (one, other):
            held.add(other if one == root else one)
        if not model.body_weldid[bodies].all():
            on_floor |= {one, other}
    joints = []
    for body in sorted(held - on_floor - {root}):
        joint = int(model.body_jntadr[body])
        if joint >= 0 and int(model.jnt_type[joint]) == int(backend().mjtJoint.mjJNT_FREE):
            joints.append(joint)
    return tuple(joints)


def held_names(model: Any, base: Base) -> list[str]:
    """Names of the bodies that a tree holds."""
    return [repr(body_name(model, int(model.jnt_bodyid[joint]))) for joint in base.held]


def _no_fall(model: Any, root: int, why: str) -> UserError:
    """The error for a tree that does not fall. root: number of its root body. why: a clause."""
    return UserError("model", f"{body_name(model, root)!r} does not fall: {why}", _EXPECTED)


def _up(model: Any) -> Floats:
    """Unit vector against gravity, (3,). Raises UserError for a model without gravity."""
    gravity = np.asarray(model.opt.gravity)
    is_off = model.opt.disableflags & backend().mjtDisableBit.mjDSBL_GRAVITY
    if is_off or not gravity.any():
        raise UserError(
            "gravity",
            "the model has none",
            "a gravity that lets the robot fall",
            "Try --gravity 9.81",
        )
    return np.asarray(-gravity / np.linalg.norm(gravity))


def _base_joints(model: Any, root: int) -> list[int]:
    """Numbers of the joints by which the base of a tree moves in the world, from its root on.

    They end where a joint is driven or has a spring, where the tree branches, and after a body that
    turns: what follows are the joints of a robot.
    """
    free = int(backend().mjtJoint.mjJNT_FREE)
    slide = int(backend().mjtJoint.mjJNT_SLIDE)
    driven = _driven_joints(model)
    joints: list[int] = []
    body = root
    while True:
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            if int(model.jnt_type[joint]) == free:
                return [joint]
            if joint in driven or model.jnt_stiffness[joint].any():
                return joints
            joints.append(joint)
        children = np.flatnonzero(model.body_parentid == body).tolist()
        turns = any(int(model.jnt_type[joint]) != slide for joint in joints)
        if turns or len(children) != 1:
            return joints
        body = children[0]


def _driven_joints(model: Any) -> set[int]:
    """Numbers of the joints on which actuators act."""
    kinds = backend().mjtTrn
    on_joint = np.isin(
        model.actuator_trntype, [int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT)]
    )
    return set(model.actuator_trnid[on_joint, 0].tolist())


def _require_fall(model: Any, start: Any, base: Base, up: Floats) -> None:
    """Raise UserError for a tree that does not fall where nothing is below it: a constraint ties it
    to something else, or servos, springs or gravity compensation hold it.

    base: how the tree rises.
    start: MjData of the pose, which stays as it is.
    up: unit vector, (3,).
    """
    mujoco = backend()
    tie = _tie(model, start, base.root)
    if tie is not None:
        name = sanitized(str(model.eq(tie).name)) or f"number {tie}"
        raise _no_fall(model, base.root, f"the equality constraint {name!r} holds it")
    height = max(HEIGHTS)
    data = copy.copy(start)
    base.lift(model, data, height)
    flags = int(model.opt.disableflags)
    with captured_warnings():
        mujoco.mj_forward(model, data)
        # Servos hold the height that they are to fall from.
        drive, _ = drive_of("pd", model, data, base.root)
        begin = float(up @ data.subtree_com[base.root])
        lowest = begin
        seconds = latest_touch(height, float(np.linalg.norm(model.opt.gravity)))
        model.opt.disableflags = flags | int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        for _ in range(math.ceil(seconds / model.opt.timestep)):
            drive(data)
            mujoco.mj_step(model, data)
            lowest = min(lowest, float(up @ data.subtree_com[base.root]))
            if begin - lowest > _FALLS * height:
                break
        model.opt.disableflags = flags
    if not begin - lowest > _FALLS * height:
        raise _no_fall(model, base.root, "servos, springs or other forces hold it")


def _tie(model: Any, data: Any, root: int) -> int | None:
    """Number of an equality constraint that ties a tree to what is not part of it; None without one.

    data: MjData, in which constraints may be off.
    root: number of the tree's root body.
    """
    mujoco = backend()
    kinds = [int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)]
    for number in range(model.neq):
        if int(model.eq_type[number]) not in kinds or not data.eq_active[number]:
            continue
        ends = np.array([model.eq_obj1id[number], model.eq_obj2id[number]])
        if int(model.eq_objtype[number]) == int(mujoco.mjtObj.mjOBJ_SITE):
            ends = model.site_bodyid[ends]
        in_tree = model.body_rootid[ends] == root
        if in_tree.any() and not in_tree.all():
            return number
    return None


# Which tree is the robot.


def base_of_pairs(model: Any, start: Any, requests: Sequence[Request]) -> Base:
    """Find how the one tree falls of which each pair has one part.

    model: compiled.
    start: MjData of the pose, with its kinematics and mass matrix.
    requests: of the pairs; without names, the only pair that the model has.
    Raises UserError where a pair is missing or unknown, where both or none of its parts move, for
    parts of several trees, without gravity, and for a tree that does not fall.
    """
    roots = set()
    for request in requests:
        names = request.pair or only_pair(model)
        if names is None:
            raise UserError("pair", "missing", _PAIRS)
        pair = named_pair(model, names)
        one, two = pair.first.body, pair.second.body
        moving = [body for body in (one, two) if model.body_weldid[body]]
        if len(moving) != 1:
            raise UserError("pair", ",".join(names), _PAIRS)
        roots.add(int(model.body_rootid[moving[0]]))
    if len(roots) != 1:
        raise UserError("pair", "parts of several robots", _PAIRS, "Tune them one by one")
    return base_of(model, start, roots.pop())


def robot_in(model: Any, start: Any, move: str | None) -> tuple[Base, list[str]]:
    """Find the robot of a model, and sentences on how it was chosen where several trees fall.

    It is the tree that falls and that actuators drive; without one a tree that falls and has joints
    beside those of its base; without one any that falls; of several the heaviest.
    start: MjData of the pose, with its kinematics and mass matrix.
    move: "body:NAME" or "joint:NAME" of the tree to take; else None or "base:".
    Raises UserError for unknown names, without gravity, and where nothing falls.
    """
    _up(model)
    named = _named_root(model, move)
    if named is not None:
        return base_of(model, start, named), []
    roots = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
    driven = _driven_roots(model)
    falling: list[Base] = []
    reasons: dict[int, UserError] = {}
    for root in roots:
        if not model.body_dofnum[model.body_rootid == root].any():
            continue
        try:
            falling.append(base_of(model, start, root))
        except UserError as error:
            reasons[root] = error
    if not falling and reasons:
        raise reasons[max(reasons, key=lambda root: float(model.body_subtreemass[root]))]
    if not falling:
        raise UserError("model", "no body falls: all are fixed to the world", _EXPECTED)

    def rank(base: Base) -> tuple[bool, bool, float]:
        mass = float(model.body_subtreemass[base.root])
        return base.root in driven, base.has_joints, mass

    falling.sort(key=rank, reverse=True)
    return falling[0], list(_choice(model, falling, driven & set(reasons)))


def _driven_roots(model: Any) -> set[int]:
    """Numbers of the root bodies of the trees that actuators move: by a joint, a tendon or a site."""
    kinds = backend().mjtTrn
    bodies: set[int] = {int(model.jnt_bodyid[joint]) for joint in _driven_joints(model)}
    for actuator in range(model.nu):
        kind = int(model.actuator_trntype[actuator])
        number = int(model.actuator_trnid[actuator, 0])
        if kind in (int(kinds.mjTRN_SITE), int(kinds.mjTRN_SLIDERCRANK)):
            bodies.add(int(model.site_bodyid[number]))
        elif kind == int(kinds.mjTRN_TENDON):
            bodies |= _bodies_of_tendon(model, number)
    return set(model.body_rootid[sorted(bodies)].tolist()) - {0}


def _bodies_of_tendon(model: Any, tendon: int) -> set[int]:
    """Numbers of the bodies on which a tendon pulls: those of its joints and sites."""
    kinds = backend().mjtWrap
    bodies: set[int] = set()
    first = int(model.tendon_adr[tendon])
    for wrap in range(first, first + int(model.tendon_num[tendon])):
        kind = int(model.wrap_type[wrap])
        number = int(model.wrap_objid[wrap])
        if kind == int(kinds.mjWRAP_JOINT):
            bodies.add(int(model.jnt_bodyid[number]))
        elif kind == int(kinds.mjWRAP_SITE):
            bodies.add(int(model.site_bodyid[number]))
    return bodies


def _choice(model: Any, falling: Sequence[Base], held: set[int]) -> Iterator[str]:
    """Sentences on how the robot was chosen; none where it is the only one.

    falling: trees that fall, the robot first.
    held: numbers of the root bodies of trees that actuators drive and that do not fall.
    """
    robot, *others = (body_name(model, base.root) for base in falling)
    if held and falling[0].root not in _driven_roots(model):
        names = ", ".join(repr(body_name(model, root)) for root in sorted(held))
        yield f"{robot!r} is dropped: {names}, which actuators drive, does not fall."
    if others:
        shown = ", ".join(repr(name) for name in others[:_SHOWN])
        more = f" and {len(others) - _SHOWN} more" if len(others) > _SHOWN else ""
        yield (
            f"{len(falling)} trees of bodies fall; {robot!r} is dropped. --move body:NAME drops"
            f" another: {shown}{more}."
        )


def _named_root(model: Any, move: str | None) -> int | None:
    """Number of the root body of the tree that has the body or joint of `move`; None for None and
    "base:".

    Raises UserError for a name that the model does not have, and for a body that is fixed.
    """
    kind, _, name = (move or "").partition(":")
    if kind == "body":
        names = [body_name(model, body) for body in range(model.nbody)]
        bodies = list(range(model.nbody))
    elif kind == "joint":
        names = [joint_name(model, joint) for joint in range(model.njnt)]
        bodies = model.jnt_bodyid.tolist()
    else:
        return None
    # Names are sanitized where they are read.
    name = sanitized(name)
    if name not in names:
        raise UserError("move", f"no {kind} {name!r}", *suggest_names(name, names))
    return int(model.body_rootid[bodies[names.index(name)]])
