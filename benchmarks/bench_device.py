"""Launches a second of MJX and MuJoCo Warp in one batch, of a user's mjx.step loop, and of MuJoCo.

    python benchmarks/bench_device.py --device gpu --launches 1000000

It needs `hcbench engines add mjx mujoco-warp`, or both beside hcbench. Each row is the second of
two rounds: the first one compiles.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from hcbench import load_scene
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.sim.columns import Launches
from hcbench.sim.remote import RemoteEngine
from hcbench.terms.setting import Setting
from hcbench.workers import call

SCENE = load_scene("steel-plane")
ALPHA, SLOWEST, FASTEST = 0.3, 0.1, 0.5  # s/m, m/s
CASES = (("impulse", 1e-3), ("spring-damper", 1e-5))

USER = """
import json, os, sys, time

os.environ["NPROC"] = "16"  # threads of XLA: two may wait for each other
import jax, mujoco, numpy as np
from mujoco import mjx

given = json.loads(sys.stdin.readline())
device = jax.devices(given["device"])[0]
model = mujoco.MjModel.from_xml_string(given["xml"])
on_device = mjx.put_model(model, device=device)
empty = mjx.make_data(on_device, device=device)
speeds = np.linspace(*given["speeds"], given["launches"], dtype=np.float32)
place = jax.jit(jax.vmap(lambda v: empty.replace(
    qpos=empty.qpos.at[:3].set(jax.numpy.array([0, 0, given["radius"] + 2.5 * given["timestep"] * v])),
    qvel=empty.qvel.at[2].set(-v))))
step = jax.jit(jax.vmap(mjx.step, in_axes=(None, 0)))
for _ in range(2):
    began, used = time.perf_counter(), time.process_time()
    data, rates = place(jax.device_put(speeds, device)), []
    for _ in range(given["steps"]):
        data = step(on_device, data)
        rates.append(np.asarray(data.qvel[:, 2]))
    e = rates[-1] / speeds
    took = time.perf_counter() - began, time.process_time() - used
print(json.dumps([*took, float(e.mean())]))
"""


def target(timestep: float) -> Target:
    law = HuntCrossley(SCENE.stiffness, ALPHA, SCENE.exponent)
    return Target(law, SCENE.mass, timestep, SLOWEST, FASTEST)


def launches(count: int) -> Launches:
    table = np.zeros((count, 8))
    table[:, 0], table[:, 1], table[:, 2] = np.linspace(SLOWEST, FASTEST, count), 0.5, np.nan
    return Launches.of_table(table)


def hcbench(setting: Setting, sent: Launches) -> tuple[float, float, float, float]:
    """Seconds by the clock and of processors, memory of the process in MiB, and mean e."""
    engine = registry.engine(setting.engine)
    at = engine.interpreter if isinstance(engine, RemoteEngine) else None

    def there(function: Callable[..., Any], *args: Any) -> Any:
        return call(function, *args, limit=None, at=at) if engine.own_process else function(*args)

    for _ in range(2):
        began, used = time.perf_counter(), there(time.process_time)
        impacts = engine.run_columns(SCENE, setting, sent)
        took = time.perf_counter() - began, there(time.process_time) - used
    memory = there(resource.getrusage, resource.RUSAGE_SELF).ru_maxrss / 1024
    return *took, memory, float(impacts.restitution.mean())


def user(setting: Setting, count: int, device: str, steps: int) -> tuple[float, float, float]:
    """Seconds by the clock and of processors, and mean e, of a loop over
    mjx.step that keeps each rate.
    """
    engine = registry.engine("mjx")
    python = engine.environment.executable if isinstance(engine, RemoteEngine) else sys.executable
    given = {
        "xml": engine.script(SCENE, setting), "device": device, "launches": count, "steps": steps,
        "speeds": (SLOWEST, FASTEST), "radius": SCENE.touch_radius, "timestep": setting.timestep,
    }  # fmt: skip
    command = [str(python), "-c", USER]
    done = subprocess.run(
        command, input=json.dumps(given) + "\n", capture_output=True, text=True, check=True
    )
    wall, cpu, e = json.loads(done.stdout.splitlines()[-1])
    return wall, cpu, e


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", choices=["cpu", "gpu"], default="cpu")
    parser.add_argument("--launches", type=int, default=100_000)
    both = ["mjx", "mujoco-warp"]
    parser.add_argument("--engines", choices=both, nargs="*", default=both)
    parser.add_argument("--steps", choices=["1 ms", "10 us"], nargs="*", default=["1 ms", "10 us"])
    asked = parser.parse_args()
    sent = launches(asked.launches)
    print("| launches | who | launches/s | launches a processor second | memory, MiB | mean e |")
    print("|---|---|---|---|---|---|")
    for (recipe, timestep), name in zip(CASES, ("1 ms", "10 us"), strict=True):
        if name not in asked.steps:
            continue
        longest = 0
        for engine in asked.engines:
            setting = registry.recipe(f"{engine}.{recipe}")(target(timestep))
            setting = replace(setting, options={**setting.options, "device": asked.device})
            wall, cpu, memory, e = hcbench(setting, sent)
            row(asked.launches, f"{engine}, {name}, {asked.device}", wall, cpu, f"{memory:.0f}", e)
            if engine == "mjx":
                impacts = registry.engine(engine).run_columns(SCENE, setting, sent[:1000])
                longest = int((impacts.start + impacts.samples).max()) + 1
                wall, cpu, e = user(setting, asked.launches, asked.device, longest)
                row(
                    asked.launches,
                    f"a loop over mjx.step, {name}, {asked.device}",
                    wall,
                    cpu,
                    "",
                    e,
                )
        few = sent[:: max(1, asked.launches // 20_000)]
        wall, cpu, memory, e = hcbench(registry.recipe(f"mujoco.{recipe}")(target(timestep)), few)
        row(len(few), f"mujoco, {name}, one core", wall, cpu, f"{memory:.0f}", e)


def row(count: int, who: str, wall: float, cpu: float, memory: str, e: float) -> None:
    print(
        f"| {count} | {who} | {count / wall:.3g} | {count / cpu:.3g} | {memory} | {e:.5f} |",
        flush=True,
    )


if __name__ == "__main__":
    main()
