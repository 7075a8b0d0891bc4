"""e over impact speed of one setting, as measured: phases folded."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from hcbench.impact import Floats
from hcbench.reporting.wording import NBSP, span


@dataclass(frozen=True, slots=True)
class Curve:
    """e over impact speed of one run for one α; arrays over speed, phases folded.

    speed: as measured, m/s. low, middle, high: least, median and largest e over the phases.
    error: largest |e - e of (16)| over the phases. loss: median of ½ m (v_i² - v_o²), J.
    """

    speed: Floats
    low: Floats
    middle: Floats
    high: Floats
    error: Floats
    loss: Floats

    def range_text(self, space: str = NBSP) -> str:
        """The range of e: "0.10 … 0.88"; one number where it hardly changes."""
        low, high = self.low.min(), self.high.max()
        return f"{low:.2f}" if high - low < 0.005 else span(f"{low:.2f}", f"{high:.2f}", space)


def curve_of(rows: pd.DataFrame, mass: float) -> Curve:
    """Fold phases; speeds that differ by round-off only are one speed."""
    names = ("speed_m_per_s", "speed_in_m_per_s", "restitution", "restitution_law")
    asked, v_in, e, law = (rows[name].to_numpy(dtype=float) for name in names)
    good = np.isfinite(e)
    asked, v_in, e, law = asked[good], v_in[good], e[good], law[good]
    _, group, count = np.unique(asked.round(12), return_inverse=True, return_counts=True)
    first = np.cumsum(count) - count

    def ordered(values: Floats) -> Floats:
        return np.asarray(values[np.lexsort((values, group))])

    def median(values: Floats) -> Floats:
        middle = ordered(values)
        return np.asarray((middle[first + (count - 1) // 2] + middle[first + count // 2]) / 2.0)

    return Curve(
        speed=median(v_in),
        low=ordered(e)[first],
        middle=median(e),
        high=ordered(e)[first + count - 1],
        error=ordered(np.abs(e - law))[first + count - 1],
        loss=median(0.5 * mass * v_in**2 * (1 - e**2)),
    )
