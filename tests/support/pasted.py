"""Text that hcbench hands out, in a plain model or script of other names: loaded, stepped, e read."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import mujoco

if TYPE_CHECKING:
    from pathlib import Path

FOOT, FLOOR = NAMES = ("foot", "floor")
RADIUS, MASS = 0.0508, 0.45359237
Launches = Sequence[tuple[float, float]]  # (speed at touch m/s, phase of the step)


def renamed(text: str) -> str:
    """A text with the reader's names in it, as the page's script puts them."""
    return re.sub(r"\b(ball|plate)\b", lambda found: {"ball": FOOT, "plate": FLOOR}[found[0]], text)


def plain_mujoco(text: str, step: float, gravity: float) -> Any:
    """A ball on a plane, with the text and nothing else of hcbench."""
    ball = f'<geom name="{FOOT}" type="sphere" size="{RADIUS}" mass="{MASS}"/>'
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step!r}" gravity="0 0 {-gravity}"/>{text}<worldbody>'
        f'<geom name="{FLOOR}" type="plane" size="3 3 .1"/>'
        f'<body name="{FOOT}" pos="0 0 {RADIUS}"><freejoint/>{ball}</body></worldbody></mujoco>'
    )


def bounces(model: Any, launches: Launches, radius: float = RADIUS) -> list[float]:
    """e at the touch plane of each launch, by a loop over mj_step; 0 of a ball that stays down."""
    return [_bounce(model, speed, phase, radius) for speed, phase in launches]


def _bounce(model: Any, speed: float, phase: float, radius: float) -> float:
    data, h, g = mujoco.MjData(model), model.opt.timestep, -model.opt.gravity[2]
    # A semi-implicit step leaves the speed of its middle, RK4 that of its end.
    half = 0.0 if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 else g * h / 2
    t = (phase + (speed > 4 * g * h)) * h  # a slower one has not fallen for a whole step
    data.qpos[2] = radius + speed * t - g * t * t / 2
    data.qvel[2] = -(speed - g * t - half)
    for _ in range(3_000):
        z, w = data.qpos[2] - radius, float(data.qvel[2])
        if z >= 0 and w > 0:  # a contact that ends within the step still acts in it
            mujoco.mj_step(model, data)
            z, w = data.qpos[2] - radius, float(data.qvel[2])
            return math.sqrt((w - half) ** 2 + 2 * g * z) / speed
        mujoco.mj_step(model, data)
    return 0.0


_BULLET = """
import json, math, sys
import pybullet
pybullet.connect(pybullet.DIRECT)
radius, mass = float(sys.argv[1]), float(sys.argv[2])
inertia, friction = 0.4 * mass * radius**2, 0.0
for text, h, g, launches in json.load(sys.stdin):
    pybullet.resetSimulation()
    pybullet.setGravity(0, 0, -g)
    pybullet.setTimeStep(h)
    maximal = "useMaximalCoordinates=True" in text
    resolved = any(word in text for word in ("hunt_crossley", "loadURDF", "contactStiffness"))
    floor = pybullet.createMultiBody(
        0, pybullet.createCollisionShape(pybullet.GEOM_PLANE), useMaximalCoordinates=maximal)
    if "loadURDF" not in text:
        sphere = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius)
        foot = pybullet.createMultiBody(
            mass, sphere, basePosition=[0, 0, radius], useMaximalCoordinates=maximal)
    exec(text)
    for speed, phase in launches:
        t = (phase + 2 * (speed > 4 * g * h)) * h
        up = speed * t - g * t * t / 2
        pybullet.resetBasePositionAndOrientation(foot, [0, 0, radius + up], [0, 0, 0, 1])
        pybullet.resetBaseVelocity(foot, [0, 0, -(speed - g * t - g * h / 2)], [0, 0, 0])
        before, e = 0.0, 0.0
        for _ in range(5000):
            v = pybullet.getBaseVelocity(foot)[0][2]
            z = pybullet.getBasePositionAndOrientation(foot)[0][2] - radius
            if v > 0 and (z >= 0 or not resolved):
                if resolved:
                    pybullet.stepSimulation()
                    v = pybullet.getBaseVelocity(foot)[0][2]
                    z = pybullet.getBasePositionAndOrientation(foot)[0][2] - radius
                at_plane = math.sqrt(max(0.0, (v - g * h / 2) ** 2 + 2 * g * z))
                e = -v / before if maximal else at_plane / speed
                break
            before = v
            pybullet.stepSimulation()
        print("e =", e)
"""


def bullet_bounces(
    given: Sequence[tuple[str, float, float, Launches]], folder: Path
) -> list[list[float]]:
    """e of the launches of each (text, step s, gravity m/s², launches), in one plain script.

    Of Bullet's own restitution, speed out over the speed that it reverses, at the start of a step.
    """
    command = [sys.executable, "-c", _BULLET, repr(RADIUS), repr(MASS)]
    done = subprocess.run(
        command, input=json.dumps(given), capture_output=True, text=True, check=True, cwd=folder
    )
    found = iter(
        [float(line.split()[2]) for line in done.stdout.splitlines() if line.startswith("e =")]
    )
    return [[next(found) for _ in launches] for *_, launches in given]
