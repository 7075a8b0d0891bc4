"""The interface between an engine and `hcbench.sim.simulate`: a world, its
simulations, and records of steps.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from hcbench.sim.read_impact import NOT_FINITE, SpeedReading
from hcbench.terms.resolution import ROUND_OFF_STEP

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from hcbench.sim.columns import Impacts, Launches
    from hcbench.terms.impact import Floats, Launch

    Flags = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Record:
    """States at the start of each step; arrays of shape (b, n), SI.

    penetration: above 0 in contact.
    rate: of penetration, above 0 on approach.
    force: the normal contact force that acts in the step, above 0 where it parts the two; exactly 0
    where the contact did not act.
    All three are NaN from the step on at which the engine gave up.

    tangential: the motion along the plate, (8, b, n): slip 2 m/s, spin 3 rad/s, friction 2 N, and
    the kinetic energy without that of the approach, J. None where no launch is oblique, or from an
    engine that knows the normal direction only.
    whole: all of these, one below the other, where an engine has them so; (3 or 11, b, n).
    """

    penetration: Floats
    rate: Floats
    force: Floats
    tangential: Floats | None = None
    whole: Floats | None = None

    def rows(self) -> Floats:
        """The whole record, one quantity below the other, shape (3 or 11, b, n)."""
        if self.whole is not None:
            return self.whole
        normal = np.stack([self.penetration, self.rate, self.force])
        return normal if self.tangential is None else np.concatenate([normal, self.tangential])


def momentum_force(
    mass: float, timestep: float, slowed: Floats, speeds: Floats, bits: int = 64
) -> Floats:
    """Normal force of each step from the change of momentum, N; exactly 0 where the change is not
    more than round-off, so that the contact did nothing.

    mass: kg.
    timestep: s.
    slowed: speed into the plate that the contact took in the step, m/s.
    speeds: sum of the absolute values of all speeds in that difference, m/s, by which round-off is
    judged; both of one shape.
    bits: of the engine's numbers, 32 or 64.
    """
    noise = ROUND_OFF_STEP * float(np.finfo(f"f{bits // 8}").eps) * speeds
    return np.asarray(mass * np.where(np.abs(slowed) <= noise, 0.0, slowed / timestep))


class CannotShareError(Exception):
    """Launches that were simulated together may have disturbed each other:
    each is to be simulated alone.
    """


class Simulation(ABC):
    """Some launches under way, from their release on."""

    @abstractmethod
    def advance(self, steps: int) -> Record:
        """Take between one step and `steps`, and return the record of the launches that are kept.

        Raises CannotShareError where launches that share a world have disturbed each other.
        """

    @abstractmethod
    def keep(self, which: Flags) -> None:
        """Go on with these only, shape (b,): the others have ended."""

    def notes(self, counts: NDArray[np.int64]) -> Sequence[str]:
        """Sentences on the forces other than the contact that acted on the bodies of each launch
        that has ended, in order; "" where none acted, () where no simulation like this has any.

        counts: steps of each launch under way that has ended, else 0, (b,).
        """
        return ()

    def close(self) -> None:  # noqa: B027 - most have nothing to put back
        """Put back what the simulation changed in its world."""


class World(ABC):
    """One or more equal bodies over what they fall on, in one engine.

    timestep: s.
    gravity: m/s², along the normal, into the plate.
    mass: effective mass along the normal, kg.
    places: launches that one simulation carries.
    least_steps: that it takes at once, at least.
    concurrent: simulations that may be under way at once, each in a thread of its own.
    deepest: penetration beyond which the engine cannot see the contact any more, m.
    diverged: the reason to give where numbers are not finite.
    speed_reading: which speeds e is the ratio of.
    energy_by_work: whether the energy lost is what the contact takes, as joints or servos change
    it, too.
    room: launches that `read` takes together; 0 for a world whose steps are recorded.
    least_taken: steps of the group of launches that took the fewest until now; 0 before the first.
    """

    timestep: float
    gravity: float
    mass: float
    places: int = 1
    least_steps: int = 0
    concurrent: int = 1
    deepest: float = math.inf
    diverged: str = NOT_FINITE
    speed_reading: SpeedReading = SpeedReading.TOUCH_PLANE
    energy_by_work: bool = False
    room: int = 0
    least_taken: int = 0

    @abstractmethod
    def release(self, launches: Sequence[Launch]) -> Simulation:
        """Bodies at their starting points, at most `places` of them, with nothing remembered."""

    def read(self, launches: Launches) -> Impacts:
        """The impacts of up to `room` launches, read while they are stepped; they have no loops."""
        raise NotImplementedError

    def follow(self, launch: Launch) -> Simulation:
        """One launch to be followed as far as one likes, stepped
        exactly as the engine's users do it.
        """
        return self.release([launch])

    def close(self) -> None:  # noqa: B027 - most hold nothing
        """Give back what the world holds."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
