"""The restitution law in Python: the rows of a contact that MuJoCo found, as in _mujoco_restitution.c."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.plugin.callback_force import (
    Table,
    force_row,
    gravity_on,
    gravity_on_row,
    parameters,
    solve,
    tendon_row,
    velocity_at,
)
from hcbench.engines.mujoco.plugin.pairs import CONSTANT, FIXED, LINEAR, RESTITUTION, PairSpec
from hcbench.laws.restitution import Restitution

if TYPE_CHECKING:
    from hcbench.engines.mujoco.plugin.callback_force import Plans
    from hcbench.impact import Floats

_RIGID = 1e-9  # compliance of a row, in units of the pair's own inverse mass
_MINVAL = 1e-15
_STILL = 1.1  # steps of falling whose speed counts as rest


@dataclass(frozen=True, slots=True)
class _Rows:
    """What the rows of one contact are to do.

    value: accelerations. cone: whether the rows are edges of a pyramid. compliance: of each row, relative.
    force: what each of them will take; a row that yields is asked for as much more as it will yield.
    """

    value: Floats
    cone: bool
    compliance: float
    force: float


def rewrite_rows(model: Any, data: Any, table: Table, stage: int, plans: Plans) -> None:
    """Give the rows of attached contacts the acceleration that ends this step at e(v), or at rest."""
    if not any(pair.kind == RESTITUTION for pair in table.pairs):
        return
    before, order = -1, 0
    for i in range(data.ncon):
        contact = data.contact[i]
        g1, g2 = int(contact.geom1), int(contact.geom2)
        number = table.index.get((min(g1, g2), max(g1, g2)), -1) if contact.efc_address >= 0 else -1
        if number < 0 or table.pairs[number].kind != RESTITUTION:
            continue
        order = order + 1 if number == before else 0
        before = number
        now = _targets(model, data, table, table.pairs[number], contact)
        _set_rows(data, table, stage, (number, order), plans, int(contact.efc_address), now)
    _rewrite_tendons(model, data, table, stage, plans)


def _rewrite_tendons(model: Any, data: Any, table: Table, stage: int, plans: Plans) -> None:
    import mujoco

    kind = int(mujoco.mjtConstraint.mjCNSTR_LIMIT_TENDON)
    for number, pair in enumerate(table.pairs):
        if pair.tendon < 0 or pair.kind != RESTITUTION:
            continue
        length, ends = float(data.ten_length[pair.tendon]), model.tendon_range[pair.tendon]
        left = float(ends[1]) - length if pair.side > 0 else length - float(ends[0])
        row = tendon_row(model, data, pair.tendon, -pair.side)
        approach = pair.side * float(data.ten_velocity[pair.tendon])
        gravity = gravity_on_row(model, table, row)
        parting = _parting(model, pair, approach, gravity)
        value = np.array([(parting + approach) / float(model.opt.timestep)])
        force = max(0.0, value[0] + gravity) / float(row @ solve(model, data, row))
        now = _Rows(value, False, _compliance(model, parting > 0), force)
        rows = (data.efc_type == kind) & (data.efc_id == pair.tendon) & (data.efc_pos == left)
        for i in np.flatnonzero(rows):
            _set_rows(data, table, stage, (number, 0), plans, int(i), now)


def _parting(model: Any, pair: PairSpec, approach: float, gravity: float) -> float:
    """The speed to leave with. What one step of falling gives is no impact that steps tell from rest."""
    if not approach > max(0.0, _STILL * float(model.opt.timestep) * gravity):
        return 0.0
    alpha = parameters(model, pair)[1]
    if pair.reading == CONSTANT:
        return approach * alpha
    curve = Restitution(alpha, "linear" if pair.reading == LINEAR else "law")
    return approach * max(0.0, float(curve.at(approach)))


def _targets(model: Any, data: Any, table: Table, pair: PairSpec, contact: Any) -> _Rows:
    """Accelerations of a contact's rows, as many as it has."""
    import mujoco

    h, frame = float(model.opt.timestep), np.asarray(contact.frame).reshape(3, 3)
    bodies = [int(model.geom_bodyid[g]) for g in (contact.geom1, contact.geom2)]
    velocity = [velocity_at(model, data, body, contact.pos) for body in bodies]
    turning = data.cvel[bodies[1], :3] - data.cvel[bodies[0], :3]
    rate = np.concatenate([frame @ (velocity[1] - velocity[0]), frame @ turning])
    if hasattr(contact, "surfacevel"):
        rate[1:4] += contact.surfacevel
    row = force_row(model, data, (bodies[0], bodies[1]), contact.pos, frame[0])
    # By gravity, and by gravity on one body alone, which the other may bear.
    pulls = [
        sign * float(gravity_on(model, body) @ frame[0])
        for sign, body in zip((1.0, -1.0), bodies, strict=True)
        if table.bodies[body] != FIXED
    ]
    gravity = sum(pulls)
    parting = _parting(model, pair, -float(rate[0]), max(pulls, default=0.0))
    dim = int(contact.dim)
    cone = dim > 1 and int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
    if cone:
        sides = np.outer(np.asarray(contact.friction)[: dim - 1] * rate[1:dim], [1.0, -1.0]).ravel()
        value = (parting - rate[0] - sides) / h
    else:
        value = (np.concatenate([[parting], np.zeros(dim - 1)]) - rate[:dim]) / h
    force = max(0.0, (parting - float(rate[0])) / h + gravity) / float(row @ solve(model, data, row))
    slip = abs(float(rate[1])) + abs(float(rate[2]))
    roots = {int(model.body_rootid[body]) for body in bodies} - {0}
    straight = parting > 0 and (dim == 1 or slip <= 1e-6 * parting)
    compliance = _compliance(model, straight and _alone(model, data, roots))
    return _Rows(value, cone, compliance, force / len(value) if cone else force)


def _alone(model: Any, data: Any, roots: set[int]) -> bool:
    """Whether the bodies of a contact have no other: then its force is known beforehand."""
    count = 0
    for contact in data.contact:
        if contact.efc_address >= 0 and contact.geom1 >= 0 and contact.geom2 >= 0:
            bodies = model.geom_bodyid[[contact.geom1, contact.geom2]]
            count += sum(int(root) in roots for root in model.body_rootid[bodies])
    return count == len(roots)


def _compliance(model: Any, known: bool) -> float:
    if not _takes_forces(model):
        return _RIGID
    return 1e-3 if known else 1e-8


def _takes_forces(model: Any) -> bool:
    """Implicit integrators take qfrc_constraint, whose rounding grows as 1/compliance; others take qacc."""
    import mujoco

    kinds, integrator = mujoco.mjtIntegrator, int(model.opt.integrator)
    if integrator in (int(kinds.mjINT_IMPLICIT), int(kinds.mjINT_IMPLICITFAST)):
        return True
    undamped = int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    return integrator == int(kinds.mjINT_EULER) and not undamped and bool(model.dof_damping.any())


def _set_rows(
    data: Any,
    table: Table,
    stage: int,
    key: tuple[int, int],
    plans: Plans,
    row: int,
    now: _Rows,
) -> None:
    """All stages of a Runge-Kutta step push alike; what touches between stages waits for the next step."""
    table.not_finite += not np.isfinite(now.value[0])
    if stage == 1:
        plans[key] = now
    elif stage > 1:
        planned = plans.get(key)
        if planned is not None and len(planned.value) == len(now.value):
            now = planned
        else:
            value = np.where(np.arange(len(now.value)) * (not now.cone) > 0, 0.0, -1e10)
            now = _Rows(value, now.cone, now.compliance, 0.0)
    for j, acceleration in enumerate(now.value):
        i, stiff = row + j, data.efc_KBIP[row + j]
        data.efc_R[i] = max(data.efc_R[i] * stiff[2] / (1.0 - stiff[2]) * now.compliance, _MINVAL)
        data.efc_D[i] = 1.0 / data.efc_R[i]
        # mj_referenceConstraint comes next and computes -B vel - K I (pos - margin).
        stiff[0], stiff[1] = 1.0, 0.0
        more = 0.0 if j and not now.cone else data.efc_R[i] * now.force
        data.efc_margin[i] = data.efc_pos[i] + (acceleration + more) / stiff[2]
        if hasattr(data, "iefc_D") and data.nisland > 0:
            island_row = data.map_efc2iefc[i]
            data.iefc_R[island_row], data.iefc_D[island_row] = data.efc_R[i], data.efc_D[i]
