"""The loop in C for users' models: the bits of the loop in Python, which it replaces."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import mujoco
import pytest

import hcbench as hb
from hcbench.engines.mujoco.model import floor_record, simulation
from hcbench.engines.mujoco.model.simulation import CompiledFlight, flights_of, simulation_of
from hcbench.engines.mujoco.model.speed_shares import ADHESION
from hcbench.engines.mujoco.model.under_test import MujocoModel
from hcbench.measuring.request import make_request
from hcbench.sim import simulate
from hcbench.system.compiler import NotCompiled
from hcbench.system.errors import EngineFailed

QUADRUPED = Path(__file__).parents[3] / "examples/quadruped.xml"
PLATE = '<geom name="plate" type="plane" size="2 2 .1"/>'
FREE = '<body name="ball" pos="0 0 .3"><freejoint/><geom {0}/></body>'
# A ball on a slide with a servo, friction and damping, which adheres; its two arms hang together, lie
# at the limit of their joints, and touch the plate beside the ball.
PULLS = 'adhesion=".2"' if hasattr(mujoco.MjModel, "flg_adhesion") else ""
HELD = f"""<body name="ball" pos="0 0 .2"><joint name="lift" type="slide" axis="0 0 1" damping="1"
  frictionloss=".5"/><geom size=".05" solref="-2e4 -20" {PULLS}/>
  <body><joint name="left" axis="0 1 0" range="0 60" limited="true"/>
    <geom size=".05" pos=".3 0 -.0005"/></body>
  <body><joint name="right" axis="0 1 0"/><geom size=".03" pos="-.2 0 0"/></body></body>"""
SERVOS = """<actuator><position joint="lift" kp="20" kv="1"/></actuator>
<equality><joint joint1="left" joint2="right"/></equality>"""
MODELS = {
    "a ball": (PLATE + FREE.format('size=".1" solref="-1e4 -20"'), "", ""),
    "a box on four points, elliptic": (
        PLATE + FREE.format('type="box" size=".1 .1 .1" solref="-1e4 -20"'),
        "",
        'cone="elliptic"',
    ),
    "a frictionless ball with a margin": (
        PLATE + FREE.format('size=".1" condim="1" margin=".001" solref="-1e4 -20"'),
        "",
        "",
    ),
    "two bodies that move": (
        PLATE.replace("plate", "floor")
        + '<body pos="0 0 .1"><freejoint/><geom name="plate" type="box" size=".3 .3 .1"/></body>'
        + FREE.format('size=".05" solref="-1e4 -20"'),
        "",
        "",
    ),
    "a ball with all that may hold it": (PLATE + HELD, SERVOS, 'integrator="implicitfast"'),
    "a state that MuJoCo resets": (
        PLATE + FREE.format('size=".1" solref="-1e22 0" solimp=".9999 .9999 .001 .5 2"'),
        "",
        "",
    ),
}


def opened(text: str, **more: Any) -> MujocoModel:
    model = mujoco.MjModel.from_xml_string(text)
    request = make_request("ball,plate", speeds=[0.2, 1.5], phases=2, **more)
    return MujocoModel(model, "model", None, request)


def mjcf(name: str) -> str:
    world, rest, option = MODELS[name]
    return f"<mujoco><option {option}/><worldbody>{world}</worldbody>{rest}</mujoco>"


def results(model: MujocoModel) -> Any:
    """All that launches and the model under test keep, to the last bit."""
    sent = simulate.impacts_in(model, model.request.launches())
    whole = simulate_steps(model)
    rows = [(i.status, i.reason, i.speed_in, i.speed_out, i.samples) for i in sent]
    return repr(rows), whole, repr(model.shares), model.others


def simulate_steps(model: MujocoModel) -> bytes:
    """Penetration, rate and force of 200 steps of the last launch, long past its impact."""
    record = model.follow(model.request.launches()[-1]).advance(200)
    return record.rows().tobytes()


@pytest.mark.parametrize("name", MODELS)
def test_bits_are_those_of_the_loop_in_python(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    in_c, in_python = opened(mjcf(name)), opened(mjcf(name))
    in_c.least_steps = in_python.least_steps = 8  # several calls a launch
    assert isinstance(flights_of(in_c, in_c.request.launches())[0], CompiledFlight)
    found = results(in_c)
    monkeypatch.setattr(simulation, "loop_in_c", lambda: None)
    assert found == results(in_python)
    if "resets" in name:
        assert "diverged" in found[0]
    if "all" in name.split():
        shares = in_c.shares
        # Older versions of MuJoCo have no adhesion.
        has_all = all(share != 0.0 for cause, share in shares.items() if PULLS or cause != ADHESION)
        assert shares and has_all, shares
        assert in_c.others


def test_without_a_compiler_the_loop_in_python_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: Any) -> None:
        raise NotCompiled("no C compiler found")

    monkeypatch.setattr(simulation, "build", missing)
    simulation.loop_in_c.cache_clear()
    model = opened(mjcf("a ball"))
    try:
        assert type(flights_of(model, model.request.launches())[0]).__name__ == "MujocoFlight"
    finally:
        simulation.loop_in_c.cache_clear()


@pytest.mark.parametrize("option", ['integrator="RK4"', ""])
def test_what_the_loop_in_c_lacks_is_stepped_in_python(option: str) -> None:
    text = mjcf("a ball").replace("<option ", f"<option {option} ")
    model = opened(text, **({} if option else {"angle": "0.5 rad"}))
    kinds = {type(flight) for flight in flights_of(model, model.request.launches())}
    assert CompiledFlight not in kinds


def test_a_fatal_error_of_mujoco_is_an_error_and_not_the_end_of_the_process() -> None:
    model = opened(mjcf("a ball"))
    model.model.opt.solver = 99
    with pytest.raises(EngineFailed, match="solver"):
        simulate.impacts_in(model, model.request.launches())


def test_the_loop_in_c_itself_makes_that_error(monkeypatch: pytest.MonkeyPatch) -> None:
    model = opened(mjcf("a ball"))
    model.model.opt.solver = 99
    # Nothing around it turns MuJoCo's errors into hcbench's.
    monkeypatch.setattr(simulation, "captured_warnings", lambda: nullcontext([]))
    launches = model.request.launches()
    with pytest.raises(EngineFailed, match="solver"):
        simulation_of(model, launches, None).advance(10)


@pytest.mark.parametrize("contacts", [0, 4])
def test_a_robot_lands_in_c_as_in_python(contacts: int, monkeypatch: pytest.MonkeyPatch) -> None:
    model = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    monkeypatch.setattr(floor_record, "_CONTACTS", contacts)  # 0: room is made as points come
    (in_c,) = hb.land(model, "3 cm", tilt="10 deg").drops
    monkeypatch.setattr(floor_record, "loop_in_c", lambda: None)
    (in_python,) = hb.land(model, "3 cm", tilt="10 deg").drops
    assert len(in_c.feet) == 4
    assert repr(in_c) == repr(in_python)
    assert in_c.force.tobytes() == in_python.force.tobytes()
    assert [repr(one) for one in in_c.others] == [repr(one) for one in in_python.others]
