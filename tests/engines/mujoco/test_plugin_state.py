"""Everything that a program may do with a model and its state while the
restitution plug-in is in contact.
"""

from __future__ import annotations

import threading
from typing import Any

import mujoco
import numpy as np
import pytest
from mujoco import rollout

from hcbench.contact import mujoco as contact

STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)


def model(option: str = "", names: tuple[str, str] = ("one", "two"), start: float = 0.3) -> Any:
    """Two balls over a floor; the law acts on the one whose geom is called `one`."""
    contact.load()
    return mujoco.MjModel.from_xml_string(f"""<mujoco><option timestep="0.002" {option}/><extension>
      <plugin plugin="hcbench.restitution"><instance name="r">
      <config key="geom1" value="one"/><config key="geom2" value="floor"/>
      <config key="restitution" value="0.9"/></instance></plugin></extension>
      <worldbody><geom name="floor" type="plane" size="1 1 .1"/>
      <body pos="0 0 {start}"><freejoint/><geom name="{names[0]}" size=".05" mass="1"/></body>
      <body pos=".5 0 {start}"><freejoint/><geom name="{names[1]}" size=".05" mass="1"/></body>
      </worldbody></mujoco>""")


def in_contact(of: Any) -> Any:
    """A state in which the first ball meets the floor, turning."""
    data = mujoco.MjData(of)
    data.qpos[2] = 0.0499
    data.qvel[:6] = 0.3, 0, -1, 2, 3, 1
    return data


def state(of: Any, data: Any) -> Any:
    got = np.zeros(mujoco.mj_stateSize(of, STATE))
    mujoco.mj_getState(of, data, got, STATE)
    return got


def after(of: Any, data: Any, steps: int = 200) -> Any:
    mujoco.mj_step(of, data, nstep=steps)
    return state(of, data)


SOLVERS = [
    'solver="Newton"',
    'solver="PGS"',
    'noslip_iterations="5"',
    'solver="PGS" noslip_iterations="5"',
]


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_inverse_dynamics_give_back_no_force_beyond_what_acts(solver: str, cone: str) -> None:
    """Inverse dynamics of the accelerations of a step, at rest and in
    an impact: finite, and no crash.
    """
    made = model(f'{solver} cone="{cone}"')
    data = in_contact(made)
    for _ in range(300):
        mujoco.mj_step(made, data)
        if data.ncon:
            mujoco.mj_inverse(made, data)
            assert np.isfinite(data.qfrc_inverse).all()


@pytest.mark.parametrize("solver", SOLVERS)
def test_derivatives_of_a_step_in_contact_are_finite_and_leave_the_state(solver: str) -> None:
    made = model(f'{solver} gravity="0 0 0"')
    data = in_contact(made)
    before = state(made, data)
    jacobian = np.zeros((2 * made.nv, 2 * made.nv))
    mujoco.mjd_transitionFD(made, data, 1e-6, True, jacobian, None, None, None)
    assert np.isfinite(jacobian).all()
    assert (state(made, data) == before).all()
    up = jacobian[made.nv + 2, made.nv + 2]  # of the speed after by the speed before: -e
    assert up == pytest.approx(-0.9, abs=1e-6)


@pytest.mark.skipif(not hasattr(mujoco, "mj_copyData"), reason="this MuJoCo has no mj_copyData")
def test_a_copy_in_contact_goes_on_bit_for_bit() -> None:
    for integrator in ("Euler", "implicitfast", "RK4"):
        made = model(f'integrator="{integrator}"')
        data, other = in_contact(made), mujoco.MjData(made)
        mujoco.mj_step(made, other, nstep=7)
        mujoco.mj_copyData(other, made, data)
        assert (after(made, data) == after(made, other)).all()


def test_forward_called_again_changes_nothing() -> None:
    for integrator in ("Euler", "implicitfast", "RK4"):
        made = model(f'integrator="{integrator}"')
        once, often = in_contact(made), in_contact(made)
        for _ in range(200):
            mujoco.mj_step(made, once)
            for _ in range(3):
                mujoco.mj_forward(made, often)
            mujoco.mj_step(made, often)
        assert state(made, often) == pytest.approx(state(made, once), abs=1e-9)


def test_a_reset_in_the_middle_of_contact_is_a_new_start() -> None:
    for integrator in ("Euler", "implicitfast", "RK4"):
        made = model(f'integrator="{integrator}"', start=0.06)
        used = in_contact(made)
        mujoco.mj_step(made, used)
        mujoco.mj_resetData(made, used)
        assert (after(made, used) == after(made, mujoco.MjData(made))).all()


def test_a_model_read_again_and_another_model_with_the_same_data() -> None:
    first, second = model(), model(names=("two", "one"))
    data = mujoco.MjData(first)
    mujoco.mj_step(first, data, nstep=50)
    mujoco.mj_resetData(second, data)
    assert (after(second, data, 400) == after(second, mujoco.MjData(second), 400)).all()
    del second
    again = model(names=("two", "one"))
    mujoco.mj_resetData(again, data)
    assert (after(again, data, 400) == after(again, mujoco.MjData(again), 400)).all()


def test_many_threads_on_one_model_move_as_one() -> None:
    made = model()
    results: list[Any] = [None] * 8

    def run(i: int) -> None:
        results[i] = after(made, in_contact(made), 500)

    threads = [threading.Thread(target=run, args=(i,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all((one == results[0]).all() for one in results)


def test_rollout_of_several_models_on_several_threads_is_that_of_each_alone() -> None:
    models = [model(), model(names=("two", "one"))] * 6
    start = np.stack([state(made, mujoco.MjData(made)) for made in models])
    together, _ = rollout.rollout(
        models, [mujoco.MjData(models[0]) for _ in range(3)], start, nstep=400
    )
    for made, got in zip(models[:2], together[:2], strict=True):
        assert (got[-1] == after(made, mujoco.MjData(made), 400)).all()
    assert all((together[i] == together[i % 2]).all() for i in range(12))
