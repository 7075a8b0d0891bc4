"""The force law in MuJoCo's passive callback, in Python: as in _mujoco_touch.c and _mujoco_force.c."""

from __future__ import annotations

import ctypes
import functools
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.plugin import native
from hcbench.engines.mujoco.plugin.pairs import FORCE, FREE, PairSpec
from hcbench.laws.contact_law import Friction
from hcbench.laws.exact_step import ContactOde, euler_force, rk4_stage_forces, touch_speed_ode

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.impact import Floats

    Plans = dict[tuple[int, int], Any]  # what the first stage of RK4 leaves to the others, by pair and order

_MOST = 50  # contacts of one pair
_COARSE = 1.0  # (ω h)² beyond which a step is too coarse
_SLOTS = (("o_solref", 0), ("o_solimp", 0), ("o_solimp", 2), ("o_friction", 0), ("o_friction", 2))


@dataclass
class Table:
    """What _native.Table is in C."""

    pairs: list[PairSpec]
    bodies: Sequence[int]
    index: dict[tuple[int, int], int]
    not_finite: int = 0
    too_coarse: int = 0


@dataclass
class Touching:
    """One contact of the force law at the present state."""

    pair: int
    order: int
    x: float
    v: float
    bodies: tuple[int, int] | None  # None: a tendon
    point: Floats
    normal: Floats
    slip: Floats
    row: Floats  # of the generalised coordinates: the force along them, per unit normal force
    solved: Floats = field(default_factory=lambda: np.empty(0))  # M^-1 row
    inverse_mass: float = 0.0
    motion: ContactOde = field(default_factory=lambda: ContactOde(0.0, 0.0, 1.0))
    force: float = 0.0


@functools.cache
def _collision_functions() -> tuple[Any, Any, int, int]:
    """MuJoCo's table of collision functions, their type, and the size of what they write, in doubles."""
    import mujoco

    engine = native._engine()
    kinds = int(mujoco.mjtGeom.mjGEOM_MESH) + 2  # ... mesh, sdf
    table = (ctypes.c_void_p * (kinds * kinds)).from_address(native._address(engine, "mjCOLLISIONFUNC"))
    kind = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 3, ctypes.c_int, ctypes.c_int, ctypes.c_double)
    return table, kind, kinds, _stride()


def _stride() -> int:
    import mujoco

    header = Path(mujoco.__file__).parent / "include" / "mujoco" / "mjdata.h"
    text = header.read_text(encoding="utf-8")
    if "mjPreContact;" in text:
        return 10
    body = re.search(r"struct mjContact_ \{(.*?)\n\}", text, re.DOTALL)
    assert body is not None, f"no mjContact in {header}"
    sizes = {"mjNREF": 2, "mjNIMP": 5, "": 1}
    doubles = ints = 0
    for kind, length in re.findall(r"^\s*(mjtNum|int)\s+\w+(?:\[(\w+)\])?;", body[1], re.MULTILINE):
        count = sizes[length] if length in sizes else int(length)
        doubles, ints = (doubles + count, ints) if kind == "mjtNum" else (doubles, ints + count)
    return doubles + (ints + 1) // 2


def velocity_at(model: Any, data: Any, body: int, point: Floats) -> Floats:
    """Velocity of a body's material point, m/s."""
    spatial = data.cvel[body]
    arm = point - data.subtree_com[model.body_rootid[body]]
    return np.asarray(np.cross(spatial[:3], arm) + spatial[3:])


def gravity_on(model: Any, body: int) -> Floats:
    """Acceleration of a free body by gravity, m/s²."""
    import mujoco

    if int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY):
        return np.zeros(3)
    return np.asarray(model.opt.gravity * (1.0 - model.body_gravcomp[body]))


def parameters(model: Any, pair: PairSpec) -> tuple[float, float]:
    """k and α of a pair: a copy of the model may have its own."""
    if pair.slot < 0:
        return pair.stiffness, pair.alpha
    name, start = _SLOTS[pair.slot]
    factor, alpha = getattr(model.opt, name)[start : start + 2]
    return pair.stiffness * float(factor), float(alpha)


def _reach(model: Any, data: Any, geoms: Sequence[int]) -> float:
    """How far the surfaces of two geoms can approach in a step, m."""
    h, total = float(model.opt.timestep), 0.0
    for geom in geoms:
        body = int(model.geom_bodyid[geom])
        speed = np.linalg.norm(velocity_at(model, data, body, data.geom_xpos[geom]))
        turning = 0.0 if model.geom_type[geom] == 0 else np.linalg.norm(data.cvel[body][:3])
        total += h * float(speed + turning * model.geom_rbound[geom])
    return 1.01 * (total + h * h * float(np.linalg.norm(model.opt.gravity))) + 1e-9


def _narrow_phase(model: Any, data: Any, number: int, pair: PairSpec) -> list[Touching]:
    g1, g2 = sorted((pair.geom1, pair.geom2), key=lambda geom: (model.geom_type[geom], geom))
    table, kind, kinds, stride = _collision_functions()
    address = table[int(model.geom_type[g1]) * kinds + int(model.geom_type[g2])]
    if not address:
        return []
    found = np.zeros((_MOST, stride))
    reach = _reach(model, data, (g1, g2))
    count = kind(address)(model._address, data._address, found.ctypes.data, g1, g2, reach)
    bodies = int(model.geom_bodyid[g1]), int(model.geom_bodyid[g2])
    made = []
    for order in range(count):
        point, normal = found[order, 1:4].copy(), found[order, 4:7].copy()
        slip = velocity_at(model, data, bodies[1], point) - velocity_at(model, data, bodies[0], point)
        v = -float(slip @ normal)
        row = force_row(model, data, bodies, point, normal)
        made.append(
            Touching(number, order, -float(found[order, 0]), v, bodies, point, normal, slip + v * normal, row)
        )
    return made


def force_row(model: Any, data: Any, bodies: tuple[int, int], point: Floats, along: Floats) -> Floats:
    """Generalised force of a unit force along `along` on the second body, and its opposite on the first."""
    import mujoco

    row = np.zeros(model.nv)
    jacobian = np.zeros((3, model.nv))
    for body, sign in zip(bodies, (-1.0, 1.0), strict=True):
        mujoco.mj_jac(model, data, jacobian, None, point, body)
        row += sign * (along @ jacobian)
    return row


def tendon_row(model: Any, data: Any, tendon: int, sign: float) -> Floats:
    """A tendon's Jacobian times `sign`, dense."""
    source = model if hasattr(model, "ten_J_rownnz") else data
    values = np.asarray(data.ten_J)
    if values.size == model.ntendon * model.nv and source is data and not _sparse(model):
        return np.asarray(sign * values.reshape(model.ntendon, model.nv)[tendon])
    start, count = int(source.ten_J_rowadr[tendon]), int(source.ten_J_rownnz[tendon])
    row = np.zeros(model.nv)
    row[source.ten_J_colind.ravel()[start : start + count]] = sign * values.ravel()[start : start + count]
    return row


def _sparse(model: Any) -> bool:
    import mujoco

    return bool(mujoco.mj_isSparse(model))


def _tendon_touch(model: Any, data: Any, number: int, pair: PairSpec) -> Touching:
    length, ends = float(data.ten_length[pair.tendon]), model.tendon_range[pair.tendon]
    x = length - float(ends[1]) if pair.side > 0 else float(ends[0]) - length
    v = pair.side * float(data.ten_velocity[pair.tendon])
    nothing = np.zeros(3)
    row = tendon_row(model, data, pair.tendon, -pair.side)
    return Touching(number, 0, x, v, None, nothing, nothing, nothing, row)


def gravity_on_row(model: Any, table: Table, row: Floats) -> float:
    """How fast gravity makes the free bodies approach along a row, m/s²."""
    total = 0.0
    for body in range(1, model.nbody):
        if table.bodies[body] == FREE:
            dof = int(model.body_dofadr[body])
            total -= float(gravity_on(model, body) @ row[dof : dof + 3])
    return total


def solve(model: Any, data: Any, row: Floats) -> Floats:
    """M^-1 row."""
    import mujoco

    solved = np.zeros((1, model.nv))
    mujoco.mj_solveM(model, data, solved, row[None, :])
    return np.asarray(solved[0])


def _gather(model: Any, data: Any, table: Table) -> list[Touching]:
    found: list[Touching] = []
    for number, pair in enumerate(table.pairs):
        if pair.kind != FORCE:
            continue
        if pair.tendon >= 0:
            found.append(_tendon_touch(model, data, number, pair))
        else:
            found += _narrow_phase(model, data, number, pair)
    for touch in found:
        touch.solved = solve(model, data, touch.row)
        touch.inverse_mass = float(touch.row @ touch.solved)
        k, alpha = parameters(model, table.pairs[touch.pair])
        b = gravity_on_row(model, table, touch.row)
        pair = table.pairs[touch.pair]
        if pair.own and alpha > 0.0:
            touch.motion = touch_speed_ode(k * touch.inverse_mass, 1.5 * alpha, pair.exponent, b)
            if touch.x > 0.0 and np.isfinite(touch.v):
                touch.motion = touch.motion.with_touch_speed(touch.x, touch.v)
        else:
            touch.motion = ContactOde(k * touch.inverse_mass, 1.5 * alpha, pair.exponent, b)
    return found


def _couple(found: list[Touching]) -> None:
    """What the other contacts do to the approach of one, to first order, enters as an acceleration."""
    plain = []
    for touch in found:
        own = touch.motion
        alone = own.with_load(0.0).acceleration(touch.x, touch.v)
        plain.append(-alone / touch.inverse_mass)
    for i, touch in enumerate(found):
        others = sum(
            float(touch.row @ other.solved) * plain[j] for j, other in enumerate(found) if j != i and plain[j]
        )
        own = touch.motion
        touch.motion = own.with_load(own.b - others)


def _set_force(model: Any, table: Table, touch: Touching, stage: int, plans: Plans) -> None:
    h, motion, key = float(model.opt.timestep), touch.motion, (touch.pair, touch.order)
    if not np.isfinite((touch.x, touch.v, touch.inverse_mass)).all():
        table.not_finite += 1
        return
    table.too_coarse += (h * motion.frequency(touch.x)) ** 2 > _COARSE
    if stage > 1:
        planned = plans.get(key)
        touch.force = planned[2 if stage == 4 else 1] if planned is not None else 0.0
        return
    if stage == 1:
        planned = [one / touch.inverse_mass for one in rk4_stage_forces(motion, h, touch.x, touch.v)]
        if any(planned):
            plans[key] = planned
        touch.force = planned[0]
    else:
        touch.force = euler_force(motion, h, touch.x, touch.v) / touch.inverse_mass


def evaluate(model: Any, data: Any, table: Table, stage: int, plans: Plans) -> list[Touching]:
    """Contacts of the force law at the present state, with their forces."""
    found = _gather(model, data, table)
    if len(found) > 1 and stage < 2:
        _couple(found)
    for touch in found:
        _set_force(model, table, touch, stage, plans)
    return found


def add_forces(model: Any, data: Any, table: Table, stage: int, plans: Plans) -> None:
    """Add the forces of all attached pairs to qfrc_passive."""
    for touch in evaluate(model, data, table, stage, plans):
        if touch.force > 0.0:
            data.qfrc_passive[:] += touch.force * touch.row
            pair = table.pairs[touch.pair]
            if pair.static_friction > 0.0 and touch.bodies is not None:
                _add_friction(model, data, touch, pair)


def _add_friction(model: Any, data: Any, touch: Touching, pair: PairSpec) -> None:
    slip = float(np.linalg.norm(touch.slip))
    if slip == 0.0 or touch.bodies is None:
        return
    row = force_row(model, data, touch.bodies, touch.point, touch.slip / slip)
    law = Friction(pair.static_friction, pair.dynamic_friction, pair.slip_speed)
    # A step can stop the slip, never turn it around.
    most = slip / (float(model.opt.timestep) * float(row @ solve(model, data, row)))
    data.qfrc_passive[:] -= min(law.coefficient(slip) * touch.force, most) * row
