"""`hcbench.law` in tables: loops and motions agree with the law, for one α and for several."""

from __future__ import annotations

import numpy as np
import pytest

import hcbench as hb
from hcbench.laws import ode
from hcbench.system.errors import UserError


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
