"""Settings of PhysX through SAPIEN, the preferred ones of each role first."""

from __future__ import annotations

from typing import Any

from hcbench.recipes.constant import minimax_constant
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Recipe, Role, stock
from hcbench.recipes.target import Target

_SCENE = {"bounce_threshold": 0.0, "enable_tgs": True}
_WITHIN = 1.3e-6  # of e, by float32
_SCATTER = 3e-3  # of a force law's at 1e-5 s: a position at R has steps of 4 nm


def restitution(target: Target) -> dict[str, Any]:
    """PhysX's own restitution: the best constant e of the band, without a threshold."""
    e, _ = minimax_constant(target)
    return {**_SCENE, "restitution": e}


_NATIVE = (
    stock(
        "physx",
        "PhysX as SAPIEN makes it: nothing bounces below 2 m/s.",
        "Above 2 m/s it bounces with e = .1, that of the default material.",
        forms=("plane",),
    ),
    Recipe(
        "physx",
        "restitution",
        Role.CONSTANT_E,
        restitution,
        "PhysX's restitution with no bounce threshold, by TGS: the best constant e, at any step and phase.",
        (
            "The threshold is set before the system is made: later edits of system.config do nothing.",
            "The materials of the two are averaged, and SAPIEN cannot change that: e goes on both.",
            "TGS only: PGS bounces with .77 ... .9 for .9, by luck of the phase.",
            "A restitution below 0 is a spring's stiffness for PhysX.",
            "Under gravity it rebounds with e (v + g h), v the speed of the state before the touch.",
            "The ball turns in the step in which it would touch, above the plate: there is no loop to read.",
            "float32: e to 1.3e-6 at 1e-5 ... 1/240 s, within metres of the origin; to .003 at 1e-6 s.",
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
        f"Called before each step, as PhysX calls nothing back; float32: force laws scatter by {_SCATTER:g}.",
        force=_SCATTER,
        each_impact=_WITHIN,
        common=_SCENE,
    ),
)
