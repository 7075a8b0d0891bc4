"""The paper's steps (2) ... (15), each against what (16) itself does."""

from __future__ import annotations

from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.paper import approximations as ap
from hcbench.system.errors import UserError

K, MASS = 3.4064e10, 0.45359237
BY_NAME = {a.name: a for a in ap.APPROXIMATIONS}
SPEEDS = np.array([0.01, 0.1, 0.5])


def _depth(exponent: float, speed: Any, mass: float = MASS) -> Any:
    """x_m of eq. (8), ½ m v_i² = k x_m^(n+1)/(n+1)."""
    return ((exponent + 1.0) * mass * speed**2 / (2.0 * K)) ** (1.0 / (exponent + 1.0))


def _bounce(law: HuntCrossley, mass: float, speed: float) -> tuple[float, float, float]:
    """e, work on the way in and work on the way out, by an ODE in units of the impact's own size."""
    n = law.exponent
    depth = float(_depth(n, speed, mass))
    time = depth / speed
    d = law.dissipation * speed
    push = law.stiffness * depth**n * time**2 / (mass * depth)  # (n + 1)/2

    def rate(t: float, y: np.ndarray) -> list[float]:
        x = max(y[0], 0.0) ** n
        return [y[1], -push * x * (1.0 + d * y[1]), push * d * x * y[1] ** 2]

    def turned(t: float, y: np.ndarray) -> float:
        return float(y[1])

    def parted(t: float, y: np.ndarray) -> float:
        return float(y[0]) if t > 0.1 else 1.0

    turned.direction = parted.direction = -1  # type: ignore[attr-defined]
    parted.terminal = True  # type: ignore[attr-defined]
    run: Any = solve_ivp(
        rate,
        (0, 50),
        [0, 1, 0],
        "DOP853",
        rtol=1e-12,
        atol=1e-14,
        events=[turned, parted],
        max_step=0.05,
    )
    inward, whole = run.y_events[0][0][2], run.y_events[1][0][2]
    energy = mass * speed**2
    return -run.y_events[1][0][1], inward * energy, (whole - inward) * energy


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("mass", [0.01, 100.0])
def test_the_factor_3_2_alpha_k_depends_on_neither_exponent_nor_mass(
    exponent: float, mass: float
) -> None:
    """α read off simulated bounces of λ = (3/2) α k, as v goes to 0, is
    the α that was put in: eq. (15).
    """
    alpha = 0.3
    slopes = []
    for speed in (0.004, 0.002):
        e, _, _ = _bounce(HuntCrossley(K, alpha, exponent), mass, speed)
        slopes.append((1.0 - e) / (alpha * speed))
    assert 2.0 * slopes[1] - slopes[0] == pytest.approx(
        1.0, abs=3e-6
    )  # what is left goes with (α v)²


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.5])
def test_10_starts_at_the_speed_in_of_9_and_ends_at_0(exponent: float) -> None:
    depth = _depth(exponent, SPEEDS)
    np.testing.assert_allclose(ap.speed_at(K, MASS, exponent, depth, 0.0), SPEEDS, rtol=1e-13)
    assert ap.speed_at(K, MASS, exponent, depth, depth).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("name", BY_NAME)
def test_every_step_is_exact_as_alpha_v_goes_to_0(name: str) -> None:
    assert abs(float(BY_NAME[name].error(1e-9))) < 5e-9
    assert float(BY_NAME[name].error(0.0)) == 0.0


def _in_50_digits(name: str, u: float, n: float) -> mpmath.mpf:
    with mpmath.workdps(50):
        u = mpmath.mpf(u)
        d = u * 3 / 2
        e = (1 + mpmath.lambertw(-(1 + d) * mpmath.exp(-(1 + d)))).real / d
        g = 2 * (d - mpmath.log(1 + d)) / d**2
        return {
            "restitution": (1 - u) / e,
            "loss": 2 * u / (1 - e**2),
            "depth": g ** (-1 / (mpmath.mpf(n) + 1)),
            "speed in": mpmath.sqrt(g),
            "speed out": mpmath.sqrt(g) / e,
            "loss from depth": 2 * u * g ** (mpmath.mpf(3) / 2) / (1 - e**2),
            "equal halves": 2 * (1 - g) / (1 - e**2),
        }[name]


@pytest.mark.parametrize("name", BY_NAME)
@pytest.mark.parametrize("u", [1e-9, 1e-4, 0.01, 0.033, 0.034, 0.3, 0.9, 3.0, 30.0])
def test_the_errors_agree_with_50_digit_arithmetic(name: str, u: float) -> None:
    wanted = _in_50_digits(name, u, 1.25)
    got = float(BY_NAME[name].error(u, 1.25)) + 1.0
    assert got == pytest.approx(float(wanted), rel=2e-14)


@pytest.mark.parametrize("u", [0.05, 0.3, 0.8])
@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_the_errors_agree_with_a_simulated_loop(u: float, exponent: float) -> None:
    alpha, speed = 0.5, u / 0.5
    law = HuntCrossley(K, alpha, exponent)
    e, inward, outward = _bounce(law, MASS, speed)
    whole = inward + outward
    depth = float(closed_form.penetration_max(law, MASS, speed))
    by_9 = float(ap.speed_at(K, MASS, exponent, depth, 0.0))
    measured = {
        "restitution": (1 - u) / e,
        "loss": alpha * MASS * speed**3 / whole,
        "depth": _depth(exponent, speed) / depth,
        "speed in": by_9 / speed,
        "speed out": by_9 / (e * speed),
        "loss from depth": alpha * MASS * by_9**3 / whole,  # (11) is (3) at the speed of (9)
        "equal halves": 2 * inward / whole,
    }
    for name, ratio in measured.items():
        assert float(BY_NAME[name].error(u, exponent)) + 1.0 == pytest.approx(ratio, rel=2e-9), name


def test_10_is_worst_where_contact_starts_and_ends() -> None:
    law = HuntCrossley(K, 0.5)
    depth = float(closed_form.penetration_max(law, MASS, 0.6))
    x = np.linspace(0.0, 0.999 * depth, 200)
    approximate = ap.speed_at(K, MASS, 1.5, depth, x)
    inward = approximate / closed_form.rate_at(law, MASS, 0.6, x, "approach") - 1.0
    outward = approximate / -closed_form.rate_at(law, MASS, 0.6, x, "rebound") - 1.0
    assert (
        inward.min() == inward[0] == pytest.approx(float(BY_NAME["speed in"].error(0.3)), rel=1e-9)
    )
    assert (
        outward.max()
        == outward[0]
        == pytest.approx(float(BY_NAME["speed out"].error(0.3)), rel=1e-9)
    )


@pytest.mark.parametrize("name", BY_NAME)
@pytest.mark.parametrize("error", [0.01, 0.1])
def test_an_error_is_met_where_it_says_and_nowhere_before(name: str, error: float) -> None:
    where = BY_NAME[name].reaches(error)
    assert abs(float(BY_NAME[name].error(where))) == pytest.approx(error, rel=1e-9)
    before = np.linspace(0.0, where * (1 - 1e-9), 2000)
    assert np.abs(BY_NAME[name].error(before)).max() < error


def test_the_paper_holds_in_its_own_range_but_for_the_dropped_square() -> None:
    """At α = 0.008 s/in and 16 in/s (α v = 0.128): (2) errs 1.6 %, (11) 0.06 %, but (3) 20 %."""
    u = 0.008 * 16
    assert float(BY_NAME["restitution"].error(u)) == pytest.approx(-0.0162, abs=1e-4)
    assert abs(float(BY_NAME["loss from depth"].error(u))) < 6e-4
    assert float(BY_NAME["loss"].error(u)) == pytest.approx(0.195, abs=1e-3)


def test_bad_numbers_are_named() -> None:
    with pytest.raises(UserError, match=r"u: -0\.1"):
        BY_NAME["loss"].error(-0.1)
    with pytest.raises(UserError, match="error: 1"):
        BY_NAME["loss"].reaches(1.0)
