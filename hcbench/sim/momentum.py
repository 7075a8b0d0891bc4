"""The force of a step, by what it did to the momentum."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hcbench.resolution import ROUND_OFF_STEP

if TYPE_CHECKING:
    from hcbench.impact import Floats


def momentum_force(mass: float, timestep: float, slowed: Floats, speeds: Floats, bits: int = 64) -> Floats:
    """Normal force of each step, N; exactly 0 where it did nothing.

    slowed: speed into the plate that the contact took in the step, m/s. speeds: sum of the sizes of what the
    step added up, m/s, which rounding goes by. bits: of the engine's numbers. All of one shape.
    """
    noise = ROUND_OFF_STEP * float(np.finfo(f"f{bits // 8}").eps) * speeds
    return np.asarray(mass * np.where(np.abs(slowed) <= noise, 0.0, slowed / timestep))
