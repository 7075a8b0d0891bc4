"""Steps of a foot on the floor: when it has left, and when its contact only chatters."""

from __future__ import annotations

import numpy as np
import pytest

from hcbench.sim.landing import FootfallLog, take_off_speed

STEP = 1e-3  # s


def landed(*pushes: float) -> FootfallLog:
    """A foot that the floor pushes by 10 N in steps that begin at
    these times, s, sliding at 0.5 m/s.
    """
    foot = FootfallLog(touch=pushes[0], speed=1.0, slide=0.5)
    for time in pushes:
        foot.add(time, STEP, force=10.0, slide=0.5, depth=1e-4)
    return foot


@pytest.mark.parametrize(("gap", "bounces"), [(0.0, 0), (0.0049, 0), (0.0051, 1), (0.02, 1)])
def test_a_foot_that_is_off_the_floor_for_more_than_5_ms_has_left_it(
    gap: float, bounces: int
) -> None:
    foot = landed(0.1, 0.1 + STEP + gap)
    assert foot.bounces == bounces
    # A gap that only chatters belongs to the contact.
    assert foot.contact == pytest.approx(STEP if bounces else 2.0 * STEP + gap)
    assert foot.slip == pytest.approx(2.0 * STEP * 0.5)
    assert foot.force_max == 10.0


@pytest.mark.parametrize(("steps_off", "speed"), [(4, 0.0), (5, 0.7), (9, 0.7)])
def test_a_robot_takes_off_where_no_foot_pushes_for_5_ms(steps_off: int, speed: float) -> None:
    """Rising at 0.7 m/s as the last foot leaves; later steps, back on the floor, are slower."""
    force = np.array([9.0, 9.0, *[0.0] * steps_off, 9.0, 9.0])
    rising = np.array([-1.0, 0.2, 0.7, *[0.1] * (steps_off + 1)])
    assert take_off_speed(force, rising, STEP) == speed
