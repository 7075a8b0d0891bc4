"""A bounce as a user's own loop over `mj_step` sees it: only the
distance of two geoms at each state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.terms.impact import Floats

_STEPS = 5000


def bounce_by_distance(model: Any, data: Any, first: str, second: str) -> tuple[float, float]:
    """(speed in, speed out), m/s, of two geoms, by name."""
    return bounce_of(model, data, [(model.geom(first).id, model.geom(second).id)])


def bounce_of(
    model: Any, data: Any, pairs: Sequence[tuple[int, int]], onset: float = 0.0
) -> tuple[float, float]:
    """(speed in, speed out), m/s, of the nearest of these geoms where they cross the touch plane:
    slopes of the parabolas through the states around it between which no contact force acts: two
    before and one after the touch, one before and two after the parting. Under RK4, whose stages
    may touch within a step, all three are before the touch, or after the parting. onset: distance
    at which the contact begins, m.
    """
    gaps, touched, apart, ends = list[float](), 0, 0, np.zeros(6)
    for step in range(_STEPS):
        mujoco.mj_fwdPosition(model, data)
        gaps.append(
            min(mujoco.mj_geomDistance(model, data, a, b, 10.0, ends) for a, b in pairs) - onset
        )
        touched = touched or (step if gaps[-1] <= 0.0 else 0)
        if touched and gaps[-1] > 0.0:
            apart = apart or step
        if apart and step == apart + 2:
            break
        mujoco.mj_step(model, data)
    assert apart, "they never part"
    h, path = float(model.opt.timestep), np.array(gaps)
    staged = int(model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4)
    before = path[max(0, touched - 2 - staged) : touched + 1 - staged]
    into = _slope_at_zero(before, len(before) - 1.5 + staged) / h
    return -into, _slope_at_zero(path[apart - 1 + staged : apart + 2 + staged], 0.5 - staged) / h


def _slope_at_zero(path: Floats, near: float) -> float:
    """Slope of the parabola through three values where it is 0. near:
    about where that is, in steps.
    """
    parabola = np.poly1d(np.polyfit(np.arange(len(path)), path, len(path) - 1))
    zeros = parabola.roots[np.isreal(parabola.roots)].real
    return float(parabola.deriv()(zeros[np.abs(zeros - near).argmin()]))
