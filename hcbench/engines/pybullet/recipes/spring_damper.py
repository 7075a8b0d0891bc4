"""PyBullet: contactStiffness and contactDamping with the law's contact time."""

from typing import Any

from hcbench.engines.pybullet.recipes.restitution import BALL, WORLD
from hcbench.recipes import constant
from hcbench.recipes.recipe import Recipe, Role
from hcbench.recipes.target import Target

# Bullet puts the springs of the two bodies in series: the plate's must not yield.
RIGID = 1e30


def spring_damper(target: Target) -> dict[str, Any]:
    """Kelvin-Voigt contact, eq. (4), as Bullet integrates it: F = max(0, k (x + h v+) + c v+).

    With the best constant e of the band; SettingError for e = 1.
    """
    duration = constant.contact_time(target)
    stiffness, damping = constant.implicit_spring_damper(target, duration, "restitution")
    return {
        "world": WORLD,
        "ball": {**BALL, "contactStiffness": stiffness, "contactDamping": damping},
        "plate": {"contactStiffness": RIGID, "contactDamping": 0.0},
        "maximal_coordinates": False,
    }


SPRING_DAMPER = Recipe(
    "pybullet",
    "spring-damper",
    Role.CONSTANT_E,
    spring_damper,
    "contactStiffness and contactDamping: the best constant e, the law's contact time at middle speed.",
    (
        "k (N/m) and c (N s/m) are for this mass, unlike MuJoCo's.",
        "Bullet's implicit step adds damping. At coarse steps hcbench softens the spring to keep it small.",
        "The plate needs contactStiffness 1e30: Bullet puts the springs of the two bodies in series.",
        "e does not depend on speed, and the force jumps at touch: the force loop is not the law's.",
        "resetSimulation does not reset contactBreakingThreshold, and all clients of the process share it.",
    ),
)
