# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""DART: restitutions of two shapes multiply, so each has the root of the pair's; friction is the
smaller of both.
"""

import math
from importlib.metadata import version
from typing import Any

import dartpy as dart  # type: ignore[import-not-found]
import numpy as np


class DartBodies:
    """An engine of `hcbench_cases`: DART with the best settings that are known."""

    name = "dart"
    version = version("dartpy")
    combine = "product"
    # DART's lengths in a metre. It bounces nothing while e v is below 0.1 of them a second, and
    # nothing faster than 100 of them a second.
    length = 20.0

    def make(self, world: dict[str, Any]) -> None:
        """Build a world with its bodies at their start, and a slab for the floor.

        world: in SI units: timestep, gravity, friction, restitution (or materials: e of the bodies
        and of the floor), bodies, and floor, true or false. Lengths are multiplied by `length` for
        DART.
        """
        self.world = dart.simulation.World()
        self.world.setTimeStep(world["timestep"])
        self.world.setGravity(np.array(world["gravity"], float) * self.length)
        e, floor_e = world.get("materials", [math.sqrt(world.get("restitution", 0.0))] * 2)
        friction = world["friction"]
        self.moving = []
        for i, body in enumerate(world["bodies"]):
            node, skeleton = self._body(f"body{i}", body)
            self._shape(node, self._solid(body), e, friction)
            if not body.get("fixed"):
                self.moving.append((node, skeleton))
            self.world.addSkeleton(skeleton)
        if world["floor"]:
            ground = dart.dynamics.Skeleton("floor")
            _, node = ground.createWeldJointAndBodyNodePair()
            # DART has no planes: a thick plate, whose upper side is z = 0.
            slab = dart.dynamics.BoxShape(np.array([20.0, 20.0, 0.4]) * self.length)
            shape = self._shape(node, slab, floor_e, friction)
            shape.setRelativeTranslation(np.array([0.0, 0.0, -0.2]) * self.length)
            self.world.addSkeleton(ground)

    def _body(self, name: str, body: dict[str, Any]) -> tuple[Any, Any]:
        """Make a body of DART at its start, welded to the world or on a free joint: its body node and
        its skeleton.

        name: of the skeleton.
        body: of a case, SI: position, velocity, spin, mass, or fixed.
        """
        skeleton = dart.dynamics.Skeleton(name)
        at = np.array(body["position"]) * self.length
        if body.get("fixed"):
            joint, node = skeleton.createWeldJointAndBodyNodePair()
            frame = dart.math.Isometry3()
            frame.set_translation(at)
            joint.setTransformFromParentBodyNode(frame)
            return node, skeleton
        _, node = skeleton.createFreeJointAndBodyNodePair()
        mass = body["mass"]
        inertia = self._solid(body).computeInertia(mass)
        node.setInertia(dart.dynamics.Inertia(mass, [0, 0, 0], inertia))
        # Of a free joint the rotations come first.
        skeleton.setPositions([0, 0, 0, *at])
        skeleton.setVelocities([*body["spin"], *(np.array(body["velocity"]) * self.length)])
        return node, skeleton

    def _solid(self, body: dict[str, Any]) -> Any:
        if body["shape"] == "sphere":
            return dart.dynamics.SphereShape(body["radius"] * self.length)
        if body["shape"] == "box":
            return dart.dynamics.BoxShape(2.0 * np.array(body["half"]) * self.length)
        raise NotImplementedError("has meshes of files alone")

    @staticmethod
    def _shape(node: Any, solid: Any, e: float, friction: float) -> Any:
        """Give a body node a shape that collides, and return the shape node.

        solid: DART's shape.
        e: restitution of its surface, which DART multiplies with that of the other.
        friction: of its surface.
        """
        shape = node.createShapeNode(solid)
        shape.createVisualAspect()
        shape.createCollisionAspect()
        shape.createDynamicsAspect()
        shape.getDynamicsAspect().setRestitutionCoeff(coefficient(e))
        shape.getDynamicsAspect().setFrictionCoeff(friction)
        return shape

    def step(self) -> None:
        self.world.step()

    def state(self) -> list[list[float]]:
        """Position (m), velocity (m/s) and spin (rad/s) of each body that moves, nine numbers."""
        states = []
        for node, _ in self.moving:
            at = node.getWorldTransform().translation() / self.length
            states.append(
                [*at, *node.getLinearVelocity() / self.length, *node.getAngularVelocity()]
            )
        return states


def coefficient(e: float) -> float:
    """The restitution to set of a surface, 0 to 1, so that two such surfaces bounce with e².

    e: restitution of the surface, the root of that of a pair of them.
    DART's constraint force mixing of 1e-5 is built in: surfaces whose coefficients multiply to p
    bounce with (1 + p)/(1 + 1e-5) - 1. Of two unlike surfaces, a and b, the bounce is too strong
    by 1e-5 (a - b)²/(2 a b). Above 1, which DART does not take, it is 1.
    """
    # Without a restitution no coefficient is set: it would be that of the mixing, 0.003.
    if e == 0.0:
        return 0.0
    product = (1.0 + e**2) * (1.0 + 1e-5) - 1.0
    return min(1.0, math.sqrt(product))


class DartStock(DartBodies):
    """An engine of `hcbench_cases`: DART in metres, only restitution and friction chosen."""

    name = "dart-stock"
    length = 1.0


ENGINES = [DartBodies, DartStock]
