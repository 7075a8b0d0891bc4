"""A report's figures: what they show, their labels, and their text. Numbers and times in words; units."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from reported_results import IMPULSE, LAW, STOCK
from small_results import ALPHAS

from hcbench.benchmark.results import Results
from hcbench.benchmark.study import study_from
from hcbench.laws import closed_form
from hcbench.reporting import plot_style, wording
from hcbench.reporting.build import band_text, overview_drawing, overview_figure
from hcbench.reporting.page import svg_bytes
from hcbench.reporting.view import View


def test_the_overview_shows_the_measured_restitution_and_names_each_line(view: View) -> None:
    figure = overview_figure(view, [LAW, IMPULSE, STOCK])
    upper, lower = figure.axes
    law, linear, *engines = [np.asarray(line.get_xydata()) for line in upper.get_lines()]
    np.testing.assert_allclose(law[:, 1], closed_form.restitution(ALPHAS[1], law[:, 0]))
    np.testing.assert_allclose(linear[:, 1], 1 - ALPHAS[1] * linear[:, 0])
    curve = view.curve(LAW, ALPHAS[1])
    assert curve is not None
    np.testing.assert_array_equal(engines[0], np.column_stack([curve.speed_in, curve.restitution]))
    np.testing.assert_allclose(
        curve.restitution, closed_form.restitution(ALPHAS[1], curve.speed_in), atol=1e-3
    )
    assert [text.get_text()[:5] for text in upper.texts] == ["the l", "1 − α", "expli", "singl"]
    assert [text.get_text()[:12] for text in lower.texts] == ["single, noth"], "far below the rest"


def test_the_figure_has_a_text_for_who_cannot_see_it(view: View, page: Path) -> None:
    drawing = overview_drawing(view)
    assert len(drawing.alt) > 40
    assert "nan" not in drawing.alt
    assert drawing.alt in page.read_text("utf-8")


def test_a_kind_of_setting_has_one_hue_that_stands_out_and_each_setting_its_mark() -> None:
    looks = plot_style.plot_styles([("mujoco", name) for name in plot_style._RECIPES], "reference")
    assert {look.kind for look in looks.values()} == set(plot_style.KIND_COLOURS)
    of_kind = {
        kind: [
            look.marker
            for name, look in looks.items()
            if look.kind == kind and name[1] != "restitution"
        ]
        for kind in plot_style.KIND_COLOURS
    }
    assert all(len(set(markers)) == len(markers) for markers in of_kind.values())


def test_a_setting_looks_the_same_in_every_study() -> None:
    alone = plot_style.plot_styles([("mujoco", "impulse")], "reference")
    among = plot_style.plot_styles(
        [("mujoco", "impulse"), ("mujoco", "aaa"), ("nobodys", "impulse"), ("pybullet", "x")],
        "reference",
    )
    assert alone["mujoco", "impulse"] == among["mujoco", "impulse"]
    assert among["nobodys", "impulse"].dashes != among["mujoco", "impulse"].dashes


def test_engines_have_their_titles_and_those_that_are_not_installed_their_names() -> None:
    assert [wording.engine_title(name) for name in ("mujoco", "nowhere")] == ["MuJoCo", "nowhere"]


@given(st.lists(st.floats(0, 1), min_size=1, max_size=14))
def test_labels_keep_their_order_and_never_overlap(wanted: list[float]) -> None:
    places = plot_style.declutter(np.array(wanted), 0.05, 0.0, 1.0)
    assert (np.diff(np.sort(places)) >= 0.05 - 1e-6).all() or len(wanted) == 1
    assert (np.diff(places[np.argsort(wanted, kind="stable")]) >= 0).all()
    assert places.min() >= -1e-6


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


def test_a_dot_that_several_points_make_stands_once_in_a_picture() -> None:
    figure = Figure()
    axes = figure.subplots()
    x = np.repeat([1.0, 2.0], 5)
    y = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 3.0, 2.0, 3.0, 2.0])
    ends = (np.stack([each - 1e-3, each + 1e-3, np.full(10, np.nan)], 1).ravel() for each in (x, y))
    axes.plot(*ends, color="#123456")
    svg = svg_bytes(figure).decode()
    (dots,) = re.findall(r'd="([^"]*)"[^>]*stroke: #123456', svg)
    assert dots.count("M ") == 3
