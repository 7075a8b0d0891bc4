"""Drops in the model of the rows: Euler's steps in contact, and each flight in one go."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.mujoco.scene.rows import acceleration
from hcbench.sim.passivity import HEIGHTS, LASTS, MOST_E, Bounces, LongestTrain, allowed_rebounds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.mujoco.scene.rows import ConstraintRow
    from hcbench.terms.impact import Floats

# A drop rests after so many steps in contact without a parting.
_RESTED = 200
# Steps in contact of each drop: of finer time steps the rest is left to the whole gate.
_MOST_STEPS = 6000
# Single launches start at this share of the band's lowest speed; so many
# speeds, at so many phases each.
_SLOW = 0.1
_SPEEDS = 24
_PHASES = 24


def bounces_in_rows(
    rows: Sequence[ConstraintRow],
    timestep: float,
    gravity: float,
    speeds: tuple[float, float],
    train: LongestTrain | None = None,
) -> Bounces:
    """Bounces of drops from HEIGHTS, and of single impacts from a tenth of the band up to its top,
    at many phases, in the model of the rows.

    timestep: s. gravity: m/s²; without it, 0, the single impacts alone.
    speeds: lowest and highest of the band, m/s; impacts go up to the speed of the highest drop,
    too.
    train: the longest train of bounces that the target allows; None: none goes on.
    """
    u = np.geomspace(
        _SLOW * speeds[0], max(speeds[1], math.sqrt(2.0 * gravity * HEIGHTS[-1])), _SPEEDS
    )
    later = (np.arange(_PHASES) + 0.5) / _PHASES
    v, phase = (axis.ravel() for axis in np.meshgrid(u, later, indexing="ij"))
    drops = _Drops(rows, timestep, gravity)
    impacts = drops.run(drops.touching(v, phase), np.zeros(v.size), impacts=1)
    if gravity == 0.0:
        return impacts
    allowed = allowed_rebounds(train, HEIGHTS, gravity)
    return impacts.joined(drops.run(drops.from_rest(np.array(HEIGHTS)), allowed))


class _Drops:
    """Balls over a plate, each with a clock of its own, under Euler's steps of a setting's rows.

    timestep: s. gravity: m/s². Penetration x, m, is above 0 in contact, its rate v, m/s, on
    approach; flights are advanced in closed form.
    """

    def __init__(self, rows: Sequence[ConstraintRow], timestep: float, gravity: float) -> None:
        self._rows = rows
        self._h = timestep
        self._g = gravity

    def touching(self, speeds: Floats, phases: Floats) -> Floats:
        """States, (5, n), of drops in their first step in contact.

        speeds: at touch, m/s, (n,). phases: where in a step each touches, 0 to 1, (n,).
        """
        time = self._h * (1.0 - phases)
        x = speeds * time + self._g * time**2 / 2.0
        return self._states(x, speeds + self._g * (time - self._h / 2.0), speeds)

    def from_rest(self, heights: Floats) -> Floats:
        """States of drops that fall from these heights, m."""
        at_rest = np.zeros(len(heights))
        states = self._states(-heights, at_rest, self._kept(-heights, at_rest))
        states[:2], _ = self._flown(*states[:2])
        return states

    def _states(self, x: Floats, v: Floats, speed_in: Floats) -> Floats:
        """Penetration, rate, speed at the last touch, time, and steps
        since the last flight; (5, n).
        """
        return np.stack([x, v, speed_in, *np.zeros((2, len(x)))])

    def _kept(self, x: Floats, v: Floats) -> Floats:
        """Speed at the touch plane of a flight, m/s."""
        squared = (v + self._g * self._h / 2.0) ** 2 - 2.0 * self._g * x
        return np.asarray(np.sqrt(np.maximum(0.0, squared)))

    def _flown(self, x: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
        """(x, v, duration s) of drops in flight, advanced to their first state in contact.

        x, v: at the flight's start, m and m/s, (n,).
        """
        g = self._g
        h = self._h
        half = v + g * h / 2.0
        steps = np.floor((-half + np.sqrt(half**2 - 2.0 * g * x)) / (g * h)) + 1.0
        fallen = x + steps * h * half + g * h**2 * steps**2 / 2.0
        return fallen, v + g * h * steps, steps * h

    def run(self, states: Floats, allowed: Floats, impacts: float = math.inf) -> Bounces:
        """Simulate until each drop has rested, or LASTS (s) are over, and count its bounces.

        states: (5, n): penetration, rate, speed at the last touch, time and steps since the last
        flight; changed.
        allowed: rebound speed of each drop at the end that its target allows, m/s, (n,).
        impacts: 1 ends each drop with its first rebound; infinite lets it bounce on.
        Returns the largest e, the fastest touch of those that gain energy, and the number of drops
        that bounce on.
        """
        count = states.shape[1]
        max_e = 0.0
        gains_below = 0.0
        bouncing = 0
        x, v, speed_in, clock, still = states
        for _ in range(_MOST_STEPS):
            v -= self._h * acceleration(self._rows, x, v, self._g)
            x += self._h * v
            clock += self._h
            still += 1.0
            parted = np.flatnonzero((x <= 0.0) & (v < 0.0))
            if parted.size:
                out = self._kept(x[parted], v[parted])
                came = speed_in[parted]
                e = out / came
                max_e = max(max_e, float(e.max()))
                gains_below = max(gains_below, float(came[e > MOST_E].max(initial=0.0)))
                if impacts == 1:
                    clock[parted] = math.inf
                else:
                    speed_in[parted] = out
                    still[parted] = 0.0
                    x[parted], v[parted], lasts = self._flown(x[parted], v[parted])
                    clock[parted] += lasts
            going = (clock <= LASTS) & (still < _RESTED)
            if not going.all():
                bounces_on = np.isfinite(clock) & (clock > LASTS) & (speed_in > allowed)
                bouncing += int(bounces_on.sum())
                allowed = allowed[going]
                states = states[:, going]
                x, v, speed_in, clock, still = states
                if not states.size:
                    break
        return Bounces(max_e, gains_below, bouncing, count)
