"""Promises of `hcbench tune` at the steps of robots, judged in the plain
engines: must beside measured.

    python benchmarks/bench_tune.py                      # the table: gravity, friction,
    rest; a minute pip install "mujoco[sysid]"                          # for the second
    row of python benchmarks/bench_tune.py --searches SECONDS   # recipes beside
    mujoco.sysid and SciPy, same target

Settings are pasted into models of their own and stepped by loops that share no code with hcbench
(`_bounces.py`), at 150 random speeds, phases and slips that no fit saw, under gravity.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from _bounces import G, bounce, box, mujoco_model, pybullet_bounces, rest
from _searches import methods, paste, searched

from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target, minimax_constant
from hcbench.system.errors import SettingError
from hcbench.terms.scene import load_scene
from hcbench.tuning.find import tune
from hcbench.tuning.model import snippet
from hcbench.tuning.tuned import Tuned

SCENE = load_scene("steel-plane")
ALPHA, BAND, MU, DROP = 0.315, (0.1, 3.0), 0.5, 0.02
_judged: list[Case] = []
RUBBER = ((0.1, 0.98), (0.5, 0.91), (1.0, 0.84), (2.0, 0.75), (3.0, 0.67))
NATIVE = "compliant-pairs"
Row = tuple[str, str, str]  # what, must, is


def at_random(lowest: float, highest: float, count: int = 150) -> list[tuple[float, float, float]]:
    """(speed, phase, slip), the lowest speed among them."""
    random = np.random.default_rng(1975)
    speeds = random.uniform(lowest, highest, count)
    speeds[:10] = lowest
    return list(zip(speeds, random.uniform(0, 1, count), random.uniform(0, 3, count), strict=True))


@dataclass(frozen=True)
class Case:
    """A target, and the recipe for it."""

    target: Target
    recipe: str = NATIVE

    @property
    def band(self) -> tuple[float, float]:
        return self.target.speed_min, self.target.speed_max

    def tuned(self) -> Tuned:
        return _tuned(self)

    def paste(self) -> str:
        return snippet(self.tuned().setting, "plane")

    def largest_errors(self) -> tuple[float, float]:
        """Largest errors of e and of friction in the plain engine."""
        _judged.append(self)
        return _largest_errors(self)


@cache
def _tuned(case: Case) -> Tuned:
    return tune("mujoco", case.target, SCENE, case.recipe)


@cache
def _largest_errors(case: Case) -> tuple[float, float]:
    return max_errors(mujoco_model(case.paste()), case)


def max_errors(model: Any, case: Case) -> tuple[float, float]:
    """Errors of e and of friction's impulse, at random launches over the case's band."""
    mu, launches = case.target.friction, at_random(*case.band)
    bounces = [bounce(model, v, phase, slip if mu else 0.0, mu) for v, phase, slip in launches]
    off = [
        abs(b.e - float(case.target.curve.at(v)))
        for b, (v, *_) in zip(bounces, launches, strict=True)
    ]
    return max(off), max(b.friction for b in bounces)


def case(
    alpha: float = ALPHA,
    timestep: float = 2e-3,
    friction: float = 0.0,
    band: tuple[float, float] = BAND,
    points: tuple[tuple[float, float], ...] = (),
    recipe: str = NATIVE,
    corners: int = 1,
) -> Case:
    law = HuntCrossley(SCENE.stiffness, alpha, SCENE.exponent)
    reading = "points" if points else "law"
    wanted = Target(
        law,
        SCENE.mass,
        timestep,
        *band,
        reading,
        points,
        gravity=G,
        friction=friction,
        corners=corners,
    )
    return Case(wanted, recipe)


def falling() -> Iterator[Row]:
    for h, most, sliding in ((1e-3, 0.022, 0.03), (2e-3, 0.04, 0.045), (5e-3, 0.065, 0.08)):
        at = f"MuJoCo native e(v), {1e3 * h:g} ms, 0.1 ... 3 m/s, α 0.315 s/m"
        yield at, f"{most}", f"{case(timestep=h).largest_errors()[0]:.4f}"
        e, friction = case(timestep=h, friction=MU).largest_errors()
        yield (
            f"{at}, μ 0.5, slip to 3 m/s: e; friction",
            f"{sliding}; 0.05",
            f"{e:.4f}; {friction:.4f}",
        )
    for alpha, most in ((0.05, 0.042), (0.1, 0.0215), (0.165, 0.0261), (0.3, 0.031)):
        yield (
            f"the same at 2 ms, α {alpha} s/m",
            f"{most}",
            f"{case(alpha).largest_errors()[0]:.4f}",
        )
    e = case(points=RUBBER).largest_errors()[0]
    yield "the same through five --points of rubber", "0.0276", f"{e:.4f}"
    e = case(band=(0.0254, 0.508)).largest_errors()[0]
    yield "the same, α 0.315 s/m, 1 ... 20 in/s (calm at rest)", "0.0711", f"{e:.4f}"


def resting() -> Iterator[Row]:
    for h, deep, buzz in ((1e-3, 0.1, 1), (2e-3, 0.3, 10), (5e-3, 1.0, 300)):
        for alpha, drop in ((ALPHA, DROP), (0.1, 0.0), (0.05, 0.0)):
            depth, swing = rest(mujoco_model(case(alpha, h, MU).paste()), drop)
            how = "after 2 cm of fall" if drop else "let down"
            what = f"at rest, {1e3 * h:g} ms, α {alpha:g} s/m, {how}: depth; peak to peak in the 6th second"
            yield what, f"{deep} mm; {buzz} µm", f"{1e3 * depth:.3f} mm; {1e6 * swing:.2f} µm"
    for h in (1e-3, 2e-3, 5e-3):
        for corners in (1, 4):
            model = mujoco_model(case(timestep=h, friction=MU, corners=corners).paste(), 0.1, "box")
            ends = [box(model, tilt, slip) for tilt, slip in ((0.0, 0.0), (0.3, 0.0), (0.7, 1.0))]
            energy, drift = (max(column) for column in zip(*ends, strict=True))
            what = f"box of 20 cm, {1e3 * h:g} ms, --corners {corners}: energy over the first; drift in 5 s"
            yield what, "1; 1 mm", f"{energy:.6f}; {1e3 * drift:.3f} mm"


def constant() -> Iterator[Row]:
    one = case(points=((0.3, 0.9),), friction=MU, band=(0.3, 3.0), recipe="compliant")
    e, friction = one.largest_errors()
    yield (
        "constant e = 0.9, 2 ms, 0.3 ... 3 m/s, μ 0.5: e; friction",
        "0.06; 0.04",
        f"{e:.4f}; {friction:.4f}",
    )
    target = case(points=((0.1, 0.9),), timestep=1 / 240, friction=MU).target
    setting = tune("pybullet", target, SCENE, "restitution").setting
    bounces = pybullet_bounces(snippet(setting, "plane"), at_random(*BAND), MU)
    e, friction = max(abs(b.e - 0.9) for b in bounces), max(b.friction for b in bounces)
    what = (
        "PyBullet restitution, 1/240 s, μ 0.5, read by the speed the step starts with: e; friction"
    )
    yield what, "1e-6", f"{e:.1e}; {friction:.1e}"


def printed() -> Iterator[Row]:
    """Over all that was judged until now; e and friction within the same share."""
    pairs = [(one.largest_errors(), one.tuned().evaluation) for one in set(_judged)]
    shares = [errors[0] / said.max_error for errors, said in pairs]
    rubbing = [errors[1] / said.friction_error for errors, said in pairs if errors[1] > 0]
    within = f"{max(shares):.3f}; {max(rubbing):.3f} (least {min(shares):.2f}; {min(rubbing):.2f})"
    yield "worst found here over what tune prints: e; friction", "1.1; 1.1", within
    start = time.process_time()
    tune("mujoco", case(0.23).target, SCENE, NATIVE)
    took = time.process_time() - start
    text = case().paste()
    sizes = f"{text.count('<pair')}; {text.count('<geom')}; {took:.2f} s"
    yield "<pair> elements; geoms added; time of fit and evaluation", "2; 0; 10 s", sizes


def searches(budget: float) -> None:
    """Recipes beside what one would do without them, for the same target at 2 ms."""
    print("| how | time, s | trials | largest error of e |\n|---|---|---|---|")
    wanted = case().target
    for name in (NATIVE, "compliant", "impulse", "soft"):
        start = time.process_time()
        try:
            error = case(recipe=name).largest_errors()[0]
        except SettingError as refused:
            print(f"| hcbench {name} | - | - | {refused} |")
            continue
        print(
            f"| hcbench {name} | {time.process_time() - start:.2f} | - | {error:.3f} |", flush=True
        )
    for title, method in methods().items():
        loop = searched(method, wanted.curve, wanted.timestep, budget)
        error = max_errors(mujoco_model(paste(loop.best[1], wanted.timestep)), case())[0]
        print(f"| {title} | {budget:g} | {loop.calls} | {error:.3f} |", flush=True)
    print(f"| the best constant e, at no phase off | - | - | {minimax_constant(wanted)[1]:.3f} |")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--searches", type=float, metavar="SECONDS", help="for each search")
    budget = parser.parse_args().searches
    if budget:
        searches(budget)
        return
    print("| what | must | is |\n|---|---|---|")
    for rows in (falling, resting, constant, printed):
        for row in rows():
            print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
