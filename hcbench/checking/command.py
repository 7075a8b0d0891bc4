"""`hcbench.check`: runs the checks of a model, of a file or of a study, as CI does, and writes
their results to files.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from hcbench.checking.judge import judge_results, run_checks
from hcbench.checking.outcome import Outcome, Report, Verdict
from hcbench.checking.spec import Check, CheckSpec, plan, read_max_error
from hcbench.checking.text import as_junit, as_markdown, checks_in, table_in
from hcbench.measuring.request import read_limit, read_pair
from hcbench.system.errors import OutputError, UserError
from hcbench.system.outputs import require_outputs, write_output
from hcbench.system.text import sanitized
from hcbench.terms.arguments import checked
from hcbench.terms.fields import read_toml, validate
from hcbench.terms.options import BodyPair, CheckOptions, Jobs, PintQuantity

if TYPE_CHECKING:
    from hcbench.checking.outcome import Report


if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.measuring.measurement import Measurement

    Progress = Callable[[int, int], None] | None

DEFAULT_FILE = "pyproject.toml"


@dataclass(frozen=True, slots=True)
class Outputs:
    """Files to write; None: not at all.

    force: replace files that hcbench did not write.
    """

    junit: Path | None = None
    markdown: Path | None = None
    png: Path | None = None
    baseline: Path | None = None
    force: bool = False

    @property
    def files(self) -> dict[str, Path]:
        """The files to write, by the options that name them."""
        files = {"junit": self.junit, "markdown": self.markdown, "png": self.png}
        files["write-baseline"] = self.baseline
        return {f"--{name}": path for name, path in files.items() if path is not None}


def run_spec(
    spec: CheckSpec,
    outputs: Outputs | None = None,
    jobs: int = 1,
    progress: Progress = None,
    measure_only: bool = False,
) -> Report:
    """Run the checks that a specification names, and write files of the results.

    spec.models: () for the [tool.hcbench] of ./pyproject.toml; a TOML file with such a table; a
    study or the folder of its report; else a model.
    jobs: worker processes, for a study.
    progress: called with (done, in all).
    measure_only: no check may have a target; else, unless a baseline is written, each needs one.
    Raises UserError for what cannot be planned, and OutputError for what cannot be written.
    """
    outputs = outputs or Outputs()
    given = spec.models or (DEFAULT_FILE,)
    require_outputs(outputs.files, [*given, *spec.options.values()], outputs.force)
    if outputs.baseline is not None and spec.options["baseline"] is not None:
        raise UserError("baseline", "--baseline and --write-baseline", "one of the two")
    report = _run(spec, outputs, jobs, progress, measure_only)
    _write(report, outputs)
    return report


def _run(
    spec: CheckSpec, outputs: Outputs, jobs: int, progress: Progress, measure_only: bool
) -> Report:
    """The report on a model, on each check of a TOML file, or on a study or its results.

    jobs: worker processes, for a study.
    progress: called with (done, in all).
    measure_only: no check may have a target.
    Raises UserError for a spec that cannot be planned, before anything runs. Errors of single
    checks become outcomes.
    """
    models = spec.models or (DEFAULT_FILE,)
    source = Path(models[0])
    is_toml = source.suffix.lower() == ".toml"
    if len(models) == 1 and is_toml:
        if not spec.models and not source.is_file():
            raise UserError("checks", f"no model, and no {DEFAULT_FILE} here", "a model to check")
        content = read_toml(source, UserError, "checks")
        table = table_in(content, source)
        # A TOML file that is neither is taken for checks, whose errors say how to write some.
        if table is not None or not _is_study(content):
            checks = _listed(table, source, spec)
            return run_checks(_planned(checks, outputs, measure_only), progress)
    if len(models) == 1 and (is_toml or source.is_dir()):
        if outputs.baseline is not None:
            raise UserError("write-baseline", f"given with {source}, a study", "a model to check")
        if measure_only:
            got = f"given with {source}, a study, whose settings have targets"
            raise UserError("measure-only", got, "a model to measure")
        return _check_study(source, spec, jobs, progress)
    return run_checks(_planned([plan(spec)], outputs, measure_only), progress)


def _is_study(content: dict[str, Any]) -> bool:
    """Say whether a TOML file with this content has one of the keys that every study has."""
    return bool({"scene", "run"} & content.keys())


def _planned(checks: list[Check], outputs: Outputs, measure_only: bool) -> list[Check]:
    """The checks, as they are. Raises UserError for one without a target, which could never fail,
    and for one with a target that `measure_only` would leave out.

    outputs: where a baseline is written, no check needs a target.
    """
    for check in checks:
        if measure_only and check.targets:
            option = check.targets[0].replace("_", "-")
            got = f"given with --{option}, the target of {check.name}"
            raise UserError("measure-only", got, "one of the two")
        if not measure_only and not check.targets and outputs.baseline is None:
            targets = "--restitution, --alpha, --points, --baseline, --require"
            options = f"{targets}, --max-depth or --max-vibration"
            advice = "--measure-only measures without a verdict"
            raise UserError(check.name, "no target", options, advice)
    return checks


def _listed(table: dict[str, Any] | None, path: Path, spec: CheckSpec) -> list[Check]:
    """The checks of a file; a limit or baseline given with the file holds for all of them.

    table: of checks in the file, None for a file without one.
    path: of the file.
    Raises UserError for other options given with it, for a file without checks, and for a check
    with wrong keys or values, by their names.
    """
    _require_only(
        spec,
        {"baseline", "max_error", "limit"},
        f"given with {path}",
        "it in the file, for each check",
    )
    options = spec.options
    changes: dict[str, float | None] = {}
    if options["max_error"] is not None:
        changes["max_error"] = read_max_error(options["max_error"])
    if options["limit"] is not None:
        changes["limit"] = read_limit(options["limit"])
    baseline: Path | None = None
    if options["baseline"] is not None:
        baseline = Path(options["baseline"])
    checks = checks_in(table, path, baseline)
    return [dataclasses.replace(check, **changes) for check in checks]  # type: ignore[arg-type]


def _check_study(path: Path, spec: CheckSpec, jobs: int, progress: Progress) -> Report:
    """Hold each setting of a study to its own law: of the results in a folder, or of a run now.

    path: of a study or of the folder of its report.
    jobs: worker processes.
    Raises UserError for options of launches, which the study itself has, and for a path that is
    not a study.
    """
    from hcbench.benchmark.results import Results
    from hcbench.benchmark.run import run_study
    from hcbench.benchmark.study import find_study, load_study

    got = f"given with {path}: differs from the study"
    _require_only(spec, {"target", "max_error"}, got, "the α, speeds and steps of the study itself")
    limit = read_max_error(spec.options["max_error"])
    if path.is_dir() and (path / "summary.json").is_file():
        results = Results.read(path)
    else:
        results = run_study(load_study(find_study(str(path))), jobs, progress)
    return judge_results(results, limit, spec.options["target"])


def _require_only(spec: CheckSpec, used: set[str], got: str, expected: str) -> None:
    """Raises UserError for what was given and would be ignored."""
    for name, value in spec:
        if name not in used | {"model"} and value != CheckSpec.model_fields[name].default:
            raise UserError(name.replace("_", "-"), got, expected)


def _write(report: Report, outputs: Outputs) -> None:
    """Write the output files, each completely or not at all.

    A baseline is written only when everything in it was measured; else UserError or OutputError
    says what was not. OutputError is raised, too, for a file that cannot be written.
    """
    if outputs.junit is not None:
        write_output(outputs.junit, as_junit(report), "--junit", outputs.force)
    if outputs.markdown is not None:
        write_output(outputs.markdown, as_markdown(report), "--markdown", outputs.force)
    if outputs.png is not None:
        from hcbench.checking.figure import errors_png

        write_output(outputs.png, errors_png(report), "--png", outputs.force)
    if outputs.baseline is not None:
        from hcbench.checking.baseline import write_baseline

        write_baseline(outputs.baseline, _measurements(report), outputs.force)


def _measurements(report: Report) -> dict[str, Measurement]:
    """Measurement of each check by its name.

    Raises an error for the first check that has no measurement: UserError where the check itself is
    wrong, OutputError where it could not be run; UserError, too, where no check is listed.
    """
    outcomes = report.outcomes or (Outcome("anything", Verdict.MISTAKE, "no check is listed"),)
    measurements = {}
    for outcome in outcomes:
        if outcome.measurement is None or not outcome.measurement.measured:
            kind = UserError if outcome.verdict is Verdict.MISTAKE else OutputError
            got = f"not written: {sanitized(outcome.name)} was not measured: {outcome.message}"
            raise kind("baseline", got, "every check measured")
        measurements[outcome.name] = outcome.measurement
    return measurements


# `hcbench.check`: hold a model to a target, as CI does.


@checked
def check(
    model: str | Path | Sequence[str | Path] = (),
    pair: BodyPair | None = None,
    *,
    name: str | None = None,
    jobs: Jobs = 1,
    measure_only: bool = False,
    **options: Unpack[CheckOptions],
) -> Report:
    """Hold a pair of your model to a target, as `hcbench check` does.

    Parameters
    ----------
    model : path or two paths, optional
        A model, two URDFs, a study, or a TOML file with a [tool.hcbench] table; ./pyproject.toml by default.
    pair : text or two names, optional
        Two bodies or geoms, first the one that moves.
    name : text, optional
        What the result calls the check; the file's name by default.
    material, alpha, restitution, points, baseline, require : optional
        One target: a pair of materials that `materials` lists; α, s/m or with a unit, read as `target` "law"
        or "linear"; one e for all speeds; a CSV file of measured pairs; a baseline that
        `hcbench check --write-baseline` wrote; or limits on landings or on a recorded motion,
        "e < 0.3, peak < 6".
    heights, tilt, controller : optional
        With `require`: how to drop a robot, as `land` takes them.
    trajectory : path, optional
        With `require`: a file of a recorded motion, as `measure_trajectory` takes it.
    max_error : float, optional
        Of e, 0.02 by default.
    max_depth, max_vibration : float, text or quantity of Pint's, optional
        Most of the penetration, m, and of the vibration, m/s (rms), at rest.
    engine, limit : optional
        As `measure` takes them.
    jobs : int
        Worker processes, for a study.
    measure_only : bool
        Measure without a target; nothing can fail.
    **launch
        Speeds, pose and all else of the launches, as `measure` takes them.

    Returns
    -------
    Report
        `exit_code`, as the command ends with; `raise_if_failed()`; `outcomes`, one a check.

    Raises
    ------
    UserError
        For what cannot be planned, in the argument's name.

    Examples
    --------
    >>> import hcbench as hb
    >>> hb.check("ball.xml", "ball,plate", restitution=0.9, speeds="0.2, 0.5 m/s", max_error=0.01)
    PASSED ball.xml: largest error -0.00136 at 0.2058 m/s, limit 0.01

    """
    models = [model] if isinstance(model, str | Path) else list(model)
    given = {
        "model": tuple(map(str, models)),
        "pair": read_pair(pair),
        "name": name,
        **options,
    }
    plain = {slot: _plain(value) for slot, value in given.items()}
    return run_spec(validate(CheckSpec, plain, UserError), jobs=jobs, measure_only=measure_only)


def _plain(value: Any) -> Any:
    """A quantity of Pint's as text, which files of checks have, too."""
    return f"{value.magnitude!s} {value.units}" if isinstance(value, PintQuantity) else value
