"""Time of a step with `hcbench.contact.mjx` over that of `mjx.step`, in worlds that land.

    pip install 'mujoco-mjx>=3.17' && python benchmarks/bench_mjx.py
    python benchmarks/bench_mjx.py --worlds 64 4096 --rest      # on a GPU, with jax[cuda12]

On a processor the time is its own, on a GPU that of the clock. Both steps are compiled before, and
measured in turn, four times each; the least of each counts. --rest lets as many quadrupeds as the
largest number of worlds, each with an e of its own, land and stand, and says how they end.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx

from hcbench.contact.mjx import ConstantRestitution, restitution

# A landing and half of the time until rest, at 2 ms.
STEPS = 150
# Steps until a quadruped stands, at 2 ms.
UNTIL_REST = 1500
ROUNDS = 4
BALL = """<mujoco><option timestep=".002"/><worldbody><geom name="floor" type="plane" size="5 5 .1"/>
<body name="ball" pos="0 0 .1"><freejoint/><geom name="ball" size=".05"/></body></worldbody></mujoco>"""
QUADRUPED = mujoco.MjModel.from_xml_path(
    str(Path(__file__).parents[1] / "examples" / "quadruped.xml")
)
FEET = [f"{side}_{end}_foot" for side in ("left", "right") for end in ("front", "hind")]
LIFT = 0.05


def compiled(step: Any, start: Any, model: Any) -> Any:
    """A function that lets all worlds take STEPS steps, and has done so once."""
    each = jax.vmap(step, in_axes=(None, 0))

    @jax.jit
    def run(model: Any, data: Any) -> Any:
        return jax.lax.scan(lambda data, _: (each(model, data), None), data, length=STEPS)[0]

    jax.block_until_ready(run(model, start).qpos)
    return run


def raised(model: mujoco.MjModel, lift: float, worlds: int) -> Any:
    """MJX's data of this many worlds, the lowest raised by `lift`, m, the highest by 2 cm more."""
    heights = model.qpos0[2] + lift + jnp.linspace(0.0, 0.02, worlds)
    empty = mjx.make_data(model)
    return jax.vmap(lambda z: empty.replace(qpos=jnp.array(model.qpos0).at[2].set(z)))(heights)


def row(
    name: str, model: mujoco.MjModel, pairs: Mapping[tuple[str, str], Any], lift: float, worlds: int
) -> None:
    """Print the time of a step of all worlds with the law and without it."""
    on_gpu = jax.default_backend() == "gpu"
    clock = time.perf_counter if on_gpu else time.process_time
    world = mjx.put_model(model)
    start = raised(model, lift, worlds)
    runs = [compiled(step, start, world) for step in (restitution(model, pairs), mjx.step)]
    least = [float("inf"), float("inf")]
    for _ in range(ROUNDS):
        for i, run in enumerate(runs):
            begun = clock()
            jax.block_until_ready(run(world, start).qpos)
            least[i] = min(least[i], clock() - begun)
    with_law, without = (1e3 * seconds / STEPS for seconds in least)
    print(
        f"| {name} | {worlds} | {with_law:.3g} | {without:.3g} | {with_law / without:.2f} |",
        flush=True,
    )


def land(pairs: Mapping[tuple[str, str], Any], worlds: int) -> None:
    """Print how quadrupeds, each with an e of its own, end after UNTIL_REST steps."""
    world = mjx.put_model(QUADRUPED)
    each = jax.vmap(restitution(QUADRUPED, pairs), in_axes=(None, 0, 0))
    values = jnp.repeat(jnp.linspace(0.0, 0.6, worlds)[:, None], len(pairs), axis=1)
    start = raised(QUADRUPED, LIFT, worlds)

    @jax.jit
    def run(data: Any) -> Any:
        def one(carry: Any, _: Any) -> Any:
            data, highest, lowest = carry
            data = each(world, data, values)
            depth = jnp.min(data._impl.contact.dist, axis=1)
            return (
                data,
                jnp.maximum(highest, data.qpos[:, 2]),
                jnp.minimum(lowest, depth),
            ), None

        none = jnp.full(worlds, -jnp.inf)
        return jax.lax.scan(one, (data, none, -none), length=UNTIL_REST)[0]

    jax.block_until_ready(run(start)[1])
    begun = time.perf_counter()
    data, highest, lowest = run(start)
    jax.block_until_ready(highest)
    took = time.perf_counter() - begun
    speed = np.abs(np.asarray(data.qvel)).max(axis=1)
    above = np.asarray(highest) - np.asarray(start.qpos[:, 2])
    print(
        f"\n{worlds} quadrupeds, e from 0 to 0.6, dropped {100 * LIFT:.0f} to "
        f"{100 * LIFT + 2:.0f} cm, {UNTIL_REST} steps in {took:.3g} s:\n"
        f"  {worlds * UNTIL_REST / took:.3g} world steps a second\n"
        f"  {np.count_nonzero(speed < 0.01)} rest: no velocity above 0.01 m/s or rad/s\n"
        f"  {np.count_nonzero(above > 1e-3)} rose above where they began, by {above.max():.2g} m\n"
        f"  largest penetration {-1e3 * np.asarray(lowest).min():.3g} mm, "
        f"at the end {-1e3 * np.asarray(data._impl.contact.dist).min():.3g} mm\n"
        f"  {np.count_nonzero(~np.isfinite(speed))} ended in NaN",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, nargs="*", default=[64])
    parser.add_argument("--rest", action="store_true")
    asked = parser.parse_args()
    feet = {(foot, "floor"): ConstantRestitution(0.3) for foot in FEET}
    print(f"{jax.devices()[0].device_kind}, JAX {jax.__version__}\n")
    print("| model | worlds | ms a step with the law | with `mjx.step` | ratio |")
    print("|---|---|---|---|---|")
    for worlds in asked.worlds:
        ball = mujoco.MjModel.from_xml_string(BALL)
        row("ball", ball, {("ball", "floor"): 0.3}, 0.0, worlds)
        row("quadruped, four feet", QUADRUPED, feet, LIFT, worlds)
    if asked.rest:
        land(feet, max(asked.worlds))


if __name__ == "__main__":
    main()
