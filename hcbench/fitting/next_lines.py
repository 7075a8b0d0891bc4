"""Commands to type after a fit, complete as printed."""

from __future__ import annotations

import math
import re
import shlex
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.table import Table, table_of
from hcbench.fitting.text import limit_of, with_uncertainty
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
    """Make a scene with this contact, and check it; none without an engine.

    engine: "" where none can run.
    given: the words after `hcbench` that led here.
    scene: a scene that was written, and its path; it is checked then.
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
        check = f"--pairs {_POINTS}"
    lines = ["next:"]
    if _POINTS in what and "--write-points" not in given:
        lines.append(f"  hcbench {shlex.join(given)} --write-points {_POINTS}")
    limit = limit_of(result, scene[0].e_off if scene else 0.0)
    if scene is not None:
        replayed, file = scene
        engine = replayed.setting.engine
    else:
        file = "scene.xml" if _reads_xml(engine) else "scene.py"
        lines.append(
            f"  hcbench tune {engine} {what} --timestep 1e-3 {speeds} --write-scene {file}"
        )
    if _reads_xml(engine):
        lines.append(
            f"  hcbench check {shlex.quote(file)} --pair {_PAIR} {check} {speeds} --max-error {limit:.2g}"
        )
    return lines


def _inwards(low: float, high: float) -> tuple[float, float]:
    """Both ends rounded inwards to three digits: pairs that were measured hold for no other speeds."""
    first, last = (10.0 ** (math.floor(math.log10(v)) - 2) for v in (low, high))
    return math.ceil(low / first - 1e-9) * first, math.floor(high / last + 1e-9) * last


def _reads_xml(engine: str) -> bool:
    """Say whether scenes of an engine are models that `check` opens; those of others are scripts."""
    adapter = registry.engine(engine)
    return isinstance(adapter, OpensModels) and ".xml" in adapter.suffixes


_BOUNCE = re.compile(r"bounce (\d+)")


def tracker_table(path: Path, lines: list[tuple[int, str]]) -> Table | None:
    """The columns t and y of a Tracker export in metres and seconds; None where it is none.

    Raises UserError for several tracks in one file.
    """
    rows = [(n, line.rstrip("\r\n").split("\t")) for n, line in lines]
    at = next((i for i, (_, row) in enumerate(rows[:4]) if "t" in row and "y" in row), None)
    if at is None:
        return None
    header = rows[at][1]
    below = rows[at + 1 :]
    # Tracker writes no line of units: this file is of another program.
    if below and below[0][1][0].strip().isalpha():
        return None
    if lines[0][1].startswith("#multi:"):
        raise UserError(path.name, "several tracks", "one", "Export the ball's track alone")
    places = header.index("t"), header.index("y")
    cells = []
    numbers = []
    for n, row in below:
        cell_t, cell_y = (row[place] if place < len(row) else "" for place in places)
        # Frames without the ball have a time and no place.
        if cell_t.strip() and cell_y.strip():
            cells.append((cell_t, cell_y))
            numbers.append(n)
    has_commas = any("," in cell_t or "," in cell_y for cell_t, cell_y in cells)
    return Table(
        name=sanitized(path.name),
        header=(("t", "s"), ("y", "m")),
        cells=tuple(cells),
        lines=tuple(numbers),
        decimal="," if has_commas else ".",
    )


def phyphox_times(path: Path, lines: list[tuple[int, str]]) -> Floats | None:
    """Times of touches of an export of phyphox' "(In)elastic collision", s; None where it is none.

    Touches that were not heard are 0 or NaN there.
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
    times = [table.number(row[column]) for _, column in sorted(places) if column < len(row)]
    # The first bounce is at 0; any other 0 was not heard.
    heard = [t for k, t in enumerate(times) if math.isfinite(t) and (t > 0.0 or k == 0)]
    return np.array(heard)
