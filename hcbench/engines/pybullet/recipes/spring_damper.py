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
