"""A mass in a gap between two blocks: the appendix and the forced system of section 3.1.

Position q is 0 in the middle. The right block is touched at q = g/2, the left one at q = -g/2, so
the penetrations are x_R = q - g/2 and x_L = -q - g/2, and m q'' = F_L(x_L, -v) - F_R(x_R, v) +
P(t). g > 0 is clearance (two impacts a cycle), g = 0 two half loops that meet (Fig. 7), g < 0 a
mass squeezed from both sides (Figs. 8, 9). The blocks press and never pull: where a law would pull
(F < 0 at x > 0), nothing acts until it presses again or the surfaces part.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Literal, TypeAlias

import numpy as np
from scipy.integrate import quad

from hcbench.laws.force import ForceLaw, HuntCrossley
from hcbench.laws.require import positive, require
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats

Drive: TypeAlias = Callable[[float], float]


@dataclass(frozen=True, slots=True)
class Sinusoid:
    """P(t) = A sin(2π f t + φ): amplitude A, N; frequency f, Hz; phase φ, rad."""

    amplitude: float
    frequency: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        require(
            "amplitude", self.amplitude, math.isfinite(self.amplitude), "a finite amplitude in N"
        )
        positive("frequency", self.frequency, "Hz")
        require("phase", self.phase, math.isfinite(self.phase), "a finite phase in rad")

    def __call__(self, time: float) -> float:
        """P in N at `time` in s."""
        return self.amplitude * math.sin(2.0 * math.pi * self.frequency * time + self.phase)


@dataclass(frozen=True, slots=True)
class VibroImpact:
    """The mass (kg), the gap g (m; negative: squeezed) and the law of each block.

    depth_max: penetration (m) up to which the laws hold, such as `EllipticContact.depth_max()`; a
    gap that squeezes the mass further is refused.
    """

    mass: float
    gap: float
    right: ForceLaw
    left: ForceLaw
    depth_max: float = math.inf

    def __post_init__(self) -> None:
        positive("mass", self.mass, "kg")
        require("gap", self.gap, math.isfinite(self.gap), "a finite gap in m; negative: squeezed")
        require("depth_max", self.depth_max, self.depth_max > 0.0, "a depth above 0 m")
        if -self.gap / 2.0 > self.depth_max:
            raise UserError(
                "gap",
                f"{self.gap!r} m squeezes each side by {-self.gap / 2.0:.4g} m",
                f"at most {self.depth_max:.4g} m, where contact radius over surface radius reaches 0.1 and "
                "Hertz's law ends",
                f"Take a gap above {-2.0 * self.depth_max:.4g} m",
            )

    @property
    def squeeze(self) -> float:
        """Penetration on both sides at rest in the middle, m; 0 with clearance."""
        return max(0.0, -self.gap / 2.0)

    def resultant(self, position: Floats | float, velocity: Floats | float) -> Floats:
        """F_R - F_L in N, what the blocks do against q; positions (m)
        and velocities (m/s) broadcast.
        """
        q, v = np.broadcast_arrays(
            np.asarray(position, dtype=float), np.asarray(velocity, dtype=float)
        )
        half = self.gap / 2.0
        return pressing(self.right, q - half, v) - pressing(self.left, -q - half, -v)


def pressing(law: ForceLaw, penetration: Floats, rate: Floats) -> Floats:
    """F of a law that cannot pull, N: 0 for x <= 0 and where F would
    be below 0; arrays of one shape.
    """
    inside = np.maximum(penetration, 0.0)
    return np.where(penetration > 0.0, np.maximum(law.force(inside, rate), 0.0), 0.0)


def stored(law: ForceLaw, penetration: float) -> float:
    """Elastic energy ∫ F(x, 0) dx from 0 to `penetration` (m), J; 0 outside contact."""
    if penetration <= 0.0:
        return 0.0
    if isinstance(law, HuntCrossley):
        return float(law.stiffness * penetration ** (law.exponent + 1.0) / (law.exponent + 1.0))
    value, _ = quad(
        lambda x: float(law.force(x, 0.0)), 0.0, penetration, epsabs=0.0, epsrel=1e-13, limit=200
    )
    return float(value)


Side = Literal["right", "left"]
Kind = Literal["touch", "part", "release", "press"]


@dataclass(frozen=True, slots=True)
class Event:
    """A side touched or parted (x = 0), or its force went to 0 (release)
    or came back (press) at x > 0.

    time, s; rate: of penetration at that side, m/s, > 0 on approach.
    """

    time: float
    side: Side
    kind: Kind
    rate: float


@dataclass(frozen=True, slots=True)
class SimulatedMotion:
    """Motion, forces and energies: arrays of shape (n,) at the integrator's own steps, events
    included; SI.

    right, left: what the blocks press with, >= 0. kinetic + stored + lost - put_in is constant.
    """

    time: Floats
    position: Floats
    velocity: Floats
    right: Floats
    left: Floats
    kinetic: Floats
    stored: Floats
    lost: Floats
    put_in: Floats
    events: tuple[Event, ...]

    @property
    def resultant(self) -> Floats:
        """F_R - F_L, N: over `position`, the summed loops of Figs. 7, 8 and 9."""
        return self.right - self.left

    def during(self, start: float, end: float) -> SimulatedMotion:
        """The part with start <= time <= end, s."""
        keep = (self.time >= start) & (self.time <= end)
        arrays = {f.name: getattr(self, f.name)[keep] for f in fields(self) if f.name != "events"}
        events = tuple(e for e in self.events if start <= e.time <= end)
        return SimulatedMotion(**arrays, events=events)
