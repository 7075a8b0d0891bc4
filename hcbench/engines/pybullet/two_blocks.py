"""The scene `two-blocks` in PyBullet, by plug-in or by Bullet's own
contact: see `hcbench.sim.two_blocks`.

Bullet's own contact is a restitution where the body is clear of the blocks; where they squeeze it,
there is no impact, and it is a spring and damper. Both are right at one speed.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hcbench.engines.pybullet import recipes
from hcbench.engines.pybullet.backend import BulletClient
from hcbench.recipes.target import Target
from hcbench.sim.two_blocks import SIDES, TwoBlocks, folder
from hcbench.terms.impact import Floats

NOTE = (
    "PyBullet's own contact is right at one speed, here 0.4 m/s, and parts from the reference after the first"
    " impacts; squeezed, it jumps by c v at every touch."
)


def own_contact(squeezed: bool) -> str:
    """Name of the recipe that tunes Bullet's own contact."""
    return "spring-damper" if squeezed else "restitution"


def _options(blocks: TwoBlocks) -> Mapping[str, Any]:
    """Keyword arguments of Bullet's calls, by "world", "ball" and "plate": of its own contact, tuned
    at the scene's one speed, or without such a speed those that a plug-in's law needs.
    """
    if blocks.tuned_at is None:
        return {"world": recipes.WORLD, "ball": recipes.BALL, "plate": {}}
    target = Target(blocks.law, blocks.mass, blocks.timestep, blocks.tuned_at, blocks.tuned_at)
    recipe = recipes.SPRING_DAMPER if blocks.gap <= 0.0 else recipes.RESTITUTION
    return recipe(target).options


def simulate(
    blocks: TwoBlocks, position: float, velocity: float, forces: Floats
) -> tuple[Floats, Floats]:
    """Simulate the ball between two blocks, in a PyBullet client of its own.

    Returns its positions, m, and velocities, m/s, along x, at the start and after each step,
    (steps + 1,) each.

    position, velocity: at the start, m and m/s.
    forces: on the ball along x, N, (steps,).
    """
    bullet = BulletClient.direct()
    try:
        return _simulate(bullet, blocks, position, velocity, forces)
    finally:
        bullet.disconnect()


def _simulate(
    bullet: BulletClient, blocks: TwoBlocks, position: float, velocity: float, forces: Floats
) -> tuple[Floats, Floats]:
    """Simulate the ball between two blocks in an empty client.

    Returns its positions, m, and velocities, m/s, along x, at the start and after each step,
    (steps + 1,) each.

    position, velocity: at the start, m and m/s.
    forces: on the ball along x, N, (steps,).
    """
    from hcbench.engines.pybullet import plugin

    options = _options(blocks)
    bullet.setPhysicsEngineParameter(fixedTimeStep=blocks.timestep, **options["world"])
    planes = [_load(bullet, side, blocks.plane(side)) for side in SIDES]
    ball = _load(bullet, "ball", position)
    bullet.changeDynamics(ball, -1, mass=blocks.mass, **options["ball"])
    for plane in planes:
        bullet.changeDynamics(plane, -1, **options["plate"])
    bullet.resetBaseVelocity(ball, [velocity, 0, 0])
    states = [(position, velocity)]
    # A contact that is tuned at one speed is Bullet's own; else the plug-in's law acts.
    if blocks.tuned_at is None:
        for plane in planes:
            plugin.add(blocks.law, ball, plane, client=bullet.client)
    # Bullet forgets a force after each step.
    for force in forces:
        centre = bullet.getBasePositionAndOrientation(ball)[0]
        bullet.applyExternalForce(ball, -1, [force, 0, 0], centre, bullet.module.WORLD_FRAME)
        bullet.stepSimulation()
        x = bullet.getBasePositionAndOrientation(ball)[0][0]
        states.append((x, bullet.getBaseVelocity(ball)[0][0]))
    q, v = np.array(states).T
    return q, v


def _load(bullet: BulletClient, name: str, x: float) -> int:
    """A body of the scene, at x (m)."""
    flags = bullet.module.URDF_USE_INERTIA_FROM_FILE
    (body,) = bullet.load_model(folder() / f"{name}.urdf", basePosition=[x, 0, 0], flags=flags)
    return body
