"""Successive bounces: a body dropped under gravity and followed for ten of them, beside the law's heights."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench import scoring
from hcbench.benchmark.results import TRAIN_COLUMNS, run_key
from hcbench.benchmark.tables import parquet
from hcbench.impact import Launch
from hcbench.laws import ode
from hcbench.laws.force import HuntCrossley
from hcbench.sim import registry
from hcbench.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hcbench.benchmark.plan import Inputs, Plan
    from hcbench.scene import Scene
    from hcbench.setting import Setting

BOUNCES = 10
_SLACK = 2.0  # of the law's time for as many bounces, for engines that bounce higher


@dataclass(frozen=True, slots=True)
class Drop:
    """A drop under gravity, and everything that is needed to simulate it anywhere.

    height: m. law_heights: after each bounce, as (16) has it, m. duration: to be simulated, s.
    """

    setting: Setting
    height: float
    law_heights: tuple[float, ...]
    duration: float
    inputs: Inputs

    def __str__(self) -> str:
        return f"the bounces of {self.setting.engine} {self.setting.name}"


def law_heights(law: HuntCrossley, mass: float, height: float, count: int = BOUNCES) -> list[float]:
    """Heights (m) after each of `count` bounces of a drop from `height` (m), by (16) under gravity."""
    heights = []
    for _ in range(count):
        speed = math.sqrt(2 * STANDARD_GRAVITY * height)
        impact = ode.impact(law, mass, speed, gravity=STANDARD_GRAVITY, count=3)
        height *= impact.restitution**2
        heights.append(height)
    return heights


def plan_drops(plan: Plan) -> list[Drop]:
    """A drop of each setting that the study drops, for its main α."""
    study, height = plan.study, plan.study.train_height
    if height is None:
        return []
    law = HuntCrossley(study.scene.stiffness, study.main_alpha, study.scene.exponent)
    heights = tuple(law_heights(law, study.scene.mass, height))
    falls = [math.sqrt(2 * h / STANDARD_GRAVITY) for h in (height, *heights)]
    duration = _SLACK * (falls[0] + 2 * sum(falls[1:]))
    settings = {
        grid.setting.key: grid.setting
        for grid in plan.grids
        if study.main_alpha in grid.alphas and grid.setting.timestep == study.train_step
    }
    return [Drop(setting, height, heights, duration, plan.inputs) for setting in settings.values()]


def simulate_bounces(scene: Scene, drop: Drop) -> list[float]:
    """Heights, m, after each bounce; fewer than BOUNCES where it comes to rest."""
    heavy = dataclasses.replace(scene, gravity=STANDARD_GRAVITY)
    engine, launch = registry.engine(drop.setting.engine), Launch(0.0, height=drop.height)
    path = engine.trajectory(heavy, drop.setting, launch, drop.duration)
    return scoring.bounce_heights(path, BOUNCES)


def bounce_table(drops: Sequence[Drop], heights: Mapping[str, Sequence[float]], alpha: float) -> bytes:
    """TRAIN_COLUMNS, as the bytes of a file. heights: after each bounce, m, by a setting's key."""
    tables = []
    for drop in drops:
        reached = np.array(heights[drop.setting.key])
        count = len(reached)
        key = run_key(drop.inputs.scene, drop.setting, alpha)
        columns = (*key.values(), np.arange(1, count + 1), reached, np.array(drop.law_heights[:count]))
        tables.append(dict(zip(TRAIN_COLUMNS, columns, strict=True)))
    return parquet(tables, TRAIN_COLUMNS)
