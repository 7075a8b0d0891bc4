"""A report's figures: what they show, their labels, and their text."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pandas as pd
from hypothesis import given
from hypothesis import strategies as st
from reported_results import IMPULSE, LAW
from small_results import ALPHAS, RUNS, SCENE, small_results

from hcbench.benchmark.results import TRAIN_COLUMNS, Results
from hcbench.laws import closed_form
from hcbench.reporting import (
    bounce_figures,
    plot_style,
    restitution_figures,
    wording,
)
from hcbench.reporting.conditions import Views, views
from hcbench.reporting.drawings import drawings
from hcbench.reporting.view import View


def test_curves_show_the_measured_restitution(view: View) -> None:
    figure = restitution_figures.restitution_figure(view, restitution_figures.columns_of_alphas(view, True))
    panel = figure.axes[1]  # the only fine engine's row, the second α
    law, linear, *engines = [np.asarray(line.get_xydata()) for line in panel.get_lines()]
    np.testing.assert_allclose(law[:, 1], closed_form.restitution(ALPHAS[1], law[:, 0]))
    np.testing.assert_allclose(linear[:, 1], 1 - ALPHAS[1] * linear[:, 0])
    curve = view.curve(LAW, ALPHAS[1])
    assert curve is not None
    np.testing.assert_array_equal(engines[0], np.column_stack([curve.speed, curve.middle]))
    np.testing.assert_allclose(curve.middle, closed_form.restitution(ALPHAS[1], curve.speed), atol=1e-3)


def test_what_lies_below_the_frame_is_named(view: View) -> None:
    figure = restitution_figures.restitution_figure(view, restitution_figures.columns_of_alphas(view, False))
    said = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert [s for s in said if "stock" in s] == ["▼ stock: e = 0.10"] * len(ALPHAS)


def test_a_figure_without_content_says_why() -> None:
    coarse_only = View(small_results([run for run in RUNS if run[1] in ("impulse", "stock")]))
    by_name = {d.name: d for d in drawings(Views(None, coarse_only))}
    for name in ("restitution-fine", "error-fine", "loops", "steps"):
        assert by_name[name].draw is None
        assert by_name[name].why
    assert by_name["restitution-coarse"].draw is not None


def test_a_bounce_train_is_drawn_over_the_laws(results: Results) -> None:
    """A constant e loses the same share each time: a straight line on the log axis."""
    heights = 0.01 * 0.9 ** (2 * np.arange(1, 6))
    key = (SCENE, 0.0, 0.0, 0.0, *IMPULSE[:2], ALPHAS[1], 1e-3)
    rows = [(*key, i, 0.1 * i, 0.1 * i, h, 0.01 * 0.8**i) for i, h in enumerate(heights, 1)]
    study = {**results.study, "train_height": 0.01}
    dropped = dataclasses.replace(results, study=study, trains=pd.DataFrame(rows, columns=TRAIN_COLUMNS))
    left, right = bounce_figures.bounces_figure(View(dropped)).axes
    law, train = (np.asarray(line.get_xydata()) for line in left.get_lines())
    np.testing.assert_allclose(law[:, 1], 10 * 0.8 ** np.arange(6))
    np.testing.assert_allclose(np.diff(np.log(train[:, 1])), 2 * np.log(0.9))
    over = np.asarray(right.get_lines()[1].get_xydata())
    np.testing.assert_allclose(over[:, 1], 1e3 * heights / law[1:, 1])
    by_name = {d.name: d for d in drawings(views(results))}
    assert by_name["trains"].draw is None


def test_every_figure_has_a_text_for_who_cannot_see_it(view: View, page: Path) -> None:
    for drawing in drawings(Views(None, view)):
        assert len(drawing.alt) > 40
        assert not re.search(r"\bnan\b", drawing.alt)
    captions = re.findall(
        r'<figure id="figure-[^>]*>\n<figcaption>(.*?)</figcaption>', page.read_text("utf-8")
    )
    assert len(captions) == sum(drawing.draw is not None for drawing in drawings(Views(None, view)))
    assert not [caption for caption in captions if re.search(r"\bnan\b", caption)]


def test_no_two_settings_of_an_engine_look_alike() -> None:
    known = list(
        plot_style.plot_styles(
            [("mujoco", name) for name in plot_style._RECIPES if name != "restitution"], "reference"
        ).values()
    )
    new = list(plot_style.plot_styles([("mujoco", f"new {i}") for i in range(5)], "reference").values())
    assert len({look.colour for look in known + new}) == len(known + new)
    assert len({look.marker for look in known + new}) == len(known + new)


def test_a_setting_looks_the_same_in_every_study() -> None:
    alone = plot_style.plot_styles([("mujoco", "impulse")], "reference")
    among = plot_style.plot_styles(
        [("mujoco", "impulse"), ("mujoco", "aaa"), ("nobodys", "impulse"), ("pybullet", "x")], "reference"
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
