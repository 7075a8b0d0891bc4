"""The gauge of plain English: phrases and names that may not occur, each with what to say instead."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

import hcbench

ROOT = Path(hcbench.__file__).parents[1]

# Pattern (case is ignored, white space is one space) -> what to say.
PHRASES = {
    r"\bbeside each other\b": "side by side",
    r"\bas (it|they|one) comes?\b": "with nothing set / the default",
    r"\b(is|are|was|were) told\b": "name the agent: hcbench reports, prints, warns",
    r"\b(is|are|was|were) said\b": "name the agent: hcbench reports, prints, warns",
    r"\b(that|which) (is|are|was|were) there\b": "installed / available / present",
    r"\bnobody\b": "no one; better: name who does not, or use 'not' and a passive",
    r"\banew\b": "again / from the start",
    r"\b(flies|is flown|are flown)\b": "simulates",
    r"\b(lent|lender'?s?)\b": "shared model; name the engine that compiles it",
    r"\bborrow(s|ed|er|ers|ing)?\b": "steps the model of another engine",
    r"\bwhatever\b": "any / regardless of",
    r"\bwhat else than\b": "other than",
    r"\bby the same door\b": "in the same way",
    r"\btook off\b": "removed from / lost to",
    r"\bturn(s|ed|ing)? round\b": "reverses",
    r"\bat the most\b(?! likely)": "at most",
    r"\benergy from nothing\b": "the contact adds energy",
    r"\benergy out of nothing\b": "the contact adds energy",
    r"\blaw put in\b": "plug-in",
    r"\brobots'? steps\b": "time steps of 1 ms and more",
    r"\bline to beat\b": "best constant e",
    r"\bthe moving ones?\b": "the first body / the body that moves",
    r"\bcomes? (in )?from above\b": "approaches from above",
    r"\bgoes on as it came\b": "keeps its momentum",
    r"\bwho( \w+){0,5} is given\b": "say what the user gets: 'By default ...'",
    r"\bknow:": "Notes:",
    r"\blook at: ": "check: ",
    r"\bcannot tell:": "undecided:",
    r"\bwhich it has a way in for\b": "which this engine supports",
    r"\bto fall by\b": "gravity",
    r"\bas without a command\b": "Same as plain ...",
    r"\b(is|are|was|were) (off|out) by\b": "is wrong by",
    r"\bas wanted\b": "the target",
    r"\bwanted bounce\b": "the target",
    r"\bwithout a word\b": "without a warning",
    r"\bhardly slows\b": "is slowed too little",
    r"\bby luck\b": "by chance; by the phase of the step",
    r"\bnext to (no|nothing)\b": "almost no / nothing",
    r"\b(a|the) touch falls( decides)?[.:]": "the contact starts; varies with the phase of the step",
    r"\berrs by\b": "is wrong by",
    r"\boutlive any\b": "survive",
    r"\b(is|are) of this step\b": "holds at this step",
    r"\bnot-a-number\b": "NaN",
    r"\ba limit (was )?passed\b(?! its)": "a limit was exceeded",
}

# Names in code -> better ones.
NAMES = {
    "heavy": "with_gravity",
    "free": "without_gravity",
    "told": "reported",
    "found": "what was found: pairs, paths, match, ...",
    "todo": "advice",
    "traps": "caveats",
    "remark": "note",
    "as_felt": "with_measured_load",
    "lender": "the engine that compiles the model",
}

# Where a name has another sense: joints are free there.
OTHER_SENSE = {("hcbench/engines", "free")}

SUFFIXES = (".py", ".md", ".html", ".js", ".css", ".toml", ".yml", ".c", ".h", ".mplstyle")
BESIDE = ("docs", "examples", "benchmarks", "scenes")
FILES = (
    *sorted(ROOT.glob("*.md")),
    ROOT / "Makefile",
    ROOT / "action.yml",
    *(
        p
        for folder in ("hcbench", *BESIDE)
        for p in sorted((ROOT / folder).rglob("*"))
        if p.suffix in SUFFIXES and "_build" not in p.parts
    ),
)


def _room(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return "/".join(parts[:2]) if parts[0] == "hcbench" else parts[0]


ROOMS = sorted({_room(p) for p in FILES})


def _strings(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """(line, text) of every string, a formatted one whole with {} for its fields."""
    parts = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            text = "".join(str(v.value) if isinstance(v, ast.Constant) else "{}" for v in node.values)
            yield node.lineno, text
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
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
        yield from _strings(ast.parse(text))
        yield from _comments(text)
    else:
        yield 1, text


def _hits(line: int, text: str) -> Iterator[str]:
    for pattern, better in PHRASES.items():
        spaced = re.compile(pattern.replace(" ", r"[\s*/#]+"), re.IGNORECASE)
        for match in spaced.finditer(text):
            where = line + text.count("\n", 0, match.start())
            yield f"{where}: {' '.join(match.group().split())!r}: say: {better}"


def _named(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """(line, name) of every name that code binds."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id


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


@pytest.mark.parametrize("room", ROOMS)
def test_a_name_says_what_it_is(room: str) -> None:
    hits = [
        f"{path.relative_to(ROOT)}:{line}: {name!r}: say: {NAMES[name.strip('_')]}"
        for path in FILES
        if _room(path) == room and path.suffix == ".py"
        for line, name in _named(ast.parse(path.read_text(encoding="utf-8")))
        if name.strip("_") in NAMES and (room, name.strip("_")) not in OTHER_SENSE
    ]
    assert not hits, "\n".join(hits)


PAGES = sorted(p for p in FILES if p.suffix == ".md")
NO_PROSE = re.compile(r"^ *```.*?^ *```$|^<!--.*?-->$|^ *\|.*?$|^#.*?$|^!\[.*?$", re.MULTILINE | re.DOTALL)
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


def test_the_gauge_notices() -> None:
    assert next(_hits(1, "An error\nis\n    told.")).startswith("2: 'is told'")
    assert not list(_hits(1, "A free joint and the flight of a ball are right English."))
    assert list(_named(ast.parse("def f(heavy): todo = 1")))[1:] == [(1, "heavy"), (1, "todo")]
