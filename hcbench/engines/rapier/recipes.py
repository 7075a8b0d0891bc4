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
        "Rapier averages the restitutions of both colliders by default: set e on both.",
        "Rapier has no speed threshold, and reverses the speed of the start of the step.",
        "Under gravity a rebound slower than 1.3 g h (5 cm/s at 1/240 s) is back within two steps and stays.",
        "Such a ball counts as at rest, with e = 0.",
        "In float32, a ball that moves less than half a rounding unit of its height a step does not move.",
        "The bounce takes one step: contact force and contact time mean nothing.",
    ),
)
_HOOK = "Before each world.step(), lines of Python set the restitution of both colliders."
RECIPES = (*_NATIVE, *python_law_recipes("rapier", _NATIVE, _HOOK, each_impact=1e-6))
