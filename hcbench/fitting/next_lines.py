"""Commands to type after a fit, complete as printed."""

from __future__ import annotations

import math
import re
import shlex
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.result import limit_of, with_uncertainty
from hcbench.fitting.table import Table, cell_of, table_of
from hcbench.sim import registry
from hcbench.sim.capabilities import OpensModels
from hcbench.system.errors import UserError
from hcbench.system.text import sanitized

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from hcbench.fitting.replay import Replay
    from hcbench.fitting.result import FitResult
    from hcbench.terms.impact import Floats


# Names in a scene that hcbench writes.
_POINTS = "points.csv"
_PAIR = "ball,plate"


def next_lines(
    result: FitResult, engine: str, given: Sequence[str], scene: tuple[Replay, str] | None = None
) -> list[str]:
    """Commands that make a scene with this contact and check it, as lines; empty without an engine.

    engine: "" where none can run.
    given: the words after `hcbench` that led here.
    scene: a scene that was written, and its path; then it is checked, and no other is made.
    Engines whose scenes are scripts get no line that checks.
    """
    if not engine:
        return []
    low, high = _inwards(*result.speeds)
    speeds = f'--speeds "{low:g}:{high:g} m/s"'
    if result.is_plain and result.alpha is not None:
        check = f'--alpha "{with_uncertainty(result.alpha.value, result.alpha.uncertainty)} s/m"'
        what = f"{check} --plugin"
    elif result.law == "constant" and result.restitution is not None:
        what = check = f"--restitution {result.restitution.value:.6g}"
    else:
        what = f"--points {_POINTS}"
        check = f"--points {_POINTS}"
    lines = ["next:"]
    if _POINTS in what and "--write-points" not in given:
        lines.append(f"  hcbench {shlex.join(given)} --write-points {_POINTS}")
    if scene is not None:
        replayed, file = scene
        engine = replayed.setting.engine
        limit = limit_of(result, replayed.e_off)
    else:
        file = "scene.py"
        if _reads_xml(engine):
            file = "scene.xml"
        limit = limit_of(result)
        lines.append(
            f"  hcbench tune {engine} {what} --timestep 1e-3 {speeds} --write-scene {file}"
        )
    if _reads_xml(engine):
        lines.append(
            f"  hcbench check {shlex.quote(file)} --pair {_PAIR} {check} {speeds} --max-error {limit:.2g}"
        )
    return lines


def _inwards(low: float, high: float) -> tuple[float, float]:
    """Both ends rounded inwards to three digits: pairs that were measured hold for no other speeds.

    low, high: m/s, above 0.
    A band that is narrower than that keeps more digits, up to the six that a command has: its ends
    never change places.
    """
    for digits in (3, 4, 5, 6):
        # The last digit of each, m/s.
        of_low = 10.0 ** (math.floor(math.log10(low)) - digits + 1)
        of_high = 10.0 ** (math.floor(math.log10(high)) - digits + 1)
        inner_low = math.ceil(low / of_low - 1e-9) * of_low
        inner_high = math.floor(high / of_high + 1e-9) * of_high
        if inner_low <= inner_high:
            return inner_low, inner_high
    return low, high


def _reads_xml(engine: str) -> bool:
    """Say whether scenes of an engine are models that `check` opens; those of others are scripts."""
    adapter = registry.engine(engine)
    return isinstance(adapter, OpensModels) and ".xml" in adapter.suffixes


_BOUNCE = re.compile(r"bounce (\d+)")


def tracker_table(path: Path, lines: list[tuple[int, str]]) -> Table | None:
    """The columns t and y of a Tracker export in metres and seconds; None where it is none.

    lines: number and text of each line of the file.
    Raises UserError for several tracks in one file.
    """
    # Numbers of lines, and their cells.
    rows = [(n, line.rstrip("\r\n").split("\t")) for n, line in lines]
    for at, (_, header) in enumerate(rows[:4]):
        if "t" in header and "y" in header:
            below = rows[at + 1 :]
            break
    else:
        return None
    # Tracker writes no line of units: this file is of another program.
    if below and below[0][1][0].strip().isalpha():
        return None
    if lines[0][1].startswith("#multi:"):
        raise UserError(path.name, "several tracks", "one", "Export the ball's track alone")
    cells = []
    numbers = []
    decimal = "."
    time_column = header.index("t")
    height_column = header.index("y")
    for n, row in below:
        cell_t = cell_of(row, time_column)
        cell_y = cell_of(row, height_column)
        # Frames without the ball have a time and no place.
        if not cell_t.strip() or not cell_y.strip():
            continue
        cells.append((cell_t, cell_y))
        numbers.append(n)
        if "," in cell_t or "," in cell_y:
            decimal = ","
    return Table(
        name=sanitized(path.name),
        header=(("t", "s"), ("y", "m")),
        cells=tuple(cells),
        lines=tuple(numbers),
        decimal=decimal,
    )


def phyphox_times(path: Path, lines: list[tuple[int, str]]) -> Floats | None:
    """Times of touches of an export of phyphox' "(In)elastic collision", s; None where it is none.

    lines: number and text of each line of the file.
    Touches that were not heard are 0 or NaN there, and left out here.
    """
    first = lines[0][1].lower()
    if '"bounce 0' not in first and not first.startswith("bounce 0"):
        return None
    table = table_of(path, lines[:2])
    row = table.cells[0]
    # Pairs of (number of the bounce, column).
    places = []
    for column, (name, _) in enumerate(table.header):
        if match := _BOUNCE.fullmatch(name):
            places.append((int(match[1]), column))
    times = np.array(
        [table.number(row[column]) for _, column in sorted(places) if column < len(row)]
    )
    # The first bounce is at 0; any other 0 was not heard.
    is_heard = np.isfinite(times) & (times > 0.0)
    is_heard[:1] = np.isfinite(times[:1])
    return np.asarray(times[is_heard])
