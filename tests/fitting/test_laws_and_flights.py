"""The laws, the flights and their derivatives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from measured_bounces import synthesise

from hcbench.fitting.flight import Ballistics, in_air
from hcbench.fitting.heights import SpeedPairs
from hcbench.fitting.read import read_dataset
from hcbench.fitting.setup import read_setup
from hcbench.fitting.which_law import LAWS, dissipation_of, hunt_crossley
from hcbench.laws import closed_form

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("d", [1e-7, 1e-3, 0.1, 1.0, 10.0, 41.0, 100.0])
def test_the_scalar_law_is_the_closed_form_and_its_slope(d: float) -> None:
    log_e, slope = hunt_crossley(d)
    assert math.exp(log_e) == pytest.approx(float(closed_form.restitution(d / 1.5, 1.0)), rel=1e-12)
    up, down = (hunt_crossley(d * f)[0] for f in (1 + 1e-4, 1 - 1e-4))
    assert slope == pytest.approx((up - down) / 2e-4, rel=1e-4)
    assert dissipation_of(log_e) == pytest.approx(d, rel=1e-9)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("speed", [0.1, 0.5, 2.0])
def test_laws_know_their_own_derivatives(name: str, speed: float) -> None:
    law = LAWS[name]
    parameters = [-0.2, -0.05][: law.count]
    local = law.curve(tuple(parameters), 0.5).local(speed)
    for i, by in enumerate(local[2]):
        moved = [
            law.curve(tuple(p + s * 1e-6 * (i == j) for j, p in enumerate(parameters)), 0.5).local(
                speed
            )[0]
            for s in (1, -1)
        ]
        assert by == pytest.approx((moved[0] - moved[1]) / 2e-6, abs=1e-6)
    ends = [law.curve(tuple(parameters), 0.5).local(speed * f)[0] for f in (1 + 1e-6, 1 - 1e-6)]
    assert local[1] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-6)


@pytest.mark.parametrize("launch", [0.3, 2.0, 4.0])
def test_a_flight_in_air_is_that_of_the_equation_of_motion(launch: float) -> None:
    ball = in_air(9.80665, 2.7e-3, 0.04, 0.47)
    aloft, touch = synthesise.flight_in_air(launch, 2.7e-3, 0.04, 0.47)
    assert ball.aloft(launch)[0] == pytest.approx(aloft, rel=1e-7)
    assert ball.touch(launch)[0] == pytest.approx(touch, rel=1e-7)


@pytest.mark.parametrize("ball", [Ballistics(9.81), Ballistics(9.81, 0.1)])
def test_flights_know_their_own_derivatives(ball: Ballistics) -> None:
    t = np.array([0.05, 0.2, 0.35])
    for name in ("aloft", "touch", "apex", "dropped"):
        of = getattr(ball, name)
        assert of(1.7)[1] == pytest.approx((of(1.7 + 1e-6)[0] - of(1.7 - 1e-6)[0]) / 2e-6, rel=1e-7)
    for of in (ball.path, ball.fall):
        _, by, velocity = of(2.0, t * (1 if of == ball.path else 0.3))
        ends = [of(2.0 + s, t * (1 if of == ball.path else 0.3))[0] for s in (1e-6, -1e-6)]
        assert by == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-6)
        sign, at = (1, t) if of == ball.path else (-1, 0.3 * t)
        later, earlier = (of(2.0, at + sign * s)[0] for s in (1e-6, -1e-6))
        assert velocity == pytest.approx((later - earlier) / 2e-6, rel=1e-5)
    assert ball.path(1.7, np.array([ball.aloft(1.7)[0]]))[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("of", ["rebound height [m]", "flight time [s]"])
def test_the_rebound_of_a_light_ball_is_slowed_by_the_air(tmp_path: Path, of: str) -> None:
    setup = read_setup(mass="2.7 g", diameter="40 mm")
    flight = setup.ballistics
    drops = [0.3, 0.6, 1.0, 1.5, 2.0]
    rows = [f"drop height [m],{of}"]
    for drop in drops:
        launch = 0.9 * flight.dropped(drop)[0]
        measured = flight.apex(launch)[0] if "height" in of else flight.aloft(launch)[0]
        rows.append(f"{drop},{measured:.9f}")
    path = tmp_path / "rebounds.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    found = read_dataset(path, setup)
    assert isinstance(found, SpeedPairs)
    np.testing.assert_allclose(found.restitution, 0.9, rtol=1e-6)
