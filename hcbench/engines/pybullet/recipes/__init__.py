"""Settings of PyBullet, the preferred ones of each role first."""

import math

from hcbench.engines.pybullet.recipes.restitution import RESTITUTION
from hcbench.engines.pybullet.recipes.spring_damper import SPRING_DAMPER
from hcbench.engines.pybullet.recipes.staggered import STAGGERED
from hcbench.recipes.law_recipes import plug_in_recipes
from hcbench.recipes.recipe import stock

STOCK = stock(
    "pybullet",
    "PyBullet as it loads the model: restitution 0, and no bounce below 0.2 m/s with any setting.",
    "Knows nothing of the law. Bullet acts on a contact it predicts for the coming step,"
    " so what bounce there is depends on the phase.",
)
_NATIVE = (STOCK, RESTITUTION, SPRING_DAMPER, STAGGERED)
# Bullet slows every body in flight; the law is about contact alone.
_NO_DRAG = {"ball": {"linearDamping": 0.0, "angularDamping": 0.0}}


# In g h: at 1.6 itself, where round-off decides, some bodies stay down.
_SLOWEST = 1.601


def _exact_above(e: float) -> float:
    """Impact speed over g h from which the plug-in's e is exact: Bullet adds g h after the impact."""
    if not e**2 > 0.0:
        return math.inf
    root = math.sqrt(max(0.0, 1.0 - 0.75 * e**2))
    return max(_SLOWEST, (1.0 + root) / e**2)


RECIPES = (*_NATIVE, *plug_in_recipes("pybullet", _NATIVE, _NO_DRAG, _exact_above))
