"""PyBullet: one launch of a placed pair, stepped as the user's own loop would step it.

A step first finds contacts at the positions it starts from, then solves for velocities, then moves.
So the contacts read after it carry its force and belong to the state before it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.pybullet import plugin
from hcbench.engines.pybullet.backend import (
    DISTANCE,
    FORCE,
    LATERAL_FRICTION,
    NORMAL,
    POINT_A,
    POINT_B,
    BulletClient,
)
from hcbench.engines.pybullet.model.bodies import BulletBody, FreeBase, dot, rotate_inverse
from hcbench.engines.pybullet.model.place import BulletPlacement
from hcbench.sim.model_under_test import Vector
from hcbench.sim.tangential import plate_frame
from hcbench.sim.world import Record, Simulation
from hcbench.system.errors import UserError
from hcbench.terms.impact import FRICTION, SLIP, Floats, Launch

if TYPE_CHECKING:
    from hcbench.sim.world import Flags

# PyBullet: how a placed pair is sent along the plate, and what it does there.

# Places in a contact point of a friction force, N, and its direction; there are two.
FRICTIONS = ((10, 11), (12, 13))

# Distance along the plate, m, within which two points are of one fresh contact.
_SLID = 1e-6


def pair_friction(bullet: BulletClient, place: BulletPlacement) -> float:
    """Coulomb's μ of a pair: Bullet multiplies those of the two bodies."""
    first = bullet.getDynamicsInfo(place.first.body, place.first.link)[LATERAL_FRICTION]
    second = bullet.getDynamicsInfo(place.second.body, place.second.link)[LATERAL_FRICTION]
    return float(first * second)


def surface_point(contacts: Sequence[Any]) -> list[float]:
    """Mean point of a pair's contacts on the moving body, m, (3,).

    Contacts whose two points have slid apart, which Bullet keeps for a while, do not count; if all
    have, the one that slid least stands for them.

    contacts: as getContactPoints returns them, one or more, the moving body first.
    """

    def slid(contact: Any) -> float:
        """Distance of a contact's two points along the plate, m."""
        apart = np.subtract(contact[POINT_A], contact[POINT_B])
        normal = np.array(contact[NORMAL])
        return float(np.linalg.norm(apart - (apart @ normal) * normal))

    points = [contact[POINT_A] for contact in contacts if slid(contact) < _SLID]
    if not points:
        points = [min(contacts, key=slid)[POINT_A]]
    return [float(x) for x in np.mean(points, axis=0)]


class BulletAlongPlate:
    """One launch along the plate, of a body with a free base."""

    def __init__(
        self,
        bullet: BulletClient,
        place: BulletPlacement,
        launch: Launch,
        along: Vector | None,
        clearance: float,
    ) -> None:
        """Find the axes of the plate; `send` then starts the motion.

        place: where the pair touches, and what moves the first part.
        launch: with slip or spin.
        along: direction of the plate's first axis, in the world; None: x, or y where that is normal
        to the plate.
        clearance: from which the body starts, m.

        Raises UserError for a direction that is 0 or normal to the plate.
        """
        self.bullet = bullet
        self.place = place
        self.body = place.first.body
        self.axes = plate_frame(place.normal, along)
        self.slip = np.array([*launch.slip, 0.0])
        self.spin = np.array(launch.spin)
        self._clearance = clearance
        # The slip is the first part's velocity less the second's.
        self._sides = [(1.0, place.first), (-1.0, place.second)]
        self._bodies = {part.body: BulletBody(bullet, part.body) for _, part in self._sides}
        # Position of the body at the last contact, and before this step.
        self._seen = self._now = np.zeros(3)

    def send(self, flight_time: float) -> None:
        """Give the body, which `place` has launched along the normal, the slip and spin of the launch
        as well.

        It is put back by the way that it slides before it touches, so that it touches where it
        would without slip.

        flight_time: from release to touch, s.
        Raises UserError for a body without a free base.
        """
        bullet = self.bullet
        body = self.body
        mover = self.place.mover
        if not isinstance(mover, FreeBase) or body != mover.body:
            slot = "spin" if self.spin.any() else "angle"
            raise UserError(slot, mover.description, "a free base, to slide and spin")
        slide = self.slip @ self.axes
        spin = self.spin @ self.axes
        position, quaternion = bullet.getBasePositionAndOrientation(body)
        # At touch, as the contact point that is known beforehand is the one there.
        self._seen = np.array(position) + self.place.normal * self._clearance
        approach, _ = bullet.getBaseVelocity(body)
        velocity = np.array(approach) + slide
        back = np.array(position) - flight_time * slide
        bullet.resetBasePositionAndOrientation(body, back.tolist(), quaternion)
        bullet.resetBaseVelocity(body, velocity.tolist(), spin.tolist())

    def _position(self) -> Floats:
        return np.array(self.bullet.getBasePositionAndOrientation(self.body)[0])

    def moved_with(self, point: Sequence[float]) -> list[float]:
        """A contact point, m, (3,), moved by as much as the moving body since the last contact."""
        return [float(x) for x in np.array(point) + self._position() - self._seen]

    def motion(self, point: Sequence[float], rate: float) -> Floats:
        """The present motion along the plate, (8,), in the axes of the plate: slip, 2 numbers, m/s;
        spin, 3, rad/s; 2 zeros, for the friction that `friction` knows after the step; and the
        kinetic energy without that of the approach, J.

        point: of the contact, m, (3,).
        rate: of approach, m/s.
        """
        slip = np.zeros(3)
        spin = np.zeros(3)
        self._now = self._position()
        for sign, part in self._sides:
            body = self._bodies[part.body]
            body.refresh()
            slip += sign * np.array(body.velocity_at(part.link, point))
            spin += sign * np.array(body.spin_of(part.link))
        energy = sum(_kinetic_energy(body) for body in self._bodies.values())
        # Energy of the approach alone, J.
        normal = 0.5 * self.place.effective_mass * rate**2
        # Friction is known only after the step.
        no_friction = (0.0, 0.0)
        return np.array(
            [*(self.axes[:2] @ slip), *(self.axes @ spin), *no_friction, energy - normal]
        )

    def friction(self, contacts: Sequence[Any], slip: Floats) -> Floats:
        """Friction on the moving body in the step just taken, along the plate's axes, N, (2,).

        Also notes where the contact was seen, for `moved_with`.

        contacts: of that step, as getContactPoints returns them, one or more.
        slip: before the step, along the plate's axes, m/s, (2,).
        """
        self._seen = self._now
        # Each contact has two friction forces, N, along directions in the world.
        pushes = []
        for contact in contacts:
            pushes += [contact[force] * np.array(contact[way]) for force, way in FRICTIONS]
        pushed = self.axes[:2] @ np.sum(pushes, axis=0)
        # Bullet gives friction no sign, and friction never drives the slip.
        if pushed @ slip > 0.0:
            pushed = -pushed
        return np.asarray(pushed)


def _kinetic_energy(body: BulletBody) -> float:
    """Kinetic energy of a body with all its links, J, as of its last `refresh`; 0 for a fixed one."""
    if body.kind == "fixed":
        return 0.0
    energy = 0.0
    for link in range(-1, len(body.joints)):
        mass, _, inertia = body.bullet.getDynamicsInfo(body.number, link)[:3]
        centre, quaternion = body.pose(link)
        spin = np.array(rotate_inverse(quaternion, body.spin_of(link)))
        speed = np.array(body.velocity_at(link, centre))
        energy += 0.5 * mass * float(speed @ speed) + 0.5 * float(np.array(inertia) @ spin**2)
    return energy


# A reported force was not applied if the momentum changed by less than
# this share of what it would do.
_STALE = 0.05
# Distance within which PyBullet is asked for that of the two, m.
_SEEN = 1.0
# Change of the speed in a step of substeps, as a share, that only a contact explains.
_HIDDEN = 1e-6


class _Contact(NamedTuple):
    """The contacts of a step: penetration at its start, m; force in it, N; where they are, m."""

    penetration: float
    force: float
    point: Sequence[float]


class LaunchInUserWorld(Simulation):
    """One launch in the user's world as it is; nothing puts it back.

    bullet: client with the world, which the launch changes.
    gravity: along the normal, into the other body, m/s².
    along: the way that oblique launches take; None: along x or y.
    law: number of the plug-in's law between the two, whose force is none of Bullet's contact.

    Raises UserError for an oblique launch of a body without a free base.
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
        """Put the moving body where the launch begins, at the launch's speed, slip and spin.

        place: where the pair touches, and the mover.
        gravity: along the normal, into the other body, m/s².
        along: in the world, the plate's first axis of oblique launches; None: along x or y.
        law: number of the plug-in's law between the two; None without one.
        Raises UserError for an oblique launch of a body without a free base.
        """
        self.bullet = bullet
        self.place = place
        self.gravity = gravity
        self.law = law
        parameters = bullet.getPhysicsEngineParameters()
        self.timestep = float(parameters["fixedTimeStep"])
        self.substeps = int(parameters["numSubSteps"]) > 1
        self._moving = []
        for sign, part in ((1.0, place.first), (-1.0, place.second)):
            body = BulletBody(bullet, part.body)
            if body.kind != "fixed":
                self._moving.append((sign, body, part.link))
        clearance = launch.clearance_in_phase(self.timestep, gravity)
        place.launch(bullet, launch.speed, clearance)
        # Penetration now, m.
        self._x = -clearance
        self._touched = False
        # Where the two met last, m in the world.
        self._point: Sequence[float] = place.point.tolist()
        self._normal = place.normal.tolist()
        self._along = None
        if launch.is_oblique:
            self._along = BulletAlongPlate(bullet, place, launch, along, clearance)
            self._along.send(launch.flight_time(self.timestep, gravity))
        # Rate of the penetration before the next step, m/s.
        self._before = self._rate()

    def advance(self, steps: int) -> Record:
        """Take `steps` steps as the user's own loop would, and return what they did, with one launch.

        Where the velocity is no longer finite, the record ends earlier, with a step of NaN.
        """
        rows: list[tuple[float, ...]] = []
        is_finite = True
        while len(rows) < steps and is_finite:
            row = self._step()
            rows.append(row)
            _, rate, *_ = row
            is_finite = math.isfinite(rate)
        # (quantities, 1 launch, steps).
        seen = np.array(rows).T[:, None]
        x, v, f = seen[:3]
        if self._along is None:
            return Record(x, v, f, None)
        return Record(x, v, f, seen[3:])

    def keep(self, which: Flags) -> None:
        """Keep the one launch that there is."""

    def _step(self) -> tuple[float, ...]:
        """Take a step, and return one row of the record: penetration, m, and approach rate, m/s, before
        the step, and the force in it, N.

        The row of an oblique launch goes on with slip, 2 numbers, m/s; spin, 3, rad/s; friction, 2,
        N; and the kinetic energy without the approach's, J. All are NaN where the body's velocity
        is not finite after the step.
        """
        along = None
        point = self._contact_point()
        if self._along is not None:
            along = self._along.motion(point, self._before)
        if self.law is not None:
            self._x, nearest = self._gap()
            self._point = nearest if self.place.face is None else point
        self.bullet.stepSimulation()
        contact = self._read()
        if contact is not None and self._along is not None and along is not None:
            along[FRICTION] = self._along.friction(self._contacts(), along[SLIP])
        force = 0.0
        if self.law is not None:
            native = 0.0 if contact is None else contact.force
            force = native + plugin.force(self.law, client=self.bullet.client)
        elif contact is not None:
            self._x = contact.penetration
            force = contact.force
            # Bullet often pushes one point of a face, by how its search ended.
            self._point = contact.point if self.place.face is None else point
        elif self._touched:
            # Bullet reports no contact: the two do not overlap, whatever the summed rates say.
            self._x = min(self._x, 0.0)
        x = self._x
        before = self._before
        after = self._rate()
        tangential = () if along is None else tuple(along)
        if not math.isfinite(after):
            return (math.nan,) * (3 + len(tangential))
        force = self._applied(force, before, after, x)
        self._touched |= force != 0.0
        self._x = x + self.timestep * after
        self._before = after
        return (x, before, force, *tangential)

    def _applied(self, force: float, before: float, after: float, x: float) -> float:
        """The force that acted in the step just taken, N, which is not always the reported one.

        Contacts that are apart still report the force of an earlier step: 0 then. With substeps, a
        contact may begin and end within a step, and reports nothing: the mean force then, by the
        change of the speed.

        force: reported, N.
        before, after: approach rates, m/s.
        x: penetration before the step, m.
        """
        mass = self.place.effective_mass
        if not math.isfinite(mass):
            return force
        # Mean force in the step by the change of momentum, N.
        mean = mass * ((before - after) / self.timestep + self.gravity)
        if force != 0.0:
            is_stale = x < 0.0 and abs(mean) < _STALE * abs(force)
            return 0.0 if is_stale else force
        # With substeps, a contact may show in the speed alone.
        if self.substeps and abs(mean) * self.timestep > _HIDDEN * mass * abs(before):
            return mean
        return force

    def _read(self) -> _Contact | None:
        """All contacts of the pair in the step just taken as one; None without a contact.

        It has the deepest penetration, m, the sum of the forces, N, and the mean point, m: halfway
        between the surfaces, or of an oblique launch on the surface of the moving body.
        """
        contacts = self._contacts()
        if not contacts:
            return None
        if self._along is not None:
            point = surface_point(contacts)
        else:
            total = [0.0, 0.0, 0.0]
            for contact in contacts:
                on_first = contact[POINT_A]
                on_second = contact[POINT_B]
                for k in range(3):
                    total[k] += on_first[k] + on_second[k]
            count = 2 * len(contacts)
            point = [coordinate / count for coordinate in total]
        deepest = min(contact[DISTANCE] for contact in contacts)
        return _Contact(-deepest, sum(contact[FORCE] for contact in contacts), point)

    def _gap(self) -> tuple[float, Sequence[float]]:
        """Present penetration of the two shapes, m, and the point halfway between them, m, (3,).

        A force law's pair has no contacts to read them from. Both stay the last ones where the two
        are farther apart than _SEEN, m.
        """
        first = self.place.first
        second = self.place.second
        points = self.bullet.getClosestPoints(
            first.body, second.body, _SEEN, first.link, second.link
        )
        if not points:
            return self._x, self._point
        nearest = min(points, key=lambda point: float(point[DISTANCE]))
        ends = zip(nearest[POINT_A], nearest[POINT_B], strict=True)
        return -nearest[DISTANCE], [0.5 * (a + b) for a, b in ends]

    def _contacts(self) -> Sequence[Any]:
        """The contacts of the last step between the two, as PyBullet returns them."""
        first = self.place.first
        second = self.place.second
        contacts: Sequence[Any] = self.bullet.getContactPoints(
            first.body, second.body, first.link, second.link
        )
        return contacts

    def _contact_point(self) -> Sequence[float]:
        """Point of the last contact, m; moved along with a body that slides and spins."""
        if self._along is None:
            return self._point
        return self._along.moved_with(self._point)

    def _rate(self) -> float:
        """Present approach rate of the two along the normal, at the point of contact, m/s."""
        rate = 0.0
        point = self._contact_point()
        for sign, body, link in self._moving:
            body.refresh()
            rate += sign * dot(self._normal, body.velocity_at(link, point))
        return rate
