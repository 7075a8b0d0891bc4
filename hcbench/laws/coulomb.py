"""Coulomb's friction in the impact of a sphere: closed form, for every law of the normal force.

Friction acts at the contact point, against the way it slides, with μ times the normal force, until
it slides no more. A sphere's normal force turns and shifts nothing along the plate, so the
direction of sliding never changes, and the impulse of friction is the lesser of two: μ J_n of a
contact that slides to its end, and m_t s of one that sticks, with m_t = 1/(1/m + R²/I) the mass
that the slip s meets; 2/7 m for a solid sphere.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from hcbench.terms.impact import Tangential

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.terms.impact import Impact, Launch
    from hcbench.terms.scene import Scene

Pair = tuple[float, float]


def friction_impulse(slip: Sequence[float], normal_impulse: float, scene: Scene) -> Pair:
    """Impulse of friction on the ball along the plate, x and y, N s; against the slip, 0 without
    slip.

    slip: velocity of its contact point along the plate, x and y, m/s.
    normal_impulse: N s, 0 or more.
    scene: its mass, radius, inertia and friction coefficient count.
    """
    sticking = 1.0 / (1.0 / scene.mass + scene.touch_radius**2 / scene.inertia)
    speed = math.hypot(*slip)
    share = min(sticking, scene.friction * normal_impulse / speed) if speed > 0.0 else 0.0
    return -share * slip[0], -share * slip[1]


def coulomb_ratio(along: Tangential, scene: Scene) -> float:
    """Coulomb's value of `Tangential.impulse_ratio`, for the measured slip and normal impulse."""
    return (
        math.hypot(*friction_impulse(along.slip_in, along.normal_impulse, scene))
        / along.normal_impulse
    )


def tangential(impact: Impact, launch: Launch, scene: Scene) -> Tangential:
    """Motion along the plate by Coulomb's law, for an impact whose normal direction is known.

    impact: its speeds in and out and its duration count: with gravity they give the normal impulse.
    launch: its slip, the centre's velocity along the plate, m/s, and its spin, rad/s.
    scene: its mass, radius, inertia, friction and gravity.
    Vectors are in the plate's frame: x and y along it, z up. The contact point of a sphere that
    turns at (p, q, r) moves by (-R q, R p) against its centre.
    """
    m = scene.mass
    R = scene.touch_radius
    inertia = scene.inertia
    # Gravity pushes through the contact, too.
    J_n = m * (impact.speed_in + impact.speed_out + scene.gravity * impact.duration)
    # Velocity of the centre along the plate, and spin.
    u, v = launch.slip
    p, q, r = launch.spin
    slip = (u - R * q, v + R * p)
    J = friction_impulse(slip, J_n, scene)
    # The same after the impact.
    after = (u + J[0] / m, v + J[1] / m)
    spin = (p + R * J[1] / inertia, q - R * J[0] / inertia, r)

    def energy(normal: float, along: Sequence[float], turning: Sequence[float]) -> float:
        return 0.5 * m * math.hypot(normal, *along) ** 2 + 0.5 * inertia * math.hypot(*turning) ** 2

    return Tangential(
        slip_in=slip,
        slip_out=(after[0] - R * spin[1], after[1] + R * spin[0]),
        spin_in=launch.spin,
        spin_out=spin,
        impulse=J,
        normal_impulse=J_n,
        energy_in=energy(impact.speed_in, launch.slip, launch.spin),
        energy_out=energy(impact.speed_out, after, spin),
    )
