"""Dampers and servos beside MuJoCo's restitution plug-in: a step with an
impact goes on from the velocities after it, and what is too fast for the
step is named.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import pytest

from hcbench.contact import mujoco as contact

if TYPE_CHECKING:
    from collections.abc import Callable

H = 2e-3
LEG = """
<mujoco>
  <option timestep="{h}" integrator="{integrator}" {option}><flag {flag}/></option>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body pos="0 0 .4">
      <freejoint/>
      <geom type="box" size=".1 .1 .05" mass="3" contype="0" conaffinity="0"/>
      <body pos=".05 0 -.02" euler="0 30 0">
        <joint name="hip" axis="0 1 0" {joint}/>
        <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass=".4" contype="0" conaffinity="0"/>
        <body pos="0 0 -.2" euler="0 -60 0">
          <joint name="knee" axis="0 1 0" {joint}/>
          <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass=".2" contype="0" conaffinity="0"/>
          <geom name="foot" size=".02" pos="0 0 -.2" mass=".1" friction="0.5"/>
        </body>
      </body>
    </body>
  </worldbody>
  {rest}
  <extension><plugin plugin="hcbench.restitution"><instance name="foot">
    <config key="geom1" value="foot"/><config key="geom2" value="floor"/>
    <config key="restitution" value=".8"/>
  </instance></plugin></extension>
</mujoco>"""
SERVO = '<position joint="{joint}" kp="10" kv=".15" {limit}/>'
NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)


def servos(limit: str = "") -> str:
    both = "".join(SERVO.format(joint=joint, limit=limit) for joint in ("hip", "knee"))
    return f"<actuator>{both}</actuator>"


def leg(parts: dict[str, str], integrator: str = "Euler", h: float = H) -> Any:
    """A leg of two joints under a base, with the law on its foot.

    parts: of `LEG`: attributes of option, flag and joint, and the rest of the model.
    """
    contact.load()
    given = {"option": "", "flag": "", "joint": "", "rest": ""} | parts
    return mujoco.MjModel.from_xml_string(LEG.format(h=h, integrator=integrator, **given))


def start_of(model: Any) -> Any:
    """The foot just in the floor, all joints in motion."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.qpos[2] -= data.geom("foot").xpos[2] - 0.02 + 1e-4
    data.qvel[:] = [0.3, 0.05, -1.2, 0.2, 0.5, -0.3, 2.0, -3.0]
    data.ctrl[:] = 0.3
    return data


def off_any_impact(model: Any) -> float:
    """Distance of the step's velocities from those of a step without
    contact after the impulse at the foot that fits them best.
    """
    data, free = start_of(model), start_of(model)
    mujoco.mj_forward(model, free)
    jacobian, inertia = np.zeros((3, model.nv)), np.zeros((model.nv, model.nv))
    foot = model.geom("foot")
    point = free.geom("foot").xpos - [0.0, 0.0, 0.02 - 5e-5]
    mujoco.mj_jac(model, free, jacobian, None, point, foot.bodyid[0])
    for row, unit in zip(inertia, np.eye(model.nv), strict=True):
        mujoco.mj_mulM(model, free, row, unit)
    per_impulse, before = np.linalg.solve(inertia, jacobian.T), data.qvel.copy()
    mujoco.mj_step(model, data)
    model.opt.disableflags |= NO_CONTACT

    def stepped(impulse: Any) -> Any:
        one = start_of(model)
        one.qvel[:] = before + per_impulse @ impulse
        mujoco.mj_step(model, one)
        return one.qvel.copy()

    impulse, small = np.zeros(3), 1e-6 * np.eye(3)
    for _ in range(20):
        slope = np.array([stepped(impulse + one) - stepped(impulse) for one in small]).T / 1e-6
        impulse = impulse + np.linalg.lstsq(slope, data.qvel - stepped(impulse))[0]
    assert impulse[2] > 0.1
    return float(np.abs(data.qvel - stepped(impulse)).max())


EXPLICIT: dict[str, dict[str, str]] = {
    "joint damping": {"joint": 'damping=".15"', "flag": 'eulerdamp="disable"'},
    "servos": {"rest": servos()},
    "servos at their limit": {"rest": servos('forcerange="-.5 .5"')},
    "limits of joints": {"joint": 'actuatorfrcrange="-.5 .5"', "rest": servos()},
    "tendon": {
        "rest": '<tendon><fixed damping=".1"><joint joint="hip" coef="1"/>'
        '<joint joint="knee" coef="-.5"/></fixed></tendon>'
    },
    "fluid": {"option": 'density="1000" viscosity=".1"'},
}


@pytest.mark.parametrize("parts", EXPLICIT.values(), ids=EXPLICIT)
def test_a_step_goes_on_from_the_velocities_after_the_impact(parts: dict[str, str]) -> None:
    """With dampers of the velocities before it e of a foot would be 0.25 higher."""
    assert off_any_impact(leg(parts)) < 1e-10


@pytest.mark.parametrize(
    "parts",
    [{"joint": 'damping=".15"'}, {"rest": servos()}, {"rest": servos('forcerange="-.5 .5"')}],
)
def test_so_it_does_where_damping_is_implicit(parts: dict[str, str]) -> None:
    assert off_any_impact(leg(parts, "implicitfast")) < 1e-9


def heard(act: Callable[[], object]) -> list[str]:
    """Warnings of MuJoCo while something is done."""
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        act()
    finally:
        mujoco.set_mju_user_warning(None)
    return warned


def warnings_of(model: Any, steps: int = 1) -> list[str]:
    warned = heard(lambda: mujoco.mj_step(model, start_of(model), nstep=steps))
    return [words for words in warned if "too fast for a step" in words]


def grows(model: Any) -> bool:
    """Say whether a slight motion in flight, without the plug-in's contact, grows."""
    model.opt.gravity[:] = 0.0
    model.opt.disableflags |= NO_CONTACT | int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    data = start_of(model)
    data.ctrl[:] = 0.0
    data.qvel[:] = 1e-6
    for _ in range(2000):
        mujoco.mj_step(model, data)
        if not np.abs(data.qvel).max() < 1e-1:
            return True
    return False


FAST = [
    *(("Euler", {"joint": f'damping="{d}"', "flag": 'eulerdamp="disable"'}) for d in (0.5, 2.0, 8.0)),
    *((name, {"joint": 'damping="20"'}) for name in ("Euler", "implicit", "implicitfast")),
    *(
        (name, {"rest": f'<actuator><position joint="knee" kp="{kp}" kv="{kv}"/></actuator>'})
        for name in ("Euler", "implicit", "implicitfast", "RK4")
        for kp, kv in ((10, 0.1), (300, 1), (10, 20), (30_000, 0.1), (30_000, 40), (4_000, 0.2))
    ),
]  # fmt: skip


@pytest.mark.parametrize(("integrator", "parts"), FAST)
def test_a_servo_is_named_where_mujocos_own_step_gains_energy(
    integrator: str, parts: dict[str, str]
) -> None:
    named = warnings_of(leg(parts, integrator))
    assert bool(named) == grows(leg(parts, integrator))
    if not named:
        return
    finer = float(named[0].split("timestep of ")[1].split(",")[0])
    assert not warnings_of(leg(parts, integrator, 0.98 * finer))
    assert warnings_of(leg(parts, integrator, 1.1 * finer))


def test_it_is_named_once() -> None:
    parts = {"joint": 'damping="8"', "flag": 'eulerdamp="disable"'}
    assert len(warnings_of(leg(parts), steps=600)) == 1


@pytest.mark.parametrize("solver", ["CG", "PGS"])
def test_sleep_under_rk4_is_refused_with_solvers_that_let_bodies_sink(solver: str) -> None:
    model = leg({"option": f'solver="{solver}"', "flag": 'sleep="enable"'}, "RK4")
    with pytest.raises(mujoco.FatalError, match="under RK4 the flag sleep wakes"):
        mujoco.mj_step(model, start_of(model))


SPRUNG_WHEEL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 .1"/>
    <body pos="0 0 .4">
      <joint type="slide" axis="0 0 1" stiffness="900"/>
      <geom size=".03" mass=".3" contype="0" conaffinity="0"/>
      <body><joint name="axle" axis="0 1 0"/><geom name="wheel" size=".07" mass=".4"/></body>
    </body>
  </worldbody>
  <actuator><velocity joint="axle" kv=".1"/></actuator>
  <extension><plugin plugin="hcbench.restitution"><instance name="wheel">
    <config key="geom1" value="wheel"/><config key="geom2" value="floor"/>
    <config key="restitution" value=".4"/>
  </instance></plugin></extension>
</mujoco>"""


def test_a_damped_axle_beside_a_spring_is_not_named() -> None:
    """A trace of the spring in the axle's motion made the longest step 0, by cancellation."""

    def run() -> None:
        model = mujoco.MjModel.from_xml_string(SPRUNG_WHEEL)
        mujoco.mj_step(model, mujoco.MjData(model), nstep=300)

    contact.load()
    assert not heard(run)
