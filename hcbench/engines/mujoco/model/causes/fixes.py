"""Fixes that the diagnosis suggests: numbers for a user to paste, and
changes to a copy of the model.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

from hcbench.engines.mujoco.model.bodies import explicit_pairs, integrator_name
from hcbench.engines.mujoco.scene.mjcf import numbers_text
from hcbench.engines.mujoco.scene.rows import STIFF_SOLIMP
from hcbench.laws.kelvin_voigt import Ending, matched
from hcbench.terms.resolution import STEPS_OF_AN_EXPLICIT_SPRING

# Ten digits: as many as hcbench writes into an attribute of XML.
numbers = partial(numbers_text, number="{:.10g}".format)
# No spring and damper is made for a smaller e: e = 0 would take infinite damping.
_LEAST_E = 0.01


def solref_of(e: float, timestep: float, integrator: str) -> tuple[float, float]:
    """solref, in the direct format, that has the restitution e with STIFF_SOLIMP.

    timestep: s.
    integrator: as XML spells it.
    A bounce in one step where the integrator allows it: without a spring, "0 -(1 + e)/h". Under RK4
    and discrete a spring and damper of a few steps, "-stiffness -damping" (1/s², 1/s), with an e of
    0.01 at least.
    """
    if integrator in ("RK4", "discrete"):
        law = matched(
            min(max(e, _LEAST_E), 1.0), STEPS_OF_AN_EXPLICIT_SPRING * timestep, 1.0, Ending.FORCE
        )
        return -law.stiffness, -law.damping
    return 0.0, -(1.0 + e) / timestep


def set_contact(
    model: Any, geoms: Sequence[int], solref: Sequence[float] | None, solimp: Sequence[float]
) -> None:
    """Set the parameters of the contacts among some geoms: in their <pair>s, or else in the geoms.

    model: changed.
    geoms: their numbers, both sides of the contact.
    solref: (timeconst s, dampratio) or (-stiffness 1/s², -damping 1/s); None leaves it as it is.
    solimp: MuJoCo's five numbers.
    """
    pairs = explicit_pairs(model, geoms)
    # The fields of <pair>s or of geoms, and their numbers.
    source, rows = ("pair", pairs) if pairs else ("geom", list(geoms))
    if solref is not None:
        getattr(model, f"{source}_solref")[rows] = solref
    getattr(model, f"{source}_solimp")[rows] = solimp
    if not pairs:
        # Equal priorities: else MuJoCo would take the parameters of one geom alone.
        model.geom_priority[rows] = model.geom_priority[rows].max()


def set_restitution(model: Any, geoms: Sequence[int], e: float) -> None:
    """Give the contact this e, at the step and under the integrator that the model has by then."""
    set_contact(
        model, geoms, solref_of(e, float(model.opt.timestep), integrator_name(model)), STIFF_SOLIMP
    )


def set_options(model: Any, **values: Any) -> None:
    """Set fields of the model's options."""
    for name, value in values.items():
        setattr(model.opt, name, value)


def disable(model: Any, flag: int) -> None:
    """Turn off something of the whole model."""
    model.opt.disableflags |= flag


def free_limits(model: Any, joints: Sequence[int], tendons: Sequence[int]) -> None:
    """Take the limits off some joints and tendons."""
    model.jnt_limited[list(joints)] = 0
    model.tendon_limited[list(tendons)] = 0


def zero_dofs(model: Any, field: str, dofs: Sequence[int]) -> None:
    """Take a loss off some degrees of freedom."""
    getattr(model, field)[list(dofs)] = 0.0


def no_margin(model: Any, geoms: Sequence[int]) -> None:
    """Let contacts act where the surfaces meet."""
    for field in ("margin", "gap"):
        getattr(model, f"geom_{field}")[list(geoms)] = 0.0
        getattr(model, f"pair_{field}")[explicit_pairs(model, geoms)] = 0.0
