"""Drake: a discrete plant with its default dissipation; boxes touch the floor by patches, not a point."""

import logging
from importlib.metadata import version
from typing import Any

import pydrake.all as drake

logging.getLogger("drake").setLevel(logging.ERROR)


class DrakeBodies:
    name, version, combine = "drake", version("drake"), None

    def make(self, world: dict[str, Any]) -> None:
        if world.get("restitution") != 0.0:
            raise NotImplementedError("has no restitution: its loss depends on the speed")
        self.h, self.steps, bodies = world["timestep"], 0, world["bodies"]
        builder, self.properties = drake.DiagramBuilder(), drake.ProximityProperties()
        plant, _ = drake.AddMultibodyPlantSceneGraph(builder, time_step=self.h)
        drake.AddContactMaterial(50.0, 1e7, drake.CoulombFriction(*[world["friction"]] * 2), self.properties)
        rigid, self.patch = (drake.ProximityProperties(self.properties) for _ in range(2))
        drake.AddRigidHydroelasticProperties(1.0, rigid)
        drake.AddCompliantHydroelasticProperties(0.1, 1e8, self.patch)
        self.moving = [self._body(plant, f"body{i}", body) for i, body in enumerate(bodies)]
        if world["floor"]:
            self._shape(plant, plant.world_body(), drake.HalfSpace(), rigid)
        plant.mutable_gravity_field().set_gravity_vector(world["gravity"])
        plant.Finalize()
        self.plant, self.simulator = plant, drake.Simulator(builder.Build())
        self.context = plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        for made, body in zip(self.moving, bodies, strict=True):
            plant.SetFreeBodyPose(self.context, made, drake.RigidTransform(body["position"]))
            velocity = drake.SpatialVelocity(body["spin"], body["velocity"])
            plant.SetFreeBodySpatialVelocity(self.context, made, velocity)
        self.simulator.Initialize()

    def _body(self, plant: Any, name: str, body: dict[str, Any]) -> Any:
        size, unit = [2 * x for x in body.get("half", [])], drake.UnitInertia
        shape: Any = drake.Box(*size) if size else drake.Sphere(body["radius"])
        solid = unit.SolidBox(*size) if size else unit.SolidSphere(body["radius"])
        centre: Any = [0, 0, 0]
        made = plant.AddRigidBody(name, drake.SpatialInertia(body["mass"], centre, solid))
        self._shape(plant, made, shape, self.patch if size else self.properties)
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


ENGINES = [DrakeBodies]
