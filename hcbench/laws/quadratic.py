"""Section 2.2's other choice of q: a damping force λ x^p v^q, with q = 2 worked out to the end.

The paper asks that ∮ λ x^p v^q dx have x_m in the power 3(n + 1)/2 and equal (11).
With v of (10) that fixes both:

    p = (3 - q)(n + 1)/2 - 1,    λ = α m (n + 1) C^(3-q) / (2 B((3 - q)/2, q/2
    + 1)),    C = √(2k/(m(n + 1)))

B the beta function. q = 1 gives p = n and λ = (3/2) α k, eq. (15); q = 2 gives p = (n - 1)/2 and λ2
= (3/8) α √(2 k m (n + 1)). (With x^n in front of v² the loss would go with x_m^(2(n+1)): no
constant λ2 could then match (11), nor would its unit be that of the printed α √(k m (n + 1)).)

Derived here, for q = 2: with z = b y_m, y = x^((n+1)/2), b = 4 λ2/(m(n + 1)) and u = α v_i the
path is linear in y and v², and

    (9/8) u² = f(z),    f(z) = 1 + (z - 1) e^z,    e² = f(-z)/f(z)   where x is 0 again.

So e depends on u alone, as with (16). But p < n: near x = 0 the damping outweighs the spring and F
pulls before parting, the fault that section 1.5 finds with (4). Contact that cannot pull ends at
z_F = z - ln(1 + z) with e² = z_F/((9/8) u²), a little faster.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammainc, hyp1f1

from hcbench.laws.closed_form import g_ratio
from hcbench.laws.kelvin_voigt import Ending
from hcbench.terms.bounds import positive, require, within
from hcbench.terms.impact import Floats


@dataclass(frozen=True, slots=True)
class QuadraticDamping:
    """F = k x^n + λ2 x^((n-1)/2) v |v|.

    stiffness: k, N/m^n.
    alpha: α, s/m.
    mass: kg, on which λ2 depends.
    exponent: n >= 1.
    """

    stiffness: float
    alpha: float
    mass: float
    exponent: float = 1.5

    def __post_init__(self) -> None:
        positive("stiffness", self.stiffness, "N/m^n")
        positive("mass", self.mass, "kg")
        require("alpha", self.alpha, 0 <= self.alpha < np.inf, "0 s/m or more")
        require("exponent", self.exponent, 1 <= self.exponent < np.inf, "n of 1 or more")

    @property
    def factor(self) -> float:
        """λ2 = (3/8) α √(2 k m (n + 1)), N s²/m^((n+3)/2)."""
        return (
            0.375
            * self.alpha
            * float(np.sqrt(2.0 * self.stiffness * self.mass * (self.exponent + 1.0)))
        )

    def force(self, x: Floats | float, v: Floats | float) -> Floats:
        """F(x, v) in N; x >= 0 in m, v in m/s."""
        rate = np.asarray(v)
        damping = self.factor * np.power(x, (self.exponent - 1.0) / 2.0) * rate * np.abs(rate)
        return np.asarray(self.stiffness * np.power(x, self.exponent) + damping)


def restitution(
    alpha: Floats | float, speed: Floats | float, ending: Ending = Ending.SURFACE
) -> Floats:
    """e of the q = 2 variant; alpha in s/m and speed in m/s broadcast.

    ending: where contact ends: at x = 0, or, of a contact that cannot pull, at F = 0.
    Raises UserError for an α v below 0 or NaN.
    """
    u = np.asarray(alpha, dtype=float) * np.asarray(speed, dtype=float)
    within("alpha * speed", u, 0.0, np.inf, "α v_i of 0 or more")
    z = turning_point(u)
    if ending is Ending.SURFACE:
        ratio = np.divide(gammainc(2.0, z), _f(z), out=np.ones_like(z), where=z > 0.0)
    else:
        # z - ln(1 + z) = G(z) z²/2 and f(z) = z²/2 1F1(2; 3; z): the z² go away.
        ratio = g_ratio(z) / hyp1f1(2.0, 3.0, z)
    return np.asarray(np.sqrt(ratio))


def turning_point(u: Floats | float) -> Floats:
    """z of f(z) = (9/8) u² over u = α v_i, same shape; 1.5 u where u is small.

    f(z) = 1 + (z - 1) e^z. u: 0 or more, not checked.
    """
    s = 1.125 * np.asarray(u, dtype=float) ** 2
    wanted = np.sqrt(2.0 * s)
    z = np.where(wanted < 1.0, wanted, np.log1p(s))
    # Newton's method on √(2 f), which is nearly straight where f itself is a parabola.
    for _ in range(60):
        root = np.sqrt(2.0 * _f(z))
        step = np.divide((root - wanted) * root, z * np.exp(z), out=np.zeros_like(z), where=z > 0.0)
        z = np.maximum(z - step, 0.0)
        if np.all(np.abs(step) <= 4e-16 * z):
            break
    return z


def _f(z: Floats) -> Floats:
    """f(z) = 1 + (z - 1) e^z = z²/2 1F1(2; 3; z), which cancels nothing."""
    return np.asarray(0.5 * z * z * hyp1f1(2.0, 3.0, z))
