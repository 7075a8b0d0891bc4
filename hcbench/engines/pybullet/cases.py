"""PyBullet: restitution and friction are products of two bodies', so each
body has the root of the pair's.
"""

import math
from importlib.metadata import version
from typing import Any

import pybullet


class PybulletBodies:
    name, version, combine = "pybullet", version("pybullet"), "product"

    def __init__(self) -> None:
        self.client = pybullet.connect(pybullet.DIRECT)

    def make(self, world: dict[str, Any]) -> None:
        pybullet.resetSimulation()
        exact = {"restitutionVelocityThreshold": 0, "contactERP": 0, "contactSlop": 0}
        pybullet.setPhysicsEngineParameter(fixedTimeStep=world["timestep"], **exact)
        pybullet.setGravity(*world["gravity"])
        own = math.sqrt(world.get("restitution", 0.0))
        materials = world.get("materials", [own, own])
        friction = math.sqrt(world["friction"])
        self.moving = []
        for body in world["bodies"]:
            made = self._body(body, materials[0], friction)
            if not body.get("fixed"):
                self.moving.append(made)
        if world["floor"]:
            plane = pybullet.createMultiBody(0, pybullet.createCollisionShape(pybullet.GEOM_PLANE))
            pybullet.changeDynamics(plane, -1, restitution=materials[1], lateralFriction=friction)

    def _body(self, body: dict[str, Any], e: float, friction: float) -> int:
        if body["shape"] == "sphere":
            shape = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=body["radius"])
        else:
            shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=body["half"])
        mass = 0 if body.get("fixed") else body["mass"]
        made = int(pybullet.createMultiBody(mass, shape, basePosition=body["position"]))
        damping = {
            "linearDamping": 0,
            "angularDamping": 0,
            "maxJointVelocity": 1e9,
            "contactProcessingThreshold": 0,
        }
        pybullet.changeDynamics(made, -1, restitution=e, lateralFriction=friction, **damping)
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


ENGINES = [PybulletBodies]
