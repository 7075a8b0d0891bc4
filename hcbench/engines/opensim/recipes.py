"""Settings of OpenSim in closed form, the preferred ones of each role first.

Simbody's contact of a sphere with a half space, with one set of parameters for both, is
F = (4/3) sqrt(R) (S^(2/3)/2)^1.5 x^1.5 (1 + 1.5 c x'): eq. (16) with c = α.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Recipe, Role, stock
from hcbench.recipes.target import Target
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Status

_ACCURACY = 1e-11
_HERTZ = 1.5


def stock_accuracy(target: Target) -> dict[str, Any]:
    """Set the numbers of the law, c = α; SettingError for an exponent that Simbody's contact does
    not have.
    """
    law = target.law
    if law.exponent != _HERTZ:
        given, advice = f"n = {law.exponent:g} in opensim", "The plug-in `hunt-crossley` has any"
        raise SettingError("exponent", given, "n = 1.5 for HuntCrossleyForce", advice)
    return {"stiffness": law.stiffness, "dissipation": law.alpha}


def hunt_crossley_force(target: Target) -> dict[str, Any]:
    """Set the law as OpenSim's force, under error control that is tight enough for e."""
    return {**stock_accuracy(target), "accuracy": _ACCURACY}


_ON_A_PLANE = partial(Recipe, "opensim", forms=("plane",), kinds=("law",))
_SHARED = "Both geometries share one set of numbers: call addGeometry for both, then set them on the force."
_NATIVE = (
    stock(
        "opensim",
        "OpenSim with nothing set: the force has stiffness 0, and the state becomes NaN without a warning.",
        forms=("plane",),
        ends=Status.DIVERGED,
    ),
    _ON_A_PLANE(
        "force",
        Role.LAW_AND_LOOP,
        hunt_crossley_force,
        "HuntCrossleyForce with c = α and accuracy 1e-11: the law, force loop included, at any step.",
        (
            "Its dissipation c is α itself, where Drake's d is 1.5 α.",
            "The step only sets how often you read the state; the integrator takes smaller ones.",
            "e is within 5e-9. At accuracy 1e-5 it is wrong by 0.0024, at 1e-7 by 5e-5, at 1e-9 by 3e-7.",
            "Coarse fixed steps gain energy.",
            _SHARED,
        ),
        within=1e-8,
    ),
    _ON_A_PLANE(
        "stock-accuracy",
        Role.FALLING_E,
        stock_accuracy,
        "HuntCrossleyForce with c = α at OpenSim's default accuracy, 1e-3: e wrong by 0.2, or energy gained.",
        (
            "Launched at 1 in/s from 1 mm and read once a millisecond, a ball leaves 2.9 times as fast.",
            "Frequent calls of integrate() shorten its steps and hide the error: 0.001 at 20 µs.",
            _SHARED,
        ),
        by_auto=False,
    ),
)
RECIPES = (
    *_NATIVE,
    *python_law_recipes(
        "opensim",
        _NATIVE,
        "Uses an ExpressionBasedCoordinateForce, for any exponent: Python cannot define a Force.",
        force=1e-8,
        common={"accuracy": _ACCURACY},
    ),
)
