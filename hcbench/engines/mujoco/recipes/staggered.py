"""MuJoCo: the whole of eq. (16), loop included, in plain MJCF.

Springs that start at staggered depths add up to the law's elastic force k x^n; dampers whose
impedance grows as x^n are its damping a k x^n v. Rows of contact act on one another: with weights w
= d/(1 - d) the acceleration is a = Σ w a_ref / (1 + Σ w), so what the springs have to add up to is
k x^n (1 + Σ w). The restitution depends on the ratio of damping to elastic force alone, and how it
changes with that ratio is known (`restitution_sensitivity`): springs and dampers come out of one linear
problem, a non-negative least-squares fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from hcbench.engines.mujoco.recipes.common import (
    DAMPED_STEP,
    SOFTENED,
    SPRING_SOLIMP,
    WEAK_FRICTION,
    nonnegative_fit,
    rows_options,
)
from hcbench.engines.mujoco.scene.rows import MAX_IMPEDANCE, MIN_IMPEDANCE, ConstraintRow, weight
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.recipe import Recipe, Role
from hcbench.recipes.target import Target, resolvable_law
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Floats
from hcbench.terms.resolution import STEPS_OF_A_LOOP

# Points of the law's path, dense where the body turns round.
_POINTS = 501


def restitution_sensitivity(law: HuntCrossley, mass: float, speed: float, grid: Floats) -> Floats:
    """Sensitivity of e to an error of a contact's damping at each penetration: weights K, (n,),
    1/(N s/m), with δe = K @ (g - a f)(grid).

    law, mass (kg): of the impact.
    speed: at touch, m/s.
    grid: penetrations, m, (n,), rising.

    A force f(x) + g(x) v, f in N and g in N s/m, is near that of the law, for which g = a f with a
    = (3/2) α. Only the ratio of g to f matters. With the work U = ∫ f dx as the path, d(v²/2)/dU =
    -(1 + v g/f)/m, and to first order around eq. (16) the integrating factors are 1/(1 + a v) on
    the way in and 1/(1 - a s) on the way out at speed s:

        δe = -(1 - a e v_i)/(m e v_i²) ∫ (v/(1 + a v) + s/(1 - a s)) (g - a f) dx
    """
    a = law.dissipation
    e = float(closed_form.restitution(law.alpha, speed))
    # Dense where v turns.
    x = closed_form.penetration_max(law, mass, speed) * np.sin(np.linspace(0.0, np.pi / 2, _POINTS))
    v = closed_form.rate_at(law, mass, speed, x, "approach")
    s = -closed_form.rate_at(law, mass, speed, x, "rebound")
    # The integral by the trapezoidal rule: the part of each interval of x.
    integrand = v / (1.0 + a * v) + s / (1.0 - a * s)
    share = (integrand[1:] + integrand[:-1]) / 2.0 * np.diff(x)
    # Each interval's part of the integral goes to the two neighbours of its middle on the grid.
    middle = (x[1:] + x[:-1]) / 2.0
    left = np.clip(np.searchsorted(grid, middle) - 1, 0, len(grid) - 2)
    beyond = np.clip((middle - grid[left]) / (grid[left + 1] - grid[left]), 0.0, 1.0)
    weights = np.zeros(len(grid))
    np.add.at(weights, left, share * (1.0 - beyond))
    np.add.at(weights, left + 1, share * beyond)
    return np.asarray(-(1.0 - a * e * speed) / (mass * e * speed**2) * weights)


# Penetrations and impact speeds of the band at which the rows are fitted.
_GRID = 1200
_SPEEDS = 50
# In largest penetrations without loss: the band ends a little beyond.
_HEADROOM = 1.02
# One unit of misfit: relative for a force, absolute for e.
_FORCE_SCALE = 1e-3
_RESTITUTION_SCALE = 2e-6
_SPRING_WEIGHT = MIN_IMPEDANCE / (1.0 - MIN_IMPEDANCE)


@dataclass(frozen=True)
class Damper:
    """Damper of a staggered contact.

    onset: penetration from which it acts, m.
    solimp: its impedance.
    """

    onset: float
    solimp: tuple[float, float, float, float, float]

    def weight(self, x: Floats) -> Floats:
        """d/(1 - d) at penetrations (m), same shape."""
        return weight(self.solimp, x - self.onset)


@dataclass(frozen=True)
class Band:
    """The law and the impact speeds (m/s) to match, which reach penetrations from `low` to `top`
    (m).

    mass: effective, kg.
    speeds: rising, (s,).
    lag: half a step (s) where the engine's rates lag the positions by it, else 0.
    """

    law: HuntCrossley
    mass: float
    speeds: Floats
    low: float
    top: float
    lag: float

    def elastic(self, x: Floats) -> Floats:
        """Elastic acceleration f of the contact at penetrations x, m, in m/s², so that f (1 + a v) is
        the law's at the rate v that the engine uses.

        An Euler step x+ = x + h v+ knows the rate of half a step ago, v + (h/2) f (1 + a v): hence
        the denominator. The ratio of damping to elastic force, and with it e, stays as it is.
        """
        f = self.law.stiffness / self.mass * np.power(x, self.law.exponent)
        return np.asarray(f / (1.0 + self.law.dissipation * self.lag * f))

    def grid(self) -> Floats:
        """Penetrations to fit at, m: 0 and evenly in log up to the top."""
        return np.concatenate([[0.0], np.geomspace(self.low * 1e-3, self.top, _GRID)])


def band_of(target: Target, law: HuntCrossley, integrator: str) -> Band:
    """The band that a staggered contact has to serve: a target's impact speeds, and the penetrations
    that they reach.

    Without its loss the law goes deepest, to mass v²/2 = k xⁿ⁺¹/(n + 1); there are margins at both
    ends.
    integrator: its name; under Euler's kinds rates lag positions by half a step.
    """

    def deepest(speed: float) -> float:
        """Largest penetration at an impact speed (m/s) without loss, m."""
        n = law.exponent
        return float(((n + 1) * target.mass * speed**2 / (2 * law.stiffness)) ** (1 / (n + 1)))

    lag = target.timestep / 2
    if integrator == "RK4":
        lag = 0.0
    return Band(
        law=law,
        mass=target.mass,
        speeds=np.geomspace(target.speed_min, target.speed_max, _SPEEDS),
        low=0.9 * deepest(target.speed_min),
        top=_HEADROOM * deepest(target.speed_max),
        lag=lag,
    )


def _rising(base: float, end: float, power: float, highest: float, start: float) -> Damper:
    """A damper whose impedance rises from a penetration `base` to `end`, m, as a power of the depth.

    power: of the rise.
    highest: impedance at `end`.
    No impedance is below MIN_IMPEDANCE, so a damper is felt as soon as it acts, as much as at the
    depth at which the power reaches that value. It starts later than `base` by `start` times that
    depth.
    """
    # `start` times the depth at which the power reaches the least impedance, m.
    later = start * (MIN_IMPEDANCE / highest) ** (1.0 / max(power, 1.0)) * (end - base)
    onset = base + later
    # A midpoint of nearly 1 makes of MuJoCo's sigmoid a plain power.
    return Damper(onset, (MIN_IMPEDANCE, highest, end - onset, MAX_IMPEDANCE, power))


def _layouts(band: Band, highest: float) -> list[list[Damper]]:
    """Sets of dampers to choose from: one stretch from touch to top; from a `highest` of 0.5 on also
    two stretches, which wide bands of speed need. One empty set for a law without damping.

    highest: impedance of the strongest damper.
    Onsets and powers are what makes the fit good over n = 1 ... 2, any a and band; all else is
    fitted.
    """
    if band.law.dissipation == 0.0:
        return [[]]
    n = band.law.exponent
    top = band.top
    # Beside each damper that rises as x^n a weak straight one, which begins at twice the depth (over
    # the stretch) at which the other one leaves the least impedance.
    late = 2.0 * (MIN_IMPEDANCE / highest) ** (1.0 / n)
    power = 1.003 * n
    one = [
        _rising(base=0.0, end=top, power=power, highest=highest, start=0.45),
        _straight(onset=late * top, end=top, highest=0.01),
    ]
    # Two stretches weigh as much as both together: too much where the impedance is held low.
    if highest < 0.5:
        return [one]
    split = float(np.sqrt(band.low * top))
    late_low = 2.0 * (MIN_IMPEDANCE / 0.2) ** (1.0 / n)
    two = [
        _rising(base=0.0, end=split, power=power, highest=0.2, start=0.45),
        _straight(onset=late_low * split, end=split, highest=0.005),
        _straight(onset=split, end=top, highest=0.1),
        _rising(base=split, end=top, power=power, highest=highest, start=0.45),
    ]
    return [one, two]


def _straight(onset: float, end: float, highest: float) -> Damper:
    """A damper whose impedance rises in a straight line from `onset` to `end`, m, to `highest`."""
    return Damper(onset, (MIN_IMPEDANCE, highest, end - onset, 0.5, 1.0))


def knots_of(band: Band, dampers: Sequence[Damper], misfit: float) -> Floats:
    """Choose the penetrations at which the springs start, m, rising from 0: so close that straight
    lines between them are near the curve of the force that the springs have to give.

    dampers: that act beside the springs; their weights add to what the springs have to give.
    misfit: that is allowed, relative to the curve, and below the band's lowest penetration to the
    curve there.
    A straight line over a width w differs from a curve of second derivative c by c w²/8 at most:
    hence the density of knots.
    """
    edges = np.geomspace(band.low * 1e-3, band.top * (1.0 - 1e-6), 3001)
    x = np.sqrt(edges[1:] * edges[:-1])

    def curve(at: Floats) -> Floats:
        """Acceleration that the springs have to give at penetrations, m: f (1 + Σ w), m/s², same shape."""
        return np.asarray(band.elastic(at) * (1.0 + sum(d.weight(at) for d in dampers)))

    # The second derivative, by central differences.
    nudge = 1e-3
    bend = (curve(x * (1 + nudge)) - 2 * curve(x) + curve(x * (1 - nudge))) / (nudge * x) ** 2
    # Knots a metre, and how many there are up to each edge.
    density = np.sqrt(np.abs(bend) / (8 * misfit * curve(np.maximum(x, band.low))))
    knots_until = np.concatenate([[0.0], np.cumsum(density * np.diff(edges))])
    count = max(1, int(np.ceil(knots_until[-1])))
    later = np.interp(np.arange(1, count), knots_until, edges)
    return np.asarray(np.concatenate([[0.0], later]))


@dataclass(frozen=True)
class _Fit:
    """Springs that start at knots (m), and dampers, with S (1/s²) and D (1/s) of each."""

    knots: Floats
    dampers: Sequence[Damper]
    stiffness: Floats
    damping: Floats
    misfit: float


@dataclass(frozen=True)
class _Shares:
    """Parts of the acceleration apart that each row adds at n penetrations, for a strength of 1.

    springs: acceleration of each, m/s², with S = 1/s², (n, springs).
    dampings: acceleration over rate of each damper, 1/s, with D = 1/s, (n, dampers).
    offset: acceleration that the springs give less in all than their strengths say, m/s², (n,).
    """

    springs: Floats
    dampings: Floats
    offset: Floats

    @classmethod
    def of(cls, band: Band, dampers: Sequence[Damper], knots: Floats) -> Self:
        """Shares at the penetrations of the band's grid.

        knots: onsets of the springs, m, rising from 0. Rows of weights w give together Σ w a_ref/(1 +
        Σ w). A spring acts from where it asks for more than the others give, so its line starts at
        their acceleration there.
        """
        x = band.grid()
        # (n, springs): the springs that a penetration has passed.
        behind = x[:, None] > knots
        # Weights w of the dampers, (n, dampers), and 1/(1 + Σ w) over all rows, (n,).
        weights = np.array([d.weight(x) for d in dampers]).reshape(len(dampers), len(x)).T
        share = 1.0 / (1.0 + weights.sum(axis=1) + _SPRING_WEIGHT * behind.sum(axis=1))
        depth = np.maximum(0.0, x[:, None] - knots)
        return cls(
            springs=_SPRING_WEIGHT / MIN_IMPEDANCE * depth * share[:, None],
            dampings=weights / np.array([d.solimp[1] for d in dampers]) * share[:, None],
            offset=_SPRING_WEIGHT * (behind * band.elastic(knots)).sum(axis=1) * share,
        )


def _fit(band: Band, dampers: Sequence[Damper], knots: Floats, sensitivity: Floats) -> _Fit:
    """Fit the strengths of springs and dampers together, so that the force is near the law's at every
    penetration, and e nearer still.

    dampers: with their onsets and impedances; how strong each is, is fitted.
    knots: onsets of the springs, m, (k,).
    sensitivity: of e at each speed of the band to the force at each penetration of its grid,
    (speeds, grid), 1/(N s/m).

    One non-negative least-squares problem: a row for the elastic force and one for the damping at
    each penetration, and one for e at each speed; a column for each spring and each damper.
    """
    # Penetrations, m, (grid,); the law's damping over elastic force, s/m; its elastic force there,
    # per unit mass, m/s².
    x = band.grid()
    a = band.law.dissipation
    f = band.elastic(x)
    shares = _Shares.of(band, dampers, knots)
    # Errors of the force are relative, but below the band's lowest penetration absolute.
    scale = np.maximum(f, band.elastic(np.asarray(band.low)))
    span = max(np.log(band.top / band.low), 0.5)
    # Each penetration counts by its share of the band's logarithm.
    share_of_band = np.sqrt(np.gradient(x) / np.maximum(x, band.low) / span)
    # From an acceleration, from a damping and from both to units of misfit.
    force = (share_of_band / scale / _FORCE_SCALE)[:, None]
    rate = force * min(band.speeds[-1], 1.0 / a) if a else force
    to_e = sensitivity * band.mass / _RESTITUTION_SCALE / np.sqrt(len(sensitivity))
    # Rows of the problem: elastic force, damping, restitution. Columns: springs, dampers.
    no_damper = np.zeros((len(x), len(dampers)))
    no_spring = np.zeros((len(x), len(knots)))
    left = np.block(
        [
            [shares.springs * force, no_damper],
            [no_spring, shares.dampings * rate],
            [-a * to_e @ shares.springs, to_e @ shares.dampings],
        ]
    )
    elastic = (f - shares.offset) * force[:, 0]
    right = np.concatenate([elastic, a * f * rate[:, 0], a * to_e @ shares.offset])
    solution, misfit = nonnegative_fit(left, right)
    stiffness, dampings = np.split(solution, [len(knots)])
    return _Fit(knots, dampers, stiffness, dampings, misfit)


def _fit_pruned(band: Band, dampers: Sequence[Damper], misfit: float, sensitivity: Floats) -> _Fit:
    """Fit springs and dampers, and again without those that the fit does not use, until all are used:
    an idle row would still weigh on the others.

    dampers: to choose from.
    misfit: that is allowed of the springs' straight lines, relative.
    sensitivity: of e at each speed of the band to the force at each penetration, (speeds, grid),
    1/(N s/m).
    """
    knots = knots_of(band, dampers, misfit)
    while True:
        fit = _fit(band, dampers, knots, sensitivity)
        spacing = np.gradient(np.append(knots, band.top))[:-1]
        # Springs so weak that they would start more than half a spacing before their knot.
        late = band.elastic(knots) * MIN_IMPEDANCE > 0.5 * fit.stiffness * spacing
        late[0] = False
        if fit.damping.all() and not late.any():
            return fit
        dampers = [damper for damper, D in zip(dampers, fit.damping, strict=True) if D > 0.0]
        knots = knots[~late]


def _rows(band: Band, fit: _Fit) -> list[ConstraintRow]:
    """Contact rows of a fit in SI units: springs from the shallowest on, then dampers; those without
    strength are left out.

    A spring only acts once it asks for as much as the others give: so it starts that much before
    its knot.
    band: the law, and the impact speeds that it is matched at.
    """
    rows = []
    for knot, S in zip(fit.knots, fit.stiffness, strict=True):
        if S > 0.0:
            early = float(band.elastic(knot)) * MIN_IMPEDANCE / S  # m
            onset = _short(knot - early)
            rows.append(ConstraintRow.direct(_short(S), 0.0, SPRING_SOLIMP, onset=onset))
    # The law at the top of the band: speed, m/s; damping over elastic force, s/m; the latter, m/s².
    fastest = float(band.speeds[-1])
    a = band.law.dissipation
    f = float(band.elastic(np.asarray(band.top)))
    for damper, D in zip(fit.dampers, fit.damping, strict=True):
        highest = damper.solimp[1]
        # Twice the largest pull of this row on the way out.
        pull = highest / (1 - highest) * (D / highest * fastest + f * (1 + a * fastest))
        adhesion = _short(2 * band.mass * pull)
        rows.append(
            ConstraintRow.direct(
                0.0, _short(D), damper.solimp, _short(damper.onset), adhesion=adhesion
            )
        )
    return rows


def _short(number: float) -> float:
    """Nine digits: a fit knows no more, and processors differ in the rest."""
    return float(f"{number:.9g}")


def staggered(
    target: Target, integrator: str = "Euler", misfit: float = 0.004, impedance: float = 0.5
) -> dict[str, Any]:
    """Options of a setting, by name: eq. (16) as staggered springs and dampers, in closed form.

    integrator: that the options name, and that the rows are for.
    misfit: how far the springs' straight lines may be off k xⁿ, relative.
    impedance: the highest of the dampers.
    Raises SettingError for an impedance outside 1e-3 ... 0.5.
    """
    return rows_options(integrator, *staggered_rows(target, integrator, misfit, impedance))


def staggered_rows(
    target: Target, integrator: str = "Euler", misfit: float = 0.004, impedance: float = 0.5
) -> list[ConstraintRow]:
    """The rows of eq. (16), one <pair> each: springs from the shallowest on, then dampers.

    integrator: under Euler's kinds rates lag positions by half a step, which the rows make up for.
    misfit: how far the springs' straight lines may be off k x^n, relative; fewer pairs for more.
    impedance: the highest of the dampers; lower, such as 0.05, for a body that several others press
    at once, as all rows share in it, at the price of a little more damping at touch.
    Raises SettingError for an impedance outside 1e-3 ... 0.5.
    """
    if not 10 * MIN_IMPEDANCE <= impedance <= 0.5:
        raise SettingError("impedance", f"{impedance!r}", f"{10 * MIN_IMPEDANCE:g} ... 0.5")
    law = resolvable_law(target)
    band = band_of(target, law, integrator)
    # Of e at each speed to the force at each penetration; no rows for a law without loss.
    sensitivity = np.zeros((0, _GRID + 1))
    if law.dissipation > 0.0:
        x = band.grid()
        at_speeds = [restitution_sensitivity(law, band.mass, float(v), x) for v in band.speeds]
        sensitivity = np.array(at_speeds)
    layouts = _layouts(band, impedance)
    fits = [_fit_pruned(band, dampers, misfit, sensitivity) for dampers in layouts]

    def cost(fit: _Fit) -> float:
        # A second stretch of dampers costs pairs: it has to pay.
        if len(fit.dampers) > 2:
            return 1.5 * fit.misfit
        return fit.misfit

    return _rows(band, min(fits, key=cost))


STAGGERED = Recipe(
    "mujoco",
    "staggered",
    Role.LAW_AND_LOOP,
    staggered,
    "Springs that start at staggered depths and dampers, one pair each: the law, force loop included.",
    (
        "Use the integrator Euler, implicit, implicitfast or RK4; discrete is refused.",
        "The numbers are per unit effective mass: k is divided by the effective mass of the two bodies.",
        "Impacts faster than the band do not follow the law: the dampers reach their limit.",
        "If the law's shortest contact lasts fewer than 10 steps, hcbench softens the springs to 24 steps.",
        "Penetration is then larger. Without gravity e and the shape of the loop stay the law's.",
        "A steady load meets up to twice the stiffness: the dampers carry half of it.",
        "With the law's own stiffness, a body rests about as deep as by the law, without drift.",
        "Its oscillations then die out at the law's rate, (3/4) α g.",
        SOFTENED,
        WEAK_FRICTION,
        "The pairs are frictionless (condim 1). The dampers need MuJoCo 3.11 or later (pair adhesion).",
    ),
    kinds=("law",),
    instead="`two-pair` or `soft`",
    steps_min_with_gravity=STEPS_OF_A_LOOP,
    integrators=DAMPED_STEP,
    forms=("plane",),
)
