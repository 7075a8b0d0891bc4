"""Intervals of α that hold where a constant loss, a large scatter or outliers are present."""

from __future__ import annotations

import numpy as np
import pytest
from long_searches import long_study
from measured_bounces import EXACT, synthesise, times_of

from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.fit import fit
from hcbench.fitting.heights import SpeedPairs
from hcbench.fitting.misfits import _freed
from hcbench.fitting.which_law import LAWS, WITH_E0

TRIALS = 16


def hits(make, alpha: float) -> tuple[int, list[float]]:  # type: ignore[no-untyped-def]
    """Number of intervals that hold α, and the scatter that each fit found."""
    found = [fit([make(seed)]) for seed in range(TRIALS)]
    held = [one.alpha for one in found if one.alpha is not None]
    return sum(one.low <= alpha <= one.high for one in held) + TRIALS - len(held), [
        one.best.scatter for one in found
    ]


@pytest.mark.parametrize(
    ("alpha", "e0", "scatter", "timing", "touches"),
    [
        (0.15, 0.99, 5e-3, 2e-4, 12),
        pytest.param(0.2, 0.98, 1e-2, 1e-3, 8, marks=long_study),
        pytest.param(0.2, 1.0, 5e-3, 2e-4, 12, marks=long_study),
    ],
)
def test_the_interval_holds_beside_a_constant_loss(
    alpha: float, e0: float, scatter: float, timing: float, touches: int
) -> None:
    """16 drops a row; `make test-all` has all three.

    With the interval of the likelier law alone half of them hold in the first two rows.
    """
    law = synthesise.hunt_crossley(alpha, e0)
    more = {"scatter": scatter, "timing": timing, "most": touches}
    held, _ = hits(lambda seed: TouchTimes("t", EXACT, times_of(law, seed, **more)), alpha)
    assert held >= 13


@pytest.mark.parametrize(
    ("scatter", "outliers"),
    [
        pytest.param(0.05, 0.0, marks=long_study),
        pytest.param(0.35, 0.0, marks=long_study),
        (0.2, 0.05),
    ],
)
def test_the_interval_holds_at_any_scatter(scatter: float, outliers: float) -> None:
    """16 sets of 40 pairs a row; `make test-all` has all three."""
    law = synthesise.hunt_crossley(0.5)

    def make(seed: int) -> SpeedPairs:
        rng = np.random.default_rng(seed)
        v = rng.uniform(0.2, 3.0, 40)
        off = 1 + scatter * rng.standard_normal(40)
        off = np.where(rng.random(40) < outliers, rng.uniform(0.1, 0.5, 40), off)
        e = np.clip(np.array([law(x) for x in v]) * off, 0.0, 1.15)
        return SpeedPairs("p", EXACT, v, e, np.zeros(40), np.zeros(40))

    held, found = hits(make, 0.5)
    assert held >= 13
    assert np.median(found) == pytest.approx(scatter, rel=0.2)


def test_a_second_file_does_not_let_more_impacts_of_the_first_be_anywhere() -> None:
    """The bound was of all files together, and each of two freed a third of its impacts."""
    law = synthesise.hunt_crossley(0.2)
    v = np.linspace(0.5, 3.0, 6)
    e = np.array([law(x) for x in v]) * (1 + 1e-3 * np.random.default_rng(1).standard_normal(6))
    e[[0, 3]] *= 0.3, 0.8
    data = SpeedPairs("p", EXACT, v, e, np.zeros(6), np.zeros(6))
    freed = [int((wide > 1.0).sum()) for wide in _freed(LAWS[WITH_E0], [data, data], 1.0)]
    assert freed == [1, 1]
