"""Simulates launches in any engine: release, advance in chunks, stop, read the impacts.

Results are the same bits for any batch size, number of threads and length of chunks.
"""

from __future__ import annotations

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, closing, nullcontext
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from hcbench.errors import SettingError
from hcbench.impact import Impact, Status, Trajectory
from hcbench.laws import closed_form
from hcbench.sim.backend import require
from hcbench.sim.entry_points import here
from hcbench.sim.read_impact import impacts_of
from hcbench.sim.stop import StopRule
from hcbench.sim.tangential import with_tangential
from hcbench.sim.world import CannotShareError
from hcbench.workers import call, map_surviving_crashes, redirect_output

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.impact import Floats, Launch
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.sim.engine import SteppedEngine
    from hcbench.sim.world import Simulation, World

STEP_S = 1e-3  # for one step of a trajectory, beyond the engine's limit for a launch
SHORTEST_CHUNK, _CHUNK_SHARE = 8, 8  # steps in a chunk: at least, and as a share of those taken already
_GUESS_SHARE = 2 / 3  # of the steps that a guess expects: then it is seen how soon the bodies part
_SLOWEST = 1e-3  # m/s: for a body let down on the plate, a step is judged at this speed


@cache  # as reading a version takes as long as tens of launches
def require_installed(name: str) -> None:
    """Raises EngineMissing; warns of a version that was never tried."""
    require(here(name))


def _explained_errors(engine: SteppedEngine) -> AbstractContextManager[None]:
    return engine.backend.explained_errors() if engine.backend else nullcontext()


def impacts(
    engine: SteppedEngine, scene: Scene, setting: Setting, launches: Sequence[Launch]
) -> list[Impact]:
    """One impact for each launch, in order; one that the engine's process dies on is CRASHED."""
    require_installed(engine.name)
    # Alike together: they take equally long.
    order = sorted(range(len(launches)), key=lambda i: (launches[i].height or 0.0, launches[i].speed))
    in_order = [launches[i] for i in order]
    where = (engine.name, scene, setting)
    if engine.own_process:
        results = map_surviving_crashes(
            simulate_all,
            in_order,
            *where,
            lost=lambda launch, reason: Impact(launch, Status.CRASHED, reason),
            limit=engine.limit,
            together=engine.together,
            give_up=engine.together,
        )
    else:
        results = list(simulate_all(in_order, *where))
    back = dict(zip(order, results, strict=True))
    return [back[i] for i in range(len(launches))]


def trajectory(
    engine: SteppedEngine, scene: Scene, setting: Setting, launch: Launch, duration: float
) -> Trajectory:
    """Every step of `duration` s after one launch, NaN from where the engine gave up."""
    require_installed(engine.name)
    steps = max(1, round(duration / setting.timestep))
    if not engine.own_process:
        return _followed(engine.name, scene, setting, launch, steps)
    limit = engine.limit + steps * STEP_S
    return call(_followed, engine.name, scene, setting, launch, steps, limit=limit)


def impacts_in(world: World, launches: Sequence[Launch]) -> list[Impact]:
    """One impact for each launch in a loaded world, in order."""
    return [impact for group in run_launches(world, launches) for impact in group]


def run_launches(
    world: World, launches: Sequence[Launch], places: int = 0, expected: int = 0
) -> Iterator[list[Impact]]:
    """Impacts of launches that are sorted by how long they take, in groups of the world's `places`.

    places: at most so many together, 0 for as many as the world carries. expected: steps of the first, after
    which each group tells the next; 0 where they have nothing in common.
    Raises SettingError for a launch that cannot arrive.
    """
    for launch in launches:
        if launch.speed == 0.0 and math.isinf(launch.flight_time(world.timestep, world.gravity)):
            raise SettingError("speed", "0 m/s without gravity", "a speed above 0, or gravity")
    groups = max(1, math.ceil(len(launches) / (places or world.places)))
    size = max(1, math.ceil(len(launches) / groups))
    first, whole = round(_GUESS_SHARE * expected), expected

    def run(group: Sequence[Launch]) -> list[Impact]:
        nonlocal first, whole
        group_impacts, taken = _run_group(world, group, first, whole)
        first = whole = taken if expected else 0
        return group_impacts

    parts = [launches[i : i + size] for i in range(0, len(launches), size)]
    if world.concurrent == 1 or len(parts) == 1:
        yield from map(run, parts)
        return
    with ThreadPoolExecutor(world.concurrent) as pool:
        yield from pool.map(run, parts)


def _run_group(
    world: World, launches: Sequence[Launch], first: int, expected: int
) -> tuple[list[Impact], int]:
    """The impacts of launches that are simulated side by side, and how many steps that took.

    first, expected: steps to take before anything is looked at, and probably in all; 0 where unknown.
    """
    try:
        with closing(world.release(launches)) as simulation:
            return _until_ended(world, simulation, launches, first, expected)
    except CannotShareError:
        assert len(launches) > 1, "a launch that is simulated alone shares with none"
        return [_run_group(world, [launch], first, expected)[0][0] for launch in launches], expected


def _until_ended(
    world: World, simulation: Simulation, launches: Sequence[Launch], first: int, expected: int
) -> tuple[list[Impact], int]:
    after = world.speed_reading.steps_after
    rule = StopRule.for_launches(launches, world.timestep, world.gravity, world.deepest, after)
    left, longest = np.arange(len(launches)), 0
    history: list[Floats] = []  # of shape (3 or 11, b, n) each
    ended_impacts: dict[int, Impact] = {}
    steps = first
    while left.size:
        chunk = simulation.advance(max(SHORTEST_CHUNK, steps)).rows()
        history.append(chunk)
        counts, ends = rule.add(*chunk[:3])
        ended = counts > 0
        # How long a contact lasts that is longer than expected is unknown: a share of what was.
        most = max(expected - rule.steps, rule.steps // _CHUNK_SHARE)
        steps = int(min(most, _steps_to_part(chunk[:2, ~ended, -1], world.timestep)))
        if not ended.any():
            continue
        longest, all_ended = int(counts.max()), bool(ended.all())
        if not all_ended:
            rows = np.concatenate([part[:, ended] for part in history], axis=2)
        else:
            rows = history[0] if len(history) == 1 else np.concatenate(history, axis=2)
        which, counts, ends = left[ended].tolist(), counts[ended], ends[ended]
        read = impacts_of(
            [launches[i] for i in which],
            np.arange(rows.shape[2], dtype=np.float64) * world.timestep,
            rows[:3],
            counts,
            ends,
            world.gravity,
            world.speed_reading,
            world.diverged,
        )
        if len(rows) > 3:
            whole = zip(read, rows.swapaxes(0, 1), counts.tolist(), strict=True)
            by = world.timestep, world.mass, world.energy_by_work
            read = [with_tangential(i, r[:, :n], *by) for i, r, n in whole]
        for i, impact, count in zip(which, read, counts.tolist(), strict=True):
            ended_impacts[i] = _explained(impact, simulation.note(count))
        if all_ended:
            break
        going = ~ended
        left, history = left[going], [part[:, going] for part in history]
        rule.keep(going)
        simulation.keep(going)
    return [ended_impacts[i] for i in range(len(launches))], longest


def _steps_to_part(last: Floats, timestep: float) -> float:
    """At most so many steps until bodies part that are on their way out, as a contact speeds them up on it.

    last: penetration and rate, shape (2, b). Infinite where one is not on its way out.
    """
    x, v = last
    if not ((x > 0.0) & (v < 0.0)).all():
        return math.inf
    with np.errstate(over="ignore"):
        return float((x / -v).max(initial=0.0)) / timestep + 2.0


def _explained(impact: Impact, note: str) -> Impact:
    """With what was in the way of one that went wrong."""
    if not note or impact.status not in (Status.NO_TOUCH, Status.DIVERGED):
        return impact
    return dataclasses.replace(impact, reason=f"{impact.reason}; {note}")


def simulate_all(launches: Sequence[Launch], name: str, scene: Scene, setting: Setting) -> Iterator[Impact]:
    """One impact for each launch, in order, in this process."""
    engine: SteppedEngine = here(name)  # type: ignore[assignment]
    speeds = [launch.touch_speed(setting.timestep, scene.gravity) for launch in launches]
    quiet = redirect_output if engine.own_process else nullcontext
    with quiet(), _explained_errors(engine):
        world = engine.load(scene, setting, max([_SLOWEST, *speeds]))
    with world, _explained_errors(engine):
        places = min(world.places, engine.together) if engine.own_process else world.places
        groups = run_launches(world, launches, places, _expected_steps(scene, setting.timestep, launches))
        while True:
            with quiet():
                group = next(groups, None)
            if group is None:
                return
            yield from group


def _expected_steps(scene: Scene, timestep: float, launches: Sequence[Launch]) -> int:
    """About how many steps the first launch takes: flight, and elastic contact of the scene's stiffness."""
    if not launches:
        return 0
    speed = launches[0].touch_speed(timestep, scene.gravity)
    flight = launches[0].flight_time(timestep, scene.gravity)
    if speed == 0.0 or math.isinf(flight):
        return 0
    contact = closed_form.elastic_duration(scene.stiffness, scene.exponent, scene.mass, speed)
    return math.ceil((contact + flight) / timestep) + SHORTEST_CHUNK


def _followed(name: str, scene: Scene, setting: Setting, launch: Launch, steps: int) -> Trajectory:
    engine: SteppedEngine = here(name)  # type: ignore[assignment]
    fastest = max(_SLOWEST, launch.touch_speed(setting.timestep, scene.gravity))
    path = np.full((3, steps), np.nan)
    done = 0
    with (
        redirect_output() if engine.own_process else nullcontext(),
        _explained_errors(engine),
        engine.load(scene, setting, fastest) as world,
        closing(world.follow(launch)) as simulation,
    ):
        while done < steps:
            record = simulation.advance(steps - done)
            count = record.force.shape[1]
            path[:, done : done + count] = record.penetration[0], record.rate[0], record.force[0]
            done = done + count if np.isfinite(path[:, done : done + count]).all() else steps
    return Trajectory(np.arange(steps, dtype=np.float64) * setting.timestep, *path)
