"""Settings of OpenSim in closed form, the preferred ones of each role first.

Simbody's contact of a sphere with a half space, with one set of parameters for both, is
F = (4/3) sqrt(R) (S^(2/3)/2)^1.5 x^1.5 (1 + 1.5 c x'): eq. (16) with c = α.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from hcbench.errors import SettingError
from hcbench.impact import Status
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Recipe, Role, stock
from hcbench.recipes.target import Target

_ACCURACY = 1e-11
_HERTZ = 1.5


def stock_accuracy(target: Target) -> dict[str, Any]:
    """The law's own numbers, c = α; SettingError for an exponent that Simbody's contact does not have."""
    law = target.law
    if law.exponent != _HERTZ:
        given, advice = f"n = {law.exponent:g} in opensim", "The plug-in `hunt-crossley` has any"
        raise SettingError("exponent", given, "n = 1.5 for HuntCrossleyForce", advice)
    return {"stiffness": law.stiffness, "dissipation": law.alpha}


def hunt_crossley_force(target: Target) -> dict[str, Any]:
    """With error control that is tight enough for e."""
    return {**stock_accuracy(target), "accuracy": _ACCURACY}


_ON_A_PLANE = partial(Recipe, "opensim", forms=("plane",), kinds=("law",))
_SHARED = "One set of numbers for both geometries: addGeometry both, then set them on the force."
_NATIVE = (
    stock(
        "opensim",
        "OpenSim with nothing set: the force's stiffness is 0, and the state turns to NaN without a warning.",
        forms=("plane",),
        ends=Status.DIVERGED,
    ),
    _ON_A_PLANE(
        "force",
        Role.LAW_AND_LOOP,
        hunt_crossley_force,
        "HuntCrossleyForce with c = α and accuracy 1e-11: eq. (16), loop included, at any step.",
        (
            "Its dissipation c is α itself, where Drake's d is 1.5 α.",
            "The step only says how often you look: error control takes smaller ones. e to 5e-9.",
            "Accuracy 1e-5 errs by .0024, 1e-7 by 5e-5, 1e-9 by 3e-7; fixed steps gain energy when coarse.",
            _SHARED,
        ),
        within=1e-8,
    ),
    _ON_A_PLANE(
        "stock-accuracy",
        Role.FALLING_E,
        stock_accuracy,
        "HuntCrossleyForce with c = α at OpenSim's own accuracy of 1e-3: e errs by .2, or gains energy.",
        (
            "At 1 in/s from 1 mm, looked at once a millisecond, it leaves at 2.9 times its speed.",
            "Frequent calls of integrate() cut its steps short and hide the error: .001 at 2e-5 s.",
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
        "An ExpressionBasedCoordinateForce, for any exponent; a Force cannot be written in Python.",
        force=1e-8,
        common={"accuracy": _ACCURACY},
    ),
)
