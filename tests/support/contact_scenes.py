"""Scenes with several contacts at once for MuJoCo's plug-ins, and what becomes of their energy."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import free_flight
import mujoco
import numpy as np
import pytest

from hcbench.contact.mujoco import ConstantRestitution, add_to_spec

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike

    from hcbench.laws.contact_law import Law
    from hcbench.terms.impact import Floats

BALL, BOX = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_BOX
RADIUS = 0.05


def require_plugins_in_specs() -> None:
    """Skip the test where the installed MuJoCo takes plug-ins in MJCF only."""
    if not hasattr(mujoco.MjSpec, "activate_plugin"):
        pytest.skip("this MuJoCo's MjSpec takes no plug-ins")


@dataclass
class Scene:
    """Bodies that meet each other and, if there is a floor, the floor, by one law.

    start: qvel. friction: of all geoms.
    """

    spec: Any
    law: Law | None
    start: Sequence[tuple[str, ArrayLike]] = ()

    def model(self) -> Any:
        """Compiled, with an instance of the plug-in for each pair of bodies
        that have geoms and may meet.
        """
        require_plugins_in_specs()
        bodies = [body for body in self.spec.bodies if body.geoms]
        apart = [{one.bodyname1, one.bodyname2} for one in self.spec.excludes]
        for one, two in combinations(bodies, 2):
            if self.law is not None and {one.name, two.name} not in apart:
                add_to_spec(self.spec, self.law, bodies=(one.name, two.name))
        return self.spec.compile()

    def data(self, model: Any) -> Any:
        """The state at the start."""
        data = mujoco.MjData(model)
        for body, velocity in self.start:
            joint = model.body(body).jntadr[0]
            dof = model.jnt_dofadr[joint]
            data.qvel[dof : dof + np.size(velocity)] = velocity
        return data


def world(
    h: float, *, gravity: float = 9.81, floor: bool = True, friction: float = 0.5, cone: str = "pyramidal",
    integrator: str = "Euler", solver: str = "Newton", noslip: int = 0,
) -> Any:  # fmt: skip
    """An MjSpec with a floor or none. noslip: iterations."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = h, [0, 0, -gravity]
    spec.option.cone = getattr(mujoco.mjtCone, f"mjCONE_{cone.upper()}")
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    spec.option.solver = getattr(mujoco.mjtSolver, f"mjSOL_{solver.upper()}")
    spec.option.noslip_iterations = noslip
    spec.option.enableflags = int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    spec.memory = 2**26
    if floor:
        size = [5, 5, 1]
        spec.worldbody.add_geom(
            name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=size, friction=[friction, 0, 0]
        )
    return spec


def add_body(
    spec: Any, name: str, at: ArrayLike, kind: Any = BALL, size: ArrayLike = (RADIUS, 0, 0),
    mass: float = 1.0, friction: float = 0.5, condim: int = 3, quat: ArrayLike = (1, 0, 0, 0),
) -> Any:  # fmt: skip
    """A free body of one geom."""
    body = spec.worldbody.add_body(name=name, pos=np.asarray(at), quat=np.asarray(quat))
    body.add_freejoint()
    shape = {
        "type": kind,
        "size": np.asarray(size),
        "mass": mass,
        "friction": [friction, 0, 0],
        "condim": condim,
    }
    body.add_geom(name=name, **shape)
    return body


def row(
    n: int, h: float, law: Law | None, moving: int = 1, speed: float = 1.0, friction: float = 0.0
) -> Scene:
    """Balls that touch in a row without gravity; the first ones come in."""
    spec = world(h, gravity=0.0, floor=False)
    for i in range(n):
        gap = 0.1 * RADIUS if i < moving else 0.0
        add_body(spec, f"b{i}", (2 * RADIUS * i - gap, 0, 0), friction=friction)
    return Scene(spec, law, [(f"b{i}", [speed, 0, 0]) for i in range(moving)])


def rack(h: float, law: Law | None, speed: float = 3.0, friction: float = 0.1) -> Scene:
    """Ten balls on a table, and a cue ball that breaks them."""
    spec = world(h, friction=friction)
    add_body(spec, "cue", (-0.3, 0, RADIUS), friction=friction)
    for i in range(4):
        for j in range(i + 1):
            at = (np.sqrt(3) * RADIUS * i, RADIUS * (2 * j - i), RADIUS)
            add_body(spec, f"b{i}{j}", at, friction=friction)
    return Scene(spec, law, [("cue", [speed, 0, 0])])


def stack(
    n: int, h: float, law: Law | None, friction: float = 0.5, gap: float = 0.0, **options: Any
) -> Scene:
    """Boxes on each other."""
    spec = world(h, friction=friction, **options)
    for i in range(n):
        at = (0, 0, RADIUS * (2 * i + 1) + gap * (i + 1))
        add_body(spec, f"b{i}", at, BOX, (RADIUS,) * 3, friction=friction)
    return Scene(spec, law)


def cradle(n: int, h: float, law: Law | None, angle: float = 0.5) -> Scene:
    """Balls on hinges that touch; the first one is lifted."""
    spec = world(h, floor=False)
    for i in range(n):
        body = spec.worldbody.add_body(name=f"b{i}", pos=[2 * RADIUS * i, 0, 1.0])
        body.add_joint(name=f"b{i}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
        body.add_geom(
            name=f"b{i}",
            type=BALL,
            size=[RADIUS, 0, 0],
            pos=[0, 0, -0.5],
            mass=1.0,
            friction=[0, 0, 0],
        )
    made = Scene(spec, law)
    made.spec.add_key(name="start", qpos=[angle] + [0.0] * (n - 1))
    return made


def pile(
    seed: int, h: float, law: Law | None, n: int = 8, integrator: str = "implicit", **options: Any
) -> Scene:
    """Boxes and balls of 100:1 in mass that fall on each other.

    By the integrator `implicit`: under Euler a box that spins fast about
    unequal axes wins energy in flight.
    """
    rng = np.random.default_rng(seed)
    friction = float(rng.choice([0.0, 0.001, 0.1, 0.5, 1.0]))
    cone = {"cone": str(rng.choice(["pyramidal", "elliptic"]))}
    spec = world(h, friction=friction, integrator=integrator, **(cone | options))
    for i in range(n):
        quat = rng.normal(size=4)
        size = rng.uniform(0.03, 0.06, 3)
        at = (*rng.uniform(-0.1, 0.1, 2), 0.15 + 0.15 * i)
        kind = (BALL, BOX)[int(rng.integers(2))]
        add_body(spec, f"b{i}", at, kind, size, 10 ** rng.uniform(-1, 1), friction, quat=quat)
    return Scene(spec, law, [(f"b{i}", rng.normal(size=6)) for i in range(n)])


def tumbling(
    seed: int,
    h: float,
    law: Law | None,
    friction: float,
    cone: str = "pyramidal",
    size: ArrayLike = (0.05, 0.08, 0.03),
    **options: Any,
) -> Scene:
    """One box that falls on a corner, turning."""
    rng = np.random.default_rng(seed)
    spec = world(h, friction=friction, cone=cone, **options)
    quat = rng.normal(size=4)
    add_body(spec, "box", (0, 0, 0.3), BOX, size, 1.0, friction, quat=quat)
    return Scene(spec, law, [("box", rng.normal(size=6) * [1, 1, 1, 5, 5, 5])])


def chain(
    seed: int,
    h: float,
    law: Law | None,
    integrator: str = "Euler",
    limited: bool = False,
    geared: bool = False,
) -> Scene:
    """Four links on hinges that fall on the floor; their ranges end, or two of them turn together."""
    rng = np.random.default_rng(seed)
    spec = world(h, friction=0.3, integrator=integrator)
    parent = spec.worldbody
    for i in range(4):
        parent = parent.add_body(name=f"l{i}", pos=[0.15, 0, 0] if i else [0, 0, 0.5])
        if i:
            hinge = {"type": mujoco.mjtJoint.mjJNT_HINGE, "axis": [0, 1, 0], "armature": 0.005}
            parent.add_joint(name=f"j{i}", range=[-0.3, 0.4], limited=limited, **hinge)
            spec.add_exclude(bodyname1=f"l{i - 1}", bodyname2=f"l{i}")
        else:
            parent.add_freejoint()
        shape = {
            "type": mujoco.mjtGeom.mjGEOM_CAPSULE,
            "fromto": [0.03, 0, 0, 0.12, 0, 0],
            "condim": 3,
        }
        mass = 10 ** rng.uniform(-0.5, 0.5)
        parent.add_geom(name=f"l{i}", size=[0.025, 0, 0], mass=mass, friction=[0.3, 0, 0], **shape)
    if geared:
        add_equality(spec, "joint", "j1", "j2", [0, 1])
    return Scene(spec, law, [("l0", rng.normal(size=6))])


def add_equality(spec: Any, kind: str, one: str, two: str, numbers: ArrayLike) -> None:
    """A weld or connect of two bodies, or a joint that follows another; its first numbers."""
    of = mujoco.mjtObj.mjOBJ_JOINT if kind == "joint" else mujoco.mjtObj.mjOBJ_BODY
    made = spec.add_equality(
        type=getattr(mujoco.mjtEq, f"mjEQ_{kind.upper()}"), objtype=of, name1=one, name2=two
    )
    made.data[:] = 0.0
    made.data[: np.size(numbers)] = numbers


def full_mass(model: Any, data: Any) -> Floats:
    """The mass matrix, shape (nv, nv)."""
    mass = np.zeros((model.nv, model.nv))
    try:
        mujoco.mj_fullM(model, data, mass)
    except TypeError:  # as it was before MuJoCo 3.10
        mujoco.mj_fullM(model, mass, data.qM)
    return mass


def before_turning(model: Any, body: int, w: Floats) -> Floats:
    """Angular velocity from which a free body turns to `w` in a step, in body axes, shape (3,)."""
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[body])
    inertia = axes.reshape(3, 3) @ np.diag(model.body_inertia[body]) @ axes.reshape(3, 3).T
    return free_flight.before_turning(inertia, w, model.opt.timestep)


def kept_in_flight(model: Any, data: Any) -> float:
    """Kinetic and potential energy, J, as steps keep it in flight: half a
    step of gravity in each velocity.

    Their energy at whole steps is not: of a body thrown upward it
    falls by m g h v until it is back.
    """
    arm = data.xipos - data.subtree_com[model.body_rootid]
    v = data.cvel[:, 3:] + np.cross(data.cvel[:, :3], arm)
    lag: float = 0.5 * model.opt.timestep * (model.body_mass @ (v @ model.opt.gravity))
    return float(data.energy.sum()) + float(lag)


def rise(make: Callable[[Any], Scene], law: Any, seconds: float) -> float:
    """Largest energy above the start's, less what steps with contact off won until then, over it."""
    scene = make(law)
    model = scene.model()
    data = scene.data(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    start = kept_in_flight(model, data)
    own, highest, before = 0.0, 0.0, start
    free, alone = copy.copy(model), mujoco.MjData(model)
    free.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    for _ in range(round(seconds / model.opt.timestep)):
        alone.qpos[:], alone.qvel[:] = data.qpos, data.qvel
        mujoco.mj_step(free, alone)
        mujoco.mj_forward(free, alone)
        own += max(0.0, kept_in_flight(free, alone) - before)
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        now = kept_in_flight(model, data)
        highest, before = max(highest, now - start - own), now
    broken = any(warning.number for warning in data.warning)
    return np.inf if broken or not np.isfinite(now) else highest / max(abs(start), 1e-9)


@dataclass
class Seen:
    """Energy (J) at the start of each step, and the last state."""

    energy: Floats
    model: Any
    data: Any

    @property
    def growth(self) -> float:
        """The largest energy over that at the start, of the kinetic and
        potential energy there is to lose.
        """
        return float((self.energy.max() - self.energy[0]) / self.scale)

    @property
    def scale(self) -> float:
        """Energy at the start, J."""
        return max(abs(float(self.energy[0])), 1e-9)


def run(scene: Scene, seconds: float) -> Seen:
    """Step a scene from its start."""
    model = scene.model()
    data = scene.data(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    energy = []
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step(model, data)
        energy.append(float(data.energy.sum()))
    return Seen(np.array(energy), model, data)


HALF = ConstantRestitution(0.5)


def plugged(
    spec: Any, pairs: Sequence[tuple[str, str]], law: Law, tendon: str | None = None, **more: Any
) -> Any:
    """A model of an MjSpec in which a law acts on pairs of geoms, and on a tendon's limit."""
    require_plugins_in_specs()
    for pair in pairs:
        add_to_spec(spec, law, geoms=pair, **more)
    if tendon is not None:
        add_to_spec(spec, law, tendon=tendon, **more)
    return spec.compile()
