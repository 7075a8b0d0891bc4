"""The contact plug-ins: how near to the law, what becomes of energy, and what a step costs.

    python benchmarks/bench_plugins.py [--quick] [--costs]

One line a claim: what must be, what was measured. e: worst error over the paper's four α, 1 ...
20 in/s, 8 phases of touch, sphere on plane and in the cup; under gravity of the speeds at the
touch plane. Energy, as flight keeps it: its largest rise above the start, as a share of the
start, over 10 s at 1, 2 and 5 ms, less what steps from the same states win with contact off.
Costs: CPU time, in turns with MuJoCo's own contact, a spring-damper (rollouts on one thread), and
with a bare stepSimulation of PyBullet's. --costs measures steps with many contacts and robots
alone, and writes their table into README.md, and the ratios of MuJoCo into
docs/reference/plugins.md.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "engines" / "mujoco"))

import bullet_scenes
import contact_scenes as scenes
from _many_contacts import in_bullet_steps, in_mujoco_steps, robots_settle
from gain_tables import write_table
from test_plugin_mujoco import oblique

from hcbench.contact.mujoco import ConstantRestitution, HuntCrossley, Restitution
from hcbench.laws import closed_form
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.terms.impact import Launch
from hcbench.terms.scene import load_scene
from hcbench.tuning.evaluate import evaluate

INCH = 0.0254
ALPHAS = (0.002, 0.004, 0.008, 0.016)  # s/in
LAWS = [Restitution(0.315), Restitution(0.002), *(ConstantRestitution(e) for e in (1.0, 0.9, 0.5))]
Claim = tuple[str, str, float]  # what, must, measured
README = Path(__file__).with_name("README.md")
BEGIN, END = "<!-- begin costs -->", "<!-- end costs -->"
FALLS_SHORT = " (falls short)"
BALL = """<mujoco><option timestep="{h}" gravity="0 0 {g}" cone="elliptic"/><worldbody>
  <geom name="plate" type="plane" size="1 1 1" {contact}/>
  <body name="ball" pos="0 0 .0508"><freejoint/>
  <geom name="ball" size=".0508" mass=".45359237" {contact}/></body></worldbody></mujoco>"""


def e_of_recipes(engine: str, quick: bool) -> Iterator[Claim]:
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
                    setting = registry.recipe(f"{engine}.{recipe}")(target)
                    worst = max(
                        worst, evaluate(registry.engine(engine), scene, setting, target).max_error
                    )
            yield f"{engine}.{recipe}: error of e at {h:g} s", must, worst


def ball(h: float, gravity: float, contact: str = "") -> Any:
    return mujoco.MjSpec.from_string(BALL.format(h=h, g=-gravity, contact=contact))


def e_of_drops(engine: str) -> Iterator[Claim]:
    """Drops of 1 ... 100 mm under gravity: e of the speeds at the touch plane."""
    worst, scene = 0.0, replace(load_scene("steel-plane"), gravity=9.81)
    for h in (1e-4, 1e-3, 4e-3):
        for alpha in ALPHAS:
            law = HuntCrossley(scene.stiffness, alpha / INCH, scene.exponent)
            target = Target(law, scene.mass, h, INCH, 20 * INCH, gravity=scene.gravity)
            setting = registry.recipe(f"{engine}.restitution-law")(target)
            drops = [Launch(0.0, 0.5, float(height)) for height in np.geomspace(1e-3, 0.1, 8)]
            for impact in registry.engine(engine).run(scene, setting, drops):
                e = float(closed_form.restitution(law.alpha, impact.speed_in))
                worst = max(worst, abs(impact.restitution - e))
    yield f"{engine} restitution, drops of 1 ... 100 mm: error of e", "1e-9", worst


def oblique_impacts(count: int) -> Iterator[Claim]:
    """Random oblique, spinning, off-centre and box-corner impacts, in both cones."""
    kinds: dict[str, Any] = {
        f"mujoco restitution, {cone}": partial(oblique, cone=cone)
        for cone in ("pyramidal", "elliptic")
    }
    for who, one in {**kinds, "pybullet restitution": bullet_scenes.oblique}.items():
        seen = np.array([one(seed) for seed in range(count)])
        what = f"{who}, {int((seen[:, 0] > 0).sum())} oblique impacts"
        yield f"{what}: error of e", "1e-6", float(seen[:, 0].max())
        yield (
            f"{what}: friction beyond its cone, N s",
            "1e-9",
            float((seen[:, 1] - seen[:, 2]).max()),
        )


def energies(engine: str, quick: bool) -> Iterator[Claim]:
    """Rows, cradles, a rack, stacks and piles."""
    seconds, steps = (1.0, (2e-3,)) if quick else (10.0, (1e-3, 2e-3, 5e-3))
    made: Any = scenes if engine == "mujoco" else bullet_scenes
    cones = [{"cone": "pyramidal"}, {"cone": "elliptic"}] if engine == "mujoco" else [{}]
    kinds: dict[str, list[Any]] = {
        "rows of 3 ... 10 touching balls": [partial(made.row, n) for n in (3, 4, 5, 6, 8, 10)],
        "cradle": [partial(made.cradle, 5)],
        "rack of ten at 3 m/s": [made.rack],
        "stacks of 3 ... 10 boxes": [partial(made.stack, n) for n in (3, 5, 10)],
        "tumbling cubes": [
            partial(made.tumbling, seed, friction=mu, size=(0.05,) * 3, **cone)
            for seed, mu in enumerate((0.0, 1e-4, 1e-3, 0.01, 0.5))
            for cone in cones
        ],
    }
    if engine == "mujoco":
        held: list[dict[str, bool]] = [{}, {"limited": True}, {"geared": True}]
        kinds["chains, free, limited and geared"] = [
            partial(scenes.chain, seed, integrator="implicit", **one)
            for seed in range(2)
            for one in held
        ]
    won = scenes.rise if engine == "mujoco" else bullet_scenes.rise
    for name, several in kinds.items():
        worst = max(
            won(lambda law, one=one, h=h: one(h=h, law=law), law, seconds)
            for h in steps
            for law in LAWS
            for one in several
        )
        yield f"{engine} restitution, {name}: energy won", "1e-9", worst
    count = 5 if quick else 20
    worst = max(
        won(partial(made.pile, seed, steps[seed % len(steps)]), LAWS[seed % 5], seconds)
        for seed in range(count)
    )
    yield f"{engine} restitution, {count} piles: energy won", "1e-9", worst


def drift(seconds: float) -> Iterator[Claim]:
    """A stack of five boxes at rest."""
    upright = np.outer(scenes.RADIUS * (2 * np.arange(5) + 1), [0, 0, 1])
    for h in (1e-3, 2e-3, 5e-3):
        for law, who in ((scenes.HALF, "e = 0.5"), (None, "native")):
            seen = scenes.run(scenes.stack(5, h, law), seconds)
            made = bullet_scenes.stack(5, h, law)
            made.step(round(seconds / h))
            for engine, at in (
                ("mujoco", seen.data.qpos.reshape(-1, 7)[:, :3]),
                ("pybullet", made.state()[0]),
            ):
                off = float(np.abs(at - upright).max())
                yield f"{engine}, stack of five, {who}, {h:g} s: off where it began, m", "1e-3", off
            made.close()


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


def costs_in_bullet(rounds: int) -> Iterator[Claim]:
    """A step in contact, over the bare step of a ball in flight."""
    laws = {
        "bare": (1e-6, None, 1.0, 0.0, 0.0),
        "own contact, at rest": (1e-3, None, 0.0, 9.81, 0.0),
        "force law": (1e-6, HuntCrossley(3.4064e10, 0.315), -1e-9, 0.0, 0.2),
        "restitution, at rest": (1e-3, Restitution(0.315), 0.0, 9.81, 0.0),
        "restitution, bouncing": (1e-3, ConstantRestitution(1.0), 1e-5, 9.81, 0.02),
    }
    made = {}
    for name, (h, law, gap, gravity, speed) in laws.items():
        scene = bullet_scenes.Scene(h, law, gravity, floor=False)
        scene.floor = scene.body((0, 0, 0), np.inf, mass=0)
        scene.body((0, 0, bullet_scenes.RADIUS + gap), mass=0.45359237, velocity=(0, 0, -speed))
        made[name] = scene.ready()
    taken: dict[str, list[float]] = {name: [] for name in laws}
    for _ in range(rounds):
        for name, scene in made.items():
            _, _, gap, _, speed = laws[name]
            began = 0.0
            for _ in range(10):
                scene.put(0, (0, 0, bullet_scenes.RADIUS + gap), (0, 0, -speed))
                began -= time.process_time()
                scene.step(200)
                began += time.process_time()
            taken[name].append(began / 2000)
    for name, must in (
        ("own contact, at rest", "inf"),
        ("force law", "2"),
        ("restitution, at rest", "3.2"),
        ("restitution, bouncing", "3.2"),
    ):
        ratio = statistics.median(a / b for a, b in zip(taken[name], taken["bare"], strict=True))
        took = 1e6 * statistics.median(taken[name])
        yield (
            f"pybullet {name}, {laws[name][0]:g} s: {took:.2f} us a step, over the bare step",
            must,
            ratio,
        )


def costs_of_many(rounds: int) -> Iterator[Claim]:
    """Many contacts in one step."""
    for steps in (in_mujoco_steps, robots_settle, in_bullet_steps):
        for what, must, ratio in steps(rounds):
            yield what, f"{must:g}", ratio


def write_costs(claims: list[Claim]) -> None:
    """Write the table of costs into README.md."""
    rows = ["| what | must | is |", "|---|---|---|"]
    for what, must, measured in claims:
        limit = "" if must == "inf" else must
        rows.append(
            f"| {what} | {limit} | {measured:.2g}{FALLS_SHORT if measured > float(must) else ''} |"
        )
    before, _, rest = README.read_text(encoding="utf-8").partition(BEGIN)
    table = "\n".join([BEGIN, "", *rows, "", END])
    README.write_text(before + table + rest.partition(END)[2], encoding="utf-8")
    ratios = ["| MuJoCo, a step | over native contact |", "|---|---|"]
    for what, _, measured in claims:
        if what.startswith("mujoco") and "over native" in what:
            ratios.append(f"| {_of_page(what)} | {measured:.2f} |")
    write_table("costs", ratios)


def _of_page(what: str) -> str:
    """The row's name on the page, without the time of this machine."""
    return what.removeprefix("mujoco ").partition(": ")[0]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="fewer α, 1 s instead of 10 s")
    parser.add_argument(
        "--costs", action="store_true", help="only what steps cost; writes README.md"
    )
    given = parser.parse_args()
    quick = given.quick
    print(f"mujoco {mujoco.__version__}, pybullet {registry.engine('pybullet').version()}")
    print(f"{'':84s} {'must':>8s} {'is':>8s}")
    many = costs_of_many(3 if quick else 7)
    found: list[Claim] = []
    for claims in (
        [many]
        if given.costs
        else (
            e_of_recipes("mujoco", quick),
            e_of_recipes("pybullet", quick),
            e_of_drops("mujoco"),
            e_of_drops("pybullet"),
            oblique_impacts(100 if quick else 500),
            energies("mujoco", quick),
            energies("pybullet", quick),
            drift(1.0 if quick else 10.0),
            costs(7 if quick else 21),
            costs_in_bullet(7 if quick else 21),
            many,
        )
    ):
        for what, must, measured in claims:
            print(
                f"{what:84s} {must:>8s} {measured:8.2g}{FALLS_SHORT if measured > float(must) else ''}",
                flush=True,
            )
            found.append((what, must, measured))
    if given.costs:
        write_costs(found)


if __name__ == "__main__":
    main()
