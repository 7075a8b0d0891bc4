"""Section 2.2's q = 2: its constant derived, its bounce in closed form, its fault."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from hcbench.laws import closed_form
from hcbench.laws.kelvin_voigt import Ending
from hcbench.laws.ode import impact
from hcbench.paper import approximations as ap
from hcbench.paper.approximations import QuadraticDamping, turning_point
from hcbench.paper.approximations import quadratic_restitution as restitution
from hcbench.system.errors import UserError

K, MASS, ALPHA = 3.4064e10, 0.45359237, 0.3


def _depth(exponent: float, speed: float) -> float:
    """x_m of eq. (8), m."""
    return float(((exponent + 1.0) * MASS * speed**2 / (2.0 * K)) ** (1.0 / (exponent + 1.0)))


def _loss(exponent: float, depth: float) -> float:
    """ΔE of eq. (11), J: α m v³ of (3) at the speed that (9) gives for the depth (m)."""
    return float(ALPHA * MASS * ap.speed_at(K, MASS, exponent, depth, 0.0) ** 3)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.2])
def test_the_constant_makes_the_loop_lose_what_11_says_at_every_depth(exponent: float) -> None:
    law = QuadraticDamping(K, ALPHA, MASS, exponent)
    for depth in (1e-6, 3e-5):

        def damping(x: float, depth: float = depth) -> float:
            speed = float(ap.speed_at(K, MASS, exponent, depth, x))
            return float(law.force(x, speed) - law.force(x, 0.0))

        value, _ = quad(damping, 0.0, depth, epsabs=0.0, epsrel=1e-11, limit=400)
        assert 2.0 * value == pytest.approx(_loss(exponent, depth), rel=1e-8)


def test_the_constant_goes_with_the_roots_of_the_mass_and_of_the_exponent_plus_1() -> None:
    """Section 2.2: "λ being no longer independent of n"."""
    law, other = QuadraticDamping(K, ALPHA, MASS), QuadraticDamping(K, ALPHA, 4 * MASS, 9.0)
    assert other.factor / law.factor == pytest.approx(2.0 * np.sqrt(10.0 / 2.5), rel=1e-14)


def test_with_x_to_the_n_no_constant_would_do() -> None:
    """∮ λ x^n v² dx goes with x_m^(2(n+1)), (11) with x_m^(3(n+1)/2):
    their ratio is not the same twice.
    """
    ratios = []
    for depth in (1e-6, 1e-5):
        value, _ = quad(
            lambda x, depth=depth: x**1.5 * float(ap.speed_at(K, MASS, 1.5, depth, x)) ** 2,
            0.0,
            depth,
        )
        ratios.append(value / _loss(1.5, depth))
    assert ratios[1] / ratios[0] == pytest.approx(10.0**1.25, rel=1e-9)


@pytest.mark.parametrize("u", [1e-12, 1e-6, 1e-3, 0.1, 0.5, 2.0, 50.0])
def test_the_closed_form_agrees_with_40_digit_arithmetic(u: float) -> None:
    with mpmath.workdps(40):
        s = mpmath.mpf(9) / 8 * mpmath.mpf(u) ** 2
        z = (1 + mpmath.lambertw((s - 1) / mpmath.e)).real
        surface = mpmath.sqrt((1 - (1 + z) * mpmath.exp(-z)) / s)
        force = mpmath.sqrt((z - mpmath.log(1 + z)) / s)
    assert float(turning_point(u)) == pytest.approx(float(z), rel=3e-15)
    assert float(restitution(1.0, u)) == pytest.approx(float(surface), rel=3e-15)
    assert float(restitution(1.0, u, Ending.FORCE)) == pytest.approx(float(force), rel=3e-15)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
@pytest.mark.parametrize("u", [0.05, 0.3, 1.0])
def test_the_closed_form_agrees_with_the_differential_equation(exponent: float, u: float) -> None:
    law, speed = QuadraticDamping(K, ALPHA, MASS, exponent), u / ALPHA
    depth = _depth(exponent, speed)
    time = depth / speed

    def force(x: float, v: float) -> float:
        return float(law.force(max(x, 0.0) * depth, v * speed))

    # In y = x^((n+1)/2) the x^(1/4) at touch, which no integrator likes, is
    # gone; see the module's text.
    half = 0.5 * (exponent + 1.0)

    def rate(y: float, w: np.ndarray, way: float) -> list[float]:
        x = y ** (1.0 / half)
        v = way * np.sqrt(max(w[0], 0.0))
        dx = x ** (1.0 - half) / half if y > 0 else 0.0
        return [-2.0 * force(x, v) * dx * depth / (MASS * speed**2)]

    def stopped(y: float, w: np.ndarray) -> float:
        return float(w[0])

    stopped.terminal = True  # type: ignore[attr-defined]
    options: Any = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14}
    inward: Any = solve_ivp(
        lambda y, w: rate(y, w, 1.0), (1e-12, 9.0), [1.0], events=stopped, max_step=0.05, **options
    )
    top = inward.t_events[0][0]
    outward: Any = solve_ivp(lambda y, w: rate(y, w, -1.0), (top, 1e-12), [0.0], **options)
    assert time > 0
    assert np.sqrt(outward.y[0, -1]) == pytest.approx(float(restitution(ALPHA, speed)), rel=1e-9)


@pytest.mark.parametrize("ending", Ending)
def test_the_simulation_of_any_law_agrees_in_both_readings(ending: Ending) -> None:
    law, speed = QuadraticDamping(K, ALPHA, MASS), 0.8
    bounced = impact(law, MASS, speed, ending=ending)
    assert bounced.restitution == pytest.approx(float(restitution(ALPHA, speed, ending)), rel=1e-7)


def test_it_bounces_almost_as_16_does() -> None:
    """Both readings of q = 2 against (16): within 1e-4 up to α v = 0.1 where x is 0 again."""
    u = np.linspace(0.0, 0.1, 50)
    apart = restitution(1.0, u) - closed_form.restitution(1.0, u)
    assert 0 < apart.max() < 1e-4
    assert float(restitution(1.0, 1.0) - closed_form.restitution(1.0, 1.0)) == pytest.approx(
        0.0115, abs=1e-4
    )
    assert np.all(restitution(1.0, u, Ending.FORCE) >= restitution(1.0, u))


def test_it_pulls_before_parting_where_16_does_not() -> None:
    law, speed = QuadraticDamping(K, ALPHA, MASS), 0.4
    out = float(restitution(ALPHA, speed)) * speed
    near = 1e-3 * _depth(1.5, speed)
    assert law.force(near, -out) < 0.0
    assert law.force(near, speed) > 0.0


def test_bad_numbers_are_named() -> None:
    with pytest.raises(UserError, match="mass: -1"):
        QuadraticDamping(K, ALPHA, -1.0)
    with pytest.raises(UserError, match="alpha: -1"):
        QuadraticDamping(K, -1.0, MASS)
    with pytest.raises(UserError, match=r"exponent: 0\.5"):
        QuadraticDamping(K, ALPHA, MASS, 0.5)
    with pytest.raises(UserError, match="α v_i"):
        restitution(-1.0, 1.0)
