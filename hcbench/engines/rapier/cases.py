# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""Rapier: restitution and friction are averages of two colliders', so each has those of the pair."""

from importlib.metadata import version
from typing import Any

import rapier3d as rapier


class RapierBodies:
    """An engine of `hcbench_cases`: Rapier with the best settings that are known.

    world: Rapier's.
    moving: its bodies that are not fixed, in the order of the case.
    """

    name = "rapier"
    version = version("rapier3d")
    combine = "average"

    def set_world(self) -> None:
        """Choose parameters of the solver."""
        parameters = self.world.integration_parameters
        # Lengths of a body, m: prediction, slop and largest speed are shares of it.
        parameters.length_unit = 0.05
        # A contact that is found before the touch takes speed away without friction.
        parameters.normalized_prediction_distance = 1e-3
        parameters.num_solver_iterations = 64
        parameters.friction_model = rapier.FrictionModel.COULOMB

    def make(self, world: dict[str, Any]) -> None:
        """Build a world of Rapier, its bodies at their start.

        world: of a case, in SI units: timestep, gravity, friction, restitution (or materials: e of
        the bodies and of the floor), bodies, and floor, true or false.
        """
        self.world = rapier.PhysicsWorld(gravity=world["gravity"])
        self.world.integration_parameters.dt = world["timestep"]
        self.set_world()
        e, floor_e = world.get("materials", [world.get("restitution")] * 2)
        self.moving = []
        for body in world["bodies"]:
            kind = rapier.RigidBody.fixed if body.get("fixed") else rapier.RigidBody.dynamic
            start = kind(
                translation=body["position"],
                linvel=body["velocity"],
                angvel=body["spin"],
                can_sleep=False,
            )
            handle = self.world.rigid_bodies.insert(start)
            collider = self._collider(body)
            self._insert(collider, e, world["friction"], handle)
            if not body.get("fixed"):
                self.moving.append(self.world.rigid_bodies[handle])
        if world["floor"]:
            self._insert(rapier.Collider.halfspace((0, 0, 1)), floor_e, world["friction"])

    @staticmethod
    def _collider(body: dict[str, Any]) -> Any:
        if body["shape"] == "sphere":
            return rapier.Collider.ball(body["radius"], mass=body["mass"])
        if body["shape"] == "box":
            return rapier.Collider.cuboid(*body["half"], mass=body["mass"])
        return rapier.Collider.convex_hull(body["vertices"], mass=body["mass"])

    def _insert(self, collider: Any, e: float, friction: float, handle: Any = None) -> None:
        """Add a collider to the world with its restitution and friction.

        e: restitution.
        handle: of the body that it belongs to; None for one that is fixed in the world.
        """
        colliders = self.world.colliders
        if handle is None:
            made = colliders[colliders.insert(collider)]
        else:
            made = colliders[
                colliders.insert_with_parent(collider, handle, self.world.rigid_bodies)
            ]
        made.restitution = e
        made.friction = friction

    def step(self) -> None:
        self.world.step()

    def state(self) -> list[list[float]]:
        return [[*_xyz(b.translation), *_xyz(b.linvel), *_xyz(b.angvel)] for b in self.moving]


def _xyz(v: Any) -> tuple[float, float, float]:
    return v.x, v.y, v.z


class RapierStock(RapierBodies):
    """An engine of `hcbench_cases`: Rapier with nothing chosen but restitution and friction."""

    name = "rapier-stock"

    def set_world(self) -> None:
        """Choose nothing."""


ENGINES = [RapierBodies, RapierStock]
