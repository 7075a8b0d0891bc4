"""The restitution plug-in of MuJoCo in bodies that are held together:
equalities, joints and their limits.
"""

from __future__ import annotations

import re
from functools import partial

import mujoco
import numpy as np
import pytest
from contact_scenes import BALL, RADIUS, add_body, add_equality, chain, plugged, rise, world
from random_scenes import Made, simulate

from hcbench.contact.mujoco import ConstantRestitution, Restitution

LAW, ELASTIC = Restitution(0.315), ConstantRestitution(1.0)


def _bounced(spec: object, velocity: object) -> tuple[float, float]:
    """Speed of the ball's lowest point after the step in which it touches the floor at 0.3 m/s,
    over it, and the largest rate of the equalities then, m/s.
    """
    model = plugged(spec, [("a", "floor")], ConstantRestitution(0.8))
    data, jacobian = mujoco.MjData(model), np.zeros((3, model.nv))
    data.qvel[:] = velocity
    mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    mujoco.mj_jac(model, data, jacobian, None, np.zeros(3), model.body("a").id)
    return float(jacobian[2] @ data.qvel) / 0.3, float(np.abs(data.efc_vel[: data.ne]).max())


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "RK4"])
@pytest.mark.parametrize("kind", ["weld", "connect"])
def test_bodies_that_are_held_together_bounce_together(kind: str, integrator: str) -> None:
    """Off by what turning changes within the step: without the
    equality in the impact e would be .65.
    """
    spec = world(1e-4, gravity=0.0, friction=0.3, integrator=integrator)
    add_body(spec, "a", (0, 0, RADIUS - 1e-6), friction=0.3)
    add_body(spec, "c", (0.3, 0, 0.2), friction=0.3)
    numbers = (
        [0.15, 0, 0.07] if kind == "connect" else [0, 0, 0, 0.3, 0, 0.15 + 1e-6, 1, 0, 0, 0, 1]
    )
    add_equality(spec, kind, "a", "c", numbers)
    e, rate = _bounced(spec, np.tile([0.1, 0, -0.3, 0, 0, 0], 2))
    assert e == pytest.approx(0.8, abs=2e-4)
    assert rate < 2e-4


SLINGSHOT = """
<mujoco>
  <option timestep=".005" integrator="{integrator}"><flag energy="enable"/></option>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1"/>
    <body name="a" pos="0 0 .3">
      <joint type="slide" axis="0 0 1" stiffness="200" springref="{at}"/>
      <geom name="a" type="sphere" size=".05" mass="1"/>
    </body>
  </worldbody>
</mujoco>"""


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize("at", [-0.4, 0.1])
def test_an_elastic_ball_on_a_spring_keeps_its_energy(at: float, integrator: str) -> None:
    """A spring that presses the ball into the floor, or draws it off: an impact that knew of
    gravity alone would gain 5 % at this step.
    """
    spec = mujoco.MjSpec.from_string(SLINGSHOT.format(at=at, integrator=integrator))
    native = spec.compile()
    made = Made(plugged(spec, [("a", "floor")], ELASTIC), native, np.full(1, -8.0), False)
    seen = simulate(made, 2.0)
    assert seen.depth > 1e-3
    assert seen.gain < 1e-9


def test_a_servo_without_damping_that_draws_an_elastic_ball_off_gains_what_the_page_says() -> None:
    """Impacts know of springs, not of servos, which act after them within the step."""
    servo = """<actuator><general joint="j" gainprm="20" biastype="affine" biasprm="0 -200 0"/>
      </actuator></mujoco>"""
    text = SLINGSHOT.format(at=0.1, integrator="Euler").replace(
        'timestep=".005"', 'timestep=".002"'
    )
    text = text.replace('stiffness="200"', 'name="j"').replace("</mujoco>", servo)
    spec = mujoco.MjSpec.from_string(text)
    native, start = spec.compile(), np.full(1, -8.0)
    native.actuator_gainprm[0, 0] /= 0.3  # the control of simulate
    model = plugged(spec, [("a", "floor")], ELASTIC)
    model.actuator_gainprm[0, 0] /= 0.3
    assert 0.15 < simulate(Made(model, native, start, False), 2.0).gain < 0.25


def test_a_geared_slide_bounces_with_the_mass_of_both() -> None:
    spec = world(1e-3, gravity=0.0)
    for name, x in (("a", 0.0), ("c", 0.3)):
        body = spec.worldbody.add_body(name=name, pos=[x, 0, 1.0 if x else RADIUS - 1e-6])
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
        body.add_geom(name=name, type=BALL, size=[RADIUS, 0, 0], mass=1.0)
    add_equality(spec, "joint", "c", "a", [0, 2])
    e, rate = _bounced(spec, [-0.3, -0.6])
    assert e == pytest.approx(0.8, abs=1e-9)
    assert rate < 1e-9


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "RK4"])
@pytest.mark.parametrize("kind", ["free", "limited", "geared"])
def test_chains_that_fall_win_no_energy(kind: str, integrator: str) -> None:
    """Elastic ones too: the step's Coriolis forces are those of the velocities after the impact."""
    for seed, h, law in ((2, 5e-3, ELASTIC), (3, 1e-3, ConstantRestitution(0.9)), (5, 5e-3, LAW)):
        make = partial(
            chain,
            seed,
            h,
            integrator=integrator,
            limited=kind == "limited",
            geared=kind == "geared",
        )
        assert rise(make, law, 1.0) < 1e-9


@pytest.mark.parametrize(
    ("h", "words"), [(5e-3, r'body 1 "l0" turns by 0.15 rad.*timestep of 0.003'), (2e-3, "")]
)
def test_a_body_with_joints_that_turns_too_far_in_a_step_is_named_once(
    h: float, words: str
) -> None:
    scene = chain(2, h, LAW)
    model = scene.model()
    data = scene.data(model)
    data.qpos[2] = 0.0
    data.qvel[3:6] = [0.0, 30.0, 0.0]
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        mujoco.mj_step(model, data, nstep=5)
    finally:
        mujoco.set_mju_user_warning(None)
    turning = [one for one in warned if "turns by" in one]
    assert len(turning) == bool(words)
    assert re.search(words, "".join(turning))
