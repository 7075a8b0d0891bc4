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
from operator import itemgetter
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


class _Named(NamedTuple):
    """A number in a line with its name and the unit there, and all words before it."""

    name: str
    number: str
    words: str


def _is_event(name: str) -> bool:
    """Say whether a name tells of a touch or a bounce."""
    return bool(meanings_of(name) & {"touch", "bounce"})


class _Columns(NamedTuple):
    """Names of columns, their rows, and the lines before them."""

    names: tuple[str, ...] = ()
    rows: tuple[Row, ...] = ()
    before: tuple[Row, ...] = ()

    def known(self) -> tuple[int, int]:
        """Number of columns with data, and of those that tell of touches or bounces."""
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
    if len(lines) > _MOST_LINES or any(len(line) > _MOST_CHARACTERS for _, line in lines):
        return ()
    found = max(_of_labels(lines), _of_records(lines), _of_lists(text), key=_Columns.known)
    if not any(found.known()):
        return rows_of_prose(text)
    return (*found.before, (found.rows[0][0], found.names), *found.rows)


def _lines(text: str) -> list[tuple[int, str]]:
    """Numbers and text of the lines that are not empty; each tag of XML is a line."""
    is_markup = text.lstrip().startswith("<")
    if is_markup:
        # The ends of elements say nothing.
        text = re.sub(r"</[^<>]*>", "", text)
        # <h n="1">61.2 has the number of the bounce, and then its height.
        text = re.sub(r"<(\w+)((?:\s+\w+=\"\d+\")+)\s*>(?=\s*[-+\d.])", r"<\2 \1>", text)
    return [
        (number, _ABOUT_NUMBERS.sub("", _DAY.sub("", _DAY_AFTER.sub(r"\1", part.strip()))))
        for number, line in enumerate(text.splitlines(), 1)
        for part in (re.split(r"(?<=.)(?=<)", line) if is_markup else [line])
        if part.strip()
    ]


def _without_speakers(lines: list[tuple[int, str]]) -> list[tuple[int, str]]:
    """The lines of a chat without the writers of messages that count on: of "first bounce 62 cm" by one
    and "second bounce 40 cm" by the other.

    Messages count on where all but one of their words are alike, and that one is never the same:
    two people who each measure a ball of their own say "first" twice.
    """
    said: defaultdict[tuple[str, ...], dict[int, tuple[str, str]]] = defaultdict(dict)
    for at, (_, line) in enumerate(lines):
        match = _SPEAKER.fullmatch(line)
        if match is None or not (parts := [*_parts(match["said"])]):
            continue
        # The last number is the reading, after which its unit follows.
        words = [*match["said"].removesuffix(f"{parts[-1][1]}{parts[-1][2]}").split(), parts[-1][2]]
        for i, word in enumerate(words[:-1]):
            key = (*words[:i], "", *words[i + 1 :])
            said[key][at] = (match["speaker"], word.lower())
    plain = dict(enumerate(lines))
    for messages in said.values():
        speakers = {speaker for speaker, _ in messages.values()}
        changing = {word for _, word in messages.values()}
        if len(speakers) > 1 and len(changing) == len(messages) >= _LEAST:
            for at in messages:
                plain[at] = (lines[at][0], _SPEAKER.sub(r"\g<clock>\g<said>", lines[at][1]))
    return list(plain.values())


def _of_records(lines: Sequence[tuple[int, str]]) -> _Columns:
    """Columns of records of one or more lines each, by the lines that are alike with which they
    begin: alike in the last word before each number, in all that the text repeats, and in the unit.
    """
    count = Counter(word for _, line in lines for word in set(_letters(line)))

    def place(before: str, after: str) -> tuple[str, ...]:
        words = _letters(before)
        repeated = (word for word in words if count[word] >= _LEAST or word == words[-1])
        return (*repeated, _unit_after(before, after))

    alike: defaultdict[tuple[tuple[str, ...], ...], list[int]] = defaultdict(list)
    for at, (_, line) in enumerate(lines):
        alike[tuple(place(before, after) for before, _, after in _parts(line))].append(at)
    named: dict[int, list[_Named]] = {}
    for group in alike.values():
        named |= zip(group, _named([lines[at][1] for at in group]), strict=True)
    groups = [starts for key, starts in alike.items() if key and len(starts) >= _LEAST]
    ways = [_records(lines, named, starts) for starts in groups]
    best = max(ways, key=lambda way: (way.known(), len(way.rows)), default=_Columns())
    same = [way.rows for way in ways if any(way.known()) and way.known() == best.known()]
    if any(a[-1][0] < b[0][0] for a, b in itertools.permutations(same, 2)):
        # One ball below the other: which one is asked for, nothing says.
        return _Columns()
    return _Columns() if _leaves_out_bounces(lines, best) else best


def _leaves_out_bounces(lines: Sequence[tuple[int, str]], found: _Columns) -> bool:
    """Say whether a line above records of one line each tells of a bounce in another way, with a height
    or a time as they have.
    """
    units = {unit for _, unit in map(split_header, found.names) if unit}
    above = {number for number, _ in found.before}
    return any(
        tells_of_bounce(line, of)
        for number, line in lines
        if number in above
        for of in ("position", "time")
        if any(is_unit_of(plain_unit(unit), of) for unit in units)
    )


def _of_labels(lines: Sequence[tuple[int, str]]) -> _Columns:
    """The begins of labels of Audacity whose words are those of touches, among others."""
    labels = [(number, match) for number, line in lines if (match := _LABEL.fullmatch(line))]
    words = [" ".join(_letters(match[3])) for _, match in labels]
    events = {word for word in words if _is_event(word) and words.count(word) >= _LEAST}
    if len(labels) < len(lines) or len(events) != 1:
        return _Columns()
    rows = tuple(
        (n, (match[1],)) for (n, match), word in zip(labels, words, strict=True) if word in events
    )
    return _Columns(("touch time [s]",), rows)


def _letters(text: str) -> list[str]:
    """Words of a text in lower case, without digits."""
    return _LETTERS.findall(text.lower())


def _records(
    lines: Sequence[tuple[int, str]], named: dict[int, list[_Named]], starts: Sequence[int]
) -> _Columns:
    """Columns of records that begin at these lines: those with a name that all of them have.

    lines: (number in the text, line). named: {place in `lines`: the numbers of that line with their
    names}. starts: places in `lines`, rising.
    """
    records: list[dict[str, str]] = []
    all_words: dict[str, str] = {}
    first = lines[starts[0]][1]
    # "points [1]:" is over the lines of its record.
    over = re.sub(r"[\W\d]+", " ", first).strip() if first.endswith(":") else ""
    has_words = False
    # The last record is no longer than the others.
    longest = int(max(np.diff(starts)))
    for begin, end in itertools.pairwise([*starts, min(starts[-1] + longest, len(lines))]):
        record: dict[str, str] = {}
        for at in range(begin, end):
            line = lines[at][1]
            has_words = has_words or "-->" in line or any(map(str.isalpha, line))
            for name, number, words in filter(itemgetter(0), named[at]):
                if words != all_words.setdefault(name, words):
                    # One ball beside the other.
                    return _Columns()
                called = (
                    f"{over} {name}" if over and role_of(f"{over} {name}") in QUANTITY_OF else name
                )
                # Numbers of one name differ by their places.
                called = called if called not in record else f"{called} {len(record)}"
                record.setdefault(called, number)
        _join_stamp(record)
        records.append(record)
    # Among other titles or labels, those of touches, numbered one after the other.
    for name in filter(_is_event, all_words):
        kept = [i for i, record in enumerate(records) if name in record]
        if len(kept) >= _LEAST and counts([records[i][name] for i in kept]):
            records, starts = [records[i] for i in kept], [starts[i] for i in kept]
    names = tuple(name for name in records[0] if all(name in record for record in records))
    before = [(number, (_plain(line),)) for number, line in lines[: starts[0]]]
    rows = [
        (lines[start][0], tuple(record[name] for name in names))
        for start, record in zip(starts, records, strict=True)
    ]
    listed = listed_names([line for _, line in lines[: starts[0] + 1]], len(names))
    if not listed and not has_words:
        # Numbers alone are a table, whose header says what they are.
        return _Columns()
    return _Columns(listed or names, tuple(rows), tuple(before))


def _join_stamp(record: dict[str, str]) -> None:
    """Replace the seconds and nanoseconds of a stamp of ROS by its time in s, with all its digits."""
    for whole, part in (("secs", "nsecs"), ("sec", "nanosec")):
        if whole in record and part in record:
            record["stamp [s]"] = f"{record.pop(whole)}.{int(record.pop(part)):09d}"


def _named(lines: Sequence[str]) -> Iterator[list[_Named]]:
    """The numbers in each of several lines that are alike, with the words that all of them have as
    names: "bounce 1: 62.2 cm" has the bounce and its height.
    """
    parted = [list(_parts(line)) for line in lines]
    names: list[str] = []
    whole: list[str] = []
    name = ""
    clocks = [i for i, (_, number, _) in enumerate(parted[0]) if ":" in number]
    # Of a label, the begin and the end; a clock alone is of touches where its times are a train.
    of_clocks = ("start", "stop") if len(clocks) > 1 else ("touch",)
    if len(clocks) == 1 and _are_laps([[number for _, number, _ in line] for line in parted]):
        of_clocks = ("interval",)
        # By its number a list with the newest lap first is turned.
        names.append("bounce")
    for i, places in enumerate(zip(*parted, strict=True)):
        befores = [before for before, _, _ in places]
        is_named = i < len(names)
        whole.append(_plain(_repeated(befores)))
        words = _phrase(whole[i], _unit_after(befores[0], places[0][2]))
        if i in clocks:
            is_changed = meanings_of(places[0][2]) & CHANGES
            words = words if role_of(words) else of_clocks[min(clocks.index(i), 1)]
            words = "other" if is_changed else words
        elif counts([line[i][1] for line in parted]) and meanings_of(words) <= {"?"}:
            # "Ben: 1st bounce 62 cm"
            words = "number"
        elif meanings_of(words) or not name:
            name = words
        else:
            words = name
        if not is_named:
            names.append(words)
    units = [[_unit_after(before, after) for before, _, after in line] for line in parted]
    for i in range(len(names) - 1):
        # "-4.2 -> 2.9 m/s"
        if names[i] == names[i + 1] and _ARROW.search(parted[0][i + 1][0]):
            names[i : i + 2] = [f"{names[i]} before", f"{names[i]} after"]
            for each in units:
                each[i] = each[i] or each[i + 1]
    for line, each in zip(parted, units, strict=True):
        yield [
            _Named(f"{name} [{unit}]" if unit else name, number, words if _letters(words) else name)
            for name, unit, words, (_, number, _) in zip(names, each, whole, line, strict=True)
        ]


def _are_laps(rows: Sequence[Sequence[str]]) -> bool:
    """Say whether rows are the laps of a stopwatch, the newest or the oldest first: a number that counts,
    and a time with hundredths that shrinks from one lap to the next, as flights of a ball do.
    """
    if len(rows) < _LEAST or any(len(row) != 2 for row in rows):
        return False
    numbers = [row[0] for row in rows]
    if not numbers[0].isdigit() or not re.fullmatch(r"(?:\d+:)+\d+[.,]\d+", rows[0][1]):
        return False
    laps = [re.split(":", time.replace(",", ".")) for _, time in rows]
    times = [sum(float(x) * 60.0**k for k, x in enumerate(lap[::-1])) for lap in laps]
    if int(numbers[0]) > 1:
        numbers, times = numbers[::-1], times[::-1]
    is_of_ball = counts(numbers) and times[0] < _LONGEST_LAP
    return is_of_ball and all(b < a for a, b in itertools.pairwise(times))


def _parts(line: str) -> Iterator[tuple[str, str, str]]:
    """The words before each number in a line, the number, and the words after it."""
    found = list(_NUMBER.finditer(line))
    ends = [0, *(match.end() for match in found)]
    starts = [*(match.start() for match in found), len(line)]
    for i, match in enumerate(found):
        yield line[ends[i] : starts[i]], match[0], line[ends[i + 1] : starts[i + 1]]


def _unit_after(before: str, after: str) -> str:
    """The unit after a number, "" for none; a number in quotes has none."""
    unit = re.match(r"\s*[\[(]?([^\W\d_][^\s,;<>\"')\]]*|[\"'″′%])", after)
    is_quoted = before.endswith(("'", '"'))
    return unit[1] if unit and not is_quoted and is_unit(plain_unit(unit[1])) else ""


def _repeated(texts: Sequence[str]) -> str:
    """The words of the first text that all of the texts have; "other" where one is apart from them,
    as in "steel: bounce height", which tells of several balls.
    """
    others = [set(_letters(text)) for text in texts[1:]]
    parts = re.split(rf"([^\w{_VOWELS}]+)", texts[0])
    kept = [all(word in other for word in _letters(part) for other in others) for part in parts]
    changing = "".join(parts[: len(parts) - kept[::-1].index(False)] if not all(kept) else [])
    if changing and re.search(r"[:,;].*[^\W\d]", texts[0][len(changing) :]):
        return "other"
    return "".join(itertools.compress(parts, kept))


def _phrase(words: str, unit: str) -> str:
    """The part of a name after a sign, where that alone has a role: the name of the sender, or of the
    program, goes before it.
    """
    # <time unit="s">, <value name="height (cm)">
    given = re.search(r"\s+\w+ = (\S+)$", words)
    if given is not None and is_unit(plain_unit(given[1])):
        words = f"{words[: given.start()]} [{given[1]}]"
    words = re.sub(r"^\w+ (?:name|label|title|key) = ", "", words)
    signs = [match.end() for match in re.finditer(r"[\]):;,]\s", words)]
    # "lost, height"
    signs = [at for at in signs if not meanings_of(words[:at]) & CHANGES]
    ways = [words[at:].strip() for at in (0, *signs)]
    headers = {way: f"{way} [{unit}]" if unit else way for way in ways}
    known = (way for way in ways if role_of(*split_header(headers[way])) or is_beside(way))
    return next(known, words)


def _plain(text: str) -> str:
    """Words without the signs of programs and markup about them; one sign "=" stays between words."""
    words = re.sub(r"->|</?|[>\"'|]+", " ", re.sub(r"\s*=\s*[\"']?", " = ", text))
    return words.strip(" :=,;([{-@\t")


def _of_lists(text: str) -> _Columns:
    """Columns of the lists of numbers in a text: those with the same signs between one and the next,
    such as "[0.32, 0.61]", "- 0.32" in lines, or "320 * ms," in Go.

    A name that comes again begins another drop: a column "drop" then has the drop of each row.
    Nothing is read where other words tell such lists apart, as those of two balls.
    """
    drops: list[dict[str, list[str]]] = [{}]
    for label, own, numbers in _named_lists(text):
        # The name of all may be too far above.
        is_of_drop = tells_drops_apart(label)
        name = own or (next(iter(drops[0]), "") if is_of_drop else "")
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
    rows: list[Row] = []
    for number, drop in enumerate(drops, 1):
        of_drop = (str(number),) if len(drops) > 1 else ()
        padded = itertools.zip_longest(*drop.values(), fillvalue="")
        rows += [(1, (*of_drop, *row)) for row in padded]
    # The rate of frames and samples stands somewhere else in the text.
    is_counted = any(role_of(name) in _COUNTED for name in names)
    others = [line for line in text.splitlines() if len(_IN_LIST.findall(line)) < _LEAST]
    about = [(1, (line,)) for line in others] if is_counted else []
    return _Columns((*(["drop"] if len(drops) > 1 else []), *names), tuple(rows), tuple(about))


def _named_lists(text: str) -> Iterator[tuple[str, str, list[str]]]:
    """Each list of numbers in a text, after the word before it and the name there, as of `_name_of`."""
    found = list(_IN_LIST.finditer(text))
    gaps = [
        _BETWEEN.sub(" ", text[a.end() : b.start()]).strip() for a, b in itertools.pairwise(found)
    ]
    for first, at, period in (*_runs(gaps, 1), *_runs(gaps, 2)):
        gap = gaps[first]
        numbers = [match[0] for match in found[first : at + 1]]
        before = text[: found[first].start()].rstrip().removesuffix(gap).rstrip()
        # A list is in brackets, or after a sign: numbers below a header are a table.
        if (not gap or period > 1) and before[-1:] not in _OPENING:
            continue
        if period > 1 and not counts(numbers[::2]):
            continue
        inside = text[found[first].end() : found[at].start()]
        is_over = text[: found[first].start()].rstrip(" \t")[-1:] in ("=", ":")
        if is_over and inside.count("\n") == at - first:
            # "rows: 1" is over a column, and no part of it.
            continue
        # Up to the next name in the line.
        after = re.split(r"[\n:]", text[found[at].end() : found[at].end() + _BEFORE], maxsplit=1)[0]
        label, name = _name_of(before[-_BEFORE:], f"{gap.replace('.', ' ')} {after}")
        yield label, name, numbers[period - 1 :: period]


def _runs(gaps: Sequence[str], period: int) -> Iterator[tuple[int, int, int]]:
    """First and last numbers of lists whose gaps are the same again after `period`, and the period: 2
    of "{1: 0.32, 2: 0.61}".
    """
    at = 0
    for is_same, group in itertools.groupby(a == b for a, b in zip(gaps, gaps[period:])):  # noqa: B905
        first, at = at, at + len(list(group))
        last = at + period
        if is_same and last - first >= period * _LEAST_LISTED - 1:
            yield first, last, period


def _without_types(text: str) -> str:
    """The words of a text without those of programs before a list."""
    return " ".join(word for word in _WORD.findall(text) if not _OF_PROGRAMS.fullmatch(word))


def _name_of(before: str, after: str) -> tuple[str, str]:
    """The word between a list and the last name of a column before it, such as "drop 2", and that name
    with a unit that stands near it; "" for none, or where the last name is of something else, such as
    heights lost.
    """
    *_, line = before.splitlines()
    if meanings_of(_without_types(line)) & CHANGES:
        return "", ""
    plain = re.sub(r"\(|<[^<>\n]*>", " ", before).replace("#", ":")
    phrases = map(_without_types, _SIGNS.split(plain)[::-1])
    label = ""
    for phrase in filter(None, phrases):
        name, unit = split_header(phrase)
        role = role_of(name, unit)
        if role in _COUNTED:
            return label, name
        if role in QUANTITY_OF:
            # Of several lists, each has its unit after it.
            near = [*re.findall(r"[^\W\d_][\w/]*", after), *reversed(_WORD.findall(before))]
            found = (one for one in near if is_unit_of(plain_unit(one), QUANTITY_OF[role]))
            unit = unit or next(found, "")
            return label, f"{name} [{unit}]" if unit else name
        label = label or phrase
        known = {one for one in meanings_of(name) if one != "?" and not one.isdigit()}
        if known - {"group"} and not is_beside(name):
            break
    return label, ""
