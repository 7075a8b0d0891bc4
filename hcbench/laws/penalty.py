"""Contacts given by a stiffness and a damping in SI: IMPACT of MSC Adams, ke and kd of Newton.

The restitution of both depends on the effective mass. IMPACT's depends on the speed, too: it does
not follow one α; `convert` matches it at one speed, `tune` over a band.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hcbench.laws import kelvin_voigt as kv
from hcbench.laws.require import positive, require
from hcbench.terms.arguments import checked_fields
from hcbench.terms.bounds import LARGEST
from hcbench.terms.impact import Floats


@checked_fields
@dataclass(frozen=True, slots=True)
class AdamsImpact:
    """F = max(0, k x^e + step(x, 0, 0, d, c_max) v), IMPACT of MSC Adams' function reference.

    step is the cubic from 0 at the touch to c_max at the depth d, and c_max below it.

    stiffness: k, N/m^e.
    exponent: e, 1 or more.
    damping: c_max, N s/m.
    depth: d, m.
    """

    stiffness: float
    exponent: float
    damping: float
    depth: float

    def __post_init__(self) -> None:
        positive("stiffness", self.stiffness, "N/m^n")
        require("exponent", self.exponent, 1 <= self.exponent <= 10, "n within 1 ... 10")
        require(
            "damping",
            self.damping,
            0 <= self.damping <= LARGEST,
            f"0 N s/m or more, up to {LARGEST:g}",
        )
        positive("depth", self.depth, "m")

    def force(self, x: Floats | float, v: Floats | float) -> Floats:
        """F(x, v) in N."""
        share = np.clip(np.asarray(x) / self.depth, 0.0, 1.0)
        damping = self.damping * share**2 * (3.0 - 2.0 * share)
        force = self.stiffness * np.power(x, self.exponent) + damping * np.asarray(v)
        return np.asarray(np.maximum(force, 0.0))

    def restitution(self, mass: float, speed: float) -> float:
        """e of an effective mass (kg) at an impact speed (m/s), by integration over time."""
        # SciPy's integrators are slow to import.
        from hcbench.laws import ode

        impact = ode.impact(self, mass, speed, count=3)
        return impact.speed_out / impact.speed_in

    def points(self, mass: float, low: float, high: float) -> tuple[tuple[float, float], ...]:
        """(speed m/s, e) over a band of speeds."""
        return tuple((v, self.restitution(mass, v)) for v in np.geomspace(low, high, 13).tolist())


@checked_fields
@dataclass(frozen=True, slots=True)
class NewtonSpring:
    """ke and kd of Newton's shapes.

    per_mass: whether the solver reads them in 1/s² and 1/s, the same for every mass,
    and never pulls. Else F = ke x + kd v on the way in and ke x on the way out, N/m
    and N s/m (SolverSemiImplicit).
    """

    per_mass: bool
    ke: float
    kd: float

    def __post_init__(self) -> None:
        positive("ke", self.ke, "1/s^2" if self.per_mass else "N/m")
        require("kd", self.kd, 0 <= self.kd <= LARGEST, f"0 or more, up to {LARGEST:g}")

    def restitution(self, mass: float) -> float:
        """e of an effective mass (kg), at any speed."""
        if self.per_mass:
            return float(kv.restitution(self.kd / (2.0 * math.sqrt(self.ke)), kv.Ending.FORCE))
        return one_way_restitution(self.kd / (2.0 * math.sqrt(self.ke * mass)))

    def points(self, mass: float, low: float, high: float) -> tuple[tuple[float, float], ...]:
        """(speed m/s, e): one pair, as e is the same over the band.

        high: m/s.
        """
        return ((low, self.restitution(mass)),)


def one_way_restitution(zeta: float) -> float:
    """e of a damper that acts on the way in only, over the damping ratio ζ: exp(-ζ acos ζ/√(1-ζ²)).

    The way in is a damped oscillator's from touch to its first standstill, at ω X/v
    = e; the spring returns it all.
    """
    if abs(zeta - 1.0) < 1e-8:
        return math.exp(-1.0)
    root = math.sqrt(abs(1.0 - zeta**2))
    if zeta < 1.0:
        angle = math.acos(zeta)
    else:
        angle = math.acosh(zeta)
    return math.exp(-zeta * angle / root)
