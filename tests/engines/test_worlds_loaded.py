"""The page's scripts load drawn worlds into other engines, which bounce as drawn; in environments of
their own.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

import hcbench as hb
from hcbench.sim import registry
from hcbench.sim.remote import interpreter_of
from hcbench.terms.impact import Floats

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "randomize.md"
MODEL = """<mujoco><option timestep="0.002"/><worldbody>
<geom name="floor" type="plane" size="5 5 .1"/><body name="ball" pos="0 0 .0525"><freejoint/>
<geom name="ball" size=".05" mass=".2"/></body></worldbody></mujoco>"""
STEPS = 60
# A Python that has mjlab, which is none of hcbench's engines.
MJLAB = os.environ.get("HCBENCH_MJLAB")
# What a reader adds to the page's script: the fastest rise of the ball, thrown down at 1 m/s.
RISE = {
    "mjx": """
data = data.replace(qpos=data.qpos.at[:, 2].set(0.0525), qvel=data.qvel.at[:, 2].set(-1.0))
rise = np.zeros(worlds)
for _ in range(60):
    data = step(batch, data)
    rise = np.maximum(rise, np.asarray(data.qvel)[:, 2])
np.save("rise.npy", rise)
""",
    "mujoco-warp": """
qpos, qvel = d.qpos.numpy(), d.qvel.numpy()
qpos[:, 2], qvel[:, 2] = 0.0525, -1.0
d.qpos.assign(qpos), d.qvel.assign(qvel)
rise = np.zeros(worlds)
for _ in range(60):
    mjw.step(m, d)
    rise = np.maximum(rise, d.qvel.numpy()[:, 2])
np.save("rise.npy", rise)
""",
    "mjlab": """
sim.reset()
sim.data.qpos[:, 2], sim.data.qvel[:, 2] = 0.0525, -1.0
rise = np.zeros(len(params["restitution"]))
for _ in range(60):
    sim.step()
    rise = np.maximum(rise, sim.data.qvel[:, 2].cpu().numpy())
np.save("rise.npy", rise)
""",
}


def in_plain_steps(folder: Path) -> Floats:
    """The fastest rise in each world, in MuJoCo's own steps, m/s."""
    model = mujoco.MjModel.from_xml_path(str(folder / "worlds.xml"))
    rise = []
    with np.load(folder / "params.npz") as params:
        for world in range(len(params["restitution"])):
            for name in ("pair_solref", "pair_solimp", "pair_friction"):
                getattr(model, name)[:] = params[name][world]
            data = mujoco.MjData(model)
            data.qvel[2] = -1.0
            speeds = []
            for _ in range(STEPS):
                mujoco.mj_step(model, data)
                speeds.append(float(data.qvel[2]))
            rise.append(max(speeds))
    return np.array(rise)


def require_plain_bounces(engine: str, python: Path | str, folder: Path) -> None:
    """Draw worlds of a ball, load them by the page's script, and compare its rises with MuJoCo's.

    engine: whose script. python: an interpreter that has it.
    """
    hb.randomize(
        mujoco.MjSpec.from_string(MODEL),
        "ball,floor",
        restitution="0.3:0.6",
        friction="0.5:1",
        worlds=8,
        speeds="1 m/s",
        out=folder / "params.npz",
        write_model=folder / "worlds.xml",
    )
    found = re.search(rf"<!-- tested: {engine} -->\n```py\n(.*?)```", PAGE.read_text("utf-8"), re.S)
    assert found is not None
    script = folder / "script.py"
    script.write_text(found[1] + RISE[engine], encoding="utf-8")
    subprocess.run([str(python), str(script)], cwd=folder, check=True)
    assert np.load(folder / "rise.npy") == pytest.approx(in_plain_steps(folder), abs=2e-3)


@pytest.mark.needs_engine
@pytest.mark.parametrize("engine", ["mjx", "mujoco-warp"])
def test_the_worlds_bounce_as_in_the_model_that_they_were_drawn_for(
    engine: str, tmp_path: Path
) -> None:
    environment = interpreter_of(registry.engine(engine))
    python = sys.executable if environment is None else environment.python
    require_plain_bounces(engine, python, tmp_path)


@pytest.mark.skipif(MJLAB is None, reason="HCBENCH_MJLAB names no Python that has mjlab (6 GB)")
def test_the_worlds_bounce_in_mjlab_as_in_the_model_that_they_were_drawn_for(
    tmp_path: Path,
) -> None:
    assert MJLAB is not None
    require_plain_bounces("mjlab", MJLAB, tmp_path)
