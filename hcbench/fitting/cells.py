"""Cells of a table: numbers as programs and people write them, in one style for a file."""

from __future__ import annotations

import itertools
import math
import re
import unicodedata
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING

from hcbench.fitting.column_names import is_unit, is_unit_of, plain_unit
from hcbench.system.errors import UserError
from hcbench.terms import units

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

# Cells without a number.
MISSING = {
    *("", "-", "--", "---", "–", "—", "na", "n/a", "nan", "null", "none", "#n/a", "#value!"),
    *("missing", "?", "*", "."),
}
# Signs between thousands that are never decimal signs.
_BLANKS = "  \u2009\u202f'’"
_EXPONENT = (
    r"(?:[eEdD][-+−]?\d+|\s*(?:[×x*·]|\\times|\\cdot)\s*10\s*(?:\^|\*\*)?\s*\{?[-+−]?\d+\}?)"
)
_MANTISSA = rf"[-+−]?(?:\d(?:[\d.,]|[{_BLANKS}](?=\d{{3}}))*|[.,]\d+)"
_NUMBER = re.compile(rf"({_MANTISSA})({_EXPONENT})?")
# "47 1/4" and "3/8", as rulers in inches have them; "47¼".
_FRACTION = re.compile(
    r"(?:(\d+)(?:\s+|-|\s*(?=[¼-¾⅐-⅞])))?(?:(\d+)\s*[/⁄]\s*(2|4|8|16|32|64)\b|([¼-¾⅐-⅞]))"
)
# A number with its unit, of several in one cell: "6' 3.5\"", "1 m 20 cm", "1 min 2.3 s".
_PART = re.compile(r"\s*(\d[\d.,]*(?:[\s-]+\d+/\d+)?)\s*([^\W\d_]+\.?|''|[\"'′″’”])\s*(?:,|and)?")
_TAIL = re.compile(r"\s*([%‰]|[^\d\s.,;+\-±()][^\d;±()]*(?:\^?-?\d)?)?\s*")
_PLUS_MINUS = re.compile(r"\s*(?:±|\+/?[-−]|\\pm)\s*")
_SHORT = re.compile(r"([-+−]?\d*(?:[.,](\d+))?)\((\d+(?:[.,]\d+)?)\)")
# "1:02.5", "0:00:01.234", "0:00:01:23" with hundredths, as Kinovea writes it.
_CLOCK = re.compile(r"(?:(\d+):)?(\d{1,2}):(\d{1,2})(?:([.,:])(\d+))?")
_OF_NUMPY = re.compile(r"\bnp\.\w+\(([^()]*)\)")
_ADVICE = "Write numbers without a sign between the thousands"
# 1970-01-01: later dates in seconds keep a microsecond.
_EPOCH = 719163
_EXPONENT_SIGNS = str.maketrans("dD−", "eE-")


# Arabic signs of decimals, of thousands and between cells; marks of the direction of writing.
_SIGNS_OF_NUMBERS = {0x66B: ".", 0x66C: "'", 0x61B: ";", 0x60C: ","} | dict.fromkeys(
    [0x61C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A)]
)
# Letters and signs as wide as those of Chinese.
_SIGNS_OF_NUMBERS |= {0xFF00 + i: chr(0x20 + i) for i in range(1, 0x5F)} | {0x3000: " "}


@dataclass(frozen=True, slots=True)
class NumberCell:
    """A cell that has a number: its value, standard uncertainty (NaN for none) and unit ("")."""

    value: float
    uncertainty: float = math.nan
    unit: str = ""


@dataclass(frozen=True, slots=True)
class NumberStyle:
    """Style in which a file writes its numbers.

    decimal: "." or ","; the other one of the two parts thousands.
    """

    decimal: str = "."

    def read(self, text: str) -> NumberCell | None:
        """The number in a cell: "0,5", "1.2E-3", "0.20 ± 0.01", "0.960(5)", "85 %", "31 cm", "1:02.5".

        None for other text.
        """
        text = _bare(text)
        if (seconds := _seconds(text)) is not None:
            return NumberCell(seconds, unit="s")
        if (several := self._of_parts(text)) is not None:
            return several
        if (fraction := _fraction(text)) is not None:
            return fraction
        short = _SHORT.fullmatch(text.partition(" ")[0]) if "(" in text else None
        if short is not None and short[1]:
            value = self._float(short[1], "")
            by = short[3].replace(",", ".")
            unit = text.partition(" ")[2].strip()
            return NumberCell(
                value, float(by) * 10.0 ** (-len(short[2] or "") if "." not in by else 0), unit
            )
        parts = _PLUS_MINUS.split(text.strip("()"))
        if len(parts) > 2:
            return None
        number = _NUMBER.match(parts[0])
        if number is None:
            return None
        value = self._float(number[1], number[2] or "")
        tail = _TAIL.fullmatch(parts[0][number.end() :])
        # A number beyond all bounds is one, for its reader to refuse: as text it would end the table.
        if tail is None or math.isnan(value):
            return None
        unit = (tail[1] or "").strip()
        if unit and not is_unit(unit):
            return None
        if len(parts) == 1:
            return NumberCell(value, unit=unit)
        by_number = _NUMBER.match(parts[1])
        if by_number is None:
            return None
        tail = _TAIL.fullmatch(parts[1][by_number.end() :].lstrip(")"))
        if tail is None:
            return None
        return NumberCell(
            value, self._float(by_number[1], by_number[2] or ""), unit or (tail[1] or "").strip()
        )

    def _of_parts(self, text: str) -> NumberCell | None:
        """The sum of parts in smaller and smaller units, such as "6' 3.5\"", in the first one; else None."""
        total, at, first, last = 0.0, 0, "", math.inf
        if not text:
            return None
        while at < len(text):
            part = _PART.match(text, at)
            if part is None or (not at and part.end() == len(text)):
                return None
            unit = plain_unit(part[2])
            quantity = next((of for of in ("time", "position") if is_unit_of(unit, of)), "")
            number = _fraction(part[1]) or NumberCell(self._float(part[1], ""))
            if not quantity or (first and not is_unit_of(first, quantity)):
                return None
            scale = units.parse(f"1 {unit}", quantity, "unit")
            if scale >= last:
                return None
            first, last, at = first or unit, scale, part.end()
            total += number.value * scale
        return NumberCell(total / units.parse(f"1 {first}", quantity, "unit"), unit=first)

    def _float(self, mantissa: str, exponent: str) -> float:
        """A number of its parts; NaN where its signs are not of this style."""
        for blank in _BLANKS:
            mantissa = mantissa.replace(blank, "")
        mantissa = mantissa.replace("−", "-")
        other = "," if self.decimal == "." else "."
        if other in mantissa:
            if not _is_grouped(mantissa, other, self.decimal):
                return math.nan
            mantissa = mantissa.replace(other, "")
        exponent = exponent.translate(_EXPONENT_SIGNS)
        if exponent and exponent[0] not in "eE":
            exponent = "e" + re.split(r"10", exponent, maxsplit=1)[1].strip(" ^*{}")
        try:
            return float(mantissa.replace(self.decimal, ".") + exponent)
        except ValueError:
            return math.nan


def _bare(text: str) -> str:
    """A cell without TeX's marks about a number and in it, or the type that NumPy prints about it."""
    text = _OF_NUMPY.sub(r"\1", text).strip().strip("$").strip().replace("{,}", ",")
    # "1." and "1)" are the first.
    text = re.sub(r"^(\d+)[.):]$", r"\1", text)
    return text.replace("\\%", "%").replace("\\,", " ")


def _fraction(text: str) -> NumberCell | None:
    """The number in "47 1/4", "3/8 in" or "47¼"; None for other text."""
    match = _FRACTION.match(text)
    if match is None:
        return None
    whole, over, under, sign = match.groups()
    share = unicodedata.numeric(sign) if sign else int(over) / int(under)
    unit = text[match.end() :].strip()
    if share >= 1.0 or (unit and not is_unit(unit)):
        return None
    return NumberCell(int(whole or 0) + share, unit=unit)


def _seconds(text: str) -> float | None:
    """Seconds of a clock's time or of a date with a time; None for other text."""
    clock = _CLOCK.fullmatch(text)
    if clock is not None:
        hours, minutes, seconds, sign, part = clock.groups()
        if sign == ":" and hours is None:
            return None
        # After a colon stand hundredths or thousandths.
        fraction = float(f"0.{part}") if part else 0.0
        return 3600.0 * float(hours or 0) + 60.0 * float(minutes) + float(seconds) + fraction
    if len(text) > 10 and text[4:5] in "-/" and text[:4].isdigit():
        for form in (
            text,
            text.removesuffix(" UTC"),
            text.replace("/", "-"),
            text.replace(",", "."),
        ):
            try:
                stamp = datetime.fromisoformat(form)
            except ValueError:
                continue
            midnight = stamp.replace(hour=0, minute=0, second=0, microsecond=0)
            return (stamp - midnight).total_seconds() + 86400.0 * (stamp.toordinal() - _EPOCH)
    return None


def looks_numeric(text: str) -> bool:
    """Say whether a cell has a number in any style."""
    return any(NumberStyle(decimal).read(text) is not None for decimal in ".,")


def counts(cells: Sequence[str]) -> bool:
    """Say whether cells count rows: whole numbers, each one above, or each one below, the one before;
    "1." and "1)" too.
    """
    if len(cells) < 2 or not all(re.fullmatch(r"\d+[.):]?", cell) for cell in cells):
        return False
    steps = {int(b.strip(".):")) - int(a.strip(".):")) for a, b in itertools.pairwise(cells)}
    return steps in ({1}, {-1})


def is_missing(text: str) -> bool:
    """Say whether a cell says that there is no number."""
    return text.strip().strip('"').lower() in MISSING


def _is_grouped(mantissa: str, sign: str, decimal: str) -> bool:
    """Say whether a sign parts the thousands of a number."""
    whole = mantissa.partition(decimal)[0]
    return sign not in mantissa.partition(decimal)[2] and bool(
        re.fullmatch(rf"[-+]?[1-9]\d{{0,2}}(?:{re.escape(sign)}\d{{3}})+", whole)
    )


def style_of(
    name: str, columns: Sequence[Sequence[str]], beside: Collection[str] = ()
) -> NumberStyle:
    """The style of all numbers of a table.

    name: what errors call the file. columns: their cells. beside: decimal signs of the numbers in the
    text around the table, which tell where the table does not.
    A file has one decimal sign. A comma before three digits may part thousands: then another number
    has to tell.
    Raises UserError where none does.
    """
    of_decimal: dict[str, str] = {}
    unclear: dict[str, list[tuple[int, str]]] = {",": [], ".": []}
    for at, column in enumerate(columns):
        for text in column:
            for mantissa in _mantissas(text):
                _sort_signs(mantissa, at, of_decimal, unclear)
    if len(of_decimal) == 2:
        raise UserError(
            name,
            f"{of_decimal[',']!r} and {of_decimal['.']!r}",
            "one decimal sign in the file",
            _ADVICE,
        )
    if not of_decimal and len(beside) == 1:
        return NumberStyle(*beside)
    if not of_decimal:
        if unclear[","] and not unclear["."]:
            number = unclear[","][0][1]
            expected = f"{number.replace(',', '')} or {number.replace(',', '.')}, whichever it is"
            raise UserError(name, repr(number), expected, _ADVICE)
        if unclear[","]:
            got = f"{unclear[','][0][1]!r} and {unclear['.'][0][1]!r}"
            raise UserError(name, got, "one decimal sign in the file", _ADVICE)
        return NumberStyle(".")
    ((decimal, shown),) = of_decimal.items()
    thousands = "," if decimal == "." else "."
    for at, number in unclear[thousands]:
        if not any(_says_thousands(text, thousands, decimal) for text in columns[at]):
            both = sorted((number, shown), key=lambda one: "," not in one)
            got = f"{both[0]!r} and {both[1]!r}"
            raise UserError(name, got, "one decimal sign in the file", _ADVICE)
    return NumberStyle(decimal)


def _mantissas(text: str) -> Iterable[str]:
    """The numbers in a cell, without their exponents; none in a clock's time."""
    text = _bare(text)
    if _seconds(text) is not None or not looks_numeric(text):
        return
    if _fraction(text) is not None:
        return
    for part in _PLUS_MINUS.split(text):
        number = _NUMBER.match(part.partition("(")[0] if part[:1] != "(" else part[1:])
        if number is not None:
            yield number[1].lstrip("-+−")


def _sort_signs(
    mantissa: str, at: int, of_decimal: dict[str, str], unclear: dict[str, list[tuple[int, str]]]
) -> None:
    """Add a number to those that tell the decimal sign, or to those that may part thousands.

    at: its column. of_decimal: {decimal sign: the first number that shows it}. unclear: {"." or ",":
    [(column, number)] in which this sign may part thousands or be the decimal one}.
    """
    for blank in _BLANKS:
        mantissa = mantissa.replace(blank, "")
    has = {sign for sign in ".," if sign in mantissa}
    if len(has) == 2:
        of_decimal.setdefault(max(".,", key=mantissa.rfind), mantissa)
        return
    for sign in has:
        if mantissa.count(sign) > 1:
            of_decimal.setdefault("," if sign == "." else ".", mantissa)
        elif re.fullmatch(rf"[1-9]\d{{0,2}}{re.escape(sign)}\d{{3}}", mantissa):
            unclear[sign].append((at, mantissa))
        else:
            of_decimal.setdefault(sign, mantissa)


def _says_thousands(text: str, thousands: str, decimal: str) -> bool:
    """Say whether a number has both signs, or is whole: next to 922, 1.067 is a thousand."""
    if thousands in text and decimal in text:
        return True
    return re.fullmatch(r"\s*[-+]?[1-9]\d{2,}\s*", text) is not None


def with_plain_digits(text: str) -> str:
    """Text with the digits 0 to 9, and points between them, in place of those of other scripts, and
    without the marks of the direction of writing.
    """
    if text.isascii():
        return text
    table = {ord(one): unicodedata.digit(one) for one in set(text) if one.isdecimal()}
    signs = {at: str(digit) for at, digit in table.items()}
    return text.translate(signs | _SIGNS_OF_NUMBERS)
