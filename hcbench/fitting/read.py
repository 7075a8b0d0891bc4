"""Files of measurements: what kind one is, by its header, and the data set in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.column_names import DATA_KINDS, EXPECTED_COLUMNS, explained
from hcbench.fitting.columns import DataColumns, columns_of
from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.force import fit_loop, fit_pulse
from hcbench.fitting.heights import Heights, SpeedPairs
from hcbench.fitting.listening import listen, quick_score
from hcbench.fitting.next_lines import phyphox_times, tracker_table
from hcbench.fitting.recording import is_sound, read_recording
from hcbench.fitting.table import computed, read_lines, read_table
from hcbench.fitting.track import track_of, upright
from hcbench.system.errors import UserError
from hcbench.system.text import sanitized
from hcbench.terms.bounds import require_bounds

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.force import ForceFit
    from hcbench.fitting.recording import Picks
    from hcbench.fitting.setup import MeasurementSetup
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
KINDS = ("sound", *dict.fromkeys(DATA_KINDS.values()))
_MOST_TOUCHES = 60
# Each pair adds an unknown; so many take a dozen seconds.
_MOST_PAIRS = 500
_LEAST_SAMPLES = 12
# Of so many steps one may be wrong.
_STEPS_FOR_A_RISE = 4
# Speeds that differ by less than this share are one speed.
_ONE_SPEED = 1e-6
# Letters of the trains in a recording, the likeliest first.
_TRAINS = "ABCDEF"


def read_dataset(
    path: Path, setup: MeasurementSetup, kind: str | None = None, part: Excerpt = WHOLE
) -> Dataset:
    """The data set in a file.

    kind: one of KINDS, in place of what the header says.
    part: of a recording, what to take.

    Raises UserError with the file, the line, what it has and what was expected.
    """
    if kind == "sound" or (kind is None and is_sound(path)):
        return _sound(path, setup, part)
    if part != WHOLE:
        slot = "--from"
        if part.train is not None:
            slot = "--touches"
        raise UserError(slot, f"given for {path.name}, which is not a recording", "a .wav")
    lines = read_lines(path)
    if kind in (None, "times"):
        times = phyphox_times(path, lines)
        if times is not None:
            return _touch_times(sanitized(path.name), setup, times)
    table = None
    if kind in (None, "track"):
        table = tracker_table(path, lines)
    table = table or read_table(path, lines)
    with explained(table.name, table.header), computed(table.name):
        columns = columns_of(table)
        return _READERS[_kind_of(columns, kind)](columns, setup)


def _kind_of(columns: DataColumns, asked: str | None) -> str:
    """The kind of data in a table, by its columns or as asked for. Raises
    UserError where they do not go.

    asked: one of KINDS, or None.
    """
    name = columns.table.name
    named = frozenset(role for role in columns.places if not role.startswith("u_"))
    by_header = DATA_KINDS.get(named)
    kind = asked
    if kind is None:
        kind = by_header
    if kind is None:
        names = ", ".join(columns.table.header[i][0] for i in columns.places.values())
        raise UserError(name, f"columns {names}", EXPECTED_COLUMNS)
    if kind in ("force", "loop"):
        raise UserError(name, "forces among other files", "one file of forces alone")
    needed = next(roles for roles, of_roles in DATA_KINDS.items() if of_roles == kind)
    if kind != by_header and not needed <= named:
        missing = ", ".join(sorted(needed - named))
        raise UserError(name, f"no column {missing}", f"what --as {kind} needs")
    return kind


def has_force(path: Path, kind: str | None = None) -> bool:
    """True for a file of forces.

    kind: as for `read_dataset`.
    """
    return _force_columns(path, kind) is not None


def _force_columns(path: Path, kind: str | None) -> DataColumns | None:
    """The columns of a file of forces; None for any other.

    kind: as for `read_dataset`.
    """
    if kind not in (None, "force", "loop") or is_sound(path):
        return None
    lines = read_lines(path)
    if phyphox_times(path, lines) is not None or tracker_table(path, lines) is not None:
        return None
    table = read_table(path, lines)
    with explained(table.name, table.header):
        columns = columns_of(table)
    if "force" not in columns.places:
        return None
    return columns


def read_force(path: Path, setup: MeasurementSetup, kind: str | None = None) -> ForceFit | None:
    """The fit of a file of forces; None for any other file.

    Penetration (m), rate (m/s) and force (N) are fitted as a loop; time (s) and force as a pulse.

    kind: as for `read_dataset`.
    Raises UserError for a force without the other columns, and times that do not rise.
    """
    columns = _force_columns(path, kind)
    if columns is None:
        return None
    with explained(columns.table.name, columns.table.header):
        return _fitted_force(columns, setup, kind)


def _fitted_force(columns: DataColumns, setup: MeasurementSetup, kind: str | None) -> ForceFit:
    """The fit of columns that have a force, as of `read_force`, which says what it raises."""
    if kind != "force" and {"penetration", "rate"} <= columns.places.keys():
        x = columns.get("penetration")
        v = columns.get("rate")
        force = columns.get("force")
        with computed(columns.table.name):
            return fit_loop(columns.table.name, x, v, force, setup.exponent)
    if "time" not in columns.places:
        raise UserError(
            columns.table.name, "force without time, or penetration and rate", EXPECTED_COLUMNS
        )
    time = columns.get("time")
    columns.require("time", np.concatenate([[True], np.diff(time) > 0]), "times that rise")
    with computed(columns.table.name):
        return fit_pulse(columns.table.name, setup, time, columns.get("force"))


def _sound(path: Path, setup: MeasurementSetup, part: Excerpt) -> Dataset:
    """The touches heard in a recording, of the likeliest train or of the one asked for.

    Raises UserError for a file without sound, a train that is not heard, too few touches, and
    flights that no ball has.
    """
    recording = read_recording(path, quick_score, part.begin, part.end)
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
    return TouchTimes(
        recording.name, setup, picks.times, picks.numbers, picks, recording, in_question
    )


def _times(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Read touch times, or the intervals between touches, s. Raises UserError unless they rise."""
    if "interval" in columns.places:
        intervals = columns.get("interval")
        columns.require("interval", intervals > 0, "above 0")
        return _touch_times(
            columns.table.name, setup, np.concatenate([[0.0], np.cumsum(intervals)])
        )
    times = columns.get("time")
    columns.require("time", np.concatenate([[True], np.diff(times) > 0]), "times that rise")
    return _touch_times(columns.table.name, setup, times)


def _touch_times(name: str, setup: MeasurementSetup, times: Floats) -> Dataset:
    """Check the times of touches, s, shape (n,), and make a data set of them.

    Raises UserError for times that do not rise, too few or too many of them, a contact that lasts
    longer than the shortest flight, and flights that no ball has.
    """
    if (np.diff(times) <= 0).any():
        raise UserError(name, "times that fall", "times that rise")
    if len(times) < setup.least_touches:
        raise too_few_touches(name, len(times), setup.least_touches)
    _require_few(name, len(times), "times")
    if setup.contact_time.value >= np.diff(times).min():
        got = f"{setup.contact_time.value:g} s, and two touches {np.diff(times).min():.3g} s apart"
        raise UserError("contact-time", got, "less than from one touch to the next")
    return TouchTimes(name, setup, times)


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
    heights = columns.get("height")
    columns.require("height", heights > 0, "above 0: the bottom of the ball above the plate")
    require_bounds(f"{columns.table.name}: height", heights.tolist(), "length", "m")
    if (
        setup.height is not None
        and len(heights)
        and abs(heights[0] / setup.height.value - 1.0) < 1e-6
    ):
        # The first row is the height of the drop itself: it comes before the first bounce.
        heights = heights[1:]
    _require_falling(columns)
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
    return Heights(columns.table.name, setup, heights, height_noise)


def _require_falling(columns: DataColumns) -> None:
    """Raise UserError for heights that rise too often to be bounces: a reading or two may be wrong,
    and late bounces are equal by rounding.
    """
    falls = np.diff(columns.get("height")) <= 0
    if (~falls).sum() > len(falls) // _STEPS_FOR_A_RISE:
        columns.require("height", np.concatenate([[True], falls]), "heights that fall")


def _pairs(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Impact speeds with the e of each.

    Raises UserError for speeds that are not above 0, and an e outside of 0 ... 1.2.
    """
    name = columns.table.name
    role = "speed_in"
    if "speed" in columns.places:
        role = "speed"
    speed = columns.get(role)
    e = columns.get("restitution")
    columns.require(role, speed > 0, "a speed above 0")
    require_bounds(f"{name}: {role}", speed.tolist(), "speed", "m/s")
    columns.require("restitution", (e >= 0) & (e <= 1.2), "0 ... 1")
    u_speed = columns.uncertainty(role)
    u_e = columns.uncertainty("restitution")
    return _checked_pairs(SpeedPairs(name, setup, speed, e, u_speed, u_e))


def _speeds(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Speeds before and after each impact."""
    name = columns.table.name
    before = columns.get("speed_in")
    after = columns.get("speed_out")
    columns.require("speed_in", before > 0, "a speed above 0")
    require_bounds(f"{name}: speed_in", before.tolist(), "speed", "m/s")
    gains = after > 1.2 * before
    # A row or two may have the speeds in each other's columns.
    if gains.sum() > len(gains) // _STEPS_FOR_A_RISE:
        columns.require("speed_out", ~gains, "from 0 to the speed in")
    columns.require("speed_out", after >= 0, "from 0 to the speed in")
    e = after / before
    u_in = columns.uncertainty("speed_in")
    u_out = columns.uncertainty("speed_out")
    return _checked_pairs(SpeedPairs(name, setup, before, e, u_in, u_out / before, twice=True))


def _rises(columns: DataColumns, setup: MeasurementSetup) -> Dataset:
    """Impacts from heights of drops and of their rebounds, m: the speeds in and out of each impact,
    m/s.

    Raises UserError for heights of 0 and below, and a rebound above its drop.
    """
    before = columns.get("height_in")
    after = columns.get("height_out")
    columns.require("height_in", before > 0, "above 0")
    columns.require(
        "height_out", (after >= 0) & (after <= before), "from 0 to the height of the drop"
    )
    v_in = np.array([setup.ballistics.dropped(h)[0] for h in before])
    v_out = np.sqrt(2.0 * setup.ballistics.gravity * after)
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
    return track_of(columns.table.name, setup, times, upright(times, heights, setup))


_READERS: dict[str, Callable[[DataColumns, MeasurementSetup], Dataset]] = {
    "times": _times,
    "track": _track,
    "heights": _heights,
    "pairs": _pairs,
    "speeds": _speeds,
    "rises": _rises,
}
