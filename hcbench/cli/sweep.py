"""hcbench sweep: a study of any size into a folder of Parquet parts."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hcbench.cli._process import PathType
from hcbench.cli.console import jobs_option

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from hcbench.benchmark.run import Progress


@click.command()
@click.argument("study", type=PathType())
@click.option(
    "--out",
    type=PathType(),
    help="Folder to write to: a path, or an URL such as s3://...  [default: sweeps/NAME]",
)
@jobs_option
@click.option(
    "--resume", is_flag=True, help="Go on with what is in the folder; whole parts are not flown again."
)
@click.option("--scheduler", help="Address of a Dask scheduler, tcp://HOST:8786, to fly on its workers.")
def sweep(study: str, out: str | None, jobs: int, resume: bool, scheduler: str | None) -> None:
    """Run a study of any size, in parts.

    Parts that are whole outlive any end; together they are one table for pandas and `hcbench report`.

    STUDY is a study.toml, its folder, or a built-in name. The folder's _summary.csv is kept up to date.
    """
    from hcbench.benchmark.run import sweep as run
    from hcbench.benchmark.study import find_study, load_study, name_of

    path = find_study(study)
    plan = load_study(path)
    folder = out or str(Path("sweeps") / name_of(path))
    with _bar() as tick:
        done = run(plan, folder, jobs=jobs, resume=resume, scheduler=scheduler, progress=tick)
    for number in done.damaged:
        print(
            f"part {number} was cut short or edited: put aside in _damaged and flown again", file=sys.stderr
        )
    print(folder)


@contextmanager
def _bar() -> Iterator[Callable[[Progress], None]]:
    """A bar on stderr with rate and time left, that stays away where nobody looks."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda _: None
        return
    columns = (
        TextColumn("impacts"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Bar(*columns, console=console, speed_estimate_period=120.0) as bar:
        task = bar.add_task("impacts", total=None, rate="")
        began: list[tuple[float, int]] = []

        def tick(now: Progress) -> None:
            began[:] = began or [(time.monotonic(), now.impacts)]
            passed, flown = time.monotonic() - began[0][0], now.impacts - began[0][1]
            rate = f"{flown / passed:,.0f}/s" if flown else ""
            bar.update(task, completed=now.impacts, total=now.of, rate=rate)

        yield tick
