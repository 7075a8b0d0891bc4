"""The closed forms of eq. (16) against 50-digit arithmetic, the paper's
case, and what must always hold.
"""

from __future__ import annotations

import time
from typing import Any

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from long_searches import long_study
from scipy.special import lambertw

from hcbench.laws import _restitution_series, closed_form
from hcbench.laws.closed_form import gauss_jacobi
from hcbench.laws.force import HuntCrossley
from hcbench.system.errors import UserError

INCH, POUND, LBF = 0.0254, 0.45359237, 4.4482216152605
K3 = 3.1e7 * LBF / INCH**1.5  # of section 3.1
Mp = Any  # mpmath has no types

# α s/in, v_i in/s, e, x_m in, F_max lb of the case of section 3.1: e as in 50-digit arithmetic, x_m
# and F_max the true extremes of the loop, which coarse samples of it fall short of.
PAPER_CASE = [
    (0.008, 4, "0.9689892665", "3.0461e-04", "164.96"),
    (0.008, 8, "0.9398278563", "5.2399e-04", "373.16"),
    (0.008, 12, "0.9123415268", "7.1637e-04", "599.03"),
    (0.008, 16, "0.8863786022", "8.9167e-04", "836.52"),
    (0.016, 16, "0.7953302929", "8.5545e-04", "812.16"),
]

speeds = st.floats(1e-6, 1e3)
alphas = st.floats(1e-9, 1e3)
exponents = st.floats(1.0, 4.0)
arguments = st.floats(1e-9, 1e3)  # d = (3/2) α v_i
log_ratio = st.floats(0.01, 100.0)


def true_restitution(d: Mp) -> Mp:
    """e = (1 + W0(-(1+d) exp(-(1+d)))) / d with 50 digits left after the cancellation at small d."""
    with mpmath.workdps(90):
        d = mpmath.mpf(d)
        return (1 + mpmath.lambertw(-(1 + d) * mpmath.exp(-(1 + d))).real) / d


def relative_errors(found: Any, truth: list[Mp]) -> Any:
    with mpmath.workdps(50):
        return np.array(
            [float(abs(mpmath.mpf(f) / t - 1)) for f, t in zip(found.tolist(), truth, strict=True)]
        )


def _true_g(y: Mp) -> Mp:
    return y - mpmath.log1p(y)


def _true_depth(law: HuntCrossley, mass: float, speed: float, rate: Mp) -> Mp:
    n, a = mpmath.mpf(law.exponent), mpmath.mpf(law.alpha) * 3 / 2
    work = mass / a**2 * (_true_g(a * speed) - _true_g(a * rate))
    return ((n + 1) * work / law.stiffness) ** (1 / (n + 1))


def true_extremes(law: HuntCrossley, mass: float, speed: float) -> tuple[float, float]:
    """x_m and F_max from the path equation, the maximum by root finding, in 30 digits."""
    with mpmath.workdps(30):
        k, n, a = law.stiffness, mpmath.mpf(law.exponent), mpmath.mpf(law.alpha) * 3 / 2

        def log_force_slope(w: Mp) -> Mp:
            x = _true_depth(law, mass, speed, w)
            # d ln F/dv = n x'/x + a/(1 + a v), x' = dx/dv = -m v/(k x^n (1 + a v))
            return a / (1 + a * w) - n * mass * w / (k * x ** (n + 1) * (1 + a * w))

        peak = mpmath.findroot(log_force_slope, (speed / 1000, speed / 2), solver="anderson")
        force = k * _true_depth(law, mass, speed, peak) ** n * (1 + a * peak)
        return float(mpmath.re(_true_depth(law, mass, speed, mpmath.mpf(0)))), float(
            mpmath.re(force)
        )


@pytest.mark.parametrize(
    ("count", "a", "b"), [(32, -0.6, -0.6), (448, -0.6, -0.6), (10, 0.0, -0.2), (1, 0.5, 0.0)]
)
def test_a_quadrature_has_the_moments_of_its_weight(count: int, a: float, b: float) -> None:
    nodes, weights = gauss_jacobi(count, a, b)
    for k in range(min(2 * count, 12)):
        exact = float(mpmath.mpf(2) ** (a + b + 1) * mpmath.beta(a + 1, b + k + 1))
        assert weights @ ((1 + nodes) / 2) ** k == pytest.approx(exact, rel=1e-12)


def true_duration(law: HuntCrossley, mass: float, speed: float) -> float:
    """∫ sin(θ)^-p (q/y) dθ in 30 digits over θ = s^((n+1)/2), whose ends
    are smooth; q/y by Lambert's W.
    """
    with mpmath.workdps(30):
        n, d = mpmath.mpf(law.exponent), mpmath.mpf(law.alpha) * 3 / 2 * speed
        g = d - mpmath.log1p(d)
        top, power, p = mpmath.sqrt(2 * g), (n + 1) / 2, (n - 1) / (n + 1)

        def ratio(q: Mp) -> Mp:
            w = mpmath.lambertw(-mpmath.exp(-1 - q * q / 2), -1 if q > 0 else 0).real
            return q / (-1 - w) if abs(q) > 1e-12 else mpmath.mpf(1)

        def integrand(s: Mp) -> Mp:
            theta = s**power
            shape = (mpmath.sin(theta) / theta if theta else mpmath.mpf(1)) ** -p
            return (
                power * shape * (ratio(top * mpmath.cos(theta)) + ratio(-top * mpmath.cos(theta)))
            )

        ends = [
            (mpmath.pi * part) ** (1 / power) for part in (0, mpmath.mpf("0.25"), mpmath.mpf("0.5"))
        ]
        depth = ((n + 1) * mass * speed**2 * g / (law.stiffness * d**2)) ** (1 / (n + 1))
        return float(2 * depth * d / ((n + 1) * speed * top) * mpmath.quad(integrand, ends))


def law_of(
    d: float, speed: float = 1.0, exponent: float = 1.5, stiffness: float = K3
) -> HuntCrossley:
    return HuntCrossley(stiffness, d / 1.5 / speed, exponent)


# --- restitution, to the last digits
# -------------------------------------------------------------------


def test_restitution_agrees_with_50_digits_over_sixteen_decades() -> None:
    d = np.concatenate(
        [np.logspace(-12, 4, 400), np.linspace(0.01, 6, 60), np.linspace(38, 46, 40)]
    )
    truth = [true_restitution(x) for x in d.tolist()]
    assert relative_errors(_restitution_series.restitution_of(d), truth).max() < 1e-15
    # α = d, v = 2/3 or d = 1.5 α v with its own rounding: the contract is 4e-15.
    assert relative_errors(closed_form.restitution(d / 1.5, 1.0), truth).max() < 4e-15
    assert (
        relative_errors(_restitution_series.one_minus_restitution(d), [1 - e for e in truth]).max()
        < 1e-15
    )


def test_a_speed_has_the_same_bits_in_any_batch() -> None:
    d = np.concatenate([np.linspace(0.0, 2.0, 301), np.logspace(0, 3, 99)])
    alone = [_restitution_series.restitution_of(np.array([x])).item() for x in d]
    assert _restitution_series.restitution_of(d).tolist() == alone


def test_no_dissipation_returns_all_of_the_speed() -> None:
    assert closed_form.restitution(0.0, 3.0) == 1.0
    assert closed_form.restitution(0.3, 0.0) == 1.0
    assert closed_form.energy_loss(HuntCrossley(K3, 0.0), 1.0, 2.0) == 0.0


@pytest.mark.parametrize(
    ("highest", "series"),
    [
        (_restitution_series.LOW, _restitution_series.LOW_SERIES),
        (_restitution_series.TOP, _restitution_series.SERIES),
    ],
)
def test_coefficients_are_those_of_the_function(highest: float, series: tuple[float, ...]) -> None:
    """Makes the Chebyshev series again."""
    count = 64
    with mpmath.workdps(60):
        top = mpmath.mpf(highest) / (highest + _restitution_series.SHIFT)
        angles = [mpmath.pi * (k + mpmath.mpf(1) / 2) / count for k in range(count)]
        samples = []
        for angle in angles:
            t = top * (1 + mpmath.cos(angle)) / 2
            d = _restitution_series.SHIFT * t / (1 - t)
            samples.append(((1 + d) * true_restitution(d) - 1) / t)
        made = [
            (2 if j else 1)
            * sum(s * mpmath.cos(j * a) for s, a in zip(samples, angles, strict=True))
            / count
            for j in range(count)
        ]
    last = max(j for j, c in enumerate(made) if abs(c) > 1e-17)
    assert tuple(float(c) for c in made[: last + 1]) == series


def test_restitution_broadcasts_alpha_over_speed() -> None:
    alpha, speed = np.array([[0.08], [0.32]]), np.linspace(0.1, 0.5, 7)
    table = closed_form.restitution(alpha, speed)
    assert table.shape == (2, 7)
    assert table[1, 3] == closed_form.restitution(0.32, speed[3])


def test_a_million_speeds_take_less_time_than_lambert_w() -> None:
    speed = np.linspace(0.001, 1.0, 10**6)

    def shortest(run: Any) -> float:
        spans = []
        for _ in range(3):
            start = time.perf_counter()
            run()
            spans.append(time.perf_counter() - start)
        return min(spans)

    d = 1.5 * speed
    assert shortest(lambda: closed_form.restitution(1.0, speed)) < shortest(
        lambda: lambertw(-(1 + d) * np.exp(-(1 + d)), 0)
    )


@given(alphas, speeds)
def test_restitution_solves_the_separated_equation(alpha: float, speed: float) -> None:
    """d (1 + e) = ln(1 + d) - ln(1 - d e), well conditioned where
    neither side is small nor 1 - d e is.
    """
    d = 1.5 * alpha * speed
    e = float(closed_form.restitution(alpha, speed))
    assert 0 < e <= 1
    if 0.1 < d < 5:
        assert np.log1p(d) - np.log1p(-d * e) == pytest.approx(d * (1 + e), rel=1e-12)


@given(alphas, speeds, st.floats(1e-3, 10.0))
def test_restitution_falls_with_impact_speed(alpha: float, speed: float, more: float) -> None:
    slow, fast = closed_form.restitution(alpha, np.array([speed, speed * (1 + more)]))
    assert fast < slow or alpha * speed < 1e-12


@given(st.floats(1e-4, 1.0), speeds)
def test_alpha_comes_back_from_its_restitution(restitution: float, speed: float) -> None:
    alpha = closed_form.alpha_of(restitution, speed)
    assert closed_form.restitution(alpha, speed) == pytest.approx(restitution, rel=2e-15)


def test_alpha_agrees_with_50_digits() -> None:
    e = np.concatenate(
        [1 - np.logspace(-12, -0.31, 25), np.linspace(0.01, 0.99, 25), np.logspace(-4, -1.7, 10)]
    )
    d = closed_form.alpha_of(e, 1.0) * 1.5
    # Newton's step from the answer in exact arithmetic is its error.
    with mpmath.workdps(50):
        for value, guess in zip(e.tolist(), d.tolist(), strict=True):
            x, h = mpmath.mpf(guess), mpmath.mpf(guess) * mpmath.mpf(10) ** -20
            slope = (true_restitution(x + h) - true_restitution(x)) / h
            assert abs((true_restitution(x) - value) / slope / x) < 1e-15


@given(st.floats(1e-6, 0.1))
def test_the_empirical_law_is_the_first_order_of_the_exact_one(share: float) -> None:
    """(2) drops α² v²: e - (1 - α v) = α² v² + O(α³ v³)."""
    e, linear = closed_form.restitution(share, 1.0), closed_form.restitution_linear(share, 1.0)
    assert linear == 1.0 - share
    assert abs(e - linear - share**2) <= 1.2 * share**3 + 1e-15


# --- the paper's numbers
# -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("share", "e"),
    [(0.05, 0.952), (0.1, 0.909), (0.2, 0.833), (0.3, 0.768), (0.5, 0.663), (1.0, 0.488)],
)
def test_restitution_over_alpha_v(share: float, e: float) -> None:
    assert round(float(closed_form.restitution(share, 1.0)), 3) == e


@pytest.mark.parametrize(("alpha", "speed", "e", "depth", "force"), PAPER_CASE)
def test_case_of_section_3_1(alpha: float, speed: float, e: str, depth: str, force: str) -> None:
    law, v = HuntCrossley(K3, alpha / INCH), speed * INCH
    assert f"{closed_form.restitution(law.alpha, v):.10f}" == e
    assert f"{closed_form.penetration_max(law, POUND, v) / INCH:.4e}" == depth
    assert f"{closed_form.force_max(law, POUND, v) / LBF:.2f}" == force
    true_depth, true_force = true_extremes(law, POUND, v)
    assert f"{true_depth / INCH:.4e}" == depth
    assert f"{true_force / LBF:.2f}" == force


def test_contact_time_of_section_3_1() -> None:
    law = HuntCrossley(K3, 0.008 / INCH)
    assert f"{closed_form.duration(law, POUND, 16 * INCH) * 1e3:.2f}" == "0.17"
    assert f"{closed_form.duration(law, POUND, 4 * INCH) * 1e3:.2f}" == "0.23"


def test_energy_loss_goes_with_the_cube_of_speed() -> None:
    """(3): ΔE ≈ α m v_i³ at low α v_i, without losing digits to 1 - e²."""
    law, v = HuntCrossley(K3, 0.3), np.array([1e-9, 1e-6, 1e-3])
    loss = closed_form.energy_loss(law, POUND, v)
    # Next order: ΔE = α m v³ (1 - (3/2) α v ...).
    assert loss == pytest.approx(0.3 * POUND * v**3 * (1 - 1.5 * 0.3 * v), rel=1e-6)
    with mpmath.workdps(50):
        truth = [
            (1 - true_restitution(1.5 * 0.3 * x) ** 2) / 2 * mpmath.mpf(POUND) * mpmath.mpf(x) ** 2
            for x in v.tolist()
        ]
    assert relative_errors(loss, truth).max() < 2e-15


# --- path, force, time, loop
# ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("d", "n"),
    [
        (0.2, 1.5),
        (1.5, 3.0),
        *(
            pytest.param(d, n, marks=long_study)
            for d, n in [(1e-3, 1.5), (0.2, 1.0), (1.5, 1.2), (8.0, 1.5)]
        ),
    ],
)
def test_extremes_and_duration_agree_with_many_digits(d: float, n: float) -> None:
    """Two of six cases; `make test-all` has all."""
    law = law_of(d, speed=0.4, exponent=n)
    depth, force = true_extremes(law, POUND, 0.4)
    assert closed_form.penetration_max(law, POUND, 0.4) == pytest.approx(depth, rel=2e-15)
    assert closed_form.force_max(law, POUND, 0.4) == pytest.approx(force, rel=4e-15)
    assert closed_form.duration(law, POUND, 0.4) == pytest.approx(
        true_duration(law, POUND, 0.4), rel=1e-12
    )


@pytest.mark.parametrize("n", [1.0, 1.5, 6.0, 10.0])
@pytest.mark.parametrize(
    ("share", "good"), [(0.05, 1e-13), (2.0, 1e-13), (200.0, 1e-10), (1000.0, 5e-10)]
)
def test_duration_is_as_exact_as_it_says(share: float, good: float, n: float) -> None:
    law = HuntCrossley(K3, share / 0.4, n)
    assert closed_form.duration(law, POUND, 0.4) == pytest.approx(
        true_duration(law, POUND, 0.4), rel=good
    )


def test_where_nothing_bounces_there_is_no_quadrature() -> None:
    """1e20 asked for 736 GiB of nodes."""
    for alpha in (2500.1, 1e20):
        with pytest.raises(UserError, match="up to 1000"):
            closed_form.duration(HuntCrossley(K3, alpha), POUND, 0.4)
        with pytest.raises(UserError, match="up to 1000"):
            closed_form.loop(HuntCrossley(K3, alpha), POUND, 0.4)


def test_without_dissipation_the_spring_is_left() -> None:
    """n = 1, α = 0: half a period of the linear oscillator; (8) for any n."""
    law = HuntCrossley(1e6, 0.0, 1.0)
    assert closed_form.duration(law, 4.0, 1.0) == pytest.approx(
        np.pi * np.sqrt(4.0 / 1e6), rel=1e-14
    )
    for n in (1.0, 1.5, 3.0):
        law = HuntCrossley(1e6, 0.0, n)
        x = closed_form.penetration_max(law, 4.0, 0.7)
        assert 1e6 * x ** (n + 1) / (n + 1) == pytest.approx(0.5 * 4.0 * 0.7**2, rel=1e-14)
        assert closed_form.force_max(law, 4.0, 0.7) == pytest.approx(1e6 * x**n, rel=1e-14)


@settings(max_examples=settings().max_examples // 2)
@given(arguments, exponents, log_ratio, log_ratio)
def test_every_stiffness_mass_and_exponent_rebounds_alike(
    d: float, n: float, k: float, m: float
) -> None:
    """e depends on α v_i alone: the loop, which knows them all, ends in the rate -e v_i."""
    law = law_of(d, exponent=n, stiffness=1e8 * k)
    loop = closed_form.loop(law, m, 1.0, 101)
    assert -loop.rate[-1] == pytest.approx(
        float(closed_form.restitution(law.alpha, 1.0)), rel=1e-12
    )


@settings(max_examples=settings().max_examples // 3)
@given(st.floats(0.01, 30.0), exponents)
def test_area_of_the_loop_is_the_energy_lost(d: float, n: float) -> None:
    law = law_of(d, exponent=n)
    coarse, fine = (closed_form.loop(law, POUND, 1.0, count) for count in (1001, 2001))
    areas = [
        float(np.sum((p.force[1:] + p.force[:-1]) / 2 * np.diff(p.penetration)))
        for p in (coarse, fine)
    ]
    limit = areas[1] + (areas[1] - areas[0]) / 3  # the trapezoidal rule is of second order
    assert limit == pytest.approx(float(closed_form.energy_loss(law, POUND, 1.0)), rel=2e-5)


@settings(max_examples=settings().max_examples // 3)
@given(st.floats(0.0, 100.0), exponents, st.integers(3, 400))
def test_loop_is_whole(d: float, n: float, count: int) -> None:
    law = law_of(d, exponent=n)
    loop = closed_form.loop(law, POUND, 1.0, count)
    assert (
        loop.time.shape == loop.penetration.shape == loop.rate.shape == loop.force.shape == (count,)
    )
    assert loop.penetration[[0, -1]].tolist() == loop.force[[0, -1]].tolist() == [0.0, 0.0]
    assert loop.rate[0] == pytest.approx(1.0, rel=1e-13)
    assert loop.time[0] == 0.0
    assert (np.diff(loop.time) > 0).all()
    assert (loop.force >= 0).all()  # never pulls
    assert loop.force == pytest.approx(
        law.force(loop.penetration, loop.rate), rel=1e-9, abs=1e-9 * loop.force.max()
    )
    assert loop.time[-1] == pytest.approx(float(closed_form.duration(law, POUND, 1.0)), rel=1e-10)
    top = float(closed_form.penetration_max(law, POUND, 1.0))
    assert loop.penetration.max() <= top * (1 + 1e-15)
    assert loop.force.max() <= float(closed_form.force_max(law, POUND, 1.0)) * (1 + 1e-14)
    if count % 2:
        assert loop.penetration[count // 2] == top
        assert loop.rate[count // 2] == 0.0


def test_times_along_the_loop_are_those_of_the_motion() -> None:
    """dx/dt = v between samples, by Simpson's rule on three of them away from touch and parting."""
    loop = closed_form.loop(law_of(0.5), POUND, 1.0, 2001)
    inner = slice(200, 1800)
    speed = np.gradient(loop.penetration[inner], loop.time[inner], edge_order=2)[1:-1]
    assert speed == pytest.approx(loop.rate[inner][1:-1], abs=2e-5)


def test_rate_at_a_depth_is_on_the_loop() -> None:
    law = law_of(0.5)
    loop = closed_form.loop(law, POUND, 1.0, 21)
    going_in = closed_form.rate_at(law, POUND, 1.0, loop.penetration[:9], "approach")
    coming_out = closed_form.rate_at(law, POUND, 1.0, loop.penetration[12:], "rebound")
    assert going_in == pytest.approx(loop.rate[:9], rel=1e-12)
    assert coming_out == pytest.approx(loop.rate[12:], rel=1e-12)
    assert np.isnan(closed_form.rate_at(law, POUND, 1.0, 1.01 * loop.penetration.max(), "approach"))


@given(st.floats(-30.0, 100.0))
def test_straightened_rate_is_undone(q: float) -> None:
    """q²/2 = g(y): the inverse that the loop stands on."""
    y = q * float(closed_form.rate_ratio(np.asarray(q)))
    assert y > -1 or q < -8
    if q > -4:
        assert y * np.sqrt(closed_form.g_ratio(np.asarray(y))) == pytest.approx(q, rel=1e-10)


# --- what is refused
# -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "slot"),
    [
        (lambda: closed_form.restitution(-0.1, 1.0), "alpha"),
        (lambda: closed_form.restitution(0.1, np.array([1.0, -2.0])), "speed"),
        (lambda: closed_form.penetration_max(law_of(0.1), -1.0, 1.0), "mass"),
        (lambda: closed_form.duration(law_of(0.1), 1.0, 0.0), "speed"),
        (lambda: closed_form.loop(law_of(0.1), 1.0, 1.0, 2), "count"),
        (lambda: closed_form.alpha_of(0.0, 1.0), "restitution"),
        (lambda: closed_form.alpha_of(1.01, 1.0), "restitution"),
        (lambda: HuntCrossley(K3, 0.1, 0.9), "exponent"),
        (lambda: HuntCrossley(0.0, 0.1), "stiffness"),
    ],
)
def test_nonsense_is_refused_by_name(call: Any, slot: str) -> None:
    with pytest.raises(UserError, match=f"^{slot}: "):
        call()
