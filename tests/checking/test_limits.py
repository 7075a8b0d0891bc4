"""Limits on landings: of several that are exceeded, the one by the largest share is named."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hcbench.checking.outcome import Limit, Verdict, judge_landings, read_limits
from hcbench.sim.landing import Footfall, Landing, Landings


def landings(e: float, slip: float, penetration: float) -> Landings:
    """One drop in which a foot slips, m, and goes so deep, m."""
    foot = Footfall("foot", 0.0, 1.0, 0.0, 0.01, 0, 50.0, slip, penetration)
    none = np.zeros(0)
    drop = Landing(0.1, 0.0, 1.0, e, 10.0, (foot,), none, none)
    return Landings(
        "engine", "1", "dog", "base", "floor", "its pose", "pd", 1.0, 1e-3, 9.81, (drop,)
    )


@pytest.mark.parametrize(
    ("text", "excesses"),
    [
        ("slip < 5 mm", {0.004: -0.2, 0.005: 0.0, 0.010: 1.0}),
        ("e > 0.2", {0.3: -0.5, 0.1: 0.5, math.nan: math.inf}),
        ("bouncing < 0", {0.0: 0.0, 2.0: 2.0}),
    ],
)
def test_a_value_is_beyond_a_limit_by_a_share_of_it(
    text: str, excesses: dict[float, float]
) -> None:
    """A limit of 0 has no share: the value itself counts."""
    (limit,) = read_limits(text, of_landing=True)
    assert isinstance(limit, Limit)
    for value, excess in excesses.items():
        assert limit.excess(value) == pytest.approx(excess)


@pytest.mark.parametrize(
    ("e", "slip", "named"),
    [(0.4, 0.010, "slip 0.01 (SI)"), (0.6, 0.006, "e 0.6 (SI)"), (0.1, 0.004, "slip 0.004 (SI)")],
)
def test_the_value_nearest_to_its_limit_or_farthest_beyond_is_named(
    e: float, slip: float, named: str
) -> None:
    """Twice a slip of 5 mm is worse than 4/3 of an e of 0.3, although 5 mm are the smaller number."""
    limits = read_limits("e < 0.3, slip < 5 mm", of_landing=True)
    verdict, message = judge_landings(landings(e, slip, 0.0), limits)
    assert message.startswith(named)
    assert (verdict is Verdict.PASSED) == (e < 0.3)
