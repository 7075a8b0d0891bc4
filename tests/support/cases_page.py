"""Pages of the cases: `python -m cases_page` writes what they show of what is measured and known.

It writes the tables of docs/reference/cases.md and cases-history.md, the schema's file, and the
section of the cases in reports/field/index.html.
`python -m cases_page results.json ...` judges the results first, in place of what was measured
before.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from pathlib import Path
from textwrap import fill
from typing import Any

from hcbench.cases import schema
from hcbench.cases.score import (
    MEASURED,
    EngineScore,
    known_failures,
    matrix,
    measured,
    read_scores,
    regressions,
    the_cases,
)
from hcbench.reporting.field.cells import GRADES, case_table
from hcbench.reporting.page import render

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "cases.md"
HISTORY = PAGE.with_name("cases-history.md")
FIELD = ROOT / "reports" / "field" / "index.html"


def table(rows: Sequence[Iterable[str]]) -> str:
    """A Markdown table; the first row is its header."""
    head, *rest = [[*row] for row in rows]
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rest))


def tables() -> dict[str, str]:
    """The page's tables by their names."""
    short = {"unsupported": "–", "": "–"}
    rows = [{key: short.get(word, word) for key, word in row.items()} for row in matrix()]
    reasons: dict[tuple[str, str], list[str]] = {}
    for engine, each in known_failures().items():
        for case, why in each.items():
            reasons.setdefault((engine, why), []).append(case)
    known = [(engine, ", ".join(ids), why) for (engine, why), ids in reasons.items()]
    asked = [
        (case["id"], case["title"], str(len(case["runs"])), _tolerance(case), case["source"])
        for case in the_cases()["cases"]
    ]
    return {
        "cases": table(
            [("case", "what it asks", "runs", "tolerance", "source of the true value"), *asked]
        ),
        "matrix": table([rows[0], *(row.values() for row in rows)]),
        "changes": "\n".join(
            fill(f"- {line}", 100, subsequent_indent="  ", break_on_hyphens=False)
            for line in regressions(measured())
        ),
        "versions": table(
            [("engine", "versions", "passed", "fails", "restitution"), *_versions(measured())]
        ),
        "known": table([("engine", "case", "reason"), *known]),
        "fields": table([("object", "field", "type", "unit", "meaning"), *schema.fields()]),
    }


def _tolerance(case: dict[str, Any]) -> str:
    limits = {
        f"{each['value']:g}: {each['reason'].lower()}": name
        for name, each in case["tolerance"].items()
    }
    return "; ".join(limits)


def _versions(scores: Sequence[EngineScore]) -> Iterator[tuple[str, ...]]:
    """Yield a row for the successive versions of each engine that have the same verdicts."""
    by_engine: dict[str, list[EngineScore]] = {}
    for one in scores:
        by_engine.setdefault(one.engine, []).append(one)
    for engine, versions in by_engine.items():
        for words, alike in groupby(versions, _words):
            same = [*alike]
            first, last = same[0], same[-1]
            span = ", ".join(one.version for one in same)
            if len(same) > 2:
                span = f"{first.version} ... {last.version} ({len(same)} run)"
            bad = [case for case, word in words if word in ("fail", "error")]
            passed = f"{last.passed} of {len(words)}"
            yield engine, span, passed, ", ".join(bad) or "–", last.restitution or "–"


def _words(one: EngineScore) -> list[tuple[str, str]]:
    return [(verdict["case"], verdict["verdict"]) for verdict in one.verdicts]


def page(path: Path) -> str:
    """The page with those of the tables that it has as they should be."""
    text = path.read_text(encoding="utf-8")
    for name, content in tables().items():
        mark = f"<!-- {name} -->\n"
        if mark in text:
            before, rest = text.split(mark, 1)
            _, after = rest.split("<!-- end -->", 1)
            text = f"{before}{mark}\n{content}\n\n<!-- end -->{after}"
    return text


def field_page() -> str:
    """The committed field page with the section of the cases as it should be."""
    text = FIELD.read_text(encoding="utf-8")
    begin, end = '<section id="cases">', '<section id="features">'
    before, rest = text.split(begin)
    _, after = rest.split(end)
    section = render("field_cases.html", cases=case_table(measured()), grades=GRADES)
    return f"{before}{section.strip()}\n\n{end}{after}"


def write_field_page() -> None:
    """Write the field page and its digest in the list of the report's files."""
    text = field_page()
    FIELD.write_text(text, encoding="utf-8")
    listed = FIELD.with_name("hcbench-files.json")
    content = json.loads(listed.read_text("utf-8"))
    content["files"][FIELD.name] = hashlib.sha256(text.encode()).hexdigest()
    listed.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def schema_text() -> str:
    """The file of the schema."""
    return json.dumps(schema.schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    if paths := [Path(name) for name in sys.argv[1:]]:
        lines = [json.dumps(score.as_dict()) for path in paths for score in read_scores(path)]
        MEASURED.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")
    for each in (PAGE, HISTORY):
        each.write_text(page(each), encoding="utf-8")
    write_field_page()
    schema.FILE.write_text(schema_text(), encoding="utf-8")
