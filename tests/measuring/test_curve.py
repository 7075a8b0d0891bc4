"""e over speed: one point for all phases of a launch speed, the same wherever it is shown."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from checks import GOOD

import hcbench as hb
from hcbench.benchmark.results import FOLDED, Folder
from hcbench.benchmark.run import run_study
from hcbench.benchmark.study import load_study
from hcbench.checking.judge import judge_results
from hcbench.checking.text import as_text
from hcbench.measuring.curve import CurvePoint, curve_of, step_shares, worst_of
from hcbench.pytest_plugin import RestitutionFixture
from hcbench.reporting.view import View
from hcbench.system.files import json_text
from hcbench.terms.impact import Impact, Launch, Status


def impacts(e_of_phase: dict[float, float], speed: float = 2.0) -> list[Impact]:
    """Impacts at one speed. e_of_phase: e of each phase."""
    return [
        Impact(Launch(speed, phase), Status.PARTED, speed_in=speed, speed_out=speed * e, samples=9)
        for phase, e in e_of_phase.items()
    ]


def test_a_phase_stands_for_half_of_the_gaps_beside_it() -> None:
    phases, starts = np.array([0.3, 0.0, 0.5, 0.75]), np.array([0, 1])
    assert step_shares(phases, starts) == pytest.approx([1.0, 0.375, 0.375, 0.25])


def test_each_phase_weighs_by_its_share_however_many_there_are() -> None:
    """A step of which a quarter bounces by 0.4 and the rest by 0.8 has a mean e of 0.7."""
    even = {0.125: 0.4, 0.375: 0.8, 0.625: 0.8, 0.875: 0.8}
    finer = even | {0.0: 0.4, 0.25: 0.8, 0.0625: 0.4, 0.1875: 0.4}
    (coarse,) = curve_of(impacts(even))
    (fine,) = curve_of(impacts(finer))
    assert coarse.restitution == pytest.approx(0.7)
    # 0.4 now stands for the phases from -0.0625 to 0.21875.
    assert fine.restitution == pytest.approx(0.8 - 0.4 * 0.28125)


def test_the_error_is_that_of_the_mean_and_the_worst_phase_has_its_own() -> None:
    (point,) = curve_of(impacts({0.25: 0.7, 0.75: 0.9}), lambda _: 0.85)
    assert point.error == point.restitution - point.target == pytest.approx(-0.05)
    assert point.worst_phase == pytest.approx(-0.15)
    assert point.spread == pytest.approx(0.2)
    assert worst_of([point]) is point
    assert worst_of(curve_of(impacts({0.5: 0.7}))) is None


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_worst_point_is_as_wrong_above_the_target_as_below(sign: float) -> None:
    near, far = impacts({0.5: 0.7 - sign * 0.1}, 1.0), impacts({0.5: 0.7 + sign * 0.2}, 2.0)
    worst = worst_of(curve_of([*near, *far], lambda _: 0.7))
    assert worst is not None
    assert worst.speed == 2.0
    assert worst.worst_phase == pytest.approx(sign * 0.2)


def test_e_and_target_are_means_over_the_same_phases() -> None:
    """A baseline may lack a phase: the row still adds up."""
    before = {0.25: 0.7, 0.75: 0.9, 0.5: float("nan")}
    now = impacts({0.25: 0.7, 0.75: 0.9, 0.5: 0.1})
    (point,) = curve_of(now, lambda impact: before[impact.launch.phase])
    assert point.error == 0.0
    assert point.failed == 0


def in_json(points: Iterable[CurvePoint]) -> Any:
    """Every digit of some points; NaN as null, so that equal points are equal."""
    return json.loads(json_text([point.record(is_oblique=True) for point in points]))


def test_measure_check_and_the_fixture_give_the_same_curve_to_the_last_bit() -> None:
    speeds = "0.1, 0.3, 1 m/s"
    measured = hb.measure(GOOD, "ball,plate", restitution=0.9, speeds=speeds)
    (outcome,) = hb.check(
        GOOD, "ball,plate", restitution=0.9, speeds=speeds, max_error=0.1
    ).outcomes
    assert outcome.measurement is not None
    fixture = RestitutionFixture({}, Path.cwd())
    held = fixture(GOOD, "ball,plate", speeds=speeds).matches(0.9, max_error=0.1)
    curve = in_json(measured.curve)
    assert len(curve) == 3
    assert (
        in_json(outcome.rows) == in_json(outcome.measurement.curve) == in_json(held.curve) == curve
    )


def test_a_report_folds_impacts_into_the_curve_that_measure_gives() -> None:
    """Numbers of few digits, as a report reads ten of each."""
    speeds = {0.5: {0.125: 0.4, 0.375: 0.8, 0.5: 0.7, 0.875: 0.81}, 2.0: {0.125: 0.25, 0.375: 0.5}}
    every = [impact for speed, e in speeds.items() for impact in impacts(e, speed)]
    folder = Folder({"step_speed": 2.0, "phases": 4, "speeds": [0.5, 2.0], "runs": []})
    columns: dict[str, list[Any]] = {
        "speed_m_per_s": [impact.launch.speed for impact in every],
        "phase": [impact.launch.phase for impact in every],
        "status": [impact.status.value for impact in every],
        "speed_in_m_per_s": [impact.speed_in for impact in every],
        "restitution": [impact.restitution for impact in every],
        "restitution_law": [0.6] * len(every),
        "penetration_max_m": [1e-4] * len(every),
        "samples": [impact.samples for impact in every],
    }
    folder.add({name: np.array(columns[name]) for name in FOLDED})
    of_report = [
        (p.speed, p.speed_in, p.restitution, p.target, p.worst_phase) for p in folder.folded().curve
    ]
    measured = curve_of(every, lambda _: 0.6)
    assert of_report == [
        (p.speed, p.speed_in, p.restitution, p.target, p.worst_phase) for p in measured
    ]
    assert [point.restitution for point in measured] != [
        np.median(list(e.values())) for e in speeds.values()
    ]


STUDY = """schema = 1
scene = "steel-plane"
alphas = "0.3 s/m"
speeds = "0.2, 0.4, 0.8 m/s"
phases = 4
[[run]]
engine = "reference"
recipe = "kelvin-voigt"
timesteps = "1e-5 s"
"""


def test_a_report_draws_the_curve_by_which_check_judges_a_study(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    results = run_study(load_study(tmp_path / "study.toml"), jobs=1)
    (outcome,) = judge_results(results, max_error=0.1).outcomes
    view = View(results)
    (run,) = view.tabled_runs
    drawn = view.curve(run, view.main_alpha)
    assert drawn is not None
    assert in_json(drawn) == in_json(outcome.rows)
    assert [point.speed for point in drawn] == pytest.approx([0.2, 0.4, 0.8])


def test_a_printed_row_adds_up() -> None:
    report = hb.check(GOOD, "ball,plate", alpha="0.3 s/m", speeds="0.1:2:3 m/s", max_error=1.0)
    header, *rows = [
        line for line in as_text(report).splitlines() if line.startswith(("launch", " "))
    ]
    assert header.split()[4:] == ["e", "lowest", "highest", "target", "error", "worst", "phase"]
    assert len(rows) == 3
    for row in rows:
        e, _, _, target, error, worst = map(float, row.split()[2:])
        assert e - target == pytest.approx(error, abs=1e-9)
        assert abs(worst) >= abs(error)


def test_a_list_of_one_file_is_that_file() -> None:
    """The same engine and numbers, not those of an engine that opens lists."""
    model = str(GOOD)
    alone, listed = (
        hb.measure(source, "ball,plate", speeds="0.5 m/s", phases=1) for source in (model, [model])
    )
    assert listed.facts.engine == alone.facts.engine
    assert listed.curve[0].restitution == alone.curve[0].restitution


def test_a_pair_is_measured_by_the_text_that_lists_it() -> None:
    """Whatever the names: one with a comma is quoted."""
    model = Path(GOOD).read_text(encoding="utf-8").replace('"ball"', '"ball, left"')
    (listed,) = hb.pairs(model)
    assert '"' in listed.pair
    assert hb.measure(model, listed.pair, speeds="0.5 m/s", phases=1).facts.pair == (
        "ball, left",
        "plate",
    )
