"""Settings of the reference: eq. (16), the Kelvin-Voigt contrast of Fig. 1, and laws published later."""

import math

from hcbench.laws import closed_form
from hcbench.recipes.constant import minimax_constant
from hcbench.recipes.law_recipes import law_options, published_law_options, published_law_recipes
from hcbench.recipes.recipe import Recipe, Role
from hcbench.recipes.target import Target

_SAMPLING = "The step only says how densely the loop is sampled."


def kelvin_voigt(target: Target) -> dict[str, float]:
    """Eq. (4) with the best constant restitution of the band and the law's contact time in its middle.

    k and c from e = exp(-β t) and t = π/ω, contact ending at x = 0.
    """
    e, _ = minimax_constant(target)
    middle = math.sqrt(target.speed_min * target.speed_max)
    duration = float(closed_form.duration(target.law, target.mass, middle))
    decay = -math.log(e) / duration
    stiffness = target.mass * ((math.pi / duration) ** 2 + decay**2)
    return {"stiffness": stiffness, "damping": 2 * target.mass * decay}


RECIPES = (
    Recipe(
        "reference",
        "hunt-crossley",
        Role.LAW_AND_LOOP,
        lambda target: law_options(target.law),
        "The law itself, in closed form: restitution falls with impact speed.",
        (_SAMPLING,),
        native=False,
    ),
    Recipe(
        "reference",
        "kelvin-voigt",
        Role.CONSTANT_E,
        kelvin_voigt,
        "A linear spring and damper: one e for all speeds, a force jump at touch, tension at the end.",
        ("Matches the law's restitution and contact time at one speed only.",),
        native=False,
    ),
    *published_law_recipes("reference", published_law_options, _SAMPLING),
)
