"""The numbers behind the paper's figures: the curves as they are drawn."""

from __future__ import annotations

import pytest

import hcbench as hb
from hcbench.paper import constants
from hcbench.reporting.page import COLUMNS, csv_of
from hcbench.system.errors import UserError
from hcbench.terms.units import INCH, POUND_FORCE


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
