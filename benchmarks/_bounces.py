"""Bounces in the plain engines, of settings pasted as `tune` hands them out;
no code of hcbench's reads them.

e is the ratio of the speeds at the plane of touch, by what a semi-implicit Euler step keeps in free
flight: going up (v - g h/2)² + 2 g z, going down the same with v + g h/2.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np

G, MASS = 9.81, 0.5


class Bounce(NamedTuple):
    """e; error of the impulse of friction over μ times the normal impulse, sliding's."""

    e: float
    friction: float


def mujoco_model(
    paste: str, radius: float = 0.0508, shape: str = "sphere", friction: float = 0.0
) -> Any:
    """A free ball or box that just touches a plate, with a setting's text pasted in."""
    lines = [line for line in paste.splitlines() if line.startswith(("<option", "<pair"))]
    option, pairs = lines[0], "".join(line for line in lines if line.startswith("<pair"))
    sizes = {"sphere": f"{radius}", "box": f"{radius} {radius} {radius}"}
    own = 'contype="0" conaffinity="0"' if pairs else f'condim="3" friction="{friction}"'
    return mujoco.MjModel.from_xml_string(
        f'<mujoco>{option}<option gravity="0 0 {-G}"/><worldbody>'
        f'<geom name="plate" type="plane" size="9 9 .1" {own}/>'
        f'<body pos="0 0 {radius}"><freejoint/>'
        f'<geom name="ball" type="{shape}" size="{sizes[shape]}" mass="{MASS}" {own}/>'
        f"</body></worldbody><contact>{pairs}</contact></mujoco>"
    )


def bounce(
    model: Any, speed: float, phase: float, slip: float = 0.0, friction: float = 0.0
) -> Bounce:
    """One touch of a sphere at this speed (m/s), phase of the step and slip (m/s)."""
    data, h, radius = mujoco.MjData(model), model.opt.timestep, model.geom_size[1, 0]
    t = (1 + phase) * h
    data.qpos[2] = radius + speed * t - G * t * t / 2
    data.qvel[2], data.qvel[0] = -(speed - G * t - G * h / 2), slip
    touched, before = 0, 0.0
    for step in range(3_000):
        z, w = data.qpos[2] - radius, float(data.qvel[2])
        if z < 0 and not touched:
            touched, before = step, w
        if touched and z >= 0 and w > 0:
            e = math.sqrt((w - G * h / 2) ** 2 + 2 * G * z) / speed
            normal = MASS * (w - before + G * h * (step - touched))
            sticking = MASS * slip / (1 + MASS * radius**2 / model.body_inertia[1, 0])
            along = MASS * (slip - float(data.qvel[0]))
            asked = min(friction * normal, sticking)
            return Bounce(e, abs(along - asked) / (friction * normal) if friction else 0.0)
        mujoco.mj_step(model, data)
    return Bounce(0.0, math.nan)


def rest(model: Any, drop: float, seconds: float = 6.0) -> tuple[float, float]:
    """(mean depth, peak to peak) in the last second after a drop from `drop` m; m."""
    data, radius = mujoco.MjData(model), model.geom_size[1, 0]
    data.qpos[2] += drop
    heights = []
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        heights.append(float(data.qpos[2]) - radius)
    last = np.array(heights[round((seconds - 1) / model.opt.timestep) :])
    return -float(last.mean()), float(np.ptp(last))


def box(model: Any, tilt: float, slip: float, seconds: float = 10.0) -> tuple[float, float]:
    """A box dropped at 1 m/s from 10 cm: (largest energy over the
    first, drift in its second half, m).
    """
    data, h, half = mujoco.MjData(model), model.opt.timestep, model.geom_size[1, 0]
    data.qpos[2] += 0.1 + 0.5 * half * tilt
    data.qpos[3:6] = math.cos(tilt / 2), 0.8 * math.sin(tilt / 2), 0.6 * math.sin(tilt / 2)
    data.qvel[0], data.qvel[2] = slip, -1.0
    energy, places = [], []
    for _ in range(round(seconds / h)):
        v, w, z = data.qvel[:3], data.qvel[3:], data.qpos[2]
        turning = 0.5 * model.body_inertia[1] @ w**2
        energy.append(0.5 * MASS * v @ v + turning + MASS * G * (z - 0.5 * h * v[2]))
        places.append(data.qpos[:3].copy())
        mujoco.mj_step(model, data)
    return max(energy) / energy[0], float(np.abs(places[-1] - places[len(places) // 2]).max())


def pybullet_bounces(paste: str, launches: Any, friction: float) -> list[Bounce]:
    """Bounce of a solid ball, with a setting pasted; read by the speed at the start of a step."""
    import pybullet

    radius, world = 0.0508, {"pybullet": pybullet}
    client = pybullet.connect(pybullet.DIRECT)
    shapes = {
        "ball": {"shapeType": pybullet.GEOM_SPHERE, "radius": radius},
        "plate": {"shapeType": pybullet.GEOM_PLANE},
    }
    for name, shape in shapes.items():
        mass = MASS if name == "ball" else 0
        made = pybullet.createCollisionShape(**shape)
        world[name] = pybullet.createMultiBody(mass, made, useMaximalCoordinates=True)
    exec("\n".join(line for line in paste.splitlines() if "loadURDF" not in line), world)
    pybullet.setGravity(0, 0, -G)
    h, ball, bounces = pybullet.getPhysicsEngineParameters()["fixedTimeStep"], world["ball"], []
    for speed, phase, slip in launches:
        z, sticking = radius + (1 + phase) * h * speed, MASS * slip / 3.5
        pybullet.resetBasePositionAndOrientation(ball, [0, 0, z], [0, 0, 0, 1])
        pybullet.resetBaseVelocity(ball, [slip, 0, -speed], [0, 0, 0])
        down = -speed
        while True:
            pybullet.stepSimulation()
            (along, _, up), _ = pybullet.getBaseVelocity(ball)
            if up > down - 0.5 * G * h:
                break
            down = up
        sliding = friction * MASS * (up - down + G * h)
        asked = min(sliding, sticking)
        bounces.append(Bounce(-up / down, abs(MASS * (slip - along) - asked) / sliding))
    pybullet.disconnect(client)
    return bounces
