"""Results in a notebook: HTML that holds what was found, and a figure."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import pytest
from small_results import small_results

import hcbench
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.terms.scene import load_scene
from hcbench.tuning.find import tune

GOOD = Path(__file__).parents[2] / "examples" / "good.xml"


def measured() -> Any:
    verb: Any = hcbench.measure
    return verb(GOOD, pair="ball,plate", speeds=[0.1, 0.3], phases=2, alpha=0.315)


def tuned() -> Any:
    scene = load_scene("steel-plane")
    target = Target(HuntCrossley(scene.stiffness, 0.315), scene.mass, 1e-3, 0.1, 0.5, gravity=9.81)
    return tune("mujoco", target, scene, "impulse")


SHOWN = {
    "measured": (measured, "ball on plate", "Restitution between"),
    "tuned": (tuned, "MuJoCo: impulse", "largest error of e"),
    "results": (
        small_results,
        "A steel ball",
        "With nothing set single does not bounce like the law.",
    ),
}


@pytest.mark.parametrize("name", SHOWN)
def test_a_result_shows_itself(name: str) -> None:
    make, title, fact = SHOWN[name]
    result = make()
    html = result._repr_html_()
    assert title in html
    assert fact in html
    assert not re.search(r"<script|https?://(?!www\.w3\.org|purl|creativecommons|matplotlib)", html)
    ElementTree.fromstring(
        re.sub(r'src="[^"]*"', "", html).replace("&nbsp;", " ")
    )  # every tag is closed
    with mpl.rc_context({"axes.grid": False, "lines.linewidth": 9.0}):
        figure = result.plot()
        assert mpl.rcParams["lines.linewidth"] == 9.0
    assert figure.axes
    assert max(line.get_linewidth() for axes in figure.axes for line in axes.lines) < 9.0


def test_the_plot_of_a_setting_says_on_which_side_of_the_target_it_lies() -> None:
    result = tuned()
    (axes,) = result.plot().axes
    legend = " ".join(text.get_text() for text in axes.get_legend().get_texts())
    judged = result.evaluation
    assert f"mean error {judged.mean_error:+.2g}, {100 * judged.below:.0f} % below" in legend
