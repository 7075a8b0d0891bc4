"""Errors of the paper's approximations (2), (3), (8) ... (12) against eq. (16), and its other
choice of q, worked out.

Every measure depends on u = α v_i alone, not on k, m or (but for the depth (8)) on n. With d =
(3/2) u, G = 2 (d - ln(1 + d))/d² and e of (16): the elastic energy at the turning point is ½ m v_i²
G, and the loop takes ½ m v_i² (1 - G) on the way in and ½ m v_i² (G - e²) on the way out. Derived
from the path of (16); equation numbers are those of Hunt & Crossley 1975, doi 10.1115/1.3423596.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammainc, hyp1f1

from hcbench.laws._restitution_series import one_minus_restitution, restitution_of
from hcbench.laws.closed_form import g_ratio
from hcbench.laws.kelvin_voigt import Ending
from hcbench.terms.bounds import positive, require, within
from hcbench.terms.impact import Floats


def speed_at(
    stiffness: float,
    mass: float,
    exponent: float,
    depth: Floats | float,
    penetration: Floats | float,
) -> Floats:
    """|v|, m/s, of eq. (10) at `penetration` (m) of an impact that turns at `depth` (m); they
    broadcast.

    stiffness: N/m^exponent.
    mass: kg. At penetration 0 it is v_i of eq. (9), the inverse of (8).
    """
    n1 = exponent + 1.0
    left = np.asarray(depth, dtype=float) ** n1 - np.asarray(penetration, dtype=float) ** n1
    return np.asarray(np.sqrt(2.0 * stiffness / (mass * n1) * left))


def inward_share(u: Floats | float) -> Floats:
    """Share of the energy lost that the way in takes, over u = α v_i, same shape; 1/2 at u = 0.

    Of ½ m v_i², the way in takes 1 - G, G = 2 (d - ln(1 + d))/d² with d = 1.5 u, and both take 1 -
    e².
    Raises UserError for a u below 0.
    """
    d = 1.5 * within("u", u, 0.0, np.inf, "α v_i of 0 or more")
    s = one_minus_restitution(d)
    # 1 - G = 2 d (1/3 - d/4 + d²/5 ...): by its series where the difference would lose digits.
    coefficients = 2.0 / np.arange(3.0, 16.0)
    terms = np.polynomial.polynomial.polyval(-np.minimum(d, 0.05), coefficients)
    area = s * (2.0 - s)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(d < 0.05, d * terms, 1.0 - g_ratio(d)) / area
    return np.where(d == 0.0, 0.5, share)


@dataclass(frozen=True, slots=True)
class Approximation:
    """One step that the paper takes, against what eq. (16) does.

    ratio: (u, n) -> approximate over exact value, over u = α v_i; 1 where the step is exact.
    """

    name: str
    equation: str
    statement: str
    ratio: Callable[[Floats, float], Floats]

    def error(self, u: Floats | float, exponent: float = 1.5) -> Floats:
        """Relative error over u = α v_i, signed; same shape."""
        values = within("u", u, 0.0, np.inf, "α v_i of 0 or more")
        return np.asarray(self.ratio(values, exponent) - 1.0)

    def reaches(self, error: float, exponent: float = 1.5) -> float:
        """The smallest α v_i where the approximation is wrong by `error`, up or down; inf if beyond
        100.

        error: relative, 0.01 is one per cent.
        exponent: n of the law.
        Raises UserError unless 0 < error < 1.
        """
        require("error", error, 0.0 < error < 1.0, "an error between 0 and 1, such as 0.01")

        def excess(u: float) -> float:
            return abs(float(self.error(u, exponent))) - error

        # The first of a fine grid that is over, and its neighbour below, bracket the root.
        grid = np.geomspace(1e-8, 100.0, 400)
        over = np.flatnonzero([excess(float(u)) >= 0.0 for u in grid])
        if not over.size:
            return np.inf
        i = int(over[0])
        low = 0.0  # where no approximation is wrong
        if i > 0:
            low = float(grid[i - 1])
        return float(brentq(excess, low, float(grid[i]), xtol=1e-16, rtol=1e-13))


def _area(u: Floats) -> Floats:
    s = one_minus_restitution(1.5 * u)
    return np.asarray(s * (2.0 - s))


def _per_area(u: Floats, numerator: Floats) -> Floats:
    """numerator / (1 - e²), 1 in the limit u = 0."""
    return np.divide(numerator, _area(u), out=np.ones_like(u), where=u > 0.0)


APPROXIMATIONS = (
    Approximation(
        "restitution",
        "(2)",
        "e = 1 - α v_i, against e of (16)",
        lambda u, n: (1.0 - u) / restitution_of(1.5 * u),
    ),
    Approximation(
        "loss", "(3)", "ΔE = α m v_i³, against the loss of (16)", lambda u, n: _per_area(u, 2.0 * u)
    ),
    Approximation(
        "depth",
        "(8)",
        "largest penetration without loss, against x_m of (16)",
        lambda u, n: g_ratio(1.5 * u) ** (-1.0 / (n + 1.0)),
    ),
    Approximation(
        "speed in",
        "(10)",
        "speed from the depth without loss, against v_i, where (10) is worst on the way in",
        lambda u, n: np.sqrt(g_ratio(1.5 * u)),
    ),
    Approximation(
        "speed out",
        "(10)",
        "the same against v_o, where (10) is worst on the way out",
        lambda u, n: np.sqrt(g_ratio(1.5 * u)) / restitution_of(1.5 * u),
    ),
    Approximation(
        "loss from depth",
        "(11)",
        "ΔE from x_m, against the loss of (16) at that x_m",
        lambda u, n: _per_area(u, 2.0 * u * g_ratio(1.5 * u) ** 1.5),
    ),
    Approximation(
        "equal halves",
        "(12)",
        "twice the area of the way in, against the whole loop of (16)",
        lambda u, n: 2.0 * inward_share(u),
    ),
)


# Section 2.2's other choice of q: a damping force λ x^p v^q, with q = 2 worked out to the end.
#
# The paper asks that ∮ λ x^p v^q dx have x_m in the power 3(n + 1)/2 and equal (11). With v of
# (10) that fixes both:
#
# p = (3 - q)(n + 1)/2 - 1, λ = α m (n + 1) C^(3-q) / (2 B((3 - q)/2, q/2 + 1)), C = √(2k/(m(n +
# 1)))
#
# B the beta function. q = 1 gives p = n and λ = (3/2) α k, eq. (15); q = 2 gives p = (n - 1)/2
# and λ2 = (3/8) α √(2 k m (n + 1)). (With x^n in front of v² the loss would go with x_m^(2(n+1)):
# no constant λ2 could then match (11), nor would its unit be that of the printed α √(k m (n +
# 1)).)
#
# Derived here, for q = 2: with z = b y_m, y = x^((n+1)/2), b = 4 λ2/(m(n + 1)) and u = α v_i the
# path is linear in y and v², and
#
# (9/8) u² = f(z), f(z) = 1 + (z - 1) e^z, e² = f(-z)/f(z) where x is 0 again.
#
# So e depends on u alone, as with (16). But p < n: near x = 0 the damping outweighs the spring
# and F pulls before parting, the fault that section 1.5 finds with (4). Contact that cannot pull
# ends at z_F = z - ln(1 + z) with e² = z_F/((9/8) u²), a little faster.


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


def quadratic_restitution(
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

    It stands for the depth x at which a body turns whose damping grows with v² (q = 2): z is
    b x^((n+1)/2), a pure number, b of the law. f(z) = 1 + (z - 1) e^z.
    u: 0 or more, not checked.
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
