"""Launches and impacts by the thousand: an array for each quantity;
objects are made when asked for.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any, Self, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from hcbench.terms.impact import Floats, Impact, Launch, Loop, Status

Flags = NDArray[np.bool_]
Whole = NDArray[np.int64]
Objects = NDArray[np.object_]

STATUSES = tuple(Status)
_CODES = {status: code for code, status in enumerate(STATUSES)}
_PARTED = _CODES[Status.PARTED]
_RESTED = _CODES[Status.RESTED]


One = TypeVar("One")


def even_size(count: int, most: int) -> int:
    """The size of as few equal groups of `count` launches as hold at most `most` each."""
    return math.ceil(count / math.ceil(count / most))


class Columns(Sequence[One]):
    """A sequence of objects, kept as their fields: arrays, or columns again, of one length."""

    __slots__ = ()

    @overload
    def __getitem__(self, index: int) -> One: ...
    @overload
    def __getitem__(self, index: slice) -> Self: ...
    def __getitem__(self, index: int | slice) -> One | Self:
        return self.take(index) if isinstance(index, slice) else next(iter(self.take([index])))

    def take(self, which: Any) -> Self:
        """A copy with some of the rows, in the order of `which`: an index array, a mask or a slice."""
        taken = []
        for column in self._values():
            if isinstance(column, Columns):
                taken.append(column.take(which))
            else:
                taken.append(column[which])
        return type(self)(*taken)

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Several of them joined, one after the other; at least one."""
        if len(parts) == 1:
            return parts[0]
        return cls(*map(_joined, zip(*(part._values() for part in parts), strict=True)))

    def _values(self) -> list[Any]:
        return [getattr(self, field.name) for field in fields(self)]  # type: ignore[arg-type]


def _joined(values: Sequence[Any]) -> Any:
    """Arrays, or columns of one kind, end to end."""
    if isinstance(values[0], np.ndarray):
        return np.concatenate(values)
    return type(values[0]).joined(values)


@dataclass(frozen=True, slots=True, eq=False)
class Launches(Columns[Launch]):
    """A sequence of `Launch`, each attribute a column in the same unit and frame.

    speed (m/s), phase (share of a step), height (m, NaN for none): shape (n,); slip: (n, 2), m/s;
    spin: (n, 3), rad/s.
    """

    speed: Floats
    phase: Floats
    height: Floats
    slip: Floats
    spin: Floats

    @classmethod
    def of(cls, launches: Sequence[Launch]) -> Launches:
        """The columns of launches; the launches themselves where they are columns already."""
        if isinstance(launches, Launches):
            return launches
        rows = []
        for launch in launches:
            # A column of floats has NaN for a launch without a height.
            height = math.nan
            if launch.height is not None:
                height = launch.height
            # In the order of `of_table`.
            rows.append((launch.speed, launch.phase, height, *launch.slip, *launch.spin))
        return cls.of_table(np.array(rows, dtype=np.float64).reshape(-1, 8))

    @classmethod
    def of_table(cls, table: Floats) -> Launches:
        """Launches from a table, (n, 8), of which their columns are views.

        table: of each launch speed, m/s; phase, 0 to 1; height, m, NaN for none; slip, m/s (2
        columns); spin, rad/s (3 columns).
        """
        return cls(
            speed=table[:, 0],
            phase=table[:, 1],
            height=table[:, 2],
            slip=table[:, 3:5],
            spin=table[:, 5:],
        )

    @classmethod
    def touching(
        cls,
        speed: Floats,
        phase: Floats,
        timestep: float,
        gravity: float,
        slip: Floats,
        spin: Sequence[float],
        steps_most: float,
        share: float,
    ) -> Launches:
        """Launches that touch at these speeds and phases under gravity, started a few steps before.

        speed: at touch, m/s, (n,).
        phase: where in a step they touch, 0 to 1, (n,).
        slip: along the bodies' way on the plate, m/s, (n,).
        spin: of all, rad/s, (3,).
        timestep: h, s.
        gravity: g, m/s², into the plate; for 0 the launches start at these speeds, without a
        height.
        steps_most: steps of free fall before the touch, at most.
        share: by which the integrator's free flight at height z keeps (v + share g h)² + 2 g z: 1/2
        for semi-implicit Euler, 0 for exact flight.
        """
        count = len(speed)
        spins = np.tile(np.array(spin, dtype=np.float64), (count, 1))
        slips = np.zeros((count, 2))
        slips[:, 0] = slip
        if gravity <= 0.0:
            return cls(
                speed=speed, phase=phase, height=np.full(count, np.nan), slip=slips, spin=spins
            )
        gain = gravity * timestep  # m/s a step
        # Whole steps of flight before that of the touch: as many as need no throw upwards.
        steps = np.minimum(steps_most, np.floor(speed / gain - share - phase))
        flight = timestep * (steps + phase)  # s
        start = np.maximum(0.0, speed - gain * (steps + phase + share))
        height = flight * (speed - 0.5 * gravity * flight)
        # So slow that no whole step fits: it falls from rest, from the height that gives its speed.
        falls = steps < 0
        fallen = np.maximum(0.0, speed * speed - (share * gain) * (share * gain))
        start = np.where(falls, 0.0, start)
        height = np.where(falls, fallen / (2.0 * gravity), height)
        return cls(speed=start, phase=phase, height=height, slip=slips, spin=spins)

    def __len__(self) -> int:
        return len(self.speed)

    def __iter__(self) -> Iterator[Launch]:
        rows = zip(*(column.tolist() for column in self._values()), strict=True)
        for speed, phase, height, slip, spin in rows:
            yield Launch(
                speed, phase, None if math.isnan(height) else height, tuple(slip), tuple(spin)
            )

    # As bytes, which every version of NumPy reads.
    def __reduce__(self) -> tuple[Any, ...]:
        table = np.column_stack([self.speed, self.phase, self.height, self.slip, self.spin])
        return _launches_of, (table.tobytes(),)

    @property
    def is_oblique(self) -> Flags:
        """Mask of the launches with slip or spin, shape (n,); False for
        those straight along the normal.
        """
        return np.asarray(self.slip.any(axis=1) | self.spin.any(axis=1))

    def clearance(self, timestep: float) -> Floats:
        """Clearance of each launch, as `Launch.clearance`, m, shape (n,)."""
        return np.where(
            np.isnan(self.height), (2.0 + self.phase) * timestep * self.speed, self.height
        )

    def touch_speed(self, timestep: float, gravity: float) -> Floats:
        """Speed of each launch at touch, as `Launch.touch_speed`, m/s, shape (n,)."""
        if gravity == 0.0:
            return np.abs(self.speed)
        gained = 2.0 * gravity * self.clearance(timestep)
        return np.asarray(np.sqrt(np.maximum(0.0, self.speed * self.speed + gained)))

    def flight_time(self, timestep: float, gravity: float) -> Floats:
        """Time from release to touch of each launch, s, (n,).

        inf for one that never arrives, without speed and gravity.
        timestep: s.
        gravity: m/s².
        """
        clearance = self.clearance(timestep)
        # Under constant gravity the mean speed is half the sum of those at both ends.
        sum_of_speeds = self.speed + self.touch_speed(timestep, gravity)
        times = np.full(len(self), np.inf)
        np.divide(2.0 * clearance, sum_of_speeds, out=times, where=sum_of_speeds > 0.0)
        times[clearance <= 0.0] = 0.0
        return times


def _launches_of(table: bytes) -> Launches:
    return Launches.of_table(np.frombuffer(table).reshape(-1, 8))


def _listed(column: NDArray[Any]) -> list[Any]:
    """A column's values, shape (n,), as a list, each NaN being the one object `np.nan`.

    Python holds tuples with the same NaN object to be equal; so impacts with equal numbers are
    equal, too.
    """
    values: list[Any] = column.tolist()
    if column.dtype == np.float64 and np.isnan(column).any():
        return [np.nan if value != value else value for value in values]  # noqa: PLR0124
    return values


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """Record of several launches simulated together: time, s, (n,); states:
    penetration, rate, force; (3, b, n).
    """

    time: Floats
    states: Floats

    def loop(self, row: int, start: int, count: int) -> Loop:
        """The force loop of one launch: `count` steps from `start` on, which is at time 0."""
        return Loop(self.time[:count], *self.states[:, row, start : start + count])


@dataclass(frozen=True, slots=True, eq=False)
class Impacts(Columns[Impact]):
    """A sequence of `Impact`; each column has what its attribute of that name has, in the same unit,
    shape (n,).

    status: indices into STATUSES.
    source: a `Recorded` that has the loop, in a row from a step on (start); or the loop itself, or
    None.
    """

    launches: Launches
    status: Whole
    reason: Objects
    speed_in: Floats
    speed_out: Floats
    duration: Floats
    penetration_max: Floats
    force_max: Floats
    speed_after_force: Floats
    samples: Whole
    tangential: Objects
    source: Objects
    row: Whole
    start: Whole

    @classmethod
    def of(cls, impacts: Sequence[Impact]) -> Impacts:
        """The columns of impacts; the impacts themselves where they are columns already.

        A single impact has its own loop, so that is its `source`, with row and start 0.
        """
        if isinstance(impacts, Impacts):
            return impacts
        columns: dict[str, Any] = {
            "launches": Launches.of([impact.launch for impact in impacts]),
            "status": np.array([_CODES[impact.status] for impact in impacts], dtype=np.int64),
            "row": np.zeros(len(impacts), np.int64),
            "start": np.zeros(len(impacts), np.int64),
        }
        for field in fields(cls):
            if field.name in columns:
                continue
            # Types are text under `from __future__ import annotations`.
            kind = {"Floats": np.float64, "Whole": np.int64}.get(str(field.type), np.object_)
            name = field.name
            if name == "source":
                name = "loop"
            # Filled in place: NumPy would make an array of arrays out of objects such as loops.
            column = np.empty(len(impacts), kind)
            column[:] = [getattr(impact, name) for impact in impacts]
            columns[field.name] = column
        return cls(**columns)

    def __len__(self) -> int:
        return len(self.status)

    def __iter__(self) -> Iterator[Impact]:
        return self.objects(self.launches)

    def objects(self, launches: Iterable[Launch]) -> Iterator[Impact]:
        """An `Impact` of each row, with its launch from `launches`, which are as many and in the
        same order.

        Raises ValueError for more or fewer launches.
        """
        columns = zip(
            launches,
            _listed(self.status),
            _listed(self.reason),
            _listed(self.speed_in),
            _listed(self.speed_out),
            _listed(self.duration),
            _listed(self.penetration_max),
            _listed(self.force_max),
            _listed(self.samples),
            _listed(self.source),
            _listed(self.row),
            _listed(self.start),
            _listed(self.tangential),
            _listed(self.speed_after_force),
            strict=True,
        )
        for (
            launch,
            status,
            reason,
            speed_in,
            speed_out,
            duration,
            penetration,
            force,
            samples,
            source,
            row,
            start,
            along_plate,
            speed_after_force,
        ) in columns:
            loop = source
            if isinstance(source, Recorded):
                loop = source.loop(row, start, samples)
            # In the order of the fields of `Impact`.
            yield Impact(
                launch,
                STATUSES[status],
                reason,
                speed_in,
                speed_out,
                duration,
                penetration,
                force,
                samples,
                loop,
                along_plate,
                speed_after_force,
            )

    @property
    def is_measured(self) -> Flags:
        """Mask of the impacts that have a restitution, shape (n,): those
        that parted or came to rest.
        """
        return np.asarray((self.status == _PARTED) | (self.status == _RESTED))

    @property
    def restitution(self) -> Floats:
        """e of each impact, shape (n,): speed out over speed in; 0 if it came to rest, NaN if it
        has none.
        """
        e = np.full(len(self), np.nan)
        parted = (self.status == _PARTED) & (self.speed_in > 0.0)
        np.divide(self.speed_out, self.speed_in, out=e, where=parted)
        e[self.status == _RESTED] = 0.0
        return e
