"""`hcbench.report`: a study in, its page with tables and figures out."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hcbench.benchmark.results import Results
from hcbench.benchmark.study import find_study, is_built_in, load_study, name_of
from hcbench.system.errors import UserError
from hcbench.system.files import atomic_folder, read_text
from hcbench.system.process import IS_COMMAND
from hcbench.system.text import Drawn
from hcbench.terms.arguments import checked
from hcbench.terms.options import Jobs
from hcbench.workers import WorkerPool

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from hcbench.benchmark.study import Run, Study

Tick = Callable[[int, int], None]
Stage = Callable[[str], AbstractContextManager[Tick]]


@dataclass(frozen=True, repr=False)
class StudyReport(Drawn):
    """A report that was written: `page` is its HTML, `results` its tables."""

    page: Path
    results: Results

    def _lines(self) -> list[str]:
        return [f"page: {self.page}", *self.results._lines()]

    def to_frame(self) -> pd.DataFrame:
        """The scores: a row a setting, α and step, SI."""
        return self.results.to_frame()

    def plot(self) -> Figure:
        """Restitution over impact speed, of the law and of every setting."""
        return self.results.plot()

    def _repr_html_(self) -> str:
        return self.results._repr_html_()


@checked
def report(
    study: str | Path = "steel-1lb",
    *,
    out: str | Path | None = None,
    quick: bool = False,
    jobs: Jobs = 1,
) -> StudyReport:
    """Run a study and write its page, with tables and figures, as `hcbench report` does.

    Parameters
    ----------
    study : path or text
        A study.toml, its folder, the folder of a finished sweep, or a built-in name.
    out : path, optional
        Folder to write to; reports/NAME, or reports/NAME-quick, by default.
    quick : bool
        Preview with one α and fewer speeds, phases and steps.
    jobs : int
        Worker processes.

    Returns
    -------
    StudyReport
        `page` is the path of its page; `results` has the tables, SI.

    Raises
    ------
    UserError
        For a study that cannot be read, what an engine refuses, and a folder with a file in the
        way that hcbench did not write; other files in it stay.
    CannotRun
        Where an engine is not installed, unless the study is built in, and where a worker fails.
    OutputError
        For a folder that cannot be written.

    Examples
    --------
    >>> import hcbench as hb
    >>> written = hb.report("study.toml", out="report")
    >>> written.page.name, len(written.results.impacts)
    ('index.html', 2)

    """

    def warn(line: str) -> None:
        warnings.warn(line, stacklevel=5)

    return write_report(str(study), None if out is None else Path(out), quick, jobs, _silent, warn)


def _skip_help_of_drawing() -> None:
    """In a command, let matplotlib write no help for the properties of each thing that it draws: it
    takes a third of its import, and no command shows it.
    """
    if not IS_COMMAND.get():
        return
    from matplotlib.artist import Artist

    name = "_update_set_signature_and_docstring"
    if hasattr(Artist, name):
        setattr(Artist, name, lambda: None)


@contextmanager
def _silent(_: str) -> Iterator[Tick]:
    yield lambda done, total: None


def write_report(
    study: str,
    out: Path | None,
    quick: bool,
    jobs: int,
    stage: Stage,
    warn: Callable[[str], None],
    device: str = "",
) -> StudyReport:
    """Write a report: run a study, or read a finished sweep, and write its page with tables and
    figures.

    study: a path, the folder of a finished sweep, or a built-in name.
    out: the folder; None: the default one.
    quick: a preview; a finished sweep is always shown whole.
    jobs: worker processes.
    stage: shows, by a name, how far a part of the work is.
    warn: takes a line on each thing that was left out.
    device: of the engines, "" for any.

    Raises UserError for a study that cannot be read, what an engine refuses, a folder with a file
    in the way that hcbench did not write, a device with a sweep that has run, and a folder that
    holds a report with engines that are missing now; CannotRun where an engine is not installed,
    unless the study is built in, and where a worker fails; OutputError for a folder that cannot be
    written.
    """
    with WorkerPool(jobs) as pool:
        with stage("reading the study"):
            from hcbench.benchmark.read import is_sweep, read
            from hcbench.benchmark.run import run_in_pool

            # While this process imports what draws the page.
            pool.begin("importlib", "import_module", "hcbench.benchmark.shard")
            _skip_help_of_drawing()
            from hcbench.reporting.build import build
            from hcbench.reporting.page import PAGE

            swept = is_sweep(study)
            if swept and device:
                raise UserError("--device", "given with a sweep that has run", "a study")
            plan = None
            missing: tuple[str, ...] = ()
            if swept:
                name = Path(study).resolve().name
            else:
                name, plan = find_plan(study, warn, device)
                missing = plan.missing
            default = default_folder(name, quick)
            folder = folder_for(out, default, missing, engines_in(out or default))
        if plan is None:
            with stage("reading the sweep"):
                results = read(study, pool.map)
            with stage("drawing") as tick:
                return StudyReport(build(results, folder, pool, tick), results)
        with atomic_folder(folder, PAGE) as scratch:
            with stage("impacts") as tick:
                if quick:
                    plan = plan.quick()
                results = run_in_pool(pool, plan, tick)
            with stage("drawing") as tick:
                build(results, scratch, pool, tick, folder)
    return StudyReport(folder / PAGE, results)


def find_plan(name: str, warn: Callable[[str], None], device: str = "") -> tuple[str, Study]:
    """The name of a study, and the study. A built-in one is without the engines that are not
    installed, and every one without the plug-ins that cannot be compiled, with a line to `warn`.

    name: of a file, a folder or a built-in study.
    device: that the engines compute on; "" for any.
    Raises StudyError for a name that no study has, a file that is not a study, and where no engine
    of a built-in study is installed; SceneError for a scene that cannot be read; NotCompiled where
    nothing but such plug-ins is in it.
    """
    path = find_study(name)
    study = load_study(path)
    if is_built_in(path):
        missing = missing_engines(dict.fromkeys(run.engine for run in study.runs), warn)
        study = study.of_engines(lambda engine: engine not in missing)
    study = _without_uncompiled(study, warn)
    return name_of(path), dataclasses.replace(study, device=device)


def _without_uncompiled(study: Study, warn: Callable[[str], None]) -> Study:
    """A study without the runs of plug-ins that cannot be compiled here, with a line to `warn`.

    Raises NotCompiled where nothing else is in it, and UserError for an engine or a recipe that is
    not known.
    """
    from hcbench.sim import registry
    from hcbench.sim.capabilities import HasPlugin
    from hcbench.system.compiler import NotCompiled

    # By engine, the runs that need its plug-in.
    plugged: dict[str, list[Run]] = {}
    for run in study.runs:
        recipe = registry.recipe(f"{run.engine}.{run.recipe}")
        if not recipe.native:
            plugged.setdefault(run.engine, []).append(run)
    for name, with_plugin in plugged.items():
        # Of an engine in an environment of its own only the adapter says what it has.
        if not isinstance(registry.adapter(name), HasPlugin):
            continue
        engine = registry.engine(name)
        assert isinstance(engine, HasPlugin), "an environment wraps what its adapter has"
        try:
            engine.plugin()
        except NotCompiled as error:
            runs = tuple(run for run in study.runs if run not in with_plugin)
            if not runs:
                raise
            warn(f"left out, not compiled: the plug-in of {name}. {error}")
            study = dataclasses.replace(study, runs=runs)
    return study


def missing_engines(engines: Iterable[str], warn: Callable[[str], None]) -> tuple[str, ...]:
    """Engines that are not installed, of these; where there are any, `warn` takes a line with the
    commands that add them.
    """
    from hcbench.sim import install, registry

    missing = tuple(name for name in engines if not registry.is_there(name))
    if missing:
        commands = "; ".join(install.add_commands(missing))
        warn(f"left out, not installed: {', '.join(missing)}. Add: {commands}")
    return missing


def default_folder(name: str, quick: bool) -> Path:
    """The folder of a report without --out; that of a preview is another."""
    return Path("reports") / (f"{name}-quick" if quick else name)


def folder_for(
    out: Path | None, default: Path, missing: tuple[str, ...], present: set[str]
) -> Path:
    """The folder of a report, never one that holds engines that this report lacks.

    out: the user's; None: `default`, or in place of it one whose name tells the missing engines.
    missing: engines that the report lacks.
    present: those of the report that is in the folder.
    Raises UserError where the user's folder would lose engines.
    """
    folder = out or default
    if not (lost := present & set(missing)):
        return folder
    if out is None:
        return default.with_name(f"{default.name}-without-{'-'.join(missing)}")
    engines = ", ".join(sorted(lost))
    raise UserError(
        "--out", f"{out} holds a report with {engines}, now not installed", "another folder"
    )


def engines_in(folder: Path) -> set[str]:
    """Engines of the report in a folder, by its scores.csv; empty without one that can be read."""
    import csv

    try:
        lines = read_text(folder / "scores.csv").splitlines()
        return {row["engine"] for row in csv.DictReader(lines)}
    except (OSError, ValueError, LookupError, csv.Error):
        return set()
