"""Closed forms that follow from eq. (16) of Hunt & Crossley 1975; no ODE.

With a = (3/2) α, y = a v and g(y) = y - ln(1 + y), one impact runs along

    k x^(n+1)/(n+1) = (m/a²) (g(a v_i) - g(a v)).

The signed root q = ±sqrt(2 g(y)) falls from Q to -Q as the body goes in and out again: q = Q cos
θ with θ from 0 (touch) to π (parting) makes x = x_m sin(θ)^(2/(n+1)), and the time a quadrature
whose ends are integrable. v_i is the speed in, v_o the speed out, m the effective mass.
Restitution depends on α v_i alone.

Everything is vectorised over speeds; a law with α = 0 is served by the same formulas. UserError
refuses speeds below 0 (and 0, where a motion over time is asked) and a mass that is not above 0.
"""

from __future__ import annotations

from functools import lru_cache
from math import ceil, gamma
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hcbench.laws._restitution_series import (
    inverse_restitution,
    one_minus_restitution,
    restitution_of,
)
from hcbench.laws.force import HuntCrossley
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats, Loop

# Of a loop: more cannot be drawn, and would take gigabytes.
_MOST_POINTS = 100_000
# Nodes and weights of Gauss-Jacobi quadrature.
#
# Golub and Welsch, Math. Comp. 23 (1969): the nodes are the eigenvalues of the recurrence's
# matrix. SciPy's own are ten times less exact, and importing them is a fifth of a `hcbench tune`.


@lru_cache(maxsize=64)
def gauss_jacobi(count: int, a: float, b: float) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss quadrature for the weight (1 - x)^a (1 + x)^b on -1 ... 1.

    Both have the shape (count,); the nodes rise. a and b have to be above -1, which is not checked.
    """
    # Golub and Welsch (1969): the nodes are the eigenvalues of the symmetric matrix of the
    # recurrence of the Jacobi polynomials, `middle` its diagonal and `beside` next to it.
    k = np.arange(count, dtype=np.float64)
    total = 2.0 * k + a + b
    # The first row is 0/0 where a + b is 0 or -1; the next lines replace it.
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = (b * b - a * a) / (total * (total + 2.0))
        beside = (
            4.0 * k * (k + a) * (k + b) * (k + a + b) / (total**2 * (total + 1.0) * (total - 1.0))
        )
    middle[0] = (b - a) / (a + b + 2.0)
    beside[0] = 0.0
    beside[1:2] = 4.0 * (1.0 + a) * (1.0 + b) / ((a + b + 2.0) ** 2 * (a + b + 3.0))
    beside = np.sqrt(beside)
    nodes = np.linalg.eigvalsh(np.diag(middle) + np.diag(beside[1:], -1))
    # A weight is one over the sum of the squared polynomials of norm 1 at its node; the recurrence
    # gives each polynomial by the two before it.
    before = np.zeros(count)
    here = np.ones(count)
    squares = here.copy()
    for i in range(count - 1):
        following = ((nodes - middle[i]) * here - beside[i] * before) / beside[i + 1]
        before = here
        here = following
        squares += here**2
    whole = 2.0 ** (a + b + 1.0) * gamma(a + 1.0) * gamma(b + 1.0) / gamma(a + b + 2.0)
    return np.asarray(nodes), np.asarray(whole / squares)


# Dimensionless path of eq. (16): g(y) = y - ln(1 + y), its inverse, and the rate at which the
# force peaks.
#
# y = a v = (3/2) α v is the rate, -1 < y; q = ±sqrt(2 g(y)) with the sign of y is the straightened
# rate. All of them are given as ratios that are finite and smooth at 0, so that α = 0 needs no
# branch.

# 2 (atanh r - r) / r³ / 2 = Σ r^(2i) / (2i + 3): 17 terms are enough for r² <= 1/9.
_ATANH = tuple(1.0 / (2 * i + 3) for i in range(17))
# Below this q, y is within 6 % of its limit -1, and ln(1 + y) is the better unknown.
_SERIES_FROM = -2.0


def g_ratio(y: Floats) -> Floats:
    """G(y) = 2 g(y) / y² with g(y) = y - ln(1 + y), over y > -1; same shape, 1 at 0.

    With r = y/(2 + y), ln(1 + y) = 2 atanh r: the series of atanh cancels nothing near 0. Beyond
    -0.5 ... 1 the logarithm itself has the digits.
    """
    moderate = np.clip(y, -0.5, 1.0)
    r = moderate / (2.0 + moderate)
    z = r * r
    tail = np.full_like(z, _ATANH[-1])
    for coefficient in _ATANH[-2::-1]:
        tail *= z
        tail += coefficient
    near = 2.0 / (2.0 + moderate) * (1.0 - 2.0 * moderate / (2.0 + moderate) ** 2 * tail)
    outside = moderate != y
    if not outside.any():
        return np.asarray(near)
    wide = np.where(outside, y, 1.0)
    return np.where(outside, 2.0 * (wide - np.log1p(wide)) / (wide * wide), near)


def rate_ratio(q: Floats) -> Floats:
    """y/q over any q, same shape, pure numbers; 1 at 0, NaN stays NaN.

    y is the inverse of q = ±sqrt(2 g(y)), g(y) = y - ln(1 + y), with the sign of q. Newton's method
    for q above _SERIES_FROM; below, y is near -1, and `_low_rate` finds it.
    """
    near = np.maximum(q, _SERIES_FROM)
    p = near * near / 2.0
    # Reversed series up to 2 (y = q + q²/3 + q³/36 - q⁴/270 ...), y = p + ln(1 + y) beyond.
    series = 1.0 + near / 3.0 + near**2 / 36.0 - near**3 / 270.0
    far = (p + np.log1p(p + np.log1p(p))) / np.where(near > 2.0, near, 1.0)
    ratio = np.where(near > 2.0, far, series)
    # Four steps bring both starting values to the last digits.
    for _ in range(4):
        y = near * ratio
        # |q| of this y over the q given: the ratio that is sought makes it 1. Its derivative by the
        # ratio is ratio/((1 + y) root).
        root = ratio * np.sqrt(g_ratio(y))
        ratio = ratio - (root - 1.0) * root * (1.0 + y) / ratio
    low = q < _SERIES_FROM
    if low.any():
        ratio = np.where(low, _low_rate(np.minimum(q, _SERIES_FROM)) / np.where(low, q, 1.0), ratio)
    return np.asarray(ratio)


def _low_rate(q: Floats) -> Floats:
    """y, between -1 and 0, for q <= -2, where q = -sqrt(2 g(y)) with g(y) = y - ln(1 + y); same
    shape, pure numbers.

    With 1 + y = exp(-ℓ), q²/2 = g(y) is ℓ + exp(-ℓ) = 1 + q²/2: Newton's method, from ℓ = 1 + q²/2.
    """
    wanted = 1.0 + q * q / 2.0
    ell = wanted
    # From q = -2 on, four steps reach the last digit.
    for _ in range(4):
        ell = ell - (ell + np.exp(-ell) - wanted) / -np.expm1(-ell)
    return np.expm1(-ell)


def largest_force_rate(d: Floats, exponent: float) -> Floats:
    """Y = y/d² at the largest force of an impact, y = (3/2) α v of the rate v there; shape of d.

    d: (3/2) α v_i, 0 or more.
    exponent: n. Pure numbers; (n + 1)/(2n) at d = 0.
    It is the root of n Y + (n + 1) g(d² Y)/d² = (n + 1) g(d)/d², with g(y) = y - ln(1 + y):
    convex, so Newton's method comes down from above.
    """
    n = exponent
    wanted = (n + 1.0) / 2.0 * g_ratio(d)
    share = np.minimum(wanted / n, 1.0 / np.maximum(d, 1e-300))
    # Four steps reach the last digits for d up to 1500 and n up to 10.
    for _ in range(8):
        y = d * d * share
        excess = n * share + (n + 1.0) / 2.0 * y * share * g_ratio(y) - wanted
        share = share - excess / (n + (n + 1.0) * y / (1.0 + y))
    return np.asarray(share)


# e is 7e-4 there; the nodes of a quadrature grow with the root of α v.
MOST_ALPHA_SPEED = 1e3
_PANEL_NODES = 10


def _not_negative(slot: str, value: Floats | float, unit: str) -> Floats:
    values = np.asarray(value, dtype=np.float64)
    return _refuse(slot, values, values < 0, unit, f"0 {unit} or more")


def _positive(slot: str, value: Floats | float, unit: str) -> Floats:
    values = np.asarray(value, dtype=np.float64)
    return _refuse(slot, values, ~(values > 0), unit, f"above 0 {unit}")


def _refuse(
    slot: str, values: Floats, wrong: NDArray[np.bool_], unit: str, expected: str
) -> Floats:
    """The values; UserError with the first of those where `wrong` is true.

    slot: name of the argument in the error.
    wrong: mask of the values' shape.
    unit: of the values.
    expected: what the error asks for.
    """
    if wrong.any():
        first = float(values[wrong].flat[0])
        raise UserError(slot, f"{first!r} {unit}", expected)
    return values


def _quadrature_width(law: HuntCrossley, speed: Floats) -> Floats:
    """q = sqrt(2 g(y)) at the touch, where y = d = (3/2) α v_i; over the impact runs from it to its
    negative. The larger, the more nodes a quadrature over the impact needs.

    speed: v_i, m/s; the result has its shape.
    Raises UserError for an α v above MOST_ALPHA_SPEED.
    """
    share = law.alpha * speed
    expected = f"up to {MOST_ALPHA_SPEED:g}, beyond which nothing bounces"
    _refuse("α v", share, ~(share <= MOST_ALPHA_SPEED), "", expected)
    d = np.asarray(law.dissipation * speed)
    return np.asarray(d * np.sqrt(g_ratio(d)))


def restitution(alpha: Floats | float, speed: Floats | float) -> Floats:
    """e of (16); alpha in s/m and speed in m/s broadcast. Relative error below 4e-15; 1 at d = 0.

    Raises UserError for an alpha or a speed below 0.
    """
    a = 1.5 * _not_negative("alpha", alpha, "s/m")
    return restitution_of(np.asarray(a * _not_negative("speed", speed, "m/s")))


def restitution_linear(alpha: Floats | float, speed: Floats | float) -> Floats:
    """e = 1 - α v_i, eq. (2); alpha in s/m and speed in m/s broadcast. Below 0 from v_i = 1/α on;
    numbers are not checked.
    """
    return np.asarray(
        1.0 - np.asarray(alpha, dtype=np.float64) * np.asarray(speed, dtype=np.float64)
    )


def alpha_of(restitution: Floats | float, speed: Floats | float) -> Floats:
    """α in s/m of the law that rebounds with this e (0 < e <= 1) at this speed (m/s); both broadcast.

    Raises UserError for an e outside that range, and for a speed that is not above 0.
    """
    e = _positive("restitution", restitution, "")
    if (e > 1).any():
        raise UserError(
            "restitution",
            f"{float(e.max())!r}",
            "0 < e <= 1",
            "A passive contact returns no more than it got",
        )
    return np.asarray(inverse_restitution(e) / (1.5 * _positive("speed", speed, "m/s")))


def energy_loss(law: HuntCrossley, mass: float, speed: Floats | float) -> Floats:
    """ΔE = ½ m v_i² (1 - e²) in J, the area of the loop; no digits are lost as e nears 1.

    mass: kg.
    speed: v_i, m/s; the result has its shape.
    Raises UserError for a mass that is not above 0 and for a speed below 0.
    """
    m = _positive("mass", mass, "kg")
    v = _not_negative("speed", speed, "m/s")
    lost = one_minus_restitution(np.asarray(law.dissipation * v))
    return np.asarray(0.5 * m * v**2 * lost * (2.0 - lost))


def penetration_max(law: HuntCrossley, mass: float, speed: Floats | float) -> Floats:
    """Largest penetration x_m of an impact, m, where the body turns; shape of `speed` (v_i, m/s).

    mass: kg.
    Raises UserError for a mass that is not above 0 and for a speed below 0.
    """
    m = _positive("mass", mass, "kg")
    v = _not_negative("speed", speed, "m/s")
    n = law.exponent
    work = (n + 1.0) * m * v**2 * g_ratio(np.asarray(law.dissipation * v)) / (2.0 * law.stiffness)
    return np.asarray(work ** (1.0 / (n + 1.0)))


def force_max(law: HuntCrossley, mass: float, speed: Floats | float) -> Floats:
    """Largest force of an impact, N, which acts on the way in, before the deepest point; shape of
    `speed` (v_i, m/s).

    mass: kg. With a = (3/2) α, y = a v and g(y) = y - ln(1 + y): dF/dt = 0 is n m v = a k x^(n+1),
    which on the path is n y + (n + 1) g(y) = (n + 1) g(a v_i).
    Raises UserError for a mass that is not above 0 and for a speed below 0.
    """
    m = _positive("mass", mass, "kg")
    v = _not_negative("speed", speed, "m/s")
    n, k = law.exponent, law.stiffness
    d = np.asarray(law.dissipation * v)
    # y / d²: finite even where d, and with it y, is 0.
    share = largest_force_rate(d, n)
    x = (n * m * v**2 * share / k) ** (1.0 / (n + 1.0))
    return np.asarray(k * x**n * (1.0 + d**2 * share))


def rate_at(
    law: HuntCrossley,
    mass: float,
    speed: float,
    penetration: Floats | float,
    branch: Literal["approach", "rebound"],
) -> Floats:
    """v in m/s at penetrations (m) on the way in (v > 0) or out (v < 0), same shape; NaN beyond the
    largest penetration, and for one below 0.

    mass: kg, above 0.
    speed: v_i, m/s; at 0 there is no motion, and all is NaN.
    branch: "approach", the way in, or "rebound", the way out.
    Raises UserError for a mass that is not above 0 and for a speed below 0.
    """
    x = np.asarray(penetration, dtype=np.float64)
    # x = x_m sin(θ)^(2/(n+1)) along the path, from θ = 0 at the touch to π at the parting.
    squared_cosine = 1.0 - (x / penetration_max(law, mass, speed)) ** (law.exponent + 1.0)
    is_reached = (x >= 0) & (squared_cosine >= 0)
    cosine = np.sqrt(np.where(is_reached, squared_cosine, np.nan))
    if branch == "rebound":
        cosine = -cosine
    rate, _ = _rate(law, speed, cosine)
    return rate


def _rate(law: HuntCrossley, speed: float, cosine: Floats) -> tuple[Floats, Floats]:
    """v, m/s, and the force over its elastic part, 1 + a v with a = (3/2) α, along the path of one
    impact; both in the shape of `cosine`.

    The path is q = Q cos θ with Q = d sqrt(G), d = a v_i: v = v_i sqrt(G) cos θ y/q.

    speed: v_i, m/s.
    cosine: cos θ, 1 at the touch and -1 at the parting.
    """
    d = law.dissipation * speed
    root = float(np.sqrt(g_ratio(np.asarray(d))))
    q = d * root * cosine
    ratio = rate_ratio(q)
    # ln(1 + y) = y - g(y): keeps its digits where the body leaves at nearly the limit -1/a.
    return speed * root * cosine * ratio, np.exp(q * ratio - q * q / 2.0)


def duration(law: HuntCrossley, mass: float, speed: Floats | float) -> Floats:
    """Time of contact in s, touch to parting; shape of `speed` (v_i, m/s).

    mass: kg.

    Relative error below 1e-13 for α v <= 2 and 5e-10 for α v <= 1000, as n goes from 1 to 10.
    Gauss-Jacobi over cos θ with the ends' weight (1 - cos²θ)^(-n/(n+1)): dt = T0 weight (q/y) d cos
    θ.
    Raises UserError for a mass or speed that is not above 0 and for an α v above 1000.
    """
    v = _positive("speed", speed, "m/s")
    width = _quadrature_width(law, v)
    # q/y is smooth at the scale of the nearest branch points |q| = sqrt(4π):
    # wider impacts need more nodes.
    count = 32 * (1 + int(width.max(initial=0.0) / 4.0))
    end = -law.exponent / (law.exponent + 1.0)
    cosine, weight = gauss_jacobi(count, end, end)
    total = (weight / rate_ratio(width[..., None] * cosine)).sum(axis=-1)
    return np.asarray(_time_scale(law, mass, v) * total)


def elastic_duration(stiffness: float, exponent: float, mass: float, speed: float) -> float:
    """Time of contact in s where nothing is lost: it goes by v^((1-n)/(1+n)), as eq. (8) says.

    stiffness: k, N/m^n.
    exponent: n.
    mass: kg.
    speed: v_i, m/s.
    Raises UserError for a mass or speed that is not above 0, and for a k or n that `HuntCrossley`
    refuses.
    """
    v = float(_positive("speed", speed, "m/s"))
    slowing = (1.0 - exponent) / (1.0 + exponent)
    return float(_elastic_at_one(stiffness, exponent, mass) * v**slowing)


@lru_cache(maxsize=64)
def _elastic_at_one(stiffness: float, exponent: float, mass: float) -> float:
    return float(duration(HuntCrossley(stiffness, 0.0, exponent), mass, 1.0))


def _time_scale(law: HuntCrossley, mass: float, speed: Floats) -> Floats:
    """T0 = 2 x_m / ((n + 1) v_i sqrt(G)), s, by which times along the path are scaled; shape of
    `speed` (v_i, m/s).

    G = 2 (d - ln(1 + d))/d² with d = (3/2) α v_i.
    mass: kg, above 0; a speed is above 0, which is not checked.
    """
    root = np.sqrt(g_ratio(np.asarray(law.dissipation * speed)))
    return np.asarray(
        2.0 * penetration_max(law, mass, speed) / ((law.exponent + 1.0) * speed * root)
    )


def loop(law: HuntCrossley, mass: float, speed: float, count: int = 401) -> Loop:
    """One loop from touch to parting: times from touch (s), penetrations x (m), rates (m/s, above 0
    on the way in) and forces (N), (count,) each, nearly even in time.

    mass: kg.
    speed: v_i, m/s. An odd count has the turning point x_m in its middle.
    Raises UserError for a mass or speed that is not above 0, for an α v above 1000, and for fewer
    than 3 points or more than _MOST_POINTS.
    """
    v = _positive("speed", speed, "m/s")
    if not 3 <= count <= _MOST_POINTS:
        raise UserError("count", f"{count!r}", f"3 ... {_MOST_POINTS} points")
    n = law.exponent
    theta = np.linspace(0.0, np.pi, count)
    elapsed = _elapsed(law, float(v), count)
    cosine = np.cos(theta)
    sine = np.sin(theta)
    # Touch, parting and turning point are exact: x is 0, and so is the rate.
    cosine[[0, -1]] = [1.0, -1.0]
    sine[[0, -1]] = 0.0
    if count % 2:
        cosine[count // 2] = 0.0
    x = penetration_max(law, mass, speed) * sine ** (2.0 / (n + 1.0))
    rate, push = _rate(law, float(v), cosine)
    time = _time_scale(law, mass, v) * elapsed
    return Loop(time=time, penetration=x, rate=rate, force=law.stiffness * x**n * push)


def _elapsed(law: HuntCrossley, speed: float, count: int) -> Floats:
    """Time from the touch, over T0 of `_time_scale`, at each of `count` even θ in 0 ... π; shape
    (count,).

    speed: v_i, m/s.

    θ runs along the impact: q = ±sqrt(2 g(y)) is Q cos θ, Q at the touch, with y = (3/2) α v and
    g(y) = y - ln(1 + y). The time is ∫ sin(θ)^-p (q/y) dθ from 0, p = (n-1)/(n+1). Gauss-Legendre
    panel by panel; the first and the last panel take the end's θ^-p as a Jacobi weight.
    Raises UserError for an α v above 1000.
    """
    p = (law.exponent - 1.0) / (law.exponent + 1.0)
    width = float(_quadrature_width(law, np.asarray(speed)))
    # Panels between two of the θ asked for: 16 or more in all, and more where q/y is steep.
    finer = ceil((16.0 + 8.0 * width) / (count - 1))
    edges = np.linspace(0.0, np.pi, finer * (count - 1) + 1)
    half = edges[1] / 2.0
    nodes, weights = gauss_jacobi(_PANEL_NODES, 0.0, 0.0)
    theta = edges[:-1, None] + half * (1.0 + nodes)
    panels = (half * weights * np.sin(theta) ** -p / rate_ratio(width * np.cos(theta))).sum(axis=1)
    nodes, weights = gauss_jacobi(_PANEL_NODES, 0.0, -p)
    theta = half * (1.0 + nodes)
    # θ^-p is in the weights: what is left of sin(θ)^-p is smooth. θ counts from each end.
    regular = half ** (1.0 - p) * weights * (theta / np.sin(theta)) ** p
    for panel, sign in ((0, 1.0), (-1, -1.0)):
        panels[panel] = (regular / rate_ratio(sign * width * np.cos(theta))).sum()
    return np.concatenate([[0.0], np.cumsum(panels)[finer - 1 :: finer]])
