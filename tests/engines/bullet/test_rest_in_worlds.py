"""Rest of a user's PyBullet world, on the level, on a slope and under loads: against loops of plain
PyBullet.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bullet_hopper import run_in_client

import hcbench as hb
from hcbench.cli import run
from hcbench.engines.pybullet.model.under_test import open_world
from hcbench.laws.restitution import ConstantRestitution
from hcbench.measuring.request import make_request
from hcbench.sim.capabilities import TunesModels

p = pytest.importorskip("pybullet")
BulletClient = pytest.importorskip("pybullet_utils.bullet_client").BulletClient

BOX = """<robot name="{name}"><link name="base"><inertial><mass value="{mass}"/>
<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>
<collision><geometry><box size="{size}"/></geometry></collision></link></robot>"""
G = 9.81
SECONDS = 8.0


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    """A block of 1 kg, and a floor."""
    block, floor = tmp_path / "block.urdf", tmp_path / "floor.urdf"
    block.write_text(BOX.format(name="block", mass=1, i=0.00167, size=".1 .1 .1"))
    floor.write_text(BOX.format(name="floor", mass=0, i=0, size="10 10 1"))
    return [str(block), str(floor)]


def lies(files: list[str], lines: str, slope: float) -> tuple[float, float]:
    """(way of the block up and down in the last quarter, m; its speed along the slope, m/s): the
    lines run after the files are loaded, 8 s of plain steps.
    """
    world = BulletClient(p.DIRECT)
    block = world.loadURDF(files[0], [0, 0, 0.55])
    floor = world.loadURDF(files[1])
    world.setGravity(G * math.sin(slope), 0, -G * math.cos(slope))
    run_in_client(lines, world, block=block, floor=floor)
    path = []
    for _ in range(round(240 * SECONDS)):
        world.stepSimulation()
        path.append(world.getBasePositionAndOrientation(block)[0])
    last = np.array(path[3 * len(path) // 4 :])
    return float(np.ptp(last[:, 2])), float(last[-1, 0] - last[0, 0]) / (SECONDS / 4)


def test_a_tuned_block_rests_and_holds_on_a_slope(files: list[str]) -> None:
    """The first setting rests in plain PyBullet; the second, as hcbench wrote it once, never does.
    Both are judged so before anything is handed out.
    """
    engine = hb.engine("pybullet")
    assert isinstance(engine, TunesModels)
    request = make_request(None, gravity=G, speeds=[0.2, 1.0])
    rests, hops = engine.model_settings(files, [request], ConstantRestitution(0.6))
    before = engine.standing(files, None, [request])
    for setting, is_still in ((rests, True), (hops, False)):
        lines = setting.texts((), None).paste  # type: ignore[arg-type]
        after = engine.standing(files, setting, [request])
        amplitude, _ = lies(files, lines, 0.0)
        _, creep = lies(files, lines, after.slope)
        assert (amplitude < 1e-4) is is_still
        assert (abs(creep) < 1e-3) is is_still
        assert (after.vibration < 1e-3) is is_still
        assert (after.drift < 1e-3) is is_still
        assert any("vibration" in worse for worse in after.worse_than(before))
    assert "restitutionVelocityThreshold=0," in lines


def test_a_band_of_slow_impacts_leaves_no_room_for_rest(files: list[str]) -> None:
    engine = hb.engine("pybullet")
    assert isinstance(engine, TunesModels)
    request = make_request(None, gravity=G, speeds=[0.01, 1.0])
    (setting,) = engine.model_settings(files, [request], ConstantRestitution(0.6))
    assert "hop for ever" in setting.notes[-1]


def test_a_block_carries_loads_up_to_its_friction(files: list[str]) -> None:
    """Coulomb's μ is 0.5 · 0.5 by default; Bullet bounds both directions of a plane apart."""
    with open_world(files, make_request(None, gravity=G), None) as model:
        carried = model.carried()
    assert carried.load == pytest.approx(G, rel=1e-2)
    assert [load.force for load in carried.loads] == pytest.approx(
        [G, 2 * G, 5 * G, 10 * G], rel=0.02
    )
    assert math.tan(carried.holds) == pytest.approx(0.25, rel=0.02)
    assert abs(lies(files, "", 0.95 * carried.holds)[1]) < 1e-3
    assert abs(lies(files, "", 1.05 * carried.holds)[1]) > 5e-2
    _, creep = lies(files, "", carried.slope)
    assert abs(creep) < 1e-3
    assert carried.creep < 1e-3


def test_what_stops_a_body_within_a_step_is_no_spring(files: list[str]) -> None:
    found = hb.measure(files, speeds="0.5, 1", gravity=G, contact=True, diagnose=False)
    assert found.contact is not None
    for impact in found.contact.impacts:
        assert math.isnan(impact.stiffness) or impact.stiffness > 0.0
        assert math.isnan(impact.stiffness) or impact.misfit <= 0.1
    assert found.contact.carried.load == pytest.approx(G, rel=1e-2)
    assert found.contact.peaks == ()


def test_without_gravity_nothing_is_carried(files: list[str]) -> None:
    with open_world(files, make_request(None), None) as model:
        assert model.carried().loads == ()
        assert math.isnan(model.standing().penetration)
        assert model.facts().notes[0].startswith("These files set no gravity, so none acts: ")


def test_tune_takes_two_files_and_names_none_that_it_did_not_write(
    files: list[str], capsys: pytest.CaptureFixture[Any]
) -> None:
    asked = ["--restitution", "0.6", "--gravity", "9.81", "--speeds", "0.5:1 m/s"]
    assert run(["tune", *files, *asked, "--max-error", "0.2", "--strict"]) == 1
    printed = capsys.readouterr()
    assert "vibration at rest" in printed.out
    assert "strict" in printed.err
    line = printed.out.partition("next, with these lines in FILE.py, ")[2]
    assert "--python FILE.py:FUNCTION" in line
    assert "--gravity 9.81" in line
    assert "tuned" not in line
    assert run(["measure", *files, "--speeds", "0.5 m/s"]) == 0
    assert "--write-model" not in capsys.readouterr().out.partition("next:")[2]


def test_an_engine_takes_no_second_file(capsys: pytest.CaptureFixture[Any]) -> None:
    assert run(["tune", "mujoco", "floor.urdf", "--alpha", "0.3"]) == 2
    assert "floor.urdf" in capsys.readouterr().err
