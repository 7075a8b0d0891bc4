"""Fits rows that only push to eq. (16): what a contact without adhesion, or a tendon's limit, can do.

A row that only pushes cannot be a damper on the way out, unless its own spring outweighs it: each damper row
has a spring of its own and rises, as a step of its impedance, where the ones before it have settled; springs
that start at staggered depths make up the rest. Given which rows act where, the force is linear in the rows'
numbers: a Levenberg-Marquardt iteration of non-negative least squares follows the rows that act.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import nnls

from hcbench.engines.mujoco.rows import MIN_IMPEDANCE, ConstraintRow, impedance, restitution
from hcbench.laws import closed_form

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.mujoco.rows import Solimp
    from hcbench.impact import Floats
    from hcbench.laws.force import HuntCrossley
    from hcbench.tune.search import EvaluationCount

_FORCE_SCALE, _RESTITUTION_SCALE = 1e-3, 2e-5  # one unit of misfit, relative and absolute
ITERATIONS, _GIVE_UP = 80, 1e6
_LOG_USUAL = 2.5  # log of highest over lowest penetration where a start has the dampers it says
_FLAT: Solimp = (MIN_IMPEDANCE, MIN_IMPEDANCE, 1.0, 0.5, 1.0)


@dataclass(frozen=True)
class Samples:
    """The law along its own loops, both branches; shape (n,), per unit mass, SI.

    v: the rate that the engine uses there. a: the acceleration wanted. scale: makes a misfit in a one of
    _FORCE_SCALE. kernel: (speeds, n), misfit in a to misfit in e over _RESTITUTION_SCALE; both as mean
    squares. excess: (speeds,), what e turned out to be above the wanted one, to be aimed below.
    """

    x: Floats
    v: Floats
    a: Floats
    scale: Floats
    kernel: Floats
    speeds: Floats
    excess: Floats

    def misfit(self, a: Floats) -> Floats:
        """Misfits of an acceleration (n,) or of columns (n, k): force first, then restitution."""
        return np.concatenate([(self.scale * a.T).T, np.einsum("sn,n...->s...", self.kernel, a)])

    def wanted(self) -> Floats:
        """What misfit(a) should be."""
        wanted = self.misfit(self.a)
        wanted[-len(self.speeds) :] -= self.excess / _RESTITUTION_SCALE / np.sqrt(len(self.speeds))
        return wanted


def sample(law: HuntCrossley, mass: float, speeds: Floats, points: int, lag: float) -> Samples:
    """Loops at speeds (m/s), so many points a branch; lag: of the engine's rates, s."""
    angle = (np.arange(points) + 0.5) / points * np.pi / 2
    columns: list[tuple[Floats, Floats, Floats, Floats]] = []
    unit = _RESTITUTION_SCALE * np.sqrt(len(speeds))
    kernel = np.zeros((len(speeds), 2 * points * len(speeds)))
    for i, v_i in enumerate(speeds):
        deepest = float(closed_form.penetration_max(law, mass, v_i))
        x, dx = deepest * np.sin(angle), deepest * np.cos(angle) * np.pi / 2 / points
        v_in = closed_form.rate_at(law, mass, float(v_i), x, "approach")
        v_out = closed_form.rate_at(law, mass, float(v_i), x, "rebound")
        scale = (
            np.sqrt(dx / (2 * deepest * len(speeds)))
            / float(closed_form.force_max(law, mass, v_i))
            * mass
            / _FORCE_SCALE
        )
        v_o = float(closed_form.restitution(law.alpha, v_i)) * v_i
        # δe of kernel.py, for a misfit that differs between the branches.
        answer = -(1 - law.dissipation * v_o) / (v_o * v_i)
        for v, sign in ((v_in, 1.0), (v_out, -1.0)):
            a = law.force(x, v) / mass
            place = slice(len(columns) * points, (len(columns) + 1) * points)
            kernel[i, place] = sign * answer * dx / (1 + law.dissipation * v) / unit
            columns.append((x, v + lag * a, a, scale))
    x, v, a, scale = (np.concatenate(column) for column in zip(*columns, strict=True))
    return Samples(x, v, a, scale, kernel, speeds, np.zeros(len(speeds)))


@dataclass(frozen=True)
class Start:
    """Where a fit begins.

    dampers: how many, in a usual band. power, highest: of their impedance. from_depth: the share of its width
    from which a damper has to push. lowest: width of the first over the band's lowest penetration.
    """

    dampers: int
    power: float
    highest: float
    from_depth: float
    lowest: float


@dataclass(frozen=True)
class Pushers:
    """Rows: onsets (m), solimps, and solref's stiffness S (1/s²) and damping D (1/s); misfit, in units."""

    onsets: Floats
    solimps: list[Solimp]
    stiffness: Floats
    damping: Floats
    misfit: float = np.inf

    def rows(self) -> list[ConstraintRow]:
        """As rows of contact, without those that do nothing."""
        numbers = zip(self.stiffness, self.damping, self.solimps, self.onsets, strict=True)
        return [ConstraintRow.direct(*row) for row in numbers if row[0] > 0 or row[1] > 0]


@dataclass(frozen=True)
class _Terms:
    """Of a_ref = S lever + D rate, and weights; (n, rows) each."""

    lever: Floats
    rate: Floats
    weights: Floats

    def wants(self, stiffness: Floats, damping: Floats) -> Floats:
        return self.lever * stiffness + self.rate * damping


def _terms(x: Floats, v: Floats, onsets: Floats, solimps: Sequence[Solimp]) -> _Terms:
    depth = np.maximum(0.0, x[:, None] - onsets)
    highest = np.array([solimp[1] for solimp in solimps])
    d = np.array([impedance(s, r) for s, r in zip(solimps, depth.T, strict=True)]).T
    weights = np.where(depth > 0, d / (1 - d), 0.0)
    return _Terms(d / highest**2 * depth, v[:, None] / highest, weights)


def begin(
    samples: Samples,
    law: HuntCrossley,
    mass: float,
    span: tuple[float, float],
    knots: Floats,
    fastest: float,
    start: Start,
) -> Pushers:
    """Dampers that add up to the law's damping on the way in, with springs that let them act on the way out.

    span: the lowest and the highest penetration, m; knots: where springs start, m; fastest: m/s.
    """
    low, top = span
    count = max(start.dampers, round(start.dampers * float(np.log(top / low)) / _LOG_USUAL))
    widths = np.geomspace(low * start.lowest, 1.6 * top, count)
    solimps: list[Solimp] = [(MIN_IMPEDANCE, start.highest, float(w), 0.5, start.power) for w in widths]
    x = np.concatenate([np.linspace(0.0, low, 40)[1:], np.geomspace(low, top, 120)])
    f = law.stiffness / mass * x**law.exponent
    scale = np.maximum(f, law.stiffness / mass * low**law.exponent)
    terms = _terms(x, np.ones_like(x), np.zeros(len(widths)), solimps)
    D, _ = nnls(terms.weights * terms.rate / scale[:, None], law.dissipation * f / scale, maxiter=10_000)
    D = np.maximum(D, 1e-3 * D.max() * widths / top)
    depth = np.minimum(start.from_depth * widths, top)
    speed = fastest * np.sqrt(np.maximum(0.0, 1 - (depth / top) ** (law.exponent + 1)))
    levers = np.array([impedance(s, r) * r / s[1] ** 2 for s, r in zip(solimps, depth, strict=True)])
    S = (D / start.highest * speed + law.stiffness / mass * depth**law.exponent) / levers
    elastic = (terms.weights * terms.lever * S).sum(axis=1)
    S = S * min(1.0, 0.95 * float((f * (1 + terms.weights.sum(axis=1)) / elastic).min()))
    springs = np.zeros(len(knots))
    rows = Pushers(
        np.concatenate([knots, np.zeros(len(widths))]),
        [_FLAT] * len(knots) + solimps,
        np.concatenate([springs, S]),
        np.concatenate([springs, D]),
    )
    return _fit_springs(samples, rows, len(knots))


def _fit_springs(samples: Samples, rows: Pushers, springs: int) -> Pushers:
    terms = _terms(samples.x, samples.v, rows.onsets, rows.solimps)
    wants = terms.wants(rows.stiffness, rows.damping)
    acts = terms.weights * (wants > samples.a[:, None])
    acts[:, :springs] = terms.weights[:, :springs]
    rest = samples.a * (1 + acts.sum(axis=1)) - (acts * wants)[:, springs:].sum(axis=1)
    left = samples.misfit((terms.weights * terms.lever)[:, :springs])
    norms = np.linalg.norm(left, axis=0)
    norms[norms == 0.0] = 1.0  # starts deeper than any sample
    solution, _ = nnls(left / norms, samples.misfit(rest), maxiter=10_000)
    stiffness = rows.stiffness.copy()
    stiffness[:springs] = solution / norms
    return replace(rows, stiffness=stiffness)


def refine(samples: Samples, rows: Pushers, evaluations: EvaluationCount) -> Pushers:
    """The same rows with springs and dampers that fit better; keeps the best when it does not converge.

    Counts ITERATIONS, whether it needs them or not.
    """
    terms = _terms(samples.x, samples.v, rows.onsets, rows.solimps)
    damps, count = rows.damping > 0.0, len(rows.onsets)

    def solve(S: Floats, D: Floats) -> tuple[Floats, float]:
        """The weights of the rows that act, and the misfit."""
        wants, acts = terms.wants(S, D), terms.weights
        while True:
            a = (acts * wants).sum(axis=1) / (1 + acts.sum(axis=1))
            pulls = (acts > 0) & (wants < a[:, None])
            if not pulls.any():
                return acts, float(np.linalg.norm(samples.misfit(a) - samples.wanted()))
            acts = np.where(pulls, 0.0, acts)

    S, D, wanted = rows.stiffness, rows.damping, samples.wanted()
    acts, misfit = solve(S, D)
    caution, left = 0.1, ITERATIONS
    while left and caution < _GIVE_UP:
        columns = np.concatenate([acts * terms.lever, (acts * terms.rate)[:, damps]], axis=1)
        now = np.concatenate([S, D[damps]])
        least = [np.full(count, np.median(S[S > 0])), np.full(int(damps.sum()), np.median(D[damps]))]
        unit = np.maximum(now, 1e-3 * np.concatenate(least))
        jacobian = samples.misfit(columns / (1 + acts.sum(axis=1))[:, None]) * unit
        # Sums in a fixed order: the answer must not depend on a linear algebra library's threads.
        normal = np.einsum("ni,nj->ij", jacobian, jacobian)
        right = np.einsum("ni,n->i", jacobian, wanted)
        while left and caution < _GIVE_UP:
            left -= 1
            evaluations.add(1)
            damping = (caution * misfit) ** 2 / len(now)
            root = np.linalg.cholesky(normal + (damping + 1e-12 * np.trace(normal)) * np.eye(len(now)))
            step, _ = nnls(root.T, np.linalg.solve(root, right + damping * now / unit), maxiter=10_000)
            new_S, new_D = step[:count] * unit[:count], D.copy()
            new_D[damps] = step[count:] * unit[count:]
            new_acts, new_misfit = solve(new_S, new_D)
            if new_misfit < misfit * (1 - 1e-3):
                S, D, acts, misfit, caution = new_S, new_D, new_acts, new_misfit, max(caution / 3, 1e-4)
                break
            caution *= 3
    evaluations.add(left)
    return Pushers(rows.onsets, rows.solimps, S, D, misfit)


def aim(
    samples: Samples,
    rows: Pushers,
    law: HuntCrossley,
    timestep: float,
    duration: float,
    evaluations: EvaluationCount,
) -> Pushers:
    """Once more, with the restitution that the rows turn out to have, by the model of the engine's step."""
    phases = 4
    e = restitution(rows.rows(), timestep, samples.speeds, phases, duration).mean(axis=1)
    off = samples.excess + e - closed_form.restitution(law.alpha, samples.speeds)
    return refine(replace(samples, excess=off), rows, evaluations) if np.isfinite(off).all() else rows
