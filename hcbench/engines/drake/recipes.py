"""Settings of Drake in closed form, the preferred ones of each role first.

Point contact is F = max(0, k x (1 + d v)), k and d of the pair: eq. (16) with n = 1 and d = 1.5 α. So e is
the law's, for any k, and the loop is not. k = k1 k2/(k1 + k2): each body is given twice the pair's.
"""

from __future__ import annotations

import math
from typing import Any

from hcbench.recipes import constant
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Role, on_a_plane, stock
from hcbench.recipes.target import Target

# Share of e that the discrete plant's own damping may take, where that is not too soft
_DAMPED = 2e-3
_DEEPEST = 1e-3  # m: as deep as the band's highest speed may go for it


def _hertz_stiffness(target: Target) -> float:
    """k, N/m, of the linear spring that goes as deep as the law's at the middle of the band, undamped."""
    n, energy = target.law.exponent, 0.5 * target.mass * target.speed_min * target.speed_max
    deepest = ((n + 1.0) * energy / target.law.stiffness) ** (1.0 / (n + 1.0))
    return float(2.0 * energy / deepest**2)


def continuous(target: Target) -> dict[str, Any]:
    """Follow the law's e at any step, by an integrator with error control."""
    pair = {"point_stiffness": 2.0 * _hertz_stiffness(target), "dissipation": target.law.dissipation}
    return {"plant": "continuous", "accuracy": 2e-11, **pair}


def discrete(target: Target) -> dict[str, Any]:
    """A soft spring: implicit Euler multiplies e by exp(-π ω h/2), ω² = k/m.

    Gravity, which a contact of π/ω feels, takes about π α g/ω: the two are even at ω² = 2 α g/h.
    """
    h, law = target.timestep, target.law
    under_gravity = math.sqrt(2.0 * law.alpha * target.gravity / h)
    omega = max(2.0 * _DAMPED / (math.pi * h), target.speed_max / _DEEPEST, under_gravity)
    k = min(target.mass * omega**2, _hertz_stiffness(target))
    return {"approximation": "similar", "point_stiffness": 2.0 * k, "dissipation": law.dissipation}


def spring_damper(target: Target) -> dict[str, Any]:
    """One e for all speeds: `sap` damps by c = k τ, τ the sum of the relaxation times."""
    stiffness, damping = constant.implicit_spring_damper(target, constant.contact_time(target), "continuous")
    pair = {"point_stiffness": 2.0 * stiffness, "relaxation_time": 0.5 * damping / stiffness}
    return {"approximation": "sap", **pair}


_HALF = "The pair has half of the point_stiffness of the two bodies, and their dissipation."
_NATIVE = (
    stock(
        "drake",
        "Drake with nothing set: a discrete plant with almost no bounce, e < 0.4 at 1 in/s, < 0.04 at 20.",
        "The default dissipation of 50 s/m means α = 33 s/m, a hundred times that of steel.",
        "The default point_stiffness is 1e6 N/m.",
        forms=("plane",),
    ),
    on_a_plane("drake", "continuous", Role.LAW, continuous, within=1e-7, kinds=("law",))(
        "Continuous plant, d = 1.5 α: the law's e at any step, with a force linear in penetration.",
        "The plant is continuous (time_step=0): the step only sets how often you read the state.",
        "At Drake's default accuracy of 1e-4, e is wrong by up to 0.03.",
        "An accuracy a hundred times finer takes four times as long.",
        "Coarse fixed steps gain energy: e = 2 at 100 µs with runge_kutta3.",
        _HALF,
    ),
    on_a_plane("drake", "discrete", Role.FALLING_E, discrete, within=2.1e-3, kinds=("law",))(
        "Discrete plant, d = 1.5 α, soft spring: the law's e, of which the implicit step takes 0.2 %.",
        "A discrete plant multiplies e by exp(-π ω h/2), ω² = k/m. No d above 0 makes up for it.",
        "The contact is soft, up to 1 mm deep and milliseconds long, so gravity acts within it.",
        "Above 1 µs the spring would have to be softer than hcbench allows: e is too low there.",
        "`lagged`, the default, gives the same e; `sap` ignores dissipation.",
        _HALF,
    ),
    on_a_plane("drake", "spring-damper", Role.CONSTANT_E, spring_damper)(
        "Discrete plant, `sap`: the best constant e and the law's contact time at the band's middle speed.",
        "The relaxation times of both bodies add up. With Drake's default of 0.1 s each, nothing bounces.",
        "The implicit step adds damping. At coarse steps hcbench softens the spring to keep it small.",
        _HALF,
    ),
)
_HOOK = "A LeafSystem turns the plant's state into an applied spatial force; add no collision geometry."
_CONTINUOUS = {"plant": "continuous", "accuracy": 1e-8}
RECIPES = (*_NATIVE, *python_law_recipes("drake", _NATIVE, _HOOK, force=1e-6, common=_CONTINUOUS))
