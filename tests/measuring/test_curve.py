"""e over speed: one point for all phases of a launch speed, the same wherever it is shown."""

from __future__ import annotations

import json

import numpy as np
import pytest
from checks import GOOD

import hcbench as hb
from hcbench._files import json_text
from hcbench.checking.text import as_record_of, as_text
from hcbench.impact import Impact, Launch, Status
from hcbench.measuring.curve import curve_of, step_shares, worst_of
from hcbench.measuring.text import as_record


def impacts(e_of_phase: dict[float, float], speed: float = 2.0) -> list[Impact]:
    """Impacts at one speed. e_of_phase: e of each phase."""
    return [
        Impact(Launch(speed, phase), Status.PARTED, speed_in=speed, speed_out=speed * e, samples=9)
        for phase, e in e_of_phase.items()
    ]


def test_a_phase_stands_for_half_of_the_gaps_beside_it() -> None:
    assert step_shares(np.array([0.3])) == pytest.approx([1.0])
    assert step_shares(np.array([0.75, 0.0, 0.5])) == pytest.approx([0.25, 0.375, 0.375])


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


def test_e_and_target_are_means_over_the_same_phases() -> None:
    """A baseline may lack a phase: the row still adds up."""
    before = {0.25: 0.7, 0.75: 0.9, 0.5: float("nan")}
    now = impacts({0.25: 0.7, 0.75: 0.9, 0.5: 0.1})
    (point,) = curve_of(now, lambda impact: before[impact.launch.phase])
    assert point.error == 0.0
    assert point.failed == 0


def test_measure_and_check_give_the_same_curve_to_the_last_bit() -> None:
    speeds = "0.1, 0.3, 1 m/s"
    measured = as_record(hb.measure(GOOD, "ball,plate", restitution=0.9, speeds=speeds))["curve"]
    report = hb.check(GOOD, "ball,plate", restitution=0.9, speeds=speeds, max_error=0.1)
    record = json.loads(json_text(as_record_of(report)))["checks"][0]
    assert record["rows"] == record["measurement"]["curve"] == json.loads(json_text(measured))


def test_a_printed_row_adds_up() -> None:
    report = hb.check(GOOD, "ball,plate", alpha="0.3 s/m", speeds="0.1:2:3 m/s", max_error=1.0)
    header, *rows = [line for line in as_text(report).splitlines() if line.startswith(("launch", " "))]
    assert header.split()[4:] == ["e", "lowest", "highest", "target", "error", "worst", "phase"]
    assert len(rows) == 3
    for row in rows:
        e, _, _, target, error, worst = map(float, row.split()[2:])
        assert e - target == pytest.approx(error, abs=1e-9)
        assert abs(worst) >= abs(error)
