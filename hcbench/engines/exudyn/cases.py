# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""Exudyn: mass points with ObjectContactSphereSphere, a spring and a damper that is fitted to e."""

import math
from itertools import combinations
from typing import Any

import exudyn
from exudyn import itemInterface

items: Any = itemInterface  # its functions have no types

# Steps of a contact: with fewer it gains energy.
CONTACT_STEPS = 20
# Radius of the sphere that stands for the floor, m: on its axis the gap is that of a plane.
FLOOR_RADIUS = 100.0


class ExudynBodies:
    """An engine of `hcbench_cases`: Exudyn with the best settings that are known."""

    name = "exudyn"
    version = exudyn.__version__
    combine = None

    def make(self, world: dict[str, Any]) -> None:
        """Build a system of mass points at their start, with a contact of every two and of each
        with the floor.

        world: in SI units: timestep, gravity, restitution, bodies, and floor, true or false.
        Raises NotImplementedError for materials, friction, and other shapes than spheres.
        """
        self._require(world)
        self.h = world["timestep"]
        self.mbs = exudyn.SystemContainer().AddSystem()
        bodies = world["bodies"]
        # Mass points do not turn: their spins stay.
        self.spins = [body["spin"] for body in bodies]
        self.nodes = []
        # (marker, radius m, 1/mass 1/kg) of all that can touch.
        balls = []
        for body in bodies:
            start = {"initialVelocities": body["velocity"]}
            node = self.mbs.AddNode(items.NodePoint(referenceCoordinates=body["position"], **start))
            point = self.mbs.AddObject(items.MassPoint(mass=body["mass"], nodeNumber=node))
            marker = self.mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=point))
            pull = [body["mass"] * g for g in world["gravity"]]
            self.mbs.AddLoad(items.Force(markerNumber=marker, loadVector=pull))
            self.nodes.append(node)
            balls.append((marker, body["radius"], 1.0 / body["mass"]))
        if world["floor"]:
            ground = self.mbs.AddObject(items.ObjectGround())
            below = items.MarkerBodyRigid(bodyNumber=ground, localPosition=[0, 0, -FLOOR_RADIUS])
            balls.append((self.mbs.AddMarker(below), FLOOR_RADIUS, 0.0))
        for a, b in combinations(balls, 2):
            self._contact(world["restitution"], a, b)
        self.mbs.Assemble()
        self._solver()

    @staticmethod
    def _require(world: dict[str, Any]) -> None:
        """Raise NotImplementedError for a world that this adapter has not."""
        if "materials" in world:
            raise NotImplementedError("has no restitution of a material")
        if world["friction"] or any(body["shape"] != "sphere" for body in world["bodies"]):
            raise NotImplementedError("has a contact of balls without friction alone")

    def _contact(self, e: float, a: tuple[Any, ...], b: tuple[Any, ...]) -> None:
        """Add a contact of two spheres to the system, with the restitution e: a linear spring that
        lasts CONTACT_STEPS steps for the two masses, and a loss.

        a, b: (marker, radius m, 1/mass 1/kg, 0 of the floor) each.
        """
        on_a, radius_a, share_a = a
        on_b, radius_b, share_b = b
        # Exudyn's own data of a contact: the gap, m, begins as open.
        start = [0.1, 0, 0, 0]
        touch = self.mbs.AddNode(
            items.NodeGenericData(initialCoordinates=start, numberOfDataCoordinates=4)
        )
        rate = math.pi / (CONTACT_STEPS * self.h)  # of half a turn of the spring, 1/s
        mass = 1.0 / (share_a + share_b)  # reduced mass of the two, kg
        if e:
            loss = {"impactModel": 2, "restitutionCoefficient": e, "minimumImpactVelocity": 0.0}
        else:
            # Its law of restitution diverges at 0; a critical damper does not bounce.
            loss = {"impactModel": 0, "contactDamping": 2.0 * mass * rate}
        contact = items.ObjectContactSphereSphere(
            markerNumbers=[on_a, on_b],
            nodeNumber=touch,
            spheresRadii=[radius_a, radius_b],
            contactStiffness=mass * rate**2,
            contactStiffnessExponent=1.0,
            **loss,
        )
        self.mbs.AddObject(contact)

    def _solver(self) -> None:
        """Make the settings of Exudyn's solver, `settings`: one step of `h`, s, a call, written to no
        file.
        """
        self.settings = exudyn.SimulationSettings()
        time = self.settings.timeIntegration
        # The default of 1e-8 s ends one impact in five at parting.
        time.minimumStepSize = 1e-16
        time.adaptiveStep = False
        time.discontinuous.useRecommendedStepSize = False
        time.numberOfSteps = 1
        time.endTime = self.h
        self.settings.solution.file.write = False

    def step(self) -> None:
        kind = exudyn.DynamicSolverType.RK44
        self.mbs.SolveDynamic(self.settings, solverType=kind, updateInitialValues=True)

    def state(self) -> list[list[float]]:
        states = []
        for node, spin in zip(self.nodes, self.spins, strict=True):
            position = self.mbs.GetNodeOutput(node, exudyn.OutputVariableType.Position)
            velocity = self.mbs.GetNodeOutput(node, exudyn.OutputVariableType.Velocity)
            states.append([*position, *velocity, *spin])
        return states


class ExudynStock(ExudynBodies):
    """An engine of `hcbench_cases`: Exudyn with nothing chosen."""

    name = "exudyn-stock"

    def make(self, world: dict[str, Any]) -> None:
        raise NotImplementedError("has no contact until a contactStiffness is chosen")


ENGINES = [ExudynBodies, ExudynStock]
