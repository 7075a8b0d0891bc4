"""hcbench cases: the bounces that engines should get right, run and judged."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from hcbench.cli.console import (
    PathType,
    as_json,
    force_option,
    jobs_option,
    output_option,
    print_json,
    progress,
)
from hcbench.cli.help import group
from hcbench.system.errors import LimitPassed, UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from hcbench.cases.score import EngineScore

# Engines side by side, at most; more get a row each.
_SIDE_BY_SIDE = 4
_SIGN = {"pass": "pass", "fail": "FAIL", "unsupported": "-", "error": "ERROR"}


@group()
def cases() -> None:
    """Run a frozen set of bounces in engines; judge their results.

    Engines can take the set and its runner into their own tests: two files, without dependencies.
    """


_case_option = click.option(
    "--case", "only", multiple=True, metavar="ID", help="This case alone, such as C13. Repeatable."
)


@cases.command("run")
@click.argument("engines", metavar="ENGINE[@VERSION]...", nargs=-1, required=True)
@_case_option
@output_option("--out", help="Write the results, a JSON list, for `hcbench cases score`.")
@output_option("--junit", help="Write the verdicts as JUnit's XML.")
@click.option(
    "--expected",
    type=PathType(path_type=Path),
    help="JSON file {engine: {case: reason}} of known failures.  [default: those known to hcbench]",
)
@click.option(
    "--limit",
    metavar="SECONDS",
    type=click.FloatRange(min=0.0, min_open=True),
    default=300.0,
    show_default=True,
    help="End a case that takes longer; it is an error.",
)
@as_json
@jobs_option
@force_option
def run_cases(
    engines: tuple[str, ...],
    only: tuple[str, ...],
    out: Path | None,
    junit: Path | None,
    expected: Path | None,
    limit: float,
    as_json: bool,
    jobs: int,
    force: bool,
) -> None:
    """Run the cases in engines; exit 1 where one fails that is not known to.

    Engines that are not beside hcbench run in their own environments (`hcbench engines add`).
    """
    # limit: s, for each case of each engine.
    import json

    from hcbench.cases.score import known_failures, run_engines, score
    from hcbench.system.outputs import write_output

    known = _read_known(expected) if expected else known_failures()
    with progress("engines") as tick:
        results = run_engines(engines, jobs, tick, only, limit)
    scores = [score(each, only=only) for each in results]
    if out:
        write_output(out, json.dumps(results, separators=(",", ":")) + "\n", "--out", force)
    if junit:
        write_output(junit, _junit(scores, known), "--junit", force)
    _print(scores, as_json, markdown=False)
    _require_expected(scores, known)


@cases.command("score")
@click.argument("results", nargs=-1, required=True, type=PathType(path_type=Path))
@_case_option
@click.option("--markdown", is_flag=True, help="Print a Markdown table.")
@as_json
def score_cases(
    results: tuple[Path, ...], only: tuple[str, ...], markdown: bool, as_json: bool
) -> None:
    """Judge files of results, from any engine in any language.

    Exit 0 also where cases fail: the verdicts are the result. `hcbench cases run` exits 1.
    """
    from hcbench.cases.score import read_scores

    scores: list[EngineScore] = []
    for path in results:
        scores += read_scores(path, only)
    _print(scores, as_json, markdown)


@cases.command("vendor")
@click.argument("folder", metavar="FOLDER", type=PathType(path_type=Path))
@_case_option
@force_option
def vendor_cases(folder: Path, only: tuple[str, ...], force: bool) -> None:
    """Write runner, cases, a test and an adapter's outline to a folder.

    The folder needs nothing but Python's standard library; unittest and pytest run its test.
    """
    from hcbench.cases.vendor import vendor

    written = vendor(folder, only, force)
    size = sum(path.stat().st_size for path in written)
    print("\n".join(map(str, written)))
    print(f"{size / 1000:.1f} kB; write the adapter, then: python -m unittest discover {folder}")


def _with_signs(row: Mapping[str, str]) -> dict[str, str]:
    """A row of the matrix with verdicts as they are printed."""
    return {key: _SIGN.get(word, word) for key, word in row.items()}


def _markdown(rows: Sequence[Mapping[str, str]]) -> Iterator[str]:
    """Lines of a table in Markdown, a row for each engine."""
    header = list(rows[0])
    rule = ["---"] * len(header)
    cells = [list(row.values()) for row in rows]
    for line in (header, rule, *cells):
        yield f"| {' | '.join(line)} |"


def _engines_below(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """Lines of a table with a row for each engine."""
    from hcbench.system.text import table

    header = tuple(rows[0])
    return table(header, [tuple(row.values()) for row in rows])


def _engines_beside(scores: Sequence[EngineScore], rows: Sequence[Mapping[str, str]]) -> list[str]:
    """Lines of a table with a column for each engine and a row for
    each case, with the case's title.

    scores: at least one.
    rows: one for each of them, in order: "engine", "version", then each case with its sign, ""
    where it has none.
    """
    from hcbench.system.text import table

    titles = {verdict["case"]: verdict["title"] for verdict in scores[0].verdicts}
    width = max(map(len, titles.values()))
    header = ("case", "", *(each.name for each in scores))
    lines = []
    for key in rows[0]:
        signs = [row[key] for row in rows]
        if key not in ("engine", "version") and any(signs):
            title = titles.get(key, "")
            lines.append((key, title.ljust(width), *signs))
    return table(header, lines)


def _print(scores: Sequence[EngineScore], as_json: bool, markdown: bool) -> None:
    """Print the verdicts: as JSON, as a table in Markdown, or for people with the reasons of
    failures.

    scores: of each engine. as_json goes before markdown.
    """
    from hcbench.cases.score import matrix, regressions

    if as_json:
        print_json([each.as_dict() for each in scores])
        return
    rows = [_with_signs(row) for row in matrix(scores)]
    if markdown:
        print("\n".join(_markdown(rows)))
        return
    lines = _engines_below(rows)
    if len(rows) <= _SIDE_BY_SIDE:
        lines = _engines_beside(scores, rows)
    print("\n".join(lines))
    for each in scores:
        for verdict in each.verdicts:
            if verdict["verdict"] != "pass":
                print(f"{each.name} {verdict['case']}: {verdict['why']}")
    for line in regressions(scores):
        print(f"changed: {line}")


def _read_known(path: Path) -> Mapping[str, Mapping[str, str]]:
    """Known failures: the reason by engine and case. Raises UserError for a file of another form."""
    from hcbench.system.files import parse_json, read_text

    known = {}
    try:
        for engine, reasons in parse_json(read_text(path)).items():
            known[str(engine)] = {str(case): str(reason) for case, reason in reasons.items()}
    except (OSError, ValueError, AttributeError) as error:
        raise UserError(
            "--expected", f"{path}: {error}", "a JSON file {engine: {case: reason}}"
        ) from None
    return known


def _junit(scores: Sequence[EngineScore], known: Mapping[str, Mapping[str, str]]) -> str:
    """Verdicts as JUnit's XML, a suite for each engine.

    scores: of each engine.
    known: reasons of known failures, by case, by engine.
    """
    from hcbench.cases.hcbench_cases import junit

    suites = ""
    for each in scores:
        suites += junit(list(each.verdicts), each.name, dict(known.get(each.engine, {})))
    return f"<testsuites>{suites}</testsuites>\n"


def _require_expected(
    scores: Sequence[EngineScore], known: Mapping[str, Mapping[str, str]]
) -> None:
    """Raise LimitPassed for the first case that fails and is not known to, or passes and is known
    to fail.

    scores: of each engine.
    known: reasons of known failures, by case, by engine.
    """
    from hcbench.cases.hcbench_cases import outcome

    for each in scores:
        for verdict in each.verdicts:
            kind, text = outcome(verdict, dict(known.get(each.engine, {})))
            if kind == "failure":
                passes = "a known failure" if verdict["verdict"] == "pass" else "a pass"
                raise LimitPassed(f"{each.name} {verdict['case']}", text, passes)
