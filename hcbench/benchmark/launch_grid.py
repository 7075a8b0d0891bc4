"""The launches of one setting: at which speeds, angles and phases, and
how bodies are sent to touch so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.recipes.target import default_band
from hcbench.sim import registry
from hcbench.sim.columns import Launches
from hcbench.sim.engine import SteppedEngine
from hcbench.terms.impact import Launch
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from hcbench.benchmark.study import Run, Study
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting


@dataclass(frozen=True, slots=True)
class LaunchGrid:
    """A setting, launched or dropped at every speed (m/s), angle (rad) and
    phase, compared to every α (s/m).

    spin: of all, see `Launch`, rad/s.
    loop_speeds: those at which loops are kept, at the middle phase.
    share: of g h, see `SpeedReading`, by which every engine touches at the same speeds.
    """

    scene: Scene
    dropped: bool
    setting: Setting
    alphas: tuple[float, ...]
    speeds: tuple[float, ...]
    loop_speeds: tuple[float, ...]
    phases: int
    angles: tuple[float, ...]
    spin: tuple[float, float, float]
    share: float

    def __len__(self) -> int:
        return math.prod(self.shape)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of speeds, angles and phases."""
        return len(self.speeds), len(self.angles), self.phases

    def cut(self, part: range) -> tuple[LaunchGrid, range]:
        """A grid of no more speeds than a part of the launches has, and
        which of its launches these are.
        """
        row = len(self.angles) * self.phases
        first = part.start // row
        speeds = self.speeds[first : (part.stop - 1) // row + 1]
        loop_speeds = tuple(sorted({*self.loop_speeds} & {*speeds}))
        small = replace(self, speeds=speeds, loop_speeds=loop_speeds)
        return small, range(part.start - first * row, part.stop - first * row)

    def asked(self, part: range) -> tuple[Floats, Floats]:
        """The speed at touch, m/s, and the phase of some launches; those
        of one speed and angle together.
        """
        speed, _, phase = np.unravel_index(np.arange(part.start, part.stop), self.shape)
        return np.array(self.speeds)[speed], (phase + 0.5) / self.phases

    def launches(self, part: range) -> Launches:
        """Launches that reach the speeds (m/s) and phases of the grid at the touch.

        part: numbers of the launches in the grid, counted over speeds, then angles, then phases.
        """
        speed, phase = self.asked(part)
        _, angle, _ = np.unravel_index(np.arange(part.start, part.stop), self.shape)
        # Slip of a launch of 1 m/s at each angle.
        slips = np.array([Launch.at_angle(each, 1.0).slip[0] for each in self.angles])
        steps_most = 2.0
        if self.dropped:
            steps_most = math.inf
        return Launches.touching(
            speed,
            phase,
            self.setting.timestep,
            self.scene.normal_gravity,
            slip=speed * slips[angle],
            spin=self.spin,
            steps_most=steps_most,
            share=self.share,
        )

    def looped(self, part: range) -> list[int]:
        """Numbers of the launches whose loops are kept: at the middle phase, along the normal."""
        speed, phase = self.asked(part)
        kept = np.isin(speed, self.loop_speeds) & (phase == (self.phases // 2 + 0.5) / self.phases)
        return [int(i) for i in np.flatnonzero(kept & ~self.launches(part).is_oblique)]


def share_of(setting: Setting) -> float:
    """Share of g h that an engine's speed lacks under a setting, see `SpeedReading`."""
    engine = registry.adapter(registry.base_name(setting.engine))
    return engine.speed_reading(setting).share if isinstance(engine, SteppedEngine) else 0.0


def speeds_at(study: Study, run: Run, timestep: float) -> tuple[float, ...]:
    """Impact speeds of a run, m/s; on a field page moved into the band over which a body bounces at
    the step, with gravity or without.

    timestep: s. The speeds keep their order, and are stretched evenly.
    """
    first = run.speeds[0]
    last = run.speeds[-1]
    low, high = map(max, (first, last), default_band(timestep, STANDARD_GRAVITY))
    if study.page != "field" or low == first:
        return run.speeds
    stretch = 1.0
    if last > first:
        stretch = (high - low) / (last - first)
    return tuple(low + stretch * (speed - first) for speed in run.speeds)
