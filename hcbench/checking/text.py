"""The results of checks for a terminal, as JSON, as a Markdown summary,
and as JUnit XML for CI systems.
"""

import html
import math
import re
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from pydantic import Field

from hcbench.catalogue.find import is_material_file
from hcbench.checking.outcome import Outcome, Report, Verdict
from hcbench.checking.spec import Check, CheckSpec, SharedSpec, plan
from hcbench.measuring.curve import CurvePoint
from hcbench.measuring.request import is_python
from hcbench.measuring.text import all_cause_lines, as_record
from hcbench.sim.packages import named_folders
from hcbench.system.errors import UserError
from hcbench.system.text import LONGEST_NOTE, number, sanitized, table, without_empty
from hcbench.terms.fields import read_toml, validate
from hcbench.terms.options import OPTIONS

# Schema 1 had a row of other keys, whose error was that of the worst phase.
SCHEMA = 2
_MARKS = {
    Verdict.PASSED: "✅",
    Verdict.MEASURED: "📏",
    Verdict.FAILED: "❌",
    Verdict.MISTAKE: "⚠️",
    Verdict.COULD_NOT_RUN: "💥",
}
# Decimals of e.
_DECIMALS = 4
_HEADER = (
    "launch m/s",
    "deg",
    "impact m/s",
    "e",
    "lowest",
    "highest",
    "target",
    "error",
    "worst phase",
)


def as_text(report: Report) -> str:
    """The tables of all checks, then one line each, for a terminal."""
    parts = [outcome_text(outcome) for outcome in report.outcomes]
    if len(report.outcomes) > 1:
        parts.append("\n".join(outcome.line for outcome in report.outcomes))
    return "\n\n".join(parts) + "\n"


def outcome_text(outcome: Outcome) -> str:
    """One check as lines: what was measured, the curve, the verdict, and the causes where it
    failed.
    """
    lines = []
    if outcome.measurement is not None:
        lines += outcome.measurement.headline
        # A check prints only those notes of `measure` by which its numbers may be wrong.
        for note in outcome.measurement.facts.warnings:
            lines.append(f"note: {sanitized(note, LONGEST_NOTE)}")
    if outcome.against:
        against = f"against {outcome.against}"
        if not math.isnan(outcome.max_error):
            against += f", limit {outcome.max_error:g}"
        lines.append(against)
    if outcome.rows:
        lines += ["", *table(*_table(outcome)), ""]
    lines.append(outcome.line)
    if outcome.verdict is Verdict.FAILED and outcome.measurement is not None:
        lines += all_cause_lines(outcome.measurement)
    return "\n".join(lines)


def _table(outcome: Outcome) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    rows = [_cells(row, outcome.is_oblique) for row in outcome.rows]
    return without_empty(_HEADER, rows, "deg")


def _cells(row: CurvePoint, is_oblique: bool) -> tuple[str, ...]:
    """Cells of one point of a curve: speeds in m/s, the angle in degrees, e and its range over the
    phases, target and errors; a dash for a number that there is not.

    is_oblique: whether any launch of the check is; the angle is "" where none is.
    """
    # The difference of the two numbers as they are printed, so that the row adds up for its reader.
    error = round(row.restitution, _DECIMALS) - round(row.target, _DECIMALS)
    angle = ""
    if is_oblique:
        angle = f"{math.degrees(row.angle):.4g}"
    return (
        f"{row.speed:.4g}",
        angle,
        number(row.speed_in, ".4g"),
        number(row.restitution),
        number(row.lowest),
        number(row.highest),
        number(row.target),
        number(error, "+z.4f"),
        number(row.worst_phase, "+z.4f"),
    )


def as_record_of(report: Report) -> dict[str, Any]:
    """Record of the report for `--json`, in SI units; NaN for a number that does not apply."""
    return {
        "schema": SCHEMA,
        "kind": "hcbench check",
        "exit_code": report.exit_code,
        "checks": [_record(outcome) for outcome in report.outcomes],
    }


def _record(outcome: Outcome) -> dict[str, Any]:
    """Record of one check for JSON, its numbers in SI; NaN for a number that does not apply.

    None stands for a worst point or a measurement that it has not.
    """
    is_oblique = outcome.is_oblique
    worst = None
    if outcome.worst is not None:
        worst = outcome.worst.record(is_oblique)
    measurement = None
    if outcome.measurement is not None:
        measurement = as_record(outcome.measurement)
    return {
        "name": outcome.name,
        "verdict": outcome.verdict.value,
        "exit_code": outcome.exit_code,
        "message": outcome.message,
        "against": outcome.against,
        "max_error": outcome.max_error,
        "worst": worst,
        "rows": [row.record(is_oblique) for row in outcome.rows],
        "measurement": measurement,
    }


def as_markdown(report: Report) -> str:
    """The report as a Markdown summary for a CI step, with the curve and the causes of what failed.

    Names come from models: nothing in them is taken as markup.
    """
    lines = ["### Restitution", "", "| | check | against | result |", "|---|---|---|---|"]
    for o in report.outcomes:
        cells = (_MARKS[o.verdict], f"**{_safe(o.name)}**", _safe(o.against), _safe(o.message))
        lines.append(f"| {' | '.join(cells)} |")
    for outcome in report.outcomes:
        if outcome.verdict in (Verdict.PASSED, Verdict.MEASURED) or outcome.measurement is None:
            continue
        lines += [
            "",
            f"<details><summary>{_safe(outcome.name)}: the curve and the cause</summary>",
            "",
        ]
        header, rows = _table(outcome)
        lines += [f"| {' | '.join(header)} |", "|" + "---:|" * len(header)]
        lines += [f"| {' | '.join(cells)} |" for cells in rows]
        for cause in (*outcome.measurement.causes, *outcome.measurement.rest_causes):
            words = (
                f"**{_safe(cause.title)}** Found: {_safe(cause.evidence)}. Fix: {_safe(cause.fix)}"
            )
            lines += ["", f"- {words}"]
        lines += ["", _safe(outcome.measurement.remedy), "", "</details>"]
    return "\n".join(lines) + "\n"


def as_junit(report: Report) -> str:
    """The report as JUnit XML: one test suite, a test case a check, with its text.

    Times are left out: the same run gives the same bytes.
    """
    outcomes = report.outcomes
    failures = sum(o.verdict is Verdict.FAILED for o in outcomes)
    errors = sum(o.verdict in (Verdict.MISTAKE, Verdict.COULD_NOT_RUN) for o in outcomes)
    counts = {"tests": str(len(outcomes)), "failures": str(failures), "errors": str(errors)}
    suites = ET.Element("testsuites", counts)
    suite = ET.SubElement(suites, "testsuite", {"name": "hcbench", **counts})
    for outcome in outcomes:
        case = ET.SubElement(
            suite,
            "testcase",
            {"classname": "hcbench.check", "name": sanitized(outcome.name), "time": "0"},
        )
        if outcome.verdict is Verdict.FAILED:
            body = ET.SubElement(case, "failure", {"message": sanitized(outcome.message)})
        elif outcome.verdict in (Verdict.PASSED, Verdict.MEASURED):
            body = ET.SubElement(case, "system-out")
        else:
            body = ET.SubElement(
                case,
                "error",
                {"message": sanitized(outcome.message), "type": outcome.verdict.value},
            )
        body.text = outcome_text(outcome)
    ET.indent(suites)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(suites, encoding="unicode")}\n'


def _safe(text: str) -> str:
    """Text with everything escaped that Markdown or HTML would interpret."""
    escaped = html.escape(sanitized(text), quote=True)
    return re.sub(r"[\\`*_{}\[\]()#+!|~@:]", lambda m: f"&#{ord(m[0])};", escaped)


class CheckTable(SharedSpec):
    """The table: what all checks share, and the checks."""

    check: list[CheckSpec] = Field(
        min_length=1, description="[[tool.hcbench.check]] entries, one or more"
    )


def find_table(path: Path) -> dict[str, Any] | None:
    """The table of checks of a TOML file: [tool.hcbench], or all of a file that has [[check]]; None
    without one.

    Raises UserError for a file that is not TOML, and for a [tool.hcbench] that is not a table.
    """
    return table_in(read_toml(path, UserError, "checks"), path)


def table_in(content: dict[str, Any], path: Path) -> dict[str, Any] | None:
    """The table of a TOML file: [tool.hcbench], or all of a file that has [[check]]; None without
    one.

    content: of the file.
    path: of it, for errors.
    Raises UserError for a [tool.hcbench] that is not a table.
    """
    table = None
    if isinstance(content.get("tool"), dict):
        table = content["tool"].get("hcbench")
    if table is not None and not isinstance(table, dict):
        got = f"{path}: [tool] hcbench is {table!r:.60}"
        raise UserError("checks", got, "a table with [[tool.hcbench.check]] entries")
    if table is None and "check" in content:
        table = content
    return table


def checks_of(path: Path, baseline: Path | None = None) -> list[Check]:
    """The checks that a file lists, planned; the models are not opened.

    path: of the TOML file.
    baseline: as of `checks_in`.
    Raises UserError for a file that is not TOML or has no table of checks, for an entry and key
    that cannot be used, by their names, and for two checks of one name.
    """
    return checks_in(find_table(path), path, baseline)


def checks_in(
    content: dict[str, Any] | None, path: Path, baseline: Path | None = None
) -> list[Check]:
    """Checks that the table of a file lists, planned; the models are not opened.

    content: the table, None for a file without one.
    path: of the file, from whose folder paths lead.
    baseline: a file to hold the checks against, in place of the material, α, e or pairs that they
    name; those with limits on landings or on a motion keep them, as no baseline has any.
    Raises UserError that names the entry and key that cannot be used, for a file without a table,
    and for two checks of one name.
    """
    if content is None:
        raise UserError(
            "checks", f"{path} has no [tool.hcbench]", "a table with [[tool.hcbench.check]] entries"
        )
    table = validate(CheckTable, content, UserError, f"checks: {path}: [tool.hcbench] {{}}")
    checks = []
    for place, entry in enumerate(table.check):
        try:
            checks.append(plan(_complete(entry, table, path.parent, baseline)))
        except UserError as error:
            slot = f"checks: {path}: [tool.hcbench] check[{place}]: {error.slot}"
            raise type(error)(slot, error.got, error.expected, error.advice) from None
    name, count = Counter(check.name for check in checks).most_common(1)[0]
    if count > 1:
        raise UserError(
            "checks", f"{path}: two checks are called {sanitized(name)!r}", "a name for each"
        )
    return checks


def _complete(
    entry: CheckSpec, table: CheckTable, folder: Path, baseline: Path | None
) -> CheckSpec:
    """An entry of a file of checks, completed: keys that it lacks are those of the whole table, and
    relative paths start at the folder.

    folder: of the file that lists the checks.
    baseline: a file that takes the place of the entry's own target, unless that is limits
    (`require`).
    Raises UserError for an entry without a model.
    """
    if not entry.models:
        raise UserError("model", "none given", "a file, or two URDF files")
    update: dict[str, Any] = {}
    # What the whole table says.
    for name in SharedSpec.model_fields.keys() - entry.model_fields_set:
        update[name] = getattr(table, name)
    # Paths, which start at the folder; a name of a material is none.
    for name in ("points", "baseline", "trajectory", "state"):
        path = update.get(name, getattr(entry, name))
        if path:
            update[name] = folder / path
    controller = update.get("controller", entry.options["controller"])
    if is_python(controller):
        update["controller"] = str(folder / str(controller))
    if is_material_file(entry.options["material"]):
        update["material"] = folder / str(entry.options["material"])
    package = entry.launch["package"] or table.launch["package"]
    if package:
        update["package"] = {name: str(folder / path) for name, path in named_folders(package)}
    update["model"] = tuple(str(folder / model) for model in entry.models)
    # One target alone: the entry's own is reset.
    if baseline is not None and entry.options["require"] is None:
        for name in ("material", "alpha", "restitution", "points", "target"):
            update[name] = OPTIONS[name].default
        update["baseline"] = baseline
    return entry.model_copy(update=update)
