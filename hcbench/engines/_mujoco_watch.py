"""When a launch has shown all there is to see: where its record ends, whatever chunks it came in."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from hcbench.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hcbench.engines._mujoco_load import Loaded
    from hcbench.impact import Floats, Launch

    Whole = NDArray[np.int64]
    Flags = NDArray[np.bool_]

_CONTACT_S = 0.5  # how long a ball may stay in contact before it counts as resting there
_AT_REST = 1e-6  # of its impact speed
_STILL = 32  # steps in a row that slow, touched, are rest: a bounce turns around in far fewer


@dataclass(slots=True)
class Watch:
    """Over launches flown side by side; arrays of shape (b,).

    steps: seen so far. patience: steps after which a ball counts as resting, or as never touching.
    rest_speed: m/s. touch: the step in which the force first acted, or beyond every step. moved: the last
    step that was no rest.
    """

    patience: Whole
    rest_speed: Floats
    touch: Whole
    moved: Whole
    steps: int = 0

    @classmethod
    def over(cls, model: Loaded, launches: Sequence[Launch]) -> Watch:
        """A watch that has not begun. Raises SettingError for a launch that cannot arrive."""
        h, g = model.timestep, model.scene.gravity
        patience, rest_speed = [], []
        for launch in launches:
            gap = launch.gap(h)
            speed = math.sqrt(launch.speed**2 + 2.0 * g * gap)  # at touch
            if gap and not speed:
                raise SettingError("speed", "0 m/s without gravity", "a speed above 0, or gravity to fall by")
            flight = 2.0 * gap / (launch.speed + speed) if gap else 0.0
            patience.append(math.ceil(1.5 * flight / h) + math.ceil(_CONTACT_S / h) + 100)
            rest_speed.append(_AT_REST * speed)
        never = np.full(len(launches), np.iinfo(np.int64).max)
        return cls(np.array(patience, np.int64), np.array(rest_speed), never, np.full(len(launches), -1))

    def add(self, x: Floats, v: Floats, f: Floats) -> Whole:
        """One more chunk of penetration, rate and force, shape (b, n): how many of all steps to keep.

        0 for a launch that has not ended.
        """
        n = x.shape[1]
        step = self.steps + np.arange(n)
        acting = f != 0.0
        new = acting.any(axis=1) & (self.touch > step[-1])
        self.touch[new] = self.steps + acting[new].argmax(axis=1)
        after = step >= self.touch[:, None]
        over = after & (x <= 0.0) & (v < 0.0) & ~acting  # parted, as impact_of has it
        over |= ~np.isfinite(x + v + f)
        over |= step >= self.patience[:, None] - 1
        over |= self._rests(after & (np.abs(v) <= self.rest_speed[:, None]), step)
        self.steps += n
        return np.where(over.any(axis=1), step[0] + over.argmax(axis=1) + 1, 0)

    def _rests(self, still: Flags, step: Whole) -> Flags | np.bool_:
        if not still.any():
            self.moved[:] = step[-1]
            return np.False_
        moved = np.maximum.accumulate(np.where(still, self.moved[:, None], step), axis=1)
        self.moved = moved[:, -1]
        return np.asarray(still & (step - moved >= _STILL))

    def keep(self, which: Flags) -> None:
        """Watch only these from now on."""
        for part in fields(self):
            if part.name != "steps":
                setattr(self, part.name, getattr(self, part.name)[which])
