"""Data that a law does not fit: touches that stand out, outliers, and the test whether any law fits."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial.legendre import Legendre

from hcbench.fitting.estimate import fit_law
from hcbench.fitting.linear import coarse_grid, logsumexp, noise_prior, reduce, scatter_prior

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.linear import LawFit, Reduced
    from hcbench.fitting.which_law import CandidateLaw
    from hcbench.terms.impact import Floats

# Touches that do not go with the others: named, not dropped; and what another reading would be
# worth.

# Chance that good data have one touch flagged.
_CHANCE = 0.01
# Twice the ln of likelihood by which an error of measuring must lead, to be named.
_TIE = 1.0
# With fewer degrees of freedom no outlier can be told from the scatter.
_LEAST_FREE = 3


@dataclass(frozen=True, slots=True)
class Flag:
    """A touch that stands out from the others of its data.

    file, touch: which.
    what: "measured off" or "bounced off".
    size: how far, in SI or as a share of e.
    sigmas: how far from the others, in standard deviations with this touch left out.
    """

    file: str
    touch: str
    what: str
    size: float
    sigmas: float


def flagged_touches(fit: LawFit, sets: Sequence[Dataset]) -> Iterator[Flag]:
    """Flag touches that one more parameter, their own error, would make much likelier; one for each
    data set.

    A touch may have bounced off the curve, or have been measured off. The limit holds for all
    candidates together, so that 1 % of good data sets have a flag. Data with fewer than 3 degrees
    of freedom have none.
    """
    for i, (s, model) in enumerate(zip(sets, fit.models, strict=True)):
        degrees = len(model.residual) - model.by_own.shape[1] - model.by_law.shape[1]
        if degrees < _LEAST_FREE:
            continue
        candidates = [(name, "bounced off") for name in s.touches()]
        candidates += [(name, "measured off") for name in s.rows()]
        # What one unit of each candidate's error does to the residual, a column each.
        columns = [*model.by_scatter.T, *np.eye(len(s.rows()))]
        directions = np.stack(columns, axis=1)
        gain, size = _gains(fit, i, directions)
        # χ² of one degree of freedom that chance alone passes so seldom.
        limit = NormalDist().inv_cdf(0.5 * _CHANCE / len(candidates)) ** 2
        # The first reading is as well off where the first impact is: then the impact is named.
        is_impact = np.array([what == "bounced off" for _, what in candidates])
        worst = int(np.argmax(gain + _TIE * is_impact))
        if gain[worst] > limit:
            name, what = candidates[worst]
            yield Flag(s.name, name, what, float(size[worst]), float(np.sqrt(gain[worst])))


def _gains(fit: LawFit, i: int, directions: Floats) -> tuple[Floats, Floats]:
    """Twice the gain in ln likelihood by a parameter along each direction, and its value, (c,)
    each.

    i: number of the data set.
    directions: (n, c), what a unit of each parameter does to the residual.
    """
    model = fit.models[i]
    grid = fit.surface.grid
    left, offset = _without_law(reduce(model, directions), grid.log_scatter, grid.log_noise[i])
    of_residual = left[..., 0, 0]
    along = np.diagonal(left, axis1=-2, axis2=-1)[..., 1:]
    score = left[..., 0, 1:]
    prior = fit.surface.prior_scatter[:, None] + fit.surface.prior_noise[i]
    before = offset + prior - 0.5 * of_residual
    gain = score**2 / np.maximum(along, 1e-300)
    after = before[..., None] + 0.5 * gain
    flat = after.reshape(-1, after.shape[-1])
    best = flat.argmax(axis=0)
    size = (score / np.maximum(along, 1e-300)).reshape(flat.shape)
    columns = np.arange(flat.shape[1])
    return 2.0 * (flat[best, columns] - before.max()), size[best, columns]


def _without_law(reduced: Reduced, log_scatter: Floats, log_noise: Floats) -> tuple[Floats, Floats]:
    """Eliminate the law's parameters: matrices (k, l, 1+c, 1+c) of right-hand sides, and offsets
    (k, l).

    log_scatter, log_noise: ln s_e, (k,), and ln s_m, (l,). The first right-hand side is the
    residual.
    """
    scatter, noise = np.meshgrid(np.exp(log_scatter), np.exp(log_noise), indexing="ij")
    matrix, offset = reduced.profile(scatter, noise)
    q = reduced.law
    law = matrix[..., :q, :q]
    cross = matrix[..., :q, q:]
    rest = matrix[..., q:, q:]
    # A law that has no slope where it ends leaves a singular matrix: nothing to eliminate.
    law = law + 1e-9 * np.eye(q)
    offset = offset - 0.5 * np.linalg.slogdet(law)[1]
    return rest - np.swapaxes(cross, -1, -2) @ np.linalg.solve(law, cross), offset


def gains_by_moving(fit: LawFit, s: Dataset, rows: Sequence[int], moves: Floats) -> Floats:
    """The gain in ln evidence where one reading each is another, to first order: shape (c,).

    fit: of one data set, s, whose noise is not given.
    rows: which reading.
    moves: (c,), by how much, in the unit of the data.
    """
    (model,) = fit.models
    moved = np.repeat(model.residual[:, None], len(moves), axis=1)
    moved[rows, np.arange(len(moves))] += moves
    grid = coarse_grid([s])
    reduced = reduce(model, moved, np.repeat(model.prior[None, :, 0], len(moves), axis=0))
    left, offset = _without_law(reduced, grid.log_scatter, grid.log_noise[0])
    prior_scatter, (prior_noise,) = grid.weights([s])
    prior = prior_scatter[:, None] + prior_noise
    squares = np.diagonal(left, axis1=-2, axis2=-1)
    evidence = logsumexp((offset + prior)[..., None] - 0.5 * squares, axis=(0, 1))
    return np.asarray(evidence[1:] - evidence[0])


# Scatter with outliers: each e gets a width of its own, as Student's t distribution has it.

# An impact with a lower weight is named.
LOW_WEIGHT = 0.3
# With a larger share of outliers another law is at work.
MOST_OUTLIERS = 0.25
# Degrees of freedom of Student's t distribution, which stands for the scatter with outliers.
_FREEDOM = 4.0
_ROUNDS = 3
# Impacts of a file that may be anywhere at first, at most, and their width over s_e.
_MOST_FREED = 3
_ANYWHERE = 100.0


def scatter_widths(law: CandidateLaw, sets: Sequence[Dataset], reference: float) -> list[Floats]:
    """Width of each e's scatter over s_e, (m,) per data set, the same for all laws.

    t as a mixture of normal distributions: the weight of an impact is the mean of its
    precision, given how far its e is off the law (expectation maximisation). Laws with weights
    of their own could not be compared.

    reference: m/s.
    """
    widths = _freed(law, sets, reference)
    for _ in range(_ROUNDS):
        fit = fit_law(law, sets, reference, widths)
        widths = []
        # relative: change of each e off the law, over e. wide: its width in the round before.
        for relative, wide, reduced, noise in zip(
            fit.latent, fit.width, fit.reduced, fit.noise, strict=True
        ):
            variance = reduced.latent_variance(fit.scatter, noise)
            # Mean square of each e off the law, in units of s_e².
            square = ((relative / wide) ** 2 + variance) * wide**2 / fit.scatter**2
            widths.append(np.sqrt((_FREEDOM + square) / (_FREEDOM + 1.0)))
    return widths


def _freed(law: CandidateLaw, sets: Sequence[Dataset], reference: float) -> list[Floats]:
    """Widths to start from, (m,) per data set: impacts that stand out in it may be anywhere, at most
    _MOST_FREED of a data set, and no larger share of it than MOST_OUTLIERS.

    One impact far off raises the scatter of all so much that it would hardly count as one.

    reference: m/s.
    """
    widths = []
    for s in sets:
        wide = np.ones(len(s.touches()))
        for _ in range(min(_MOST_FREED, int(MOST_OUTLIERS * len(wide)))):
            fit = fit_law(law, [s], reference, [wide])
            off = [flag for flag in flagged_touches(fit, [s]) if flag.what == "bounced off"]
            if not off:
                break
            wide[s.touches().index(off[0].touch)] = _ANYWHERE
        widths.append(wide)
    return widths


def doubted_impacts(sets: Sequence[Dataset], widths: Sequence[Floats]) -> list[str]:
    """The impacts that count little, each by its file and its touch.

    widths: of each data set's e over s_e, shape (m,); the weight of an e is 1/width².
    """
    doubted: list[str] = []
    for s, wide in zip(sets, widths, strict=True):
        touches = zip(s.touches(), wide, strict=True)
        doubted += [f"{s.name}, {touch}" for touch, w in touches if w**-2 < LOW_WEIGHT]
    return doubted


# Test whether any law fits: odds of a smooth change of ln e over speed besides the law and the
# scatter.

# From these odds on, a change besides the law is certain, and no law of the list fits.
ODDS_AGAINST = 10.0
# From these odds on a change besides the law is so likely that no law is chosen.
_ODDS_TO_DOUBT = 2.5
# Prior odds of adhesion against a constant loss e0, which is the rule.
PRIOR_OF_ADHESION = 1.0 / 3.0
# From these odds on adhesion may be what seems a constant loss.
_RIVAL = 0.1
# Standard deviations of each coefficient of the change, tried in turn.
_SIZES = (0.01, 0.03, 0.1, 0.3)
# Degrees of the Legendre polynomials that make up the change.
_DEGREES = (1, 2, 3)
# Grid over the ln of the scatter of e.
_SCATTER = np.linspace(math.log(2e-4), 0.0, 28)
# Points of the grid over the ln of the measuring noise.
_NOISE_STEPS = 15
# That grid reaches so far, in ln, beyond the grid of the fit.
_WIDER = 1.5


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """Signs that no law of the list describes the data.

    odds: of a change besides the law against none.
    shape: what e does that the law does not.
    adhesion: odds of bodies that stick against the likeliest law.
    """

    odds: float
    shape: str
    adhesion: float

    @property
    def is_certain(self) -> bool:
        """True if none of the laws fits."""
        return self.odds > ODDS_AGAINST

    @property
    def is_likely(self) -> bool:
        """True if the data speak against all laws, and no law is to be chosen."""
        return self.odds > _ODDS_TO_DOUBT

    @property
    def may_stick(self) -> bool:
        """True if the data do not rule out adhesion."""
        return self.adhesion > _RIVAL


def smooth_change(fit: LawFit, s: Dataset) -> tuple[float, str]:
    """ln of the odds of a smooth change of ln e besides a law, and its shape in words.

    fit: to the one data set s.
    The change is a sum of Legendre polynomials of ln v, of degrees 1 to 1, 2 or 3, with normal
    coefficients; scatter and noise are integrated out on both sides.
    """
    x = np.log(fit.models[0].speed)
    change = _Change(fit, s, _legendre(2.0 * (x - x.min()) / max(float(np.ptp(x)), 1e-9) - 1.0))
    log_odds = float(logsumexp(np.array([change.log_odds(range(degree)) for degree in _DEGREES])))
    ends = _legendre(np.array([-1.0, 0.0, 1.0])) @ change.likeliest(range(_DEGREES[-1]))
    return log_odds - math.log(len(_DEGREES)), _shape(ends)


def adhesion(fit: LawFit, s: Dataset) -> float:
    """ln of the odds of the law times sqrt(1 - (v_s/v)²) against the law alone.

    -inf where e at low speeds is not less than the law says.
    v_s: speed below which the bodies stick, whose kinetic energy is what parting them takes; to
    first order in (v_s/v)².
    s: the data set that the law was fitted to.
    """
    speed = fit.models[0].speed
    # ln of the factor is -(v_s/v)²/2: its coefficient, in units of the slowest speed, is to be found.
    change = _Change(fit, s, -((speed.min() / speed) ** 2)[:, None])
    # Only the one coefficient of this change.
    used = range(1)
    if not change.likeliest(used)[0] > 0.0:
        return -math.inf
    return change.log_odds(used)


def _legendre(u: Floats) -> Floats:
    """(m, 3)."""
    return np.stack([Legendre.basis(k)(u) for k in range(1, _DEGREES[-1] + 1)], axis=1)


class _Change:
    """A change of ln e besides a law, over a grid of scatter and noise.

    _alone: ln of the evidence of the law without a change.
    """

    def __init__(self, fit: LawFit, s: Dataset, shapes: Floats) -> None:
        """Prepare the likelihood of a change of e about the fitted law.

        s: the one data set that was fitted.
        shapes: (m, c), change at each impact by coefficient.
        """
        (model,) = fit.models
        by_change = (model.by_scatter / fit.width[0]) @ shapes
        reduced = reduce(replace(model, by_law=np.concatenate([model.by_law, by_change], axis=1)))
        log_noise = fit.surface.grid.log_noise[0]
        prior = scatter_prior(_SCATTER)[:, None]
        if s.known_noise is None:
            log_noise = np.linspace(log_noise[0] - _WIDER, log_noise[-1] + _WIDER, _NOISE_STEPS)
            prior = prior + noise_prior(log_noise, s.noise_scale)
        scatter, noise = np.meshgrid(np.exp(_SCATTER), np.exp(log_noise), indexing="ij")
        self._matrix, offset = reduced.profile(scatter, noise)
        self._offset = offset + prior
        self._law = model.by_law.shape[1]
        self._alone = self._evidence(range(0), 1.0)[0]

    def log_odds(self, used: range) -> float:
        """ln of the odds of a change with these coefficients against none, over all sizes of it."""
        log_evidence = [self._evidence(used, size)[0] for size in _SIZES]
        return float(logsumexp(np.array(log_evidence))) - math.log(len(_SIZES)) - self._alone

    def likeliest(self, used: range) -> Floats:
        """The likeliest coefficients."""
        return max((self._evidence(used, size) for size in _SIZES), key=lambda one: one[0])[1]

    def _evidence(self, used: range, size: float) -> tuple[float, Floats]:
        """ln of the evidence with a change of this size, and its likeliest coefficients, shape
        (c,).

        used: numbers of the c coefficients.
        size: standard deviation of each coefficient, of ln e.
        """
        q = self._law
        keep = [*range(q), *(q + k for k in used), -1]
        part = self._matrix[..., keep, :][..., :, keep].copy()
        change = np.arange(q, q + len(used))
        part[..., change, change] += size**-2
        n = q + len(used)
        normal = part[..., :n, :n] + 1e-9 * np.eye(n)
        right = part[..., :n, n]
        best = np.linalg.solve(normal, right[..., None])[..., 0]
        quadratic = part[..., n, n] - (right * best).sum(axis=-1)
        log_density = self._offset - 0.5 * quadratic - 0.5 * np.linalg.slogdet(normal)[1]
        top = np.unravel_index(int(np.argmax(log_density)), log_density.shape)
        return float(logsumexp(log_density)) - len(used) * math.log(size), best[top][q:]


def _shape(change: Floats) -> str:
    """Words for how e departs from the law.

    change: change of ln e at a slow, a middle and a fast impact, shape (3,).
    """
    slow, middle, fast = change
    if middle > max(slow, fast):
        return "e lies above the law at middle speeds and below it at both ends"
    if middle < min(slow, fast):
        return "e lies below the law at middle speeds and above it at both ends"
    if fast > slow:
        return "e rises with speed more than the law, or falls less"
    return "e falls with speed more than the law"
