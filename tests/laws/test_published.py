"""Laws after 1975: what each promises against what it delivers."""

from __future__ import annotations

import dataclasses
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hcbench.laws import closed_form
from hcbench.laws.contact_law import require_resolved
from hcbench.laws.force import HuntCrossley
from hcbench.laws.ode import impact
from hcbench.laws.published import (
    LAWS,
    Exact,
    Flores,
    HuGuo,
    PublishedLaw,
    TouchSpeedLaw,
    law_named,
)
from hcbench.system.errors import SettingError, UserError
from hcbench.terms.impact import Status

ALL = list(LAWS.values())
ASKED = np.array([0.05, 0.2, 0.4, 0.6, 0.8, 0.9, 0.99, 1.0])

# χ at e = 1/2 as a fraction, by hand from the printed formulas.
AT_HALF = {
    "Hunt-Crossley": 3 / 4,
    "Herbert-McWhannell": 1.0,
    "Lee-Wang": 3 / 8,
    "Lankarani-Nikravesh": 9 / 16,
    "Gonthier et al.": 3 / 2,
    "Zhiying-Qishao": 9 / 16 * np.e,
    "Flores et al.": 8 / 5,
    "Hu-Guo": 3 / 2,
    "Carvalho-Martins": 63 / 44,
}
# χ/(1 - e) as e nears 1; 3/2 is what loses the right energy there.
SLOPES = {"Lee-Wang": 3 / 4, "Gonthier et al.": 2.0, "Flores et al.": 8 / 5}


def _simulated(law: TouchSpeedLaw, mass: float, speed: float) -> float:
    """e by an ODE of the published force, k x^n (1 + χ v/v_i), in units of the impact."""
    n = law.exponent
    depth = (mass * speed**2 / law.stiffness) ** (1.0 / (n + 1.0))
    time = depth / speed

    def rate(t: float, y: np.ndarray) -> list[float]:
        push = law.stiffness * (max(y[0], 0.0) * depth) ** n * (1.0 + law.chi * y[1])
        return [y[1], -push * time / (mass * speed)]

    def parted(t: float, y: np.ndarray) -> float:
        return float(y[0]) if t > 0.1 else 1.0

    parted.terminal, parted.direction = True, -1  # type: ignore[attr-defined]
    run: Any = solve_ivp(
        rate, (0, 400), [0, 1], "DOP853", rtol=1e-11, atol=1e-13, events=parted, max_step=0.2
    )
    return float(-run.y_events[0][0][1])


@pytest.mark.parametrize("law", ALL, ids=LAWS)
@pytest.mark.parametrize(
    ("exponent", "mass", "speed"), [(1.5, 0.45, 0.4), (1.0, 20.0, 0.01), (2.5, 1e-3, 3.0)]
)
def test_what_is_delivered_follows_from_chi_alone(
    law: PublishedLaw, exponent: float, mass: float, speed: float
) -> None:
    one = TouchSpeedLaw(law, 3.4e10, 0.7, exponent)
    assert _simulated(one, mass, speed) == pytest.approx(float(law.delivered(0.7)), abs=2e-9)


@pytest.mark.parametrize("law", ALL, ids=LAWS)
def test_they_are_laws_like_the_others_to_the_simulation(law: PublishedLaw) -> None:
    bounced = impact(TouchSpeedLaw(law, 3.4e10, 0.8).at(0.4), 0.45, 0.4)
    assert bounced.restitution == pytest.approx(float(law.delivered(0.8)), rel=1e-9)
    assert bounced.loop is not None
    assert bounced.loop.force[0] == 0.0


@pytest.mark.parametrize("law", ALL, ids=LAWS)
@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.2])
def test_with_v_i_of_each_impact_all_speeds_have_one_restitution(
    law: PublishedLaw, exponent: float
) -> None:
    own = TouchSpeedLaw(law, 3.4e10, 0.8, exponent)
    for speed in (0.0254, 0.508, 5.0):
        bounced = impact(own, 0.45, speed)
        assert bounced.restitution == pytest.approx(own.delivered, abs=1e-10)
        assert bounced.penetration_max == pytest.approx(
            float(closed_form.penetration_max(own.at(speed), 0.45, speed)), rel=1e-10
        )


def test_what_damps_takes_the_energy_that_the_impact_loses() -> None:
    """λ = χ k/v_i: the work of λ x^n v along the path is what e leaves of the energy."""
    own, speed, mass = TouchSpeedLaw(Flores, 3.4e10, 0.5), 0.3, 0.45
    loop = impact(own, mass, speed, count=20_001).loop
    assert loop is not None
    damping = own.chi * own.stiffness / speed * loop.penetration**1.5 * loop.rate**2
    work = float(np.trapezoid(damping, loop.time))
    assert work == pytest.approx(0.5 * mass * speed**2 * (1 - own.delivered**2), rel=1e-7)


def test_gravity_makes_the_weakest_impacts_stay() -> None:
    own = TouchSpeedLaw(Flores, 3.4e10, 0.5)
    states = [impact(own, 0.45, v, gravity=9.81) for v in (0.5, 0.05, 0.002)]
    assert [one.status for one in states] == [Status.PARTED, Status.PARTED, Status.RESTED]
    assert own.delivered > states[0].restitution > states[1].restitution


@pytest.mark.parametrize("law", ALL, ids=LAWS)
def test_delivered_agrees_with_40_digit_arithmetic(law: PublishedLaw) -> None:
    for e in ASKED[:-1]:
        with mpmath.workdps(40):
            d = mpmath.mpf(float(law.chi_of(e)))
            root = (1 + mpmath.lambertw(-(1 + d) * mpmath.exp(-(1 + d)))).real / d
        assert float(law.delivered(e)) == pytest.approx(float(root), rel=4e-15)


@pytest.mark.parametrize("name", AT_HALF)
def test_chi_is_the_published_one(name: str) -> None:
    assert float(LAWS[name].chi_of(0.5)) == pytest.approx(AT_HALF[name], rel=1e-14)


@pytest.mark.parametrize("law", ALL, ids=LAWS)
def test_small_losses_are_right_to_first_order_but_for_three_laws(law: PublishedLaw) -> None:
    slope = float(law.chi_of(1 - 1e-7)) / 1e-7
    assert slope == pytest.approx(SLOPES.get(law.name, 1.5), rel=1e-6)
    assert float(law.delivered(1.0)) == 1.0


def test_the_exact_law_delivers_what_it_promises_at_every_e() -> None:
    asked = np.concatenate([np.geomspace(1e-6, 0.5, 200), 1.0 - np.geomspace(1e-12, 0.5, 200)])
    np.testing.assert_allclose(Exact.delivered(asked), asked, rtol=4e-15)


def test_how_far_the_promises_are_kept() -> None:
    """Largest |delivered - asked| over 0.05 ... 1: Carvalho-Martins and
    Hu-Guo keep theirs best above 0.4.
    """
    asked = np.linspace(0.4, 1.0, 601)
    worst = {name: float(np.abs(law.delivered(asked) - asked).max()) for name, law in LAWS.items()}
    order = sorted(worst, key=worst.__getitem__)
    assert order[:3] == ["exact", "Carvalho-Martins", "Hu-Guo"]
    assert order[-1] == "Lee-Wang"
    assert worst["Carvalho-Martins"] < 1.2e-3
    assert worst["Hu-Guo"] < 0.021


def test_hu_guo_as_published_keeps_its_promise_and_the_halved_one_does_not() -> None:
    """Some public code divides χ by a further 2; that χ at e is the
    published one of (1 + e)/2's loss.
    """
    from hcbench.laws._restitution_series import restitution_of

    e = np.array([0.8, 0.9, 0.99])
    halved = restitution_of(HuGuo.chi_of(e) / 2.0)
    assert np.abs(HuGuo.delivered(e) - e).max() < 1e-3
    np.testing.assert_allclose((1.0 - halved) / (1.0 - e), 0.5, atol=0.06)


@pytest.mark.parametrize("law", ALL, ids=LAWS)
def test_as_16_it_is_the_same_force(law: PublishedLaw) -> None:
    one = TouchSpeedLaw(law, 3.4e10, 0.6)
    x = np.linspace(0.0, 2e-5, 7)[:, None]
    v = np.linspace(-0.3, 0.35, 5)
    published = 3.4e10 * x**1.5 * (1.0 + law.chi_of(0.6) * v / 0.35)
    np.testing.assert_allclose(one.at(0.35).force(x, v), published, rtol=1e-13, atol=1e-12)
    assert one.at(0.35).force(0.0, 0.35) == 0.0


@pytest.mark.parametrize("law", ALL, ids=LAWS)
def test_every_law_names_its_source_and_cannot_be_changed(law: PublishedLaw) -> None:
    if law is not Exact:
        assert any(year in law.reference for year in ("19", "20"))
        assert "doi 10." in law.reference or "in Chinese" in law.reference
    with pytest.raises(dataclasses.FrozenInstanceError):
        law.takes_zero = False  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        TouchSpeedLaw(law, 1.0, 0.5).restitution = 0.4  # type: ignore[misc]


@pytest.mark.parametrize("law", ALL, ids=LAWS)
@pytest.mark.parametrize("e", [-0.1, 1.0001, np.nan])
def test_a_restitution_that_makes_chi_negative_is_refused(law: PublishedLaw, e: float) -> None:
    with pytest.raises(UserError, match="0 <= e <= 1: above 1 χ is below 0"):
        TouchSpeedLaw(law, 1e10, e)


@pytest.mark.parametrize("law", ALL, ids=LAWS)
def test_e_0_is_refused_where_chi_is_infinite_and_taken_elsewhere(law: PublishedLaw) -> None:
    if law.takes_zero:
        assert 0.0 < float(law.delivered(0.0)) < 1.0
    else:
        with pytest.raises(UserError, match="e above 0"):
            law.chi_of(0.0)


def test_bad_numbers_are_named() -> None:
    with pytest.raises(UserError, match="restitution of Flores"):
        Flores.chi_of(0.0)
    with pytest.raises(UserError, match="speed: 0"):
        TouchSpeedLaw(Flores, 1e10, 0.5).at(0.0)
    with pytest.raises(UserError, match="stiffness: nan"):
        TouchSpeedLaw(Flores, np.nan, 0.5)
    with pytest.raises(UserError, match=r"exponent: 0\.9"):
        TouchSpeedLaw(Flores, 1e10, 0.5, 0.9)
    with pytest.raises(UserError, match="carvalho-martins"):
        law_named("hertz")
    assert law_named("hu-guo") is HuGuo
    assert law_named("Flores et al.") is law_named("flores") is Flores
    with pytest.raises(UserError, match="restitution of Flores"):
        TouchSpeedLaw(Flores, 1e10, 0.0)


@pytest.mark.parametrize("mass", [0.1, 0.2, 0.5, 1.0, 3.0])
def test_a_step_that_the_error_allows_resolves_the_contact(mass: float) -> None:
    law = HuntCrossley(1e6, 0.3)
    with pytest.raises(SettingError) as caught:
        require_resolved(law, mass, 1.0, 1.0)
    allowed = float(caught.value.expected.partition("at most ")[2].split()[0])
    require_resolved(law, mass, 1.0, allowed)
