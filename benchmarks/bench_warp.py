"""Time of a world's step with `hcbench.contact.warp` over that of `mujoco_warp.step`, many worlds.

    pip install mujoco-warp && python benchmarks/bench_warp.py [--device cuda:0] [--worlds 1,64]

On a GPU both are captured as graphs, and measured by the clock; on a CPU by processor time. Both are
compiled before, and measured in turn, three times each; the least of each counts. Then 4 096
quadrupeds are dropped, each with an e of its own: they must rest, and gain no energy.

Warp compiles some 70 kernels when first used: half a minute on a CPU, a few minutes on a GPU.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp

from hcbench.contact.warp import ConstantRestitution, restitution

# A landing and half of the time until rest, at 2 ms.
STEPS = 150
ROUNDS = 3
# Seconds until every quadruped is at rest.
REST = 3.0
BALL = """<mujoco><option timestep=".002"/><worldbody><geom name="floor" type="plane" size="5 5 .1"/>
<body name="ball" pos="0 0 .1"><freejoint/><geom name="ball" size=".05"/></body></worldbody></mujoco>"""
QUADRUPED = Path(__file__).parents[1] / "examples" / "quadruped.xml"
FEET = [f"{side}_{end}_foot" for side in ("left", "right") for end in ("front", "hind")]

Step = Callable[..., None]


class Worlds:
    """Worlds of a model that are dropped from heights of their own."""

    def __init__(self, model: mujoco.MjModel, worlds: int, lift: float) -> None:
        """Put each into the model's first pose, `lift` (m) above it and up to 2 cm more."""
        self.m = mjw.put_model(model)
        self.d = mjw.make_data(model, nworld=worlds, nconmax=8, njmax=48)
        qpos = np.tile(model.qpos0, (worlds, 1))
        qpos[:, 2] += lift + np.linspace(0.0, 0.02, worlds)
        self._start = wp.array(qpos, dtype=float)

    def drop(self) -> None:
        """Put all worlds back to where they began, at rest."""
        wp.copy(self.d.qpos, self._start)
        for array in (self.d.qvel, self.d.qacc, self.d.qacc_warmstart, self.d.qfrc_smooth):
            array.zero_()
        self.d.nacon.zero_()

    def ready(self, step: Step) -> Callable[[], None]:
        """A step of all worlds, compiled, and on a GPU captured as a graph."""
        self.drop()
        run = partial(step, self.m, self.d)
        run()
        if not wp.get_device().is_cuda:
            return run
        with wp.ScopedCapture() as capture:
            run()
        return partial(wp.capture_launch, capture.graph)


def seconds(worlds: Worlds, run: Callable[[], None]) -> float:
    """Time of STEPS steps from the start: of the clock on a GPU, of the processor on a CPU."""
    clock = time.perf_counter if wp.get_device().is_cuda else time.process_time
    worlds.drop()
    wp.synchronize()
    begun = clock()
    for _ in range(STEPS):
        run()
    wp.synchronize()
    return clock() - begun


def row(name: str, model: mujoco.MjModel, step: Step, count: int, lift: float) -> str:
    """A line of the table: µs of a world's step by the engine alone and with the law, and how many
    times as long it takes.
    """
    worlds = Worlds(model, count, lift)
    runs = [worlds.ready(each) for each in (mjw.step, step)]
    least = [float("inf")] * 2
    for _ in range(ROUNDS):
        for i, run in enumerate(runs):
            least[i] = min(least[i], seconds(worlds, run))
    own, law = (1e6 * each / STEPS / count for each in least)
    return f"| {name} | {count} | {own:.3g} | {law:.3g} | {law / own:.2f} |"


def landing(pairs: Mapping[tuple[str, str], Any], count: int) -> str:
    """Sentence about quadrupeds that are dropped, each with an e of its own.

    Exits where one does not rest, or gains energy: by its impacts, whose kinetic energies before
    them are those of a twin with the engine's own forward dynamics, or above that of its start.
    """
    model = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    worlds, twins = Worlds(model, count, 0.1), Worlds(model, count, 0.1)
    e = np.random.default_rng(48).uniform(0.0, 0.8, (count, 1))
    values = wp.array(np.tile(e, (1, len(pairs))), dtype=float)
    law = restitution(model, pairs)

    def both(m: Any, d: Any) -> None:
        """Take the energies of the state, then a step."""
        wp.copy(twins.d.qpos, d.qpos)
        wp.copy(twins.d.qvel, d.qvel)
        mjw.forward(twins.m, twins.d)
        law(m, d, values)

    run = worlds.ready(both)
    worlds.drop()
    stiffness = model.actuator_gainprm[:, 0]
    by_impact, total = [], []
    for _ in range(int(REST / model.opt.timestep)):
        hinges = worlds.d.qpos.numpy()[:, 7:].astype(float)
        run()
        energy = worlds.d.energy.numpy().astype(float)
        by_impact.append(energy[:, 1] - twins.d.energy.numpy()[:, 1])
        total.append(energy.sum(axis=1) + hinges**2 @ stiffness / 2)
    fall = total[0].mean() - total[-1].mean()
    gained = np.max(by_impact) / fall
    above = np.max(np.array(total) - total[0]) / fall
    speed = np.abs(worlds.d.qvel.numpy()).max()
    height = worlds.d.qpos.numpy()[:, 2]
    text = (
        f"{count} quadrupeds with e from 0 to 0.8: after {REST:g} s the fastest of {model.nv} speeds "
        f"is {speed:.2g} (m/s or rad/s), trunks are at {height.min():.4f} ... {height.max():.4f} m. "
        f"The most energy that an impact adds is {gained:.1g} of the {fall:.2f} J of the fall; no "
        f"world has more than {above:.1g} of it above its start."
    )
    if worlds.d.overflow.numpy().any():
        sys.exit(f"{text}\nA world has more contacts than there is room for.")
    # Velocities are those of a step's start, and impacts are passive half a step of weight later:
    # an impulse of 1 N s may add g h/2 times itself, 10 mJ at 2 ms.
    if not (speed < 0.05 and gained < 1e-3 and above < 1e-4):
        sys.exit(
            f"{text}\nThey must rest below 0.05, add less than 0.001, and stay below the start."
        )
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--device", help="Warp's name of a device; default: the one it prefers")
    parser.add_argument(
        "--worlds", help="numbers of worlds; default: 1,64,1024,4096, more on a GPU"
    )
    parser.add_argument("--landing", type=int, default=4096, help="quadrupeds to drop; 0 for none")
    given = parser.parse_args()
    wp.config.quiet = True
    device = wp.get_device(given.device) if given.device else wp.get_preferred_device()
    wp.set_device(device)
    counts = given.worlds or ("1,64,1024,4096,16384" if device.is_cuda else "1,64,1024,4096")
    begun = time.perf_counter()
    ball, quadruped = (
        mujoco.MjModel.from_xml_string(BALL),
        mujoco.MjModel.from_xml_path(str(QUADRUPED)),
    )
    feet = {(foot, "floor"): ConstantRestitution(0.3) for foot in FEET}
    models = {
        "ball": (ball, restitution(ball, {("ball", "floor"): 0.3}), 0.0),
        "quadruped, four feet": (quadruped, restitution(quadruped, feet), 0.05),
    }
    print(f"{device.name}, Warp {wp.__version__}, MuJoCo Warp {mjw.__version__}\n")
    print("| model | worlds | `mujoco_warp.step`, µs a world | with the law, µs | ratio |")
    print("|---|---|---|---|---|")
    for name, (model, step, lift) in models.items():
        for count in map(int, counts.split(",")):
            print(row(name, model, step, count, lift), flush=True)
    print(f"\n{time.perf_counter() - begun:.0f} s with compiling")
    if given.landing:
        print("\n" + landing(feet, given.landing))


if __name__ == "__main__":
    main()
