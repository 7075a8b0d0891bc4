"""Flies a stretch of launches and says in columns what came of it; light, as engines' processes run this."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.errors import UserError
from hcbench.impact import Impact, Launch, Status
from hcbench.sim import registry

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from hcbench.impact import Loop
    from hcbench.scene import Scene
    from hcbench.setting import Setting


@dataclass(frozen=True, slots=True)
class Stretch:
    """Launches of one setting, (speed m/s, phase) each. keep: the indices of those whose loops are kept."""

    scene: Scene
    setting: Setting
    launches: Sequence[tuple[float, float]]
    keep: Collection[int]


@dataclass(frozen=True, slots=True)
class Flown:
    """What came of a stretch: `columns_of` its impacts, and kept loops by the launch's index."""

    columns: Mapping[str, Any]
    loops: Sequence[tuple[int, Loop]]

    @classmethod
    def of(cls, impacts: Sequence[Impact], keep: Collection[int]) -> Flown:
        """Of a stretch's impacts, in order."""
        kept = [(i, impacts[i].loop) for i in sorted(keep)]
        return cls(columns_of(impacts), [(i, loop) for i, loop in kept if loop is not None])


def columns_of(impacts: Sequence[Impact]) -> dict[str, Any]:
    """What impacts say of themselves: column -> values, one an impact."""
    return {
        "speed_m_per_s": [impact.launch.speed for impact in impacts],
        "phase": [impact.launch.phase for impact in impacts],
        "status": [impact.status.value for impact in impacts],
        "reason": [impact.reason for impact in impacts],
        "speed_in_m_per_s": np.array([impact.speed_in for impact in impacts], dtype=np.float64),
        "speed_out_m_per_s": np.array([impact.speed_out for impact in impacts], dtype=np.float64),
        "restitution": np.array([impact.restitution for impact in impacts], dtype=np.float64),
        "duration_s": np.array([impact.duration for impact in impacts], dtype=np.float64),
        "penetration_max_m": np.array([impact.penetration_max for impact in impacts], dtype=np.float64),
        "force_max_n": np.array([impact.force_max for impact in impacts], dtype=np.float64),
        "samples": np.array([impact.samples for impact in impacts], dtype=np.int64),
    }


def together(stretch: Stretch) -> Flown:
    """All of it at once, as the engine does best."""
    launches = [Launch(*launch) for launch in stretch.launches]
    impacts = registry.engine(stretch.setting.engine).run(stretch.scene, stretch.setting, launches)
    return Flown.of(impacts, stretch.keep)


def alone(which: Sequence[int], stretch: Stretch) -> Iterator[Impact]:
    """Some of it one by one: what the engine fails on is CRASHED, with the reason."""
    engine = registry.engine(stretch.setting.engine)
    for i in which:
        launch = Launch(*stretch.launches[i])
        try:
            (impact,) = engine.run(stretch.scene, stretch.setting, [launch])
        except UserError:
            raise
        except Exception as error:
            why = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(":")
            impact = Impact(launch, Status.CRASHED, why)
        yield impact if i in stretch.keep else dataclasses.replace(impact, loop=None)  # light to send
