"""Causes outside the contact: motion, limits, actuators, and what moves a body at rest."""

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import body_name, joint_name
from hcbench.engines.mujoco.model.causes import fixes
from hcbench.engines.mujoco.model.causes.context import Context
from hcbench.engines.mujoco.model.speed_shares import ACTUATORS, EQUALITIES, LIMITS
from hcbench.measuring import diagnose
from hcbench.sim.model_under_test import Suspect
from hcbench.system.text import time_step
from hcbench.terms.impact import Status
from hcbench.terms.resolution import NOTABLE_SHARE

# Causes in the step, in the integrator, and in what else acts on the body.

# MuJoCo's own defaults.
_SOLVER = {"tolerance": 1e-8, "iterations": 100, "ls_iterations": 50}

# Actuators that a line names.
_SHOWN = 4


def integrator(context: Context) -> Iterator[Suspect]:
    """Suspect an integrator under which the contact has another e than its solref says: RK4 where
    the solref turns a body back in one step, and discrete in any case. At most one suspect.
    """
    law = context.used
    if law is None or context.integrator not in ("RK4", "discrete"):
        return
    if law.is_impulse or context.integrator == "discrete":
        what = "A one-step (impulse) solref" if law.is_impulse else "Restitution"
        yield Suspect(
            "integrator",
            f"{what} does not survive the integrator {context.integrator}.",
            f"integrator {context.integrator}, solref {fixes.numbers(law.solref)}",
            '<option integrator="implicitfast"/>',
            partial(fixes.set_options, integrator=int(backend().mjtIntegrator.mjINT_IMPLICITFAST)),
        )


def servo_damping(context: Context) -> Iterator[Suspect]:
    """Suspect servos whose damping kv an implicit integrator applies to the speed that the contact
    gives, within the same step; at most one suspect, none where actuators are off.

    The suspect is reported where its fix alone takes half of the error, even if others cure as
    well.
    """
    model = context.model
    off = context.model.opt.disableflags & backend().mjtDisableBit.mjDSBL_ACTUATION
    if context.integrator not in ("implicit", "implicitfast") or off or not model.nu:
        return
    # MuJoCo: force = gain ctrl + b0 + b1 length + b2 velocity, so b2 is -kv of a servo. The same
    # place is a force of a muscle, and nothing where there is no bias.
    is_servo = model.actuator_biastype == int(backend().mjtBias.mjBIAS_AFFINE)
    damped = np.flatnonzero(is_servo & (model.actuator_biasprm[:, 2] != 0.0))
    if damped.size:
        names = ", ".join(model.actuator(int(i)).name or f"actuator:{i}" for i in damped[:_SHOWN])
        yield Suspect(
            "integrator",
            f"Under {context.integrator} the servos' kv damps the bounce within the contact's own step.",
            f"kv up to {-float(model.actuator_biasprm[damped, 2].min()):g} of {names}",
            '<option integrator="Euler"/>',
            partial(fixes.set_options, integrator=int(backend().mjtIntegrator.mjINT_EULER)),
            named_if_half=True,
        )


def solver(context: Context) -> Iterator[Suspect]:
    """Suspect a solver that stops before it has found the forces: with fewer iterations or a larger
    tolerance than MuJoCo's defaults. At most one suspect.
    """
    options = context.model.opt
    loose = []
    for name, own in _SOLVER.items():
        value = getattr(options, name)
        # Few iterations are loose, and so is a large tolerance.
        if name == "tolerance":
            is_loose = value > own
        else:
            is_loose = value < own
        if is_loose:
            loose.append(f"{name} {value:g}, {own:g} unless set")
    if loose:
        words = " ".join(f'{name}="{own:g}"' for name, own in _SOLVER.items())
        yield Suspect(
            "solver",
            "The solver stops before it has found the contact's force.",
            ", ".join(loose),
            f"<option {words}/>",
            partial(fixes.set_options, **_SOLVER),
        )


def resolution(context: Context) -> Iterator[Suspect]:
    """Suspect a time step too long for the contact: one at which the state diverges; else one at
    which impacts gain energy; else, for a contact that is not made to last one step, one with few
    steps in contact. At most one suspect.
    """
    law = context.used
    step = diagnose.StepFix(context.timestep, '<option timestep="{}"/>', fixes.set_options)
    stiffness = 0.0  # per unit mass, 1/s²
    if law is not None:
        stiffness, _ = law.stiffness_damping()
    has_diverged = any(impact.status is Status.DIVERGED for impact in context.impacts)
    # Beyond 1, a step is longer than a radian of the oscillation.
    if has_diverged and stiffness * context.timestep**2 > 1:
        # 40 steps in half a period.
        text, apply = step.to(math.pi / math.sqrt(stiffness) / 40)
        yield Suspect(
            "unstable",
            "The contact is too stiff for the step: the state diverges.",
            f"stiffness {stiffness:.3g} /s^2 at a step of {context.timestep:g} s",
            f"{text} or a softer solref",
            apply,
            always_reported=True,
        )
        return
    yield from diagnose.energy_gain(context.impacts, step)
    if law is None or not law.is_impulse:
        yield from diagnose.few_steps(context.impacts, step, "a softer solref")


def gravity(context: Context) -> Iterator[Suspect]:
    """Gravity does more than its part during a step or a contact."""
    fix = "a stiffer solref and a smaller timestep, so that a contact lasts less than {:.2g} s"
    apply = partial(fixes.set_options, gravity=0.0)
    return diagnose.gravity(context.impacts, context.gravity, context.timestep, fix.format, apply)


def losses(context: Context) -> Iterator[Suspect]:
    """Suspect damping outside the contact: damping or dry friction of the joint that carries the
    moving body, and a fluid that the model is filled with. Up to three suspects.
    """
    model = context.model
    dofs = list(context.place.joint.dofs)
    joint = body_name(model, context.place.joint.body)
    for code, field, words in (
        ("joint-damping", "dof_damping", "damping"),
        ("joint-friction", "dof_frictionloss", "frictionloss"),
    ):
        value = float(np.max(getattr(model, field)[dofs]))
        if value > 0:
            yield Suspect(
                code,
                f"The joint that carries the moving body has {words} of its own.",
                f"{words} {value:g} on the joint of {joint!r}",
                f'{joint}: {words}="0" on the joint',
                partial(fixes.zero_dofs, field=field, dofs=dofs),
            )
    if model.opt.density > 0 or model.opt.viscosity > 0:
        yield Suspect(
            "fluid",
            "The model is filled with a fluid, which drags.",
            f"density {model.opt.density:g}, viscosity {model.opt.viscosity:g}",
            '<option density="0" viscosity="0"/>',
            partial(fixes.set_options, density=0.0, viscosity=0.0),
        )


def margin(context: Context) -> Iterator[Suspect]:
    """Suspect margin and gap, where the contact's force begins away from the surfaces; at most one
    suspect, none where it begins at the touch.
    """
    # Distance at which it begins, m.
    onset = context.place.contact.onset
    if onset == 0:
        return
    where = "before the surfaces meet" if onset > 0 else "only below the surface"
    yield Suspect(
        "margin",
        f"margin and gap make the contact act {where}: the body reverses in the wrong place.",
        f"the force begins at a distance of {onset:g} m",
        f'{context.names}: margin="0" gap="0"',
        partial(fixes.no_margin, geoms=context.all_geoms),
        always_reported=True,
    )


# Causes in what holds or drives a body while it touches: limits, tethers, actuators, equalities.

# Limits are looked for as deep as this times the largest penetration.
_DEEPER = 1.5


def _change_of_approach(share: float) -> str:
    """Words for the share of the approach that a force took or added while two bodies touched.

    share: that it took of the speed at touch; below 0 where it added to it.
    """
    size = abs(share)
    amount = f"{size:.2g} times" if size >= 1.0 else f"{100 * size:.2g} % of"
    change = f"they took {amount} the speed at touch from the approach"
    if share < 0.0:
        change = f"they added {amount} the speed at touch to the approach"
    return f"while the two touched, {change}"


def limits(context: Context) -> Iterator[Suspect]:
    """Suspect limits of joints and tendons that act during the contact, if they change the speed at
    touch by the share NOTABLE_SHARE or more; at most one suspect, which names them.
    """
    share = context.shares.get(LIMITS, 0.0)
    if abs(share) < NOTABLE_SHARE:
        return
    joints, tendons = _reached(context)
    model = context.model
    names = [f"joint {joint_name(model, j)!r}" for j in joints]
    names += [f"tendon {model.tendon(t).name or t!r}" for t in tendons]
    shown = ", ".join(names)
    yield Suspect(
        "limits",
        "A limit acts while the two touch: it takes part of the speed.",
        f"{_change_of_approach(share)}: {shown}",
        f'another pose (--key, --qpos), or limited="false" on {shown}',
        partial(fixes.free_limits, joints=joints, tendons=tendons),
    )


def _reached(context: Context) -> tuple[list[int], list[int]]:
    """Numbers of the joints and of the tendons that are at a limit when the contact is deepest; if
    there are none, of all in the model that have limits.

    They are looked for in the pose at touch, moved on along the approach by _DEEPER times the
    largest penetration.
    """
    model = context.model
    place = context.place
    mujoco = backend()
    depths = [i.penetration_max for i in context.impacts if np.isfinite(i.penetration_max)]
    deepest = _DEEPER * max(depths, default=0.0)
    data = mujoco.MjData(model)
    data.qpos[:] = place.qpos
    # The direction approaches at 1 m/s, so its time is the depth, m.
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
    """Suspect actuators, and equality constraints, that push or hold during the contact, each if it
    changes the speed at touch by the share NOTABLE_SHARE or more. Up to two suspects.
    """
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
        if abs(share) >= NOTABLE_SHARE:
            yield Suspect(
                code, words, _change_of_approach(share), fix, partial(fixes.disable, flag=int(flag))
            )


# Causes of a pair that lies deep, or does not lie still.

# A contact gives way to a weight by its 1 - d: a fix leaves this share of it.
_HARDER = 0.1
# Share of the step that a fix leaves.
_FINER = 0.25


def at_rest(context: Context) -> Iterator[Suspect]:
    """Suspect what lets a body lie deep or vibrate at rest: a contact that is too soft, and a step
    that is too long for it.

    Both are yielded without evidence that they matter, as callers try the fixes; but no soft
    contact where several different ones add up.
    """
    if (law := context.used) is not None:
        # The impedances at touch and at depth; then width, midpoint and power, which stay.
        low, high, *curve = law.solimp
        harder = [float(f"{1.0 - _HARDER * (1.0 - d):.6g}") for d in (low, high)]
        solimp = (*harder, *curve)
        yield Suspect(
            "soft-contact",
            "The contact yields to a weight: the bodies lie deep.",
            f"solref {fixes.numbers(law.solref)}, solimp {fixes.numbers(law.solimp)}",
            f'{context.names}: solimp="{fixes.numbers(solimp)}"',
            partial(fixes.set_contact, geoms=context.all_geoms, solref=None, solimp=solimp),
        )
    finer = _FINER * context.timestep
    yield Suspect(
        "long-step",
        "The step is too long for the contact to come to rest.",
        f"a step of {time_step(context.timestep)} s",
        f'<option timestep="{finer:.6g}"/>',
        partial(fixes.set_options, timestep=finer),
    )
