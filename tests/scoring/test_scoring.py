"""The comparator: what it says of loops and curves whose answer is known in closed form."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from hcbench import scoring
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.terms.impact import Impact, Launch, Loop, Status

LAW = HuntCrossley(stiffness=3.4064e10, alpha=0.315, exponent=1.5)
MASS = 0.45359237
SPEEDS = np.linspace(0.0254, 0.508, 20)


def law_impact(speed: float, phase: float = 0.5, law: HuntCrossley = LAW) -> Impact:
    loop = closed_form.loop(law, MASS, speed, 400)
    return Impact(
        launch=Launch(speed, phase),
        status=Status.PARTED,
        speed_in=speed,
        speed_out=speed * float(closed_form.restitution(law.alpha, speed)),
        duration=float(closed_form.duration(law, MASS, speed)),
        penetration_max=float(loop.penetration.max()),
        force_max=float(loop.force.max()),
        samples=len(loop.time),
        loop=loop,
    )


def constant_impact(speed: float, e: float, phase: float = 0.5) -> Impact:
    return Impact(
        Launch(speed, phase), Status.PARTED, speed_in=speed, speed_out=e * speed, samples=1
    )


@pytest.fixture(scope="module")
def law_score() -> scoring.Score:
    return scoring.score([law_impact(v) for v in SPEEDS], LAW, MASS)


def test_the_law_scored_against_itself_is_perfect(law_score: scoring.Score) -> None:
    assert law_score.max_error_law < 1e-15
    assert law_score.alpha_fit == pytest.approx(LAW.alpha, rel=1e-4)
    assert law_score.loop_rms < 1e-4
    for ratio in ("area_ratio", "force_ratio", "penetration_ratio", "duration_ratio"):
        assert getattr(law_score, ratio) == pytest.approx(1, abs=1e-4), ratio


@pytest.mark.parametrize("begins", [0.1, 0.5, 0.8])
def test_a_spring_that_loses_nothing_encloses_no_area_however_few_samples(begins: float) -> None:
    """x = sin t from a share of a step on, six samples to π: the last lies inside the surface."""
    step = math.pi / 6.0
    time = step * (begins + np.arange(6.0))
    x = np.sin(time)
    spring = Loop(time=time, penetration=x, rate=np.cos(time), force=3.0 * x)
    assert x[-1] > 0.1
    assert x[-1] + spring.rate[-1] * step < 0.0
    assert scoring.loop_area(spring) == pytest.approx(0.0, abs=1e-12)


def test_of_several_loops_the_one_farthest_from_the_law_counts_by_its_factor() -> None:
    """Half of the law's force is farther from it than 1.5 times: a factor of 2."""
    impacts = []
    for speed, factor in ((0.1, 0.5), (0.2, 1.5), (0.4, 1.0)):
        impact = law_impact(speed)
        assert impact.loop is not None
        loop = dataclasses.replace(impact.loop, force=factor * impact.loop.force)
        impacts.append(dataclasses.replace(impact, loop=loop))
    found = scoring.score(impacts, LAW, MASS)
    assert found.force_ratio == pytest.approx(0.5, rel=1e-3)
    assert found.area_ratio == pytest.approx(0.5, rel=1e-3)


def test_the_law_keeps_all_of_the_papers_claims(law_score: scoring.Score) -> None:
    assert [getattr(law_score, claim) for claim in scoring.CLAIMS] == [True] * 4


def test_a_constant_restitution_loses_energy_as_the_square_of_speed() -> None:
    score = scoring.score([constant_impact(v, 0.9) for v in SPEEDS], LAW, MASS)
    assert score.energy_exponent == pytest.approx(2, abs=1e-9)
    assert score.cubic_loss is False
    assert score.starts_at_zero is None, "one step in contact says nothing about a loop"


def test_no_constant_beats_the_best_constant() -> None:
    e, error = scoring.best_constant(LAW.alpha, SPEEDS)
    assert scoring.score(
        [constant_impact(v, e) for v in SPEEDS], LAW, MASS
    ).max_error_law == pytest.approx(error)
    for other in (e - 0.01, e + 0.01):
        assert (
            scoring.score([constant_impact(v, other) for v in SPEEDS], LAW, MASS).max_error_law
            > error
        )


@pytest.mark.parametrize(
    ("alpha", "e", "error"),
    [
        (0.002, 0.97977, 0.0182),
        (0.004, 0.96095, 0.0351),
        (0.008, 0.926935, 0.0651),
        (0.016, 0.87020, 0.1141),
    ],
)
def test_the_line_to_beat_for_the_papers_four_alphas(alpha: float, e: float, error: float) -> None:
    constant, largest = scoring.best_constant(alpha / 0.0254, SPEEDS)
    assert constant == pytest.approx(e, abs=5e-6)
    assert largest == pytest.approx(error, abs=5e-5)


def test_law_and_linear_are_distinguished() -> None:
    linear = [constant_impact(v, 1 - LAW.alpha * v) for v in SPEEDS]
    score = scoring.score(linear, LAW, MASS)
    assert score.max_error_linear < 1e-15
    assert score.max_error_law == pytest.approx(
        max(closed_form.restitution(LAW.alpha, SPEEDS) - (1 - LAW.alpha * SPEEDS)), rel=1e-9
    )


def test_a_kelvin_voigt_loop_fails_the_claims_it_should_fail() -> None:
    speed = 0.2
    time = np.linspace(0, 1e-4, 300)
    omega, decay = np.pi / 1e-4, 800.0
    x = speed / omega * np.exp(-decay * time) * np.sin(omega * time)
    v = np.gradient(x, time)
    force = MASS * (omega**2 + decay**2) * x + 2 * MASS * decay * v
    impact = dataclasses.replace(
        law_impact(speed),
        loop=dataclasses.replace(
            closed_form.loop(LAW, MASS, speed, 300), time=time, penetration=x, rate=v, force=force
        ),
    )
    score = scoring.score([impact], LAW, MASS)
    assert score.starts_at_zero is False
    assert score.no_tension is False
    assert score.sharp_at_origin is False
    assert score.tension_share > 0


@pytest.mark.parametrize("alpha", [0.002, 0.016])
def test_even_a_faint_shock_at_touch_is_seen(alpha: float) -> None:
    """c v_i over the largest force is 1 % for a Kelvin-Voigt contact of e = 0.98."""
    e, _ = scoring.best_constant(alpha / 0.0254, SPEEDS)
    decay = -math.log(e) / 2e-4
    time = np.linspace(0, 2e-4, 201)
    omega = np.pi / 2e-4
    x = 0.2 / omega * np.exp(-decay * time) * np.sin(omega * time)
    v = 0.2 * np.exp(-decay * time) * (np.cos(omega * time) - decay / omega * np.sin(omega * time))
    force = np.maximum(0, MASS * (omega**2 + decay**2) * x + 2 * MASS * decay * v)
    loop = Loop(time, x, v, force)
    score = scoring.score([dataclasses.replace(law_impact(0.2), loop=loop)], LAW, MASS)
    assert score.starts_at_zero is False
    assert score.no_tension is True
    assert score.sharp_at_origin is False


def test_energy_gained_is_flagged() -> None:
    assert scoring.score([constant_impact(0.1, 1.01)], LAW, MASS).energy_gained
    assert not scoring.score([constant_impact(0.1, 1.0)], LAW, MASS).energy_gained


def test_phase_spread_is_over_phases_of_one_speed_only() -> None:
    impacts = [constant_impact(v, e, p) for v, e in ((0.1, 0.9), (0.2, 0.5)) for p in (0.0, 0.5)]
    assert scoring.score(impacts, LAW, MASS).phase_spread == 0
    impacts.append(constant_impact(0.2, 0.4, 0.7))
    assert scoring.score(impacts, LAW, MASS).phase_spread == pytest.approx(0.1)


def test_failures_are_counted_and_never_in_the_curve() -> None:
    bad = Impact(Launch(0.3), Status.DIVERGED, "not finite")
    score = scoring.score([law_impact(0.1), law_impact(0.2), bad], LAW, MASS)
    assert (score.impacts, score.parted, score.failed) == (3, 2, 1)
    assert score.max_error_law < 1e-15


def test_a_body_that_rests_counts_as_no_restitution() -> None:
    rested = Impact(Launch(0.1), Status.RESTED, "still in contact", speed_in=0.1, speed_out=0.0)
    score = scoring.score([rested], LAW, MASS)
    assert score.max_error_law == pytest.approx(float(closed_form.restitution(LAW.alpha, 0.1)))


def test_nothing_but_failures_gives_a_score_without_numbers() -> None:
    score = scoring.score([Impact(Launch(0.1), Status.CRASHED, "died")], LAW, MASS)
    assert score.failed == 1
    assert np.isnan(score.max_error_law)
