"""MuJoCo: eq. (16) with rows that only push, for true cups (tendon
limits) and for MuJoCo before 3.11.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from hcbench.engines.mujoco.recipes.common import DAMPED_STEP, SOFTENED, rows_options
from hcbench.engines.mujoco.recipes.nonadhesive_fit import (
    ITERATIONS,
    InitialGuess,
    PushingRows,
    initial_rows,
    levenberg_marquardt,
    sample,
)
from hcbench.engines.mujoco.recipes.staggered import band_of, knots_of
from hcbench.engines.mujoco.scene.rows import restitution
from hcbench.laws import closed_form
from hcbench.recipes.constant import resolvable_law
from hcbench.recipes.recipe import Recipe, Role, Search
from hcbench.recipes.target import Target
from hcbench.system.errors import SettingError
from hcbench.terms.resolution import STEPS_OF_A_LOOP

# The best ones of many, tried over n, alpha and bands; dampers are for a
# band of penetrations of 11 to 1.
_GUESSES = [
    InitialGuess(26, 4.0, 0.04, 0.5, 0.25),
    InitialGuess(26, 4.0, 0.10, 0.7, 0.25),
    InitialGuess(26, 3.0, 0.04, 0.5, 0.25),
    InitialGuess(20, 6.0, 0.10, 0.7, 0.50),
    InitialGuess(20, 4.0, 0.04, 0.5, 0.25),
    InitialGuess(16, 4.0, 0.10, 0.9, 0.50),
    InitialGuess(26, 6.0, 0.04, 0.7, 0.50),
    InitialGuess(26, 6.0, 0.10, 0.5, 0.25),
    InitialGuess(16, 6.0, 0.04, 0.9, 0.25),
    InitialGuess(20, 6.0, 0.04, 0.9, 0.25),
    InitialGuess(20, 6.0, 0.04, 0.5, 0.25),
]
# Relative misfit of the springs' straight lines.
_MISFIT = 0.006
_SPEEDS = 14
_POINTS = 40
_MOST_LOSS = 0.6
_LEAST_EXPONENT = 1.2
# Phases at which the bias in e is looked at.
_PHASES = 4
# The best guesses, which are fitted to all speeds.
_BEST = 2
# In units of misfit: beyond it the rows do not have the law.
_WORST = 25.0


# Engines that simulate these rows ask for the same ones.
@lru_cache(maxsize=16)
def staggered_push(target: Target, integrator: str = "Euler") -> dict[str, Any]:
    """Options of a setting: eq. (16) by rows that never pull, springs from the shallowest on, then
    dampers.

    The best of several starts, fitted again with what Euler's own steps add to e.

    Raises SettingError where such rows cannot have the law, and for a law without loss.
    """
    law = resolvable_law(target)
    if law.dissipation == 0.0:
        raise SettingError(
            "alpha", "0 s/m", "a contact with a loss", "Use `staggered`: it never pulls then"
        )
    if law.alpha * target.speed_max > _MOST_LOSS or law.exponent < _LEAST_EXPONENT:
        raise _beyond(target)
    band = band_of(target, law, integrator)
    knots = knots_of(band, [], _MISFIT)
    speeds = np.geomspace(target.speed_min, target.speed_max, 3 * _SPEEDS)
    samples = sample(band, speeds[1::3], _POINTS)
    search = Search((len(_GUESSES) + _BEST + 1) * ITERATIONS)
    fits = []
    for guess in _GUESSES:
        rows = initial_rows(samples, band, knots, guess)
        fits.append(levenberg_marquardt(samples, rows, search))
    fits.sort(key=_misfit)
    # The best of them at speeds between those too: only what they leave open is still free.
    samples = sample(band, speeds, _POINTS)
    refitted = [levenberg_marquardt(samples, fit, search) for fit in fits[:_BEST]]
    best = min(refitted, key=_misfit)
    if best.misfit > _WORST:
        raise _beyond(target)
    longest = float(closed_form.duration(law, target.mass, speeds[[0, -1]]).max())
    step = max(target.timestep, longest / 400)
    e = restitution(best.rows(), step, speeds, _PHASES, 1.1 * longest).mean(axis=1)
    bias = e - closed_form.restitution(law.alpha, speeds)
    # Aimed as much below e as a simulation of the engine's own steps is above it.
    if np.isfinite(bias).all():
        best = levenberg_marquardt(replace(samples, bias=bias), best, search)
    return rows_options(integrator, *best.rows())


def _misfit(rows: PushingRows) -> float:
    return rows.misfit


def _beyond(target: Target) -> SettingError:
    """The error for a target that rows without pull cannot follow."""
    law = target.law
    return SettingError(
        "target",
        f"α v up to {law.alpha * target.speed_max:.3g}, n = {law.exponent:.3g},"
        f" speeds {target.speed_max / target.speed_min:.3g} to 1",
        "α v up to about 0.35, speeds up to about 100 to 1, n from 1.25 on, as no row may pull",
        "Use `staggered` (MuJoCo 3.11 or later, no tendon limits), or the force law as a plug-in",
    )


STAGGERED_PUSH = Recipe(
    "mujoco",
    "staggered-push",
    Role.LAW_AND_LOOP,
    staggered_push,
    "Like `staggered`, without pull: for tendon limits (a true cup) and for MuJoCo before 3.11.",
    (
        "Use the integrator Euler, implicit, implicitfast or RK4; discrete is refused.",
        "The numbers are per unit effective mass: k is divided by the effective mass of the two bodies.",
        "Targets above about α v = 0.35 are refused: the dampers would have to pull.",
        "The exponent must be about 1.25 or more: otherwise the springs are too weak for the dampers.",
        "If the law's shortest contact lasts fewer than 10 steps, hcbench softens the springs to 24 steps.",
        SOFTENED,
    ),
    kinds=("law",),
    instead="`soft`",
    steps_min_with_gravity=STEPS_OF_A_LOOP,
    integrators=DAMPED_STEP,
)
