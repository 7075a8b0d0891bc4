"""hcbench report, sweep and paper: a study in, a page or tables out; and Hunt & Crossley 1975 as a page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hcbench.cli.console import jobs_option, progress
from hcbench.cli.outputs import PathType
from hcbench.cli.reality import NAME, reality_options, report_reality, require_none
from hcbench.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from hcbench.benchmark.run import Progress
    from hcbench.benchmark.study import Study


def _load(name: str) -> tuple[str, Study]:
    """A study and its name. A built-in one leaves out engines that are not installed; a line says so."""
    from hcbench.benchmark.study import find_study, is_built_in, load_study, name_of

    path = find_study(name)
    study = load_study(path)
    if is_built_in(path):
        missing = _missing(dict.fromkeys(run.engine for run in study.runs))
        study = study.of_engines(lambda engine: engine not in missing)
    return name_of(path), study


def _missing(engines: Iterable[str]) -> tuple[str, ...]:
    """Those of some engines that are not installed; a line says so, with the commands that add them."""
    from hcbench.sim import install, registry

    missing = tuple(name for name in engines if not registry.is_there(name))
    if missing:
        commands = "; ".join(install.add_commands(missing))
        print(f"left out, not installed: {', '.join(missing)}. Add: {commands}", file=sys.stderr)
    return missing


def _default_folder(name: str, quick: bool) -> Path:
    """Where a report goes unless said: a preview not in place of the whole."""
    return Path("reports") / (f"{name}-quick" if quick else name)


def _folder(out: Path | None, default: Path, missing: tuple[str, ...], there: set[str]) -> Path:
    """Where a report goes: not in place of one that has engines that this one lacks."""
    folder = out or default
    if not (lost := there & set(missing)):
        return folder
    if out is None:
        return default.with_name(f"{default.name}-without-{'-'.join(missing)}")
    engines = ", ".join(sorted(lost))
    raise UserError("--out", f"{out} holds a report with {engines}, now not installed", "another folder")


def _engines_in(folder: Path) -> set[str]:
    """The engines of the report in a folder; none where there is no report."""
    import csv

    from hcbench._files import read_text

    try:
        return {row["engine"] for row in csv.DictReader(read_text(folder / "scores.csv").splitlines())}
    except (OSError, ValueError, LookupError, csv.Error):
        return set()


@click.command()
@click.argument("study", default="steel-1lb", type=PathType())
@click.option(
    "--out", type=PathType(path_type=Path), help="Folder to write to.  [default: reports/NAME, or NAME-quick]"
)
@click.option("--quick", is_flag=True, help="Preview with one α and fewer speeds, phases and steps.")
@jobs_option
@reality_options
def report(study: str, out: Path | None, quick: bool, jobs: int, **of_reality: Any) -> None:
    """Run a study and write its page.

    Write tables and figures beside the page.

    STUDY is a study.toml, its folder, or a built-in name; or the folder of a finished sweep.
    """
    if study == NAME:
        if quick:
            raise UserError("--quick", f"given with `{NAME}`", "--sets, for fewer data sets")
        print(report_reality(out, jobs, **of_reality))
        return
    require_none(of_reality)
    from hcbench._files import atomic_folder
    from hcbench.benchmark.read import is_sweep, read
    from hcbench.workers import WorkerPool

    swept = is_sweep(study)
    name, plan = (Path(study).resolve().name, None) if swept else _load(study)
    default = _default_folder(name, quick)
    folder = _folder(out, default, plan.missing if plan else (), _engines_in(out or default))
    with WorkerPool(jobs) as pool:
        # While this process imports what draws the page.
        pool.begin("importlib", "import_module", "hcbench.benchmark.shard")
        from hcbench.benchmark.run import run_in_pool
        from hcbench.reporting.build import build
        from hcbench.reporting.page import PAGE

        if plan is None:
            build(read(study, pool.map), folder, pool)
        else:
            plan = plan.quick() if quick else plan
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
    "--resume", is_flag=True, help="Continue the sweep in the folder; finished parts are not run again."
)
@click.option("--scheduler", help="Address of a Dask scheduler, tcp://HOST:8786, to run on its workers.")
def sweep(study: str, out: str | None, jobs: int, resume: bool, scheduler: str | None) -> None:
    """Run a study of any size, in parts.

    Finished parts survive an interruption. Together they are one table for pandas and `hcbench report`.

    STUDY is a study.toml, its folder, or a built-in name. The folder's _summary.csv is kept up to date.
    """
    from hcbench.benchmark.run import sweep as run

    name, plan = _load(study)
    folder = out or str(Path("sweeps") / name)
    with progress("impacts") as tick:

        def report(now: Progress) -> None:
            tick(now.impacts, now.of)

        done = run(plan, folder, jobs=jobs, resume=resume, scheduler=scheduler, progress=report)
    for number in done.damaged:
        print(f"part {number} was cut short or edited: put aside in _damaged and run again", file=sys.stderr)
    print(folder)


@click.command()
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
    from hcbench.paper.build import build, engines_drawn_in
    from hcbench.paper.engines import engines_with_two_blocks

    missing = _missing(engines_with_two_blocks())
    default = _default_folder("paper", quick)
    folder = _folder(out, default, missing, engines_drawn_in(out or default))
    with progress("figures") as tick:
        page = build(folder, quick=quick, jobs=jobs, tick=tick)
    print(page)
