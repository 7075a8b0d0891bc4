"""The test of energy launches a body below and above the band of a setting, each launch once."""

import pytest

from hcbench.sim.passivity import _around_band


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.0314, 0.508), (0.5, 0.5), (0.0314, 3.0), (1e-3, 0.5)],
    ids=["both sides", "one speed", "none above", "none below"],
)
def test_no_launch_around_a_band_is_made_twice(low: float, high: float) -> None:
    launches = _around_band((low, high), 8, 1e-3, 9.81)
    assert len(set(launches)) == len(launches)
    # Both ends of the band are launched too, at all phases.
    assert len(launches) % 8 == 0
    assert len(launches) >= 8 * len({low, high})
