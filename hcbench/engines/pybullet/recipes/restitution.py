"""PyBullet: the restitution that was set is the restitution that happens."""

from __future__ import annotations

from typing import Any

from hcbench.recipes.constant import minimax_constant
from hcbench.recipes.recipe import Recipe, Role
from hcbench.recipes.target import Target

# What stands between the number and the bounce out of the box: a speed threshold of 0.2 m/s, error reduction
# and slop that add or eat speed, and damping of free flight.
WORLD: dict[str, Any] = {
    "restitutionVelocityThreshold": 0.0,
    "contactSlop": 0.0,
    "contactERP": 0.0,
    "contactBreakingThreshold": 0.02,
}
BALL: dict[str, Any] = {"linearDamping": 0.0, "angularDamping": 0.0, "contactProcessingThreshold": 0.0}


def restitution(target: Target) -> dict[str, Any]:
    """Bullet's own restitution: the best constant e of the band, with all that distorts it switched off."""
    e, _ = minimax_constant(target)
    return {
        "world": WORLD,
        "ball": {**BALL, "restitution": e},
        "plate": {"restitution": 1.0},
        "maximal_coordinates": True,
    }


RESTITUTION = Recipe(
    "pybullet",
    "restitution",
    Role.CONSTANT_E,
    restitution,
    "Bullet's restitution without all that distorts it: the best constant e, at any step and phase.",
    (
        "The restitutions of the two bodies multiply: e goes on the ball and 1 on the plate.",
        "All of it must be set before the first step.",
        "erp is left as it is: 0 would let constraints and the joints of rigid bodies drift apart;"
        " contactERP=0 is all that a bounce needs.",
        "contactBreakingThreshold outlives resetSimulation and leaks into other clients of the process.",
        "Maximal coordinates (loadURDF's useMaximalCoordinates) keep e under gravity;"
        " Bullet's default rebounds from v + g dt.",
        "The force is one impulse of m (1 + e) v / dt: forces and contact times mean nothing.",
    ),
    one_step=True,
)
