"""hcbench report: a study in, a page out."""

from pathlib import Path

import click

from hcbench.cli._process import PathType
from hcbench.cli.console import jobs_option, progress


@click.command()
@click.argument("study", default="steel-1lb", type=PathType())
@click.option("--out", type=PathType(path_type=Path), help="Folder to write to.  [default: reports/NAME]")
@click.option("--quick", is_flag=True, help="Fewer speeds, phases and steps: a preview.")
@jobs_option
def report(study: str, out: Path | None, quick: bool, jobs: int) -> None:
    """Run a study and write its page.

    With tables and figures beside it.

    STUDY is a study.toml, its folder, or a built-in name; or the folder of a finished sweep.
    """
    from hcbench._files import atomic_folder
    from hcbench.benchmark.read import is_sweep, read
    from hcbench.benchmark.run import run_in_pool
    from hcbench.benchmark.study import find_study, load_study, name_of
    from hcbench.report.build import build
    from hcbench.report.page import PAGE
    from hcbench.workers import WorkerPool

    if is_sweep(study):
        folder = out or Path("reports") / Path(study).resolve().name
        with WorkerPool(jobs) as pool:
            build(read(study), folder, pool)
        print(folder / "index.html")
        return
    path = find_study(study)
    plan = load_study(path).quick() if quick else load_study(path)
    folder = out or Path("reports") / name_of(path)
    with atomic_folder(folder, PAGE) as scratch, WorkerPool(jobs) as pool:
        with progress("impacts") as tick:
            results = run_in_pool(pool, plan, tick)
        build(results, scratch, pool)
    print(folder / "index.html")
