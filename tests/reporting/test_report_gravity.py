"""A page leads with what was dropped under gravity; a setting that fails at rest is not advised."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from pathlib import Path

import pandas as pd
import pytest
from reported_results import IMPULSE, LAW, dropped
from small_results import SCENE, SPEEDS

from hcbench.benchmark.results import ImpactTable, Results
from hcbench.reporting import ranking, wording
from hcbench.reporting.build import build
from hcbench.reporting.tables import under
from hcbench.reporting.view import RunKey, View


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
