"""MuJoCo: one spring pair and one damper pair at the same spot.

With a linear spring, eq. (16) with n = 1 wants a damper that grows in proportion to depth:
the damper's impedance does that, starting from its floor. The spring's impedance is small, so
that the two hardly act on each other. Five numbers of the damper are fitted to the
restitution wanted, on a model of the two rows that equals the engine's step to round-off; the
start is the closed form for n = 1.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench.engines.mujoco.recipes.common import DAMPED_STEP, SOFTENED, WEAK_FRICTION, rows_options
from hcbench.engines.mujoco.scene.rows import (
    MAX_IMPEDANCE,
    MIN_IMPEDANCE,
    ConstraintRow,
    restitution,
)
from hcbench.laws import closed_form
from hcbench.recipes.recipe import Recipe, Role, Search, map_result
from hcbench.recipes.target import Target, contact_time
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Floats
from hcbench.terms.resolution import STEPS_OF_A_FITTED_SPRING

_SPEEDS = 12
_PHASES = 2
# Steps of the model in a contact where the engine's own are more.
_STEPS = 200
# Impedance of the spring.
_SPRING = 1e-3
# One unit of misfit, in e.
_UNIT = 1e-4
# In units of misfit: if the first start ends worse than that, another one is tried.
_GOOD = 10.0
# Steps of the fit: each evaluates once, and once more for each of six numbers.
_STEPS_MAX = 30


# log D, log of width over top, logit of dw, power, midpoint, onset over
# top: bounds and usual changes.
_LOWEST = [-np.inf, -4.0, -6.0, 1.0, 1e-3, 0.0]
_HIGHEST = [np.inf, 4.0, 3.0, 6.0, MAX_IMPEDANCE, 0.05]
_SCALE = [0.1, 0.1, 0.3, 0.1, 0.01, 1e-3]
# Logit of dw at the start.
_LOGIT = -2.67


@dataclass(frozen=True)
class _Pairs:
    """Scales that the damper's parameters are relative to.

    omega: frequency of the spring, 1/s.
    speed: at the top of the band, m/s.
    mass: kg.
    """

    omega: float
    speed: float
    mass: float

    @property
    def top(self) -> float:
        """The largest penetration, m."""
        return self.speed / self.omega

    def start(self, loss: float) -> Floats:
        """Parameters of the damper to start a fit from, (6,): those with which it grows with depth as
        eq. (16) with n = 1 asks for.

        loss: (3/2) α, s/m.
        Parameters are the logarithms of D (1/s) and of the impedance's width over `top`, the logit
        of its highest value, its power and midpoint, and the onset over `top`. All but D were found
        by trial.
        """
        highest = _logistic(_LOGIT)
        damping = loss * self.omega**2 * self.top / (highest / (1 - highest)) * highest
        return np.array([math.log(1.22 * damping), 0.2, _LOGIT, 1.1, 0.015, 1e-4])

    def constant_start(self, loss: float) -> Floats:
        """Parameters to start from for an e that hardly falls with speed, (6,), as of `start`: half
        the damping, at its full strength almost from touch on.

        loss: (3/2) α, s/m.
        """
        log_damping, _, logit, _, midpoint, onset = self.start(loss).tolist()
        log_width = -3.0
        power = 1.5
        return np.array([log_damping + math.log(0.5), log_width, logit, power, midpoint, onset])

    def rows(self, parameters: Floats) -> list[ConstraintRow]:
        """The spring and the damper, in SI units.

        parameters: of the damper, (6,): logarithms of D and of its width over `top`, logit of its
        highest impedance, its power and midpoint, and its onset over `top`.
        """
        log_damping, log_width, logit, power, midpoint, onset = parameters.tolist()
        highest = _logistic(logit)
        D = math.exp(log_damping)
        solimp = (MIN_IMPEDANCE, highest, self.top * math.exp(log_width), midpoint, power)
        # w S/d = ω²: what the spring weighs and asks for.
        constant = (_SPRING, _SPRING, 1.0, 0.5, 1.0)
        spring = ConstraintRow.direct(self.omega**2 * (1 - _SPRING), 0.0, constant)
        # Twice the largest pull of the damper on the way out.
        pull = highest / (1 - highest) * (D / highest + self.omega) * self.speed
        adhesion = 2 * self.mass * pull
        damper = ConstraintRow.direct(0.0, D, solimp, onset * self.top, adhesion=adhesion)
        return [spring, damper]


def _logistic(logit: float) -> float:
    return 1 / (1 + math.exp(-logit))


def contact_duration(target: Target) -> float:
    """Duration of the spring's contact, s: the law's at the geometric mean speed,
    or 36 steps if that is longer.
    """
    return contact_time(target, STEPS_OF_A_FITTED_SPRING)


def two_pair(target: Target, integrator: str = "Euler") -> dict[str, Any]:
    """Options of a setting, by name: a spring pair and a damper pair with any restitution that
    falls with speed.

    integrator: that the options name.
    Raises SettingError for a target without loss or without bounce, SearchInterrupted with the best
    options so far.
    """
    with map_result(lambda rows: rows_options(integrator, *rows)):
        return rows_options(integrator, *two_pair_rows(target))


def two_pair_rows(target: Target) -> list[ConstraintRow]:
    """The spring and the damper, fitted to the target's e without gravity, from up to two starts.

    target: its α or curve, band of speeds, mass and step.
    Raises SettingError for a target without loss or without bounce, SearchInterrupted with the best
    so far.
    """
    # SciPy's optimisation is slow to import.
    from scipy.optimize import least_squares

    speeds = np.geomspace(target.speed_min, target.speed_max, _SPEEDS)
    wanted = target.restitution(speeds)
    if not 0 < wanted[-1] < 1:
        raise SettingError(
            "restitution",
            f"{wanted[-1]:.4g} at {target.speed_max:.4g} m/s",
            "a bounce with a loss, 0 < e < 1",
            "Use `staggered` for a contact without loss, `impulse` for one without bounce",
        )
    duration = contact_duration(target)
    step = max(target.timestep, duration / _STEPS)
    # Time for which an impact is followed, s: with more loss it takes longer to part.
    longest = (1.3 if wanted[-1] > 0.5 else 3.0) * duration
    pairs = _Pairs(math.pi / duration, target.speed_max, target.mass)
    loss = 1.5 * float(closed_form.alpha_of(wanted[-1], target.speed_max))

    starts = (pairs.start(loss), pairs.constant_start(loss))
    search = Search(len(starts) * _STEPS_MAX * (1 + len(_LOWEST)))

    def misfit(parameters: Floats) -> Floats:
        """Error of e at each speed, in units of _UNIT, (speeds,); parameters: (6,)."""
        e = restitution(pairs.rows(parameters), step, speeds, _PHASES, longest)
        # A launch that has not parted counts as far off.
        errors = np.nan_to_num(e.mean(axis=1), nan=5.0) - wanted
        search.record(parameters[None], np.abs(errors).max(keepdims=True))
        return np.asarray(errors / _UNIT)

    best = starts[0]
    error = np.inf
    with map_result(pairs.rows), search.interrupt_with_best():
        for start in starts:
            fit = least_squares(
                misfit,
                start,
                bounds=(_LOWEST, _HIGHEST),
                x_scale=_SCALE,
                max_nfev=_STEPS_MAX,
                diff_step=[1e-4] * 6,
            )
            worst = float(np.abs(fit.fun).max())
            if worst < error:
                best = fit.x
                error = worst
            if error < _GOOD:
                break
    return pairs.rows(best)


TWO_PAIR = Recipe(
    "mujoco",
    "two-pair",
    Role.FALLING_E,
    two_pair,
    "A linear spring and a damper that grows with depth, one pair each: e follows the target.",
    (
        "Use the integrator Euler, implicit, implicitfast or RK4; discrete is refused.",
        "The numbers are per unit effective mass, so they give the same e for any mass.",
        "The force loop starts and ends at 0. The spring is linear, so it is the law's loop only for n = 1.",
        "A contact lasts at least 36 steps: where the law's is shorter, hcbench softens the spring.",
        SOFTENED,
        WEAK_FRICTION,
        "The pairs are frictionless (condim 1). The damper needs MuJoCo 3.11 or later (pair adhesion).",
    ),
    integrators=DAMPED_STEP,
    # A spring softened to fewer steps sags under its weight.
    steps_min=STEPS_OF_A_FITTED_SPRING,
    forms=("plane",),
)
