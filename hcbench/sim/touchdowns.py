"""Touchdowns of a robot's recorded motion: the speeds of each foot, and the band its setting must
cover.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from hcbench.system.notebook import Shown
from hcbench.terms.impact import Floats


@dataclass(frozen=True, slots=True)
class Touchdowns:
    """The touchdowns of one part of the model on one other.

    part, other: their names. time, s, speed: towards the other, and slide: along it, m/s; shape (n,) each.
    band: speeds that the setting of the two is valid for, m/s; None where hcbench did not write the setting.
    setting: what the two have, in words.
    """

    part: str
    other: str
    time: Floats = field(repr=False)
    speed: Floats = field(repr=False)
    slide: Floats = field(repr=False)
    band: tuple[float, float] | None
    setting: str

    @property
    def outside(self) -> float:
        """The share of touchdowns at speeds outside the band; NaN without a band."""
        if self.band is None:
            return float("nan")
        low, high = self.band
        return float(np.mean((self.speed < low) | (self.speed > high)))


@dataclass(frozen=True, slots=True, repr=False)
class TrajectoryTouchdowns(Shown):
    """Touchdowns in a recorded motion.

    states: how many were read. interval: between two, s. feet: those that touch down most first.
    """

    engine: str
    version: str
    model: str
    states: int
    interval: float
    feet: tuple[Touchdowns, ...]

    def _lines(self) -> Iterator[str]:
        every = f"{self.states} states, one every {1e3 * self.interval:.4g} ms"
        yield f"{self.model}: {every}, {self.engine} {self.version}"
        for foot in self.feet:
            most = f"at up to {foot.speed.max():.3g} m/s"
            yield f"{foot.part} on {foot.other}: {len(foot.time)} touchdowns {most}"

    def _rows(self) -> Iterator[dict[str, object]]:
        for foot in self.feet:
            for time, speed, slide in zip(foot.time, foot.speed, foot.slide, strict=True):
                yield {
                    "part": foot.part,
                    "other": foot.other,
                    "time_s": float(time),
                    "normal_speed_m_per_s": float(speed),
                    "sliding_speed_m_per_s": float(slide),
                }
