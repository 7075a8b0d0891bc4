# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""OpenSim: balls with HuntCrossleyForce, without loss for e = 1, with a great one for e = 0."""

import math
from importlib.metadata import version
from typing import Any

import opensim as osim  # type: ignore[import-not-found]

osim.Logger.setLevelString("Off")  # else 12 lines a step, and a file
osim.Logger.removeFileSink()


class OpensimBodies:
    """An engine of `hcbench_cases`: OpenSim with the best settings that are known."""

    name = "opensim"
    version = version("opensim")
    combine = None

    def make(self, world: dict[str, Any]) -> None:
        """Build a model, its bodies at their start.

        world: in SI units: timestep, gravity, friction, restitution, bodies, and floor, true or
        false.
        Raises NotImplementedError for any e but 0 and 1, for materials, for shapes other than
        spheres and for fixed bodies.
        """
        e = world.get("restitution")
        if e not in (0.0, 1.0):
            raise NotImplementedError("has no restitution: its loss depends on the speed")
        if any(body["shape"] != "sphere" or body.get("fixed") for body in world["bodies"]):
            raise NotImplementedError("has meshes of files alone, and no boxes")
        self.h = world["timestep"]
        self.steps = 0
        self.model = osim.Model()
        self.model.setGravity(osim.Vec3(*world["gravity"]))
        ground = self.model.getGround()
        force = osim.HuntCrossleyForce()
        self.moving = []
        starts = []
        for i, body in enumerate(world["bodies"]):
            inertia = osim.Inertia(0.4 * body["mass"] * body["radius"] ** 2)
            made = osim.Body(f"body{i}", body["mass"], osim.Vec3(0), inertia)
            joint = osim.FreeJoint(f"joint{i}", ground, made)
            self.model.addBody(made)
            self.model.addJoint(joint)
            ball = osim.ContactSphere(body["radius"], osim.Vec3(0), made, f"ball{i}")
            self.model.addContactGeometry(ball)
            force.addGeometry(f"ball{i}")
            self.moving.append(made)
            # The six coordinates of a free joint: angles, then x y z; and their speeds.
            places = [0, 0, 0, *body["position"]]
            speeds = [*body["spin"], *body["velocity"]]
            starts.append((joint, [*zip(places, speeds, strict=True)]))
        if world["floor"]:
            upwards = osim.Vec3(0, math.pi / 2, 0)  # the half space's normal is -x of its frame
            floor = osim.ContactHalfSpace(osim.Vec3(0), upwards, ground, "floor")
            self.model.addContactGeometry(floor)
            force.addGeometry("floor")
        force.setStiffness(1e10)
        # s/m: a ball leaves slower than 1/(1.5 of these), at any speed of impact.
        force.setDissipation(0.0 if e else 1e3)
        force.setStaticFriction(world["friction"])
        force.setDynamicFriction(world["friction"])
        force.setTransitionVelocity(1e-3)  # m/s: slower slips have less friction
        self.model.addForce(force)
        now = self.model.initSystem()
        for joint, start in starts:
            for i, (place, speed) in enumerate(start):
                joint.get_coordinates(i).setValue(now, place)
                joint.get_coordinates(i).setSpeedValue(now, speed)
        self.now = now
        self.manager = osim.Manager(self.model)
        self.manager.setWriteToStorage(False)
        self.manager.setPerformAnalyses(False)
        self.manager.setIntegratorAccuracy(1e-9)  # with OpenSim's 1e-3 e is wrong by 0.2
        self.manager.initialize(now)

    def step(self) -> None:
        self.steps += 1
        self.now = self.manager.integrate(self.steps * self.h)

    def state(self) -> list[list[float]]:
        self.model.realizeVelocity(self.now)
        return [body_state(body, self.now) for body in self.moving]


def body_state(body: Any, now: Any) -> list[float]:
    motion = body.getVelocityInGround(now)  # spin, then velocity
    rows = body.getPositionInGround(now), motion.get(1), motion.get(0)
    return [row.get(i) for row in rows for i in range(3)]


class OpensimStock(OpensimBodies):
    """An engine of `hcbench_cases`: OpenSim with nothing chosen."""

    name = "opensim-stock"

    def make(self, world: dict[str, Any]) -> None:
        raise NotImplementedError("has no contact until a stiffness is chosen")


ENGINES = [OpensimBodies, OpensimStock]
