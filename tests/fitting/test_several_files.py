"""Several drops of one ball, and two materials against each other."""

from __future__ import annotations

import numpy as np
import pytest
from measured_bounces import EXACT, synthesise, times_of

from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.fit import fit
from hcbench.fitting.heights import odd_drops, ratio, shared_value
from hcbench.fitting.linear import Estimate
from hcbench.fitting.result import band, points_text
from hcbench.laws.closed_form import restitution


def drop(name: str, alpha: float, seed: int) -> TouchTimes:
    return TouchTimes(name, EXACT, times_of(synthesise.hunt_crossley(alpha), seed))


def estimates(alpha: float, between: float, own: float, count: int, seed: int) -> list[Estimate]:
    rng = np.random.default_rng(seed)
    values = alpha * np.exp(between * rng.standard_normal(count) + own * rng.standard_normal(count))
    return [Estimate(v, own * v, v * np.exp(-1.96 * own), v * np.exp(1.96 * own)) for v in values]


@pytest.mark.parametrize(
    ("between", "count"), [(0.04, 10), (0.04, 4), (0.0, 10), (0.1, 10), (0.01, 10)]
)
def test_the_interval_holds_whether_drops_differ_or_not(between: float, count: int) -> None:
    found = [shared_value(estimates(0.2, between, 0.015, count, seed)) for seed in range(100)]
    held = [one.estimate().low <= 0.2 <= one.estimate().high for one in found]
    assert np.mean(held) >= 0.91
    if count == 10 and between >= 0.04:
        assert np.median([one.between for one in found]) == pytest.approx(between, rel=0.3)


def test_an_odd_drop_is_found_and_no_other() -> None:
    false = [odd_drops(estimates(0.2, 0.04, 0.015, 4, seed)) for seed in range(100)]
    assert sum(map(bool, false)) <= 2
    for seed in range(20):
        each = [*estimates(0.15, 0.01, 0.015, 3, seed), *estimates(0.3, 0.01, 0.015, 1, seed)]
        ((which, off),) = odd_drops(each)
        assert which == 3 and off > 4


def test_two_materials_differ_or_not() -> None:
    different = [
        ratio(estimates(0.2, 0.03, 0.015, 5, 2 * s), estimates(0.3, 0.03, 0.015, 5, 2 * s + 1))
        for s in range(50)
    ]
    assert np.mean([one.low <= 2 / 3 <= one.high for one in different]) >= 0.9
    assert np.mean([one.high < 1 for one in different]) >= 0.98
    same = [
        ratio(estimates(0.2, 0.03, 0.015, 5, 2 * s), estimates(0.2, 0.03, 0.015, 5, 2 * s + 1))
        for s in range(50)
    ]
    assert np.mean([one.low <= 1 <= one.high for one in same]) >= 0.9


def test_drops_that_agree_narrow_the_interval() -> None:
    files = [drop(f"{i}", 0.3, i) for i in range(4)]
    four, *each = (
        fit(sets, "hunt-crossley").alpha for sets in [files, *([file] for file in files)]
    )
    assert four is not None
    widths = [one.high - one.low for one in each if one is not None]
    assert four.high - four.low < np.mean(widths)
    assert four.low < 0.3 < four.high


def test_a_file_that_does_not_go_with_the_others_is_named() -> None:
    found = fit([drop("a", 0.15, 1), drop("b", 0.15, 2), drop("c", 0.15, 3), drop("other", 0.3, 4)])
    assert any(warning.startswith("other does not go with") for warning in found.warnings)
    assert found.between is not None and found.between > 0.1


@pytest.mark.parametrize("law", ["constant", "hunt-crossley"])
def test_the_curve_of_several_drops_has_the_number_that_is_given(law: str) -> None:
    """The mean of drops is not that of all their impacts: once the curve and the headline differed."""
    each = (0.15, 0.2, 0.3)
    curves = [
        synthesise.hunt_crossley(value) if law != "constant" else synthesise.constant(1.0 - value)
        for value in each
    ]
    sets = [
        TouchTimes(str(n), EXACT, times_of(curve, n)[: 8 + 4 * n]) for n, curve in enumerate(curves)
    ]
    found = fit(sets, law)
    speeds, e, low, high = band(found)
    assert (low < e).all()
    assert (e < high).all()
    rows = points_text(found).splitlines()[2:]
    of_points = np.array([float(row.split(",")[1]) for row in rows])
    of_speeds = [float(row.split(",")[0]) for row in rows]
    if law == "constant":
        assert found.restitution is not None
        assert e == pytest.approx(found.restitution.value, rel=1e-6)
        assert of_points == pytest.approx(found.restitution.value, rel=1e-5)
    else:
        assert found.alpha is not None
        assert e == pytest.approx(restitution(found.alpha.value, speeds), rel=1e-3)
        expected = restitution(found.alpha.value, np.array(of_speeds))
        assert of_points == pytest.approx(expected, rel=1e-3)
