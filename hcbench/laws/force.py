"""Force laws F(x, v): normal force over penetration and its rate.

x is the penetration (m, > 0 in contact), v its rate (m/s, > 0 on approach), F the force
on the bodies (N, > 0 apart). Equation numbers are those of K. H. Hunt, F. R. E.
Crossley, "Coefficient of Restitution Interpreted as Damping in Vibroimpact", J. Appl.
Mech. 42(2), 1975, doi 10.1115/1.3423596.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hcbench.system.errors import UserError
from hcbench.system.text import shown
from hcbench.terms.arguments import checked_fields, is_array
from hcbench.terms.bounds import LARGEST, positive, require
from hcbench.terms.impact import Floats


def _real(slot: str, values: Floats | float) -> Floats:
    """The values as an array; an array of NumPy as it is.

    slot: name of the argument.
    Raises UserError in its name for what is not real numbers.

    Solvers call a law's `force` a million times: this is faster than `checked`.
    """
    if type(values) is not float and not is_array(values):
        raise UserError(slot, shown(values), "a number, or an array of them")
    return np.asarray(values)


class ForceLaw(Protocol):
    """Anything that gives a normal force at x > 0; it is never evaluated at x <= 0."""

    def force(self, x: Floats | float, v: Floats | float) -> Floats:
        """F(x, v) in N; x and v broadcast."""
        ...


@checked_fields
@dataclass(frozen=True)
class HuntCrossley:
    """F = k x^n (1 + (3/2) α v), eq. (16).

    stiffness: k, N/m^n.
    alpha: α of e ≈ 1 - α v_i, s/m.
    exponent: n >= 1.
    """

    stiffness: float
    alpha: float
    exponent: float = 1.5

    def __post_init__(self) -> None:
        positive("stiffness", self.stiffness, "N/m^n")
        require(
            "alpha", self.alpha, 0 <= self.alpha <= LARGEST, f"0 s/m or more, up to {LARGEST:g}"
        )
        require("exponent", self.exponent, 1 <= self.exponent <= 10, "n within 1 ... 10")

    @property
    def dissipation(self) -> float:
        """a = (3/2) α = λ / k, s/m; what Drake calls `hunt_crossley_dissipation`."""
        return 1.5 * self.alpha

    def force(self, x: Floats | float, v: Floats | float) -> Floats:
        """F(x, v) in N, eq. (16); 0 where the bodies are apart, x <= 0."""
        depth = np.maximum(_real("x", x), 0.0)
        return np.asarray(
            self.stiffness
            * np.power(depth, self.exponent)
            * (1.0 + self.dissipation * _real("v", v))
        )


@checked_fields
@dataclass(frozen=True)
class KelvinVoigt:
    """F = k x + c v, eq. (4): jumps to c v_i at touch, pulls before parting.

    stiffness: k, N/m.
    damping: c, N s/m.
    """

    stiffness: float
    damping: float

    def __post_init__(self) -> None:
        """Raise UserError for a k that is not above 0 and for a c below 0."""
        positive("stiffness", self.stiffness, "N/m")
        require(
            "damping",
            self.damping,
            0 <= self.damping <= LARGEST,
            f"0 N s/m or more, up to {LARGEST:g}",
        )

    def force(self, x: Floats | float, v: Floats | float) -> Floats:
        """F(x, v) in N, eq. (4)."""
        return np.asarray(self.stiffness * _real("x", x) + self.damping * _real("v", v))
