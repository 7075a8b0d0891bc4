"""Bounces told one a line, as in chats: "[14:02] Tom: first bounce 63 cm", "Ana: second 40 cm"."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from hcbench.fitting.column_names import (
    CHANGES,
    folded,
    has_word_of,
    is_unit_of,
    meanings_of,
    ordinals,
    plain_unit,
    words_of_texts,
)
from hcbench.terms import units

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.fitting.separators import Row

# The day and the time of a message, anywhere in its line; a clock with hundredths is a reading.
_DAY = r"(?<![\w.])\d{1,4}(?P<sign>[-/.])\d{1,2}(?P=sign)\d{2,4}(?!\w)"
_CLOCK = r"(?<![\w:.])\d{1,2}:\d\d(?::\d\d)?(?![:.,]?\d)(?:\s?[ap]\.?m\b\.?)?"
_STAMP = re.compile(rf"{_DAY}|{_CLOCK}", re.IGNORECASE)
# The writer, after the signs about a stamp: "- Tom: ", "[] Ana: ", "] +49 171 234: ".
_WRITER = re.compile(r"^[^\w+]*(?P<writer>\+\d[\d ]+|[^\W\d][^:\d\n]{0,30}):\s+")
# A number, with the letters that make it an ordinal, or the unit after it.
_NUMBER = re.compile(
    r"(?<![\w.,:])(?P<number>\d+(?:[.,]\d+)?)(?![.,]?\d)"
    r"(?:(?P<ordinal>st|nd|rd|th|er|re|eme|e|o|a|º|ª)(?!\w)|\s*(?P<unit>[^\W\d_]+|[\"″]))?"
)
# What the words before a bounce's reading may mean, and no name of a writer.
_OF_BOUNCES = frozenset({"bounce", "touch", "height", "number", *CHANGES})
_LETTERS = re.compile(r"[^\W\d_]+")
_LEAST = 3
# Letters of a text that may be a chat about one ball, at most.
_LONGEST = 20_000


class _BounceTold(NamedTuple):
    """A height or a time that one line tells.

    bounce: the number of the bounce, from 1; 0 for the drop.
    number: as written, with a decimal point.
    unit: Pint's word, "" for none.
    words: those of the line before its last number.
    """

    bounce: int
    number: str
    unit: str
    words: str


class _NumbersOfLine(NamedTuple):
    """The numbers that a line has, sorted by what they may be.

    readings: (number with a decimal point, Pint's unit or "") of heights or times.
    counts: numbers of bounces, from 1; -1 for one that cannot be the number of a bounce.
    words: those before the last number.
    """

    readings: list[tuple[str, str]]
    counts: list[int]
    words: str


def rows_of_messages(text: str) -> tuple[Row, ...]:
    """A header and rows of the bounces that a text tells one a line: heights, else times, in SI.

    The height of the drop comes first where the text has it. The rows are empty where a line has a
    number of something else, and where the bounces are not counted 1, 2, 3, ...: two people who each
    measure a ball of their own count "first" twice.
    """
    if len(text) > _LONGEST:
        return ()
    for quantity in ("position", "time"):
        told = _bounces_told(text, quantity)
        if told is None:
            continue
        drop = [one for one in told if not one.bounce]
        bounces = [one for one in told if one.bounce]
        numbers = [one.bounce for one in told]
        is_counted = numbers == [*([0] * len(drop)), *range(1, len(bounces) + 1)]
        if len(bounces) < _LEAST or len(drop) > 1 or not is_counted:
            continue
        name = _column_name(quantity, bounces)
        # The drop is not a touch.
        if name and not (drop and quantity == "time"):
            si_unit = units.QUANTITIES[quantity].unit
            rows = [(1, (f"{x:.9g}",)) for x in _in_si(told, quantity)]
            return ((1, (f"{name} [{si_unit}]",)), *rows)
    return ()


def tells_of_bounce(line: str, quantity: str) -> bool:
    """Say whether a line tells a bounce or a touch with a reading of a quantity, and not the drop."""
    said = without_stamps(line)
    readings = _numbers_of(said, quantity).readings
    if not any(unit for _, unit in readings) or has_word_of(said, "let go"):
        return False
    return bool(meanings_of(said) & {"bounce", "touch"}) or has_word_of(said, "rose")


def count_readings(text: str) -> int:
    """Number of heights or times with a unit in a text."""
    count = 0
    for line in map(without_stamps, text.splitlines()):
        for quantity in ("position", "time"):
            readings = _numbers_of(line, quantity).readings
            count += sum(bool(unit) for _, unit in readings)
    return count


def without_stamps(line: str) -> str:
    """The words of a message, `folded`, without its day, its time and its writer."""
    said = folded(_STAMP.sub(" ", line)).strip()
    match = _WRITER.match(said)
    if match is None:
        return said
    writer = match["writer"]
    found = meanings_of(writer)
    # After a stamp a writer stands, whatever else the name means.
    is_name = found <= {"?"} or (_STAMP.search(line) and not found & _OF_BOUNCES)
    if not is_name or any(map(_ordinal, _LETTERS.findall(writer))):
        # "second bounce: 40 cm"
        return said
    return said[match.end() :]


def _bounces_told(text: str, quantity: str) -> list[_BounceTold] | None:
    """The bounces, and the drop, that the lines of a text tell, in their order.

    Lines without a number are left out. None where a line with a number is in doubt: it has two
    readings, no number of a bounce, a word such as "lost", or words that may name another ball.
    """
    told: list[_BounceTold] = []
    for line in map(without_stamps, text.splitlines()):
        readings, counts, words = _numbers_of(line, quantity)
        if not readings and not counts:
            continue
        tells_drop = has_word_of(line, "let go") and not has_word_of(line, "rose")
        is_drop = tells_drop and not counts
        if len(readings) != 1 or len(counts) != (0 if is_drop else 1):
            return None
        if meanings_of(line) & CHANGES or not (is_drop or _may_precede_reading(words)):
            return None
        ((number, unit),) = readings
        told.append(_BounceTold(counts[0] if counts else 0, number, unit, words))
    return told


def _numbers_of(line: str, quantity: str) -> _NumbersOfLine:
    """The numbers in a line, of which those with a unit of the quantity are readings.

    Words such as "second" count bounces where they stand before a number. Where none does, the first
    number without a unit counts: "2: 40" is the second bounce, at 40.
    """
    readings: list[tuple[str, str]] = []
    counts: list[int] = []
    words = []
    end = 0
    bare: list[str] = []
    for match in _NUMBER.finditer(line):
        words.append(line[end : match.start()])
        unit = plain_unit(match["unit"] or "")
        is_unit = bool(unit) and is_unit_of(unit, quantity)
        end = match.end() if is_unit or match["ordinal"] else match.end("number")
        number = match["number"].replace(",", ".")
        if is_unit:
            readings.append((number, unit))
        elif match["ordinal"]:
            counts.append(_count(number))
        else:
            bare.append(number)
    before = " ".join(words)
    # A line without any other number may count behind: "third, missed it".
    counting = before if readings or bare else line
    counts += filter(None, map(_ordinal, _LETTERS.findall(counting)))
    if bare and not counts:
        counts.append(_count(bare.pop(0)))
    readings += [(number, "") for number in bare]
    return _NumbersOfLine(readings, counts, before)


def _count(number: str) -> int:
    """The number of a bounce; -1, which is none, for one with decimals."""
    return int(number) if number.isdigit() else -1


def _ordinal(word: str) -> int:
    """The number that a word such as "second" or "zweiten" counts, 0 for other words."""
    return next((n for begin, n in ordinals() if word.startswith(begin)), 0)


def _may_precede_reading(words: str) -> bool:
    """Say whether each of some words may stand before a bounce's reading: no other ball is named."""
    joins = words_of_texts("joins")
    return all(
        word in joins
        or _ordinal(word)
        or has_word_of(word, "rose")
        or bool(meanings_of(word) & {"bounce", "touch", "height", "number"})
        for word in _LETTERS.findall(words)
    )


def _column_name(quantity: str, bounces: Sequence[_BounceTold]) -> str:
    """The name of the column that the readings make: "height", "touch time" or "interval".

    bounces: without the drop. "" where no line tells of a bounce, no reading has a unit, or times
    neither rise nor have a name of intervals.
    """
    words = " ".join(one.words for one in bounces)
    found = meanings_of(words)
    is_of_bounces = bool(found & {"bounce", "touch"}) or has_word_of(words, "rose")
    if not is_of_bounces or not any(one.unit for one in bounces):
        return ""
    if quantity == "position":
        return "height"
    times = list(_in_si(bounces, quantity))
    if times == sorted(times):
        return "touch time"
    return "interval" if "interval" in found else ""


def _in_si(told: Sequence[_BounceTold], quantity: str) -> Iterator[float]:
    """Yield each reading in SI; people write the unit once, so that it holds for the lines below.

    told: at least one bounce has a unit, which the readings before it have too.
    """
    unit = next(one.unit for one in told if one.unit and one.bounce)
    for one in told:
        unit = one.unit or unit
        yield units.parse(f"{one.number} {unit}", quantity, "reading")
