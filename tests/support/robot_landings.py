"""Robots that land on feet of MuJoCo's restitution plug-in, beside the same on its native contact."""

from __future__ import annotations

import copy
import itertools
import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from contact_scenes import require_plugins_in_specs
from outside_models import found_file
from random_scenes import energy

from hcbench.contact.mujoco import ConstantRestitution, Restitution, add_to_spec

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.laws.contact_law import Law

EXAMPLES = Path(__file__).parents[2] / "examples"
LAWS: tuple[Law, ...] = (*map(ConstantRestitution, (0.0, 0.3, 0.6, 0.9)), Restitution(0.3))
HEIGHTS = (0.02, 0.05, 0.1)  # m
TILTS = (0.0, 5.0)  # degrees
GRAVITY = 9.81
FALLEN = 0.6  # of the height of the centre of mass over the floor as the feet touch it
RESTS = 0.02  # m/s and rad/s
FAINT = 0.3  # e up to which a robot hardly leaves the floor again
STIFF = 15.0  # of weight times height: N m/rad of the servos that hold a robot
DAMPED = 0.05  # s, their damping over their stiffness
PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
FREE, SLIDE, HINGE = (
    int(getattr(mujoco.mjtJoint, f"mjJNT_{name}")) for name in ("FREE", "SLIDE", "HINGE")
)
RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


@dataclass(frozen=True)
class Robot:
    """file: of an installed package, or of examples/. feet: a pattern of names of geoms or bodies.

    held: whether servos of the judge hold the joints; else the model's own
    do, or motors without a control.
    """

    name: str
    file: str
    feet: str
    held: bool = True


QUADRUPED = Robot("README's quadruped", "quadruped.xml", ".*_foot", held=False)
_GYM, _SUITE = "gymnasium/envs/mujoco/assets", "dm_control/suite"
ROBOTS = (
    QUADRUPED,
    Robot("gymnasium ant", f"{_GYM}/ant.xml", ".*_ankle_geom"),
    Robot("gymnasium half_cheetah", f"{_GYM}/half_cheetah.xml", "[bf]foot"),
    Robot("gymnasium hopper", f"{_GYM}/hopper.xml", "foot_geom"),
    Robot("gymnasium humanoid", f"{_GYM}/humanoid.xml", "(left|right)_foot"),
    Robot("gymnasium walker2d", f"{_GYM}/walker2d_v5.xml", "foot(_left)?_geom"),
    Robot("dm_control cheetah", f"{_SUITE}/cheetah.xml", "[bf]foot"),
    Robot("dm_control humanoid", f"{_SUITE}/humanoid.xml", "(left|right)_.*foot"),
    Robot("dm_control humanoid_CMU", f"{_SUITE}/humanoid_CMU.xml", "[lr](foot|toes)"),
    Robot("dm_control quadruped", f"{_SUITE}/quadruped.xml", "(toe|foot)_.*"),
    Robot("dm_control walker", f"{_SUITE}/walker.xml", "(left|right)_foot"),
    Robot("safety_gymnasium doggo", "safety_gymnasium/assets/xmls/doggo.xml", "ankle_.*"),
)


def path_of(robot: Robot) -> Path:
    """The robot's file, of the examples or of an installed package."""
    return EXAMPLES / robot.file if "/" not in robot.file else found_file(robot.file)


def compiled(robot: Robot, law: Law | None, step: float | None = None) -> Any:
    """The robot alone over a floor, with the law on its feet, compiled.

    law None: native contact. step: s; None: the model's own.
    """
    require_plugins_in_specs()
    spec = mujoco.MjSpec.from_file(str(path_of(robot)))
    _keep_robot(spec)
    spec.option.timestep = step or spec.option.timestep
    if robot.held:
        _hold(spec)
    model = spec.compile()
    feet = feet_of(robot, model)
    assert feet, robot
    for geom in spec.geoms:
        geom.name = geom.name or f"geom {geom.id}"
        if law is not None and geom.id in feet:
            add_to_spec(spec, law, geoms=(geom.name, "floor"))
    model = spec.compile()
    if robot.held:
        _damp(model)
    return model


def _keep_robot(spec: Any) -> None:
    """Leave the first body of the world, which is the robot, and a floor."""
    for body in list(spec.worldbody.bodies)[1:]:
        spec.delete(body)
    floors = [geom for geom in spec.worldbody.geoms if geom.type == PLANE]
    for geom in spec.worldbody.geoms:
        if geom is not next(iter(floors), None):
            spec.delete(geom)
    floor = (
        floors[0]
        if floors
        else spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 1])
    )
    floor.name = "floor"


def _meets_floor(model: Any, geom: int) -> bool:
    floor, contype, conaffinity = model.geom("floor").id, model.geom_contype, model.geom_conaffinity
    masks = contype[geom] & conaffinity[floor] | contype[floor] & conaffinity[geom]
    return bool(masks and model.geom_bodyid[geom])


def _hold(spec: Any) -> None:
    """Servos in place of the motors, as stiff as the robot's weight needs."""
    for one in [*spec.actuators, *spec.sensors, *spec.keys]:
        spec.delete(one)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    height = float(np.ptp(data.geom_xpos[model.geom_bodyid > 0, 2])) + 0.05
    stiff = STIFF * GRAVITY * float(model.body_mass.sum()) * height
    root = spec.worldbody.bodies[0].name
    for i, joint in enumerate(spec.joints):
        if joint.parent.name == root:
            continue
        joint.name = joint.name or f"joint {i}"
        spec.add_actuator(
            name=f"servo {i}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.name,
            gainprm=[stiff, *[0] * 9], biastype=mujoco.mjtBias.mjBIAS_AFFINE, biasprm=[0, -stiff, *[0] * 8],
            ctrllimited=False, forcelimited=False, actlimited=False, dyntype=mujoco.mjtDyn.mjDYN_NONE,
            gear=[1, 0, 0, 0, 0, 0],
        )  # fmt: skip


def _damp(model: Any) -> None:
    """The damping of the servos, and what RK4 needs of rotor inertia to integrate it."""
    for servo in range(model.nu):
        dof = model.jnt_dofadr[model.actuator_trnid[servo, 0]]
        model.dof_damping[dof] = -DAMPED * model.actuator_biasprm[servo, 1]
        if model.opt.integrator == RK4:
            model.dof_armature[dof] += 0.5 * model.opt.timestep * model.dof_damping[dof]
    mujoco.mj_setConst(model, mujoco.MjData(model))


@dataclass(frozen=True)
class Drop:
    """height: m. phase: share of a step's fall that it starts higher. tilt: of the base, degrees.

    along: speed along x, m/s.
    """

    height: float
    phase: float
    tilt: float
    along: float = 0.0


def drops(phases: int) -> list[Drop]:
    """Drops from each height and tilt, so many phases of the step each."""
    shares = [i / phases for i in range(phases)]
    return [Drop(*one) for one in itertools.product(HEIGHTS, shares, TILTS)]


def released(model: Any, drop: Drop) -> Any:
    """Data of the robot over its floor, its joints within their limits
    and its servos where they are.
    """
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    for joint in range(model.njnt):
        at, (low, high) = model.jnt_qposadr[joint], model.jnt_range[joint]
        if model.jnt_limited[joint] and model.jnt_type[joint] in (SLIDE, HINGE):
            data.qpos[at] = np.clip(
                data.qpos[at], low + 0.05 * (high - low), high - 0.05 * (high - low)
            )
    for servo in range(0 if model.nkey else model.nu):
        if model.actuator_biasprm[servo, 1] != 0:
            data.ctrl[servo] = data.qpos[model.jnt_qposadr[model.actuator_trnid[servo, 0]]]
    up = _tilt(model, data, np.radians(drop.tilt))
    mujoco.mj_forward(model, data)
    floor = model.geom("floor").id
    geoms = [geom for geom in range(model.ngeom) if _meets_floor(model, geom)]
    gap = min(mujoco.mj_geomDistance(model, data, geom, floor, 9.0, None) for geom in geoms)
    fall = math.sqrt(2 * GRAVITY * drop.height) * model.opt.timestep
    data.qpos[up] += drop.height + drop.phase * fall - gap
    data.qvel[0] = drop.along
    mujoco.mj_forward(model, data)
    return data


def _tilt(model: Any, data: Any, angle: float) -> int:
    """Turn the base; the place of its height in qpos."""
    base = [
        joint for joint in range(model.njnt) if model.body_parentid[model.jnt_bodyid[joint]] == 0
    ]
    kind, at = model.jnt_type, model.jnt_qposadr
    if kind[base[0]] == FREE:
        first, turn, turned = at[base[0]], np.zeros(4), np.zeros(4)
        mujoco.mju_axisAngle2Quat(turn, np.array([0.6, 0.8, 0.0]), angle)
        mujoco.mju_mulQuat(turned, turn, data.qpos[first + 3 : first + 7])
        data.qpos[first + 3 : first + 7] = turned
        return int(first) + 2
    data.qpos[next(at[j] for j in base if kind[j] == HINGE)] += angle
    return int(next(at[j] for j in base if kind[j] == SLIDE and abs(model.jnt_axis[j][2]) > 0.9))


@dataclass
class Landing:
    """depth: the largest of a foot in the floor, m. gain: of energy,
    as a share of that of the drop.

    speed: the fastest of the last tenth, m/s or rad/s. travel: of the centre of mass, m. seconds:
    simulated, to the end or to the fall.
    """

    depth: float = 0.0
    gain: float = 0.0
    speed: float = 0.0
    travel: float = 0.0
    seconds: float = 0.0
    fell: bool = False
    warned: list[str] = field(default_factory=list)

    @property
    def stands(self) -> bool:
        """Say whether the robot has not fallen, and nothing moves any more."""
        return not self.fell and self.speed < RESTS


def feet_of(robot: Robot, model: Any) -> list[int]:
    """The geoms of the robot that are its feet."""
    every = range(model.ngeom)
    return [g for g in every if is_named_foot(robot, model, g) and _meets_floor(model, g)]


def is_named_foot(robot: Robot, model: Any, geom: int) -> bool:
    """Say whether the name of a geom, or of its body, is one of the robot's feet."""
    names = model.geom(geom).name, model.body(model.geom_bodyid[geom]).name
    return any(name and re.fullmatch(robot.feet, name) for name in names)


def land(
    model: Any, robot: Robot, drop: Drop, seconds: float, *, to_the_fall: bool = False
) -> Landing:
    """Let the robot land, for so long, or until it falls."""
    data, seen = released(model, drop), Landing()
    free, alone = copy.copy(model), mujoco.MjData(model)
    free.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    free.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    first, com = _energy(free, alone, data), data.subtree_com[0].copy()
    is_foot = np.isin(np.arange(model.ngeom + 1), feet_of(robot, model))  # -1, of flexes, is none
    floor, steps = model.geom("floor").id, round(seconds / model.opt.timestep)
    fallen = FALLEN * (com[2] - drop.height)
    mujoco.set_mju_user_warning(seen.warned.append)
    try:
        for step in range(steps):
            mujoco.mj_step(model, data)
            geoms = data.contact.geom
            lands = (geoms == floor).any(axis=1) & is_foot[geoms].any(axis=1)
            seen.depth = max(seen.depth, -float(np.min(data.contact.dist[lands], initial=0.0)))
            if step > 0.9 * steps:
                seen.speed = max(seen.speed, float(np.abs(data.qvel).max()))
            if step % 4 == 0:
                seen.gain = max(seen.gain, _energy(free, alone, data) - first)
            seen.seconds = (step + 1) * model.opt.timestep
            seen.fell = bool(data.subtree_com[0, 2] < fallen)
            if to_the_fall and seen.fell:
                break
    finally:
        mujoco.set_mju_user_warning(None)
    seen.warned = [words for words in seen.warned if words.startswith("plugin hcbench")]
    seen.gain /= GRAVITY * float(model.body_mass.sum()) * drop.height
    seen.travel = float(np.linalg.norm((data.subtree_com[0] - com)[:2]))
    return seen


def _energy(free: Any, alone: Any, data: Any) -> float:
    """J, in the scene without contact."""
    alone.qpos[:], alone.qvel[:], alone.ctrl[:] = data.qpos, data.qvel, data.ctrl
    if free.na:
        alone.act[:] = data.act
    return energy(free, alone)


@dataclass
class Landings:
    """Landings of a robot, of each law, beside those on native contact.

    Those that fall there end with the fall. bounces: flags of those whose law asks for an e above
    FAINT.
    """

    step: float
    native: list[Landing]
    own: list[Landing]
    bounces: list[bool]

    @classmethod
    def of(
        cls,
        robot: Robot,
        laws: Sequence[Law],
        phases: int,
        seconds: float,
        step: float | None = None,
    ) -> Landings:
        """Let the robot land. step: s, None: the model's."""
        model, every = compiled(robot, None, step), drops(phases)
        native = [land(model, robot, drop, seconds, to_the_fall=True) for drop in every]
        found = cls(float(model.opt.timestep), [], [], [])
        for law in laws:
            model = compiled(robot, law, step)
            found.native += native
            faint = isinstance(law, ConstantRestitution) and float(law.restitution) <= FAINT
            found.bounces += [not faint] * len(native)
            found.own += [
                land(model, robot, drop, one.seconds)
                for drop, one in zip(every, native, strict=True)
            ]
        return found

    def named(self) -> list[bool]:
        """Flags of those in which the plug-in warned."""
        return [bool(one.warned) for one in self.own]

    def deeper(self) -> list[float]:
        """Depths beyond those on native contact, m."""
        return [own.depth - native.depth for own, native in self._both()]

    def restless(self) -> list[bool]:
        """Flags of those that move on and stand on native contact."""
        return [native.stands and not own.stands for own, native in self._both()]

    def further(self) -> list[float]:
        """Travel beyond that on native contact, m; 0 for those that fall there."""
        return [0.0 if native.fell else own.travel - native.travel for own, native in self._both()]

    def _both(self) -> Iterator[tuple[Landing, Landing]]:
        return zip(self.own, self.native, strict=True)

    def advised(self) -> float | None:
        """The coarsest step that satisfies each warning, s; None without one."""
        said = [
            re.search(r"timestep of (?:at most )?([0-9.e-]+)$", words)
            for one in self.own
            for words in one.warned
        ]
        return min((float(one[1]) for one in said if one), default=None)

    def row(self, name: str) -> list[str]:
        """The cells of the page's table."""
        pairs = zip(self.further(), self.bounces, strict=True)
        faint = [further for further, bounces in pairs if not bounces]
        return [
            self.label(name),
            str(len(self.own)),
            str(sum(self.named())),
            str(sum(one.fell for one in self.native)),
            up(max(self.deeper()) * 1e3),
            up(max(one.gain for one in self.own) * 100),
            str(sum(self.restless())),
            f"{math.ceil(max(faint, default=0.0) * 1e3)}",
            f"{math.ceil(max(self.further()) * 1e3)}",
        ]

    def label(self, name: str) -> str:
        """The row's name: the robot and its step."""
        return f"{name}, {self.step * 1e3:.3g} ms"


def up(value: float) -> str:
    """A number, rounded up to a tenth."""
    return f"{math.ceil(value * 10 - 1e-6) / 10 + 0.0:.1f}"
