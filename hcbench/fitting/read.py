"""Files of measurements: what kind one is, by its header, and the data set in it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hcbench.fitting.assumed import completed, is_train, scaled_by_fall
from hcbench.fitting.column_names import (
    DATA_KINDS,
    EXPECTED_COLUMNS,
    QUANTITY_OF,
    explained,
    is_unit_of,
    meanings_of,
    role_of,
)
from hcbench.fitting.columns import (
    DataColumns,
    bounce_numbers,
    columns_of,
    kind_of,
    require_one_drop,
    row_order,
)
from hcbench.fitting.datasets import TouchTimes, rounding_of
from hcbench.fitting.facts import require_usual_fall
from hcbench.fitting.force import fit_loop, fit_pulse
from hcbench.fitting.heights import DropHeights, Heights, SpeedPairs
from hcbench.fitting.listening import listen, quick_score, with_contact
from hcbench.fitting.numbers_in_text import rows_in_text
from hcbench.fitting.pushes import is_single_push, recording_of, require_one_ball, weighed_ball
from hcbench.fitting.recording import is_sound, read_recording
from hcbench.fitting.sheets import read_sheets
from hcbench.fitting.signals import evened, signal_in
from hcbench.fitting.table import Table, computed
from hcbench.fitting.tables import tables_of
from hcbench.fitting.track import track_of, upright
from hcbench.system.errors import UserError
from hcbench.system.text import sanitized
from hcbench.terms.bounds import require_bounds

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.force import ForceFit
    from hcbench.fitting.recording import Indices, Picks, Recording
    from hcbench.fitting.setup import MeasurementSetup
    from hcbench.fitting.sheets import Sheet
    from hcbench.fitting.signals import Signal
    from hcbench.terms.impact import Floats


@dataclass(frozen=True, slots=True)
class Excerpt:
    """Part of a recording.

    begin, end: s.
    train: from 0, and touches, from 1: None where not chosen.
    """

    begin: float = 0.0
    end: float | None = None
    train: int | None = None
    touches: range | None = None


WHOLE = Excerpt()
KINDS = ("sound", "signal", *dict.fromkeys(DATA_KINDS.values()))
_MOST_TOUCHES = 60
# Each pair adds an unknown; so many take a dozen seconds.
_MOST_PAIRS = 500
_LEAST_SAMPLES = 12
# Of so many steps one may be wrong.
_STEPS_FOR_A_RISE = 4
# Share of the largest height by which noise may lift one above the height before it.
_OF_NOISE = 0.02
# Share by which a column of e may differ from the columns that it is computed from.
_OF_E = 0.05
# Impacts from which a law is fitted.
LEAST_PAIRS = 3
# Speeds that differ by less than this share are one speed.
_ONE_SPEED = 1e-6
# Share by which a first height may differ from that of the drop, and is it.
_SAME_HEIGHT = 1e-6
# Flights that are all shorter, s, are those of no ball one sees: contacts, or another unit.
_SHORTEST = 10e-3
# The same of flights that are all longer: those of a ball from 120 m.
_LONGEST = 10.0
# Roles that leave a column of times to mean something else than touches.
_OF_SOMETHING_ELSE = frozenset({"height_in", "speed", "speed_in", "speed_out"})
# Meanings of a column by which rows differ.
_NUMBERS = {"number", "bounce", "touch"}
# Bounces in a row that may be missing from a table: numbers with wider gaps count something else.
_MOST_UNSEEN = 3
# Rounding of times, s, or heights, m, below which two drops do not agree by chance.
_NO_CHANCE = 1e-4
# Bounces not seen that a sentence names.
_MOST_SHOWN = 6
_EXPECTED_SIGNAL = (
    "100 or more rows of a time in even steps and a value, such as time [s],force [N]"
)
# Letters of the trains in a recording, the likeliest first.
_TRAINS = "ABCDEF"


def read_dataset(
    path: Path, setup: MeasurementSetup, kind: str | None = None, part: Excerpt = WHOLE
) -> Dataset:
    """The data set in a file of one drop.

    Raises UserError as `read_datasets`, and for a file with several drops.
    """
    found = read_datasets(path, setup, kind, part)
    if len(found) > 1:
        names = ", ".join(one.name for one in found[:3])
        raise UserError(sanitized(path.name), f"{len(found)} drops: {names}", "one")
    return found[0]


def read_datasets(
    path: Path, setup: MeasurementSetup, kind: str | None = None, part: Excerpt = WHOLE
) -> list[Dataset]:
    """The data sets in a file, one for each drop: a workbook may have several sheets, and a sheet
    several drops.

    kind: one of KINDS, in place of what the header says.
    part: of a recording, what to take.

    Raises UserError with the file, the line, what it has and what was expected.
    """
    if kind == "sound" or (kind is None and is_sound(path)):
        recording = read_recording(path, quick_score, part.begin, part.end)
        return [_touches_in(recording, setup, part)]
    signal = signal_in(path) if kind in (None, "signal") else None
    if signal is not None:
        return [_touches_of_signal(signal, setup, part)]
    if kind == "signal":
        raise UserError(sanitized(path.name), "no signal over time", _EXPECTED_SIGNAL)
    if part != WHOLE:
        slot = "--from" if part.train is None else "--touches"
        raise UserError(slot, f"given for {path.name}, which is not a recording", "a .wav")
    sheets = read_sheets(path)
    read = _read(sheets, setup, kind)
    if read.refused:
        # No table, or not all: the numbers may stand between words.
        in_text = [replace(sheet, rows=rows_in_text(sheet.text)) for sheet in sheets]
        read_in_text = _read(in_text, setup, kind)
        if read_in_text.count_impacts() > read.count_impacts():
            read = read_in_text
        elif not read.found:
            worst = _worst([*read.refused, *read_in_text.refused])
            raise _with_what_is_said(sheets, worst)
    _require_all_read(read)
    require_usual_fall(sheets, read.found, setup)
    return _different([one.data for one in read.found])


class _Found(NamedTuple):
    """A table that is read: its columns by role, and the data set of them."""

    columns: DataColumns
    data: Dataset


class _Refused(NamedTuple):
    """A table that cannot be read, or None for a sheet without one, and the reason."""

    table: Table | None
    error: UserError


class _SheetsRead(NamedTuple):
    """The tables of all sheets: those that are read, and those that are not."""

    found: list[_Found]
    refused: list[_Refused]

    def count_impacts(self) -> int:
        """Number of impacts in all that is read."""
        return sum(len(one.data.pairs()[0]) for one in self.found)


def _read(sheets: list[Sheet], setup: MeasurementSetup, kind: str | None) -> _SheetsRead:
    """Read the tables of sheets; a refusal is returned, since another table may do.

    kind: one of KINDS, in place of what the headers say.
    """
    found: list[_Found] = []
    refused: list[_Refused] = []
    for table in _tables(sheets):
        if isinstance(table, UserError):
            refused.append(_Refused(None, table))
            continue
        try:
            found.append(_read_table(table, setup, kind))
        except UserError as error:
            refused.append(_Refused(table, error))
    return _SheetsRead(found, refused)


def _read_table(table: Table, setup: MeasurementSetup, kind: str | None) -> _Found:
    """The data set of a table with its columns. Raises UserError, `explained`, for what is none."""
    with explained(table.name, table.header), computed(table.name):
        scaled, said = scaled_by_fall(table, setup.gravity.value)
        columns, of_kind = _understood(scaled, kind)
        columns = _assuming(columns, said)
        if of_kind in ("force", "loop"):
            got = "forces among other files"
            raise UserError(table.name, got, "one file of forces alone")
        return _Found(columns, _READERS[of_kind](columns, setup))


def _tables(sheets: list[Sheet]) -> Iterator[Table | UserError]:
    """Yield each table of the sheets, and for each sheet whose tables cannot be read the reason.

    Sheets without rows are passed over.
    """
    for sheet in sheets:
        if not sheet.rows:
            continue
        try:
            yield from tables_of(sheet)
        except UserError as error:
            yield error


def _worst(refused: list[_Refused]) -> UserError:
    """The refusal, of several, of the table that most looks like data: by its known columns, then its
    rows.
    """

    def likeness(one: _Refused) -> tuple[int, int]:
        if one.table is None:
            return 0, 0
        known = sum(role_of(*name) in QUANTITY_OF for name in one.table.header)
        return known, len(one.table.cells)

    return max(refused, key=likeness).error


def _require_all_read(read: _SheetsRead) -> None:
    """Raise the refusal of a table that has the columns of one that is read, or as many in the same
    sheet: a drop, or its last bounces, would be missing.
    """
    tables = [one.columns.table for one in read.found]
    headers = {table.header for table in tables}
    widths = {(table.name, len(table.header)) for table in tables}
    for table, error in read.refused:
        if table is None:
            continue
        if table.header in headers or (table.name, len(table.header)) in widths:
            raise error


def _different(found: list[Dataset]) -> list[Dataset]:
    """Data sets, without precise times or heights that another one has whole: phyphox writes a
    stopwatch's first times into several sheets. Of rounded ones two drops may be alike.
    """
    kept: list[Dataset] = []
    for data in sorted(found, key=lambda one: -len(_readings(one))):
        readings = _readings(data)
        is_precise = len(readings) > 0 and rounding_of(readings) < _NO_CHANCE
        same = [other for other in kept if type(other) is type(data)]
        if not is_precise or not any(_begins_with(_readings(other), readings) for other in same):
            kept.append(data)
    # By identity: data sets hold arrays, which have no one answer to ==.
    return [data for data in found if any(data is one for one in kept)]


def _readings(data: Dataset) -> Floats:
    """Flights, s, or heights, m, of a drop, one after the other; none of other data."""
    if isinstance(data, TouchTimes):
        return np.diff(data.times)
    return data.heights if isinstance(data, Heights) else np.zeros(0)


def _begins_with(longer: Floats, readings: Floats) -> bool:
    """Say whether readings are the first ones of another drop, of as many or more."""
    return bool(np.allclose(longer[: len(readings)], readings, rtol=1e-6))


def _understood(table: Table, asked: str | None) -> tuple[DataColumns, str]:
    """The columns of a table by role, rows without a reading left out and times rising, and the kind of
    data.

    asked: one of KINDS, or None.
    Raises UserError where the columns are not data of a kind.
    """
    table, assumed = completed(table, asked)
    with explained(table.name, table.header):
        columns = replace(columns_of(table, asked), assumed=assumed)
        kind = _kind_of(columns, asked)
        of_kind = _of_bounces(columns, kind, asked)
        return _complete(columns, of_kind), of_kind


def _kind_of(columns: DataColumns, asked: str | None) -> str:
    """The kind of data in a table, by its columns or as asked for. Raises
    UserError where they do not go.

    asked: one of KINDS, or None.
    """
    name = columns.table.name
    roles = columns.roles
    kind = asked or kind_of(roles)
    if kind is None:
        if "restitution" in roles or "squared" in roles:
            raise UserError(name, "e without a speed", EXPECTED_COLUMNS)
        if {"frame", "sample"} & columns.places.keys():
            expected = "a time, or a line such as '# fps: 240' before the table"
            raise UserError(name, "frames without their rate", expected)
        names = ", ".join(text for text, _ in columns.table.header if text)
        raise UserError(name, f"columns {names}", EXPECTED_COLUMNS)
    other = sorted(roles & _OF_SOMETHING_ELSE)
    if kind == "times" and other and asked is None:
        got = f"times beside a {other[0].replace('_in', ' before').replace('_out', ' after')}"
        advice = "Leave the other column out if the times are those of touches"
        raise UserError(name, got, EXPECTED_COLUMNS, advice)
    needed = [of for of, of_kind in DATA_KINDS.items() if of_kind == kind]
    if not any(of <= roles for of in needed):
        missing = ", ".join(sorted(needed[0] - roles))
        raise UserError(name, f"no column {missing}", f"what --as {kind} needs")
    return kind


def _of_bounces(columns: DataColumns, kind: str, asked: str | None) -> str:
    """The kind of data, "heights" or "times" where a time and a height are those of each bounce.

    A track rises again after each touch; heights of bounces fall from row to row.
    """
    if kind != "track" or asked is not None:
        return kind
    heights = columns.table.numbers(columns.places["height"])
    if len(heights) > 2 and (np.diff(heights) < 0).all():
        name = columns.table.header[columns.places["time"]][0] if "time" in columns.places else ""
        return "times" if meanings_of(name) & {"touch", "bounce"} else "heights"
    return kind


def _complete(columns: DataColumns, kind: str) -> DataColumns:
    """The columns without rows that lack a reading, and with times that rise.

    kind: of the data, whose columns the table has.
    Of successive bounces only those before the first and after the last reading are left out: a gap
    among them counts. A list from the last to the first row, or shuffled beside the numbers of its
    rows, is turned.
    Raises UserError where no row is left, and for bounces of several drops.
    """
    are_in_a_row = kind in ("times", "heights")
    columns = columns.taken(_rows_given(columns, kind))
    if are_in_a_row:
        require_one_drop(columns)
        order = row_order(columns)
        if order is not None:
            return columns.taken(order.tolist())
    has_times = "time" in columns.places
    if has_times and kind in ("times", "track", "force"):
        times = columns.table.numbers(columns.places["time"])
        is_turned = len(times) > 1 and bool((np.diff(times) < 0).all())
        # Times of touches that do not rise may be exchanged, or of another drop; samples are sorted.
        is_sortable = kind != "times" and len(set(times.tolist())) == len(times)
        if is_turned or is_sortable:
            return columns.taken(np.argsort(times, kind="stable").tolist())
    is_numbered = any(meanings_of(name) & _NUMBERS for name, _ in columns.table.header)
    if has_times or (are_in_a_row and is_numbered):
        # Heights alone may be the same twice.
        return columns.taken(_without_copies(columns))
    return columns


def _rows_given(columns: DataColumns, kind: str) -> list[int]:
    """The rows that have all readings of a kind of data, and those between such rows where they are
    successive bounces. Raises UserError where no row has them.
    """
    needed = next(
        roles for roles, of in DATA_KINDS.items() if of == kind and roles <= columns.roles
    )
    given = np.ones(len(columns.table.cells), dtype=bool)
    for role in needed & columns.places.keys():
        given &= columns.table.is_given(columns.places[role])
    kept = np.flatnonzero(given)
    if not len(kept):
        raise UserError(columns.table.name, "no row has all of its numbers", "rows of numbers")
    if kind in ("times", "heights"):
        return list(range(int(kept[0]), int(kept[-1]) + 1))
    return [int(row) for row in kept]


def _without_copies(columns: DataColumns) -> list[int]:
    """Rows, without those that say the same as the row before them."""
    cells = columns.table.cells
    return [i for i in range(len(cells)) if not i or cells[i] != cells[i - 1]]


def has_force(path: Path, kind: str | None = None) -> bool:
    """True for a file of forces.

    kind: as for `read_dataset`.
    """
    return _force_columns(path, kind) is not None


def _force_columns(path: Path, kind: str | None) -> tuple[DataColumns, str] | None:
    """The columns of a file of forces, and their kind, "force" or "loop"; None for any other file.

    kind: as for `read_dataset`. Raises UserError for a table with a force that is not fitted.
    """
    if kind not in (None, "force", "loop") or is_sound(path):
        return None
    signal = signal_in(path)
    if kind is None and signal is not None and not is_single_push(signal):
        # Touches of a ball, or no force at all.
        return None
    for table in _tables(read_sheets(path)):
        if isinstance(table, UserError) or not _may_have_force(table):
            continue
        with explained(table.name, table.header):
            columns = columns_of(completed(table, kind)[0], kind)
            if "force" not in columns.roles:
                continue
            if kind is None and kind_of(columns.roles) not in ("force", "loop"):
                got = "force without time, or penetration and rate"
                raise UserError(table.name, got, EXPECTED_COLUMNS)
            of_kind = _kind_of(columns, kind)
            return _complete(columns, of_kind), of_kind
    return None


def _may_have_force(table: Table) -> bool:
    """Say whether a column has the name, or the unit, of a force."""
    return any(
        role_of(name, unit) == "force" or is_unit_of(unit, "force") for name, unit in table.header
    )


def read_force(path: Path, setup: MeasurementSetup, kind: str | None = None) -> ForceFit | None:
    """The fit of a file of forces; None for any other file.

    Penetration (m), rate (m/s) and force (N) are fitted as a loop; time (s) and force as a pulse.

    kind: as for `read_dataset`.
    Raises UserError for a force without the other columns, and times that do not rise.
    """
    found = _force_columns(path, kind)
    if found is None:
        return None
    columns, of_kind = found
    with explained(columns.table.name, columns.table.header):
        try:
            return _fitted_force(columns, setup, of_kind)
        except UserError as error:
            raise _with_what_is_said(read_sheets(path), error) from error


def _with_what_is_said(sheets: list[Sheet], error: UserError) -> UserError:
    """An error about an option that is missing, mass or speed, with the line of the file that may tell it;
    any other error as it is.
    """
    unit = {"mass": r"(?:[kmкм]?[gг]|克)\b", "speed": r"(?:[ck]?m/s|km/h)"}.get(error.slot)
    if unit is None:
        return error
    for line in "\n".join(sheet.text for sheet in sheets).splitlines():
        if match := re.search(rf"\d+(?:[.,]\d+)?\s*{unit}", line):
            value = match[0].replace(",", ".")
            advice = f"The file has {line.strip()!r}: give --{error.slot} {value!r} if that is it"
            return UserError(error.slot, error.got, error.expected, advice)
    return error


def _fitted_force(columns: DataColumns, setup: MeasurementSetup, kind: str) -> ForceFit:
    """The fit of columns that have a force, as of `read_force`, which says what it raises."""
    force = columns.get("force")
    if kind == "loop":
        x = columns.get("penetration")
        v = columns.get("rate")
        with computed(columns.table.name):
            return fit_loop(columns.table.name, x, v, force, setup.exponent)
    time = columns.get("time")
    columns.require("time", _rises_at(time), "times that rise")
    even = evened(time)
    if even is not None:
        time = even
    # Plates give the force on the plate or the one on the ball.
    zero = float(np.median(force))
    if zero - force.min() > 2.0 * (force.max() - zero):
        force = -force
    with computed(columns.table.name):
        return fit_pulse(columns.table.name, setup, time, force)


def _touches_of_signal(signal: Signal, setup: MeasurementSetup, part: Excerpt) -> Dataset:
    """The touches that are pulses or clicks of a signal, as `_touches_in`.

    Raises UserError also where pushes on a plate are not those of one ball.
    """
    data = _touches_in(recording_of(signal, part.begin, part.end), setup, part)
    require_one_ball(data)
    weighed, said = weighed_ball(data, signal)
    assumed = "; ".join(filter(None, (signal.assumed, said)))
    return replace(weighed, assumed=assumed)


def _touches_in(recording: Recording, setup: MeasurementSetup, part: Excerpt) -> TouchTimes:
    """The touches heard in a recording, of the likeliest train or of the one asked for.

    Raises UserError for a train that is not heard, too few touches, and flights that no ball has.
    """
    heard = listen(recording, setup)
    train = part.train or 0
    if train >= len(heard):
        trains = ", ".join(_TRAINS[: len(heard)])
        raise UserError("--touches", f"train {_TRAINS[train]}", f"one that is heard: {trains}")
    picks = heard[train]
    if part.touches is not None:
        picks = picks.taken(part.touches)
    if len(picks.times) < setup.least_touches:
        raise too_few_touches(recording.name, len(picks.times), setup.least_touches)
    # A train that the user chose is in no question.
    in_question: tuple[Picks, ...] = ()
    if part.train is None:
        in_question = tuple(heard)
    setup = with_contact(setup, picks.contact_time)
    return TouchTimes(
        recording.name, setup, picks.times, picks.numbers, picks, recording, in_question
    )


def _times(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """The touches of a table of times, of intervals between touches, or of numbers of frames.

    Raises UserError for times that do not rise, and intervals that are not above 0 or of no ball.
    """
    if "time" in columns.places:
        return _touches_at_times(columns, setup)
    if "interval" in columns.places:
        return _touches_after_intervals(columns, setup)
    return _touches_at_frames(columns, setup)


def _touches_at_times(columns: DataColumns, setup: MeasurementSetup) -> TouchTimes:
    """Touches at times, s. A row without a time is a touch that was not seen."""
    seen, numbers = _seen(columns, "time")
    seen = _in_turn(seen)
    times = seen.get("time")
    seen.require("time", _rises_at(times), "times that rise")
    return replace(_touch_times(seen.table.name, setup, times, seen.assumed), numbers=numbers)


def _touches_at_frames(columns: DataColumns, setup: MeasurementSetup) -> TouchTimes:
    """Touches at frames, or samples, that are counted at a known rate."""
    times = columns.get("time")
    clock = "frame" if "frame" in columns.places else "sample"
    columns.require(clock, _rises_at(times), f"{clock}s that rise")
    return _touch_times(columns.table.name, setup, times, columns.assumed)


def _touches_after_intervals(columns: DataColumns, setup: MeasurementSetup) -> TouchTimes:
    """Touches of which each row has the time, s, to the next one; the first is at 0 s."""
    name = columns.table.name
    if (np.diff(bounce_numbers(columns)) > 1).any():
        raise UserError(name, "flights are left out", "each flight, one after the other")
    intervals = columns.get("interval")
    if len(intervals) > 1 and intervals[-1] == 0:
        # The last touch has no interval after it.
        intervals = intervals[:-1]
    columns.require("interval", intervals > 0, "above 0")
    if len(intervals) > 2 and (np.diff(intervals) > 0).all():
        raise UserError(name, "flights that last longer and longer", "each shorter, as of a ball")
    times = np.concatenate([[0.0], np.cumsum(intervals)])
    return _touch_times(name, setup, times, columns.assumed)


def _rises_at(values: Floats) -> NDArray[np.bool_]:
    """For each of n values, True where it is above the one before; True for the first."""
    return np.concatenate([np.array([True]), np.diff(values) > 0])


def _seen(columns: DataColumns, role: str) -> tuple[DataColumns, Indices | None]:
    """The rows of bounces that have a reading, and which bounce each is, from 0 for the first of them,
    (n,); None where all are seen.

    role: "time" or "height". A row without a reading, and a number that is left out, are a bounce
    that was not seen.
    Raises UserError where more than three in a row were not.
    """
    given = np.flatnonzero(columns.table.is_given(columns.places[role]))
    numbers = bounce_numbers(columns)[given]
    seen = columns.taken(given.tolist())
    missing = sorted(set(range(numbers[0], numbers[-1])) - set(numbers.tolist()))
    if not missing:
        return seen, None
    if np.diff(numbers).max() > _MOST_UNSEEN + 1:
        got = f"numbers of bounces that leave out {np.diff(numbers).max() - 1}"
        expected = f"at most {_MOST_UNSEEN} bounces not seen in a row"
        raise UserError(columns.table.name, got, expected)
    event = "touch" if role == "time" else "bounce"
    shown = ", ".join(str(number + 1) for number in missing[:_MOST_SHOWN])
    said = f"no {role} of {event} {shown}, counted from 1: read as not seen"
    return _assuming(seen, said), numbers - numbers[0]


def _assuming(columns: DataColumns, said: str) -> DataColumns:
    """The columns with one more sentence of what is assumed."""
    return replace(columns, assumed="; ".join(filter(None, (columns.assumed, said))))


def _in_turn(columns: DataColumns) -> DataColumns:
    """Rows with the times of two touches that stand in each other's place exchanged, if that alone
    makes times rise; else the rows as they are.
    """
    times = columns.table.numbers(columns.places["time"])
    wrong = np.flatnonzero(np.diff(times) <= 0)
    if len(wrong) != 1:
        return columns
    first = int(wrong[0])
    order = np.arange(len(times))
    order[first] = first + 1
    order[first + 1] = first
    if not is_train(times[order]):
        return columns
    said = f"times {times[first]:g} and {times[first + 1]:g} do not rise: read as exchanged"
    return _assuming(columns.taken(order.tolist()), said)


def _touch_times(
    name: str, setup: MeasurementSetup, times: Floats, assumed: str = ""
) -> TouchTimes:
    """Check the times of touches, s, shape (n,), and make a data set of them.

    Raises UserError for too few or too many of them, a contact that lasts longer than the shortest
    flight, and flights that no ball has.
    """
    if len(times) < setup.least_touches:
        raise too_few_touches(name, len(times), setup.least_touches)
    _require_few(name, len(times), "times")
    flights = np.diff(times)
    got = ""
    if len(flights) and flights.max() < _SHORTEST:
        got = f"flights of at most {flights.max():.2g} s"
    elif len(flights) and flights.min() > _LONGEST:
        got = f"flights of at least {flights.min():.2g} s"
    if got:
        raise UserError(name, got, "those of a bouncing ball", "Look at the unit")
    if setup.contact_time.value >= flights.min():
        got = f"{setup.contact_time.value:g} s, and two touches {flights.min():.3g} s apart"
        raise UserError("contact-time", got, "less than from one touch to the next")
    return TouchTimes(name, setup, times, assumed=assumed)


def _require_few(name: str, count: int, what: str) -> None:
    """Raise UserError for more readings than one ball gives."""
    if count > _MOST_TOUCHES:
        got = f"{count} {what}"
        advice = "Leave out the rattle at the end"
        raise UserError(name, got, f"up to {_MOST_TOUCHES} touches of one ball", advice)


def too_few_touches(name: str, count: int, least: int) -> UserError:
    """The error for a recording with too few touches, with the reason.

    least: 3 with a height, 4 without.
    """
    expected = f"{least} or more"
    advice = "Record more bounces"
    if least == 4:
        expected += " without --height"
        advice += ", or give --height"
    if count == 3:
        advice = "Times alone give the speeds of the flights only: two flights are one e, with no check of it"
    return UserError(name, f"{count} touches", expected, advice)


def _heights(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Check the heights of successive bounces, m, and make a data set of them.

    A first row that is the drop height itself is left out.
    Raises UserError for heights that do not fall, too few or too many of them, and a first bounce
    above the drop.
    """
    columns, numbers = _seen(columns, "height")
    heights = columns.get("height")
    above = np.flatnonzero(heights > 0)
    if 0 < len(above) == above[-1] + 1:
        # After the last bounce that rises, the ball rests at 0.
        columns = columns.taken(above.tolist())
        heights = heights[above]
        numbers = None if numbers is None else numbers[above]
    name = columns.table.name
    columns.require("height", heights > 0, "above 0: the bottom of the ball above the plate")
    require_bounds(f"{name}: height", heights.tolist(), "length", "m")
    drop = None if setup.height is None else setup.height.value
    if drop is not None and len(heights) and abs(heights[0] / drop - 1.0) < _SAME_HEIGHT:
        # The first row is the height of the drop itself: it comes before the first bounce.
        heights = heights[1:]
        numbers = None if numbers is None else numbers[1:] - 1
    _require_falling(columns, _allowed_rise(columns))
    _require_few(name, len(heights), "heights")
    # Heights lie between the touches: one fewer.
    least = setup.least_touches - 1
    if len(heights) < least:
        got = f"{len(heights)} heights"
        raise UserError(name, got, f"{least} or more bounces", "Fewer have no check")
    if drop is not None and heights[0] >= drop:
        got = f"the first bounce rises to {heights[0]:.4g} m, let go at {drop:.4g} m"
        raise UserError("height", got, "a bounce below the drop")
    given = columns.uncertainty("height")
    noise = float(given.mean()) if given.any() else None
    return Heights(name, setup, heights, noise, columns.assumed, numbers)


def _allowed_rise(columns: DataColumns) -> float:
    """Largest rise of a height above the one before it that is none, m: by the last digit that the file
    has, the given uncertainty, or 2 % of the largest height.
    """
    table = columns.table
    place = columns.places["height"]
    # In the unit of the file.
    last_digit = 1.0
    for text in table.texts(place):
        _, point, behind = text.partition(table.style.decimal)
        if point:
            decimals = len(behind) - len(behind.lstrip("0123456789"))
            last_digit = min(last_digit, 10.0**-decimals)
    # More than the digit itself, for rounding of floats.
    of_digit = 1.01 * last_digit * table.scale(place, "position")
    given = float(columns.uncertainty("height").max(initial=0.0))
    return max(of_digit, 3.0 * given, _OF_NOISE * float(columns.get("height").max()))


def _require_falling(columns: DataColumns, allowed: float) -> None:
    """Raise UserError for heights that rise too often to be bounces: a reading or two may be wrong.

    allowed: a rise that noise or rounding may make, m.
    """
    falls = np.diff(columns.get("height")) <= allowed
    if (~falls).sum() > len(falls) // _STEPS_FOR_A_RISE:
        columns.require("height", np.concatenate([[True], falls]), "heights that fall")


def _pairs(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Impacts of which each has a speed before, m/s, or the height of its drop, m, and e or e².

    Raises UserError for speeds that are not above 0, and an e outside of 0 ... 1.2.
    """
    name = columns.table.name
    role = next(one for one in ("speed_in", "speed", "height_in") if one in columns.places)
    size = columns.get(role)
    columns.require(role, size > 0, "above 0")
    speed = size
    u_speed = columns.uncertainty(role)
    drops = None
    if role == "height_in":
        drops = DropHeights(size, u_speed)
        speed, u_speed = drops.speeds(setup.ballistics)
    require_bounds(f"{name}: {role}", speed.tolist(), "speed", "m/s")
    if "restitution" in columns.places:
        e = columns.get("restitution")
        columns.require("restitution", (e >= 0) & (e <= 1.2), "0 ... 1")
        u_e = columns.uncertainty("restitution")
    else:
        squared = columns.get("squared")
        columns.require("squared", (squared >= 0) & (squared <= 1.44), "0 ... 1")
        e = np.sqrt(squared)
        u_e = columns.uncertainty("squared") / (2.0 * np.maximum(e, 1e-3))
    pairs = SpeedPairs(name, setup, speed, e, u_speed, u_e, assumed=columns.assumed, drops=drops)
    return _checked_pairs(pairs)


def _speeds(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Impacts from the speeds before and after each, m/s, or from velocities of opposite signs.

    Raises UserError for a speed before that is not above 0, and for gains of speed in more than a
    quarter of the rows.
    """
    name = columns.table.name
    before = columns.get("speed_in")
    after = columns.get("speed_out")
    if (before * after <= 0.0).all():
        # A velocity is turned round.
        before = np.abs(before)
        after = np.abs(after)
    columns.require("speed_in", before > 0, "a speed above 0")
    require_bounds(f"{name}: speed_in", before.tolist(), "speed", "m/s")
    gains = after > 1.2 * before
    # A row or two may have the speeds in each other's columns.
    if gains.sum() > len(gains) // _STEPS_FOR_A_RISE:
        columns.require("speed_out", ~gains, "from 0 to the speed in")
    columns.require("speed_out", after >= 0, "from 0 to the speed in")
    e = after / before
    _require_e(columns, e)
    u_in = columns.uncertainty("speed_in")
    u_out = columns.uncertainty("speed_out")
    return _checked_pairs(SpeedPairs(name, setup, before, e, u_in, u_out / before, twice=True))


def _require_e(columns: DataColumns, e: Floats) -> None:
    """Raise UserError where a column of e says something else than the speeds, or heights, beside it.

    e: (n,), computed from those. A table without a column of e, and its empty cells, say nothing.
    """
    if "restitution" not in columns.places:
        return
    place = columns.places["restitution"]
    in_percent = columns.table.unit_of(place, "number") == "%"
    written = columns.table.numbers(place)
    if in_percent:
        written = 0.01 * written
    expected = f"{e[0]:.3g}, of the columns before and after"
    off = np.abs(written - e) > _OF_E * np.maximum(e, 0.2)
    columns.require("restitution", ~off | np.isnan(written), expected)


def _energies(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Impacts from the kinetic energies before and after, J: speeds, m/s, by the mass.

    Raises UserError without the mass, for energies of 0 and below, and a gain of energy.
    """
    name = columns.table.name
    before = columns.get("energy_in")
    after = columns.get("energy_out")
    if setup.mass is None:
        raise UserError("mass", f"not given for {name}", "the mass of the ball")
    columns.require("energy_in", before > 0, "above 0")
    columns.require("energy_out", (after >= 0) & (after <= before), "from 0 to the energy before")
    e = np.sqrt(after / before)
    _require_e(columns, e)
    speed = np.sqrt(2.0 * before / setup.mass.value)
    return _checked_pairs(_without_uncertainties(name, setup, speed, e))


def _without_uncertainties(
    name: str, setup: MeasurementSetup, speed: Floats, e: Floats
) -> SpeedPairs:
    """Impacts at speeds, m/s, whose e is v_out/v_in: both (n,), of errors that are to be found."""
    nothing = np.zeros(len(speed))
    return SpeedPairs(name, setup, speed, e, nothing, nothing, twice=True)


def _rises(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Impacts from heights of drops, m, and of their rebounds, m, or the flights after them, s.

    Raises UserError for heights of 0 and below, a rebound above its drop, and rebounds that are not
    the first ones.
    """
    ballistics = setup.ballistics
    before = columns.get("height_in")
    columns.require("height_in", before > 0, "above 0")
    role = "height_out" if "height_out" in columns.places else "interval"
    after = columns.get(role)
    nothing = np.zeros(len(before))
    drops = DropHeights(before, nothing, rebound=after)
    if role == "interval":
        drops = DropHeights(before, nothing, flight=after)
        launches = (ballistics.launch(time) for time in after)
        after = np.array([math.copysign(ballistics.apex(v)[0], v) for v in launches])
    name, _ = columns.table.header[columns.places[role]]
    if any(int(number) > 1 for number in re.findall(r"\d+", name)):
        raise UserError(columns.table.name, f"{name!r}", "the height of the first rebound")
    columns.require(role, (after >= 0) & (after <= before), "a rebound below the drop")
    v_in, _ = drops.speeds(ballistics)
    e = ballistics.launch_to(after) / v_in
    _require_e(columns, e)
    pairs = _without_uncertainties(columns.table.name, setup, v_in, e)
    return _checked_pairs(replace(pairs, drops=drops))


def _checked_pairs(pairs: SpeedPairs) -> SpeedPairs:
    """Return the impacts as they are; raise UserError for data that leave α unknown.

    Needed are LEAST_PAIRS to 500 impacts, two speeds or more, and an e above 0.
    """
    name = pairs.name
    count = len(pairs.speed)
    if count > _MOST_PAIRS:
        advice = "Average those of nearly one speed"
        raise UserError(name, f"{count} impacts", f"up to {_MOST_PAIRS}", advice)
    if count < LEAST_PAIRS:
        advice = "Fewer say nothing of how far to trust them"
        raise UserError(name, f"{count} impacts", f"{LEAST_PAIRS} or more", advice)
    if float(np.ptp(pairs.speed)) <= _ONE_SPEED * float(pairs.speed.max()):
        got = f"{count} impacts, all at {pairs.speed[0]:.4g} m/s"
        raise UserError(name, got, "two speeds or more", "One speed gives one e, and no α")
    if not (pairs.restitution > 0.0).any():
        got = "no impact rebounds: a rest only"
        raise UserError(name, got, "e above 0", "α cannot be known from it")
    return pairs


def _track(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """A track of times, s, and heights, m, that rise upwards.

    Raises UserError for times that do not rise, and a track of few points.
    """
    name = columns.table.name
    times = columns.get("time")
    heights = columns.get("height")
    columns.require("time", _rises_at(times), "times that rise")
    if len(times) < _LEAST_SAMPLES:
        raise UserError(name, f"{len(times)} points", f"{_LEAST_SAMPLES} or more of a track")
    track = track_of(name, setup, times, upright(times, heights, setup))
    return replace(track, assumed=columns.assumed)


_READERS: dict[str, Callable[[DataColumns, MeasurementSetup], Dataset]] = {
    "times": _times,
    "track": _track,
    "heights": _heights,
    "pairs": _pairs,
    "speeds": _speeds,
    "rises": _rises,
    "energies": _energies,
}
