# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""PhysX behind SAPIEN: restitution and friction are averages of two materials', so each has those
of the pair.
"""

from importlib.metadata import version
from typing import Any

import numpy as np
import sapien  # type: ignore[import-not-found]


class PhysxBodies:
    """An engine of `hcbench_cases`: PhysX with the best settings that are known."""

    name = "physx"
    version = version("sapien")
    combine = "average"

    def configure(self, gravity: list[float]) -> None:
        """Set the parameters of the scenes to come."""
        # Below the threshold nothing bounces. TGS splits the step, and turns a ball exactly.
        own = {"bounce_threshold": 0.0, "enable_tgs": True}
        sapien.physx.set_scene_config(gravity=np.array(gravity), **own)

    def make_exact(self, body: Any) -> None:
        """Set the parameters of a body."""
        body.linear_damping = body.angular_damping = 0.0
        body.max_angular_velocity = 1e6
        body.solver_position_iterations = 50

    def make(self, world: dict[str, Any]) -> None:
        """Build a scene of PhysX, its bodies at their start.

        world: in SI units: timestep, gravity, friction, restitution (or materials: e of the bodies
        and of the floor), bodies, and floor, true or false.
        Raises NotImplementedError for a mesh.
        """
        self.configure(world["gravity"])
        self.system = sapien.physx.PhysxCpuSystem()
        self.system.timestep = world["timestep"]
        self.scene = sapien.Scene([self.system])
        e, floor_e = world.get("materials", [world.get("restitution")] * 2)
        mu = world["friction"]
        material = sapien.physx.PhysxMaterial(mu, mu, e)
        self.moving: list[Any] = []
        for body in world["bodies"]:
            self._add(body, material)
        if world["floor"]:
            ground = self.scene.create_actor_builder()
            up = sapien.Pose(q=[0.5**0.5, 0, -(0.5**0.5), 0])  # the normal of a plane is x
            ground.add_plane_collision(up, sapien.physx.PhysxMaterial(mu, mu, floor_e))
            ground.build_static("floor")

    def _add(self, body: dict[str, Any], material: Any) -> None:
        """Add a body to the scene at its start, and to `moving` if it is not fixed.

        body: of the case, SI.
        material: of its shape.
        Raises NotImplementedError for a mesh.
        """
        if body["shape"] == "mesh":
            raise NotImplementedError("has meshes of files alone")
        builder = self.scene.create_actor_builder()
        if body["shape"] == "sphere":
            builder.add_sphere_collision(radius=body["radius"], material=material)
            # Inertia over mass, m²: of a solid ball, 2/5 r²; below of a solid box.
            arms = [0.4 * body["radius"] ** 2] * 3
        else:
            half = np.array(body["half"])
            builder.add_box_collision(half_size=half, material=material)
            arms = list((half @ half - half**2) / 3)
        pose = sapien.Pose(body["position"])
        builder.set_initial_pose(pose)
        if body.get("fixed"):
            builder.build_static("fixed")
            return
        made = builder.build("moving")
        part = made.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
        part.mass = body["mass"]
        part.inertia = [body["mass"] * arm for arm in arms]
        self.make_exact(part)
        part.linear_velocity = body["velocity"]
        part.angular_velocity = body["spin"]
        self.moving.append(part)

    def step(self) -> None:
        self.system.step()

    def state(self) -> list[list[float]]:
        return [
            [float(x) for x in (*b.entity_pose.p, *b.linear_velocity, *b.angular_velocity)]
            for b in self.moving
        ]


class PhysxStock(PhysxBodies):
    """An engine of `hcbench_cases`: PhysX with nothing chosen but restitution and friction."""

    name = "physx-stock"

    def configure(self, gravity: list[float]) -> None:
        sapien.physx.set_scene_config(gravity=np.array(gravity))

    def make_exact(self, body: Any) -> None:
        """Choose nothing."""


ENGINES = [PhysxBodies, PhysxStock]
