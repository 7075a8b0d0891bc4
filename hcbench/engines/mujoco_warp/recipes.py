"""Recipes of MuJoCo Warp: MuJoCo's own, as float32 needs them, and the laws from Python."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Integrators
from hcbench.sim.shared_model import changed, shared_recipes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hcbench.recipes.target import Target


_STEPS = Integrators(("Euler", "implicitfast", "RK4"), "MuJoCo Warp does not have this integrator")
# Range of e: a float32 position at R has steps of 4 nm.
_SCATTER = 4e-3
_COPIES = "MuJoCo Warp keeps one pair of two geoms only: each pair gets a massless copy of the ball's geom."
_FLOAT = (
    "In float32 e varies by 0.004 at 1 µs and 10 µs: put the contact near the origin, not 1 m up."
)
_ONE_FORCE = Integrators(("Euler", "implicitfast"), "the recipe assumes one contact force a step")
_SOFT = "The numbers hold at this step and gravity only. e varies with the phase of the step."
_HUGE = "Keep adhesion near the contact force: at 1e6 N, float32 rounding makes e wrong by 0.1."
_NOTES = {"notes": (_FLOAT, _COPIES), "integrators": _STEPS, "within": _SCATTER}


def compliant_pairs(target: Target, integrator: str = "Euler") -> Mapping[str, Any]:
    """MuJoCo's pairs, with adhesion as large as the contact's force:
    beside 1e6 N float32 loses that.
    """
    # N: twice the force that stops the fastest impact within one step.
    enough = 2.0 * target.mass * target.speed_max / target.timestep

    def held(options: Mapping[str, Any]) -> dict[str, Any]:
        """The options with no row's adhesion above `enough`."""
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
                "D = (1 + e)/h holds at this step only. The bounce takes one step.",
                "float32 is enough: e is within 3e-7, 10 m from the origin too.",
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
        "Runs as a kernel in callback.passive, or as the step function of `hcbench.contact.warp`.",
        force=_SCATTER,
        each_impact=3e-6,
    ),
)
