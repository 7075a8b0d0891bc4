"""Numbers and times in words; units."""

from __future__ import annotations

import dataclasses
import math

import pytest
from reported_results import LAW

from hcbench.benchmark.results import Results
from hcbench.benchmark.study import study_from
from hcbench.reporting import wording
from hcbench.reporting.build import band_text, overview_figure
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
    [
        (1e-6, "1 µs"),
        (5e-5, "50 µs"),
        (1e-3, "1 ms"),
        (1 / 240, "1/240 s"),
        (4e-3, "4 ms"),
        (2.0, "2 s"),
    ],
)
def test_times_in_words(seconds: float, text: str) -> None:
    assert wording.time(seconds).replace(wording.NBSP, " ") == text


@pytest.mark.parametrize("unit", ["m/s", "in/s"])
def test_a_study_is_reported_in_the_unit_that_it_is_written_in(results: Results, unit: str) -> None:
    written = {"scene": "steel-plane", "alphas": "0.3 s/m", "speeds": f"0.1, 0.4 {unit}"}
    run = {"engine": "reference", "recipe": "hunt-crossley", "timesteps": "1e-5 s"}
    study = study_from({**written, "run": [run]}).described()
    assert study["speed_unit"] == unit
    shown = View(dataclasses.replace(results, study={**results.study, "speed_unit": unit}))
    assert ("in/s" in band_text(shown)) == (unit == "in/s")
    assert "m/s" in band_text(shown)
    tops = [
        axis.get_xlabel() for axes in overview_figure(shown, [LAW]).axes for axis in axes.child_axes
    ]
    assert ("in/s" in tops) == (unit == "in/s")


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.02812, "0.028"), (2.14e-5, "2.1e-5"), (3e-6, "3e-6"), (0.0, "1e-7"), (math.nan, "–")],
)
def test_an_error_is_written_as_tune_writes_it(value: float, text: str) -> None:
    assert wording.error(value) == text
