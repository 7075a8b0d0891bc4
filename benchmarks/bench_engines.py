"""Engines through hcbench beside the loop a user would write, and beside
a bare loop in C over mj_step.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pytest
from _loops import (
    bare,
    bare_steps,
    in_mujoco,
    in_mujoco_barely,
    in_pybullet,
    in_rollout,
    users_ball,
    users_robot,
)

from hcbench.benchmark.batch import Batch, run_batch
from hcbench.contact.mujoco import load as load_plugins
from hcbench.engines.mujoco import engine as mujoco_engine
from hcbench.engines.mujoco.engine import MujocoEngine
from hcbench.engines.mujoco.scene import batch
from hcbench.engines.mujoco.scene.mjcf import model_xml, read_options
from hcbench.engines.mujoco.scene.scene_model import load
from hcbench.engines.mujoco.scene.world import BatchPool
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.measuring.request import make_request
from hcbench.recipes.target import Target
from hcbench.sim import registry, simulate
from hcbench.sim.columns import Launches
from hcbench.terms.impact import Launch
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Setting
from hcbench.workers import WorkerPool, serve

SCENE = load_scene("steel-plane")
LAW = HuntCrossley(SCENE.stiffness, 0.008 / 0.0254)
STEP = 1e-6
INCH = 0.0254


def launches(count: int) -> list[Launch]:
    """1 ... 20 in/s at four phases each."""
    return [
        Launch(float(v), (i + 0.5) / 4)
        for v in np.linspace(1, 20, count // 4) * INCH
        for i in range(4)
    ]


def made(recipe: str) -> Setting:
    setting: Setting = registry.recipe(recipe)(Target(LAW, SCENE.mass, STEP, 1 * INCH, 20 * INCH))
    return setting


@pytest.mark.parametrize(
    ("recipe", "count", "must", "aim"),
    [
        ("spring-damper", 80, "4", "7"),
        ("spring-damper", 640, "7", "8.5"),
        ("staggered", 80, "1.2", "1.5"),
    ],
)
def test_mujoco_over_a_users_loop(
    beside: Any, recipe: str, count: int, must: str, aim: str
) -> None:
    setting, eighty, many, engine = (
        made(f"mujoco.{recipe}"),
        launches(80),
        launches(count),
        MujocoEngine(),
    )
    xml = model_xml(SCENE, setting)
    hertz = float(closed_form.duration(HuntCrossley(SCENE.stiffness, 0.0), SCENE.mass, 1 * INCH))
    enough, turns = round(1.5 * hertz / STEP), 800 // count

    def in_turns() -> None:  # as long as the others take
        for _ in range(turns):
            engine.run(SCENE, setting, many)

    loops = {
        "mujoco.rollout on all cores, 1.5 Hertz contacts long": lambda: in_rollout(
            xml, eighty, STEP, enough
        ),
        "a user's loop, until the ball has left": lambda: in_mujoco(xml, eighty, STEP),
        "a user's loop, 1.5 Hertz contacts long": lambda: in_mujoco(xml, eighty, STEP, enough),
        "mj_step in Python, nothing read but when it has left": lambda: in_mujoco_barely(
            xml, eighty, STEP
        ),
    }
    beside(
        f"MuJoCo, {recipe}, {count} launches at 1 µs, all cores",
        {**loops, "hcbench": in_turns},
        per={**dict.fromkeys(loops, 80), "hcbench": turns * count},
        rounds=5,
        must=must,
        aim=aim,
    )


@pytest.mark.parametrize("recipe", ["spring-damper", "staggered"])
def test_mujoco_over_a_bare_c_loop(
    beside: Any, recipe: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Per ball-step of one core. The same balls: in the models that
    hcbench puts them in, and all in one.
    """
    monkeypatch.setattr(serve, "_is_worker", True)  # one thread
    mujoco_engine.cached_pool.cache_clear()
    setting, many, engine = made(f"mujoco.{recipe}"), launches(480), MujocoEngine()
    loaded = load(SCENE, STEP, read_options(setting.options))
    pool = BatchPool.of(loaded)
    many = sorted(many, key=lambda launch: launch.speed)
    size = -(-len(many) // -(-len(many) // pool.max_batch))  # as `run_launches` groups them
    groups = [many[i : i + size] for i in range(0, len(many), size)]
    impacts = {i.launch: i for i in engine.run(SCENE, setting, many)}
    steps = [max(impacts[launch].samples for launch in group) + 5 for group in groups]
    models = [pool.batch(len(group)).model for group in groups]
    default = load(SCENE, STEP, read_options(setting.options))
    together = batch.compile_batch(default, 80, sliding=False).model
    together.opt.jacobian = mujoco.mjtJacobian.mjJAC_AUTO
    eighty = many[::6]
    longest = max(steps)

    loops = [bare(*job) for job in zip(models, groups, [STEP] * len(groups), steps, strict=True)]

    def all_bare() -> None:
        for run in loops:
            run()

    ball_steps = sum(impact.samples + 5 for impact in impacts.values())
    beside(
        f"MuJoCo, {recipe}, a ball-step of one core",
        {
            "C, the models that hcbench makes": all_bare,
            "C, 80 balls in one model as MuJoCo makes it": bare(together, eighty, STEP, longest),
            "hcbench": lambda: engine.run(SCENE, setting, many),
        },
        per={
            "C, 80 balls in one model as MuJoCo makes it": 80 * longest,
            "C, the models that hcbench makes": ball_steps,
            "hcbench": ball_steps,
        },
        must="1/1.12" if recipe == "spring-damper" else "1/1.06",
        aim="1/1.05",
    )
    mujoco_engine.cached_pool.cache_clear()


def test_pybullet_over_a_users_loop(beside: Any) -> None:
    setting, eighty = made("pybullet.spring-damper"), launches(80)
    many = Batch(SCENE, setting, Launches.of(launches(320)), ())

    serve._is_worker = False
    with WorkerPool(2) as pool:

        def ours() -> None:
            pool.map(run_batch, [many, many])

        beside(
            "PyBullet, spring-damper at 1 µs, two processes",
            {
                "a user's loop": lambda: in_pybullet_alone(setting, eighty),
                "hcbench": ours,
            },
            per={"a user's loop": 80, "hcbench": 640},
            rounds=3,
            must="6",
            aim="8",
        )


def in_pybullet_alone(setting: Setting, eighty: list[Launch]) -> None:
    try:
        in_pybullet(SCENE, setting, eighty)
    finally:
        serve._is_worker = False


QUADRUPED = str(Path(__file__).parents[1] / "examples/quadruped.xml")


@pytest.mark.parametrize(
    ("what", "source", "pair", "must", "aim"),
    [
        ("a ball at 0.1 ms", users_ball(1e-4), "ball,plate", "1/1.5", "1/1.2"),
        ("a ball at 2 ms", users_ball(2e-3), "ball,plate", "1/2.5", "1/1.2"),
        ("66 degrees of freedom at 2 ms", users_robot(2e-3), "ball,plate", "1/1.4", "1/1.2"),
        (
            "README's quadruped, a foot, 2 ms",
            QUADRUPED,
            "left_front_foot,floor",
            "1/1.6",
            "1/1.2",
        ),
    ],
)
def test_a_users_model_over_mj_step(
    beside: Any, what: str, source: str, pair: str, must: str, aim: str
) -> None:
    """CPU time per step of launches at eight speeds and four phases,
    and of the same steps of mj_step, in C and in Python.
    """
    opened = MujocoEngine().open(source, make_request(pair, phases=4))
    model = opened.model
    timestep = opened.timestep
    launches = Launches.of(opened.request.launches())
    seen = list(simulate.run_launches(opened, launches))
    after = 1 + opened.speed_reading.steps_after
    counts = [int(count) for group in seen for count in group.start + group.samples + after]
    data, state = mujoco.MjData(model), mujoco.mjtState.mjSTATE_INTEGRATION
    starts = np.empty((len(launches), mujoco.mj_stateSize(model, state)))
    for launch, start in zip(launches, starts, strict=True):
        mujoco.mj_copyData(data, model, opened.start)
        data.qpos[:] = opened.place.qpos
        back = -launch.clearance_in_phase(timestep, opened.gravity)
        mujoco.mj_integratePos(model, data.qpos, opened.place.direction, back)
        data.qvel[:] = launch.speed * opened.place.direction
        mujoco.mj_getState(model, data, start, state)

    def stepped() -> float:
        began = time.process_time()
        for start, count in zip(starts, counts, strict=True):
            mujoco.mj_setState(model, data, start, state)
            for _ in range(count):
                mujoco.mj_step(model, data)
        return time.process_time() - began

    def in_c() -> float:
        began = time.process_time()
        for start, count in zip(starts, counts, strict=True):
            mujoco.mj_setState(model, data, start, state)
            bare_steps(model, data, count)
        return time.process_time() - began

    def ours() -> float:
        began = time.process_time()
        list(simulate.run_launches(opened, launches))
        return time.process_time() - began

    beside(
        f"MuJoCo, a step of a user's model, {what}",
        {
            "mj_step in C, nothing read": in_c,
            "mj_step in Python, nothing read": stepped,
            "hcbench": ours,
        },
        per=sum(counts),
        must=must,
        aim=aim,
    )


def test_the_plug_in_over_native_contact(beside: Any) -> None:
    """Per step in contact, in a rollout on one thread."""
    native = load(SCENE, STEP, read_options(made("mujoco.spring-damper").options)).model
    load_plugins()
    plugged = load(SCENE, STEP, read_options(made("mujoco.hunt-crossley").options)).model
    speed, steps = 0.2, 200

    def roll(model: Any) -> None:
        data = mujoco.MjData(model)
        data.qvel[2] = -speed
        state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        for _ in range(5):
            mujoco.rollout.rollout(model, data, state[None], nstep=steps)

    beside(
        "MuJoCo, a step in contact, plug-in",
        {
            "its own contact, a spring and damper": lambda: roll(native),
            "hcbench.contact": lambda: roll(plugged),
        },
        per=5 * steps,
    )
