"""The force over one step of an engine: lands on the law's own motion,
at the order that is documented.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from compiled_laws import (
    ContactOde,
    advance,
    euler_force,
    restitution,
    rk4_stage_forces,
    touch_speed_ode,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from hcbench.laws import closed_form
from hcbench.laws.contact_law import Friction, law_of
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import Restitution
from hcbench.system.errors import SettingError

MASS, STIFFNESS = 0.45359237, 3.4064e10
ALPHA = 0.016 / 0.0254  # s/m: the paper's stretch case, the hardest
PHASES = [0.06 + i / 8 for i in range(8)]


def motion_of(law: HuntCrossley, mass: float = MASS, b: float = 0.0) -> ContactOde:
    return ContactOde(law.stiffness / mass, law.dissipation, law.exponent, b)


def bounce_euler(
    motion: ContactOde, h: float, speed: float, phase: float
) -> tuple[float, list[tuple[float, float, float]]]:
    """Restitution, and the record (x, v, F/m), of semi-implicit Euler
    with the force of `euler_force`.
    """
    x, v, record = -(2 + phase) * h * speed, speed, []
    while True:
        force = euler_force(motion, h, x, v)
        record.append((x, v, force))
        if v < 0 and force == 0:
            return -v / speed, record
        v -= h * force
        x += h * v


def bounce_rk4(motion: ContactOde, h: float, speed: float, phase: float) -> float:
    x, v, touched = -(2 + phase) * h * speed, speed, False
    while True:
        f = rk4_stage_forces(motion, h, x, v)
        touched = touched or any(f)
        if touched and v < 0 and not any(f):
            return -v / speed
        x += h * v - h * h / 6 * (f[0] + 2 * f[1])
        v -= h / 6 * (f[0] + 4 * f[1] + f[2])


@pytest.mark.parametrize(("h", "error"), [(1e-6, 1e-9), (1e-5, 1e-6), (2e-5, 5e-6)])
@pytest.mark.parametrize(
    "bounce", [lambda *a: bounce_euler(*a)[0], bounce_rk4], ids=["euler", "rk4"]
)
def test_restitution_is_the_laws_own_at_every_phase(
    bounce: Callable[..., float], h: float, error: float
) -> None:
    law = HuntCrossley(STIFFNESS, ALPHA)
    for speed in (0.0254, 0.2032, 0.508) if h > 1e-6 else (0.2032,):
        for phase in PHASES if h > 1e-6 else PHASES[::4]:
            got = bounce(motion_of(law), h, speed, phase)
            assert got == pytest.approx(float(closed_form.restitution(ALPHA, speed)), abs=error)


def test_restitution_converges_with_at_least_the_documented_order() -> None:
    law, speed = HuntCrossley(STIFFNESS, ALPHA), 0.2032
    truth = float(closed_form.restitution(ALPHA, speed))

    def worst(h: float) -> float:
        return max(
            abs(bounce_euler(motion_of(law), h, speed, phase)[0] - truth) for phase in PHASES[::2]
        )

    coarse, fine = worst(1e-5), worst(1e-6)
    assert math.log10(coarse / fine) > 2.0


@pytest.mark.parametrize(("h", "share"), [(1e-6, 5e-4), (1e-5, 5e-3)])
def test_the_loop_is_the_laws_own(h: float, share: float) -> None:
    law, speed = HuntCrossley(STIFFNESS, 0.008 / 0.0254), 0.4064
    record = np.array(bounce_euler(motion_of(law), h, speed, 0.3)[1])
    x, force = record[:, 0], record[:, 2] * MASS
    inside = x > 0
    rising = np.append(np.diff(x) > 0, False)
    branches = [
        closed_form.rate_at(law, MASS, speed, np.maximum(x, 0.0), way)
        for way in ("approach", "rebound")
    ]
    rate = np.where(rising, *branches)
    use = inside & np.isfinite(rate)
    truth = law.force(x[use], rate[use])
    rms = np.sqrt(np.mean((force[use] - truth) ** 2)) / float(
        closed_form.force_max(law, MASS, speed)
    )
    assert rms < share


@pytest.mark.parametrize("order", [2, 4])
def test_force_within_the_loop_is_of_second_order(order: int) -> None:
    # The triangle average of a smooth force differs from it by h²/12 F''.
    law = HuntCrossley(STIFFNESS, ALPHA)
    motion, x, v = motion_of(law), 1e-5, 0.1
    h = 1e-6

    def error(h: float) -> float:
        before = advance(ContactOde(motion.kappa, -motion.a, motion.n), h, x, -v)[0]
        return abs(euler_force(motion, h, x, (x - before) / h) + motion.acceleration(x, v))

    assert error(order * h) / error(h) == pytest.approx(order**2, rel=0.05)


def test_flow_conserves_what_the_law_conserves() -> None:
    # Along (16): k x^(n+1)/(n+1) + (m/a²) (a v - ln(1 + a v)) is constant.
    law = HuntCrossley(STIFFNESS, ALPHA)
    a, motion = law.dissipation, motion_of(law)

    def invariant(x: float, v: float) -> float:
        stored = STIFFNESS * math.pow(max(x, 0.0), 2.5) / 2.5
        return stored + MASS / a**2 * (a * v - math.log1p(a * v))

    x, v = -1e-7, 0.3
    start = invariant(x, v)
    for _ in range(40):
        x, v = advance(motion, 5e-6, x, v)
        assert invariant(x, v) == pytest.approx(start, rel=1e-6)


def test_a_body_at_rest_under_gravity_stays() -> None:
    motion = motion_of(HuntCrossley(STIFFNESS, ALPHA), b=9.81)
    x = (9.81 / motion.kappa) ** (1 / 1.5)
    for _ in range(200):
        force = euler_force(motion, 1e-5, x, 0.0)
        assert force == pytest.approx(9.81, rel=1e-6)


@given(
    x=st.floats(-1e-5, 3e-5),
    v=st.floats(-0.6, 0.6),
    h=st.sampled_from([1e-6, 3e-6, 1e-5, 2e-5]),
    n=st.sampled_from([1.0, 1.2, 1.5, 2.0]),
    b=st.sampled_from([0.0, 9.81]),
    chi=st.sampled_from([0.0, 0.1, 1.6]),
)
@settings(max_examples=2 * settings().max_examples)
def test_no_state_is_ever_pulled(
    x: float, v: float, h: float, n: float, b: float, chi: float
) -> None:
    kappa = STIFFNESS / MASS * 1e-5 ** (1.5 - n)
    motion = touch_speed_ode(kappa, chi, n, b) if chi else ContactOde(kappa, 1.5 * ALPHA, n, b)
    assert 0 <= euler_force(motion, h, x, v) < math.inf
    assert all(0 <= force < math.inf for force in rk4_stage_forces(motion, h, x, v))


@given(d=st.floats(1e-12, 1e3))
@settings(max_examples=2 * settings().max_examples)
def test_compiled_restitution_is_the_references(d: float) -> None:
    assert restitution(d) == pytest.approx(float(closed_form.restitution(1 / 1.5, d)), rel=1e-14)


def test_friction_rises_to_static_and_falls_to_dynamic() -> None:
    friction = Friction(static=0.5, dynamic=0.3, slip_speed=1e-3)
    slips = np.linspace(0, 5e-3, 501)
    values = np.array([friction.coefficient(slip) for slip in slips])
    assert values[0] == 0.0
    assert values.max() == pytest.approx(0.5)
    assert values[slips >= 3e-3] == pytest.approx(0.3)
    assert np.abs(np.diff(values)).max() < 0.015


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"kind": "spring", "alpha": 0.1}, "kind"),
        ({"kind": "force", "alpha": 0.1}, "stiffness"),
        ({"kind": "restitution"}, "alpha"),
        ({"kind": "restitution", "alpha": 0.1, "stiffness": 1e10}, "stiffness"),
        ({"kind": "restitution", "alpha": "0.1"}, "alpha"),
        ({"kind": "restitution", "alpha": -0.1}, "alpha"),
        ({"kind": "restitution", "alpha": 0.1, "reading": "quick"}, "reading"),
    ],
)
def test_options_that_are_no_law_are_refused_by_name(options: dict[str, Any], word: str) -> None:
    with pytest.raises(SettingError, match=word):
        law_of(options)


def test_options_make_the_laws() -> None:
    assert law_of({"kind": "force", "alpha": 0.3, "stiffness": 3e10}) == HuntCrossley(3e10, 0.3)
    assert law_of({"kind": "restitution", "alpha": 0.3, "reading": "linear"}) == Restitution(
        0.3, "linear"
    )
    assert Restitution(0.3, "linear").at(0.5) == pytest.approx(0.85)
