"""A free body whose mass is off its frame, under MuJoCo's plug-in: the energy of its flights.

MuJoCo accelerates the frame, half a step late: the velocities in its state are not those by which
the centre of mass moves. So energy is read from places alone.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from hcbench.contact import mujoco as contact

MODEL = """<mujoco>
<extension><plugin plugin="hcbench.restitution"><instance name="law">
<config key="geom1" value="box"/><config key="geom2" value="floor"/>
<config key="restitution" value="1"/></instance></plugin></extension>
<option timestep="{h}" integrator="{integrator}"/>
<worldbody><geom name="floor" type="plane" size="5 5 .1" condim="1"/>
<body name="body" pos="0 0 .35"><freejoint/>
<inertial pos=".04 -.02 .03" mass="1.3" diaginertia=".006 .008 .01"/>
<geom name="box" type="box" size=".1 .07 .05" condim="1"/></body></worldbody></mujoco>"""
FLIGHT = 0.02  # s, over which energy is read, before and after the first impact


def _thrown(model: Any, seed: int) -> Any:
    """A state in any attitude that turns by 12 rad/s."""
    random = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    data.qpos[3:7] = random.normal(size=4)
    mujoco.mj_normalizeQuat(model, data.qpos)
    data.qvel[:3] = 0.5 * random.normal(size=3)
    axis = random.normal(size=3)
    data.qvel[3:] = 12.0 * axis / np.linalg.norm(axis)
    return data


def _energies(model: Any, data: Any) -> tuple[list[float], list[float]]:
    """Energies, J, of the steps before the first impact and after it, from places; those after it
    are fewer than a flight's where the body touches again.
    """
    h = model.opt.timestep
    at = mujoco.MjData(model)
    mass, inertia = model.body_mass[1], model.body_inertia[1]
    before: list[float] = []
    after: list[float] = []
    place = attitude = None
    while len(after) < FLIGHT / h:
        mujoco.mj_step(model, data)
        if data.ncon and len(after) > 3:
            break
        at.qpos[:] = data.qpos
        mujoco.mj_kinematics(model, at)
        now, turned = at.xipos[1].copy(), at.ximat[1].reshape(3, 3).copy()
        if place is not None and attitude is not None:
            v = (now - place) / h
            turn = np.empty(3)
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, (attitude.T @ turned).ravel())
            mujoco.mju_quat2Vel(turn, quaternion, h)
            energy = 0.5 * mass * v @ v + 0.5 * inertia @ turn**2
            energy -= mass * model.opt.gravity[2] * 0.5 * (now + place)[2]
            has_met = bool(data.ncon) or bool(after)
            (after if has_met else before).append(float(energy))
        place, attitude = now, turned
    return before[-round(FLIGHT / h) :], after


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "RK4"])
def test_the_flight_after_an_impact_has_the_energy_of_the_one_before(integrator: str) -> None:
    contact.load()
    model = mujoco.MjModel.from_xml_string(MODEL.format(h=0.002, integrator=integrator))
    changes = []
    for seed in range(16):
        before, after = _energies(model, _thrown(model, seed))
        if len(after) > 3:
            changes.append(np.mean(after) / np.mean(before) - 1.0)
    assert len(changes) > 10
    # Half a step too early or too late it was up to 0.017.
    assert np.abs(changes).max() < 0.002
