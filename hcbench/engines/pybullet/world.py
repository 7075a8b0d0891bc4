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

from hcbench.engines.pybullet import simulate
from hcbench.engines.pybullet.simulate import touching_height
from hcbench.engines.pybullet.urdf import check_ball, check_plate
from hcbench.errors import EngineFailed, SceneError
from hcbench.workers import in_worker, redirect_output

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

    from hcbench.engines.pybullet.options import Options
    from hcbench.impact import Impact, Launch, Trajectory
    from hcbench.scene import Scene

# These outlive resetSimulation, and the first one the client too: Bullet's own values, set for each run.
_GLOBALS = {"contactBreakingThreshold": 0.02, "numSubSteps": 0, "enableFileCaching": 0}

_SLOWEST = 1e-3  # m/s: for a body let down on the plate, a plug-in's step is judged at this speed
_FAR = 10.0  # m: a place without contacts
TOGETHER = 8  # balls in one world: more make Bullet's broad phase dear
_BALLS, _PLATE = 2, 1  # their groups in Bullet's collision filter
_SHAPE_TOLERANCE = 1e-6  # m, between the overlap that Bullet sees and the scene's


def fly_here(
    launches: Sequence[Launch], scene: Scene, timestep: float, options: Options, together: int = TOGETHER
) -> Iterator[Impact]:
    """One impact for each launch, in order, up to so many in one world.

    Raises SceneError, and EngineFailed where PyBullet refuses.
    """
    if options.law is not None:
        together = 1  # a plug-in looks at one pair
    groups = max(1, math.ceil(len(launches) / together))
    share = max(1, math.ceil(len(launches) / groups))
    fastest = max((launch.speed for launch in launches), default=0.0)
    with _world(scene, timestep, options, fastest, min(share, len(launches))) as world:
        steps = 0
        for i in range(0, len(launches), share):
            with redirect_output():
                found, steps = simulate.fly(world, launches[i : i + share], steps)
            yield from found


def follow_here(scene: Scene, timestep: float, options: Options, launch: Launch, steps: int) -> Trajectory:
    """All of `steps` steps after one launch. Raises as `fly_here` does."""
    with _world(scene, timestep, options, launch.speed) as world, redirect_output():
        return simulate.follow(world, launch, steps)


@contextmanager
def _world(scene: Scene, timestep: float, options: Options, speed: float, balls: int = 1) -> Iterator[World]:
    assert in_worker(), "PyBullet's settings are global: they would leak into the user's own"
    with redirect_output():
        bullet = _client()
    try:
        with redirect_output():
            ball, plate = _set_up(bullet, scene, timestep, options)
            own = (ball, *_company(bullet, scene, options, ball, plate, balls - 1))
        with _stepping(bullet, scene, options, own, plate, speed) as step:
            yield World(bullet, scene, timestep, own, step, told=not _is_lossless(options))
    except bullet.error as error:
        raise EngineFailed("pybullet", str(error), "") from error


@contextmanager
def _stepping(
    bullet: Any, scene: Scene, options: Options, balls: Sequence[int], plate: int, speed: float
) -> Iterator[Callable[[], Sequence[float] | None]]:
    """One step of the world, with Bullet's contact or a plug-in's.

    It tells the normal force that acted on each ball in it, N, unless that is left to their momentum.
    """
    if options.law is not None:
        from hcbench.engines.pybullet.plugin import attach as contact

        gap = None
        if scene.form == "cup":
            gap = contact.cup(scene.ball_radius, -scene.plate_radius, (0.0, 0.0, -scene.plate_radius))
        (ball,) = balls
        with contact.attach([(ball, plate)], options.law, gap=gap, speed=max(speed, _SLOWEST)) as law:
            yield lambda: [sum(touch.force for touch in law.step())]
        return
    move = bullet.stepSimulation
    if _is_lossless(options):
        yield move
        return
    parts = (options.ball, options.plate)
    reach = min(part.get("contactProcessingThreshold", math.inf) for part in parts)
    number = {ball: i for i, ball in enumerate(balls)}
    nothing, contacts = [0.0] * len(balls), bullet.getContactPoints

    def step() -> Sequence[float]:
        move()
        forces = nothing.copy()
        for contact in contacts():
            # A contact out of reach was not solved for; it still says the force of when it last was.
            if contact[8] <= reach:
                forces[number[contact[2] if contact[1] == plate else contact[1]]] += contact[9]
        return forces

    yield step


def _is_lossless(options: Options) -> bool:
    """Whether nothing but gravity and Bullet's own contact changes a ball's velocity."""
    return options.law is None and options.ball.get("linearDamping") == 0.0


def _set_up(bullet: Any, scene: Scene, timestep: float, options: Options) -> tuple[int, int]:
    """An empty world, the two bodies in it, and the options on them; the bodies' ids."""
    bullet.resetSimulation()
    bullet.setPhysicsEngineParameter(fixedTimeStep=timestep, **{**_GLOBALS, **options.world})
    bullet.setGravity(0.0, 0.0, -scene.gravity)
    check_ball(_urdf(scene, "ball"), scene)
    ball = _load(bullet, scene, "ball", options.maximal_coordinates)
    check_plate(_urdf(scene, "plate"))
    plate = _load(bullet, scene, "plate", options.maximal_coordinates)
    _check_shapes(bullet, scene, ball, plate)
    _make_ready(bullet, scene, options, ball)
    bullet.changeDynamics(plate, -1, **options.plate)
    return ball, plate


def _make_ready(bullet: Any, scene: Scene, options: Options, ball: int) -> None:
    if bullet.getDynamicsInfo(ball, -1)[0] != scene.mass:
        bullet.changeDynamics(ball, -1, mass=scene.mass)
    bullet.changeDynamics(ball, -1, **options.ball)


def _company(bullet: Any, scene: Scene, options: Options, ball: int, plate: int, more: int) -> list[int]:
    """So many more balls like the one; none of them collides with another."""
    if not more:
        return []
    others = [_load(bullet, scene, "ball", options.maximal_coordinates) for _ in range(more)]
    for other in others:
        _make_ready(bullet, scene, options, other)
    for one in (ball, *others):
        bullet.setCollisionFilterGroupMask(one, -1, _BALLS, _PLATE)
    bullet.setCollisionFilterGroupMask(plate, -1, _PLATE, _PLATE | _BALLS)
    return others


@cache
def _client() -> Any:
    """The module, connected: one client for the life of this process."""
    import pybullet  # prints on import

    if pybullet.connect(pybullet.DIRECT) < 0:
        raise EngineFailed("pybullet", "no client could be connected", "")
    return pybullet


def _urdf(scene: Scene, role: str) -> Path:
    try:
        path: Path = scene.models["pybullet"][role].resolve()
    except KeyError:
        raise SceneError(
            f"scene {scene.name!r}", f"no PyBullet model for the {role}", "a URDF file for it"
        ) from None
    if not path.is_file():
        raise SceneError(f"scene {scene.name!r}", f"{path} does not exist", f"the URDF of the {role}")
    return path


def _load(bullet: Any, scene: Scene, role: str, maximal: bool) -> int:
    path = _urdf(scene, role)
    try:
        # Bullet looks for a mesh in the working directory first, and only then beside the URDF.
        with chdir(path.parent):
            return int(bullet.loadURDF(path.name, useMaximalCoordinates=maximal))
    except bullet.error as error:
        raise SceneError(f"scene {scene.name!r}", f"{path}: {error}", "a URDF that PyBullet loads") from None


def _check_shapes(bullet: Any, scene: Scene, ball: int, plate: int) -> None:
    """Bullet must see the overlap that the scene says: radii, frames and meshes are right then."""
    overlap = 1e-5
    _place(bullet, ball, touching_height(scene) - overlap)
    seen = [-point[8] for point in bullet.getClosestPoints(ball, plate, 0.0)]
    if not seen or abs(max(seen) - overlap) > _SHAPE_TOLERANCE:
        found = f"{max(seen):.3e} m" if seen else "none"
        raise SceneError(
            f"scene {scene.name!r}",
            f"the URDFs of ball and plate overlap by {found} where the scene says {overlap:g} m",
            f"the ball to touch with its centre at z = {touching_height(scene)!r} m",
        )


def _place(bullet: Any, ball: int, height: float) -> None:
    bullet.resetBasePositionAndOrientation(ball, [0.0, 0.0, height], [0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class World:
    """Balls and a plate in this process's client.

    step: takes one. told: it also tells the normal force on each ball, N, else that is all that changes a
    ball's velocity besides gravity.
    """

    bullet: Any
    scene: Scene
    timestep: float
    balls: Sequence[int]
    step: Callable[[], Sequence[float] | None]
    told: bool

    def release(self, launches: Sequence[Launch]) -> None:
        """Put a ball where each launch starts and any others away, with nothing remembered."""
        # Contacts are kept from step to step, and with them forces: shed those of the launches before.
        for ball in self.balls:
            _place(self.bullet, ball, _FAR)
            self.bullet.resetBaseVelocity(ball, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
        self.bullet.performCollisionDetection()
        for ball, launch in zip(self.balls, launches, strict=False):
            _place(self.bullet, ball, touching_height(self.scene) + launch.gap(self.timestep))
            self.bullet.resetBaseVelocity(ball, [0.0, 0.0, -launch.speed], [0.0, 0.0, 0.0])
