"""Settings of MuJoCo Warp: MuJoCo's own, as far as float32 does the same with them."""

from __future__ import annotations

from hcbench.sim.batched import borrowed
from hcbench.tune.law_recipes import python_law_recipes
from hcbench.tune.recipe import Integrators

_STEPS = Integrators(("Euler", "implicitfast", "RK4"), "MuJoCo Warp does not have it")
_SCATTER = 4e-3  # of e: a float32 position at R has steps of 4 nm
_COPIES = "It keeps one of several pairs of the same two geoms: each has a massless copy of the ball's geom."
_FLOAT = "float32: e scatters by .004 at 1e-5 s and 1e-6 s; put the contact near the origin, not 1 m up."
_NOTES = {"notes": (_FLOAT, _COPIES), "integrators": _STEPS, "within": _SCATTER}
_NATIVE = borrowed(
    "mujoco-warp",
    "mujoco",
    {
        "stock": {"notes": (_FLOAT,)},
        "impulse": {
            "notes": (
                "D = (1 + e)/h is of this step only. The force is one impulse.",
                "float32 costs it nothing: e to 3e-7, 10 m from the origin too.",
            ),
            "integrators": Integrators(("Euler", "implicitfast"), "the bounce needs one force a step"),
            "within": 1e-6,
        },
        "spring-damper": {**_NOTES, "within": 6e-3},
        "two-pair": _NOTES,
        "staggered": _NOTES,
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
