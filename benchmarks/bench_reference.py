"""The closed forms beside what one would write with SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import lambertw

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley

ALPHA, MASS, INCH = 0.008 / 0.0254, 0.45359237, 0.0254
LAW = HuntCrossley(3.4064e10, ALPHA)
SPEEDS = np.linspace(1 * INCH, 20 * INCH, 1_000_000)


def by_lambertw(alpha: float, speed: Any) -> Any:
    """e of (16): -y - ln(1 - y) at the rebound is y - ln(1 + y) at the impact, y = 1.5 α v."""
    y = 1.5 * alpha * speed
    return (1.0 + lambertw(-(1.0 + y) * np.exp(-(1.0 + y))).real) / y


def by_ode(speed: float, points: int | None = None) -> Any:
    """One impact of (16) by SciPy's best explicit solver, until the force is zero again."""

    def motion(_: float, state: Any) -> Any:
        x, v = max(state[0], 0.0), state[1]
        return v, -LAW.stiffness * x**1.5 * (1.0 + 1.5 * ALPHA * v) / MASS

    def parted(t: float, state: Any) -> float:
        return float(state[0]) if t > 1e-6 else 1.0

    parted.terminal = True  # type: ignore[attr-defined]
    times = (
        None
        if points is None
        else np.linspace(0.0, float(closed_form.duration(LAW, MASS, speed)), points)
    )
    return solve_ivp(
        motion,
        (0.0, 1e-2),
        (0.0, speed),
        "DOP853",
        times,
        events=parted,
        rtol=1e-12,
        atol=(1e-18, 1e-13),
    )


def test_restitution_of_a_million_speeds_over_lambertw(beside: Any) -> None:
    beside(
        "e(v) of 10⁶ speeds",
        {
            "scipy.special.lambertw": lambda: by_lambertw(ALPHA, SPEEDS),
            "hcbench.laws.closed_form": lambda: closed_form.restitution(ALPHA, SPEEDS),
        },
        must="3",
        aim="5",
    )
    off = np.abs(by_lambertw(ALPHA, SPEEDS) / closed_form.restitution(ALPHA, SPEEDS) - 1).max()
    assert off < 1e-7, "the same e, as far as lambertw is accurate"


def test_restitution_of_a_speed_over_solve_ivp(beside: Any) -> None:
    speeds = (0.1, 0.3)
    beside(
        "e(v), per speed",
        {
            "scipy.integrate.solve_ivp": lambda: [by_ode(speed) for speed in speeds],
            "hcbench.laws.closed_form": lambda: closed_form.restitution(ALPHA, SPEEDS),
        },
        per={"scipy.integrate.solve_ivp": len(speeds), "hcbench.laws.closed_form": len(SPEEDS)},
        must="10⁴",
        aim="10⁵",
    )
    e = -by_ode(0.3).y[1, -1] / 0.3
    assert abs(e - float(closed_form.restitution(ALPHA, 0.3))) < 1e-9


def test_a_loop_over_its_ode(beside: Any) -> None:
    beside(
        "a loop of 401 points",
        {
            "scipy.integrate.solve_ivp": lambda: by_ode(0.3, 401),
            "hcbench.laws.closed_form": lambda: closed_form.loop(LAW, MASS, 0.3, 401),
        },
    )
