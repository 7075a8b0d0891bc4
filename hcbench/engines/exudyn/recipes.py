"""Settings of Exudyn in closed form.

ObjectContactSphereSphere, impactModel 1: F = k x^n (1 + 1.5 (1 - e)/max(v_in, V) v), v_in the speed at touch
and V minimumImpactVelocity. With V above every speed and e = 1 - α V that is eq. (16).
"""

from __future__ import annotations

from typing import Any

from hcbench.recipes.constant import minimax_constant
from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Recipe, Role, stock
from hcbench.recipes.softening import resolvable_law
from hcbench.recipes.target import Target
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Status
from hcbench.terms.resolution import STEPS_OF_A_SOFTENED_EXPLICIT


def _contact(target: Target, model: int, e: float, **more: float) -> dict[str, Any]:
    law = resolvable_law(target, STEPS_OF_A_SOFTENED_EXPLICIT)
    spring = {"contactStiffness": law.stiffness, "contactStiffnessExponent": law.exponent}
    return {"solver": "RK44", **spring, "impactModel": model, "restitutionCoefficient": e, **more}


def contact_law(target: Target) -> dict[str, Any]:
    """Eq. (16) itself; V is twice the band's highest speed, or halfway to 1/α where that is nearer."""
    fastest, alpha = target.speed_max, target.law.alpha
    if alpha * fastest >= 1.0:
        raise SettingError("speeds", f"up to {fastest:.4g} m/s", f"below 1/α = {1.0 / alpha:.4g} m/s")
    threshold = 2.0 * fastest if alpha * fastest < 1.0 / 3.0 else 0.5 * (fastest + 1.0 / alpha)
    return _contact(target, 1, 1.0 - alpha * threshold, minimumImpactVelocity=threshold)


def restitution(target: Target) -> dict[str, Any]:
    """The best constant e."""
    return _contact(target, 2, minimax_constant(target)[0], minimumImpactVelocity=0.0)


_STEPS = "Lower timeIntegration.minimumStepSize: its default, 1e-8, ends one impact in five with an error."
_GAIN = (
    "A contact of few steps gains energy: with 20 steps e is 0.007 too high.",
    "Below 10 steps a contact, hcbench softens the spring to 60.",
)
_NATIVE = (
    stock(
        "exudyn",
        "Exudyn with nothing set: contactStiffness is 0, and the ball falls through the plate silently.",
        ends=Status.DIVERGED,
    ),
    Recipe(
        "exudyn",
        "contact-law",
        Role.LAW_AND_LOOP,
        contact_law,
        "impactModel 1, minimumImpactVelocity V above all speeds, e = 1 - α V: the law, force loop included.",
        (
            "Impacts faster than V lose less energy than the law says: their α is (1 - e)/v.",
            "contactStiffness belongs to the pair: no two values are combined.",
            "A cup is modelled exactly, as a hollow sphere.",
            _STEPS,
            *_GAIN,
        ),
        kinds=("law",),
        within=3e-5,
    ),
    Recipe(
        "exudyn",
        "restitution",
        Role.CONSTANT_E,
        restitution,
        "impactModel 2: the best constant e, with the stiffness and exponent of the law.",
        (
            "e is within 2e-5 of the number that you set from 0.9 up; 0.3 gives 0.3042.",
            "impactModel 0 ignores restitutionCoefficient.",
            _STEPS,
            *_GAIN,
        ),
        within=5e-5,
    ),
)
_HOOK = "Runs as springForceUserFunction of a CoordinateSpringDamper between the ball and the ground."
RECIPES = (*_NATIVE, *python_law_recipes("exudyn", _NATIVE, _HOOK, force=5e-6, common={"solver": "RK44"}))
