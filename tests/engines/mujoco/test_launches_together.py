"""Launches of a user's model that share an MjData, a stop rule and a
reading: the same bits as each alone.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from hcbench.engines.mujoco.model.under_test import MujocoModel
from hcbench.measuring.request import make_request
from hcbench.sim import simulate

BALL = """<mujoco><option timestep="1e-3" {0}/><worldbody><geom name="plate" type="plane" size="1 1 .1"/>
<body name="ball" pos="0 0 .2"><freejoint/><geom size=".1" solref="-2e4 -20"/></body></worldbody></mujoco>"""
SERVO = """<mujoco><worldbody><geom name="plate" type="plane" size="1 1 .1"/>
<body name="base" pos="0 0 .5"><freejoint/><geom size=".05"/>
<body name="ball"><joint name="knee" type="slide" axis="0 0 1"/>
<geom size=".05" pos="0 0 -.2" {0}/></body></body></worldbody>
<actuator><position joint="knee" kp="2000" kv="20"/></actuator></mujoco>"""
REQUEST: dict[str, Any] = {"speeds": [0.2, 0.7, 1.5], "phases": 2}


def opened(text: str, **more: Any) -> MujocoModel:
    model = mujoco.MjModel.from_xml_string(text)
    return MujocoModel(model, "model", None, make_request("ball,plate", **REQUEST, **more))


def results(model: MujocoModel) -> Any:
    """Results of every launch, to the last bit, and the model's record of them."""
    sent = simulate.impacts_in(model, model.request.launches())
    loops = [impact.loop and impact.loop.force.tobytes() for impact in sent]
    rows = [(i.status, i.speed_in, i.speed_out, i.samples, repr(i.tangential)) for i in sent]
    return repr(rows), loops, dict(model.shares), model.others


@pytest.mark.parametrize(
    ("text", "more"),
    [
        (BALL.format(""), {}),
        (BALL.format('integrator="RK4"'), {"angle": "0, 0.5 rad"}),
        (BALL.format('cone="elliptic"'), {"angle": "0, 0.5 rad"}),
        (SERVO.format(""), {}),
        (SERVO.format('solref="-2e4 -20"'), {}),
    ],
)
def test_a_launch_beside_others_has_the_bits_it_has_alone(text: str, more: Any) -> None:
    together, alone, in_one_go = (opened(text, **more) for _ in range(3))
    alone.places, alone.least_steps, in_one_go.least_steps = 1, 8, 400
    found = results(together)
    assert together.places > 6
    assert found == results(alone) == results(in_one_go)


def test_a_users_callback_sees_one_launch_after_the_other() -> None:
    model, times = mujoco.MjModel.from_xml_string(SERVO.format("")), []
    mujoco.set_mjcb_control(lambda model, data: times.append(data.time))
    try:
        opened = MujocoModel(model, "model", None, make_request("ball,plate", **REQUEST))
        times.clear()
        sent = simulate.impacts_in(opened, opened.request.launches())
    finally:
        mujoco.set_mjcb_control(None)
    assert np.count_nonzero(np.diff(times) < 0.0) == len(sent) - 1
