"""Tables, numbers and results as text, and text from models that others wrote made safe to print."""

from __future__ import annotations

import csv
import io
import math
import unicodedata
from collections.abc import Mapping, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from typing import TYPE_CHECKING, Any

import hcbench

if TYPE_CHECKING:
    from collections.abc import Iterable

    import pandas as pd
    from matplotlib.figure import Figure


_LONGEST = 200
# Characters of a note that are printed: hcbench's own sentences are longer than a user's names.
LONGEST_NOTE = 400
# Columns of a line for people.
COLUMNS = 100
# Control characters, direction marks and line separators: nothing of these is printed.
_UNSEEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}


def sanitized(text: object, longest: int = _LONGEST) -> str:
    """The text in one line without control characters, each of which is a "?": no name can move a
    cursor, break a line or end a table.

    longest: characters that are kept; a longer text then ends in "...".
    """
    shown = ""
    for character in str(text)[: longest + 1]:
        if unicodedata.category(character) in _UNSEEN:
            shown += "?"
        else:
            shown += character
    if len(shown) > longest:
        return f"{shown[:longest]}..."
    return shown


def shown(value: object) -> str:
    """The value as Python shows it, at most 80 characters; its type where that fails."""
    try:
        return f"{value!r:.80}"
    # A caller's own class may raise anything.
    except Exception:
        return f"a {type(value).__name__}"


def table(header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Lines of a table, cells at the right of their columns, two spaces between columns, or one
    where the lines would be longer than COLUMNS characters.

    rows: of as many cells as the header.
    """
    lines = [header, *rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    gap = "  "
    if len(gap.join(" " * width for width in widths)) > COLUMNS:
        gap = " "
    return [gap.join(map(str.rjust, cells, widths)) for cells in lines]


def joined_names(names: Sequence[str]) -> str:
    """Names with commas between them, as --pair takes them; a name that holds one is quoted."""
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow(names)
    return line.getvalue()


def split_names(text: str) -> list[str]:
    """The names in a text "a,b"; one with a comma in it is quoted, as in '"a, left",b'. The inverse
    of `joined_names`. Empty for a name that is too long.
    """
    if '"' not in text:
        return text.split(",")
    try:
        return next(csv.reader([text], skipinitialspace=True), [])
    except csv.Error:
        # A field longer than the csv module takes, and so longer than any name.
        return []


def without_empty(
    header: tuple[str, ...], rows: Sequence[tuple[str, ...]], name: str
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """The header and rows of a table without the column `name`, where no row has anything in it;
    else with it. Raises ValueError for a column that the table does not have.
    """
    at = header.index(name)
    if any(row[at] for row in rows):
        return header, list(rows)
    return header[:at] + header[at + 1 :], [row[:at] + row[at + 1 :] for row in rows]


def two_digits(error: float) -> str:
    """An error as every line, page and figure prints it: "0.028", "2.1e-5", "1e-7"."""
    digits = 2 if error >= 1e-5 else 1
    return f"{error:.{digits}g}".replace("e-0", "e-")


def as_bound(error: float) -> str:
    """An error that others shall not exceed: two digits, rounded up."""
    up = Context(prec=2, rounding=ROUND_CEILING)
    return f"{float(up.create_decimal(f'{error:.4g}')):.2g}"


def rounded_down(value: float) -> str:
    """A limit in two digits that a number may be up to: what is printed is within it."""
    down = Context(prec=2, rounding=ROUND_FLOOR)
    return f"{float(down.create_decimal_from_float(float(value))):.2g}"


def rounded_up(value: float) -> str:
    """A limit in two digits that a number may be down to: what is printed is within it."""
    up = Context(prec=2, rounding=ROUND_CEILING)
    return f"{float(up.create_decimal_from_float(float(value))):.2g}"


def shortest(value: float) -> str:
    """The fewest digits that read back the same."""
    short = f"{value + 0.0:.15g}"
    return short if float(short) == value else repr(float(value))


def number(value: float, digits: str = ".4f") -> str:
    """A number in fixed form, an em dash for none."""
    return "—" if math.isnan(value) else f"{value:{digits}}"


def arguments(values: Mapping[str, Any]) -> str:
    """Keyword arguments of a call as Python writes them: "alpha=0.3, kind='law'"."""
    words = []
    for name, value in values.items():
        text = shortest(value) if isinstance(value, float) else repr(value)
        words.append(f"{name}={text}")
    return ", ".join(words)


def time_step(step: float) -> str:
    """A time step, s, as text that the command line reads: "0.001"; "1/240" where that is exact and
    no decimal of six digits is.
    """
    plain = f"{step:.6g}"
    if float(plain) == step or step <= 0:
        return plain
    rate = round(1.0 / step)
    if rate and step == 1.0 / rate:
        return f"1/{rate}"
    return plain


def gravity_text(gravity: Sequence[float]) -> str:
    """Gravity, m/s²: one number where it is along -z, else three."""
    x, y, z = gravity
    if x == y == 0.0 and z <= 0.0:
        return f"{abs(z):.4g}"
    return " ".join(f"{each + 0.0:.4g}" for each in gravity)


# Lines of a repr, at most.
_LINES = 12


class Shown:
    """A result in at most 12 lines of text, as a table of pandas, and as that table in a notebook.

    A subclass states `_lines` and `_rows`.
    """

    __slots__ = ()

    def _lines(self) -> Iterable[str]:
        """The result in lines."""
        raise NotImplementedError

    def _rows(self) -> Iterable[Mapping[str, Any]]:
        """The rows of `to_frame`, SI; units stand in the names."""
        raise NotImplementedError

    def __repr__(self) -> str:
        """The result in at most 12 lines of at most 100 columns."""
        lines = []
        for line in self._lines():
            if len(line) > COLUMNS:
                lines.append(line[: COLUMNS - 3] + "...")
            else:
                lines.append(line)
        if len(lines) > _LINES:
            lines[_LINES - 1 :] = ["..."]
        return "\n".join(lines)

    def to_frame(self) -> pd.DataFrame:
        """The result as a table of pandas; numbers are SI, and the columns' names have the units."""
        # pandas is slow to import.
        import pandas as pd

        return pd.DataFrame(list(self._rows()))

    def _repr_html_(self) -> str:
        """The table as Jupyter shows it."""
        html: str = self.to_frame().to_html(index=False, na_rep="", border=0)
        return html


class Drawn(Shown):
    """A result that hcbench draws: its figures stand above all results,
    and matplotlib is loaded late.
    """

    __slots__ = ()

    def plot(self) -> Figure:
        """The main figure: restitution over impact speed, for `Figure.savefig` or a notebook."""
        figure: Figure = hcbench._figures().figure_of(self)
        return figure

    def _repr_html_(self) -> str:
        """Show the text and the main figure in Jupyter."""
        html: str = hcbench._figures().html_of(self)
        return html
