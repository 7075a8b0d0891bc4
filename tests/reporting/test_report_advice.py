"""Advice, verdicts and claims of a page follow from the scores. A page leads with what was dropped under
gravity; a setting that fails at rest is not advised.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path

import pandas as pd
import pytest
from reported_results import IMPULSE, LAW, SPRING, STOCK, dropped
from small_results import ALPHAS, RUNS, SCENE, SPEEDS, small_results

from hcbench.benchmark.results import ImpactTable, Results
from hcbench.reporting import ranking, tables, wording
from hcbench.reporting.build import build
from hcbench.reporting.tables import Views, under
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


def both(without_gravity: Results, with_gravity: Results) -> Results:
    names = ("impacts", "loops", "scores", "rests")
    pairs = {name: (getattr(without_gravity, name), getattr(with_gravity, name)) for name in names}
    tables_of_both = {name: pd.concat([t for t in pair if len(t)]) for name, pair in pairs.items()}
    table = ImpactTable.of(tables_of_both.pop("impacts"), without_gravity.study)
    settings = [*without_gravity.settings, *with_gravity.settings]
    return dataclasses.replace(without_gravity, settings=settings, table=table, **tables_of_both)


def test_the_page_leads_with_what_was_dropped_and_ranks_both(
    results: Results, tmp_path: Path
) -> None:
    found = both(results, dropped(results, 9.81, law=(5e-3, 0.0), spring_damper=(5e-3, 0.0)))
    page = build(found, tmp_path).read_text(encoding="utf-8")
    assert "this command finds it" in page
    data = json.loads(re.findall(r'id="explorer-data">(.*?)</script>', page, re.S)[0])
    assert data["start"]["gravity"] == 9.81
    rows = {(row["gravity"], row["setting"]): row for row in data["ranking"]}
    assert "sinks 5\N{NO-BREAK SPACE}mm at rest" in rows[9.81, "law"]["also"]
    assert rows[9.81, "law"]["grade"] == "bad"
    assert rows[0.0, "law"]["verdict"] == "follows the law"
    assert rows[0.0, "law"]["also"].startswith("loop right; under gravity sinks")
    assert "sinks" not in rows[9.81, "impulse"]["also"]


@pytest.mark.parametrize(
    ("depth", "motion", "lacks"),
    [
        (9e-5, 9e-6, ()),
        (1.1e-4, 0.0, ("sinks 0.11 mm at rest",)),
        (1e-6, 1.1e-5, ("does not come to rest",)),
        (math.nan, math.nan, ("does not come to rest",)),
    ],
)
def test_a_setting_that_sinks_or_moves_at_rest_is_not_advised(
    results: Results, depth: float, motion: float, lacks: tuple[str, ...]
) -> None:
    """By g h², 9.81 µm at 1 ms: ten times of it deep, once of it in motion."""
    view = View(under(dropped(results, 9.81, impulse=(depth, motion)), 9.81))
    found = tuple(text.replace(wording.NBSP, " ") for text in ranking.lacks(view, IMPULSE))
    assert found == lacks
    assert (IMPULSE in ranking.best(view, [IMPULSE])) == (not lacks)
    assert (ranking.verdict(view, IMPULSE).grade == "bad") == bool(lacks)


def test_a_contact_deeper_than_any_step_needs_is_not_advised(results: Results) -> None:
    """Deeper than 2.5 times the way of a step at the highest speed."""
    with_gravity, limit = dropped(results, 9.81), 2.5 * SPEEDS[-1] * 1e-3
    for share, advised in ((0.99, True), (1.01, False)):
        impacts = with_gravity.impacts.assign(penetration_max_m=share * limit)
        table = ImpactTable.of(impacts, with_gravity.study)
        view = View(under(dataclasses.replace(with_gravity, table=table), 9.81))
        assert (ranking.best(view, [IMPULSE]) == [IMPULSE]) == advised


def test_what_ran_on_the_flat_alone_stands_in_and_is_marked(results: Results) -> None:
    flat = {"scene": "elsewhere"}
    moved = dropped(results, 0.0)
    scenes = {name: {"form": "plane", "relative_radius_m": 0.05} for name in (SCENE, "elsewhere")}
    own = [record for record in results.settings if record["setting"] != "law"]
    there = [{**record, **flat} for record in results.settings]

    def also_there(table: pd.DataFrame) -> pd.DataFrame:
        return pd.concat([table[table["setting"] != "law"], table.assign(**flat)])

    found = dataclasses.replace(
        moved,
        study={**results.study, "scenes": scenes},
        settings=[*own, *there],
        table=ImpactTable.of(also_there(results.impacts), results.study),
        loops=also_there(results.loops),
        scores=also_there(results.scores),
    )
    view = View(under(found, 0.0))
    assert RunKey(*LAW[:3], "on a flat plate") in view.band_runs
    assert IMPULSE in view.band_runs
    assert RunKey(*IMPULSE[:3], "on a flat plate") not in view.band_runs
    sentences = " ".join(ranking.advised(view)).replace(wording.NBSP, " ")
    assert "explicit law on a flat plate, step 1 µs" in sentences


def test_several_engines_that_break_the_law_are_the_subject_of_one_sentence() -> None:
    other = [("explicit", *run[1:]) for run in RUNS if run[1] == "stock"]
    stock_only = View(small_results([*(run for run in RUNS if run[1] == "stock"), *other]))
    assert ranking.advised(stock_only) == [
        "With nothing set single and explicit do not bounce like the law."
    ]
