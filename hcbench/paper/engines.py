"""The mass between two blocks inside MuJoCo and PyBullet, to be laid over the reference.

The scene is `two-blocks`. Contact is either the plug-in, which is eq. (16) itself, or the best that the
engine has of its own: staggered pairs in MuJoCo; in PyBullet a constant restitution where the body flies, a
spring and damper where it is squeezed, both right at one speed. The engines run in a process of their own.
"""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from hcbench.laws.force import HuntCrossley
from hcbench.laws.require import positive, require
from hcbench.paper import two_blocks
from hcbench.sim.registry import engine
from hcbench.workers import process

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.impact import Floats
    from hcbench.paper.vibroimpact.system import Sinusoid, VibroImpact

Where = Literal["mujoco", "pybullet"]
LIMIT = 120.0  # s of wall time for one run


@dataclass(frozen=True, slots=True)
class Track:
    """What an engine's mass did, at the ends of steps, shape (n,): s, m, m/s, N.

    resultant: what the blocks did against the position, by the change of speed; P taken off.
    """

    time: Floats
    position: Floats
    velocity: Floats
    resultant: Floats

    def since(self, start: float) -> Track:
        """The part with time >= start, s."""
        keep = self.time >= start
        return Track(self.time[keep], self.position[keep], self.velocity[keep], self.resultant[keep])


def track(
    where: Where,
    system: VibroImpact,
    position: float,
    velocity: float,
    until: float,
    drive: Sinusoid | None = None,
    *,
    timestep: float = 1e-5,
    native_at: float | None = None,
) -> Track:
    """Run a system in an engine, by the plug-in, or by its own contact tuned at the speed `native_at` (m/s).

    Both blocks must have the same law (16). timestep, until in s. Raises UserError for a system that an
    engine cannot have, EngineMissing and EngineFailed.
    """
    law = system.right
    alike = isinstance(law, HuntCrossley) and law == system.left
    require("laws", (system.right, system.left), alike, "the same law (16) on both sides")
    assert isinstance(law, HuntCrossley)
    positive("timestep", timestep, "s")
    positive("until", until, "s")
    if native_at is not None:
        positive("native_at", native_at, "m/s")
    engine(where).version()  # raises EngineMissing
    kicks = _Kicks(system.mass, drive, timestep)
    case = _Case(system, law, position, velocity, math.ceil(until / timestep) + 1, kicks, native_at)
    return process.collect(_run, where, case, limit=LIMIT)[0]


def _run(where: Where, case: _Case) -> Iterator[Track]:
    """In the worker."""
    yield (_in_mujoco if where == "mujoco" else _in_pybullet)(case)


@dataclass(frozen=True, slots=True)
class _Kicks:
    """The drive as both engines' steps want it: v += h P/m, then q += h v, is leapfrog.

    Velocities are then those half a step before the positions: P is that of the step's start, the first
    velocity lags half a kick, and a velocity at a step's end is the mean of its neighbours. So the drive is
    of second order.
    """

    mass: float
    drive: Sinusoid | None
    step: float

    def __call__(self, i: int) -> float:
        return self.drive(i * self.step) if self.drive is not None else 0.0

    def start(self, velocity: float) -> float:
        return velocity - 0.5 * self.step * self(0) / self.mass

    def track(self, position: Floats, staggered: Floats) -> Track:
        """position: at steps 0 ... n; staggered: velocities half a step before 0 ... n."""
        count = len(position) - 1
        push = np.array([self(i) for i in range(count)])
        return Track(
            time=np.asarray(np.arange(count) * self.step, dtype=np.float64),
            position=position[:-1],
            velocity=np.asarray(0.5 * (staggered[:-1] + staggered[1:])),
            resultant=push - self.mass * np.diff(staggered) / self.step,
        )


@dataclass(frozen=True, slots=True)
class _Case:
    """What `track` was asked for; law: of both blocks. steps: to take."""

    system: VibroImpact
    law: HuntCrossley
    position: float
    velocity: float
    steps: int
    kicks: _Kicks
    native_at: float | None


def _in_mujoco(case: _Case) -> Track:
    import mujoco

    from hcbench.engines.mujoco.backend import require_feature
    from hcbench.engines.mujoco.plugin import attach as contact

    kicks = case.kicks
    if case.native_at is not None:
        require_feature(mujoco, "adhesion")
    model = mujoco.MjModel.from_xml_string(two_blocks.mjcf(case.system, kicks.step, case.native_at))
    pairs = [("ball", "left"), ("ball", "right")]
    attached = contact.attach(model, pairs, case.law) if case.native_at is None else nullcontext()
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = case.position, kicks.start(case.velocity)
    q, v = [float(data.qpos[0])], [float(data.qvel[0])]
    with attached:
        for i in range(case.steps):
            data.ctrl[0] = kicks(i)
            mujoco.mj_step(model, data)
            q.append(float(data.qpos[0]))
            v.append(float(data.qvel[0]))
    return kicks.track(np.array(q), np.array(v))


def _in_pybullet(case: _Case) -> Track:
    import pybullet as bullet

    client = bullet.connect(bullet.DIRECT)
    try:
        return _bullet_track(bullet, client, case)
    finally:
        bullet.disconnect(client)


def _bullet_track(bullet: Any, client: int, case: _Case) -> Track:
    from hcbench.engines.pybullet.plugin import attach as contact
    from hcbench.engines.pybullet.recipes.restitution import BALL, WORLD

    system, kicks, native_at = case.system, case.kicks, case.native_at
    own = {} if native_at is None else two_blocks.bullet_options(system, kicks.step, native_at)
    world = own.get("world", WORLD)
    bullet.setPhysicsEngineParameter(fixedTimeStep=kicks.step, **world, physicsClientId=client)
    blocks = [_load(bullet, client, side, two_blocks.place(system, side)) for side in two_blocks.SIDES]
    ball = _load(bullet, client, "ball", case.position)
    bullet.changeDynamics(ball, -1, mass=system.mass, **own.get("ball", BALL), physicsClientId=client)
    for block in blocks:
        bullet.changeDynamics(block, -1, **own.get("plate", {}), physicsClientId=client)
    bullet.resetBaseVelocity(ball, [kicks.start(case.velocity), 0, 0], physicsClientId=client)
    attached: Any = nullcontext()
    if native_at is None:
        attached = contact.attach([(ball, block) for block in blocks], case.law, client=client)
    q, v = [case.position], [kicks.start(case.velocity)]
    with attached as law:
        for i in range(case.steps):
            place = bullet.getBasePositionAndOrientation(ball, physicsClientId=client)[0]
            bullet.applyExternalForce(
                ball, -1, [kicks(i), 0, 0], place, bullet.WORLD_FRAME, physicsClientId=client
            )
            if law is not None:
                law.apply()
            bullet.stepSimulation(physicsClientId=client)
            q.append(bullet.getBasePositionAndOrientation(ball, physicsClientId=client)[0][0])
            v.append(bullet.getBaseVelocity(ball, physicsClientId=client)[0][0])
    return kicks.track(np.array(q), np.array(v))


def _load(bullet: Any, client: int, name: str, x: float) -> int:
    """A body of the scene, at x (m)."""
    file, flags = str(two_blocks.folder() / f"{name}.urdf"), bullet.URDF_USE_INERTIA_FROM_FILE
    return int(bullet.loadURDF(file, [x, 0, 0], flags=flags, physicsClientId=client))
