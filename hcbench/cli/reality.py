"""hcbench report reality: engines against measured impacts."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hcbench.cli.console import progress
from hcbench.cli.outputs import PathType
from hcbench.errors import UserError

if TYPE_CHECKING:
    from hcbench.reality.study import Request

NAME = "reality"
_OPTIONS = (
    click.option("--sets", help="Of the study `reality`: some of its data sets, such as cube,ellipse."),
    click.option(
        "--data",
        type=PathType(path_type=Path, file_okay=False, exists=True),
        help="Of the study `reality`: folder of a data set's original repository, or of several.",
    ),
    click.option(
        "--part",
        type=click.IntRange(0, 4),
        help="Of the study `reality`: judge tosses with number % 5 = PART.",
    ),
    click.option("--identify", is_flag=True, help="Of the study `reality`: search the parameters again."),
)


def reality_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Gives `report` the options that the study `reality` alone has."""
    return reduce(lambda made, option: option(made), reversed(_OPTIONS), command)


def require_none(options: dict[str, Any]) -> None:
    """UserError for an option of the study `reality` with another study."""
    for name, value in options.items():
        if value:
            raise UserError(f"--{name}", "given with another study", f"the study `{NAME}`")


def report_reality(
    out: Path | None, jobs: int, sets: str | None, data: Path | None, part: int | None, identify: bool
) -> Path:
    """Run the study and write its page; the page."""
    from hcbench.workers import WorkerPool

    with WorkerPool(jobs) as pool:
        pool.begin("importlib", "import_module", "hcbench.reality.study")
        from hcbench.reality.build import build
        from hcbench.reality.study import run

        request = _request(sets, data, part, identify)
        folder = out or Path("reports") / NAME
        with progress("settings") as tick:
            return build(run(request, pool, tick), folder)


def _request(sets: str | None, data: Path | None, part: int | None, identify: bool) -> Request:
    from hcbench.reality import sources
    from hcbench.reality.cells import SETS, require_sets
    from hcbench.reality.study import Request

    chosen = require_sets(sets) if sets else list(SETS)
    folders = {name: sources.find(name, data) for name in chosen}
    for name in chosen:
        if folders[name] is None and (advice := sources.missing(name)):
            if sets:
                raise UserError("--data", f"has no {name}" if data else "not given", advice)
            print(f"left out: {name}. Add: --data, {advice}", file=sys.stderr)
    if part == 4 and "cube" in chosen and folders["cube"] is None:
        raise UserError("--part", "4, which is not shipped", "--data with the folder of DAIRLab/contact-nets")
    known = [name for name in chosen if folders[name] is not None or not sources.missing(name)]
    return Request(known, folders, part, identify)
