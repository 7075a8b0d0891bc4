"""A report's figures: what they show, their labels, and their text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from reported_results import IMPULSE, LAW, STOCK
from small_results import ALPHAS

from hcbench.laws import closed_form
from hcbench.reporting import plot_style, wording
from hcbench.reporting.build import overview_drawing, overview_figure
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
