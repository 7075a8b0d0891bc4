"""Causes in the step, in the integrator, and in what else acts on the body."""

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import body_name
from hcbench.engines.mujoco.model.causes import fixes
from hcbench.engines.mujoco.model.causes.context import Context
from hcbench.measuring import diagnose
from hcbench.sim.model_under_test import Suspect
from hcbench.terms.impact import Status

# MuJoCo's own defaults.
_SOLVER = {"tolerance": 1e-8, "iterations": 100, "ls_iterations": 50}

# Actuators that a line names.
_SHOWN = 4


def integrator(context: Context) -> Iterator[Suspect]:
    """Integrators under which a solref in the direct format does something else."""
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
    """Servos whose damping an implicit integrator applies to what the
    contact gives, within the same step.
    """
    model = context.model
    off = context.model.opt.disableflags & backend().mjtDisableBit.mjDSBL_ACTUATION
    if context.integrator not in ("implicit", "implicitfast") or off or not model.nu:
        return
    damped = np.flatnonzero(model.actuator_biasprm[:, 2])
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
    """A solver that stops before it has found the forces: looser than MuJoCo's own settings."""
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
    """A step that does not resolve the contact."""
    law = context.used
    step = diagnose.StepFix(context.timestep, '<option timestep="{}"/>', fixes.set_options)
    stiffness = 0.0
    if law is not None:
        stiffness, _ = law.stiffness_damping()
    has_diverged = any(impact.status is Status.DIVERGED for impact in context.impacts)
    # Beyond 1, a step is longer than a radian of the oscillation.
    if has_diverged and stiffness * context.timestep**2 > 1:
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
    """Suspect damping outside the contact: of joints, and of a medium."""
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
    """Contacts that act away from the surfaces."""
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
