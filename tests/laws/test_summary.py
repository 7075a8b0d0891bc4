"""One impact in one row: the closed forms, and the limits that the paper sets to itself."""

from __future__ import annotations

import pytest

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.impact_law import PAPER_RELATIVE_RADIUS, summarize

INCH, POUND, LBF = 0.0254, 0.45359237, 4.4482216152605
K3 = 3.1e7 * LBF / INCH**1.5  # of section 3.1


def test_a_row_warns_where_the_papers_limits_are_passed() -> None:
    def warnings(alpha: float, speed: float, exponent: float = 1.5) -> str:
        law = HuntCrossley(K3, alpha / INCH, exponent)
        return " | ".join(summarize(law, POUND, speed * INCH, PAPER_RELATIVE_RADIUS).warnings)

    assert warnings(0.008, 4) == ""
    assert "shear stress" in warnings(0.008, 16)
    assert "shear stress" not in warnings(0.008, 12)
    assert "0.508 m/s" in warnings(0.002, 20.1)
    assert "0.508 m/s" not in warnings(0.002, 20)
    assert "α v = 0.256 is above 0.16" in warnings(0.016, 16)
    assert "exponent 1.2" in warnings(0.002, 4, exponent=1.2)


def test_a_row_is_the_closed_forms() -> None:
    law = HuntCrossley(K3, 0.3)
    row = summarize(law, POUND, 0.2, PAPER_RELATIVE_RADIUS)
    assert row.restitution == closed_form.restitution(0.3, 0.2)
    assert row.restitution_linear == 1 - 0.3 * 0.2
    assert row.energy_loss_j == pytest.approx(
        0.5 * POUND * 0.2**2 * (1 - row.restitution**2), rel=1e-13
    )
    assert row.shear_stress_max_pa is not None
    assert (
        summarize(HuntCrossley(K3, 0.3, 1.2), POUND, 0.2, PAPER_RELATIVE_RADIUS).shear_stress_max_pa
        is None
    )
