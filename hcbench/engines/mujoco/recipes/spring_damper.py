"""MuJoCo: a linear spring and damper with the law's contact time."""

import math
from typing import Any

from hcbench.engines.mujoco.recipes.common import DAMPED_STEP, SOFTENED, WEAK_FRICTION, rows_options
from hcbench.engines.mujoco.scene.rows import MAX_IMPEDANCE, STIFF_SOLIMP, ConstraintRow
from hcbench.recipes import constant
from hcbench.recipes.recipe import Recipe, Role
from hcbench.recipes.target import Target


def spring_damper(target: Target, integrator: str = "Euler") -> dict[str, Any]:
    """Options of a setting: a Kelvin-Voigt contact, eq. (4), by solref in its direct form, with
    the best constant e of the band.

    Of impedance d throughout, the contact is a = S x / d + D v. S and D are those whose discrete
    orbit x+ = x + h v+, v+ = v - h (S/d x + D v) has the poles exp((-β ± i ω) h) of the wanted
    motion exactly, so the step does not shift e or the contact time to first order.
    """
    e, _ = constant.minimax_constant(target)
    beta, omega = constant.spring_damper(e, constant.contact_time(target), "impulse")
    h = target.timestep
    if integrator == "RK4":
        spring = omega**2 + beta**2
        damping = 2 * beta
    else:
        decay = math.exp(-beta * h)
        damping = (1 - decay**2) / h
        spring = (1 + decay**2 - 2 * decay * math.cos(omega * h)) / h**2
    return rows_options(
        integrator, ConstraintRow.direct(spring * MAX_IMPEDANCE, damping, STIFF_SOLIMP)
    )


SPRING_DAMPER = Recipe(
    "mujoco",
    "spring-damper",
    Role.CONSTANT_E,
    spring_damper,
    "A linear spring and damper: the best constant e, and the law's contact time at the middle speed.",
    (
        "Use the integrator Euler, implicit, implicitfast or RK4; discrete is refused: it lowers e by 0.2.",
        "The numbers are per unit effective mass, so they give the same e for any mass.",
        "A contact lasts at least 20 steps: where the law's is shorter, hcbench softens the spring.",
        SOFTENED,
        WEAK_FRICTION,
        "e does not depend on speed, and the force jumps at touch: the force loop is not the law's.",
        "Set solref and solimp on both geoms or in a <pair>: MuJoCo mixes those of the two geoms.",
    ),
    integrators=DAMPED_STEP,
)
