"""The speeds of an impact under gravity: read off free states beside
the contact, whichever they are.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hcbench.sim.read_impact import SpeedReading
from hcbench.terms.impact import Launch

PLANE, EXACT = SpeedReading.TOUCH_PLANE, SpeedReading.TOUCH_PLANE_EXACT_FLIGHT
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
@pytest.mark.parametrize(("reading", "share"), [(PLANE, 1.0), (QUARTERS, 0.625), (EXACT, 0.5)])
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
