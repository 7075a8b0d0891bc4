# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""ODE in panda3d: python hcbench_cases.py ode_adapter.py. Friction and restitution are of a contact,
so of the pair itself.
"""

from importlib.metadata import version

from panda3d import ode


class OdeBodies:
    """An engine of `hcbench_cases`: ODE with the best settings that are known."""

    name, version, combine = "ode", version("panda3d"), None

    def choose(self):
        """Choose parameters of the world."""
        # Error reduction adds speed; without any mixing ODE aborts where a box rests.
        self.world.setErp(0.0)
        self.world.setCfm(1e-7)

    def make(self, world):
        if "materials" in world:
            raise NotImplementedError("has no restitution of a material")
        self.h = world["timestep"]
        self.world = ode.OdeWorld()
        self.world.setGravity(*world["gravity"])
        self.world.initSurfaceTable(1)
        # Threshold of speed, error reduction, mixing, slip and damping are 0.
        self.world.setSurfaceEntry(0, 0, world["friction"], world["restitution"], 0, 0, 0, 0, 0)
        self.choose()
        self.space, self.contacts = ode.OdeSimpleSpace(), ode.OdeJointGroup()
        self.space.setAutoCollideWorld(self.world)
        self.space.setAutoCollideJointGroup(self.contacts)
        self.moving, self.geoms = [], []
        for b in world["bodies"]:
            self.add(b)
        if world["floor"]:
            self.geoms.append(ode.OdePlaneGeom(self.space, 0, 0, 1, 0))
        for geom in self.geoms:
            self.space.setSurfaceType(geom, 0)

    def add(self, b):
        """Add a body at its start."""
        mass = ode.OdeMass()
        if b["shape"] == "sphere":
            geom = ode.OdeSphereGeom(self.space, b["radius"])
            mass.setSphereTotal(b["mass"], b["radius"])
        elif b["shape"] == "box":
            edges = [2 * half for half in b["half"]]
            geom = ode.OdeBoxGeom(self.space, *edges)
            mass.setBoxTotal(b["mass"], *edges)
        else:
            raise NotImplementedError("no mesh in this adapter")
        self.geoms.append(geom)
        if b.get("fixed"):
            geom.setPosition(*b["position"])
            return
        body = ode.OdeBody(self.world)
        body.setMass(mass)
        body.setPosition(*b["position"])
        body.setLinearVel(*b["velocity"])
        body.setAngularVel(*b["spin"])
        geom.setBody(body)
        self.moving.append(body)

    def step(self):
        self.space.autoCollide()
        self.world.step(self.h)
        self.contacts.empty()

    def state(self):
        return [[*b.getPosition(), *b.getLinearVel(), *b.getAngularVel()] for b in self.moving]


class OdeStock(OdeBodies):
    """An engine of `hcbench_cases`: ODE with nothing chosen but restitution and friction."""

    name = "ode-stock"

    def choose(self):
        pass


ENGINES = [OdeBodies, OdeStock]
