"""hcbench sweep: a study of any size into a folder of Parquet parts."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hcbench.cli._process import PathType
from hcbench.cli.console import jobs_option, progress

if TYPE_CHECKING:
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
    "--resume", is_flag=True, help="Go on with what is in the folder; whole parts are not run again."
)
@click.option("--scheduler", help="Address of a Dask scheduler, tcp://HOST:8786, to run on its workers.")
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
    with progress("impacts") as tick:

        def report(now: Progress) -> None:
            tick(now.impacts, now.of)

        done = run(plan, folder, jobs=jobs, resume=resume, scheduler=scheduler, progress=report)
    for number in done.damaged:
        print(f"part {number} was cut short or edited: put aside in _damaged and run again", file=sys.stderr)
    print(folder)
