"""Energy tests of a contact: the rows' model agrees with plain MuJoCo, and no advised setting gives
energy.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from hcbench.engines.mujoco.model import simulation
from hcbench.engines.mujoco.passivity import judge, plain
from hcbench.engines.mujoco.passivity.judge import bounces_in_rows, screened
from hcbench.engines.mujoco.passivity.plain import certify
from hcbench.engines.mujoco.scene.mjcf import read_options
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.sim.passivity import MOST_E, Passivity
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Setting

G, STEP = 9.81, 2e-3
SCENE = replace(load_scene("steel-plane"), gravity=G)
BAND = (0.0314, 0.508)


@cache
def made(recipe: str, friction: float = 0.0) -> Setting:
    law = HuntCrossley(SCENE.stiffness, 0.008 / 0.0254, SCENE.exponent)
    target = Target(law, SCENE.mass, STEP, *BAND, gravity=G, friction=friction)
    return registry.recipe(f"mujoco.{recipe}")(target)


def plain_drops(setting: Setting, heights: list[float], seconds: float) -> tuple[float, int]:
    """(largest e, drops that still bounce), by a loop over mj_step of a model with other names."""
    text = registry.engine("mujoco").snippet(setting, "plane", ("foot", "floor"))
    radius = SCENE.relative_radius
    model = mujoco.MjModel.from_xml_string(f"""<mujoco>{text}<worldbody>
      <geom name="floor" type="plane" size="9 9 1"/><body pos="0 0 {radius}"><freejoint/>
      <geom name="foot" type="sphere" size="{radius}" mass=".2"/></body></worldbody></mujoco>""")
    largest, bouncing = 0.0, 0
    for height in heights:
        data, before, parted = mujoco.MjData(model), math.nan, 0.0
        data.qpos[2] += height
        for _ in range(round(seconds / STEP)):
            z, w = data.qpos[2] - radius, data.qvel[2]
            mujoco.mj_step(model, data)
            later, up = data.qpos[2] - radius, data.qvel[2]
            if z >= 0 > later:
                before = math.sqrt((w - G * STEP / 2) ** 2 + 2 * G * z)
            elif z < 0 <= later and up > 0:
                largest = max(largest, math.sqrt((up - G * STEP / 2) ** 2 + 2 * G * later) / before)
                parted = data.time
        bouncing += parted > seconds - 1
    return largest, bouncing


@pytest.mark.adhesion
def test_the_model_of_the_rows_finds_a_setting_that_bounces_for_ever_as_plain_steps_do() -> None:
    """The setting is one that hcbench advised at 1/240 s before its searches looked at energy."""
    rows = [
        {"solref": [-30754.3, -0.960032], "solimp": [1e-4, 1e-4, 1, 0.5, 1]},
        {
            "solref": [0, -12.5684],
            "solimp": [1e-4, 0.29914, 5.28273e-3, 0.381628, 4],
            "adhesion": 1e6,
        },
    ]
    setting = Setting("mujoco", "once", 1 / 240, {"rows": rows})
    found = bounces_in_rows(
        read_options(setting.options).rows, setting.timestep, G, (0.0254, 0.508)
    )
    assert found.max_e > 1.02
    assert 0.2 < found.gains_below < 0.4
    assert found.still_bouncing


@pytest.mark.parametrize("recipe", ["impulse", "compliant", "compliant-pairs"])
def test_what_is_advised_never_gains_energy_and_rests(recipe: str) -> None:
    setting = made(recipe)
    screen = screened(SCENE, setting, BAND)
    assert screen is not None
    assert screen.sphere
    largest, bouncing = plain_drops(setting, np.geomspace(2e-4, 0.2, 4).tolist(), 30.0)
    assert bouncing == 0
    assert largest < MOST_E
    assert largest <= screen.bounces.max_e + 2e-3


@pytest.mark.adhesion
def test_the_whole_gate_passes_what_the_screen_passes_under_friction() -> None:
    setting = made("compliant-pairs", 0.5)
    screen = screened(SCENE, setting, BAND)
    contact, runs = judge.tried(SCENE, setting)
    gate = certify(contact, slides=True, runs=[runs[2]])
    assert isinstance(screen, Passivity)
    assert screen.sphere
    assert screen.others.startswith(
        "Other contacts of the model: drift on 10 degrees 2.2 -> 1.5e-06 mm/s"
    )
    assert gate.sphere, gate.warning
    assert gate.slope_drift < 1e-4
    assert gate.flat == judge.with_boxes(SCENE, setting, screen).flat
    assert {finding.under for finding in gate.findings} == {"implicitfast, elliptic, Newton"}
    assert {str(run) for run in runs} >= {"Euler, elliptic, PGS", "implicit, elliptic, Newton"}


def test_the_plug_in_passes_the_whole_gate_too() -> None:
    contact, runs = judge.tried(SCENE, made("restitution-law"))
    gate = certify(contact, slides=False, runs=runs[:1])
    assert gate.sphere, gate.warning
    assert gate.flat, [finding for finding in gate.findings if not finding.passed]
    assert gate.bounces.max_e < 1.0
    alone = Passivity(gate.bounces)
    assert judge.with_boxes(SCENE, made("restitution-law"), alone).flat
    assert judge.with_law(SCENE, made("impulse"), alone) is alone


@pytest.mark.skipif(judge._library() is None, reason="no C compiler")
@pytest.mark.parametrize(
    ("recipe", "off"),
    [
        ("spring-damper", 0.0),
        ("compliant", 0.0),
        # NumPy's power is not the C library's on every processor: slow bounces amplify its last bit.
        pytest.param("compliant-pairs", 1e-6, marks=pytest.mark.adhesion),
    ],
)
def test_drops_in_c_are_those_in_numpy(recipe: str, off: float) -> None:
    rows = read_options(made(recipe).options).all_rows
    drops = judge._Drops(rows, STEP, G)
    v = np.repeat(np.geomspace(0.003, 2.0, 6), 4)
    starts = drops.touching(v, np.tile([0.1, 0.4, 0.6, 0.9], 6)), drops.from_rest(v**2 / (2.0 * G))
    for states, is_single in zip(starts, (True, False), strict=True):
        max_e, gains_below, rebounds = drops.run(states.copy(), is_single)
        expected = drops._run_by_arrays(states.copy(), is_single)
        assert max_e == pytest.approx(expected[0], rel=off, abs=0.0)
        assert gains_below == pytest.approx(expected[1], rel=off, abs=0.0)
        assert rebounds == pytest.approx(expected[2], rel=off, abs=0.0)


@pytest.mark.skipif(simulation.loop_in_c() is None, reason="no C compiler")
def test_a_body_takes_the_same_steps_in_c_as_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    contact, runs = judge.tried(replace(SCENE, friction=0.5), made("compliant", 0.5))
    model = contact.with_boxes(runs[0])
    paths = []
    for library in (simulation.loop_in_c(), None):
        monkeypatch.setattr(simulation, "loop_in_c", lambda library=library: library)
        data = mujoco.MjData(model)
        data.qpos[2] += 0.01
        data.qvel[:] = 0.3, 0.0, -0.5, 0.0, 2.0, 1.0
        paths.append(plain._stepped(model, data, 300))
    for in_c, in_python in zip(*paths, strict=True):
        np.testing.assert_array_equal(in_c, in_python)
    assert set(paths[0][0]) > {0}


def test_a_spring_that_throws_a_ball_up_is_named() -> None:
    screen = screened(SCENE, made("spring-damper"), BAND)
    assert screen is not None
    assert not screen.sphere
    assert "gains energy below" in screen.warning
