"""Tables in a sheet: which rows are the header, where the numbers begin, and the lines before it."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING

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
    has, and numbers that can be read in two ways.
    """
    rows = [(line, tuple(cell.strip() for cell in cells)) for line, cells in sheet.rows]
    turned = _turned(rows)
    if len(turned) > len(rows) or not any(_is_data(cells) for _, cells in rows):
        rows = turned
    is_of_tracker = any("multi" in cells[0].split(":") for _, cells in rows[:3])
    tables: list[Table] = []
    parts = list(_parts(rows))
    # Remarks below a table may begin with names.
    of_numbers = [part for part in parts if any(_is_data(cells) for _, cells in part)]
    for part in of_numbers or parts:
        above = [cells for line, cells in rows if line < part[0][0] and not _is_data(cells)]
        table = _table(sheet, part, above)
        tables += drops_of(table)
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
    """Rows and columns exchanged where each row has a name and then numbers; else as they are."""
    named: list[tuple[int, list[str]]] = []
    others: list[Row] = []
    for line, cells in rows:
        first, *rest = [*cells]
        match = _NAME_OF_A_ROW.fullmatch(first)
        if match is not None and role_of(*split_header(match[1])) in QUANTITY_OF:
            first, rest = match[1], [match[2], *rest] if match[2] else rest
        numeric = sum(map(looks_numeric, rest))
        is_named = bool(first) and not looks_numeric(first)
        if (
            is_named
            and numeric > 1
            and 2 * numeric > sum(1 for cell in rest if not is_missing(cell))
        ):
            named.append((line, [first, *(cell.strip("[](){};") for cell in rest)]))
        else:
            others.append((line, cells))
    has_role = any(role_of(*split_header(cells[0])) in QUANTITY_OF for _, cells in named)
    # Under a header of several names a row with a name is a row of that table.
    is_under_header = any(
        sum(role_of(*split_header(cell)) in QUANTITY_OF for cell in cells) > 1
        for _, cells in others
    )
    if not named or not has_role or is_under_header:
        return rows
    turned = itertools.zip_longest(*(cells for _, cells in named), fillvalue="")
    line = named[0][0]
    return [*others, *((line, tuple(cells)) for cells in turned)]


def _parts(rows: list[Row]) -> Iterator[list[Row]]:
    """Tables one below the other: after rows of numbers, a row of names begins another one."""
    part: list[Row] = []
    count = 0
    for line, cells in rows:
        is_data = _is_data(cells)
        if not is_data and count >= LEAST_ROWS and _names(cells):
            yield part
            part, count = [], 0
        part.append((line, cells))
        count += is_data
    yield part


def _names(cells: Sequence[str]) -> int:
    """Number of names of columns in a row."""
    return sum(
        role_of(*split_header(cell)) != "" for cell in cells if cell and not looks_numeric(cell)
    )


def _table(sheet: Sheet, rows: list[Row], above: list[tuple[str, ...]]) -> Table:
    """The table in these rows of a sheet, below others. Raises UserError, `explained`, where there is
    none.
    """
    name = sheet.name
    begin, end = _block(name, rows)
    width = max(len(trimmed(cells)) for _, cells in rows[begin:end])
    # "Run 2", alone in its line, parts drops.
    body = [row for row in rows[begin:end] if not _is_label(row[1], width)]
    header, before = _header(rows[:begin], body, width)
    # "frame (240 fps)" has the rate in the header.
    frequency, written = _said_before([*above, *before, tuple(" ".join(one) for one in header)])
    for at, (called, unit) in enumerate(header):
        if _RATE_IN_WORDS.search(unit) and any(":" in cells[at] for _, cells in body if cells[at:]):
            got = f"frames in the times under {called!r}"
            raise UserError(name, got, "seconds with decimals, or numbers of frames")
    header = tuple(
        (_AT_RATE.sub("", one), "" if _RATE_IN_WORDS.search(unit) else unit) for one, unit in header
    )
    # "before", "after" under "unit: mm/s"
    header = tuple((one, unit or _unit_for(one, written)) for one, unit in header)
    if "x" in written:
        header = tuple(
            (written["x"], unit) if meanings_of(name) == {"x"} else (name, unit)
            for name, unit in header
        )
    text = sheet.text or "\n".join(" ".join(cells) for _, cells in sheet.rows)
    table = Table(
        name=name,
        header=header,
        cells=tuple(cells for _, cells in body),
        lines=tuple(line for line, _ in body),
        frequency=frequency,
        units=tuple(written.items()),
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


def _unit_for(name: str, written: Mapping[str, str]) -> str:
    """The unit above a table by which "before" or "after" alone names a quantity; "" for other names.

    written: units by quantity.
    """
    if meanings_of(name) not in ({"before"}, {"after"}):
        return ""
    return next((unit for of, unit in written.items() if of != "time" and role_of(name, unit)), "")


def _block(name: str, rows: list[Row]) -> tuple[int, int]:
    """First and last rows of the numbers: the longest run of rows of numbers, and what
    belongs to it before and after.

    Rows that sum up, such as "mean,0.8", end it. Raises UserError where no row has numbers.
    """
    is_data = [_is_data(cells) for _, cells in rows]
    longest, start, at = 0, 0, 0
    for has_numbers, group in itertools.groupby(is_data):
        count = len(list(group))
        if has_numbers and count >= longest:
            longest, start = count, at
        at += count
    if not longest:
        header = next((tuple(map(split_header, cells)) for _, cells in rows if _names(cells)), ())
        told = count_readings("\n".join(" ".join(cells) for _, cells in rows))
        if told:
            raise _no_drop(name, told)
        got = "has a header and no rows" if header else "has no rows of numbers"
        with explained(name, header):
            raise UserError(name, got, "a header and rows of numbers")
    above = max((i for i in range(start) if _names(rows[i][1])), default=-1)
    width = len(trimmed(rows[start][1]))
    begin = next(
        i for i in range(above + 1, start + 1) if is_data[i] and len(trimmed(rows[i][1])) == width
    )
    end = next((i for i in range(start, len(rows)) if _sums_up(rows[i][1])), len(rows))
    if end - begin > _LEAST_SUMMED and _is_total(
        rows[end - 1][1], [row[1] for row in rows[begin : end - 1]]
    ):
        end -= 1
    return begin, end


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
    """Say whether a row has a word, and after it the sum of a column of numbers above."""
    given = [i for i, cell in enumerate(cells) if looks_numeric(cell)]
    if looks_numeric(cells[0]) or not given or not all(looks_numeric(row[0]) for row in above):
        return False
    texts = [cell_of(row, given[-1]).replace(",", ".") for row in (*above, cells)]
    numbers = [float(text) for text in texts if _PLAIN.fullmatch(text)]
    return len(numbers) > 1 and math.isclose(sum(numbers[:-1]), numbers[-1], rel_tol=_OF_A_SUM)


def _header(
    above: list[Row], body: list[Row], width: int
) -> tuple[tuple[tuple[str, str], ...], list[tuple[str, ...]]]:
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
    # A title has words of a header, and no units.
    units = {i: sum(bool(split_header(cell)[1]) for cell in rows[i]) for i in near}
    at = max(
        near, key=lambda i: (_names(rows[i]), len(rows[i]) == width, units[i], -i), default=None
    )
    if at is not None and not _names(rows[at]):
        # No name is known: the row next to the numbers is the header, unless it is a title.
        at = next(
            (i for i in reversed(near) if not _are_units(rows[i]) and len(rows[i]) >= width), None
        )
    listed = names_in_brackets([", ".join(row) for row in rows], width)
    if at is None:
        listed = listed_names([" ".join(row) for row in rows], width)
    if at is None and not listed and near:
        # "inches" alone
        written = _padded(rows[near[-1]], body, width)
        return tuple(("", plain_unit(unit)) for unit in written), rows
    if listed or at is None:
        return tuple(map(split_header, listed or [""] * width)), rows
    # "Height (cm)", merged over "Trial 1", "Trial 2", ...
    trials = next((i for i in near if i > at and _are_trials(rows[i])), None)
    if trials is not None:
        merged = _merged(_padded(rows[at], body, width), _padded(rows[trials], body, width))
        return merged, [row for i, row in enumerate(rows) if i not in (at, trials)]
    names = _padded(rows[at], body, width)
    if (titled := _titled(rows[:at], names)) is not None:
        return titled
    # Numbers beyond the last name may be halves of numbers with commas: no name is made up for them.
    is_short = any(any(cells[len(rows[at]) :]) for _, cells in body)
    if is_short and len(names) > len(rows[at]) and names[0]:
        names = rows[at]
    header = [split_header(name) for name in names]
    used = {at}
    below = next((i for i in near if i != at and _are_units(rows[i])), None)
    if below is not None:
        used.add(below)
        written = _padded(rows[below], body, width)
        for i, unit in enumerate(map(plain_unit, written[: len(header)])):
            if not header[i][1] and unit.lower() not in NO_UNIT:
                header[i] = (header[i][0], unit)
    groups = [i for i in near if i < at and i not in used and len(rows[i]) >= width - 1]
    if groups and len(set(header)) < len(header):
        group = _padded(rows[groups[-1]], body, width)
        # A sentence above may have fewer words than the table has columns.
        group = (*group, *[""] * (len(header) - len(group)))
        header = [
            (f"{of} {name}".lower() if of else name, unit)
            for of, (name, unit) in zip(group[: len(header)], header, strict=True)
        ]
    return tuple(header), [row for i, row in enumerate(rows) if i not in used]


def _is_said(cells: tuple[str, ...]) -> bool:
    """Say whether a row is a name of the whole file and its value, as programs write above tables."""
    return len(cells) == 2 and bool(of_file(cells[0])) and not role_of(*split_header(cells[0]))


def _fits(cells: tuple[str, ...], body: list[Row], width: int) -> bool:
    """Say whether a row may name the columns of the numbers below it."""
    if not any(any(map(str.isalpha, cell)) for cell in cells) or any(map(looks_numeric, cells)):
        return False
    if len(cells) >= width or (len(cells) == width - 1 and _is_counted(body)):
        return True
    return _names(cells) > 0 and (width == 1 or len(cells) > 1)


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


def _merged(over: Sequence[str], below: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Names with units of columns under headings that are merged over the names of trials: "height
    trial 1", in cm, of "Height (cm)" over "Trial 1".

    Where the lower row has no name, that of the upper row counts.
    """
    header = []
    spread: Iterator[str] = itertools.accumulate(over, lambda before, cell: cell or before)
    for own, heading, trial in zip(over, spread, below, strict=True):
        name, unit = split_header(heading if trial else own)
        header.append((f"{name} {trial}".strip().lower(), unit))
    return tuple(header)


def _titled(
    above: Sequence[tuple[str, ...]], names: Sequence[str]
) -> tuple[tuple[tuple[str, str], ...], list[tuple[str, ...]]] | None:
    """Names with units of trials below a line that says what they all have, "Rebound height (cm)", and
    the other lines above; None where there is no such line.
    """
    titles = [i for i, row in enumerate(above) if _is_title(row)]
    if len(titles) != 1 or not _are_trials(names):
        return None
    (title,) = filter(None, above[titles[0]])
    over = [title if meanings_of(name) & {"trial", "drop"} else "" for name in names]
    return _merged(over, names), [row for i, row in enumerate(above) if i != titles[0]]


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


def _said_before(rows: list[tuple[str, ...]]) -> tuple[float | None, dict[str, str]]:
    """The frequency of frames or samples, Hz, and units by quantity, that lines before a table name."""
    frequency = None
    written: dict[str, str] = {}
    for i, cells in enumerate(rows):
        text = "\t".join(cells)
        parts = [part.strip() for part in re.split(r"[\t:=;,]", text) if part.strip()]
        for name, value in itertools.pairwise(parts):
            meaning = of_file(name)
            number = re.match(r"\d+(?:\.\d+)?", value)
            if meaning == "frequency" and number is not None:
                frequency = frequency or float(number[0])
            elif meaning in _UNITS_OF and is_unit(plain_unit(value)):
                written[_UNITS_OF[meaning]] = plain_unit(value)
            elif meaning == "units" and value.lower() in ("si", "mks"):
                written |= {"time": "s", "position": "m", "speed": "m/s", "force": "N"}
            elif meaning == "units":
                unit = plain_unit(value)
                written |= {of: unit for of in QUANTITIES_OF_COLUMNS if is_unit_of(unit, of)}
            elif meaning == "dimension of x" and role_of(value.lower()) == "time":
                # LabVIEW counts its x in s and names it x_value.
                written |= {"x": "time", "time": "s"}
        is_sentence = len(cells) == 1 or (len(cells) == 2 and is_beside(cells[0]))
        for unit in map(plain_unit, _UNIT_IN_WORDS.findall(text) if is_sentence else ()):
            quantities = [of for of in QUANTITIES_OF_COLUMNS if is_unit_of(unit, of)]
            written |= {of: unit for of in quantities if of not in written}
        match = _RATE_IN_WORDS.search(text)
        if match is not None:
            thousands = 1e3 if match[2] else 1.0
            frequency = frequency or thousands * float(match[1].replace(",", "."))
        # Vicon: the rate is alone in the line below "Trajectories" or "Devices".
        is_of_vicon = i and rows[i - 1][:1] in (("Trajectories",), ("Devices",), ("Model Outputs",))
        if is_of_vicon and len(cells) == 1 and re.fullmatch(r"\d+(?:\.\d+)?", cells[0]):
            frequency = float(cells[0])
    return frequency, written


def _style(table: Table, text: str) -> NumberStyle:
    """The style of a table's numbers. Raises UserError for those that can be read in two ways.

    text: of the whole file.
    """
    columns = [table.texts(i) for i in range(len(table.header))]
    return style_of(table.name, columns, decimal_signs(text))


def _is_label(cells: Sequence[str], width: int) -> bool:
    """Say whether a row of a table of `width` columns has a word alone, such as "Run 2"."""
    given = trimmed(cells)
    if len(given) != 1 or looks_numeric(given[0]):
        return False
    words = {meaning for meaning in meanings_of(given[0]) if not meaning.isdigit()}
    return width > 1 or (bool(words) and words <= {"number", "trial", "drop"})
