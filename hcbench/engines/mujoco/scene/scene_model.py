"""Compiles a scene's MJCF under a setting and checks that MuJoCo sees what the scene says."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings, require_feature
from hcbench.engines.mujoco.scene.elements import as_text
from hcbench.engines.mujoco.scene.mjcf import add_acceleration_sensor, model_path, scene_tree
from hcbench.system.errors import SceneError

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

    from hcbench.engines.mujoco.scene.mjcf import Options
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene

# Overlap at which the model is checked, m.
_OVERLAP = 1e-5
_SHAPE_TOLERANCE = 1e-9  # m
# A ball in free flight is tried at this height in radii, thrown at this speed, m/s, and pushed by
# this acceleration, m/s²: it must obey to the last number.
_CLEAR = 0.5
_THROWN = 1.0
_PUSHED = 1.0
_FREELY = 1e-9


@dataclass(frozen=True, slots=True)
class SceneModel:
    """A compiled model, and where to look in its state.

    root: its MJCF.
    origin: the full state with the ball at qpos0, where it just touches, shape (nstate,).
    at: where position and velocity of the ball start in a state.
    clearance: |R2| - R1 of a cup, None on a plane.
    sensed: the model ends its sensors with the ball's acceleration.
    plugged: a plug-in acts on this model.
    """

    mujoco: Any
    model: Any
    root: ET.Element
    scene: Scene
    timestep: float
    origin: Floats
    at: tuple[int, int]
    clearance: float | None
    sensed: bool
    plugged: bool


def load(scene: Scene, timestep: float, options: Options) -> SceneModel:
    """Compile a scene under a setting, and check that the model is what the scene says.

    timestep: s.
    options: the setting's.

    Raises SettingError for friction or adhesion in a cup, SceneError for a model that is not what
    the scene says, EngineMissing where the installed MuJoCo is too old for the setting.
    """
    mujoco = backend()
    root = scene_tree(scene, timestep, options)
    _require_features(mujoco, options)
    # Under RK4 the change of momentum is a mean of four stages: the force is read off a sensor.
    is_sensed = any(option.get("integrator") == "RK4" for option in root.iterfind("option"))
    if is_sensed:
        add_acceleration_sensor(root)
    with captured_warnings():
        try:
            model = mujoco.MjModel.from_xml_string(as_text(root))
        except ValueError as error:
            what = " ".join(str(error).split())
            raise SceneError(str(model_path(scene)), what, "MJCF that MuJoCo loads") from None
        joint = _find_ball(mujoco, model, scene)
        _check_touch(mujoco, model, joint, scene, options)
        _check_flight(mujoco, model, joint, scene)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        origin = np.empty(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, mujoco.MjData(model), origin, kind)
    # A state is the time, then positions, then velocities.
    position = 1 + int(model.jnt_qposadr[joint])
    velocity = 1 + int(model.nq) + int(model.jnt_dofadr[joint])
    clearance = None
    if scene.form == "cup":
        # |R2| - R1: a cup's radius is below 0.
        clearance = -scene.plate_radius - scene.ball_radius
    return SceneModel(
        mujoco=mujoco,
        model=model,
        root=root,
        scene=scene,
        timestep=timestep,
        origin=origin,
        at=(position, velocity),
        clearance=clearance,
        sensed=is_sensed,
        plugged=options.law is not None,
    )


def _require_features(mujoco: Any, options: Options) -> None:
    """Raise EngineMissing where the installed MuJoCo is too old for a setting."""
    if any(row.adhesion for row in options.rows):
        require_feature(mujoco, "adhesion")
    if options.integrator == "discrete":
        require_feature(mujoco, "integrator 'discrete'")


def _check_touch(mujoco: Any, model: Any, joint: int, scene: Scene, options: Options) -> None:
    """Raise SceneError unless ball and plate just touch at qpos0, with the scene's radii: the ball,
    lowered by _OVERLAP m, must be as deep in the plate.

    mujoco: the module.
    joint: number of the ball's free joint.
    options: of the setting; the first row of a cup begins at its onset.
    """
    data = mujoco.MjData(model)
    data.qpos[int(model.jnt_qposadr[joint]) + 2] -= _OVERLAP
    mujoco.mj_forward(model, data)
    seen = _overlap(mujoco, model, data, scene)
    if scene.form == "cup" and options.rows:
        # The limit of the tendon begins where its row does.
        seen += options.rows[0].onset
    if abs(seen - _OVERLAP) > _SHAPE_TOLERANCE:
        raise SceneError(
            str(model_path(scene)),
            f"ball and plate overlap by {seen:.6e} m where the scene says {_OVERLAP:g} m",
            "the ball to just touch at qpos0, with the radii of scene.toml",
        )


def _check_flight(mujoco: Any, model: Any, joint: int, scene: Scene) -> None:
    """Raise SceneError if anything but gravity acts on the ball off the plate: what else changes its
    momentum would be taken for the contact.

    mujoco: the module.
    joint: number of the ball's free joint.
    """
    path = str(model_path(scene))
    body = int(model.jnt_bodyid[joint])
    data = mujoco.MjData(model)
    if model.opt.enableflags & getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0):
        raise SceneError(path, "lets bodies fall asleep", 'no <flag sleep="enable"/>')
    # Clear of the plate, thrown down and pushed up: damping, air and armature would show. The third
    # numbers of a free joint are vertical.
    data.qpos[model.jnt_qposadr[joint] + 2] += _CLEAR * scene.ball_radius
    dof = int(model.jnt_dofadr[joint])
    data.qvel[dof + 2] = -_THROWN
    pushed = scene.mass * _PUSHED  # N
    data.xfrc_applied[body, 2] = pushed
    mujoco.mj_forward(model, data)
    # Accelerations of x y z, m/s², and of the spin, rad/s².
    expected = np.array([0.0, 0.0, _PUSHED - scene.gravity, 0.0, 0.0, 0.0])
    error = np.abs(data.qacc[dof : dof + 6] - expected).max()
    if not error <= _FREELY * (_PUSHED + scene.gravity):
        raise SceneError(
            path,
            f"off the plate, at {_THROWN:g} m/s and under {pushed:.6g} N, the ball's acceleration is wrong"
            f" by {error:.3g}",
            "only gravity to act on it there",
            "Look for damping, armature, springs, frictionloss, gravcomp, air, a disabled gravity, or"
            " bodies fixed to it",
        )


def _find_ball(mujoco: Any, model: Any, scene: Scene) -> int:
    """Check the body `ball` of a model, and return the number of its free joint.

    mujoco: the module.
    Raises SceneError where the body is not on a free joint, not the scene's sphere, not centred on
    its geom or not as heavy as the scene says.
    """
    path = str(model_path(scene))
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "ball")
    joint = model.body_jntadr[body]
    if model.body_jntnum[body] != 1 or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_FREE:
        raise SceneError(path, "the body 'ball' does not move freely", "a <freejoint/> on it")
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "ball")
    if geom < 0 or model.geom_bodyid[geom] != body:
        raise SceneError(path, "the body 'ball' has no geom 'ball'", "one")
    if model.geom_pos[geom].any() or model.body_ipos[body].any():
        raise SceneError(
            path,
            "the ball's geom or mass is off its body's origin",
            "both at the centre, pos 0 0 0",
        )
    _check_radius(mujoco, model, geom, scene)
    mass = float(model.body_mass[body])
    if not math.isclose(mass, scene.mass, rel_tol=1e-12):
        raise SceneError(
            path,
            f"the body 'ball' weighs {mass!r} kg",
            f"{scene.mass!r} kg as scene.toml says",
            "Give it an <inertial>, or all of its mass to the geom 'ball'",
        )
    return int(joint)


def _check_radius(mujoco: Any, model: Any, geom: int, scene: Scene) -> None:
    """Raise SceneError unless the ball is a sphere of the radius that the scene says; the check of
    the touch alone would let one of another radius pass.

    geom: number of the ball's.
    On a plane it has the scene's relative radius.
    """
    path = str(model_path(scene))
    what = "R1"
    radius = scene.ball_radius
    if scene.form == "plane":
        radius = scene.relative_radius
        what = "1/(1/R1 + 1/R2)"
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_SPHERE:
        raise SceneError(f"{path}: geom 'ball'", "not a sphere", f"a sphere of {radius:.12g} m")
    size = float(model.geom_size[geom][0])
    if abs(size - radius) > _SHAPE_TOLERANCE:
        expected = f"{radius:.12g} m, the {what} of scene.toml"
        raise SceneError(f"{path}: geom 'ball' size", f"{size:.12g} m", expected)


def _overlap(mujoco: Any, model: Any, data: Any, scene: Scene) -> float:
    """Depth of the ball in the plate as MuJoCo sees it, m; in a cup, how far the tendon `contact` is
    beyond its limit.

    data: MjData after mj_forward.

    Raises SceneError where ball and plate, or the limit of a cup, are missing.
    """
    path = str(model_path(scene))
    if scene.form == "cup":
        tendon = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, "contact")
        if tendon < 0 or not model.tendon_range[tendon][1] > 0:
            raise SceneError(
                path, "there is no limited tendon 'contact'", "one between the two centres"
            )
        return float(data.ten_length[tendon] - model.tendon_range[tendon][1])
    ball = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "ball")
    plate = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "plate")
    if plate < 0 or model.body_weldid[model.geom_bodyid[plate]] != 0:
        raise SceneError(path, "there is no fixed geom 'plate'", "one that cannot move")
    return -float(mujoco.mj_geomDistance(model, data, ball, plate, 1.0, None))
