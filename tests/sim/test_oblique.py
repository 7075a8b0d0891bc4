"""Oblique impacts: e of the normal direction, and what the body does along the plate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest
from free_flight import speed_at_plane
from hypothesis import given
from hypothesis import strategies as st

from hcbench.laws.coulomb import friction_impulse
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Floats, Impact, Launch
from hcbench.terms.scene import Scene, load_scene
from hcbench.terms.setting import Setting
from hcbench.tuning.evaluate import friction_error, oblique_launches
from hcbench.workers import call

# A solid ball, so that its slip meets 2/7 of its mass, with Coulomb's
# friction on a plane under gravity.
R = 0.0508
BALL = replace(
    load_scene("steel-plane"), ball_radius=R, plate_radius=math.inf, friction=0.5, gravity=9.81
)
MASS, ALPHA, STEP = BALL.mass, 0.315, 2e-3
ANYHOW = Launch(0.9, 0.3, slip=(0.7, -0.4), spin=(25.0, -10.0, 30.0))
STICKS, SLIDES = Launch(1.0, 0.6, slip=(0.4, 0.0)), Launch(0.3, 0.2, slip=(2.0, 0.0))


def target(timestep: float, low: float = 0.1, high: float = 3.0) -> Target:
    return Target(
        HuntCrossley(BALL.stiffness, ALPHA, BALL.exponent), BALL.mass, timestep, low, high
    )


def setting(recipe: str, timestep: float = STEP) -> Setting:
    return registry.recipe(recipe)(target(timestep))


def run(
    recipe: str, *launches: Launch, timestep: float = STEP, gravity: float = 9.81
) -> list[Impact]:
    made = setting(recipe, timestep)
    return registry.engine(made.engine).run(replace(BALL, gravity=gravity), made, launches)


class Judged(NamedTuple):
    """Largest errors of e and of friction's impulse, largest share of
    energy gained, impacts without e.
    """

    max_error: float
    impulse_error: float
    energy_gained: float
    failed: int


def judged(case: Scene, made: Setting, wanted: Target) -> Judged:
    impacts = registry.engine(made.engine).run(case, made, oblique_launches(wanted))
    good = [i for i in impacts if i.is_measured]
    return Judged(
        max(abs(i.restitution - float(wanted.restitution(np.array(i.speed_in)))) for i in good),
        friction_error(impacts, case),
        max(-i.tangential.energy_lost for i in good if i.tangential is not None),
        len(impacts) - len(good),
    )


def outcome(impact: Impact) -> list[float]:
    """Slip and spin after, share of energy lost, impulse ratio."""
    along = impact.tangential
    assert along is not None
    return [*along.slip_out, *along.spin_out, along.energy_lost, along.impulse_ratio]


def test_a_solid_sphere_that_sticks_rolls_on_with_five_sevenths_of_its_speed() -> None:
    sticks, slides = run("reference.hunt-crossley", STICKS, SLIDES, timestep=1e-6, gravity=0.0)
    assert sticks.tangential is not None
    assert slides.tangential is not None
    assert sticks.tangential.slip_out == pytest.approx((0.0, 0.0), abs=1e-15)
    assert R * sticks.tangential.spin_out[1] == pytest.approx(5 / 7 * 0.4)
    assert slides.tangential.impulse_ratio == pytest.approx(0.5)
    slowed = 0.5 * 0.3 * (1 + slides.restitution)
    assert slides.tangential.slip_out[0] == pytest.approx(2.0 - 3.5 * slowed)


component = st.floats(-30.0, 30.0)


@given(
    st.floats(0.05, 5.0),
    st.tuples(component, component),
    st.tuples(component, component, component),
)
def test_coulombs_law_loses_energy_and_never_turns_the_slip_around(
    speed: float, slip: tuple[float, float], spin: tuple[float, float, float]
) -> None:
    (impact,) = run("reference.hunt-crossley", Launch(speed, slip=slip, spin=spin), gravity=0.0)
    along = impact.tangential
    if along is None:
        return
    assert along.energy_lost > -1e-12
    assert along.impulse_ratio <= 0.5 * (1 + 1e-12)
    assert np.dot(along.slip_in, along.slip_out) >= -1e-12
    assert math.hypot(*along.slip_out) <= math.hypot(*along.slip_in) * (1 + 1e-12)


def mujoco_by_hand(launch: Launch, options: Mapping[str, Any], gravity: float) -> Floats:
    """e and `outcome` of a ball that meets a plane, in a loop as a user writes it."""
    row = options["rows"][0]
    solref, solimp = (" ".join(map(repr, row[key])) for key in ("solref", "solimp"))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{STEP!r}" gravity="0 0 {-gravity!r}"/><worldbody>'
        '<geom name="plate" type="plane" size="1 1 .1"/>'
        f'<body pos="0 0 {R!r}"><freejoint/><geom name="ball" type="sphere" size="{R!r}" mass="{MASS!r}"/>'
        '</body></worldbody><contact><pair geom1="ball" geom2="plate" condim="3" friction=".5 .5"'
        f' solref="{solref}" solimp="{solimp}"/></contact></mujoco>'
    )
    data, wrench, spin = mujoco.MjData(model), np.zeros(6), np.zeros(3)
    data.qpos[2] += (2 + launch.phase) * STEP * launch.speed
    data.qvel[:] = [*launch.slip, -launch.speed, *launch.spin]
    before, impulse = None, np.zeros(3)
    while True:
        mujoco.mju_rotVecQuat(spin, data.qvel[3:], data.qpos[3:])
        state = np.array([data.qpos[2] - R, *data.qvel[:3], *spin])
        mujoco.mj_step(model, data)
        if data.ncon:  # in the state that the step began with
            before = state if before is None else before
            mujoco.mj_contactForce(model, data, 0, wrench)
            impulse += STEP * wrench[:3]
        elif before is not None:
            return by_hand(before, state, impulse, gravity)


def by_hand(before: Floats, after: Floats, impulse: Floats, gravity: float) -> Floats:
    """From gap, velocity and spin, shape (7,), before and after: e, then what `outcome` has."""
    fall = gravity * STEP / 2
    speeds = [math.sqrt((v[3] - fall) ** 2 + 2 * gravity * v[0]) for v in (before, after)]
    energies = [
        0.5 * MASS * (speed**2 + v[1] ** 2 + v[2] ** 2) + 0.2 * MASS * R**2 * v[4:] @ v[4:]
        for speed, v in zip(speeds, (before, after), strict=True)
    ]
    slip = after[1] - R * after[5], after[2] + R * after[4]
    ratio = math.hypot(*impulse[1:]) / impulse[0]
    return np.array(
        [speeds[1] / speeds[0], *slip, *after[4:], 1 - energies[1] / energies[0], ratio]
    )


@pytest.mark.parametrize("launch", [ANYHOW, STICKS, SLIDES], ids=str)
def test_a_loop_by_hand_in_plain_mujoco_agrees(launch: Launch) -> None:
    made = setting("mujoco.impulse")
    (impact,) = run("mujoco.impulse", launch, gravity=0.0)
    seen = [impact.restitution, *outcome(impact)]
    assert seen == pytest.approx(mujoco_by_hand(launch, made.options, 0.0), abs=1e-9)


def pybullet_by_hand(launch: Launch, options: Mapping[str, Any], timestep: float) -> list[float]:
    """Velocity and spin after the bounce of a ball on a plane, in a loop as a user writes it."""
    from pybullet_utils.bullet_client import BulletClient  # type: ignore[import-untyped]

    p = BulletClient()
    p.setPhysicsEngineParameter(fixedTimeStep=timestep, **options["world"])
    p.setGravity(0, 0, -9.81)
    kind = {"useMaximalCoordinates": options["maximal_coordinates"]}
    plate = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE), **kind)
    ball = p.createMultiBody(MASS, p.createCollisionShape(p.GEOM_SPHERE, radius=R), **kind)
    p.changeDynamics(ball, -1, **{**options["ball"], "lateralFriction": 0.5})
    p.changeDynamics(plate, -1, **{**options["plate"], "lateralFriction": 1.0})
    gap = (2 + launch.phase) * timestep * launch.speed
    p.resetBasePositionAndOrientation(ball, [0, 0, R + gap], [0, 0, 0, 1])
    p.resetBaseVelocity(ball, [*launch.slip, -launch.speed], launch.spin)

    def at_plane() -> float:
        gap = p.getBasePositionAndOrientation(ball)[0][2] - R
        return speed_at_plane(gap, p.getBaseVelocity(ball)[0][2], 9.81, timestep)

    while (velocity := p.getBaseVelocity(ball))[0][2] < 0:
        before = at_plane()
        p.stepSimulation()
    e = at_plane() / before
    p.disconnect()
    (u, v, _), (a, b, c) = velocity
    return [e, u - R * b, v + R * a, a, b, c]


@pytest.mark.needs_engine("pybullet")
@pytest.mark.parametrize("launch", [ANYHOW, STICKS, SLIDES], ids=str)
def test_a_loop_by_hand_in_plain_pybullet_agrees(launch: Launch) -> None:
    made = setting("pybullet.restitution", 1 / 240)
    (impact,) = run("pybullet.restitution", launch, timestep=1 / 240)
    seen = call(pybullet_by_hand, launch, made.options, 1 / 240, limit=30)
    assert [impact.restitution, *outcome(impact)[:5]] == pytest.approx(seen, abs=1e-9)


@pytest.mark.needs_engine("pybullet")
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_the_restitution_of_pybullet_survives_gravity_friction_slip_and_spin(
    gravity: float,
) -> None:
    """At PyBullet's step of 1/240 s its friction is Coulomb's, too."""
    launches = [
        Launch(v, phase, slip=slip, spin=spin)
        for v in (0.1, 0.7, 2.9)
        for phase in (0.11, 0.71)
        for slip, spin in (((1.3, 0.0), (0.0, 0.0, 0.0)), ((0.4, 0.2), (5.0, -40.0, 20.0)))
    ]
    made = setting("pybullet.restitution", 1 / 240)
    asked = made.options["ball"]["restitution"] * made.options["plate"]["restitution"]
    case = replace(BALL, gravity=gravity)
    for impact in registry.engine("pybullet").run(case, made, launches):
        along = impact.tangential
        assert along is not None
        if (
            not gravity
        ):  # which else changes e by where in the step the ball reverses, as without slip
            assert impact.restitution == pytest.approx(asked, abs=1e-6)
        coulomb = friction_impulse(along.slip_in, along.normal_impulse, case)
        assert along.impulse == pytest.approx(coulomb, rel=1e-6, abs=1e-9)


def test_one_contact_row_of_mujoco_makes_bounce_of_sliding_and_no_energy_check_sees_it() -> None:
    """`impulse` with friction: e 2 ... 7 where .9 is asked, while energy is lost."""
    wanted = Target(HuntCrossley(BALL.stiffness, 0.06), BALL.mass, STEP, 0.3, 1.0)
    made = registry.recipe("mujoco.impulse")(wanted)
    slides, spins = registry.engine("mujoco").run(
        replace(BALL, gravity=0.0), made, [SLIDES, Launch(0.3, 0.2, spin=(0.0, 40.0, 0.0))]
    )
    assert made.options["rows"][0]["solref"][1] * STEP == pytest.approx(-1.97, abs=0.01)
    for impact in (slides, spins):
        assert impact.tangential is not None
        assert 2.0 < impact.restitution < 8.0
        assert impact.tangential.energy_lost > 0.0


def test_a_setting_is_judged_by_what_it_does_where_bodies_slide() -> None:
    case, wanted = replace(BALL, gravity=0.0), target(STEP)
    row = judged(case, setting("mujoco.impulse"), wanted)
    law = judged(case, setting("reference.hunt-crossley"), wanted)
    assert row.max_error > 2.0
    assert row.energy_gained < 0.0
    assert law.max_error < 1e-9
    assert law.impulse_error < 1e-12
    assert law.failed == row.failed == 0


def test_a_cup_of_tendons_has_no_friction() -> None:
    cup = replace(load_scene("steel-cup"), friction=0.5)
    with pytest.raises(SettingError, match="friction"):
        registry.engine("mujoco").run(cup, setting("mujoco.impulse"), [SLIDES])


@pytest.mark.parametrize(
    ("recipe", "timestep", "off"),
    [
        (
            "mujoco.restitution-law",
            STEP,
            0.04,
        ),  # MuJoCo's contact point is v h / 2 deep in the ball
        ("pybullet.restitution-law", 1 / 240, 1e-9),
    ],
)
def test_the_restitution_law_is_exact_obliquely_under_gravity(
    recipe: str, timestep: float, off: float
) -> None:
    """From the speed on at which its e leaves gravity its part: α v² > g h."""
    wanted = target(timestep, low=0.5)
    made = registry.recipe(recipe)(wanted)
    result = judged(BALL, made, wanted)
    assert result.failed == 0
    assert result.max_error < 1e-6
    assert result.impulse_error < off
    assert result.energy_gained < 0.0


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_the_force_law_has_coulombs_friction(engine: str) -> None:
    wanted, case = target(1e-5), replace(BALL, gravity=0.0)
    made = registry.recipe(f"{engine}.hunt-crossley")(wanted)
    result = judged(case, made, wanted)
    assert result.max_error < 1e-6
    assert result.impulse_error < 1e-3
