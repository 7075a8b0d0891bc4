"""MuJoCo at the steps of robots: one soft pair with a constant e, or two whose e falls with speed.

`compliant_fit` has their numbers and says why they hold under gravity and with friction.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from hcbench.engines.mujoco.backend import backend, has_feature
from hcbench.engines.mujoco.recipes.common import rows_options
from hcbench.engines.mujoco.recipes.compliant_fit import IMPRATIO, pushing_row, spring_and_damper_rows
from hcbench.engines.mujoco.scene.rows import ConstraintRow
from hcbench.errors import SettingError
from hcbench.recipes.recipe import Integrators, Recipe, Role
from hcbench.recipes.search import map_result
from hcbench.recipes.target import Target


def compliant_options(rows: list[ConstraintRow], target: Target, integrator: str) -> dict[str, Any]:
    """A setting's options with these rows, the first with the target's friction."""
    if not target.friction:
        return rows_options(integrator, *rows)
    rubbing = rows[0].with_friction(target.friction, target.timestep, IMPRATIO)
    options = rows_options(integrator, rubbing, *rows[1:])
    return {**options, "cone": "elliptic", "impratio": IMPRATIO}


def compliant(target: Target, integrator: str = "Euler") -> dict[str, Any]:
    """One soft row of a few steps, as near to the e wanted as one e can be."""
    band = target.speed_min, target.speed_max
    with map_result(lambda row: compliant_options([row], target, integrator)):
        row = _row_for(target.curve, band, target.timestep, target.gravity, target.corners)
    return compliant_options([row], target, integrator)


def compliant_pairs(
    target: Target, integrator: str = "Euler", adhesive: bool | None = None
) -> dict[str, Any]:
    """Two rows with an e that falls with speed; SettingError for a target without loss or without bounce.

    adhesive: whether the damper may pull; None for what the installed MuJoCo can do.
    """
    if not 0 < (lowest := float(target.restitution(target.speed_max))) < 1:
        got = f"{lowest:.4g} at {target.speed_max:.4g} m/s"
        raise SettingError("restitution", got, "a bounce with a loss, 0 < e < 1", "Use `compliant`")
    with map_result(lambda rows: compliant_options(rows, target, integrator)):
        rows = _rows_for(
            target.curve,
            (target.speed_min, target.speed_max),
            target.timestep,
            target.gravity,
            target.corners,
            has_feature(backend(), "adhesion") if adhesive is None else adhesive,
        )
    return compliant_options(list(rows), target, integrator)


@lru_cache(maxsize=16)
def _row_for(*case: Any) -> ConstraintRow:
    return pushing_row(*case)


@lru_cache(maxsize=16)
def _rows_for(*case: Any) -> tuple[ConstraintRow, ...]:
    return tuple(spring_and_damper_rows(*case))


_SHARED = (
    "Euler, implicit and implicitfast; RK4 and discrete are refused.",
    "Numbers are per unit effective mass and for this step and gravity: the same for any mass.",
    "With friction the model's cone is elliptic and its impratio 1000000, for all of its contacts.",
)
_ONE_FORCE = Integrators(("Euler", "implicit", "implicitfast"), "its numbers are of one force a step")
COMPLIANT = Recipe(
    "mujoco",
    "compliant",
    Role.CONSTANT_E,
    compliant,
    "One soft contact of a few steps, spring and damper: the best constant e, with Coulomb friction.",
    (
        *_SHARED,
        "e scatters with where in a step a touch falls: slow ones by g h / v, all by some .2 (1 - e).",
        "A flat box meets with 4 corners at once: --corners 4, of 6 steps at least; fewer gain energy.",
    ),
    within=0.01,  # where there is no gravity, though it is made for some
    integrators=_ONE_FORCE,
)
COMPLIANT_PAIRS = Recipe(
    "mujoco",
    "compliant-pairs",
    Role.FALLING_E,
    compliant_pairs,
    "Two pairs of the same two geoms, spring and damper, fitted with gravity: e falls with speed as wanted.",
    (
        *_SHARED,
        "The spring carries the friction, the damper has none: over an impact it neither pushes nor pulls.",
        "Faster impacts than the band's lose less than wanted.",
        "Before MuJoCo 3.11, which has no adhesion, the damper cannot pull: e is a little further off.",
    ),
    integrators=_ONE_FORCE,
    forms=("plane",),
)
