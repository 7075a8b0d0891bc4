"""Settings of DART in closed form."""

from __future__ import annotations

import math
from typing import Any

from hcbench.recipes.constant import minimax_constant
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Role, on_a_plane, stock
from hcbench.recipes.target import Target
from hcbench.system.errors import SettingError

# Constraint force mixing, built in: a shape's e gives (1 + e)/(1 + 1e-5) - 1
_MIXING = 1e-5
# Units of length a second: no bounce below in e v, none faster than that
_THRESHOLD, _CAP = 0.1, 100.0


def units_per_metre(target: Target, e: float) -> float:
    """The smallest unit of length, a power of ten, whose cap is half again the band's highest speed."""
    units = 10.0 ** math.floor(math.log10(_CAP / (1.5 * target.speed_max)))
    if e * target.speed_min * units <= _THRESHOLD:
        got, least = f"from {target.speed_min:.4g} m/s on", _THRESHOLD / (e * units) if e else math.inf
        raise SettingError("speeds", got, f"{least:.4g} m/s or more: DART bounces within a band of 1000 only")
    return units


def restitution(target: Target) -> dict[str, Any]:
    """The best constant e, in a unit of length that keeps the band between threshold and cap."""
    e, _ = minimax_constant(target)
    return {
        "restitution": min(1.0, (1.0 + e) * (1.0 + _MIXING) - 1.0),
        "units_per_metre": units_per_metre(target, e),
    }


_UNITS = (
    "Nothing bounces while e v is below 0.1 units of length a second; no rebound is faster than 100.",
    "So a scene in cm bounces from 1 mm/s to 1 m/s, a scene in metres from 0.1 m/s on.",
    "Scale all lengths of the scene to your unit, gravity too.",
    "Under gravity the rebound is e (v + g h): energy grows.",
    "The ball goes on bouncing at e g h/(1 - e), 0.12 m/s for e = 0.93 at 1 ms.",
    "It stops where that is below the threshold. `restitution-law` avoids it: it sets e v/(v + g h).",
)
_NATIVE = (
    stock(
        "dart",
        "DART with nothing set: a shape's restitution is 0 and nothing bounces.",
        "URDF, SDF and SKEL files cannot set restitution: set it in Python.",
        forms=("plane",),
    ),
    on_a_plane("dart", "restitution", Role.CONSTANT_E, restitution, one_step=True)(
        "DART's restitution: the best constant e, exact at any step and phase, in suitable units of length.",
        "Restitutions multiply: set the plate's to 1; its default is 0.",
        "DART's constraint force mixing of 1e-5 lowers e: set (1 + e)(1 + 1e-5) - 1.",
        "The highest e is 0.99998.",
        *_UNITS,
        "The bounce takes one step: contact force and contact time mean nothing.",
    ),
)
_HOOK = "Before each world.step(), call addExtForce, or setRestitutionCoeff on the ball's shape."


def _unit_of_law(target: Target) -> dict[str, Any]:
    return {"units_per_metre": units_per_metre(target, float(target.restitution(target.speed_min)))}


_LAWS = python_law_recipes(
    "dart", _NATIVE, _HOOK, force=5e-6, each_impact=1e-12, each_impact_options=_unit_of_law
)
RECIPES = (*_NATIVE, *_LAWS)
