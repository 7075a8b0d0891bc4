"""A measurement as a linear model about given parameters, and its
likelihood with two kinds of noise.

    r = X_own δ_own + X_law δ_law + s_e D ε + s_m η,    ε, η independent standard normal

r: what was measured less what the parameters say; D: what a relative change of each e does to
it, so that s_e is the scatter of e from one impact to the next; s_m: the noise of measuring.
With timing alone (s_e = 0) a 95 % interval of α holds the truth in 14 % of cases: the change of
one e moves every later touch.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.which_law import CandidateLaw, FittedCurve
    from hcbench.terms.impact import Floats


@dataclass(frozen=True, slots=True)
class LinearModel:
    """A data set linearised about a law: n readings, p own and q law parameters, m changes of e.

    residual: (n,).
    by_own: (n, p), derivatives by parameters of this data set alone.
    by_law: (n, q).
    by_scatter: (n, m), D.
    shape: (n,), standard deviations of the noise of measuring at s_m = 1.
    prior: (p, 2) mean offset and standard deviation of each own parameter, inf where nothing is
    known.
    speed: (m,), impact speed in m/s that goes with each column of by_scatter.
    """

    residual: Floats
    by_own: Floats
    by_law: Floats
    by_scatter: Floats
    shape: Floats
    prior: Floats
    speed: Floats


@dataclass(frozen=True, slots=True)
class Reduced:
    """Linear model reduced so that its likelihood is cheap for any s_e and s_m.

    size: (m,), eigenvalues' roots of D Dᵀ.
    columns: (m, p + q + c), the model's columns [own, law, residual and more right-hand sides]
    along its eigenvectors; rest: their Gram matrix across them, of rest_count dimensions.
    turn: (m, m), from ε to those directions.
    own, law: numbers p and q of the columns of own and of the law's parameters.
    prior: Gram matrix of what is known before.
    constant: added to the log-likelihood.
    """

    size: Floats
    columns: Floats
    rest: Floats
    rest_count: int
    turn: Floats
    prior: Floats
    constant: float
    own: int
    law: int

    def grams(self, scatter: Floats, noise: Floats) -> tuple[Floats, Floats]:
        """Normal matrices (..., p+q+c, p+q+c) and ln det of the covariance (...).

        scatter, noise: s_e and s_m, of any one shape (...); the noise above 0.
        """
        variance = scatter[..., None] ** 2 * self.size**2 + noise[..., None] ** 2
        normal = self.columns.T @ (self.columns / variance[..., None])
        normal += self.rest / noise[..., None, None] ** 2 + self.prior
        log_det = np.log(variance).sum(axis=-1) + 2.0 * self.rest_count * np.log(noise)
        return normal, log_det

    def profile(self, scatter: Floats, noise: Floats) -> tuple[Floats, Floats]:
        """Own parameters integrated out: matrices S (..., q+c, q+c) and offsets (...).

        The log-likelihood of δ_law is offset - ½ zᵀ S z with z = (-δ_law, 1) on the first
        right-hand side.

        scatter, noise: s_e and s_m, of any one shape (...).
        """
        normal, log_det = self.grams(scatter, noise)
        p = self.own
        own = normal[..., :p, :p]
        cross = normal[..., :p, p:]
        outer = normal[..., p:, p:]
        if p:
            outer = outer - np.swapaxes(cross, -1, -2) @ np.linalg.solve(own, cross)
            log_det = log_det + np.linalg.slogdet(own)[1]
        return outer, self.constant - 0.5 * log_det

    def variance_parts(self, scatter: float, noise: float, gain: Floats) -> tuple[float, float]:
        """Variance of gain · δ_law that comes from the scatter of e, and from the noise of
        measuring.

        scatter, noise: s_e and s_m.
        gain: weights of the law's parameters, shape (q,).
        """
        p, q = self.own, self.law
        normal, _ = self.grams(np.array(scatter), np.array(noise))
        # Weights of the residual in the slope by δ_law, with own parameters eliminated.
        to_law = (
            np.concatenate([-np.linalg.solve(normal[:p, :p], normal[:p, p : p + q]), np.eye(q)])
            @ gain
        )
        along = self.columns[:, : p + q] @ to_law
        variance = scatter**2 * self.size**2 + noise**2
        across = float(to_law @ self.rest[: p + q, : p + q] @ to_law) / noise**2
        by_scatter = float((along**2 * scatter**2 * self.size**2 / variance**2).sum())
        return by_scatter, float((along**2 * noise**2 / variance**2).sum()) + across

    def latent(self, scatter: float, noise: float, own_step: Floats, law_step: Floats) -> Floats:
        """The likeliest relative changes of e, shape (m,): the mean of s_e ε given the data."""
        q = self.own + self.law
        left = self.columns[:, q] - self.columns[:, :q] @ np.concatenate([own_step, law_step])
        share = scatter**2 * self.size / (scatter**2 * self.size**2 + noise**2)
        return np.asarray(self.turn.T @ (share * left))

    def latent_variance(self, scatter: float, noise: float) -> Floats:
        """Variance of each relative change of e, shape (m,), the parameters held fixed."""
        known = scatter**2 * self.size**2 / (scatter**2 * self.size**2 + noise**2)
        return np.asarray(scatter**2 * (1.0 - known @ self.turn**2))

    def own_step(self, scatter: float, noise: float, law_step: Floats) -> Floats:
        """δ_own that goes with δ_law, both where the likelihood is largest: shape (p,).

        scatter, noise: s_e and s_m.
        law_step: δ_law, shape (q,).
        """
        p, q = self.own, self.law
        if not p:
            return np.zeros(0)
        normal, _ = self.grams(np.array(scatter), np.array(noise))
        right = normal[:p, p + q] - normal[:p, p : p + q] @ law_step
        return np.asarray(np.linalg.solve(normal[:p, :p], right))


def reduce(
    model: LinearModel, more: Floats | None = None, offsets: Floats | None = None
) -> Reduced:
    """The model along the eigenvectors of D Dᵀ.

    more: (n, c), further right-hand sides; offsets: (c, p), what they do to the offsets of the
    prior.
    Each row is divided by its `shape`, so that the noise of measuring is alike in all.
    """
    p = model.by_own.shape[1]
    q = model.by_law.shape[1]
    blocks = [model.by_own, model.by_law, model.residual[:, None]]
    if more is not None:
        blocks.append(more)
    columns = np.concatenate(blocks, axis=1) / model.shape[:, None]
    vectors, size, turn = _directions(model.by_scatter / model.shape[:, None])
    along = vectors.T @ columns
    across = columns - vectors @ along
    prior = np.zeros((columns.shape[1],) * 2)
    constant = -float(np.log(model.shape).sum()) - 0.5 * (len(columns) - p) * math.log(
        2.0 * math.pi
    )
    for i, (mean, sd) in enumerate(model.prior):
        if math.isfinite(sd):
            row = np.zeros(columns.shape[1])
            row[i] = 1.0 / sd
            row[p + q] = mean / sd
            if offsets is not None:
                row[p + q + 1 :] = offsets[:, i] / sd
            prior += np.outer(row, row)
            constant -= math.log(sd)
    rest = across.T @ across
    return Reduced(
        size=size,
        columns=along,
        rest=rest,
        rest_count=len(columns) - size.size,
        turn=turn,
        prior=prior,
        constant=constant,
        own=p,
        law=q,
    )


# Rows of a matrix that LAPACK decomposes in one thread.
_BLOCK = 256


def _directions(by_scatter: Floats) -> tuple[Floats, Floats, Floats]:
    """Singular value decomposition of D, (n, m): vectors (n, k), sizes (k,) and turn (k, m).

    Impacts measured one by one have a diagonal matrix, and need none.
    """
    n, m = by_scatter.shape
    size = np.diagonal(by_scatter)
    if n == m and np.count_nonzero(by_scatter) == np.count_nonzero(size):
        return np.eye(n), size.copy(), np.eye(n)
    if n <= _BLOCK:
        return np.linalg.svd(by_scatter, full_matrices=False)
    # By blocks of rows, of which one matrix of all their triangles is decomposed: LAPACK takes all
    # threads for more rows, and waits for them a hundred times as long as it computes.
    blocks = [np.linalg.qr(rows) for rows in np.array_split(by_scatter, math.ceil(n / _BLOCK))]
    joined, square = np.linalg.qr(np.concatenate([triangle for _, triangle in blocks]))
    turned, size, turn = np.linalg.svd(square)
    ends = np.cumsum([len(triangle) for _, triangle in blocks])[:-1]
    parts = np.split(joined @ turned, ends)
    vectors = [along @ part for (along, _), part in zip(blocks, parts, strict=True)]
    return np.concatenate(vectors), size, turn


# Grids over scatter and noise of measuring, and the likelihood of a law over them.

# Likeliest scatter of e from one impact to the next: 0.1 to 2 % are seen.
SCATTER_SCALE = 0.0035
# The grid reaches so many times below and above what is likely.
_SPAN = 1e4
# Scale of the prior of the noise, in ln: instruments differ by a factor of three.
_FACTOR = math.log(3.0)
# Largest scatter of e: bodies other than balls scatter by a third.
MOST_SCATTER = 1.0
# Points of the first grid, over all noise that is possible.
_COARSE = 19
# Points of the grid about the likeliest noise.
_FINE = 13
# A point of the grid is dropped if the ln of its density is this far below the largest.
_NEGLIGIBLE = 9.0


def scatter_prior(log_scatter: Floats) -> Floats:
    """ln of the density over ln s_e, in the shape of `log_scatter`.

    1/s_e is half a normal distribution, of width 1/SCATTER_SCALE. It has almost nothing below a
    third of the scale, so that few touches that happen to lie on the curve do not get an interval
    of no width, and a long tail above it.
    """
    away = SCATTER_SCALE * np.exp(-log_scatter)
    return np.asarray(0.5 * math.log(2.0 / math.pi) + np.log(away) - 0.5 * away**2)


def noise_prior(log_noise: Floats, scale: float) -> Floats:
    """ln of the density over ln s_m: about a scale, with long tails: instruments differ more."""
    away = (log_noise - math.log(scale)) / _FACTOR
    return np.asarray(-np.log(math.pi * _FACTOR * (1.0 + away**2)))


class NoisyData:
    """Data with noise of measuring, s_m, in their SI unit."""

    noise_unit: ClassVar[str]

    @property
    @abstractmethod
    def noise_scale(self) -> float:
        """Likely noise of measuring, in the data's SI unit."""

    @property
    def known_noise(self) -> float | None:
        """s_m where it is given."""
        return None


@dataclass(frozen=True, slots=True)
class NoiseGrid:
    """A grid over the scatter of e and the noise of each data set.

    log_scatter: (k,), ln s_e, even.
    log_noise: one array (l,) of ln s_m, even, a data set.
    """

    log_scatter: Floats
    log_noise: tuple[Floats, ...]

    def weights(self, sets: Sequence[NoisyData]) -> tuple[Floats, list[Floats]]:
        """ln of prior mass of each value: of s_e, and of s_m a data set.

        sets: the data sets of the grid, in its order.
        Shapes (k,) and, a data set, (l,). A known s_m is one point with all the mass.
        """
        each = []
        for grid, s in zip(self.log_noise, sets, strict=True):
            if s.known_noise is not None:
                each.append(np.zeros(1))
            else:
                each.append(noise_prior(grid, s.noise_scale) + _log_cell(grid))
        return scatter_prior(self.log_scatter) + _log_cell(self.log_scatter), each


def _log_cell(grid: Floats) -> float:
    return math.log(grid[1] - grid[0])


def coarse_grid(sets: Sequence[NoisyData]) -> NoiseGrid:
    """A coarse grid over all noise that is possible: ln s_e, and ln s_m for each data set.

    A data set with a known s_m has that value alone.
    """
    scatter = np.linspace(math.log(SCATTER_SCALE / _SPAN), math.log(MOST_SCATTER), _COARSE)
    # About ln of a data set's own scale.
    around = np.linspace(-math.log(_SPAN), math.log(100.0), _COARSE)
    noise = []
    for s in sets:
        if s.known_noise is None:
            noise.append(np.log(s.noise_scale) + around)
        else:
            noise.append(np.log([s.known_noise]))
    return NoiseGrid(scatter, tuple(noise))


@dataclass(frozen=True, slots=True)
class NoiseLikelihood:
    """Likelihood of a law's parameters δ over a grid of noise, for each data set.

    outer: (k, l, q+1, q+1) matrices S; offset: (k, l).
    prior_scatter, prior_noise: ln of the priors of s_e and of each data set's s_m over the grid.
    """

    grid: NoiseGrid
    outer: tuple[Floats, ...]
    offset: tuple[Floats, ...]
    prior_scatter: Floats
    prior_noise: tuple[Floats, ...]

    def over_noise(self, delta: Floats) -> list[Floats]:
        """ln of prior times likelihood at one δ (q,) for each data set: (k, l)."""
        z = np.concatenate([-delta, [1.0]])
        return [
            offset - 0.5 * (outer @ z) @ z + prior
            for outer, offset, prior in zip(self.outer, self.offset, self.prior_noise, strict=True)
        ]

    def log_posterior(self, deltas: Floats) -> tuple[Floats, Floats]:
        """ln of prior times likelihood at δ (g, q), noise integrated out: (g,), and by s_e: (k, g).

        The prior is that of the noise; that of the parameters is flat.
        """
        z = np.concatenate([-deltas, np.ones((len(deltas), 1))], axis=1)
        total = np.tile(self.prior_scatter[:, None], (1, len(deltas)))
        q = z.shape[1]
        # z S z as a product of S with the monomials of z: one matrix product for the whole grid.
        monomials = np.einsum("ga,gb->abg", z, z).reshape(q * q, -1)
        for outer, offset, prior in zip(self.outer, self.offset, self.prior_noise, strict=True):
            k, n = offset.shape
            # In place: the grid has some hundred thousand points, and room for each takes longer.
            part = ((-0.5 * outer).reshape(k * n, q * q) @ monomials).reshape(k, n, -1)
            part += (offset + prior)[..., None]
            top = part.max(axis=1)
            part -= top[:, None]
            np.exp(part, out=part)
            total += top + np.log(part.sum(axis=1))
        return logsumexp(total, axis=0), total


def logsumexp(log_terms: Floats, axis: int | tuple[int, ...] | None = None) -> Floats:
    """ln of a sum, from the ln of its terms.

    log_terms: of any shape.
    axis: along which terms are added; None: all are, to an array of no dimension.

    It is `scipy.special.logsumexp`, bit for bit, without the import, which takes a third of a fit.
    """
    largest = log_terms.max(axis=axis, keepdims=True)
    is_largest = log_terms == largest
    count = is_largest.sum(axis=axis, keepdims=True, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Beside the largest terms, which are 1 each, small ones would lose digits.
        others = np.exp(np.where(is_largest, -np.inf, log_terms - largest))
        share = others.sum(axis=axis, keepdims=True) / count
        log_sum = np.log1p(share) + np.log(count) + largest
    return np.asarray(log_sum.squeeze(axis=axis))


def surface(
    reduced: Sequence[Reduced], sets: Sequence[NoisyData], grid: NoiseGrid
) -> NoiseLikelihood:
    """The likelihood of a law over a grid of noise.

    reduced: the model of each data set; right-hand sides after the residual are left out.
    sets: in the same order; they tell the priors of the noise.
    """
    outer, offset = [], []
    for one, log_noise in zip(reduced, grid.log_noise, strict=True):
        scatter, noise = np.meshgrid(np.exp(grid.log_scatter), np.exp(log_noise), indexing="ij")
        matrices, offsets = one.profile(scatter, noise)
        outer.append(matrices[..., : one.law + 1, : one.law + 1])
        offset.append(offsets)
    prior_scatter, prior_noise = grid.weights(sets)
    return NoiseLikelihood(grid, tuple(outer), tuple(offset), prior_scatter, tuple(prior_noise))


def refined(coarse: NoiseLikelihood, delta: Floats, sets: Sequence[NoisyData]) -> NoiseGrid:
    """A grid over what the coarse one leaves likely at δ.

    delta: change of the law's parameters, shape (q,). A known s_m keeps its one value.

    Raises FloatingPointError where no noise is likely.
    """
    per_set = coarse.over_noise(delta)
    by_scatter = [logsumexp(part, axis=1) for part in per_set]
    total = coarse.prior_scatter + sum(by_scatter)
    scatter = _zoomed(coarse.grid.log_scatter, total)
    noise = []
    for s, grid, part, own in zip(sets, coarse.grid.log_noise, per_set, by_scatter, strict=True):
        if s.known_noise is not None:
            noise.append(grid)
            continue
        # This data set's own part of the total is in `part`, over its noise.
        over = logsumexp(part + (total - own)[:, None], axis=0)
        noise.append(_zoomed(grid, over))
    return NoiseGrid(scatter, tuple(noise))


def _zoomed(grid: Floats, log_weight: Floats) -> Floats:
    """A finer grid over the part of a grid (n,) whose ln of weight is not negligible: _FINE points.

    Raises FloatingPointError where no weight is a number.
    """
    likely = np.flatnonzero(log_weight > log_weight.max() - _NEGLIGIBLE)
    if not likely.size:
        raise FloatingPointError("no noise is likely")
    low = max(likely[0] - 1, 0)
    high = min(likely[-1] + 1, len(grid) - 1)
    return np.linspace(grid[low], grid[high], _FINE)


def best_noise(surface: NoiseLikelihood, delta: Floats) -> tuple[float, list[float]]:
    """The most likely s_e, and s_m for each data set, in its SI unit.

    surface: likelihood over the grid of noise.
    delta: change of the law's parameters, shape (q,).
    """
    per_set = surface.over_noise(delta)
    total = surface.prior_scatter + sum(logsumexp(part, axis=1) for part in per_set)
    k = int(np.argmax(total))
    noise = []
    for log_noise, part in zip(surface.grid.log_noise, per_set, strict=True):
        likeliest = int(np.argmax(part[k]))
        noise.append(float(np.exp(log_noise[likeliest])))
    return float(np.exp(surface.grid.log_scatter[k])), noise


@dataclass(frozen=True, slots=True)
class Posterior:
    """Posterior of a law's parameters, on a grid.

    parameters: (g, q), points of a grid.
    weight: (g,), their share; the shares add up to 1.
    """

    parameters: Floats
    weight: Floats

    def quantiles(self, values: Floats, shares: Sequence[float]) -> list[float]:
        """Quantiles of a function of the parameters with these values (g,) on the grid."""
        return quantiles(values, self.weight, shares)


def quantiles(values: Floats, weight: Floats, shares: Sequence[float]) -> list[float]:
    """Quantiles of weighted values (g,); the weights add up to 1."""
    order = np.argsort(values, kind="stable")
    sorted_weight = weight[order]
    below = np.cumsum(sorted_weight) - 0.5 * sorted_weight
    return [float(q) for q in np.interp(shares, below, values[order])]


@dataclass(frozen=True, slots=True)
class LawFit:
    """The fit of one law to data, linearised about its most likely parameters.

    reference: speed, m/s, at which the law's first parameter is ln e.
    own, latent, models, reduced: a data set each; latent: relative changes of each e, and in the
    models divided by `width`, how much wider than s_e each scatters.
    log_evidence: ln of the marginal likelihood, parameters and noise integrated out.
    scatter, noise: the most likely s_e and s_m.
    beyond: share of the posterior where the law would gain energy, cut off.
    """

    law: CandidateLaw
    reference: float
    parameters: Floats
    own: tuple[Floats, ...]
    latent: tuple[Floats, ...]
    width: tuple[Floats, ...]
    models: tuple[LinearModel, ...]
    reduced: tuple[Reduced, ...]
    surface: NoiseLikelihood
    posterior: Posterior
    log_evidence: float
    scatter: float
    noise: tuple[float, ...]
    beyond: float

    @property
    def curve(self) -> FittedCurve:
        """e over speed at the most likely parameters."""
        return self.law.curve(tuple(self.parameters), self.reference)

    def measured_off(self) -> list[Floats]:
        """Residual of each reading after the law and its scatter, (n,) per data set, in the data's
        unit.
        """
        return [
            model.residual - model.by_scatter @ (latent / wide)
            for model, latent, wide in zip(self.models, self.latent, self.width, strict=True)
        ]

    def values(self, name: str) -> Floats:
        """One of the law's named parameters at each point of the posterior."""
        points = self.posterior.parameters
        return np.array([self.law.describe(tuple(p), self.reference)[name] for p in points])


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its standard uncertainty and its 95 % interval, SI."""

    value: float
    uncertainty: float
    low: float
    high: float
