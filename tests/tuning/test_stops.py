"""Bodies that should not bounce: `tune --restitution 0` finds a contact that stops them, or says that
the model has it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hcbench as hb
from hcbench.cli import run

mujoco = pytest.importorskip("mujoco")

FLOOR = '<geom name="floor" type="plane" size="2 2 .1"/>'
# A heavy ball at 5 ms, which bounces by chance. A contact that stops it in one step throws up what
# slides.
ANVIL = """<mujoco><option timestep="0.005" cone="elliptic" integrator="implicitfast"/><worldbody>
<geom name="floor" type="box" size="3 3 .5" pos="0 0 -.5" friction=".9" priority="1"
 solref=".03 .4" solimp=".8 .9 .02 .5 2"/>
<body pos="0 0 1"><freejoint/><geom name="ball" type="sphere" size=".3" mass="800"/></body>
</worldbody></mujoco>"""
SOFT = f"""<mujoco><worldbody>{FLOOR}<body pos="0 0 .3"><freejoint/>
<geom name="ball" type="sphere" size=".05" mass=".2"/></body></worldbody></mujoco>"""
# The foot hangs 6 cm over the floor on a piston of 5 cm: the hip has to bring it there.
LEG = f"""<mujoco><option timestep="0.001"/><worldbody>{FLOOR}
<body pos="0 0 .4"><joint name="rail" type="slide" axis="0 0 1"/>
 <geom type="box" size=".05 .05 .05" mass="2" contype="0" conaffinity="0"/>
 <body pos="0 0 -.1"><joint name="piston" type="slide" axis="0 0 1" range="-.05 .05" stiffness="1e4"/>
  <geom name="toe" type="sphere" pos="0 0 -.22" size=".02" mass=".4"/></body></body>
</worldbody></mujoco>"""


def rises(xml: str, speed: float, phase: float, slide: float = 0.0) -> float:
    """Height, m, that the ball of a model regains after an impact at some m/s, in plain MuJoCo."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    radius = float(model.geom("ball").size[0])
    data.qpos[2] = radius + (2.0 + phase) * speed * model.opt.timestep
    data.qvel[[0, 2]] = slide, -speed
    touched, highest = False, 0.0
    for _ in range(400):
        mujoco.mj_step(model, data)
        touched = touched or data.ncon > 0
        if touched:
            highest = max(highest, float(data.qpos[2]) - radius)
    return highest


def test_a_stop_that_takes_some_steps_throws_up_nothing_that_slides() -> None:
    """The stop within a step does, so that hcbench found no setting for an e of 0."""
    tuned = hb.tune_model(ANVIL, "ball,floor", restitution=0.0, speeds="0.5:2 m/s")
    assert (tuned.name, tuned.gains, tuned.worse) == ("stop of 5 steps", True, [])
    for speed, phase, slide in ((1.9, 0.3, 0.0), (0.7, 0.8, 0.0), (1.3, 0.5, 3.0)):
        dropped = rises(tuned.written, speed, phase, slide)
        # It may end a step above the floor.
        assert dropped < speed * 0.005
    assert rises(ANVIL, 1.9, 0.3) > 0.01


def test_a_model_that_stops_by_itself_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One found an e of 0 in it, and ended with an error: a gain was expected."""
    (tmp_path / "soft.xml").write_text(SOFT)
    out = tmp_path / "tuned.xml"
    asked = ["--pair", "ball,floor", "--restitution", "0", "--speeds", "1 m/s"]
    given = ["--write-model", str(out)]
    assert run(["tune", str(tmp_path / "soft.xml"), *asked, *given]) == 0
    said = capsys.readouterr().out
    assert "The model as it is has this e already: there is nothing to paste." in said
    # What comes next is held on the model itself, as no other was written.
    assert f"hcbench check {tmp_path / 'soft.xml'}" in said.replace(" \\\n     ", "")
    assert not out.exists()


def test_a_joint_whose_limit_is_before_the_touch_gives_way_to_one_that_gets_there() -> None:
    """The piston turned back at its limit, and the pair "never touched"."""
    seen = hb.measure(LEG, "toe,floor", speeds=1.0, diagnose=False, rest=False)
    assert "on its slide" in seen.facts.moved
    assert all(np.isfinite(impact.restitution) for impact in seen.impacts)
    assert "NO_TOUCH" not in {impact.status.name for impact in seen.impacts}
