"""PyBullet: contactStiffness and contactDamping with the law's contact time."""

import math
from typing import Any

from hcbench.engines.pybullet.recipes.restitution import BALL, WORLD
from hcbench.errors import SettingError
from hcbench.tune import constant
from hcbench.tune.recipe import Recipe, Role
from hcbench.tune.target import Target

# Bullet puts the springs of the two bodies in series: the plate's must not yield.
RIGID = 1e30


def spring_damper(target: Target) -> dict[str, Any]:
    """Kelvin-Voigt contact, eq. (4), as Bullet integrates it: F = max(0, k (x + h v+) + c v+).

    With the best constant e of the band; SettingError for e = 1. k and c are those whose implicit step has
    the poles exp((-β ± i ω) h) of the wanted motion exactly: m exp(2 β h) = m + h c + h² k, so c is smaller
    than a continuous damper's by k h.
    """
    e, _ = constant.minimax_constant(target)
    h, m = target.timestep, target.mass
    if e >= 1.0:
        raise SettingError("restitution", "1", "e below 1", "Bullet's implicit step always damps")
    beta, omega = constant.spring_damper(e, constant.contact_time(target), "restitution")
    # c >= 0 asks for exp(2 β h) - 1 >= h² k / m, nearly 2 β >= ω² h: slow down until it holds.
    slower = max(1.0, (omega**2 + beta**2) * h / (2 * beta) * (1 + 1e-9))
    while True:
        grow, turn = math.exp(beta / slower * h), omega / slower * h
        stiffness = (grow**2 + 1 - 2 * grow * math.cos(turn)) / h**2
        damping = (grow**2 - 1) / h - stiffness * h
        if damping >= 0:
            break
        slower *= 1.02
    return {
        "world": WORLD,
        "ball": {**BALL, "contactStiffness": m * stiffness, "contactDamping": m * damping},
        "plate": {"contactStiffness": RIGID, "contactDamping": 0.0},
        "maximal_coordinates": False,
    }


SPRING_DAMPER = Recipe(
    "pybullet",
    "spring-damper",
    Role.CONSTANT_E,
    spring_damper,
    "contactStiffness and contactDamping: the best constant e and the law's contact time mid-band.",
    (
        "k and c are for this mass (N/m, N s/m), unlike MuJoCo's.",
        "Bullet's implicit step damps by itself: a coarse step softens the spring until that alone is not"
        " more than the damping wanted.",
        "The plate needs contactStiffness 1e30: Bullet puts the two in series.",
        "e does not depend on speed, and the force jumps at touch: it is not the law's loop.",
        "contactBreakingThreshold outlives resetSimulation and leaks into other clients of the process.",
    ),
)
