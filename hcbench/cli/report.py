"""hcbench report, sweep and paper: a study in, a page or tables out; and Hunt & Crossley 1975 as a page."""

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
@click.argument("study", default="steel-1lb", type=PathType())
@click.option("--out", type=PathType(path_type=Path), help="Folder to write to.  [default: reports/NAME]")
@click.option("--quick", is_flag=True, help="One α, fewer speeds, phases and steps: a preview.")
@jobs_option
def report(study: str, out: Path | None, quick: bool, jobs: int) -> None:
    """Run a study and write its page.

    With tables and figures beside it.

    STUDY is a study.toml, its folder, or a built-in name; or the folder of a finished sweep.
    """
    from hcbench._files import atomic_folder
    from hcbench.benchmark.read import is_sweep, read
    from hcbench.benchmark.study import find_study, load_study, name_of
    from hcbench.workers import WorkerPool

    swept = is_sweep(study)
    path = Path(study).resolve() if swept else find_study(study)
    folder = out or Path("reports") / (path.name if swept else name_of(path))
    with WorkerPool(jobs) as pool:
        # While this process imports what draws the page.
        pool.begin("importlib", "import_module", "hcbench.benchmark.shard")
        from hcbench.benchmark.run import run_in_pool
        from hcbench.reporting.build import build
        from hcbench.reporting.page import PAGE

        if swept:
            build(read(study, pool.map), folder, pool)
        else:
            plan = load_study(path).quick() if quick else load_study(path)
            with atomic_folder(folder, PAGE) as scratch:
                with progress("impacts") as tick:
                    results = run_in_pool(pool, plan, tick)
                build(results, scratch, pool)
    print(folder / "index.html")


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


@click.command()
@click.option(
    "--out", type=PathType(path_type=Path), default=Path("reports/paper"), show_default=True,
    help="Folder to write to.",
)  # fmt: skip
@click.option("--quick", is_flag=True, help="Fewer parameters in the forced figures: a preview.")
@jobs_option
def paper(out: Path, quick: bool, jobs: int) -> None:
    """Redraw and check Hunt and Crossley 1975.

    Every figure is redrawn, and every number that it prints is computed again.
    """
    from hcbench.paper.build import build

    with progress("figures") as tick:
        page = build(out, quick=quick, jobs=jobs, tick=tick)
    print(page)
