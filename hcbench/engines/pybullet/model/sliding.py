"""PyBullet: how a placed pair is sent along the plate, and what it does there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hcbench.engines.pybullet.backend import NORMAL, POINT_A, POINT_B, BulletClient
from hcbench.engines.pybullet.model.bodies import BulletBody, FreeBase
from hcbench.engines.pybullet.model.place import BulletPlacement
from hcbench.engines.pybullet.vectors import rotate_inverse
from hcbench.sim.model_under_test import Vector
from hcbench.sim.tangential import plate_frame
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats, Launch

# Place of lateralFriction in getDynamicsInfo.
_FRICTION = 1
# Places in a contact point of a friction force, N, and its direction; there are two.
_PUSHES = ((10, 11), (12, 13))

# Distance along the plate, m, within which two points are of one fresh contact.
_SLID = 1e-6


def pair_friction(bullet: BulletClient, place: BulletPlacement) -> float:
    """Coulomb's μ of the pair: Bullet multiplies those of the two."""
    one, two = (
        bullet.getDynamicsInfo(p.body, p.link)[_FRICTION] for p in (place.first, place.second)
    )
    return float(one * two)


def surface_point(contacts: Sequence[Any]) -> list[float]:
    """Mean point of the contacts on the moving body, m, without those that have
    slid apart, which Bullet keeps.
    """

    def slid(contact: Any) -> float:
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
        """clearance: from which the body starts, m."""
        self.bullet = bullet
        self.place = place
        self.body = place.first.body
        self.axes = plate_frame(place.normal, along)
        self.slip = np.array([*launch.slip, 0.0])
        self.spin = np.array(launch.spin)
        self._clearance = clearance
        self._sides = [(1.0, place.first), (-1.0, place.second)]
        self._bodies = {part.body: BulletBody(bullet, part.body) for _, part in self._sides}
        # Position of the body at the last contact, and before this step.
        self._seen = self._now = np.zeros(3)

    def send(self, flight_time: float) -> None:
        """Add slip and spin to the motion, and put the body back by what it slides in the flight.

        flight_time: from release to touch, s. Raises UserError for a body without a free base.
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
        """A contact point as the moving body has carried it along since it was seen."""
        return [float(x) for x in np.array(point) + self._position() - self._seen]

    def motion(self, point: Sequence[float], rate: float) -> Floats:
        """Slip 2 m/s, spin 3 rad/s, no friction (2 zeros) and energy without
        that of the approach, J; (8,).

        point: of the contact, m.
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
        """Friction on the moving body in the step after `motion`, with these contacts, N, (2,).

        Bullet tells it without its sign.
        """
        self._seen = self._now
        pushes = []
        for contact in contacts:
            pushes += [contact[force] * np.array(contact[way]) for force, way in _PUSHES]
        pushed = self.axes[:2] @ np.sum(pushes, axis=0)
        # Bullet gives friction no sign, and friction never drives the slip.
        if pushed @ slip > 0.0:
            pushed = -pushed
        return np.asarray(pushed)


def _kinetic_energy(body: BulletBody) -> float:
    """Kinetic energy of a body with all its links, J; 0 for a fixed one."""
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
