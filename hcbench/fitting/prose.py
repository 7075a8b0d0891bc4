"""Sentences that tell heights or times: "dropped from 1 m, it came back to 81 cm, then 66"."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hcbench.fitting.column_names import (
    folded,
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

    number: as written. unit: Pint's word, "" for none. begin, end: its place in the text.
    """

    number: str
    unit: str
    begin: int
    end: int

    def in_si(self, unit: str, quantity: str) -> float:
        """The reading in SI, in its own unit or else in this one."""
        number = self.number.replace(",", ".")
        return units.parse(f"{number} {self.unit or unit}", quantity, "reading")


def rows_of_prose(text: str) -> tuple[Row, ...]:
    """A header and rows of the heights, or times, that sentences tell one after the other; empty where
    it is in doubt whether they are those of one ball.

    The height of a drop is the first of its heights. A column "drop" parts several drops.
    """
    if len(text) > _LONGEST:
        return ()
    text = folded(text)
    for quantity, told in (("position", _heights), ("time", _times)):
        chains = [one for one in _chains(text, quantity) if len(one) >= _LEAST_IN_A_LINE]
        # Beside another list nobody knows which one is the ball's.
        if len(chains) != 1 or not _shares_a_line(text, chains[0]):
            continue
        name, drops = told(text, chains[0])
        if not drops or min(map(len, drops)) < _LEAST:
            continue
        si_unit = units.QUANTITIES[quantity].unit
        rows = [(f"{k}", f"{x:.9g}") for k, one in enumerate(drops, 1) for x in one]
        return ((1, ("drop", f"{name} [{si_unit}]")), *((1, row) for row in rows))
    return ()


def _shares_a_line(text: str, chain: Sequence[_Reading]) -> bool:
    """Say whether a line has two of the readings, as lines of a table have not."""
    lines = [text.count("\n", 0, one.begin) for one in chain]
    return any(lines.count(line) >= _LEAST_IN_A_LINE for line in lines)


def _chains(text: str, quantity: str) -> Iterator[list[_Reading]]:
    """Readings of a quantity with no other words between them than those that join readings.

    A number without a unit is a reading only beside one that has it.
    """
    chain: list[_Reading] = []
    for one in _readings(text, quantity):
        if chain and not _joins(text[chain[-1].end : one.begin]):
            yield from [chain] if any(each.unit for each in chain) else []
            chain = []
        chain.append(one)
    yield from [chain] if any(each.unit for each in chain) else []


def _readings(text: str, quantity: str) -> Iterator[_Reading]:
    """Numbers in a text with a unit of a quantity, or with none."""
    for match in _READING.finditer(text):
        unit = plain_unit(match["unit"] or "")
        # The word of "0.5 then" is not a unit.
        is_one = bool(unit) and any(is_unit_of(unit, of) for of in ("position", "time", "speed"))
        if is_one and not is_unit_of(unit, quantity):
            continue
        end = match.end() if is_one else match.end("number")
        yield _Reading(match["number"], unit if is_one else "", match.start(), end)


def _begins(text: str, meaning: str) -> bool:
    """Say whether a word of a text begins as one of a meaning."""
    return any(
        re.search(rf"(?<![^\W\d_]){re.escape(word)}", text) for word in words_of_texts(meaning)
    )


def _joins(between: str) -> bool:
    """Say whether all words of a text may stand between two readings of one ball."""
    if re.search(r"\d", between):
        return False
    return all(
        word in words_of_texts("joins")
        or _begins(word, "rose")
        or _begins(word, "let go")
        or bool(meanings_of(word) & {"bounce", "touch"})
        for word in re.findall(r"[^\W\d_]+", between)
    )


def _heights(text: str, chain: Sequence[_Reading]) -> tuple[str, list[list[float]]]:
    """Return "height", and the heights of each drop, m: none where one rises that is not that of a drop."""
    before = text[: chain[0].begin]
    if not _begins(text[: chain[-1].end], "rose"):
        return "", []
    drops: list[list[float]] = []
    for at, (one, x) in enumerate(zip(chain, _in_si(chain, "position"), strict=True)):
        words = text[chain[at - 1].end : one.begin] if at else before
        is_drop = _begins(words, "let go") and not _begins(words, "rose")
        if is_drop or not drops:
            drops.append([])
        elif x >= drops[-1][-1]:
            return "", []
        drops[-1].append(x)
    return "height", drops


def _times(text: str, chain: Sequence[_Reading]) -> tuple[str, list[list[float]]]:
    """The name of the times, and the times of one drop, s: those of touches rise, those between them
    fall.
    """
    times = _in_si(chain, "time")
    steps = [b - a for a, b in itertools.pairwise(times)]
    found = meanings_of(text[: chain[0].begin])
    if all(step > 0 for step in steps) and found & {"touch", "bounce"}:
        return "touch time", [times]
    if all(step < 0 for step in steps) and found & {"interval", "bounce"}:
        return "interval", [times]
    return "", []


def _in_si(chain: Sequence[_Reading], quantity: str) -> list[float]:
    """Readings in SI; one without a unit has that of the next one that has it, or of the last."""
    found: list[float] = []
    unit = next(one.unit for one in reversed(chain) if one.unit)
    for one in reversed(chain):
        unit = one.unit or unit
        found.append(one.in_si(unit, quantity))
    return found[::-1]
