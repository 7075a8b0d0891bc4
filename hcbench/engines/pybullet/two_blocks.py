"""The scene `two-blocks` in PyBullet, by plug-in or by Bullet's own contact: see `hcbench.sim.two_blocks`.

Bullet's own contact is a restitution where the body is clear of the blocks; where they squeeze it, there is
no impact, and it is a spring and damper. Both are right at one speed.
"""

from __future__ import annotations

from contextlib import nullcontext
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.pybullet.recipes import restitution, spring_damper
from hcbench.sim.two_blocks import SIDES, folder
from hcbench.tune.target import Target

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hcbench.impact import Floats
    from hcbench.sim.two_blocks import TwoBlocks

REMARK = (
    "PyBullet's own contact is right at one speed, here 0.4 m/s, and parts from the reference after the first"
    " impacts; squeezed, it jumps by c v at every touch."
)


def own_contact(squeezed: bool) -> str:
    """The recipe by which Bullet's own contact is tuned."""
    return "spring-damper" if squeezed else "restitution"


def _options(blocks: TwoBlocks) -> Mapping[str, Any]:
    """Keyword arguments of Bullet's calls."""
    if blocks.tuned_at is None:
        return {"world": restitution.WORLD, "ball": restitution.BALL, "plate": {}}
    target = Target(blocks.law, blocks.mass, blocks.timestep, blocks.tuned_at, blocks.tuned_at)
    recipe = spring_damper.SPRING_DAMPER if blocks.gap <= 0.0 else restitution.RESTITUTION
    return recipe(target).options


def simulate(blocks: TwoBlocks, position: float, velocity: float, forces: Floats) -> tuple[Floats, Floats]:
    """Positions and velocities at the ends of steps; in a client of its own."""
    import pybullet as bullet

    client = bullet.connect(bullet.DIRECT)
    try:
        return _simulate(bullet, client, blocks, position, velocity, forces)
    finally:
        bullet.disconnect(client)


def _simulate(
    bullet: Any, client: int, blocks: TwoBlocks, position: float, velocity: float, forces: Floats
) -> tuple[Floats, Floats]:
    from hcbench.engines.pybullet.plugin.attach import attach

    options, here = _options(blocks), {"physicsClientId": client}
    bullet.setPhysicsEngineParameter(fixedTimeStep=blocks.timestep, **options["world"], **here)
    planes = [_load(bullet, client, side, blocks.plane(side)) for side in SIDES]
    ball = _load(bullet, client, "ball", position)
    bullet.changeDynamics(ball, -1, mass=blocks.mass, **options["ball"], **here)
    for plane in planes:
        bullet.changeDynamics(plane, -1, **options["plate"], **here)
    bullet.resetBaseVelocity(ball, [velocity, 0, 0], **here)
    place = partial(bullet.getBasePositionAndOrientation, ball, **here)
    plugged = blocks.tuned_at is None
    states = [(position, velocity)]
    pairs = [(ball, plane) for plane in planes]
    with attach(pairs, blocks.law, client=client) if plugged else nullcontext() as contact:
        for force in forces:
            bullet.applyExternalForce(ball, -1, [force, 0, 0], place()[0], bullet.WORLD_FRAME, **here)
            if contact is not None:
                contact.apply()
            bullet.stepSimulation(**here)
            states.append((place()[0][0], bullet.getBaseVelocity(ball, **here)[0][0]))
    q, v = np.array(states).T
    return q, v


def _load(bullet: Any, client: int, name: str, x: float) -> int:
    """A body of the scene, at x (m)."""
    file, flags = str(folder() / f"{name}.urdf"), bullet.URDF_USE_INERTIA_FROM_FILE
    return int(bullet.loadURDF(file, [x, 0, 0], flags=flags, physicsClientId=client))
