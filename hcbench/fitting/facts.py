"""Facts of a fall that a file tells beside its numbers: another gravity, a tilt, a throw, a moving plate."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING

from hcbench.fitting.column_names import folded, is_unit_of, words_of_texts
from hcbench.fitting.setup import MeasurementSetup
from hcbench.fitting.table import cell_of
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.fitting.columns import DataColumns
    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.sheets import Sheet

_NUMBER = r"[-+−]?(?:\d+(?:[.,]\d+)?|\.\d+)(?:e[-+]?\d+)?(?![.,]?\d)"
_TO_NEXT = r"\s*[\s,;]\s*(?:\"?[xyz]\"?\s*[:=]\s*|-\s+)?"
# "m/s^2" of "m/s²", "m s-2", "m_s2", "mps2"; "n/kg". Of the length, SI.
_LENGTHS = {"m": 1.0, "м": 1.0, "cm": 1e-2, "см": 1e-2, "mm": 1e-3, "ft": 0.3048, "in": 0.0254}
_ACCELERATION = rf"(?:({'|'.join(_LENGTHS)})[\s/_·*.p]*(?:sec|s|с)[\s^*_]*[-−]?2|n/kg)"
# Between a name and its number: signs and a unit, or words where a unit is after the number.
_SIGNS = rf"[ \t\"'`*]*(?:[ \t\[(_,]*{_ACCELERATION}[\])]*)?[ \t=:≈,;|>\"'`*~-]*?(?:(?<=:)\s*)?"
_VALUE = rf"([\[({{\"]?[ \t]*(?:\"?x\"?\s*[:=]\s*|-\s+)?)(?<!\w)({_NUMBER}(?:{_TO_NEXT}{_NUMBER}){{0,2}})"
_AFTER_SIGNS = rf"{_SIGNS}{_VALUE}(?:\s*{_ACCELERATION})?"
_OF_GRAVITY = rf"(?:{_AFTER_SIGNS}|[^\d\n]{{0,40}}?(?<!\w)()({_NUMBER})\s*{_ACCELERATION})"
# Without a unit, that of the Earth in m/s², cm/s², ft/s², in/s², and in g.
_OF_EARTH = (1.0, 1e-2, 0.3048, 0.0254, 9.80665)
# Share by which gravity may differ without a word: latitudes differ by 0.7 %.
_NEAR = 0.01
_UNITS = {
    "tilt": r"°|º|deg\w*|gra[du]\w*|度",
    "throw": r"k?m/[sh]|mph|ft/s|cm/s|mm/s|м/с|米/秒",
    "moving plate": r"k?m/[sh]|ft/s|cm/s|mm/s|hz|м/с|гц",
}
_EXPECTED = {
    "tilt": "a vertical fall",
    "throw": "a fall from rest",
    "moving plate": "a plate at rest",
    "track": "a vertical fall",
}
_ADVICE = {
    "tilt": "Give the part of gravity along the track, g sin(angle), such as --gravity '0.26 m/s^2'",
    "track": "Give the part of gravity along the track, g sin(angle), such as --gravity '0.26 m/s^2'",
    "throw": "Give pairs of speeds before and after the impact",
    "moving plate": "Give pairs of speeds relative to the plate",
}


def require_usual_fall(
    sheets: Sequence[Sheet], found: Sequence[tuple[DataColumns, Dataset]], setup: MeasurementSetup
) -> None:
    """Raise UserError where a file names a gravity, a tilt, a throw or a motion of the plate that would
    change the answer. A user who gives --gravity has looked.
    """
    is_given = setup.gravity != MeasurementSetup().gravity
    is_dropped = [bool({"height_in"} & columns.places.keys()) for columns, _ in found]
    counts = {
        "throw": any(is_dropped) or setup.height is not None,
        "moving plate": True,
        "gravity": not is_given and any([*is_dropped, *(data.needs_gravity for _, data in found)]),
    }
    counts |= dict.fromkeys(("tilt", "track"), counts["gravity"])
    texts = [one.text or "\n".join("\t".join(cells) for _, cells in one.rows) for one in sheets]
    for columns, _ in found:
        first = columns.table.cells[0]
        texts += [
            f"{name} [{unit}]: {cell_of(first, i)}"
            for i, (name, unit) in enumerate(columns.table.header)
        ]
    name = found[0][0].table.name
    for fact, said in _said("\n".join(texts), setup.gravity.value):
        if counts[fact] and fact == "gravity":
            advice = f"Give the one that counts, such as --gravity '{said}'"
            expected = f"{setup.gravity.value:.2f} m/s^2, which is used without --gravity"
            raise UserError("gravity", f"{said} in {name}", expected, advice)
        if counts[fact]:
            raise UserError(f"{name}: {fact}", repr(said), _EXPECTED[fact], _ADVICE[fact])


def _said(text: str, gravity: float) -> Iterator[tuple[str, str]]:
    """Facts in a text, with its words; a gravity (m/s^2) that differs from this one, as text."""
    text = "\n".join(
        line.casefold() if line.isascii() else folded(line) for line in text.splitlines()
    )
    for match in _pattern("gravity").finditer(text):
        said = _gravity_of(match, gravity)
        if said:
            yield "gravity", said
    for fact in _EXPECTED:
        if any(word in text for word in words_of_texts(fact)):
            yield from ((fact, match[0].strip()) for match in _pattern(fact).finditer(text))


@cache
def _pattern(fact: str) -> re.Pattern[str]:
    """The form of a fact: one of its words, and a number that is not 0 with a unit."""
    words = "|".join(sorted(map(re.escape, words_of_texts(fact)), key=len, reverse=True))
    words = rf"(?<!specific )(?<!of )(?<![^\W\d_])(?:{words})"
    if fact == "gravity":
        # Of "mass, g: 45" the unit.
        alone = r"(?<![\w/])(?<!\d )g(?=\s*[=≈])|(?:^|(?<=[{\"']))[\s#*-]*g(?=[\"'\s]*[=:\[(])"
        return re.compile(rf"(?:{words}\w*?|{alone}){_OF_GRAVITY}", re.MULTILINE)
    if fact == "track":
        return re.compile(words)
    number = rf"(?=[-+−.,0]*[1-9]){_NUMBER}"
    unit = _UNITS[fact]
    return re.compile(
        rf"{words}[^\d\n]*?(?:[\[(_]\s*(?:{unit})\s*[\])]?[\s=:,;|\"]*{number}|{number}\s*(?:{unit})(?!\w))"
        rf"|(?<![\w.,]){number}\s*(?:{unit})(?!\w)[^\d\n]*{words}"
    )


def _gravity_of(match: re.Match[str], gravity: float) -> str:
    """A gravity with its unit where it is another one than `gravity` (m/s²); "" where it is that."""
    before, opening, first, after, _, alone, last = match.groups()
    numbers = re.findall(rf"(?<![\d.,]){_NUMBER}", first or alone)
    values = [float(one.replace("−", "-").replace(",", ".")) for one in numbers]
    is_vector = len(values) > 1 and (bool(opening.strip()) or 0.0 in values)
    value = math.hypot(*values) if is_vector else abs(values[0])
    rest = match.string[match.end() :]
    unit = re.match(r"\s?([^\W\d_]+(?:/[^\W\d_]+)?)", rest)
    length = before or after or last
    has_unit = length or re.search(r"n/kg", match[0])
    if not has_unit and unit and any(is_unit_of(unit[1], of) for of in ("position", "time")):
        # "center of gravity 12 mm"
        return ""
    digits = numbers[-1 if is_vector else 0].partition("e")[0].replace(",", ".").partition(".")[2]
    rounding = 0.5 * 10.0 ** -len(digits)
    scales = (_LENGTHS.get(length, 1.0),) if has_unit else _OF_EARTH
    if unit and unit[1] == "g":
        scales = (_OF_EARTH[-1],)
    if any(abs(value * s - gravity) <= max(_NEAR * gravity, rounding * s) for s in scales):
        return ""
    return f"{value * scales[0]:.5g} m/s^2"
