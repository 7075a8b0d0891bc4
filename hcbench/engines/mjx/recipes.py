"""Settings of MJX: MuJoCo's own, as far as MJX and float32 do the same with them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hcbench.engines.mjx.engine import IMPEDANCE
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Integrators
from hcbench.sim.shared_model import changed, shared_recipes

_STEPS = Integrators(("Euler", "implicitfast", "RK4"), "MJX does not have it")
_SCATTER = 4e-3  # of e: a float32 position at R has steps of 4 nm, and 1e-5 s moves it by 250 and more
_ONE_FORCE = Integrators(("Euler", "implicitfast"), "its numbers are of one force a step")
_SOFT = "For this step and gravity. e scatters with where in a step a touch falls."
_FLOAT = "float32: e scatters by .004 at 1e-5 s and 1e-6 s; put the contact near the origin, not 1 m up."
_PUSHES = "`two-pair` and `staggered` are refused: MJX drops a pair's adhesion without a word."


def _coarser(options: Mapping[str, Any]) -> dict[str, Any]:
    """With an impedance whose rest float32 can tell."""
    rows = [{**row, "solimp": [IMPEDANCE, IMPEDANCE, *row["solimp"][2:]]} for row in options["rows"]]
    return {**options, "rows": rows}


_NATIVE = shared_recipes(
    "mjx",
    "mujoco",
    {
        "stock": {"notes": (_FLOAT,)},
        "impulse": {
            "function": changed("mujoco.impulse", _coarser),
            "notes": (
                "solimp .9, not .9999: of 1 - d float32 keeps too little, and e is off by .0024.",
                "Under gravity its step carries .9 of the weight only: e is off by .1 g h / v more.",
            ),
            "integrators": _ONE_FORCE,
            "within": 3e-6,
        },
        "spring-damper": {"notes": (_FLOAT, _PUSHES), "integrators": _STEPS, "within": 6e-3},
        "compliant": {"notes": (_SOFT, _FLOAT), "integrators": _ONE_FORCE, "within": 0.01},
        "compliant-pairs": {
            "function": changed("mujoco.compliant-pairs", dict, adhesive=False),
            "summary": "Two pairs of the same two geoms that only push: e falls with speed nearly as wanted.",
            "notes": (_SOFT, _PUSHES),
            "integrators": _ONE_FORCE,
        },
        "soft": {
            "function": changed("mujoco.soft", lambda options: {**options, "precision": "float64"}),
            "notes": ("float64 only: in float32 its power underflows, and nothing bounces.",),
            "integrators": _STEPS,
            "within": 0.01,
        },
        "staggered-push": {"notes": (_FLOAT, _PUSHES), "integrators": _STEPS, "within": _SCATTER},
    },
)
RECIPES = (
    *_NATIVE,
    *python_law_recipes(
        "mjx",
        _NATIVE,
        "In the step that jit and vmap take. precision = 'float64' is jax_enable_x64, for the whole process.",
        force=1e-3,
        common={"precision": "float64"},
    ),
    *python_law_recipes("mjx", _NATIVE, "In the step that jit and vmap take.", each_impact=5e-6),
)
