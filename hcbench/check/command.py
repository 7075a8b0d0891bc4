"""`hcbench check` without the printing: from sources and options to a report and its files."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from hcbench import units
from hcbench._text import sanitized
from hcbench.check.baseline import write_baseline
from hcbench.check.model import MAX_ERROR, Outputs, Report
from hcbench.check.plan import Ask, plan
from hcbench.check.run import run_checks
from hcbench.check.table import checks_of, find_table
from hcbench.errors import OutputError, UserError

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.check.model import Check

    Progress = Callable[[int, int], None] | None

DEFAULT_FILE = "pyproject.toml"


def check(ask: Ask, outputs: Outputs | None = None, jobs: int = 1, progress: Progress = None) -> Report:
    """Check what `ask.models` names and write what `outputs` asks for.

    models: none for the [tool.hcbench] of ./pyproject.toml; a TOML file with such a table; a study or the
        folder of its report; else a model.
    Raises UserError for what cannot be planned, and OutputError for what cannot be written.
    """
    outputs = outputs or Outputs()
    _require_places(outputs)
    if outputs.baseline is not None and ask.baseline is not None:
        raise UserError("baseline", "--baseline and --write-baseline", "one of the two")
    report = _run(ask, jobs, progress)
    write_outputs(report, outputs)
    return report


def _run(ask: Ask, jobs: int, progress: Progress) -> Report:
    source = Path(ask.models[0]) if ask.models else Path(DEFAULT_FILE)
    if len(ask.models) < 2 and source.suffix.lower() == ".toml":
        if not source.is_file() and not ask.models:
            raise UserError("checks", f"no model, and no {DEFAULT_FILE} here", "a model to check")
        if find_table(source) is not None or source.name == DEFAULT_FILE:
            return run_checks(_listed(source, ask), progress)
    if len(ask.models) == 1 and (source.suffix.lower() == ".toml" or source.is_dir()):
        return _study(source, ask, jobs, progress)
    return run_checks([plan(ask)], progress)


def _listed(path: Path, ask: Ask) -> list[Check]:
    """The checks of a table; what the user adds beside it counts for all of them."""
    own = {"models", "reading", "baseline", "max_error", "limit"}
    for field in dataclasses.fields(ask):
        if field.name not in own and getattr(ask, field.name) is not None:
            slot = field.name.replace("_", "-")
            raise UserError(slot, f"given beside {path}", "it in the file, for each check")
    checks = checks_of(path, ask.baseline)
    changes: dict[str, float] = {}
    if ask.max_error is not None:
        changes["max_error"] = units.parse(ask.max_error, "number", "max-error")
    if ask.limit is not None:
        changes["limit"] = units.parse(ask.limit, "timestep", "limit")
    return [dataclasses.replace(check, **changes) for check in checks]  # type: ignore[arg-type]


def _study(path: Path, ask: Ask, jobs: int, progress: Progress) -> Report:
    from hcbench.benchmark.results import Results
    from hcbench.benchmark.study import find_study
    from hcbench.check.studies import check_results, check_study

    if any(value is not None for value in (ask.restitution, ask.pairs, ask.baseline, ask.alpha, ask.pair)):
        raise UserError(
            "study", f"{path} with something else to hold it against", "the α of the study itself"
        )
    limit = MAX_ERROR if ask.max_error is None else units.parse(ask.max_error, "number", "max-error")
    if path.is_dir() and (path / "summary.json").is_file():
        return check_results(Results.read(path), limit, ask.reading)
    return check_study(find_study(str(path)), limit, ask.reading, jobs, progress)


def _require_places(outputs: Outputs) -> None:
    """Refuse before measuring what could not be written after."""
    for field in dataclasses.fields(outputs):
        path: Path | None = getattr(outputs, field.name)
        if path is not None and (path.is_dir() or not path.parent.is_dir()):
            what = "is a folder" if path.is_dir() else "is in a folder that is not there"
            raise OutputError(field.name, f"{sanitized(path)} {what}", "a file in a folder that is")


def write_outputs(report: Report, outputs: Outputs) -> None:
    """Write the files asked for, each whole or not at all.

    A baseline is written only when everything in it was measured; else OutputError says what was not.
    """
    if outputs == Outputs():
        return
    from hcbench._files import write_bytes, write_text
    from hcbench.check.junit import as_junit
    from hcbench.check.words import as_markdown

    if outputs.junit is not None:
        write_text(outputs.junit, as_junit(report))
    if outputs.markdown is not None:
        write_text(outputs.markdown, as_markdown(report))
    if outputs.png is not None:
        from hcbench.check.figure import errors_png

        write_bytes(outputs.png, errors_png(report))
    if outputs.baseline is not None:
        measured = {o.name: o.found for o in report.outcomes if o.found is not None}
        missing = [o.name for o in report.outcomes if o.found is None]
        if missing or not measured:
            names = ", ".join(sanitized(name) for name in missing) or "anything"
            raise OutputError("baseline", f"not written: {names} was not measured", "every check measured")
        write_baseline(outputs.baseline, measured)
