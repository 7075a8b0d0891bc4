"""How fast a pair may meet before its stress limit is reached, by eqs. (5), (6) and (16)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy.optimize import brentq

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.hertz import SHEAR_LIMIT
from hcbench.laws.require import positive

if TYPE_CHECKING:
    from hcbench.laws.hertz_elliptic import EllipticContact


class Stressed(Protocol):
    """A contact whose shear stress follows from its force, such as `hertz.HertzContact`."""

    @property
    def stiffness(self) -> float:
        """k of F = k x^(3/2), N/m^1.5."""
        ...

    def force_at_shear(self, stress: float) -> float:
        """The force (N) at which the largest shear stress reaches `stress` (Pa)."""
        ...


def speed_at_force(law: HuntCrossley, mass: float, force: float) -> float:
    """v_i (m/s) at which the largest force of (16) is `force` (N); mass in kg."""
    positive("force", force, "N")
    positive("mass", mass, "kg")
    n1 = law.exponent + 1.0
    # Without loss F_max = k x_m^n and (8) hold; loss moves the speed by a factor that depends on α v alone.
    depth = (force / law.stiffness) ** (1.0 / law.exponent)
    lossless = float(np.sqrt(2.0 * law.stiffness * depth**n1 / (n1 * mass)))

    def excess(log_v: float) -> float:
        return float(np.log(closed_form.force_max(law, mass, float(np.exp(log_v))) / force))

    low, high = np.log(lossless) - 1.0, np.log(lossless) + 1.0
    while excess(low) > 0.0:
        low -= 2.0
    while excess(high) < 0.0:
        high += 2.0
    return float(np.exp(brentq(excess, low, high, xtol=1e-15, rtol=1e-14)))


def speed_at_shear(contact: Stressed, alpha: float, mass: float, stress: float = SHEAR_LIMIT) -> float:
    """v_i (m/s) at which a round contact reaches a shear stress (Pa); α in s/m, mass in kg."""
    return speed_at_force(HuntCrossley(contact.stiffness, alpha), mass, contact.force_at_shear(stress))


def speed_at_pressure(contact: EllipticContact, alpha: float, mass: float, pressure: float) -> float:
    """v_i (m/s) at which any Hertz contact reaches a largest pressure (Pa); α in s/m, mass in kg."""
    return speed_at_force(HuntCrossley(contact.stiffness, alpha), mass, contact.force_at_pressure(pressure))
