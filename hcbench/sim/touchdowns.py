"""Where a robot's recorded motion met the floor: the speeds of each foot, and the band its setting is for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hcbench.impact import Floats


@dataclass(frozen=True, slots=True)
class Touchdowns:
    """The touchdowns of one part of the model on one other.

    part, other: their names. time, s, speed: towards the other, and slide: along it, m/s; shape (n,) each.
    band: speeds that the setting of the two is valid for, m/s; None where hcbench did not write the setting.
    setting: what the two have, in words.
    """

    part: str
    other: str
    time: Floats
    speed: Floats
    slide: Floats
    band: tuple[float, float] | None
    setting: str

    @property
    def outside(self) -> float:
        """The share of touchdowns at speeds outside the band; NaN without a band."""
        if self.band is None:
            return float("nan")
        low, high = self.band
        return float(np.mean((self.speed < low) | (self.speed > high)))


@dataclass(frozen=True, slots=True)
class TrajectoryTouchdowns:
    """Touchdowns in a recorded motion.

    states: how many were read. interval: between two, s. feet: those that touch down most first.
    """

    engine: str
    version: str
    model: str
    states: int
    interval: float
    feet: tuple[Touchdowns, ...]
