# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""Drake: a discrete plant with its default dissipation; boxes touch the
floor by patches, not a point.
"""

import logging
from importlib.metadata import version
from typing import Any

import pydrake.all as drake

logging.getLogger("drake").setLevel(logging.ERROR)


class DrakeBodies:
    """An engine of `hcbench_cases`: Drake with the best settings that are known."""

    name = "drake"
    version = version("drake")
    combine = None

    def make(self, world: dict[str, Any]) -> None:
        """Build a discrete plant, its bodies at their start.

        world: in SI units: timestep, gravity, friction, restitution, bodies, and floor, true or
        false.
        Raises NotImplementedError for a restitution other than 0, and for meshes.
        """
        if world.get("restitution") != 0.0:
            raise NotImplementedError("has no restitution: its loss depends on the speed")
        bodies = world["bodies"]
        self.h = world["timestep"]
        self.steps = 0
        builder = drake.DiagramBuilder()
        plant, _ = drake.AddMultibodyPlantSceneGraph(builder, time_step=self.h)
        friction = drake.CoulombFriction(world["friction"], world["friction"])
        self.materials(friction)
        self.moving = [self._body(plant, f"body{i}", body) for i, body in enumerate(bodies)]
        if world["floor"]:
            self._shape(plant, plant.world_body(), drake.HalfSpace(), self.rigid)
        plant.mutable_gravity_field().set_gravity_vector(world["gravity"])
        plant.Finalize()
        self.plant = plant
        self.simulator = drake.Simulator(builder.Build())
        self.context = plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        # Only a finalized plant has a state to set; all bodies are free.
        for made, body in zip(self.moving, bodies, strict=True):
            plant.SetFreeBodyPose(self.context, made, drake.RigidTransform(body["position"]))
            velocity = drake.SpatialVelocity(body["spin"], body["velocity"])
            plant.SetFreeBodySpatialVelocity(self.context, made, velocity)
        self.simulator.Initialize()

    def materials(self, friction: Any) -> None:
        """Make the contact properties of balls (`properties`), of boxes (`patch`) and of the floor
        (`rigid`), Drake's ProximityProperties.

        friction: Drake's CoulombFriction of all of them.
        """
        # Drake's default dissipation, s/m, and a point stiffness, N/m.
        dissipation = 50.0
        stiffness = 1e7
        self.properties = drake.ProximityProperties()
        drake.AddContactMaterial(dissipation, stiffness, friction, self.properties)
        self.rigid = drake.ProximityProperties(self.properties)
        drake.AddRigidHydroelasticProperties(1.0, self.rigid)
        self.patch = drake.ProximityProperties(self.properties)
        # Length of the elements of a body's pressure field, m, and its modulus, Pa.
        resolution = 0.1
        modulus = 1e8
        drake.AddCompliantHydroelasticProperties(resolution, modulus, self.patch)

    def _body(self, plant: Any, name: str, body: dict[str, Any]) -> Any:
        """Add a body with its shape to a plant, and return it.

        name: in the plant.
        body: of the case, SI.
        Boxes touch by patches, spheres by a point.
        Raises NotImplementedError for a mesh.
        """
        shape: Any
        if body["shape"] == "mesh":
            raise NotImplementedError("has meshes of files alone")
        if "half" in body:
            sides = [2 * x for x in body["half"]]
            shape = drake.Box(*sides)
            inertia = drake.UnitInertia.SolidBox(*sides)
            properties = self.patch
        else:
            shape = drake.Sphere(body["radius"])
            inertia = drake.UnitInertia.SolidSphere(body["radius"])
            properties = self.properties
        centre: Any = [0, 0, 0]
        made = plant.AddRigidBody(name, drake.SpatialInertia(body["mass"], centre, inertia))
        self._shape(plant, made, shape, properties)
        return made

    def _shape(self, plant: Any, body: Any, shape: Any, properties: Any) -> None:
        plant.RegisterCollisionGeometry(body, drake.RigidTransform(), shape, "shape", properties)

    def step(self) -> None:
        self.steps += 1
        self.simulator.AdvanceTo(self.steps * self.h)

    def state(self) -> list[list[float]]:
        states = []
        for body in self.moving:
            pose = self.plant.EvalBodyPoseInWorld(self.context, body)
            v = self.plant.EvalBodySpatialVelocityInWorld(self.context, body)
            states.append([*pose.translation(), *v.translational(), *v.rotational()])
        return states


class DrakeStock(DrakeBodies):
    """An engine of `hcbench_cases`: Drake with nothing chosen but the friction."""

    name = "drake-stock"

    def materials(self, friction: Any) -> None:
        self.properties = drake.ProximityProperties()
        drake.AddContactMaterial(None, None, friction, self.properties)
        self.rigid = self.patch = self.properties


ENGINES = [DrakeBodies, DrakeStock]
