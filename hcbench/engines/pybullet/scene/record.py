"""Penetration, rate and force of balls in PyBullet, from their positions and velocities.

Of several balls only the velocity is needed, as a query from Python costs as much as a step.
Positions follow exactly, as Bullet moves a body by its new velocity times the step. Forces are
what they do to the momentum, equal to Bullet's to rounding, where nothing else slows a ball;
else they are read from Bullet.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hcbench.sim.tangential import rows_of_ball
from hcbench.sim.world import momentum_force

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene


def overlap(scene: Scene, position: Floats, velocity: Floats) -> tuple[Floats, Floats, Floats]:
    """Penetration, m, its rate, m/s, and the unit vector that leads deeper: no mesh, no engine.

    position, velocity: the ball's, m and m/s, shape (..., 3).
    """
    radius = scene.touch_radius
    down = np.array([0.0, 0.0, -1.0])
    # Below the lowest point of the plate, or of the cup.
    depth = radius - position[..., 2]
    falling = -velocity[..., 2]
    if scene.form == "plane":
        return depth, falling, down
    bowl = -scene.plate_radius
    # From the centre of curvature.
    away = position - np.array([0.0, 0.0, bowl])
    x = away[..., 0]
    y = away[..., 1]
    z = away[..., 2]
    distance = np.sqrt(x * x + y * y + z * z)
    # At the centre itself there is no direction outwards.
    with np.errstate(all="ignore"):
        out = (x * velocity[..., 0] + y * velocity[..., 1] + z * velocity[..., 2]) / distance
        deeper = np.where(z[..., None] >= 0.0, down, away / distance[..., None])
    # Above the centre: height over the lowest point.
    is_above = z >= 0.0
    penetration = np.where(is_above, depth, distance - (bowl - radius))
    rate = np.where(is_above, falling, out)
    return penetration, rate, deeper


def tangential_rows(scene: Scene, timestep: float, motion: Floats, deeper: Floats) -> Floats:
    """Motion along the plate in each step, (8, b, n): slip 2 m/s, spin 3 rad/s,
    friction 2 N, other energy J.

    timestep: s.
    motion: velocity and spin before all steps and after each, (n + 1, b, 2, 3).
    deeper: unit vectors into the plate, (..., 3).
    """
    velocity = motion[:-1, :, 0]
    spin = motion[:-1, :, 1]
    # The contact's part of the acceleration alone, m/s².
    gained = np.diff(motion[:, :, 0], axis=0) / timestep + [0.0, 0.0, scene.gravity]
    vectors = (velocity, spin, np.broadcast_to(deeper, velocity.shape), gained)
    return rows_of_ball(scene, *(vector.swapaxes(0, 1) for vector in vectors))


def force_from_momentum(scene: Scene, timestep: float, velocity: Floats, deeper: Floats) -> Floats:
    """Normal force of each step, N, shape (n, b), from velocities of shape (n + 1, b, 3); exactly 0
    where the contact did not act.
    """
    fall = scene.gravity * timestep
    gained = np.diff(velocity, axis=0)
    gained[..., 2] += fall
    slowed = -(gained * deeper).sum(axis=-1)
    speed = np.abs(velocity).sum(axis=-1)
    return momentum_force(scene.mass, timestep, slowed, speed[:-1] + speed[1:] + fall)
