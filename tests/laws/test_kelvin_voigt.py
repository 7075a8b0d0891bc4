"""Eq. (4): the damped half-sine, its shock, its tension, and the two
places where its contact may end.
"""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hcbench.laws.force import KelvinVoigt
from hcbench.laws.kelvin_voigt import (
    Ending,
    bounce,
    damping_ratio,
    damping_ratio_for,
    loop,
    matched,
    restitution,
    state,
)
from hcbench.system.errors import UserError

MASS, SPEED = 0.45359237, 0.4064
ZETAS = (1e-9, 1e-4, 0.02, 0.3, 0.5, 0.9, 0.9999, 0.999999, 1.0, 1.000001, 1.2, 3.0, 50.0)


def _law(zeta: float, stiffness: float = 1e8) -> KelvinVoigt:
    return KelvinVoigt(stiffness, 2.0 * zeta * np.sqrt(stiffness * MASS))


def _exact_force_reading(zeta: float) -> mpmath.mpf:
    with mpmath.workdps(50):
        z = mpmath.mpf(zeta)
        root = mpmath.sqrt(mpmath.mpc(1 - z * z))
        g = mpmath.mpf(1) if zeta == 1.0 else (mpmath.acos(mpmath.mpc(z)) / root).real
        return mpmath.exp(-2 * z * abs(g))


@pytest.mark.parametrize("zeta", ZETAS)
def test_restitution_where_the_force_ends_is_right_to_the_last_digits(zeta: float) -> None:
    exact = _exact_force_reading(zeta)
    assert abs(float(restitution(zeta, Ending.FORCE) - exact) / float(exact)) < 4e-15 * max(
        1.0, zeta
    )


@pytest.mark.parametrize("zeta", [z for z in ZETAS if z < 0.9999])
def test_restitution_where_the_surface_is_reached_again(zeta: float) -> None:
    with mpmath.workdps(50):
        z = mpmath.mpf(zeta)
        exact = mpmath.exp(-mpmath.pi * z / mpmath.sqrt(1 - z * z))
    # Near ζ = 1 the exponent is large and carries the rounding of ζ itself.
    tolerance = 4e-15 * (1.0 + float(-mpmath.log(exact)) / (1.0 - zeta))
    assert abs(float(restitution(zeta, Ending.SURFACE) / exact - 1)) < tolerance


def test_no_parting_at_the_surface_once_critically_damped() -> None:
    assert restitution(np.array([1.0, 2.0]), Ending.SURFACE).tolist() == [0.0, 0.0]
    assert bounce(_law(1.5), MASS, SPEED, Ending.SURFACE).duration == np.inf
    with pytest.raises(UserError, match="damping ratio below 1"):
        loop(_law(1.5), MASS, SPEED, Ending.SURFACE)


@pytest.mark.parametrize("ending", Ending)
@pytest.mark.parametrize("zeta", [0.01, 0.2, 0.49, 0.51, 0.8, 0.97])
def test_closed_forms_agree_with_the_differential_equation(zeta: float, ending: Ending) -> None:
    law = _law(zeta)
    k, c = law.stiffness, law.damping

    def parting(t: float, y: np.ndarray) -> float:
        return float(y[0] if ending is Ending.SURFACE else k * y[0] + c * y[1]) if t > 1e-9 else 1.0

    parting.terminal, parting.direction = True, -1  # type: ignore[attr-defined]
    run: Any = solve_ivp(
        lambda t, y: [y[1], -(k * y[0] + c * y[1]) / MASS],
        (0.0, 1.0),
        [0.0, SPEED],
        method="DOP853",
        rtol=1e-13,
        atol=1e-18,
        events=parting,
        dense_output=True,
    )
    end = float(run.t_events[0][0])
    time = np.linspace(0.0, end, 20001)
    x, v = run.sol(time)
    force = k * x + c * v
    ours = bounce(law, MASS, SPEED, ending)
    assert ours.duration == pytest.approx(end, rel=1e-10)
    assert ours.restitution == pytest.approx(-run.y_events[0][0][1] / SPEED, rel=1e-9)
    assert ours.penetration_max == pytest.approx(x.max(), rel=1e-7)
    assert ours.force_max == pytest.approx(force.max(), rel=1e-7)
    assert ours.tension_max == pytest.approx(
        max(0.0, -force.min()), rel=1e-7, abs=1e-9 * ours.force_max
    )
    assert ours.penetration_left == pytest.approx(
        run.y_events[0][0][0], abs=1e-9 * ours.penetration_max
    )
    np.testing.assert_allclose(state(law, MASS, SPEED, time)[1], v, atol=1e-10 * SPEED)


def test_it_starts_with_a_shock_and_ends_by_pulling() -> None:
    law = _law(0.1)
    whole = loop(law, MASS, SPEED, Ending.SURFACE)
    assert whole.force[0] == pytest.approx(law.damping * SPEED, rel=1e-15)
    assert whole.force[-1] == pytest.approx(
        -law.damping * SPEED * restitution(0.1, Ending.SURFACE), rel=1e-12
    )
    pressed = loop(law, MASS, SPEED, Ending.FORCE)
    assert pressed.force[:-1].min() > 0.0
    assert abs(pressed.force[-1]) < 1e-12 * pressed.force.max()
    assert pressed.penetration[-1] > 0.0


@pytest.mark.parametrize("ending", Ending)
def test_energy_lost_goes_with_the_square_of_the_speed_and_is_the_area_of_the_loop(
    ending: Ending,
) -> None:
    law = _law(0.07)
    losses = [bounce(law, MASS, v, ending).energy_loss for v in (0.1, 0.2, 0.4)]
    assert losses[1] / losses[0] == pytest.approx(4.0, rel=1e-14)
    assert losses[2] / losses[1] == pytest.approx(4.0, rel=1e-14)
    whole = loop(law, MASS, 0.4, ending, 200_001)
    area = np.trapezoid(whole.force, whole.penetration)
    assert area == pytest.approx(losses[2], rel=1e-8)


@pytest.mark.parametrize("ending", Ending)
@pytest.mark.parametrize("e", [1.0, 0.9999, 0.93, 0.5, 0.1, 1e-3, 1e-6])
def test_damping_ratio_is_the_inverse_of_restitution(e: float, ending: Ending) -> None:
    assert float(restitution(damping_ratio_for(e, ending), ending)) == pytest.approx(e, rel=1e-12)


@pytest.mark.parametrize("ending", Ending)
def test_a_matched_spring_and_damper_bounces_as_asked(ending: Ending) -> None:
    law = matched(0.8863786, 1.7e-4, MASS, ending)
    ours = bounce(law, MASS, SPEED, ending)
    assert ours.restitution == pytest.approx(0.8863786, rel=1e-12)
    assert ours.duration == pytest.approx(1.7e-4, rel=1e-12)
    assert damping_ratio(law, MASS) < 0.05


@pytest.mark.parametrize("e", [0.0, -0.1, 1.1, np.nan])
def test_a_restitution_that_no_damper_gives_is_refused(e: float) -> None:
    with pytest.raises(UserError, match=r"restitution.*0 < e <= 1"):
        damping_ratio_for(e, Ending.FORCE)


def test_bad_numbers_are_named() -> None:
    with pytest.raises(UserError, match="zeta: -1"):
        restitution(-1.0, Ending.FORCE)
    with pytest.raises(UserError, match="mass: 0"):
        bounce(_law(0.1), 0.0, SPEED, Ending.FORCE)
    with pytest.raises(UserError, match="speed: -1"):
        bounce(_law(0.1), MASS, -1.0, Ending.FORCE)
