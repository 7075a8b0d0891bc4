"""Advice, verdicts and claims of a page follow from the scores."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest
from reported_results import IMPULSE, LAW, SPRING, STOCK
from small_results import ALPHAS, RUNS, SPEEDS, small_results

from hcbench.benchmark.results import ImpactTable, Results
from hcbench.reporting import ranking, tables, wording
from hcbench.reporting.build import build
from hcbench.reporting.tables import Views
from hcbench.reporting.view import RunKey, View
from hcbench.scoring import CLAIMS

BROKEN = RunKey("explicit", "broken", 1e-3)


def test_what_is_advised_names_what_follows_the_law_and_what_does_not(view: View) -> None:
    said = " ".join(ranking.advised(view)).replace(wording.NBSP, " ")
    assert "With nothing set single does not bounce like the law." in said
    assert (
        "single impulse, step 1 ms: wrong by at most 0.041, as good as the best constant e." in said
    )
    assert "explicit law, step 1 µs: wrong by at most" in said
    assert "spring-damper" not in said


def test_settings_that_differ_by_round_off_are_both_named(results: Results) -> None:
    scores = results.scores.copy()
    scores.loc[scores["setting"] == "impulse", "max_error_law"] = 1e-13
    scores.loc[scores["setting"] == "law", "max_error_law"] = 1e-16
    view = View(dataclasses.replace(results, scores=scores))
    assert ranking.best(view, view.band_runs) == [LAW, IMPULSE]


def test_an_engine_with_nothing_set_is_no_advice() -> None:
    stock_only = View(small_results([run for run in RUNS if run[1] == "stock"]))
    assert ranking.advised(stock_only) == ["With nothing set single does not bounce like the law."]


def test_a_law_without_damping_has_a_page_too(tmp_path: Path) -> None:
    """α = 0: no constant to beat, no energy to plot; nothing divides by either."""
    lossless = small_results([("explicit", "law", 1e-6, (0.0,), SPEEDS)])
    study = {**lossless.study, "alphas": [0.0], "main_alpha": 0.0}
    page = build(dataclasses.replace(lossless, study=study), tmp_path)
    words_of_it = re.sub(
        r"base64,[^\"]*|<style>.*</style>", "", page.read_text(encoding="utf-8"), flags=re.S
    )
    assert "explicit" in words_of_it
    assert not re.search(r"\b(nan|inf)\b", words_of_it)


def test_a_study_of_the_law_alone_has_a_page_too(results: Results, tmp_path: Path) -> None:
    none = [getattr(results, name).iloc[:0] for name in ("impacts", "loops", "scores")]
    table = ImpactTable.of(none[0], results.study)
    empty = Results(results.study, [], results.versions, table, *none[1:])
    assert "The law alone" in build(empty, tmp_path).read_text(encoding="utf-8")
    assert not [p.name for p in tmp_path.rglob("*.svg")]


@pytest.mark.parametrize(
    ("run", "bounce", "grade", "loop"),
    [
        (LAW, "follows the law", "good", "loop right"),
        (SPRING, "worse than the best constant e", "bad", "loop wrong"),
        (IMPULSE, "as good as the best constant e", "even", "no loop to judge"),
        (STOCK, "worse than the best constant e", "bad", "no loop to judge"),
        (BROKEN, "loses impacts", "bad", "no loop to judge"),
    ],
)
def test_verdicts_go_by_the_scores(
    view: View, run: RunKey, bounce: str, grade: str, loop: str
) -> None:
    assert ranking.verdict(view, run) == ranking.RunVerdict(bounce, grade, loop)


def test_energy_gained_is_said_whatever_the_error(results: Results) -> None:
    scores = results.scores.copy()
    scores.loc[scores["setting"] == "law", "energy_gained"] = True
    view = View(dataclasses.replace(results, scores=scores))
    assert ranking.verdict(view, LAW).restitution == "gains energy"
    assert LAW not in ranking.best(view, view.band_runs)


def test_runs_are_ranked_by_their_error(view: View) -> None:
    grades = [row["grade"] for row in tables.ranking(view)]
    assert grades == sorted(grades, key=["good", "even", "bad"].index)


def claims(view: View) -> dict[str, list[str]]:
    return {row["setting"]: row["cells"][-len(CLAIMS) :] for row in tables.ranking(view)}


def test_claims_tell_pass_fail_and_not_resolved_apart(view: View) -> None:
    said = claims(view)
    assert said["law"] == ["✓"] * 4
    assert said["impulse"] == ["–", "–", "–", "✗"]
    assert said["broken"] == ["–"] * 4


def test_lost_impacts_are_reported_not_dropped(view: View) -> None:
    lost = len(SPEEDS) * 2 * len(ALPHAS)
    assert tables.failed_impacts(Views(None, view)) == [f"{lost} ended with their engine's crash"]
    assert view.curve(BROKEN, ALPHAS[1]) is None
