"""CPU time of a step with `hcbench.contact.mjx` over that of `mjx.step`, 64 worlds that land.

    pip install 'mujoco-mjx>=3.17' && python benchmarks/bench_mjx.py

Both are compiled before, and measured in turn, four times each; the least of each counts.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
from mujoco import mjx

from hcbench.contact.mjx import ConstantRestitution, restitution

WORLDS = 64
# A landing and half of the time until rest, at 2 ms.
STEPS = 150
ROUNDS = 4
BALL = """<mujoco><option timestep=".002"/><worldbody><geom name="floor" type="plane" size="5 5 .1"/>
<body name="ball" pos="0 0 .1"><freejoint/><geom name="ball" size=".05"/></body></worldbody></mujoco>"""
QUADRUPED = Path(__file__).parents[1] / "examples" / "quadruped.xml"
FEET = [f"{side}_{end}_foot" for side in ("left", "right") for end in ("front", "hind")]


def compiled(step: Any, start: Any, model: Any) -> Any:
    """A function that lets all worlds take STEPS steps, and has done so once."""
    each = jax.vmap(step, in_axes=(None, 0))

    @jax.jit
    def run(model: Any, data: Any) -> Any:
        return jax.lax.scan(lambda data, _: (each(model, data), None), data, length=STEPS)[0]

    jax.block_until_ready(run(model, start).qpos)
    return run


def ratio(model: mujoco.MjModel, pairs: Mapping[tuple[str, str], Any], lift: float) -> float:
    """CPU time with the law over that without it.

    lift: of the lowest world, m; the others are up to 2 cm higher.
    """
    world = mjx.put_model(model)
    heights = model.qpos0[2] + lift + jnp.linspace(0.0, 0.02, WORLDS)
    empty = mjx.make_data(model)
    start = jax.vmap(lambda z: empty.replace(qpos=jnp.array(model.qpos0).at[2].set(z)))(heights)
    runs = [compiled(step, start, world) for step in (restitution(model, pairs), mjx.step)]
    least = [float("inf"), float("inf")]
    for _ in range(ROUNDS):
        for i, run in enumerate(runs):
            begun = time.process_time()
            jax.block_until_ready(run(world, start).qpos)
            least[i] = min(least[i], time.process_time() - begun)
    return least[0] / least[1]


def main() -> None:
    ball = ratio(mujoco.MjModel.from_xml_string(BALL), {("ball", "floor"): 0.3}, 0.0)
    feet = {(foot, "floor"): ConstantRestitution(0.3) for foot in FEET}
    quadruped = ratio(mujoco.MjModel.from_xml_path(str(QUADRUPED)), feet, 0.05)
    print("| model | CPU time of a step over `mjx.step` |\n|---|---|")
    print(f"| ball | {ball:.2f} |\n| quadruped, four feet | {quadruped:.2f} |")


if __name__ == "__main__":
    main()
