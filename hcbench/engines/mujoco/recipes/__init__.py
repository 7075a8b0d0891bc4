"""Settings of MuJoCo, the preferred ones of each role first."""

from functools import partial

from hcbench.engines.mujoco.recipes.compliant import COMPLIANT, COMPLIANT_PAIRS
from hcbench.engines.mujoco.recipes.one_row import IMPULSE, SOFT, SPRING_DAMPER
from hcbench.engines.mujoco.recipes.staggered import STAGGERED
from hcbench.engines.mujoco.recipes.staggered_push import STAGGERED_PUSH
from hcbench.engines.mujoco.recipes.two_pair import TWO_PAIR
from hcbench.recipes.law_recipes import exact_above, plug_in_recipes
from hcbench.recipes.recipe import stock

STOCK = stock(
    "mujoco",
    'MuJoCo with nothing set, solref "0.02 1": critically damped, e about 0.13; slow drops stay down.',
    "Contact time, penetration and restitution are the engine's defaults, not the law's.",
)
_NATIVE = (
    STOCK,
    IMPULSE,
    COMPLIANT,
    SPRING_DAMPER,
    TWO_PAIR,
    COMPLIANT_PAIRS,
    SOFT,
    STAGGERED,
    STAGGERED_PUSH,
)
RECIPES = (*_NATIVE, *plug_in_recipes("mujoco", _NATIVE, {}, partial(exact_above, 1.6)))
