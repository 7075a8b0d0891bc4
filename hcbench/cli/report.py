"""hcbench report, sweep and paper: a study in, a page or tables out; and
Hunt & Crossley 1975 as a page.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hcbench.cli.console import device_option, jobs_option
from hcbench.cli.help import command
from hcbench.cli.outputs import PathType
from hcbench.cli.reality import NAME, reality_options, report_reality, require_none
from hcbench.cli.terminal import progress
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from hcbench.benchmark.run import Progress


def _warn(line: str) -> None:
    print(line, file=sys.stderr)


@command()
@click.argument("study", default="steel-1lb", type=PathType())
@click.option(
    "--out",
    type=PathType(path_type=Path),
    help="Folder to write to.  [default: reports/NAME, or NAME-quick]",
)
@click.option(
    "--quick", is_flag=True, help="Preview with one α and fewer speeds, phases and steps."
)
@jobs_option
@device_option
@reality_options
def report(
    study: str, out: Path | None, quick: bool, jobs: int, device: str | None, **of_reality: Any
) -> None:
    """Run a study and write its page.

    Write tables and figures beside the page.

    STUDY is a study.toml, its folder, or a built-in name; or the folder of a finished sweep.
    """
    if study == NAME:
        if quick:
            raise UserError("--quick", f"given with `{NAME}`", "--sets, for fewer data sets")
        if device:
            raise UserError("--device", f"given with `{NAME}`", "the name of a study")
        print(report_reality(out, jobs, **of_reality))
        return
    require_none(of_reality)
    with progress("starting"):
        from hcbench.reporting.ask import write_report
    print(write_report(study, out, quick, jobs, progress, _warn, device or "").page)


@command()
@click.argument("study", type=PathType())
@click.option(
    "--out",
    type=PathType(),
    help="Folder to write to: a path, or an URL such as s3://...  [default: sweeps/NAME]",
)
@jobs_option
@click.option(
    "--resume",
    is_flag=True,
    help="Continue the sweep in the folder; finished parts are not run again.",
)
@device_option
@click.option(
    "--scheduler", help="Address of a Dask scheduler, tcp://HOST:8786, to run on its workers."
)
def sweep(
    study: str, out: str | None, jobs: int, resume: bool, device: str | None, scheduler: str | None
) -> None:
    """Run a study of any size, in parts.

    Finished parts survive an interruption. Together they are one table
    for pandas and `hcbench report`.

    STUDY is a study.toml, its folder, or a built-in name. The folder's
    _summary.csv is kept up to date.
    """
    with progress("reading the study"):
        from hcbench.benchmark.run import sweep as run
        from hcbench.reporting.ask import find_plan

        name, plan = find_plan(study, _warn, device or "")
    folder = out or str(Path("sweeps") / name)
    with progress("impacts") as tick:

        def report(now: Progress) -> None:
            tick(now.impacts, now.of)

        done = run(plan, folder, jobs=jobs, resume=resume, scheduler=scheduler, progress=report)
    for number in done.damaged:
        print(
            f"part {number} was cut short or edited: put aside in _damaged and run again",
            file=sys.stderr,
        )
    print(folder)


@command()
@click.option(
    "--out",
    type=PathType(path_type=Path),
    help="Folder to write to.  [default: reports/paper, or paper-quick]",
)
@click.option("--quick", is_flag=True, help="Preview with fewer parameters in the forced figures.")
@jobs_option
def paper(out: Path | None, quick: bool, jobs: int) -> None:
    """Redraw and check Hunt and Crossley 1975.

    Redraw every figure, and compute every number that the paper prints.
    """
    with progress("starting"):
        from hcbench.paper.build import build, engines_drawn_in
        from hcbench.paper.engines import engines_with_two_blocks
        from hcbench.reporting.ask import default_folder, folder_for, missing_engines

        missing = missing_engines(engines_with_two_blocks(), _warn)
    default = default_folder("paper", quick)
    folder = folder_for(out, default, missing, engines_drawn_in(out or default))
    with progress("figures") as tick:
        page = build(folder, quick=quick, jobs=jobs, tick=tick)
    print(page)
