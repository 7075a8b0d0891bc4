"""Files of results and scores: their schema, its page, and what is measured and known of engines."""

from __future__ import annotations

import copy
import hashlib
import json
import re
from typing import Any

import cases_page
import pytest

from hcbench.cases import schema
from hcbench.cases.score import (
    known_failures,
    matrix,
    measured,
    regressions,
    run_engines,
    score,
    the_cases,
)
from hcbench.system.errors import UserError

MEASURED = measured()


@pytest.fixture(scope="module")
def results() -> list[dict[str, Any]]:
    return run_engines(["mujoco"], only=["C07", "C09"])


def test_the_schema_file_and_the_page_are_what_the_types_say() -> None:
    assert json.loads(schema.FILE.read_text("utf-8")) == schema.schema()
    for path in (cases_page.PAGE, cases_page.HISTORY):
        assert path.read_text("utf-8") == cases_page.page(path), (
            "PYTHONPATH=tests/support python -m cases_page"
        )


def test_the_field_page_has_what_was_measured_and_the_digest_of_its_text() -> None:
    text = cases_page.FIELD.read_text("utf-8")
    assert text == cases_page.field_page(), "PYTHONPATH=tests/support python -m cases_page"
    listed = json.loads(cases_page.FIELD.with_name("hcbench-files.json").read_text("utf-8"))
    assert listed["files"]["index.html"] == hashlib.sha256(text.encode()).hexdigest()


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
    [
        ("format", {"format": 2}),
        ("engine", {"engine": {"name": 3}}),
        ("runs.C07", {"runs": {"C07": 1}}),
    ],
)
def test_what_is_no_result_is_refused_with_its_place(
    results: list[dict[str, Any]], place: str, change: dict[str, Any]
) -> None:
    with pytest.raises(UserError, match=re.escape(place)):
        score({**results[0], **change}, "mine.json")


def changed(results: list[dict[str, Any]], states: Any) -> dict[str, Any]:
    """The results with other states of one ball."""
    runs = copy.deepcopy(results[0]["runs"])
    runs["C09"][7]["states"] = states(runs["C09"][7]["states"])
    return {**results[0], "runs": runs}


@pytest.mark.parametrize(
    ("place", "states"),
    [
        ("C09, run 7: states after other steps", lambda states: []),
        ("C09, run 7: states after other steps", lambda states: states[1:]),
        ("C09, run 7, step 3: 2 bodies", lambda s: [*s[:3], s[3] + s[3][1:], *s[4:]]),
        ("runs.C09.7.states[3] is [3, [0.0, 0.0", lambda s: [*s[:3], [3, [0.0] * 8], *s[4:]]),
        (
            "runs.C09.7.states[2] is [0.1, 0.2, 0.3, 0.4, 0.5]",
            lambda s: [*s[:2], [0.1, 0.2, 0.3, 0.4, 0.5]],
        ),
        ("runs.C09.7.states[0] is 'up'", lambda s: ["up", *s[1:]]),
    ],
)
def test_states_that_the_case_does_not_ask_for_are_refused(
    results: list[dict[str, Any]], place: str, states: Any
) -> None:
    with pytest.raises(UserError, match=re.escape(f"mine.json: {place}")):
        score(changed(results, states), "mine.json", ["C07", "C09"])


def test_missing_runs_are_refused_and_a_state_that_is_not_finite_fails(
    results: list[dict[str, Any]],
) -> None:
    with pytest.raises(UserError, match=r"C01: 0 of 60 runs.*--case"):
        score(results[0])
    blown = changed(results, lambda states: [*states[:-1], [states[-1][0], [float("nan")] * 9]])
    verdicts = {v["case"]: v for v in score(blown, only=["C07", "C09"]).verdicts}
    assert verdicts["C07"]["verdict"] == "pass"
    assert (verdicts["C09"]["verdict"], verdicts["C09"]["why"]) == (
        "fail",
        "a state is not finite (run 7)",
    )


def test_texts_of_a_results_file_cannot_move_the_cursor_nor_break_a_line(
    results: list[dict[str, Any]],
) -> None:
    runs = copy.deepcopy(results[0]["runs"])
    runs["C09"][0] = {"error": "lost\n\x1b[2Jthe ball"}
    engine = {"name": "my\x1b[31m\nengine", "version": "1\r2", "combine": None}
    found = score({**results[0], "runs": runs, "engine": engine}, only=["C07", "C09"])
    texts = [found.name, *(verdict["why"] for verdict in found.verdicts)]
    assert all(text.isprintable() for text in texts)
    assert any("the ball" in text for text in texts)


def test_the_matrix_has_a_word_for_each_case_of_each_engine() -> None:
    ids = [case["id"] for case in the_cases()["cases"]]
    for row in matrix():
        assert [*row] == ["engine", "version", *ids, "passed", "restitution", "gravity"]
        assert {row[name] for name in ids} <= {"pass", "fail", "unsupported", "error"}
        assert row["restitution"] in ("obeyed", "soft", "threshold", "mixed", "ignored", "")
        assert row["gravity"] in ("e v", "e (v + g h)", "")


def test_every_failure_that_was_measured_is_known_with_a_reason() -> None:
    newest = {each.engine: each for each in MEASURED}
    for engine, known in known_failures().items():
        failed = {v["case"] for v in newest[engine].verdicts if v["verdict"] in ("fail", "error")}
        assert failed == set(known), engine


def test_the_history_finds_jolts_gain_of_energy() -> None:
    (line,) = [line for line in regressions(MEASURED) if line.startswith("jolt C03")]
    assert line.endswith("fail in 0.29.0, pass in 1.1.0")
