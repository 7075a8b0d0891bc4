"""A robot over the parts of the world that it can land on: how far it is above them, and what drives
its joints while it lands.
"""

from __future__ import annotations

import copy
import inspect
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import body_name
from hcbench.system.errors import UserError
from hcbench.terms import units
from hcbench.terms.impact import Floats
from hcbench.terms.options import Controller

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Sequence

    from numpy.typing import NDArray

    from hcbench.terms.impact import Floats


# A floor is looked for this far below a robot, and as far above one that starts inside it, m.
_FARTHEST = 10.0
# Step of that search, m, and halvings of it afterwards: after 40 the height is exact to rounding.
_SCAN = 0.01
_ROUNDS = 40


class OverFloor:
    """A robot in a compiled model, and what stands still around it.

    root: number of the robot's base body; all that hangs on it is the robot.
    gravity: m/s²; up: unit vector against it, (3,).
    mass: kg; weight: N.
    of_robot, of_floor: of each geom whether it is the robot's, and whether it stands still, (ngeom
    + 1,).
    A contact of a flex has the geom -1, which finds the False at their ends.
    """

    def __init__(self, model: Any, root: int) -> None:
        """Read a robot and its floors from a compiled model, which must have gravity.

        root: number of the robot's base body.
        """
        self.model = model
        self.root = root
        self.gravity = float(np.linalg.norm(model.opt.gravity))
        self.up: Floats = -np.asarray(model.opt.gravity) / self.gravity
        self.mass = float(model.body_subtreemass[root])
        self.weight = self.mass * self.gravity
        # A contact of a flex has the geom -1, which finds the False at the ends.
        body_of_geom = np.asarray(model.geom_bodyid)
        self.of_robot = np.append(model.body_rootid[body_of_geom] == root, False)
        # MuJoCo welds what stands still to the world, whose number is 0.
        self.of_floor = np.append(model.body_weldid[body_of_geom] == 0, False)

    @property
    def name(self) -> str:
        """Name of the robot's base."""
        return body_name(self.model, self.root)

    def between(self, geoms: NDArray[Any]) -> NDArray[np.bool_]:
        """Mask, (n,), of the contacts between the robot and what stands still.

        geoms: numbers of the two geoms of each contact, (n, 2), in either order.
        """
        one = geoms[:, 0]
        other = geoms[:, 1]
        touches_robot = self.of_robot[one] | self.of_robot[other]
        touches_floor = self.of_floor[one] | self.of_floor[other]
        return np.asarray(touches_robot & touches_floor)

    def is_touching(self, data: Any) -> bool:
        """Say whether the robot touches what stands still in the pose that `data` has."""
        backend().mj_fwdPosition(self.model, data)
        contacts = data.contact
        acts = (contacts.dist <= 0.0) & (contacts.exclude == 0)
        return bool((self.between(contacts.geom) & acts).any())

    def way_up(self, data: Any, rise: Floats) -> float:
        """Height by which to raise the robot of a pose until it just clears the floor, m; below 0
        to lower it.

        data: MjData with the pose, which stays as it is.
        rise: velocities that raise the robot by 1 m/s, (nv,).
        Raises UserError where the robot meets nothing within _FARTHEST.
        """
        raised = copy.copy(data)

        def is_touching_at(height: float) -> bool:
            raised.qpos[:] = data.qpos
            backend().mj_integratePos(self.model, raised.qpos, rise, height)
            return self.is_touching(raised)

        return _way_up(is_touching_at, self.name)


def _way_up(is_touching_at: Callable[[float], bool], robot: str) -> float:
    """Height by which to raise a robot until it just clears the floor, m; below 0 to lower it.

    is_touching_at: whether the robot touches the floor when it is raised by a height, m.
    robot: its name in errors.
    Raises UserError where nothing is below it.
    """
    # Up, out of the floor that it is in, or down to where it first touches.
    is_in_floor = is_touching_at(0.0)
    step = _SCAN if is_in_floor else -_SCAN
    for i in range(1, round(_FARTHEST / _SCAN)):
        end = step * i
        if is_touching_at(end) is not is_in_floor:
            break
    else:
        raise UserError(
            "model",
            f"{robot!r} has nothing below to land on, down to {_FARTHEST:g} m",
            "a floor",
            'Add a floor: <geom type="plane" size="0 0 1"/> in the worldbody',
        )
    # Between the two heights the touch begins: it touches at the lower one alone.
    low = end
    high = end + _SCAN
    if is_in_floor:
        low = end - _SCAN
        high = end
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        if is_touching_at(middle):
            low = middle
        else:
            high = middle
    return high


# Controllers of a robot's joints while it lands: PD at its pose, the pose's own controls, or a
# function.

# Function that sets the controls of an MjData.
Drive = Callable[[Any], None]

# kd over kp, s.
_SHARE = 0.05
# An explicit PD with more than these shares of I/h² and I/h is not stable at the step h.
_MOST_KP = 0.1
_MOST_KD = 0.3


def drive_of(
    controller: Controller, model: Any, start: Any, root: int, posed: Container[int] = ()
) -> tuple[Drive, str]:
    """Make the function of MjData that sets the controls before each step, and a phrase that
    describes it.

    controller: "pd", "pd:KP,KD", "ctrl", or a function of (MjModel, MjData).
    start: MjData of the pose to hold; with "pd" its servos' filters settle.
    root: number of the robot's base body.
    posed: numbers of joints that a user put where they are, see `_holding`.

    Raises UserError for another one, for gains other than numbers from 0 up, and for a function of
    other arguments; the drive of a function also raises it, for controls that do not fit.
    """
    if callable(controller):
        return _function(controller, model), getattr(controller, "__name__", "a function")
    if controller == "ctrl":
        return lambda data: None, "the controls of the pose"
    kind, colon, text = controller.partition(":")
    if kind != "pd":
        expected = "pd, pd:KP,KD, ctrl, or FILE.py:FUNCTION"
        raise UserError("controller", repr(controller), expected)
    gains: list[float] = []
    if colon:
        gains = [units.parse(gain, "number", "controller") for gain in text.split(",")]
    drive, words = _pd(model, start, root, gains, posed)
    before = start.ctrl.copy()
    drive(start)
    _settle(model, start, start.ctrl)
    start.ctrl[:] = before
    return drive, words


def _settle(model: Any, data: Any, controls: Floats) -> None:
    """Give every actuator with one activation that of the pose at rest, where the pose has none of
    its own: a filter or a muscle its control, as after long, a servo that integrates its length.

    data: MjData of the pose, with its kinematics.
    """
    if data.act.any():
        return
    for actuator in np.flatnonzero(model.actuator_actnum == 1).tolist():
        if not _integrates(model, actuator):
            activation = controls[actuator]
        elif float(model.actuator_biasprm[actuator, 1]) < 0.0:
            activation = data.actuator_length[actuator]
        else:
            # A motor's: its torque is 0.
            activation = 0.0
        data.act[model.actuator_actadr[actuator]] = activation


def _integrates(model: Any, actuator: int) -> bool:
    """Say whether the control of an actuator is the rate of its activation, as of `intvelocity`."""
    return int(model.actuator_dyntype[actuator]) == int(backend().mjtDyn.mjDYN_INTEGRATOR)


def _function(function: Callable[[Any, Any], Any], model: Any) -> Drive:
    """Make the function that sets the controls before each step out of a user's function of
    (MjModel, MjData), which returns the controls, (nu,), or sets them itself and returns None.

    Raises UserError for a function of other arguments and, while it drives, for controls of another
    number or that are not finite.
    """
    expected = f"{model.nu} finite controls, or None"
    # Functions of compiled libraries may have no signature.
    with suppress(ValueError):
        signature = inspect.signature(function)
        try:
            signature.bind(model, None)
        except TypeError:
            got = f"a function of {signature}"
            raise UserError("controller", got, "a function of (model, data)") from None

    def drive(data: Any) -> None:
        """Set the controls that the function returns. Raises UserError for ones that do not fit."""
        controls = function(model, data)
        if controls is None:
            return
        try:
            values = np.asarray(controls, dtype=float).reshape(-1)
        except (TypeError, ValueError):
            got = f"the controller returned {controls!r:.60}"
            raise UserError("controller", got, expected) from None
        if values.shape != data.ctrl.shape or not np.isfinite(values).all():
            got = f"the controller returned {values.size} numbers"
            raise UserError("controller", got, expected)
        data.ctrl[:] = values

    return drive


def _pd(
    model: Any, start: Any, root: int, gains: list[float], posed: Container[int]
) -> tuple[Drive, str]:
    """Make the function that holds the pose of one robot by its hinges and slides, and a phrase that
    describes it.

    Position servos get the controls of the pose or their joint's angle as target, see `_holding`;
    motors get PD torques; actuators that integrate their control get 0, which keeps what they hold,
    see `_settle`; joints without an actuator are free.

    start: MjData of the pose to hold, with its kinematics and mass matrix.
    root: number of the robot's base body; actuators of other robots keep their controls.
    gains: kp and kd in SI, or [] for those by weight and inertia.
    posed: numbers of joints.

    Raises UserError for gains that are not two numbers from 0 up.
    """
    if gains and (len(gains) != 2 or min(gains) < 0):
        raise UserError(
            "controller", f"pd with {len(gains)} gains", "two from 0 up: pd:KP,KD, such as pd:60,2"
        )
    drive = _holding(model, start, root, gains, posed)
    described = []
    if drive.servos.size:
        few = "1 position servo holds its joint"
        many = f"{drive.servos.size} position servos hold their joints"
        by = " by the pose's ctrl" if drive.by_controls else ""
        described.append((few if drive.servos.size == 1 else many) + by)
    if drive.resting.size:
        few = "1 actuator that integrates its control"
        many = f"{drive.resting.size} actuators that integrate their controls"
        described.append(f"{few if drive.resting.size == 1 else many}, at 0")
    if drive.motors:
        kp_span = _span([motor.kp for motor in drive.motors])
        kd_span = _span([motor.kd for motor in drive.motors])
        noun = "motor" if len(drive.motors) == 1 else "motors"
        described.append(f"{len(drive.motors)} {noun} by PD, kp {kp_span}, kd {kd_span} (SI)")
    if not described:
        words = "the controls of the pose" if model.nu else "no actuators: its joints are free"
        return (lambda data: None), words
    return drive, "; ".join(described)


def _holding(
    model: Any, start: Any, root: int, gains: Sequence[float], posed: Container[int]
) -> _Pd:
    """Find the position servos and the motors of a robot that can hold its pose, with the targets of
    the servos and the gains of the motors.

    A pose that gives controls means them: by them a gripper squeezes what it holds. A keyframe without
    has zeros, by which a robot would leave its pose: its servos get the joints' angles.

    start: MjData of the pose, with its kinematics and mass matrix.
    root: number of the robot's base body.
    gains: kp and kd of all motors, SI; [] for gains chosen by weight and inertia.
    posed: numbers of joints that a user put elsewhere than the pose with its controls.
    """
    servos: list[int] = []
    angles: list[float] = []
    unposed: list[int] = []
    motors: list[_Motor] = []
    resting: list[int] = []
    for actuator in range(model.nu):
        joint = int(model.actuator_trnid[actuator, 0])
        if not _turns_or_slides(model, actuator, joint):
            continue
        if int(model.body_rootid[model.jnt_bodyid[joint]]) != root:
            continue
        # Index of the joint's angle, rad, or position, m, in qpos.
        angle = int(model.jnt_qposadr[joint])
        gear = float(model.actuator_gear[actuator, 0]) or 1.0
        gain = float(model.actuator_gainprm[actuator, 0])
        bias = model.actuator_biasprm[actuator]
        if _integrates(model, actuator):
            # `_settle` gives it the angle to hold, from which any other control moves it.
            resting.append(actuator)
            continue
        # MuJoCo: force = gain ctrl + b0 + b1 length + b2 velocity.
        # A position servo has -kp in the second number of its bias.
        if float(bias[1]) < 0.0:
            if joint not in posed:
                unposed.append(len(servos))
            servos.append(actuator)
            angles.append(gear * float(start.qpos[angle]))
        elif gain != 0.0 and not bias.any():
            kp, kd = gains or _gains(model, start, root, joint)
            dof = int(model.jnt_dofadr[joint])
            motors.append(_Motor(actuator, gear * gain, angle, dof, kp, kd))
    targets = np.array(angles)
    given = start.ctrl[servos]
    by_controls = bool(given[unposed].any())
    if by_controls:
        targets[unposed] = given[unposed]
    return _Pd(
        pose=start.qpos.copy(),
        servos=np.array(servos, int),
        targets=targets,
        by_controls=by_controls,
        motors=tuple(motors),
        resting=np.array(resting, int),
    )


def hold_pose(model: Any, start: Any, root: int, posed: Container[int] = ()) -> tuple[Floats, str]:
    """Let constant controls hold the pose of a robot: return these controls, (nu,), and a phrase of
    what holds the pose.

    model: changed: its motors become servos with the gains and largest torques that PD control
    would give them.
    start: MjData of the pose, whose filters settle.
    root: number of the robot's base body.
    posed: numbers of joints that a user put where they are, see `_holding`.
    """
    before = start.ctrl.copy()
    drive, words = _pd(model, start, root, [], posed)
    # The controls at rest in the pose, read off the start, whose own stay.
    drive(start)
    controls: Floats = start.ctrl.copy()
    start.ctrl[:] = before
    motors: tuple[_Motor, ...] = ()
    if isinstance(drive, _Pd):
        motors = drive.motors
    for motor in motors:
        actuator = motor.actuator
        # A servo of MuJoCo: force = kp (ctrl - length) - kd velocity, along its length, which is the
        # gear times the angle; the torque is the gear times the force.
        gear = float(model.actuator_gear[actuator, 0]) or 1.0
        # The largest torques of the motor, as forces of the servo.
        limit = motor.gain / gear * model.actuator_ctrlrange[actuator]
        if model.actuator_ctrllimited[actuator] and not model.actuator_forcelimited[actuator]:
            model.actuator_forcelimited[actuator] = 1
            model.actuator_forcerange[actuator] = sorted(limit)
        model.actuator_ctrllimited[actuator] = 0
        model.actuator_gainprm[actuator, 0] = motor.kp / gear**2
        model.actuator_biastype[actuator] = int(backend().mjtBias.mjBIAS_AFFINE)
        model.actuator_biasprm[actuator, 1:3] = -motor.kp / gear**2, -motor.kd / gear**2
        controls[actuator] = gear * float(start.qpos[motor.angle])
    _settle(model, start, controls)
    return controls, words


class _Motor(NamedTuple):
    """A motor under PD control.

    gain: its torque, or force, for a control of 1.
    angle, dof: places of its joint in qpos and qvel.
    kp, kd: SI.
    """

    actuator: int
    gain: float
    angle: int
    dof: int
    kp: float
    kd: float


@dataclass(frozen=True, slots=True)
class _Pd:
    """Servos and motors that hold a pose.

    pose: its qpos.
    servos: numbers of the position servos; targets: their controls, alike.
    by_controls: whether these are the pose's own, and not the angles of the joints.
    resting: numbers of the actuators that integrate their control, which is 0.
    """

    pose: Floats
    servos: Any
    targets: Floats
    by_controls: bool
    motors: tuple[_Motor, ...]
    resting: Any

    def __call__(self, data: Any) -> None:
        """Set the controls of an MjData."""
        data.ctrl[self.resting] = 0.0
        data.ctrl[self.servos] = self.targets
        for motor in self.motors:
            behind = self.pose[motor.angle] - data.qpos[motor.angle]
            torque = motor.kp * behind - motor.kd * data.qvel[motor.dof]
            data.ctrl[motor.actuator] = torque / motor.gain


def _turns_or_slides(model: Any, actuator: int, joint: int) -> bool:
    """Say whether an actuator acts on a joint, and that is a hinge or a slide."""
    kinds = backend()
    if int(model.actuator_trntype[actuator]) != int(kinds.mjtTrn.mjTRN_JOINT):
        return False
    return int(model.jnt_type[joint]) >= int(kinds.mjtJoint.mjJNT_SLIDE)


def _span(values: list[float]) -> str:
    low = min(values)
    high = max(values)
    return f"{low:.3g}" if low == high else f"{low:.3g} ... {high:.3g}"


def _gains(model: Any, data: Any, root: int, joint: int) -> tuple[float, float]:
    """Choose gains kp and kd for the motor of a joint: N m/rad and N m s/rad of a hinge, N/m and
    N s/m of a slide.

    data: MjData of the pose, with its kinematics and mass matrix.
    root: number of the robot's base body.
    joint: number of the joint.

    With this kp the robot's whole weight, at the end of what the joint carries, would turn the
    joint by 1 rad (move a slide by 2 cm); kd is a share of that kp. Then both are limited so that the
    time step stays stable. Without gravity the weight is taken as 1 N.
    """
    h = float(model.opt.timestep)
    dof = int(model.jnt_dofadr[joint])
    gravity = float(np.linalg.norm(model.opt.gravity))
    weight = float(model.body_subtreemass[root]) * gravity or 1.0
    if int(model.jnt_type[joint]) == int(backend().mjtJoint.mjJNT_SLIDE):
        kp = weight / 0.02
    else:
        kp = weight * _reach(model, data, int(model.jnt_bodyid[joint]), data.xanchor[joint])
    row: Floats = np.zeros((1, model.nv))
    row[0, dof] = 1.0
    solved = np.zeros((1, model.nv))
    backend().mj_solveM(model, data, solved, row)
    # Inertia that the joint feels with all other joints at liberty: kg m², kg for a slide.
    inertia = 1.0 / float(solved[0, dof])
    kd = min(_SHARE * kp, _MOST_KD * inertia / h)
    return min(kp, _MOST_KP * inertia / h**2), kd


def _reach(model: Any, data: Any, body: int, anchor: Floats) -> float:
    """Distance from a joint's anchor to the centre of the farthest geom that hangs on it, m; 0.1 m,
    a guess, where that is 0 or infinite.

    data: MjData with the kinematics.
    body: number of the joint's.
    anchor: (3,), m, in the world.
    """
    reach = 0.0
    for geom in range(model.ngeom):
        above = int(model.geom_bodyid[geom])
        # A body's parent has a smaller number than the body.
        while above > body:
            above = int(model.body_parentid[above])
        if above == body:
            reach = max(reach, float(np.linalg.norm(data.geom_xpos[geom] - anchor)))
    # Nothing finite hangs on the joint: 0.1 m is a guess.
    return reach if reach > 0 and math.isfinite(reach) else 0.1
