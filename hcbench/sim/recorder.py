"""When a flight is over: the same for every engine."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np

from hcbench.impact import Impact, Launch, Status, Trajectory, impact_of

MAX_STEPS = 200_000
_LONGEST = 5.0  # s of simulated contact: no bounce lasts longer
_AT_REST = 1e-3  # of the speed in: slower than this for half as long as the contact has lasted
_JITTER = 1.5  # of what gravity gives in a step: a resting body's speed may be that large
_PATIENCE = 128  # steps in contact before the first look for rest
_FLIGHT_SLACK = 100  # steps beyond the expected flight in which the touch must come


@dataclass(slots=True)
class Track:
    """What is written down on the way; one entry a step, for the state before it. SI, signs as in an Impact.

    verdict: set where there is no impact to compute, with the reason; a reason alone is that of a rest.
    fall: speed that gravity gives in a step, m/s.
    timestep: s.
    """

    timestep: float
    fall: float = 0.0
    penetration: list[float] = field(default_factory=list)
    rate: list[float] = field(default_factory=list)
    force: list[float] = field(default_factory=list)
    verdict: Status | None = None
    reason: str = ""
    touched: int = -1

    def is_over(self, patience: int) -> bool:
        """Whether nothing more can happen to this impact, after at most `patience` steps of flight."""
        step = len(self.rate) - 1
        if self.touched < 0:
            if step > patience or self.rate[-1] < 0:
                self.verdict = Status.NO_TOUCH
                self.reason = (
                    f"no contact force within {step} steps"
                    if self.rate[-1] >= 0
                    else "turned back without a contact force of the pair"
                )
            return self.verdict is not None
        if self.force[-1] == 0.0 and self.penetration[-1] <= 0.0 and self.rate[-1] < 0.0:
            return True
        lasted = step - self.touched
        if lasted * self.timestep > _LONGEST:
            self.give_up()
            return True
        if lasted >= _PATIENCE and lasted & (lasted - 1) == 0:  # at powers of two
            recent = max(abs(v) for v in self.rate[-lasted // 2 :])
            if recent < max(_AT_REST * abs(self.rate[self.touched]), _JITTER * self.fall):
                self.reason = f"slower than {recent:.2g} m/s for {lasted // 2} steps"
                return True
        return False

    def give_up(self) -> None:
        """The contact never ended."""
        steps = len(self.rate) - self.touched
        self.verdict = Status.CRASHED
        self.reason = (
            f"still in contact, and not at rest, after {steps} steps ({steps * self.timestep:.3g} s)"
        )

    def impact(self, launch: Launch) -> Impact:
        """The impact that was written down."""
        force, rate = np.array(self.force, np.float64), np.array(self.rate, np.float64)
        if self.verdict is not None:
            seen = int(np.count_nonzero(force)) if self.verdict is not Status.NO_TOUCH else 0
            return Impact(launch, self.verdict, self.reason, samples=seen)
        time = np.arange(len(rate), dtype=np.float64) * self.timestep
        found = impact_of(launch, Trajectory(time, np.array(self.penetration, np.float64), rate, force))
        if found.status is Status.RESTED and self.reason:
            return dataclasses.replace(found, reason=self.reason)
        if found.loop is not None and not (found.speed_in > 0 and found.speed_out >= 0):
            reason = "turned back by something else than the contact of the pair"
            return Impact(launch, Status.DIVERGED, reason, samples=found.samples)
        return found


def patience(speed: float, gap: float, falls: bool, timestep: float, g: float) -> int:
    """Steps within which a touch must come; falls: let go from a height, so that gravity counts."""
    flight = gap / speed if speed > 0 else 0.0
    fall = (2 * gap / g) ** 0.5 if g > 0 and falls else 0.0
    return min(MAX_STEPS - 1, int(4 * max(flight, fall) / timestep) + _FLIGHT_SLACK)
