"""The attitudes in which a loose body can meet a face: on its own faces, edges and vertices."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import masks_match
from hcbench.engines.mujoco.model.under_test import MujocoModel

if TYPE_CHECKING:
    from hcbench.sim.model_under_test import Request
    from hcbench.terms.impact import Floats

# Directions in a geom that point at the other body, by shape: the geom's
# size turns them into attitudes.
_BOX = {"face": (0.0, 0.0, 1.0), "edge": (0.0, 1.0, 1.0), "vertex": (1.0, 1.0, 1.0)}
_ROUND = {"face": (0.0, 0.0, 1.0), "side": (1.0, 0.0, 0.0), "rim": (1.0, 0.0, 1.0)}
# Of a free joint: a body with these alone hangs on nothing.
_FREE_DOFS = 6
_NEAR = 1e-3  # m


def attitudes(model: Any, label: str, state: Any, request: Request) -> list[tuple[str, Request]]:
    """(attitude, request) of each way in which the two can meet; ("",
    request) where there is only one.

    A body of one box or cylinder, on a free joint of its own, has several against a flat geom of
    what stands still, where nothing else touches it. The requests differ in their pose, qpos in m
    and quaternions. Raises UserError or SceneError where the pair cannot be brought to touch.
    """
    kinds = backend().mjtGeom
    placed = MujocoModel(model, label, state, request)
    place = placed.place
    geom, other = place.contact.geoms
    if int(model.geom_bodyid[geom]) != place.pair.first.body:
        geom, other = other, geom
    body = int(model.geom_bodyid[geom])
    ways_of_shape = {int(kinds.mjGEOM_BOX): _BOX, int(kinds.mjGEOM_CYLINDER): _ROUND}
    ways = ways_of_shape.get(int(model.geom_type[geom]))
    is_flat = int(model.geom_type[other]) in (int(kinds.mjGEOM_PLANE), int(kinds.mjGEOM_BOX))
    is_fixed = not model.body_weldid[model.geom_bodyid[other]]
    if ways is None or request.pose or not (is_flat and is_fixed):
        return [("", request)]
    if not _is_loose(model, body) or _is_touched(model, placed.start, geom, other):
        return [("", request)]
    size = model.geom_size[geom]
    if ways is _ROUND:
        # The sizes in the geom's own axes: a cylinder has its radius first
        # and half its length second.
        size = np.array([size[0], size[0], size[1]])
    upright = copy.copy(placed.start)
    backend().mj_kinematics(model, upright)
    address = int(model.jnt_qposadr[model.body_jntadr[body]])
    attitude = slice(address + 3, address + 7)
    turned = []
    for name, way in ways.items():
        qpos = placed.start.qpos.copy()
        # Backed off by its bounding radius: no attitude starts inside the other body.
        qpos[address : address + 3] -= model.geom_rbound[geom] * place.contact.normal
        frame = upright.geom_xmat[geom].reshape(3, 3)
        turn = _turn(frame @ _unit(size * np.array(way)), place.contact.normal)
        backend().mju_mulQuat(qpos[attitude], turn, placed.start.qpos[attitude])
        pose = (("qpos", tuple(qpos.tolist())),)
        turned.append((name, replace(request, pose=pose)))
    return turned


def _is_loose(model: Any, body: int) -> bool:
    """Say whether a body has one geom and a free joint, and no other body hangs on it."""
    tree = np.flatnonzero(model.body_rootid == body)
    return (
        len(tree) == 1
        and int(model.body_geomnum[body]) == 1
        and int(model.body_dofnum[body]) == _FREE_DOFS
    )


def _is_touched(model: Any, start: Any, geom: int, other: int) -> bool:
    """Say whether a third geom touches `geom` at the start."""
    mujoco = backend()
    data = copy.copy(start)
    mujoco.mj_kinematics(model, data)
    ends = np.zeros(6)
    for third in range(model.ngeom):
        if third in (geom, other) or not masks_match(model, geom, third):
            continue
        if mujoco.mj_geomDistance(model, data, geom, third, _NEAR, ends) < _NEAR:
            return True
    return False


def _unit(vector: Floats) -> Floats:
    return vector / np.linalg.norm(vector)


def _turn(start: Floats, end: Floats) -> Floats:
    """The quaternion, w x y z, of the least turn from one unit vector, (3,), to another."""
    axis = np.cross(start, end)
    cosine = float(start @ end)
    # Half a turn: every axis across the start will do, and 1 + cosine
    # would vanish in the quaternion.
    if cosine < -1.0 + 1e-12:
        axis = np.linalg.svd(start[None])[2][1]
        cosine = 0.0
        return np.array([0.0, *axis])
    return _unit(np.array([1.0 + cosine, *axis]))
