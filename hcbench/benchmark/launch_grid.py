"""The launches of one setting: at which speeds, angles and phases, and how bodies are sent to touch so."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hcbench.impact import Launch
from hcbench.recipes.band import default_band
from hcbench.sim import registry
from hcbench.sim.engine import SteppedEngine
from hcbench.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from hcbench.benchmark.study import Run, Study
    from hcbench.scene import Scene
    from hcbench.setting import Setting


@dataclass(frozen=True, slots=True)
class LaunchGrid:
    """A setting, launched or dropped at every speed (m/s), angle (rad) and phase, compared to every α (s/m).

    spin: of all, as `Launch` has it, rad/s. loop_speeds: those at which loops are kept, at the middle phase.
    share: of g h, as `SpeedReading` has it, by which every engine touches at the same speeds.
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
        """How many speeds, angles and phases."""
        return len(self.speeds), len(self.angles), self.phases

    def launch(self, speed: float, phase: float, angle: float) -> Launch:
        """How a body is sent to touch at a speed (m/s), phase and angle (rad)."""
        return Launch.touching(
            speed,
            phase,
            self.setting.timestep,
            self.scene.normal_gravity,
            slip=Launch.at_angle(angle, speed).slip,
            spin=self.spin,
            steps_most=math.inf if self.dropped else 2.0,
            share=self.share,
        )


def share_of(setting: Setting) -> float:
    """Of g h, as `SpeedReading` has it, in an engine under a setting."""
    engine = registry.adapter(registry.base_name(setting.engine))
    return engine.speed_reading(setting).share if isinstance(engine, SteppedEngine) else 0.0


def speeds_at(study: Study, run: Run, timestep: float) -> tuple[float, ...]:
    """Impact speeds of a run, m/s; on a field page moved into the band over which a body bounces at the step,
    with gravity or without.
    """
    first, last = run.speeds[0], run.speeds[-1]
    low, high = map(max, (first, last), default_band(timestep, STANDARD_GRAVITY))
    if study.page != "field" or low == first:
        return run.speeds
    stretch = (high - low) / (last - first) if last > first else 1.0
    return tuple(low + stretch * (speed - first) for speed in run.speeds)
