"""Sentences that tell heights or times: "dropped from 1 m, it came back to 81 cm, then 66"."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from hcbench.fitting.column_names import (
    folded,
    has_word_of,
    is_unit_of,
    meanings_of,
    plain_unit,
    words_of_texts,
)
from hcbench.terms import units

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.fitting.separators import Row

# A number with the word behind it; not an ordinal, nor part of a name or of a time of the clock.
_READING = re.compile(
    r"(?<![\w.,:/-])(?P<number>\d+(?:[.,]\d+)?)(?![\d:/]|[.,]\d|(?:st|nd|rd|th)\b)"
    r"(?:\s*(?P<unit>[^\W\d_]+|[\"″]))?"
)
# Letters of a text that may be prose, at most.
_LONGEST = 4000
# Readings of a drop, at least; and of those, in one line.
_LEAST = 3
_LEAST_IN_A_LINE = 2


@dataclass(frozen=True, slots=True)
class _Reading:
    """A number in a text that may be a reading.

    number: as written.
    unit: Pint's word, "" for none.
    begin, end: its place in the text.
    """

    number: str
    unit: str
    begin: int
    end: int

    def in_si(self, unit: str, quantity: str) -> float:
        """The reading in SI, in its own unit or else in this one."""
        number = self.number.replace(",", ".")
        return units.parse(f"{number} {self.unit or unit}", quantity, "reading")


class _Told(NamedTuple):
    """Meaning of a chain of readings.

    name: of the column that they make, such as "height"; "" where they are in doubt.
    drops: the readings of each drop, SI; none where they are in doubt.
    """

    name: str
    drops: list[list[float]]


_IN_DOUBT = _Told("", [])


def rows_of_prose(text: str) -> tuple[Row, ...]:
    """A header and rows of the heights, else times, that sentences tell one after the other, in SI.

    Each row has the number of its drop and a reading; the height of the drop is the first of its
    heights. The rows are empty where it is in doubt whether the readings are those of one ball.
    """
    if len(text) > _LONGEST:
        return ()
    text = folded(text)
    for quantity, told_by in (("position", _heights_told), ("time", _times_told)):
        chains = [one for one in _chains(text, quantity) if len(one) >= _LEAST_IN_A_LINE]
        # Beside another list nobody knows which one is the ball's.
        if len(chains) != 1 or not _shares_a_line(text, chains[0]):
            continue
        name, drops = told_by(text, chains[0])
        if not drops or min(map(len, drops)) < _LEAST:
            continue
        rows: list[Row] = [(1, ("drop", f"{name} [{units.QUANTITIES[quantity].unit}]"))]
        for number, readings in enumerate(drops, 1):
            rows += [(1, (f"{number}", f"{x:.9g}")) for x in readings]
        return tuple(rows)
    return ()


def _shares_a_line(text: str, chain: Sequence[_Reading]) -> bool:
    """Say whether a line has two of the readings, as lines of a table have not."""
    lines = [text.count("\n", 0, one.begin) for one in chain]
    return any(lines.count(line) >= _LEAST_IN_A_LINE for line in lines)


def _chains(text: str, quantity: str) -> Iterator[list[_Reading]]:
    """Yield readings of a quantity with no words between them but those that join readings.

    A number without a unit is a reading only beside one that has it.
    """
    chain: list[_Reading] = []
    for one in _readings(text, quantity):
        if chain and not _joins_readings(text[chain[-1].end : one.begin]):
            if any(each.unit for each in chain):
                yield chain
            chain = []
        chain.append(one)
    if any(each.unit for each in chain):
        yield chain


def _readings(text: str, quantity: str) -> Iterator[_Reading]:
    """Yield the numbers in a text with a unit of a quantity, or with none."""
    for match in _READING.finditer(text):
        unit = plain_unit(match["unit"] or "")
        # The word of "0.5 then" is not a unit.
        is_one = bool(unit) and any(is_unit_of(unit, of) for of in ("position", "time", "speed"))
        if is_one and not is_unit_of(unit, quantity):
            continue
        end = match.end() if is_one else match.end("number")
        yield _Reading(match["number"], unit if is_one else "", match.start(), end)


def _joins_readings(between: str) -> bool:
    """Say whether all words of a text may stand between two readings of one ball; no number may, nor
    "±", behind which stands no reading.
    """
    if re.search(r"\d|±|\+\s*/?\s*[-−]|\\pm", between):
        return False
    return all(
        word in words_of_texts("joins")
        or has_word_of(word, "rose")
        or has_word_of(word, "let go")
        or bool(meanings_of(word) & {"bounce", "touch"})
        for word in re.findall(r"[^\W\d_]+", between)
    )


def _heights_told(text: str, chain: Sequence[_Reading]) -> _Told:
    """The heights of each drop, m: a new one begins where the words tell that the ball is let go.

    In doubt where nothing tells that the ball rose, and where a bounce is not below the one before.
    """
    before = text[: chain[0].begin]
    if not has_word_of(text[: chain[-1].end], "rose"):
        return _IN_DOUBT
    drops: list[list[float]] = []
    for at, (one, height) in enumerate(zip(chain, _in_si(chain, "position"), strict=True)):
        words = text[chain[at - 1].end : one.begin] if at else before
        is_drop = has_word_of(words, "let go") and not has_word_of(words, "rose")
        if is_drop or not drops:
            drops.append([])
        elif height >= drops[-1][-1]:
            return _IN_DOUBT
        drops[-1].append(height)
    return _Told("height", drops)


def _times_told(text: str, chain: Sequence[_Reading]) -> _Told:
    """The times of one drop, s: those of touches rise, those between touches fall.

    In doubt where they do neither, and where the words before them name something else.
    """
    times = _in_si(chain, "time")
    steps = [b - a for a, b in itertools.pairwise(times)]
    named = meanings_of(text[: chain[0].begin])
    if all(step > 0 for step in steps) and named & {"touch", "bounce"}:
        return _Told("touch time", [times])
    if all(step < 0 for step in steps) and named & {"interval", "bounce"}:
        return _Told("interval", [times])
    return _IN_DOUBT


def _in_si(chain: Sequence[_Reading], quantity: str) -> list[float]:
    """Readings in SI; in a sentence a unit holds for the numbers before it: "81, 66 and 53 cm".

    The numbers after the last unit have it too.
    """
    found: list[float] = []
    unit = next(one.unit for one in reversed(chain) if one.unit)
    for one in reversed(chain):
        unit = one.unit or unit
        found.append(one.in_si(unit, quantity))
    return found[::-1]
