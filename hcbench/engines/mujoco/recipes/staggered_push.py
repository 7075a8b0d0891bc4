"""MuJoCo: eq. (16) with rows that only push, for true cups (tendon limits) and for MuJoCo before 3.11.

A row that only pushes cannot be a damper on the way out, unless its own spring outweighs it: each
damper row has a spring of its own and rises, as a step of its impedance, where the ones before it
have settled; springs that start at staggered depths make up the rest. Given which rows act where,
the force is linear in the rows' stiffness and damping: a Levenberg-Marquardt iteration of
non-negative least squares finds them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.recipes.common import (
    DAMPED_STEP,
    SOFTENED,
    SPRING_SOLIMP,
    nonnegative_fit,
    rows_options,
)
from hcbench.engines.mujoco.recipes.staggered import band_of, knots_of
from hcbench.engines.mujoco.scene.rows import (
    MIN_IMPEDANCE,
    ConstraintRow,
    combine,
    impedance,
    restitution,
)
from hcbench.laws import closed_form
from hcbench.recipes.recipe import Recipe, Role, Search
from hcbench.recipes.target import Target, resolvable_law
from hcbench.system.errors import SettingError
from hcbench.terms.resolution import STEPS_OF_A_LOOP

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.mujoco.recipes.staggered import Band
    from hcbench.engines.mujoco.scene.rows import Solimp
    from hcbench.terms.impact import Floats

# One unit of misfit: relative for a force, absolute for e.
_FORCE_SCALE = 1e-3
_RESTITUTION_SCALE = 2e-5
# Steps of one fit, at most.
ITERATIONS = 80
# Damping of the first iteration, relative to the misfit.
_CAUTION = 0.1
# Least damping of an iteration.
_LEAST_CAUTION = 1e-4
# Damping at which the iteration gives up.
_MOST_CAUTION = 1e6
# Least relative fall of the misfit for a step to be taken.
_PROGRESS = 1e-3
# Log of highest over lowest penetration for which a guess names its number of dampers.
_USUAL_LOG_BAND = 2.5


@dataclass(frozen=True)
class Samples:
    """The law along its own loops, both branches; shape (n,), per unit mass, SI.

    v: the rate that the engine uses there.
    a: the acceleration to have.
    scale: makes an error in a one of _FORCE_SCALE.
    sensitivity: (speeds, n), error in a to error in e over _RESTITUTION_SCALE; both as mean
    squares.
    bias: (speeds,), what e turned out to be too high, to be aimed below.
    """

    x: Floats
    v: Floats
    a: Floats
    scale: Floats
    sensitivity: Floats
    speeds: Floats
    bias: Floats | float = 0.0

    def scaled(self, a: Floats) -> Floats:
        """An acceleration (n,), or columns (n, k), in units of misfit: n of force, then one of
        restitution for each speed.
        """
        return np.concatenate(
            [(self.scale * a.T).T, np.einsum("sn,n...->s...", self.sensitivity, a)]
        )

    def goal(self) -> Floats:
        """The values that `scaled` should have."""
        goal = self.scaled(self.a)
        goal[-len(self.speeds) :] -= self.bias / _RESTITUTION_SCALE / np.sqrt(len(self.speeds))
        return goal


def sample(band: Band, speeds: Floats, points: int) -> Samples:
    """Samples of the law along its loops of force over penetration, one loop for each impact speed:
    first its way in, then its way out.

    band: the law and the mass.
    speeds: m/s.
    points: of each way; evenly in the angle of a sine, so dense where the body turns round.
    """
    law = band.law
    mass = band.mass
    angle = (np.arange(points) + 0.5) / points * np.pi / 2
    # Of each branch: penetrations, rates, accelerations, and their scales, (points,) each.
    columns: list[tuple[Floats, Floats, Floats, Floats]] = []
    unit = _RESTITUTION_SCALE * np.sqrt(len(speeds))
    sensitivity = np.zeros((len(speeds), 2 * points * len(speeds)))
    for i, v_i in enumerate(speeds):
        deepest = float(closed_form.penetration_max(law, mass, v_i))
        x = deepest * np.sin(angle)
        dx = deepest * np.cos(angle) * np.pi / 2 / points
        v_in = closed_form.rate_at(law, mass, float(v_i), x, "approach")
        v_out = closed_form.rate_at(law, mass, float(v_i), x, "rebound")
        largest = float(closed_form.force_max(law, mass, v_i))
        # A point counts by the depth that it stands for, so that the squares add up to a mean.
        scale = np.sqrt(dx / (2 * deepest * len(speeds))) / largest * mass / _FORCE_SCALE
        v_o = float(closed_form.restitution(law.alpha, v_i)) * v_i
        # δe as in `restitution_sensitivity`, for an error that differs between the branches.
        factor = -(1 - law.dissipation * v_o) / (v_o * v_i)
        for v, sign in ((v_in, 1.0), (v_out, -1.0)):
            a = law.force(x, v) / mass
            # Samples of the branches until now.
            start = len(columns) * points
            of_branch = sign * factor * dx / (1 + law.dissipation * v) / unit
            sensitivity[i, start : start + points] = of_branch
            # The engine uses the rate of half a step ago, before a acted on it.
            columns.append((x, v + band.lag * a, a, scale))
    x, v, a, scale = (np.concatenate(column) for column in zip(*columns, strict=True))
    return Samples(x=x, v=v, a=a, scale=scale, sensitivity=sensitivity, speeds=speeds)


@dataclass(frozen=True)
class InitialGuess:
    """Start of a fit.

    dampers: how many, in a usual band.
    power, highest: of their impedance.
    from_depth: the share of its width from which a damper has to push.
    lowest: width of the first over the band's lowest penetration.
    """

    dampers: int
    power: float
    highest: float
    from_depth: float
    lowest: float

    def solimps(self, low: float, top: float) -> list[Solimp]:
        """The solimps of the dampers, for a band of penetrations, m."""
        # A band wider than usual needs more dampers, to lie as close.
        share = float(np.log(top / low)) / _USUAL_LOG_BAND
        count = max(self.dampers, round(self.dampers * share))
        widths = np.geomspace(low * self.lowest, 1.6 * top, count)
        return [(MIN_IMPEDANCE, self.highest, float(width), 0.5, self.power) for width in widths]


@dataclass(frozen=True)
class PushingRows:
    """Rows that only push: onsets (m), solimps, and solref's stiffness S (1/s²) and damping D
    (1/s), (rows,) each.

    misfit: root of the summed squares, in units of misfit; infinite before any fit.
    """

    onsets: Floats
    solimps: Sequence[Solimp]
    stiffness: Floats
    damping: Floats
    misfit: float = np.inf

    def rows(self) -> list[ConstraintRow]:
        """Rows of contact, without those that do nothing."""
        numbers = zip(self.stiffness, self.damping, self.solimps, self.onsets, strict=True)
        return [ConstraintRow.direct(*row) for row in numbers if row[0] > 0 or row[1] > 0]


@dataclass(frozen=True)
class _Terms:
    """Terms of rows at samples, (n, rows) each: a_ref = lever S + rate D, and weights."""

    lever: Floats
    rate: Floats
    weights: Floats

    @classmethod
    def of(cls, x: Floats, v: Floats, onsets: Floats, solimps: Sequence[Solimp]) -> _Terms:
        """Terms of rows with these onsets, m, at n penetrations x, m, and rates v, m/s."""
        depth = np.maximum(0.0, x[:, None] - onsets)
        highest = np.array([solimp[1] for solimp in solimps])
        d = np.array([impedance(*column) for column in zip(solimps, depth.T, strict=True)]).T
        weights = np.where(depth > 0, d / (1 - d), 0.0)
        return cls(d / highest**2 * depth, v[:, None] / highest, weights)

    def reference(self, stiffness: Floats, damping: Floats) -> Floats:
        return self.lever * stiffness + self.rate * damping


def initial_rows(samples: Samples, band: Band, knots: Floats, guess: InitialGuess) -> PushingRows:
    """Rows to start a fit from: dampers that add up to the law's damping on the way in, each with a
    spring that lets it act on the way out; and further springs that make up the rest.

    samples: of the law's force, to which the further springs are fitted last.
    band: of depths that the rows serve.
    knots: where the further springs start, m; they come first in the rows.
    guess: how many dampers, and their impedances.
    """
    law = band.law
    low = band.low
    top = band.top
    solimps = guess.solimps(low, top)
    widths = np.array([solimp[2] for solimp in solimps])
    # Penetrations, m, (n,); the law's elastic force there, per unit mass; and the dampers' terms.
    x = np.concatenate([np.linspace(0.0, low, 40)[1:], np.geomspace(low, top, 120)])
    force = law.stiffness / band.mass * x**law.exponent
    terms = _Terms.of(x, np.ones_like(x), np.zeros(len(widths)), solimps)
    damping = _damping_on_the_way_in(band, terms, force, widths)
    stiffness = _springs_of_dampers(band, guess, solimps, damping)
    # Together these springs stay below the law's own force, so that the others have a part of it.
    elastic = (terms.weights * terms.lever * stiffness).sum(axis=1)
    room = float((force * (1 + terms.weights.sum(axis=1)) / elastic).min())
    stiffness = stiffness * min(1.0, 0.95 * room)
    none_yet = np.zeros(len(knots))
    rows = PushingRows(
        np.concatenate([knots, np.zeros(len(widths))]),
        [SPRING_SOLIMP] * len(knots) + solimps,
        np.concatenate([none_yet, stiffness]),
        np.concatenate([none_yet, damping]),
    )
    return _fit_springs(samples, rows, len(knots))


def _damping_on_the_way_in(band: Band, terms: _Terms, force: Floats, widths: Floats) -> Floats:
    """Damping D of each damper, 1/s, (dampers,), with which they are together nearest to the law's
    damping, a f(x) v.

    band: the law, the mass and the depths to match.
    terms: of the dampers at n penetrations and a rate of 1 m/s.
    force: elastic force f of the law there, per unit mass, m/s², (n,).
    widths: of the dampers' impedances, m, (dampers,).
    """
    # SciPy's optimisation is slow to import.
    from scipy.optimize import nnls

    law = band.law
    # Relative errors count, but below the band's lowest penetration absolute ones.
    scale = np.maximum(force, law.stiffness / band.mass * band.low**law.exponent)
    columns = terms.weights * terms.rate / scale[:, None]
    D, _ = nnls(columns, law.dissipation * force / scale, maxiter=10_000)
    # No damper is left out at the start: the fit could not revive it.
    return np.asarray(np.maximum(D, 1e-3 * D.max() * widths / band.top))


def _springs_of_dampers(
    band: Band, guess: InitialGuess, solimps: Sequence[Solimp], damping: Floats
) -> Floats:
    """Stiffness S of each damper row, 1/s², (dampers,): with it the row's own spring outweighs its
    damping on the way out of the fastest impact, at depths beyond `guess.from_depth` of its width.

    band: the law, the mass and the depths to match.
    solimps: of the dampers.
    damping: D of each, 1/s, (dampers,).
    """
    law = band.law
    widths = np.array([solimp[2] for solimp in solimps])
    depth = np.minimum(guess.from_depth * widths, band.top)
    # Without loss: the energy that is left at that depth.
    speed = band.speeds[-1] * np.sqrt(np.maximum(0.0, 1 - (depth / band.top) ** (law.exponent + 1)))
    levers = np.zeros(len(widths))
    for i, solimp in enumerate(solimps):
        levers[i] = impedance(solimp, depth[i]) * depth[i] / solimp[1] ** 2
    elastic = law.stiffness / band.mass * depth**law.exponent
    return np.asarray((damping / guess.highest * speed + elastic) / levers)


def _fit_springs(samples: Samples, rows: PushingRows, springs: int) -> PushingRows:
    """Fit the stiffness S, 1/s², of the first rows, which are springs, to the samples; the other rows
    stay as they are.

    springs: how many.
    Rows of weights w and reference accelerations r give a (1 + Σ w) = Σ w r, which is linear in S:
    the springs have no damping. Which of the other rows act is taken from the law's own
    acceleration; the springs are taken to act from their onsets on.
    """
    terms = _Terms.of(samples.x, samples.v, rows.onsets, rows.solimps)
    reference = terms.reference(rows.stiffness, rows.damping)
    # Weights of the rows that act at each sample, (n, rows), 0 for the others.
    acting = terms.weights * (reference > samples.a[:, None])
    acting[:, :springs] = terms.weights[:, :springs]
    # What is left for the springs, (n,).
    by_others = (acting * reference)[:, springs:].sum(axis=1)
    rest = samples.a * (1 + acting.sum(axis=1)) - by_others
    # A spring below all samples has a column of 0.
    columns = samples.scaled((terms.weights * terms.lever)[:, :springs])
    solution, _ = nonnegative_fit(columns, samples.scaled(rest))
    return replace(rows, stiffness=np.concatenate([solution, rows.stiffness[springs:]]))


class _LeastSquares:
    """The problem that `levenberg_marquardt` solves, in the parameters S of
    all rows and D of the dampers.

    start: these, S first, of the rows to begin with.
    dampers: mask of the rows that have a D.
    goal: values that `Samples.scaled` should have.
    """

    def __init__(self, samples: Samples, rows: PushingRows) -> None:
        self.samples = samples
        self.goal = samples.goal()
        self.terms = _Terms.of(samples.x, samples.v, rows.onsets, rows.solimps)
        self.dampers = rows.damping > 0.0
        self.start = np.concatenate([rows.stiffness, rows.damping[self.dampers]])

    def split(self, parameters: Floats) -> tuple[Floats, Floats]:
        """(S, D) of all rows."""
        count = len(self.dampers)
        damping = np.zeros(count)
        damping[self.dampers] = parameters[count:]
        return parameters[:count], damping

    def evaluate(self, parameters: Floats) -> tuple[Floats, float]:
        """(weights of the rows that act, misfit)."""
        reference = self.terms.reference(*self.split(parameters))
        a, weights = combine(reference, self.terms.weights, may_pull=False, axis=1)
        return weights, float(np.linalg.norm(self.samples.scaled(a) - self.goal))

    def linearised(self, parameters: Floats, weights: Floats) -> tuple[Floats, Floats, Floats]:
        """The linear problem around parameters: its normal matrix, (k, k), its right side, (k,), and
        the units, (k,), in which it has the k parameters.

        parameters: S of all rows, then D of the dampers, (k,).
        weights: of the rows at the samples, (n, rows), 0 for one that does not act.
        """
        S = parameters[: len(self.dampers)]
        D = parameters[len(self.dampers) :]
        # A parameter of 0 has a unit, too: a small share of a usual value.
        least = [np.full(len(S), np.median(S[S > 0])), np.full(len(D), np.median(D))]
        unit = np.maximum(parameters, 1e-3 * np.concatenate(least))
        columns = np.concatenate(
            [weights * self.terms.lever, (weights * self.terms.rate)[:, self.dampers]], axis=1
        )
        jacobian = self.samples.scaled(columns / (1 + weights.sum(axis=1))[:, None]) * unit
        # Sums in a fixed order: the answer must not depend on a linear algebra library's threads.
        normal = np.einsum("ni,nj->ij", jacobian, jacobian)
        return normal, np.einsum("ni,n->i", jacobian, self.goal), unit


def levenberg_marquardt(samples: Samples, rows: PushingRows, search: Search) -> PushingRows:
    """Fit the strengths S, 1/s², and D, 1/s, of rows to samples of the law, neither below 0, by
    Levenberg and Marquardt's method; the rows with the best after ITERATIONS, or when no step helps
    any more.

    rows: start; its onsets and impedances stay, and rows without a D get none.
    search: counts ITERATIONS, whether they are needed or not.
    """
    from scipy.optimize import nnls

    problem = _LeastSquares(samples, rows)
    parameters = problem.start
    caution = _CAUTION
    weights, misfit = problem.evaluate(parameters)
    normal, right, unit = problem.linearised(parameters, weights)
    for iteration in range(ITERATIONS):
        if caution >= _MOST_CAUTION:
            search.add(ITERATIONS - iteration)
            break
        search.add(1)
        # The damping holds the parameters near those of now; a little more keeps the matrix regular.
        damping = (caution * misfit) ** 2 / len(parameters)
        regular = damping + 1e-12 * np.trace(normal)
        root = np.linalg.cholesky(normal + regular * np.eye(len(parameters)))
        # Non-negative least squares of the Cholesky factor: damped normal equations with bounds.
        right_side = np.linalg.solve(root, right + damping * parameters / unit)
        trial = nnls(root.T, right_side, maxiter=10_000)[0] * unit
        trial_weights, trial_misfit = problem.evaluate(trial)
        # Taken, and the next step is bolder; or left, and the next one is shorter.
        if trial_misfit < misfit * (1 - _PROGRESS):
            parameters = trial
            misfit = trial_misfit
            caution = max(caution / 3, _LEAST_CAUTION)
            normal, right, unit = problem.linearised(parameters, trial_weights)
        else:
            caution *= 3
    return PushingRows(rows.onsets, rows.solimps, *problem.split(parameters), misfit)


# The best ones of many, tried over n, alpha and bands; dampers are for a
# band of penetrations of 11 to 1. Each has dampers, power, highest, from_depth, lowest.
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
    """Options of a setting, by name: eq. (16) by rows that never pull, springs from the shallowest
    on, then dampers.

    integrator: that the options name, and that the rows are for. The best of several starts, fitted
    again with what Euler's own steps add to e.
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
    # All guesses are first fitted at every third speed.
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
    # e of the rows in the engine's own steps, the mean over phases at each speed; s.
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
    """The error to raise for a target that rows without pull cannot follow, with the limits of what
    they can.
    """
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
