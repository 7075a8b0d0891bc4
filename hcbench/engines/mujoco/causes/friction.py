"""Causes that show only where a body slides or spins."""

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.causes import fixes
from hcbench.engines.mujoco.causes.context import Context
from hcbench.engines.mujoco.causes.fixes import numbers
from hcbench.engines.mujoco.model import explicit_pairs, geom_friction
from hcbench.sim.model_under_test import Suspect

_LIFT = 0.02  # of e, over that of the same contact where nothing slides
_SOFT = 1e-4  # impedance of the fix, MuJoCo's least: that share of the lift is left
_STEPS = 6  # of the fix's contact: also a box that lands flat rests on it
_SOLIMP = (_SOFT, _SOFT, 1.0, 0.5, 1.0)


def sliding_lift(context: Context) -> Iterator[Suspect]:
    """Friction adds to the bounce: acceleration apart grows by impedance times μ times that of the slip."""
    contact, friction = context.used, geom_friction(context.model, context.geoms)
    if contact is None or not friction:
        return
    oblique = [i for i in context.impacts if i.tangential is not None]
    lifts = [(i.restitution - contact.restitution(i.speed_in), i) for i in oblique]
    lift, worst = max(lifts, key=lambda pair: pair[0], default=(0.0, None))
    if worst is None or worst.tangential is None or not lift > _LIFT:
        return
    solref, ratio = _whole_step_solref(context.goal(), context.timestep), 1.0 / _SOFT
    row = f'solref="{numbers(solref)}" solimp="{numbers(_SOLIMP)}"'
    slip = math.hypot(*worst.tangential.slip_in)
    yield Suspect(
        "sliding-lift",
        "Friction throws a sliding body up: MuJoCo's contact turns slip into bounce, as far as it is stiff.",
        f"e = {worst.restitution:.4g} where it slides at {slip:.3g} m/s, {lift:.3g} more than without slip; "
        f"impedance {contact.impedance(0.0):.4g}, friction {friction:g}",
        f'<option cone="elliptic" impratio="{ratio:g}"/>, for all contacts, and a <pair> of {context.names}: '
        f'{row} solreffriction="0 {-_SOFT / context.timestep:g}"',
        partial(_soften, geoms=context.all_geoms, solref=solref),
        apply_last=True,
    )


def _whole_step_solref(e: float, timestep: float) -> tuple[float, float]:
    """The spring and damper that turns v into -e v in _STEPS steps, whatever its impedance: the step
    v+ = v - h (K x + D v), x+ = x + h v+ multiplies by exp(±i π/n) √c, c = 1 - D h = e^(2/n).
    """
    c = max(e, 0.01) ** (2.0 / _STEPS)
    stiffness = (1.0 + c - 2.0 * math.sqrt(c) * math.cos(math.pi / _STEPS)) / timestep**2
    return -stiffness, -(1.0 - c) / timestep


def _soften(model: Any, geoms: tuple[int, ...], solref: tuple[float, float]) -> None:
    """Give contacts a soft row of a few steps; without a <pair> friction has the same solref."""
    fixes.set_contact(model, geoms, solref, _SOLIMP)
    for pair in explicit_pairs(model, geoms):
        model.pair_solreffriction[pair] = 0.0, -_SOFT / model.opt.timestep
    cone = int(backend().mjtCone.mjCONE_ELLIPTIC)
    fixes.set_options(model, cone=cone, impratio=1.0 / _SOFT)
