"""PyBullet: delivers exactly the restitution that is set."""

from __future__ import annotations

from typing import Any

from hcbench.recipes.constant import minimax_constant
from hcbench.recipes.recipe import Recipe, Role
from hcbench.recipes.target import Target

# What stands between the number and the bounce out of the box: a speed threshold of 0.2 m/s, error
# reduction and slop that add or eat speed, and damping of free flight.
WORLD: dict[str, Any] = {
    "restitutionVelocityThreshold": 0.0,
    "contactSlop": 0.0,
    "contactERP": 0.0,
    "contactBreakingThreshold": 0.02,
}
BALL: dict[str, Any] = {
    "linearDamping": 0.0,
    "angularDamping": 0.0,
    "contactProcessingThreshold": 0.0,
}


def restitution(target: Target) -> dict[str, Any]:
    """Bullet's own restitution: the best constant e of the band, with all
    that distorts it switched off.
    """
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
    "Bullet's restitution with what distorts it turned off: the best constant e, at any step and phase.",
    (
        "The restitutions of the two bodies multiply: set e on the ball and 1 on the plate.",
        "Set all of this before the first step.",
        "Leave erp at its default: with 0, constraints and joints of rigid bodies would drift apart.",
        "A bounce needs contactERP=0 only.",
        "resetSimulation does not reset contactBreakingThreshold, and all clients of the process share it.",
        "Use maximal coordinates (loadURDF's useMaximalCoordinates) to keep e under gravity.",
        "By default Bullet reverses the speed v + g dt instead of v.",
        "The bounce takes one step: contact force and contact time mean nothing.",
    ),
    one_step=True,
)
