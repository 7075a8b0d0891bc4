"""e over impact speed of one setting, as measured: phases folded."""

from dataclasses import dataclass

import pandas as pd

from hcbench.impact import Floats
from hcbench.report.wording import NBSP, span


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
    good = rows[rows["restitution"].notna()]
    v_in, e = good["speed_in_m_per_s"].astype(float), good["restitution"].astype(float)
    error = (e - good["restitution_law"].astype(float)).abs()
    columns = {"speed": v_in, "e": e, "error": error, "loss": 0.5 * mass * v_in**2 * (1 - e**2)}
    by_speed = pd.DataFrame(columns).groupby(good["speed_m_per_s"].astype(float).round(12))
    return Curve(
        speed=by_speed["speed"].median().to_numpy(),
        low=by_speed["e"].min().to_numpy(),
        middle=by_speed["e"].median().to_numpy(),
        high=by_speed["e"].max().to_numpy(),
        error=by_speed["error"].max().to_numpy(),
        loss=by_speed["loss"].median().to_numpy(),
    )
