"""Output of the study: the table of scores, the verdicts, and folders that are not overwritten."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hcbench.reality import evidence
from hcbench.reality.data_sets import smooth_least
from hcbench.reality.motion import SettingErrors
from hcbench.reality.page import build, errors_figure, page_text, verdicts
from hcbench.reality.study import NO_ENGINE, RealityRequest, RealityResults, SettingScore, csv_text
from hcbench.system.errors import UserError

COLUMNS = "set,engine,setting,cone,error,error_low,error_high,unit,rotation_deg,n"
ELLIPTIC = SettingScore(
    "cube", "mujoco", "friction alone", "elliptic", 13.3, 12.4, 14.4, "%", 14.8, 341
)
PYRAMIDAL = replace(ELLIPTIC, cone="pyramidal", error=23.2, error_low=22.0, error_high=24.5)
PLUGIN = replace(
    ELLIPTIC, setting="plug-in constant e", error=11.8, error_low=11.0, error_high=12.7
)
OTHER = replace(PLUGIN, engine="pybullet", cone="", error=12.2, error_low=11.4, error_high=13.1)


def results(*scores: SettingScore) -> RealityResults:
    return RealityResults(RealityRequest(["cube"]), {}, scores, {}, [], {}, [], [], {})


@pytest.mark.parametrize(
    ("errors", "labels"),
    [
        ((1.0, 20.0), ["1", "2", "5", "10", "20"]),
        ((2.6, 3.8), ["3", "4"]),
        ((3.0, 3.0), ["2.5", "3", "3.5"]),
        ((0.0, 10.0, 30.0), ["10", "20"]),
    ],
)
def test_the_axis_of_errors_has_round_ticks(errors: list[float], labels: list[str]) -> None:
    """A narrow range had no tick, and an error of 0 no figure."""
    scores = [replace(ELLIPTIC, error=error, error_low=error, error_high=error) for error in errors]
    (axes,) = errors_figure(scores, "%").axes
    assert [label.get_text() for label in axes.get_xticklabels()] == labels


def test_errors_of_0_alone_have_a_plain_axis() -> None:
    exact = replace(ELLIPTIC, error=0.0, error_low=0.0, error_high=0.0)
    (axes,) = errors_figure([exact], "%").axes
    assert (axes.get_xscale(), axes.get_xlabel()) == ("linear", "error, %")


def test_the_table_has_the_columns_that_others_read() -> None:
    text = csv_text([ELLIPTIC, replace(ELLIPTIC, set="ball", rotation_deg=None)])
    assert text.splitlines()[0] == COLUMNS
    rows = list(csv.DictReader(io.StringIO(text)))
    assert (rows[0]["error"], rows[0]["rotation_deg"], rows[1]["rotation_deg"]) == (
        "13.3",
        "14.8",
        "",
    )


def test_the_cost_of_the_pyramidal_cone_is_told_where_the_intervals_are_apart() -> None:
    assert "a factor 1.7" in " ".join(verdicts(results(ELLIPTIC, PYRAMIDAL)))
    unsure = replace(PYRAMIDAL, error=14.0, error_low=13.0, error_high=15.0)
    assert "factor" not in " ".join(verdicts(results(ELLIPTIC, unsure)))


def test_no_order_is_told_among_settings_whose_intervals_overlap() -> None:
    told = " ".join(verdicts(results(ELLIPTIC, PLUGIN, OTHER)))
    assert "No order among the 3 identified settings" in told
    apart = replace(PLUGIN, error=9.0, error_low=8.8, error_high=9.2)
    assert "No order" not in " ".join(verdicts(results(ELLIPTIC, apart, OTHER)))


def test_the_page_stands_alone(tmp_path: Path) -> None:
    floor = replace(ELLIPTIC, engine=NO_ENGINE, setting=evidence.NOISE, cone="")
    page = page_text(results(ELLIPTIC, PYRAMIDAL, PLUGIN, floor))
    assert "BSD-3-Clause" in page and "arXiv 2009.11193" in page
    assert 'src="http' not in page
    build(results(ELLIPTIC, PYRAMIDAL), tmp_path / "study")
    assert (tmp_path / "study" / "scores.csv").read_text().startswith(COLUMNS)


def test_a_study_of_more_sets_is_not_replaced(tmp_path: Path) -> None:
    both = [ELLIPTIC, replace(ELLIPTIC, set="ellipse")]
    study = results(*both)
    build(replace(study, request=RealityRequest(["cube", "ellipse"])), tmp_path / "study")
    with pytest.raises(UserError, match="ellipse"):
        build(results(ELLIPTIC), tmp_path / "study")


def test_the_best_of_each_toss_is_by_its_own_score() -> None:
    outcomes = [
        SettingErrors(np.array([1.0, 9.0]), np.array([0.1, 0.9]), np.array([0.0, 0.0])),
        SettingErrors(np.array([8.0, 2.0]), np.array([0.8, 0.2]), np.array([0.0, 0.0])),
    ]
    assert evidence.best(outcomes).errors.tolist() == [1.0, 2.0]


def test_a_parabola_through_tries_is_less_rough_than_the_best_of_them() -> None:
    noise = np.random.default_rng(0)
    true = np.array([0.1, -0.2])
    points = [noise.normal(0.0, 0.3, 2) for _ in range(90)]
    tries = [(u, float(((u - true) ** 2).sum() + noise.normal(0.0, 0.01))) for u in points]
    luckiest = min(tries, key=lambda pair: pair[1])[0]
    smooth = smooth_least(tries)
    assert np.linalg.norm(smooth - true) < min(0.05, float(np.linalg.norm(luckiest - true)))
