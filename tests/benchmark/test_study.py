"""Studies: the same inputs give the same bytes, and failures are rows."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from machines import other_kernels

from hcbench.benchmark.plan import file_digest, make_plan
from hcbench.benchmark.results import RUN_KEY, ImpactTable, Results
from hcbench.benchmark.run import run_study
from hcbench.benchmark.study import Study, find_study, load_study, name_of, study_from
from hcbench.recipes.target import default_band
from hcbench.sim import registry
from hcbench.system.errors import StudyError
from hcbench.system.files import atomic_folder
from hcbench.terms.impact import Trajectory
from hcbench.tuning.ask import tune

CONTENT: dict[str, Any] = {
    "scene": "steel-plane",
    "alphas": "0.004, 0.008 s/in",
    "speeds": "4, 10, 16 in/s",
    "loop_speeds": "10 in/s",
    "phases": 2,
    "run": [
        {"engine": "reference", "recipe": "hunt-crossley", "timesteps": 1e-6},
        {"engine": "mujoco", "recipe": "impulse", "timesteps": 1e-3},
        {"engine": "mujoco", "recipe": "stock", "timesteps": 2e-3},
    ],
}
if registry.is_there("pybullet"):
    CONTENT["run"] += [{"engine": "pybullet", "recipe": "restitution", "timesteps": 1e-3}]


@pytest.fixture(scope="module")
def study() -> Study:
    return study_from(CONTENT)


@pytest.fixture(scope="module")
def results(study: Study) -> Results:
    return run_study(study, jobs=2)


@pytest.fixture(scope="module")
def progress() -> list[tuple[int, int]]:
    return []


@pytest.fixture(scope="module")
def by_one_job(study: Study, progress: list[tuple[int, int]]) -> Results:
    return run_study(study, jobs=1, progress=lambda done, total: progress.append((done, total)))


def test_every_impact_asked_for_is_a_row(results: Results) -> None:
    runs, alphas, speeds, phases = len(CONTENT["run"]), 2, 3, 2
    assert len(results.impacts) == runs * alphas * speeds * phases
    assert len(results.scores) == runs * alphas == len(results.settings)
    assert results.impacts["status"].isin(["parted", "rested"]).all()


def test_loops_are_kept_where_asked_and_nowhere_else(results: Results) -> None:
    assert results.loops["speed_m_per_s"].unique() == pytest.approx([0.254])
    assert set(results.loops["engine"]) >= {"reference", "mujoco"}


def test_what_was_measured_is_written_in_ten_digits_and_what_was_asked_in_all(
    results: Results,
) -> None:
    """Another processor's arithmetic differs in the last ones of sixteen."""
    for table in (results.impacts, results.loops, results.scores):
        for name in set(table.select_dtypes("float").columns) - {
            *RUN_KEY,
            "speed_m_per_s",
            "phase",
        }:
            values = table[name].to_numpy()
            assert [float(f"{v:.9e}") for v in values] == pytest.approx(
                values.tolist(), rel=0, abs=0, nan_ok=True
            )
    assert set(results.impacts["alpha_s_per_m"]) == set(study_from(CONTENT).alphas)


def test_all_loops_keeps_every_speed_of_the_band_and_scores_as_before(results: Results) -> None:
    everything = run_study(study_from({**CONTENT, "all_loops": True}))
    assert set(everything.loops["speed_m_per_s"]) == set(everything.impacts["speed_m_per_s"])
    assert (
        len(everything.loops.groupby([*RUN_KEY, "speed_m_per_s"])) == len(CONTENT["run"]) * 2 * 3
    )  # runs, α, speeds
    pd.testing.assert_frame_equal(everything.scores, results.scores)


def test_the_reference_is_scored_perfect_against_its_own_law(results: Results) -> None:
    own = results.scores[results.scores["engine"] == "reference"]
    assert (own["max_error_law"] < 1e-14).all()
    assert (own["loop_rms"] < 1e-3).all()


def test_the_number_of_jobs_does_not_change_a_byte(
    tmp_path: Path, by_one_job: Results, results: Results
) -> None:
    texts = []
    for name, found in (("two", results), ("one", by_one_job)):
        with atomic_folder(tmp_path / name) as scratch:
            found.write(scratch)
        texts.append({p.name: p.read_bytes() for p in sorted((tmp_path / name).iterdir())})
    tables = [
        "loops.csv",
        "restitution.csv",
        "rests.csv",
        "scores.csv",
        "summary.json",
        "trains.csv",
    ]
    assert sorted(texts[0]) == ["hcbench-files.json", *tables]
    assert texts[0] == texts[1]


def test_an_old_processors_kernels_do_not_change_a_byte(
    tmp_path: Path, study: Study, results: Results
) -> None:
    """NumPy without the instructions that it can do without, and
    OpenBLAS as on a Prescott, 4 threads.
    """
    code = (
        "import json, sys; from pathlib import Path; from hcbench.benchmark.run import run_study;"
        "from hcbench.benchmark.study import study_from; from hcbench.system.files import atomic_folder;"
        "found = run_study(study_from(json.loads(sys.argv[1])), jobs=1)\n"
        "with atomic_folder(Path(sys.argv[2])) as scratch: found.write(scratch)"
    )
    environment = os.environ | other_kernels() | {"OMP_NUM_THREADS": "4"}
    command = [sys.executable, "-c", code, json.dumps(CONTENT), str(tmp_path / "old")]
    subprocess.run(command, env=environment, check=True)
    with atomic_folder(tmp_path / "here") as scratch:
        results.write(scratch)
    texts = [
        {p.name: p.read_bytes() for p in sorted((tmp_path / name).iterdir())}
        for name in ("here", "old")
    ]
    assert texts[0] == texts[1]


def test_results_read_back_as_they_were_written(tmp_path: Path, results: Results) -> None:
    results.write(tmp_path)
    back = Results.read(tmp_path)
    for name in ("impacts", "loops", "scores"):
        pd.testing.assert_frame_equal(
            getattr(back, name), getattr(results, name), check_dtype=False
        )
    assert back.summary()["settings"] == results.summary()["settings"]


def test_a_setting_that_does_not_depend_on_alpha_is_scored_against_each(results: Results) -> None:
    stock = results.impacts[
        (results.impacts["engine"] == "mujoco") & (results.impacts["setting"] == "stock")
    ]
    by_alpha = [group["restitution"].to_numpy() for _, group in stock.groupby("alpha_s_per_m")]
    assert np.array_equal(by_alpha[0], by_alpha[1])


@pytest.mark.usefixtures("by_one_job")
def test_progress_reaches_the_end(progress: list[tuple[int, int]]) -> None:
    assert progress[-1][0] == progress[-1][1] > 0
    assert [done for done, _ in progress] == sorted(done for done, _ in progress)


def test_a_quick_study_is_a_smaller_one(study: Study) -> None:
    full = load_study(find_study("steel-1lb"))
    quick = full.quick()
    assert 3 <= len(quick.speeds) < len(full.speeds)
    assert quick.phases < full.phases
    assert {run.engine for run in quick.runs} == {run.engine for run in full.runs}
    assert not {run.recipe for run in quick.runs} & {"soft", "two-pair"}
    assert {run.alphas for run in quick.runs} == {quick.alphas} == {(full.main_alpha,)}
    assert "5 of 20 speeds, 4 of 8 phases, 1 of 4 α" in quick.left_out
    assert quick.described()["left_out"] == quick.left_out
    assert "left_out" not in full.described()


def test_a_quick_study_keeps_both_heights_of_two_and_the_only_step() -> None:
    two = study_from(CONTENT)
    drops = dataclasses.replace(two.runs[0], dropped=True, speeds=(0.5, 1.5), timesteps=(1e-3,))
    (run,) = dataclasses.replace(two, runs=(drops,)).quick().runs
    assert run.speeds == (0.5, 1.5)
    launched = dataclasses.replace(two.runs[0], speeds=two.speeds, timesteps=(1e-3,))
    (run,) = dataclasses.replace(two, runs=(launched,), page="field").quick().runs
    assert run.timesteps == (1e-3,)


def test_a_study_of_which_a_preview_would_be_empty_says_so() -> None:
    oblique = study_from({**CONTENT, "angles": "30 deg", "gravity": 9.81, "friction": 0.5})
    with pytest.raises(StudyError, match="quick: every run is oblique"):
        oblique.quick()


@pytest.mark.parametrize("key", ["scene", "alphas", "speeds", "run"])
def test_a_study_without_an_essential_is_refused_by_name(key: str) -> None:
    with pytest.raises(StudyError, match=key):
        study_from({k: v for k, v in CONTENT.items() if k != key})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("phases", 0),
        ("phases", 1.5),
        ("schema", 9),
        ("run", "x"),
        ("step_speed", -1),
        ("step_speed", 0.123),
        ("main_alpha", 0.123),
    ],
)
def test_a_wrong_value_is_refused_by_name(key: str, value: object) -> None:
    with pytest.raises(StudyError, match=key):
        study_from({**CONTENT, key: value})


SCRIPT = """
from hcbench import load_study, run_study
results = run_study(load_study(__import__("pathlib").Path("study.toml")), jobs=2)
print(set(results.impacts["status"]))
"""


def test_a_script_without_a_main_guard_can_run_a_study(tmp_path: Path) -> None:
    text = 'scene = "steel-plane"\nalphas = 0.3\nspeeds = "0.1, 0.2"\n[[run]]\nengine = "mujoco"\n'
    (tmp_path / "study.toml").write_text(
        text + 'recipe = "impulse"\ntimesteps = 1e-3\n', encoding="utf-8"
    )
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stdout.strip() == "{'parted'}", done.stderr


def test_a_study_is_called_by_its_folder_or_by_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "balls"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for path in ("study.toml", "./study.toml", "../balls/study.toml", folder / "study.toml"):
        assert name_of(Path(path)) == "balls"
    assert name_of(Path("other.toml")) == "other"


def test_a_study_is_loaded_from_a_path_in_text_too(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(
        'scene = "steel-plane"\nalphas = 0.3\nspeeds = 0.1\n'
        '[[run]]\nengine = "reference"\nrecipe = "hunt-crossley"\ntimesteps = 1e-5\n',
        encoding="utf-8",
    )
    assert load_study(str(tmp_path / "study.toml")) == load_study(tmp_path / "study.toml")
    with pytest.raises(StudyError, match="does not exist"):
        load_study("nowhere.toml")


def test_run_keys_identify_a_score(results: Results) -> None:
    assert not results.scores.duplicated(RUN_KEY).any()


@given(st.integers(2, 60), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 2e-3, 0.1]))
def test_a_simplified_loop_stays_within_its_tolerance(
    count: int, seed: int, tolerance: float
) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.1, 1.0, count))
    whole = Trajectory(time, *np.cumsum(rng.normal(size=(3, count)), axis=1))
    thin = whole.simplified(tolerance)
    assert thin.time[[0, -1]].tolist() == time[[0, -1]].tolist()
    for name in ("penetration", "rate", "force"):
        values, kept = getattr(whole, name), getattr(thin, name)
        off = np.abs(np.interp(time, thin.time, kept) - values).max()
        assert off <= (tolerance + 1e-12) * np.abs(values).max()


def test_a_loop_of_straight_lines_keeps_only_its_corners() -> None:
    x = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, 0, 50)[1:]])
    thin = Trajectory(np.arange(99.0), x, 1 - x, 3 * x).simplified(2e-3)
    assert thin.penetration.tolist() == [0.0, 1.0, 0.0]


def test_a_run_over_the_default_band_has_the_settings_that_tune_prints() -> None:
    run = {"engine": "mujoco", "recipe": "impulse", "timesteps": "1e-3, 2e-3 s", "default_band": 5}
    study = study_from({**CONTENT, "run": [{**run, "gravity": "9.81 m/s^2"}]})
    assert [(each.timesteps, each.dropped) for each in study.runs] == [
        ((1e-3,), True),
        ((2e-3,), True),
    ]
    for each in study.runs:
        low, high = default_band(each.timesteps[0], 9.81)
        assert (each.speeds[0], each.speeds[-1], len(each.speeds)) == (low, high, 5)
    records = make_plan(study).records
    answer = tune(
        "mujoco",
        timestep=2e-3,
        alpha=study.alphas[1],
        kind="constant",
        recipe="impulse",
        friction=0.0,
    )
    assert records[-1]["options"] == answer.best.setting.options
    for wrong in (run, {**run, "gravity": "9.81 m/s^2", "heights": "1, 2 mm"}):
        with pytest.raises(StudyError, match="default_band"):
            study_from({**CONTENT, "run": [wrong]})


def test_files_that_name_each_other_in_a_circle_have_a_digest(tmp_path: Path) -> None:
    first, second = tmp_path / "first.xml", tmp_path / "second.xml"
    first.write_text('<mujoco><include file="second.xml"/></mujoco>')
    second.write_text('<mujoco><include file="first.xml"/></mujoco>')
    before = file_digest(first)
    second.write_text('<mujoco><include file="first.xml"/><!-- changed --></mujoco>')
    assert file_digest(first) != before


@pytest.mark.parametrize(
    ("speeds", "unit"),
    [
        ("4, 16 in/s", "in/s"),
        ("16in/s", "in/s"),
        (["4 inch/s"], "in/s"),
        ("3, 12 m/min", "m/s"),
        ([0.1, 0.2], "m/s"),
    ],
)
def test_a_page_shows_inches_where_the_study_states_its_speeds_in_them(
    speeds: object, unit: str
) -> None:
    run = {"engine": "reference", "recipe": "hunt-crossley", "timesteps": "1 us"}
    content = {"scene": "steel-plane", "alphas": "0.008 s/in", "speeds": speeds, "run": [run]}
    assert study_from(content).speed_unit == unit


def test_a_table_of_no_settings_has_its_columns_and_no_impacts(results: Results) -> None:
    none = ImpactTable.of(results.impacts, results.study).only([])
    assert len(none) == len(none.frame) == 0
    assert list(none.frame.columns) == list(results.impacts.columns)
