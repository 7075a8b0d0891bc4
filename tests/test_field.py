"""The field report: engines beside each other, what is missing named, the same bytes but for the costs."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from hcbench.benchmark.run import run_study
from hcbench.benchmark.study import find_study, load_study, study_from
from hcbench.errors import StudyError
from hcbench.report.build import build
from hcbench.report.field.headline import headline
from hcbench.report.field.matrix import COLUMNS, matrix
from hcbench.report.field.page import COST
from hcbench.report.field.view import Case, FieldView
from hcbench.sim import registry
from hcbench.sim.features import Features

if TYPE_CHECKING:
    from pathlib import Path

RUNS = [
    {"engine": "reference", "recipe": "hunt-crossley", "timesteps": "1e-5 s"},
    {"engine": "mujoco", "recipe": "stock", "timesteps": "1e-3 s"},
    {"engine": "mujoco", "recipe": "impulse", "timesteps": "1e-5, 1e-3 s"},
    {"engine": "mujoco", "recipe": "impulse", "timesteps": "1e-3 s", "gravity": "9.81 m/s^2"},
    {"engine": "mujoco", "recipe": "staggered", "timesteps": "1e-5 s"},
    {"engine": "mujoco@0.1", "recipe": "impulse", "timesteps": "1e-3 s"},
]
STUDY = {
    "scene": "steel-plane",
    "alphas": "0.008 s/in",
    "speeds": "4, 8, 16 in/s",
    "loop_speeds": "8 in/s",
    "step_speed": "8 in/s",
    "phases": 2,
    "page": "field",
}


@pytest.fixture(scope="module")
def view() -> FieldView:
    pytest.importorskip("mujoco")
    return FieldView(run_study(study_from({**STUDY, "run": RUNS})))


def test_the_best_setting_is_the_one_nearest_to_the_law(view: FieldView) -> None:
    best = view.best("mujoco", 0.0, 1e-5)
    assert best == Case("mujoco", "staggered", 0.0, 1e-5)
    assert view.follows_law(best)
    coarse = view.best("mujoco", 0.0, 1e-3)
    assert coarse is not None
    assert view.error(coarse) == pytest.approx(view.constant_error, rel=1e-3), "one e, the best there is"


def test_the_headline_names_who_follows_the_law_and_who_is_nearest_under_gravity(view: FieldView) -> None:
    law, robots, *_ = headline(view)
    version = registry.engine("mujoco").version()
    assert (
        f"At a step of 10\u00a0µs these follow the law by settings of their own: MuJoCo {version} staggered"
        in law
    )
    assert f"At 1\u00a0ms under gravity the nearest are MuJoCo {version} impulse" in robots


def test_an_engine_that_is_not_there_is_named_and_left_out(view: FieldView) -> None:
    assert view.study["missing"] == ["mujoco@0.1"]
    assert view.engines == ["mujoco"]
    with pytest.raises(StudyError, match="none of its engines is there"):
        run_study(study_from({**STUDY, "run": RUNS[-1:]}))


def test_every_cell_of_the_features_says_where_it_is_from(view: FieldView) -> None:
    ((engine, cells),) = matrix(view, {})
    assert engine == "mujoco"
    assert len(cells) == len(COLUMNS)
    assert all(cell.source for cell in cells if cell.text != "–")
    by_name = dict(zip(COLUMNS, cells, strict=True))
    assert re.fullmatch(r"yes: its area is the energy lost to .*%", by_name["loop"].text)
    assert by_name["by_speed"].text.startswith("its own: staggered, ")


def test_an_engine_says_its_own_features() -> None:
    features = registry.submodule("mujoco", "features").FEATURES
    assert isinstance(features, Features)
    assert features.licence.text == "Apache-2.0"


def test_the_page_and_its_tables_are_the_same_bytes_the_costs_apart(view: FieldView, tmp_path: Path) -> None:
    for name in ("one", "two"):
        build(view.results, tmp_path / name)
    one, two = (
        {p.relative_to(f): p for p in f.rglob("*") if p.is_file()}
        for f in (tmp_path / "one", tmp_path / "two")
    )
    assert one.keys() == two.keys()
    own = ("hcbench-files.json", COST)
    assert [p for p in one if one[p].read_bytes() != two[p].read_bytes() and p.name not in own] == []
    page = one.keys() and (tmp_path / "one" / "index.html").read_text(encoding="utf-8")
    assert "hcbench engines add mujoco@0.1" in page
    cost = (tmp_path / "one" / COST).read_text(encoding="utf-8").splitlines()
    assert cost[0].startswith("# ")
    assert cost[1] == "engine,setting,timestep_s,balls,us_a_ball_step"
    assert 0.01 < float(cost[2].rsplit(",", 1)[1]) < 1e4


def test_the_study_in_the_wheel_names_engines_that_are_registered() -> None:
    study = load_study(find_study("field"))
    assert study.page == "field"
    assert {registry.base_name(run.engine) for run in study.runs} <= set(registry.names())
    for run in study.runs:
        assert registry.recipe(f"{run.engine}.{run.recipe}").name == run.recipe
