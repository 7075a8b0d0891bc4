"""Numbers and times in words; results of an earlier schema; units."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import pandas as pd
import pytest
from reported_results import LAW
from small_results import ALPHAS

from hcbench.benchmark.results import CONDITIONS, Results
from hcbench.benchmark.study import study_from
from hcbench.reporting import (
    advice,
    restitution_figures,
    wording,
)
from hcbench.reporting.conditions import views
from hcbench.reporting.drawings import loop_speeds, step_speed
from hcbench.reporting.view import View


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.06513, "0.0651"),
        (2.14e-5, "2.1·10⁻⁵"),
        (1e-16, "<10⁻¹²"),
        (math.nan, "–"),
        (1234.5, "1234"),
    ],
)
def test_small_numbers_in_words(value: float, text: str) -> None:
    assert wording.number(value) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(1e-6, "1 µs"), (5e-5, "50 µs"), (1e-3, "1 ms"), (1 / 240, "1/240 s"), (4e-3, "4 ms"), (2.0, "2 s")],
)
def test_times_in_words(seconds: float, text: str) -> None:
    assert wording.time(seconds).replace(wording.NBSP, " ") == text


def test_results_of_the_former_schema_are_read(results: Results, tmp_path: Path) -> None:
    """Schema 1 has no columns of gravity, place and friction, and no table of rests."""
    results.write(tmp_path)
    (tmp_path / "rests.csv").unlink()
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    summary["schema"] = 1
    for record in summary["settings"]:
        for name in CONDITIONS:
            del record[name]
    (tmp_path / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    for name in ("restitution", "loops", "scores", "trains"):
        table = pd.read_csv(tmp_path / f"{name}.csv").drop(columns=CONDITIONS)
        table.to_csv(tmp_path / f"{name}.csv", index=False)
    again = views(Results.read(tmp_path)).main
    assert again.band_runs == views(results).main.band_runs
    assert advice.headline(again) == advice.headline(views(results).main)


@pytest.mark.parametrize("unit", ["m/s", "in/s"])
def test_a_study_is_reported_in_the_unit_that_it_is_written_in(results: Results, unit: str) -> None:
    written = {"scene": "steel-plane", "alphas": "0.3 s/m", "speeds": f"0.1, 0.4 {unit}"}
    run = {"engine": "reference", "recipe": "hunt-crossley", "timesteps": "1e-5 s"}
    study = study_from({**written, "run": [run]}).described()
    assert study["speed_unit"] == unit
    shown = View(dataclasses.replace(results, study={**results.study, "speed_unit": unit}))
    for text in (advice.band_text(shown), loop_speeds(shown), step_speed(shown)):
        assert ("in/s" in text) == (unit == "in/s")
        assert unit in text
    figure = restitution_figures.restitution_figure(shown, [restitution_figures.Column("", ALPHAS[1], [LAW])])
    tops = [axis.get_xlabel() for axes in figure.axes for axis in axes.child_axes]
    assert ("in/s" in tops) == (unit == "in/s")
