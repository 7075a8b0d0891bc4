"""Causes in a contact: its parameters, its condim and its friction."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import explicit_pairs, geom_friction, geom_name
from hcbench.engines.mujoco.model.causes import fixes
from hcbench.engines.mujoco.model.causes.context import DEFAULT_SOLREF, Context, same, tuned_rows
from hcbench.engines.mujoco.model.causes.fixes import numbers
from hcbench.engines.mujoco.scene.mjcf import numbers_text
from hcbench.engines.mujoco.scene.rows import (
    MAX_IMPEDANCE,
    MAX_POWER,
    MIN_IMPEDANCE,
    STIFF_SOLIMP,
    ConstraintRow,
    SoftConstraint,
)
from hcbench.measuring.diagnose import NO_PUSH
from hcbench.sim.model_under_test import Suspect
from hcbench.terms.impact import Impact, Tangential

# Causes in the parameters of the contact, which do not arrive as written or ask for no bounce.

# Differences of e below this are not worth a line in the diagnosis.
_NOTABLE = 0.01
_MIXING = {"solref": "mixes the solref", "solimp": "averages the solimp"}


def mixing(context: Context) -> Iterator[Suspect]:
    """Suspect that the contact does not have the solref and solimp that the geoms were given.

    The override flag replaces them; else a geom with a higher priority decides alone; else MuJoCo
    mixes those of the two geoms. Yields one suspect for the first that applies, two for a mixture;
    nothing for a <pair>, whose parameters MuJoCo takes as they are.
    """
    model = context.model
    written = context.written
    solref = context.place.contact.rows[0].solref
    solimp = context.place.contact.rows[0].solimp
    # It replaces those of a body whose geoms differ, too.
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
    if written is None or explicit_pairs(model, context.geoms):
        return
    # (as written, in the contact) of each of the two parameters; then of those that differ.
    values = {"solref": (written.solref, solref), "solimp": (written.solimp, solimp)}
    lost = {name: value for name, value in values.items() if not same(*value)}
    geoms = context.all_geoms
    apply = partial(fixes.set_contact, geoms=geoms, solref=written.solref, solimp=written.solimp)
    lower, higher = sorted(context.geoms, key=lambda geom: int(model.geom_priority[geom]))
    low = int(model.geom_priority[lower])
    high = int(model.geom_priority[higher])
    if lost and low != high:
        winner = geom_name(model, higher)
        loser = geom_name(model, lower)
        fix = f'{loser}: priority="{high + 1}"'
        if not _has_both(model, lower, written):
            # With the priority of the loser the solref or the solimp of the winner would be lost.
            both = f'solref="{numbers(written.solref)}" solimp="{numbers(written.solimp)}"'
            fix = f"{context.names}: {both}"
        yield Suspect(
            "priority",
            f"Geom {winner!r} has priority: the parameters of {loser!r} are not used.",
            f"priority {high} over {low}; solref is now {numbers(solref)}",
            fix,
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


def _has_both(model: Any, geom: int, contact: SoftConstraint) -> bool:
    """Say whether a geom has both the solref and the solimp of a contact."""
    has_solref = same(model.geom_solref[geom], contact.solref)
    return has_solref and same(model.geom_solimp[geom], contact.solimp)


def refsafe(context: Context) -> Iterator[Suspect]:
    """Suspect a time constant of solref so short that MuJoCo replaces it by a longer one.

    That is one below two steps; under the integrator discrete, one whose product with the damping
    ratio is below one step. Nothing for a solref in the direct format, which has no time constant,
    or with the flag refsafe off.
    """
    solref = context.place.contact.rows[0].solref
    constant, ratio = solref
    if constant <= 0 or context.model.opt.disableflags & backend().mjtDisableBit.mjDSBL_REFSAFE:
        return
    evidence = f"{2 * context.timestep:g} s is used"
    is_long = constant >= 2 * context.timestep
    if context.integrator == "discrete":
        evidence = "no bounce is left"
        is_long = constant * ratio >= context.timestep
    if is_long:
        return
    # The undamped spring has 40 steps in half a period, π times the time constant times the
    # damping ratio; and never less than ten steps in a time constant.
    step = constant * min(0.1, math.pi * ratio / 40)
    if context.integrator == "discrete":
        # It takes e off by twice as much.
        step /= 2.0
    yield Suspect(
        "refsafe",
        "The time constant is too short for the step: refsafe replaces it by a longer, softer one.",
        f"solref {numbers(solref)} at a step of {context.timestep:g} s: {evidence}",
        f'<option timestep="{step:.6g}"/>',
        partial(fixes.set_options, timestep=step),
    )


def solref(context: Context) -> Iterator[Suspect]:
    """Suspect that the solref, as its author wrote it, asks for another bounce than the target.

    MuJoCo's default, and a solref without spring and damper, are suspected in any case; others
    where there is a target e and that of the solref differs from it by _NOTABLE or more.
    """
    if context.written is None:
        return
    goal = context.goal()
    written_e = context.written_e
    is_default = same(context.written.solref, DEFAULT_SOLREF)
    is_certain = is_default or context.written.is_powerless
    if not is_certain and (context.wanted is None or abs(written_e - goal) < _NOTABLE):
        return
    if is_default:
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
        always_reported=is_certain,
        # It is made for the step and the integrator, which other fixes may change.
        apply_last=True,
        assumed_e=assumed_e,
    )


def _restitution_fix(context: Context, e: float) -> tuple[str, Callable[[Any], None]]:
    """The fix that gives the contact this e: text for the user, and a function that makes the fix in
    a copy of the model.

    The copy has a bounce in one step, which shows the cause for any pair. The text has it for pairs
    without friction alone, because its damper of (1 + e)/h turns slip into bounce, 46 mm high for a
    box that slides at 1 m/s; with friction it has rows as `tune` writes them.
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
    """Suspect a solimp that weakens spring and damper, or that MuJoCo does not use as written: a
    power so high that MuJoCo's impedance is NaN, else an impedance that begins below its final
    value, and one outside MuJoCo's bounds. Up to two suspects.
    """
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
    # In the direct format solref's numbers hold at the full impedance.
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
    """Suspect that MuJoCo holds impedances within its bounds, if that changes e at any launch speed
    by more than _NOTABLE.

    contact: with the author's solimp and the solref that is used.
    """
    speeds = sorted({i.launch.speed for i in context.impacts})
    # e at each speed.
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


# Causes that show only where a body slides or spins.

# Share of μ that friction may be short before it counts as weak.
WEAK = 0.05
# Gain of e, over that of the same contact without slip, from which friction is named.
_LIFT = 0.02


def sliding_lift(context: Context) -> Iterator[Suspect]:
    """Suspect that friction adds to the bounce of oblique impacts, if one has an e that is more than
    _LIFT above that of the contact without slip; the impact with the largest gain is named.

    In MuJoCo the acceleration apart grows by impedance times μ times that of the slip, so the
    fix is a soft row.
    """
    contact = context.used
    friction = geom_friction(context.model, context.geoms)
    if contact is None or not friction:
        return
    lift = _LIFT
    worst = None
    for impact in context.impacts:
        if impact.tangential is None:
            continue
        gained = impact.restitution - contact.restitution(impact.speed_in)
        if gained > lift:
            lift = gained
            worst = impact
    if worst is None or worst.tangential is None:
        return
    # The fix, and its <pair> as text.
    row, impratio = _soft_row(context, friction)
    parameters = {"solref": row.solref, "solimp": row.solimp, "solreffriction": row.solreffriction}
    # A <pair> that says nothing of friction has MuJoCo's default, not that of its geoms.
    attributes = ['condim="3"', f'friction="{friction:g} {friction:g}"']
    for name, values in parameters.items():
        attributes.append(f'{name}="{numbers_text(values, "{:.6g}".format)}"')
    pair = " ".join(attributes)
    slip = math.hypot(*worst.tangential.slip_in)  # m/s
    yield Suspect(
        "sliding-lift",
        "Friction throws a sliding body up: MuJoCo's contact turns slip into bounce, as far as it is stiff.",
        f"e = {worst.restitution:.4g} where it slides at {slip:.3g} m/s, {lift:.3g} more than without slip; "
        f"impedance {contact.impedance(0.0):.4g}, friction {friction:g}",
        f'<option cone="elliptic" impratio="{impratio:g}"/> and a <pair> of {context.names}: {pair}',
        partial(_soften, geoms=context.all_geoms, row=row, impratio=impratio),
        apply_last=True,
    )


def pyramidal_cone(
    model: Any, impacts: Sequence[Impact], friction: float
) -> tuple[Impact, Suspect] | None:
    """Suspect that the pyramidal friction cone holds a sliding body too little: the impact in which
    friction is weakest although the body slides on, and the suspect.

    friction: Coulomb's μ of the two geoms.
    None for another cone, and where no impact's friction is below μ by the share WEAK. Along the
    diagonal of the pyramid friction is 29 % below Coulomb's. The suspect has no evidence, "": the
    caller tries the fix first.
    """
    if int(model.opt.cone) != int(backend().mjtCone.mjCONE_PYRAMIDAL) or not friction:
        return None
    weakest = None
    least = math.inf  # impulse of friction over that of the normal
    for impact in impacts:
        along = impact.tangential
        if along is None or not impact.is_measured or not _slides_on(along):
            continue
        if along.impulse_ratio < least:
            least = along.impulse_ratio
            weakest = impact
    if weakest is None or least > (1.0 - WEAK) * friction:
        return None
    return weakest, Suspect(
        "pyramidal-cone",
        "The pyramidal friction cone holds a sliding body less, the more its way is off the pyramid's axes.",
        "",
        '<option cone="elliptic"/>',
        partial(fixes.set_options, cone=int(backend().mjtCone.mjCONE_ELLIPTIC)),
        always_reported=True,
    )


def _slides_on(along: Tangential) -> bool:
    """Say whether the contact point still slides in the direction in which it came."""
    return sum(a * b for a, b in zip(along.slip_in, along.slip_out, strict=True)) > 0.0


def _soft_row(context: Context, friction: float) -> tuple[ConstraintRow, float]:
    """A contact row that lasts a few steps, so soft that friction hardly lifts a sliding body, with
    the e of the context's goal; and the impratio that it needs.

    friction: Coulomb's μ, of which the row has its friction.
    """
    # Here, as it imports SciPy's searches.
    from hcbench.engines.mujoco.recipes.compliant import IMPRATIO, whole_step_row

    row = whole_step_row(context.goal(), context.timestep, len(context.place.contact.rows))
    return row.with_friction(friction, context.timestep, IMPRATIO), IMPRATIO


def _soften(model: Any, geoms: tuple[int, ...], row: ConstraintRow, impratio: float) -> None:
    """Give contacts a row; without a <pair> friction has the same solref."""
    fixes.set_contact(model, geoms, row.solref, row.solimp)
    for pair in explicit_pairs(model, geoms):
        model.pair_solreffriction[pair] = row.solreffriction
    fixes.set_options(model, cone=int(backend().mjtCone.mjCONE_ELLIPTIC), impratio=impratio)
