"""A pair at rest: how deep it lies, by the constraint's own balance, how still, and why not."""

from __future__ import annotations

import math

import pytest

from hcbench.measuring import Measurement, measure

pytest.importorskip("mujoco")

BALL = """<mujoco><option timestep="2e-3" {option}/><worldbody>
  <geom name="plate" type="plane" size="1 1 .1" condim="1" {contact}/>
  <body name="ball" pos="0 0 1"><freejoint/><geom name="sphere" size=".1" condim="1" {contact}/></body>
  </worldbody></mujoco>"""
HELD = """<mujoco><option timestep="2e-3" cone="elliptic" impratio="10"/><worldbody>
  <body name="left" pos="-.05 0 .24"><joint name="l" type="slide" axis="1 0 0" damping="5"/>
  <geom name="left" type="box" size=".008 .012 .04" mass=".05" friction="1.5"/></body>
  <body name="right" pos=".05 0 .24"><joint name="r" type="slide" axis="-1 0 0" damping="5"/>
  <geom name="right" type="box" size=".008 .012 .04" mass=".05" friction="1.5"/></body>
  <body name="cube" pos="0 0 .241"><freejoint/><geom name="cube" type="box" size=".02 .02 .02" mass=".1"/>
  </body></worldbody><actuator><motor joint="l"/><motor joint="r"/></actuator>
  <keyframe><key name="held" qpos=".0221 .0221 0 0 .241 1 0 0 0" ctrl="5 5"/></keyframe></mujoco>"""


def at_rest(contact: str = "", option: str = "") -> Measurement:
    text = BALL.format(contact=contact, option=option)
    return measure(text, "ball,plate", speeds=[0.5], phases=[0.3], height=None)


def test_a_ball_lies_as_deep_as_its_constraint_yields_to_its_weight() -> None:
    """d k x = (1 - d) g, k = d/(dmax tc ζ)² (MuJoCo's documentation, Modeling: solver parameters)."""
    found = at_rest('solref=".02 1" solimp=".9 .9 .001 .5 2"')
    assert found.rest is not None
    assert found.rest.penetration == pytest.approx(
        0.1 * 9.81 * (0.9 * 0.02) ** 2 / 0.9**2, rel=1e-3
    )
    assert found.rest.vibration < 1e-6
    assert found.rest.force_noise < 1e-6
    assert not found.rest_causes


def test_a_vibration_that_dies_away_is_waited_for() -> None:
    """Laid down, it sags by g/k: a damping b leaves exp(-b t/2) of its swing, after 12 s of 2 to 4."""
    found = at_rest('solref="-2000 -1" solimp="1 1 .001 .5 2"')
    assert found.rest is not None
    after_4_s = 9.81 / math.sqrt(2000.0) * math.exp(-0.5 * 2.0)
    assert 0.0 < found.rest.vibration < 0.05 * after_4_s


def test_a_soft_contact_is_the_cause_of_a_deep_rest() -> None:
    found = at_rest('solref=".1 1" solimp=".8 .8 .001 .5 2"')
    assert found.rest is not None
    assert found.rest.penetration > 1e-3
    (soft,) = [cause for cause in found.rest_causes if cause.code == "soft-contact"]
    cured = at_rest(f'solref=".1 1" {soft.fix.partition(": ")[2]}')
    assert cured.rest is not None
    assert cured.rest.penetration < found.rest.penetration / 5


def test_a_step_too_long_for_a_spring_shakes() -> None:
    found = at_rest('solref="-1e6 0" solimp="1e-4 1e-4 .001 .5 2"')
    assert found.rest is not None
    assert found.rest.vibration > 1e-3
    assert "long-step" in [cause.code for cause in found.rest_causes]


def test_a_held_body_rests_between_its_fingers() -> None:
    found = measure(HELD, "geom:cube,left", speeds=[0.3], phases=[0.3], key="held", diagnose=False)
    assert found.rest is not None
    assert 1e-4 < found.rest.penetration < 2e-3
    assert found.rest.vibration < 1e-6


def test_what_nothing_presses_together_has_no_rest() -> None:
    assert at_rest(option='gravity="0 0 0"').rest is None
