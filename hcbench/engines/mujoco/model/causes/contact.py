"""Causes in the parameters of the contact, which do not arrive as written or ask for no bounce."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import explicit_pairs, geom_friction, geom_name
from hcbench.engines.mujoco.model.causes import fixes
from hcbench.engines.mujoco.model.causes.context import DEFAULT_SOLREF, Context, same, tuned_rows
from hcbench.engines.mujoco.model.causes.fixes import numbers
from hcbench.engines.mujoco.scene.rows import (
    MAX_IMPEDANCE,
    MAX_POWER,
    MIN_IMPEDANCE,
    STIFF_SOLIMP,
    SoftConstraint,
)
from hcbench.measuring.diagnose import NO_PUSH
from hcbench.sim.model_under_test import Suspect

# Differences of e below this are not worth a line in the diagnosis.
_NOTABLE = 0.01
_MIXING = {"solref": "mixes the solref", "solimp": "averages the solimp"}


def mixing(context: Context) -> Iterator[Suspect]:
    """The geoms' parameters do not arrive as written."""
    model = context.model
    written = context.written
    if written is None or (explicit_pairs(model, context.geoms) and not context.overridden):
        return
    solref, solimp, _ = context.place.contact.rows[0]
    if context.overridden:
        flags = model.opt.enableflags & ~int(backend().mjtEnableBit.mjENBL_OVERRIDE)
        yield Suspect(
            "override",
            "The override flag replaces every contact's solref and solimp.",
            f"o_solref {numbers(solref)}, o_solimp {numbers(solimp)}",
            '<option><flag override="disable"/></option>',
            partial(fixes.set_options, enableflags=flags),
        )
        return
    values = {"solref": (written.solref, solref), "solimp": (written.solimp, solimp)}
    lost = {name: value for name, value in values.items() if not same(*value)}
    geoms = context.all_geoms
    apply = partial(fixes.set_contact, geoms=geoms, solref=written.solref, solimp=written.solimp)
    ranks = [int(model.geom_priority[g]) for g in context.geoms]
    if lost and ranks[0] != ranks[1]:
        loser, winner = sorted((0, 1), key=lambda i: ranks[i])
        names = [geom_name(model, g) for g in context.geoms]
        yield Suspect(
            "priority",
            f"Geom {names[winner]!r} has priority: the parameters of {names[loser]!r} are not used.",
            f"priority {ranks[winner]} over {ranks[loser]}; solref is now {numbers(solref)}",
            f'{names[loser]}: priority="{ranks[winner] + 1}"',
            apply,
        )
        return
    for name, (as_written, in_contact) in lost.items():
        yield Suspect(
            f"{name}-mixing",
            f"MuJoCo {_MIXING[name]} of the two geoms: the contact does not have the one written.",
            f"written {numbers(as_written)}, in the contact {numbers(in_contact)}",
            f'{context.names}: {name}="{numbers(as_written)}"',
            apply,
        )


def refsafe(context: Context) -> Iterator[Suspect]:
    """A time constant below two steps is not honoured."""
    solref = context.place.contact.rows[0].solref
    constant, ratio = solref
    if constant <= 0 or context.model.opt.disableflags & backend().mjtDisableBit.mjDSBL_REFSAFE:
        return
    evidence = f"{2 * context.timestep:g} s is used"
    least = 2 * context.timestep
    if context.integrator == "discrete":
        evidence = "no bounce is left"
        least = context.timestep
        constant = constant * ratio
    if constant >= least:
        return
    # The undamped spring has 40 steps in half a period, π times the time constant times the
    # damping ratio; and never less than ten steps in a time constant.
    step = constant * min(0.1, math.pi * ratio / 40)
    yield Suspect(
        "refsafe",
        "The time constant is too short for the step: refsafe replaces it by a longer, softer one.",
        f"solref {numbers(solref)} at a step of {context.timestep:g} s: {evidence}",
        f'<option timestep="{step:.6g}"/>',
        partial(fixes.set_options, timestep=step),
    )


def solref(context: Context) -> Iterator[Suspect]:
    """The contact is asked for, as written, another bounce than is wanted."""
    if context.written is None:
        return
    goal = context.goal()
    written_e = context.written_e
    default = same(context.written.solref, DEFAULT_SOLREF)
    certain = default or context.written.is_powerless
    if not certain and (context.wanted is None or abs(written_e - goal) < _NOTABLE):
        return
    if default:
        code = "default-solref"
        title = "is MuJoCo's default, critically damped: it asks for almost no bounce."
    elif context.written.is_powerless:
        code = NO_PUSH
        title = "asks for neither a spring nor a damper: nothing pushes back."
    elif written_e > goal:
        code = "lively-solref"
        title = "asks for less damping than the target needs."
    else:
        code = "damped-solref"
        title = "asks for more damping than the target needs."
    assumed_e = None
    if context.wanted is None:
        assumed_e = goal
    yield Suspect(
        code,
        f"solref {title}",
        f"solref {numbers(context.written.solref)} promises e = {written_e:.3g}",
        *_restitution_fix(context, goal),
        always_reported=certain,
        apply_last=True,
        assumed_e=assumed_e,
    )


def _restitution_fix(context: Context, e: float) -> tuple[str, Callable[[Any], None]]:
    """(text, apply) of the fix that gives the contact this e.

    A bounce in one step shows the cause for any pair, but is handed out for pairs without friction
    alone: its damper of (1 + e)/h turns the slip of what slides into bounce, 46 mm high for a box
    at 1 m/s. `tune` writes rows that slide, too.
    """
    apply = partial(fixes.set_restitution, geoms=context.all_geoms, e=e)
    if geom_friction(context.model, context.geoms) > 0.0:
        return tuned_rows(context, e), apply
    solref = numbers(fixes.solref_of(e, context.timestep, context.integrator))
    other = ', integrator="implicitfast"' if context.integrator == "discrete" else ""
    text = (
        f'{context.names}: solref="{solref}" solimp="{numbers(STIFF_SOLIMP)}" (e = {e:.3g}{other})'
    )
    return text, apply


def solimp(context: Context) -> Iterator[Suspect]:
    """solimp takes a share off spring and damper, or is clamped."""
    if context.used is None or context.written is None:
        return
    if context.written.overflows:
        yield Suspect(
            "solimp-power",
            "The power of solimp is too high: MuJoCo's sigmoid underflows and gives NaN.",
            f"solimp {numbers(context.written.solimp)}",
            f"{context.names}: a power below {MAX_POWER:g} in solimp",
            always_reported=True,
        )
        return
    at_touch = context.written.impedance(0.0)
    at_depth = context.written.impedance(math.inf)
    if context.used.solref[0] <= 0 and at_touch < at_depth:
        yield Suspect(
            "impedance",
            "solimp starts below its final value: at touch the contact has only part of its strength.",
            f"impedance {at_touch:.4g} at touch, {at_depth:.4g} at depth",
            f'{context.names}: solimp="{numbers(STIFF_SOLIMP)}"',
            partial(fixes.set_contact, geoms=context.all_geoms, solref=None, solimp=STIFF_SOLIMP),
        )
    if not all(MIN_IMPEDANCE <= d <= MAX_IMPEDANCE for d in context.written.solimp[:2]):
        yield from _clamped(context, replace(context.used, solimp=context.written.solimp))


def _clamped(context: Context, contact: SoftConstraint) -> Iterator[Suspect]:
    """Clamping the impedances of a contact changes its e."""
    speeds = sorted({i.launch.speed for i in context.impacts})
    as_used = replace(contact, clamped=True).curve(speeds)
    as_written = replace(contact, clamped=False).curve(speeds)
    worst = int(np.argmax(np.abs(np.subtract(as_written, as_used))))
    if abs(as_written[worst] - as_used[worst]) <= _NOTABLE:
        return
    yield Suspect(
        "impedance-floor",
        f"solimp is not used as written: impedances are held to {MIN_IMPEDANCE:g} ... {MAX_IMPEDANCE:g}.",
        f"solimp {numbers(contact.solimp)}: at {speeds[worst]:.3g} m/s e = {as_used[worst]:.3g} "
        f"where {as_written[worst]:.3g} was written",
        *_restitution_fix(context, float(np.mean(as_written))),
        always_reported=True,
        apply_last=True,
    )
