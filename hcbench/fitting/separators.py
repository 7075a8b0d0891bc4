"""Lines of text as rows of cells: comments, marks of Markdown and LaTeX, and the sign between cells."""

from __future__ import annotations

import csv
import io
import itertools
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from hcbench.fitting.cells import counts, is_missing, looks_numeric
from hcbench.fitting.column_names import (
    is_beside,
    is_unit,
    meanings_of,
    of_file,
    role_of,
    split_header,
)
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

# A row: its number in the file, and its cells.
Row = tuple[int, tuple[str, ...]]

# "" stands for one column. The blank of "43 3/4" stands in a number.
_BLANKS = r"(?<!\d)\s+|\s+(?!\d+/(?:2|4|8|16|32|64)\b)"
_WIDE_BLANKS = r"\s{2,}"
# Likelier ones first: they win where two part the lines equally well.
_SEPARATORS = ("\t", ";", "|", "&", ",", _WIDE_BLANKS, _BLANKS, "")
# Blanks stand in names too: another sign that parts the lines nearly as well is the one between cells.
_OF_BLANKS = (_WIDE_BLANKS, _BLANKS)
_WEAKER = 0.9
_COMMENT = re.compile(r"\s*(?:#|%|//|!|\\(?=\t)|<!--)+\s*")
# A "#" after a number starts a comment; in a header it may be part of a name, as in "bounce #".
_AFTER_NUMBER = re.compile(r"(?<=[\d.])\s+(?:#|//).*")
# A line between header and numbers in tables of text: "|---|:---:|", "+---+", "====  ====".
_RULE = re.compile(
    r"[\s|:+=_&*–—-]*(?:-{2,}|={2,}|_{3,}|—{2,})[\s|:+=_&*–—-]*|\s*\|?\s*:?-:?\s*(?:\|\s*:?-:?\s*)+\|?\s*"
)
_LATEX_END = re.compile(r"\\\\(?:\s*\[[^\]]*\])?\s*(?:\\[a-z]*(?:rule|line)\b.*)?\s*$")
_LATEX_ALONE = re.compile(
    r"\s*\\(?:[a-z]*(?:rule|line)|begin|end|centering|caption|label|small|footnotesize)\b.*"
)
# Rows of a matrix or a list in a program: "[1, 2],", "{1, 2},", "1 2;".
_IN_BRACKETS = re.compile(r"\s*[\[({].*[\])}]+[,;]?\s*$|[^\[({]*\d\s*;\s*$")
# Lines that are looked at to find the separator: all of the first ones, and others further down.
_FIRST_LOOKED_AT = 40
_MOST_LOOKED_AT = 200
# Meanings of a name that other columns complete.
_ALONE = ({"x"}, {"uncertainty"})
# Signs that stand between two numbers of a cell, or between cells.
_MARKS = frozenset(["±", "+-", "+/-", "\\pm", "&", "|", ";", ","])
# Words in a header that is parted by what they mean.
_MOST_WORDS = 14
# The longest cell, and the longest line.
_LONGEST = 400
_LONGEST_LINE = 200_000


def rows_of(name: str, lines: Sequence[tuple[int, str]]) -> tuple[Row, ...]:
    """Rows of cells in the lines of a file, parted by the sign that gives the most columns of
    numbers under a header of as many names.

    name: what errors call the file.
    lines: numbers and text, without empty ones.
    Raises UserError for a line that is too long for a row, and for a cell that is too long to be a
    number or a name.
    """
    for number, text in lines:
        if len(text) > _LONGEST_LINE:
            got = f"{len(text)} characters"
            expected = f"lines of at most {_LONGEST_LINE}"
            raise UserError(f"{name}, line {number}", got, expected, "Write a row for each reading")
    kept = list(_without_marks(lines))
    # Excel writes the sign into the first line: "sep=;".
    stated = re.fullmatch(r"sep=(.)", kept[0][1].strip()) if kept else None
    if stated is not None:
        kept = kept[1:]
    texts = [text for _, text in kept]
    sign = _likeliest_sign(texts) if stated is None else stated[1]
    found = _score(texts, sign)
    is_counted = counts([split(text, sign)[0] for text in texts[found.first :]])
    rows: list[Row] = []
    for at, (number, text) in enumerate(kept):
        if at < found.first:
            cells = _cells_above(text, sign, found.width, is_counted)
        else:
            cells = split(text, sign)
        longest = max(map(len, cells))
        if longest > _LONGEST:
            where = f"{name}, line {number}"
            raise UserError(where, f"a cell of {longest} characters", "cells of numbers")
        if any(cells):
            rows.append((number, tuple(cells)))
    return tuple(rows)


def _likeliest_sign(texts: Sequence[str]) -> str:
    """The sign that parts lines best; of equal ones, that which gives the first line known names."""

    def worth(sign: str) -> tuple[float, int]:
        return _score(texts, sign).score, _known_names(texts[:1], sign)

    return max(_SEPARATORS, key=worth)


def _cells_above(text: str, sign: str, width: int, is_counted: bool) -> list[str]:
    """Cells of a line above the numbers, which may be the header.

    sign, width: of the rows of numbers.
    is_counted: their first column counts, and may have no name: pandas prints none over the index
    of the rows.
    A header may have other signs between its names than there are between the numbers. Of the ways
    that give as many names as numbers the one with the most known names is taken.
    """
    ways = [
        way
        for way in header_cells(text, sign, width)
        if len(way) == width or (is_counted and len(way) == width - 1)
    ]
    if not ways:
        cells = split(text, sign)
    else:
        cells = max(ways, key=lambda way: sum(map(_is_known, way)) - len(way))
    return [name.strip('"') for name in cells]


def _without_marks(lines: Sequence[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Yield lines without comments, rules and the marks of Markdown, wikis, matrices and LaTeX.

    Before the first numbers a comment may be a header: there it loses its mark only.
    """
    is_wiki = any(text.lstrip().startswith("{|") for _, text in lines)
    of_numbers = [text for _, text in lines if any(map(str.isdigit, text))]
    is_matrix = sum(1 for text in of_numbers if _IN_BRACKETS.match(text)) * 2 > len(of_numbers)
    is_latex = sum(1 for _, text in lines if _LATEX_END.search(text)) > 1
    has_numbers = False
    for number, line in lines:
        text = line
        # Wikis write a sign twice: "! a !! b" and "| 1 || 2", or "||a||b||" in headers alone.
        if is_wiki or text.startswith("||"):
            text = re.sub(r"^\s*!|!!|\|\|", "|", text)
        if is_matrix:
            text = _without_brackets(text)
        if is_latex:
            if _LATEX_ALONE.fullmatch(text):
                continue
            text = _plain(_LATEX_END.sub("", text).removeprefix("\\hline").strip())
        if _RULE.fullmatch(text) or (is_wiki and text.startswith(("{|", "|-", "|}"))):
            continue
        comment = _COMMENT.match(text)
        if comment is not None and has_numbers:
            continue
        if comment is not None:
            text = text[comment.end() :].removesuffix("-->")
        else:
            text = _AFTER_NUMBER.sub("", text)
            has_numbers = has_numbers or _is_of_numbers(text)
        if text.strip().startswith("|"):
            # An empty cell of a wiki stands at the end of its line.
            text = text.strip()[1:].removesuffix("" if is_wiki else "|")
        if text.strip():
            yield number, text


def _without_brackets(text: str) -> str:
    """A line of a matrix without the brackets about it and the sign to the next line."""
    text = text.strip().rstrip(",; ").lstrip("[({ ")
    while text[-1:] in tuple("])}") and sum(map(text.count, "])}")) > sum(map(text.count, "[({")):
        text = text[:-1]
    return text


def _plain(text: str) -> str:
    """A line of LaTeX with the content alone of commands for a number, a quantity or a font."""
    text = text.replace("~", " ")
    text = re.sub(r"\\(?:SI|qty)\s*\{([^{}]*)\}\s*\{([^{}]*)\}", r"\1 \2", text)
    text = re.sub(r"\\multicolumn\s*\{[^{}]*\}\s*\{[^{}]*\}", "", text)
    return re.sub(r"\\(?:num|text\w\w|bfseries|itshape)\b\s*(?:\{([^{}]*)\})?", r"\1", text)


def _is_of_numbers(text: str) -> bool:
    """Say whether a line has numbers as a table has them, two or one alone."""
    cells = [cell for cell in re.split(r"[\t;|&]|,\s|\s+|,", text) if cell.strip()]
    numeric = sum(map(looks_numeric, cells))
    return numeric > 0 and 2 * numeric >= len(cells)


def split(text: str, separator: str) -> list[str]:
    """Cells of a line, with the quotes of csv; without blanks at their ends."""
    if not separator:
        return [text.strip().strip('"')]
    if separator in _OF_BLANKS and '"' not in text:
        return re.split(separator, text.strip())
    if separator in _OF_BLANKS:
        separator = " "
    try:
        cells = next(
            csv.reader(io.StringIO(text.strip(" \r\n")), delimiter=separator, skipinitialspace=True)
        )
    except (csv.Error, StopIteration):
        return [text]
    return [cell.strip() for cell in cells]


class _Parted(NamedTuple):
    """Rows that a sign makes of lines.

    score: how well it parts them; 0 where it gives no numbers.
    width: cells of the rows of numbers.
    first: place of the first line with as many.
    """

    score: float
    width: int
    first: int


@dataclass(slots=True)
class _RowsOfWidth:
    """Rows of numbers with as many cells each, of the lines looked at.

    first: place of the first such line.
    heads: their first cells.
    full: cells of the fullest of them, less the empty ones at its end.
    numbers: how many numbers they have, less where cells are text.
    """

    first: int
    heads: list[str] = field(default_factory=list)
    full: int = 0
    numbers: float = 0.0


def _score(texts: Sequence[str], separator: str) -> _Parted:
    """Rate a sign that parts lines by the numbers in rows of the commonest width; by ten times that
    where a known header of the same width goes before.

    Of a long file some lines are looked at.
    """
    step = max(1, len(texts) // _MOST_LOOKED_AT)
    begin = min(_FIRST_LOOKED_AT, len(texts))
    rows: dict[int, _RowsOfWidth] = {}
    for at in (*range(begin), *range(begin, len(texts), step)):
        cells = split(texts[at], separator)
        numeric = _count_numbers(cells, separator)
        empty = sum(map(is_missing, cells))
        if not numeric or 2 * (numeric + empty) < len(cells):
            continue
        # Cells of text say that the sign is another one.
        share = (numeric + empty) / len(cells)
        of_width = rows.setdefault(len(cells), _RowsOfWidth(at))
        of_width.numbers += numeric * share**2
        of_width.heads.append(cells[0])
        of_width.full = max(of_width.full, len(trimmed(cells)))
    if not rows:
        return _Parted(0.0, 0, len(texts))
    scores = {}
    for width, of_width in rows.items():
        worth = _worth_of_header(texts[: of_width.first], separator, width, of_width, begin)
        scores[width] = of_width.numbers * worth
        if separator in _OF_BLANKS:
            scores[width] *= _WEAKER
    # A table of one row, such as phyphox writes it, counts as well as a table of one column.
    width = max(scores, key=lambda width: (scores[width], width))
    return _Parted(scores[width], width, rows[width].first)


def _count_numbers(cells: Sequence[str], separator: str) -> int:
    """Number of cells of a line that are numbers; 0 where the sign surely is another one."""
    if not _MARKS.isdisjoint(cells):
        # A sign stands between numbers of one cell.
        return 0
    if separator == "," and any(re.fullmatch(r"0\d+", cell) for cell in cells):
        # "0,05" is no 0 and 05.
        return 0
    if of_file(cells[0]) and not looks_numeric(cells[0]):
        # "fps,240" tells of the file.
        return 0
    return sum(map(looks_numeric, cells))


def _worth_of_header(
    above: Sequence[str], separator: str, width: int, rows: _RowsOfWidth, most_heads: int
) -> float:
    """Factor by which a header makes rows of numbers likelier: 10 where a name is known, 2 where it has
    as many cells, 1 without one.

    above: lines before the rows.
    width: cells of the rows.
    most_heads: how many rows tell whether their first column counts.
    """
    worth = 1.0
    is_counted = counts(rows.heads[:most_heads])
    for text in above:
        for way in header_cells(text, separator, width):
            is_known = any(role_of(*split_header(cell)) for cell in way)
            fits = bool({len(way), len(trimmed(way))} & {width, rows.full})
            # The index of the rows may have no name.
            lacks_index = is_known and is_counted and len(way) == width - 1
            if fits or lacks_index:
                worth = max(worth, 10.0 if is_known else 2.0)
    return worth


def _known_names(texts: Sequence[str], separator: str) -> int:
    """Number of names with a role in lines without numbers."""
    cells = [cell for text in texts for cell in split(text, separator)]
    return sum(role_of(*split_header(cell)) != "" for cell in cells)


def trimmed(cells: Sequence[str]) -> tuple[str, ...]:
    """Cells without the empty ones at their end."""
    count = len(cells)
    while count and not cells[count - 1]:
        count -= 1
    return tuple(cells[:count])


def header_cells(text: str, separator: str, width: int) -> Iterator[list[str]]:
    """Yield ways to part a header: by the sign between the numbers, or by others where that is blanks.

    width: of the rows of numbers. A unit belongs to the name before it: "time, s" is one cell. A line
    with a number yields no way.
    """
    if not separator:
        if any(map(str.isalpha, text)) and not looks_numeric(text):
            yield [text.strip()]
        return
    if separator not in _OF_BLANKS:
        cells = split(text, separator)
        has_words = any(map(str.isalpha, "".join(cells)))
        if has_words and not any(map(looks_numeric, cells)):
            yield _with_units(cells) if separator == "," else cells
        return
    if '"' in text:
        yield split(text, separator)
    # A unit in brackets belongs to the name before it.
    wide = re.split(r"\s{2,}(?![\[(])", text.strip())
    narrow = re.split(r"\s+(?![\[(])", text.strip())
    narrowest = re.split(r"\s+", text.strip())
    of_signs = [_with_units(split(text, sign)) for sign in ("\t", ";", ",") if sign in text]
    for names in (wide, *of_signs, narrow, narrowest):
        if not any(map(looks_numeric, names)):
            yield names
    yield from _by_meaning(text.split(), width)


def _by_meaning(words: list[str], width: int) -> Iterator[list[str]]:
    """Yield the ways to join words to `width` names that are all known, no two of one role.

    Names of several words each may have single blanks between them: "touch time rebound height".
    """
    if not 1 < width < len(words) <= _MOST_WORDS:
        return
    for cuts in itertools.combinations(range(1, len(words)), width - 1):
        names = [" ".join(words[a:b]) for a, b in itertools.pairwise([0, *cuts, len(words)])]
        if not all(map(_is_known, names)):
            continue
        roles = list(filter(None, (role_of(*split_header(name)) for name in names)))
        if len(set(roles)) == len(roles):
            yield names


def _is_known(name: str) -> bool:
    """Say whether a name has a role, or tells of something else than bounces."""
    plain, unit = split_header(name)
    return bool(role_of(plain, unit)) or is_beside(plain) or meanings_of(plain) in _ALONE


def _with_units(cells: list[str]) -> list[str]:
    """Cells with a unit alone joined to the name before them: "time", "s" is "time, s"."""
    joined: list[str] = []
    for cell in cells:
        last = joined[-1] if joined else ""
        is_for_name = is_unit(cell.strip()) and not split_header(last)[1]
        if is_for_name and role_of(last.lower()):
            joined[-1] = f"{last}, {cell.strip()}"
        else:
            joined.append(cell)
    return joined


# "@attribute time_ms numeric", "Column 2: height (m)".
_OF_LIST = re.compile(
    r"^[@#%\s]*(?:attribute|columns?|col|field|variable|channel|spalte|colonne|columna)?\s*\d*\s*[:=.)-]?\s*"
    r"|\s+(?:numeric|real|integer|int|float|double|text|string)\b.*",
    re.IGNORECASE,
)


def names_in_brackets(lines: Sequence[str], count: int) -> tuple[str, ...]:
    """Names of `count` columns in brackets, as in SQL; of several lines the last; () for none."""
    names: tuple[str, ...] = ()
    for line in lines:
        for inside in re.findall(r"\(([^()]*,[^()]*)\)", line):
            # Of "name type" the name alone.
            found = [(part.split() or [""])[0] for part in inside.split(",")]
            if _are_names(found, count):
                names = tuple(found)
    return names


def listed_names(lines: Sequence[str], count: int) -> tuple[str, ...]:
    """Names of `count` columns in brackets, or below one another in the last lines, as in ARFF; ()
    for none.
    """
    below = [line for line in lines if not line.strip().lower().startswith(("@data", "@relation"))]
    way = [_OF_LIST.sub("", line).strip() for line in below[-count:]]
    return tuple(way) if _are_names(way, count) else names_in_brackets(lines, count)


def _are_names(way: Sequence[str], count: int) -> bool:
    """Say whether texts name `count` columns: "rate = 240" has a value, and names nothing."""
    return len(way) == count > 1 and all(
        _is_known(one) and not set(one) & {"=", ":", "<"} for one in way
    )
