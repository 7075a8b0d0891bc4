"""Tuning solref and solimp: hcbench beside what a user would do today, on the same work and target.

    pip install "mujoco[sysid]"            # for the second row; left out where it is missing
    python benchmarks/bench_tune.py [--budget SECONDS]

Target: e of (16) for α = 0.008 s/in over 1 ... 20 in/s, steel on its plate, step 1e-5 s. The searches see six
speeds through a Python step loop, as one writes it; all are judged by hcbench at held-out speeds, 8 phases.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.optimize import differential_evolution

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.scene import load_scene
from hcbench.setting import Setting
from hcbench.sim import registry
from hcbench.tune.evaluate import evaluate
from hcbench.tune.target import Target

SCENE = load_scene("steel-plane")
LAW = HuntCrossley(SCENE.stiffness, 0.008 / 0.0254, SCENE.exponent)
STEP = 1e-5
TARGET = Target(LAW, SCENE.mass, STEP, 0.0254, 0.508)
SPEEDS = np.linspace(0.0254, 0.508, 6)
WANTED = closed_form.restitution(LAW.alpha, SPEEDS)
XML = """
<mujoco><option timestep="1e-5" gravity="0 0 0"/><worldbody>
  <geom name="plate" type="plane" size="1 1 .1" condim="1"/>
  <body pos="0 0 .0508"><joint type="slide" axis="0 0 1"/>
    <geom name="ball" type="sphere" size=".0508" mass="0.45359237" condim="1"/></body>
</worldbody></mujoco>"""
# log10 stiffness, log10 damping, d0, dwidth, log10 width, midpoint, power
LOW = np.array([6.0, 0.0, 1e-4, 0.05, -6.0, 0.1, 1.0])
HIGH = np.array([10.0, 4.0, 0.9999, 0.9999, -3.0, 0.9, 20.0])
START = np.array([8.4, 2.9, 0.9, 0.95, -3.0, 0.5, 2.0])  # a spring-damper with MuJoCo's default solimp


class OutOfTimeError(Exception):
    """The search has had its budget."""


@dataclass
class StepLoop:
    """Residuals of e by a plain Python loop over mj_step; keeps the best, stops at the deadline."""

    deadline: float

    def __post_init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(XML)
        self.data = mujoco.MjData(self.model)
        self.best = (np.inf, START)
        self.calls = 0

    def __call__(self, x: np.ndarray) -> np.ndarray:
        if time.perf_counter() > self.deadline:
            raise OutOfTimeError
        self.calls += 1
        solref, solimp = words(x)
        self.model.geom_solref[:] = solref
        self.model.geom_solimp[:] = solimp
        off = np.array([self.bounce(v) for v in SPEEDS]) - WANTED
        if np.abs(off).max() < self.best[0]:
            self.best = (float(np.abs(off).max()), np.array(x))
        return off

    def bounce(self, speed: float) -> float:
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[0], self.data.qvel[0] = 2.5 * STEP * speed, -speed
        for _ in range(600):
            mujoco.mj_step(self.model, self.data)
            if self.data.qvel[0] > 0 and self.data.qpos[0] > 0:
                return float(self.data.qvel[0] / speed)
        return 0.0


def words(x: np.ndarray) -> tuple[list[float], list[float]]:
    k, b, d0, dw, width, midpoint, power = (float(v) for v in x)
    return [-(10**k), -(10**b)], [d0, dw, 10**width, midpoint, power]


def search(method: Callable[[StepLoop], None], budget: float) -> tuple[Setting, int]:
    loop = StepLoop(time.perf_counter() + budget)
    with suppress(OutOfTimeError):
        method(loop)
    solref, solimp = words(loop.best[1])
    row = {"solref": solref, "solimp": solimp, "onset": 0.0, "adhesion": 0.0}
    return Setting("mujoco", "search", STEP, {"integrator": "Euler", "rows": [row]}), loop.calls


def by_evolution(loop: StepLoop) -> None:
    bounds = list(zip(LOW, HIGH, strict=True))
    differential_evolution(lambda x: np.abs(loop(x)).max(), bounds, seed=1, x0=START, popsize=10, tol=0)


def by_sysid(loop: StepLoop) -> None:
    from mujoco import sysid

    parameters = sysid.ParameterDict()
    parameters.add(sysid.Parameter("contact", START, LOW, HIGH))

    def residual(x: np.ndarray, _: object) -> tuple[list[np.ndarray], None, None]:
        # One column a trial.
        return [np.stack([loop(column) for column in np.atleast_2d(x.T)], axis=1)], None, None

    sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--budget", type=float, default=60.0, help="seconds for each search")
    budget = parser.parse_args().budget
    rows = []
    recipes = registry.recipes("mujoco")
    for name in ("staggered", "two-pair", "soft"):
        if name in recipes:
            start = time.perf_counter()
            setting = recipes[name](TARGET)
            rows.append((f"hcbench {name}", time.perf_counter() - start, setting, 0))
    searches = [("scipy differential_evolution, Python step loop", by_evolution)]
    try:
        from mujoco import sysid

        sysid.optimize  # noqa: B018 - there only with the extra installed
        searches.insert(0, ("mujoco.sysid optimize, Python step loop", by_sysid))
    except (ImportError, AttributeError):
        print('mujoco.sysid is left out: pip install "mujoco[sysid]"')
    for title, method in searches:
        start = time.perf_counter()
        setting, calls = search(method, budget)
        rows.append((title, time.perf_counter() - start, setting, calls))
    print("| how | time, s | trials | largest error of e, held out |\n|---|---|---|---|")
    for title, seconds, setting, calls in rows:
        verdict = evaluate(registry.engine("mujoco"), SCENE, setting, TARGET)
        print(f"| {title} | {seconds:.2f} | {calls or '-'} | {verdict.max_error:.2g} |")
    print(f"| the best constant e | - | - | {verdict.constant_error:.2g} |")


if __name__ == "__main__":
    main()
