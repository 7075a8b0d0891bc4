"""MuJoCo, one row of contact: a bounce in a single step or a spring and damper, with the best
constant e; or all numbers of solref and solimp searched for, so that e falls with speed.

The search: one row gives a = d (S d/dw² r + D/dw v). The best that its numbers can do is a step: an
impedance that stays at its floor until half its width and jumps to its top there holds the ball up
with a nearly constant force F (1 + a v), and the restitution of that is the restitution of eq.
(16), for any exponent. How sharp the step can be is set by MuJoCo's arithmetic, which underflows
beyond a power of about 1020 (at midpoint 0.5).
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.recipes.common import DAMPED_STEP, SOFTENED, WEAK_FRICTION, rows_options
from hcbench.engines.mujoco.scene.rows import (
    MAX_IMPEDANCE,
    MIN_IMPEDANCE,
    STIFF_SOLIMP,
    ConstraintRow,
    impedance,
)
from hcbench.recipes.recipe import Integrators, Recipe, Role, Search, map_result
from hcbench.recipes.target import Target, contact_time, minimax_constant, spring_damper_rates
from hcbench.sim.columns import Whole
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Floats
from hcbench.terms.resolution import STEPS_OF_A_LOOP, STEPS_OF_A_WIDE_SPRING

# Speeds of the band at which e is compared.
_SPEEDS = 12
_DEEPEST = 0.02  # m
# One seed, so that a target always has the same setting.
_SEED = 1975
# Members of the search, five for each parameter, and its generations.
_MEMBERS = 30
_GENERATIONS = 40
# Evaluations afterwards, of two parameters and of all.
_POLISH_TWO = 120
_POLISH_ALL = 300
# The smallest power that MuJoCo's spline can take without a subnormal number: midpoint^(power - 1).
_LOG_SMALLEST_POWER = -math.log(1e-306)
# log10 S, log10 D (in widths and highest speeds), log10 d0, log10(1 - dw),
# midpoint, log10(power/largest).
_LOWEST = np.array(
    [-1.5, -3.0, math.log10(MIN_IMPEDANCE), math.log10(1 - MAX_IMPEDANCE), 0.35, -0.8]
)
_HIGHEST = np.array([2.5, 2.0, -2.0, -0.0005, 0.65, 0.0])


def largest_power(midpoint: Floats) -> Floats:
    """Largest power at which MuJoCo can compute the impedance; same shape."""
    return np.asarray(
        1.0 + _LOG_SMALLEST_POWER / np.maximum(-np.log(midpoint), -np.log1p(-midpoint))
    )


class _Numbers(NamedTuple):
    """Numbers of MuJoCo's rows, one a member of the search, (population, 1) each; lengths in widths
    of the impedance, speeds in the band's highest one, per unit mass.

    S, D: stiffness and damping of solref "-S -D".
    d0, dw: impedances of solimp at touch and at its width.
    midpoint, power: of the sigmoid between the two.
    """

    S: Floats
    D: Floats
    d0: Floats
    dw: Floats
    midpoint: Floats
    power: Floats


def _numbers(parameters: Floats) -> _Numbers:
    """The rows that points of the search stand for.

    parameters: (population, 6), in the order of _LOWEST: log10 of S, D, d0 and 1 - dw; midpoint;
    log10 of the power over the largest that MuJoCo can compute.
    """
    log_s, log_d, log_d0, log_gap, midpoint, log_share = parameters.T[..., None]
    return _Numbers(
        S=10.0**log_s,
        D=10.0**log_d,
        d0=10.0**log_d0,
        dw=1.0 - 10.0**log_gap,
        midpoint=midpoint,
        power=np.maximum(1.0, largest_power(midpoint) * 10.0**log_share),
    )


def _work_and_damping(parameters: Floats) -> tuple[Floats, Floats]:
    """Elastic work and damping of one contact row over intervals of depth, which are fine where its
    impedance steps up; (population, intervals) each.

    parameters: of rows, (population, 6), in the order of _LOWEST.
    Lengths are in widths of the impedance and speeds in the band's highest one, per unit mass.
    """
    # Stiffness and damping; solimp's impedance at touch and at its width, midpoint and power.
    S, D, d0, dw, midpoint, power = _numbers(parameters)
    # Around the midpoint a sigmoid of this power rises within a few midpoint/power; before it and
    # after it the impedance hardly changes.
    step = midpoint * np.maximum(0.0, 1.0 + np.linspace(-10.0, 10.0, 121) / power)
    before = step[:, :1] * np.linspace(0.0, 1.0, 21)[None, :-1]
    after = step[:, -1:] + (np.geomspace(1.0, 3e3, 60)[None, 1:] - 1.0) * midpoint / power
    edges = np.concatenate([before, step, after], axis=1)
    depth = (edges[:, 1:] + edges[:, :-1]) / 2
    length = np.diff(edges, axis=1)
    d = impedance((d0, dw, 1.0, midpoint, power), depth)
    # One row of solref "-S -D" gives the acceleration S (d/dw)² x + D d/dw v.
    work = S * (d / dw) ** 2 * depth * length
    damping = D * d / dw * length
    return work, damping


def _mean(v: Floats, w: Floats) -> Floats:
    """Mean speed along an interval under a constant force, from v at one end to w at the other."""
    return np.asarray((2 / 3) * (v * v + v * w + w * w) / np.maximum(v + w, 1e-300))


def _restitution(parameters: Floats, speeds: Floats) -> Floats:
    """e of contacts at impact speeds, (population, speeds); 0 where it would go too deep.

    parameters: (population, 6), in the order of _LOWEST.
    speeds: over the highest of the band, (speeds,).

    By energy along the depth, per unit mass: over an interval v²/2 falls by P + G v on the way in,
    and grows by P - G v on the way out as long as the contact pushes. P is the interval's elastic
    work, G its damping, and v its mean speed: first that of its ends, then better.
    """
    work, damping = _work_and_damping(parameters)
    last, part = _way_in(work, damping, speeds)
    out = _way_out(work, damping, last, part)
    # -1: it never stops.
    return np.where(last < 0, 0.0, out / speeds)


def _way_in(work: Floats, damping: Floats, speeds: Floats) -> tuple[Whole, Floats]:
    """Follow impacts on the way in: the index of the interval of depth in which each turns round, -1
    where it goes through all, and the share of that interval, 0 to 1, that it gets into;
    (population, speeds) each.

    work, damping: elastic work and damping of each interval, (population, intervals), per unit
    mass, with speeds in the band's highest one.
    speeds: at touch, over that one, (speeds,).
    """
    v = np.broadcast_to(speeds, (len(work), len(speeds))).copy()
    last = np.full(v.shape, -1)
    part = np.zeros(v.shape)
    for i in range(work.shape[1]):
        P = work[:, i, None]
        G = damping[:, i, None]
        # A first guess of the speed w at the interval's end, from w²/2 = v²/2 - P - G (v + w)/2;
        # with it a better mean speed, and w².
        rough = np.sqrt(np.maximum(G**2 / 4 - 2 * P - G * v + v**2, 0.0)) - G / 2
        squared = v**2 - 2 * (P + G * _mean(v, np.maximum(rough, 0.0)))
        stops = (last < 0) & (squared <= 0.0)
        # Where it stops within the interval, its mean speed there is 2/3 of that at its start.
        reached = np.clip(v**2 / 2 / np.maximum(P + G * v * 2 / 3, 1e-300), 0.0, 1.0)
        part = np.where(stops, reached, part)
        last = np.where(stops, i, last)
        if (last >= 0).all():
            break
        v = np.where(last < 0, np.sqrt(np.maximum(squared, 0.0)), v)
    return last, part


def _way_out(work: Floats, damping: Floats, last: Whole, part: Floats) -> Floats:
    """Follow impacts on the way out: the speed with which each leaves, in the band's highest one,
    (population, speeds).

    work, damping: elastic work and damping of each interval of depth, (population, intervals).
    last, part: index of the interval in which each turns round, and the share of it that it gets
    into, (population, speeds). An interval in which the damping would pull adds nothing: the
    contact only pushes.
    """
    s = np.zeros(part.shape)
    # From the deepest interval of any impact up to the surface.
    for i in range(int(last.max()), -1, -1):
        # The share of this interval that an impact passes: part of its deepest, no deeper one.
        share = np.where(last > i, 1.0, 0.0)
        share = np.where(last == i, part, share)
        P = work[:, i, None] * share
        G = damping[:, i, None] * share
        push = P - G * s
        # As on the way in: a first guess of the speed at the interval's end, then its square.
        rough = np.sqrt(np.maximum(G**2 / 4 + 2 * push + G * s + s**2, 0.0)) - G / 2
        squared = s**2 + 2 * (P - G * _mean(s, np.maximum(rough, 0.0)))
        s = np.where(push > 0, np.sqrt(np.maximum(squared, 0.0)), s)
    return s


@lru_cache(maxsize=64)
def _search(shares: tuple[float, ...], wanted: tuple[float, ...]) -> Floats:
    """Search the parameters of one row, (6,), in the order of _LOWEST, with the least largest error
    of e, by an evolution and by Nelder and Mead's method.

    shares: impact speeds over the highest of the band, rising.
    wanted: e at each.
    Raises SearchInterrupted with the best so far.
    """
    # SciPy's optimisation is slow to import.
    from scipy.optimize import Bounds, differential_evolution, minimize

    speeds = np.array(shares)
    e = np.array(wanted)
    search = Search(_MEMBERS * (1 + _GENERATIONS) + _POLISH_TWO + _POLISH_ALL)

    def errors(parameters: Floats) -> Floats:
        """Largest error of e of each point, (n,), which is recorded, too; parameters: (n, 6)."""
        inside = np.clip(parameters, _LOWEST, _HIGHEST)
        largest = np.asarray(np.abs(_restitution(inside, speeds) - e).max(axis=1))
        search.record(inside, largest)
        return largest

    def error(parameters: Floats) -> float:
        """Largest error of e of one point; parameters: (6,)."""
        return float(errors(parameters[None])[0])

    def polished(start: Floats, others: Floats, evaluations: int) -> Floats:
        """Parameters (6,) of less error, by Nelder and Mead from `start`, (k,), with `others`, (6 -
        k,), left as they are.

        evaluations: at most.
        """

        def error_at(parameters: Floats) -> float:
            return error(np.concatenate([parameters, others]))

        result = minimize(
            error_at, start, method="Nelder-Mead", options={"maxfev": evaluations, "fatol": 1e-7}
        )
        return np.concatenate([result.x, others])

    # A step as high and sharp as can be, in the middle of the width; S and D found by trial.
    loss = max(1e-4, 1 - wanted[-1])
    start = np.array([0.45, math.log10(2.5 * loss), _LOWEST[2], _LOWEST[3], 0.5, 0.0])

    def population_errors(parameters: Floats) -> Any:
        # SciPy has the members in columns.
        return errors(parameters.T)

    with search.interrupt_with_best():
        evolved = differential_evolution(
            population_errors,
            Bounds(_LOWEST, _HIGHEST),
            x0=np.clip(start, _LOWEST + 1e-6, _HIGHEST - 1e-6),
            seed=_SEED,
            popsize=_MEMBERS // len(start),
            maxiter=_GENERATIONS,
            vectorized=True,
            updating="deferred",
            polish=False,
        )
        # The best step is as high and as sharp as can be: from there S and
        # D alone, from elsewhere all.
        sharp = polished(start[:2], start[2:], _POLISH_TWO)
        free = polished(np.asarray(evolved.x), np.empty(0), _POLISH_ALL)
    return np.asarray(np.clip(min((sharp, free), key=error), _LOWEST, _HIGHEST))


def soft(target: Target, integrator: str = "Euler") -> dict[str, Any]:
    """Options of a setting, by name: one contact that follows e(v) as nearly as one contact can.

    integrator: that the options name.
    Raises SettingError where the step is too coarse, SearchInterrupted with the best so far.
    """
    width = STEPS_OF_A_WIDE_SPRING * target.timestep * target.speed_max
    if width > _DEEPEST:
        limit = _DEEPEST / (STEPS_OF_A_WIDE_SPRING * target.speed_max)
        raise SettingError(
            "timestep",
            f"{target.timestep:.4g} s, which takes a contact {width:.3g} m deep",
            f"{limit:.3g} s or less for speeds up to {target.speed_max:.4g} m/s",
            "Use `staggered`, `two-pair` or `impulse`",
        )
    speeds = np.geomspace(target.speed_min, target.speed_max, _SPEEDS)
    shares = speeds / target.speed_max
    wanted = target.restitution(speeds)

    def options(parameters: Floats) -> dict[str, Any]:
        """Options of the row of one point of the search, (6,), in SI units."""
        S, D, d0, dw, midpoint, power = (
            float(number[0, 0]) for number in _numbers(parameters[None])
        )
        # The search has lengths in widths, and speeds in the highest: this is its unit, 1/s.
        rate = target.speed_max / width
        row = ConstraintRow.direct(S * rate**2, D * rate, (d0, dw, width, midpoint, power))
        return rows_options(integrator, row)

    with map_result(options):
        parameters = _search(tuple(shares.tolist()), tuple(wanted.tolist()))
    return options(parameters)


SOFT = Recipe(
    "mujoco",
    "soft",
    Role.FALLING_E,
    soft,
    "One contact, solref and solimp searched: e falls with speed, near the target, without gravity only.",
    (
        "Use Euler, implicit, implicitfast or RK4, with steps of at most 26 µs for 1 ... 20 in/s.",
        "The numbers are per unit effective mass, so they give the same e for any mass.",
        "The force loop is not the law's: the force is nearly constant; faster contacts last longer.",
        "Do not use it under gravity: a body rests half of solimp's width deep, and slow bounces fail.",
        "Do not raise the power: above about 1020 (midpoint 0.5) MuJoCo's impedance is NaN.",
        "Set solref and solimp on both geoms or in a <pair>: MuJoCo averages the solimp of the two geoms.",
    ),
    integrators=DAMPED_STEP,
    steps_min=STEPS_OF_A_LOOP,
    # Many times deeper than the law's contact: never chosen automatically.
    by_auto=False,
)


# MuJoCo: one row with the best constant e: a bounce in a single step, or a spring and damper with
# the law's contact time.


def impulse(target: Target, integrator: str = "Euler", spring: float = 0.0) -> dict[str, Any]:
    """Options of a setting, by name: one contact whose damping turns a speed v into -e v within the
    step that finds it closed.

    target: its best constant e and its time step count.
    integrator: that the options name.
    spring: K, 1/s².
    A contact of impedance d gives the acceleration a = d (K x - D v) + (1 - d) g: with D = (1 +
    e)/h a step h ends in v - (1 + e) v = -e v, at any depth x. With K = 0 e is exact at every
    phase, but a body at rest sinks slowly, by the part 1 - d of gravity; a K above 0 holds it at a
    depth of 1e-4 g / K, at the price of up to K h² / 2 in e.
    """
    e, _ = minimax_constant(target)
    h = target.timestep
    # A step finds the ball 0 ... v h deep: half of K h takes the spring's mean effect on e out.
    damping = (1 + e) / h - spring * h / 2
    return rows_options(
        integrator, ConstraintRow.direct(spring * MAX_IMPEDANCE, damping, STIFF_SOLIMP)
    )


IMPULSE = Recipe(
    "mujoco",
    "impulse",
    Role.CONSTANT_E,
    impulse,
    "One step turns v into -e v: the best constant e, exact without gravity and friction; no force loop.",
    (
        "Use the integrator Euler, implicit or implicitfast; RK4 and discrete give e = 0 and are refused.",
        "The numbers serve every body at every speed, at this step only.",
        "If you change the step, change solref too: D = (1 + e)/h.",
        "Set solref and solimp on both geoms or in a <pair>: MuJoCo mixes those of the two geoms.",
        "At rest under gravity a body drifts into the plate at about 1e-4 g h / (1 + e).",
        "Do not use it with friction, which throws a sliding body up: use `compliant`.",
        "Under gravity e varies by up to (1 + e) g h / v with the phase of the step.",
        "The bounce takes one step: contact force, stress and contact time mean nothing.",
    ),
    one_step=True,
    integrators=Integrators(
        ("Euler", "implicit", "implicitfast"), "the recipe assumes one contact force a step"
    ),
)


def spring_damper(target: Target, integrator: str = "Euler") -> dict[str, Any]:
    """Options of a setting, by name: a linear spring and damper (Kelvin-Voigt, eq. (4)) by solref in
    its direct form, with the target's best constant e.

    integrator: that the options name, and that the numbers are for. With an impedance d throughout,
    the contact is a = S x / d + D v. S and D are chosen so that the steps x+ = x + h v+, v+ = v - h
    (S/d x + D v) have the poles exp((-β ± i ω) h) of the wanted motion exactly: the step h does not
    shift e or the contact time to first order.
    """
    e, _ = minimax_constant(target)
    # Decay and angular frequency of the motion in contact, 1/s.
    beta, omega = spring_damper_rates(e, contact_time(target), "impulse")
    h = target.timestep
    # RK4 follows continuous time.
    if integrator == "RK4":
        spring = omega**2 + beta**2
        damping = 2 * beta
    else:
        decay = math.exp(-beta * h)
        damping = (1 - decay**2) / h
        spring = (1 + decay**2 - 2 * decay * math.cos(omega * h)) / h**2
    return rows_options(
        integrator, ConstraintRow.direct(spring * MAX_IMPEDANCE, damping, STIFF_SOLIMP)
    )


SPRING_DAMPER = Recipe(
    "mujoco",
    "spring-damper",
    Role.CONSTANT_E,
    spring_damper,
    "A linear spring and damper: the best constant e, and the law's contact time at the middle speed.",
    (
        "Use the integrator Euler, implicit, implicitfast or RK4; discrete is refused: it lowers e by 0.2.",
        "The numbers are per unit effective mass, so they give the same e for any mass.",
        "A contact lasts at least 20 steps: where the law's is shorter, hcbench softens the spring.",
        SOFTENED,
        WEAK_FRICTION,
        "e does not depend on speed, and the force jumps at touch: the force loop is not the law's.",
        "Set solref and solimp on both geoms or in a <pair>: MuJoCo mixes those of the two geoms.",
    ),
    integrators=DAMPED_STEP,
)
