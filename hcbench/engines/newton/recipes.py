"""Settings of Newton in closed form, the preferred ones of each role first."""

import math
from functools import partial
from typing import Any

from hcbench.errors import SettingError
from hcbench.tune.constant import contact_time, minimax_constant
from hcbench.tune.law_recipes import python_law_recipes
from hcbench.tune.recipe import Recipe, Role, stock
from hcbench.tune.target import Target

_WITHIN, _SCATTER = 1e-6, 6e-3  # of e by float32: in one step, and in contacts of many
_STEPS = 40.0  # of a contact at least: its damper is stepped explicitly


def restitution(target: Target) -> dict[str, Any]:
    """XPBD's own restitution: the best constant e of the band."""
    return {"restitution": minimax_constant(target)[0]}


def spring_damper(target: Target) -> dict[str, Any]:
    """F = ke x + kd x' going in, ke x coming out: e = exp(-ζ/√(1-ζ²) acos ζ), ζ = kd/(2 √(ke m)).

    With the law's contact time mid-band, (acos ζ/√(1-ζ²) + π/2)/ω, ω² = ke/m. SettingError for e below e^-1.
    """
    from scipy.optimize import brentq

    e, _ = minimax_constant(target)

    def way_in(zeta: float) -> float:
        return math.acos(zeta) / math.sqrt(1.0 - zeta**2)

    if not math.exp(-0.99) < e <= 1.0:
        raise SettingError("restitution", f"{e:.4g}", "e within 0.372 ... 1", "Use `restitution`")
    zeta = float(brentq(lambda z: z * way_in(z) + math.log(e), 0.0, 1.0 - 1e-9, xtol=1e-15))
    omega = (way_in(zeta) + math.pi / 2) / contact_time(target, _STEPS)
    ke = target.mass * omega**2
    return {"solver": "SemiImplicit", "ke": ke, "kd": 2.0 * zeta * math.sqrt(ke * target.mass)}


_ON_A_PLANE = partial(Recipe, "newton", forms=("plane",))
_NATIVE = (
    stock(
        "newton",
        "Newton as it comes: SolverXPBD ignores every restitution, e of .01 to .03.",
        forms=("plane",),
    ),
    _ON_A_PLANE(
        "restitution",
        Role.CONSTANT_E,
        restitution,
        "SolverXPBD with enable_restitution=True: the best constant e, at any step and phase.",
        (
            "The restitutions of both shapes are averaged: e goes on both. MJCF and URDF bring none.",
            "Under gravity it rebounds with e (v + g h), v of the state before; none below 2 g h.",
            "The contact force it reports leaves the restitution out: trust none in an impact.",
        ),
        one_step=True,
        within=_WITHIN,
    ),
    _ON_A_PLANE(
        "spring-damper",
        Role.CONSTANT_E,
        spring_damper,
        "SolverSemiImplicit, ke and kd in closed form: the best constant e and the law's contact time.",
        (
            "ke and kd are for this mass; both shapes have them, as they are averaged.",
            "It damps the way in only. e is off by up to .006, of 40 steps a contact and float32.",
        ),
        within=_SCATTER,
    ),
)
RECIPES = (
    *_NATIVE,
    *python_law_recipes(
        "newton",
        _NATIVE,
        "Before each step: body_f after clear_forces(), or shape_material_restitution, a value a world.",
        force=_SCATTER,
        each_impact=2e-6,
    ),
)
