"""A ball that can only go up and down, in place of a free one: the same
impact for a third of the cost.

A sphere that falls along the axis of what it falls on, and meets no friction there, is never pushed
aside or turned: five of a free body's six velocities stay 0. On a slide joint the ball has the
other one alone. MuJoCo computes body_invweight0 from all three directions; a slide joint changes
it, so the free body's is restored.

Where one row of constraint holds a ball, its force is one division, without Newton's
line search over all balls of a model: one sweep of Gauss and Seidel, the same to
rounding, the same bits in any batch.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbench.engines.mujoco.model.bodies import masks_match

# Number of the position or velocity that is along the axis.
Z = 2


def stays_on_axis(mujoco: Any, model: Any) -> bool:
    """Say whether the ball of a model, which at qpos0 just touches, cannot leave the vertical.

    Expects one free joint, and contact through explicit <pair>s, tendon
    limits, or one pair of geoms.
    """
    joint = model.jnt_bodyid[0]
    geoms = np.flatnonzero(model.geom_bodyid == joint)
    plain = (
        model.body_parentid[joint] == 0
        and np.array_equal(model.body_quat[joint], [1.0, 0.0, 0.0, 0.0])
        and not model.body_gravcomp[joint]
        and (model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_SPHERE).all()
        and not model.geom_pos[geoms].any()
        and not any((model.opt.wind.any(), model.opt.density, model.opt.viscosity))
        and _solves_well(mujoco, model)
    )
    return bool(plain and _touches_below(mujoco, model) and _pulls_along(mujoco, model))


def _solves_well(mujoco: Any, model: Any) -> bool:
    """Say whether the solver may iterate until it converges: stopped early,
    it moves a free ball otherwise.
    """
    option = model.opt
    usual = mujoco.MjOption()
    return bool(
        option.iterations >= usual.iterations
        and option.ls_iterations >= usual.ls_iterations
        and option.tolerance <= usual.tolerance
        and option.ls_tolerance <= usual.ls_tolerance
    )


def _contact_ways(model: Any) -> list[tuple[int, int, int]]:
    """All ways for the ball to touch: its geom, the other one, the dimension of the contact."""
    ball = model.geom_bodyid == model.jnt_bodyid[0]
    if model.npair:
        pairs = zip(
            model.pair_geom1.tolist(),
            model.pair_geom2.tolist(),
            model.pair_dim.tolist(),
            strict=True,
        )
        ways = []
        for one, other, dim in pairs:
            if ball[one]:
                ways.append((one, other, dim))
            else:
                ways.append((other, one, dim))
        return ways
    dims = model.geom_condim
    return [(b, o, int(max(dims[b], dims[o]))) for b, o in collidable_pairs(model, ball)]


def collidable_pairs(model: Any, moving: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Geoms of these, and of the others, whose contype and conaffinity let them collide."""
    return [
        (one, other)
        for one in np.flatnonzero(moving).tolist()
        for other in np.flatnonzero(~moving).tolist()
        if masks_match(model, one, other)
    ]


def _touches_below(mujoco: Any, model: Any) -> bool:
    """Say whether all that the ball can touch are fixed horizontal planes, without friction."""
    return all(
        dim == 1
        and model.geom_type[other] == mujoco.mjtGeom.mjGEOM_PLANE
        and model.geom_bodyid[other] == 0
        and not model.geom_quat[other][1:3].any()
        for _, other, dim in _contact_ways(model)
    )


def _pulls_along(mujoco: Any, model: Any) -> bool:
    """Say whether all tendons hold the ball, and run along the axis: between sites on it."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    sites = model.wrap_objid[model.wrap_type == mujoco.mjtWrap.mjWRAP_SITE]
    if len(sites) != model.nwrap or data.site_xpos[sites, :Z].any():
        return False
    on_ball = model.site_bodyid[sites] == model.jnt_bodyid[0]
    ends = zip(model.tendon_adr.tolist(), model.tendon_num.tolist(), strict=True)
    return all(on_ball[start : start + count].any() for start, count in ends)


def has_one_constraint(model: Any) -> bool:
    """Say whether a ball is never in more than one constraint.

    model: one that `stays_on_axis` accepts.
    """
    return len(_contact_ways(model)) + int(model.ntendon) == 1


def island_flag(mujoco: Any) -> int:
    """The flag that keeps constraints from being solved island by
    island; 0 where it is not the rule.
    """
    flag = getattr(mujoco.mjtDisableBit, "mjDSBL_ISLAND", None)
    return 0 if flag is None else int(flag)


def replace_free_joint(mujoco: Any, spec: Any, height: float) -> None:
    """Free joints made slides along z, whose position is the height of the body's centre.

    Done after reading, as a <freejoint> takes nothing from default classes and a slide would.
    """
    for joint in spec.joints:
        joint.type = mujoco.mjtJoint.mjJNT_SLIDE
        joint.axis = [0.0, 0.0, 1.0]
        joint.ref = height


def copy_inverse_weights(mujoco: Any, model: Any, free: Any) -> None:
    """Give balls on the axis the inverse masses of a free one, and where it is one row its solver."""
    body = int(free.jnt_bodyid[0])
    size = model.njnt
    # A <frame> around the joint may have turned its axis.
    model.jnt_axis[:] = 0.0, 0.0, 1.0
    model.body_invweight0[model.jnt_bodyid] = free.body_invweight0[body]
    model.dof_invweight0[:] = free.dof_invweight0[Z]
    if free.ntendon:
        model.tendon_invweight0[:] = np.tile(free.tendon_invweight0, size)
    if has_one_constraint(free):
        model.opt.solver = mujoco.mjtSolver.mjSOL_PGS
        model.opt.iterations = 1
        model.opt.disableflags |= island_flag(mujoco)
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
