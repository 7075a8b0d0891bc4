"""Impacts read off the steps of an engine: while they are taken or from their record, to the same bits;
and the speeds of an impact under gravity, from free states beside the contact, whichever they are.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

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
from hcbench.terms.impact import Floats, Launch, Status
from hcbench.terms.scene import load_scene

TOUCH_PLANE, EXACT = SpeedReading.TOUCH_PLANE, SpeedReading.TOUCH_PLANE_EXACT_FLIGHT
QUARTERS = SpeedReading.TOUCH_PLANE_FOUR_SUBSTEPS
STEPS = st.floats(1e-4, 5e-3)
SPEEDS = st.floats(0.1, 5.0)


def flight(
    h: float, g: float, speed: float, phase: float, share: float
) -> tuple[np.ndarray, np.ndarray]:
    """Penetration and rate at eight states about the touch at `speed`;
    share: of g h² in a step's way.
    """
    n = np.arange(-4, 4)
    x = [-(speed * phase * h)]
    v = [speed]
    for _ in n[1:]:
        x.append(x[-1] + h * v[-1] + share * g * h * h)
        v.append(v[-1] + g * h)
    return np.array(x), np.array(v)


@given(h=STEPS, g=st.floats(0.5, 30.0), speed=SPEEDS, phase=st.floats(0, 4))
@pytest.mark.parametrize(
    ("reading", "share"), [(TOUCH_PLANE, 1.0), (QUARTERS, 0.625), (EXACT, 0.5)]
)
def test_every_state_of_a_flight_tells_the_same_speed_at_the_plane(
    reading: SpeedReading, share: float, h: float, g: float, speed: float, phase: float
) -> None:
    x, v = flight(h, g, speed, phase, share)
    speed_in, speed_out = reading.speeds((x, v), (x, v), g * h, g)
    assert np.ptp(speed_in) < 1e-12 * speed_in[0]
    assert np.array_equal(speed_in, speed_out)
    if share == 0.5:  # the parabola itself
        assert speed_in[0] ** 2 == pytest.approx(speed**2 + 2 * g * speed * phase * h, rel=1e-12)


@given(v=SPEEDS, e=st.floats(0, 1), x=st.floats(0, 1e-3))
@pytest.mark.parametrize("reading", list(SpeedReading))
def test_without_gravity_all_readings_are_the_velocities(
    reading: SpeedReading, v: float, e: float, x: float
) -> None:
    state = (np.array([x]), np.array([v]))
    speed_in, speed_out = reading.speeds(state, (state[0], -e * state[1]), 0.0, 0.0)
    assert (speed_in[0], speed_out[0]) == (v, e * v)


@given(h=STEPS, g=st.floats(0.5, 30.0), speed=st.floats(0.02, 5.0), phase=st.floats(0, 0.999))
@pytest.mark.parametrize("reading", list(SpeedReading))
def test_a_launch_touches_at_the_speed_and_phase_it_is_made_for(
    reading: SpeedReading, h: float, g: float, speed: float, phase: float
) -> None:
    launch = Launch.touching(speed, phase, h, g, share=reading.share)
    gap, v = launch.clearance(h), launch.speed
    assert v >= 0
    assert gap >= 0
    if gap > 0:
        came = np.array([-gap]), np.array([v])
        (at_touch,), _ = reading.speeds(came, (np.zeros(1), np.zeros(1)), g * h, g)
        assert at_touch == pytest.approx(speed, rel=1e-9)
    if v > 0:
        steps = 2 * gap / (v + reading.share * g * h + speed) / h  # at the mean speed
        assert steps % 1 == pytest.approx(phase, abs=1e-6) or steps % 1 == pytest.approx(
            1.0, abs=1e-6
        )


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
