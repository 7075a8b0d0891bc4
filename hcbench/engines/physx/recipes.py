"""Settings of PhysX through SAPIEN, the preferred ones of each role first."""

from __future__ import annotations

from typing import Any

from hcbench.recipes.constant import minimax_constant
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Recipe, Role, stock
from hcbench.recipes.target import Target

_SCENE = {"bounce_threshold": 0.0, "enable_tgs": True}
_WITHIN = 1.3e-6  # of e, by float32
# Of a force law's at 1e-5 s: a position at R has steps of 4 nm
_SCATTER = 3e-3


def restitution(target: Target) -> dict[str, Any]:
    """PhysX's own restitution: the best constant e of the band, without a threshold."""
    e, _ = minimax_constant(target)
    return {**_SCENE, "restitution": e}


_NATIVE = (
    stock(
        "physx",
        "PhysX with SAPIEN's defaults: nothing bounces below 2 m/s.",
        "Above 2 m/s bodies bounce with e = 0.1, that of the default material.",
        forms=("plane",),
    ),
    Recipe(
        "physx",
        "restitution",
        Role.CONSTANT_E,
        restitution,
        "PhysX's restitution, bounce threshold 0, TGS solver: the best constant e, at any step and phase.",
        (
            "Set the threshold before the system is made: later edits of system.config do nothing.",
            "PhysX averages the materials of the two, which SAPIEN cannot change: set e on both.",
            "Use TGS: under PGS a restitution of 0.9 gives 0.77 ... 0.9, by the phase of the step.",
            "PhysX takes a restitution below 0 as the stiffness of a spring.",
            "Under gravity a body rebounds with e (v + g h), v its speed before the contact.",
            "The ball reverses above the plate, in the step in which it would touch: there is no force loop.",
            "float32, within metres of the origin: e is within 1.3e-6 at 10 µs ... 1/240 s, 0.003 at 1 µs.",
        ),
        one_step=True,
        forms=("plane",),
        within=_WITHIN,
    ),
)
RECIPES = (
    *_NATIVE,
    *python_law_recipes(
        "physx",
        _NATIVE,
        f"Call it before each step: PhysX has no callbacks. In float32, force laws vary e by {_SCATTER:g}.",
        force=_SCATTER,
        each_impact=_WITHIN,
        common=_SCENE,
    ),
)
