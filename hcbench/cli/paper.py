"""hcbench paper: Hunt & Crossley 1975 as a page."""

from pathlib import Path

import click

from hcbench.cli._process import PathType
from hcbench.cli.console import jobs_option, progress


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
