"""When a launch has shown all there is to see: where its record ends, whatever chunks it came in."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.impact import not_finite

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from hcbench.impact import Floats

    Whole = NDArray[np.int64]
    Flags = NDArray[np.bool_]


@dataclass(slots=True)
class Watch:
    """Over launches flown side by side; arrays of shape (b,).

    patience: steps after which a ball counts as resting, or as never touching. rest_speed: m/s. still: steps
    in a row that slow, touched, which are rest. deepest: m, penetration beyond which there is nothing to see.
    steps: seen so far. touch: the step in which the force first acted, or beyond every step. moved: the last
    step that was no rest.
    """

    patience: Whole
    rest_speed: Floats
    still: int
    touch: Whole
    moved: Whole
    deepest: float = math.inf
    steps: int = 0

    @classmethod
    def over(cls, patience: ArrayLike, rest_speed: ArrayLike, still: int, deepest: float = math.inf) -> Watch:
        """A watch that has not begun."""
        steps, slow = np.array(patience, np.int64), np.array(rest_speed, np.float64)
        never, moved = np.full(len(steps), np.iinfo(np.int64).max), np.full(len(steps), -1)
        return cls(steps, slow, still, never, moved, deepest)

    def add(self, x: Floats, v: Floats, f: Floats) -> Whole:
        """One more chunk of penetration, rate and force, shape (b, n): how many of all steps to keep.

        0 for a launch that has not ended.
        """
        n = x.shape[1]
        step = np.arange(self.steps, self.steps + n)
        acting = f != 0.0
        new = acting.any(axis=1) & (self.touch > step[-1])
        self.touch[new] = self.steps + acting[new].argmax(axis=1)
        after = step >= self.touch[:, None]
        over = after & (x <= 0.0) & (v < 0.0) & ~acting  # parted, as impact_of has it
        over |= not_finite(x, v, f)
        if self.deepest < math.inf:
            over |= x > self.deepest
        if step[-1] >= self.patience.min() - 1:
            over |= step >= self.patience[:, None] - 1
        slow = self.rest_speed[:, None]
        over |= self._rests(after & (v <= slow) & (v >= -slow), step)
        self.steps += n
        return np.where(over.any(axis=1), step[0] + over.argmax(axis=1) + 1, 0)

    def _rests(self, still: Flags, step: Whole) -> Flags | np.bool_:
        if not still.any():
            self.moved[:] = step[-1]
            return np.False_
        moved = np.maximum.accumulate(np.where(still, self.moved[:, None], step), axis=1)
        self.moved = moved[:, -1]
        return np.asarray(still & (step - moved >= self.still))

    def keep(self, which: Flags) -> None:
        """Watch only these from now on."""
        self.patience, self.rest_speed = self.patience[which], self.rest_speed[which]
        self.touch, self.moved = self.touch[which], self.moved[which]
