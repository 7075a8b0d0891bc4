"""hcbench report, sweep and paper: a study in, a page or tables out; and
Hunt & Crossley 1975 as a page.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hcbench.cli.console import MASS, PathType, device_option, jobs_option, progress
from hcbench.cli.help import command
from hcbench.cli.sweep_model import model_options, require_study, sweep_a_model
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from hcbench.benchmark.run import Progress
    from hcbench.reality.study import RealityRequest

# hcbench report reality: engines against measured impacts.

NAME = "reality"
_OPTIONS = (
    click.option(
        "--sets", help="Of the study `reality`: some of its data sets, such as cube,ellipse."
    ),
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
    click.option(
        "--poses",
        type=PathType(path_type=Path, dir_okay=False, exists=True),
        multiple=True,
        help="Of the study `reality`: judge engines by your own toss: a CSV of t, x, y, z, qw, qx, qy, qz.",
    ),
    click.option("--size", help="With --poses: three edges of the box, such as '0.1 0.1 0.1' (m)."),
    click.option("--mass", type=MASS, help="With --poses: mass of the box, such as 0.37 kg."),
    click.option(
        "--model",
        type=PathType(path_type=Path, dir_okay=False, exists=True),
        help="With --poses: an MJCF file whose first box is the body, in place of --size and --mass.",
    ),
    click.option(
        "--inertia", help="With --poses: one or three moments, kg m².  [default: of a solid box]"
    ),
    click.option(
        "--identify", is_flag=True, help="Of the study `reality`: search the parameters again."
    ),
)


def reality_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Gives `report` the options that the study `reality` alone has."""
    return reduce(lambda made, option: option(made), reversed(_OPTIONS), command)


def require_none(options: dict[str, Any], expected: str = f"the study `{NAME}`") -> None:
    """Raise UserError for an option that was given: not None, not False and not ().

    expected: what the options belong to, for the error.
    """
    for name, value in options.items():
        # Compared with == a number 0, which was given, would be False.
        if value is not None and value is not False and value != ():
            raise UserError(f"--{name}", "given without what it belongs to", expected)


def _report_own(
    paths: tuple[Path, ...],
    *,
    size: str | None,
    mass: float | None,
    inertia: str | None,
    model: Path | None,
    identify: bool,
    out: Path | None,
    jobs: int,
) -> Path:
    """Read the user's poses of a box, judge the settings by them, and write the report; return its
    folder.

    paths: files of poses.
    size, inertia: of the box, three numbers each, as typed.
    mass: kg.
    model: a file with the box in place of these; without it size and mass are needed.
    identify: whether to search the parameters of the settings on these poses.
    out: folder of the report; None: reports/ and the name of the first file.
    jobs: worker processes.
    Raises UserError for missing numbers and for files that cannot be read.
    """
    from hcbench.workers import WorkerPool

    if model is not None:
        require_none({"size": size, "mass": mass, "inertia": inertia}, "poses without --model")
    elif size is None or mass is None:
        missing = "--size" if size is None else "--mass"
        raise UserError(missing, "not given", "the box's, or --model")
    with WorkerPool(jobs) as pool:
        pool.begin("importlib", "import_module", "hcbench.reality.study")
        from hcbench.reality.page import build_own
        from hcbench.reality.poses import box, box_of, judge, read, text

        if model is not None:
            body = box_of(model)
        else:
            body = box(
                _numbers("--size", size or ""), mass or 0.0, _numbers("--inertia", inertia or "")
            )
        with progress("settings") as tick:
            own = judge(read(paths, body), pool, identify, tick)
    folder = out or Path("reports") / paths[0].stem
    build_own(own, folder)
    print("\n".join(text(own, folder)))
    return folder


def report_reality(
    out: Path | None,
    jobs: int,
    sets: str | None,
    data: Path | None,
    part: int | None,
    poses: tuple[Path, ...],
    size: str | None,
    mass: float | None,
    inertia: str | None,
    model: Path | None,
    identify: bool,
) -> Path:
    """Run the study of measured impacts and write its page; return the page's path. Of a user's own
    poses: print and write what they tell, and return the folder.

    out: folder; None for the default.
    jobs: worker processes.
    sets: names of data sets, with commas.
    data: folder of one set.
    part: number of the part, of five, to judge.
    poses: files of a user's own box.
    size, inertia: of that box, as typed.
    mass: its, kg.
    model: a file with it in place of these.
    identify: search parameters on the data, too.
    Raises UserError for options that do not go together, and what the study raises.
    """
    from hcbench.workers import WorkerPool

    if poses:
        require_none(
            {"sets": sets, "data": data, "part": part is not None}, f"`{NAME}` without --poses"
        )
        return _report_own(
            poses,
            size=size,
            mass=mass,
            inertia=inertia,
            model=model,
            identify=identify,
            out=out,
            jobs=jobs,
        )
    require_none({"size": size, "mass": mass, "inertia": inertia, "model": model}, "--poses")

    with WorkerPool(jobs) as pool:
        pool.begin("importlib", "import_module", "hcbench.reality.study")
        from hcbench.reality.page import build
        from hcbench.reality.study import run

        request = _request(sets, data, part, identify)
        folder = out or Path("reports") / NAME
        with progress("settings") as tick:
            return build(run(request, pool, tick), folder)


def _request(
    sets: str | None, data: Path | None, part: int | None, identify: bool
) -> RealityRequest:
    """The request of a study of measured impacts: its data sets, with their folders.

    sets: names with commas between them, None for all.
    data: folder of one set, None for the places where hcbench looks.
    part: number of the part of the data to judge; None: the validation parts.
    identify: whether to search parameters on the data, too.
    A set whose data are missing is left out with a line to stderr; data of another version than the
    study's get a warning there.
    Raises UserError where a set was asked for by name, and for the held-out part without its data.
    """
    from hcbench.reality import data_sets
    from hcbench.reality.cube import HELD_OUT
    from hcbench.reality.data_sets import SETS, require_sets
    from hcbench.reality.study import RealityRequest

    chosen = require_sets(sets) if sets else list(SETS)
    folders = {name: data_sets.find(name, data) for name in chosen}
    for name in chosen:
        if folders[name] is None and (advice := data_sets.missing(name)):
            if sets:
                got = "not given"
                if data:
                    got = f"has no {name}"
                raise UserError("--data", got, advice)
            print(f"left out: {name}. Add: --data, {advice}", file=sys.stderr)
    for name, folder in folders.items():
        if folder is not None and data_sets.differs(name, folder):
            print(
                f"warning: {name}: {folder} has another version of {data_sets.SOURCES[name].path}",
                file=sys.stderr,
            )
    if part == HELD_OUT and "cube" in chosen and folders["cube"] is None:
        got = f"{HELD_OUT}, which is not shipped"
        raise UserError("--part", got, "--data with the folder of DAIRLab/contact-nets")
    known = [name for name in chosen if folders[name] is not None or not data_sets.missing(name)]
    return RealityRequest(known, folders, part, identify)


def _numbers(option: str, text: str) -> list[float]:
    """Numbers with spaces or commas between them."""
    try:
        return [float(part) for part in text.replace(",", " ").split()]
    except ValueError:
        raise UserError(option, repr(text), "numbers in SI, such as '0.1 0.1 0.1'") from None


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
    `hcbench report reality --help` adds the options of that study.
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
@model_options
def sweep(
    study: str,
    out: str | None,
    jobs: int,
    resume: bool,
    device: str | None,
    scheduler: str | None,
    **of_model: Any,
) -> None:
    """Run a study, or measure a model under many contacts, in parts.

    Finished parts survive an interruption. Together they are one table
    for pandas and `hcbench report`.

    STUDY is a study.toml, its folder, or a built-in name. The folder's
    _summary.csv is kept up to date. With --vary it is a model: MJCF, or FILE.py:FUNCTION.
    """
    if of_model["vary"]:
        # Without --resume, too: what is there is of the same rows, and stays.
        sweep_a_model(study, out, jobs, scheduler, device, **of_model)
        return
    require_study(of_model, study)
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
        from hcbench.paper.page import build, engines_drawn_in
        from hcbench.paper.vibroimpact_figures import engines_with_two_blocks
        from hcbench.reporting.ask import default_folder, folder_for, missing_engines

        missing = missing_engines(engines_with_two_blocks(), _warn)
    default = default_folder("paper", quick)
    folder = folder_for(out, default, missing, engines_drawn_in(out or default))
    with progress("figures") as tick:
        page = build(folder, quick=quick, jobs=jobs, tick=tick)
    print(page)
