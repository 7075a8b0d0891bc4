"""Iterations of MuJoCo's solver, most of what a robot's step costs under the restitution plug-in."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from contact_scenes import require_plugins_in_specs
from test_plugin_robots import robot

from hcbench.contact.mujoco import ConstantRestitution, Restitution, add_to_spec

BOX = '<body pos="{at}"><freejoint/><geom {name} type="box" size=".1 .1 .1"/></body>'
STACK_AND_BOX = f"""
<mujoco>
  <option solver="PGS" iterations="1000"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1"/>
    {BOX.format(at="0 0 .1", name="")}{BOX.format(at=".02 0 .3", name="")}{BOX.format(at="0 .02 .5", name="")}
    {BOX.format(at="2 0 .1", name='name="box"')}
  </worldbody>
</mujoco>"""


def iterations(model: Any, height: float, steps: int) -> Any:
    """Iterations of the island that takes most, by step, after a drop; shape (steps,)."""
    data = mujoco.MjData(model)
    data.qpos[2] += height
    taken = np.zeros(steps)
    for step in range(steps):
        mujoco.mj_step(model, data)
        taken[step] = data.solver_niter[: max(1, data.nisland)].max()
    return taken


@pytest.mark.parametrize("integrator", ["EULER", "IMPLICITFAST"])
@pytest.mark.parametrize("name", ["quadruped", "biped"])
def test_newton_needs_about_two_iterations_while_a_robot_settles(name: str, integrator: str) -> None:
    """Native contact needs one; rows as stiff as those that stand still would need three to five."""
    number = int(getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}"))
    settling = robot(name, Restitution(0.3), integrator=number)
    assert iterations(settling, 0.1, 1000).mean() < 2.5


def test_pgs_keeps_the_forces_of_native_contacts_that_it_starts_from() -> None:
    """A stack on native contact beside a box on the plug-in's takes no more than without the plug-in."""
    require_plugins_in_specs()
    spec = mujoco.MjSpec.from_string(STACK_AND_BOX)
    native = iterations(spec.compile(), 0.0, 400)[200:].mean()
    add_to_spec(spec, ConstantRestitution(0.5), geoms=("box", "floor"))
    assert iterations(spec.compile(), 0.0, 400)[200:].mean() < 2 * native
