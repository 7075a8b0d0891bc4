"""The loops that users write, and the bare loop in C that no Python can beat."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sysconfig
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pytest

from hcbench.engines.pybullet.scene.options import read_options
from hcbench.engines.pybullet.scene.world import PybulletWorld
from hcbench.terms.impact import Launch
from hcbench.terms.scene import Scene
from hcbench.terms.setting import Setting
from hcbench.workers import mark_as_worker

Record = list[tuple[float, float, float]]


def in_mujoco(
    xml: str, launches: Sequence[Launch], timestep: float, length: int | None = None
) -> int:
    """Depth, rate and force of each step of each launch; how many steps that is.

    As MuJoCo's documentation shows: mj_step, data.contact, mj_contactForce.
    length: steps, or until parted.
    """
    model = mujoco.MjModel.from_xml_string(xml)
    data, force, steps = mujoco.MjData(model), np.zeros(6), 0
    for launch in launches:
        mujoco.mj_resetData(model, data)
        data.qpos[2] += launch.clearance(timestep)
        data.qvel[2] = -launch.speed
        record: Record = []
        while len(record) != length:
            if length is None and record and data.qvel[2] > 0 and record[-1][2] == 0.0:
                break
            rate, depth, normal = -data.qvel[2], 0.0, 0.0
            mujoco.mj_step(model, data)
            for i in range(data.ncon):
                mujoco.mj_contactForce(model, data, i, force)
                depth, normal = -data.contact[i].dist, normal + force[0]
            record.append((depth, rate, normal))
        steps += len(record)
    return steps


def in_rollout(xml: str, launches: Sequence[Launch], timestep: float, length: int) -> Any:
    """States of each step of each launch, (n, length, nstate), by MuJoCo's rollout on all cores."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = [mujoco.MjData(model) for _ in range(len(os.sched_getaffinity(0)))]
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    states = np.empty((len(launches), mujoco.mj_stateSize(model, kind)))
    for state, launch in zip(states, launches, strict=True):
        mujoco.mj_resetData(model, data[0])
        data[0].qpos[2] += launch.clearance(timestep)
        data[0].qvel[2] = -launch.speed
        mujoco.mj_getState(model, data[0], state, kind)
    path, _ = mujoco.rollout.rollout(model, data, states, nstep=length)
    return path


def in_mujoco_barely(xml: str, launches: Sequence[Launch], timestep: float) -> int:
    """The same, but for force and depth: mj_step and the velocity,
    nothing else that can be left out.
    """
    model = mujoco.MjModel.from_xml_string(xml)
    data, steps = mujoco.MjData(model), 0
    start = model.qpos0[2]
    for launch in launches:
        mujoco.mj_resetData(model, data)
        data.qpos[2] += launch.clearance(timestep)
        data.qvel[2] = -launch.speed
        velocity, position = data.qvel, data.qpos
        while not (velocity[2] > 0 and position[2] > start):
            mujoco.mj_step(model, data)
            steps += 1
    return steps


@cache
def _library() -> Any:
    compiler = shutil.which(sysconfig.get_config_var("CC").split()[0]) or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    home = Path(mujoco.__file__).parent
    folder = Path(tempfile.mkdtemp())
    (folder / "bare.c").write_text(
        "#include <mujoco/mujoco.h>\n"
        "void bare(const mjModel* m, mjData* d, int n) { for (int i = 0; i < n; i++) mj_step(m, d); }\n"
    )
    shared = next(home.glob("libmujoco.so*"))
    command = [
        compiler,
        "-O3",
        "-shared",
        "-fPIC",
        f"-I{home}/include",
        str(folder / "bare.c"),
        str(shared),
    ]
    subprocess.run([*command, "-o", str(folder / "bare.so")], check=True)
    library = ctypes.CDLL(str(folder / "bare.so"))
    library.bare.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int]
    return library


def bare_steps(model: Any, data: Any, steps: int) -> None:
    """`for (...) mj_step(m, d)` in C, of any model."""
    _library().bare(model._address, data._address, steps)


def bare(model: Any, launches: Sequence[Launch], timestep: float, steps: int) -> Any:
    """`for (...) mj_step(m, d)` over all of these balls in one model, ready to be run."""
    library, data, whole = _library(), mujoco.MjData(model), mujoco.mjtState.mjSTATE_INTEGRATION
    heights, speeds = (
        (slice(2, None, 7), slice(2, None, 6)) if model.nq > model.nv else (slice(None),) * 2
    )
    data.qpos[heights] = model.qpos0[heights] + [launch.clearance(timestep) for launch in launches]
    data.qvel[speeds] = [-launch.speed for launch in launches]
    start = np.empty(mujoco.mj_stateSize(model, whole))
    mujoco.mj_getState(model, data, start, whole)

    def run() -> None:
        mujoco.mj_setState(model, data, start, whole)
        library.bare(model._address, data._address, steps)

    return run


def users_ball(timestep: float) -> str:
    """MJCF of a free ball over a plane that bounces."""
    return (
        f'<mujoco><option timestep="{timestep}"/><worldbody><geom name="plate" type="plane" size="1 1 .1"/>'
        '<body name="ball" pos="0 0 .2"><freejoint/><geom size=".1" solref="-1e4 -20"/></body>'
        "</worldbody></mujoco>"
    )


def users_robot(timestep: float, legs: int = 10) -> str:
    """MJCF of a trunk of 6 degrees of freedom, and ten legs of six joints with springs and damping."""
    hinge = '<joint type="hinge" axis="{0}" damping=".5" armature=".01" stiffness="20"/>'
    axes = ["0 1 0", "1 0 0"] * 3
    parts = [
        hinge.format(axis) + '<geom type="capsule" fromto="0 0 0 0 0 .08" size=".02"/>'
        for axis in axes
    ]
    leg = '<body pos="0 0 .1">'.join(parts) + "</body>" * (len(parts) - 1)
    turns = np.linspace(0.0, 2.0 * np.pi, legs, endpoint=False)
    bodies = "".join(
        f'<body pos="{0.3 * np.cos(a)} {0.3 * np.sin(a)} .1">{leg}</body>' for a in turns
    )
    return (
        f'<mujoco><option timestep="{timestep}"/><default><geom contype="0"/></default><worldbody>'
        '<geom name="plate" type="plane" size="3 3 .1" contype="1"/><body name="ball" pos="0 0 .5">'
        f'<freejoint/><geom size=".2" solref="-1e4 -20"/>{bodies}</body></worldbody></mujoco>'
    )


def in_pybullet(scene: Scene, setting: Setting, launches: Sequence[Launch]) -> int:
    """Depth, rate and force of each step of each launch, until it has
    parted; how many steps that is.
    """
    mark_as_worker()  # this process is the benchmark's own
    world = PybulletWorld(
        scene,
        setting.timestep,
        read_options(setting.options),
        max(launch.speed for launch in launches),
    )
    bullet, ball, plate = world.bullet, world.balls[0], world.plate
    radius, steps = world.deepest, 0
    for launch in launches:
        bullet.resetBasePositionAndOrientation(
            ball, [0, 0, radius + launch.clearance(setting.timestep)], [0, 0, 0, 1]
        )
        bullet.resetBaseVelocity(ball, [0, 0, -launch.speed], [0, 0, 0])
        record: Record = []
        touched = False
        while not (touched and record[-1][2] == 0.0 and record[-1][1] < 0):
            depth = radius - bullet.getBasePositionAndOrientation(ball)[0][2]
            rate = -bullet.getBaseVelocity(ball)[0][2]
            bullet.stepSimulation()
            force = sum(contact[9] for contact in bullet.getContactPoints(ball, plate))
            touched = touched or force > 0
            record.append((depth, rate, force))
        steps += len(record)
    return steps
