"""Many bracketed root searches side by side, one trial at a time each."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from hcbench.impact import Floats

    Flags = NDArray[np.bool_]

_EPS = float(np.finfo(float).eps)


class Searches:
    """Shortens a step from `high`, where a value is below 0, towards where it is 0; arrays of shape (n,).

    Newton's step where it stays inside the bracket, else the Illinois method (regula falsi that halves the
    value of an end that stays put; M. Dowell, P. Jarratt, BIT 11, 1971, 168-174, doi 10.1007/BF01934364),
    with a bisection every fourth trial.
    """

    def __init__(self, count: int) -> None:
        self.on = np.zeros(count, dtype=bool)
        self.trial = np.zeros(count)
        self._low, self._high = np.zeros(count), np.zeros(count)
        self._at_low, self._at_high = np.zeros(count), np.zeros(count)
        self._side, self._tries = np.zeros(count, dtype=np.int8), np.zeros(count, dtype=np.int64)

    def start(self, which: Flags, high: Floats, at_low: Floats, at_high: Floats) -> None:
        """Search where `which` is set, between a step of 0 and `high`, with the values there."""
        self.on |= which
        self._low[which], self._high[which] = 0.0, high[which]
        self._at_low[which], self._at_high[which] = at_low[which], at_high[which]
        self._side[which], self._tries[which] = 0, 0
        self._aim(which)

    def narrow(self, which: Flags, value: Floats, slope: Floats, near_zero: Floats) -> Flags:
        """Take in values and slopes (NaN where unknown) at the trials.

        Returns where the search is over, its trial being the answer: |value| within `near_zero` of 0, or the
        bracket no wider than rounding.
        """
        width, tried = self._high - self._low, self.trial.copy()
        done = which & ((np.abs(value) <= near_zero) | (width <= 2.0 * _EPS * self._high))
        self.on &= ~done
        good, bad = which & ~done & (value > 0.0), which & ~done & ~(value > 0.0)
        self._at_high[good & (self._side > 0)] *= 0.5
        self._at_low[bad & (self._side < 0)] *= 0.5
        self._low[good], self._at_low[good], self._side[good] = self.trial[good], value[good], 1
        self._high[bad], self._at_high[bad], self._side[bad] = self.trial[bad], value[bad], -1
        self._tries[good | bad] += 1
        more = good | bad
        self._aim(more)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = tried - value / slope
        inside = more & (newton > self._low) & (newton < self._high) & (self._tries % 4 != 3)
        self.trial[inside] = newton[inside]
        return done

    def _aim(self, which: Flags) -> None:
        low, high = self._low[which], self._high[which]
        at_low, at_high = self._at_low[which], self._at_high[which]
        span = high - low
        share = at_low / np.maximum(at_low - at_high, np.finfo(float).tiny)
        share = np.where(self._tries[which] % 4 == 3, 0.5, share)
        # An end whose value is 0 but for rounding must not pull the trial onto itself.
        self.trial[which] = low + span * np.clip(share, 1e-3 * (at_low <= 0.0), 1.0)

    def keep(self, which: Flags) -> None:
        """Drop all searches but those of `which`."""
        for name in ("on", "trial", "_low", "_high", "_at_low", "_at_high", "_side", "_tries"):
            setattr(self, name, getattr(self, name)[which])


def root_of_cubic(span: Floats, position: Floats, speed: Floats, share: Floats) -> Floats:
    """Where between 0 and 1 a cubic passes the point that lies at `share` of the way; a good first trial.

    span: the step, shape (n,). position, speed (its derivative): at both ends, shape (2, n).
    """
    rise = position[1] - position[0]
    v0, v1 = speed * span
    # q = v0 s + b s² + c s³ with the value and the slope at s = 1.
    c = v0 + v1 - 2.0 * rise
    b = rise - v0 - c
    s = np.clip(share, 0.0, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(4):
            value = s * (v0 + s * (b + s * c)) - share * rise
            s = np.clip(s - value / (v0 + s * (2.0 * b + s * 3.0 * c)), 0.0, 1.0)
    return np.where((s > 0.0) & (s < 1.0), s, np.clip(share, 1e-3, 1.0 - 1e-3))
