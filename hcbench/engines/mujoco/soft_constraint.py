"""What a MuJoCo contact promises: the restitution of its own law in continuous time.

One contact of solref and solimp accelerates the pair by d (k x + b v), clipped to a push, where the impedance
d and the gains k, b follow from the two (MuJoCo's documentation, "Computation", eqs. of solver parameters).
What the engine then delivers at a finite step is something else: the difference is what is diagnosed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import solve_ivp

from hcbench.laws.kelvin_voigt import Ending, damping_ratio_for

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.impact import Floats

MIN_IMPEDANCE, MAX_IMPEDANCE = 1e-4, 0.9999  # mjMINIMP, mjMAXIMP: what the engine clamps impedances to
HIGHEST_POWER = 1000.0  # of solimp; a little above, the sigmoid underflows
_TINY = 1e-15  # mjMINVAL
_SPRINGY = 0.1  # k h² from which a spring, not the damper of one step, makes the bounce
_SOFTEST = 100.0  # of the slowest time there is in a contact: how long one is followed


@dataclass(frozen=True, slots=True)
class ContactLaw:
    """Parameters of one contact as the engine uses them.

    solref: (time constant s, damping ratio), or (-stiffness 1/s^2, -damping 1/s), per unit effective mass.
    solimp: (d0, dwidth, width m, midpoint, power).
    timestep: s; shortest: the least time constant, s, that the engine's refsafe lets through (0: any).
    clamped: whether impedances are held within what the engine allows, as it does.
    """

    solref: tuple[float, float]
    solimp: tuple[float, float, float, float, float]
    timestep: float
    shortest: float = 0.0
    clamped: bool = True

    def impedance(self, x: float) -> float:
        """d at penetration x (m): a power sigmoid from d0 to dwidth."""
        d0, dw, width, midpoint, power = self._solimp()
        if width <= _TINY or d0 == dw:
            return 0.5 * (d0 + dw)
        u = min(abs(x) / width, 1.0)
        if power == 1 or u in (0.0, 1.0):
            return d0 + u * (dw - d0)
        if u <= midpoint:
            y = math.pow(u, power) / math.pow(midpoint, power - 1)
        else:
            y = 1 - math.pow(1 - u, power) / math.pow(1 - midpoint, power - 1)
        return d0 + y * (dw - d0)

    def gains(self) -> tuple[float, float]:
        """(k / d, b), 1/s^2 and 1/s: stiffness without its share of impedance, and damping."""
        dw = self._solimp()[1]
        first, second = self.solref
        if first > 0:
            constant = max(first, self.shortest)
            return 1 / max(_TINY, (dw * constant * second) ** 2), 2 / max(_TINY, dw * constant)
        return -first / max(_TINY, dw**2), -second / max(_TINY, dw)

    def _solimp(self) -> tuple[float, float, float, float, float]:
        d0, dw, width, midpoint, power = self.solimp
        if not self.clamped:
            return d0, dw, width, midpoint, power
        low, high = MIN_IMPEDANCE, MAX_IMPEDANCE
        return (
            min(max(d0, low), high),
            min(max(dw, low), high),
            max(width, 0.0),
            min(max(midpoint, low), high),
            max(power, 1.0),
        )

    @property
    def is_impulse(self) -> bool:
        """Whether one step takes the whole impact: damping that turns the body round, hardly any spring."""
        stiffness, damping = (-value for value in self.solref)
        return (
            self.solref[0] <= 0
            and 1.0 <= damping * self.timestep <= 2.0
            and stiffness * self.timestep**2 < _SPRINGY
        )

    @property
    def is_powerless(self) -> bool:
        """Whether neither spring nor damper pushes back."""
        return self.solref[0] <= 0 and max(abs(value) for value in self.solref) < _TINY

    @property
    def overflows(self) -> bool:
        """Whether the sigmoid of solimp cannot be computed, by the engine neither."""
        _, _, width, midpoint, power = self._solimp()
        low = min(midpoint, 1 - midpoint)
        return width > _TINY and power > HIGHEST_POWER and math.pow(max(low, 0.0), power - 1) == 0.0

    def restitution(self, speed: float) -> float:
        """e that this law promises at an impact speed, m/s; of an impulse setting the D h - 1 of its step."""
        if self.is_impulse:
            return -self.solref[1] * self.timestep - 1.0
        if not speed > 0 or self.overflows:
            return math.nan
        k, b = self.gains()

        def push(x: float, v: float) -> float:
            d = self.impedance(x)
            return d * (k * d * x + b * v)

        def motion(_: float, state: Floats) -> list[float]:
            x, v = state.tolist()
            return [v, -max(0.0, push(x, v))]

        def let_go(_: float, state: Floats) -> float:
            x, v = state.tolist()
            return push(x, v) if v < 0 else 1.0

        let_go.terminal = True  # type: ignore[attr-defined]
        if k <= 0:
            return 0.0
        softest = max(1e-6, min(self.impedance(0.0), self.impedance(math.inf)))
        end = _SOFTEST * (1 / (math.sqrt(k) * softest) + b / k)
        done = solve_ivp(
            motion,
            (0.0, end),
            np.array([0.0, speed]),
            method="LSODA",
            events=let_go,
            rtol=1e-8,
            atol=1e-12 * speed,
        )
        let_loose = done.t_events is not None and done.t_events[0].size > 0
        return float(max(0.0, -done.y[1, -1]) / speed) if let_loose else 0.0

    def curve(self, speeds: Sequence[float]) -> tuple[float, ...]:
        """e at each of `speeds` (m/s)."""
        return tuple(self.restitution(float(v)) for v in speeds)


def spring_damper(e: float, timestep: float, steps: int = 40) -> tuple[float, float]:
    """(stiffness, damping) of a contact that lasts `steps` steps and gives e, per unit effective mass.

    The body parts where its force ends, as MuJoCo clips it. e from 0.14 (critical damping) to 1.
    """
    zeta = min(damping_ratio_for(min(max(e, 0.1), 1.0), Ending.FORCE), 0.999)
    omega = math.pi / (steps * timestep * math.sqrt(1 - zeta**2))
    return omega**2, 2 * zeta * omega
