"""Reading impacts while steps are taken gives, to the bit, the same as reading a record of all
steps.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hcbench.sim.columns import Flags, Impacts, Launches
from hcbench.sim.read_impact import (
    Reading,
    SpeedReading,
    begun,
    contacts_of,
    impacts_of,
    reader,
    rule_for,
)
from hcbench.sim.stop import StopRule
from hcbench.sim.world import momentum_force
from hcbench.terms.impact import Floats, Status
from hcbench.terms.scene import load_scene

PLANE = load_scene("steel-plane")
STEP = 1e-4
WORDS = "position, velocity or force is not finite"


def launches(count: int, seed: int) -> Launches:
    rng = np.random.default_rng(seed)
    table = np.zeros((count, 8))
    table[:, 0], table[:, 1], table[:, 2] = (
        rng.uniform(0.01, 0.5, count),
        rng.uniform(0, 1, count),
        np.nan,
    )
    return Launches.of_table(table)


def paths(sent: Launches, gravity: float, seed: int, steps: int = 1000) -> tuple[Floats, Floats]:
    """Heights and velocities upwards, shape (steps + 1, b), of balls on springs and
    dampers of all kinds: some part, some rest or creep, some are caught, leave at once,
    fall through or are not finite.
    """
    rng, b = np.random.default_rng(seed), len(sent)
    m, radius = PLANE.mass, PLANE.touch_radius
    kind = rng.integers(0, 8, b)
    k = m * 10.0 ** rng.uniform(4, 6.5, b)
    c = rng.choice([0.0, 0.1, 1.0, 3.0], b) * np.sqrt(k * m)
    c, k = (
        np.where(kind == 7, 0.0, c),
        np.where(kind == 6, 0.0, k),
    )  # never pushed; through the plate
    z, u = radius + sent.clearance(STEP), np.where(kind == 2, 1.0, -1.0) * sent.speed
    heights, rising = [z], [u]
    for i in range(steps):
        x = radius - z
        f = np.where(x > 0.0, np.maximum(k * x - c * u, -0.1 * k * x), 0.0)
        f = np.where((kind == 1) & (x > 0), np.maximum(f, 0.0), f)
        u = u + STEP * (f / m - gravity)
        u = np.where((kind == 3) & (x > 0.0) & (rng.random(b) < 0.2), 0.0, u)  # caught
        u = np.where((kind == 4) & (i > 20) & (rng.random(b) < 0.01), np.nan, u)
        z = z + STEP * u
        z = np.where((kind == 5) & (x > 0.0), z.astype(np.float32), z)
        heights.append(z)
        rising.append(u)
    return np.array(heights), np.array(rising)


def recorded(
    sent: Launches, heights: Floats, rising: Floats, gravity: float
) -> tuple[Impacts, Flags]:
    """Impacts read from a record of all steps."""
    radius, fall = PLANE.touch_radius, gravity * STEP
    z, u = heights.T, rising.T
    speeds = np.abs(u[:, :-1]) + np.abs(u[:, 1:]) + fall
    f = momentum_force(PLANE.mass, STEP, np.diff(u) + fall, speeds)
    states = np.stack([radius - z[:, :-1], -u[:, :-1], f])
    counts, ends = StopRule.for_launches(sent, STEP, gravity, radius).add(*states)
    time: Floats = np.arange(states.shape[2], dtype=np.float64) * STEP
    over = counts > 0
    read = impacts_of(
        sent.take(over),
        time,
        states[:, over],
        counts[over],
        ends[over],
        gravity,
        SpeedReading.TOUCH_PLANE,
    )
    return read, over


def read(sent: Launches, heights: Floats, rising: Floats, gravity: float, bits: int) -> Reading:
    kind: type = {32: np.float32, 64: np.float64}[bits]
    scene = dataclasses.replace(PLANE, gravity=gravity)
    rule, add = rule_for(sent, scene, STEP, bits, kind), reader(np)
    reading = begun(heights[0], rising[0], kind)
    for z, u in zip(heights[1:].astype(kind), rising[1:].astype(kind), strict=True):
        reading = Reading(*add(z, u, *rule, *reading))
    return reading


def impacts_read(sent: Launches, reading: Reading, gravity: float) -> Impacts:
    seen = contacts_of(reading)
    speeds = SpeedReading.TOUCH_PLANE.speeds(seen.came, seen.left, gravity * STEP, gravity)
    return seen.impacts(sent, speeds, STEP, WORDS)


@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_impacts_are_those_of_a_record_to_the_bit(gravity: float) -> None:
    sent = launches(200, 1)
    heights, rising = paths(sent, gravity, 2)
    theirs, over = recorded(sent, heights, rising, gravity)
    reading = read(sent, heights, rising, gravity, 64)
    assert np.array_equal(reading.end > 0, over)
    mine = impacts_read(sent.take(over), Reading(*(column[over] for column in reading)), gravity)
    assert {Status.PARTED, Status.RESTED, Status.NO_TOUCH, Status.DIVERGED} == {
        i.status for i in mine
    }
    # As tuples: from Python 3.13 a dataclass with a NaN is not equal to its copy.
    without_loops = [dataclasses.replace(impact, loop=None) for impact in theirs]
    assert [*map(dataclasses.astuple, mine)] == [*map(dataclasses.astuple, without_loops)]


def test_float32_is_near_enough() -> None:
    sent = launches(200, 3)
    heights, rising = paths(sent, 9.81, 4)
    exact, rounded = (
        impacts_read(sent, read(sent, heights, rising, 9.81, bits), 9.81).restitution
        for bits in (64, 32)
    )
    both = np.isfinite(exact) & (exact > 0.0) & np.isfinite(rounded)
    assert both.sum() > 50
    assert np.abs(exact - rounded)[both].max() < 5e-4
