"""MuJoCo: one row with the best constant e: a bounce in a single step, or a spring and damper with the
law's contact time.
"""

import math
from typing import Any

from hcbench.engines.mujoco.recipes.common import DAMPED_STEP, SOFTENED, WEAK_FRICTION, rows_options
from hcbench.engines.mujoco.scene.rows import MAX_IMPEDANCE, STIFF_SOLIMP, ConstraintRow
from hcbench.recipes import constant
from hcbench.recipes.recipe import Integrators, Recipe, Role
from hcbench.recipes.target import Target


def impulse(target: Target, integrator: str = "Euler", spring: float = 0.0) -> dict[str, Any]:
    """Options of a setting, by name: one contact whose damping turns v into -e v within the step
    that finds it closed.

    target: e is the best constant of its band; its step counts. integrator: that the options name.
    spring: K, 1/s².
    A contact of impedance d gives the acceleration a = d (K x - D v) + (1 - d) g: with D = (1 +
    e)/h a step h ends in v - (1 + e) v = -e v, at any depth x. K is 0 for an e that is exact at
    every phase. A K above 0 lifts a body at rest out of the slow creep that the missing 1 - d
    allows, to a depth of 1e-4 g / K, at the price of up to K h² / 2 in e.
    """
    e, _ = constant.minimax_constant(target)
    h = target.timestep
    # A step finds the ball 0 ... v h deep: half of K h takes the spring's mean effect on e out.
    damping = (1 + e) / h - spring * h / 2
    return rows_options(
        integrator, ConstraintRow.direct(spring * MAX_IMPEDANCE, damping, STIFF_SOLIMP)
    )


IMPULSE = Recipe(
    "mujoco",
    "impulse",
    Role.CONSTANT_E,
    impulse,
    "One step turns v into -e v: the best constant e, exact without gravity and friction; no force loop.",
    (
        "Use the integrator Euler, implicit or implicitfast; RK4 and discrete give e = 0 and are refused.",
        "The numbers serve every body at every speed, at this step only.",
        "If you change the step, change solref too: D = (1 + e)/h.",
        "Set solref and solimp on both geoms or in a <pair>: MuJoCo mixes those of the two geoms.",
        "At rest under gravity a body drifts into the plate at about 1e-4 g h / (1 + e).",
        "Do not use it with friction, which throws a sliding body up: use `compliant`.",
        "Under gravity e varies by up to (1 + e) g h / v with the phase of the step.",
        "The bounce takes one step: contact force, stress and contact time mean nothing.",
    ),
    one_step=True,
    integrators=Integrators(
        ("Euler", "implicit", "implicitfast"), "the recipe assumes one contact force a step"
    ),
)


def spring_damper(target: Target, integrator: str = "Euler") -> dict[str, Any]:
    """Options of a setting, by name: a Kelvin-Voigt contact, eq. (4), by solref in its direct form,
    with the best constant e of the band.

    integrator: that the options name, and that the numbers are for. Of impedance d throughout, the
    contact is a = S x / d + D v. S and D are those whose discrete orbit x+ = x + h v+, v+ = v - h
    (S/d x + D v) has the poles exp((-β ± i ω) h) of the wanted motion exactly, so the step does not
    shift e or the contact time to first order.
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
