"""The paper's page: all its figures, all its numbers, the same bytes every time."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pytest
from long_searches import long_study

import hcbench as hb
from hcbench.laws import closed_form
from hcbench.laws import kelvin_voigt as kv
from hcbench.laws.force import HuntCrossley
from hcbench.laws.ode import impact
from hcbench.laws.published import LAWS
from hcbench.paper import constants, impact_figures, vibroimpact_figures
from hcbench.paper.page import Printed, build, drawings, factors, printed_numbers
from hcbench.paper.vibroimpact_figures import QUICK
from hcbench.reporting.page import COLUMNS, csv_of
from hcbench.reporting.plot_style import COLOURS, DASHES, figure_defaults, numbered_line
from hcbench.reporting.wording import four_digits
from hcbench.system.errors import UserError
from hcbench.terms.units import POUND_FORCE

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


INCH, POUND = 0.0254, 4.4482216152605
NUMBERS = {(n.where, n.what): n for n in printed_numbers()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("paper"), quick=True).parent


class _Page(HTMLParser):
    """Reads a page: what a browser would load, and whether every tag that opens closes."""

    def __init__(self) -> None:
        super().__init__()
        self.images: list[dict[str, str | None]] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.ids += [str(given["id"])] if given.get("id") else []
        self.links += [str(given["href"])] if tag == "a" else []
        if tag == "img":
            self.images.append(given)
        elif tag not in ("meta", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def _parsed(folder: Path) -> _Page:
    page = _Page()
    page.feed((folder / "index.html").read_text(encoding="utf-8"))
    return page


def test_all_nine_figures_are_there_and_say_what_they_show(folder: Path) -> None:
    page = _parsed(folder)
    assert page.open == []
    for i in range(1, 10):
        assert f"figure-{i}" in page.ids
    assert len(page.images) == len(drawings(QUICK))
    for image in page.images:
        assert str(image["src"]).startswith("data:image/svg+xml,")
        assert len(str(image["alt"])) > 40
    for drawing in drawings(QUICK):
        for suffix in ("svg", "png", "csv"):
            assert (folder / "figures" / f"{drawing.name}.{suffix}").stat().st_size > 1000


@pytest.mark.parametrize("name", [drawing.name for drawing in drawings(QUICK)])
def test_a_figure_has_its_numbers(folder: Path, name: str) -> None:
    """They are those of `hb.paper.data` (tested below)."""
    found = pd.read_csv(folder / "figures" / f"{name}.csv")
    assert tuple(found.columns) == COLUMNS
    assert len(found) > 100
    assert found[["x", "y"]].notna().any().all()
    # One curve of a panel has one pair of axes.
    axes = found.groupby(["panel", "curve"], dropna=False)[["x_axis"]].nunique()
    assert (axes == 1).all().all()


def test_the_page_needs_nothing_from_outside(folder: Path) -> None:
    text = (folder / "index.html").read_text(encoding="utf-8")
    page = _parsed(folder)
    assert all(link.startswith("#") and link[1:] in page.ids for link in page.links)
    assert not re.search(r"(?:src|href)=\"(?:https?:)?//", text)
    assert "<script" not in text


@long_study
def test_the_same_bytes_every_time(folder: Path, tmp_path: Path) -> None:
    ticks: list[tuple[int, int]] = []
    again = build(
        tmp_path / "new", quick=True, tick=lambda done, total: ticks.append((done, total))
    ).parent
    files = sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    assert files == sorted(p.relative_to(again) for p in again.rglob("*") if p.is_file())
    for file in files:
        assert (folder / file).read_bytes() == (again / file).read_bytes(), file
    assert ticks[0] == (0, len(drawings(QUICK)))
    assert ticks[-1] == (len(drawings(QUICK)), len(drawings(QUICK)))


def test_a_folder_that_cannot_be_written_is_named_and_nothing_is_left(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UserError, match="output folder"):
        build(tmp_path / "file" / "page", quick=True)
    assert sorted(tmp_path.iterdir()) == [tmp_path / "file"]


# --- numbers
# ----------------------------------------------------------------------------------------------------


def test_the_printed_numbers_that_do_not_agree_are_the_known_four() -> None:
    differ = {n.what for n in NUMBERS.values() if n.verdict == "differs"}
    assert differ == {
        "K1 in metric units",
        "K2 in metric units (R in cm, τ in N/m²)",
        "weight of the steel body",
        "600 lb in metric units",
    }


@pytest.mark.parametrize(
    ("key", "ours"),
    [
        (("(5)", "K1 = (4/3) E/(2(1 - ν²))"), 2.1978e7),
        (("(5)", "K1 in metric units"), 1.5153e7),
        (("(6)", "K2 = 0.31 (6 E*²/π³)^(1/3)"), 11613.0),
        (("3.1", "K3"), 3.1082e7),
        (("3.1", "K3 in metric units"), 3.4154e7),
        (("3.1", "600 lb in metric units"), 2668.93),
        (("3.1", "largest allowed force"), 608.62),
        (("3.2", "largest α drawn, 0.016 s/in"), 0.62992),
    ],
)
def test_the_numbers_are_computed_right(key: tuple[str, str], ours: float) -> None:
    assert NUMBERS[key].ours == pytest.approx(ours, rel=5e-5)


def test_k1_in_metric_units_was_printed_with_a_slip_of_the_conversion() -> None:
    assert NUMBERS["(5)", "K1 in metric units"].value == pytest.approx(
        2.19e7 * POUND / 25.4, rel=2e-3
    )


def test_a_verdict_goes_by_the_printed_digits() -> None:
    def verdict(printed: str, ours: float, meant: int) -> str:
        return Printed("", "", printed, ours, "", meant).verdict

    assert verdict("2.19e7", 2.1949e7, 3) == "agrees"
    assert verdict("2.19e7", 2.198e7, 3) == "rounded"
    assert verdict("2.19e7", 2.21e7, 3) == "differs"
    assert verdict("600", 608.6, 1) == "agrees"
    assert verdict("600", 608.6, 2) == "rounded"
    assert four_digits(15153300.0) == "1.515·10⁷"
    assert four_digits(62004.1) == "62000"


def test_the_factor_of_15_is_3_2_whatever_the_exponent_and_the_mass(folder: Path) -> None:
    text = (folder / "index.html").read_text(encoding="utf-8")
    for _, row in factors():
        for value in row:
            assert value == pytest.approx(1.5, abs=2e-5)
            assert f"{value:.5f}" in text


def test_every_number_is_on_the_page(folder: Path) -> None:
    text = (folder / "index.html").read_text(encoding="utf-8")
    for n in NUMBERS.values():
        assert four_digits(n.ours) in text
        assert four_digits(n.value) in text
    for law in LAWS.values():
        assert law.name in text


# --- figures
# ----------------------------------------------------------------------------------------------------


def _lines(axes: Axes) -> list[np.ndarray]:
    return [np.array(line.get_xydata()) for line in axes.lines]


def test_figure_4_shows_the_closed_form_in_the_papers_units() -> None:
    with figure_defaults():
        panels = impact_figures.figure_4().axes[:4]
    for axes, alpha in zip(panels, constants.ALPHAS, strict=True):
        for line, speed in zip(_lines(axes), constants.SPEEDS, strict=False):
            law = constants.law(alpha)
            assert line[:, 0].max() * INCH / 1e3 == pytest.approx(
                closed_form.penetration_max(law, constants.MASS, speed)
            )
            top = float(closed_form.force_max(law, constants.MASS, speed)) / POUND
            assert line[:, 1].max() == pytest.approx(top, rel=1e-4)
            assert line[:, 1].max() < 1000.0  # the paper's frame
            assert line[:, 0].max() < 1.0


def test_figure_1_pulls_on_the_left_only() -> None:
    with figure_defaults():
        left, right = impact_figures.figure_1()[0].axes
    assert _lines(left)[0][:, 1].min() < 0.0 < _lines(left)[0][0, 1]
    assert min(line[:, 1].min() for line in _lines(right)) == 0.0


def test_figure_9_lies_on_its_ellipse_and_figure_8_does_not_close_on_one() -> None:
    with figure_defaults():
        small, large = (
            vibroimpact_figures.figure_9()[0].axes[1],
            vibroimpact_figures.figure_8().axes[1],
        )
    loop, ellipse = _lines(small)[:2]
    assert np.ptp(loop[:, 1]) == pytest.approx(np.ptp(ellipse[:, 1]), rel=0.02)
    assert np.ptp(loop[:, 0]) == pytest.approx(np.ptp(ellipse[:, 0]), rel=1e-3)
    assert np.ptp(_lines(large)[0][:, 0]) > 2.0 * vibroimpact_figures.SQUEEZE


LIKE_HUES = ((0, 4), (0, 7), (4, 7), (3, 7), (1, 8), (6, 9))  # blues, purples, browns, greys


def test_inks_of_like_hue_differ_in_their_dashes() -> None:
    assert len(DASHES) == len(COLOURS)
    for one, other in LIKE_HUES:
        assert numbered_line(one)["linestyle"] != numbered_line(other)["linestyle"]


@pytest.mark.parametrize(
    "draw", [impact_figures.approximations_figure, impact_figures.later_laws_figure]
)
def test_lines_that_lie_on_one_another_differ_in_their_dashes(draw: Callable[[], Figure]) -> None:
    lines = [line for line in draw().axes[0].lines if np.size(line.get_xdata()) > 2]
    assert len(lines) >= 7
    for i, under in enumerate(lines):
        for over in lines[i + 1 :]:
            first, second = (np.asarray(line.get_ydata(), dtype=float) for line in (under, over))
            near = np.abs(first - second) < 0.1 * np.maximum(first, second)
            if near.mean() > 0.5:  # over half of the figure
                dashes = [DASHES[COLOURS.index(str(line.get_color()))] for line in (under, over)]
                widths = sorted(line.get_linewidth() for line in (under, over))
                assert dashes[0] != dashes[1] or widths[1] > 1.5 * widths[0]


def test_the_other_reading_of_4_is_in_the_caption(folder: Path) -> None:
    """Found again by the differential equation: no force below 0."""
    e = float(closed_form.restitution(0.5, 1.0))
    time = float(closed_form.duration(HuntCrossley(1.0, 0.5), 1.0, 1.0))
    law = kv.matched(e, time, 1.0, kv.Ending.SURFACE)
    other = impact(law, 1.0, 1.0, ending=kv.Ending.FORCE).restitution
    assert other > e
    assert f"makes the restitution of (a) {other:.3f}" in (folder / "index.html").read_text(
        encoding="utf-8"
    )


@pytest.mark.adhesion
def test_the_page_says_how_far_each_engine_is_from_the_reference(folder: Path) -> None:
    text = (folder / "index.html").read_text(encoding="utf-8")
    found = dict(re.findall(r"(MuJoCo plug-in|MuJoCo staggered) [\d.]+ % and ([\d.]+) %", text))
    assert float(found["MuJoCo plug-in"]) < 10.0  # of a preview's steps, five times as long
    assert float(found["MuJoCo staggered"]) < 10.0


def test_the_loop_of_q_2_encloses_the_loss_that_its_restitution_says() -> None:
    from hcbench.paper import approximations

    law = approximations.QuadraticDamping(constants.STIFFNESS, 1.0, constants.MASS)
    x, force = impact_figures._quadratic_loop(law, 0.5)
    e = float(approximations.quadratic_restitution(1.0, 0.5))
    assert np.trapezoid(force, x) == pytest.approx(
        0.5 * constants.MASS * 0.25 * (1.0 - e**2), rel=1e-3
    )


def test_the_loops_of_figure_4_are_those_of_the_law() -> None:
    found = hb.paper.data("figure-4")
    assert len(set(found.panel)) == len(constants.ALPHAS)
    panel = found[(found.panel == "α = 0.008 s/in") & (found.curve == "16 in/s")]
    loop = hb.law("0.008 s/in").loop("16 in/s")
    assert panel.x.to_numpy() * INCH * 1e-3 == pytest.approx(loop.penetration_m, rel=1e-9)
    assert panel.y.to_numpy() * POUND_FORCE == pytest.approx(loop.force_n, rel=1e-9)
    assert set(panel.x_axis) == {"approach x, 10⁻³ in"}
    assert set(panel.y_axis) == {"force F, lb"}


def test_the_limit_across_a_panel_is_no_curve() -> None:
    assert set(hb.paper.data("figure-4").curve) == {"4 in/s", "8 in/s", "12 in/s", "16 in/s"}


def test_the_file_has_the_same_table() -> None:
    lines = csv_of(hb.paper.figure("figure-2")).decode().splitlines()
    assert lines[0] == ",".join(COLUMNS)
    assert len(lines) == len(hb.paper.data("figure-2")) + 1


def test_an_unknown_figure_lists_the_known() -> None:
    with pytest.raises(UserError, match=r"^name: 'figure-10'; expected one of: figure-1, "):
        hb.paper.data("figure-10")
