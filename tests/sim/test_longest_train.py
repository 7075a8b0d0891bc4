"""The longest train of bounces that a target allows, against the
geometric series of a bouncing ball.
"""

from __future__ import annotations

import numpy as np
import pytest

from hcbench.laws.restitution import ConstantRestitution, Restitution
from hcbench.sim.passivity import LongestTrain

G = 9.81  # m/s²


def ends_after(e: float, height: float) -> float:
    """Time, s, after which a ball with one e for all speeds lies still:
    a geometric series of flights.
    """
    fall = np.sqrt(2.0 * height / G)
    return float(fall * (1.0 + e) / (1.0 - e))


@pytest.mark.parametrize(
    ("error", "allowed"), [(0.0, 0.9), (0.02, 0.92), (0.05, 0.95), (0.3, 0.95)]
)
def test_an_impact_may_lose_less_by_the_error_but_half_of_the_target_at_least(
    error: float, allowed: float
) -> None:
    train = LongestTrain(ConstantRestitution(0.9), error, fastest=1.0)
    assert train.restitution(np.array([0.1, 1.0, 3.0])) == pytest.approx(allowed)


def test_nothing_is_promised_above_the_band() -> None:
    law = Restitution(0.3)
    train = LongestTrain(law, 0.0, fastest=0.5)
    assert train.restitution(np.array([0.5, 2.0])) == pytest.approx(float(law.at(0.5)))


@pytest.mark.parametrize(("error", "e"), [(0.0, 0.9), (1.0, 0.95)])
def test_a_train_lasts_as_long_as_its_geometric_series(error: float, e: float) -> None:
    """To a hundredth: hops slower than 1 mm/s count as rest."""
    train, heights = LongestTrain(ConstantRestitution(0.9), error, fastest=10.0), (0.05, 0.2)
    for height in heights:
        end = ends_after(e, height)
        assert train.rebounds_after([height], G, 0.97 * end)[0] > 0.0
        assert train.rebounds_after([height], G, 1.01 * end)[0] == 0.0


def test_a_ball_under_way_has_the_speed_of_its_last_bounce() -> None:
    """Half a flight after its second bounce it left the plate at e² times the speed of the fall."""
    speed = np.sqrt(2.0 * G * 0.2)
    at = (speed + 2.0 * 0.9 * speed + 0.81 * speed) / G
    train = LongestTrain(ConstantRestitution(0.9), 0.0, fastest=10.0)
    assert train.rebounds_after([0.2], G, at)[0] == pytest.approx(0.81 * speed)
