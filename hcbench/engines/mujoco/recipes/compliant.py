"""MuJoCo at the steps of robots: one soft pair with a constant e, or two whose e falls with speed.

Contacts of a few steps, under gravity, with Coulomb friction. Three things make them (MuJoCo's
documentation, Computation, constraint model). A soft row, of impedance 1e-4, lets gravity act on
through the contact: its force is continuous at touch, and e hardly depends on where in a step the
contact starts; a stiff one shuts gravity out from the step on that finds the touch, e scatters by
(1 + e) g h / v. Of MuJoCo's friction, a row's normal acceleration grows by impedance times friction
times slip: almost nothing of it remains, and impratio gives friction back its strength. Two <pair>s
may name the same two geoms: each makes a row of its own.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, has_feature
from hcbench.engines.mujoco.recipes.common import SPRING_SOLIMP, rows_options
from hcbench.engines.mujoco.recipes.row_pair import RowFit, oscillator, short
from hcbench.engines.mujoco.scene.rows import ConstraintRow
from hcbench.laws.restitution import RestitutionCurve
from hcbench.recipes.recipe import Integrators, Recipe, Role, Search, evolve, map_result
from hcbench.recipes.target import Target
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Floats

# A body held by friction slips by 1/impratio; from 1e7 on MuJoCo's solver iterates more.
IMPRATIO = 1e6
# One seed, so that a target always has the same rows.
_SEED = 1
# Members and generations of the search for two rows.
_MEMBERS = 48
_GENERATIONS = 90
# The best of them are polished on a finer grid, for so many generations.
_BEST = 40
_POLISH = 60
# Members, and generations, of the search for a row by itself.
_ALONE = 28
# Log of the highest D h of a row by itself.
_ALL = -0.01
_NO_DAMPER = np.log([1e-12, 0.3, 1.0, 0.5])
# Largest rest depth, m, for a step of 1 s.
_SAG = 0.2
# Least damping of the spring, 1/s: a body at rest has calmed down by exp(-9) after 5 s.
_CALM = 3.6
# Damping D h of the spring that is enough for a body to calm down.
_ENOUGH = 6.5e-3
# Least damping D h with which a body still calms down.
_LEAST = 4e-3
# Share of the slowest impact's loss that the spring may take.
_SHARE = 0.4
# From this share of the band's lowest speed on no impact may gain energy.
_SLOW = 0.1
# Up to this speed, m/s, no impact may gain energy.
_FAST = 2.0
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
# Half period in steps; logs of D h of the spring, D h, dmax, width over v
# h and midpoint of the damper.
_LOWEST = np.array([4.0, *np.log([_LEAST, 0.05, 5e-3, 0.3, 3e-3])])
_HIGHEST = np.array([10.0, *np.log([0.3, 5.0, 0.3, 20.0, 0.5])])
# What long searches found for several α and steps, as members of the first generation.
_STARTS = np.array([
    [7.18, -5.63, -2.46, -1.24, 1.99, -3.69],
    [7.92, -5.62, -2.46, -3.04, 1.39, -1.76],
    [7.91, -5.62, -1.08, -1.21, 2.86, -4.82],
    [8.66, -5.63, -0.91, -1.20, 2.70, -4.81],
    [9.39, -5.60, -0.77, -1.27, 2.38, -4.69],
    [6.53, -5.31, -1.67, -1.20, 1.85, -3.24],
    [6.53, -5.52, -2.74, -1.22, 1.49, -2.95],
    [7.14, -5.04, -0.33, -1.70, 2.20, -4.23],
    [5.00, -5.04, -1.06, -2.29, 0.48, -2.43],
])  # fmt: skip


def half_period_steps(corners: float) -> int:
    """Steps of a contact that `corners` of a body meet at once: fewer gain energy. Found by trial."""
    return 3 if corners == 1 else math.ceil(2 * math.sqrt(corners) + 2)


def whole_step_row(restitution: float, timestep: float, corners: float = 1) -> ConstraintRow:
    """Contact row of a linear spring and damper that turns a speed v into -e v in a whole number n of
    Euler's steps, exactly without gravity.

    restitution: e.
    timestep: h, s.
    corners: that meet at once and share the row.
    The step v+ = v - h (K x + D v), x+ = x + h v+ multiplies by exp(±i π/n) √c, c = 1 - D h: after
    n steps by -c^(n/2) = -e. Per unit mass.
    """
    n = half_period_steps(corners)
    stiffness, damping = oscillator(n, 1.0 - restitution ** (2.0 / n))
    spring = float(stiffness) / timestep**2 / corners
    damper = damping / timestep / corners
    return ConstraintRow.direct(short(spring), short(damper), SPRING_SOLIMP)


def spring_and_damper_rows(
    curve: RestitutionCurve,
    speeds: tuple[float, float],
    timestep: float,
    gravity: float,
    corners: float = 1,
    adhesive: bool = True,
    rk4: bool = False,
    points: int = 0,
) -> list[ConstraintRow]:
    """Search two rows with a target e over a band of impact speeds, for two <pair>s of the same two
    geoms: a soft linear spring whose half period is a few steps, and a damper whose impedance grows
    with depth.

    Their numbers have the least largest error over speeds and phases in a model of the two rows
    that equals MuJoCo's step, gravity included. Per unit mass: the same for any mass.
    curve: e over speed.
    speeds: lowest and highest of the band, m/s.
    timestep: s.
    gravity: m/s², into the plate.
    corners: of a body that meet at once, or how much more a row does there than on a ball.
    adhesive: whether the damper may pull (MuJoCo 3.11 and later).
    rk4: that integrator, else Euler's.
    points: corners that meet at once, where `corners` says something else; 0: those.
    Raises SearchInterrupted with the best so far.
    """
    low, high = speeds
    bounds = _bounds(1.0 - float(curve.at(low)), timestep, gravity, points or corners)

    def fit_to(band: tuple[int, int], below: tuple[int, int]) -> RowFit:
        """The goal of a fit by launches on grids, each of (speeds, phases), in and below the band."""
        launches = _launches(curve, speeds, band, below)
        # In units of the step and the band's highest speed.
        fall = gravity * timestep / high
        return RowFit(*launches, fall, corners, adhesive, rk4, *bounds)

    fine = fit_to((25, 10), (9, 12))
    with map_result(lambda parameters: fine.rows(parameters, timestep, high)):
        return fine.rows(_search(fit_to((9, 6), (6, 6)), fine), timestep, high)


def _launches(
    curve: RestitutionCurve,
    speeds: tuple[float, float],
    band: tuple[int, int],
    below: tuple[int, int],
    above: tuple[int, int] = (0, 0),
) -> tuple[Floats, Floats, Floats]:
    """Plan the launches that judge a row: speed over the band's highest, phase (where in a step the
    contact starts, 0 to 1), and target e, (n,) each, in, below and above the band.

    curve: e over speed.
    speeds: lowest and highest of the band, m/s.
    band, below, above: (number of speeds, number of phases of each) there.

    Outside of the band any e will do that gains no energy: the target is NaN.
    """
    low, high = speeds
    parts = [
        _grid(low / high, 1.0, *band),
        _grid(_SLOW * low / high, low / high, *below),
        _grid(1.0, max(1.0, _FAST / high), *above),
    ]
    shares = np.concatenate([shares for shares, _ in parts])
    phases = np.concatenate([phases for _, phases in parts])
    # The launches in the band come first.
    in_band, _ = parts[0]
    is_in_band = np.arange(shares.size) < in_band.size
    target = np.where(is_in_band, curve.at(shares * high), np.nan)
    return shares, phases, target


def _grid(lowest: float, highest: float, speeds: int, phases: int) -> tuple[Floats, Floats]:
    """Speed and phase (where in a step the contact starts, 0 to 1) of launches on a grid; (n,) each.

    lowest, highest: speeds, in any unit; the others lie between them evenly in logarithm.
    speeds: how many.
    phases: how many at each speed; they are shifted from speed to speed, so that few of them leave
    no gap.
    """
    # Multiples of the golden ratio, of which no two share a place (a sequence of low discrepancy).
    later = (np.arange(speeds) * _GOLDEN) % 1.0
    # Not quite 0 or 1, where rounding decides which step sees the touch.
    where = np.clip((np.arange(phases) + later[:, None]).ravel() / phases, 0.003, 0.997)
    return np.repeat(np.geomspace(lowest, highest, speeds), phases), where


def pushing_row(
    curve: RestitutionCurve,
    speeds: tuple[float, float],
    timestep: float,
    gravity: float,
    corners: int = 1,
) -> ConstraintRow:
    """Search one row that only pushes: a linear spring and damper whose e comes as near to a target
    over a band of impact speeds as one e can.

    curve: e over speed.
    speeds: lowest and highest of the band, m/s.
    timestep: s.
    gravity: m/s², into the plate.
    corners: that meet at once.
    Half period and damping are searched with gravity and over all phases: as the row may not pull
    in its last step, the closed form of a whole number n of steps would give e^(2/n) instead of e.
    Per unit mass.
    Raises SearchInterrupted with the best so far.
    """
    low, high = speeds
    e = float(curve.at(math.sqrt(low * high)))
    n = half_period_steps(corners)
    # The row of whole steps, which is exact without gravity, is one of the first members.
    whole_steps = n, math.log(max(1e-4, 1.0 - e ** (2.0 / n)))
    # The search for two rows, with the second one held at no damping: parameters are the half
    # period in steps, log D h of the spring, and four of the damper.
    lowest, highest = _bounds(1.0 - e, timestep, gravity, corners)
    lowest[:2] = np.minimum(lowest[:2], whole_steps)
    highest[1] = _ALL
    lowest[2:] = _NO_DAMPER
    highest[2:] = _NO_DAMPER
    bounds = lowest, highest
    launches = _launches(curve, speeds, (9, 16), (6, 12), (9, 16))
    fit = RowFit(
        *launches,
        gravity * timestep / high,
        corners,
        adhesive=False,
        rk4=False,
        lowest=lowest,
        highest=highest,
    )

    def row(parameters: Floats) -> ConstraintRow:
        spring, _ = fit.rows(parameters, timestep, high)
        return spring

    search = Search(_ALONE * (1 + _ALONE))
    random = np.random.default_rng(_SEED)
    first = random.uniform(*bounds, (_ALONE, len(lowest)))
    first[0, :2] = whole_steps
    with map_result(row), search.interrupt_with_best():
        best = evolve(search.recorded(fit.errors), first, _ALONE, bounds, random)
    return row(best[0])


def _bounds(loss: float, timestep: float, gravity: float, corners: float) -> tuple[Floats, Floats]:
    """Bounds of a search of two rows: lowest and highest parameters, (6,) each: half period of the
    spring in steps, and logarithms of its damping, and of the damper's damping, impedance, width
    and midpoint.

    loss: 1 - e of the slowest impact.
    timestep: s.
    gravity: m/s².
    corners: that meet at once.
    """
    lowest = _LOWEST.copy()
    highest = _HIGHEST.copy()
    # The spring's least damping D h: what a body at rest calms down by, but no more than a part of
    # the slowest impact's loss.
    lowest[1] = math.log(min(_ENOUGH, _CALM * timestep, max(_LEAST, _SHARE * loss)))
    # The spring's rest depth is g (n h/π)², m, and may be _SAG h: so many steps n at most.
    if gravity > 0.0:
        softest = math.pi * math.sqrt(_SAG / (gravity * timestep))
        highest[0] = min(highest[0], max(softest, lowest[0] + 0.6))
    if corners > 1:
        least_steps = half_period_steps(corners)
        lowest[0] = least_steps
        highest[0] = max(highest[0], least_steps + 2.0)
    return lowest, highest


def _search(coarse: RowFit, fine: RowFit) -> Floats:
    """Search the parameters of two rows with the least error, (6,): by evolution with few launches,
    then from the best of these with many.

    coarse, fine: the same goal with few launches and with many. The same goal always gives the same
    parameters.
    Raises SearchInterrupted with the best so far.
    """
    search = Search(_MEMBERS * (1 + _GENERATIONS) + _BEST * (1 + _POLISH))
    random = np.random.default_rng(_SEED)
    first = random.uniform(fine.lowest, fine.highest, (_MEMBERS, len(fine.lowest)))
    first[: len(_STARTS)] = np.clip(_STARTS, fine.lowest, fine.highest)
    bounds = fine.lowest, fine.highest
    with search.interrupt_with_best():
        best = evolve(search.recorded(coarse.errors), first, _GENERATIONS, bounds, random)
        polished = evolve(
            search.recorded(fine.errors), best[:_BEST], _POLISH, bounds, random, towards_best=True
        )
    return np.asarray(polished[0])


def compliant_options(rows: list[ConstraintRow], target: Target, integrator: str) -> dict[str, Any]:
    """A setting's options with these rows, the first with the target's friction."""
    if not target.friction:
        return rows_options(integrator, *rows)
    rubbing = rows[0].with_friction(target.friction, target.timestep, IMPRATIO)
    options = rows_options(integrator, rubbing, *rows[1:])
    return {**options, "cone": "elliptic", "impratio": IMPRATIO}


def compliant(target: Target, integrator: str = "Euler") -> dict[str, Any]:
    """Options of a setting: one soft row of a few steps, as near to the target as one e can be.

    target: e over a band of speeds, time step, gravity and friction.
    integrator: that the options name.
    Raises SearchInterrupted with the best options so far.
    """
    band = target.speed_min, target.speed_max
    with map_result(lambda row: compliant_options([row], target, integrator)):
        row = _row_for(target.curve, band, target.timestep, target.gravity, target.corners)
    return compliant_options([row], target, integrator)


def compliant_pairs(
    target: Target, integrator: str = "Euler", adhesive: bool | None = None
) -> dict[str, Any]:
    """Options of a setting, by name: two rows with an e that falls with speed.

    target: e over a band of speeds, time step, gravity and friction.
    integrator: that the options name.
    adhesive: whether the damper may pull; None for what the installed MuJoCo can do.
    Raises SettingError for a target without loss or without bounce, SearchInterrupted with the best
    options so far.
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
