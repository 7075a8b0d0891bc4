"""Output for a person at a terminal: lines of at most 100 columns, verdicts in colour, progress."""

from __future__ import annotations

import os
import re
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import click

from hcbench.system.text import COLUMNS, sanitized

WIDTH = COLUMNS
_COLOURS = {
    "PASSED": "green",
    "MEASURED": "cyan",
    "FAILED": "red",
    "MISTAKE": "yellow",
    "COULD NOT RUN": "red",
}
_VERDICT = re.compile(rf"^({'|'.join(_COLOURS)})\b", re.MULTILINE)
# The text before the value in a line `name   value`.
_NAME = re.compile(r"\S.*?\s{2,}(?=\S)")
# A call without texts, which may be broken after its commas.
_CALL = re.compile(r"\s*[\w.]+\([^'\"#]*\)")
# Seconds of silence after which hcbench names its work.
_AFTER_S = 0.5


def show(text: str) -> None:
    """Print a text: lines folded to 100 columns, and verdicts in colour unless NO_COLOR is set.

    Characters that move a cursor, as a model's names may have them, are each a "?".
    """
    lines = "\n".join(folded([sanitized(line, len(line)) for line in text.split("\n")]))
    print(_VERDICT.sub(_coloured, lines) if has_colour() else lines)


def show_code(text: str) -> None:
    """Print lines of a text to paste: long tags are broken between attributes, long calls after
    commas.
    """
    for line in text.split("\n"):
        lines: Iterable[str] = [line]
        if len(line) > WIDTH:
            if line.lstrip().startswith("<"):
                lines = _folded_tag(line)
            elif _CALL.fullmatch(line):
                lines = _folded_call(line)
        print("\n".join(lines))


def has_colour() -> bool:
    """Say whether standard output is a terminal that may have colour (https://no-color.org)."""
    return (
        sys.stdout.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    )


def _coloured(match: re.Match[str]) -> str:
    return click.style(match[1], fg=_COLOURS[match[1]], bold=True)


def folded(lines: list[str]) -> Iterator[str]:
    """The lines, those of more than 100 columns broken: commands by
    backslashes, tags between attributes.
    """
    for line in lines:
        if len(line) <= WIDTH:
            yield line
        elif re.match(r"\s*(hcbench|next:) ", line):
            yield from _folded_command(line)
        elif re.match(r"\s*<", line):
            yield from _folded_tag(line)
        else:
            name = _NAME.match(line)
            lead = len(line) - len(line.lstrip())
            is_item = lead > 0 or re.match(r"- |[\w ,:.-]+: ", line) is not None
            after = name.end() if name and name.end() <= WIDTH // 2 else lead + 2 * is_item
            yield from textwrap.wrap(
                line, WIDTH, subsequent_indent=" " * after, break_long_words=False,
                break_on_hyphens=False, drop_whitespace=True, replace_whitespace=False,
            )  # fmt: skip


def _folded_command(line: str) -> Iterator[str]:
    """Broken before options, so that a shell reads one command."""
    *lines, last = _joined(re.split(r" (?=--)", line), line, " ", room=2)
    yield from (f"{each} \\" for each in lines)
    yield last


def _folded_tag(line: str) -> Iterator[str]:
    """Broken before attributes, which XML allows; a comment between words."""
    return _joined(re.split(r" (?=\S)" if "<!--" in line else r" (?=[\w:]+=\")", line), line, " ")


def _folded_call(line: str) -> Iterator[str]:
    """Broken after commas within the brackets of a call."""
    return _joined(re.split(r"(?<=,) ", line), line, " ")


def _joined(parts: list[str], line: str, by: str, room: int = 0) -> Iterator[str]:
    """Fill lines with parts, joined by `by`; all but the first line are indented by four more than
    `line` is.

    line: from which the parts are. room: columns to leave free. The indent is less where the
    longest part would not fit; a part that is longer than the terminal stays too long.
    """
    longest = max(map(len, parts[1:]), default=0)
    lead = " " * max(0, min(len(line) - len(line.lstrip()) + 4, WIDTH - room - longest))
    now = parts[0]
    for part in parts[1:]:
        if len(now) + len(by) + len(part) > WIDTH - room:
            yield now
            now = f"{lead}{part}"
        else:
            now = f"{now}{by}{part}"
    yield now


@contextmanager
def status(what: str) -> Iterator[None]:
    """While the work lasts, a line on a terminal says what it is and since when; nothing elsewhere.

    A thread writes it, by the system's own call: it holds no lock that a
    fork of this process could miss.
    """
    if not sys.stderr.isatty():
        yield
        return
    over = threading.Event()
    begin = time.monotonic()

    def write() -> None:
        wait = _AFTER_S
        while not over.wait(wait):
            os.write(2, f"\r{what} ... {time.monotonic() - begin:.0f} s".encode())
            wait = 1.0

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    try:
        yield
    finally:
        over.set()
        writer.join()
        os.write(2, b"\r\x1b[K")


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on stderr with rate and time left, on a terminal; yields `tick(done, total)`.

    what: is under way, in words, beside the bar. At 100 % the bar becomes indeterminate, since
    writing takes time too. Without a terminal `tick` does nothing.
    """
    # Asked before the import of Rich, which takes a while and takes more kinds of output for
    # terminals.
    if not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done, total: None
        return
    columns = (
        *(TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[count]}")),
        *(TextColumn("{task.fields[rate]}"), TimeElapsedColumn(), TimeRemainingColumn()),
    )
    with Progress(*columns, console=console, transient=True, speed_estimate_period=120.0) as bar:
        task = bar.add_task(what, total=None, rate="", count="")
        first: list[tuple[float, int]] = []

        def tick(done: int, total: int) -> None:
            """Move the bar to `done` of `total`; the rate is that since the first call."""
            first[:] = first or [(time.monotonic(), done)]
            elapsed = time.monotonic() - first[0][0]
            new = done - first[0][1]
            rate = f"{new / elapsed:,.0f}/s" if new else ""
            bar.update(task, completed=done, total=total, count=f"{done}/{total}", rate=rate)
            if done >= total:
                bar.update(task, description=f"{what}: putting together", rate="")
                # A bar without a total moves from end to end.
                bar.tasks[0].total = None

        yield tick
