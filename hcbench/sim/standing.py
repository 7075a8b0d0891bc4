"""Rest, slope and grasp of a model: quantities that a setting of its contacts may not make worse."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import astuple, dataclass

from hcbench.sim.rest import Rest

# Times what it was: more than that is worse.
WORSE = 1.2


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity to compare.

    si: of what is printed.
    enough: below it, as printed, any number will do.
    """

    key: str
    title: str
    unit: str
    si: float
    enough: float


QUANTITIES = (
    Quantity("penetration_m", "penetration at rest", "mm", 1e-3, 0.1),
    Quantity("drift_m_per_s", "drift on a slope", "mm/s", 1e-3, 0.1),
    Quantity("hold_m_per_s", "drift in a grasp", "mm/s", 1e-3, 0.1),
    Quantity("vibration_m_per_s", "vibration at rest", "m/s", 1.0, 1e-5),
    Quantity("solver_iterations", "solver iterations", "a step", 1.0, 2.0),
    Quantity("step_time_s", "time of a step", "µs", 1e-6, 0.0),
)


@dataclass(frozen=True, slots=True)
class Standing:
    """A model at rest under its own gravity, on a slope and in a
    grasp, SI; NaN for what it has not.

    penetration: m.
    drift: along a slope of 10 degrees, or of two thirds of the friction angle where that is less,
    m/s.
    hold: of a body held by two others, m/s.
    vibration: rms, m/s.
    iterations: of the solver, in each step.
    step_time: of CPU, s.
    force_noise: standard deviation of the contact force over its mean.
    slope: rad.
    """

    penetration: float
    drift: float
    hold: float
    vibration: float
    iterations: float
    step_time: float
    force_noise: float = math.nan
    slope: float = math.nan

    @classmethod
    def of(
        cls, rest: Rest, on_slope: Rest, hold: float, cost: tuple[float, float], slope: float
    ) -> Standing:
        """Made of rests on the level and on a slope (rad), drift in a
        grasp, (iterations, time) of a step.
        """
        return cls(
            rest.penetration, on_slope.drift, hold, rest.vibration, *cost, rest.force_noise, slope
        )

    @property
    def record(self) -> dict[str, float]:
        """The numbers as JSON and the table have them, by key."""
        names = [quantity.key for quantity in QUANTITIES]
        return dict(zip(names, astuple(self), strict=False)) | {"force_noise": self.force_noise}

    def worse_than(self, before: Standing) -> Iterator[str]:
        """Quantities that grew by more than a fifth and are not small, in words."""
        for quantity, was, now in zip(QUANTITIES, astuple(before), astuple(self), strict=False):
            unit = quantity.si
            lost = math.isnan(now) and not math.isnan(was)
            if lost or now > max(WORSE * was, quantity.enough * unit):
                yield f"{quantity.title} {was / unit:.3g} -> {now / unit:.3g} {quantity.unit}"


UNKNOWN = Standing(*[math.nan] * 6)
