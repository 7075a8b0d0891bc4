"""Settings of Rapier in closed form."""

from __future__ import annotations

from typing import Any

from hcbench.recipes.constant import minimax_constant
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Role, on_a_plane, stock
from hcbench.recipes.target import Target


def restitution(target: Target) -> dict[str, Any]:
    """The best constant e, on both colliders."""
    return {"restitution": minimax_constant(target)[0]}


_NATIVE = (
    stock(
        "rapier",
        "Rapier with nothing set: restitution 0 and nothing bounces.",
        forms=("plane",),
    ),
    on_a_plane("rapier", "restitution", Role.CONSTANT_E, restitution, one_step=True, within=1e-6)(
        "Rapier's restitution: the best constant e, at any step and phase, to 32-bit rounding.",
        "Stock averages the restitutions of both colliders: set the same on both.",
        "It has no threshold, and under gravity reverses the speed of the step's start.",
        "Under gravity a ball that rebounds slower than 1.3 g h (5 cm/s at 1/240 s) is back within two steps"
        " and stays: it counts as at rest, with e 0.",
        "Its numbers have 32 bits: a ball that moves under half an ulp of its height a step stands still.",
        "The force is one impulse of m (1 + e) v / h: forces and contact times mean nothing.",
    ),
)
_HOOK = "Lines of Python before each world.step(): restitution of both colliders."
RECIPES = (*_NATIVE, *python_law_recipes("rapier", _NATIVE, _HOOK, each_impact=1e-6))
