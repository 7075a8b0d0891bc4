"""Launches under gravity: a body that an engine steps reaches the plate at
the speed and phase asked for.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from hcbench.system.errors import QuantityError
from hcbench.terms.impact import Floats, Launch

G, H = 9.8, 0.01  # m/s², s


def positions(launch: Launch, substeps: int) -> Floats:
    """Penetration at the ends of steps, each of semi-implicit
    substeps: the new speed moves the body.
    """
    x, v = -launch.clearance(H), launch.speed
    path = [x]
    for _ in range(6):
        for _ in range(substeps):
            v += G * H / substeps
            x += v * H / substeps
        path.append(x)
    return np.array(path)


@pytest.mark.parametrize("phase", [0.05, 0.5, 0.95])
@pytest.mark.parametrize(("substeps", "share"), [(1, 0.5), (4, 0.125)])
@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_a_launch_under_gravity_touches_at_its_speed_and_phase(
    speed: float, substeps: int, share: float, phase: float
) -> None:
    """The states of a flight at constant acceleration lie on one parabola, which tells both."""
    launch = Launch.touching(speed, phase, H, G, share=share)
    path = np.polynomial.Polynomial.fit(H * np.arange(7), positions(launch, substeps), 2)
    touch = min(time for time in path.roots().real if time > 0.0)
    assert touch == pytest.approx((2.0 + phase) * H, rel=1e-9)
    assert path.deriv()(touch) == pytest.approx(speed, rel=1e-9)


def test_a_body_too_slow_for_a_whole_step_falls_from_rest() -> None:
    """0.5 g h of its speed is gained by the first step's move: the
    height has the rest of the energy.
    """
    slow = 0.8 * G * H
    launch = Launch.touching(slow, 0.9, H, G)
    assert launch.speed == 0.0
    assert launch.height == pytest.approx((0.64 - 0.25) * G * H * H / 2.0)


@pytest.mark.parametrize(
    "given",
    [
        {"speed": math.nan},
        {"speed": -1.0},
        {"speed": math.inf},
        {"speed": 1.0, "phase": 1.0},
        {"speed": 1.0, "phase": -0.1},
        {"speed": 1.0, "height": -1e-3},
        {"speed": 1.0, "slip": (math.inf, 0.0)},
        {"speed": 1.0, "spin": (0.0, math.nan, 0.0)},
    ],
)
def test_a_launch_that_no_body_can_have_is_refused(given: dict[str, Any]) -> None:
    name = list(given)[-1]
    with pytest.raises(QuantityError, match=f"^{name}: "):
        Launch(**given)


@pytest.mark.parametrize("angle", [math.pi / 2, 2.0, -2.0, math.inf, math.nan, "30 deg", None])
def test_a_body_cannot_be_sent_at_an_angle_of_90_degrees_or_more(angle: Any) -> None:
    """The tangent gave a slip of the wrong sign."""
    with pytest.raises(QuantityError, match=r"^angle: "):
        Launch.at_angle(angle, 1.0)
    with pytest.raises(QuantityError, match=r"^speed: "):
        Launch.at_angle(0.5, None)  # type: ignore[arg-type]


def test_a_launch_has_the_angle_that_it_was_made_with() -> None:
    for degrees in (0.0, 20.0, 89.9):
        launch = Launch.at_angle(math.radians(degrees), 0.3)
        assert math.degrees(launch.angle) == pytest.approx(degrees, abs=1e-9)
