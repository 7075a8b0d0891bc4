"""A page's headline, verdicts and claims follow from the scores."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from reported_results import IMPULSE, LAW, SPRING, STOCK
from small_results import ALPHAS, RUNS, SPEEDS, small_results

from hcbench.benchmark.results import Results
from hcbench.reporting import (
    advice,
    loop_figures,
    ranking,
    tables,
    wording,
)
from hcbench.reporting.build import build
from hcbench.reporting.conditions import Views
from hcbench.reporting.view import RunKey, View

BROKEN = RunKey("explicit", "broken", 1e-3)


def test_the_headline_names_what_follows_the_law_and_what_does_not(view: View) -> None:
    said = " ".join(advice.headline(view)).replace(wording.NBSP, " ")
    assert "single does not bounce like the law" in said
    assert "In single set impulse at 1 ms: the best constant e" in said
    assert "In explicit set law at 1 µs: the bounce follows the law" in said
    assert "spring-damper" not in said


def test_a_bounce_in_a_soft_contact_is_promised_without_gravity(results: Results) -> None:
    scores = results.scores.copy()
    scores.loc[scores["setting"] == "law", "penetration_ratio"] = 30.0
    said = advice.headline(View(dataclasses.replace(results, scores=scores)))
    promise = "the bounce follows the law, without gravity and in a far softer contact."
    assert promise in said[-1] + said[-2]


@pytest.mark.parametrize("count", range(1, 13))
def test_no_panel_stands_alone_in_the_last_row(count: int) -> None:
    columns = loop_figures.panel_columns(count)
    assert count == columns or count % columns != 1


def test_a_plug_in_is_distinguished_from_what_can_be_set(results: Results) -> None:
    settings = [
        {**s, "options": {"law": {"alpha": 1.0}}} if s["setting"] == "law" else s for s in results.settings
    ]
    view = View(dataclasses.replace(results, settings=settings))
    said = " ".join(advice.headline(view)).replace(wording.NBSP, " ")
    assert "In explicit set spring-damper at 1 µs: further from the law than the best constant e." in said
    assert advice.plugin_sentence(view).replace(wording.NBSP, " ") == (
        "The plug-in law at 1 µs (in explicit) follows the law."
    )
    titles = {card.question: [a.title for a in card.advice] for card in advice.cards(view)}
    assert [t.replace(wording.NBSP, " ") for t in titles["A plug-in in your own simulation"]] == [
        "explicit law, 1 µs"
    ]


def test_the_headline_says_when_nothing_follows_the_law() -> None:
    constant_only = small_results([run for run in RUNS if run[1] in ("impulse", "stock")])
    said = " ".join(advice.headline(View(constant_only)))
    assert "follows the law" not in said
    assert "the best constant e" in said


def test_settings_that_differ_by_round_off_are_both_named(results: Results) -> None:
    scores = results.scores.copy()
    scores.loc[scores["setting"] == "impulse", "max_error_law"] = 1e-13
    scores.loc[scores["setting"] == "law", "max_error_law"] = 1e-16
    view = View(dataclasses.replace(results, scores=scores))
    assert ranking.best(view, view.band_runs) == [LAW, IMPULSE]


def test_an_engine_as_it_comes_is_no_advice() -> None:
    stock_only = View(small_results([run for run in RUNS if run[1] == "stock"]))
    assert advice.headline(stock_only) == ["With nothing set single does not bounce like the law."]


def test_a_law_without_damping_has_a_page_too(tmp_path: Path) -> None:
    """α = 0: no constant to beat, no energy to plot; nothing divides by either."""
    lossless = small_results([("explicit", "law", 1e-6, (0.0,), SPEEDS)])
    study = {**lossless.study, "alphas": [0.0], "main_alpha": 0.0}
    page = build(dataclasses.replace(lossless, study=study), tmp_path)
    words_of_it = re.sub(r"base64,[^\"]*|<style>.*</style>", "", page.read_text(encoding="utf-8"), flags=re.S)
    assert "explicit" in words_of_it
    assert not re.search(r"\b(nan|inf)\b", words_of_it)


def test_a_study_of_the_law_alone_has_a_page_too(results: Results, tmp_path: Path) -> None:
    nothing = {n: getattr(results, n).iloc[:0] for n in ("impacts", "loops", "scores")}
    empty = Results(results.study, [], results.versions, **nothing)
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
def test_verdicts_go_by_the_scores(view: View, run: RunKey, bounce: str, grade: str, loop: str) -> None:
    assert ranking.verdict(view, run) == ranking.RunVerdict(bounce, grade, loop)


def test_energy_gained_is_said_whatever_the_error(results: Results) -> None:
    scores = results.scores.copy()
    scores.loc[scores["setting"] == "law", "energy_gained"] = True
    view = View(dataclasses.replace(results, scores=scores))
    assert ranking.verdict(view, LAW).restitution == "gains energy"
    assert LAW not in ranking.best(view, view.band_runs)
    assert LAW not in ranking.best_loops(view, view.band_runs)


def test_runs_are_ranked_by_their_error(view: View) -> None:
    for group in tables.ranking(view):
        grades = [row["verdict"].grade for row in group["rows"]]
        assert grades == sorted(grades, key=["good", "even", "bad"].index)


def test_claims_tell_pass_fail_and_not_resolved_apart(view: View) -> None:
    said = {row["run"].setting: [cell["words"] for cell in row["cells"]] for row in tables.claims(view)}
    assert said["law"] == ["pass"] * 4
    assert said["impulse"][:3] == ["not resolved"] * 3
    assert said["impulse"][3] == "fail"
    assert said["broken"] == ["not resolved"] * 4


def test_one_bad_alpha_fails_a_claim(results: Results) -> None:
    scores = results.scores.copy()
    hit = (scores["setting"] == "law") & np.isclose(scores["alpha_s_per_m"], ALPHAS[0])
    scores.loc[hit, "no_tension"] = False
    cells = tables.claims(View(dataclasses.replace(results, scores=scores)))[0]["cells"]
    assert [cell["words"] for cell in cells] == ["pass", "fail for 1 of 2 α", "pass", "pass"]


def test_lost_impacts_are_reported_not_dropped(view: View) -> None:
    lost = {row["run"].setting: row for row in tables.failed_impacts(Views(None, view))}
    assert lost["broken"]["impacts"] == len(SPEEDS) * 2 * len(ALPHAS)
    assert lost["broken"]["reason"] == "the engine's process died on it"
    assert view.curve(BROKEN, ALPHAS[1]) is None
