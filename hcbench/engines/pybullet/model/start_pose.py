"""Joints of a PyBullet world: put where a request says, held against
their limits, their motors off.
"""

import math
from typing import Any

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.engines.pybullet.model.bodies import FIXED, JOINT_NAME, JOINT_TYPE, PRISMATIC, REVOLUTE
from hcbench.engines.pybullet.model.open import LoadedWorld
from hcbench.sim.model_under_test import Request
from hcbench.sim.packages import suggest_names
from hcbench.sim.touch import JointBeyondLimit, require_no_joint_beyond
from hcbench.system.errors import UserError
from hcbench.system.text import sanitized

# Places in getJointInfo.
_LOWER = 8
_UPPER = 9
# Beyond a limit by more, rad or m, a pose is not one that the model can hold.
_TURNED = math.radians(5.0)
_MOVED = 1e-3
_Joint = tuple[int, int]


def joint_states(bullet: BulletClient) -> dict[_Joint, tuple[float, float]]:
    """(position, velocity), rad or m and by s, of every hinge and slide, by (body, joint)."""
    states: dict[_Joint, tuple[float, float]] = {}
    for body in bullet.bodies():
        for joint in range(bullet.getNumJoints(body)):
            kind = bullet.getJointInfo(body, joint)[JOINT_TYPE]
            if kind in (REVOLUTE, PRISMATIC):
                position, velocity, *_ = bullet.getJointState(body, joint)
                states[body, joint] = position, velocity
    return states


def base_states(bullet: BulletClient, request: Request) -> list[tuple[int, Any, Any]]:
    """(body, pose, velocities) of every body's base, as PyBullet returns them.

    Empty where the request sets no pose: nothing then moves a base.
    """
    if not request.pose:
        return []
    states = []
    for body in bullet.bodies():
        pose = bullet.getBasePositionAndOrientation(body)
        velocities = bullet.getBaseVelocity(body)
        states.append((body, pose, velocities))
    return states


def set_pose(world: LoadedWorld, request: Request) -> None:
    """Set positions and switch motors off, where the request says so.

    Of a joint, by its name or as "file/name": one number, m or rad. Of a free base, as
    `_free_base` finds it: x y z, m, and a quaternion w x y z, if given. Raises
    UserError for other names and counts.
    """
    bullet = world.bullet
    joints = _named_joints(world)
    for name, values in request.pose:
        if name in joints:
            if len(values) != 1:
                raise UserError("qpos", f"{name}: {len(values)} numbers", "1: m or rad")
            bullet.resetJointState(*joints[name], values[0])
            continue
        base = _free_base(world, name)
        if base is None:
            raise UserError("qpos", f"no joint {name!r}", *suggest_names(name, joints))
        _put_base(bullet, base, values)
    if not request.actuators:
        for body in bullet.bodies():
            for joint in range(bullet.getNumJoints(body)):
                bullet.setJointMotorControl2(body, joint, bullet.module.VELOCITY_CONTROL, force=0)


def _free_base(world: LoadedWorld, name: str) -> int | None:
    """Id of the body whose free base a name means; None without one.

    name: of the body's file, without its suffix; "base": of the body with most joints, of several
    the heaviest.
    """
    bullet = world.bullet
    masses = {body: bullet.getDynamicsInfo(body, -1)[0] for body in bullet.bodies()}
    free = [body for body, mass in masses.items() if mass > 0.0]
    for body in free:
        stem, _, _ = world.files.get(body, "").partition(".")
        if stem == name:
            return body
    if name != "base":
        return None
    # A robot is the body with joints; of several the heaviest.
    return max(free, key=lambda body: (bullet.getNumJoints(body), masses[body]), default=None)


def _put_base(bullet: BulletClient, body: int, values: tuple[float, ...]) -> None:
    """Put a free base of a body, by its id: x y z, m, and a quaternion w x y z, if given.

    Raises UserError for another number of values than 3 or 7.
    """
    if len(values) not in (3, 7):
        raise UserError("qpos", f"base: {len(values)} numbers", "3 or 7: m, quaternion w x y z")
    turned = bullet.getBasePositionAndOrientation(body)[1]
    if len(values) == 7:
        turned = (*values[4:], values[3])
    bullet.resetBasePositionAndOrientation(body, values[:3], turned)


def _named_joints(world: LoadedWorld) -> dict[str, _Joint]:
    """(body, joint) of each joint that moves, by "name", "body:ID/name" and "file/name".

    A name that several joints have means the first body's.
    """
    joints: dict[str, _Joint] = {}
    # The first body comes last, and takes a name that several have.
    for body in reversed(world.bullet.bodies()):
        for joint in range(world.bullet.getNumJoints(body)):
            info = world.bullet.getJointInfo(body, joint)
            if info[JOINT_TYPE] == FIXED:
                continue
            name = sanitized(info[JOINT_NAME].decode(errors="replace"))
            joints[name] = (body, joint)
            joints[f"body:{body}/{name}"] = (body, joint)
            if body in world.files:
                joints[f"{world.files[body]}/{name}"] = (body, joint)
    return joints


def require_joints_within_limits(bullet: BulletClient, body: int) -> None:
    """Refuse a pose in which hinges or slides of a body are far outside their limits, by UserError.

    More than 5 degrees or 1 mm.
    """
    outside = []
    for joint in range(bullet.getNumJoints(body)):
        info = bullet.getJointInfo(body, joint)
        if info[JOINT_TYPE] not in (REVOLUTE, PRISMATIC) or info[_LOWER] > info[_UPPER]:
            continue
        low = float(info[_LOWER])
        high = float(info[_UPPER])
        # Such limits stand for a file that has none.
        if low == 0.0 and high <= 0.0:
            continue
        position = float(bullet.getJointState(body, joint)[0])
        nearest = min(max(position, low), high)
        turns = info[JOINT_TYPE] == REVOLUTE
        if abs(position - nearest) > (_TURNED if turns else _MOVED):
            name = sanitized(info[JOINT_NAME].decode(errors="replace"))
            outside.append(JointBeyondLimit(name, abs(position - nearest), turns, nearest))
    require_no_joint_beyond(outside, "")
