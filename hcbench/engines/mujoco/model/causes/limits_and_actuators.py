"""Causes in what holds or drives a body while it touches: limits, tethers, actuators, equalities."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import joint_name
from hcbench.engines.mujoco.model.causes import fixes
from hcbench.engines.mujoco.model.causes.context import Context
from hcbench.engines.mujoco.model.speed_shares import ACTUATORS, EQUALITIES, LIMITS
from hcbench.sim.model_under_test import Suspect

# Share of the speed at touch, lost to or gained from other causes than the contact, that is named.
_NOTABLE = 0.005
# Limits are looked for as deep as this times the largest penetration.
_DEEPER = 1.5


def limits(context: Context) -> Iterator[Suspect]:
    """A limit of a joint, or of a tendon that tethers a body, takes part in the bounce."""
    share = context.shares.get(LIMITS, 0.0)
    if abs(share) < _NOTABLE:
        return
    joints, tendons = _reached(context)
    model = context.model
    names = [f"joint {joint_name(model, j)!r}" for j in joints]
    names += [f"tendon {model.tendon(t).name or t!r}" for t in tendons]
    shown = ", ".join(names)
    yield Suspect(
        "limits",
        "A limit acts while the two touch: it takes part of the speed.",
        f"{share:+.2g} of the speed at touch, by {shown}",
        f'another pose (--key, --qpos), or limited="false" on {shown}',
        partial(fixes.free_limits, joints=joints, tendons=tendons),
    )


def _reached(context: Context) -> tuple[list[int], list[int]]:
    """Joints and tendons that are at a limit where the contact is
    deepest; all limited ones if none is.
    """
    model = context.model
    place = context.place
    mujoco = backend()
    depths = [i.penetration_max for i in context.impacts if np.isfinite(i.penetration_max)]
    deepest = _DEEPER * max(depths, default=0.0)
    data = mujoco.MjData(model)
    data.qpos[:] = place.qpos
    mujoco.mj_integratePos(model, data.qpos, place.direction, deepest)
    mujoco.mj_forward(model, data)
    kinds = mujoco.mjtConstraint
    joints = data.efc_id[data.efc_type == int(kinds.mjCNSTR_LIMIT_JOINT)]
    tendons = data.efc_id[data.efc_type == int(kinds.mjCNSTR_LIMIT_TENDON)]
    if not joints.size and not tendons.size:
        joints = np.flatnonzero(model.jnt_limited)
        tendons = np.flatnonzero(model.tendon_limited)
    return joints.tolist(), tendons.tolist()


def drives(context: Context) -> Iterator[Suspect]:
    """Actuators and equality constraints that push or hold during the contact."""
    flags = backend().mjtDisableBit
    for code, name, words, fix, flag in (
        (
            "actuators",
            ACTUATORS,
            "Actuators push while the two touch: e is not that of the contact alone.",
            "--no-actuators, or controls that push less",
            flags.mjDSBL_ACTUATION,
        ),
        (
            "equality",
            EQUALITIES,
            "Equality constraints push while the two touch: e is not that of the contact alone.",
            '<option><flag equality="disable"/></option>',
            flags.mjDSBL_EQUALITY,
        ),
    ):
        share = context.shares.get(name, 0.0)
        if abs(share) >= _NOTABLE:
            evidence = f"{share:+.2g} of the speed at touch"
            yield Suspect(code, words, evidence, fix, partial(fixes.disable, flag=int(flag)))
