"""Recipes of MJX: MuJoCo's own, as float32 needs them, and the laws from Python."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Integrators
from hcbench.sim.shared_model import changed, shared_recipes

if TYPE_CHECKING:
    from collections.abc import Mapping


_STEPS = Integrators(("Euler", "implicitfast", "RK4"), "MJX does not have this integrator")
# Range of e in float32: a position at R has steps of 4 nm, and 1e-5 s
# moves it by 250 and more of them.
_SCATTER = 4e-3
# Impedance of a bounce in one step: float32 tells 1 - d to 2e-6.
_IMPEDANCE = 0.9
_ONE_FORCE = Integrators(("Euler", "implicitfast"), "the recipe assumes one contact force a step")
_SOFT = "The numbers hold at this step and gravity only. e varies with the phase of the step."
_FLOAT = (
    "In float32 e varies by 0.004 at 1 µs and 10 µs: put the contact near the origin, not 1 m up."
)
_PUSHES = "`two-pair` and `staggered` are refused: MJX ignores a pair's adhesion without a warning."
_CONES = (
    "With friction the cone is elliptic: MJX then has no contact of condim 1, in the whole model."
)
# Beside an impratio of 1e6 MJX rounds the square of mu / sqrt(impratio) up to 1e-15: with MuJoCo's
# own least mu, 1e-5, e rises by 0.1 where a body slides. From 1e-3 on it moves as in MuJoCo.
_LEAST_FRICTION = 1e-3


def _coarser(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options with an impedance d so far below 1 that float32 resolves 1 - d."""
    rows = []
    for row in options["rows"]:
        # The first two numbers of solimp are impedances.
        solimp = [_IMPEDANCE, _IMPEDANCE, *row["solimp"][2:]]
        rows.append({**row, "solimp": solimp})
    return {**options, "rows": rows}


def _all_rough(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options of a setting, in which all rows have some friction if one of them has: MJX cannot
    have contacts without friction (condim 1) together with elliptic cones.
    """
    rows = options["rows"]
    if any(row.get("friction") for row in rows):
        rows = [{"friction": _LEAST_FRICTION, **row} for row in rows]
    return {**options, "rows": rows}


_NATIVE = shared_recipes(
    "mjx",
    "mujoco",
    {
        "stock": {"notes": (_FLOAT,)},
        "impulse": {
            "function": changed("mujoco.impulse", _coarser),
            "notes": (
                "solimp is 0.9: with MuJoCo's 0.9999, float32 rounding makes e wrong by 0.0024.",
                "Under gravity the contact carries only 0.9 of the weight: e is wrong by 0.1 g h / v more.",
            ),
            "integrators": _ONE_FORCE,
            "within": 3e-6,
        },
        "spring-damper": {"notes": (_FLOAT, _PUSHES), "integrators": _STEPS, "within": 6e-3},
        "compliant": {"notes": (_SOFT, _FLOAT, _CONES), "integrators": _ONE_FORCE, "within": 0.01},
        "compliant-pairs": {
            "function": changed("mujoco.compliant-pairs", _all_rough, adhesive=False),
            "summary": "Two pairs of the same two geoms that only push: e falls with speed, near the target.",
            "notes": (_SOFT, _PUSHES, _CONES),
            "integrators": _ONE_FORCE,
        },
        "soft": {
            "function": changed("mujoco.soft", lambda options: {**options, "precision": "float64"}),
            "notes": (
                "Needs float64: in float32 the power of solimp underflows, and nothing bounces.",
            ),
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
        "Runs in the step function, for jit and vmap. precision = 'float64' sets jax_enable_x64 globally.",
        force=1e-3,
        common={"precision": "float64"},
    ),
    *python_law_recipes(
        "mjx", _NATIVE, "Runs in the step function, for jit and vmap.", each_impact=5e-6
    ),
)
