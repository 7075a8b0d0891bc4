"""Tosses in MuJoCo, by its own contact and by the plug-in: see `hcbench.sim.toss`."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.plugin import add_to_spec
from hcbench.sim.toss import (
    ALPHA,
    FRICTION,
    GRAVITY,
    MU,
    NOTHING,
    PLUGIN_ALPHA,
    PLUGIN_E,
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

SOLREF = "solref identified"
_SPRING = (Parameter("stiffness", (1.5e4, 5e4, 5e3)), Parameter("damping", (250.0, 60.0, 5.0)))
# Columns of a state: MuJoCo's qpos and qvel, and parts of them.
_QPOS = slice(0, 7)
_QVEL = slice(7, 13)
_QUATERNION = slice(3, 7)
_VELOCITY = slice(7, 10)
_SPIN = slice(10, 13)
SHAPES: frozenset[Shape] = frozenset({"box", "ellipsoid", "sphere"})
SETTINGS = (
    ContactSetting(NOTHING, (), "pyramidal"),
    ContactSetting(FRICTION, (MU,), "pyramidal"),
    ContactSetting(FRICTION, (MU,), "elliptic"),
    ContactSetting(SOLREF, (*_SPRING, MU), "elliptic"),
    ContactSetting(PLUGIN_E, (E, MU), "elliptic"),
    ContactSetting(PLUGIN_E, (E, MU), "pyramidal"),
    ContactSetting(PLUGIN_ALPHA, (ALPHA, MU), "elliptic"),
)


def simulate(
    body: Body,
    setting: ContactSetting,
    values: Sequence[float],
    timestep: float,
    tosses: Sequence[Toss],
) -> list[Floats]:
    """Simulate tosses of a body onto a plate by MuJoCo's Euler integrator: states before the first
    step and after each, (steps + 1, 13), an array a toss.

    values: of the setting's parameters, SI, in its order.
    timestep: s.
    tosses: motions to start from, each with its number of steps. A state is position, quaternion w
    x y z, velocity and spin, SI, in the world.
    Raises SettingError for numbers that a plug-in's law does not take, EngineMissing or
    EngineFailed without MuJoCo.
    """
    mujoco = backend()
    model = _model(mujoco, body, setting, values, timestep)
    data = mujoco.MjData(model)
    return [_simulate(mujoco, model, data, toss, timestep) for toss in tosses]


def _model(
    mujoco: Any, body: Body, setting: ContactSetting, values: Sequence[float], timestep: float
) -> Any:
    """The compiled model, MjModel, of a body on a free joint over a plate, under a setting.

    mujoco: the module.
    body: shape, mass and inertia of what is tossed.
    values: of the setting's parameters, SI, in its order.
    timestep: s.
    """
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.gravity = [0.0, 0.0, -GRAVITY]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    if setting.cone == "elliptic":
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    plate = spec.worldbody.add_geom(
        name="plate", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[9.0, 9.0, 0.1]
    )
    tossed = spec.worldbody.add_body(name="body")
    tossed.add_freejoint()
    tossed.mass = body.mass
    tossed.inertia = list(body.inertia)
    tossed.explicitinertial = True
    # MuJoCo 3.3 takes no inertia without its place.
    tossed.ipos = [0.0, 0.0, 0.0]
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{body.shape.upper()}")
    geoms = (plate, tossed.add_geom(name="body", type=kind, size=list(body.half_sizes)))
    given = setting.named(values)
    # Of both geoms alike, as MuJoCo mixes theirs.
    for geom in geoms:
        if "friction" in given:
            geom.friction[0] = given["friction"]
        if setting.name == SOLREF:
            # solref in its direct format; with one impedance its numbers hold at every depth.
            geom.solref = [-given["stiffness"], -given["damping"]]
            geom.solimp[:2] = 0.95, 0.95
    if (law := plugin_law(setting, given)) is not None:
        add_to_spec(spec, law, bodies=("body", "world"))
    return spec.compile()


def _simulate(mujoco: Any, model: Any, data: Any, toss: Toss, timestep: float) -> Floats:
    """Simulate one toss: its states before the first step and after each, (steps + 1, 13), SI, in
    the world: position, quaternion w x y z, velocity and spin.

    Velocities are those of the true motion at the step's end, which differ from the integrator's by
    half a step of gravity.
    mujoco: the module.
    data: MjData of the model, reset here.
    timestep: s.
    """
    mujoco.mj_resetData(model, data)
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, toss.quaternion)
    data.qpos[:3] = toss.position
    data.qpos[3:] = toss.quaternion
    data.qvel[:3] = as_integrated(toss.velocity, timestep)
    # MuJoCo has the spin in the body's frame.
    data.qvel[3:] = turn.reshape(3, 3).T @ toss.spin
    states = np.empty((toss.steps + 1, 13))
    states[0, _QPOS] = data.qpos
    states[0, _QVEL] = data.qvel
    # Looked up once: these are views that follow the state.
    qpos = data.qpos
    qvel = data.qvel
    for row in states[1:]:
        mujoco.mj_step(model, data)
        row[_QPOS] = qpos
        row[_QVEL] = qvel
    states[:, _VELOCITY] = as_body(states[:, _VELOCITY], timestep)
    states[:, _SPIN] = in_world(states[:, _QUATERNION], states[:, _SPIN])
    return states


def in_world(quaternions: Floats, vectors: Floats) -> Floats:
    """Rotate vectors of a body's frame into the world's, arrays of shape (n, 4) and (n, 3)."""
    scalar = quaternions[:, :1]
    axis = quaternions[:, 1:]
    once = 2.0 * np.cross(axis, vectors)
    turned: Floats = vectors + scalar * once + np.cross(axis, once)
    return turned
