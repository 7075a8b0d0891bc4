"""Numbers and times in words; units."""

from __future__ import annotations

import dataclasses
import math

import pytest
from reported_results import LAW
from small_results import ALPHAS

from hcbench.benchmark.results import Results
from hcbench.benchmark.study import study_from
from hcbench.reporting import (
    advice,
    restitution_figures,
    wording,
)
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
