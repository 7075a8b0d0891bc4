"""Files of results and scores: their schema, its page, and what is measured and known of engines."""

from __future__ import annotations

import json
import re
from typing import Any

import cases_page
import pytest

from hcbench.cases import schema
from hcbench.cases.run import run_engines
from hcbench.cases.score import known_failures, matrix, measured, regressions, score, the_cases
from hcbench.errors import UserError

MEASURED = measured()


@pytest.fixture(scope="module")
def results() -> list[dict[str, Any]]:
    return run_engines(["mujoco"], only=["C07", "C09"])


def test_the_schema_file_and_the_page_are_what_the_types_say() -> None:
    assert json.loads(schema.FILE.read_text("utf-8")) == schema.schema()
    assert (
        cases_page.PAGE.read_text("utf-8") == cases_page.page()
    )  # PYTHONPATH=tests/support python -m cases_page


def test_every_field_has_a_type_and_a_meaning() -> None:
    fields = [*schema.fields()]
    assert len(fields) > 20
    for _, name, kind, _, meaning in fields:
        assert kind, name
        assert meaning, name


def test_real_results_and_scores_are_of_the_schema(results: list[dict[str, Any]]) -> None:
    schema.validated(results[0], "results", "results")
    found = [score(each, only=["C07", "C09"]).as_dict() for each in results]
    schema.validated(json.loads(json.dumps(found)), "scores", "scores")


@pytest.mark.parametrize(
    ("place", "change"),
    [("format", {"format": 2}), ("engine", {"engine": {"name": 3}}), ("runs.C07", {"runs": {"C07": 1}})],
)
def test_what_is_no_result_is_refused_with_its_place(
    results: list[dict[str, Any]], place: str, change: dict[str, Any]
) -> None:
    with pytest.raises(UserError, match=re.escape(place)):
        score({**results[0], **change}, "mine.json")


def test_the_matrix_has_a_word_for_each_case_of_each_engine() -> None:
    ids = [case["id"] for case in the_cases()["cases"]]
    for row in matrix():
        assert [*row] == ["engine", "version", *ids, "passed", "restitution"]
        assert {row[name] for name in ids} <= {"pass", "fail", "unsupported", "error"}
        assert row["restitution"] in ("obeyed", "threshold", "mixed", "ignored", "")


def test_every_failure_that_was_measured_is_known_with_a_reason() -> None:
    newest = {each.engine: each for each in MEASURED}
    for engine, known in known_failures().items():
        failed = {v["case"] for v in newest[engine].verdicts if v["verdict"] in ("fail", "error")}
        assert failed == set(known), engine


def test_the_history_finds_jolts_gain_of_energy() -> None:
    (line,) = [line for line in regressions(MEASURED) if line.startswith("jolt C03")]
    assert line.endswith("fail in 0.29.0, pass in 1.1.0")
