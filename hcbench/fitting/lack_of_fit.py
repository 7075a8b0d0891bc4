"""Test whether any law fits: odds of a smooth change of ln e over speed besides the law and the
scatter.
"""

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
    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.estimate import LawFit
    from hcbench.terms.impact import Floats

# From these odds on, a change besides the law is certain, and no law of the list fits.
ODDS_AGAINST = 10.0
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
    def may_stick(self) -> bool:
        """True if the data do not rule out adhesion."""
        return self.adhesion > _RIVAL


def smooth_change(fit: LawFit, s: Dataset) -> tuple[float, str]:
    """ln of the odds of a smooth change of ln e besides a law fitted to one
    data set, and its shape in words.

    The change is a sum of Legendre polynomials of ln v, of degrees 1 to 1, 2 or 3, with normal
    coefficients; scatter and noise are integrated out on both sides.
    """
    x = np.log(fit.models[0].speed)
    change = _Change(fit, s, _legendre(2.0 * (x - x.min()) / max(float(np.ptp(x)), 1e-9) - 1.0))
    log_odds = float(logsumexp([change.log_odds(range(degree)) for degree in _DEGREES]))
    ends = _legendre(np.array([-1.0, 0.0, 1.0])) @ change.likeliest(range(_DEGREES[-1]))
    return log_odds - math.log(len(_DEGREES)), _shape(ends)


def adhesion(fit: LawFit, s: Dataset) -> float:
    """ln of the odds of the law times sqrt(1 - (v_s/v)²) against the law
    alone; -inf where it is not less.

    v_s: speed below which the bodies stick, whose kinetic energy is what parting them
    takes; to first order in (v_s/v)².

    s: the data set that the law was fitted to.
    """
    speed = fit.models[0].speed
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
    """A change of ln e besides a law, over a grid of scatter and noise."""

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
        return float(logsumexp(log_evidence)) - math.log(len(_SIZES)) - self._alone

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
    """Describe how e departs from the law.

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
