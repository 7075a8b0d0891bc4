"""Staggered pairs carry eq. (16) in plain MuJoCo: restitution, loop,
any mass, any band, any exponent.
"""

from __future__ import annotations

import time

import mujoco
import numpy as np
import pytest
from plain_mujoco import INCH, STEEL_MASS, STEEL_STIFFNESS, Flight, pasted, simulated

from hcbench.engines.mujoco.recipes.staggered import STAGGERED, staggered_rows
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target, resolvable_law
from hcbench.system.errors import SettingError
from hcbench.terms.resolution import STEPS_OF_A_SOFTENED

HELD_OUT = np.array([1.0, 1.37, 2.1, 3.3, 5.2, 8.0, 12.3, 16.0, 20.0]) * INCH
ALPHAS = (0.002, 0.004, 0.008, 0.016)


def target_of(
    alpha: float,
    timestep: float,
    exponent: float = 1.5,
    mass: float = STEEL_MASS,
    band: tuple[float, float] = (1.0, 20.0),
) -> Target:
    # About the same penetration for any exponent.
    stiffness = STEEL_STIFFNESS * 1.4e-5 ** (1.5 - exponent)
    law = HuntCrossley(stiffness, alpha / INCH, exponent)
    return Target(law, mass, timestep, band[0] * INCH, band[1] * INCH)


def measured(
    target: Target, speeds: np.ndarray, integrator: str = "Euler", phases: int = 8
) -> Flight:
    setting = STAGGERED(target, integrator)
    law = resolvable_law(target)
    longest = float(closed_form.duration(law, target.mass, speeds[[0, -1]]).max())
    xml = pasted(dict(setting.options), target.timestep, target.mass)
    return simulated(xml, target.timestep, speeds, 1.1 * longest + 4 * target.timestep, phases)


def restitution_error(flight: Flight, target: Target, speeds: np.ndarray) -> float:
    return float(np.abs(flight.restitution - target.restitution(speeds)[:, None]).max())


def loop_error(flight: Flight, target: Target, speeds: np.ndarray) -> float:
    """Worst root mean square distance in force at equal penetration and
    branch, over the law's largest.
    """
    law, worst = resolvable_law(target), 0.0
    for i, speed in enumerate(speeds):
        truth = closed_form.loop(law, target.mass, float(speed), 2001)
        top = len(truth.time) // 2
        for depth, rate in zip(flight.x[i], flight.v[i], strict=True):
            inside = np.flatnonzero(depth[:-1] > 0)
            x, force = depth[inside], -target.mass * np.diff(rate)[inside] / target.timestep
            going_in = np.interp(x, truth.penetration[: top + 1], truth.force[: top + 1])
            coming_out = np.interp(x, truth.penetration[top:][::-1], truth.force[top:][::-1])
            off = force - np.where(np.arange(len(x)) <= x.argmax(), going_in, coming_out)
            path = np.abs(np.gradient(x))
            rms = float(np.sqrt((off**2 * path).sum() / path.sum()))
            worst = max(worst, rms / float(closed_form.force_max(law, target.mass, float(speed))))
    return worst


@pytest.mark.adhesion
@pytest.mark.parametrize("alpha", ALPHAS)
def test_restitution_and_loop_are_those_of_the_law(alpha: float) -> None:
    target = target_of(alpha, 1e-6)
    flight = measured(target, HELD_OUT)
    assert restitution_error(flight, target, HELD_OUT) < 3e-5
    assert loop_error(flight, target, HELD_OUT) < 0.002


@pytest.mark.adhesion
@pytest.mark.parametrize("exponent", [1.0, 2.0])
@pytest.mark.parametrize("alpha", [0.002, 0.016])
def test_other_exponents_have_the_same_restitution_and_their_own_loop(
    alpha: float, exponent: float
) -> None:
    target = target_of(alpha, 1e-6, exponent)
    flight = measured(target, HELD_OUT)
    # A linear spring switched on between two steps scatters e by (h ω)²/8 whatever else is right.
    scatter = (1e-6 * np.pi / 1.87e-4) ** 2 / 8 if exponent == 1.0 else 0.0
    assert restitution_error(flight, target, HELD_OUT) < 3e-5 + scatter
    assert loop_error(flight, target, HELD_OUT) < 0.002


@pytest.mark.adhesion
@pytest.mark.parametrize("alpha", ALPHAS)
def test_at_ten_microseconds_only_the_step_is_left(alpha: float) -> None:
    target = target_of(alpha, 1e-5)
    flight = measured(target, HELD_OUT)
    # The law itself, integrated in 16 steps, scatters by 6e-4 with the
    # phase; its mean does not move.
    assert restitution_error(flight, target, HELD_OUT) < 1.5e-3
    mean = flight.restitution.mean(axis=1) - target.restitution(HELD_OUT)
    assert np.abs(mean).max() < 5e-5
    assert loop_error(flight, target, HELD_OUT) < 0.01


@pytest.mark.adhesion
@pytest.mark.parametrize("timestep", [1e-4, 5e-4, 1e-3, 2e-3])
@pytest.mark.parametrize("alpha", ALPHAS)
def test_coarse_steps_soften_the_spring_and_keep_the_restitution(
    alpha: float, timestep: float
) -> None:
    target = target_of(alpha, timestep)
    flight = measured(target, HELD_OUT)
    assert (flight.x > 0).sum(axis=-1).min() >= 20
    assert resolvable_law(target).stiffness < 0.01 * target.law.stiffness
    assert restitution_error(flight, target, HELD_OUT) < 1e-3
    assert loop_error(flight, target, HELD_OUT) < 0.005


def test_a_softened_contact_lasts_as_many_steps_as_asked() -> None:
    target = target_of(0.008, 1e-3)
    shortest = closed_form.duration(resolvable_law(target), STEEL_MASS, target.speed_max)
    assert shortest / target.timestep == pytest.approx(STEPS_OF_A_SOFTENED)
    assert resolvable_law(target_of(0.008, 1e-6)) == target.law


@pytest.mark.adhesion
@pytest.mark.parametrize("integrator", ["implicit", "implicitfast", "RK4"])
def test_other_integrators_that_hold(integrator: str) -> None:
    target = target_of(0.008, 1e-6)
    assert restitution_error(measured(target, HELD_OUT, integrator), target, HELD_OUT) < 3e-5


@pytest.mark.adhesion
@pytest.mark.parametrize(
    ("mass", "band"),
    [(0.001, (1.0, 20.0)), (1000.0, (0.5, 3.0)), (0.2, (10.0, 12.0)), (5.0, (0.1, 40.0))],
)
@pytest.mark.parametrize("alpha", [0.0005, 0.02])
def test_any_mass_and_any_band(alpha: float, mass: float, band: tuple[float, float]) -> None:
    contact = closed_form.duration(target_of(alpha, 1.0).law, mass, band[1] * INCH)
    target = target_of(alpha, float(contact) / 160, mass=mass, band=band)
    speeds = np.geomspace(*band, 7) * INCH
    flight = measured(target, speeds, phases=4)
    assert restitution_error(flight, target, speeds) < 6e-5
    assert loop_error(flight, target, speeds) < (0.005 if band[1] < 40 * band[0] else 0.015)


def test_no_loss_is_springs_alone() -> None:
    target = target_of(0.0, 1e-6)
    assert all(row.damping == 0.0 for row in staggered_rows(target))
    assert restitution_error(measured(target, HELD_OUT), target, HELD_OUT) < 3e-5


def test_numbers_are_per_unit_effective_mass() -> None:
    one = staggered_rows(target_of(0.008, 1e-6))
    double = Target(
        HuntCrossley(2 * STEEL_STIFFNESS, 0.008 / INCH), 2 * STEEL_MASS, 1e-6, INCH, 20 * INCH
    )
    for row, twin in zip(one, staggered_rows(double), strict=True):
        assert twin.stiffness == pytest.approx(row.stiffness, rel=1e-6)
        assert twin.damping == pytest.approx(row.damping, rel=1e-6)
        assert twin.onset == pytest.approx(row.onset, rel=1e-6, abs=1e-12)


def test_the_same_answer_always_and_at_once() -> None:
    target = target_of(0.008, 1e-6)
    begin = time.process_time()
    first = STAGGERED(target)
    assert time.process_time() - begin < 2.0
    assert first.key == STAGGERED(target).key


def test_what_breaks_it_is_refused() -> None:
    target = target_of(0.008, 1e-6)
    with pytest.raises(SettingError, match="integrator"):
        STAGGERED(target, "discrete")
    linear = Target(target.law, target.mass, 1e-6, INCH, 20 * INCH, reading="linear")
    with pytest.raises(SettingError, match="two-pair"):
        STAGGERED(linear)


@pytest.mark.adhesion
def test_two_free_bodies_meet_off_axis_with_their_effective_mass() -> None:
    """Balls of 1 lb and 2 lb, both moving, along no axis of the world: their bounce is the law's."""
    first, second = STEEL_MASS, 2 * STEEL_MASS
    target = target_of(0.008, 1e-6, mass=first * second / (first + second))
    rows = STAGGERED(target).options["rows"]
    geom = f'type="sphere" size="{INCH!r}" contype="0" conaffinity="0"'
    copies = "".join(
        f'<geom name="a{i}" mass="{0.0 if i else first!r}" {geom}/>' for i in range(len(rows))
    )
    pairs = "".join(
        f'<pair geom1="a{i}" geom2="b" condim="1" margin="{-row["onset"]!r}" adhesion="{row["adhesion"]!r}"'
        f' solref="{" ".join(map(repr, row["solref"]))}" solimp="{" ".join(map(repr, row["solimp"]))}"/>'
        for i, row in enumerate(rows)
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="1e-6" gravity="0 0 0"/><worldbody>'
        f"<body><freejoint/>{copies}</body><body><freejoint/>"
        f'<geom name="b" mass="{second!r}" {geom}/></body></worldbody><contact>{pairs}</contact></mujoco>'
    )
    data = mujoco.MjData(model)
    normal, sideways, speed = np.array([0.6, 0.0, 0.8]), np.array([0.0, 0.3, 0.0]), 12 * INCH
    data.qpos[7:10] = (2 * INCH + 1.5e-6 * speed) * normal
    data.qvel[:3] = 0.75 * speed * normal + sideways
    data.qvel[6:9] = -0.25 * speed * normal + sideways
    for _ in range(260):
        mujoco.mj_step(model, data)
    apart = data.qvel[6:9] - data.qvel[:3]
    assert float(apart @ normal) / speed == pytest.approx(
        float(target.restitution(speed)), abs=3e-5
    )
    assert np.abs(np.cross(apart, normal)).max() < 1e-9
    assert data.qvel[1] == pytest.approx(0.3, abs=1e-9)


@pytest.mark.adhesion
def test_under_gravity_it_is_the_law_under_gravity() -> None:
    gravity, timestep = 9.81, 1e-6
    target = target_of(0.008, timestep)
    speeds = np.array([2.0, 16.0]) * INCH
    xml = pasted(dict(STAGGERED(target).options), timestep, STEEL_MASS, gravity=gravity)
    flight = simulated(xml, timestep, speeds, 3e-4)
    # The law by the same step, from the same states.
    x, v = flight.x[..., 0].copy(), flight.v[..., 0].copy()
    for _ in range(flight.x.shape[-1] - 1):
        force = np.where(x > 0, target.law.force(np.maximum(x, 0.0), v), 0.0)
        v = v + timestep * (gravity - force / STEEL_MASS)
        x = x + timestep * v
    # Not quite its own error: the dampers' impedance holds back a part
    # of the weight while they act.
    assert np.abs((flight.v[..., -1] - v) / speeds[:, None]).max() < 1e-4


@pytest.mark.adhesion
def test_a_ball_let_down_on_the_plate_comes_to_rest() -> None:
    """The oscillation dies with the law's own rate (3/4) α g, and there is no creep."""
    alpha, timestep, gravity = 0.02, 1e-5, 9.81
    xml = pasted(
        dict(STAGGERED(target_of(alpha, timestep)).options), timestep, STEEL_MASS, gravity=gravity
    )
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    sag = (STEEL_MASS * gravity / STEEL_STIFFNESS) ** (1 / 1.5)
    data.qpos[0] = -0.5 * sag
    height = np.empty(60_000)
    for i in range(len(height)):
        mujoco.mj_step(model, data)
        height[i] = data.qpos[0]
    rate = np.log(np.ptp(height[:3000]) / np.ptp(height[-3000:])) / (57_000 * timestep)
    assert rate == pytest.approx(0.75 * alpha / INCH * gravity, rel=0.2)
    # A tenth of the band's lowest penetration deep the springs are straight lines.
    assert -height[-3000:].mean() == pytest.approx(sag, rel=0.2)
    assert abs(height[-3000:].mean() - height[-6000:-3000].mean()) / (3000 * timestep) < 1e-8
