"""Drops of robots in a loop of plain MuJoCo that shares no code with hcbench's drop test."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

QUADRUPED = Path(__file__).parents[2] / "examples" / "quadruped.xml"
FEET = [f"{side}_{end}_foot,floor" for end in ("front", "hind") for side in ("left", "right")]
GRAVITY = 9.81
CHATTER = 0.005  # s


@dataclass
class Seen:
    """rebound: of the centre of mass, m. rest: s. peak: over the weight. depth, travel: m."""

    rebound: float = 0.0
    rest: float = 0.0
    peak: float = 0.0
    depth: float = 0.0
    travel: float = 0.0


def drop(model: Any, height: float, phase: float, seconds: float, tilt: float = 0.0) -> Seen:
    """Drop a robot whose servos hold its pose over geom "floor". height: m. tilt: about y, rad."""
    data = mujoco.MjData(model)
    for servo in range(model.nu):
        data.ctrl[servo] = data.qpos[model.jnt_qposadr[model.actuator_trnid[servo, 0]]]
    data.qpos[3:7] = math.cos(tilt / 2), 0.0, math.sin(tilt / 2), 0.0
    mujoco.mj_forward(model, data)
    floor = model.geom("floor").id
    solid = [g for g in range(model.ngeom) if model.geom_contype[g] and g != floor]
    gap = min(mujoco.mj_geomDistance(model, data, g, floor, 9.0, None) for g in solid)
    speed = math.sqrt(2 * GRAVITY * height)
    data.qpos[2] += height + phase * speed * model.opt.timestep - gap
    seen, weight = Seen(), float(model.body_mass.sum()) * GRAVITY
    left, touch, start, flying, rising = 0.0, None, None, 0.0, 0.0
    while data.time < seconds:
        velocity = _speed(model, data)
        mujoco.mj_step(model, data)
        force, deepest = _floor(model, data, floor)
        seen.peak, seen.depth = max(seen.peak, force / weight), max(seen.depth, deepest)
        if force > 0.0 and touch is None:
            touch, start = data.time, data.subtree_com[0].copy()
        if touch is None:
            continue
        if force > 0.0:
            flying = 0.0
        else:
            rising = velocity[2] if flying == 0.0 else rising
            flying += model.opt.timestep
            if flying >= CHATTER and rising > 0.0:
                seen.rebound = max(seen.rebound, rising**2 / (2 * GRAVITY))
        if np.linalg.norm(velocity) > 0.02:
            left = data.time - touch
    assert start is not None
    seen.rest, seen.travel = left, float(np.linalg.norm((data.subtree_com[0] - start)[:2]))
    return seen


def _speed(model: Any, data: Any) -> Any:
    jacobian = np.zeros((3, model.nv))
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_jacSubtreeCom(model, data, jacobian, 1)
    return jacobian @ data.qvel


def _floor(model: Any, data: Any, floor: int) -> tuple[float, float]:
    """(force upwards, N; deepest penetration, m) of the contacts with the floor."""
    force, deepest, wrench = 0.0, 0.0, np.zeros(6)
    for i, contact in enumerate(data.contact):
        if floor in contact.geom:
            mujoco.mj_contactForce(model, data, i, wrench)
            force += abs(float((contact.frame.reshape(3, 3).T @ wrench[:3])[2]))
            deepest = max(deepest, -float(contact.dist))
    return force, deepest
