"""Whether any law fits: the odds of a smooth change of ln e over speed, besides the law and the scatter."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial.legendre import Legendre
from scipy.special import logsumexp

from hcbench.fitting.linear import reduce
from hcbench.fitting.noise import noise_prior, scatter_prior

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.estimate import LawFit
    from hcbench.impact import Floats

ODDS_AGAINST = 10.0  # from which on no law of the list fits
_SIZES = (0.01, 0.03, 0.1, 0.3)  # of the change, standard deviation of each coefficient
_DEGREE = 3
_SCATTER = np.linspace(math.log(2e-4), 0.0, 28)
_NOISE_STEPS, _WIDER = 15, 1.5  # of ln s_m: points, and how far beyond the grid of the fit


@dataclass(frozen=True, slots=True)
class LackOfFit:
    """odds: of a smooth change besides the law against none. shape: what e does that the law does not."""

    odds: float
    shape: str

    @property
    def is_certain(self) -> bool:
        """Whether no law of the list fits."""
        return self.odds > ODDS_AGAINST


def lack_of_fit(fit: LawFit, sets: Sequence[Dataset]) -> LackOfFit:
    """The odds over all data sets, each with a change of its own; the shape in the set with the largest odds.

    The change is a sum of Legendre polynomials of ln v, degrees 1 to 3, with normal coefficients; scatter and
    noise are integrated out on both sides.
    """
    odds_of_sets = [_of_set(fit, i, s) for i, s in enumerate(sets)]
    worst = max(range(len(odds_of_sets)), key=lambda i: odds_of_sets[i][0])
    total = sum(log_odds for log_odds, _ in odds_of_sets)
    return LackOfFit(math.exp(min(total, 700.0)), _shape(odds_of_sets[worst][1]))


def _of_set(fit: LawFit, i: int, s: Dataset) -> tuple[float, Floats]:
    """ln of the odds, and the likeliest change at the slowest, the middle and the fastest impact, (3,)."""
    model = fit.models[i]
    x = np.log(model.speed)
    u = 2.0 * (x - x.min()) / max(float(np.ptp(x)), 1e-9) - 1.0
    basis = [Legendre.basis(k) for k in range(1, _DEGREE + 1)]
    smooth = np.stack([b(u) for b in basis], axis=1)
    by_smooth = (model.by_scatter / fit.width[i]) @ smooth
    reduced = reduce(replace(model, by_law=np.concatenate([model.by_law, by_smooth], axis=1)))
    log_noise = fit.surface.grid.log_noise[i]
    prior = scatter_prior(_SCATTER)[:, None]
    if s.known_noise is None:
        log_noise = np.linspace(log_noise[0] - _WIDER, log_noise[-1] + _WIDER, _NOISE_STEPS)
        prior = prior + noise_prior(log_noise, s.noise_scale)
    scatter, noise = np.meshgrid(np.exp(_SCATTER), np.exp(log_noise), indexing="ij")
    matrix, offset = reduced.profile(scatter, noise)
    offset = offset + prior
    q = model.by_law.shape[1]
    alone, _ = _evidence(matrix, offset, q, None)
    with_change = [_evidence(matrix, offset, q, size) for size in _SIZES]
    log_evidence = [one for one, _ in with_change]
    change = with_change[int(np.argmax(log_evidence))][1]
    ends = np.stack([b(np.array([-1.0, 0.0, 1.0])) for b in basis], axis=1)
    return float(logsumexp(log_evidence)) - math.log(len(_SIZES)) - alone, ends @ change


def _evidence(matrix: Floats, offset: Floats, q: int, size: float | None) -> tuple[float, Floats]:
    """ln of the evidence with a change of this size (None: without), and its likeliest coefficients.

    matrix, offset: `Reduced.profile` over a grid of scatter and noise, the change's columns after the law's.
    """
    count = 0 if size is None else _DEGREE
    keep = [*range(q + count), q + _DEGREE]
    part = matrix[..., keep, :][..., :, keep].copy()
    log_prior = 0.0
    if size is not None:
        change = np.arange(q, q + _DEGREE)
        part[..., change, change] += size**-2
        log_prior = -_DEGREE * math.log(size)
    n = q + count
    normal, right = part[..., :n, :n] + 1e-9 * np.eye(n), part[..., :n, n]
    best = np.linalg.solve(normal, right[..., None])[..., 0]
    quadratic = part[..., n, n] - (right * best).sum(axis=-1)
    log_density = offset - 0.5 * quadratic - 0.5 * np.linalg.slogdet(normal)[1]
    top = np.unravel_index(int(np.argmax(log_density)), log_density.shape)
    return float(logsumexp(log_density)) + log_prior, best[top][q:]


def _shape(change: Floats) -> str:
    """In words, of the change at the slowest, the middle and the fastest impact."""
    slow, middle, fast = change
    if middle > max(slow, fast):
        return "e lies above the law at middle speeds and below it at both ends"
    if middle < min(slow, fast):
        return "e lies below the law at middle speeds and above it at both ends"
    if fast > slow:
        return "e rises with speed more than the law, or falls less"
    return "e falls with speed more than the law"
