"""Simulates launches in any engine: release, advance in chunks, stop, read the impacts.

Results are the same bits for any batch size, number of threads and length of chunks.
"""

from __future__ import annotations

import math
from contextlib import AbstractContextManager, closing, nullcontext
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from hcbench.laws import closed_form
from hcbench.sim.backend import require
from hcbench.sim.columns import STATUSES, Impacts, Launches, even_size
from hcbench.sim.entry_points import here
from hcbench.sim.read_impact import impacts_of
from hcbench.sim.stop import StopRule
from hcbench.sim.tangential import tangential_of
from hcbench.sim.world import CannotShareError
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Impact, Status, Trajectory
from hcbench.workers import call, in_worker, map_surviving_crashes, redirect_output

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from hcbench.sim.engine import SteppedEngine
    from hcbench.sim.world import Simulation, World
    from hcbench.terms.impact import Floats, Launch
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# Time that a step of a trajectory may take beyond the engine's limit for a launch, s.
STEP_S = 1e-3
# Steps in a chunk: at least, and the share of those taken already, 1 in so many.
SHORTEST_CHUNK = 8
_CHUNK_SHARE = 8
# Share of the steps that a guess expects: then it is seen how soon the bodies part.
_GUESS_SHARE = 2 / 3
_WRONG = [STATUSES.index(status) for status in (Status.NO_TOUCH, Status.DIVERGED)]
# Steps of launches that are simulated together, all in all: bounds memory.
_ROOM = 2**18
# A group has at least a world's places over this number, however long its launches take.
_LEAST_SHARE = 8
# A step is judged at this speed for a body that is let down on the plate, m/s.
_SLOWEST = 1e-3


# Reading a version takes as long as tens of launches.
@cache
def require_installed(name: str) -> None:
    """Raises EngineMissing; warns of a version that was never tried."""
    require(here(name))


def _explained_errors(engine: SteppedEngine) -> AbstractContextManager[None]:
    return engine.backend.explained_errors() if engine.backend else nullcontext()


def impacts(engine: SteppedEngine, scene: Scene, setting: Setting, launches: Launches) -> Impacts:
    """One impact for each launch, in order; one that the engine's process dies on is CRASHED.

    Simulated in a process of their own for engines that need one, or compute on a device; else here.
    Raises EngineMissing where the engine is not installed, and what its `load` raises; EngineFailed
    for errors of a version that was never tried.
    """
    require_installed(engine.name)
    # Launches of like height and speed go together, since they take equally long.
    order = np.lexsort((launches.speed, np.nan_to_num(launches.height)))
    in_order = launches.take(order)
    where = (engine.name, scene, setting)
    if engine.device_of(setting):
        results = call(_together, in_order, *where, limit=engine.limit * len(in_order))
    elif engine.own_process and not in_worker():
        results = Impacts.of(
            map_surviving_crashes(
                simulate_all,
                in_order,
                *where,
                lost=lambda launch, reason: Impact(launch, Status.CRASHED, reason),
                limit=engine.limit,
                together=engine.together,
                give_up=engine.together,
            )
        )
    else:
        results = _together(in_order, *where)
    return results.take(np.argsort(order))


def trajectory(
    engine: SteppedEngine, scene: Scene, setting: Setting, launch: Launch, duration: float
) -> Trajectory:
    """Simulate one launch for `duration`, s, or one step if that is longer: time, penetration, rate
    and force at each step, (n,), NaN from where the engine gave up.

    Raises EngineMissing, what the engine's `load` raises, and the error of a process that died or
    hung.
    """
    require_installed(engine.name)
    steps = max(1, round(duration / setting.timestep))
    if not engine.own_process:
        return _followed(engine.name, scene, setting, launch, steps)
    limit = engine.limit + steps * STEP_S
    return call(_followed, engine.name, scene, setting, launch, steps, limit=limit)


def impacts_in(world: World, launches: Sequence[Launch]) -> list[Impact]:
    """One impact for each launch in a loaded world, in order."""
    impacts: list[Impact] = []
    for group in run_launches(world, Launches.of(launches)):
        impacts.extend(group)
    return impacts


def run_launches(
    world: World, launches: Launches, places: int = 0, expected: int = 0
) -> Iterator[Impacts]:
    """Yield the impacts of launches in their order, a group of launches at a time.

    launches: sorted by how long they take.
    places: launches simulated together at most; 0 for as many as the world carries.
    expected: steps that the first group probably takes; each group then tells what to expect of the
    next. 0 where that is unknown, and launches have nothing in common.
    Raises SettingError, before the first group, for a launch that cannot arrive.
    """
    _require_arrival(world, launches)
    most = places or world.places
    # Steps that a group takes before anything is looked at, and probably in all.
    first = round(_GUESS_SHARE * expected)
    whole = expected
    if expected:
        first = max(first, world.least_taken)
        whole = max(whole, world.least_taken)

    def run(group: Launches) -> Impacts:
        """Impacts of a group, by whose steps the next one is planned; a plan changes how long it
        takes, and no result.
        """
        nonlocal first, whole
        group_impacts, taken = _run_group(world, group, first, whole)
        if expected:
            first = whole = taken
            world.least_taken = min(taken, world.least_taken or taken)
        return group_impacts

    if world.concurrent > 1 and len(launches) > most:
        # Most commands need no threads, and their import takes as long as a launch.
        from concurrent.futures import ThreadPoolExecutor

        size = even_size(len(launches), most)
        groups = [launches[i : i + size] for i in range(0, len(launches), size)]
        with ThreadPoolExecutor(world.concurrent) as pool:
            yield from pool.map(run, groups)
        return
    done = 0
    while done < len(launches):
        # Launches whose recorded steps fit into memory.
        room = max(_ROOM // max(1, whole), math.ceil(most / _LEAST_SHARE))
        # Full groups and a rest: a world takes a step of all its places in any case.
        size = min(most, room)
        yield run(launches[done : done + size])
        done += size


def _require_arrival(world: World, launches: Launches) -> None:
    if np.isinf(launches.flight_time(world.timestep, world.gravity)[launches.speed == 0.0]).any():
        raise SettingError("speed", "0 m/s without gravity", "a speed above 0, or gravity")


def _read_while_stepping(world: World, launches: Launches) -> Iterator[Impacts]:
    """Impacts of launches, in groups of the world's `room`. Raises as `run_launches`."""
    _require_arrival(world, launches)
    size = even_size(len(launches), world.room)
    for i in range(0, len(launches), size):
        yield world.read(launches[i : i + size])


def _run_group(world: World, launches: Launches, first: int, expected: int) -> tuple[Impacts, int]:
    """Simulate launches together: their impacts in order, and how many steps that took.

    first, expected: steps to take before anything is looked at, and probably in all; 0 where
    unknown.
    If launches disturbed each other, each is simulated again alone; the steps returned are then
    `expected`.
    """
    try:
        with closing(world.release(launches)) as simulation:
            return _until_ended(world, simulation, launches, first, expected)
    except CannotShareError:
        assert len(launches) > 1, "a launch that is simulated alone shares with none"
        alone = []
        for i in range(len(launches)):
            impact, _ = _run_group(world, launches[i : i + 1], first, expected)
            alone.append(impact)
        return Impacts.joined(alone), expected


def _until_ended(
    world: World, simulation: Simulation, launches: Launches, first: int, expected: int
) -> tuple[Impacts, int]:
    """Impacts of a simulation's launches, in order, and the steps that the longest took.

    first, expected: steps to take before anything is looked at, and probably in all; 0 where
    unknown.
    Launches that have ended are read and no longer looked at.
    Raises CannotShareError where launches have disturbed each other.
    """
    after = world.speed_reading.steps_after
    rule = StopRule.for_launches(launches, world.timestep, world.gravity, world.deepest, after)
    # Places, among all, of the b launches that have not ended.
    left = np.arange(len(launches))
    longest = 0
    # Recorded steps of these launches, chunk by chunk; each of shape (3 or 11, b, n).
    history: list[Floats] = []
    # Impacts of those that have ended, and their places among all.
    parts: list[Impacts] = []
    order: list[NDArray[np.int64]] = []
    steps = first
    while left.size:
        chunk = simulation.advance(max(SHORTEST_CHUNK, world.least_steps, steps)).rows()
        history.append(chunk)
        counts, ends = rule.add(*chunk[:3])
        ended = counts > 0
        # How long a contact lasts that is longer than expected is unknown: a share of what was.
        most = max(expected - rule.steps, rule.steps // _CHUNK_SHARE)
        steps = int(min(most, _steps_to_part(chunk[:2, ~ended, -1], world.timestep)))
        if not ended.any():
            continue
        longest = int(counts.max())
        all_ended = bool(ended.all())
        if not all_ended:
            rows = np.concatenate([part[:, ended] for part in history], axis=2)
        elif len(history) > 1:
            rows = np.concatenate(history, axis=2)
        else:
            # No copy of what may be large.
            rows = history[0]
        places = left[ended]
        order.append(places)
        read = _read(world, launches.take(places), rows, counts[ended], ends[ended])
        _explain(read, simulation, counts)
        parts.append(read)
        if all_ended:
            break
        going = ~ended
        left = left[going]
        history = [part[:, going] for part in history]
        rule.keep(going)
        simulation.keep(going)
    if len(parts) == 1:
        # All ended in one chunk, in order.
        return parts[0], longest
    in_order = np.argsort(np.concatenate(order))
    return Impacts.joined(parts).take(in_order), longest


def _read(
    world: World,
    launches: Launches,
    rows: Floats,
    counts: NDArray[np.int64],
    ends: NDArray[np.int64],
) -> Impacts:
    """Read the impacts of launches that have ended off their recorded steps, with the motion along
    the plate where that was recorded.

    rows: penetration, rate and force, then the eight of `Record.tangential` if known, SI, (3 or 11,
    b, n).
    counts, ends: steps of each launch, and why it ended (`End`), (b,).
    """
    time = np.arange(rows.shape[2], dtype=np.float64) * world.timestep
    read = impacts_of(
        launches, time, rows[:3], counts, ends, world.gravity, world.speed_reading, world.diverged
    )
    # Nothing is recorded along the plate.
    if len(rows) == 3:
        return read
    for i in np.flatnonzero(read.is_measured & launches.is_oblique):
        read.tangential[i] = tangential_of(
            rows[:, i, : counts[i]],
            int(read.samples[i]),
            (float(read.speed_in[i]), float(read.speed_out[i])),
            world.timestep,
            world.mass,
            world.energy_by_work,
        )
    return read


def _steps_to_part(last: Floats, timestep: float) -> float:
    """Upper bound of the steps until all of some bodies have parted, from the speeds with which they
    leave; infinite where one is not inside and on its way out.

    last: penetration, m, and rate, m/s, of each, (2, b).
    timestep: s.
    """
    x, v = last
    if not ((x > 0.0) & (v < 0.0)).all():
        return math.inf
    with np.errstate(over="ignore"):
        return float((x / -v).max(initial=0.0)) / timestep + 2.0


def _explain(impacts: Impacts, simulation: Simulation, counts: NDArray[np.int64]) -> None:
    """Add to the reason of each impact that went wrong, in place, a note on other forces that acted.

    counts: steps of each launch of the simulation that has just ended, else 0, (b,).
    impacts: of those that ended, in order.
    """
    # Asked in any case: a simulation of a user's model keeps what acted, for the causes.
    notes = simulation.notes(counts)
    wrong = np.isin(impacts.status, _WRONG)
    for i, note in enumerate(notes):
        if note and wrong[i]:
            impacts.reason[i] = f"{impacts.reason[i]}; {note}"


def simulate_all(
    launches: Sequence[Launch], name: str, scene: Scene, setting: Setting
) -> Iterator[Impact]:
    """One impact for each launch, in order, in this process."""
    for group in _groups(Launches.of(launches), name, scene, setting):
        yield from group


def _together(launches: Launches, name: str, scene: Scene, setting: Setting) -> Impacts:
    return Impacts.joined(list(_groups(launches, name, scene, setting)))


def _groups(launches: Launches, name: str, scene: Scene, setting: Setting) -> Iterator[Impacts]:
    """The impacts of launches, in order, as many at a time as the engine simulates together.

    name: of the engine, in this process.
    Raises what its `load` raises, SettingError for a launch that cannot arrive, and EngineFailed
    for errors of a version that was never tried.
    """
    engine: SteppedEngine = here(name)  # type: ignore[assignment]
    fastest = float(launches.touch_speed(setting.timestep, scene.gravity).max(initial=_SLOWEST))
    quiet = redirect_output if engine.own_process else nullcontext
    with quiet(), _explained_errors(engine):
        world = engine.load(scene, setting, fastest)
    with world, _explained_errors(engine):
        places = world.places
        if engine.own_process:
            places = min(places, engine.together)
        expected = _expected_steps(scene, setting.timestep, launches)
        if world.room:
            groups = _read_while_stepping(world, launches)
        else:
            groups = run_launches(world, launches, places, expected)
        while True:
            with quiet():
                group = next(groups, None)
            if group is None:
                return
            yield group


def _expected_steps(scene: Scene, timestep: float, launches: Launches) -> int:
    """Estimate how many steps the first launch takes: its flight, and an elastic contact of the
    scene's stiffness; 0 where there is no launch, and for one that never arrives.

    timestep: s.
    """
    if not len(launches):
        return 0
    speed = launches[0].touch_speed(timestep, scene.gravity)
    flight = launches[0].flight_time(timestep, scene.gravity)
    if speed == 0.0 or math.isinf(flight):
        return 0
    contact = closed_form.elastic_duration(scene.stiffness, scene.exponent, scene.mass, speed)
    return math.ceil((contact + flight) / timestep) + SHORTEST_CHUNK


def _followed(name: str, scene: Scene, setting: Setting, launch: Launch, steps: int) -> Trajectory:
    """Simulate one launch for `steps` steps in this process: time, penetration, rate and force at
    each, NaN from where the engine gave up.

    name: of the engine.
    Raises what its `load` raises.
    """
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
            is_finite = np.isfinite(path[:, done : done + count]).all()
            done += count
            # The engine gave up.
            if not is_finite:
                break
    return Trajectory(np.arange(steps, dtype=np.float64) * setting.timestep, *path)
