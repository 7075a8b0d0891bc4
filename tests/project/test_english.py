"""Plain English by its shape: first words of docstrings, sentences,
paragraphs and numbers of pages.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import hcbench

ROOT = Path(hcbench.__file__).parents[1]

# Shapes that a reader has to read twice -> what to write instead. Case counts, white space is one
# space. An editor shows the first words of a docstring alone: they have rules of their own.
FIRST_WORDS = {
    r"(What|Whether|Where|How|Why|When|Who|Which|That|As|Of|Its?)\b": "begin with a noun or a verb",
    r"((The |An? )?\w+'s?|Theirs|Ours)[.,;:]": "name the thing: a possessive alone has no noun",
}
SENTENCES = {
    r"(?<!here\s)\b(is|are|was|were) no (?!(longer|better|more|less)\b)[a-z]+": "'is not a ...'",
    r"\bknows? none\b": "name what is missing: 'has no recipe for ... here'",
    r"(^|[.;:] )It (without|with|of|in|by|from)\b": "name the thing: 'The study without ...'",
    r"\b(is|are|was|were) (told|said|lent|flown)\b": "name who does it: 'hcbench reports ...'",
    r"\bas [`\w.]+ (has|have) (it|them)\b": "'see `X`', or say it here",
    r"\b(is|are) theirs\b": "name the thing, or say what decides it",
    r"\b(nothing|none) of what\b|\bnone do(es)? not\b|\bwhere even\b": "one negation: 'empty if ...'",
    r"\b(is|are|was|were) (off|out) by\b|\berrs? by\b": "'is wrong by'",
}
SPACED = {
    re.compile(pattern.replace(" ", r"[\s*/#]+"), re.MULTILINE): better
    for pattern, better in SENTENCES.items()
}

SUFFIXES = (".py", ".md", ".html", ".toml", ".yml", ".c", ".h", ".mplstyle")
BESIDE = ("docs", "examples", "benchmarks", "scenes")
FILES = (
    *sorted(ROOT.glob("*.md")),
    ROOT / "Makefile",
    ROOT / "action.yml",
    *(
        p
        for folder in ("hcbench", "tests", *BESIDE)
        for p in sorted((ROOT / folder).rglob("*"))
        if p.suffix in SUFFIXES and "_build" not in p.parts and p != Path(__file__)
    ),
)


def _room(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return "/".join(parts[:2]) if parts[0] == "hcbench" else parts[0]


ROOMS = sorted({_room(p) for p in FILES})
CODE_ROOMS = sorted({_room(p) for p in FILES if p.suffix == ".py"})


Text = tuple[int, str]


@cache
def _read(path: Path) -> tuple[list[Text], list[Text]]:
    """(line, text) of every string and every docstring of a file of Python."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    return list(_strings(nodes)), list(_docstrings(nodes))


def _strings(nodes: list[ast.AST]) -> Iterator[Text]:
    """(line, text) of every string, a formatted one whole with {} for its fields."""
    parts = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            text = "".join(
                str(v.value) if isinstance(v, ast.Constant) else "{}" for v in node.values
            )
            yield node.lineno, text
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts
        ):
            yield node.lineno, node.value


def _comments(text: str) -> Iterator[tuple[int, str]]:
    """(line, text) of every block of comments."""
    block: list[tuple[int, str]] = []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            if block and token.start[0] != block[-1][0] + 1:
                yield block[0][0], " ".join(line for _, line in block)
                block = []
            block.append((token.start[0], token.string.lstrip("# ")))
    if block:
        yield block[0][0], " ".join(line for _, line in block)


def _texts(path: Path) -> Iterator[tuple[int, str]]:
    """(line, text) of all that a reader of the file reads."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        strings, _ = _read(path)
        yield from strings
        yield from _comments(text)
    else:
        yield 1, text


def _docstrings(nodes: list[ast.AST]) -> Iterator[Text]:
    """(line, text) of every docstring."""
    for node in nodes:
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text is not None:
                yield node.body[0].lineno, text


def _hits(line: int, text: str) -> Iterator[str]:
    """Sentences of a text that have a shape of SENTENCES, each with its line."""
    for spaced, better in SPACED.items():
        for match in spaced.finditer(text):
            where = line + text.count("\n", 0, match.start())
            yield f"{where}: {' '.join(match.group().split())!r}: write: {better}"


def _openings(line: int, docstring: str) -> Iterator[str]:
    """The first words of a docstring, if they have a shape of FIRST_WORDS."""
    for pattern, better in FIRST_WORDS.items():
        if re.match(pattern, docstring):
            yield f"{line}: {' '.join(docstring.split()[:6])!r}: {better}"


@pytest.mark.parametrize("room", ROOMS)
def test_a_text_says_it_plainly(room: str) -> None:
    hits = [
        f"{path.relative_to(ROOT)}:{hit}"
        for path in FILES
        if _room(path) == room
        for line, text in _texts(path)
        for hit in _hits(line, text)
    ]
    assert not hits, "\n".join(hits)


@pytest.mark.parametrize("room", CODE_ROOMS)
def test_a_docstring_begins_with_a_noun_or_a_verb(room: str) -> None:
    hits = [
        f"{path.relative_to(ROOT)}:{hit}"
        for path in FILES
        if path.suffix == ".py" and _room(path) == room
        for line, text in _read(path)[1]
        for hit in _openings(line, text)
    ]
    assert not hits, "\n".join(hits)


PAGES = sorted(p for p in FILES if p.suffix == ".md")
NO_PROSE = re.compile(
    r"^ *```.*?^ *```$|^<!--.*?-->$|^ *\|.*?$|^#.*?$|^!\[.*?$", re.MULTILINE | re.DOTALL
)
CODE = re.compile(r"^ *```.*?^ *```$|<!--.*?-->|`[^`]*`|not \.028", re.MULTILINE | re.DOTALL)
PARAGRAPH = re.compile(r"\n\s*\n|\n(?= *(?:[-*]|\d+\.) )")
NO_ZERO = re.compile(r"(?<=[\s(±=<>|])\.\d+(?![\dgfe])")


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_a_page_is_easy_to_scan(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    prose = NO_PROSE.sub("\n", text)
    long = [line for line in prose.splitlines() if len(line) > 100]
    assert not long, f"more than 100 columns: {long}"
    heavy_going = [part for part in PARAGRAPH.split(prose) if len(part.split()) > 60]
    assert not heavy_going, f"more than 60 words: {heavy_going}"
    bare = NO_ZERO.findall(CODE.sub("", text))
    assert not bare, f"a number has its zero: {bare}"


@pytest.mark.parametrize(
    "docstring",
    [
        "That the two were in each other at the start, by that many m.",
        "The adapter's.",
        "The engine's, there; installed into the environment.",
        "What was added.",
        "Whether this process is a worker that hcbench started.",
        "How a body lies after its path has calmed.",
        "It without the runs of engines that are not there.",
        "As of `Impact`.",
        "Its unit.",
    ],
)
def test_the_gauge_notices_a_docstring_without_a_noun(docstring: str) -> None:
    assert list(_openings(1, docstring))


@pytest.mark.parametrize(
    "sentence",
    [
        "x.json is no baseline",
        "'auto' knows none for 'x'",
        "The study. It without the runs of engines that are not there.",
        "An error\nis\n    told.",
        "Motion along the plate as `Record.tangential` has it.",
        "Others keys are theirs.",
        "Median e of impacts at one vertex; nothing of what no impact tells.",
        "or as many as need no throw upwards; where even none do not, it falls",
    ],
)
def test_the_gauge_notices_a_sentence_to_read_twice(sentence: str) -> None:
    assert list(_hits(1, sentence))


@pytest.mark.parametrize(
    "sentence",
    [
        "x.json is not a baseline.",
        "'auto' has no recipe for 'x' here.",
        "The study without the runs whose engine is missing.",
        "There is no gravity, and the contact is no longer stiff.",
        "The engine's settings are those of the robot's floor.",
    ],
)
def test_the_gauge_lets_a_plain_sentence_pass(sentence: str) -> None:
    assert not list(_hits(1, sentence))
    assert not list(_openings(1, sentence))


def test_the_gauge_names_the_line() -> None:
    assert next(_hits(1, "An error\nis\n    told.")).startswith("2: 'is told'")
