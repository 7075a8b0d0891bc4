"""Names of columns: what their words mean in many languages, and what a refusal says of them."""

from __future__ import annotations

import itertools
import re
import tomllib
import unicodedata
from contextlib import contextmanager
from functools import cache, lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from hcbench.system.errors import QuantityError, UserError
from hcbench.terms import units

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

# The kind of number under each role.
QUANTITY_OF = {
    "time": "time",
    "interval": "time",
    "height": "position",
    "height_in": "position",
    "height_out": "position",
    "speed": "speed",
    "speed_in": "speed",
    "speed_out": "speed",
    "restitution": "number",
    "squared": "number",
    "penetration": "position",
    "rate": "speed",
    "force": "force",
    "energy_in": "energy",
    "energy_out": "energy",
}
EXPECTED_COLUMNS = (
    "columns such as time [s], height [cm], speed [m/s],restitution or v_in [m/s],v_out [m/s]"
)
# Sets of columns that are data, by their roles, and the kind of data: of those that a table has,
# the first is taken, since the others say less or are computed from it.
DATA_KINDS: dict[frozenset[str], str] = {
    frozenset({"penetration", "rate", "force"}): "loop",
    frozenset({"time", "force"}): "force",
    frozenset({"time", "height"}): "track",
    frozenset({"speed_in", "speed_out"}): "speeds",
    frozenset({"energy_in", "energy_out"}): "energies",
    frozenset({"height_in", "height_out"}): "rises",
    frozenset({"height_in", "interval"}): "rises",
    frozenset({"speed", "restitution"}): "pairs",
    frozenset({"speed_in", "restitution"}): "pairs",
    frozenset({"speed", "squared"}): "pairs",
    frozenset({"speed_in", "squared"}): "pairs",
    frozenset({"height_in", "restitution"}): "pairs",
    frozenset({"height_in", "squared"}): "pairs",
    frozenset({"time"}): "times",
    frozenset({"interval"}): "times",
    frozenset({"height"}): "heights",
}
# A header and a number of each role, as a file may have them.
_EXAMPLES = {
    "time": ("time [s]", "0.32"),
    "interval": ("interval [s]", "0.41"),
    "height": ("height [cm]", "24.5"),
    "height_in": ("drop height [cm]", "50"),
    "height_out": ("rebound height [cm]", "31"),
    "speed": ("speed [m/s]", "1.2"),
    "speed_in": ("v_in [m/s]", "1.2"),
    "speed_out": ("v_out [m/s]", "0.9"),
    "restitution": ("restitution", "0.75"),
    "squared": ("energy ratio", "0.56"),
    "penetration": ("penetration [um]", "4.5"),
    "rate": ("rate [m/s]", "0.3"),
    "force": ("force [N]", "12"),
    "energy_in": ("energy before [mJ]", "18"),
    "energy_out": ("energy after [mJ]", "10"),
}
# Meanings of whole files, which no column has.
_OF_FILES = ("frequency", "unit of length", "unit of time", "units", "dimension of x")
# Meanings of words that stand anywhere in a text.
_OF_TEXTS = (
    *("gravity", "tilt", "camera", "track", "throw", "left out", "moving plate"),
    *("support", "moving", "shaker", "driven ball"),
    *("stairs", "other motion", "rolled off", "begun anew", "each"),
    *("joins", "ordinal", "rose", "let go"),
)
# Roles: the meanings that a name must have, and those that it may have besides.
_EVENTS = {"touch", "bounce"}
_UPWARDS = {"vertical", "y", "z"}
_ROLES: tuple[tuple[str, set[str], set[str]], ...] = (
    ("time", {"time"}, {*_EVENTS, "begin", "number", "sample", "frame"}),
    ("time", {"begin"}, _EVENTS),
    ("interval", {"interval"}, {"time", "duration", *_EVENTS}),
    # That of a touch is its contact.
    ("interval", {"duration"}, {"time", "bounce"}),
    ("height_in", {"height", "drop"}, {"before", "bounce", *_UPWARDS, "place"}),
    ("height_in", {"height", "before"}, {"bounce", "touch", *_UPWARDS, "place"}),
    ("height_in", {"place", "drop"}, _UPWARDS),
    ("height_out", {"height", "after"}, {"bounce", "touch", "peak", *_UPWARDS, "place"}),
    ("height", {"height"}, {"bounce", "peak", "place", *_UPWARDS}),
    ("height", {"place"}, _UPWARDS),
    ("height", {"y"}, {"vertical", "number"}),
    ("height", {"z"}, {"vertical", "number"}),
    ("height", {"peak", "bounce"}, set()),
    ("speed_in", {"speed", "before"}, {*_EVENTS, "drop", *_UPWARDS}),
    ("speed_in", {"speed", "touch"}, {"drop", "vertical"}),
    ("speed_in", {"speed", "drop"}, {"vertical"}),
    ("speed_out", {"speed", "after"}, {*_EVENTS, *_UPWARDS}),
    ("speed_out", {"speed", "bounce"}, {"vertical"}),
    ("speed", {"speed"}, {"vertical"}),
    ("restitution", {"restitution"}, {*_EVENTS, "vertical"}),
    ("squared", {"restitution", "squared"}, _EVENTS),
    ("energy_in", {"energy", "before"}, _EVENTS),
    ("energy_out", {"energy", "after"}, _EVENTS),
    ("squared", {"energy", "ratio"}, {*_EVENTS, "after"}),
    ("squared", {"energy", "restitution"}, set()),
    ("squared", {"height", "ratio"}, {"bounce", "after"}),
    ("force", {"force"}, {"touch", "vertical", "z"}),
    ("rate", {"rate"}, set()),
    ("rate", {"penetration", "rate"}, set()),
    ("rate", {"penetration", "speed"}, set()),
    ("penetration", {"penetration"}, {"touch", "vertical"}),
    ("frame", {"frame"}, {"number", "begin", *_EVENTS}),
    ("sample", {"sample"}, {"number", "begin", *_EVENTS}),
)
# Roles of single words by the kind of their unit: "drop [cm]" is a height; "drop" alone numbers the
# drops.
_BY_QUANTITY = {
    ("drop", "position"): "height_in",
    ("after", "position"): "height_out",
    ("before", "position"): "height_in",
    ("bounce", "position"): "height",
    ("after", "speed"): "speed_out",
    ("before", "speed"): "speed_in",
    ("touch", "speed"): "speed_in",
    ("touch", "time"): "time",
    ("bounce", "time"): "time",
    ("after", "force"): "force",
    ("penetration", "time"): "interval",
}
# Columns that say nothing of the bounces, where a name has these meanings alone. Any other column
# of numbers may change what the rest means: a time beside a temperature may be a log of something else.
_BESIDE = {
    *("number", "trial", "beside", "vertical", "bounce", "touch", "drop", "mean", "before"),
    *("frame", "sample"),
}
# Meanings of words that make another quantity of what they stand before.
CHANGES = {"changed", "peak", "upper edge"}
# Meanings of names that tell drops apart.
_OF_DROPS = {"trial", "drop", "number"}
# Quantities that units of columns are of.
QUANTITIES_OF_COLUMNS = ("time", "position", "speed", "force", "energy")
# Units of a picture, which a scale turns into lengths.
PIXELS = ("px", "pixel", "pixels")
# Units of a column that is a ratio, such as e.
NO_UNIT = ("", "1", "-", "–", "—", "none", "dimensionless", "ohne", "a.u.", "n/a", "/")
# The brackets in which a unit may stand: square ones first, as round ones are used for words too.
_BRACKETS = (
    re.compile(r"\[\s*([^\[\]]*?)\s*\]"),
    re.compile(r"\(\s*([^()]*(?:\([^()]*\)[^()]*)*)\s*\)"),
    re.compile(r"\{\s*([^{}]*?)\s*\}"),
)
# What a word in brackets may add to a name: "v (in)", "e (mean)", "e (std)".
_IN_BRACKETS = {
    *("before", "after", "mean", "touch", "bounce", "drop", "vertical", "x", "y", "z", "peak"),
    "uncertainty",
}
_RUN = re.compile(
    r"\s*(?:[,;:|-]\s*)?\b(?:run|data set|dataset|set|latest|mass [a-z]|mass_[a-z])\b\s*#?\s*\d*\s*:?\s*",
    re.IGNORECASE,
)
_BEFORE_UNIT = re.compile(r"\s*/\s*|_|\s*,\s*|\s+(?:in|en)\s+|\s+")
_OF_R = re.compile(r"(\S+?)\.{2,3}([a-zA-Zµ]+(?:\.[a-z]+)?)\.?")
# Units times a power of ten, "10^-2 m", "1/100 s", "x10 cm", have a prefix: cm, cs, dm. Of "(10 cm)"
# nobody knows whether it is the height of the drop.
_SCALED = re.compile(
    r"[(\[]?\s*(?:[x×]?\s?(?:1?e(?P<e>-?\d)|1/1(?P<under>0+)|10\s*(?:\^\s*|(?=-))(?P<power>-?\d))"
    r"|[x×]\s?(?:0\.(?P<zeros>0*)1|1(?P<over>0+)))\s*[·*]?\s*(?P<unit>[cdm]?(?:m/s|[ms]))\s*[)\]]?"
)
_PREFIXES = {-6: "µ", -3: "m", -2: "c", -1: "d", 0: "", 1: "da", 2: "h", 3: "k"}
# "m s^-1" and "m*s^-1" are m/s.
_BY_POWER = re.compile(r"([a-zµ]+)[\s*]([sh])\^-1")
_SIGNS = dict.fromkeys("-−–", "before") | dict.fromkeys("+'′’", "after")
_SIGNED = re.compile(r"([a-zA-Z]+)\s*[_^]*\{?\s*([-−–+'′’])\}?")
_DELTA = re.compile(r"^[δ∆]\s*_?\s*([a-z])\b")
# Thai, Chinese, Japanese and Korean part no words by blanks, or not always.
_WITHOUT_BLANKS = re.compile(r"[\u0e00-\u0eff\u3040-\u30ff\u4e00-\u9fff\uac00-\ud7a3]")
# Letters without an accent that could be left out, as people type them elsewhere.
_PLAIN_LETTERS = str.maketrans({"ø": "oe", "æ": "ae", "œ": "oe", "ł": "l", "đ": "d", "ı": "i"})
# Vowels with an accent are typed in two letters too: "hoehe" is "höhe", "hoejd" is "höjd".
_TWO_LETTERS = re.compile(r"([aou])e|a(?=a)")
# Letters of Russian in Latin ones.
_CYRILLIC = dict(zip("абвгдезийклмнопрстуфыэ", "abvgdeziyklmnoprstufye", strict=True)) | {
    **{"ж": "zh", "х": "kh", "ц": "ts", "ч": "ch", "ш": "sh", "щ": "shch"},
    **{"ъ": "", "ь": "", "ю": "yu", "я": "ya"},
}
# Languages whose words have many endings, and letters that a word has before its ending, at least.
_OF_MANY_ENDINGS = frozenset(["pl", "cs", "ru", "uk", "hu", "fi", "tr", "ro", "el"])
_LEAST_STEM = 5
# Letters between the parts of a compound.
_LINKS = ("", "s", "n", "en", "e")
# Parts of compounds, such as Fallhöhe, have this many letters or more.
_LEAST_PART = 3
# Words of the longest phrase that has one meaning.
_LONGEST_PHRASE = 5
# Letters of the longest word that is looked up: garbage in a wrong encoding has longer ones.
_LONGEST_WORD = 60
# Columns that a refusal shows, and letters of each name, at most.
_MOST_SHOWN = 4
_LETTERS = 24


@cache
def _table() -> dict[str, Mapping[str, list[str]]]:
    """Words by meaning and language, from `words.toml`."""
    return _toml("words.toml")


def _toml(name: str) -> dict[str, Any]:
    """A data file of this room."""
    return tomllib.loads(files("hcbench.fitting").joinpath(name).read_text(encoding="utf-8"))


@cache
def _lexicon(of_files: bool = False) -> dict[str, str]:
    """{word or phrase, as `_words` parts it: its meaning, a key of words.toml}.

    of_files: those of lines before a table, in place of those of columns.
    """
    meanings: dict[str, str] = {}
    for meaning, languages in _table().items():
        if meaning in ("unit", *_OF_TEXTS) or (meaning in _OF_FILES) != of_files:
            continue
        for word in itertools.chain(*languages.values()):
            meanings.setdefault(_phrase(word), meaning)
    for word, meaning in list(meanings.items()):
        # "vysota": Russian in Latin letters, as programs' names are.
        if len(word) >= _LEAST_STEM and set(word) & set(_CYRILLIC):
            meanings.setdefault("".join(_CYRILLIC.get(letter, letter) for letter in word), meaning)
    return meanings


@cache
def _languages() -> dict[str, frozenset[str]]:
    """Languages of each word of a column, in the meaning that `_lexicon` has for it."""
    found: dict[str, frozenset[str]] = {}
    for meaning, languages in _table().items():
        for language, words in languages.items():
            for word in map(_phrase, words):
                if _lexicon().get(word) == meaning:
                    found[word] = found.get(word, frozenset()) | {language}
    return found


@cache
def _unit_words() -> dict[str, str]:
    """Pint's word for each unit, by what people write."""
    found: dict[str, str] = {}
    for table in (_table()["unit"], _toml("unit_words.toml")):
        for unit, words in table.items():
            for word in (*words, unit):
                found.setdefault(folded(word), unit)
    return found


def folded(text: str) -> str:
    """Text in lower case without accents, wide letters and LaTeX's marks."""
    text = unicodedata.normalize("NFKC", text).casefold().strip().translate(_PLAIN_LETTERS)
    bare = unicodedata.normalize("NFD", text)
    letters = "".join(letter for letter in bare if not unicodedata.combining(letter))
    return unicodedata.normalize("NFC", letters)


@cache
def words_of_texts(meaning: str) -> tuple[str, ...]:
    """Words for a fact that a text may tell, `folded`."""
    return tuple(folded(word) for words in _table()[meaning].values() for word in words)


def has_word_of(text: str, meaning: str) -> bool:
    """Say whether a word of a text begins as one of a fact does: "rebounded" as "rebound".

    text: `folded`. meaning: a key of words.toml, such as "rose"; some of its words are phrases.
    """
    return any(
        # After a letter, "go" is a part of another word: "cargo".
        re.search(rf"(?<![^\W\d_]){re.escape(word)}", text)
        for word in words_of_texts(meaning)
    )


@cache
def ordinals() -> list[tuple[str, int]]:
    """Begins of words that count, `folded`, and the number each stands for: ("zweit", 2)."""
    languages = _table()["ordinal"].values()
    return [(folded(word), n) for words in languages for n, word in enumerate(words, 1)]


def _words(name: str) -> list[str]:
    """Words of a name: lower case, without accents; digits and signs of counting are words."""
    name = re.sub(r"\\(?:mathrm|text|rm|mathit|operatorname|textrm|mathbf)\b", "", name)
    name = (
        re.sub(r"\\(?=[a-zA-Z])|[${}\\]", "", name)
        .replace("²", " squared ")
        .replace("^2", " squared ")
    )
    name = re.sub(r"(?<=[a-zа-я])(?=[A-ZА-Я])", " ", name)
    name = re.sub(r"(?<!\w)[nN][.°º](?!\w)", " # ", name)
    signed = _SIGNED.fullmatch(name.strip())
    if signed is not None:
        name = f"{signed[1]} {_SIGNS[signed[2]]}"
    name = folded(name)
    delta = _DELTA.match(name)
    if delta is not None and delta[1] != "t":
        name = f"sigma {name[delta.end() - 1 :]}"
    # "d'impact", "l'urto"; the articles of Arabic and Hebrew are parts of the word.
    name = re.sub(r"\b[dl]['’]|\b(?:ال|ה)(?=\w{3})", " ", name)
    name = "".join(letter if _is_of_word(letter) else " " for letter in name)
    name = re.sub(r"(?<=[^\W\d])(?=\d)|(?<=\d)(?=[^\W\d])", " ", name)
    return name.split()


def _is_of_word(letter: str) -> bool:
    """True for letters, digits, the vowels that stand about a letter in Hindi or Thai, and signs."""
    return letter.isalnum() or letter in "#°№±" or unicodedata.category(letter)[0] == "M"


# For the words of the list alone, each of which is looked up twice.
@cache
def _phrase(listed: str) -> str:
    """A word or phrase of words.toml as `_words` parts it."""
    return " ".join(_words(listed))


def meanings_of(name: str) -> frozenset[str]:
    """Meanings of the words of a name; "?" where one is not known, digits as themselves."""
    return _meanings(tuple(_words(name)))


@cache
def _meanings(words: tuple[str, ...]) -> frozenset[str]:
    """Do as `meanings_of`, for the words of a name as `_words` parts it; the longest phrase that is
    known counts, of at most five words.
    """
    # Alone, "F" is a force; in "v_f" it is final.
    if words == ("f",):
        return frozenset({"force"})
    lexicon = _lexicon()
    found: set[str] = set()
    at = 0
    while at < len(words):
        for count in range(min(_LONGEST_PHRASE, len(words) - at), 0, -1):
            phrase = " ".join(words[at : at + count])
            if phrase in lexicon:
                # Some phrases mean two things at once: "height + before".
                found.update(lexicon[phrase].split(" + "))
                at += count
                break
        else:
            found |= _parts(words[at])
            at += 1
    return frozenset(found - {"filler"})


def _parts(word: str) -> set[str]:
    """Meanings of the parts of a word that is in no list, or of the known word that it is in another
    spelling or with another ending; "?" where they are not known.
    """
    if word.isdigit():
        return {word}
    if len(word) > _LONGEST_WORD:
        return {"?"}
    least = 1 if _WITHOUT_BLANKS.search(word) else _LEAST_PART
    for spelled in (word, _TWO_LETTERS.sub(r"\1", word)):
        if spelled in _lexicon():
            return {_lexicon()[spelled]}
        found = _compound(spelled, least)
        if found is not None:
            return found
    return _inflected(word)


@cache
def _words_with_endings() -> dict[str, list[str]]:
    """Known words of languages of many endings, by their first letters: a file may have thousands of
    unknown words.
    """
    found: dict[str, list[str]] = {}
    for known, languages in _languages().items():
        if len(known) >= _LEAST_STEM and languages & _OF_MANY_ENDINGS:
            found.setdefault(known[:_LEAST_STEM], []).append(known)
    return found


def _inflected(word: str) -> set[str]:
    """Meaning of a word with another ending than the known word has, in a language of many endings;
    "?" where no known word begins alike, or several of unlike meanings do.
    """
    found = set()
    for known in _words_with_endings().get(word[:_LEAST_STEM], ()):
        stem = known[: max(_LEAST_STEM, len(known) - 2)]
        if word.startswith(stem) and len(word) <= len(known) + 3:
            found.add(_lexicon()[known])
    return set(found.pop().split(" + ")) if len(found) == 1 else {"?"}


# Garbage in a wrong encoding has long words, whose ends come again and again.
@lru_cache(maxsize=20_000)
def _compound(word: str, least: int, languages: frozenset[str] | None = None) -> set[str] | None:
    """Meanings of a compound such as Rücksprunghöhe, of parts of `least` letters or more in one
    language; None unless it is a compound.

    languages: of the parts before this word; None for any. Long parts are tried first.
    """
    if not word:
        return set()
    for end in range(len(word), least - 1, -1):
        for link in _LINKS:
            part = word[:end].removesuffix(link)
            spoken = _languages().get(part, frozenset())
            if languages is not None:
                spoken &= languages
            is_linked = not link or (word[:end].endswith(link) and end < len(word))
            if not spoken or len(part) < least or not is_linked:
                continue
            rest = _compound(word[end:], least, spoken)
            if rest is not None:
                return {*_lexicon()[part].split(" + "), *rest}
    return None


def is_word_of_header(word: str) -> bool:
    """Say whether names of columns or their units have such a word."""
    plain = folded(word)
    return "?" not in meanings_of(word) or plain in _unit_words() or plain in _words_of_phrases()


def is_short_latin(word: str) -> bool:
    """Say whether a word is of three Latin letters or less, accents apart."""
    plain = folded(word)
    return plain.isascii() and len(plain) <= _LEAST_PART


@cache
def _words_of_phrases() -> frozenset[str]:
    """The single words of all names of columns."""
    return frozenset(itertools.chain(*map(str.split, _lexicon())))


def role_of(name: str, unit: str = "") -> str:
    """Role of a column with this name; "u_" and the role for an uncertainty, "" for an unknown
    name.

    unit: as the header has it: "drop [cm]" is "height_in"; "drop" alone numbers the drops and has
    no role, "".
    """
    found = set(meanings_of(name)) - {"mean"}
    if "uncertainty" in found:
        bare = _role_of_meanings(found - {"uncertainty"}, unit)
        return f"u_{bare}" if bare in QUANTITY_OF else ""
    return _role_of_meanings(found, unit)


def _role_of_meanings(found: set[str], unit: str) -> str:
    """Role of a set of meanings, "" for none.

    Digits of a single column do not count; where two columns differ in them, `columns_of` asks.
    """
    if "restitution" in found and is_unit_of(unit, "energy"):
        # "E before [mJ]"
        found = found - {"restitution"} | {"energy"}
    if unit == "%" and found & {"height", "energy"}:
        # "rebound height (% of the drop)"
        found = found | {"ratio"}
    digits = {meaning for meaning in found if meaning.isdigit()}
    # "rebound height, trial 1"
    found = found - digits - ({"trial"} if digits else set())
    for role, needed, allowed in _ROLES:
        if needed <= found <= needed | allowed:
            return role
    # "touch no. 3 [ms]" has the time of the touch, "after bounce [cm]" the height after it.
    bare = found - {"number"}
    bare = bare - _EVENTS or bare
    if len(bare) == 1 and unit:
        (meaning,) = bare
        for quantity in QUANTITIES_OF_COLUMNS:
            if is_unit_of(unit, quantity):
                return _BY_QUANTITY.get((meaning, quantity), "")
    return ""


def is_beside(name: str) -> bool:
    """Say whether programs and people write such a column besides the data."""
    found = {meaning for meaning in meanings_of(name) if not meaning.isdigit()}
    if "number" in found:
        # "flight no."
        found.discard("interval")
    return bool(found) and (found <= _BESIDE or "beside" in found)


def numbers_bounces(name: str) -> bool:
    """Say whether a name tells of the numbers of bounces or touches, and of nothing else."""
    found = meanings_of(name)
    return bool(found & {"bounce", "touch"}) and found <= {"number", "bounce", "touch"}


def tells_drops_apart(name: str) -> bool:
    """Say whether a name tells one drop from another: "drop 2", "run_b", "3"."""
    found = meanings_of(name)
    has_number = any(one.isdigit() for one in found)
    words = {one for one in found if not one.isdigit()}
    return words <= {*_OF_DROPS, "?"} and (has_number or bool(words & _OF_DROPS))


def is_group(name: str) -> bool:
    """Say whether a column tells one ball or plate from another."""
    is_thing = " ".join(_words(name)) in ("ball", "plate", "kugel", "balle")
    return is_thing or meanings_of(name) == {"group"}


def of_file(name: str) -> str:
    """Meaning of a name in a line before the table, such as "frequency"; "" for any other.

    The name may have other words before or after: "camera frame rate", "fps of the film".
    """
    words = _words(name)
    lexicon = _lexicon(of_files=True)
    for left_out in range(len(words)):
        last_words = " ".join(words[left_out:])
        first_words = " ".join(words[: len(words) - left_out])
        meaning = lexicon.get(last_words, "") or lexicon.get(first_words, "")
        if meaning:
            return meaning
    return ""


def split_header(cell: str) -> tuple[str, str]:
    """(name in lower case, unit) of "name [unit]", "name (unit)", "t/s", "time_s" or "time, s".

    The unit is "" where the cell has none. "Latest:" and "Run #1" are left out, and "name:" where the
    words after it have a role.
    """
    found = _split_header(cell)
    before, sign, rest = cell.partition(": ")
    if sign and is_beside(before) and not role_of(*found):
        later = _split_header(rest)
        return later if role_of(*later) else found
    return found


def _split_header(cell: str) -> tuple[str, str]:
    """The parts of a header as `split_header` gives them, with the words before a colon."""
    cell = unicodedata.normalize(
        "NFKC", cell.replace("²", "^2").replace("⁻¹", "^-1").replace("⁻", "-")
    )
    cell = cell.strip().removesuffix(":")
    # Gnuplot numbers its columns, and R writes "height (cm)" as "height..cm.".
    cell = re.sub(r"^\d+\s*:\s*(?=\D)", "", cell)
    of_r = _OF_R.fullmatch(cell)
    if of_r is not None:
        cell = f"{of_r[1]} [{of_r[2].replace('.', '/')}]"
    cell = re.sub(r"\\(?:si|SI|unit)\s*\{([^{}]*)\}", _of_latex, cell)
    cell = (
        re.sub(r"\\(?:mathrm|text|rm|textrm)\b\s*|\\[,;: ]|\$", "", cell).replace("\\", " ").strip()
    )
    if re.search(r"\b(?:latest|run|set|mass)\b", cell, re.IGNORECASE):
        cell = _RUN.sub(" ", cell).strip() or cell
    for brackets in _BRACKETS:
        found = list(brackets.finditer(cell))
        if not found:
            continue
        last = found[-1]
        unit = last[1].strip()
        # "v_{y}" is a name in LaTeX, and "qpos[2]" in a program.
        if unit.isdigit() or (cell[last.start()] == "{" and not is_unit(unit)):
            break
        outside = f"{cell[: last.start()]} {cell[last.end() :]}".strip().lower()
        if _adds_to_name(outside, unit):
            outside = f"{outside} {unit}"
            unit = ""
        # "t / (0.1 s)"
        unit = (outside.endswith("/") and _with_prefix(f"x{unit}")) or unit
        return _with_unit(re.sub(r"[\[\](){}]", " ", outside), unit)
    return _with_unit(cell.lower(), "")


def _of_latex(macro: re.Match[str]) -> str:
    """A unit of LaTeX's siunitx in brackets: "[m/s]" of "\\si{\\metre\\per\\second}"."""
    return f"[{macro[1].replace(chr(92) + 'per', '/').replace(chr(92), '').replace(' ', '')}]"


def _adds_to_name(outside: str, inside: str) -> bool:
    """Say whether a word in brackets belongs to the name before it, and is not a unit.

    "v (in)" has no inches: a speed has none.
    """
    meanings = meanings_of(inside)
    role = _role_of_meanings(set(meanings_of(outside)), "")
    if is_unit(inside):
        quantity = QUANTITY_OF.get(role, "")
        return inside.lower() in ("in", "n") and bool(quantity) and not is_unit_of(inside, quantity)
    if meanings_of(outside) <= {"uncertainty"} and inside:
        return "?" not in meanings
    # A Latin letter alone is a unit or a symbol; "σ" and "±" are words.
    is_letter = len(inside) == 1 and inside.isascii()
    return not is_letter and bool(meanings) and meanings <= _IN_BRACKETS


def _with_unit(name: str, unit: str) -> tuple[str, str]:
    """(name, unit) of "t/s", "time_s", "time, s", "height in cm".

    name: in lower case.
    unit: in brackets behind it; "" where there were none, and then a unit is looked for in the
    name.
    """
    # Keyboards have the Greek letter, Unicode the sign of micro too.
    name = name.replace("\N{GREEK SMALL LETTER MU}", "µ").strip().rstrip("/").strip()
    unit = unit.replace("\N{GREEK SMALL LETTER MU}", "µ")
    if unit:
        # "height_cm [cm]" says it twice.
        bare, again = _with_unit(name, "")
        says_it_twice = bool(again) and again == plain_unit(unit)
        return (bare if says_it_twice else name), plain_unit(unit)
    # The first sign after which all is a unit: "speed_m_s" has m/s, not s.
    for sign in _BEFORE_UNIT.finditer(name, 1):
        before = name[: sign.start()]
        found = _unit_behind(before, sign[0], name[sign.end() :])
        if found:
            return before.strip(" _"), found
    # "seconds" alone.
    if len(name) > 2 and is_unit_of(plain_unit(name), "time") and name in _unit_words():
        return "time", plain_unit(name)
    return name, ""


def _unit_behind(before: str, sign: str, written: str) -> str:
    """The unit that is all that stands behind a sign in a name; "" for other words.

    before: the name up to the sign, such as "_" or " in ".
    written: what is behind it.
    """
    if len(written) > _LONGEST_WORD:
        # A sentence, or a line without ends.
        return ""
    # "v_in" has no inches: a speed has none.
    quantity = QUANTITY_OF.get(role_of(before), "")
    if written in ("in", "n") and sign in ("_", " ") and not is_unit_of(written, quantity):
        return ""
    # "t / 10 ms"
    scaled = _with_prefix(f"x{written}") if sign.strip() in ("/", "in") else ""
    if scaled:
        return scaled
    unit = _BY_POWER.sub(r"\1/\2", units.usual_unit(plain_unit(written)))
    return unit if is_unit(unit) or unit in PIXELS else ""


def plain_unit(text: str) -> str:
    """A unit in the word that Pint knows: "s" of "Sekunden", "m/s" of "м/с"; else as it is."""
    if scaled := _with_prefix(text):
        return scaled
    text = text.strip().strip("[](){}").strip()
    # "% of the drop"
    text = re.sub(r"^%\s*(?:of|from|von|vom|de|du|del|della|do|da)\b.*", "%", text)
    known = _unit_words()
    # "cm." at the end of a sentence, or as an abbreviation.
    bare = text.rstrip(".")
    return known.get(folded(text)) or (len(bare) > 1 and known.get(folded(bare))) or text


def _with_prefix(text: str) -> str:
    """The unit for a power of ten times a unit, such as cm for "10^-2 m"; "" for other text, and for a
    power that no prefix has.
    """
    found = _SCALED.fullmatch(text.replace("−", "-").replace("-^", "^-").lower())
    if found is None:
        return ""
    exponent = int(found["e"] or found["power"] or 0)
    # "100 s", "1/100 s", "0.01 s"
    exponent += len(found["over"] or "") - len(found["under"] or "")
    if found["zeros"] is not None:
        exponent -= len(found["zeros"]) + 1
    unit = found["unit"]
    bare = re.sub(r"^[cdm](?=[ms])", "", unit)
    exponent += next(k for k, sign in _PREFIXES.items() if f"{sign}{bare}" == unit)
    return f"{_PREFIXES[exponent]}{bare}" if exponent in _PREFIXES else ""


@cache
def is_unit(text: str) -> bool:
    """True for the unit of a column of times, places, speeds, forces or energies, and for %."""
    return any(is_unit_of(text, quantity) for quantity in QUANTITIES_OF_COLUMNS) or text == "%"


@cache
def is_unit_of(text: str, quantity: str) -> bool:
    """True for a unit of this quantity, in a word of any language."""
    scaled = _with_prefix(text)
    text = _BY_POWER.sub(r"\1/\2", units.usual_unit(plain_unit(text)))
    if not (scaled or text in _usual_units()) or quantity not in QUANTITIES_OF_COLUMNS:
        return False
    try:
        units.parse(f"1 {text}", quantity, "unit")
    except QuantityError:
        return False
    return True


@cache
def _usual_units() -> frozenset[str]:
    """Units that stand in headers without brackets."""
    return frozenset(_table()["unit"]) | {"µs", "µm", "dm", "kmh", "knots", "nm"}


@contextmanager
def explained(name: str, header: Sequence[tuple[str, str]]) -> Iterator[None]:
    """Add to each refusal of a table how hcbench read its header, and lines that it reads.

    name: what errors call the file.
    header: names with their units, "" for none.
    Raises the UserError of the block again, with the longer advice where it is about the table.
    """
    try:
        yield
    except UserError as error:
        is_of_table = error.slot.startswith(name)
        is_explained = "Read: " in error.advice or "Lines that" in error.advice
        if not is_of_table or is_explained:
            raise
        advice = [error.advice, _read_as(header)]
        # EXPECTED_COLUMNS are lines that are read: they do where no name was known.
        if error.expected != EXPECTED_COLUMNS or any(role_of(*one) for one in header):
            advice.append(_lines_that_are_read(header))
        text = ". ".join(filter(None, advice))
        raise type(error)(error.slot, error.got, error.expected, text) from error


def _read_as(header: Sequence[tuple[str, str]]) -> str:
    """Sentence on how hcbench read the columns: "Read: 'time [s]' as time in s, 'foo' as nothing"."""
    if header and not any(name for name, _ in header):
        return f"Read: {len(header)} column{'s' * (len(header) > 1)} without a name"
    shown = [_as_read(name, unit) for name, unit in header[:_MOST_SHOWN]]
    if len(header) > _MOST_SHOWN:
        shown.append(f"and {len(header) - _MOST_SHOWN} more")
    return f"Read: {', '.join(shown)}" if shown else ""


def _as_read(name: str, unit: str) -> str:
    """A column and what it was taken for, in words: "'time [s]' as time in s"."""
    cell = f"{name[:_LETTERS]} [{unit}]" if unit else name[:_LETTERS]
    return f"{cell!r} as {_taken_for(name, unit)}"


def _taken_for(name: str, unit: str) -> str:
    """Words for what a column was taken for: "time in s", "a number of rows", "no data", "nothing"."""
    role = role_of(name, unit)
    bare = role.removeprefix("u_")
    if bare in QUANTITY_OF:
        meaning = _EXAMPLES[bare][0].partition(" [")[0]
        if role != bare:
            meaning = f"uncertainty of {meaning}"
        if units.QUANTITIES[QUANTITY_OF[bare]].unit:
            meaning += f" in {unit}" if unit else " without a unit"
        return meaning
    if role or (is_beside(name) and meanings_of(name) & {"number", "trial"}):
        return "a number of rows"
    return "no data" if is_beside(name) else "nothing"


def _lines_that_are_read(header: Sequence[tuple[str, str]]) -> str:
    """A header and a line of numbers that are read, of the kind that a header is nearest to."""
    roles = {role_of(*one) for one in header}
    nearest = max(DATA_KINDS, key=lambda needed: len(needed & roles) - len(needed ^ roles) / 100)
    if not roles & set(QUANTITY_OF):
        nearest = frozenset({"time"})
    examples = [_EXAMPLES[role] for role in _EXAMPLES if role in nearest]
    names, numbers = zip(*examples, strict=True)
    return f"Lines that are read: {','.join(names)!r}, {','.join(numbers)!r}"
