"""Start configuration of a MuJoCo model: a keyframe or a state with
joints set, within their limits.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import body_name, joint_name
from hcbench.measuring.request import STATE_FIELDS
from hcbench.sim.model_under_test import Request
from hcbench.sim.packages import suggest_names
from hcbench.sim.touch import JointBeyondLimit, require_no_joint_beyond
from hcbench.system.errors import QuantityError, SceneError, UserError
from hcbench.system.text import sanitized
from hcbench.terms.bounds import admits_beyond_bounds, require_bounds
from hcbench.terms.impact import Floats
from hcbench.terms.units import STANDARD_GRAVITY

# Refuses a MuJoCo model, pose or contact whose numbers no bouncing body has.

# Other units of length, and how many are in a metre.
_OTHER_UNITS = {"millimetres": 1000.0, "centimetres": 100.0}
# A gravity within this share of the Earth's is taken for the Earth's.
_EARTH = 0.02
# Length of the shortest quaternion that still names an attitude.
_LEAST_QUATERNION = 1e-3


def require_plausible_model(model: Any, label: str) -> None:
    """Raise an error for a compiled model with numbers that no simulation survives, though MuJoCo's
    compiler lets them through.

    label: the model's name in errors.
    SceneError: for masses, inertias, sizes and frictions that are below 0 or not finite, and for a
    time step that is not above 0 s. QuantityError: for gravity in another unit of length, and for
    steps, gravity, masses, positions and sizes outside the bounds of `units`, which --beyond-bounds
    lifts. A size of 0 m passes: by it a plane is infinite.
    """
    for kind, field in (
        ("body", "mass"),
        ("body", "inertia"),
        ("geom", "size"),
        ("geom", "friction"),
    ):
        # A row for each body or geom, of one number or more.
        values = getattr(model, f"{kind}_{field}")
        bad = np.argwhere(~(np.isfinite(values) & (values >= 0)))
        if bad.size:
            first = tuple(bad[0].tolist())
            number = first[0]
            name = getattr(model, kind)(number).name or number
            got = f"{label}: {field} {float(values[first]):g} of {kind} {name}"
            raise SceneError("model", got, "numbers of 0 or more")
    require_bounds(f"{label}: timestep", [float(model.opt.timestep)], "timestep", "s")
    if model.opt.timestep <= 0:
        raise SceneError(f"{label}: timestep", f"{model.opt.timestep:g} s", "a step above 0 s")
    _require_metres(label, float(np.linalg.norm(model.opt.gravity)))
    require_bounds(f"{label}: gravity", model.opt.gravity.tolist(), "acceleration", "m/s^2")
    require_bounds(f"{label}: mass", model.body_mass.tolist(), "mass", "kg", smallest=0.0)
    for kind in ("body", "geom", "site"):
        positions = getattr(model, f"{kind}_pos").ravel().tolist()
        require_bounds(f"{label}: position of a {kind}", positions, "position", "m")
    kinds = backend().mjtGeom
    # Sizes of planes and height fields are other things, such as the spacing of a drawn grid.
    is_flat = np.isin(model.geom_type, [int(kinds.mjGEOM_PLANE), int(kinds.mjGEOM_HFIELD)])
    sizes = model.geom_size[~is_flat].ravel().tolist()
    require_bounds(f"{label}: size", sizes, "length", "m", smallest=0.0)


def _require_metres(label: str, gravity: float) -> None:
    """Raise QuantityError for a model whose gravity is the Earth's in another unit of length, such as
    981 for centimetres; not with --beyond-bounds.

    label: the model's name in errors.
    gravity: its magnitude, in the model's units.
    """
    for unit, per_metre in _OTHER_UNITS.items():
        looks_like_it = abs(gravity / (STANDARD_GRAVITY * per_metre) - 1.0) < _EARTH
        if looks_like_it and not admits_beyond_bounds():
            raise QuantityError(
                f"{label}: gravity",
                f"{gravity:g}, the Earth's in {unit}",
                "a model in metres, kilograms and seconds",
                "Scale its lengths to metres; --beyond-bounds reads the numbers as metres",
            )


def require_plausible_state(model: Any, data: Any) -> None:
    """Raise an error for a pose that cannot be: UserError for numbers that are not finite,
    QuantityError for a quaternion of length 0 and for a position out of bounds.

    data: MjData with the pose in qpos.
    """
    kinds = backend().mjtJoint
    if not np.isfinite(data.qpos).all():
        raise UserError("qpos", "a number that is not finite", "finite numbers")
    require_quaternions(model, data.qpos, "qpos")
    for joint in range(model.njnt):
        kind = int(model.jnt_type[joint])
        at = int(model.jnt_qposadr[joint])
        # Numbers of the joint that are positions, m: they come first.
        count = {int(kinds.mjJNT_FREE): 3, int(kinds.mjJNT_SLIDE): 1}.get(kind, 0)
        where = f"qpos: {_joint_name(model, joint)}"
        require_bounds(where, data.qpos[at : at + count].tolist(), "position", "m")


def require_quaternions(model: Any, qpos: Floats, slot: str) -> None:
    """Raise QuantityError for a pose in which the quaternion of a joint has the length 0.

    qpos: one pose, (nq,), or several, (n, nq).
    slot: name of what has them, for the error.
    """
    kinds = backend().mjtJoint
    for joint in range(model.njnt):
        at = int(model.jnt_qposadr[joint])
        # A free joint's quaternion follows its position; hinges and slides have none.
        begins = {int(kinds.mjJNT_FREE): at + 3, int(kinds.mjJNT_BALL): at}
        quaternion = begins.get(int(model.jnt_type[joint]))
        if quaternion is None:
            continue
        lengths = np.linalg.norm(qpos[..., quaternion : quaternion + 4], axis=-1)
        if lengths.min() < _LEAST_QUATERNION:
            got = f"the quaternion of {_joint_name(model, joint)!r} is 0"
            raise QuantityError(slot, got, "one of length 1, w x y z")


def _joint_name(model: Any, joint: int) -> str:
    """The name of a joint; that of its body where it has none, by which users name a free joint."""
    return str(
        model.joint(joint).name or model.body(int(model.jnt_bodyid[joint])).name or f"joint:{joint}"
    )


# Velocities and times of a state are ignored: everything starts at rest.
_IGNORED = ("qvel", "time", "qacc", "qacc_warmstart")
# Beyond a limit by more, the pose is not one that the model can hold; models write 5 deg rounded.
TURNED = math.radians(5.01)
MOVED = 1e-3


def start_pose(model: Any, request: Request, state: Any = None) -> tuple[Any, str]:
    """Make a new MjData at rest in the start configuration, and the phrase that names it.

    It is the request's keyframe; else the state as it stands; else the model's first keyframe, else
    its zero, qpos0. Then the joints, and the whole fields such as qpos, are set that the request
    names. Nothing that follows from them, such as places of bodies, is computed.
    state: an MjData of the user's, or None.

    Raises UserError for a keyframe or joint that the model does not have and for wrong numbers,
    QuantityError for a position out of bounds or a quaternion of 0.
    """
    mujoco = backend()
    data = mujoco.MjData(model)
    name = ""
    if state is not None and request.key is None:
        for field in STATE_FIELDS:
            getattr(data, field)[:] = getattr(state, field)
        name = "as it stands"
    else:
        name = _reset(model, data, request.key)
    moves = data.qvel.any()
    if state is not None and request.key is None:
        # They are not copied.
        moves = state.qvel.any()
    named = []
    for joint, values in request.pose:
        if _set(model, data, joint, values):
            named.append(joint)
        elif joint == "qvel":
            moves = moves or any(values)
    if named:
        name += " with " + ", ".join(named)
    if moves:
        name += ", at rest (its velocities are left out)"
        data.qvel[:] = 0.0
    data.time = 0.0
    require_plausible_state(model, data)
    mujoco.mj_normalizeQuat(model, data.qpos)
    return data, name


def _reset(model: Any, data: Any, key: str | None) -> str:
    """Reset `data` to a keyframe, and return what to call the pose.

    data: a new MjData, which is at qpos0.
    key: name or number of a keyframe, or "qpos0"; None: the first keyframe if there is one.

    Raises UserError for a keyframe that the model does not have.
    """
    # MuJoCo's zero first: keyframe i is at i + 1. One without a name goes by its number.
    names = ["qpos0", *(model.key(i).name or str(i) for i in range(model.nkey))]
    if key is None:
        key = names[min(1, model.nkey)]
    elif key not in names:
        if not key.isdecimal() or int(key) >= model.nkey:
            raise UserError("key", repr(key), f"one of: {', '.join(names)}")
        key = names[1 + int(key)]
    if key == "qpos0":
        return key
    backend().mj_resetDataKeyframe(model, data, names.index(key) - 1)
    return f"keyframe {key!r}"


def _set(model: Any, data: Any, name: str, values: tuple[float, ...]) -> bool:
    """Set the numbers of a joint, or a whole field of the state such as qpos, in `data`; False for
    a field of velocities or times, which is ignored.

    name: of a joint; of the body of a free joint, or "base" for the heaviest one; or of a field.
    values: m, rad and quaternions w x y z; of a free joint also three, its position alone.

    Raises UserError for another name, and for another number of values.
    """
    names = [joint_name(model, j) for j in range(model.njnt)]
    # `joint_name` and `body_name` give them sanitized.
    name = sanitized(name)
    joint = names.index(name) if name in names else _free_joint(model, name)
    if joint is not None:
        address = model.jnt_qposadr[joint]
        # The numbers of a joint end where those of the next one begin.
        end = model.nq
        if joint + 1 < model.njnt:
            end = model.jnt_qposadr[joint + 1]
        is_free = int(model.jnt_type[joint]) == int(backend().mjtJoint.mjJNT_FREE)
        if is_free and len(values) == 3:
            # A place without an attitude.
            end = address + 3
        # A view, as is the next: filling it changes `data`.
        target = data.qpos[address:end]
    elif name in STATE_FIELDS:
        target = getattr(data, name).reshape(-1)
    elif name in _IGNORED:
        return False
    else:
        raise UserError("qpos", f"no joint {name!r}", *suggest_names(name, names))
    if len(values) != len(target):
        slot = "state" if name in STATE_FIELDS else "qpos"
        raise UserError(
            slot, f"{name}: {len(values)} numbers", f"{len(target)}: m, rad, quaternion w x y z"
        )
    target[:] = values
    return True


def posed_joints(model: Any, request: Request) -> set[int]:
    """Numbers of the joints that a request puts elsewhere than the pose it starts from, without
    controls for it.
    """
    names = {sanitized(name) for name, _ in request.pose}
    if "ctrl" in names:
        return set()
    joints = range(model.njnt)
    return {joint for joint in joints if "qpos" in names or joint_name(model, joint) in names}


def _free_joint(model: Any, name: str) -> int | None:
    """Number of the free joint of a body of this name; "base": of the heaviest body on one.

    None where there is none. A body's mass here includes all that hangs on it.
    """
    free = np.flatnonzero(model.jnt_type == int(backend().mjtJoint.mjJNT_FREE)).tolist()
    for joint in free:
        if body_name(model, int(model.jnt_bodyid[joint])) == name:
            return int(joint)
    if name != "base" or not free:
        return None
    masses = model.body_subtreemass[model.jnt_bodyid[free]]
    return int(free[masses.argmax()])


def require_joints_within_limits(model: Any, data: Any, bodies: tuple[int, ...]) -> None:
    """Raise UserError, with the joint values that cure it, for a pose in which joints are more than
    5 degrees, or 1 mm of a slide, beyond their limits.

    data: MjData with the pose in qpos.
    bodies: numbers of the pair's bodies; only joints of their trees, such as a robot, count.
    """
    roots = {int(model.body_rootid[body]) for body in bodies if body}
    outside = []
    for joint in range(model.njnt):
        root = int(model.body_rootid[model.jnt_bodyid[joint]])
        if root not in roots or not model.jnt_limited[joint]:
            continue
        at = joint_at_limit(model, data, joint)
        if at.is_far_beyond:
            name = joint_name(model, joint)
            outside.append(JointBeyondLimit(name, at.beyond, at.turns, at.nearest))
    require_no_joint_beyond(outside, "another --key, or from ")


class JointAtLimit(NamedTuple):
    """Place of a joint beside its limit; m for a slide, else rad.

    beyond: how far it is beyond the limit, 0 within it; of a ball joint below 0 within it.
    nearest: the nearest value within the limit; NaN for a ball joint, whose limit is on the angle
    of its turn.
    turns: whether it turns, as hinges and balls do.
    """

    beyond: float
    nearest: float
    turns: bool

    @property
    def is_far_beyond(self) -> bool:
        """True beyond what rounding in a model explains: 5 degrees, or 1 mm of a slide."""
        return self.beyond > (TURNED if self.turns else MOVED)


def joint_at_limit(model: Any, data: Any, joint: int) -> JointAtLimit:
    """Compare a joint with its limit.

    data: MjData with the pose in qpos.
    joint: number of a limited joint.
    """
    kinds = backend().mjtJoint
    kind = int(model.jnt_type[joint])
    low, high = model.jnt_range[joint].tolist()
    address = int(model.jnt_qposadr[joint])
    if kind == kinds.mjJNT_BALL:
        # The scalar part of a quaternion, which comes first, is the cosine of half the angle.
        angle = 2.0 * math.acos(min(1.0, abs(float(data.qpos[address]))))
        return JointAtLimit(beyond=angle - high, nearest=math.nan, turns=True)
    value = float(data.qpos[address])
    nearest = float(np.clip(value, low, high))
    return JointAtLimit(abs(value - nearest), nearest, turns=kind != kinds.mjJNT_SLIDE)
