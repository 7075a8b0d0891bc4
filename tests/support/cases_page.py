"""The tables of docs/reference/cases.md: `python -m cases_page` writes them
from what is measured and known.

`python -m cases_page results.json ...` judges the results first, in
place of what was measured before.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from hcbench.cases import schema
from hcbench.cases.score import (
    MEASURED,
    known_failures,
    matrix,
    measured,
    read_scores,
    regressions,
    the_cases,
)

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "cases.md"


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
        "known": table([("engine", "case", "reason"), *known]),
        "fields": table([("object", "field", "type", "unit", "meaning"), *schema.fields()]),
    }


def _tolerance(case: dict[str, Any]) -> str:
    limits = {
        f"{each['value']:g}: {each['reason'].lower()}": name
        for name, each in case["tolerance"].items()
    }
    return "; ".join(limits)


def page() -> str:
    """The page with its tables as they should be."""
    text = PAGE.read_text(encoding="utf-8")
    for name, content in tables().items():
        before, rest = text.split(f"<!-- {name} -->\n", 1)
        text = f"{before}<!-- {name} -->\n\n{content}\n\n<!-- end -->{rest.split('<!-- end -->', 1)[1]}"
    return text


def schema_text() -> str:
    """The file of the schema."""
    return json.dumps(schema.schema(), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    if paths := [Path(name) for name in sys.argv[1:]]:
        lines = [json.dumps(score.as_dict()) for path in paths for score in read_scores(path)]
        MEASURED.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")
    schema.FILE.write_text(schema_text(), encoding="utf-8")
