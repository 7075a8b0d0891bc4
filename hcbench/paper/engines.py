"""The mass between two blocks inside the engines, to be laid over the
reference: the scene `two-blocks`.

Contact is either the engine's plug-in, which is eq. (16) itself, or the best that the engine has of
its own, tuned at one speed. The engines run in a process of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.laws.force import HuntCrossley
from hcbench.sim import registry
from hcbench.sim.remote import interpreter_of
from hcbench.sim.two_blocks import TwoBlocks
from hcbench.terms.bounds import positive, require
from hcbench.workers import call

if TYPE_CHECKING:
    from hcbench.paper.vibroimpact.system import Sinusoid, VibroImpact
    from hcbench.terms.impact import Floats

# Processor time of one simulation, s: an engine that runs longer counts as hung.
LIMIT = 120.0


@dataclass(frozen=True, slots=True)
class EngineTrajectory:
    """Motion of an engine's mass at the ends of steps, arrays of shape (n,): s, m, m/s, N.

    resultant: what the blocks did against the position, by the change of speed; P taken off.
    """

    time: Floats
    position: Floats
    velocity: Floats
    resultant: Floats

    def since(self, start: float) -> EngineTrajectory:
        """The part with time >= start, s."""
        keep = self.time >= start
        return EngineTrajectory(
            self.time[keep], self.position[keep], self.velocity[keep], self.resultant[keep]
        )


def engines_with_two_blocks() -> list[str]:
    """Names of the engines that can simulate the scene, whether they are installed or not."""
    return [name for name in registry.names() if registry.submodule(name, "two_blocks") is not None]


def simulate_in_engine(
    name: str,
    system: VibroImpact,
    position: float,
    velocity: float,
    until: float,
    drive: Sinusoid | None = None,
    *,
    timestep: float = 1e-5,
    tuned_at: float | None = None,
) -> EngineTrajectory:
    """Simulate a system in an engine, from t = 0 on.

    name: of the engine, one of `engines_with_two_blocks`.
    system: both its blocks must have the same law (16).
    position, velocity: at the start, m and m/s; `VibroImpact` has the signs.
    until: duration, s. timestep: s.
    drive: P, N; None: the mass is free.
    tuned_at: speed, m/s, at which the engine's own contact is tuned; None: its plug-in is used.

    Raises UserError for a system that an engine cannot have and for numbers that are not above 0,
    EngineMissing, and EngineFailed where the engine crashes or passes LIMIT.

    The drive is leapfrog, so of second order: engines do v += h P/m, then q += h v. With P of the
    step's start, and the first velocity half a step behind, velocities are those half a step before
    the positions; the velocity at a step's end is the mean of its neighbours.
    """
    law = system.right
    alike = isinstance(law, HuntCrossley) and law == system.left
    require("laws", (system.right, system.left), alike, "the same law (16) on both sides")
    assert isinstance(law, HuntCrossley)
    positive("timestep", timestep, "s")
    positive("until", until, "s")
    if tuned_at is not None:
        positive("tuned_at", tuned_at, "m/s")
    engine = registry.engine(name)
    # Raises EngineMissing before the simulation starts.
    engine.version()
    count = math.ceil(until / timestep) + 1
    forces = np.zeros(count)
    if drive is not None:
        forces[:] = [drive(i * timestep) for i in range(count)]
    # Half a step before the position, see above.
    start = velocity - 0.5 * timestep * float(forces[0]) / system.mass
    blocks = TwoBlocks(system.mass, system.gap, law, timestep, tuned_at)
    where = interpreter_of(engine)
    positions, velocities = call(
        _simulate, name, blocks, position, start, forces, limit=LIMIT, at=where
    )
    return EngineTrajectory(
        time=np.asarray(np.arange(count) * timestep, dtype=np.float64),
        position=positions[:-1],
        velocity=np.asarray(0.5 * (velocities[:-1] + velocities[1:])),
        resultant=forces - system.mass * np.diff(velocities) / timestep,
    )


def _simulate(
    name: str, blocks: TwoBlocks, position: float, velocity: float, forces: Floats
) -> tuple[Floats, Floats]:
    """Simulate the two blocks, in the worker process."""
    states: tuple[Floats, Floats]
    states = registry.submodule(name, "two_blocks").simulate(blocks, position, velocity, forces)
    return states
