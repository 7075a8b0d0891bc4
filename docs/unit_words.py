"""Write the words for units in many languages, from CLDR, the Unicode Consortium's data of languages.

Run `python docs/unit_words.py` with the Babel of `requirements-dev.txt`: it has the data.
"""

from __future__ import annotations

import unicodedata
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import babel
from babel.localedata import load, locale_identifiers

if TYPE_CHECKING:
    from collections.abc import Iterator

PATH = Path(__file__).parents[1] / "hcbench/fitting/unit_words.toml"
# CLDR's name of each unit, by Pint's.
_UNITS = {
    "s": "duration-second",
    "ms": "duration-millisecond",
    "us": "duration-microsecond",
    "m": "length-meter",
    "cm": "length-centimeter",
    "mm": "length-millimeter",
    "in": "length-inch",
    "ft": "length-foot",
    "m/s": "speed-meter-per-second",
}
# Other units whose words are left out: "saat" is a second in Malay and an hour in Turkish.
_OTHERS = (
    "duration-minute",
    "duration-hour",
    "duration-day",
    "duration-month",
    "length-kilometer",
    "length-yard",
    "length-mile",
)
# Forms of a word by number; "per" and the genders are others.
_PLURALS = ("zero", "one", "two", "few", "many", "other")
# Shorter words mean other things in other languages: "d" is a second in Indonesian, "δ" in Greek.
_LEAST = 2
_LEAST_LATIN = 5
_HEADER = """\
# Words for units in the languages of CLDR, through Babel {babel}; `python docs/unit_words.py` writes them.
# © 1991-2025 Unicode, Inc. Unicode License v3: https://www.unicode.org/license.txt
# Words for two units, and short words in Latin letters, are left out.
"""


def unit_words() -> dict[str, list[str]]:
    """Words of each unit, in the order of Unicode; none stands for two units."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    for locale in locale_identifiers():
        # Countries differ in little, and scripts are locales of their own.
        if "_" in locale and len(locale.split("_")[1]) == 2:
            continue
        patterns = load(locale).get("unit_patterns", {})
        for unit, name in (*_UNITS.items(), *zip(_OTHERS, _OTHERS, strict=True)):
            for word in _words_of(patterns.get(name, {})):
                found[word].add(unit)
    words: dict[str, list[str]] = {unit: [] for unit in _UNITS}
    for word, units in sorted(found.items()):
        unit = min(units)
        if len(units) == 1 and unit in words and _tells(word):
            words[unit].append(word)
    return words


def _words_of(styles: Any) -> Iterator[str]:
    """Words in the patterns of a unit, such as "{0} seconds", of all styles."""
    for style in dict(styles).values():
        for form, pattern in dict(style).items() if hasattr(style, "items") else ():
            word = (
                unicodedata.normalize("NFKC", str(pattern))
                .replace("{0}", "")
                .strip(" \u200e\u200f")
            )
            if form in _PLURALS and word and "{" not in word:
                yield word.casefold()


def _tells(word: str) -> bool:
    """Say whether a word is long enough for its letters to mean nothing else in another language."""
    letters = [letter for letter in word if unicodedata.category(letter)[0] in "LM"]
    is_latin = any(unicodedata.name(letter).startswith("LATIN") for letter in letters)
    return word[0] != "/" and len(letters) >= (_LEAST_LATIN if is_latin else _LEAST)


def text() -> str:
    """The file."""
    lines = [_HEADER.format(babel=babel.__version__)]
    for unit, words in unit_words().items():
        lines.append(f'"{unit}" = [')
        line = " "
        for word in words:
            quoted = f' "{word}",' if '"' not in word else f" '{word}',"
            if len(line) + len(quoted) > 100:
                lines.append(line)
                line = " "
            line += quoted
        lines += [line, "]"]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PATH.write_text(text(), encoding="utf-8")
