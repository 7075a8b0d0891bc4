"""Touches heard in a recording, and why they may not be the ball's."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.clicks import Indices
    from hcbench.fitting.estimate import Estimate
    from hcbench.terms.impact import Floats

# Touches of a train that rivals the first one, at least.
_RIVAL_TOUCHES = 5
# Largest scatter of e of a rival.
_RIVAL_SCATTER = 0.03
# Standard deviations by which a rival's α differs, at least.
_RIVAL_APART = 3.0
# Share of the first train's α by which a rival's α differs, at least.
_RIVAL_SHARE = 0.02
# A lower score, as ln odds, is hardly more regular than noise.
_LEAST_SCORE = 10.0
# Touches that a fit needs.
_LEAST_TOUCHES = 6
# Largest scatter of e: that of a ball is 0.1 to 2 %.
_MOST_SCATTER = 0.02
# m/s: a fall of 1.8 m. A faster first impact needs a height that the user gives.
_MOST_SPEED = 6.0


# No law is chosen below this score: 1 in 20 of such trains is not the ball's.
_SURE_SCORE = 25.0


@dataclass(frozen=True, slots=True)
class Picks:
    """Touches heard.

    times: (n,), s.
    numbers: (n,), which touch each is, from 0: some may be unheard.

    level: (n,), dB over the noise.
    band: Hz, above which they were looked for.
    score: ln of the likelihood ratio of one ball against clutter.
    scatter, alpha: of a fit to them alone; None where they are too few.
    """

    times: Floats
    numbers: Indices
    level: Floats
    band: float
    score: float = math.inf
    scatter: float | None = None
    alpha: Estimate | None = None

    def taken(self, touches: range) -> Picks:
        """The picks of these touches of the list, counted from 1."""
        kept = np.isin(np.arange(1, len(self.times) + 1), touches)
        return replace(
            self, times=self.times[kept], numbers=self.numbers[kept], level=self.level[kept]
        )


def rivals(heard: Sequence[Picks]) -> list[Picks]:
    """Trains that may be the ball's as well as the first, and give another α."""
    best, others = heard[0], []
    for other in heard[1:]:
        if best.alpha is None or other.alpha is None or other.scatter is None:
            continue
        if len(other.times) < _RIVAL_TOUCHES or other.scatter > _RIVAL_SCATTER:
            continue
        off = abs(other.alpha.value - best.alpha.value)
        sd = math.hypot(other.alpha.uncertainty, best.alpha.uncertainty)
        if off > max(_RIVAL_APART * sd, _RIVAL_SHARE * best.alpha.value):
            others.append(other)
    return others


def reservation_of(heard: Sequence[Picks]) -> str:
    """Reason to choose no law although the first train is likely the ball's; "" without one."""
    best = heard[0]
    if best.score >= _SURE_SCORE:
        return ""
    odds = f"ln odds {best.score:.0f}"
    return f"the touches are likely, not surely, the ball's ({odds}): look at --page, then take --touches A"


def doubts_of(
    heard: Sequence[Picks], scatter: float, fastest: float, height_given: bool
) -> list[str]:
    """Reasons to doubt that the first train is the ball's; with any, the fit gives no number.

    scatter: of e, 1.
    fastest: impact speed, m/s.
    """
    best, reasons = heard[0], []
    if best.score < _LEAST_SCORE:
        reasons.append("the clicks are hardly more regular than noise")
    if len(best.times) < _LEAST_TOUCHES:
        reasons.append(f"only {len(best.times)} touches are heard, and {_LEAST_TOUCHES} are needed")
    if scatter > _MOST_SCATTER:
        reasons.append(
            f"e varies by {100 * scatter:.2g} % from bounce to bounce, a ball's by 0.1 to 2 %"
        )
    if fastest > _MOST_SPEED and not height_given:
        reasons.append(
            f"the first impact would be at {fastest:.2g} m/s; give --height for a fall that high"
        )
    if rivals(heard):
        reasons.append("another train of clicks gives another α")
    return reasons
