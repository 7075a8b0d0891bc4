"""The ODE of one impact: agrees with the closed forms, converges as declared, and knows gravity."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbench.laws import closed_form, kelvin_voigt, ode
from hcbench.laws.force import HuntCrossley, KelvinVoigt
from hcbench.laws.ode import Ending
from hcbench.system.errors import UserError
from hcbench.terms.impact import Impact, Loop, Status

MASS, SPEED, K3 = 0.45359237, 0.4064, 3.4064e10
TEN_DIGITS = 1e-10


def area(loop: Loop) -> float:
    return float(np.sum((loop.force[1:] + loop.force[:-1]) / 2 * np.diff(loop.penetration)))


def energy_lost(impact: Impact) -> float:
    return 0.5 * MASS * (impact.speed_in**2 - impact.speed_out**2)


@pytest.mark.parametrize("exponent", [1.0, 1.2, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("d", [0.0, 1e-6, 0.05, 0.2, 1.0, 5.0, 30.0])
def test_agrees_with_the_closed_forms(d: float, exponent: float) -> None:
    law = HuntCrossley(K3, d / 1.5 / SPEED, exponent)
    impact = ode.impact(law, MASS, SPEED)
    assert impact.status is Status.PARTED
    assert impact.restitution == pytest.approx(
        float(closed_form.restitution(law.alpha, SPEED)), rel=TEN_DIGITS
    )
    assert impact.penetration_max == pytest.approx(
        float(closed_form.penetration_max(law, MASS, SPEED)), rel=TEN_DIGITS
    )
    assert impact.force_max == pytest.approx(
        float(closed_form.force_max(law, MASS, SPEED)), rel=TEN_DIGITS
    )
    assert impact.duration == pytest.approx(
        float(closed_form.duration(law, MASS, SPEED)), rel=TEN_DIGITS
    )


@settings(max_examples=settings().max_examples // 6)
@given(st.floats(0.0, 3.0), st.floats(1e3, 1e12), st.floats(1e-3, 1e3), st.floats(1e-3, 10.0))
def test_agrees_for_rubber_as_for_steel(
    share: float, stiffness: float, mass: float, speed: float
) -> None:
    """The ODE is solved in its own units: tolerances mean the same at
    any stiffness, mass and speed.
    """
    law = HuntCrossley(stiffness, share / speed)
    impact = ode.impact(law, mass, speed)
    assert impact.restitution == pytest.approx(
        float(closed_form.restitution(law.alpha, speed)), rel=TEN_DIGITS
    )
    assert impact.penetration_max == pytest.approx(
        float(closed_form.penetration_max(law, mass, speed)), rel=TEN_DIGITS
    )
    assert impact.duration == pytest.approx(
        float(closed_form.duration(law, mass, speed)), rel=TEN_DIGITS
    )


def test_loop_lies_on_the_exact_one() -> None:
    law = HuntCrossley(K3, 0.63)
    loop = ode.impact(law, MASS, SPEED, count=101).loop
    assert loop is not None
    top = float(closed_form.penetration_max(law, MASS, SPEED))
    going_in = loop.rate > 0.01 * SPEED
    rate = closed_form.rate_at(law, MASS, SPEED, loop.penetration[going_in], "approach")
    assert loop.rate[going_in] == pytest.approx(rate, rel=1e-9)
    coming_out = loop.rate < -0.01 * SPEED
    rate = closed_form.rate_at(law, MASS, SPEED, loop.penetration[coming_out], "rebound")
    assert loop.rate[coming_out] == pytest.approx(rate, rel=1e-9)
    assert loop.penetration.max() == pytest.approx(top, rel=1e-3)
    assert loop.penetration[[0, -1]].tolist() == loop.force[[0, -1]].tolist() == [0.0, 0.0]


# --- Kelvin-Voigt: two readings of parting
# -------------------------------------------------------------


@pytest.mark.parametrize("ending", list(Ending))
@pytest.mark.parametrize("zeta", [0.0, 0.01, 0.3, 0.7, 0.9])
def test_agrees_with_the_damped_sine(zeta: float, ending: Ending) -> None:
    law = KelvinVoigt(1e8, 2 * zeta * math.sqrt(1e8 * MASS))
    impact = ode.impact(law, MASS, SPEED, ending=ending)
    truth = kelvin_voigt.bounce(law, MASS, SPEED, ending)
    # e falls to 1.5e-3 at ζ = 0.9 and x = 0: what is absolute there is relative to the speed in.
    assert impact.restitution == pytest.approx(truth.restitution, abs=TEN_DIGITS)
    assert impact.penetration_max == pytest.approx(truth.penetration_max, rel=TEN_DIGITS)
    assert impact.force_max == pytest.approx(truth.force_max, rel=TEN_DIGITS)
    assert impact.duration == pytest.approx(truth.duration, rel=TEN_DIGITS)


def test_a_linear_damper_pulls_before_it_parts_at_the_surface() -> None:
    """The faults of eq. (4) in Fig. 1: force at touch, tension at the
    end; none of the second at F = 0.
    """
    law = KelvinVoigt(1e8, 2 * 0.2 * math.sqrt(1e8 * MASS))
    surface, force = (ode.impact(law, MASS, SPEED, ending=ending).loop for ending in Ending)
    assert surface is not None
    assert force is not None
    assert surface.force[0] == pytest.approx(law.damping * SPEED)
    assert surface.force[-1] < 0
    assert force.force.min() > -1e-9 * force.force.max()
    assert force.penetration[-1] > 0


def test_an_overdamped_contact_never_parts_at_the_surface() -> None:
    law = KelvinVoigt(1e8, 3.0 * math.sqrt(1e8 * MASS))
    impact = ode.impact(law, MASS, SPEED)
    assert impact.status is Status.RESTED
    assert impact.restitution == 0.0
    assert impact.reason


# --- gravity
# -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [1e-3, 0.01, 0.1, 0.4])
def test_under_gravity_the_loop_still_closes_the_energy_balance(speed: float) -> None:
    """Gravity does no work from touch to parting, both at x = 0: ΔE is the loop's area."""
    impact = ode.impact(HuntCrossley(K3, 0.63), MASS, speed, gravity=9.81, count=2001)
    assert impact.loop is not None
    assert area(impact.loop) == pytest.approx(energy_lost(impact), rel=1e-5)


def test_under_gravity_a_spring_alone_still_returns_everything() -> None:
    for speed in (1e-4, 0.01, 0.4):
        impact = ode.impact(HuntCrossley(K3, 0.0), MASS, speed, gravity=9.81)
        assert impact.restitution == pytest.approx(1.0, rel=TEN_DIGITS)


def test_gravity_presses_deeper_and_takes_more_the_slower_the_impact() -> None:
    law, extra = HuntCrossley(K3, 0.32), []
    for speed in (0.4, 0.1, 0.02, 0.005):
        without_gravity, with_gravity = (
            ode.impact(law, MASS, speed, gravity=g) for g in (0.0, 9.81)
        )
        assert with_gravity.penetration_max > without_gravity.penetration_max
        assert with_gravity.duration > without_gravity.duration
        extra.append(without_gravity.restitution - with_gravity.restitution)
    assert extra[0] > 0
    assert (np.diff(extra) > 0).all()


def test_under_gravity_a_slow_body_stays() -> None:
    """Slower than its losses allow, the body cannot get back to the
    surface: v_o² would be negative.
    """
    impact = ode.impact(HuntCrossley(K3, 0.3), MASS, 1e-4, gravity=9.81)
    assert impact.status is Status.RESTED
    assert impact.restitution == 0.0


def test_gravity_on_a_linear_spring_is_a_shifted_sine() -> None:
    """n = 1, α = 0: x = x_s + sqrt(x_s² + (v/ω)²) sin(...), x_s = m g/k, so x_m is known."""
    k, v, g = 1e4, 0.3, 9.81
    rest, swing = MASS * g / k, v / math.sqrt(k / MASS)
    impact = ode.impact(HuntCrossley(k, 0.0, 1.0), MASS, v, gravity=g)
    assert impact.penetration_max == pytest.approx(rest + math.hypot(rest, swing), rel=TEN_DIGITS)
    touch = math.pi + 2 * math.atan2(rest, swing)
    assert impact.duration == pytest.approx(touch / math.sqrt(k / MASS), rel=TEN_DIGITS)


# --- convergence
# ---------------------------------------------------------------------------------------


def depth_errors(exponent: float, steps: list[float]) -> Any:
    law = HuntCrossley(1e8, 0.6, exponent)
    truth = float(closed_form.penetration_max(law, MASS, SPEED))
    runs = [ode.impact(law, MASS, SPEED, tolerance=math.inf, step_max=step) for step in steps]
    return np.abs(np.array([run.penetration_max for run in runs]) / truth - 1)


def test_fixed_steps_converge_with_order_eight_where_the_law_is_smooth() -> None:
    steps = [0.8, 0.4, 0.2]
    order = np.polyfit(np.log(steps), np.log(depth_errors(1.0, steps)), 1)[0]
    assert 7.5 < order < 12


def test_touch_costs_a_fixed_step_its_order() -> None:
    """x^1.5 starts with an unbounded derivative at touch: order n + 1 =
    2.5, whatever the integrator's is.
    """
    steps = [0.2, 0.1, 0.05, 0.025]
    order = np.polyfit(np.log(steps), np.log(depth_errors(1.5, steps)), 1)[0]
    assert order == pytest.approx(2.5, abs=0.1)


def test_error_follows_the_tolerance() -> None:
    law = HuntCrossley(K3, 0.6)
    e = float(closed_form.restitution(law.alpha, SPEED))
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        error = abs(ode.impact(law, MASS, SPEED, tolerance=tolerance).restitution - e)
        assert error < 20 * tolerance


# --- what is refused
# -----------------------------------------------------------------------------------


class Fluid:
    """A damper with no spring."""

    def force(self, x: Any, v: Any) -> Any:
        return np.asarray(v) * 10.0 + 0.0 * np.asarray(x)


@pytest.mark.parametrize(
    ("call", "slot"),
    [
        (lambda law: ode.impact(law, 0.0, 1.0), "mass"),
        (lambda law: ode.impact(law, 1.0, -1.0), "speed"),
        (lambda law: ode.impact(law, 1.0, 1.0, gravity=-9.81), "gravity"),
        (lambda law: ode.impact(law, 1.0, 1.0, count=2), "count"),
        (lambda _: ode.impact(Fluid(), 1.0, 1.0), "law"),
    ],
)
def test_nonsense_is_refused_by_name(call: Any, slot: str) -> None:
    with pytest.raises(UserError, match=f"^{slot}: "):
        call(HuntCrossley(K3, 0.3))
