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
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
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
    count: int

    def grams(self, scatter: Floats, noise: Floats) -> tuple[Floats, Floats]:
        """Normal matrices (..., p+q+c, p+q+c) and ln det of the covariance
        (...), over s_e and s_m (...).
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
        """δ_own that goes with δ_law, both where the likelihood is largest: shape (p,)."""
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

    more: (n, c), further right-hand sides; offsets: (c, p), what they
    do to the offsets of the prior.
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
        size, along, rest, len(columns) - size.size, turn, prior, constant, p, q, len(columns)
    )


def _directions(by_scatter: Floats) -> tuple[Floats, Floats, Floats]:
    """The singular value decomposition; impacts measured one by one have a
    diagonal matrix, and need none.
    """
    n, m = by_scatter.shape
    size = np.diagonal(by_scatter)
    if n == m and np.count_nonzero(by_scatter) == np.count_nonzero(size):
        return np.eye(n), size.copy(), np.eye(n)
    return np.linalg.svd(by_scatter, full_matrices=False)
