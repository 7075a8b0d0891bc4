"""Flies launches in PyBullet, several balls in one world, each with the bits it has alone.

Balls are kept from colliding with each other, and Bullet's solver works on each contact by itself; that the
bits are the same is not promised by Bullet, but held by tests of every setting and form. Little is asked in a
step: each ball's velocity, as asking costs as much as stepping. Positions follow exactly, as Bullet moves a
body by its new velocity times the step; each stretch of steps ends by asking whether it did. Forces are what
they do to the momentum, Bullet's own to rounding, where nothing else slows a ball; else they are asked for.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.errors import SettingError
from hcbench.impact import Impact, Status, Trajectory, impacts_of
from hcbench.laws import closed_form
from hcbench.sim.stop import Watch

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hcbench.engines.pybullet.world import World
    from hcbench.impact import Floats, Launch
    from hcbench.scene import Scene

# How long a body may stay in contact before it counts as resting there.
_CONTACT_S = 0.25
_CONTACT_STEPS_MIN, _CONTACT_STEPS = 500, 20_000
_LONGEST = 8.0  # times the elastic contact of the scene's law
# Or sooner, after so many steps below this part of its speed: a bounce turns around in fewer.
_STILL_STEPS, _AT_REST = 50, 1e-4
_SHORT = 8  # steps in the shortest stretch
_THROUGH = "went through the plate: deeper than its own radius"
_ROUND_OFF = 16 * np.finfo(float).eps  # of what a step adds up: a smaller change of velocity is no force


def fly(world: World, launches: Sequence[Launch], expected: int = 0) -> tuple[list[Impact], int]:
    """One impact for each launch, no more of them than the world has balls, and how many steps that took.

    expected: as many as it probably takes.
    """
    world.release(launches)
    flight = _Flight(world, launches)
    if flight.land(expected):
        return flight.impacts(), flight.longest
    if len(launches) > 1:  # something is not finite, and who knows what else that has touched
        return [fly(world, [launch])[0][0] for launch in launches], expected
    world.release(launches)
    flight = _Flight(world, launches, ask=True)
    flight.land(expected)
    return flight.impacts(), flight.longest


def follow(world: World, launch: Launch, steps: int) -> Trajectory:
    """All of `steps` steps after one launch."""
    world.release([launch])
    ((x,), (v,), (f,)), _ = _Paths(world, [0], ask=True).go(steps)
    return Trajectory(np.arange(steps, dtype=np.float64) * world.timestep, x, v, f)


class _Flight:
    """Launches that fly side by side, from release until each has ended."""

    def __init__(self, world: World, launches: Sequence[Launch], ask: bool = False) -> None:
        self._world, self._launches, self._ask = world, launches, ask
        self._landed: dict[int, Impact] = {}
        self.longest = 0

    def impacts(self) -> list[Impact]:
        """One for each launch, in order."""
        return [self._landed[i] for i in range(len(self._launches))]

    def land(self, expected: int) -> bool:
        """Step until all have ended; False where positions are not what they should be."""
        watch = _watch(self._launches, self._world.scene, self._world.timestep)
        flying = np.arange(len(self._launches))
        paths = _Paths(self._world, flying.tolist(), self._ask)
        history: list[Floats] = []
        while flying.size:
            seen, as_moved = paths.go(
                max(_SHORT, watch.steps // 8) if watch.steps else max(_SHORT // 2, expected)
            )
            if not as_moved:
                return False
            history.append(seen)
            counts = watch.add(*seen)
            ended = counts > 0
            if ended.any():
                self.longest = int(counts.max())
                x, v, f = np.concatenate([chunk[:, ended] for chunk in history], axis=2)
                time = np.arange(x.shape[1], dtype=np.float64) * self._world.timestep
                which = flying[ended].tolist()
                found = impacts_of([self._launches[i] for i in which], time, x, v, f, counts[ended])
                self._landed.update(zip(which, map(self._checked, found), strict=True))
                flying, history = flying[~ended], [chunk[:, ~ended] for chunk in history]
                watch.keep(~ended)
                paths.keep(~ended)
        return True

    def _checked(self, impact: Impact) -> Impact:
        # Beyond, Bullet's broad phase loses sight of the contact, sooner or later by what else it looks at.
        through = impact.penetration_max > touching_height(self._world.scene)
        return Impact(impact.launch, Status.DIVERGED, _THROUGH) if through else impact


class _Paths:
    """Steps the world and records some of its balls; with `ask`, positions are read instead of worked out."""

    def __init__(self, world: World, balls: Sequence[int], ask: bool) -> None:
        self._world, self._ask = world, ask
        self._balls = np.array(balls)
        self._position, self._velocity = self._places(), self._motions()

    def _places(self) -> Floats:
        place = self._world.bullet.getBasePositionAndOrientation
        return np.array([place(self._world.balls[i])[0] for i in self._balls])

    def _motions(self) -> Floats:
        motion = self._world.bullet.getBaseVelocity
        return np.array([motion(self._world.balls[i])[0] for i in self._balls])

    def keep(self, which: NDArray[np.bool_]) -> None:
        """Record only these from now on."""
        self._balls, self._position, self._velocity = (
            part[which] for part in (self._balls, self._position, self._velocity)
        )

    def go(self, steps: int) -> tuple[Floats, bool]:
        """Penetration, rate and force at the start of each step, shape (3, b, steps), and whether the balls
        are now where their velocities have taken them.
        """
        told, moved, placed = self._step(steps)
        v = np.concatenate([self._velocity[None], np.reshape(moved, (steps, -1, 3))])
        if self._ask:
            p = np.concatenate([self._position[None], np.reshape(placed, (steps, -1, 3))])
        else:
            p = np.cumsum(np.concatenate([self._position[None], self._world.timestep * v[1:]]), axis=0)
        self._position, self._velocity = p[-1], v[-1]
        x, rate, deeper = overlap(self._world.scene, p[:-1], v[:-1])
        if self._world.told:
            force = np.reshape(np.array(told, dtype=np.float64), (steps, -1))[:, self._balls]
        else:
            force = _momentum(self._world.scene, self._world.timestep, v, deeper)
        return np.stack([x.T, rate.T, force.T]), self._ask or np.array_equal(self._places(), p[-1])

    def _step(self, steps: int) -> tuple[list[Any], list[float], list[float]]:
        """What each step told, and all velocities after each, and all positions where those are asked."""
        step, bullet = self._world.step, self._world.bullet
        place, motion = bullet.getBasePositionAndOrientation, bullet.getBaseVelocity
        balls = [self._world.balls[i] for i in self._balls]
        told: list[Any] = []
        velocities: list[float] = []
        positions: list[float] = []
        for _ in range(steps):
            told.append(step())
            for ball in balls:
                velocities += motion(ball)[0]
            if self._ask:
                for ball in balls:
                    positions += place(ball)[0]
        return told, velocities, positions


def _momentum(scene: Scene, timestep: float, velocity: Floats, deeper: Floats) -> Floats:
    """Normal force of each step, N, shape (n, b), from velocities of shape (n + 1, b, 3); exactly 0 where the
    contact did not act.
    """
    fall = scene.gravity * timestep
    gained = np.diff(velocity, axis=0)
    gained[..., 2] += fall
    slowed = -(gained * deeper).sum(axis=-1)
    speed = np.abs(velocity).sum(axis=-1)
    noise = _ROUND_OFF * (speed[:-1] + speed[1:] + fall)
    return np.asarray(scene.mass * np.where(np.abs(slowed) <= noise, 0.0, slowed / timestep))


def overlap(scene: Scene, position: Floats, velocity: Floats) -> tuple[Floats, Floats, Floats]:
    """Penetration, its rate, and the unit vector that leads deeper: no mesh, no engine.

    position, velocity: the ball's, shape (..., 3).
    """
    radius = touching_height(scene)
    above, falling, down = radius - position[..., 2], -velocity[..., 2], np.array([0.0, 0.0, -1.0])
    if scene.form == "plane":
        return above, falling, down
    bowl = -scene.plate_radius
    away = position - np.array([0.0, 0.0, bowl])  # from the centre of curvature
    x, y, z = away[..., 0], away[..., 1], away[..., 2]
    distance = np.sqrt(x * x + y * y + z * z)
    with np.errstate(all="ignore"):  # at the centre itself there is no way out to speak of
        out = (x * velocity[..., 0] + y * velocity[..., 1] + z * velocity[..., 2]) / distance
        deeper = np.where(z[..., None] >= 0.0, down, away / distance[..., None])
    # Above the centre: height over the lowest point.
    return np.where(z >= 0.0, above, distance - (bowl - radius)), np.where(z >= 0.0, falling, out), deeper


def touching_height(scene: Scene) -> float:
    """Height of the ball's centre over the plate's lowest point at touch, m."""
    return scene.ball_radius if scene.form == "cup" else scene.relative_radius


def _watch(launches: Sequence[Launch], scene: Scene, timestep: float) -> Watch:
    """With patience for the flight and any sensible contact."""
    shortest = max(_CONTACT_STEPS_MIN, min(math.ceil(_CONTACT_S / timestep), _CONTACT_STEPS))
    patience, rest_speed = [], []
    for launch in launches:
        gap = launch.gap(timestep)
        speed = math.sqrt(launch.speed**2 + 2.0 * scene.gravity * gap)  # at touch
        if speed == 0.0:
            raise SettingError("speed", "0 m/s without gravity", "a speed above 0, or gravity to fall by")
        # However heavy and soft the scene is: a contact that is cut off would count as rest.
        elastic = closed_form.elastic_duration(scene.stiffness, scene.exponent, scene.mass, speed)
        contact = max(shortest, math.ceil(_LONGEST * elastic / timestep))
        patience.append(math.ceil(1.5 * 2.0 * gap / (launch.speed + speed) / timestep) + contact)
        rest_speed.append(_AT_REST * speed)
    return Watch.over(patience, rest_speed, _STILL_STEPS, deepest=touching_height(scene))
