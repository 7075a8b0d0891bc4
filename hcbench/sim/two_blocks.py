"""The scene `two-blocks`: a sphere that is free to move along x between two
fixed planes, without gravity.

An engine that can simulate it has a module `two_blocks` in its
package (`registry.submodule`) with

    simulate(blocks, position, velocity, forces) -> (positions, velocities)
        Steps from x (m) and v (m/s), one for each of `forces` (N, along x); arrays of shape (steps + 1,).
        Called in a worker process; raises EngineMissing where the backend is missing or too old.
    own_contact(squeezed) -> str
        What the engine's own contact is called, where it is tuned to the law: for a mass that is squeezed
        between the planes, or for one that is clear of them.
    NOTE
        A sentence on how the engine's own contact compares with the law.
"""

from dataclasses import dataclass
from pathlib import Path

from hcbench.laws.force import HuntCrossley
from hcbench.terms.scene import built_in_folder

NAME = "two-blocks"
# Radius of the sphere, m: the relative radius of the paper's section 3.1; no force depends on it.
RADIUS = 0.0508
# Names of the blocks' geoms, bodies and files, and the side of each along x.
SIDES = {"left": -1.0, "right": 1.0}


@dataclass(frozen=True, slots=True)
class TwoBlocks:
    """The scene with a mass (kg), a gap (m; negative: squeezed), a law
    of both contacts and a step (s).

    tuned_at: the speed (m/s) at which the engine's own contact is tuned to the law; None: the law
    itself, by the engine's plug-in.
    """

    mass: float
    gap: float
    law: HuntCrossley
    timestep: float
    tuned_at: float | None = None

    def plane(self, side: str) -> float:
        """x of a block's plane, m."""
        return SIDES[side] * (RADIUS + self.gap / 2.0)


def folder() -> Path:
    """Return the folder of the scene's files."""
    return built_in_folder(NAME)
