"""A restitution tuned for links whose file gives them a spring and a damper, in plain PyBullet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from bullet_hopper import run_in_client

import hcbench as hb

p = pytest.importorskip("pybullet")
BulletClient = pytest.importorskip("pybullet_utils.bullet_client").BulletClient

STEP = 1 / 240
RADIUS = 0.0632
INERTIA = '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/>'
PUCK = (
    '<robot name="puck"><link name="puck"><contact><stiffness value="8000"/><damping value="30"/>'
    f'</contact><inertial><mass value="1.5"/>{INERTIA.format(i=0.0024)}</inertial>'
    f'<collision><geometry><sphere radius="{RADIUS}"/></geometry></collision></link></robot>'
)
GROUND = (
    f'<robot name="g"><link name="ground"><inertial><mass value="0"/>{INERTIA.format(i=0)}'
    '</inertial><collision><origin xyz="0 0 -.5"/><geometry><box size="9 9 1"/></geometry>'
    "</collision></link></robot>"
)


def bounced(files: list[str], lines: str, speed: float, phase: float) -> float:
    """e of the puck with lines run, in a client of its own."""
    world: Any = BulletClient(p.DIRECT)
    puck = world.loadURDF(files[0], [0, 0, RADIUS + (2.0 + phase) * speed * STEP])
    ground = world.loadURDF(files[1])
    run_in_client(lines, world, puck=puck, ground=ground)
    world.resetBaseVelocity(puck, [0, 0, -speed])
    for _ in range(40):
        world.stepSimulation()
    e = float(world.getBaseVelocity(puck)[0][2]) / speed
    world.disconnect()
    return e


def test_a_restitution_holds_where_the_file_has_a_spring(tmp_path: Path) -> None:
    """The spring stayed, and acted in place of the restitution."""
    files = []
    for name, text in (("puck.urdf", PUCK), ("ground.urdf", GROUND)):
        (tmp_path / name).write_text(text)
        files.append(str(tmp_path / name))
    assert bounced(files, "", 1.0, 0.4) > 0.4
    tuned = hb.tune_model(files, "puck,ground", restitution=0.6, speeds="0.5, 1 m/s")
    assert tuned.gains
    for speed, phase in ((0.6, 0.15), (0.9, 0.7)):
        assert bounced(files, tuned.text, speed, phase) == pytest.approx(0.6, abs=0.01)
