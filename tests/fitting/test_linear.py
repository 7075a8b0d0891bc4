"""The likelihood of a linear model with two kinds of noise, against the normal distribution itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import special
from scipy.stats import multivariate_normal

from hcbench.fitting.linear import LinearModel, logsumexp, reduce

SCATTER, NOISE = 0.03, 0.2


def model(impacts: int, own: int, known: float) -> LinearModel:
    """Twelve readings of some impacts. known: standard deviation of each own parameter about 0.1."""
    random = np.random.default_rng(own)
    return LinearModel(
        residual=random.normal(size=12),
        by_own=random.normal(size=(12, own)),
        by_law=random.normal(size=(12, 1)),
        by_scatter=random.normal(size=(12, impacts)),
        shape=random.uniform(0.5, 2.0, size=12),
        prior=np.array([(0.1, known)] * own).reshape(own, 2),
        speed=np.ones(impacts),
    )


def log_likelihood(made: LinearModel, law: float, noise: float) -> float:
    """ln of the likelihood of a change of the law's parameter, by `Reduced.profile`."""
    outer, offset = reduce(made).profile(np.array(SCATTER), np.array(noise))
    z = np.array([-law, 1.0])
    return float(offset - 0.5 * z @ outer @ z)


def log_density(made: LinearModel, law: float, noise: float, own: float, known: float) -> float:
    """ln of the density of the readings: s_e² D Dᵀ of the impacts, s_m² of each reading's own
    noise, and what own parameters of own ± known add.
    """
    left = made.residual - law * made.by_law[:, 0] - own * made.by_own.sum(axis=1)
    covariance = SCATTER**2 * made.by_scatter @ made.by_scatter.T + np.diag(
        (noise * made.shape) ** 2
    )
    covariance += known**2 * made.by_own @ made.by_own.T
    return float(multivariate_normal(np.zeros(12), covariance).logpdf(left))


@pytest.mark.parametrize("noise", [0.2, 0.5])
@pytest.mark.parametrize("impacts", [3, 12])
def test_without_own_parameters_it_is_the_density_of_the_readings(
    impacts: int, noise: float
) -> None:
    made = model(impacts, 0, math.inf)
    assert log_likelihood(made, 0.4, noise) == pytest.approx(
        log_density(made, 0.4, noise, 0.0, 0.0)
    )


@pytest.mark.parametrize("impacts", [3, 12])
def test_own_parameters_that_are_known_before_widen_the_density(impacts: int) -> None:
    """One law and noise against others: a factor that all have in common cancels."""
    made = model(impacts, 2, 0.5)
    first = log_density(made, 0.4, 0.2, 0.1, 0.5)
    for law, noise in ((0.4, 0.5), (-0.3, 0.2)):
        expected = first - log_density(made, law, noise, 0.1, 0.5)
        assert log_likelihood(made, 0.4, 0.2) - log_likelihood(made, law, noise) == pytest.approx(
            expected
        )


@pytest.mark.parametrize("axis", [None, 0, 1, (0, 1)])
def test_ln_of_a_sum_is_scipys(axis: int | tuple[int, ...] | None) -> None:
    random = np.random.default_rng(0)
    log_terms = random.normal(scale=300.0, size=(5, 7, 3))
    log_terms[random.random(log_terms.shape) < 0.2] = -np.inf
    # Terms that are the largest twice.
    log_terms[2] = log_terms.max()
    expected = special.logsumexp(log_terms, axis=axis)
    np.testing.assert_allclose(logsumexp(log_terms, axis), expected, rtol=1e-15, atol=0.0)


def test_ln_of_a_sum_of_terms_that_are_all_zero_is_that_of_zero() -> None:
    assert logsumexp(np.full(4, -np.inf)) == -np.inf
