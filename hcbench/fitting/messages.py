"""Bounces told one a line, as in chats: "[14:02] Tom: first bounce 63 cm", "Ana: second 40 cm"."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from hcbench.fitting.column_names import (
    CHANGES,
    folded,
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


class _Told(NamedTuple):
    """A height or a time in one line.

    bounce: its number, 0 for that of the drop. number: as written, with a point.
    unit: Pint's word, "" for none. words: those of the line.
    """

    bounce: int
    number: str
    unit: str
    words: str


def rows_of_messages(text: str) -> tuple[Row, ...]:
    """A header and rows of the bounces that a text tells one a line, counted from 1: heights, that of
    the drop first where there is one, or times. Empty where a line has a number that is none of
    them, or the bounces are not counted on.

    Two people who each measure a ball of their own count "first" twice.
    """
    if len(text) > _LONGEST:
        return ()
    for quantity in ("position", "time"):
        told = _told(text, quantity)
        if told is None:
            continue
        drop = [one for one in told if not one.bounce]
        bounces = [one for one in told if one.bounce]
        counts = [one.bounce for one in told]
        is_counted = counts == [*([0] * len(drop)), *range(1, len(bounces) + 1)]
        if len(bounces) < _LEAST or len(drop) > 1 or not is_counted:
            continue
        name = _name(quantity, bounces)
        if name and not (drop and quantity == "time"):
            si_unit = units.QUANTITIES[quantity].unit
            rows = [(1, (f"{x:.9g}",)) for x in _in_si(told, quantity)]
            return ((1, (f"{name} [{si_unit}]",)), *rows)
    return ()


def tells_of_bounce(line: str, quantity: str) -> bool:
    """Say whether a line tells a bounce or a touch with a reading of a quantity, and not the drop."""
    said = without_stamps(line)
    readings, _, _ = _numbers_of(said, quantity)
    if not any(unit for _, unit in readings) or _begins(said, "let go"):
        return False
    return bool(meanings_of(said) & {"bounce", "touch"}) or _begins(said, "rose")


def count_readings(text: str) -> int:
    """Number of heights or times with a unit in a text."""
    lines = [without_stamps(line) for line in text.splitlines()]
    each = (_numbers_of(line, of)[0] for line in lines for of in ("position", "time"))
    return sum(bool(unit) for readings in each for _, unit in readings)


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
    is_name = is_name and not any(map(_ordinal, _LETTERS.findall(writer)))
    return said[match.end() :] if is_name else said


def _told(text: str, quantity: str) -> list[_Told] | None:
    """Bounces, and the drop, in the lines with a number of a quantity; None where one of them is in doubt."""
    told: list[_Told] = []
    for line in map(without_stamps, text.splitlines()):
        readings, counts, words = _numbers_of(line, quantity)
        if not readings and not counts:
            continue
        is_drop = not counts and _begins(line, "let go") and not _begins(line, "rose")
        if len(readings) != 1 or len(counts) != (0 if is_drop else 1):
            return None
        if meanings_of(line) & CHANGES or not (is_drop or _all_known(words)):
            return None
        told.append(_Told(counts[0] if counts else 0, *readings[0], words))
    return told


def _numbers_of(line: str, quantity: str) -> tuple[list[tuple[str, str]], list[int], str]:
    """The readings in a line, each a number and its unit or "", the numbers of bounces, and the words
    before the last number.

    Of two numbers the first counts; words such as "second" count where no number is before them.
    """
    readings: list[tuple[str, str]] = []
    counts: list[int] = []
    words = []
    end = 0
    plain: list[str] = []
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
            plain.append(number)
    before = " ".join(words)
    found = map(_ordinal, _LETTERS.findall(before if readings or plain else line))
    counts += [one for one in found if one]
    if plain and not counts:
        counts.append(_count(plain.pop(0)))
    readings += [(number, "") for number in plain]
    return readings, counts, before


def _count(number: str) -> int:
    """The number of a bounce; -1, which is none, for one with decimals."""
    return int(number) if number.isdigit() else -1


def _ordinal(word: str) -> int:
    """The number that a word such as "second" or "zweiten" counts, 0 for other words."""
    return next((n for begin, n in ordinals() if word.startswith(begin)), 0)


def _begins(text: str, meaning: str) -> bool:
    """Say whether a word of a text begins as one of a meaning."""
    return any(word.startswith(words_of_texts(meaning)) for word in _LETTERS.findall(text))


def _all_known(words: str) -> bool:
    """Say whether words before a reading may stand before that of a bounce: no other ball is named."""
    joins = words_of_texts("joins")
    return all(
        word in joins
        or _ordinal(word)
        or _begins(word, "rose")
        or bool(meanings_of(word) & {"bounce", "touch", "height", "number"})
        for word in _LETTERS.findall(words)
    )


def _name(quantity: str, bounces: Sequence[_Told]) -> str:
    """The name of the column; "" where no line tells of a bounce, or no reading has a unit."""
    words = " ".join(one.words for one in bounces)
    found = meanings_of(words)
    is_of_bounces = bool(found & {"bounce", "touch"}) or _begins(words, "rose")
    if not is_of_bounces or not any(one.unit for one in bounces):
        return ""
    if quantity == "position":
        return "height"
    numbers = list(_in_si(bounces, quantity))
    if numbers == sorted(numbers):
        return "touch time"
    return "interval" if "interval" in found else ""


def _in_si(told: Sequence[_Told], quantity: str) -> Iterator[float]:
    """Readings in SI; one without a unit has that of the bounce before it, or of the first that has
    one.
    """
    unit = next(one.unit for one in told if one.unit and one.bounce)
    for one in told:
        unit = one.unit or unit
        yield units.parse(f"{one.number} {unit}", quantity, "reading")
