"""MuJoCo at the steps of robots: one soft pair with a constant e, or two whose e falls with speed.

`compliant_fit` has their numbers and says why they hold under gravity and with friction.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from hcbench.engines.mujoco.backend import backend, has_feature
from hcbench.engines.mujoco.recipes.common import rows_options
from hcbench.engines.mujoco.recipes.compliant_fit import (
    IMPRATIO,
    pushing_row,
    spring_and_damper_rows,
)
from hcbench.engines.mujoco.scene.rows import ConstraintRow
from hcbench.recipes.recipe import Integrators, Recipe, Role, map_result
from hcbench.recipes.target import Target
from hcbench.system.errors import SettingError


def compliant_options(rows: list[ConstraintRow], target: Target, integrator: str) -> dict[str, Any]:
    """A setting's options with these rows, the first with the target's friction."""
    if not target.friction:
        return rows_options(integrator, *rows)
    rubbing = rows[0].with_friction(target.friction, target.timestep, IMPRATIO)
    options = rows_options(integrator, rubbing, *rows[1:])
    return {**options, "cone": "elliptic", "impratio": IMPRATIO}


def compliant(target: Target, integrator: str = "Euler") -> dict[str, Any]:
    """Options of a setting: one soft row of a few steps, as near to the target as one e can be.

    target: e over a band of speeds, time step, gravity and friction. Raises SearchInterrupted with
    the best options so far.
    """
    band = target.speed_min, target.speed_max
    with map_result(lambda row: compliant_options([row], target, integrator)):
        row = _row_for(target.curve, band, target.timestep, target.gravity, target.corners)
    return compliant_options([row], target, integrator)


def compliant_pairs(
    target: Target, integrator: str = "Euler", adhesive: bool | None = None
) -> dict[str, Any]:
    """Options of a setting: two rows with an e that falls with speed.

    adhesive: whether the damper may pull; None for what the installed MuJoCo can do.

    Raises SettingError for a target without loss or without bounce, SearchInterrupted with the
    best options so far.
    """
    lowest = float(target.restitution(target.speed_max))
    if not 0 < lowest < 1:
        got = f"{lowest:.4g} at {target.speed_max:.4g} m/s"
        raise SettingError("restitution", got, "a bounce with a loss, 0 < e < 1", "Use `compliant`")
    if adhesive is None:
        adhesive = has_feature(backend(), "adhesion")
    with map_result(lambda rows: compliant_options(rows, target, integrator)):
        rows = _rows_for(
            target.curve,
            (target.speed_min, target.speed_max),
            target.timestep,
            target.gravity,
            target.corners,
            adhesive,
        )
    return compliant_options(list(rows), target, integrator)


@lru_cache(maxsize=16)
def _row_for(*case: Any) -> ConstraintRow:
    return pushing_row(*case)


@lru_cache(maxsize=16)
def _rows_for(*case: Any) -> tuple[ConstraintRow, ...]:
    return tuple(spring_and_damper_rows(*case))


_SHARED = (
    "Use the integrator Euler, implicit or implicitfast; RK4 and discrete are refused.",
    "The numbers hold at this step and gravity, for any mass.",
    "With friction the model's cone is elliptic and its impratio 1000000, for all of its contacts.",
)
_ONE_FORCE = Integrators(
    ("Euler", "implicit", "implicitfast"), "the recipe assumes one contact force a step"
)
COMPLIANT = Recipe(
    "mujoco",
    "compliant",
    Role.CONSTANT_E,
    compliant,
    "One soft contact of a few steps, spring and damper: the best constant e, with Coulomb friction.",
    (
        *_SHARED,
        "e varies with the phase of the step: by about 0.2 (1 - e), and slow impacts by g h / v more.",
        "A box that lands flat touches with 4 corners at once: use --corners 4, or it gains energy.",
    ),
    # Holds where there is no gravity, though the row is made for some.
    within=0.01,
    integrators=_ONE_FORCE,
)
COMPLIANT_PAIRS = Recipe(
    "mujoco",
    "compliant-pairs",
    Role.FALLING_E,
    compliant_pairs,
    "Two pairs of the same two geoms, spring and damper, fitted with gravity: e follows the target.",
    (
        *_SHARED,
        "Friction works as usual: it acts through the spring.",
        "Impacts faster than the band lose less energy than the target says.",
        "With half the spring's damping e comes nearer (0.024 for 0.028 at α = 0.3 s/m, 2 ms, 0.1 ... 2 m/s, "
        "no friction), and a body at rest vibrates 13 times as fast.",
        "Before MuJoCo 3.11 pairs have no adhesion and the damper cannot pull: e is a little less exact.",
    ),
    integrators=_ONE_FORCE,
    forms=("plane",),
)
