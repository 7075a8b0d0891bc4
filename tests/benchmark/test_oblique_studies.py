"""Studies that launch obliquely: what their files have more, and what is drawn of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from in_place import in_place

from hcbench.benchmark.batch import OBLIQUE_COLUMNS
from hcbench.benchmark.results import IMPACT_COLUMNS, Results
from hcbench.benchmark.run import run_study
from hcbench.benchmark.study import study_from
from hcbench.checking.judge import judge_results
from hcbench.checking.text import as_text
from hcbench.reporting.tables import oblique
from hcbench.reporting.view import View
from hcbench.system.errors import StudyError

STUDY: dict[str, Any] = {
    "scene": "steel-plane",
    "alphas": "0.008 s/in",
    "speeds": "0.3, 2 m/s",
    "phases": 2,
    "loop_speeds": "0.3 m/s",
    "run": [
        {"engine": "reference", "recipe": "hunt-crossley", "timesteps": "1e-6 s"},
        {"engine": "mujoco", "recipe": "impulse", "timesteps": "1e-3 s"},
    ],
}
OBLIQUE = {**STUDY, "angles": "0, 45, 85 deg", "friction": 0.5}


@pytest.fixture(scope="module")
def results() -> Results:
    with in_place():
        return run_study(study_from(OBLIQUE))


@pytest.mark.usefixtures("without_processes")
def test_only_a_study_with_angles_has_their_columns(results: Results) -> None:
    assert list(results.impacts) == [*IMPACT_COLUMNS, *OBLIQUE_COLUMNS]
    plain = run_study(study_from(STUDY))
    assert list(plain.impacts) == IMPACT_COLUMNS
    assert not {"angles", "spin"} & {*plain.study, *plain.study["runs"][0]}


def test_each_speed_is_launched_at_each_angle_and_phase(results: Results, tmp_path: Path) -> None:
    rows = results.impacts[results.impacts["setting"] == "impulse"]
    assert len(rows) == 2 * 3 * 2
    assert np.degrees(rows["angle_rad"].unique()) == pytest.approx([0, 45, 85])
    slid = rows["speed_m_per_s"] * np.tan(rows["angle_rad"])
    assert rows["slip_in_m_per_s"].to_numpy() == pytest.approx(
        slid.to_numpy(), rel=1e-9
    )  # ten digits
    results.write(tmp_path)
    pd.testing.assert_frame_equal(
        Results.read(tmp_path).impacts, results.impacts, check_dtype=False
    )
    assert set(results.loops["engine"]) == {"reference", "mujoco"}
    assert (results.loops.groupby(["engine"])["time_s"].apply(lambda t: (t == 0).sum()) == 1).all()


def test_the_reference_has_coulombs_friction_and_one_row_of_mujoco_has_not(
    results: Results,
) -> None:
    law, row = (
        results.impacts[results.impacts["engine"] == name] for name in ("reference", "mujoco")
    )
    assert law["impulse_ratio"].to_numpy() == pytest.approx(
        law["impulse_ratio_coulomb"].to_numpy(), abs=1e-12
    )
    assert (row["restitution"] > 1.5).any()
    assert (row["energy_lost"] > 0).all()
    assert (row["impulse_ratio"] - row["impulse_ratio_coulomb"] > 0.1).any()


def test_check_of_a_study_gates_each_angle(results: Results) -> None:
    law, row = judge_results(results, 0.02).outcomes
    assert law.exit_code == 0
    assert [round(np.degrees(r.angle or 0.0)) for r in law.rows] == [0, 45, 85] * 2
    assert row.exit_code == 1
    assert "and 85 deg, limit" in row.message
    assert "deg" in as_text(judge_results(results, 0.02)).splitlines()[2]


def test_the_page_has_the_largest_errors_against_both_laws(results: Results) -> None:
    rows = {row["run"].setting: row for row in oblique(View(results))}
    assert list(rows) == ["hunt-crossley", "impulse"]
    assert rows["hunt-crossley"]["friction"] == "1e-7"
    impulse = results.impacts[results.impacts["setting"] == "impulse"]
    ratio = (impulse["impulse_ratio"] - impulse["impulse_ratio_coulomb"]).abs().max()
    assert float(rows["impulse"]["friction"]) == pytest.approx(ratio, rel=0.05)
    assert float(rows["impulse"]["largest_e"]) == pytest.approx(
        impulse["restitution"].max(), rel=5e-3
    )


@pytest.mark.usefixtures("without_processes")
def test_a_study_without_angles_has_no_such_table() -> None:
    assert not oblique(View(run_study(study_from({**STUDY, "run": STUDY["run"][:1]}))))


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("angles", "60", "below 90 deg"),
        ("angles", "-5 deg", "0 rad or more"),
        ("spin", "40 Hz", "60 rpm"),
        ("spin", "1, 2 rad/s", "one number, or three"),
        ("friction", -0.1, "0 or more"),
    ],
)
def test_what_is_no_angle_spin_or_friction_is_refused(key: str, value: Any, words: str) -> None:
    with pytest.raises(StudyError, match=words):
        study_from({**STUDY, key: value})


def test_spin_is_about_the_axis_across_unless_three_are_given() -> None:
    assert study_from({**STUDY, "spin": "60 rpm"}).runs[0].spin == pytest.approx(
        (0.0, 2 * np.pi, 0.0)
    )
    assert study_from({**STUDY, "spin": "1, 2, 3 rad/s"}).runs[0].spin == (1.0, 2.0, 3.0)
