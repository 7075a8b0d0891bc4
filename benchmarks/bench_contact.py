"""The contact plug-ins: how near to the law, and how fast beside the engine's own contact.

    python benchmarks/bench_contact.py [--quick]

Restitution: the paper's four α, 1 ... 20 in/s, 8 phases of touch, against e of (16); worst of all. Loops: rms
distance in force over the largest force. Speed: single-threaded CPU time of steps in contact in this very
run; MuJoCo's own contact is a spring-damper (solref "-2.679e8 -815"), round by round beside the plug-in.
"""

from __future__ import annotations

import argparse
import ctypes
import os
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import metadata
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np

from hcbench.engines.mujoco.plugin import attach as contact
from hcbench.engines.mujoco.plugin.attach import HuntCrossley, Restitution
from hcbench.laws import closed_form
from hcbench.scene import load_scene

INCH = 0.0254
SCENES = [load_scene("steel-plane"), load_scene("steel-cup")]
MASS, STIFFNESS = SCENES[0].mass, SCENES[0].stiffness
ALPHAS = [float(alpha) / INCH for alpha in (0.002, 0.004, 0.008, 0.016)]
LAW = HuntCrossley(STIFFNESS, ALPHAS[2])
SPEED, RADIUS = 8 * INCH, 0.0508
PHASES = [(i + 0.5) / 8 for i in range(8)]
STIFF = 'condim="1" solref="-2.679e8 -815" solimp=".9999 .9999 .001 .5 2"'
XML = f"""<mujoco><option timestep="{{h}}" gravity="0 0 0"/><worldbody>
  <geom name="plate" type="plane" size="1 1 1" {STIFF}/>
  <body pos="0 0 .0508"><freejoint/><geom name="ball" size=".0508" mass=".45359237" {STIFF}/></body>
  </worldbody></mujoco>"""
Record = list[tuple[float, float, float]]  # x, v, F of each step, for a ball that was sent at a speed
Fly = Callable[[float, float], Record]


@contextmanager
def in_mujoco(scene: Any, law: Any, h: float, integrator: str) -> Iterator[Fly]:
    """Flights of a ball in MuJoCo, the law attached."""
    model = mujoco.MjModel.from_xml_path(str(scene.models["mujoco"]["scene"]))
    model.opt.timestep, model.opt.gravity[2] = h, 0.0
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    ready = float(model.qpos0[2])
    own: dict[str, Any] = {"tendons": ["contact"]} if scene.form == "cup" else {"pairs": [("ball", "plate")]}

    def fly(speed: float, phase: float) -> Record:
        data, record = mujoco.MjData(model), []
        data.qpos[2], data.qvel[2] = ready + (2 + phase) * h * speed, -speed
        while not (record and data.qvel[2] > 0 and record[-1][2] == 0.0):
            x, v = ready - float(data.qpos[2]), -float(data.qvel[2])
            mujoco.mj_step(model, data)
            record.append((x, v, MASS * (float(data.qvel[2]) + v) / h))
        return record

    with contact.attach(model, law=law, **own):
        yield fly


@contextmanager
def in_pybullet(scene: Any, law: Any, h: float, _: str) -> Iterator[Fly]:
    """Flights of a ball in PyBullet, the law attached."""
    import pybullet as bullet

    from hcbench.contact import pybullet as plug_in

    client = bullet.connect(bullet.DIRECT)
    bullet.setTimeStep(h)
    ball, plate = (bullet.loadURDF(str(scene.models["pybullet"][role])) for role in ("ball", "plate"))
    bullet.changeDynamics(ball, -1, linearDamping=0, angularDamping=0)
    cup = scene.form == "cup"
    ready = scene.ball_radius if cup else scene.relative_radius
    bowl = -scene.plate_radius
    gap = plug_in.cup(scene.ball_radius, bowl, (0, 0, bowl)) if cup else None

    def fly(speed: float, phase: float) -> Record:
        bullet.resetBasePositionAndOrientation(ball, (0, 0, ready + (2 + phase) * h * speed), (0, 0, 0, 1))
        bullet.resetBaseVelocity(ball, (0, 0, -speed), (0, 0, 0))
        record: Record = []
        while not (record and record[-1][1] < 0 and record[-1][2] == 0.0):
            x = ready - bullet.getBasePositionAndOrientation(ball)[0][2]
            v = -bullet.getBaseVelocity(ball)[0][2]
            record.append((x, v, sum(touch.force for touch in attached.step())))
        return record

    with plug_in.attach([(ball, plate)], law, client=client, gap=gap) as attached:
        yield fly
    bullet.disconnect(client)


ENGINES = {"mujoco": in_mujoco, "pybullet": in_pybullet}


def worst(engine: str, kind: str, h: float, speeds: list[float], integrator: str = "Euler") -> float:
    """Largest error of e over α, speeds, phases and both scenes."""
    error = 0.0
    for scene in SCENES:
        for alpha in ALPHAS:
            law = HuntCrossley(STIFFNESS, alpha) if kind == "force" else Restitution(alpha)
            with ENGINES[engine](scene, law, h, integrator) as fly:
                for speed in speeds:
                    truth = float(closed_form.restitution(alpha, speed))
                    error = max(error, *(abs(-fly(speed, phase)[-1][1] / speed - truth) for phase in PHASES))
    return error


def loop(engine: str, h: float) -> float:
    """Worst rms distance in force at equal penetration and branch, over the largest force."""
    found = []
    for scene in SCENES:
        with ENGINES[engine](scene, LAW, h, "Euler") as fly:
            for speed in (4 * INCH, 8 * INCH, 12 * INCH, 16 * INCH):
                record = np.array(fly(speed, 0.3))
                x, force = record[:, 0], record[:, 2]
                rising = np.append(np.diff(x) > 0, False)
                ways = ("approach", "rebound")
                rates = [closed_form.rate_at(LAW, MASS, speed, np.maximum(x, 0.0), way) for way in ways]  # type: ignore[arg-type]
                rate = np.where(rising, *rates)
                use = (x > 0) & np.isfinite(rate)
                off = force[use] - LAW.force(x[use], rate[use])
                found.append(np.sqrt(np.mean(off**2)) / float(closed_form.force_max(LAW, MASS, speed)))
    return max(found)


def batched(model: Any, sims: int, steps: int) -> Callable[[], float]:
    """CPU seconds of one run of `sims` simulations over one impact each, under Batch or else rollout."""
    heights = RADIUS + np.linspace(2, 3, sims) * model.opt.timestep * SPEED
    try:
        from mujoco import batch
    except ImportError:
        data = mujoco.MjData(model)
        full = mujoco.mjtState.mjSTATE_FULLPHYSICS
        start = np.zeros((sims, mujoco.mj_stateSize(model, full)))
        for row, height in zip(start, heights, strict=True):
            data.qpos[2], data.qvel[2] = height, -SPEED
            mujoco.mj_getState(model, data, row, full)

        def roll() -> float:
            began = time.process_time()
            mujoco.rollout.rollout(model, data, start, nstep=steps)
            return time.process_time() - began

        return roll
    many = batch.Batch(model, sims, 1)

    def step() -> float:
        many.qpos[:, 2], many.qvel[:] = heights, 0.0
        many.qvel[:, 2] = -SPEED
        began = time.process_time()
        many.step(nstep=steps)
        return time.process_time() - began

    return step


def rate_beside_native(h: float, rounds: int) -> tuple[float, float]:
    """(steps/s with the plug-in, that over native contact's): medians of alternating rounds."""
    steps, sims = int(2.2e-4 / h), max(16, int(1.2e-2 / (2.2e-4 / h * 2e-6)) // 8)
    native, model = (mujoco.MjModel.from_xml_string(XML.format(h=h)) for _ in range(2))
    with contact.attach(model, ("ball", "plate"), LAW):
        runs = batched(native, sims, steps), batched(model, sims, steps)
        times = np.array([[run() for run in runs] for _ in range(rounds)])
    ratio = statistics.median(times[:, 0] / times[:, 1])
    return sims * steps / statistics.median(times[:, 1]), ratio


@contextmanager
def quiet() -> Iterator[None]:
    """PyBullet prints when imported."""
    saved, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        ctypes.CDLL(None).fflush(None)
        os.dup2(saved, 1)
        os.close(saved)
        os.close(null)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="three speeds instead of eight, fewer rounds")
    quick = parser.parse_args().quick
    speeds = [v * INCH for v in ((1, 8, 20) if quick else (1, 2, 4, 8, 12, 16, 18, 20))]
    print(f"mujoco {mujoco.__version__}, pybullet {metadata.version('pybullet')}: e error, worst of all\n")
    cases = [("mujoco", integrator) for integrator in ("Euler", "implicitfast", "RK4")] + [
        ("pybullet", "Euler")
    ]
    rows: list[tuple[str, str, list[float]]] = []
    with quiet():
        for engine, integrator in cases:
            name = engine if engine == "pybullet" else f"{engine} {integrator}"
            errors = [worst(engine, "force", h, speeds, integrator) for h in (1e-6, 1e-5, 2e-5)]
            rows.append((f"{name}, force law", "1e-6, 1e-5, 2e-5 s", errors))
            errors = [worst(engine, "restitution", h, speeds, integrator) for h in (1e-4, 1e-3, 4e-3)]
            rows.append((f"{name}, restitution law", "1e-4, 1e-3, 4e-3 s", errors))
        loops = [(name, [loop(name, h) for h in (1e-6, 1e-5)]) for name in ENGINES]
    for what, steps, errors in rows:
        print(f"{what:38s} {steps:20s} " + "  ".join(f"{error:.1e}" for error in errors))
    print()
    for name, found in loops:
        print(f"{name:38s} {'1e-6, 1e-5 s':20s} loop rms " + "  ".join(f"{100 * one:.3f} %" for one in found))
    print()
    for h in (1e-6, 1e-5):
        rate, ratio = rate_beside_native(h, 5 if quick else 15)
        print(f"mujoco force law, h = {h:g} s: {rate:.3g} steps/s, {ratio:.2f} x native contact")


if __name__ == "__main__":
    main()
