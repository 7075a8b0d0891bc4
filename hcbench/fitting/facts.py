"""Facts of a fall that a file tells beside its numbers: another gravity, a tilt, a moving plate, a push,
stairs, another ball each time.
"""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING

from hcbench.fitting.column_names import folded, is_unit, words_of_texts
from hcbench.fitting.setup import MeasurementSetup
from hcbench.fitting.table import cell_of
from hcbench.system.errors import UserError
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.fitting.columns import DataColumns
    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.sheets import Sheet

_NUMBER = r"[-+−]?(?:\d+(?:[.,]\d+)?|\.\d+)(?:e[-+]?\d+)?(?![.,]?\d)"
_NEXT = rf"\s*[\s,;]\s*(?:\"?[xyz]\"?\s*[:=]\s*|-\s+)?{_NUMBER}"
# Where a word begins: Chinese and Japanese part no words by blanks.
_BEGIN = r"(?:(?<![^\W\d_])|(?<=[\u3040-\u9fff]))"
# "m/s^2", "m/s²", "m s-2", "m_s2", "mps2", "N/kg", in lower case.
_LENGTHS = {"m": 1.0, "м": 1.0, "n": 1.0, "cm": 1e-2, "см": 1e-2, "mm": 1e-3, "ft": 0.3048}
_UNIT = rf"({'|'.join(_LENGTHS)})[\s/_·*.p]*(?:(?:sec|s|с)[\s^*_]*[-−]?2|kg)"
# A gravity after signs, with an opening bracket where it is a vector; or after words, with a unit.
_SIGNS = rf"[ \t\"'`*]*(?:[ \t\[(_,]*{_UNIT}[\])]*)?[ \t=:≈,;|>\"'`*~-]*?(?:(?<=:)\s*)?"
_VECTOR = rf"([\[({{\"]?[ \t]*(?:\"?x\"?\s*[:=]\s*|-\s+)?)(?<!\w)({_NUMBER}(?:{_NEXT}){{0,2}})"
_GRAVITY = rf"(?:{_SIGNS}{_VECTOR}(?:\s*{_UNIT})?|[^\d\n]{{0,40}}?(?<!\w)({_NUMBER})\s*{_UNIT})"
# "g = 1.62", or first in its line; of "mass, g: 45" it is the unit.
_LETTER = r"(?<![\w/])(?<!\d )g(?=\s*[=≈])|(?:^|(?<=[{\"']))[\s#*-]*g(?=[\"'\s]*[=:\[(])"
# Without a unit, that of the Earth in m/s², cm/s², ft/s², and in g.
_OF_EARTH = (1.0, 1e-2, 0.3048, STANDARD_GRAVITY)
# Share by which gravity may differ without a word: latitudes differ by 0.7 %.
_NEAR = 0.01
_ALONG = "Give the part of gravity along the track, g sin(angle), such as --gravity '0.26 m/s^2'"
_PAIRS = "Give pairs of speeds before and after the impact, relative to the plate"
_TO_PLATE = f"{_PAIRS}, and write 'speeds relative to the plate'"
_RELATIVE = re.compile(r"speeds?\b[^.\n]*\brelative to the (?:plate|platform|table)")
_FREE = "Record a ball that nothing drives, or give pairs of speeds before and after the impact"
_ONE_FLOOR = "Write the bounces on one floor alone, without this sentence"
_EACH_ALONE = (
    "Give the height of the drop and of the rebound in each row, or leave the sentence out"
)
# Other facts: the units of their numbers, what was expected, and advice.
_FACTS = {
    "tilt": (r"°|º|deg\w*|gra[du]\w*|度", "a vertical fall", _ALONG),
    "track": ("", "a vertical fall", _ALONG),
    "upper edge": (
        "",
        "heights of the bottom of the ball",
        "Subtract the ball's diameter from each",
    ),
    "left out": ("", "each bounce", "Number the bounces in a column of their own"),
    "throw": (r"k?m/[sh]|mph|ft/s|[cm]m/s|м/с", "a fall from rest", _PAIRS),
    "moving plate": (r"k?m/[sh]|ft/s|[cm]m/s|hz|м/с|гц", "a plate at rest", _TO_PLATE),
    "driven ball": ("", "free bounces", _FREE),
    "stairs": ("", "bounces on one level floor", _ONE_FLOOR),
    "other motion": (
        "",
        "a ball that bounces",
        "Leave the sentence out if the numbers are a ball's",
    ),
    "rolled off": ("", "bounces on one level floor", f"{_ONE_FLOOR}, up to the last one there"),
    "begun anew": ("", "successive bounces of one drop", _EACH_ALONE),
}
# Of this a word for "each" must stand in the same sentence: a ball is caught in the end, too.
_EACH_TIME = "begun anew"
# Facts of which a refusal shows the whole line.
_SENTENCES = ("stairs", "other motion", "rolled off", _EACH_TIME)
# Facts that words about them may deny: "not dribbled".
_DENIED = ("driven ball", "moving plate", "upper edge", *_SENTENCES)
# Words between a support and its motion, and between its motion and it: "is slowly moving",
# "vibrating steel plate".
_IS = r"(?:is|was|were|are|being|been|has|itself|wird|wurde|ist|war|est|etait|era|es|e|\w+ly)"
_OF_KIND = (
    r"(?!(?:an?|the|on|to|of|in|at|by|over|with|from|off|into|and|along|ball|average|mean)\b)\w+"
)
# Words that deny a motion, or tell of one between drops: "no shaker", "the table was moved away".
_NOT_BEFORE = re.compile(
    r"(?:\b(?:no|not|non|never|without|instead of|unless|before|ohne|kein\w*|nicht|sans|sin|senza)"
    r"|n't)\b[^.,;:\n]{0,16}$"
)
_NOT_AFTER = re.compile(
    r"[ \t\"':=]*(?:(?:is|was|were)[ \t]+)?"
    r"(?:(?:false|no|none|0|off|aus|not|nicht|removed|unplugged|to|away|aside|average)\b"
    r"|slightly|a little|negligibly|when|after|(?:at|on) (?:each |every |the )?impact"
    # A table of a data base.
    r"|(?<=table moves )\()"
)
# "rolled off at the end"
_AT_THE_END = re.compile(
    r"[^.,;\n]{0,24}?\b(?:(?:at|in) the end|after the last|am ende|zum schluss|a la fin|al final|alla fine)\b"
)
# "11 cm, then it rolled off": after the reading before it.
_THEN = re.compile(
    r"\d[ \t]*[^\W\d_]{0,12}[ \t,;.-]+(?:\w+ )?(?:then|dann|puis|luego|poi|depois)\b[^\d\n]*$"
)
# A line about a column that is read, as `require_usual_fall` adds them to the text.
_OF_COLUMN = re.compile(r".*\[[^\[\]]*\]: \S*")


def require_usual_fall(
    sheets: Sequence[Sheet], found: Sequence[tuple[DataColumns, Dataset]], setup: MeasurementSetup
) -> None:
    """Raise UserError where a file names a gravity, a tilt, a throw or a motion of the plate that would
    change the answer. A user who gives --gravity has looked.

    sheets: of the file, whose texts are searched.
    found: its data sets, one or more, with their columns: which facts matter depends on the kind of
    data.
    """
    text = _text_about(sheets, [columns for columns, _ in found])
    matters = _facts_that_matter(text, found, setup)
    for fact, words in _facts_in(text, setup.gravity.value):
        if fact not in matters:
            continue
        got = f"{words!r} in {found[0][0].table.name}"
        if fact == "gravity":
            used = f"{setup.gravity.value:.2f} m/s^2, which is used without --gravity"
            advice = f"Give the gravity that counts, such as --gravity '{words}'"
            raise UserError(fact, got, used, advice)
        _, expected, advice = _FACTS[fact]
        raise UserError(fact, got, expected, advice)


def _text_about(sheets: Sequence[Sheet], found: Sequence[DataColumns]) -> str:
    """The text of a file, and below it a line "name [unit]: first cell" for each column that is read."""
    lines = [
        sheet.text or "\n".join("\t".join(cells) for _, cells in sheet.rows) for sheet in sheets
    ]
    for columns in found:
        table = columns.table
        for place, (name, unit) in enumerate(table.header):
            lines.append(f"{name} [{unit}]: {cell_of(table.cells[0], place)}")
    return "\n".join(lines)


def _facts_that_matter(
    text: str, found: Sequence[tuple[DataColumns, Dataset]], setup: MeasurementSetup
) -> set[str]:
    """The facts that would change the answer: "gravity", and keys of _FACTS.

    text: of the file.
    found: its data sets with their columns.
    setup: what the user gives.
    """
    has_flights = any(data.needs_gravity for _, data in found)
    has_drop_heights = any("height_in" in columns.places for columns, _ in found)
    matters = set()
    is_gravity_open = setup.gravity == MeasurementSetup().gravity
    if is_gravity_open and (has_drop_heights or has_flights):
        matters |= {"gravity", "tilt", "track"}
    if has_drop_heights or setup.height is not None:
        matters.add("throw")
    # Pairs may be of any impact, one by one.
    if has_flights:
        matters |= {"driven ball", "stairs", "other motion", "rolled off"}
    # Several drops are begun anew each.
    if has_flights and len(found) == 1:
        matters.add("begun anew")
    # A track may be of any point of the ball.
    if has_drop_heights or any(data.kind == "heights" for _, data in found):
        matters.add("upper edge")
    # Bounces that are numbered may be left out.
    if any(data.needs_gravity and getattr(data, "numbers", None) is None for _, data in found):
        matters.add("left out")
    # Speeds relative to the plate tell its motion already.
    if has_flights or not _RELATIVE.search(text.casefold()):
        matters.add("moving plate")
    return matters


def _facts_in(text: str, gravity: float) -> Iterator[tuple[str, str]]:
    """Yield (fact, words of the text that tell it) for each fact that a text tells and does not deny.

    text: of a file.
    gravity: m/s²; another one in the text is the fact "gravity", and its words are the value in
    m/s². The other facts are keys of _FACTS.
    """
    lines = text.splitlines()
    text = "\n".join(line.casefold() if line.isascii() else folded(line) for line in lines)
    for match in _pattern("gravity").finditer(text):
        if other := _other_gravity(match, gravity):
            yield "gravity", other
    # The tilt of a camera is none of the plate's.
    text = _of_cameras().sub(" ", text)
    for fact in _FACTS:
        if not any(word in text for word in words_of_texts(fact)):
            # A search for a word is far faster than one for its pattern.
            continue
        for match in _pattern(fact).finditer(text):
            if not _is_denied(fact, match):
                yield fact, _line_of(match) if fact in _SENTENCES else match[0].strip()
    moves = (*words_of_texts("moving"), "moved", *words_of_texts("shaker"))
    if any(word in text for word in moves):
        for match in _moving_plate().finditer(text):
            if not _has_denial(match, _NOT_AFTER):
                yield "moving plate", match[0]


def _is_after_all(match: re.Match[str]) -> bool:
    """Say whether words tell what came after the last number of a text."""
    line, *below = match.string[match.end() :].split("\n")
    later = [line, *(one for one in below if not _OF_COLUMN.fullmatch(one))]
    is_then = _THEN.search(match.string[: match.start()]) is not None
    return is_then and not any(re.search(r"\d", one) for one in later)


def _line_of(match: re.Match[str]) -> str:
    """The line of a text in which a match stands, without the marks of a comment."""
    begin = match.string.rfind("\n", 0, match.start()) + 1
    return match.string[begin:].partition("\n")[0].strip('#%/!; \t"{},')


def _is_denied(fact: str, match: re.Match[str]) -> bool:
    """Say whether the words around those of a fact deny it, or tell that it came after all readings.

    fact: a key of _FACTS; only those of _DENIED are ever denied.
    """
    if fact not in _DENIED:
        return False
    if fact == "rolled off" and _is_after_all(match):
        return True
    return _has_denial(match, _AT_THE_END if fact in _SENTENCES else _NOT_AFTER)


def _has_denial(match: re.Match[str], after: re.Pattern[str]) -> bool:
    """Say whether the words around a match deny it: "no shaker", "shaker off".

    after: words behind the match that do.
    """
    line_before = match.string[: match.start()].rpartition("\n")[2]
    if _NOT_BEFORE.search(line_before):
        return True
    return after.match(match.string, match.end()) is not None


@cache
def _moving_plate() -> re.Pattern[str]:
    """A word of a support with one of motion, or the name of a support that is there to move."""
    support, moving, shaker = (
        "|".join(sorted(map(re.escape, words_of_texts(of)), key=len, reverse=True))
        for of in ("support", "moving", "shaker")
    )
    gap = r"[ \t_]+\(?"
    # A ball may be what moves: "on the floor moving to the left".
    upwards = rf"moving{gap}(?:up|down|vertically|sinusoidally|periodically|at\b|with\b)"
    # A plate is also moved to another place between drops.
    moved = rf"moved{gap}(?:up{gap}and{gap}down|vertically|sinusoidally|periodically)"
    after = rf"(?:{_IS}{gap})+(?:{moving})|(?!moving\b)(?:{moving})|(?:{_IS}{gap})*(?:{upwards}|{moved})"
    return re.compile(
        rf"(?<![\w-])(?:(?:{moving}){gap}(?:{_OF_KIND}{gap}){{0,2}}(?:{support})"
        rf"|(?:{support}){gap}(?:{after})|{shaker})(?!\w)"
    )


@cache
def _of_cameras() -> re.Pattern[str]:
    """The words of a tilt that is a camera's: "camera tilt", "tilt of the phone", "Kamera um 3° geneigt"."""
    cameras, tilts = ("|".join(map(re.escape, words_of_texts(of))) for of in ("camera", "tilt"))
    camera, tilt = rf"\b(?:{cameras})\w*", rf"(?:{tilts})\w*"
    joint = r"[\s_:=-]*(?:(?:was|is|were|wurde|war|ist|est|etait|era|es|e|um|by|de)\s+)*"
    angle = rf"(?:{_NUMBER}\s*(?:{_FACTS['tilt'][0]})\s*)?"
    of = r"[\s_]*(?:angle\s+)?(?:of|der|des|de|du|della|del|da)?\s*(?:the|la|l['’])?\s*"
    return re.compile(rf"{camera}{joint}{angle}{tilt}|{tilt}{of}{camera}")


@cache
def _pattern(fact: str) -> re.Pattern[str]:
    """The form of a fact: one of its words, and a number that is not 0 with a unit."""
    words = "|".join(sorted(map(re.escape, words_of_texts(fact)), key=len, reverse=True))
    words = rf"(?<!specific )(?<!of ){_BEGIN}(?:{words})"
    if fact == "gravity":
        return re.compile(rf"(?:{words}\w*?|{_LETTER}){_GRAVITY}", re.MULTILINE)
    unit = _FACTS[fact][0]
    number = rf"(?=[-+−.,0]*[1-9]){_NUMBER}"
    before = rf"[\[(_]\s*(?:{unit})\s*[\])]?[\s=:,;|\"]*{number}"
    after = rf"{number}\s*(?:{unit})(?!\w)"
    if fact == _EACH_TIME:
        each = rf"{_BEGIN}(?:{'|'.join(map(re.escape, words_of_texts('each')))})"
        return re.compile(rf"{words}[^.;\n]*?{each}|{each}[^.;\n]*?{words}")
    both = rf"{words}[^\d\n]*?(?:{before}|{after})|(?<![\w.,]){after}[^\d\n]*{words}"
    return re.compile(both if unit else words)


def _other_gravity(match: re.Match[str], gravity: float) -> str:
    """A gravity in a text, as "1.62 m/s^2", where it is another one than `gravity` (m/s²); else "".

    match: of `_pattern("gravity")`. Of a vector the size counts. A number without a unit may be in
    m/s², cm/s², ft/s² or g: it is another gravity where none of these makes it the given one.
    """
    unit_before, opening, after_sign, unit_after, after_words, unit_of_words = match.groups()
    texts = re.findall(_NUMBER, after_sign or after_words)
    numbers = [text.replace("−", "-").replace(",", ".") for text in texts]
    values = list(map(float, numbers))
    is_vector = len(values) > 1 and (bool(opening.strip()) or 0.0 in values)
    value = math.hypot(*values) if is_vector else abs(values[0])
    length = unit_before or unit_after or unit_of_words
    word = re.match(r"[ \t]?([^\W\d_]+)", match.string[match.end() :])
    is_in_g = word is not None and word[1] == "g"
    if length:
        scales: Sequence[float] = (_LENGTHS[length],)
    elif is_in_g:
        scales = (STANDARD_GRAVITY,)
    elif word and is_unit(word[1]):
        # "center of gravity 12 mm"
        return ""
    else:
        scales = _OF_EARTH
    decimals = numbers[-1 if is_vector else 0].partition(".")[2]
    rounding = 0.5 * 10.0 ** -len(decimals)
    for scale in scales:
        if abs(value * scale - gravity) <= max(_NEAR * gravity, rounding * scale):
            return ""
    return f"{value * scales[0]:.5g} m/s^2"
