"""Balls over a plate in PyBullet. Runs in a process that hcbench owns, never in the user's.

What PyBullet does and when (version 3.2): a step first finds contacts at the positions it starts
from, then solves for velocities, then moves. So contacts read after a step carry the force of that
step, and belong to the state before it; that normalForce is m Δv / dt to rounding.

Several balls share a world, each with the bits it has alone: they are kept from colliding with each
other, and Bullet's solver works on each contact by itself. Bullet does not promise that; tests of
every setting and form hold it.
"""

from __future__ import annotations

import math
import tempfile
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.pybullet import plugin
from hcbench.engines.pybullet.backend import (
    BODY_A,
    BODY_B,
    DISTANCE,
    FORCE,
    LASTING_SETTINGS,
    MASS,
    UNCLIPPED,
    BulletClient,
    client,
)
from hcbench.engines.pybullet.model.open import check_ball, check_plate
from hcbench.engines.pybullet.scene.options import ball_urdf
from hcbench.sim.tangential import rows_of_ball
from hcbench.sim.world import CannotShareError, Record, Simulation, World, momentum_force
from hcbench.system.errors import SceneError, foreign_errors
from hcbench.workers import in_worker

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene

# Penetration, rate and force of balls in PyBullet, from their positions and velocities.
#
# Of several balls only the velocity is needed, as a query from Python costs as much as a step.
# Positions follow exactly, as Bullet moves a body by its new velocity times the step. Forces are
# what they do to the momentum, equal to Bullet's to rounding, where nothing else slows a ball;
# else they are read from Bullet.


def overlap(scene: Scene, position: Floats, velocity: Floats) -> tuple[Floats, Floats, Floats]:
    """Penetration of a ball into the scene's plane or cup, m, (...), its rate, m/s, (...), and the
    unit vector that leads deeper, (3,) on a plane, (..., 3) in a cup.

    They follow from the scene's numbers alone, whatever meshes the engine has.

    position, velocity: of the ball's centre, m and m/s, (..., 3).
    """
    radius = scene.touch_radius
    down = np.array([0.0, 0.0, -1.0])
    # Of the ball's lowest point below that of the plate or cup, m.
    depth = radius - position[..., 2]
    falling = -velocity[..., 2]
    if scene.form == "plane":
        return depth, falling, down
    # Radius of the cup, m, whose lowest point is the origin.
    bowl = -scene.plate_radius
    # From the cup's centre of curvature to the ball's centre, m.
    away = position - np.array([0.0, 0.0, bowl])
    x = away[..., 0]
    y = away[..., 1]
    z = away[..., 2]
    distance = np.sqrt(x * x + y * y + z * z)
    # At the centre itself there is no direction outwards.
    with np.errstate(all="ignore"):
        out = (x * velocity[..., 0] + y * velocity[..., 1] + z * velocity[..., 2]) / distance
        deeper = np.where(z[..., None] >= 0.0, down, away / distance[..., None])
    # Above the centre of curvature the height over the lowest point counts.
    is_above = z >= 0.0
    penetration = np.where(is_above, depth, distance - (bowl - radius))
    rate = np.where(is_above, falling, out)
    return penetration, rate, deeper


def tangential_rows(scene: Scene, timestep: float, motion: Floats, deeper: Floats) -> Floats:
    """Motion of b balls along the plate in each of n steps, (8, b, n): slip, 2 numbers, m/s; spin, 3,
    rad/s; friction, 2, N; and the kinetic energy without the approach's, J.

    timestep: s.
    motion: velocity, m/s, and spin, rad/s, before all steps and after each, (n + 1, b, 2, 3).
    deeper: unit vectors into the plate, (..., 3).
    """
    velocity = motion[:-1, :, 0]
    spin = motion[:-1, :, 1]
    # The contact's part of the acceleration alone, m/s².
    gained = np.diff(motion[:, :, 0], axis=0) / timestep + [0.0, 0.0, scene.gravity]
    vectors = (velocity, spin, np.broadcast_to(deeper, velocity.shape), gained)
    return rows_of_ball(scene, *(vector.swapaxes(0, 1) for vector in vectors))


def force_from_momentum(scene: Scene, timestep: float, velocity: Floats, deeper: Floats) -> Floats:
    """Normal force on b balls in each of n steps, N, (n, b), from what it did to their momentum;
    exactly 0 where the contact did not act.

    timestep: s.
    velocity: before all steps and after each, m/s, (n + 1, b, 3).
    deeper: unit vectors into the plate, (3,) or (n, b, 3).
    """
    # Speed that gravity adds in a step, m/s.
    fall = scene.gravity * timestep
    # By the contact alone.
    gained = np.diff(velocity, axis=0)
    gained[..., 2] += fall
    slowed = -(gained * deeper).sum(axis=-1)
    speed = np.abs(velocity).sum(axis=-1)
    return momentum_force(scene.mass, timestep, slowed, speed[:-1] + speed[1:] + fall)


if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.engines.pybullet.scene.options import PybulletOptions
    from hcbench.sim.world import Flags
    from hcbench.terms.impact import Floats, Launch
    from hcbench.terms.scene import Scene

    Step = Callable[[], Sequence[float] | None]

# Distance without contacts, m.
_FAR = 10.0
# More balls make Bullet's broad phase slow.
_BALLS_IN_WORLD = 8
# Groups of balls and plate in Bullet's collision filter.
_BALLS = 2
_PLATE = 1
# Difference, m, between the overlap that Bullet sees and the scene's.
_SHAPE_TOLERANCE = 1e-6


class PybulletWorld(World):
    """Balls and a plate in this process's client, as a scene and options have them.

    balls: ids of the bodies.
    reports_force: whether `step` returns the normal force on each ball, N; if not, nothing but
    gravity and the contact changes a ball's velocity.

    Raises SceneError where the scene's URDFs are missing or not as it says, SettingError for links
    in a cup or a law that the step does not resolve, EngineFailed where PyBullet fails.
    """

    # Looking at a chunk takes as long as some fifty steps of a ball.
    least_steps = 32

    def __init__(
        self, scene: Scene, timestep: float, options: PybulletOptions, fastest: float
    ) -> None:
        """Set up the world in this process, a worker of hcbench.

        timestep: s.
        fastest: speed of impacts, m/s, up to which a force law must be resolved.
        Raises SceneError where the scene's URDFs are missing or not as it says, SettingError for
        links in a cup or a law that the step does not resolve, EngineFailed where PyBullet fails.
        """
        assert in_worker(), "PyBullet's settings are global: they would leak into the user's own"
        self.scene = scene
        self.options = options
        self.timestep = timestep
        self.gravity = scene.normal_gravity
        self.mass = scene.mass
        self.deepest = scene.touch_radius
        # Launches that share a world. How often Bullet's solver sweeps over several links depends on
        # all that are in contact.
        self.places = 1 if options.links else _BALLS_IN_WORLD
        self.reports_force = options.ball.get("linearDamping") != 0.0
        self.bullet = client()
        with foreign_errors("pybullet", self.bullet.error):
            ball, self.plate = _set_up(self.bullet, scene, timestep, options)
            self.balls = [ball]
            self._fastest = fastest
            self._laws: list[int] = []
            self._add_law(ball)
            self.step = self._step()

    @cached_property
    def recorder(self) -> plugin.Recorder | None:
        """The compiled recorder, which steps and reads the balls; None where it cannot be compiled, or
        where forces must be read from Bullet.
        """
        return None if self.reports_force else plugin.recorder(self.bullet)

    def release(self, launches: Sequence[Launch]) -> PybulletSimulation:
        """Put a ball where each launch starts, and the others far away, as if nothing had been before.

        This ends an earlier simulation, which used the same balls.
        Raises EngineFailed where PyBullet fails, CannotShareError for several launches of which one
        is oblique.
        """
        oblique = any(launch.is_oblique for launch in launches)
        # Bullet's sweeps over friction depend on all balls.
        if oblique and len(launches) > 1:
            raise CannotShareError
        with foreign_errors("pybullet", self.bullet.error):
            self._add_balls(len(launches) - len(self.balls))
            # Contacts are kept from step to step, and with them forces: remove
            # those of the launches before.
            for ball in self.balls:
                _place(self.bullet, ball, np.array([0.0, 0.0, _FAR]))
                self.bullet.resetBaseVelocity(ball, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0])
            self.bullet.performCollisionDetection()
            away = np.array(self.scene.normal)
            touch = np.array([0.0, 0.0, self.scene.touch_radius]) + self.scene.touch_offset
            for ball, launch in zip(self.balls, launches, strict=False):
                _place(self.bullet, ball, touch + launch.clearance(self.timestep) * away)
                velocity = [*launch.slip, 0.0] - launch.speed * away
                self.bullet.resetBaseVelocity(ball, velocity.tolist(), [*launch.spin])
        return PybulletSimulation(self, len(launches), oblique)

    def _add_balls(self, count: int) -> None:
        """Add balls like the first to the world; balls do not collide with each other.

        count: how many; 0 or less for none.
        Raises SettingError for a law that the step does not resolve.
        """
        if count <= 0:
            return
        for _ in range(count):
            ball = _load(self.bullet, self.scene, "ball", self.options.maximal_coordinates)
            _make_ready(self.bullet, self.scene, self.options, ball)
            self._add_law(ball)
            self.balls.append(ball)
        # The base, -1, its group, and the groups that it collides with, as bits.
        for ball in self.balls:
            self.bullet.setCollisionFilterGroupMask(ball, -1, _BALLS, _PLATE)
        self.bullet.setCollisionFilterGroupMask(self.plate, -1, _PLATE, _PLATE | _BALLS)

    def _add_law(self, ball: int) -> None:
        """Let the setting's law, if it has one, act between a ball and the plate.

        ball: its id.
        Raises SettingError for a force law that the step does not resolve.
        """
        law = self.options.law
        if law is None:
            return
        # Radius and centre of curvature, m.
        cup = None
        if self.scene.form == "cup":
            bowl = -self.scene.plate_radius
            cup = (bowl, 0.0, 0.0, bowl)
        made = plugin.add(
            law,
            ball,
            self.plate,
            client=self.bullet.client,
            cup=cup,
            speed=self._fastest,
        )
        self._laws.append(made)

    def _step(self) -> Step:
        """Make the function that takes a step of the world; if `reports_force`, it returns the normal
        force on each ball, N, else None.

        The force is that of the plug-in's law where there is one, else of Bullet's own contact.
        """
        move: Step = self.bullet.stepSimulation
        if not self.reports_force:
            return move
        if self._laws:

            def step_with_law() -> Sequence[float]:
                """Take a step, and return the law's force on each ball, N."""
                move()
                return [plugin.force(law, client=self.bullet.client) for law in self._laws]

            return step_with_law
        parts = (self.options.ball, self.options.plate)
        # Distance up to which Bullet solves for a contact, m.
        reach = min(part.get("contactProcessingThreshold", math.inf) for part in parts)
        contacts = self.bullet.getContactPoints

        def step() -> Sequence[float]:
            """Take a step, and add up Bullet's contact forces on each ball, N."""
            move()
            forces = [0.0] * len(self.balls)
            for contact in contacts():
                # A contact out of reach was not solved for; it still says
                # the force of when it last was.
                if contact[DISTANCE] <= reach:
                    ball = contact[BODY_A]
                    if ball == self.plate:
                        ball = contact[BODY_B]
                    forces[self.balls.index(ball)] += contact[FORCE]
            return forces

        return step


class PybulletSimulation(Simulation):
    """Launches of a PyBullet world under way.

    The position of a launch that is alone is read after each step; those of several are worked out
    from their velocities, and checked at the end of each chunk.
    """

    def __init__(self, world: PybulletWorld, count: int, oblique: bool) -> None:
        """Take up launches whose balls are in place.

        count: of launches, which have the world's first balls.
        oblique: whether to record the motion along the plate, too.
        """
        self._world = world
        self._reads_position = count == 1
        self._oblique = oblique
        # Numbers of the launches that are still stepped.
        self._which = list(range(count))
        self._position = self._positions()
        self._motion = self._motions()

    def advance(self, steps: int) -> Record:
        """Take `steps` steps of all balls, and return their record.

        Raises CannotShareError where a ball is not where its velocities take it, EngineFailed where
        PyBullet fails.
        """
        world = self._world
        with foreign_errors("pybullet", world.bullet.error):
            forces, positions, motions = self._step(steps)
        # Before all steps and after each, of each ball: velocity and spin, (n + 1, b, 2, 3); velocity
        # alone, and position, (n + 1, b, 3).
        motion = np.concatenate([self._motion[None], np.reshape(motions, (steps, -1, 2, 3))])
        velocity = motion[:, :, 0]
        if self._reads_position:
            read = np.reshape(positions, (steps, -1, 3))
            position = np.concatenate([self._position[None], read])
        else:
            moved = world.timestep * velocity[1:]
            # Bullet adds up in the same order: equal to the bit, unless balls disturb each other.
            position = np.cumsum(np.concatenate([self._position[None], moved]), axis=0)
        self._position = position[-1]
        self._motion = motion[-1]
        x, rate, deeper = overlap(world.scene, position[:-1], velocity[:-1])
        if world.reports_force:
            # Of all balls of the world: those that are still recorded are picked.
            force = np.reshape(np.array(forces, dtype=np.float64), (steps, -1))[:, self._which]
        else:
            force = force_from_momentum(world.scene, world.timestep, velocity, deeper)
        if not (self._reads_position or np.array_equal(self._positions(), position[-1])):
            raise CannotShareError
        along_plate = None
        if self._oblique:
            along_plate = tangential_rows(world.scene, world.timestep, motion, deeper)
        return Record(x.T, rate.T, force.T, along_plate)

    def keep(self, which: Flags) -> None:
        """Record only these from now on."""
        self._which = [
            ball for ball, going in zip(self._which, which.tolist(), strict=True) if going
        ]
        self._position = self._position[which]
        self._motion = self._motion[which]

    def _positions(self) -> Floats:
        place = self._world.bullet.getBasePositionAndOrientation
        return np.array([place(self._world.balls[i])[0] for i in self._which])

    def _motions(self) -> Floats:
        """Velocity, m/s, and spin, rad/s, of each ball, (b, 2, 3)."""
        motion = self._world.bullet.getBaseVelocity
        return np.array([motion(self._world.balls[i]) for i in self._which])

    def _step(self, steps: int) -> tuple[list[Any], Any, Any]:
        """Take `steps` steps, and return what was read in each: forces, N; positions, m; velocities,
        m/s, with spins, rad/s; in the order of steps, then balls.

        Forces are those of all balls of the world, and None or [] where no step reports them;
        positions are [] where they are not read.
        """
        step = self._world.step
        bullet = self._world.bullet
        recorder = self._world.recorder
        balls = [self._world.balls[i] for i in self._which]
        if recorder is not None:
            # Position, velocity and spin, (steps, balls, 3, 3).
            seen = recorder.record(balls, steps)
            return [], seen[:, :, 0], seen[:, :, 1:]
        place = bullet.getBasePositionAndOrientation
        motion = bullet.getBaseVelocity
        forces: list[Any] = []
        motions: list[float] = []
        positions: list[float] = []
        for _ in range(steps):
            forces.append(step())
            for ball in balls:
                velocity, spin = motion(ball)
                motions += velocity
                motions += spin
                if self._reads_position:
                    positions += place(ball)[0]
        return forces, positions, motions


def _set_up(
    bullet: BulletClient, scene: Scene, timestep: float, options: PybulletOptions
) -> tuple[int, int]:
    """Empty a client's world, load ball and plate, set the options, and return the ids of the two.

    timestep: s.
    Raises SceneError where the URDFs are missing or not as the scene says, SettingError for links
    in a cup.
    """
    bullet.resetSimulation()
    bullet.setPhysicsEngineParameter(
        fixedTimeStep=timestep, **{**LASTING_SETTINGS, **options.world}
    )
    bullet.setGravity(0.0, 0.0, -scene.gravity)
    check_ball(_urdf(scene, "ball"), scene)
    if options.links:
        ball = _load_links(bullet, scene, options)
    else:
        ball = _load(bullet, scene, "ball", options.maximal_coordinates)
    check_plate(_urdf(scene, "plate"))
    plate = _load(bullet, scene, "plate", options.maximal_coordinates)
    _check_shapes(bullet, scene, ball, plate)
    _make_ready(bullet, scene, options, ball)
    # Bullet multiplies the frictions of the two.
    neutral = {"lateralFriction": 1.0} if scene.friction else {}
    bullet.changeDynamics(plate, -1, **{**neutral, **options.plate})
    return ball, plate


def _make_ready(bullet: BulletClient, scene: Scene, options: PybulletOptions, ball: int) -> None:
    """Give a ball the scene's mass, kg, friction, and with friction its inertia, kg m², then the
    setting's keywords of changeDynamics, which go before.

    options: of the setting.
    ball: its id; of one with links, all links are changed.
    """
    # With friction the ball turns, and its inertia is not what Bullet makes of the sphere.
    if scene.friction:
        # Without its mass a body of maximal coordinates would get any inertia.
        inertia = [scene.inertia] * 3
        bullet.changeDynamics(ball, -1, mass=scene.mass, localInertiaDiagonal=inertia)
    elif bullet.getDynamicsInfo(ball, -1)[MASS] != scene.mass:
        bullet.changeDynamics(ball, -1, mass=scene.mass)
    keywords: dict[str, Any] = {}
    if scene.friction:
        keywords["lateralFriction"] = scene.friction
    # Bullet clips spin at 100 rad/s. Of a ball with links it would change the joints, too.
    if not options.links:
        keywords["maxJointVelocity"] = UNCLIPPED
    keywords |= options.ball
    for link in range(-1, max(0, len(options.links) - 1)):
        bullet.changeDynamics(ball, link, **keywords)


def _urdf(scene: Scene, role: str) -> Path:
    """Path of the URDF that a scene names for a role, "ball" or "plate". Raises SceneError for a scene
    that names none, and for a file that is missing.
    """
    try:
        path: Path = scene.models["pybullet"][role].resolve()
    except KeyError:
        raise SceneError(
            f"scene {scene.name!r}", f"no PyBullet model for the {role}", "a URDF file for it"
        ) from None
    if not path.is_file():
        raise SceneError(
            f"scene {scene.name!r}", f"{path} does not exist", f"the URDF of the {role}"
        )
    return path


def _load(bullet: BulletClient, scene: Scene, role: str, maximal: bool) -> int:
    (body,) = bullet.load_model(
        _urdf(scene, role), f"scene {scene.name!r}", useMaximalCoordinates=maximal
    )
    return body


def _load_links(bullet: BulletClient, scene: Scene, options: PybulletOptions) -> int:
    """Load a ball with the links of a setting from a URDF made for it, and return its id.

    Raises SettingError in a cup, SceneError for links that start as deep as the ball's radius or
    deeper.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ball.urdf"
        path.write_text(ball_urdf(scene, options.links), encoding="utf-8")
        flags = bullet.module.URDF_USE_INERTIA_FROM_FILE
        (body,) = bullet.load_model(path, f"scene {scene.name!r}", flags=flags)
        return body


def _check_shapes(bullet: BulletClient, scene: Scene, ball: int, plate: int) -> None:
    """Require that Bullet sees the overlap of ball and plate that the scene says, by SceneError:
    radii, frames and meshes are right then. Moves the ball.

    ball, plate: ids.
    """
    overlap = 1e-5  # m
    _place(bullet, ball, np.array([0.0, 0.0, scene.touch_radius - overlap]))
    # Overlaps at all points that Bullet finds, m.
    seen = [-point[DISTANCE] for point in bullet.getClosestPoints(ball, plate, 0.0)]
    if not seen or abs(max(seen) - overlap) > _SHAPE_TOLERANCE:
        depth = f"{max(seen):.3e} m" if seen else "none"
        raise SceneError(
            f"scene {scene.name!r}",
            f"the URDFs of ball and plate overlap by {depth} where the scene says {overlap:g} m",
            f"the ball to touch with its centre at z = {scene.touch_radius!r} m",
        )


def _place(bullet: BulletClient, ball: int, position: Floats) -> None:
    bullet.resetBasePositionAndOrientation(ball, position.tolist(), [0.0, 0.0, 0.0, 1.0])
