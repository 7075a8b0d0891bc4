"""Successive bounces: a body dropped under gravity, followed for ten
of them and until it lies still.
"""

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

    from hcbench.benchmark.plan import Inputs, Plan
    from hcbench.benchmark.tables import Encode
    from hcbench.terms.impact import Trajectory
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

BOUNCES = 10
# Key of the table's metadata that holds how the bodies lie at the end.
RESTS = "hcbench.rests"
# Multiple of the law's time for as many bounces, for engines that bounce higher.
_SLACK = 2.0
# s after a drop: what still vibrates or sinks then never stops.
_REST_S = 6.0


@dataclass(frozen=True, slots=True)
class Bounce:
    """One of several bounces: when the contact began and ended, s after
    release, and how high it went then, m.
    """

    touch: float
    parting: float
    height: float


def bounces(path: Trajectory, count: int) -> list[Bounce]:
    """The first `count` bounces of a body, or fewer: times in s, heights over the surface in m.

    path: from release on, through all of these bounces; its penetration is above 0 in contact.
    A height is the highest sample of a flight and its two neighbours', by the parabola through
    them. A last flight whose top may come after the path's end is left out.
    """
    gap = -path.penetration
    acting = path.force != 0
    last = len(gap) - 1
    # Last samples of contacts that a flight follows, not a loss of touch
    # while the body still goes in.
    partings = np.flatnonzero(acting[:-1] & ~acting[1:] & (path.rate[1:] < 0))
    # A flight lasts from its parting to the next one, at most; -1 stands before the first sample.
    previous_partings = [-1, *partings]
    ends = [*partings[1:], last]
    bounces = []
    for previous, parting, end in zip(previous_partings, partings, ends, strict=False):
        top = parting + int(gap[parting : end + 1].argmax())
        # A flight that is cut off by the end of the path may have its top later.
        if not (0 < top < last and gap[top] > 0 and gap[top] >= gap[top + 1]):
            continue
        before, here, after = gap[top - 1 : top + 2]
        bend = before - 2 * here + after
        height = float(here)
        # Vertex of the parabola through three samples at equal steps; a straight line has none.
        if bend < 0:
            height = float(here - (after - before) ** 2 / (8 * bend))
        touch = previous + 1 + int(acting[previous + 1 :].argmax())
        bounces.append(Bounce(float(path.time[touch]), float(path.time[parting + 1]), height))
    return bounces[:count]


@dataclass(frozen=True, slots=True)
class RestAfterDrop:
    """A body long after its drop: its penetration in the last second,
    mean and greatest less least, m.
    """

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

    height: clearance at release, m.
    law_heights: after each of the first BOUNCES bounces, by the law (16), m.
    duration: to be simulated, s.
    rests: whether it is long enough to lie still, so that its rest is measured.
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
    """Heights (m) after each of `count` bounces of a drop from `height` (m), by the law (16) under
    standard gravity, which acts in the contact too.

    mass: effective, kg.
    """
    from hcbench.laws import ode

    heights = []
    for _ in range(count):
        speed = math.sqrt(2 * STANDARD_GRAVITY * height)
        impact = ode.impact(law, mass, speed, gravity=STANDARD_GRAVITY, count=3)
        height *= impact.restitution**2
        heights.append(height)
    return heights


def plan_drops(plan: Plan, mapper: Callable[..., Iterable[Any]] = map) -> list[Drop]:
    """A drop of each setting that the study drops, for its main α; none for a study without a
    height for drops, or for settings off a cup's axis.

    mapper: computes the law's heights, as `map` does; that of a pool in another process.
    """
    study = plan.study
    height = study.train_height
    if height is None:
        return []
    law = HuntCrossley(study.scene.stiffness, study.main_alpha, study.scene.exponent)
    (heights,) = mapper(partial(law_heights, law, study.scene.mass), [height])
    first_fall, *falls = [math.sqrt(2 * h / STANDARD_GRAVITY) for h in (height, *heights)]
    # After the first fall a body goes up and comes down: two falls a bounce.
    bouncing = _SLACK * (first_fall + 2 * sum(falls))
    drops = {}
    for grid in plan.grids:
        wanted = grid.dropped or grid.setting.timestep == study.train_step
        if wanted and study.main_alpha in grid.alphas and not grid.scene.off_axis:
            duration = bouncing
            if grid.dropped:
                # Followed until it has come to rest.
                duration = max(bouncing, _REST_S)
            drops[grid.scene, grid.setting.key] = Drop(
                setting=grid.setting,
                height=height,
                law_heights=tuple(heights),
                duration=duration,
                rests=grid.dropped,
                inputs=plan.inputs_of(grid),
            )
    return list(drops.values())


def simulate_bounces(scene: Scene, drop: Drop) -> Dropped:
    """Simulate a drop under the scene's gravity, or the standard one where it has none.

    scene: the drop's, with its files as they lie on this machine.
    Raises what the engine raises.
    """
    with_gravity = dataclasses.replace(scene, gravity=scene.gravity or STANDARD_GRAVITY)
    engine = registry.engine(drop.setting.engine)
    launch = Launch(0.0, height=drop.height)
    path = engine.trajectory(with_gravity, drop.setting, launch, drop.duration)
    at_rest = None
    if drop.rests:
        at_rest = rest(path)
    return Dropped(bounces(path, BOUNCES), at_rest)


def bounce_table(dropped: Sequence[tuple[Drop, Dropped]], alpha: float, encode: Encode) -> bytes:
    """The bounces of drops as the bytes of a file, in TRAIN_COLUMNS: times in s, heights in m.

    The metadata has, as JSON, how the body lies at the end of each drop that is followed so long.

    dropped: each drop and its bounces.
    alpha: of the law, s/m.
    encode: `parquet` or `arrays`.
    """
    tables = []
    rests = []
    for drop, seen in dropped:
        key = run_key(drop.inputs.scene, drop.setting, alpha)
        count = len(seen.bounces)
        # Touch and parting, s, and height, m, of each bounce: shape (count, 3).
        bounces = np.array([dataclasses.astuple(bounce) for bounce in seen.bounces]).reshape(-1, 3)
        columns = [
            *key.values(),
            np.arange(1, count + 1),
            *bounces.T,
            np.array(drop.law_heights[:count]),
        ]
        tables.append(dict(zip(TRAIN_COLUMNS, columns, strict=True)))
        if seen.rest is not None:
            lies = {
                "followed_s": drop.duration,
                "depth_m": seen.rest.depth,
                "motion_m": seen.rest.motion,
            }
            rests.append({**key, **lies})
    return encode(tables, TRAIN_COLUMNS, {RESTS: json.dumps(rests).encode()})
