# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""PyBullet: restitution and friction are products of two bodies', so each
body has the root of the pair's.
"""

import math
from importlib.metadata import version
from typing import Any

import pybullet


class PybulletBodies:
    """An engine of `hcbench_cases`: PyBullet with the best settings that are known."""

    name = "pybullet"
    version = version("pybullet")
    combine = "product"

    def __init__(self) -> None:
        self.client = pybullet.connect(pybullet.DIRECT)

    def settings(self, e: float) -> dict[str, float]:
        """Parameters of the engine for a pair's restitution."""
        if e:
            # Error reduction adds its own speed to a rebound.
            return {"restitutionVelocityThreshold": 0, "contactERP": 0, "contactSlop": 0}
        # Without a rebound it keeps bodies out of each other; the slop keeps them from shaking.
        return {"restitutionVelocityThreshold": 0, "contactERP": 0.02, "contactSlop": 1e-4}

    def dynamics(self) -> dict[str, float]:
        """Keywords of changeDynamics for each body: no damping, no limit of its velocity, and no
        contact that acts before the touch.
        """
        return {
            "linearDamping": 0,
            "angularDamping": 0,
            "maxJointVelocity": 1e9,
            "contactProcessingThreshold": 0,
        }

    # In reduced coordinates an impact adds up to g h to the speed.
    is_maximal = True

    def make(self, world: dict[str, Any]) -> None:
        """Build a world in place of the last one, its bodies at their start.

        world: in SI units: timestep, gravity, friction, restitution (or materials: e of the bodies
        and of the floor), bodies, and floor, true or false. Bullet multiplies the restitutions of
        two bodies, and their frictions: each gets the root.
        """
        pybullet.resetSimulation()
        materials = world.get("materials", [math.sqrt(world.get("restitution", 0.0))] * 2)
        settings = self.settings(math.prod(materials))
        pybullet.setPhysicsEngineParameter(fixedTimeStep=world["timestep"], **settings)
        pybullet.setGravity(*world["gravity"])
        friction = math.sqrt(world["friction"])
        self.moving = []
        for body in world["bodies"]:
            made = self._body(body, materials[0], friction)
            if not body.get("fixed"):
                self.moving.append(made)
        if world["floor"]:
            shape = pybullet.createCollisionShape(pybullet.GEOM_PLANE)
            plane = pybullet.createMultiBody(0, shape, useMaximalCoordinates=self.is_maximal)
            pybullet.changeDynamics(plane, -1, restitution=materials[1], lateralFriction=friction)

    def _body(self, body: dict[str, Any], e: float, friction: float) -> int:
        """Add a body at its start, and return its id.

        body: of the case, SI; a mesh is its convex hull.
        e, friction: of this body.
        """
        if body["shape"] == "sphere":
            shape = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=body["radius"])
        elif body["shape"] == "box":
            shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=body["half"])
        else:
            shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, vertices=body["vertices"])
        mass = 0 if body.get("fixed") else body["mass"]
        at = body["position"]
        coordinates = {"useMaximalCoordinates": self.is_maximal}
        made = int(pybullet.createMultiBody(mass, shape, basePosition=at, **coordinates))
        own = self.dynamics()
        pybullet.changeDynamics(made, -1, restitution=e, lateralFriction=friction, **own)
        pybullet.resetBaseVelocity(made, body["velocity"], body["spin"])
        return made

    def step(self) -> None:
        pybullet.stepSimulation()

    def state(self) -> list[list[float]]:
        states = []
        for body in self.moving:
            position, _ = pybullet.getBasePositionAndOrientation(body)
            velocity, spin = pybullet.getBaseVelocity(body)
            states.append([*position, *velocity, *spin])
        return states


class PybulletStock(PybulletBodies):
    """An engine of `hcbench_cases`: PyBullet with nothing chosen but restitution and friction."""

    name = "pybullet-stock"
    is_maximal = False

    def settings(self, e: float) -> dict[str, float]:
        return {}

    def dynamics(self) -> dict[str, float]:
        return {}


ENGINES = [PybulletBodies, PybulletStock]
