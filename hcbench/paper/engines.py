"""The mass between two blocks inside MuJoCo and PyBullet, to be laid over the reference.

A sphere between two planes that face each other, on MuJoCo's slide joint or free in PyBullet, without
gravity; the drive is an external force. Contact is either the plug-in, which is eq. (16) itself, or what
the engine has of its own, tuned to the law at one speed: a spring and damper in MuJoCo (solref), a constant
restitution in PyBullet. The engines run in a process of their own.
"""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from hcbench.engines import isolation
from hcbench.engines.registry import engine
from hcbench.reference import exact
from hcbench.reference.forced import kelvin_voigt_blocks
from hcbench.reference.laws import HuntCrossley, KelvinVoigt
from hcbench.reference.require import positive, require

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.impact import Floats
    from hcbench.reference.vibroimpact import Sinusoid, VibroImpact

Where = Literal["mujoco", "pybullet"]
RADIUS = 0.0508  # m: the relative radius of section 3.1; no force depends on it here
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
    positive("timestep", timestep, "s")
    positive("until", until, "s")
    if native_at is not None:
        positive("native_at", native_at, "m/s")
        clear = system.gap > 0.0 or where == "mujoco"
        require("gap", system.gap, clear, "a gap above 0 m: a restitution says nothing of a squeezed mass")
    engine(where).version()  # raises EngineMissing
    kicks = _Kicks(system.mass, drive, timestep)
    given = (where, system, position, velocity, until, kicks, native_at)
    return isolation.collect(_run, *given, limit=LIMIT)[0]


def mjcf(system: VibroImpact, timestep: float, contact: str = "") -> str:
    """The system as MJCF: geoms ball, left, right; joint `q`.

    contact: attributes of all geoms, such as solref.
    """
    wall = RADIUS + system.gap / 2.0
    return f"""<mujoco model="vibroimpact">
  <option timestep="{timestep!r}" gravity="0 0 0"/>
  <default><geom condim="1" {contact}/></default>
  <worldbody>
    <geom name="left" type="plane" size=".5 .5 .1" pos="{-wall!r} 0 0" zaxis="1 0 0"/>
    <geom name="right" type="plane" size=".5 .5 .1" pos="{wall!r} 0 0" zaxis="-1 0 0"/>
    <body name="ball">
      <joint name="q" type="slide" axis="1 0 0"/>
      <geom name="ball" type="sphere" size="{RADIUS!r}" mass="{system.mass!r}"/>
    </body>
  </worldbody>
</mujoco>
"""


def _run(where: Where, *arguments: Any) -> Iterator[Track]:
    """In the worker."""
    yield (_in_mujoco if where == "mujoco" else _in_pybullet)(*arguments)


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


def _in_mujoco(
    system: VibroImpact,
    position: float,
    velocity: float,
    until: float,
    kicks: _Kicks,
    native_at: float | None,
) -> Track:
    import mujoco

    from hcbench.contact import mujoco as contact

    own = ""
    if native_at is not None:
        spring = kelvin_voigt_blocks(system, native_at).right
        assert isinstance(spring, KelvinVoigt)
        solref = f"{-spring.stiffness / system.mass!r} {-spring.damping / system.mass!r}"
        # Two contacts at once feel each other through d/(1 - d): of low impedance d they are two springs.
        own = f'solref="{solref}" solimp=".001 .001 .001"'
    model = mujoco.MjModel.from_xml_string(mjcf(system, kicks.step, own))
    pairs = [("ball", "left"), ("ball", "right")]
    attached = contact.attach(model, pairs, _law(system)) if native_at is None else nullcontext()
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = position, kicks.start(velocity)
    q, v = [float(data.qpos[0])], [float(data.qvel[0])]
    with attached:
        for i in range(math.ceil(until / kicks.step) + 1):
            data.qfrc_applied[0] = kicks(i)
            mujoco.mj_step(model, data)
            q.append(float(data.qpos[0]))
            v.append(float(data.qvel[0]))
    return kicks.track(np.array(q), np.array(v))


def _in_pybullet(
    system: VibroImpact,
    position: float,
    velocity: float,
    until: float,
    kicks: _Kicks,
    native_at: float | None,
) -> Track:
    import pybullet as bullet

    client = bullet.connect(bullet.DIRECT)
    try:
        return _bullet_track(bullet, client, system, position, velocity, until, kicks, native_at)
    finally:
        bullet.disconnect(client)


def _bullet_track(
    bullet: Any,
    client: int,
    system: VibroImpact,
    position: float,
    velocity: float,
    until: float,
    kicks: _Kicks,
    native_at: float | None,
) -> Track:
    from hcbench.contact import pybullet as contact
    from hcbench.tune.pybullet_restitution import BALL, WORLD

    bullet.setPhysicsEngineParameter(fixedTimeStep=kicks.step, **WORLD, physicsClientId=client)
    walls = [_wall(bullet, client, side * (RADIUS + system.gap / 2.0), -side) for side in (-1.0, 1.0)]
    shape = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=RADIUS, physicsClientId=client)
    ball = bullet.createMultiBody(system.mass, shape, basePosition=[position, 0, 0], physicsClientId=client)
    bullet.changeDynamics(ball, -1, **BALL, physicsClientId=client)
    bullet.resetBaseVelocity(ball, [kicks.start(velocity), 0, 0], physicsClientId=client)
    if native_at is None:
        attached: Any = contact.attach([(ball, wall) for wall in walls], _law(system), client=client)
    else:
        attached = nullcontext()
        e = float(exact.restitution(_law(system).alpha, native_at))
        for body, share in ((ball, e), *((wall, 1.0) for wall in walls)):
            bullet.changeDynamics(body, -1, restitution=share, physicsClientId=client)
    q, v = [position], [kicks.start(velocity)]
    with attached as law:
        for i in range(math.ceil(until / kicks.step) + 1):
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


def _wall(bullet: Any, client: int, place: float, facing: float) -> int:
    shape = bullet.createCollisionShape(bullet.GEOM_PLANE, planeNormal=[facing, 0, 0], physicsClientId=client)
    return int(bullet.createMultiBody(0, shape, basePosition=[place, 0, 0], physicsClientId=client))


def _law(system: VibroImpact) -> HuntCrossley:
    assert isinstance(system.right, HuntCrossley)
    return system.right
