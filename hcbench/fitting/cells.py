"""Cells of a table: numbers as programs and people write them, in one style for a file."""

from __future__ import annotations

import itertools
import math
import re
import unicodedata
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, NamedTuple

from hcbench.fitting.column_names import (
    QUANTITIES_OF_COLUMNS,
    is_unit,
    is_unit_of,
    plain_unit,
)
from hcbench.system.errors import UserError
from hcbench.terms import units

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

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
# "0.960(5) m", "1.23(4)e-3"; "(1.23 ± 0.04)e-3 m", with the pair and what holds for both.
_SHORT = re.compile(rf"({_MANTISSA})\((\d+(?:[.,]\d+)?)\)({_EXPONENT})?(?:\s+(\S.*))?")
_PAIR = re.compile(rf"\(([^()]+)\)({_EXPONENT})?\s*([^()]*)")
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

        None for other text, and for a number that is not of this style.
        """
        text = _bare(text)
        seconds = _seconds(text)
        if seconds is not None:
            return NumberCell(seconds, unit="s")
        # Forms of more than one number go before the one number that they begin with.
        special = self._of_mixed_units(text) or _fraction(text) or self._with_digits_in_doubt(text)
        if special is not None:
            return special
        pair = _PAIR.fullmatch(text)
        exponent = ""
        unit_of_both = ""
        if pair is not None:
            text, exponent, unit_of_both = (part or "" for part in pair.groups())
        parts = [part + exponent for part in _PLUS_MINUS.split(text.strip("()"))]
        numbers = [self._number_with_unit(f"{part} {unit_of_both}") for part in parts]
        if len(numbers) == 1:
            return numbers[0]
        if len(numbers) > 2:
            return None
        number, by = numbers
        if number is None or by is None:
            return None
        return _with_uncertainty(number, by)

    def _number_with_unit(self, text: str) -> NumberCell | None:
        """The number in a text of a number and its unit; None for other text, for another word
        than a unit, and for a number that is not of this style.
        """
        number = _NUMBER.match(text)
        if number is None:
            return None
        tail = _TAIL.fullmatch(text[number.end() :])
        if tail is None:
            return None
        value = self._float(number[1], number[2] or "")
        return _cell_of(value, math.nan, tail[1] or "")

    def _with_digits_in_doubt(self, text: str) -> NumberCell | None:
        """The number in "0.960(5) m", whose last digits are uncertain by 5; None for other text."""
        short = _SHORT.fullmatch(text)
        if short is None:
            return None
        number, by, exponent, unit = (part or "" for part in short.groups())
        value = self._float(number, exponent)
        uncertainty = self._float(by, exponent)
        # "0.960(5)" counts in the last digit, "9.60(0.05)" in the unit.
        if by.isdigit():
            uncertainty /= 10.0 ** len(number.partition(self.decimal)[2])
        if math.isnan(uncertainty):
            return None
        return _cell_of(value, uncertainty, unit)

    def _of_mixed_units(self, text: str) -> NumberCell | None:
        """The sum of "6' 3.5\"" or "1 m 20 cm", in the unit of its first part.

        None for other text, one number with a unit among it: each part has a smaller unit of the same
        quantity than the part before.
        """
        if not text:
            return None
        total = 0.0
        first_unit = ""
        last_scale = math.inf
        at = 0
        while at < len(text):
            part = _PART.match(text, at)
            is_alone = part is not None and at == 0 and part.end() == len(text)
            if part is None or is_alone:
                return None
            unit = plain_unit(part[2])
            quantity = next((of for of in ("time", "position") if is_unit_of(unit, of)), "")
            if not quantity or (first_unit and not is_unit_of(first_unit, quantity)):
                return None
            scale = units.parse(f"1 {unit}", quantity, "unit")
            if scale >= last_scale:
                return None
            number = _fraction(part[1]) or NumberCell(self._float(part[1], ""))
            total += number.value * scale
            first_unit = first_unit or unit
            last_scale = scale
            at = part.end()
        total /= units.parse(f"1 {first_unit}", quantity, "unit")
        return _cell_of(total, math.nan, first_unit)

    def _float(self, mantissa: str, exponent: str) -> float:
        """The value of a number as `_NUMBER` parts it, in the unit of its cell.

        mantissa: with signs between thousands, if any.
        exponent: "e-3", "D-3", "x 10^-3" or "". NaN where its signs are not of this style.
        """
        for blank in _BLANKS:
            mantissa = mantissa.replace(blank, "")
        mantissa = mantissa.replace("−", "-")
        thousands = "," if self.decimal == "." else "."
        if thousands in mantissa:
            if not _is_grouped(mantissa, thousands, self.decimal):
                return math.nan
            mantissa = mantissa.replace(thousands, "")
        exponent = exponent.translate(_EXPONENT_SIGNS)
        if exponent and exponent[0] not in "eE":
            exponent = "e" + re.split(r"10", exponent, maxsplit=1)[1].strip(" ^*{}")
        try:
            return float(mantissa.replace(self.decimal, ".") + exponent)
        except ValueError:
            return math.nan


def _cell_of(value: float, uncertainty: float, unit: str) -> NumberCell | None:
    """A cell of these parts; None where the value is NaN, or a word is not a unit."""
    unit = unit.strip()
    # A number beyond all bounds is one, for its reader to refuse: as text it would end the table.
    if math.isnan(value) or (unit and not is_unit(unit)):
        return None
    return NumberCell(value, uncertainty, unit)


def _with_uncertainty(number: NumberCell, by: NumberCell) -> NumberCell | None:
    """A number with the one behind its "±" as uncertainty, in the number's unit: "81 cm ± 2 mm".

    A unit behind the second alone is that of both. "81 cm ± 2 %" is uncertain by a share of itself.
    None where that is in doubt, as in "0.81 ± 2 %", where units do not fit, and for one below 0.
    """
    if by.value < 0.0:
        return None
    if not number.unit:
        # The 0.81 is rather no percentage.
        if by.unit == "%" and abs(number.value) <= 1.0:
            return None
        return NumberCell(number.value, by.value, by.unit)
    unit = plain_unit(number.unit)
    unit_of_by = plain_unit(by.unit)
    if unit_of_by in ("", unit):
        return NumberCell(number.value, by.value, number.unit)
    if unit_of_by == "%":
        uncertainty = float(f"{abs(number.value) * by.value / 100.0:.12g}")
        return NumberCell(number.value, uncertainty, number.unit)
    converted = in_unit(by, unit)
    if converted is by:
        return None
    return NumberCell(number.value, converted.value, number.unit)


def in_unit(cell: NumberCell, unit: str) -> NumberCell:
    """A cell in a unit, where it has another one of the same quantity; else as it is."""
    own = plain_unit(cell.unit) if cell.unit else ""
    alike = (of for of in QUANTITIES_OF_COLUMNS if is_unit_of(own, of) and is_unit_of(unit, of))
    quantity = next(alike, "") if own and own != unit else ""
    if not quantity:
        return cell
    ratio = units.parse(f"1 {own}", quantity, own) / units.parse(f"1 {unit}", quantity, unit)
    # 1301 mm are 130.1 cm, to the last digit.
    value, uncertainty = (float(f"{one * ratio:.12g}") for one in (cell.value, cell.uncertainty))
    return NumberCell(value, uncertainty, unit)


def _bare(text: str) -> str:
    """A cell without TeX's marks about a number and in it, or the type that NumPy prints about it."""
    text = _OF_NUMPY.sub(r"\1", text).strip().strip("$").strip().replace("{,}", ",")
    # "1." and "1)" are the first.
    text = re.sub(r"^(\d+)[.):]$", r"\1", text)
    return text.replace("\\%", "%").replace("\\,", " ")


def _fraction(text: str) -> NumberCell | None:
    """The number in "47 1/4", "3/8 in" or "47¼", in its unit, "" for none; None for other text."""
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
    """Seconds of a clock's time, or of a date with a time since 1970; None for other text."""
    clock = _CLOCK.fullmatch(text)
    if clock is not None:
        hours, minutes, seconds, sign, part = clock.groups()
        if sign == ":" and hours is None:
            return None
        # After a colon stand hundredths or thousandths.
        fraction = float(f"0.{part}") if part else 0.0
        return 3600.0 * float(hours or 0) + 60.0 * float(minutes) + float(seconds) + fraction
    # "2024-05-03T10:14:07.2"
    if len(text) <= 10 or text[4:5] not in "-/" or not text[:4].isdigit():
        return None
    forms = (text, text.removesuffix(" UTC"), text.replace("/", "-"), text.replace(",", "."))
    for form in forms:
        try:
            stamp = datetime.fromisoformat(form)
        except ValueError:
            continue
        midnight = stamp.replace(hour=0, minute=0, second=0, microsecond=0)
        return (stamp - midnight).total_seconds() + 86400.0 * (stamp.toordinal() - _EPOCH)
    return None


def has_last_unit_only(text: str) -> bool:
    """Say whether a unit stands behind an uncertainty and none behind its number: "81 ± 2 mm"."""
    parts = _PLUS_MINUS.split(_bare(text))
    if len(parts) != 2:
        return False
    return parts[0][-1:].isdigit() and re.search(r"[^\W\d_%]+$", parts[1]) is not None


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

    name: what errors call the file.
    columns: their cells.
    beside: decimal signs of the numbers in the text around the table, which tell where the table
    does not.
    A file has one decimal sign. A comma before three digits may part thousands: then another number
    has to tell.
    Raises UserError for numbers with two decimal signs, and where no number tells which it is.
    """
    shown: dict[str, str] = {}
    unclear: dict[str, list[_NumberAt]] = {",": [], ".": []}
    for place, column in enumerate(columns):
        for mantissa in itertools.chain.from_iterable(map(_mantissas, column)):
            _sort_signs(mantissa, place, shown, unclear)
    if len(shown) == 2:
        raise _two_decimal_signs(name, shown[","], shown["."])
    if not shown and len(beside) == 1:
        return NumberStyle(*beside)
    if not shown:
        if unclear[","]:
            raise _unclear_style(name, unclear)
        return NumberStyle(".")
    ((decimal, example),) = shown.items()
    thousands = "," if decimal == "." else "."
    for number in unclear[thousands]:
        if not any(_says_thousands(text, thousands, decimal) for text in columns[number.column]):
            with_comma, other = sorted(
                (number.text, example), key=lambda mantissa: "," not in mantissa
            )
            raise _two_decimal_signs(name, with_comma, other)
    return NumberStyle(decimal)


class _NumberAt(NamedTuple):
    """A number as written, without its exponent, and the place of its column, from 0."""

    column: int
    text: str


def _two_decimal_signs(name: str, with_comma: str, other: str) -> UserError:
    """The error for two numbers of a file that cannot have one decimal sign."""
    got = f"{with_comma!r} and {other!r}"
    return UserError(name, got, "one decimal sign in the file", _ADVICE)


def _unclear_style(name: str, unclear: Mapping[str, Sequence[_NumberAt]]) -> UserError:
    """The error for a file in which a comma may part thousands or be the decimal sign.

    unclear: as of `_sort_signs`, with one number or more under ",".
    """
    number = unclear[","][0].text
    if unclear["."]:
        return _two_decimal_signs(name, number, unclear["."][0].text)
    expected = f"{number.replace(',', '')} or {number.replace(',', '.')}, whichever it is"
    return UserError(name, repr(number), expected, _ADVICE)


def _mantissas(text: str) -> Iterator[str]:
    """Yield the numbers in a cell without signs and exponents; none of a clock's time or "3/8"."""
    text = _bare(text)
    if _seconds(text) is not None or not looks_numeric(text):
        return
    if _fraction(text) is not None:
        return
    for part in _PLUS_MINUS.split(text):
        # "0.960(5)" has its number before the bracket, "(0.20 ± 0.01)" behind it.
        in_bracket = part[:1] == "("
        number = _NUMBER.match(part[1:] if in_bracket else part.partition("(")[0])
        if number is not None:
            yield number[1].lstrip("-+−")


def _sort_signs(
    mantissa: str, column: int, shown: dict[str, str], unclear: dict[str, list[_NumberAt]]
) -> None:
    """Add a number to those that show the decimal sign of a file, or to those that leave it open.

    column: its place.
    shown: {decimal sign: the first number that shows it}.
    unclear: {"." or ",": the numbers in which this sign may part thousands or be the decimal one}.
    Both are changed.
    """
    for blank in _BLANKS:
        mantissa = mantissa.replace(blank, "")
    signs = {sign for sign in ".," if sign in mantissa}
    if len(signs) == 2:
        # "1.234,5": the last one is the decimal one.
        shown.setdefault(max(".,", key=mantissa.rfind), mantissa)
        return
    for sign in signs:
        if mantissa.count(sign) > 1:
            shown.setdefault("," if sign == "." else ".", mantissa)
        elif re.fullmatch(rf"[1-9]\d{{0,2}}{re.escape(sign)}\d{{3}}", mantissa):
            unclear[sign].append(_NumberAt(column, mantissa))
        else:
            shown.setdefault(sign, mantissa)


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
