"""Sessions in pages: ```console blocks of `$ command` and its output, which are run and compared.

`python -m sessions [PAGE ...]` (`make sessions`) writes what the commands print now. In a block, a
line `...` stands for lines that the page leaves out, and `...` within a line for the rest or a part
of it: what a writer left out, or what another machine prints differently (`MACHINE`). Numbers are
compared by value (`same_text`).
"""

from __future__ import annotations

import io
import os
import re
import shlex
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from difflib import SequenceMatcher
from functools import cache
from pathlib import Path
from typing import NamedTuple

import notebooks
from same_text import LEFT_OUT, is_same

from hcbench.cli import run

ROOT = Path(__file__).parents[2]
PAGES = (
    ROOT / "README.md",
    ROOT / "examples" / "README.md",
    *(p for p in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in p.parts),
)
BLOCK = re.compile(r"(?<=^```console\n).*?(?=^```$)", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"\.(xml|wav|csv|toml|json|html|py|urdf)\b|^--out$")
MACHINE = (
    r"\b\d+\.\d+\.\d+\b",  # versions
    r"(?<=[\s'\"])/(?:[\w.+-]+/)+[\w.+-]*",  # absolute paths
    r"\b\d+ MB\b",  # sizes
    r"(?<=time of a step, µs)[\s\d.]+$",
)


class Step(NamedTuple):
    """A command as a page has it, with its lines, and the output that the page shows."""

    command: str
    shown: tuple[str, ...]

    @property
    def words(self) -> list[str]:
        """Words that a shell would give the program."""
        return shlex.split(self.command.replace("\\\n", " "), comments=True)


def steps(block: str) -> list[Step]:
    """The commands of a block; a line that ends with a backslash goes on in the next."""
    found: list[tuple[list[str], list[str]]] = []
    for line in block.splitlines():
        if line.startswith("$ "):
            found.append(([line[2:]], []))
        elif not found[-1][1] and found[-1][0][-1].endswith("\\"):
            found[-1][0].append(line)
        else:
            found[-1][1].append(line)
    return [Step("\n".join(command), tuple(shown)) for command, shown in found]


def page_steps(page: Path) -> list[Step]:
    """All commands of a page's sessions."""
    return [
        step for block in BLOCK.findall(page.read_text(encoding="utf-8")) for step in steps(block)
    ]


def prepare(page: Path, folder: Path) -> Path:
    """The folder in which a page's commands run: the examples, or a
    folder that has them in `examples`.
    """
    if page.parent.name == "examples":
        shutil.copytree(ROOT / "examples", folder, dirs_exist_ok=True)
    else:
        shutil.copytree(ROOT / "examples", folder / "examples")
        (folder / "scenes").symlink_to(ROOT / "scenes")
    return folder


class Shell:
    """Runs commands in the present folder; `printed` gives a command's lines, errors among them."""

    def __init__(self) -> None:
        self.code = 0

    def printed(self, step: Step) -> list[str]:
        """The lines that a command prints. `echo $?` gives the exit code of the one before."""
        name, *arguments = step.words
        if name == "echo":
            return [str(self.code)]
        if name == "cat":
            return Path(arguments[0]).read_text(encoding="utf-8").splitlines()
        if name == "python" and arguments[0] == "-c":
            return _lines(lambda: exec(arguments[1], {}))
        assert name == "hcbench", (
            f"a session runs hcbench, python -c, cat and echo alone: {step.command}"
        )
        files = [word for word in arguments if FILE.search(word)]
        if any(not word.startswith("examples/") for word in files):
            self.code, lines = _run(arguments)
        else:
            self.code, lines = _run_once(*arguments)
        return lines


@cache
def _run_once(*arguments: str) -> tuple[int, list[str]]:
    """Lines of a command that several pages may show: it reads the
    examples alone, and writes nothing.
    """
    return _run(list(arguments))


def _run(arguments: list[str]) -> tuple[int, list[str]]:
    """Exit code and lines of a command."""
    codes = list[int]()
    lines = _lines(lambda: codes.append(run(arguments)))
    return codes[0], lines


def _lines(action: Callable[[], object]) -> list[str]:
    """Lines that an action prints."""
    text = io.StringIO()
    with redirect_stdout(text), redirect_stderr(text):
        action()
    return [line.rstrip() for line in text.getvalue().rstrip("\n").splitlines()]


def agrees(shown: tuple[str, ...], printed: list[str]) -> bool:
    """Say whether a page shows the output of a command."""
    end = 0
    for start, part in _places(shown, printed):
        new = printed[start : start + len(part)]
        if start < end or len(new) < len(part) or not all(map(is_same, part, new)):
            return False
        end = start + len(part)
    return LEFT_OUT in shown or end == len(printed)


def rewritten(shown: tuple[str, ...], printed: list[str]) -> list[str]:
    """Text for a page from the lines that a command printed: the same parts as before, or all of
    it.
    """
    if LEFT_OUT not in shown:
        return [next((old for old in shown if is_same(old, new)), elided(new)) for new in printed]
    lines, end = list[str](), 0
    for start, part in _places(shown, printed):
        first = max(start, end)
        new = printed[first : first + len(part)]
        gap = [LEFT_OUT] if first > end else []
        lines += gap + [
            next((old for old in part if is_same(old, line)), elided(line)) for line in new
        ]
        end = first + len(new)
    return lines + [LEFT_OUT] * (end < len(printed))


def _places(shown: tuple[str, ...], printed: list[str]) -> Iterator[tuple[int, list[str]]]:
    """The parts between the lines that a page leaves out, each with the
    line that begins it most likely.
    """
    text = "\n".join(shown)
    parts = [
        part.split("\n")
        for each in re.split(r"^\.\.\.$", text, flags=re.M)
        if (part := each.strip("\n"))
    ]
    end = 0
    for part in parts:
        last = max(end, len(printed) - len(part))
        if part is parts[0] and shown[0] != LEFT_OUT:
            start = 0
        elif part is parts[-1] and shown[-1] != LEFT_OUT:
            start = last
        else:
            start = max(range(end, last + 1), key=lambda i: _likeness(part, printed[i:]))
        yield start, part
        end = start + len(part)


def _likeness(old: list[str], new: list[str]) -> float:
    return sum(_alike(a, b) for a, b in zip(old, new, strict=False))


def _alike(old: str, new: str) -> float:
    """2 for the same line, 1.5 for one that begins in the same way, and below 1 for another."""
    if is_same(old, new) or new.startswith(old):
        return 2.0 if is_same(old, new) else 1.5
    return SequenceMatcher(None, old, new).ratio()


def elided(line: str) -> str:
    """A line without what another machine prints differently."""
    return re.sub("|".join(MACHINE), LEFT_OUT, line)


def update(page: Path) -> bool:
    """Write what the commands of a page print now. Whether the page changed."""
    old = page.read_text(encoding="utf-8")
    shell = Shell()

    def new(match: re.Match[str]) -> str:
        lines = []
        for step in steps(match[0]):
            printed = shell.printed(step)
            shown = (
                list(step.shown) if agrees(step.shown, printed) else rewritten(step.shown, printed)
            )
            lines += [f"$ {step.command}", *shown]
        return "\n".join(lines) + "\n"

    with tempfile.TemporaryDirectory() as folder, chdir(prepare(page, Path(folder))):
        text = BLOCK.sub(new, old)
    page.write_text(text, encoding="utf-8")
    return text != old


if __name__ == "__main__":
    os.environ["HCBENCH_DATA"] = os.devnull
    for path in [Path(name).absolute() for name in sys.argv[1:]] or [*PAGES, *notebooks.PAGES]:
        changed = notebooks.update(path) if path.suffix == ".ipynb" else update(path)
        print("changed" if changed else "same", path.relative_to(ROOT))
