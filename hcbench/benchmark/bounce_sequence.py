"""Successive bounces: a body dropped under gravity, followed for ten of them and until it lies still."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.benchmark.results import TRAIN_COLUMNS, run_key
from hcbench.laws.force import HuntCrossley
from hcbench.sim import registry
from hcbench.terms.impact import Launch
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from hcbench.benchmark.encodings import Encode
    from hcbench.benchmark.plan import Inputs, Plan
    from hcbench.terms.impact import Trajectory
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

BOUNCES = 10
RESTS = "hcbench.rests"  # in the metadata of the table: how the bodies lie at the end
_SLACK = 2.0  # of the law's time for as many bounces, for engines that bounce higher
_REST_S = 6.0  # after a drop: what buzzes or sinks then does so for good


@dataclass(frozen=True, slots=True)
class Bounce:
    """One of several: when the contact began and ended, s after release, and how high it went then, m."""

    touch: float
    parting: float
    height: float


def bounces(path: Trajectory, count: int) -> list[Bounce]:
    """The first `count` bounces of a body, or fewer.

    A height over the surface is the highest sample of a flight and its two neighbours', by the parabola
    through them.
    """
    gap, acting, bounces = -path.penetration, path.force != 0, []
    partings = np.flatnonzero(acting[:-1] & ~acting[1:] & (path.rate[1:] < 0))
    for before, start, end in zip([-1, *partings], partings, [*partings[1:], len(gap) - 1], strict=False):
        top = start + int(gap[start : end + 1].argmax())
        if 0 < top < len(gap) - 1 and gap[top] > 0 and gap[top] >= gap[top + 1]:
            low, here, high = gap[top - 1 : top + 2]
            bend = low - 2 * here + high
            height = float(here - (high - low) ** 2 / (8 * bend)) if bend < 0 else float(here)
            touch = before + 1 + int(acting[before + 1 :].argmax())
            bounces.append(Bounce(float(path.time[touch]), float(path.time[start + 1]), height))
    return bounces[:count]


@dataclass(frozen=True, slots=True)
class RestAfterDrop:
    """A body long after its drop: its penetration in the last second, mean and greatest less least, m."""

    depth: float
    motion: float


def rest(path: Trajectory) -> RestAfterDrop:
    """Depth and vibration of a body in the last second of a trajectory; NaN where its engine gave
    up.
    """
    last = path.penetration[path.time >= path.time[-1] - 1.0]
    return RestAfterDrop(float(last.mean()), float(np.ptp(last)))


@dataclass(frozen=True, slots=True)
class Drop:
    """A drop under gravity, and everything that is needed to simulate it anywhere.

    height: m. law_heights: after each bounce, as (16) has it, m. duration: to be simulated, s. rests: whether
    it is long enough to lie still.
    """

    setting: Setting
    height: float
    law_heights: tuple[float, ...]
    duration: float
    rests: bool
    inputs: Inputs

    def __str__(self) -> str:
        return f"the bounces of {self.setting.engine} {self.setting.name}"


@dataclass(frozen=True, slots=True)
class Dropped:
    """Bounces of a drop, fewer than BOUNCES if it comes to rest, and its rest."""

    bounces: Sequence[Bounce]
    rest: RestAfterDrop | None


def law_heights(law: HuntCrossley, mass: float, height: float, count: int = BOUNCES) -> list[float]:
    """Heights (m) after each of `count` bounces of a drop from `height` (m), by (16) under gravity."""
    from hcbench.laws import ode

    heights = []
    for _ in range(count):
        speed = math.sqrt(2 * STANDARD_GRAVITY * height)
        impact = ode.impact(law, mass, speed, gravity=STANDARD_GRAVITY, count=3)
        height *= impact.restitution**2
        heights.append(height)
    return heights


def plan_drops(plan: Plan, mapper: Callable[..., Iterable[Any]] = map) -> list[Drop]:
    """A drop of each setting that the study drops, for its main α. mapper: as of `make_plan`."""
    study, height = plan.study, plan.study.train_height
    if height is None:
        return []
    law = HuntCrossley(study.scene.stiffness, study.main_alpha, study.scene.exponent)
    heights = tuple(*mapper(partial(law_heights, law, study.scene.mass), [height]))
    falls = [math.sqrt(2 * h / STANDARD_GRAVITY) for h in (height, *heights)]
    bouncing = _SLACK * (falls[0] + 2 * sum(falls[1:]))
    drops = {}
    for grid in plan.grids:
        wanted = grid.dropped or grid.setting.timestep == study.train_step
        if wanted and study.main_alpha in grid.alphas and not grid.scene.off_axis:
            duration = max(bouncing, _REST_S) if grid.dropped else bouncing
            drop = Drop(grid.setting, height, heights, duration, grid.dropped, plan.inputs_of(grid))
            drops[grid.scene, grid.setting.key] = drop
    return list(drops.values())


def simulate_bounces(scene: Scene, drop: Drop) -> Dropped:
    """A drop under the scene's gravity, or the standard one where it has none."""
    with_gravity = dataclasses.replace(scene, gravity=scene.gravity or STANDARD_GRAVITY)
    engine, launch = registry.engine(drop.setting.engine), Launch(0.0, height=drop.height)
    path = engine.trajectory(with_gravity, drop.setting, launch, drop.duration)
    return Dropped(bounces(path, BOUNCES), rest(path) if drop.rests else None)


def bounce_table(dropped: Sequence[tuple[Drop, Dropped]], alpha: float, encode: Encode) -> bytes:
    """TRAIN_COLUMNS, as the bytes of a file, with how the bodies lie at the end in its metadata."""
    tables, rests = [], []
    for drop, seen in dropped:
        key = run_key(drop.inputs.scene, drop.setting, alpha)
        count = len(seen.bounces)
        reached = np.array([dataclasses.astuple(bounce) for bounce in seen.bounces]).reshape(count, 3).T
        columns = (*key.values(), np.arange(1, count + 1), *reached, np.array(drop.law_heights[:count]))
        tables.append(dict(zip(TRAIN_COLUMNS, columns, strict=True)))
        if seen.rest is not None:
            lies = {"followed_s": drop.duration, "depth_m": seen.rest.depth, "motion_m": seen.rest.motion}
            rests.append({**key, **lies})
    return encode(tables, TRAIN_COLUMNS, {RESTS: json.dumps(rests).encode()})
