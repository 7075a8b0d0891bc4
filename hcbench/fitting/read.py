"""Files of measurements: what kind one is, by its header, and the data set in it."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

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
from hcbench.fitting.heights import Heights, SpeedPairs
from hcbench.fitting.listening import listen, quick_score, with_contact
from hcbench.fitting.numbers_in_text import rows_in_text
from hcbench.fitting.pushes import is_single_push, recording_of, require_one_ball, weighed_ball
from hcbench.fitting.recording import is_sound, read_recording
from hcbench.fitting.sheets import read_sheets
from hcbench.fitting.signals import evened, signal_in
from hcbench.fitting.table import Table, cell_of, computed
from hcbench.fitting.tables import tables_of
from hcbench.fitting.track import track_of, upright
from hcbench.system.errors import UserError
from hcbench.system.text import sanitized
from hcbench.terms.bounds import require_bounds

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

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
# Speeds that differ by less than this share are one speed.
_ONE_SPEED = 1e-6
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
        slot = "--from"
        if part.train is not None:
            slot = "--touches"
        raise UserError(slot, f"given for {path.name}, which is not a recording", "a .wav")
    sheets = read_sheets(path)
    found, refused = _read(sheets, setup, kind)
    if refused:
        # No table, or not all: the numbers may stand between words.
        in_text = [replace(sheet, rows=rows_in_text(sheet.text)) for sheet in sheets]
        found_too, refused_too = _read(in_text, setup, kind)
        if _impacts(found_too) > _impacts(found):
            found, refused = found_too, refused_too
        elif not found:
            raise _with_what_is_said(sheets, _worst([*refused, *refused_too]))
    _require_all_read(found, refused)
    require_usual_fall(sheets, found, setup)
    return _different([data for _, data in found])


def _read(
    sheets: list[Sheet], setup: MeasurementSetup, kind: str | None
) -> tuple[list[tuple[DataColumns, Dataset]], list[tuple[Table | None, UserError]]]:
    """The data sets in sheets with their columns, and the tables that are refused with the errors."""
    found: list[tuple[DataColumns, Dataset]] = []
    refused: list[tuple[Table | None, UserError]] = []
    for table, error in _tables(sheets):
        if table is None:
            refused.append((None, error))
            continue
        try:
            with explained(table.name, table.header), computed(table.name):
                scaled, said = scaled_by_fall(table, setup.gravity.value)
                columns, of_kind = _understood(scaled, kind)
                columns = _assuming(columns, said)
                if of_kind in ("force", "loop"):
                    got = "forces among other files"
                    raise UserError(table.name, got, "one file of forces alone")
                found.append((columns, _READERS[of_kind](columns, setup)))
        except UserError as error:
            refused.append((table, error))
    return found, refused


def _impacts(found: list[tuple[DataColumns, Dataset]]) -> int:
    """Number of impacts in data sets."""
    return sum(len(data.pairs()[0]) for _, data in found)


def _tables(sheets: list[Sheet]) -> Iterator[tuple[Table | None, UserError]]:
    """Each table of the sheets, with an error that is not to be used; and None with the reason for
    each sheet whose tables cannot be read. Sheets without rows are passed over.
    """
    for sheet in sheets:
        if not sheet.rows:
            continue
        try:
            for table in tables_of(sheet):
                yield table, UserError(sheet.name, "no table", "one")
        except UserError as error:
            yield None, error


def _worst(refused: list[tuple[Table | None, UserError]]) -> UserError:
    """The refusal, of several, of the sheet that most looks like data."""

    def columns_known(one: tuple[Table | None, UserError]) -> tuple[int, int]:
        table = one[0]
        if table is None:
            return 0, 0
        return sum(role_of(*name) in QUANTITY_OF for name in table.header), len(table.cells)

    return max(refused, key=columns_known)[1]


def _require_all_read(
    found: list[tuple[DataColumns, Dataset]], refused: list[tuple[Table | None, UserError]]
) -> None:
    """Raise the refusal of a table that has the columns of one that is read, or as many in the same
    sheet: a drop, or its last bounces, would be missing.
    """
    headers = {columns.table.header for columns, _ in found}
    widths = {(columns.table.name, len(columns.table.header)) for columns, _ in found}
    for table, error in refused:
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

    asked: one of KINDS, or None. Raises UserError where the columns are not data of a kind.
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

    Of successive bounces only those before the first and after the last reading are left out: a gap
    among them counts. A list from the last to the first row, or shuffled beside the numbers of its
    rows, is turned.
    """
    needed = next(
        of for of, of_kind in DATA_KINDS.items() if of_kind == kind and of <= columns.roles
    )
    given = np.ones(len(columns.table.cells), dtype=bool)
    for role in needed & columns.places.keys():
        given &= columns.table.is_given(columns.places[role])
    kept = np.flatnonzero(given)
    if not len(kept):
        raise UserError(columns.table.name, "no row has all of its numbers", "rows of numbers")
    if kind in ("times", "heights"):
        kept = np.arange(kept[0], kept[-1] + 1)
    columns = columns.taken(kept.tolist())
    if kind in ("times", "heights"):
        require_one_drop(columns)
    order = row_order(columns)
    if order is not None and kind in ("times", "heights"):
        return columns.taken(order.tolist())
    if "time" in columns.places and kind in ("times", "track", "force"):
        numbers = columns.table.numbers(columns.places["time"])
        is_turned = len(numbers) > 1 and bool((np.diff(numbers) < 0).all())
        if is_turned or (kind != "times" and len(set(numbers.tolist())) == len(numbers)):
            return columns.taken(np.argsort(numbers, kind="stable").tolist())
    is_numbered = any(meanings_of(name) & _NUMBERS for name, _ in columns.table.header)
    if "time" in columns.places or (kind in ("times", "heights") and is_numbered):
        return columns.taken(_without_copies(columns))
    return columns


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
    """The columns of a file of forces, and their kind; None for any other.

    kind: as for `read_dataset`.
    """
    if kind not in (None, "force", "loop") or is_sound(path):
        return None
    signal = signal_in(path)
    if kind is None and signal is not None and not is_single_push(signal):
        # Touches of a ball, or no force at all.
        return None
    for table, _ in _tables(read_sheets(path)):
        if table is None or not any(
            role_of(*name) == "force" or is_unit_of(name[1], "force") for name in table.header
        ):
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
    lines = "\n".join(sheet.text for sheet in sheets).splitlines() if unit else []
    for line in lines:
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
    columns.require("time", np.concatenate([[True], np.diff(time) > 0]), "times that rise")
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
    """Read touch times, or the intervals between touches, s. Raises UserError unless they rise.

    A row without a time is a touch that was not seen.
    """
    name = columns.table.name
    if "interval" in columns.places and "time" not in columns.roles:
        if (np.diff(bounce_numbers(columns)) > 1).any():
            raise UserError(name, "flights are left out", "each flight, one after the other")
        intervals = columns.get("interval")
        if len(intervals) > 1 and intervals[-1] == 0:
            # The last touch has no interval after it.
            intervals = intervals[:-1]
        columns.require("interval", intervals > 0, "above 0")
        if len(intervals) > 2 and (np.diff(intervals) > 0).all():
            raise UserError(
                name, "flights that last longer and longer", "each shorter, as of a ball"
            )
        return _touch_times(
            name, setup, np.concatenate([[0.0], np.cumsum(intervals)]), columns.assumed
        )
    if "time" not in columns.places:
        # Frames or samples that are counted.
        counted = columns.get("time")
        clock = "frame" if "frame" in columns.places else "sample"
        rises = np.concatenate([[True], np.diff(counted) > 0])
        columns.require(clock, rises, f"{clock}s that rise")
        return _touch_times(name, setup, counted, columns.assumed)
    seen, numbers = _seen(columns, "time")
    seen = _in_turn(seen)
    times = seen.get("time")
    seen.require("time", np.concatenate([[True], np.diff(times) > 0]), "times that rise")
    return replace(_touch_times(name, setup, times, seen.assumed), numbers=numbers)


def _seen(columns: DataColumns, role: str) -> tuple[DataColumns, Indices | None]:
    """The rows of bounces that have a reading, and which bounce each is, None where all are seen: a
    row without a reading, and a number that is left out, are one that was not seen.
    """
    given = np.flatnonzero(columns.table.is_given(columns.places[role]))
    numbers = bounce_numbers(columns)[given]
    seen = columns.taken(given.tolist())
    missing = sorted(set(range(numbers[0], numbers[-1])) - set(numbers.tolist()))
    if not missing:
        return seen, None
    if np.diff(numbers).max() > _MOST_UNSEEN + 1:
        got = f"numbers of bounces that leave out {np.diff(numbers).max() - 1}"
        raise UserError(
            columns.table.name, got, f"at most {_MOST_UNSEEN} bounces not seen in a row"
        )
    event = "touch" if role == "time" else "bounce"
    shown = ", ".join(str(i + 1) for i in missing[:_MOST_SHOWN])
    said = f"no {role} of {event} {shown}, counted from 1: read as not seen"
    return _assuming(seen, said), numbers - numbers[0]


def _assuming(columns: DataColumns, said: str) -> DataColumns:
    """The columns with one more sentence of what is assumed."""
    return replace(columns, assumed="; ".join(filter(None, (columns.assumed, said))))


def _in_turn(columns: DataColumns) -> DataColumns:
    """Rows with the times of two touches that stand in each other's place exchanged, if that alone
    makes times rise.
    """
    times = columns.table.numbers(columns.places["time"])
    wrong = np.flatnonzero(np.diff(times) <= 0)
    if len(wrong) != 1:
        return columns
    order = np.arange(len(times))
    order[[wrong[0], wrong[0] + 1]] = order[[wrong[0] + 1, wrong[0]]]
    if not is_train(times[order]):
        return columns
    shown = " and ".join(f"{times[i]:g}" for i in wrong[0] + np.arange(2))
    said = f"times {shown} do not rise: read as exchanged"
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
    if len(flights) and (flights.max() < _SHORTEST or flights.min() > _LONGEST):
        is_short = flights.max() < _SHORTEST
        bound = f"most {flights.max():.2g}" if is_short else f"least {flights.min():.2g}"
        got = f"flights of at {bound} s"
        raise UserError(name, got, "those of a bouncing ball", "Look at the unit")
    if setup.contact_time.value >= np.diff(times).min():
        got = f"{setup.contact_time.value:g} s, and two touches {np.diff(times).min():.3g} s apart"
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

    A first row that is the drop height itself is left out. Raises UserError for heights that do not
    fall, too few or too many of them, and a first bounce above the drop.
    """
    columns, numbers = _seen(columns, "height")
    heights = columns.get("height")
    above = np.flatnonzero(heights > 0)
    if 0 < len(above) == above[-1] + 1:
        # After the last bounce that rises, the ball rests at 0.
        columns, heights = columns.taken(above.tolist()), heights[above]
        numbers = None if numbers is None else numbers[above]
    columns.require("height", heights > 0, "above 0: the bottom of the ball above the plate")
    require_bounds(f"{columns.table.name}: height", heights.tolist(), "length", "m")
    if (
        setup.height is not None
        and len(heights)
        and abs(heights[0] / setup.height.value - 1.0) < 1e-6
    ):
        # The first row is the height of the drop itself: it comes before the first bounce.
        heights = heights[1:]
        numbers = None if numbers is None else numbers[1:] - 1
    _require_falling(columns, _rounding(columns, setup))
    _require_few(columns.table.name, len(heights), "heights")
    given = columns.uncertainty("height")
    # Heights lie between the touches: one fewer.
    least = setup.least_touches - 1
    if len(heights) < least:
        got = f"{len(heights)} heights"
        raise UserError(columns.table.name, got, f"{least} or more bounces", "Fewer have no check")
    if setup.height is not None and heights[0] >= setup.height.value:
        got = f"the first bounce rises to {heights[0]:.4g} m, let go at {setup.height.value:.4g} m"
        raise UserError("height", got, "a bounce below the drop")
    height_noise = None
    if given.any():
        height_noise = float(given.mean())
    return Heights(columns.table.name, setup, heights, height_noise, columns.assumed, numbers)


def _rounding(columns: DataColumns, setup: MeasurementSetup) -> float:
    """Largest rise of a height above the one before it, m: by the last digit that the file has, the
    given uncertainty, or 2 % of the largest.
    """
    heights = columns.get("height")
    last = 1.0
    for row in columns.table.cells:
        _, point, digits = cell_of(row, columns.places["height"]).partition(
            columns.table.style.decimal
        )
        digits = re.match(r"\d*", digits)[0]  # type: ignore[index]
        last = min(last, 10.0 ** -len(digits) if point else 1.0)
    scale = columns.table.scale(columns.places["height"], "position")
    given = float(columns.uncertainty("height").max(initial=0.0))
    return max(1.01 * last * scale, 3.0 * given, _OF_NOISE * float(heights.max()))


def _require_falling(columns: DataColumns, allowed: float) -> None:
    """Raise UserError for heights that rise too often to be bounces: a reading or two may be wrong.

    allowed: a rise that noise or rounding may make, m.
    """
    falls = np.diff(columns.get("height")) <= allowed
    if (~falls).sum() > len(falls) // _STEPS_FOR_A_RISE:
        columns.require("height", np.concatenate([[True], falls]), "heights that fall")


def _pairs(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Impact speeds with the e of each.

    Raises UserError for speeds that are not above 0, and an e outside of 0 ... 1.2.
    """
    name = columns.table.name
    if "speed_in" in columns.places:
        role = "speed_in"
    elif "speed" in columns.places:
        role = "speed"
    else:
        role = "height_in"
    size = columns.get(role)
    columns.require(role, size > 0, "above 0")
    u_speed = columns.uncertainty(role)
    speed = size
    if role == "height_in":
        speed = np.array([setup.ballistics.dropped(h)[0] for h in size])
        u_speed = 0.5 * speed * u_speed / size
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
    return _checked_pairs(SpeedPairs(name, setup, speed, e, u_speed, u_e, assumed=columns.assumed))


def _speeds(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Speeds before and after each impact."""
    name = columns.table.name
    before = columns.get("speed_in")
    after = columns.get("speed_out")
    if (before * after <= 0.0).all():
        # A velocity is turned round.
        before, after = np.abs(before), np.abs(after)
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
    """Raise UserError where a column of e says something else than the speeds, or heights, beside it."""
    if "restitution" not in columns.places:
        return
    at = columns.places["restitution"]
    percent = 0.01 if columns.table.unit_of(at, "number") == "%" else 1.0
    written = percent * columns.table.numbers(at)
    expected = f"{e[0]:.3g}, of the columns before and after"
    off = np.abs(written - e) > _OF_E * np.maximum(e, 0.2)
    columns.require("restitution", ~off | np.isnan(written), expected)


def _energies(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Impacts from the kinetic energies before and after, J: speeds, m/s, by the mass.

    Raises UserError without the mass, for energies of 0 and below, and a gain of energy.
    """
    name = columns.table.name
    before, after = columns.get("energy_in"), columns.get("energy_out")
    if setup.mass is None:
        raise UserError("mass", f"not given for {name}", "the mass of the ball")
    columns.require("energy_in", before > 0, "above 0")
    columns.require("energy_out", (after >= 0) & (after <= before), "from 0 to the energy before")
    e = np.sqrt(after / before)
    _require_e(columns, e)
    speed = np.sqrt(2.0 * before / setup.mass.value)
    nothing = np.zeros(len(before))
    return _checked_pairs(SpeedPairs(name, setup, speed, e, nothing, nothing, twice=True))


def _rises(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Impacts from heights of drops and of their rebounds, m: the speeds in and out of each impact,
    m/s.

    Raises UserError for heights of 0 and below, and a rebound above its drop.
    """
    before = columns.get("height_in")
    columns.require("height_in", before > 0, "above 0")
    role = "height_out" if "height_out" in columns.places else "interval"
    after = columns.get(role)
    if role == "interval":
        # A flight of the time T rises to g T²/8.
        after = setup.ballistics.gravity * after**2 / 8.0
    name, _ = columns.table.header[columns.places[role]]
    if any(int(number) > 1 for number in re.findall(r"\d+", name)):
        raise UserError(columns.table.name, f"{name!r}", "the height of the first rebound")
    columns.require(role, (after >= 0) & (after <= before), "a rebound below the drop")
    v_in = np.array([setup.ballistics.dropped(h)[0] for h in before])
    v_out = np.sqrt(2.0 * setup.ballistics.gravity * after)
    _require_e(columns, v_out / v_in)
    nothing = np.zeros(len(before))
    name = columns.table.name
    return _checked_pairs(SpeedPairs(name, setup, v_in, v_out / v_in, nothing, nothing, twice=True))


def _checked_pairs(pairs: SpeedPairs) -> SpeedPairs:
    """Return the impacts as they are; raise UserError for data that leave α unknown.

    Needed are 3 to 500 impacts, two speeds or more, and an e above 0.
    """
    if len(pairs.speed) > _MOST_PAIRS:
        got = f"{len(pairs.speed)} impacts"
        raise UserError(
            pairs.name, got, f"up to {_MOST_PAIRS}", "Average those of nearly one speed"
        )
    if len(pairs.speed) < 3:
        got = f"{len(pairs.speed)} impacts"
        raise UserError(pairs.name, got, "3 or more", "Fewer say nothing of how far to trust them")
    if float(np.ptp(pairs.speed)) <= _ONE_SPEED * float(pairs.speed.max()):
        got = f"{len(pairs.speed)} impacts, all at {pairs.speed[0]:.4g} m/s"
        raise UserError(pairs.name, got, "two speeds or more", "One speed gives one e, and no α")
    if not (pairs.restitution > 0.0).any():
        raise UserError(
            pairs.name, "no impact rebounds: a rest only", "e above 0", "α cannot be known from it"
        )
    return pairs


def _track(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """A track of times, s, and heights, m, that rise upwards.

    Raises UserError for times that do not rise, and a track of few points.
    """
    times = columns.get("time")
    heights = columns.get("height")
    columns.require("time", np.concatenate([[True], np.diff(times) > 0]), "times that rise")
    if len(times) < _LEAST_SAMPLES:
        raise UserError(
            columns.table.name, f"{len(times)} points", f"{_LEAST_SAMPLES} or more of a track"
        )
    track = track_of(columns.table.name, setup, times, upright(times, heights, setup))
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
