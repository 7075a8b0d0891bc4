"""Numbers in text without a table: logs, chats, records of several lines, markup, lists in programs.

A text is numbers with words between them. Numbers whose places repeat are a column: those of lines
that are alike, or those of a list, which stand the same signs apart. A column has the words before
it that repeat as its name, and the unit after it; words that change from line to line, such as
"first" and "second", name nothing.
"""

from __future__ import annotations

import itertools
import re
import unicodedata
from collections import Counter, defaultdict
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hcbench.fitting.cells import counts
from hcbench.fitting.column_names import (
    CHANGES,
    QUANTITY_OF,
    is_beside,
    is_unit,
    is_unit_of,
    meanings_of,
    plain_unit,
    role_of,
    split_header,
    tells_drops_apart,
)
from hcbench.fitting.messages import rows_of_messages, tells_of_bounce
from hcbench.fitting.prose import rows_of_prose
from hcbench.fitting.separators import listed_names

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.fitting.separators import Row

_CLOCK = r"\d+(?::\d+){1,3}(?:[.,]\d+)?"
_PLAIN = r"[-+]?(?:\d+[ -]\d+/(?:2|4|8|16|32|64)\b|\d+(?:[.,]\d+)?|\.\d+)(?:[eEdD][-+]?\d+)?"
_STAMP = r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:[.,]\d+)?"
_NUMBER = re.compile(rf"(?<![\w.^])(?:{_STAMP}|{_CLOCK}|{_PLAIN})(?![\w.]*\d|[^\W\d]+\s*=)")
# The day before a clock's time, which stays: "[12/03/24, 10:14:07]", "11-14 10:15:02.911".
_DAY = re.compile(
    r"(?<![\w.])(?!\d{4}-\d\d-\d\d[T ])\d{1,4}([-/.])\d{1,2}(?:\1\d{1,4})?[, ]+(?=\d{1,2}:\d\d)"
)
# The day after a clock's time, as chats copy it: "[14:10, 03/05/2024]".
_DAY_AFTER = re.compile(r"(\[\d{1,2}:\d\d(?::\d\d)?), \d{1,4}([-/.])\d{1,2}\2\d{1,4}(?=\])")
# The writer of a message: "[19:03] Mia: first bounce", "14:22 - Mia: first bounce".
_SPEAKER = re.compile(
    rf"(?P<clock>\[?{_CLOCK}\]?(?:\s*[-–])?\s+)(?P<speaker>[^\W\d][^:\d\n]{{0,30}}):\s+(?P<said>.+)"
)
# Numbers of a list have points: a comma is between them.
_IN_LIST = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][-+]?\d+)?(?![\w.]*\d)")
_BETWEEN = re.compile(r"[\s,;]+")
# Signs about numbers that are none of their names: "1er", "2nd", "08:15:02.1Z", "esp32-07".
_ABOUT_NUMBERS = re.compile(
    r"(?<=\d)(?:er|[eè]re|[eè]me|e|st|nd|rd|th|º|ª|Z)(?=\s)|(?<=[^\W\d]\d)-\d+\b|(?<=[^\W\d]\d\d)-\d+\b"
)
# A comment after a number, and the letters of its type: "1204332UL, /* 0 */".
_OF_TYPE = re.compile(
    r"(?<=[,\d{(])[ \t]*/\*[^*\n]*\*/|(?<=\d)(?:[uU]?[lL]{1,2}|[uU]|[fF])(?=\s*[,})\n])"
)
# What h5dump prints about numbers: the place before each line, "(5): 1.84, 1.99,", and their type.
_OF_DUMP = re.compile(r"^\s*(?:\(\d+(?:,\d+)*\):|DATA(?:TYPE|SPACE)\b.*)", re.MULTILINE)
# What parts the phrases of a text, and the words of one.
_SIGNS = re.compile(r"[=:,;{}\[\]\"|<>\n]+|//")
# With the vowels that stand about a letter in Hindi or Thai: Python counts them as signs.
_VOWELS = "".join(chr(i) for i in range(0x300, 0x1200) if unicodedata.category(chr(i))[0] == "M")
_LETTERS = re.compile(rf"[^\W\d](?:[^\W\d]|[{_VOWELS}])*")
_LABEL = re.compile(r"(\d+\.\d{3,})\t(\d+\.\d{3,})\t(.+)")
_WORD = re.compile(r"[^\W\d][\w./^-]*")
# Words between the name of a list and its numbers.
_OF_PROGRAMS = re.compile(
    r"(?:(?:np|numpy|array|c|list|tuple|series|out|in|double|float|real|vec|vector|var|let|const"
    r"|static|constexpr|unsigned|long|progmem|u?int\d*(?:_t)?|text|plain|time\.duration)\b[.]?)+",
    re.IGNORECASE,
)
# Roles of columns that a rate turns into times.
_COUNTED = ("frame", "sample")
_OPENING = tuple("=:([{")
_ARROW = re.compile(r"(?:->|=>|→)\s*$")
# Flights of a ball are shorter, s: it falls from 30 m. Laps of a runner are longer.
_LONGEST_LAP = 5.0
# Letters before a list that may have its name.
_BEFORE = 200
# Numbers that are a list, and lines that are records, at least; lines and characters of one at most.
_LEAST_LISTED = 4
_LEAST = 3
_MOST_LINES = 100_000
_MOST_CHARACTERS = 400


class _TextLine(NamedTuple):
    """A line that is not empty: its number in the text, from 1, and its words and numbers."""

    number: int
    text: str


class _NumberInLine(NamedTuple):
    """A number in a line, and the words before it and after it, up to the next number."""

    before: str
    number: str
    after: str


class _NamedNumber(NamedTuple):
    """A number in a line with its name and the unit there, and all words before it."""

    name: str
    number: str
    words: str


def _is_event(name: str) -> bool:
    """Say whether a name tells of a touch or a bounce."""
    return bool(meanings_of(name) & {"touch", "bounce"})


class _Columns(NamedTuple):
    """Names of columns, their rows, and the lines before them; empty where none are found."""

    names: tuple[str, ...] = ()
    rows: tuple[Row, ...] = ()
    before: tuple[Row, ...] = ()

    def known(self) -> tuple[int, int]:
        """Number of quantities among the columns, and of names that tell of touches or bounces."""
        headers = list(map(split_header, self.names))
        roles = {role_of(*header) for header in headers}
        events = {name.rstrip(" 0123456789") for name, _ in headers if _is_event(name)}
        meanings = list(map(meanings_of, self.names))
        if {"before"} in meanings and {"after"} in meanings:
            # Their unit may stand above them.
            roles |= {"speed_in", "speed_out"}
        return len(roles & {*QUANTITY_OF, *_COUNTED}), len(events)


def rows_in_text(text: str) -> tuple[Row, ...]:
    """A header and rows of the numbers in a text, below what the text says before them; empty where
    no name of a column is known.
    """
    text = _OF_DUMP.sub("", text)
    text = _OF_TYPE.sub("", re.sub(r"\bnp\.(?:float|int)\d+\(([^()]*)\)", r"\1", text))
    if told := rows_of_messages(text):
        return told
    lines = _without_speakers(_lines(text))
    if len(lines) > _MOST_LINES or any(len(line.text) > _MOST_CHARACTERS for line in lines):
        return ()
    found = max(_of_labels(lines), _of_records(lines), _of_lists(text), key=_Columns.known)
    if not any(found.known()):
        return rows_of_prose(text)
    return (*found.before, (found.rows[0][0], found.names), *found.rows)


def _lines(text: str) -> list[_TextLine]:
    """The lines of a text that are not empty, without days; each tag of XML is a line."""
    is_markup = text.lstrip().startswith("<")
    if is_markup:
        # The ends of elements say nothing.
        text = re.sub(r"</[^<>]*>", "", text)
        # <h n="1">61.2 has the number of the bounce, and then its height.
        text = re.sub(r"<(\w+)((?:\s+\w+=\"\d+\")+)\s*>(?=\s*[-+\d.])", r"<\2 \1>", text)
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        parts = re.split(r"(?<=.)(?=<)", line) if is_markup else [line]
        for part in map(str.strip, parts):
            if part:
                without_days = _DAY.sub("", _DAY_AFTER.sub(r"\1", part))
                found.append(_TextLine(number, _ABOUT_NUMBERS.sub("", without_days)))
    return found


def _without_speakers(lines: list[_TextLine]) -> list[_TextLine]:
    """The lines of a chat without the writers of messages that count on: of "first bounce 62 cm" by one
    and "second bounce 40 cm" by the other.

    Messages count on where all but one of their words are alike, and that one is never the same:
    two people who each measure a ball of their own say "first" twice.
    """
    # {words with "" in place of one of them: {place of the line: its writer and that word}}
    said: defaultdict[tuple[str, ...], dict[int, tuple[str, str]]] = defaultdict(dict)
    for at, line in enumerate(lines):
        match = _SPEAKER.fullmatch(line.text)
        if match is None:
            continue
        numbers = _numbers_in(match["said"])
        if not numbers:
            continue
        # The last number is the reading, after which its unit follows.
        reading = numbers[-1]
        before = match["said"].removesuffix(f"{reading.number}{reading.after}").split()
        for i, word in enumerate(before):
            key = (*before[:i], "", *before[i + 1 :], reading.after)
            said[key][at] = (match["speaker"], word.lower())
    plain = list(lines)
    for messages in said.values():
        speakers = {speaker for speaker, _ in messages.values()}
        changing = {word for _, word in messages.values()}
        if len(speakers) > 1 and len(changing) == len(messages) >= _LEAST:
            for at in messages:
                without = _SPEAKER.sub(r"\g<clock>\g<said>", lines[at].text)
                plain[at] = _TextLine(lines[at].number, without)
    return plain


def _of_records(lines: Sequence[_TextLine]) -> _Columns:
    """Columns of records of one or more lines each, which begin with lines that are alike.

    Of several ways to part the lines into records, that with the most known columns counts, then that
    with the most rows. Empty where two ways are as good and lie one below the other, as of two balls,
    and where lines above tell bounces in another way.
    """
    alike = _alike(lines)
    named: dict[int, list[_NamedNumber]] = {}
    for places in alike.values():
        named |= zip(places, _named_numbers([lines[at].text for at in places]), strict=True)
    groups = [places for form, places in alike.items() if form and len(places) >= _LEAST]
    ways = [_records(lines, named, starts) for starts in groups]
    best = max(ways, key=lambda way: (way.known(), len(way.rows)), default=_Columns())
    as_good = [way.rows for way in ways if any(way.known()) and way.known() == best.known()]
    for one, other in itertools.permutations(as_good, 2):
        (last_line, _), (first_line, _) = one[-1], other[0]
        if last_line < first_line:
            # One ball below the other: which one is asked for, nothing says.
            return _Columns()
    return _Columns() if _leaves_out_bounces(lines, best) else best


# The form of a line: for each of its numbers, the words that name it and its unit.
_Form = tuple[tuple[str, ...], ...]


def _alike(lines: Sequence[_TextLine]) -> dict[_Form, list[int]]:
    """Places of the lines that are alike, by their form, () for lines without numbers.

    Lines are alike in the last word before each number, in all that the text repeats, and in the unit.
    """
    count = Counter(word for line in lines for word in set(_letters(line.text)))
    found: defaultdict[_Form, list[int]] = defaultdict(list)
    for at, line in enumerate(lines):
        form = []
        for before, _, after in _numbers_in(line.text):
            words = _letters(before)
            kept = [word for word in words if count[word] >= _LEAST or word == words[-1]]
            form.append((*kept, _unit_after(before, after)))
        found[tuple(form)].append(at)
    return found


def _leaves_out_bounces(lines: Sequence[_TextLine], found: _Columns) -> bool:
    """Say whether a line above records of one line each tells of a bounce in another way, with a height
    or a time as they have.
    """
    units = {plain_unit(unit) for _, unit in map(split_header, found.names) if unit}
    quantities = [of for of in ("position", "time") if any(is_unit_of(unit, of) for unit in units)]
    above = {number for number, _ in found.before}
    return any(
        tells_of_bounce(line.text, quantity)
        for line in lines
        if line.number in above
        for quantity in quantities
    )


def _of_labels(lines: Sequence[_TextLine]) -> _Columns:
    """The begins of labels of Audacity whose words are those of touches, among others.

    Empty where a line is not a label, and where the words of touches are not those of one kind.
    """
    labels = [match for line in lines if (match := _LABEL.fullmatch(line.text))]
    words = [" ".join(_letters(label[3])) for label in labels]
    events = {word for word in words if _is_event(word) and words.count(word) >= _LEAST}
    if len(labels) < len(lines) or len(events) != 1:
        return _Columns()
    rows: list[Row] = []
    for line, label, word in zip(lines, labels, words, strict=True):
        if word in events:
            rows.append((line.number, (label[1],)))
    return _Columns(("touch time [s]",), tuple(rows))


def _letters(text: str) -> list[str]:
    """Words of a text in lower case, without digits."""
    return _LETTERS.findall(text.lower())


def _records(
    lines: Sequence[_TextLine], named: dict[int, list[_NamedNumber]], starts: Sequence[int]
) -> _Columns:
    """Columns of records that begin at these lines: those with a name that all of them have.

    named: {place in `lines`: the numbers of that line with their names}.
    starts: places in `lines`, rising. Empty for two balls side by side, and for numbers without any
    word, which are a table.
    """
    first = lines[starts[0]].text
    # "points [1]:" is over the lines of its record.
    over = re.sub(r"[\W\d]+", " ", first).strip() if first.endswith(":") else ""
    # The last record is no longer than the others.
    longest = int(max(np.diff(starts)))
    ends = [*starts[1:], min(starts[-1] + longest, len(lines))]
    texts = [line.text for line in lines[starts[0] : ends[-1]]]
    has_words = any("-->" in text or any(map(str.isalpha, text)) for text in texts)
    all_words: dict[str, str] = {}
    records: list[dict[str, str]] = []
    for begin, end in zip(starts, ends, strict=True):
        numbers = [one for at in range(begin, end) for one in named[at] if one.name]
        for one in numbers:
            if one.words != all_words.setdefault(one.name, one.words):
                # One ball beside the other.
                return _Columns()
        records.append(_record(numbers, over))
    # Among other titles or labels, those of touches, numbered one after the other.
    for name in filter(_is_event, all_words):
        kept = [i for i, record in enumerate(records) if name in record]
        if len(kept) >= _LEAST and counts([records[i][name] for i in kept]):
            records = [records[i] for i in kept]
            starts = [starts[i] for i in kept]
    names = tuple(name for name in records[0] if all(name in record for record in records))
    listed = listed_names([line.text for line in lines[: starts[0] + 1]], len(names))
    if not listed and not has_words:
        # Numbers alone are a table, whose header says what they are.
        return _Columns()
    rows = []
    for start, record in zip(starts, records, strict=True):
        rows.append((lines[start].number, tuple(record[name] for name in names)))
    before = [(line.number, (_plain(line.text),)) for line in lines[: starts[0]]]
    return _Columns(listed or names, tuple(rows), tuple(before))


def _record(numbers: Sequence[_NamedNumber], over: str) -> dict[str, str]:
    """The numbers of a record by name; several of one name differ by their places: "h", "h 1".

    over: a word over the lines of the record, which is a part of the names that it makes known.
    """
    record: dict[str, str] = {}
    for name, number, _ in numbers:
        called = name
        if over and role_of(f"{over} {name}") in QUANTITY_OF:
            called = f"{over} {name}"
        if called in record:
            called = f"{called} {len(record)}"
        record.setdefault(called, number)
    _join_stamp(record)
    return record


def _join_stamp(record: dict[str, str]) -> None:
    """Replace the seconds and nanoseconds of a stamp of ROS by its time in s, with all its digits."""
    for whole, part in (("secs", "nsecs"), ("sec", "nanosec")):
        if whole in record and part in record:
            record["stamp [s]"] = f"{record.pop(whole)}.{int(record.pop(part)):09d}"


def _named_numbers(lines: Sequence[str]) -> Iterator[list[_NamedNumber]]:
    """Yield, for each of several lines that are alike, its numbers with their names: the words that all
    of the lines have. "bounce 1: 62.2 cm" has the bounce and its height.
    """
    parted = [_numbers_in(line) for line in lines]
    # What all lines have before each number.
    common = [
        _plain(_repeated([one.before for one in numbers])) for numbers in zip(*parted, strict=True)
    ]
    units = [[_unit_after(one.before, one.after) for one in line] for line in parted]
    names = _names_of_numbers(parted, common)
    for i in range(len(names) - 1):
        # "-4.2 -> 2.9 m/s"
        if names[i] == names[i + 1] and _ARROW.search(parted[0][i + 1].before):
            names[i : i + 2] = [f"{names[i]} before", f"{names[i]} after"]
            for each in units:
                each[i] = each[i] or each[i + 1]
    for line, units_of_line in zip(parted, units, strict=True):
        found = []
        for name, unit, words, one in zip(names, units_of_line, common, line, strict=True):
            called = f"{name} [{unit}]" if unit else name
            found.append(_NamedNumber(called, one.number, words if _letters(words) else name))
        yield found


def _names_of_numbers(
    parted: Sequence[Sequence[_NumberInLine]], common: Sequence[str]
) -> list[str]:
    """The name of each number in lines that are alike; "" where nothing names it.

    parted: the numbers of each line, as many in each.
    common: the words before each number that all lines have. A number without words has the name of
    the one before.
    """
    clocks = [place for place, one in enumerate(parted[0]) if ":" in one.number]
    # Of a label, the begin and the end; a clock alone is of touches where its times are a train.
    of_clocks = ("start", "stop") if len(clocks) > 1 else ("touch",)
    are_laps = len(clocks) == 1 and _are_laps([[one.number for one in line] for line in parted])
    if are_laps:
        of_clocks = ("interval",)
    names: list[str] = []
    last = ""
    for place, first in enumerate(parted[0]):
        words = _phrase(common[place], _unit_after(first.before, first.after))
        if place in clocks:
            if meanings_of(first.after) & CHANGES:
                words = "other"
            elif not role_of(words):
                words = of_clocks[min(clocks.index(place), 1)]
        elif counts([line[place].number for line in parted]) and meanings_of(words) <= {"?"}:
            # "Ben: 1st bounce 62 cm"
            words = "number"
        elif meanings_of(words) or not last:
            last = words
        else:
            words = last
        names.append(words)
    if are_laps:
        # By its number a list with the newest lap first is turned.
        names[0] = "bounce"
    return names


def _are_laps(rows: Sequence[Sequence[str]]) -> bool:
    """Say whether rows are the laps of a stopwatch, the newest or the oldest first: a number that counts,
    and a time with hundredths that shrinks from one lap to the next, as flights of a ball do.

    rows: the numbers of each line.
    """
    if len(rows) < _LEAST or any(len(row) != 2 for row in rows):
        return False
    first_number, first_time = rows[0]
    if not first_number.isdigit() or not re.fullmatch(r"(?:\d+:)+\d+[.,]\d+", first_time):
        return False
    numbers = [number for number, _ in rows]
    times = []
    for _, time in rows:
        seconds = 0.0
        # "0:01:02.5": hours, minutes and seconds.
        for part in time.replace(",", ".").split(":"):
            seconds = 60.0 * seconds + float(part)
        times.append(seconds)
    if int(first_number) > 1:
        numbers.reverse()
        times.reverse()
    is_of_ball = counts(numbers) and times[0] < _LONGEST_LAP
    return is_of_ball and all(b < a for a, b in itertools.pairwise(times))


def _numbers_in(line: str) -> list[_NumberInLine]:
    """The numbers in a line with the words about them; [] for a line without any."""
    found = list(_NUMBER.finditer(line))
    ends = [0, *(match.end() for match in found)]
    starts = [*(match.start() for match in found), len(line)]
    # Words between two numbers are after the one and before the other.
    words = [line[end:start] for end, start in zip(ends, starts, strict=True)]
    return [_NumberInLine(words[i], match[0], words[i + 1]) for i, match in enumerate(found)]


def _unit_after(before: str, after: str) -> str:
    """The unit after a number, "" for none; a number in quotes has none."""
    unit = re.match(r"\s*[\[(]?([^\W\d_][^\s,;<>\"')\]]*|[\"'″′%])", after)
    is_quoted = before.endswith(("'", '"'))
    return unit[1] if unit and not is_quoted and is_unit(plain_unit(unit[1])) else ""


def _repeated(texts: Sequence[str]) -> str:
    """The words of the first text that all of the texts have, with the signs between them.

    "other" where a sign parts a word that changes from them, as in "steel: bounce height", which
    tells of several balls.
    """
    others = [set(_letters(text)) for text in texts[1:]]
    # Words and the signs between them in turn.
    parts = re.split(rf"([^\w{_VOWELS}]+)", texts[0])
    is_kept = [all(word in other for word in _letters(part) for other in others) for part in parts]
    changing = ""
    if not all(is_kept):
        last_changing = max(i for i, kept in enumerate(is_kept) if not kept)
        changing = "".join(parts[: last_changing + 1])
    if changing and re.search(r"[:,;].*[^\W\d]", texts[0][len(changing) :]):
        return "other"
    return "".join(itertools.compress(parts, is_kept))


def _phrase(words: str, unit: str) -> str:
    """The part of a name after a sign, where that alone has a role: the name of the sender, or of the
    program, goes before it. The whole name where no part has one.

    unit: behind the number, "" for none.
    """
    # <time unit="s">, <value name="height (cm)">
    given = re.search(r"\s+\w+ = (\S+)$", words)
    if given is not None and is_unit(plain_unit(given[1])):
        words = f"{words[: given.start()]} [{given[1]}]"
    words = re.sub(r"^\w+ (?:name|label|title|key) = ", "", words)
    signs = [match.end() for match in re.finditer(r"[\]):;,]\s", words)]
    # "lost, height"
    signs = [at for at in signs if not meanings_of(words[:at]) & CHANGES]
    for at in (0, *signs):
        part = words[at:].strip()
        header = f"{part} [{unit}]" if unit else part
        if role_of(*split_header(header)) or is_beside(part):
            return part
    return words


def _plain(text: str) -> str:
    """Words without the signs of programs and markup about them; one sign "=" stays between words."""
    words = re.sub(r"->|</?|[>\"'|]+", " ", re.sub(r"\s*=\s*[\"']?", " = ", text))
    return words.strip(" :=,;([{-@\t")


def _of_lists(text: str) -> _Columns:
    """Columns of the lists of numbers in a text: those with the same signs between one and the next,
    such as "[0.32, 0.61]", "- 0.32" in lines, or "320 * ms," in Go.

    A name that comes again begins another drop: a column "drop" then has the drop of each row.
    Nothing is read where other words tell such lists apart, as those of two balls, and where drops
    have other columns.
    """
    drops: list[dict[str, list[str]]] = [{}]
    for label, own_name, numbers in _named_lists(text):
        # The name of all may be too far above.
        is_of_drop = tells_drops_apart(label)
        name = own_name or (next(iter(drops[0]), "") if is_of_drop else "")
        if not name:
            continue
        if name in drops[-1]:
            if label and not is_of_drop:
                return _Columns()
            drops.append({})
        drops[-1][name] = numbers
    names = tuple(drops[0])
    if any(tuple(drop) != names for drop in drops):
        return _Columns()
    has_several = len(drops) > 1
    rows: list[Row] = []
    for number, drop in enumerate(drops, 1):
        of_drop = (str(number),) if has_several else ()
        padded = itertools.zip_longest(*drop.values(), fillvalue="")
        rows += [(1, (*of_drop, *row)) for row in padded]
    about: list[Row] = []
    if any(role_of(name) in _COUNTED for name in names):
        # The rate of frames and samples stands somewhere else in the text.
        others = [line for line in text.splitlines() if len(_IN_LIST.findall(line)) < _LEAST]
        about = [(1, (line,)) for line in others]
    return _Columns(("drop", *names) if has_several else names, tuple(rows), tuple(about))


class _NamedList(NamedTuple):
    """A list of numbers in a text.

    label: words between the list and its name, such as "drop 2".
    name: of a column, with its unit. Both are "" where there is none.
    """

    label: str
    name: str
    numbers: list[str]


def _named_lists(text: str) -> Iterator[_NamedList]:
    """Yield each list of numbers in a text, with the name before it.

    A list is in brackets, or after a sign such as "=": numbers below a header are a table.
    """
    found = list(_IN_LIST.finditer(text))
    gaps = [
        _BETWEEN.sub(" ", text[a.end() : b.start()]).strip() for a, b in itertools.pairwise(found)
    ]
    for run in (*_runs(gaps, 1), *_runs(gaps, 2)):
        first = found[run.first]
        last = found[run.last]
        gap = gaps[run.first]
        numbers = [match[0] for match in found[run.first : run.last + 1]]
        above = text[: first.start()]
        before = above.rstrip().removesuffix(gap).rstrip()
        if (not gap or run.period > 1) and before[-1:] not in _OPENING:
            continue
        # "{1: 0.32, 2: 0.61}" counts its numbers.
        if run.period > 1 and not counts(numbers[::2]):
            continue
        is_a_line_each = text[first.end() : last.start()].count("\n") == run.last - run.first
        if above.rstrip(" \t")[-1:] in ("=", ":") and is_a_line_each:
            # "rows: 1" is over a column, and no part of it.
            continue
        # Up to the next name in the line.
        after = re.split(r"[\n:]", text[last.end() : last.end() + _BEFORE], maxsplit=1)[0]
        label, name = _name_of(before[-_BEFORE:], f"{gap.replace('.', ' ')} {after}")
        yield _NamedList(label, name, numbers[run.period - 1 :: run.period])


class _Run(NamedTuple):
    """Numbers in a row with the same gaps between them: the places of the first and of the last.

    period: after how many numbers the gaps are the same again: 2 of "{1: 0.32, 2: 0.61}".
    """

    first: int
    last: int
    period: int


def _runs(gaps: Sequence[str], period: int) -> Iterator[_Run]:
    """Yield the runs of numbers that are long enough for a list.

    gaps: signs between each number and the next.
    period: of the gaps.
    """
    at = 0
    is_same_again = [gap == later for gap, later in zip(gaps, gaps[period:], strict=False)]
    for is_same, group in itertools.groupby(is_same_again):
        first = at
        at += len(list(group))
        last = at + period
        if is_same and last - first >= period * _LEAST_LISTED - 1:
            yield _Run(first, last, period)


def _without_types(text: str) -> str:
    """The words of a text without those of programs before a list."""
    return " ".join(word for word in _WORD.findall(text) if not _OF_PROGRAMS.fullmatch(word))


def _name_of(before: str, after: str) -> tuple[str, str]:
    """The words between a list and the last name of a column before it, such as "drop 2", and that name
    with a unit that stands near it; "" for none, or where the last name is of something else, such as
    heights lost.

    before, after: the text about the list.
    """
    *_, line = before.splitlines()
    if meanings_of(_without_types(line)) & CHANGES:
        return "", ""
    plain = re.sub(r"\(|<[^<>\n]*>", " ", before).replace("#", ":")
    label = ""
    # From the list upwards.
    for phrase in filter(None, map(_without_types, reversed(_SIGNS.split(plain)))):
        name, unit = split_header(phrase)
        role = role_of(name, unit)
        if role in _COUNTED:
            return label, name
        if role in QUANTITY_OF:
            unit = unit or _unit_near(before, after, QUANTITY_OF[role])
            return label, f"{name} [{unit}]" if unit else name
        label = label or phrase
        known = {one for one in meanings_of(name) if one != "?" and not one.isdigit()}
        if known - {"group"} and not is_beside(name):
            break
    return label, ""


def _unit_near(before: str, after: str, quantity: str) -> str:
    """The unit of a quantity that stands nearest to a list, "" for none.

    Of several lists, each has its unit after it; so words after it go first.
    """
    words = [*re.findall(r"[^\W\d_][\w/]*", after), *reversed(_WORD.findall(before))]
    return next((word for word in words if is_unit_of(plain_unit(word), quantity)), "")
