"""Quantities of a landing, read from motions of known numbers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from hcbench.sim.drop_test import DropMotion, DroppedRobot
from hcbench.sim.landing import DROPS, DropTest, Landed, Robot, drop_test

H, G, WEIGHT, HEIGHT = 1e-3, 9.81, 98.1, 0.1
UP = np.array([0.0, 0.0, 1.0])
ROBOT = DroppedRobot(H, G, UP, WEIGHT, 0.3)
FALL, PUSH, FLIGHT = 143, 20, 200  # steps
LEFT = 0.9  # m/s


def motion(seconds: float, energy_of_flight: float = 5.0) -> DropMotion:
    """A fall, a push of ten weights, a flight that begins at LEFT, then rest 0.5 mm deep."""
    count = round(seconds / H)
    velocity = np.zeros((count, 3))
    velocity[:FALL, 2] = -G * H * np.arange(FALL)
    start = FALL + PUSH
    velocity[start : start + FLIGHT, 2] = LEFT - G * H * np.arange(FLIGHT)
    force = np.zeros(count)
    force[FALL:start] = 10.0 * WEIGHT
    force[start + FLIGHT :] = WEIGHT
    distance = np.where(force > 0.0, -5e-4, 0.0)
    distance[FALL + 3] = -0.004
    energy = np.full(count, 9.81)
    energy[FALL:] = 4.0
    energy[start : start + FLIGHT] = energy_of_flight
    centre = np.zeros((count, 3))
    centre[start:, 0] = 0.02
    return DropMotion(centre, velocity, force, distance, energy)


def landed(of: DropMotion) -> Landed:
    found = ROBOT.landed(of, HEIGHT)
    assert found is not None
    return found


def test_a_landing_has_the_numbers_of_its_motion() -> None:
    found = landed(motion(10.0))
    assert found.rebound == pytest.approx(LEFT**2 / (2.0 * G))
    assert found.peak == pytest.approx(10.0)
    assert (found.depth, found.sink) == (0.004, 5e-4)
    assert found.travel == pytest.approx(0.02)
    assert (found.gain, found.creep, found.vibration, found.late) == (0.0, 0.0, 0.0, 0.0)
    # It lies still after its flight.
    assert found.rest == pytest.approx((PUSH + FLIGHT) * H, abs=2 * H)
    assert not found.fell


def test_a_flight_with_more_energy_than_the_fall_gains() -> None:
    found = landed(motion(1.0, energy_of_flight=12.0))
    assert found.gain == pytest.approx((12.0 - 9.81) / (WEIGHT * HEIGHT))


def test_a_short_drop_tells_the_rebound_and_not_the_rest() -> None:
    found = landed(motion(1.0))
    assert found.rebound == pytest.approx(LEFT**2 / (2.0 * G))
    assert math.isnan(found.rest)


def test_what_flies_off_or_is_not_finite_has_no_landing() -> None:
    good = motion(1.0)
    far, broken = good.centre.copy(), good.velocity.copy()
    far[-1], broken[-1] = 99.0, np.nan
    assert ROBOT.landed(replace(good, centre=far), HEIGHT) is None
    assert ROBOT.landed(replace(good, velocity=broken), HEIGHT) is None
    assert ROBOT.landed(replace(good, force=np.zeros_like(good.force)), HEIGHT) is None


def test_drops_of_two_lengths_are_one_test() -> None:
    robot = Robot("an engine", "m", "base", 10.0, H, (0.0, 0.0, -G), "held")
    landings = {DROPS[0]: landed(motion(1.0)), DROPS[-1]: landed(motion(10.0))}
    test = drop_test(robot, landings, 10.0)
    assert isinstance(test, DropTest)
    assert test.rest == landings[DROPS[-1]].rest
    assert (test.settled, test.falls) == (1, False)
    assert drop_test(robot, {DROPS[0]: landings[DROPS[0]]}, 1.0).falls


def test_a_robot_sags_by_what_level_drops_lower_it_whatever_the_step() -> None:
    """The output had 5.1, 7.3 and 8.3 mm at 4, 2 and 1 ms; and 41 mm of wheels, by a tilted drop."""
    robot = Robot("an engine", "m", "base", 10.0, H, (0.0, 0.0, -G), "held")
    level = motion(10.0)
    # The floor first pushes in a step that begins 3 mm below the touch.
    late = replace(level, centre=level.centre.copy(), distance=level.distance.copy())
    late.distance[FALL] = -3e-3
    late.centre[FALL, 2] -= 3e-3
    for drop in (level, late):
        drop.centre[-5000:, 2] -= 10e-3
    found = [landed(one) for one in (level, late)]
    assert found[0].sag == pytest.approx(10e-3 + 5e-4 - 5e-4)
    assert found[1].sag == pytest.approx(10e-3 - 5e-4)
    tilted = replace(found[0], sag=1e-3)
    drops = {DROPS[0]: found[0], DROPS[-1]: tilted}
    assert drop_test(robot, drops, 10.0).frequency == pytest.approx(math.sqrt(G / found[0].sag))
    flat = {DROPS[0]: replace(found[0], sag=-1e-3), DROPS[-1]: tilted}
    assert math.isnan(drop_test(robot, flat, 10.0).frequency)
