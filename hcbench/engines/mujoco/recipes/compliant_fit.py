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
from functools import partial
from typing import Any

import numpy as np

from hcbench.engines.mujoco.recipes.common import SPRING_SOLIMP
from hcbench.engines.mujoco.scene.rows import MIN_IMPEDANCE, ConstraintRow
from hcbench.impact import Floats
from hcbench.laws.restitution import RestitutionCurve
from hcbench.recipes.search import Search, evolve, map_result

IMPRATIO = 1e4  # about the inverse of the spring's impedance
_WEIGHT = MIN_IMPEDANCE / (1 - MIN_IMPEDANCE)  # of the spring, in MuJoCo's sums
_PULL = 1e6  # N: more than any contact asks for
_POWER = 4.0  # of the damper's solimp: others do no better
_SEED, _MEMBERS, _GENERATIONS, _BEST, _POLISH = 1975, 48, 90, 40, 60
_ALONE, _ALL = 28, -0.01  # members and generations of a row by itself; log of its highest D h
_NO_DAMPER = np.log([1e-12, 0.3, 1.0, 0.5])
_SAG = 0.2  # m of rest depth a second of step, at the most
_CALM = 3.6  # 1/s: the spring's least damping; a body at rest has calmed down by exp(-9) after 5 s
# Of the spring's damping D h: enough for a body to calm down, the least that will, and of the loss allowed.
_ENOUGH, _LEAST, _SHARE = 6.5e-3, 4e-3, 0.4
_DEEPEST = 2.4  # times v h at the top of the band
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_FOLLOWED = 3.0  # half periods of the spring
# Half period in steps; logs of D h of the spring, D h, dw, width over v h and midpoint of the damper.
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
        """K h², D h of the spring; D h, dw, width/(v h), midpoint of the damper; (p,) each."""
        inside = np.clip(parameters, self.lowest, self.highest).T
        spring_damping, damping, dw, width, midpoint = np.exp(inside[1:])
        stiffness, spring_damping = _oscillator(inside[0], spring_damping)
        return stiffness / self.corners, spring_damping / self.corners, damping, dw, width, midpoint

    def errors(self, parameters: Floats) -> Floats:
        """Largest error of e, and what the contact is deeper than may be; (p, 6) to (p,)."""
        e, deepest = self._flown(self.numbers(parameters))
        off: Floats = np.abs(e - self.wanted).max(axis=1)
        return off + np.maximum(0.0, deepest - _DEEPEST)

    def _flown(self, numbers: tuple[Floats, ...]) -> tuple[Floats, Floats]:
        """e of each launch, (p, n), 0 where it has not parted; largest penetration over v h, (p,)."""
        (K, D, damping, dw, width, midpoint), g = numbers, self.fall
        launches, w = len(self.speeds), self.corners * _WEIGHT / MIN_IMPEDANCE
        steep = 1.0 / midpoint ** (_POWER - 1.0), 1.0 / (1.0 - midpoint) ** (_POWER - 1.0)
        each = np.repeat([w * K, w * D, damping / dw, dw, width, midpoint, *steep], launches, axis=1)
        # Of a step, from the touch to the first state that sees it; a stage of RK4 may see it a step before.
        later = -self.phases if self.rk4 else 1.0 - self.phases
        ahead = 0.0 if self.rk4 else 0.5  # of a step's fall: by so much Euler's speed is that of later
        x = np.tile(self.speeds * later + g * later**2 / 2, len(K))
        v = np.tile(self.speeds + g * (later - ahead), len(K))
        x0, v0, e, deepest, which = x, v, np.zeros(x.size), x.copy(), np.arange(x.size)
        for k in range(int(_FOLLOWED * self.highest[0])):
            x, v = self._step(each, x, v, partial(self._free, x0, v0, k))
            deepest[which] = np.maximum(deepest[which], x)
            parted = (x <= 0.0) & (v < 0.0)
            if parted.any():
                out = np.sqrt(np.maximum(0.0, (v[parted] + g * ahead) ** 2 - 2 * g * x[parted]))
                e[which[parted]] = out / self.speeds[which[parted] % launches]
                going = np.flatnonzero(~parted)
                if not going.size:
                    break
                x, v, x0, v0, each = (a[..., going] for a in (x, v, x0, v0, each))
                which = which[going]
        return e.reshape(-1, launches), deepest.reshape(-1, launches).max(axis=1)

    def _free(self, x: Floats, v: Floats, whole: int, share: float) -> tuple[Floats, Floats]:
        """(x, v) without contact, so many whole steps and a share of one after these."""
        half, steps = 0.0 if self.rk4 else 0.5, whole + share
        return x + v * steps + self.fall * steps * (steps / 2 + half), v + self.fall * steps

    def _step(self, each: Floats, x: Floats, v: Floats, free: Any) -> tuple[Floats, Floats]:
        """(x, v) after a step: Euler's, by the new speed, or the classical Runge-Kutta of MuJoCo's RK4.

        free: (x, v) without contact, a share of a step later.
        """
        if not self.rk4:
            v = v - self._acceleration(each, x, v, free, 0.0)
            return x + v, v
        one = -self._acceleration(each, x, v, free, 0.0)
        two = -self._acceleration(each, x + v / 2, v + one / 2, free, 0.5)
        three = -self._acceleration(each, x + v / 2 + one / 4, v + two / 2, free, 0.5)
        four = -self._acceleration(each, x + v + two / 2, v + three, free, 1.0)
        return x + v + (one + two + three) / 6, v + (one + 2 * two + 2 * three + four) / 6

    def _acceleration(self, each: Floats, x: Floats, v: Floats, free: Any, share: float) -> Floats:
        """Away from the plate, (m,). Rows together give a = (Σ w a_ref - g)/(1 + Σ w), of those that act.

        each: (8, m). free, share: as of `_step`.
        """
        K, D, damping, dw, width, midpoint, before, after = each
        g, w = self.fall, self.corners * _WEIGHT
        if any(self.carried):
            x_free, v_free = free(share)
            g = g + self.carried[0] * (v_free - v) + self.carried[1] * (x_free - x)
        u = np.clip(x / width, 0.0, 1.0)
        early = u <= midpoint
        rise = np.where(early, u, 1.0 - u) ** 2
        rise *= rise
        rise *= np.where(early, before, after) * (dw - MIN_IMPEDANCE)
        d = np.where(early, MIN_IMPEDANCE + rise, dw - rise)
        weights = self.corners * d / (1.0 - d)
        spring, pull = K * x + D * v, damping * v
        a = (spring + weights * pull - g) / (1.0 + w + weights)
        if not self.adhesive:  # a row once left out never comes back, as a is larger with it
            weights = np.where(pull < a, 0.0, weights)
            a = (spring + weights * pull - g) / (1.0 + w + weights)
        a = np.where(spring < w * a, (weights * pull - g) / (1.0 + weights), a)
        return np.where(x > 0.0, a, -g)

    def rows(self, parameters: Floats, timestep: float, speed: float) -> list[ConstraintRow]:
        """Spring and damper in SI units, of parameters (6,)."""
        h = timestep
        units = (1 / h**2, 1 / h, 1 / h, 1.0, speed * h, 1.0)
        K, D, damping, dw, width, midpoint = (
            _short(float(number[0]) * unit)
            for number, unit in zip(self.numbers(parameters[None]), units, strict=True)
        )
        solimp = (MIN_IMPEDANCE, dw, width, midpoint, _POWER)
        adhesion = _PULL if self.adhesive else 0.0
        return [
            ConstraintRow.direct(K, D, SPRING_SOLIMP),
            ConstraintRow.direct(0.0, damping, solimp, adhesion=adhesion),
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
    bounds = _bounds(1.0 - float(curve.at(low)), timestep, gravity, points or corners)

    def fit_to(speed_count: int, phase_count: int) -> _RowFit:
        u, where = _grid(low / high, speed_count, phase_count)
        fall, h = gravity * timestep / high, timestep
        along = carried[0] * h, carried[1] * h**2
        return _RowFit(u, where, curve.at(u * high), fall, corners, adhesive, rk4, along, *bounds)

    fine = fit_to(25, 10)
    with map_result(lambda parameters: fine.rows(parameters, timestep, high)):
        return fine.rows(_search(fit_to(9, 6), fine), timestep, high)


def _grid(lowest: float, speeds: int, phases: int) -> tuple[Floats, Floats]:
    """(speed over the highest, phase) of so many speeds and phases each; (n,) each.

    At each speed other phases, so that few of them leave none out.
    """
    later = (np.arange(speeds) * _GOLDEN) % 1.0
    where = np.clip((np.arange(phases) + later[:, None]).ravel() / phases, 0.003, 0.997)
    return np.repeat(np.geomspace(lowest, 1.0, speeds), phases), where


def pushing_row(
    curve: RestitutionCurve, speeds: tuple[float, float], timestep: float, gravity: float, corners: int = 1
) -> ConstraintRow:
    """One row that only pushes, and comes as near to this e over a band of impact speeds (m/s) as one e can.

    Half period and damping of a linear spring and damper, searched for with gravity and over all phases:
    where its last step would pull, a whole number n of steps gives e^(2/n) instead of e. Per unit mass.
    Raises SearchInterrupted with the best so far.
    """
    low, high = speeds
    e, n = float(curve.at(math.sqrt(low * high))), half_period_steps(corners)
    whole = n, math.log(max(1e-4, 1.0 - e ** (2.0 / n)))
    lowest, highest = bounds = _bounds(1.0 - e, timestep, gravity, corners)
    lowest[:2], highest[1] = np.minimum(lowest[:2], whole), _ALL
    lowest[2:] = highest[2:] = _NO_DAMPER
    u, where = _grid(low / high, 9, 16)
    fall, still = gravity * timestep / high, (0.0, 0.0)
    fit = _RowFit(u, where, curve.at(u * high), fall, corners, False, False, still, *bounds)
    search, random = Search(_ALONE * (1 + _ALONE)), np.random.default_rng(_SEED)
    first = random.uniform(*bounds, (_ALONE, len(lowest)))
    first[0, :2] = whole
    with map_result(lambda found: fit.rows(found, timestep, high)[0]), search.return_best_on_interrupt():
        best = evolve(search.recorded(fit.errors), first, _ALONE, bounds, random)
    return fit.rows(best[0], timestep, high)[0]


def _bounds(loss: float, timestep: float, gravity: float, corners: float) -> tuple[Floats, Floats]:
    """Lowest and highest parameters, (6,) each. loss: 1 - e of the slowest impact."""
    lowest, highest = _LOWEST.copy(), _HIGHEST.copy()
    # No more than a part of the slowest impact's loss is the spring's, but what a body at rest calms down by.
    lowest[1] = math.log(min(_ENOUGH, _CALM * timestep, max(_LEAST, _SHARE * loss)))
    if gravity > 0.0:  # the spring's rest depth, g (n h/π)²
        highest[0] = min(highest[0], max(math.pi * math.sqrt(_SAG / (gravity * timestep)), lowest[0] + 0.6))
    if corners > 1:
        lowest[0], highest[0] = half_period_steps(corners), max(highest[0], half_period_steps(corners) + 2.0)
    return lowest, highest


def _search(coarse: _RowFit, fine: _RowFit) -> Floats:
    """Parameters (6,) with the least error: by evolution on a coarse grid, then on a fine one."""
    search = Search(_MEMBERS * (1 + _GENERATIONS) + _BEST * (1 + _POLISH))
    random = np.random.default_rng(_SEED)
    first = random.uniform(fine.lowest, fine.highest, (_MEMBERS, len(fine.lowest)))
    first[: len(_STARTS)] = np.clip(_STARTS, fine.lowest, fine.highest)
    bounds = fine.lowest, fine.highest
    with search.return_best_on_interrupt():
        found = evolve(search.recorded(coarse.errors), first, _GENERATIONS, bounds, random)
        polished = evolve(search.recorded(fine.errors), found[:_BEST], _POLISH, bounds, random, True)
    return np.asarray(polished[0])
