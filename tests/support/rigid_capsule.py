"""A rigid capsule that slides along its axis: Newton's e at its two ends, and Coulomb's friction.

In the plane of its axis and the vertical, by impulses, one end after the other; no code of hcbench.
"""

from __future__ import annotations

import math

import numpy as np

RADIUS, HALF = 0.03, 0.05
# Impulses of a step, at most.
_SWEEPS = 20
# Approach, m/s, that is none.
_STILL = 1e-12


class RigidCapsule:
    """A capsule of mass 1 kg on a plane, at 1 m/s along its axis.

    gain: of energy over what it began with, as a share of that.
    """

    def __init__(self, restitution: float, friction: float, gravity: float, tilt: float) -> None:
        """tilt: of its axis at the start, rad; its lower end touches the plane."""
        cylinder = math.pi * RADIUS**2 * 2 * HALF
        caps = 4 / 3 * math.pi * RADIUS**3
        share = cylinder / (cylinder + caps)
        of_cylinder = RADIUS**2 / 4 + HALF**2 / 3
        of_caps = 2 / 5 * RADIUS**2 + HALF**2 + 3 / 4 * HALF * RADIUS
        self.inertia = share * of_cylinder + (1 - share) * of_caps
        self.restitution, self.friction, self.gravity = restitution, friction, gravity
        self.height = abs(math.sin(tilt)) * HALF
        self.tilt = tilt
        # Along the plane, up, and the turn that lifts the front end, rad/s.
        self.velocity = np.array([1.0, 0.0, 0.0])
        self.gain = 0.0

    def highest(self, seconds: float, step: float) -> float:
        """The largest height, m, of its middle over where it lies flat, in so much time."""
        began = self._energy()
        highest = 0.0
        for _ in range(round(seconds / step)):
            self.velocity[1] -= self.gravity * step
            for _ in range(_SWEEPS):
                if not self._impact(2.0 * self.gravity * step):
                    break
            self.height += self.velocity[1] * step
            self.tilt += self.velocity[2] * step
            highest = max(highest, self.height)
            self.gain = max(self.gain, self._energy() / began - 1.0)
        return highest

    def _energy(self) -> float:
        moves = self.velocity[:2] @ self.velocity[:2] + self.inertia * self.velocity[2] ** 2
        return float(0.5 * moves + self.gravity * self.height)

    def _impact(self, resting: float) -> bool:
        """Apply the impulse at the end that meets the plane fastest; False where none does.

        resting: speed, m/s, up to which an end stays down.
        """
        fastest = -_STILL
        arm = np.zeros(2)
        for side in (1.0, -1.0):
            across = side * HALF * math.sin(self.tilt)
            along = side * HALF * math.cos(self.tilt)
            if (
                self.height + across <= 0.0
                and self.velocity[1] + along * self.velocity[2] < fastest
            ):
                fastest = self.velocity[1] + along * self.velocity[2]
                arm = np.array([along, across - RADIUS])
        if fastest == -_STILL:
            return False
        # Velocity of the point: along -> slip, up -> normal, for each of the three velocities.
        slip = np.array([1.0, 0.0, -arm[1]])
        normal = np.array([0.0, 1.0, arm[0]])
        inverse = np.array([1.0, 1.0, 1.0 / self.inertia])
        e = self.restitution if -fastest > resting else 0.0
        rows = np.array([normal, slip])
        wanted = -np.array([(1.0 + e) * fastest, slip @ self.velocity])
        push, rub = np.linalg.solve((rows * inverse) @ rows.T, wanted)
        if abs(rub) > self.friction * push:
            way = -math.copysign(self.friction, slip @ self.velocity)
            push = wanted[0] / ((normal * inverse) @ (normal + way * slip))
            rub = way * push
        self.velocity += inverse * (push * normal + rub * slip)
        return True
