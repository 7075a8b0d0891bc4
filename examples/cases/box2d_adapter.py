# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""Box2D 2.3.10: python hcbench_cases.py box2d_adapter.py. Its y is z, and its spin is minus spin[1].

Box2D takes the larger of two restitutions, and the root of the product of two frictions.
"""

from importlib.metadata import version

import Box2D


class Box2dBodies:
    """With the best settings that are known: lengths in a unit that is small for Box2D."""

    name, version, combine = "box2d", version("box2d"), "maximum"

    def units(self, world):
        """Box2D's units of length in a metre.

        Its skin of a hundredth, its threshold of speed, 1/s, and its farthest travel of a step, 2,
        are of such units.
        """
        pull = abs(world["gravity"][2])
        bodies = world["bodies"]
        drop = max(body["position"][2] for body in bodies)
        fastest = max(sum(v**2 for v in body["velocity"]) for body in bodies) + 2 * pull * drop
        return min(1000.0, 1.0 / (world["timestep"] * fastest**0.5))

    def make(self, world):
        self.h = world["timestep"]
        self.unit = unit = self.units(world)
        x, _, z = world["gravity"]
        self.world = Box2D.b2World(gravity=(unit * x, unit * z), doSleep=False)
        e, floor_e = world.get("materials", [world.get("restitution")] * 2)
        self.moving = []
        for body in world["bodies"]:
            self.add(body, {"restitution": e, "friction": world["friction"]})
        if world["floor"]:
            slab = Box2D.b2PolygonShape(box=(9 * unit, unit, (0, -unit), 0))
            material = {"restitution": floor_e, "friction": world["friction"]}
            self.world.CreateStaticBody().CreateFixture(shape=slab, **material)

    def add(self, body, material):
        """Add a body at its start."""
        unit, mass = self.unit, body["mass"]
        if body["shape"] == "sphere":
            radius = unit * body["radius"]
            shape = Box2D.b2CircleShape(radius=radius)
            inertia = 0.4 * mass * radius**2  # of a ball, not of a disc
        elif body["shape"] == "box":
            width, _, height = (unit * half for half in body["half"])
            shape = Box2D.b2PolygonShape(box=(width, height))
            inertia = mass * (width**2 + height**2) / 3
        else:
            raise NotImplementedError("no mesh in two dimensions")
        x, _, z = body["position"]
        place = {"position": (unit * x, unit * z)}
        if body.get("fixed"):
            self.world.CreateStaticBody(**place).CreateFixture(shape=shape, **material)
            return
        made = self.world.CreateDynamicBody(bullet=True, **place)
        made.CreateFixture(shape=shape, density=1, **material)
        made.massData = Box2D.b2MassData(mass=mass, I=inertia, center=(0, 0))
        x, _, z = body["velocity"]
        made.linearVelocity = (unit * x, unit * z)
        made.angularVelocity = -body["spin"][1]
        self.moving.append(made)

    def step(self):
        self.world.Step(self.h, 50, 50)

    def state(self):
        return [
            self._state(*body.position, *body.linearVelocity, body.angularVelocity)
            for body in self.moving
        ]

    def _state(self, x, z, vx, vz, spin):
        x, z, vx, vz = (value / self.unit for value in (x, z, vx, vz))
        return [x, 0.0, z, vx, 0.0, vz, 0.0, -spin, 0.0]


class Box2dStock(Box2dBodies):
    """With nothing chosen but restitution and friction."""

    name = "box2d-stock"

    def units(self, world):
        return 1.0


ENGINES = [Box2dBodies, Box2dStock]
