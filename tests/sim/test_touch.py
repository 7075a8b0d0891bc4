"""Two bodies are brought just to touch, by distance or by a scan; those that cannot be are refused."""

from __future__ import annotations

import math

import pytest

from hcbench.sim.touch import require_apart, require_reachable, travel_by_distance, travel_by_scan
from hcbench.system.errors import SceneError, UserError


@pytest.mark.parametrize("approach", [1.0, 0.5])
def test_a_straight_approach_takes_one_round(approach: float) -> None:
    seen: list[float] = []

    def distance(travel: float) -> float:
        seen.append(travel)
        return 1.0 - approach * travel

    assert travel_by_distance(distance, 0.1, approach) == pytest.approx(1.0 / approach)
    assert len(seen) == 2


def test_a_curved_approach_converges() -> None:
    assert travel_by_distance(lambda x: math.sqrt(1 + (2 - x) ** 2) - 1, 1e-3) == pytest.approx(
        2, abs=0.05
    )
    assert travel_by_distance(math.cos, 1.0) == pytest.approx(math.pi / 2)


def test_a_scan_finds_where_contact_begins_to_the_last_bit() -> None:
    edge = 0.123456789
    travel = travel_by_scan(lambda x: x >= edge, -1.0, 1.0)
    assert travel == pytest.approx(edge, rel=1e-15)
    assert travel_by_scan(lambda x: False, -1.0, 1.0) is None


def test_a_tenth_of_the_smaller_one_is_the_deepest_start() -> None:
    """Two that overlap by less are moved apart; deeper ones were meant otherwise."""
    for size in (0.02, 1.0):
        require_apart(-0.0999 * size, size, "ball", "plate")
        require_reachable(0.0999 * size, size, ("ball", "plate"), ("'tail'", "'wall'"))
        with pytest.raises(SceneError, match="inside 'plate'"):
            require_apart(-0.1001 * size, size, "ball", "plate")
        with pytest.raises(UserError, match="inside 'wall'"):
            require_reachable(0.1001 * size, size, ("ball", "plate"), ("'tail'", "'wall'"))


def test_a_deep_start_and_a_blocked_way_are_refused() -> None:
    require_apart(-0.009, 0.1, "ball", "plate")
    with pytest.raises(SceneError, match=r"'ball' starts 0.02 m inside 'plate'.*Move one away"):
        require_apart(-0.02, 0.1, "ball", "plate")
    require_reachable(0.009, 0.1, ("ball", "plate"), ("'tail'", "'wall'"))
    with pytest.raises(
        UserError, match=r"'ball' cannot reach 'plate': 'tail'.* 0.02 m inside 'wall'"
    ):
        require_reachable(0.02, 0.1, ("ball", "plate"), ("'tail'", "'wall'"))
