"""Tosses in PyBullet, by Bullet's own contact and by the plug-in: see `hcbench.sim.toss`."""

from collections.abc import Mapping, Sequence

import numpy as np

from hcbench.engines.pybullet.backend import BulletClient
from hcbench.sim.toss import (
    ALPHA,
    FRICTION,
    GRAVITY,
    MU,
    NOTHING,
    PLUGIN_ALPHA,
    PLUGIN_E,
    RESTITUTION,
    Body,
    ContactSetting,
    E,
    Parameter,
    Shape,
    Toss,
    as_body,
    as_integrated,
    plugin_law,
)
from hcbench.terms.impact import Floats

STIFFNESS = "stiffness and damping"
SHAPES: frozenset[Shape] = frozenset({"box", "sphere"})
SETTINGS = (
    ContactSetting(NOTHING),
    ContactSetting(FRICTION, (MU,)),
    ContactSetting(RESTITUTION, (E, MU)),
    ContactSetting(
        STIFFNESS,
        (Parameter("stiffness", (8e4, 2e4, 1e3)), Parameter("damping", (30.0, 80.0, 1.0)), MU),
    ),
    ContactSetting(PLUGIN_E, (E, MU)),
    ContactSetting(PLUGIN_ALPHA, (ALPHA, MU)),
)
# Bullet clips a body's spin at 100 rad/s, without a warning.
_FASTEST = 1e6
# Speed for which the plug-in checks the step, m/s.
_SPEED = 2.0
# Columns of a state.
_QUATERNION = slice(3, 7)
_VELOCITY = slice(7, 10)


def simulate(
    body: Body,
    setting: ContactSetting,
    values: Sequence[float],
    timestep: float,
    tosses: Sequence[Toss],
) -> list[Floats]:
    """Simulate tosses of a body on a plate, in a PyBullet client of their own.

    Returns the states of each toss at its start and after each step, (steps + 1, 13): position, m,
    quaternion w x y z, velocity, m/s, and spin, rad/s, in the world.

    setting: kind of contact.
    values: of the setting's parameters, SI, in its order.
    timestep: s.
    Raises SettingError for numbers that a plug-in's law does not take.
    """
    bullet = BulletClient.direct()
    try:
        given = setting.named(values)
        tossed = _load(bullet, body, setting, given, timestep)
        return [_simulate(bullet, tossed, toss, timestep) for toss in tosses]
    finally:
        bullet.disconnect()


def _load(
    bullet: BulletClient,
    body: Body,
    setting: ContactSetting,
    given: Mapping[str, float],
    timestep: float,
) -> int:
    """Make a plate, a body and their contact in an empty client; returns the body's id.

    body: shape, mass and inertia of what is tossed.
    setting: kind of contact: a stiffness, a restitution, the plug-in, or no more than friction.
    given: parameters of the setting by name, SI.
    timestep: s.
    Raises SettingError for numbers that a plug-in's law does not take.
    """
    from hcbench.engines.pybullet import plugin

    bullet.setGravity(0.0, 0.0, -GRAVITY)
    bullet.setTimeStep(timestep)
    kinds = bullet.module
    # A body of mass 0 does not move.
    plane = bullet.createMultiBody(0, bullet.createCollisionShape(kinds.GEOM_PLANE))
    if body.shape == "sphere":
        shape = bullet.createCollisionShape(kinds.GEOM_SPHERE, radius=body.half_sizes[0])
    else:
        shape = bullet.createCollisionShape(kinds.GEOM_BOX, halfExtents=body.half_sizes)
    tossed: int = bullet.createMultiBody(body.mass, shape, basePosition=[0.0, 0.0, 1.0])
    spring = {}
    if setting.name == STIFFNESS:
        spring = {"contactStiffness": given["stiffness"], "contactDamping": given["damping"]}
    # Bullet multiplies what the two bodies have.
    bullet.changeDynamics(plane, -1, lateralFriction=1.0, restitution=1.0, **spring)
    own = {"lateralFriction": given["friction"]} if "friction" in given else {}
    if setting.name == RESTITUTION:
        own["restitution"] = given["restitution"]
    bullet.changeDynamics(
        tossed, -1, linearDamping=0.0, angularDamping=0.0, localInertiaDiagonal=body.inertia,
        activationState=kinds.ACTIVATION_STATE_DISABLE_SLEEPING, maxJointVelocity=_FASTEST, **own, **spring,
    )  # fmt: skip
    if (law := plugin_law(setting, given)) is not None:
        plugin.add(law, tossed, plane, client=bullet.client, speed=_SPEED)
    return tossed


def _simulate(bullet: BulletClient, body: int, toss: Toss, timestep: float) -> Floats:
    """Simulate one toss, and return its states at the start and after each step, (steps + 1, 13):
    position, m, quaternion w x y z, velocity, m/s, and spin, rad/s, in the world.

    The integrator's velocities are shifted by half a step's fall from those of the body, which are
    given and returned.

    body: its id.
    timestep: s.
    """
    start = toss.position.tolist()
    turned = _scalar_last(toss.quaternion).tolist()
    velocity = as_integrated(toss.velocity, timestep).tolist()
    spin = toss.spin.tolist()
    bullet.resetBasePositionAndOrientation(body, start, turned)
    bullet.resetBaseVelocity(body, velocity, spin)
    rows = [(*start, *turned, *velocity, *spin)]
    for _ in range(toss.steps):
        bullet.stepSimulation()
        position, quaternion = bullet.getBasePositionAndOrientation(body)
        velocity, spin = bullet.getBaseVelocity(body)
        rows.append((*position, *quaternion, *velocity, *spin))
    states = np.array(rows)
    states[:, _QUATERNION] = _scalar_first(states[:, _QUATERNION])
    states[:, _VELOCITY] = as_body(states[:, _VELOCITY], timestep)
    return states


def _scalar_last(quaternion: Floats) -> Floats:
    """The quaternion w x y z as x y z w, which is the order of Bullet."""
    return np.roll(quaternion, -1, axis=-1)


def _scalar_first(quaternion: Floats) -> Floats:
    """The quaternion x y z w, which is the order of Bullet, as w x y z."""
    return np.roll(quaternion, 1, axis=-1)
