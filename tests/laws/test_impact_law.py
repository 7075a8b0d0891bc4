"""`hcbench.law`: one impact in one row by the closed forms, with the limits that the paper sets to
itself; loops and motions in tables agree with the law, for one α and for several.
"""

from __future__ import annotations

import numpy as np
import pytest

import hcbench as hb
from hcbench.laws import closed_form, ode
from hcbench.laws.force import HuntCrossley
from hcbench.laws.impact_law import PAPER_RELATIVE_RADIUS, summarize
from hcbench.system.errors import UserError

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


def test_shear_is_given_of_the_papers_bodies_alone() -> None:
    (of_paper,) = hb.law(0.3).impacts([0.2])
    (of_others,) = hb.law(0.3, stiffness=1e6).impacts([0.2])
    assert of_paper.shear_stress_max_pa is not None
    assert of_others.shear_stress_max_pa is None
    assert "shear" not in " | ".join(of_others.warnings)


@pytest.mark.parametrize("exponent", [1.5, 1.0])
def test_a_motion_is_that_of_the_equation(exponent: float) -> None:
    """Against the differential equation, which shares no code with the closed form."""
    law = hb.law(0.3, mass=0.4, stiffness=1e9, exponent=exponent)
    motion = law.trajectory("1 m/s", 201)
    exact = ode.impact(law.force, 0.4, 1.0, count=2001).loop
    assert exact is not None
    depth = np.interp(motion.time_s, exact.time, exact.penetration)
    assert motion.penetration_m.to_numpy() == pytest.approx(
        depth, abs=1e-4 * exact.penetration.max()
    )
    rate = motion.rate_m_per_s.to_numpy()
    force = 1e9 * motion.penetration_m.to_numpy() ** exponent * (1 + 1.5 * 0.3 * rate)
    assert motion.force_n.to_numpy() == pytest.approx(force, rel=1e-9)
    assert rate[0] == pytest.approx(1.0, rel=1e-14)
    assert -rate[-1] == pytest.approx(law.e(1.0), rel=1e-9)


def test_a_loop_has_the_loss_of_the_law_as_its_area() -> None:
    law = hb.law("0.008 s/in")
    loop = law.loop("4, 16 in/s", 4001)
    assert list(loop.columns) == ["speed_m_per_s", "penetration_m", "force_n"]
    for impact in law.impacts("4, 16 in/s"):
        of_speed = loop[loop.speed_m_per_s == impact.speed_m_per_s]
        assert len(of_speed) == 4001
        area = np.trapezoid(of_speed.force_n, of_speed.penetration_m)
        assert area == pytest.approx(impact.energy_loss_j, rel=1e-5)
        assert of_speed.force_n.max() == pytest.approx(impact.force_max_n, rel=1e-6)


def test_several_alphas_are_several_laws() -> None:
    laws = hb.law([0.1, "0.3 s/m"])
    assert laws.alphas.tolist() == [0.1, 0.3]
    assert laws.e([0.5, 1.0, 2.0]).shape == (2, 3)
    assert laws.e("1 m/s").tolist() == [hb.law(0.1).e(1), hb.law(0.3).e(1)]
    loops = laws.loop("1 m/s", 5)
    assert loops.columns[0] == "alpha_s_per_m"
    assert loops.groupby("alpha_s_per_m").size().tolist() == [5, 5]
    alone = hb.law(0.3).loop("1 m/s", 5).force_n
    assert loops[loops.alpha_s_per_m == 0.3].force_n.tolist() == alone.tolist()
    assert len(laws.impacts("1, 2 m/s")) == 4
    assert hb.law(np.array([0.1, 0.2])).alphas.tolist() == [0.1, 0.2]
    assert laws.trajectory(1.0, 3).time_s.iloc[0] == 0.0


@pytest.mark.parametrize(("speed", "count"), [(0, 401), ("-1 m/s", 401), (1.0, 2), ([], 401)])
def test_a_wrong_loop_is_an_error_of_ours(speed: object, count: int) -> None:
    with pytest.raises(UserError):
        hb.law(0.3).loop(speed, count)  # type: ignore[arg-type]


def test_the_figure_of_a_law_names_its_curves() -> None:
    (axes,) = hb.law([0.1, 0.3]).plot().axes
    legend = axes.get_legend()
    assert legend is not None
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["law, α = 0.1 s/m", "law, α = 0.3 s/m", "1 - α v"]
