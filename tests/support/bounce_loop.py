"""A bounce as a user's own loop over `mj_step` sees it: only the distance of two geoms at each state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

if TYPE_CHECKING:
    from hcbench.impact import Floats

_STEPS = 5000


def bounce_by_distance(model: Any, data: Any, first: str, second: str) -> tuple[float, float]:
    """(speed in, speed out), m/s, of two geoms where they cross the touch plane: slopes of the parabolas
    through the states around it between which no contact force acts: two before and one after the touch, one
    before and two after the parting.
    """
    geoms, ends = [model.geom(name).id for name in (first, second)], np.zeros(6)
    gaps, touched, apart = list[float](), 0, 0
    for step in range(_STEPS):
        mujoco.mj_fwdPosition(model, data)
        gaps.append(mujoco.mj_geomDistance(model, data, *geoms, 10.0, ends))
        touched = touched or (step if gaps[-1] <= 0.0 else 0)
        if touched and gaps[-1] > 0.0:
            apart = apart or step
        if apart and step == apart + 1:
            break
        mujoco.mj_step(model, data)
    assert apart, "they never part"
    h, path = float(model.opt.timestep), np.array(gaps)
    into = _slope_at_zero(path[touched - 2 : touched + 1], 1.5) / h
    return -into, _slope_at_zero(path[apart - 1 : apart + 2], 0.5) / h


def _slope_at_zero(path: Floats, near: float) -> float:
    """Of the parabola through three values, where it is 0; near: about where that is, in steps."""
    parabola = np.poly1d(np.polyfit(np.arange(len(path)), path, len(path) - 1))
    zeros = parabola.roots[np.isreal(parabola.roots)].real
    return float(parabola.deriv()(zeros[np.abs(zeros - near).argmin()]))
