"""Bounce trains: a drop under gravity, followed for ten bounces, beside the law's heights."""

from __future__ import annotations

import dataclasses
import math
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from hcbench import scoring
from hcbench.impact import Launch
from hcbench.laws import ode
from hcbench.sim import registry
from hcbench.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Iterable

    from hcbench.laws.force import HuntCrossley
    from hcbench.scene import Scene
    from hcbench.setting import Setting

BOUNCES = 10
_SLACK = 2.0  # of the law's time for as many bounces, for engines that bounce higher


def law_heights(law: HuntCrossley, mass: float, height: float, count: int = BOUNCES) -> list[float]:
    """Heights (m) after each of `count` bounces of a drop from `height` (m), by (16) under gravity."""
    heights = []
    for _ in range(count):
        speed = math.sqrt(2 * STANDARD_GRAVITY * height)
        impact = ode.impact(law, mass, speed, gravity=STANDARD_GRAVITY, count=3)
        height *= impact.restitution**2
        heights.append(height)
    return heights


def bounce_trains(
    scene: Scene, settings: Iterable[tuple[HuntCrossley, Setting]], height: float
) -> list[tuple[Any, ...]]:
    """Rows (α, setting, bounce number, height m, the law's height m), a bounce each; fewer where it rests."""
    heavy = dataclasses.replace(scene, gravity=STANDARD_GRAVITY)
    rows: list[tuple[Any, ...]] = []
    heights = lru_cache(law_heights)  # settings are many, laws few
    for law, setting in settings:
        truth = heights(law, scene.mass, height)
        flights = math.sqrt(2 * height / STANDARD_GRAVITY) + sum(
            2 * math.sqrt(2 * h / STANDARD_GRAVITY) for h in truth
        )
        path = registry.engine(setting.engine).trajectory(
            heavy, setting, Launch(0.0, height=height), _SLACK * flights
        )
        found = scoring.bounce_heights(path, BOUNCES)
        rows += [(law.alpha, setting, i, h, truth[i - 1]) for i, h in enumerate(found, 1)]
    return rows
