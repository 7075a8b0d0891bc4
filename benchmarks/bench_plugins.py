"""The contact plug-ins: how near to the law, what becomes of energy, and what a step costs.

    python benchmarks/bench_plugins.py [--quick]

One line a claim: what must be, what was measured. e: worst error over the paper's four α, 1 ... 20 in/s, 8
phases of touch, sphere on plane and in the cup; speeds just before and just after the impact, what gravity
adds in that step not counted. Energy: its largest rise above the start, as a share of the start, over 10 s at
1, 2 and 5 ms, less what steps from the same states win with contact off. Costs: CPU time of rollouts on one
thread, in turns with MuJoCo's own contact, a spring-damper.
"""

from __future__ import annotations

import argparse
import copy
import statistics
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import contact_scenes as scenes
from test_plugin_mujoco import oblique

from hcbench.contact.mujoco import ConstantRestitution, HuntCrossley, Restitution
from hcbench.laws import closed_form
from hcbench.scene import load_scene
from hcbench.sim import registry
from hcbench.tune.evaluate import evaluate
from hcbench.tune.target import Target

INCH = 0.0254
ALPHAS = (0.002, 0.004, 0.008, 0.016)  # s/in
LAWS = [Restitution(0.315), Restitution(0.002), *(ConstantRestitution(e) for e in (1.0, 0.9, 0.5))]
Claim = tuple[str, str, float]  # what, must, measured
BALL = """<mujoco><option timestep="{h}" gravity="0 0 {g}" cone="elliptic"/><worldbody>
  <geom name="plate" type="plane" size="1 1 1" {contact}/>
  <body name="ball" pos="0 0 .0508"><freejoint/>
  <geom name="ball" size=".0508" mass=".45359237" {contact}/></body></worldbody></mujoco>"""


def e_of_recipes(quick: bool) -> Iterator[Claim]:
    """Spheres on a plane and in the cup, at held-out speeds and phases."""
    force = {1e-6: "1e-9", 1e-5: "3e-7", 2e-5: "1.5e-6"}
    rest = dict.fromkeys((1e-4, 1e-3, 4e-3), "1e-12")
    for recipe, musts in (("hunt-crossley", force), ("restitution-law", rest)):
        for h, must in musts.items():
            worst = 0.0
            for name in ("steel-plane", "steel-cup"):
                scene = load_scene(name)
                for alpha in ALPHAS[1:3] if quick else ALPHAS:
                    law = HuntCrossley(scene.stiffness, alpha / INCH, scene.exponent)
                    target = Target(law, scene.mass, h, INCH, 20 * INCH)
                    setting = registry.recipe(f"mujoco.{recipe}")(target)
                    worst = max(worst, evaluate(registry.engine("mujoco"), scene, setting, target).max_error)
            yield f"mujoco.{recipe}: error of e at {h:g} s", must, worst


def ball(h: float, gravity: float, contact: str = "") -> Any:
    return mujoco.MjSpec.from_string(BALL.format(h=h, g=-gravity, contact=contact))


def e_of_drops() -> Iterator[Claim]:
    """Drops of 1 ... 100 mm under gravity: e of the contact itself."""
    worst = 0.0
    for h in (1e-4, 1e-3, 4e-3):
        for alpha in ALPHAS:
            model = scenes.plugged(ball(h, 9.81), [("ball", "plate")], Restitution(alpha / INCH))
            for height in np.geomspace(1e-3, 0.1, 8):
                data = mujoco.MjData(model)
                data.qpos[2] += height
                while data.qvel[2] <= 0:
                    before = -float(data.qvel[2])
                    mujoco.mj_step(model, data)
                e = (float(data.qvel[2]) + 9.81 * h) / before
                worst = max(worst, abs(e - float(closed_form.restitution(alpha / INCH, before))))
    yield "mujoco restitution, drops of 1 ... 100 mm: error of e", "1e-9", worst


def oblique_impacts(count: int) -> Iterator[Claim]:
    """Random oblique, spinning, off-centre and box-corner impacts, in both cones."""
    for cone in ("pyramidal", "elliptic"):
        seen = np.array([oblique(seed, cone) for seed in range(count)])
        happened = int((seen[:, 2] > 0).sum())
        what = f"mujoco restitution, {happened} oblique impacts, {cone}"
        yield f"{what}: error of e", "1e-6", float(seen[:, 0].max())
        yield f"{what}: friction beyond its cone, N s", "1e-9", float((seen[:, 1] - seen[:, 2]).max())


def rise(scene: scenes.Scene, seconds: float) -> float:
    """Largest energy above the start's, less what steps with contact off would have won until then."""
    model = scene.model()
    data = scene.data(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    start = float(data.energy.sum())
    own, highest, before = 0.0, 0.0, start
    free, alone = copy.copy(model), mujoco.MjData(model)
    free.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    for _ in range(round(seconds / model.opt.timestep)):
        alone.qpos[:], alone.qvel[:] = data.qpos, data.qvel
        mujoco.mj_step(free, alone)
        mujoco.mj_forward(free, alone)
        own += max(0.0, float(alone.energy.sum()) - before)
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        now = float(data.energy.sum())
        highest, before = max(highest, now - start - own), now
    broken = any(warning.number for warning in data.warning)
    return np.inf if broken else highest / max(abs(start), 1e-9)


def energies(quick: bool) -> Iterator[Claim]:
    """Rows, cradles, a rack, stacks and piles."""
    seconds, steps = (1.0, (2e-3,)) if quick else (10.0, (1e-3, 2e-3, 5e-3))
    kinds: dict[str, Any] = {
        "rows of 3 ... 10 touching balls": lambda h, law: [
            scenes.row(n, h, law) for n in (3, 4, 5, 6, 8, 10)
        ],
        "cradle": lambda h, law: [scenes.cradle(5, h, law)],
        "rack of ten at 3 m/s": lambda h, law: [scenes.rack(h, law)],
        "stacks of 3 ... 10 boxes": lambda h, law: [scenes.stack(n, h, law) for n in (3, 5, 10)],
        "tumbling cubes": lambda h, law: [
            scenes.tumbling(seed, h, law, mu, cone, size=(0.05,) * 3)
            for seed, mu in enumerate((0.0, 1e-4, 1e-3, 0.01, 0.5))
            for cone in ("pyramidal", "elliptic")
        ],
    }
    for name, make in kinds.items():
        worst = max(rise(one, seconds) for h in steps for law in LAWS for one in make(h, law))
        yield f"mujoco restitution, {name}: energy won", "1e-9", worst
    piles = [
        scenes.pile(seed, steps[seed % len(steps)], LAWS[seed % 5]) for seed in range(5 if quick else 20)
    ]
    yield (
        f"mujoco restitution, {len(piles)} piles, implicit: energy won",
        "1e-9",
        max(rise(one, seconds) for one in piles),
    )


def drift(seconds: float) -> Iterator[Claim]:
    """A stack of five boxes at rest."""
    for h in (1e-3, 2e-3, 5e-3):
        for law, who in ((scenes.HALF, "e = .5"), (None, "native")):
            seen = scenes.run(scenes.stack(5, h, law), seconds)
            upright = scenes.RADIUS * (2 * np.arange(5) + 1)
            off = np.abs(seen.data.qpos.reshape(-1, 7)[:, :3] - np.c_[upright * 0, upright * 0, upright])
            yield f"mujoco, stack of five, {who}, {h:g} s: off where it began, m", "1e-3", float(off.max())


def costs(rounds: int) -> Iterator[Claim]:
    """A step in contact, over MuJoCo's own contact."""
    stiff = 'condim="1" solref="-2.679e8 -815" solimp=".9999 .9999 .001 .5 2"'
    for name, law, h, speed, extra in (
        ("force law", HuntCrossley(3.4064e10, 0.315), 1e-6, 0.2, stiff),
        ("force law", HuntCrossley(3.4064e10, 0.315), 1e-5, 0.2, stiff),
        ("restitution, at rest", Restitution(0.315), 1e-3, 0.0, 'condim="3"'),
        ("restitution, bouncing", ConstantRestitution(1.0), 1e-3, 0.02, 'condim="3"'),
    ):
        models = [
            ball(h, 0.0 if speed == 0.2 else 9.81, extra).compile(),
            scenes.plugged(ball(h, 0.0 if speed == 0.2 else 9.81, extra), [("ball", "plate")], law),
        ]
        steps = int(2.2e-4 / h) if speed == 0.2 else 400
        data = mujoco.MjData(models[0])
        full = mujoco.mjtState.mjSTATE_FULLPHYSICS
        starts = np.zeros((64, mujoco.mj_stateSize(models[0], full)))
        for one, phase in zip(starts, np.linspace(0, 1, 64), strict=True):
            data.qpos[2], data.qvel[2] = 0.0508 + phase * h * speed - 1e-9, -speed
            mujoco.mj_getState(models[0], data, one, full)
        taken: list[list[float]] = []
        for _ in range(rounds):
            taken.append([])
            for model in models:
                one, began = mujoco.MjData(model), time.process_time()
                mujoco.rollout.rollout(model, one, starts, nstep=steps)
                taken[-1].append((time.process_time() - began) / steps / len(starts))
        ratio = statistics.median(b / a for a, b in taken)
        took = statistics.median(b for _, b in taken)
        yield f"mujoco {name}, {h:g} s: {1e6 * took:.2f} us a step, over native contact", "1", ratio


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer α, 1 s instead of 10 s")
    quick = parser.parse_args().quick
    print(f"mujoco {mujoco.__version__}\n{'':84s} {'must':>8s} {'is':>8s}")
    for claims in (
        e_of_recipes(quick),
        e_of_drops(),
        oblique_impacts(100 if quick else 500),
        energies(quick),
        drift(1.0 if quick else 10.0),
        costs(7 if quick else 21),
    ):
        for what, must, measured in claims:
            print(
                f"{what:84s} {must:>8s} {measured:8.2g}{'' if measured <= float(must) else '  FALLS SHORT'}",
                flush=True,
            )


if __name__ == "__main__":
    main()
