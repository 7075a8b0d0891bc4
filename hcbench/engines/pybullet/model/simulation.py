"""PyBullet: one launch of a placed pair, stepped as the user's own loop would step it.

A step first finds contacts at the positions it starts from, then solves for velocities, then moves. So the
contacts read after it carry its force and belong to the state before it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.pybullet import plugin
from hcbench.engines.pybullet.model.bodies import BulletBody
from hcbench.engines.pybullet.model.sliding import BulletAlongPlate, surface_point
from hcbench.engines.pybullet.vectors import dot
from hcbench.sim.world import Record, Simulation
from hcbench.terms.impact import FRICTION, SLIP

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.pybullet.backend import BulletClient
    from hcbench.engines.pybullet.model.place import BulletPlacement
    from hcbench.sim.model_under_test import Vector
    from hcbench.sim.world import Flags
    from hcbench.terms.impact import Launch

# Of a reported force: less change of momentum than this, and it was not applied
_STALE = 0.05
_SEEN = 1.0  # m: how far apart the two may be and their distance be asked for
# Of the speed: a change in a step of substeps that only a contact explains
_HIDDEN = 1e-6


class LaunchInUserWorld(Simulation):
    """One launch in the user's world as it is; nothing puts it back.

    gravity: as a `World` has it, m/s². along: the way that oblique launches take. law: number of the
    plug-in's law between the two, whose force is none of Bullet's contact.
    """

    def __init__(
        self,
        bullet: BulletClient,
        place: BulletPlacement,
        launch: Launch,
        gravity: float,
        along: Vector | None = None,
        law: int | None = None,
    ) -> None:
        self.bullet, self.place, self.gravity, self.law = bullet, place, gravity, law
        parameters = bullet.getPhysicsEngineParameters()
        self.timestep = float(parameters["fixedTimeStep"])
        self.substeps = int(parameters["numSubSteps"]) > 1
        sides = ((1.0, place.first), (-1.0, place.second))
        bodies = [(sign, BulletBody(bullet, part.body), part.link) for sign, part in sides]
        self._moving = [each for each in bodies if each[1].kind != "fixed"]
        clearance = launch.clearance_in_phase(self.timestep, gravity)
        place.launch(bullet, launch.speed, clearance)
        self._x, self._touched, self._point = -clearance, False, place.point.tolist()
        self._normal = place.normal.tolist()
        self._along = BulletAlongPlate(bullet, place, launch, along, clearance) if launch.is_oblique else None
        if self._along is not None:
            self._along.send(launch.flight_time(self.timestep, gravity))
        self._before = self._rate()

    def advance(self, steps: int) -> Record:
        """`steps` steps as the user's own loop would take them."""
        rows: list[tuple[float, ...]] = []
        while len(rows) < steps and (not rows or math.isfinite(rows[-1][1])):
            rows.append(self._step())
        seen = np.array(rows).T[:, None]
        x, v, f = seen[:3]
        return Record(x, v, f, seen[3:] if self._along is not None else None)

    def keep(self, which: Flags) -> None:
        """Keep the one launch that there is."""

    def _step(self) -> tuple[float, ...]:
        along = None if self._along is None else self._along.motion(self._contact_point(), self._before)
        if self.law is not None:
            self._x, self._point = self._gap()
        self.bullet.stepSimulation()
        contact, force = self._read(), 0.0
        if contact is not None and self._along is not None and along is not None:
            along[FRICTION] = self._along.friction(self._contacts(), along[SLIP])
        if self.law is not None:
            native = 0.0 if contact is None else contact[1]
            force = native + plugin.force(self.law, client=self.bullet.client)
        elif contact is not None:
            self._x, force, self._point = contact
        elif self._touched:
            self._x = min(self._x, 0.0)
        after = self._rate()
        if not math.isfinite(after):
            return (math.nan,) * (3 if along is None else 3 + len(along))
        x, before = self._x, self._before
        force = self._applied(force, before, after, x)
        self._touched |= force != 0.0
        self._x, self._before = x + self.timestep * after, after
        return (x, before, force) if along is None else (x, before, force, *along)

    def _applied(self, force: float, before: float, after: float, x: float) -> float:
        """The force that acted in the step: contacts out of reach still report that of an earlier one."""
        mass = self.place.effective_mass
        if not math.isfinite(mass):
            return force
        mean = mass * ((before - after) / self.timestep + self.gravity)
        if force != 0.0 and x < 0.0 and abs(mean) < _STALE * abs(force):
            return 0.0
        if force == 0.0 and self.substeps and abs(mean) * self.timestep > _HIDDEN * mass * abs(before):
            return mean
        return force

    def _read(self) -> tuple[float, float, Sequence[float]] | None:
        """(penetration at the step's start, force of the step, point); None without a contact."""
        contacts = self._contacts()
        if not contacts:
            return None
        count = 2 * len(contacts)
        point = [sum(c[5][k] + c[6][k] for c in contacts) / count for k in range(3)]
        if self._along is not None:
            point = surface_point(contacts)
        return -min(c[8] for c in contacts), sum(c[9] for c in contacts), point

    def _gap(self) -> tuple[float, Sequence[float]]:
        """Penetration now and the point, of the shapes themselves: a force law's pair has no contacts."""
        first, second = self.place.first, self.place.second
        points = self.bullet.getClosestPoints(first.body, second.body, _SEEN, first.link, second.link)
        if not points:
            return self._x, self._point
        nearest = min(points, key=lambda point: float(point[8]))
        return -nearest[8], [0.5 * (a + b) for a, b in zip(nearest[5], nearest[6], strict=True)]

    def _contacts(self) -> Sequence[Any]:
        first, second = self.place.first, self.place.second
        contacts: Sequence[Any] = self.bullet.getContactPoints(
            first.body, second.body, first.link, second.link
        )
        return contacts

    def _contact_point(self) -> Sequence[float]:
        """Point of the last contact, m; moved along with a body that slides and spins."""
        return self._point if self._along is None else self._along.moved_with(self._point)

    def _rate(self) -> float:
        """Approach rate of the two along the normal, m/s."""
        rate, point = 0.0, self._contact_point()
        for sign, body, link in self._moving:
            body.refresh()
            rate += sign * dot(self._normal, body.velocity_at(link, point))
        return rate
