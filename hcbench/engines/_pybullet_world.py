"""Flies launches in PyBullet. Runs in a process that hcbench owns, never in the user's.

What PyBullet does and when (version 3.2): a step first finds contacts at the positions it starts from, then
solves for velocities, then moves. So contacts read after a step carry the force of that step, and belong to
the state before it; that normalForce is m Δv / dt to rounding.
"""

from __future__ import annotations

import math
from contextlib import chdir, contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines import isolation
from hcbench.errors import EngineFailed, SceneError
from hcbench.impact import Trajectory, impact_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from hcbench.engines._pybullet_options import Options
    from hcbench.impact import Impact, Launch
    from hcbench.scene import Scene

    Gap = Callable[[Sequence[float], Sequence[float]], tuple[float, float]]

# These outlive resetSimulation, and the first one the client too: Bullet's own values, set for each run.
_GLOBALS = {"contactBreakingThreshold": 0.02, "numSubSteps": 0, "enableFileCaching": 0}

# How long a body may stay in contact before it counts as resting there.
_CONTACT_S = 0.25
_CONTACT_STEPS_MIN, _CONTACT_STEPS = 500, 20_000
# Or sooner, after so many steps below this part of its speed: a bounce turns around in fewer.
_STILL_STEPS, _AT_REST = 50, 1e-4
_SLOWEST = 1e-3  # m/s: for a body let down on the plate, a plug-in's step is judged at this speed
_FAR = 10.0  # m: a place without contacts
_SHAPE_TOLERANCE = 1e-6  # m, between the overlap that Bullet sees and the scene's


def fly_here(launches: Sequence[Launch], scene: Scene, timestep: float, options: Options) -> Iterator[Impact]:
    """One impact for each launch, in order. Raises SceneError, and EngineFailed where PyBullet refuses."""
    fastest = max((launch.speed for launch in launches), default=0.0)
    with _world(scene, timestep, options, fastest) as world:
        for launch in launches:
            with isolation.quiet():
                world.release(launch)
                trajectory = world.trajectory(*_patience(launch, scene, timestep))
            yield impact_of(launch, trajectory)


def follow_here(
    scene: Scene, timestep: float, options: Options, launch: Launch, steps: int
) -> Iterator[Trajectory]:
    """All of `steps` steps after one launch. Raises as `fly_here` does."""
    with _world(scene, timestep, options, launch.speed) as world, isolation.quiet():
        world.release(launch)
        yield world.trajectory(steps)


def _patience(launch: Launch, scene: Scene, timestep: float) -> tuple[int, float]:
    """For one impact: steps enough for the flight and any sensible contact, and the speed that is rest."""
    gap = launch.gap(timestep)
    speed = math.sqrt(launch.speed**2 + 2.0 * scene.gravity * gap)  # at touch
    flight = 2.0 * gap / (launch.speed + speed)
    contact = max(_CONTACT_STEPS_MIN, min(math.ceil(_CONTACT_S / timestep), _CONTACT_STEPS))
    return math.ceil(1.5 * flight / timestep) + contact, _AT_REST * speed


@contextmanager
def _world(scene: Scene, timestep: float, options: Options, speed: float) -> Iterator[World]:
    assert isolation.in_worker(), "PyBullet's settings are global: they would leak into the user's own"
    with isolation.quiet():
        bullet = _client()
    try:
        with isolation.quiet():
            ball, plate = _set_up(bullet, scene, timestep, options)
        with _stepping(bullet, scene, options, ball, plate, speed) as step:
            yield World(bullet, scene, timestep, ball, step)
    except bullet.error as error:
        raise EngineFailed("pybullet", str(error), "") from error


@contextmanager
def _stepping(
    bullet: Any, scene: Scene, options: Options, ball: int, plate: int, speed: float
) -> Iterator[Callable[[], float]]:
    """One step of the world, and the normal force that acted in it, N: Bullet's contact, or a plug-in's."""
    if options.law is not None:
        from hcbench.contact import pybullet as contact

        gap = None
        if scene.form == "cup":
            gap = contact.cup(scene.ball_radius, -scene.plate_radius, (0.0, 0.0, -scene.plate_radius))
        with contact.attach([(ball, plate)], options.law, gap=gap, speed=max(speed, _SLOWEST)) as law:
            yield lambda: sum(touch.force for touch in law.step())
        return
    parts = (options.ball, options.plate)
    reach = min(part.get("contactProcessingThreshold", math.inf) for part in parts)

    def step() -> float:
        bullet.stepSimulation()
        # A contact out of reach was not solved for; it still says the force of when it last was.
        return sum(contact[9] for contact in bullet.getContactPoints(ball, plate) if contact[8] <= reach)

    yield step


def _set_up(bullet: Any, scene: Scene, timestep: float, options: Options) -> tuple[int, int]:
    """An empty world, the two bodies in it, and the options on them; the bodies' ids."""
    bullet.resetSimulation()
    bullet.setPhysicsEngineParameter(fixedTimeStep=timestep, **{**_GLOBALS, **options.world})
    bullet.setGravity(0.0, 0.0, -scene.gravity)
    ball = _load(bullet, scene, "ball", options.maximal_coordinates)
    plate = _load(bullet, scene, "plate", options.maximal_coordinates)
    _check_shapes(bullet, scene, ball, plate)
    if bullet.getDynamicsInfo(ball, -1)[0] != scene.mass:
        bullet.changeDynamics(ball, -1, mass=scene.mass)
    bullet.changeDynamics(ball, -1, **options.ball)
    bullet.changeDynamics(plate, -1, **options.plate)
    return ball, plate


@cache
def _client() -> Any:
    """The module, connected: one client for the life of this process."""
    import pybullet  # prints on import

    if pybullet.connect(pybullet.DIRECT) < 0:
        raise EngineFailed("pybullet", "no client could be connected", "")
    return pybullet


def _load(bullet: Any, scene: Scene, role: str, maximal: bool) -> int:
    try:
        path: Path = scene.models["pybullet"][role].resolve()
    except KeyError:
        raise SceneError(
            f"scene {scene.name!r}", f"no PyBullet model for the {role}", "a URDF file for it"
        ) from None
    if not path.is_file():
        raise SceneError(f"scene {scene.name!r}", f"{path} does not exist", f"the URDF of the {role}")
    try:
        # Bullet looks for a mesh in the working directory first, and only then beside the URDF.
        with chdir(path.parent):
            return int(bullet.loadURDF(path.name, useMaximalCoordinates=maximal))
    except bullet.error as error:
        raise SceneError(f"scene {scene.name!r}", f"{path}: {error}", "a URDF that PyBullet loads") from None


def _check_shapes(bullet: Any, scene: Scene, ball: int, plate: int) -> None:
    """Bullet must see the overlap that the scene says: radii, frames and meshes are right then."""
    overlap = 1e-5
    _place(bullet, ball, _radius(scene) - overlap)
    seen = [-point[8] for point in bullet.getClosestPoints(ball, plate, 0.0)]
    if not seen or abs(max(seen) - overlap) > _SHAPE_TOLERANCE:
        found = f"{max(seen):.3e} m" if seen else "none"
        raise SceneError(
            f"scene {scene.name!r}",
            f"the URDFs of ball and plate overlap by {found} where the scene says {overlap:g} m",
            f"the ball to touch with its centre at z = {_radius(scene)!r} m",
        )


def _place(bullet: Any, ball: int, height: float) -> None:
    bullet.resetBasePositionAndOrientation(ball, [0.0, 0.0, height], [0.0, 0.0, 0.0, 1.0])


def _radius(scene: Scene) -> float:
    """Height of the ball's centre over the plate's lowest point at touch, m."""
    return scene.ball_radius if scene.form == "cup" else scene.relative_radius


def _overlap(scene: Scene) -> Gap:
    """Penetration and its rate from the ball's position and velocity, exactly: no mesh, no engine."""
    radius = _radius(scene)
    if scene.form == "plane":
        return lambda position, velocity: (radius - position[2], -velocity[2])
    bowl = -scene.plate_radius

    def in_bowl(position: Sequence[float], velocity: Sequence[float]) -> tuple[float, float]:
        x, y, z = position[0], position[1], position[2] - bowl  # from the bowl's centre of curvature
        away = math.sqrt(x * x + y * y + z * z)
        if z >= 0.0:  # above it: height over the lowest point
            return radius - position[2], -velocity[2]
        return away - (bowl - radius), (x * velocity[0] + y * velocity[1] + z * velocity[2]) / away

    return in_bowl


@dataclass(frozen=True, slots=True)
class World:
    """A ball and a plate, set up, in the client of this process."""

    bullet: Any
    scene: Scene
    timestep: float
    ball: int
    step: Callable[[], float]

    def release(self, launch: Launch) -> None:
        """Put the ball where the launch starts, with nothing remembered."""
        # Contacts are kept from step to step, and with them forces: shed those of the launch before.
        _place(self.bullet, self.ball, _FAR)
        self.bullet.performCollisionDetection()
        _place(self.bullet, self.ball, _radius(self.scene) + launch.gap(self.timestep))
        self.bullet.resetBaseVelocity(self.ball, [0.0, 0.0, -launch.speed], [0.0, 0.0, 0.0])

    def trajectory(self, steps: int, rest_speed: float | None = None) -> Trajectory:
        """Step `steps` times; with a `rest_speed` (m/s) until the ball has parted or rests, if sooner."""
        record = self._record(steps, rest_speed)
        time = np.arange(len(record), dtype=np.float64) * self.timestep
        return Trajectory(time, *np.array(record, dtype=np.float64).T)

    def _record(self, steps: int, rest_speed: float | None) -> list[tuple[float, float, float]]:
        """(penetration, rate, force) of each step."""
        ball, overlap, step = self.ball, _overlap(self.scene), self.step
        place, motion = self.bullet.getBasePositionAndOrientation, self.bullet.getBaseVelocity
        record = []
        touched, still = False, 0
        for _ in range(steps):
            x, v = overlap(place(ball)[0], motion(ball)[0])
            force = step()
            record.append((x, v, force))
            if rest_speed is None:
                continue
            if force != 0.0:
                touched = True
            elif touched and x <= 0.0 and v < 0.0:
                break
            still = still + 1 if touched and abs(v) <= rest_speed else 0
            if still == _STILL_STEPS or not math.isfinite(x):
                break
        return record
