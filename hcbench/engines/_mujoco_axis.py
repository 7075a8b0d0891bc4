"""A ball that can only go up and down, in place of a free one: the same impact for a third of the cost.

A sphere that falls along the axis of what it falls on, and meets no friction there, is never pushed aside or
turned: five of a free body's six velocities stay 0. On a slide joint the ball has the other one alone. What
MuJoCo takes for the mass that a contact feels it works out from all three directions, so that is put back.

Where one row of constraint holds a ball, its force is one division, without Newton's line search over all
balls of a model: one sweep of Gauss and Seidel, the same to rounding, the same bits in any company.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

_Z = 2
# What a default class of the model could give to a joint, as a free one has it.
_NOTHING = {"damping": "0", "stiffness": "0", "armature": "0", "frictionloss": "0", "limited": "false"}


def on_axis(mujoco: Any, model: Any) -> bool:
    """Whether the ball of a model, which at qpos0 just touches, can leave the vertical in no way.

    For a model with one joint, the ball's free one, that can touch in the ways which its pairs and limits
    say, or else by one pair of geoms.
    """
    joint = model.jnt_bodyid[0]
    own = np.flatnonzero(model.geom_bodyid == joint)
    free = (model.dof_damping, model.dof_armature, model.dof_frictionloss, model.jnt_stiffness)
    plain = (
        model.body_parentid[joint] == 0
        and np.array_equal(model.body_quat[joint], [1.0, 0.0, 0.0, 0.0])
        and not any(values.any() for values in free)
        and not model.body_gravcomp[joint]
        and (model.geom_type[own] == mujoco.mjtGeom.mjGEOM_SPHERE).all()
        and not model.geom_pos[own].any()
        and not any((model.opt.wind.any(), model.opt.density, model.opt.viscosity))
    )
    return bool(plain and _touches_below(mujoco, model) and _pulls_along(mujoco, model))


def _ways(model: Any) -> list[tuple[int, int, int]]:
    """All ways for the ball to touch: its geom, the other one, the dimension of the contact."""
    ball = model.geom_bodyid == model.jnt_bodyid[0]
    if model.npair:
        pairs = zip(
            model.pair_geom1.tolist(), model.pair_geom2.tolist(), model.pair_dim.tolist(), strict=True
        )
        return [(a, b, dim) if ball[a] else (b, a, dim) for a, b, dim in pairs]
    kinds, partners, dims = model.geom_contype, model.geom_conaffinity, model.geom_condim
    return [
        (int(b), int(o), int(max(dims[b], dims[o])))
        for b in np.flatnonzero(ball)
        for o in np.flatnonzero(~ball)
        if kinds[b] & partners[o] or kinds[o] & partners[b]
    ]


def _touches_below(mujoco: Any, model: Any) -> bool:
    """Whether all that the ball can touch are fixed horizontal planes, without friction."""
    return all(
        dim == 1
        and model.geom_type[other] == mujoco.mjtGeom.mjGEOM_PLANE
        and model.geom_bodyid[other] == 0
        and not model.geom_quat[other][1:3].any()
        for _, other, dim in _ways(model)
    )


def _pulls_along(mujoco: Any, model: Any) -> bool:
    """Whether all tendons run along the axis: between sites on it."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    sites = model.wrap_objid[model.wrap_type == mujoco.mjtWrap.mjWRAP_SITE]
    return len(sites) == model.nwrap and not data.site_xpos[sites, :_Z].any()


def holds_one_row(model: Any) -> bool:
    """Whether a ball is never in more than one constraint, for a model that `on_axis` accepts."""
    return len(_ways(model)) + int(model.ntendon) == 1


def no_islands(mujoco: Any) -> int:
    """The flag that keeps constraints from being solved island by island; 0 where it is not the rule."""
    flag = getattr(mujoco.mjtDisableBit, "mjDSBL_ISLAND", None)
    return 0 if flag is None else int(flag)


def put_on_axis(ball: ET.Element, height: float) -> None:
    """A body's free joint made a slide along z, whose position is the height of the body's centre."""
    at, joint = next((i, e) for i, e in enumerate(ball) if e.tag in ("freejoint", "joint"))
    name = {key: value for key, value in joint.attrib.items() if key == "name"}
    ball.remove(joint)
    slide = {**name, "type": "slide", "axis": "0 0 1", "ref": repr(height), **_NOTHING}
    ball.insert(at, joint.makeelement("joint", slide))


def feel_alike(mujoco: Any, model: Any, free: Any) -> None:
    """Give balls on the axis the inverse masses of a free one, and where it is one row its solver."""
    body, size = int(free.jnt_bodyid[0]), model.njnt
    model.body_invweight0[model.jnt_bodyid] = free.body_invweight0[body]
    model.dof_invweight0[:] = free.dof_invweight0[_Z]
    if free.ntendon:
        model.tendon_invweight0[:] = np.tile(free.tendon_invweight0, size)
    if holds_one_row(free):
        model.opt.solver, model.opt.iterations = mujoco.mjtSolver.mjSOL_PGS, 1
        model.opt.disableflags |= no_islands(mujoco)
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
