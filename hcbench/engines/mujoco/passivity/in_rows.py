"""Drops in the model of the rows: Euler's steps in contact, and each flight in one go."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.mujoco.scene.rows import acceleration
from hcbench.sim.passivity import HEIGHTS, LASTS, MOST_E, Bounces

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hcbench.engines.mujoco.scene.rows import ConstraintRow
    from hcbench.impact import Floats

_RESTED = 200  # steps in contact without a parting
_MOST_STEPS = 6000  # in contact, of each drop: what of finer steps comes after is left to the whole gate
_SLOW, _SPEEDS, _PHASES = 0.1, 24, 24  # launches once each: from this share of the lowest speed on


def bounces_in_rows(
    rows: Sequence[ConstraintRow], timestep: float, gravity: float, speeds: tuple[float, float]
) -> Bounces:
    """Drops from HEIGHTS, and single impacts from a tenth of the band (m/s) up to its top, at many phases."""
    u = np.geomspace(_SLOW * speeds[0], max(speeds[1], math.sqrt(2.0 * gravity * HEIGHTS[-1])), _SPEEDS)
    later = (np.arange(_PHASES) + 0.5) / _PHASES
    v, phase = (axis.ravel() for axis in np.meshgrid(u, later, indexing="ij"))
    impacts = _Drops(rows, timestep, gravity).touching(v, phase).run(impacts=1)
    if gravity == 0.0:
        return impacts
    return impacts.joined(_Drops(rows, timestep, gravity).from_rest(np.array(HEIGHTS)).run())


class _Drops:
    """Balls over a plate, each with a clock of its own."""

    def __init__(self, rows: Sequence[ConstraintRow], timestep: float, gravity: float) -> None:
        self._rows, self._h, self._g = rows, timestep, gravity

    def touching(self, speeds: Floats, phases: Floats) -> _Drops:
        """Drops that touch at these speeds, m/s, and phases, from their first state in contact on."""
        time = self._h * (1.0 - phases)
        self._x = speeds * time + self._g * time**2 / 2.0
        self._v, self._speed_in = speeds + self._g * (time - self._h / 2.0), speeds
        return self

    def from_rest(self, heights: Floats) -> _Drops:
        """Drops that fall from these heights, m."""
        self._x, self._v = -heights, np.zeros(len(heights))
        self._speed_in = self._kept(self._x, self._v)
        self._fly(np.arange(len(heights)), np.zeros(len(heights)))
        return self

    def _kept(self, x: Floats, v: Floats) -> Floats:
        """Speed at the touch plane of a flight, m/s."""
        squared = (v + self._g * self._h / 2.0) ** 2 - 2.0 * self._g * x
        return np.asarray(np.sqrt(np.maximum(0.0, squared)))

    def _fly(self, which: NDArray[np.int64], clock: Floats) -> None:
        """Advance the drops in flight to their first state in contact."""
        g, h, x, v = self._g, self._h, self._x[which], self._v[which]
        half = v + g * h / 2.0
        steps = np.floor((-half + np.sqrt(half**2 - 2.0 * g * x)) / (g * h)) + 1.0
        self._x[which] = x + steps * h * half + g * h**2 * steps**2 / 2.0
        self._v[which] = v + g * h * steps
        clock[which] += steps * h

    def run(self, impacts: float = math.inf) -> Bounces:
        """Until each has rested, has had so many impacts, or LASTS are over."""
        count = len(self._x)
        clock, still = np.zeros(count), np.zeros(count, np.int64)
        going, max_e, gains_below, bouncing = np.arange(count), 0.0, 0.0, 0
        for _ in range(_MOST_STEPS):
            x, v = self._x[going], self._v[going]
            v = v - self._h * acceleration(self._rows, x, v, self._g)
            x = x + self._h * v
            self._x[going], self._v[going] = x, v
            clock[going] += self._h
            still[going] += 1
            parted = going[(x <= 0.0) & (v < 0.0)]
            if parted.size:
                out = self._kept(self._x[parted], self._v[parted])
                e = out / self._speed_in[parted]
                max_e = max(max_e, float(e.max()))
                gains_below = max(gains_below, float(self._speed_in[parted][e > MOST_E].max(initial=0.0)))
                if impacts == 1:
                    clock[parted] = math.inf
                else:
                    self._speed_in[parted], still[parted] = out, 0
                    self._fly(parted, clock)
            bouncing += int((np.isfinite(clock[going]) & (clock[going] > LASTS)).sum())
            going = going[(clock[going] <= LASTS) & (still[going] < _RESTED)]
            if not going.size:
                break
        return Bounces(max_e, gains_below, bouncing, count)
