"""What tests look at inside an engine's world, in the process that it runs in."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from hcbench.sim import registry
from hcbench.sim.engine import SteppedEngine
from hcbench.workers import call

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.impact import Floats, Launch
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.sim.engine import World
    from hcbench.sim.read_impact import SpeedReading

Answer = TypeVar("Answer")

_LIMIT_S = 60.0


def run_where(engine: SteppedEngine, function: Callable[..., Answer], *args: Any) -> Answer:
    """What `function(*args)` returns where the engine's simulations run."""
    if engine.own_process or engine.interpreter is not None:
        return call(function, *args, limit=_LIMIT_S, at=engine.interpreter)
    return function(*args)


def reading_of(scene: Scene, setting: Setting, fastest: float) -> SpeedReading:
    """Which speeds an engine's e is the ratio of, under a setting. fastest: m/s at touch."""
    with _load(scene, setting, fastest) as world:
        return world.speed_reading


def record_in(
    scene: Scene, setting: Setting, launches: Sequence[Launch], fastest: float, parts: Sequence[int]
) -> Floats:
    """Penetration, rate and force of launches, advanced in parts of so many steps, shape (3, b, n)."""
    chunks = []
    with _load(scene, setting, fastest) as world:
        for group in (launches,) if world.places > 1 else [[launch] for launch in launches]:
            with closing(world.release(group)) as simulation:
                record = [simulation.advance(steps) for steps in parts]
            chunks.append(np.concatenate([(r.penetration, r.rate, r.force) for r in record], axis=2))
    return np.concatenate(chunks, axis=1)


def _load(scene: Scene, setting: Setting, fastest: float) -> World:
    engine = registry.engine(setting.engine)
    assert isinstance(engine, SteppedEngine)
    return engine.load(scene, setting, fastest)
