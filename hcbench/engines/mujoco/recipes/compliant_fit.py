"""MuJoCo at the steps of robots: contacts of a few steps, under gravity, with Coulomb friction.

Three things make them (MuJoCo's documentation, Computation, constraint model). A soft row, of impedance 1e-4,
lets gravity act on through the contact: its force is continuous at touch, and e hardly depends on where in a
step the touch falls; a stiff one shuts gravity out from the step on that finds the touch, e scatters by
(1 + e) g h / v. Of MuJoCo's friction, a row's normal acceleration grows by impedance times friction times
slip: next to nothing of it remains, and impratio gives friction back its strength. Two <pair>s may name the
same two geoms: each makes a row of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import Bounds, differential_evolution, minimize

from hcbench.engines.mujoco.recipes.common import SPRING_SOLIMP
from hcbench.engines.mujoco.rows import MIN_IMPEDANCE, ConstraintRow, impedance
from hcbench.impact import Floats
from hcbench.laws.restitution import RestitutionCurve
from hcbench.tune.search import Search, map_result

IMPRATIO = 1e4  # about the inverse of the spring's impedance
_WEIGHT = MIN_IMPEDANCE / (1 - MIN_IMPEDANCE)  # of the spring, in MuJoCo's sums
_PULL = 1e6  # N: more than any contact asks for
_SEED, _MEMBERS, _GENERATIONS, _POLISHES, _POLISH = 1975, 48, 110, 3, 300
_SAG = 0.2  # m of rest depth a second of step, at the most
_CALM = 3.6  # 1/s: the spring's least damping; a body at rest has calmed down by exp(-9) after 5 s
_DEEPEST = 2.4  # times v h at the top of the band
_FOLLOWED = 6.0  # half periods of the spring
# Half period in steps; logs of D h of the spring, D h, d0, dw, width over v h and midpoint; power.
_LOWEST = np.array([4.0, *np.log([6.5e-3, 0.05, MIN_IMPEDANCE, 5e-3, 0.3, 3e-3]), 1.0])
_HIGHEST = np.array([10.0, *np.log([0.3, 5.0, 1e-2, 0.3, 12.0, 0.5]), 5.0])
# What long searches found for several α and steps, as members of the first generation.
_STARTS = np.array([
    [5.85, -5.12, -2.82, -9.2, -1.45, 0.71, -1.51, 5.0],
    [6.51, -5.12, -1.26, -9.2, -1.27, 2.03, -3.98, 5.0],
    [7.12, -5.12, -1.21, -9.2, -1.27, 1.53, -3.72, 5.0],
    [7.07, -5.12, -0.33, -9.2, -2.04, 1.69, -4.16, 5.0],
    [9.39, -5.81, -0.58, -9.2, -1.39, 2.25, -4.53, 2.8],
    [4.99, -5.04, -0.81, -9.2, -1.57, 1.03, -3.16, 5.0],
])  # fmt: skip


def half_period_steps(corners: float) -> int:
    """Steps of a contact that `corners` of a body meet at once: fewer gain energy. Found by trial."""
    return 3 if corners == 1 else math.ceil(2 * math.sqrt(corners) + 2)


def whole_step_row(restitution: float, timestep: float, corners: float = 1) -> ConstraintRow:
    """A linear spring and damper that turns v into -e v in n whole steps, exactly without gravity.

    The step v+ = v - h (K x + D v), x+ = x + h v+ multiplies by exp(±i π/n) √c, c = 1 - D h: after n steps by
    -c^(n/2) = -e. Per unit mass, shared by `corners` that meet at once.
    """
    n = half_period_steps(corners)
    stiffness, damping = _oscillator(n, 1.0 - restitution ** (2.0 / n))
    spring, damper = float(stiffness) / timestep**2 / corners, damping / timestep / corners
    return ConstraintRow.direct(_short(spring), _short(damper), SPRING_SOLIMP)


def _short(number: float) -> float:
    """Six digits, as a model is written with."""
    return float(f"{number:.6g}")


def _oscillator(steps: Any, damping: Any) -> tuple[Any, Any]:
    """(K h², D h) of a half period of so many steps, for a damping D h."""
    c = 1.0 - damping
    return 1.0 + c - 2.0 * np.sqrt(c) * np.cos(np.pi / steps), damping


@dataclass(frozen=True, slots=True)
class _RowFit:
    """What spring and damper rows are fitted to, in units of the step h and the band's highest speed v.

    speeds: over v. phases: where in a step the touch falls. wanted: e; shape (n,) each. fall: g h / v.
    corners: of a body that meet at once, or how much more a row does there than on a ball. adhesive: whether
    the damper may pull. rk4: the integrator, else Euler's. carried: as `spring_and_damper_rows` has it, h and
    h² times. lowest, highest: bounds.
    """

    speeds: Floats
    phases: Floats
    wanted: Floats
    fall: float
    corners: float
    adhesive: bool
    rk4: bool
    carried: tuple[float, float]
    lowest: Floats
    highest: Floats

    def numbers(self, parameters: Floats) -> tuple[Floats, ...]:
        """K h², D h of the spring; D h, d0, dw, width/(v h), midpoint, power of the damper; (p, 1) each."""
        inside = np.clip(parameters, self.lowest, self.highest)
        steps, power = inside[:, :1], inside[:, 7:]
        spring_damping, damping, d0, dw, width, midpoint = np.exp(inside[:, 1:7]).T[..., None]
        stiffness, spring_damping = _oscillator(steps, spring_damping)
        share = 1.0 / self.corners
        low = np.minimum(d0, dw)
        return stiffness * share, spring_damping * share, damping, low, dw, width, midpoint, power

    def errors(self, parameters: Floats) -> Floats:
        """Largest error of e, and what the contact is deeper than may be; (p, 8) to (p,)."""
        e, deepest = self._flown(self.numbers(parameters))
        off: Floats = np.abs(e - self.wanted).max(axis=1)
        return off + np.maximum(0.0, deepest - _DEEPEST)

    def _flown(self, numbers: tuple[Floats, ...]) -> tuple[Floats, Floats]:
        """e of each launch, (p, n), 0 where it has not parted; largest penetration over v h, (p,)."""
        shape, g = (len(numbers[0]), len(self.speeds)), self.fall
        # Of a step, from the touch to the first state that sees it; a stage of RK4 may see it a step before.
        later = -self.phases if self.rk4 else 1.0 - self.phases
        ahead = 0.0 if self.rk4 else 0.5  # of a step's fall: by so much Euler's speed is that of later
        x = np.broadcast_to(self.speeds * later + g * later**2 / 2, shape).copy()
        v = np.broadcast_to(self.speeds + g * (later - ahead), shape).copy()
        e, deepest, parted = np.zeros(shape), np.zeros(shape[0]), np.zeros(shape, bool)
        x0, v0 = x, v
        for k in range(int(_FOLLOWED * self.highest[0])):
            x, v = self._step(numbers, x, v, lambda t, k=k: self._free(x0, v0, k + t))
            deepest = np.maximum(deepest, x.max(axis=1))
            leaves = ~parted & (x <= 0.0) & (v < 0.0)
            if leaves.any():
                out = np.sqrt(np.maximum(0.0, (v + g * ahead) ** 2 - 2 * g * x)) / self.speeds
                e = np.where(leaves, out, e)
                parted |= leaves
                if parted.all():
                    break
        return e, deepest

    def _free(self, x: Floats, v: Floats, steps: float) -> tuple[Floats, Floats]:
        """(x, v) without contact, so many steps after these."""
        half = 0.0 if self.rk4 else 0.5
        return x + v * steps + self.fall * steps * (steps / 2 + half), v + self.fall * steps

    def _step(self, numbers: Any, x: Floats, v: Floats, free: Any) -> tuple[Floats, Floats]:
        """(x, v) after a step: Euler's, by the new speed, or the classical Runge-Kutta of MuJoCo's RK4.

        free: (x, v) without contact, a share of a step later.
        """
        if not self.rk4:
            v = v - self._acceleration(numbers, x, v, free(0.0))
            return x + v, v
        one = -self._acceleration(numbers, x, v, free(0.0))
        two = -self._acceleration(numbers, x + v / 2, v + one / 2, free(0.5))
        three = -self._acceleration(numbers, x + v / 2 + one / 4, v + two / 2, free(0.5))
        four = -self._acceleration(numbers, x + v + two / 2, v + three, free(1.0))
        return x + v + (one + two + three) / 6, v + (one + 2 * two + 2 * three + four) / 6

    def _acceleration(self, numbers: Any, x: Floats, v: Floats, free: tuple[Floats, Floats]) -> Floats:
        """Away from the plate. Rows together give a = (Σ w a_ref - g)/(1 + Σ w), of those that act."""
        K, D, damping, d0, dw, width, midpoint, power = numbers
        w = self.corners * _WEIGHT
        g = self.fall + self.carried[0] * (free[1] - v) + self.carried[1] * (free[0] - x)
        closed = x > 0.0
        share = impedance((d0, dw, width, midpoint, power), x)
        weights = np.where(closed, self.corners * share / (1.0 - share), 0.0)
        spring, pull = (K * x + D * v) / MIN_IMPEDANCE, damping / dw * v
        a = (w * spring + weights * pull - g) / (1.0 + w + weights)
        if not self.adhesive:  # a row once left out never comes back, as a is larger with it
            weights = np.where(pull < a, 0.0, weights)
            a = (w * spring + weights * pull - g) / (1.0 + w + weights)
        a = np.where(spring < a, (weights * pull - g) / (1.0 + weights), a)
        return np.where(closed, a, -g)

    def rows(self, parameters: Floats, timestep: float, speed: float) -> list[ConstraintRow]:
        """Spring and damper in SI units, of parameters (8,)."""
        h = timestep
        units = (1 / h**2, 1 / h, 1 / h, 1.0, 1.0, speed * h, 1.0, 1.0)
        K, D, damping, *solimp = (
            _short(float(number[0, 0]) * unit)
            for number, unit in zip(self.numbers(parameters[None]), units, strict=True)
        )
        d0, dw, width, midpoint, power = solimp
        adhesion = _PULL if self.adhesive else 0.0
        return [
            ConstraintRow.direct(K, D, SPRING_SOLIMP),
            ConstraintRow.direct(0.0, damping, (d0, dw, width, midpoint, power), adhesion=adhesion),
        ]


def spring_and_damper_rows(
    curve: RestitutionCurve,
    speeds: tuple[float, float],
    timestep: float,
    gravity: float,
    corners: float = 1,
    adhesive: bool = True,
    rk4: bool = False,
    carried: tuple[float, float] = (0.0, 0.0),
    points: int = 0,
) -> list[ConstraintRow]:
    """Two rows with this e over a band of impact speeds (m/s), for two <pair>s of the same two geoms.

    A soft linear spring of a few steps half period, and a damper whose impedance grows with depth. All their
    numbers are searched for in a model of the two rows that equals MuJoCo's step, gravity included (m/s²,
    into the plate), to the least largest error over speeds and phases. Per unit mass: the same for any mass.
    corners: of a body that meet at once, or how much more a row does there than on a ball. adhesive: whether
    the damper may pull (MuJoCo 3.11 and later). rk4: that integrator, else Euler's. carried: damping (1/s)
    and stiffness (1/s²) by which the rest of a robot, that goes on as it came, takes the contact along.
    points: corners that meet at once, where `corners` says something else; 0: those.
    Raises SearchInterrupted with the best so far.
    """
    low, high = speeds
    lowest, highest = _bounds(1.0 - float(curve.at(low)), timestep, gravity, points or corners)

    def fit_to(speed_count: int, phase_count: int) -> _RowFit:
        share = np.geomspace(low / high, 1.0, speed_count)
        phase = (np.arange(phase_count) + 0.5) / phase_count
        phase[0], phase[-1] = 0.003, 0.997
        u, where = (grid.ravel() for grid in np.meshgrid(share, phase, indexing="ij"))
        fall, h = gravity * timestep / high, timestep
        along = carried[0] * h, carried[1] * h**2
        return _RowFit(u, where, curve.at(u * high), fall, corners, adhesive, rk4, along, lowest, highest)

    fine = fit_to(25, 10)
    with map_result(lambda parameters: fine.rows(parameters, timestep, high)):
        return fine.rows(_search(fit_to(9, 6), fine), timestep, high)


def _bounds(loss: float, timestep: float, gravity: float, corners: float) -> tuple[Floats, Floats]:
    """Lowest and highest parameters, (8,) each. loss: 1 - e of the slowest impact."""
    lowest, highest = _LOWEST.copy(), _HIGHEST.copy()
    # No more than a part of the slowest impact's loss is the spring's.
    lowest[1] = min(lowest[1], math.log(min(_CALM * timestep, 0.5 * max(1e-3, loss))))
    if gravity > 0.0:  # the spring's rest depth, g (n h/π)²
        highest[0] = min(highest[0], max(math.pi * math.sqrt(_SAG / (gravity * timestep)), lowest[0] + 0.6))
    if corners > 1:
        lowest[0], highest[0] = half_period_steps(corners), max(highest[0], half_period_steps(corners) + 2.0)
    return lowest, highest


def _search(coarse: _RowFit, fine: _RowFit) -> Floats:
    """Parameters (8,) with the least error: by evolution on a coarse grid, polished on a fine one."""
    search = Search(_MEMBERS * (1 + _GENERATIONS) + _POLISHES * _POLISH)
    lowest, highest = fine.lowest, fine.highest
    first = np.random.default_rng(_SEED).uniform(lowest, highest, (_MEMBERS, len(lowest)))
    first[: len(_STARTS)] = np.clip(_STARTS, lowest, highest)

    def errors(fit: _RowFit, parameters: Floats) -> Any:
        off = fit.errors(parameters)
        search.record(parameters, off)
        return off

    def population_errors(parameters: Floats) -> Any:
        return errors(coarse, parameters.T)

    def error(parameters: Floats) -> float:
        return float(errors(fine, parameters[None])[0])

    with search.return_best_on_interrupt():
        best = differential_evolution(
            population_errors,
            Bounds(lowest, highest),
            init=first,
            maxiter=_GENERATIONS,
            seed=_SEED,
            tol=0.0,
            mutation=(0.4, 0.9),
            recombination=0.9,
            vectorized=True,
            updating="deferred",
            polish=False,
        ).x
        for _ in range(_POLISHES):  # each from a fresh simplex
            options = {"maxfev": _POLISH, "adaptive": True, "xatol": 1e-9, "fatol": 1e-8}
            best = minimize(error, np.asarray(best), method="Nelder-Mead", options=options).x  # type: ignore[call-overload]
    return np.asarray(best)
