"""Random scenes under MuJoCo's plug-ins, drawn as a covering design, and what contact does in each."""

from __future__ import annotations

import copy
import functools
import warnings
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from contact_scenes import add_equality, require_plugins_in_specs
from covering import covering_rows
from drawn_laws import LAWS, law_of

from hcbench.contact.mujoco import add_to_spec

if TYPE_CHECKING:
    from hcbench.laws.contact_law import Law

FACTORS: dict[str, tuple[Any, ...]] = {
    "shape": ("sphere", "box", "capsule", "cylinder", "ellipsoid", "mesh", "several geoms"),
    "floor": ("plane", "box", "mesh", "height field"),
    "joint": ("free", "hinge", "slide", "ball joint", "chain", "equality", "tendon", "motor"),
    "centre": ("centred mass", "off-centre mass"),
    "integrator": ("Euler", "implicit", "implicitfast", "RK4"),
    "cone": ("pyramidal", "elliptic"),
    "solver": ("Newton", "CG", "PGS", "Newton, noslip", "PGS, noslip"),
    "multiccd": ("multiccd on", "multiccd off"),
    "island": ("island on", "island off"),
    "step": (0.25e-3, 0.5e-3, 1e-3, 2e-3, 4e-3, 5e-3),
    "law": LAWS,
    "bodies": (1, 2, 4),
    "friction": (0.0, 0.1, 0.5, 1.0),
    "condim": (1, 3, 4, 6),
}
CLASSES = ("shape", "floor", "joint", "centre", "integrator", "cone", "solver", "step", "law")


def allowed(row: dict[str, Any]) -> bool:
    """An equality holds two bodies; a force of 30 steps a contact is too
    soft for a body at coarse steps.
    """
    alone = row.get("joint") == "equality" and row.get("bodies") == 1
    soft = row.get("law") == "force" and row.get("step", 0.0) > 1e-3
    return not (alone or soft)


@functools.cache
def design(count: int) -> list[dict[str, Any]]:
    """The first rows of the design."""
    return covering_rows(FACTORS, count, allowed)


@dataclass
class Made:
    """A scene with the plug-in, and the same with the contact that MuJoCo has by itself."""

    model: Any
    native: Any
    start: Any  # qvel
    has_force: bool  # by a law that resolves the contact


def make(row: dict[str, Any], seed: int) -> Made:
    """A scene of the design; the rest of it is drawn from the seed."""
    require_plugins_in_specs()
    models = []
    for has_law in (True, False):
        rng = np.random.default_rng(seed)
        spec = _world(row)
        _add_floor(spec, row, rng)
        for i in range(row["bodies"]):
            _add_part(spec, row, i, rng)
        _join(spec, row)
        if has_law:
            _add_laws(spec, law_of(row))
        with warnings.catch_warnings():  # of a mesh on a height field, which the design draws, too
            warnings.filterwarnings("ignore", ".*whose contact MuJoCo finds late and deep")
            models.append(spec.compile())
    rng = np.random.default_rng([seed, 1])
    start = rng.normal(size=models[0].nv) * 3
    for joint in range(models[0].njnt):
        at = models[0].jnt_dofadr[joint]
        if models[0].jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            start[at : at + 6] = rng.normal(size=6) * [0.8, 0.8, 0.8, 6, 6, 6] - [0, 0, 1, 0, 0, 0]
        if models[0].jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            start[at] = -abs(rng.normal())
    return Made(models[0], models[1], start, row["law"] == "force")


def _world(row: dict[str, Any]) -> Any:
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep = row["step"]
    solver, _, noslip = row["solver"].partition(", ")
    option.cone = getattr(mujoco.mjtCone, f"mjCONE_{row['cone'].upper()}")
    option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{row['integrator'].upper()}")
    option.solver = getattr(mujoco.mjtSolver, f"mjSOL_{solver.upper()}")
    option.noslip_iterations = 5 if noslip else 0
    option.enableflags = int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    for flag in ("multiccd", "island"):
        _set_flag(option, flag.upper(), row[flag].endswith("on"))
    spec.memory = 2**26
    return spec


def _set_flag(option: Any, name: str, is_on: bool) -> None:
    """A flag of MuJoCo's, which is among those that enable in some
    versions, and that disable in others.
    """
    if (enables := getattr(mujoco.mjtEnableBit, f"mjENBL_{name}", None)) is not None:
        option.enableflags |= int(enables) if is_on else 0
    elif (disables := getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}", None)) is not None:
        option.disableflags |= 0 if is_on else int(disables)


def _surface(row: dict[str, Any]) -> dict[str, Any]:
    return {"friction": [row["friction"], 0.005, 1e-4], "condim": row["condim"]}


def _add_floor(spec: Any, row: dict[str, Any], rng: Any) -> None:
    kind = mujoco.mjtGeom
    if row["floor"] == "plane":
        shape = {"type": kind.mjGEOM_PLANE, "size": [5, 5, 1]}
    elif row["floor"] == "box":
        shape = {"type": kind.mjGEOM_BOX, "size": [2, 2, 0.2], "pos": [0, 0, -0.2]}
    elif row["floor"] == "mesh":
        corners = np.array(
            [[x, y, z] for x in (-2, 2) for y in (-2, 2) for z in (-0.4, 0)], dtype=float
        )
        spec.add_mesh(name="slab", uservert=corners.ravel())
        shape = {"type": kind.mjGEOM_MESH, "meshname": "slab"}
    else:
        heights = rng.uniform(0, 1, (16, 16)).astype(float)
        spec.add_hfield(
            name="ground", nrow=16, ncol=16, size=[2, 2, 0.02, 0.3], userdata=heights.ravel()
        )
        shape = {"type": kind.mjGEOM_HFIELD, "hfieldname": "ground"}
    spec.worldbody.add_geom(name="floor", **shape, **_surface(row))


def _add_part(spec: Any, row: dict[str, Any], i: int, rng: Any) -> None:
    """One of the bodies that may move, and what hangs on it."""
    height = {"hinge": 0.12, "ball joint": 0.12, "chain": 0.25}.get(row["joint"], 0.14)
    at = [*(0.1 * rng.uniform(-1, 1, 2) + [0.0, 0.0]), height + 0.17 * i]
    body = spec.worldbody.add_body(name=f"b{i}", pos=at, quat=rng.normal(size=4))
    joint = {"name": f"j{i}"}
    kind = mujoco.mjtJoint
    if row["joint"] in ("hinge", "ball joint"):
        is_hinge = row["joint"] == "hinge"
        axis = rng.normal(size=3)
        body.add_joint(type=kind.mjJNT_HINGE if is_hinge else kind.mjJNT_BALL, axis=axis, **joint)
    elif row["joint"] == "slide":
        body.quat = [1, 0, 0, 0]
        body.add_joint(type=kind.mjJNT_SLIDE, axis=[0.2 * rng.normal(), 0, 1], **joint)
    else:
        body.add_freejoint()
    off = 0.08 if row["joint"] in ("hinge", "ball joint") else 0.0
    _add_geoms(spec, body, row, f"b{i}", rng, off)
    if row["joint"] in ("chain", "tendon", "motor"):
        child = body.add_body(name=f"c{i}", pos=[0.12, 0, 0])
        child.add_joint(
            name=f"k{i}", type=kind.mjJNT_HINGE, axis=[0, 1, 0], armature=1e-3, pos=[-0.06, 0, 0]
        )
        _add_geoms(spec, child, row, f"c{i}", rng, 0.0)
        spec.add_exclude(bodyname1=f"b{i}", bodyname2=f"c{i}")


def _add_geoms(spec: Any, body: Any, row: dict[str, Any], name: str, rng: Any, off: float) -> None:
    size, mass = rng.uniform(0.025, 0.055, 3), float(10 ** rng.uniform(-0.7, 0.7))
    shift = 0.4 * size * rng.normal(size=3) if row["centre"] == "off-centre mass" else np.zeros(3)
    at = shift + np.array([off, 0.0, 0.0])
    parts = [row["shape"]] if row["shape"] != "several geoms" else ["box", "sphere", "capsule"]
    for k, part in enumerate(parts):
        kind = getattr(mujoco.mjtGeom, f"mjGEOM_{part.upper()}")
        shape: dict[str, Any] = {"size": size * (1 - 0.2 * k)}
        if part == "mesh":
            corners = rng.normal(size=(14, 3))
            corners *= size / np.linalg.norm(corners, axis=1)[:, None]
            spec.add_mesh(name=f"{name} mesh", uservert=corners.ravel())
            shape = {"meshname": f"{name} mesh"}
        place = at + (0.06 * k * rng.normal(size=3) if k else 0)
        body.add_geom(
            name=f"{name} {k}",
            type=kind,
            mass=mass / len(parts),
            pos=place,
            **shape,
            **_surface(row),
        )


def _join(spec: Any, row: dict[str, Any]) -> None:
    """Constraints and drives of the joints: all but constant forces and springs without damping
    take no energy.
    """
    if row["joint"] == "equality":
        kind = ("weld", "connect")[row["bodies"] // 2 % 2]
        numbers = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1] if kind == "weld" else [0.0, 0.0, 0.08]
        add_equality(spec, kind, "b0", "b1", numbers)
        spec.add_exclude(bodyname1="b0", bodyname2="b1")
    for i in range(row["bodies"]):
        if row["joint"] == "tendon":
            tendon = spec.add_tendon(name=f"t{i}", stiffness=1.0, springlength=[0.0, 0.0])
            tendon.wrap_joint(f"k{i}", 1.0)
        if row["joint"] == "motor":
            spec.add_actuator(
                name=f"a{i}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=f"k{i}",
                gainprm=[0.3, *[0] * 9], biastype=mujoco.mjtBias.mjBIAS_AFFINE,
                biasprm=[0, -0.3 if i % 2 else 0.0, *[0] * 8],
            )  # fmt: skip


def _add_laws(spec: Any, law: Law) -> None:
    bodies = [body for body in spec.bodies if body.geoms]
    for one, two in combinations(bodies, 2):
        apart = {one.name, two.name}
        if any({pair.bodyname1, pair.bodyname2} == apart for pair in spec.excludes):
            continue
        add_to_spec(spec, law, bodies=(one.name, two.name))


def starts_compressed(made: Made) -> bool:
    """Say whether a force law finds bodies in overlap at the start: energy from that does not count
    as a gain.
    """
    data = mujoco.MjData(made.native)
    mujoco.mj_forward(made.native, data)
    return made.has_force and bool((data.contact.dist < 0).any())


def energy(model: Any, data: Any) -> float:
    """Kinetic and potential energy of bodies, springs and actuators, as steps keep it in flight.

    RK4 keeps it at whole steps; the others keep it with half a step of the forces in each velocity.
    """
    mujoco.mj_forward(model, data)
    total = float(data.energy.sum())
    length, gain, bias = (
        data.actuator_length,
        model.actuator_gainprm[:, 0],
        model.actuator_biasprm[:, 1],
    )
    total -= float((gain * data.ctrl * length + 0.5 * bias * length**2).sum())
    if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        return total
    arm = data.xipos - data.subtree_com[model.body_rootid]
    v = data.cvel[:, 3:] + _cross(data.cvel[:, :3], arm)
    power = float(model.body_mass @ (v @ model.opt.gravity))
    power += float(data.qvel @ (data.qfrc_spring + data.qfrc_actuator))
    power += _power_of_turning(model, data)
    return total + 0.5 * float(model.opt.timestep) * power


def _cross(a: Any, b: Any) -> Any:
    """Cross products of vectors in the last axis: np.cross takes ten times as long for a few."""
    first = a.take(_NEXT, -1) * b.take(_LAST, -1)
    return first - a.take(_LAST, -1) * b.take(_NEXT, -1)


def _power_of_turning(model: Any, data: Any) -> float:
    """Power, W, of what accelerates the frames of free bodies whose mass is off them.

    Their places keep the velocities with half a step of it in each.
    """
    power = 0.0
    for joint in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE):
        body = model.jnt_bodyid[joint]
        if (model.dof_treeid == model.dof_treeid[model.jnt_dofadr[joint]]).sum() != 6:
            continue
        arm = data.subtree_com[body] - data.xpos[body]
        turn, v = data.cvel[body, :3], data.cvel[body, 3:]
        power -= float(model.body_subtreemass[body] * v @ _cross(turn, _cross(turn, arm)))
    return power


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
# What gains energy: MuJoCo's own step, and the lift of what starts inside or lands deep.
NAMED = ("rad in a step", "too fast for a step", "mm inside body", "may land more than")
NAMED_DEPTHS = ("mm deeper than", "mm inside body")
DEEPER = 1e-3  # m, up to which none goes deeper than native contact that the plug-in does not name


@dataclass
class Seen:
    """gain: of contact, over the first energy; depth: the largest, m; both NaN where the state was.

    named: whether the plug-in warned of what may gain energy (NAMED).
    names_depth: whether it warned that bodies are deeper than on native contact, or start so.
    met: the state in which the two that went in deepest met, and the steps left.
    """

    gain: float
    depth: float
    named: bool
    names_depth: bool
    met: tuple[Any, int]


def simulate(made: Made, seconds: float, native: bool = False) -> Seen:
    """Simulate a scene of the design with the plug-in, or with MuJoCo's native contact.

    What MuJoCo's own step gains, going on without contact from the velocities after the
    impacts, is not contact's gain.
    """
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        gain, depth, met = _follow(made, seconds, native)
    finally:
        mujoco.set_mju_user_warning(None)
    named, names_depth = (
        any(reason in words for words in warned for reason in reasons)
        for reasons in (NAMED, NAMED_DEPTHS)
    )
    return Seen(gain, depth, named, names_depth, met)


def deeper(made: Made, seen: Seen, native: Seen) -> float:
    """Depth, m, beyond that with native contact, 0 for less; NaN where a state was.

    What bounces comes faster than on native contact, which stops it, or from elsewhere. So native
    contact also goes on from where the two that went in deepest met.
    """
    more = seen.depth - native.depth
    if more > DEEPER:
        start, steps = seen.met
        data = _begin(made, made.native)
        mujoco.mj_setState(made.native, data, start, _STATE)
        return max(0.0, seen.depth - _deepest(made.native, data, steps))
    return max(0.0, more)


_STATE = mujoco.mjtState.mjSTATE_PHYSICS


def _begin(made: Made, model: Any) -> Any:
    """The data of a scene at its start."""
    data = mujoco.MjData(model)
    data.qvel[:], data.ctrl[:] = made.start, 0.3
    return data


def _deepest(model: Any, data: Any, steps: int) -> float:
    """Depth, m, of the deepest contact in these steps."""
    depth = 0.0
    for _ in range(steps):
        mujoco.mj_step(model, data)
        depth = max(depth, _depth(data))
    return depth


def _depth(data: Any) -> float:
    return -float(data.contact.dist.min()) if data.ncon else 0.0


def _follow(made: Made, seconds: float, native: bool) -> tuple[float, float, tuple[Any, int]]:
    """Gain and depth of a scene, and from where its deepest contact came (Seen.met)."""
    model, count = made.native if native else made.model, round(seconds / made.model.opt.timestep)
    data = _begin(made, model)
    free = copy.copy(made.native)
    free.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    alone, now = mujoco.MjData(free), _begin(made, free)
    alone.ctrl[:] = data.ctrl
    first = max(energy(free, now), 1e-3)
    depth = _depth_at_start(made)
    won, low, most = 0.0, 0.0, 0.0
    state = np.zeros(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, state, _STATE)
    met, since = (state, count), dict[tuple[int, ...], tuple[Any, int]]()
    for left in range(count, 0, -1):
        alone.qpos[:], alone.qvel[:] = data.qpos, data.qvel
        state = np.zeros_like(state)
        mujoco.mj_getState(model, data, state, _STATE)
        mujoco.mj_step(model, data)
        if (
            not np.isfinite(data.qpos).all()
            or data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number
        ):
            return np.nan, np.nan, met
        pairs = [(int(a), int(b)) for a, b in data.contact.geom]
        since = {pair: since.get(pair, (state, left)) for pair in pairs}
        if _depth(data) > depth:
            depth, met = _depth(data), since[pairs[int(data.contact.dist.argmin())]]
        touches = bool(np.abs(data.qfrc_constraint).sum() + np.abs(data.qfrc_passive).sum())
        if native or not (data.ncon or touches):
            continue
        won += _gain(free, alone, now, data, first)
        # A force gives back what it took in the steps before.
        low = low if made.has_force else min(low, won)
        most = max(most, won - low)
    return most / first, depth, met


def _depth_at_start(made: Made) -> float:
    """Depth, m, in which a scene finds its bodies: RK4 leaves the contacts of a step's end alone."""
    data = _begin(made, made.native)
    mujoco.mj_forward(made.native, data)
    return max(0.0, _depth(data))


def _gain(free: Any, alone: Any, now: Any, data: Any, first: float) -> float:
    """Energy (J) that contact won in the step from the state in `alone` to that in `data`.

    What the step won in all, less what a step without contact wins
    that leads to the same velocities.
    """
    places, rates = alone.qpos.copy(), alone.qvel.copy()
    before = energy(free, alone)
    now.qpos[:], now.qvel[:] = data.qpos, data.qvel
    reached = energy(free, now)
    if reached < before - 1e-5 * first:
        return reached - before
    guess, best = rates.copy(), (np.inf, reached - before)
    for _ in range(12):
        now.qpos[:], now.qvel[:] = places, guess
        started = energy(free, now)
        now.qpos[:], now.qvel[:] = places, guess
        mujoco.mj_step(free, now)
        missing = data.qvel - now.qvel
        off = float(np.abs(missing).max())
        if off < best[0]:
            best = off, reached - before - (energy(free, now) - started)
        if off < 1e-9 or not np.isfinite(off):
            break
        guess = guess + missing
    return best[1]


def classes(rows: list[dict[str, Any]]) -> dict[str, list[int]]:
    """The scenes of each class that the page has, by their numbers."""
    made = {"all": list(range(len(rows)))}
    made["2 ms or finer"] = [i for i, row in enumerate(rows) if row["step"] <= 2e-3]
    for factor in CLASSES:
        for level in FACTORS[factor]:
            name = level if isinstance(level, str) else f"{level * 1e3:g} ms"
            made[f"{factor}: {name}"] = [i for i, row in enumerate(rows) if row[factor] == level]
    return made
