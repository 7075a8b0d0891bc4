"""MuJoCo: launches of a placed pair, each stepped as the user's own loop would step it; in Python,
or in C with the same bits.
"""

from __future__ import annotations

import ctypes
import functools
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np

from hcbench.engines.mujoco import plugin
from hcbench.engines.mujoco.backend import backend, captured_warnings, forget_resets, resets
from hcbench.engines.mujoco.model.open import LaunchWorkspace, copy_state
from hcbench.engines.mujoco.model.pair_reader import MujocoAlongPlate, PairReader, with_kinematics
from hcbench.engines.mujoco.model.speed_shares import NAMES, SpeedShares, strange_share
from hcbench.sim.world import Record, Simulation
from hcbench.system.compiler import build
from hcbench.system.errors import EngineFailed, HcbenchError
from hcbench.terms.impact import TANGENTIAL_ROWS, Launch

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from hcbench.engines.mujoco.model.open import LaunchWorkspace, OpenedModel
    from hcbench.sim.world import Flags
    from hcbench.terms.impact import Floats, Launch


class _Step(NamedTuple):
    """One step as it is read, SI: numbers of the state before it.

    penetration, m; rate of it, m/s; force: of the pair's contact, N.
    free_rate: the rate after the step, had no contact acted in it; NaN but under RK4 near a touch.
    along: motion along the plate, (8,), as `MujocoAlongPlate.row` gives it; None but for oblique
    launches.
    """

    penetration: float
    rate: float
    force: float
    free_rate: float
    along: Floats | None


# Distances are looked at without a contact within so many steps of the way to the touch plane.
NEAR = 4.0
# A stage of RK4 may touch within so many steps of its approach.
_STAGE_REACH = 1.05
# A step under RK4 had no contact in it where its speed changed by less
# than this share of the largest.
_STAGE_NOISE = 1e-9


class MujocoFlight:
    """One launch of a placed pair, stepped by MuJoCo and read after each step.

    The model is only read: its flags are back as they were after each call. The model under test
    keeps `others` and `shares` of all its launches.

    launch.c does the same without RK4, plug-in and oblique motion: change `take_steps` there with
    `_step`, `_look_further` and `_depth_in_flight`.
    """

    def __init__(self, opened: OpenedModel, launch: Launch, space: LaunchWorkspace) -> None:
        """Put the pair where the launch begins: its clearance before the touch, at its speed.

        opened: the model under test, with its pair at touch.
        space: MjData in which this launch is stepped; launches that share one take turns by
        `leave` and `enter`.

        Raises UserError where an oblique launch asks for a motion that the joints cannot make, or
        for a direction that is not along the plate.
        """
        self._mujoco = backend()
        self._opened = opened
        self._space = space
        self._place = opened.place
        self._model = opened.model
        # The state under way, and that before a step; one object but under RK4.
        self._data = space.data
        self._seen = space.seen
        self._h = float(self._model.opt.timestep)
        # Under RK4 a step, `_last`, is read once the one after it is known.
        self._staged = space.free is not None
        self._last: _Step | None = None
        # Change of the rate in a step, as a share of it, up to which it is round-off.
        self._noise = _STAGE_NOISE
        # The same step without a contact, where a plug-in's law turns the pair back.
        self._beside = space.beside

        clearance = launch.clearance_in_phase(self._h, opened.gravity)
        self._along = self._put_at_release(launch, clearance)
        self._before = np.empty(self._model.nv)
        # A view that follows the state.
        self._velocity = self._data.qvel
        self._begin_reading()

        # After the last step: penetration, m, its rate, m/s, and how far the launch has come.
        self._x = -clearance
        self._rate = launch.speed
        self._touched = False
        self._steps = 0

        self._causes = None
        if self._place.pair.more_than_contacts and not self._staged:
            self._causes = SpeedShares(self._model, self._place.pair.sides)
        self._looks_further = self._staged or self._along is not None or self._causes is not None
        self._touch_speed = math.nan
        # True from where the motion does not belong to the impact any more.
        self._apart = False
        # Geoms that touched the two, and the step in which each did so first.
        self._first_touch: dict[int, int] = {}
        whole = self._mujoco.mjtState.mjSTATE_INTEGRATION
        self._state = np.empty(self._mujoco.mj_stateSize(self._model, whole))

    def _put_at_release(self, launch: Launch, clearance: float) -> MujocoAlongPlate | None:
        """Put `_data` where the launch begins; return the reader along the plate of an oblique one,
        else None.

        clearance: from the touch, m, along the motion that leads there.
        Raises UserError where an oblique launch asks for a motion that the joints cannot make.
        """
        mujoco = self._mujoco
        data = self._data
        place = self._place
        mujoco.mj_copyData(data, self._model, self._opened.start)
        data.qpos[:] = place.qpos
        mujoco.mj_integratePos(self._model, data.qpos, place.direction, -clearance)
        data.qvel[:] = launch.speed * place.direction
        data.time = 0.0
        forget_resets(data)
        if not launch.is_oblique:
            return None
        along = MujocoAlongPlate(place, launch, self._opened.request.along)
        along.send(data, launch.flight_time(self._h, self._opened.gravity))
        return along

    def _begin_reading(self) -> None:
        """Make the reader of the pair, which begins with the contact at touch."""
        state = with_kinematics(self._data, self._model)
        self._reader = PairReader(self._model, self._place, state, self._along)

    @property
    def is_oblique(self) -> bool:
        """True if the motion along the plate is read."""
        return self._along is not None

    def leave(self) -> None:
        """Keep the state, as another launch is stepped in the same place."""
        whole = self._mujoco.mjtState.mjSTATE_INTEGRATION
        self._mujoco.mj_getState(self._model, self._data, self._state, whole)

    def enter(self) -> None:
        """Go on from where it was left."""
        whole = self._mujoco.mjtState.mjSTATE_INTEGRATION
        self._mujoco.mj_setState(self._model, self._data, self._state, whole)

    def advance(self, steps: int, after: int | None = None) -> Record:
        """Take up to `steps` more steps, as the user's own loop would, and return a record of them.

        after: steps to take once the two have parted; a launch that turns back without a touch ends
        at once.
        None: all steps.

        The record has one launch: (1, n), n <= steps; oblique launches have motion along the plate,
        too. Its last step is NaN where MuJoCo reset the state.
        Raises EngineFailed for a fatal error of MuJoCo's.
        """
        self.settle()
        with captured_warnings() as warned:
            normal, tangential = self._rows(steps, after)
        self._opened.warned.extend(warned)
        x, v, f = normal[:, None]
        if tangential is not None:
            tangential = tangential[:, None]
        return Record(x, v, f, tangential)

    def settle(self) -> None:
        """Keep what each cause has added to the approach until now as a sum."""
        if self._causes is not None:
            self._causes.settle()

    def _rows(self, steps: int, after: int | None) -> tuple[Floats, Floats | None]:
        """Take steps and read the pair in each: penetration (m), rate (m/s, above 0 on approach) and
        force (N), (3, n); and the motion along the plate, (8, n), None but for oblique launches.

        steps: most to take, 1 or more.
        after: how many more once the two have parted; None: all. A launch also ends where the state
        is not finite, and where it turns back without a touch.
        Raises MuJoCo's FatalError. Under RK4 a step is read when the next one is known.
        """
        rows: list[_Step] = []
        while len(rows) < steps:
            row = self._step()
            # One step behind: the step after tells whether a stage of RK4 hid a contact.
            if self._staged:
                last = self._last
                self._last = row
                if last is None:
                    continue
                row = self._with_hidden_force(last, row)
            rows.append(row)
            if not math.isfinite(row.rate):
                break
            if after is None or row.force != 0.0 or row.rate >= 0.0:
                continue
            # It moves apart without a force: it turned back, or has parted.
            if not self._touched:
                break
            if row.penetration <= 0.0:
                steps = min(steps, len(rows) + after)
                after = None
        depths, rates, forces, _, along = zip(*rows, strict=True)
        normal = np.array([depths, rates, forces])
        return normal, np.array(along).T if self.is_oblique else None

    def note(self, steps: int) -> str:
        """Phrase that names other contacts in the first `steps` steps, or, for a launch that never
        touched, the cause that slowed it most; "" without any.

        steps: of the impact; its last step was among those of the last `advance`.
        The model under test also keeps, of all its launches, the geoms that touched, and the speed
        lost to each cause in the launch in which joints and actuators took the most.
        """
        touched = self._touched_until(steps)
        self._opened.others |= touched
        if self._causes is not None:
            taken = self._causes.taken(steps)
            if not self._touched:
                name = max(taken, key=taken.__getitem__)
                if taken[name] > 0:
                    return f"what slowed it most: {name}"
                return ""
            self._keep_shares({name: speed / self._touch_speed for name, speed in taken.items()})
        names = self._place.pair.names_of_others(touched)
        if not names:
            return ""
        return f"other contacts acted: {', '.join(names[:4])}"

    def _touched_until(self, steps: int) -> set[int]:
        """Geoms that touched the two in the first `steps` steps."""
        return {geom for geom, step in self._first_touch.items() if step < steps}

    def _keep_shares(self, shares: dict[str, float]) -> None:
        """Keep what each cause took of a launch's speed, if all but the pair's contact and gravity
        took more of it than in the launches before.

        shares: by cause, speed lost over the speed at touch.
        """
        most = self._opened.shares
        if not self._touch_speed > 0:
            return
        if not most or strange_share(shares) > strange_share(most):
            most |= shares

    def _step(self) -> _Step:
        """Take one step, and read penetration, rate and force of the pair in the state before it; all
        NaN where MuJoCo found the state unstable and reset it.
        """
        data = self._data
        # The state before the step, with its contacts and forces. RK4 leaves others in `data`.
        seen = self._seen
        before = self._before  # its velocities
        reader = self._reader
        if self._staged:
            copy_state(self._model, data, seen)
            self._mujoco.mj_forward(self._model, seen)
        before[:] = self._velocity
        time_before = data.time
        if self._beside is not None:
            copy_state(self._model, data, self._beside.data)
        self._take_step(data)
        self._steps += 1
        # MuJoCo sets the time back where it resets an unstable state.
        if data.time <= time_before or (self._steps == 1 and resets(data)):
            unknown = None if self._along is None else np.full(TANGENTIAL_ROWS, math.nan)
            return _Step(math.nan, math.nan, math.nan, math.nan, unknown)
        # m, N and m/s; no penetration without a contact.
        x, force, rate = reader.read(seen, before)
        if x is not None:
            force = self._force(force, seen)
        else:
            x = self._depth_in_flight(rate, seen)
        free = math.nan
        along = None
        if self._looks_further:
            free, along = self._look_further(x, rate, force)
        if force != 0.0:
            self._touched = True
        if reader.others:
            for geom in reader.other_geoms(seen):
                self._first_touch.setdefault(geom, self._steps - 1)
        self._x = x
        self._rate = rate
        return _Step(x, rate, force, free, along)

    def _look_further(self, x: float, rate: float, force: float) -> tuple[float, Floats | None]:
        """Read of a step what only some launches need: the approach rate after the same step without
        contact, m/s, and the motion along the plate, (8,).

        Called under RK4, for oblique launches, and where causes are looked for.
        x, rate, force: of the pair in the state before the step, m, m/s and N. The returned rate is
        NaN but where a stage of RK4 may hide a contact; the motion is None but for oblique launches.
        Also adds up the causes of the change of speed until the two are apart.
        """
        seen = self._seen
        free = math.nan
        along = None
        # A contact may hide in a stage of RK4 where a step's approach
        # nearly leads to the touch plane.
        if self._staged and force == 0.0:
            reached = x + _STAGE_REACH * self._h * max(rate, 0.0)
            if reached > 0.0:
                free = self._rate_without_contact()
        if self._along is not None:
            along = self._along.row(seen, self._before, self._reader.contact_point(seen), rate)
        if self._causes is not None:
            self._apart |= self._touched and force == 0.0 and x <= 0.0 and rate < 0.0
            # Of an impact the steps with a force count; before the touch every step does, for
            # a launch that may never touch.
            if not self._apart and (force != 0.0 or not self._touched):
                # The impact begins: what slowed the approach before is not part of it.
                if force != 0.0 and not self._touched:
                    self._causes.forget()
                    self._touch_speed = rate
                self._causes.add(self._steps - 1, seen, self._reader.row(seen), self._reader.others)
        return free, along

    def _depth_in_flight(self, rate: float, seen: Any) -> float:
        """Penetration in a state without a contact, m, from that of the step before.

        rate: approach rate in the state, m/s.
        seen: MjData of the state.
        The integrator moved the pair by this new rate, RK4 by the mean of the two. Near the touch
        plane the distance of the geoms is measured instead.
        """
        if self._steps == 1:
            return self._x
        moved_at = 0.5 * (self._rate + rate) if self._staged else rate
        x = self._x + self._h * moved_at
        if abs(x) < NEAR * self._h * max(abs(rate), abs(self._rate)):
            x = self._reader.depth(seen, x)
        if self._touched:
            # Without a force the body has left the touch plane.
            return min(x, 0.0)
        return x

    def _take_step(self, data: Any) -> None:
        """Move `data` on by a step, with the constraints and forces of
        the state before it left in it.
        """
        self._mujoco.mj_step(self._model, data)

    def _force(self, solved: float, seen: Any) -> float:
        """Force of the pair in the step just taken, N: MuJoCo's, or, where a plug-in's law acts by
        impulses, the mean force by the change of momentum.

        solved: force of MuJoCo's solver, N.
        seen: MjData of the state before the step.
        """
        if self._beside is None:
            return solved
        return self._beside.force(
            self._reader.row(seen), self._velocity, self._place.effective_mass
        )

    def _rate_without_contact(self) -> float:
        """The approach rate, m/s, after the step from the state in `_seen`, had no contact acted in
        it.

        The step is taken in `_space.free`, with contacts off in the model meanwhile.
        """
        model = self._model
        data = self._space.free
        copy_state(model, self._seen, data)
        flags = model.opt.disableflags
        model.opt.disableflags = flags | int(self._mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self._mujoco.mj_step(model, data)
        model.opt.disableflags = flags
        reader = self._reader
        point = reader.contact_point(with_kinematics(data, model))
        return float(self._place.pair.approach_row(data, point, reader.normal) @ data.qvel)

    def _with_hidden_force(self, step: _Step, after: _Step) -> _Step:
        """The step with the mean force that its change of rate shows, where a stage of RK4 had a
        contact but the state before had none; another step as it is.

        after: the step that followed, whose rate is that at this one's end.
        """
        # A stage of RK4 may touch although the states at both ends of the step do not: the solver
        # reports no force then, but the change of the rate shows one.
        if step.force != 0.0 or math.isnan(step.free_rate):
            return step
        acceleration = (step.free_rate - after.rate) / self._h
        noise = self._noise * max(abs(step.rate), abs(after.rate)) / self._h
        if not abs(acceleration) > noise:
            return step
        self._touched = True
        return step._replace(force=self._place.effective_mass * acceleration)


Flight = TypeVar("Flight", bound=MujocoFlight)


class Flights(Simulation, Generic[Flight]):
    """Launches under way, each by itself."""

    def __init__(self, flights: Sequence[Flight]) -> None:
        self._flights = list(flights)
        self._looks_along = any(flight.is_oblique for flight in flights)

    def keep(self, which: Flags) -> None:
        """Go on with these launches only."""
        self._flights = [flight for flight, kept in zip(self._flights, which, strict=True) if kept]

    def notes(self, counts: NDArray[np.int64]) -> Sequence[str]:
        """Names of the other contacts of each launch that has ended; see `Simulation`."""
        ended = np.flatnonzero(counts).tolist()
        return [self._flights[launch].note(int(counts[launch])) for launch in ended]

    def side_by_side(self, records: Sequence[Record]) -> Record:
        """Join the records of single launches into one of all, with NaN after the end of a shorter
        one.

        records: arrays (1, n), of different n; those of the result are (launches, largest n).
        """
        longest = max(record.force.shape[1] for record in records)
        quantities = 3
        if self._looks_along:
            quantities += TANGENTIAL_ROWS
        joined = np.full((quantities, len(records), longest), np.nan)
        for i, record in enumerate(records):
            row = record.rows()[:, 0]
            joined[: len(row), i, : row.shape[1]] = row
        tangential = None
        if self._looks_along:
            tangential = joined[3:]
        penetration, rate, force = joined[:3]
        return Record(penetration, rate, force, tangential, joined)


class MujocoUserSimulation(Flights[MujocoFlight]):
    """Launches in one MjData, each stepped until the two have parted, or for as long as is asked,
    and then the next one.

    flights: in one workspace, each left at its start; one or more.
    after: steps to take once they have parted; None: all that are asked for.
    """

    def __init__(self, flights: Sequence[MujocoFlight], after: int | None) -> None:
        """Begin with the last of the flights inside the MjData, which it was put into last."""
        super().__init__(flights)
        self._inside = flights[-1]
        self._after = after

    def advance(self, steps: int) -> Record:
        """Take up to `steps` steps of each launch, one launch after the other, and record all.

        Each ends `after` steps after the two have parted, or sooner if it turns back without a
        touch.
        Raises EngineFailed for a fatal error of MuJoCo's.
        """
        records = []
        for flight in self._flights:
            if flight is not self._inside:
                self._inside.leave()
                flight.enter()
                self._inside = flight
            records.append(flight.advance(steps, self._after))
        return self.side_by_side(records)


# MuJoCo: launches of a user's model stepped and read in C; the same bits as in Python.

_SOURCE = "engines/mujoco/model/launch.c"
# What functions of the library return for an error of MuJoCo's.
_FATAL_ERROR = -1
_CALLBACKS = ("control", "passive", "act_bias", "act_dyn", "act_gain", "contactfilter", "sensor")


class _Pair(ctypes.Structure):
    """`Pair` of launch.c, which says what its fields are."""

    _fields_ = (
        ("sides", ctypes.c_void_p),
        ("in_trees", ctypes.c_void_p),
        ("geoms", ctypes.c_void_p),
        ("firsts", ctypes.c_int32),
        ("seconds", ctypes.c_int32),
        ("bodies", ctypes.c_int32 * 2),
        ("has_causes", ctypes.c_int32),
        ("near", ctypes.c_double),
        ("onset", ctypes.c_double),
        ("gap", ctypes.c_double),
        ("reach", ctypes.c_double),
    )


class _Launch(ctypes.Structure):
    """`Launch` of launch.c, which says what its fields are."""

    _fields_ = (
        ("point", ctypes.c_double * 3),
        ("normal", ctypes.c_double * 3),
        ("x", ctypes.c_double),
        ("rate", ctypes.c_double),
        ("steps", ctypes.c_int32),
        ("first_force", ctypes.c_int32),
        ("is_apart", ctypes.c_int32),
        ("first_touch", ctypes.c_void_p),
    )


@functools.cache
def loop_in_c() -> ctypes.CDLL | None:
    """Compile and load the loop in C for the installed MuJoCo; None where that cannot be done.

    Its functions are `advance`, for launches; `follow`, for a free body; `read_floor`, for a
    robot that lands; and `fatal_error`, the text of MuJoCo's last fatal error.
    """
    try:
        arguments = plugin.compiler_arguments(Path(backend().__file__).parent)
        library = ctypes.CDLL(str(build(_SOURCE, *arguments)))
    # Without a compiler, without MuJoCo's headers, or on a full disk the loop in Python does it.
    except (HcbenchError, OSError):
        return None
    library.fatal_error.restype = ctypes.c_char_p
    pointer = ctypes.c_void_p
    count = ctypes.c_int
    library.advance.argtypes = [
        *(pointer, pointer, ctypes.POINTER(_Pair), count, pointer, pointer),
        *(count, count, pointer, pointer, pointer, pointer),
    ]
    library.follow.argtypes = [pointer, pointer, count, pointer, pointer, pointer]
    library.read_floor.argtypes = [pointer, pointer, count, pointer, pointer, count, *[pointer] * 6]
    return library


def follow_in_c(
    model: Any, data: Any, contacts: NDArray[np.int32], speeds: Floats, heights: Floats
) -> bool:
    """Step a model with one free body n times in C, and record the motion; return False, having done
    nothing, without the library.

    data: MjData; moved on.
    contacts, speeds, heights: filled, for each of n states: the number of contacts in the step that
    led to it, (n,), qvel, (n, 6), and the height after the step from it, m, (n,).
    Raises EngineFailed for a fatal error of MuJoCo's.
    """
    library = loop_in_c()
    if library is None:
        return False
    arrays = [array.ctypes.data for array in (contacts, speeds, heights)]
    if library.follow(model._address, data._address, len(contacts), *arrays) == _FATAL_ERROR:
        raise _fatal_error(library)
    return True


def _fatal_error(library: ctypes.CDLL) -> EngineFailed:
    """The error to raise where MuJoCo ended a loop in C: in its words, the last of this thread."""
    return EngineFailed("mujoco", library.fatal_error().decode(errors="replace"), "")


def flights_of(opened: OpenedModel, launches: Sequence[Launch]) -> list[MujocoFlight]:
    """Launches of a model in one workspace, each left at its start; stepped in C where that can be.

    Raises UserError for a launch that the joints cannot make.
    """
    space = LaunchWorkspace.of(opened, opened.stepped)
    kind: Callable[[OpenedModel, Launch, LaunchWorkspace], MujocoFlight] = MujocoFlight
    if _is_plain(opened, launches, space) and loop_in_c() is not None:
        kind = functools.partial(CompiledFlight, pair=PairInC(opened))
    flights = []
    for launch in launches:
        flights.append(kind(opened, launch, space))
        flights[-1].leave()
    return flights


def _is_plain(opened: OpenedModel, launches: Sequence[Launch], space: LaunchWorkspace) -> bool:
    """Say whether launches need nothing that the loop in C lacks.

    It has no RK4, no plug-in of hcbench's that sets e, no motion along the plate and no distance to
    height fields. A callback in Python would need the interpreter in each step.
    launches: all that are to be stepped.
    space: their memory, which has parts for what they need.
    """
    mujoco = backend()
    return (
        space.free is None
        and space.beside is None
        and opened.place.pair.height_field < 0
        and not any(launch.is_oblique for launch in launches)
        and all(getattr(mujoco, f"get_mjcb_{name}")() is None for name in _CALLBACKS)
    )


class PairInC:
    """The pair of a model under test for launch.c, which all of its launches share.

    fields: a `_Pair`, valid as long as this object.
    """

    def __init__(self, opened: OpenedModel) -> None:
        """Describe the pair of an opened model at its place of touch.

        `firsts` and `seconds` are how many of `geoms` belong to the first and the second part.
        """
        pair = opened.place.pair
        # What `fields` points into: it is freed with this object, not sooner.
        self._arrays = (
            np.ascontiguousarray(pair.sides, dtype=np.int8),
            pair.in_trees.astype(np.uint8),
            np.array(pair.geoms, dtype=np.int32),
        )
        sides, in_trees, geoms = (array.ctypes.data for array in self._arrays)
        self.fields = _Pair(
            sides=sides,
            in_trees=in_trees,
            geoms=geoms,
            firsts=len(pair.first.geoms),
            seconds=len(pair.second.geoms),
            bodies=(pair.first.body, pair.second.body),
            has_causes=pair.more_than_contacts,
            near=NEAR,
            onset=opened.place.contact.onset,
            gap=opened.place.gap,
            reach=pair.reach,
        )


class CompiledFlight(MujocoFlight):
    """One launch of a placed pair, stepped by MuJoCo and read in C, by `CompiledSimulation`.

    addresses: of its `_Launch` and of its state, for C.
    data: MjData in which it is stepped.
    """

    def __init__(
        self, opened: OpenedModel, launch: Launch, space: LaunchWorkspace, pair: PairInC
    ) -> None:
        """Put the pair where the launch begins.

        opened: the model under test, with its pair at touch.
        space: MjData in which this launch is stepped.
        pair: of the model under test, for C.
        Only normal launches come here.
        """
        super().__init__(opened, launch, space)
        contact = opened.place.contact
        self.data = space.data
        self.pair = pair
        self._touch_steps = np.full(self._model.ngeom, -1, dtype=np.int32)
        self._launch = _Launch(
            point=tuple(contact.point),
            normal=tuple(contact.normal),
            x=self._x,
            rate=self._rate,
            first_force=-1,
            first_touch=self._touch_steps.ctypes.data,
        )

        # What `advance` of launch.c takes of it.
        self.addresses = (ctypes.addressof(self._launch), self._state.ctypes.data)

    def _begin_reading(self) -> None:
        """Read nothing: the loop in C does."""

    def read_on(self, read: Floats, parts: Floats, is_counted: NDArray[np.uint8]) -> None:
        """Note the touch in steps that C has taken, and keep what each cause added to the approach,
        from the first step with a force on.

        read: penetration (m), rate (m/s) and force (N) of each step, (n, 3).
        parts: accelerations of the approach by each of NAMES, m/s², (n, causes), known where
        `is_counted`, (n,).
        """
        steps = self._launch.steps
        begin = steps - len(read)
        first_force = self._launch.first_force
        self._touched = first_force >= 0
        if self._causes is None:
            return
        counted = np.flatnonzero(is_counted)
        if first_force >= begin:
            self._causes.forget()
            self._touch_speed = float(read[first_force - begin, 1])
            counted = counted[counted >= first_force - begin]
        self._causes.keep((begin + counted).tolist(), parts[counted])

    def _touched_until(self, steps: int) -> set[int]:
        """Geoms that touched the two in the first `steps` steps."""
        touched = (self._touch_steps >= 0) & (self._touch_steps < steps)
        return set(np.flatnonzero(touched).tolist())


class CompiledSimulation(Flights[CompiledFlight]):
    """Launches in one MjData, all stepped and read in one call of C.

    flights: of one model under test, in one workspace, each left at its start; one or more.
    after: steps to take once they have parted; None: all that are asked for.
    """

    def __init__(
        self, opened: OpenedModel, flights: Sequence[CompiledFlight], after: int | None
    ) -> None:
        """Take up launches, each left at its start.

        opened: the model under test.
        flights: one or more, in one workspace.
        after: steps to take once the two have parted; None: all that are asked for.
        """
        super().__init__(flights)
        self._opened = opened
        self._data = flights[0].data
        self._pair = flights[0].pair
        self._after = -1 if after is None else after

    def advance(self, steps: int) -> Record:
        """Take up to `steps` steps of each launch, one launch after the other, and record all.

        Each ends some steps after the two have parted, or sooner if it turns back.
        Raises EngineFailed for a fatal error of MuJoCo's, and where there is no memory for a step.
        """
        library = loop_in_c()
        assert library is not None, "flights_of makes such launches only with a library"
        count = len(self._flights)
        # NaN after the end of each launch.
        read = np.full((count, steps, 3), np.nan)
        parts = np.empty((count, steps, len(NAMES)))
        is_counted = np.zeros((count, steps), dtype=np.uint8)
        taken = np.zeros(count, dtype=np.int32)
        launches, states = zip(*(flight.addresses for flight in self._flights), strict=True)
        pointers = ctypes.c_void_p * count
        model = self._opened.model
        for flight in self._flights:
            flight.settle()
        with captured_warnings() as warned:
            result = library.advance(
                *(model._address, self._data._address, self._pair.fields, count),
                *(pointers(*launches), pointers(*states), steps, self._after),
                *(array.ctypes.data for array in (read, parts, is_counted, taken)),
            )
            if result == _FATAL_ERROR:
                raise _fatal_error(library)
        self._opened.warned.extend(warned)
        if result < 0:
            raise EngineFailed("mujoco", "no memory for a step", "a model that fits into memory")
        for i, flight in enumerate(self._flights):
            n = int(taken[i])
            flight.read_on(read[i, :n], parts[i], is_counted[i, :n])
        longest = int(taken.max())
        joined = np.ascontiguousarray(read[:, :longest].transpose(2, 0, 1))
        penetration, rate, force = joined
        return Record(penetration, rate, force, whole=joined)


def simulation_of(
    opened: OpenedModel, launches: Sequence[Launch], after: int | None
) -> Flights[Any]:
    """Launches of a model under way, stepped in C where that can be.

    after: steps to take once the two have parted; None: all that are asked for.
    Raises UserError for a launch that the joints cannot make.
    """
    # Each look at one of `Launches` makes it, and checks it, again.
    flights = flights_of(opened, list(launches))
    compiled = [flight for flight in flights if isinstance(flight, CompiledFlight)]
    if compiled:
        return CompiledSimulation(opened, compiled, after)
    return MujocoUserSimulation(flights, after)
