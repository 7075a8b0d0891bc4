"""PyBullet: one launch of a placed pair, stepped as the user's own loop would step it.

A step first finds contacts at the positions it starts from, then solves for velocities, then moves. So the
contacts read after it carry its force and belong to the state before it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.pybullet.place import Placement, moves, shift_base
from hcbench.impact import Impact, Launch, Status
from hcbench.sim.recorder import MAX_STEPS, Track, patience

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.pybullet.user_model import Bullet, Side
    from hcbench.impact import Floats

_STALE = 0.05  # of a reported force: less change of momentum than this, and it was not applied
_HIDDEN = 1e-6  # of the speed: a change in a step of substeps that only a contact explains


class Flight:
    """Flies launches from a saved state; the world is back in it afterwards."""

    def __init__(self, bullet: Bullet, place: Placement, timestep: float, gravity: Floats) -> None:
        self.bullet, self.place, self.timestep = bullet, place, timestep
        self.free = float((gravity * place.normal).sum()) if self._falls_alone() else 0.0
        self.substeps = int(bullet.getPhysicsEngineParameters()["numSubSteps"]) > 1
        self.sides = [
            (side, sign, moves(bullet, side)) for side, sign in ((place.first, 1.0), (place.second, -1.0))
        ]
        self.state = bullet.saveState()

    def close(self) -> None:
        """Back to the start, nothing kept."""
        self.bullet.restoreState(self.state)
        self.bullet.removeState(self.state)

    def _falls_alone(self) -> bool:
        """Whether gravity makes the two approach: not when both fall."""
        masses = [self.bullet.getDynamicsInfo(s.body, -1)[0] for s in (self.place.first, self.place.second)]
        return self.place.mover.joint is None and min(masses) == 0.0

    def fly(self, launch: Launch) -> Impact:
        """One impact, as the engine makes it."""
        gap = launch.gap(self.timestep)
        self._launch(launch.speed, gap)
        track = Track(self.timestep, fall=abs(self.free) * self.timestep)
        wait = patience(launch.speed, gap, launch.height is not None, self.timestep, abs(self.free))
        x, point, normal = -gap, self.place.point.tolist(), self.place.normal.tolist()
        before = self._rate(point, normal)
        for step in range(MAX_STEPS):
            self.bullet.stepSimulation()
            found = self._read()
            if found is not None:
                x, force, point = found
            else:
                force, x = 0.0, min(x, 0.0) if track.touched >= 0 else x
            after = self._rate(point, normal)
            if not math.isfinite(after):
                track.verdict, track.reason = Status.DIVERGED, "velocity is not finite"
                break
            force = self._applied(force, before, after, x)
            track.penetration.append(x)
            track.rate.append(before)
            track.force.append(force)
            if force != 0.0 and track.touched < 0:
                track.touched = step
            if track.is_over(wait):
                break
            x += self.timestep * after
            before = after
        else:
            track.give_up()
        return track.impact(launch)

    def _applied(self, force: float, before: float, after: float, x: float) -> float:
        """The force that acted in the step: contacts out of reach still report that of an earlier one."""
        mass = self.place.effective_mass
        if not math.isfinite(mass):
            return force
        mean = mass * ((before - after) / self.timestep + self.free)
        if force != 0.0 and x < 0.0 and abs(mean) < _STALE * abs(force):
            return 0.0
        if force == 0.0 and self.substeps and abs(mean) * self.timestep > _HIDDEN * mass * abs(before):
            return mean
        return force

    def _launch(self, speed: float, gap: float) -> None:
        bullet, place = self.bullet, self.place
        bullet.restoreState(self.state)
        mover = place.mover
        if mover.joint is None:
            shift_base(bullet, mover.body, np.array([0.0, 0.0, place.lift]))
            shift_base(bullet, mover.body, mover.direction * (place.offset - gap))
            bullet.resetBaseVelocity(mover.body, (mover.direction * speed).tolist(), [0.0, 0.0, 0.0])
            return
        start = bullet.getJointState(mover.body, mover.joint)[0] + place.offset
        per_metre = mover.sign / place.rate
        bullet.resetJointState(mover.body, mover.joint, start - per_metre * gap, per_metre * speed)

    def _read(self) -> tuple[float, float, Sequence[float]] | None:
        """(penetration at the step's start, force of the step, point); None without a contact."""
        first, second = self.place.first, self.place.second
        contacts = self.bullet.getContactPoints(first.body, second.body, first.link, second.link)
        if not contacts:
            return None
        count = 2 * len(contacts)
        middle = [sum(c[5][k] + c[6][k] for c in contacts) / count for k in range(3)]
        return -min(c[8] for c in contacts), sum(c[9] for c in contacts), middle

    def _rate(self, point: Sequence[float], normal: Sequence[float]) -> float:
        """Approach rate of the two along the normal, m/s."""
        return sum(
            sign * _along(normal, *self._motion(side), point) for side, sign, moves in self.sides if moves
        )

    def _motion(self, side: Side) -> tuple[Sequence[float], Sequence[float], Sequence[float]]:
        """(centre, velocity, angular velocity) of the side's link."""
        bullet = self.bullet
        if side.link == -1:
            centre = bullet.getBasePositionAndOrientation(side.body)[0]
            linear, turning = bullet.getBaseVelocity(side.body)
            return centre, linear, turning
        state = bullet.getLinkState(side.body, side.link, computeLinkVelocity=1)
        return state[0], state[6], state[7]


def _along(
    normal: Sequence[float],
    centre: Sequence[float],
    linear: Sequence[float],
    turning: Sequence[float],
    point: Sequence[float],
) -> float:
    """n · (v + ω x (point - centre)); plain floats, as this is asked for at every step."""
    x, y, z = (point[k] - centre[k] for k in range(3))
    wx, wy, wz = turning
    return (
        normal[0] * (linear[0] + wy * z - wz * y)
        + normal[1] * (linear[1] + wz * x - wx * z)
        + normal[2] * (linear[2] + wx * y - wy * x)
    )
