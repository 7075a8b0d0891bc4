"""Settings of MuJoCo Warp: MuJoCo's own, as far as float32 does the same with them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Integrators
from hcbench.recipes.target import Target
from hcbench.sim.shared_model import changed, shared_recipes

_STEPS = Integrators(("Euler", "implicitfast", "RK4"), "MuJoCo Warp does not have it")
_SCATTER = 4e-3  # of e: a float32 position at R has steps of 4 nm
_COPIES = "It keeps one of several pairs of the same two geoms: each has a massless copy of the ball's geom."
_FLOAT = "float32: e scatters by .004 at 1e-5 s and 1e-6 s; put the contact near the origin, not 1 m up."
_ONE_FORCE = Integrators(("Euler", "implicitfast"), "its numbers are of one force a step")
_SOFT = "For this step and gravity. e scatters with where in a step a touch falls."
_HUGE = "Keep adhesion about as large as the contact's force: 1e6 N, rounded in float32, lets e be off by .1."
_NOTES = {"notes": (_FLOAT, _COPIES), "integrators": _STEPS, "within": _SCATTER}


def compliant_pairs(target: Target, integrator: str = "Euler") -> Mapping[str, Any]:
    """MuJoCo's, with an adhesion of the size of the contact's force: float32 forgets that beside 1e6 N."""
    enough = 2.0 * target.mass * target.speed_max / target.timestep

    def held(options: Mapping[str, Any]) -> dict[str, Any]:
        rows = [{**row, "adhesion": min(enough, row["adhesion"])} for row in options["rows"]]
        return {**options, "rows": rows}

    return changed("mujoco.compliant-pairs", held)(target, integrator)


_NATIVE = shared_recipes(
    "mujoco-warp",
    "mujoco",
    {
        "stock": {"notes": (_FLOAT,)},
        "impulse": {
            "notes": (
                "D = (1 + e)/h is of this step only. The force is one impulse.",
                "float32 costs it nothing: e to 3e-7, 10 m from the origin too.",
            ),
            "integrators": _ONE_FORCE,
            "within": 1e-6,
        },
        "compliant": {"notes": (_SOFT, _FLOAT), "integrators": _ONE_FORCE, "within": 0.01},
        "compliant-pairs": {
            "function": compliant_pairs,
            "notes": (_SOFT, _COPIES, _HUGE),
            "integrators": _ONE_FORCE,
        },
        "spring-damper": {**_NOTES, "within": 6e-3},
        "two-pair": _NOTES,
        "staggered": _NOTES,
        "staggered-push": _NOTES,
    },
)
RECIPES = (
    *_NATIVE,
    *python_law_recipes(
        "mujoco-warp",
        _NATIVE,
        "A kernel in callback.passive, or lines before each step; each world has a solref of its own.",
        force=_SCATTER,
        each_impact=3e-6,
    ),
)
