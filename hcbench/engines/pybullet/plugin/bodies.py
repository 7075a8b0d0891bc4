"""How PyBullet's bodies move: velocities of points, and the inverse mass that a contact feels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench.engines.pybullet.plugin.vectors import Vector, along, cross, dot, turned_back, vector
from hcbench.errors import SettingError

# How a unit force at a contact acts on a body: what it is along each degree of freedom, and M^-1 times that.
Row = tuple[Sequence[float], Sequence[float]]


@dataclass
class Body:
    """One body of a client, all its links: fixed, free (one rigid body) or jointed.

    `refresh` reads its state, once a step.
    """

    bullet: Any
    client: int
    number: int

    def __post_init__(self) -> None:
        joints = range(self.bullet.getNumJoints(self.number, physicsClientId=self.client))
        self.joints = [j for j in joints if self._joint(j)[3] > -1]  # their index in q
        self.links = len(joints)
        info = self._dynamics(-1)
        self.floats = info[0] > 0.0
        self.mass, self.inertia = info[0], info[2]
        self.kind = (
            "jointed" if self.joints or (self.floats and self.links) else "free" if self.floats else "fixed"
        )
        self.refresh()

    def _joint(self, joint: int) -> Any:
        return self.bullet.getJointInfo(self.number, joint, physicsClientId=self.client)

    def _dynamics(self, link: int) -> Any:
        return self.bullet.getDynamicsInfo(self.number, link, physicsClientId=self.client)

    def refresh(self) -> None:
        """Read position and velocity of the base, and the joints where there are any."""
        where, turn = self.bullet.getBasePositionAndOrientation(self.number, physicsClientId=self.client)
        self.position, self.quaternion = where, turn
        self.velocity, self.spin = self.bullet.getBaseVelocity(self.number, physicsClientId=self.client)
        self._mass_matrix: Any = None

    def check_link(self, link: int) -> None:
        """SettingError for a link that the body does not have."""
        if not -1 <= link < self.links:
            raise SettingError(
                f"link {link} of body {self.number}", "not there", f"-1 (base) to {self.links - 1}"
            )

    def pose(self, link: int) -> tuple[Vector, Sequence[float]]:
        """Position and quaternion of a link's centre of mass frame."""
        if link < 0:
            return vector(self.position), self.quaternion
        state = self._link_state(link)
        return vector(state[0]), state[1]

    def _link_state(self, link: int) -> Any:
        return self.bullet.getLinkState(
            self.number, link, computeLinkVelocity=1, computeForwardKinematics=1, physicsClientId=self.client
        )

    def velocity_at(self, link: int, point: Vector) -> Vector:
        """Velocity of a link's material point, m/s."""
        if self.kind == "fixed":
            return 0.0, 0.0, 0.0
        if link < 0:
            where, v, w = self.position, self.velocity, self.spin
        else:
            state = self._link_state(link)
            where, v, w = state[0], state[6], state[7]
        return along(v, 1.0, cross(w, along(point, -1.0, where)))

    def speed(self, link: int) -> float:
        """A bound of the speed of the link's surface, m/s."""
        if self.kind == "fixed":
            return 0.0
        low, high = self.bullet.getAABB(self.number, link, physicsClientId=self.client)
        v = self.velocity_at(link, vector([0.5 * (a + b) for a, b in zip(low, high, strict=True)]))
        spin = self.spin if link < 0 else self._link_state(link)[7]
        size = along(high, -1.0, low)
        return float(dot(v, v) ** 0.5 + 0.5 * (dot(spin, spin) * dot(size, size)) ** 0.5)

    def row(self, link: int, point: Vector, direction: Vector) -> Row | None:
        """What a unit force at `point` along `direction` does; None for a body that cannot move."""
        if self.kind == "fixed":
            return None
        if self.kind == "free":
            return self._free_row(point, direction)
        return self._jointed_row(link, point, direction)

    def _free_row(self, point: Vector, direction: Vector) -> Row:
        torque = turned_back(self.quaternion, cross(along(point, -1.0, self.position), direction))
        m, inertia = self.mass, self.inertia
        solved = [part / m for part in direction]
        solved += [part / i if i > 0.0 else 0.0 for part, i in zip(torque, inertia, strict=True)]
        return (*direction, *torque), solved

    def _jointed_row(self, link: int, point: Vector, direction: Vector) -> Row:
        """By PyBullet's mass matrix and Jacobian: in the base's frame, its spin before its velocity."""
        angles = [
            self.bullet.getJointState(self.number, j, physicsClientId=self.client)[0] for j in self.joints
        ]
        if self._mass_matrix is None:
            self._mass_matrix = np.array(
                self.bullet.calculateMassMatrix(self.number, angles, physicsClientId=self.client)
            )
        size = len(self._mass_matrix)
        force = np.array(turned_back(self.quaternion, direction))
        if link < 0:
            arm = turned_back(self.quaternion, along(point, -1.0, self.position))
            row = np.zeros(size)
            if self.floats:
                row[:3], row[3:6] = np.cross(arm, force), force
        else:
            frame = self._link_state(link)
            local = turned_back(frame[5], along(point, -1.0, frame[4]))
            zero = [0.0] * len(angles)
            jacobian = self.bullet.calculateJacobian(
                self.number, link, list(local), angles, zero, zero, physicsClientId=self.client
            )[0]
            row = force @ np.array(jacobian).reshape(3, -1)
        solved = np.linalg.solve(self._mass_matrix, row)
        return row.tolist(), solved.tolist()

    def push(self, link: int, point: Vector, force: Vector) -> None:
        """Add a force for the step that comes next."""
        if self.kind != "fixed":
            self.bullet.applyExternalForce(
                self.number, link, force, point, self.bullet.WORLD_FRAME, physicsClientId=self.client
            )


def product(row: Row | None, other: Row | None) -> float:
    """Acceleration along one row by a unit force along another of the same body."""
    if row is None or other is None:
        return 0.0
    return float(sum(a * b for a, b in zip(row[0], other[1], strict=True)))
