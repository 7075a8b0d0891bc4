"""Laws whose v_i is each impact's own, inside MuJoCo and PyBullet: found
from the state, at every phase.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pytest
from compiled_laws import ContactOde, euler_force, touch_speed, touch_speed_ode
from contact_scenes import plugged
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from hcbench.contact import pybullet as bullet_contact
from hcbench.contact.mujoco import load
from hcbench.laws import ode
from hcbench.laws.contact_law import law_of, require_resolved
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import (
    LAWS,
    Exact,
    Flores,
    LankaraniNikravesh,
    PublishedLaw,
    TouchSpeedLaw,
)
from hcbench.laws.restitution import ConstantRestitution
from hcbench.system.errors import SettingError, UserError
from hcbench.terms.setting import Setting
from hcbench.tuning.model import snippet

try:
    import pybullet as bullet
except ImportError:  # no wheel for this Python: the fixture `client` skips
    bullet = None

MASS, STIFFNESS, RADIUS = 0.45359237, 3.4064e10, 0.0508
KAPPA = STIFFNESS / MASS
SPEEDS = (0.0254, 0.2032, 0.508)
PHASES = [0.06 + i / 8 for i in range(8)]
FAMILIES = pytest.mark.parametrize("family", LAWS.values(), ids=lambda law: law.slug)


def ball(h: float, law: Any, integrator: str = "Euler", gravity: float = 0.0) -> Any:
    spec = mujoco.MjSpec.from_string(f"""<mujoco>
      <option timestep="{h}" integrator="{integrator}" gravity="0 0 {-gravity}"/><worldbody>
      <geom name="plate" type="plane" size="1 1 1"/>
      <body pos="0 0 {RADIUS}"><freejoint/><geom name="ball" size="{RADIUS}" mass="{MASS}"/></body>
      </worldbody></mujoco>""")
    return plugged(spec, [("ball", "plate")], law)


def launched(model: Any, speed: float, phase: float) -> Any:
    data = mujoco.MjData(model)
    data.qpos[2], data.qvel[2] = RADIUS + (2 + phase) * model.opt.timestep * speed, -speed
    return data


def bounce(model: Any, speed: float, phase: float) -> float:
    data = launched(model, speed, phase)
    for _ in range(5000):
        mujoco.mj_step(model, data)
        if data.qvel[2] > 0 and data.qpos[2] > RADIUS + 2 * model.opt.timestep * speed:
            return float(data.qvel[2]) / speed
    raise AssertionError("the ball never left")


# The speed at touch, from the state


@given(
    u=st.floats(-1.0, 1.0),
    chi=st.sampled_from([1e-6, 0.02, 0.4, 1.6, 8.0]),
    speed=st.floats(1e-4, 10.0),
    n=st.sampled_from([1.0, 1.5, 2.5]),
)
@settings(max_examples=3 * settings().max_examples // 2)
def test_every_state_of_an_impact_tells_its_speed_at_touch(
    u: float, chi: float, speed: float, n: float
) -> None:
    motion = touch_speed_ode(KAPPA, chi, n)
    u = u if u >= 0 else u * motion.e
    stored = speed**2 * quad(lambda w: w / (1 + chi * w), u, 1.0)[0]  # by its definition
    x = ((n + 1) * max(stored, 0.0) / KAPPA) ** (1 / (n + 1))
    assert touch_speed(KAPPA, n, chi, motion.e, 0.0, x, u * speed) == pytest.approx(speed, rel=1e-9)


@pytest.mark.parametrize(
    ("speed", "off", "without"), [(0.025, 3e-4, 1e-3), (0.1, 1e-5, 2e-4), (0.5, 2e-6, 2e-5)]
)
@pytest.mark.parametrize("family", [Flores, LankaraniNikravesh])
def test_gravity_is_reckoned_with(
    family: PublishedLaw, speed: float, off: float, without: float
) -> None:
    law, b, h = TouchSpeedLaw(family, STIFFNESS, 0.5), 9.81, 1e-5

    def error(load: float) -> float:
        motion = ContactOde(KAPPA, 0.0, 1.5, b, law.chi, law.delivered, load)
        x, v = -1.3 * h * speed, speed
        start = math.sqrt(
            (v + b * h / 2) ** 2 - 2 * b * x
        )  # v is the mean rate over the step before
        force = 1.0
        while not (v < 0 and force == 0.0 and x < 0):
            force = euler_force(motion, h, x, v)
            v -= h * (force - b)
            x += h * v
        out = math.sqrt((v + b * h / 2) ** 2 - 2 * b * x) / start
        return abs(out - ode.impact(law, MASS, start, gravity=b).restitution)

    assert error(b) < off
    assert error(0.0) > without


# In MuJoCo


@FAMILIES
@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_mujoco_delivers_what_follows_from_chi(family: PublishedLaw, integrator: str) -> None:
    for asked in (0.9, 0.4):
        law = TouchSpeedLaw(family, STIFFNESS, asked)
        model = ball(1e-5, law, integrator)
        found = [bounce(model, v, p) for v in SPEEDS for p in PHASES]
        assert np.abs(np.array(found) - law.delivered).max() < 1e-5


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_mujoco_at_a_fine_step(integrator: str) -> None:
    law = TouchSpeedLaw(Flores, STIFFNESS, 0.5)
    model = ball(1e-6, law, integrator)
    for phase in PHASES:
        assert bounce(model, 0.2032, phase) == pytest.approx(law.delivered, abs=1e-7)


def test_an_impact_goes_on_alike_in_another_simulation_that_has_only_its_state() -> None:
    model, kind = (
        ball(1e-5, TouchSpeedLaw(Flores, STIFFNESS, 0.5)),
        mujoco.mjtState.mjSTATE_FULLPHYSICS,
    )
    one, other = launched(model, 0.3, 0.4), mujoco.MjData(model)
    for i in range(40):
        mujoco.mj_step(model, one)
        state = np.zeros(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, one, state, kind)
        if i % 3 == 0:  # in between another impact is in the way
            other = launched(model, 0.05, 0.1)
            mujoco.mj_step(model, other, nstep=7)
            mujoco.mj_setState(model, other, state, kind)
        assert np.array_equal(other.qpos, one.qpos)
        mujoco.mj_step(model, other)
    assert one.qvel[2] > 0


def test_rollouts_differ_in_the_restitution_asked_for() -> None:
    kind, asked = mujoco.mjtState.mjSTATE_FULLPHYSICS, np.array([0.3, 0.6, 0.9, 1.0])
    models = [ball(1e-5, TouchSpeedLaw(Flores, STIFFNESS, e)) for e in asked]
    state = np.zeros((4, mujoco.mj_stateSize(models[0], kind)))
    for row, speed in zip(state, (0.05, 0.1, 0.3, 0.5), strict=True):
        mujoco.mj_getState(models[0], launched(models[0], speed, 0.3), row, kind)
    before = state[:, -4].copy()
    threads = [mujoco.MjData(models[0]) for _ in range(2)]
    states, _ = mujoco.rollout.rollout(models, threads, state, nstep=60)
    assert -states[:, -1, -4] / before == pytest.approx(Flores.delivered(asked), abs=1e-5)


def test_a_bounce_train_ends_at_rest_at_the_static_depth() -> None:
    model = ball(1e-5, TouchSpeedLaw(Flores, STIFFNESS, 0.5), gravity=9.81)
    data = mujoco.MjData(model)
    data.qpos[2] += 2e-5
    mujoco.mj_step(model, data, nstep=3000)
    static = (MASS * 9.81 / STIFFNESS) ** (2 / 3)
    assert RADIUS - data.qpos[2] == pytest.approx(static, rel=1e-6)
    assert abs(data.qvel[2]) < 1e-9


def test_two_free_balls_of_unequal_mass() -> None:
    spec = mujoco.MjSpec.from_string(f"""<mujoco><option timestep="1e-5" gravity="0 0 0"/><worldbody>
      <body><freejoint/><geom name="a" size="{RADIUS}" mass="0.2"/></body>
      <body pos="{2 * RADIUS + 1e-5} 0 0"><freejoint/><geom name="b" size="{RADIUS}" mass="0.7"/></body>
      </worldbody></mujoco>""")
    law = TouchSpeedLaw(LankaraniNikravesh, STIFFNESS, 0.6)
    model = plugged(spec, [("a", "b")], law)
    data = mujoco.MjData(model)
    data.qvel[0] = 0.4
    mujoco.mj_step(model, data, nstep=100)
    assert (data.qvel[6] - data.qvel[0]) / 0.4 == pytest.approx(law.delivered, abs=1e-6)
    assert 0.2 * data.qvel[0] + 0.7 * data.qvel[6] == pytest.approx(0.08, abs=1e-13)


@pytest.mark.parametrize("h", [1e-4, 1e-3])
def test_one_restitution_for_all_impacts_at_any_step(h: float) -> None:
    law = ConstantRestitution(float(Flores.delivered(0.8)))
    model = ball(h, law)
    for speed in SPEEDS:
        for phase in PHASES[::3]:
            assert bounce(model, speed, phase) == pytest.approx(law.restitution, abs=1e-12)


# In PyBullet


@pytest.fixture
def client() -> Iterator[int]:
    if bullet is None:
        pytest.skip("no PyBullet for this Python")
    made = bullet.connect(bullet.DIRECT)
    bullet.setPhysicsEngineParameter(numSubSteps=0, physicsClientId=made)
    yield made
    bullet.disconnect(made)


def bodies(client: int, h: float) -> tuple[int, int]:
    bullet.setTimeStep(h, physicsClientId=client)
    sphere = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=RADIUS, physicsClientId=client)
    plane = bullet.createCollisionShape(bullet.GEOM_PLANE, physicsClientId=client)
    made = bullet.createMultiBody(MASS, sphere, physicsClientId=client)
    bullet.changeDynamics(made, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    return made, bullet.createMultiBody(0, plane, physicsClientId=client)


def bounce_in_bullet(client: int, body: int, h: float, speed: float, phase: float) -> float:
    gap = (2 + phase) * h * speed
    bullet.resetBasePositionAndOrientation(
        body, (0, 0, RADIUS + gap), (0, 0, 0, 1), physicsClientId=client
    )
    bullet.resetBaseVelocity(body, (0, 0, -speed), (0, 0, 0), physicsClientId=client)
    for _ in range(5000):
        bullet.stepSimulation(physicsClientId=client)
        out = bullet.getBaseVelocity(body, physicsClientId=client)[0][2]
        at = bullet.getBasePositionAndOrientation(body, physicsClientId=client)[0][2]
        if out > 0 and at > RADIUS + 2 * h * out:
            return float(out / speed)
    raise AssertionError("the ball never left")


@pytest.mark.needs_engine("pybullet")
@FAMILIES
def test_pybullet_delivers_what_follows_from_chi(client: int, family: PublishedLaw) -> None:
    ball, plate = bodies(client, 1e-5)
    law = TouchSpeedLaw(family, STIFFNESS, 0.6)
    bullet_contact.add(law, ball, plate, client=client)
    for speed in SPEEDS:
        found = [bounce_in_bullet(client, ball, 1e-5, speed, phase) for phase in PHASES]
        assert np.abs(np.array(found) - law.delivered).max() < 1e-5


@pytest.mark.needs_engine("pybullet")
def test_pybullet_at_a_fine_step(client: int) -> None:
    ball, plate = bodies(client, 1e-6)
    law = TouchSpeedLaw(Flores, STIFFNESS, 0.5)
    bullet_contact.add(law, ball, plate, client=client)
    for phase in PHASES[::2]:
        e = bounce_in_bullet(client, ball, 1e-6, 0.2032, phase)
        assert e == pytest.approx(law.delivered, abs=1e-7)


@pytest.mark.needs_engine("pybullet")
def test_pybullet_gives_every_impact_one_restitution(client: int) -> None:
    ball, plate = bodies(client, 1e-3)
    bullet_contact.add(ConstantRestitution(0.7), ball, plate, client=client)
    for speed in SPEEDS:
        assert bounce_in_bullet(client, ball, 1e-3, speed, 0.3) == pytest.approx(0.7, abs=1e-12)


def test_a_step_too_coarse_names_what_has_its_restitution_at_any_step(client: int) -> None:
    law = TouchSpeedLaw(Flores, STIFFNESS, 0.5)
    with pytest.raises(
        SettingError, match=r"For coarser steps take ConstantRestitution\(law\.delivered\)"
    ):
        bullet_contact.add(law, *bodies(client, 1e-3), client=client)
    for one, instead in (
        (law, r"ConstantRestitution\(law"),
        (HuntCrossley(STIFFNESS, 0.3), r"Restitution\(alpha"),
    ):
        with pytest.raises(SettingError, match=f"For coarser steps take {instead}"):
            require_resolved(one, MASS, 0.5, 1e-3)


# As options, and as text to paste

FORCE = {"kind": "force", "law": "flores", "restitution": 0.8, "stiffness": 3e10}


def test_options_make_the_laws() -> None:
    assert law_of(FORCE) == TouchSpeedLaw(Flores, 3e10, 0.8)
    assert law_of({**FORCE, "law": "Flores et al.", "exponent": 1.2}) == TouchSpeedLaw(
        Flores, 3e10, 0.8, 1.2
    )
    made = law_of({"kind": "restitution", "law": "exact", "restitution": 0.8})
    assert isinstance(made, ConstantRestitution)
    assert made.restitution == pytest.approx(0.8, rel=1e-14)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({**FORCE, "law": "florez"}, "law: 'florez'; expected one of first-order, .*flores"),
        ({**FORCE, "restitution": 0.0}, "χ = 8 .* is infinite at e = 0"),
        ({**FORCE, "restitution": 1.2}, "above 1 χ is below 0"),
        ({**FORCE, "alpha": 0.3}, "law.alpha"),
        ({**FORCE, "stiffness": "1e10"}, "law.stiffness"),
        ({"kind": "force", "law": "flores", "stiffness": 3e10}, "law.restitution"),
        (
            {"kind": "restitution", "law": "flores", "restitution": 0.8, "stiffness": 3e10},
            "law.stiffness",
        ),
    ],
)
def test_options_that_are_no_law_are_refused_by_name(options: dict[str, Any], says: str) -> None:
    with pytest.raises(UserError, match=says):
        law_of(options)


@pytest.mark.parametrize("law", [Flores, HuntCrossley, TouchSpeedLaw, "flores", None])
def test_what_is_no_law_cannot_be_attached(law: Any) -> None:
    with pytest.raises(UserError, match="law"):
        ball(1e-5, law)


@pytest.mark.parametrize(
    "law", [FORCE, {"kind": "restitution", "law": "carvalho-martins", "restitution": 0.8}]
)
def test_pasted_text_has_the_law_of_the_setting(law: dict[str, Any]) -> None:
    text = snippet(Setting("mujoco", "x", 1e-5, {"law": law}), "plane")
    load()
    scene = f"""<mujoco><option timestep="1e-5" gravity="0 0 0"/>{text}
      <worldbody><geom name="plate" type="plane" size="1 1 1"/><body name="ball" pos="0 0 {RADIUS}">
      <freejoint/><geom name="ball" size="{RADIUS}" mass="{MASS}"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(scene)
    given = law_of(law)
    assert isinstance(given, TouchSpeedLaw | ConstantRestitution)
    e = given.delivered if isinstance(given, TouchSpeedLaw) else given.restitution
    assert bounce(model, 0.3, 0.4) == pytest.approx(e, abs=1e-5)


def test_the_exact_law_is_asked_for_e_and_gives_it() -> None:
    for e in (0.2, 0.5, 0.95):
        model = ball(1e-5, TouchSpeedLaw(Exact, STIFFNESS, e))
        assert bounce(model, 0.3, 0.4) == pytest.approx(e, abs=1e-5)
