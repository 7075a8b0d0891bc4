"""What the commands share: options, tables, JSON, progress."""

from __future__ import annotations

import json
import math
import os
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

CORES = os.cpu_count() or 1

as_json = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
jobs_option = click.option(
    "--jobs", "-j", type=click.IntRange(min=1), default=CORES, help="Worker processes.  [default: one a core]"
)


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr that stays away where nobody looks; hands out `tick(done, total)`."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda done, total: None
        return
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def print_json(content: Any) -> None:
    """JSON with null for what is not a number."""
    print(json.dumps(_no_nan(content), indent=1, ensure_ascii=False, allow_nan=False))


def _no_nan(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _no_nan(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_no_nan(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def print_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Columns to the right, two spaces between."""
    widths = [max(len(line[i]) for line in [list(header), *rows]) for i in range(len(header))]
    for line in [list(header), *rows]:
        print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))
