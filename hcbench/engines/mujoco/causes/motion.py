"""MuJoCo: causes in the step, the integrator, and in what else acts on the body."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.mujoco.causes import fixes
from hcbench.engines.mujoco.causes.context import Situation
from hcbench.engines.mujoco.pair import body_name
from hcbench.impact import Status
from hcbench.measure.measurement import NOTABLE_GAIN, Candidate

if TYPE_CHECKING:
    from collections.abc import Iterator

_FEW_STEPS = 12
_GRAVITY_SHARE = 0.05  # of the impact speed, gained in a step or in a contact: from which it is looked at


def integrator(s: Situation) -> Iterator[Candidate]:
    """Integrators that do not do what the direct format promises."""
    law = s.delivered
    if law is None or s.integrator not in ("RK4", "discrete"):
        return
    if law.is_impulse or s.integrator == "discrete":
        what = "A one-step (impulse) solref" if law.is_impulse else "Restitution"
        yield Candidate(
            "integrator",
            f"{what} does not survive the integrator {s.integrator}.",
            f"integrator {s.integrator}, solref {fixes.numbers(law.solref)}",
            '<option integrator="implicitfast"/>',
            partial(fixes.set_integrator, name="IMPLICITFAST"),
        )


def resolution(s: Situation) -> Iterator[Candidate]:
    """Too few steps in contact, and energy from nowhere."""
    parted = [i for i in s.touched if i.status is Status.PARTED]
    gained = max((i.restitution for i in parted), default=0.0)
    samples = min((i.samples for i in parted), default=0)
    impulse = s.delivered is not None and s.delivered.is_impulse
    law = s.delivered
    stiffness = law.gains()[0] if law is not None else 0.0
    if any(i.status is Status.DIVERGED for i in s.impacts) and stiffness * s.timestep**2 > 1:
        finer = math.pi / math.sqrt(stiffness) / 40
        yield Candidate(
            "unstable",
            "The contact is too stiff for the step: the state diverges.",
            f"stiffness {stiffness:.3g} /s^2 at a step of {s.timestep:g} s",
            f'<option timestep="{finer:.6g}"/> or a softer solref',
            partial(fixes.set_timestep, timestep=finer),
            static=True,
        )
    elif gained > 1 + NOTABLE_GAIN:
        finer = s.timestep * min(0.05, max(samples, 1) / 200)
        yield Candidate(
            "energy-gain",
            "The bounce makes energy from nothing: the step does not resolve the contact.",
            f"e up to {gained:.4g} with {samples} steps in contact",
            f'<option timestep="{finer:.6g}"/>',
            partial(fixes.set_timestep, timestep=finer),
        )
    elif samples and samples <= _FEW_STEPS and not impulse:
        finer = s.timestep * samples / 60
        yield Candidate(
            "few-steps",
            "Too few steps in contact: where in a step the touch falls decides about e.",
            f"{samples} steps in contact at {s.timestep:g} s; 20 or more are needed",
            f'<option timestep="{finer:.6g}"/> or a softer solref',
            partial(fixes.set_timestep, timestep=finer),
        )


def gravity(s: Situation) -> Iterator[Candidate]:
    """Gravity does more than its part during a step or a contact."""
    g = float(np.linalg.norm(s.gravity))
    slowest = min((i.launch.speed for i in s.touched), default=0.0)
    longest = max([s.timestep, *(i.duration for i in s.touched if math.isfinite(i.duration))])
    if g == 0 or slowest == 0 or g * longest < _GRAVITY_SHARE * slowest:
        return
    short = _GRAVITY_SHARE * slowest / g
    yield Candidate(
        "gravity",
        "Gravity changes the speed during a step or a contact by a large share of the impact speed.",
        f"g h = {g * s.timestep:.3g} m/s a step, {g * longest:.3g} m/s a contact, against {slowest:.3g} m/s",
        f"a stiffer solref and a smaller timestep, so that a contact lasts less than {short:.2g} s",
        fixes.no_gravity,
    )


def losses(s: Situation) -> Iterator[Candidate]:
    """Damping that is not the contact's."""
    model, dofs = s.model, list(s.place.carrier.dofs)
    joint = body_name(model, s.place.carrier.body)
    for code, field, words in (
        ("joint-damping", "dof_damping", "damping"),
        ("joint-friction", "dof_frictionloss", "frictionloss"),
    ):
        value = float(np.max(getattr(model, field)[dofs]))
        if value > 0:
            yield Candidate(
                code,
                f"The joint that carries the moving body has {words} of its own.",
                f"{words} {value:g} on the joint of {joint!r}",
                f'{joint}: {words}="0" on the joint',
                partial(fixes.zero_dofs, field=field, dofs=dofs),
            )
    if model.opt.density > 0 or model.opt.viscosity > 0:
        yield Candidate(
            "fluid",
            "The model is filled with a fluid, which drags.",
            f"density {model.opt.density:g}, viscosity {model.opt.viscosity:g}",
            '<option density="0" viscosity="0"/>',
            fixes.no_fluid,
        )


def margin(s: Situation) -> Iterator[Candidate]:
    """Contacts that act away from the surfaces."""
    onset = s.place.contact.onset
    if onset == 0:
        return
    where = "before the surfaces meet" if onset > 0 else "only below the surface"
    yield Candidate(
        "margin",
        f"margin and gap make the contact act {where}: the body turns round in the wrong place.",
        f"the force begins at a distance of {onset:g} m",
        f'{s.names}: margin="0" gap="0"',
        partial(fixes.no_margin, geoms=s.all_geoms),
        static=True,
    )
