"""Speed that each cause takes off the approach of a pair: of a ball whose forces are known."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from hcbench.engines.mujoco.model.speed_shares import ADHESION, NAMES, PASSIVE, SpeedShares
from hcbench.sim.model_under_test import WEIGHT

H, DRAG = 1e-3, 0.2  # s, N s/m
BALL = f"""<mujoco><option timestep="{H}" gravity="0 0 -10"/><worldbody>
  <body pos="0 0 1"><joint type="slide" axis="0 0 1" damping="{DRAG}"/><geom size=".1" mass="0.5"/></body>
</worldbody></mujoco>"""


def test_weight_adds_to_the_approach_of_a_falling_ball_and_damping_takes_from_it() -> None:
    """In a step g h, and c v h / m of the speed v at its start."""
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    data.qvel[:] = -3.0
    mujoco.mj_forward(model, data)
    shares = SpeedShares(model, np.zeros(model.ngeom, dtype=np.int8))
    for step in range(4):
        shares.add(
            step, data, np.array([-1.0]), others=False
        )  # its approach is its speed downwards
    taken = shares.taken(4)
    assert taken[WEIGHT] == pytest.approx(-4 * 10.0 * H)
    assert taken[PASSIVE] == pytest.approx(4 * DRAG * 3.0 / 0.5 * H)
    assert [taken[name] for name in NAMES if name not in (WEIGHT, PASSIVE)] == [0.0] * (
        len(NAMES) - 2
    )


@pytest.mark.skipif(not hasattr(mujoco.MjModel, "flg_adhesion"), reason="an older MuJoCo")
def test_the_pull_of_a_contact_is_not_that_of_springs_or_damping() -> None:
    """A pull F adds F h / m to the approach in a step."""
    pulled = '<geom type="plane" size="1 1 1" adhesion="3"/><body pos="0 0 .099">'
    model = mujoco.MjModel.from_xml_string(BALL.replace('<body pos="0 0 1">', pulled))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    shares = SpeedShares(model, np.array([2, 1], dtype=np.int8))
    shares.add(0, data, np.array([-1.0]), others=False)
    taken = shares.taken(1)
    assert taken[ADHESION] == pytest.approx(-3.0 / 0.5 * H)
    assert taken[PASSIVE] == pytest.approx(0.0, abs=1e-12)
