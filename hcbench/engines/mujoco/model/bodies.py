"""Geoms and bodies of a compiled MuJoCo model: names, who may collide, Jacobians, effective mass."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.sim.read_impact import SpeedReading
from hcbench.system.text import sanitized

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.terms.impact import Floats

    CollisionFilter = Literal["", "exclude", "masks", "welded", "parent"]

# Degrees of freedom of a free joint: a body with these alone can be moved as a whole.
FREE_DOFS = 6
# Signs of the eight corners of a box.
_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def geom_name(model: Any, geom: int) -> str:
    """Name of the geom, or geom:NUMBER for one without."""
    return sanitized(model.geom(geom).name) or f"geom:{geom}"


def joint_name(model: Any, joint: int) -> str:
    """Name of the joint, or joint:NUMBER for one without."""
    return sanitized(model.joint(joint).name) or f"joint:{joint}"


def body_name(model: Any, body: int) -> str:
    """Name of the body, or body:NUMBER for one without."""
    return "world" if body == 0 else sanitized(model.body(body).name) or f"body:{body}"


def geoms_of(model: Any, body: int) -> tuple[int, ...]:
    """All geoms of a body."""
    return tuple(np.flatnonzero(model.geom_bodyid == body).tolist())


def explicit_pairs(model: Any, geoms: Sequence[int]) -> list[int]:
    """Numbers of the <pair>s of two of these geoms."""
    return np.flatnonzero(
        np.isin(model.pair_geom1, geoms) & np.isin(model.pair_geom2, geoms)
    ).tolist()


def integrator_name(model: Any) -> str:
    """The integrator as XML spells it."""
    name = (
        str(backend().mjtIntegrator(int(model.opt.integrator)).name).removeprefix("mjINT_").lower()
    )
    return {"euler": "Euler", "rk4": "RK4"}.get(name, name)


def is_whole_state(model: Any) -> bool:
    """Say whether MuJoCo's state alone determines the motion of a model: nothing else has a memory,
    as plug-ins, sleeping bodies and callbacks of Python may have.
    """
    mujoco = backend()
    sleeps = int(getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0)) & model.opt.enableflags
    callbacks = [getattr(mujoco, name)() for name in dir(mujoco) if name.startswith("get_mjcb_")]
    return not (model.nplugin or sleeps or any(callbacks))


def speed_reading(model: Any) -> SpeedReading:
    """MuJoCo's contact acts from the touch plane on; only RK4 is exact in free flight."""
    exact = integrator_name(model) == "RK4"
    return SpeedReading.TOUCH_PLANE_EXACT_FLIGHT if exact else SpeedReading.TOUCH_PLANE


def masks_match(model: Any, geom1: int, geom2: int) -> bool:
    """Say whether contype and conaffinity of two geoms let them collide."""
    kinds = model.geom_contype
    partners = model.geom_conaffinity
    return bool(kinds[geom1] & partners[geom2] or kinds[geom2] & partners[geom1])


def collision_filter(model: Any, geom1: int, geom2: int) -> CollisionFilter:
    """Name the filter of MuJoCo that keeps two geoms apart, "" if they may collide.

    geom1, geom2: their numbers. "exclude": an <exclude>. "masks": contype and conaffinity.
    "welded", "parent": their bodies are one rigid body, or parent and child.
    """
    body1, body2 = sorted((int(model.geom_bodyid[geom1]), int(model.geom_bodyid[geom2])))
    # The first body of the rigid one that each belongs to, and the rigid body that this hangs on.
    weld1 = int(model.body_weldid[body1])
    weld2 = int(model.body_weldid[body2])
    above1 = int(model.body_weldid[model.body_parentid[weld1]])
    above2 = int(model.body_weldid[model.body_parentid[weld2]])
    # MuJoCo packs the two numbers of an <exclude>'s bodies into one integer, the smaller one high.
    if (body1 << 16) + body2 in model.exclude_signature:
        return "exclude"
    if not masks_match(model, geom1, geom2):
        return "masks"
    if weld1 == weld2:
        return "welded"
    # MuJoCo lets what hangs on the world collide with it.
    is_parent = weld1 == above2 or weld2 == above1
    return "parent" if weld1 and weld2 and is_parent else ""


def can_meet(model: Any, geoms: tuple[int, int]) -> bool:
    """True if MuJoCo collides two geoms: a <pair> of them overrides every filter."""
    return bool(explicit_pairs(model, geoms)) or not collision_filter(model, *geoms)


def geom_friction(model: Any, geoms: tuple[int, int]) -> float:
    """Coulomb's μ of two geoms: of their first <pair>, else as MuJoCo mixes it; 0 for a contact
    without friction, which has condim 1.

    geoms: numbers of the two.
    """
    if pairs := explicit_pairs(model, geoms)[:1]:
        return float(model.pair_friction[pairs[0], 0]) if model.pair_dim[pairs[0]] > 1 else 0.0
    return mixed_friction(model, geoms)


def mixed_friction(model: Any, geoms: tuple[int, int]) -> float:
    """Coulomb's μ of two geoms as MuJoCo mixes it where no <pair> joins them; 0 for none."""
    highest = model.geom_priority[list(geoms)].max()
    ruling = [geom for geom in geoms if model.geom_priority[geom] == highest]
    if model.geom_condim[ruling].max() == 1:
        return 0.0
    return float(model.geom_friction[ruling, 0].max())


def approach_row(
    model: Any, data: Any, first: int, second: int, point: Floats, normal: Floats
) -> Floats:
    """Jacobian row J, shape (nv,): the two bodies approach each other by J @ qvel, m/s.

    first, second: numbers of the bodies.
    point: of both, (3,), m, in the world.
    normal: unit vector (3,) from the first to the second.
    """
    mujoco = backend()
    jacobian = np.empty((3, model.nv))
    row = np.empty(model.nv)
    mujoco.mj_jac(model, data, jacobian, None, point, first)
    # MuJoCo's product, not NumPy's: the same bits as in C, and under every kernel of OpenBLAS.
    mujoco.mju_mulMatTVec(row, jacobian, normal)
    if second:
        other = np.empty(model.nv)
        mujoco.mj_jac(model, data, jacobian, None, point, second)
        mujoco.mju_mulMatTVec(other, jacobian, normal)
        row -= other
    return row


def response(model: Any, data: Any, row: Floats) -> Floats:
    """(nv,) M^-1 J^T of a row J of the Jacobian: the change of velocity by a unit impulse along it."""
    moved = np.empty(model.nv)
    backend().mj_solveM(model, data, moved[None], row[None])
    return moved


def effective_mass(model: Any, data: Any, row: Floats) -> float:
    """1/(J M^-1 J^T) of a row J of the Jacobian, kg; inf where nothing can move along it."""
    mobility = float(row @ response(model, data, row))
    return 1.0 / mobility if mobility > 0 else math.inf


def volumes(model: Any, data: Any, body: int) -> tuple[float, float]:
    """Two volumes of the tree of a body, m³: the sum of those of the boxes about each geom, and that
    of the box about all of them and the bodies' frames.

    data: MjData with the kinematics of a pose.
    body: number of any body of the tree. Planes and height fields do not count; the first is 0 for
    a tree without another geom.
    """
    bodies = np.flatnonzero(model.body_rootid == model.body_rootid[body])
    boxes = 0.0  # m³
    # Points in the world that the box about all has to hold, m.
    corners = [data.xpos[bodies]]
    kinds = backend().mjtGeom
    endless = (int(kinds.mjGEOM_PLANE), int(kinds.mjGEOM_HFIELD))
    for geom in np.flatnonzero(np.isin(model.geom_bodyid, bodies)).tolist():
        if int(model.geom_type[geom]) in endless:
            continue
        # A box in the geom's own frame: its middle and half its edges, m; then its eight corners.
        middle = model.geom_aabb[geom, :3]
        half = model.geom_aabb[geom, 3:]
        boxes += 8.0 * float(np.prod(half))
        ends = middle + half * _CORNERS
        corners.append(data.geom_xpos[geom] + ends @ data.geom_xmat[geom].reshape(3, 3).T)
    edges = np.ptp(np.concatenate(corners), axis=0)
    return boxes, float(np.prod(edges))
