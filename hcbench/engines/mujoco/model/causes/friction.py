"""Causes that show only where a body slides or spins."""

import math
from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import explicit_pairs, geom_friction
from hcbench.engines.mujoco.model.causes import fixes
from hcbench.engines.mujoco.model.causes.context import Context
from hcbench.engines.mujoco.scene.mjcf import numbers_text
from hcbench.engines.mujoco.scene.rows import ConstraintRow
from hcbench.sim.model_under_test import Suspect
from hcbench.terms.impact import Impact, Tangential

# Share of μ that friction may be short before it counts as weak.
WEAK = 0.05
# Gain of e, over that of the same contact without slip, from which friction is named.
_LIFT = 0.02


def sliding_lift(context: Context) -> Iterator[Suspect]:
    """Friction adds to the bounce: acceleration apart grows by impedance
    times μ times that of the slip.
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
    row, impratio = _soft_row(context, friction)
    words = {"solref": row.solref, "solimp": row.solimp, "solreffriction": row.solreffriction}
    # A <pair> that says nothing of friction has MuJoCo's default, not that of its geoms.
    attributes = ['condim="3"', f'friction="{friction:g} {friction:g}"']
    for name, values in words.items():
        attributes.append(f'{name}="{numbers_text(values, "{:.6g}".format)}"')
    pair = " ".join(attributes)
    slip = math.hypot(*worst.tangential.slip_in)
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
    """The impact in which friction is weakest although the body slides on, and the cone
    as what may weaken it: along the diagonal of the pyramid friction is 29 % below
    Coulomb's. None where nothing is short.
    """
    if int(model.opt.cone) != int(backend().mjtCone.mjCONE_PYRAMIDAL) or not friction:
        return None
    weakest = None
    least = math.inf
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
    """A row of a few steps with the e that is wanted, so soft that
    friction hardly lifts; its impratio.
    """
    # Here, as it imports SciPy's searches.
    from hcbench.engines.mujoco.recipes.compliant_fit import IMPRATIO, whole_step_row

    row = whole_step_row(context.goal(), context.timestep, len(context.place.contact.rows))
    return row.with_friction(friction, context.timestep, IMPRATIO), IMPRATIO


def _soften(model: Any, geoms: tuple[int, ...], row: ConstraintRow, impratio: float) -> None:
    """Give contacts a row; without a <pair> friction has the same solref."""
    fixes.set_contact(model, geoms, row.solref, row.solimp)
    for pair in explicit_pairs(model, geoms):
        model.pair_solreffriction[pair] = row.solreffriction
    fixes.set_options(model, cone=int(backend().mjtCone.mjCONE_ELLIPTIC), impratio=impratio)
