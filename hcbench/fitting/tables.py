"""Tables in a sheet: which rows are the header, where the numbers begin, and the lines before it."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from hcbench.fitting.cells import counts, is_missing, looks_numeric, style_of
from hcbench.fitting.column_names import (
    NO_UNIT,
    QUANTITIES_OF_COLUMNS,
    QUANTITY_OF,
    explained,
    is_beside,
    is_unit,
    is_unit_of,
    meanings_of,
    of_file,
    plain_unit,
    role_of,
    split_header,
)
from hcbench.fitting.drops import LEAST_ROWS, drops_of
from hcbench.fitting.messages import count_readings
from hcbench.fitting.separators import listed_names, names_in_brackets, trimmed
from hcbench.fitting.statements import decimal_signs, metres_of_pixel, require_one_unit
from hcbench.fitting.table import Table, cell_of
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from hcbench.fitting.cells import NumberStyle
    from hcbench.fitting.separators import Row
    from hcbench.fitting.sheets import Sheet

    # Names of columns with their units, "" for none.
    Header = tuple[tuple[str, str], ...]

# Heights or times that a text tells, at least.
_LEAST_TOLD = 3
# Rows above the numbers that may have names or units.
_MOST_HEADER_ROWS = 6
# Words before a number over the rows above.
_SUMS = {
    *("sum", "total", "min", "max", "minimum", "maximum", "count", "range", "summe", "somme"),
    *("suma", "var", "variance"),
}
# Rows above a sum, at least; share by which rounding changes one.
_PLAIN = re.compile(r"\d+(?:\.\d+)?")
_LEAST_SUMMED = 3
_OF_A_SUM = 2e-3
# Quantities whose units a line before the table may name.
_UNITS_OF = {"unit of length": "position", "unit of time": "time"}
# "heights = [62.1", "height_cm = c(50.8": a name before the numbers of a row.
_NAME_OF_A_ROW = re.compile(r"(.*[^\d\s])\s*[:=]\s*(?:[\w.]*[\[({]+)?\s*(\S*)")
# "240 fps", "48 kHz", "120 frames per second", "120 images/s", "30 кадров/с".
_RATE_IN_WORDS = re.compile(
    r"(\d+(?:[.,]\d+)?)\s*(?:fps|(k?)hz|frames\s*per\s*s|[^\W\d_]{4,}\s*/\s*[sс]\b)", re.IGNORECASE
)
# "sample @ 44.1 kHz"
_AT_RATE = re.compile(rf"\s+(?:@|at)\s+{_RATE_IN_WORDS.pattern}", re.IGNORECASE)
# "clicks in seconds", "heights (cm)", "touches, in ms"; no "ball(s)", and no "v (in)".
_UNIT_IN_WORDS = re.compile(
    r"(?:\bin\s+|\ben\s+|(?<!\w)[(\[](?!in\b))([^\W\d_][^\W\d_/]*(?:/\w+)?)(?=[)\]\s.,;:]|$)(?!\W*\d)"
)


def tables_of(sheet: Sheet) -> list[Table]:
    """The tables of a sheet: one below the other, and drops side by side.

    Raises UserError, `explained`, for a sheet without numbers, a row with more cells than the header
    has, numbers that can be read in two ways, and several tracks of Tracker.
    """
    rows = [(line, tuple(cell.strip() for cell in cells)) for line, cells in sheet.rows]
    turned = _turned(rows)
    # A table of many rows, of which the first column is names, stays as it is.
    if len(turned) > len(rows) or not any(_is_data(cells) for _, cells in rows):
        rows = turned
    tables: list[Table] = []
    parts = list(_parts(rows))
    # Remarks below a table may begin with names.
    of_numbers = [part for part in parts if any(_is_data(cells) for _, cells in part)]
    for part in of_numbers or parts:
        # Without any rows there is one part, and it is empty.
        above = [cells for line, cells in rows if line < part[0][0] and not _is_data(cells)]
        tables += drops_of(_table(sheet, part, above))
    # Tracker writes "multi:" above tracks side by side.
    is_of_tracker = any("multi" in cells[0].split(":") for _, cells in rows[:3])
    if is_of_tracker and len(tables) > 1:
        raise UserError(sheet.name, "several tracks", "one", "Export the ball's track alone")
    return tables


def _is_data(cells: Sequence[str]) -> bool:
    """Say whether a row has numbers of a table: half of its cells, and no name first."""
    given = [cell for cell in cells if not is_missing(cell)]
    numeric = sum(map(looks_numeric, given))
    if not numeric or 2 * numeric < len(given):
        return False
    # "second" is a word of counting here, and no unit.
    if looks_numeric(given[0]) or given[0].lower() == "second":
        return True
    return role_of(*split_header(given[0])) not in QUANTITY_OF and not of_file(given[0])


def _turned(rows: list[Row]) -> list[Row]:
    """Rows and columns exchanged where each row has a name and then numbers; else as they are.

    Rows without a name stay, above the others.
    """
    named: list[tuple[int, list[str]]] = []
    others: list[Row] = []
    for line, cells in rows:
        row = _row_with_name(cells)
        if row:
            named.append((line, row))
        else:
            others.append((line, cells))
    has_data = any(_is_name_of_data(cells[0]) for _, cells in named)
    # Under a header of several names a row with a name is a row of that table.
    is_under_header = any(sum(map(_is_name_of_data, cells)) > 1 for _, cells in others)
    if not named or not has_data or is_under_header:
        return rows
    first_line = named[0][0]
    columns = itertools.zip_longest(*(cells for _, cells in named), fillvalue="")
    return [*others, *((first_line, tuple(cells)) for cells in columns)]


def _row_with_name(cells: Sequence[str]) -> list[str]:
    """The cells of a row that has a name and then two numbers or more; [] for any other.

    "heights = [62.1" in its first cell is parted, and brackets about numbers are left out.
    """
    first, *rest = cells
    match = _NAME_OF_A_ROW.fullmatch(first)
    if match is not None and _is_name_of_data(match[1]):
        first = match[1]
        rest = [match[2], *rest] if match[2] else rest
    if not first or looks_numeric(first):
        return []
    numeric = sum(map(looks_numeric, rest))
    given = sum(not is_missing(cell) for cell in rest)
    if numeric < 2 or 2 * numeric <= given:
        return []
    return [first, *(cell.strip("[](){};") for cell in rest)]


def _is_name_of_data(cell: str) -> bool:
    """Say whether a cell is the name of a quantity that a column may have."""
    return role_of(*split_header(cell)) in QUANTITY_OF


def _parts(rows: list[Row]) -> Iterator[list[Row]]:
    """Yield tables one below the other: after two rows of numbers, a row of names begins another."""
    part: list[Row] = []
    count = 0
    for line, cells in rows:
        is_data = _is_data(cells)
        if not is_data and count >= LEAST_ROWS and _count_names(cells):
            yield part
            part = []
            count = 0
        part.append((line, cells))
        count += is_data
    yield part


def _count_names(cells: Sequence[str]) -> int:
    """Number of names of columns in a row."""
    return sum(
        role_of(*split_header(cell)) != "" for cell in cells if cell and not looks_numeric(cell)
    )


def _table(sheet: Sheet, rows: list[Row], above: list[tuple[str, ...]]) -> Table:
    """The table in these rows of a sheet, below others, with the rate, the units and the scale that
    lines before it, or its header, state.

    above: cells of the lines before the rows.
    Raises UserError, `explained`, where there is no table.
    """
    name = sheet.name
    begin, end = _block(name, rows)
    width = max(len(trimmed(cells)) for _, cells in rows[begin:end])
    # "Run 2", alone in its line, parts drops.
    body = [row for row in rows[begin:end] if not _is_label(row[1], width)]
    header, before = _header(rows[:begin], body, width)
    # "frame (240 fps)" has the rate in the header.
    names = tuple(f"{column} {unit}" for column, unit in header)
    stated = _stated_before([*above, *before, names])
    header = _plain_header(name, header, body, stated.units)
    text = sheet.text or "\n".join(" ".join(cells) for _, cells in sheet.rows)
    table = Table(
        name=name,
        header=header,
        cells=tuple(cells for _, cells in body),
        lines=tuple(line for line, _ in body),
        frequency=stated.frequency,
        units=tuple(stated.units.items()),
        pixel=metres_of_pixel(text),
    )
    with explained(name, table.header):
        require_one_unit(name, header, [*above, *before])
        table = replace(table, style=_style(table, text))
        for row, line in zip(table.cells, table.lines, strict=True):
            if any(row[len(header) :]):
                got = f"{len(row)} cells"
                raise UserError(f"{name}, line {line}", got, f"{len(header)}, as the header has")
    return table


def _plain_header(
    name: str, header: Header, body: Sequence[Row], written: Mapping[str, str]
) -> Header:
    """A header without rates, and with the units and names that stand above the table.

    name: what errors call the file.
    body: the rows of numbers.
    written: units by quantity, and under "x" the name of what a column x counts.
    Raises UserError for times of the clock whose last part is a number of frames.
    """
    plain = []
    for place, (column, unit) in enumerate(header):
        has_rate = _RATE_IN_WORDS.search(unit) is not None
        if has_rate and any(":" in cells[place] for _, cells in body if cells[place:]):
            got = f"frames in the times under {column!r}"
            raise UserError(name, got, "seconds with decimals, or numbers of frames")
        bare = _AT_RATE.sub("", column)
        # "before", "after" under "unit: mm/s"
        own_unit = ("" if has_rate else unit) or _unit_for(bare, written)
        if "x" in written and meanings_of(bare) == {"x"}:
            bare = written["x"]
        plain.append((bare, own_unit))
    return tuple(plain)


def _unit_for(name: str, written: Mapping[str, str]) -> str:
    """The unit above a table by which "before" or "after" alone names a quantity; "" for other names.

    written: units by quantity. A time before the impact is none.
    """
    if meanings_of(name) not in ({"before"}, {"after"}):
        return ""
    return next((unit for of, unit in written.items() if of != "time" and role_of(name, unit)), "")


def _block(name: str, rows: list[Row]) -> tuple[int, int]:
    """The first row of the numbers, from 0, and the one after the last: the longest run of rows of
    numbers, and what belongs to it before and after.

    Rows that sum up, such as "mean,0.8", end it.
    Raises UserError where no row has numbers.
    """
    is_data = [_is_data(cells) for _, cells in rows]
    longest = 0
    start = 0
    at = 0
    for has_numbers, group in itertools.groupby(is_data):
        count = len(list(group))
        if has_numbers and count >= longest:
            longest = count
            start = at
        at += count
    if not longest:
        _refuse(name, rows)
    # Rows above, after a gap in the numbers, as long as those of the run, up to the names.
    names = max((i for i in range(start) if _count_names(rows[i][1])), default=-1)
    width = len(trimmed(rows[start][1]))
    begin = start
    for i in range(names + 1, start):
        if is_data[i] and len(trimmed(rows[i][1])) == width:
            begin = i
            break
    end = next((i for i in range(start, len(rows)) if _sums_up(rows[i][1])), len(rows))
    numbers = [cells for _, cells in rows[begin:end]]
    if len(numbers) > _LEAST_SUMMED and _is_total(numbers[-1], numbers[:-1]):
        end -= 1
    return begin, end


def _refuse(name: str, rows: list[Row]) -> NoReturn:
    """Raise UserError for rows without a row of numbers, with what they may be instead."""
    told = count_readings("\n".join(" ".join(cells) for _, cells in rows))
    if told:
        raise _no_drop(name, told)
    named = [cells for _, cells in rows if _count_names(cells)]
    header = tuple(map(split_header, named[0])) if named else ()
    got = "has a header and no rows" if named else "has no rows of numbers"
    with explained(name, header):
        raise UserError(name, got, "a header and rows of numbers")


def _no_drop(name: str, told: int) -> UserError:
    """The error for a text that tells heights or times, not as those of one ball.

    told: how many, above 0.
    """
    got = f"{told} heights or times in sentences"
    if told < _LEAST_TOLD:
        got += ", too few"
    expected = f"{_LEAST_TOLD} or more of one ball"
    advice = "Tell one a line: 'bounce 1: 63 cm', 'bounce 2: 40 cm'"
    return UserError(name, got, expected, advice)


def _sums_up(cells: Sequence[str]) -> bool:
    """Say whether a row begins with "mean", "sd" or another word for a number over the rows above."""
    return re.fullmatch(r"[^\W\d_][\w\s.]*:?", cells[0]) is not None and (
        (meanings_of(cells[0]) <= {"mean", "uncertainty", "filler"} and bool(meanings_of(cells[0])))
        or cells[0].strip(": ").lower() in _SUMS
    )


def _is_total(cells: Sequence[str], above: Sequence[Sequence[str]]) -> bool:
    """Say whether a row has a word, and after it the sum of a column of the numbers above."""
    places = [place for place, cell in enumerate(cells) if looks_numeric(cell)]
    if looks_numeric(cells[0]) or not places or not all(looks_numeric(row[0]) for row in above):
        return False
    texts = [cell_of(row, places[-1]).replace(",", ".") for row in (*above, cells)]
    numbers = [float(text) for text in texts if _PLAIN.fullmatch(text)]
    return len(numbers) > 1 and math.isclose(sum(numbers[:-1]), numbers[-1], rel_tol=_OF_A_SUM)


class _HeaderFound(NamedTuple):
    """The header over rows of numbers, and the cells of the rows above that are not part of it."""

    header: Header
    others: list[tuple[str, ...]]


def _header(above: list[Row], body: list[Row], width: int) -> _HeaderFound:
    """Names with units over rows of numbers, and the rows above that are not part of the table.

    body: the rows of numbers; width: their cells. Names may have a row of units below them, a row
    of groups above them, as motion capture writes it, or be missing: then all are "".
    """
    rows = [trimmed(cells) for _, cells in above]
    near = [
        i
        for i in range(max(0, len(rows) - _MOST_HEADER_ROWS), len(rows))
        if (not _is_said(rows[i]) and _fits(rows[i], body, width))
        or (_are_units(rows[i]) and len(rows[i]) <= width)
    ]
    at = _row_of_names(rows, near, width)
    listed = names_in_brackets([", ".join(row) for row in rows], width)
    if at is None:
        listed = listed_names([" ".join(row) for row in rows], width)
    if listed:
        return _HeaderFound(tuple(map(split_header, listed)), rows)
    if at is None and near:
        # "inches" alone
        written = _padded(rows[near[-1]], body, width)
        return _HeaderFound(tuple(("", plain_unit(unit)) for unit in written), rows)
    if at is None:
        return _HeaderFound((("", ""),) * width, rows)
    # "Height (cm)", merged over "Trial 1", "Trial 2", ...
    trials = next((i for i in near if i > at and _are_trials(rows[i])), None)
    if trials is not None:
        merged = _merged(_padded(rows[at], body, width), _padded(rows[trials], body, width))
        return _HeaderFound(merged, _without(rows, {at, trials}))
    names = _padded(rows[at], body, width)
    titled = _titled(rows[:at], names)
    if titled is not None:
        return titled
    # Numbers beyond the last name may be halves of numbers with commas: no name is made up for them.
    has_more_numbers = any(any(cells[len(rows[at]) :]) for _, cells in body)
    if has_more_numbers and len(names) > len(rows[at]) and names[0]:
        names = rows[at]
    header = [split_header(name) for name in names]
    used = {at}
    below = next((i for i in near if i != at and _are_units(rows[i])), None)
    if below is not None:
        used.add(below)
        header = _with_units_below(header, _padded(rows[below], body, width))
    # Markers of motion capture: "Ball", over "x", "y", "z" that come again.
    groups = [i for i in near if i < at and i not in used and len(rows[i]) >= width - 1]
    if groups and len(set(header)) < len(header):
        header = _with_groups(header, _padded(rows[groups[-1]], body, width))
    return _HeaderFound(tuple(header), _without(rows, used))


def _row_of_names(rows: Sequence[tuple[str, ...]], near: list[int], width: int) -> int | None:
    """The row that names the columns: that of the most known names, else the last that fits.

    rows: cells of the rows above the numbers.
    near: places of those that may have names or units.
    width: cells of the numbers. None where no row has names.
    """
    # A title has words of a header, and no units.
    units = {i: sum(bool(split_header(cell)[1]) for cell in rows[i]) for i in near}
    best = max(
        near,
        key=lambda i: (_count_names(rows[i]), len(rows[i]) == width, units[i], -i),
        default=None,
    )
    if best is None or _count_names(rows[best]):
        return best
    # No name is known: the row next to the numbers is the header, unless it is a title.
    full = (i for i in reversed(near) if not _are_units(rows[i]) and len(rows[i]) >= width)
    return next(full, None)


def _without(rows: Sequence[tuple[str, ...]], used: set[int]) -> list[tuple[str, ...]]:
    """The rows whose places are not among those used."""
    return [row for i, row in enumerate(rows) if i not in used]


def _with_units_below(
    header: Sequence[tuple[str, str]], written: Sequence[str]
) -> list[tuple[str, str]]:
    """A header with the units in the row below it; a unit beside the name itself stays.

    written: a cell for each column, or more.
    """
    found = list(header)
    for place, cell in enumerate(written[: len(header)]):
        name, unit = header[place]
        below = plain_unit(cell)
        if not unit and below.lower() not in NO_UNIT:
            found[place] = (name, below)
    return found


def _with_groups(header: Sequence[tuple[str, str]], groups: Sequence[str]) -> list[tuple[str, str]]:
    """A header whose names have those of their groups, in the row above, before them."""
    found = list(header)
    # A sentence above may have fewer words than the table has columns.
    for place, group in enumerate(groups[: len(header)]):
        name, unit = header[place]
        if group:
            found[place] = (f"{group} {name}".lower(), unit)
    return found


def _is_said(cells: tuple[str, ...]) -> bool:
    """Say whether a row is a name of the whole file and its value, as programs write above tables."""
    return len(cells) == 2 and bool(of_file(cells[0])) and not role_of(*split_header(cells[0]))


def _fits(cells: tuple[str, ...], body: list[Row], width: int) -> bool:
    """Say whether a row may name the columns of the numbers below it.

    body: the rows of numbers; width: their cells. The first column may have no name where it counts.
    """
    if not any(any(map(str.isalpha, cell)) for cell in cells) or any(map(looks_numeric, cells)):
        return False
    if len(cells) >= width or (len(cells) == width - 1 and _is_counted(body)):
        return True
    return _count_names(cells) > 0 and (width == 1 or len(cells) > 1)


def _is_counted(body: list[Row]) -> bool:
    """Say whether the first column counts or names the rows: pandas gives it no name."""
    first = [cells[0] for _, cells in body]
    if not any(map(looks_numeric, first)):
        return True
    return counts(first)


def _padded(cells: tuple[str, ...], body: list[Row], width: int) -> tuple[str, ...]:
    """The cells of a row above the numbers, as many as there are columns."""
    if len(cells) == width - 1 and _is_counted(body):
        return ("", *cells)
    return (*cells, *[""] * (width - len(cells)))


def _are_trials(cells: Sequence[str]) -> bool:
    """Say whether a row has two names of trials or drops, and no name of data."""
    numbered = [one for one in cells if meanings_of(one) & {"trial", "drop"}]
    return len(numbered) > 1 and not any(
        role_of(*split_header(one)) in QUANTITY_OF for one in cells
    )


def _merged(over: Sequence[str], below: Sequence[str]) -> Header:
    """Names with units of columns under headings that are merged over the names of trials: "height
    trial 1", in cm, of "Height (cm)" over "Trial 1".

    over, below: a cell for each column; the cells after a merged one are empty. Where the lower row has
    no name, that of the upper row counts.
    """
    header = []
    heading = ""
    for own, trial in zip(over, below, strict=True):
        heading = own or heading
        name, unit = split_header(heading if trial else own)
        header.append((f"{name} {trial}".strip().lower(), unit))
    return tuple(header)


def _titled(above: Sequence[tuple[str, ...]], names: Sequence[str]) -> _HeaderFound | None:
    """The header of trials below a line that says what they all have, "Rebound height (cm)", and the
    other lines above; None where there is no such line.
    """
    titles = [i for i, row in enumerate(above) if _is_title(row)]
    if len(titles) != 1 or not _are_trials(names):
        return None
    (title,) = filter(None, above[titles[0]])
    over = [title if meanings_of(name) & {"trial", "drop"} else "" for name in names]
    return _HeaderFound(_merged(over, names), _without(above, {titles[0]}))


def _is_title(cells: Sequence[str]) -> bool:
    """Say whether a row is the name of one quantity with its unit, and nothing else."""
    given = [split_header(cell) for cell in cells if cell]
    return len(given) == 1 and bool(given[0][1]) and role_of(*given[0]) in QUANTITY_OF


def _are_units(cells: Sequence[str]) -> bool:
    """Say whether a row has units alone; "No." may be over the numbers of rows."""
    given = [cell.strip("()[] ") for cell in cells if cell.strip("()[] ").lower() not in NO_UNIT]
    if given and meanings_of(given[0]) == {"number"}:
        given = given[1:]
    return bool(given) and all(is_unit(plain_unit(one)) for one in given)


class _Stated(NamedTuple):
    """Statements of lines before a table about all of its rows.

    frequency: of frames or samples, Hz; None for none.
    units: by quantity, such as {"position": "mm"}; under "x" the name of what a column x counts.
    """

    frequency: float | None
    units: dict[str, str]


def _stated_before(rows: list[tuple[str, ...]]) -> _Stated:
    """The frequency and the units that lines before a table name, in pairs such as "fps: 240" or in
    sentences such as "heights in cm".

    rows: cells of the lines. The first frequency counts, and of units the last that a pair names.
    """
    frequency = None
    written: dict[str, str] = {}
    for i, cells in enumerate(rows):
        text = "\t".join(cells)
        parts = [part.strip() for part in re.split(r"[\t:=;,]", text) if part.strip()]
        for name, value in itertools.pairwise(parts):
            number = re.match(r"\d+(?:\.\d+)?", value)
            if of_file(name) == "frequency" and number is not None:
                frequency = frequency or float(number[0])
            else:
                written |= _units_of_pair(name, value)
        is_sentence = len(cells) == 1 or (len(cells) == 2 and is_beside(cells[0]))
        if is_sentence:
            for quantity, unit in _units_in_words(text).items():
                written.setdefault(quantity, unit)
        match = _RATE_IN_WORDS.search(text)
        if match is not None:
            thousands = 1e3 if match[2] else 1.0
            frequency = frequency or thousands * float(match[1].replace(",", "."))
        # Vicon: the rate is alone in the line below "Trajectories" or "Devices".
        is_of_vicon = i and rows[i - 1][:1] in (("Trajectories",), ("Devices",), ("Model Outputs",))
        if is_of_vicon and len(cells) == 1 and re.fullmatch(r"\d+(?:\.\d+)?", cells[0]):
            frequency = float(cells[0])
    return _Stated(frequency, written)


def _units_of_pair(name: str, value: str) -> dict[str, str]:
    """The units by quantity that a name of the whole file and its value state; {} for others.

    {"x": "time"} for what the dimension of x is.
    """
    meaning = of_file(name)
    unit = plain_unit(value)
    if meaning in _UNITS_OF and is_unit(unit):
        return {_UNITS_OF[meaning]: unit}
    if meaning == "units" and value.lower() in ("si", "mks"):
        return {"time": "s", "position": "m", "speed": "m/s", "force": "N"}
    if meaning == "units":
        return {of: unit for of in QUANTITIES_OF_COLUMNS if is_unit_of(unit, of)}
    if meaning == "dimension of x" and role_of(value.lower()) == "time":
        # LabVIEW counts its x in s and names it x_value.
        return {"x": "time", "time": "s"}
    return {}


def _units_in_words(text: str) -> dict[str, str]:
    """The units by quantity that a sentence names, as in "heights in cm"; the first of each counts."""
    written: dict[str, str] = {}
    for unit in map(plain_unit, _UNIT_IN_WORDS.findall(text)):
        for quantity in QUANTITIES_OF_COLUMNS:
            if is_unit_of(unit, quantity):
                written.setdefault(quantity, unit)
    return written


def _style(table: Table, text: str) -> NumberStyle:
    """The style of a table's numbers. Raises UserError for those that can be read in two ways.

    text: of the whole file, whose other numbers may tell the decimal sign.
    """
    columns = [table.texts(place) for place in range(len(table.header))]
    return style_of(table.name, columns, decimal_signs(text))


def _is_label(cells: Sequence[str], width: int) -> bool:
    """Say whether a row of a table of `width` columns has a word alone, such as "Run 2"."""
    given = trimmed(cells)
    if len(given) != 1 or looks_numeric(given[0]):
        return False
    if width > 1:
        return True
    # In a table of one column a word may stand for a number that is missing.
    words = {meaning for meaning in meanings_of(given[0]) if not meaning.isdigit()}
    return bool(words) and words <= {"number", "trial", "drop"}
