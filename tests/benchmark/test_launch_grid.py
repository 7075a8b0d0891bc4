"""Speeds of a field page: moved into the band in which a body can bounce at the step, end to end."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hcbench.benchmark.plan import speeds_at
from hcbench.benchmark.study import Study, study_from

CONTENT = {
    "scene": "steel-plane",
    "alphas": "0.3 s/m",
    "speeds": "0.1, 0.2, 0.4, 0.5 m/s",
    "run": [{"engine": "reference", "recipe": "hunt-crossley", "timesteps": 1e-3}],
}


@pytest.fixture(scope="module")
def field() -> Study:
    return dataclasses.replace(study_from(CONTENT), page="field")


def test_a_long_step_stretches_the_speeds_into_its_band(field: Study) -> None:
    """At 1/60 s the band is 0.262 ... 1.048 m/s: 1.6 g h, and four
    times that. Shares of the way stay.
    """
    speeds = speeds_at(field, field.runs[0], 1.0 / 60.0)
    assert speeds[0] == pytest.approx(0.262)
    assert speeds[-1] == pytest.approx(4.0 * 0.262)
    shares = (np.array(speeds) - speeds[0]) / (speeds[-1] - speeds[0])
    assert shares == pytest.approx([0.0, 0.25, 0.75, 1.0])


def test_a_short_step_leaves_the_speeds_as_they_are(field: Study) -> None:
    assert speeds_at(field, field.runs[0], 1e-3) == pytest.approx((0.1, 0.2, 0.4, 0.5))


def test_a_report_launches_at_the_speeds_of_its_study(field: Study) -> None:
    report = dataclasses.replace(field, page="report")
    assert speeds_at(report, report.runs[0], 1.0 / 60.0) == pytest.approx((0.1, 0.2, 0.4, 0.5))
