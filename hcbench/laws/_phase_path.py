"""Dimensionless path of eq. (16): g(y) = y - ln(1 + y), its inverse, and the rate at which the
force peaks.

y = a v = (3/2) α v is the rate, -1 < y; q = ±sqrt(2 g(y)) with the sign of y is the straightened
rate. All of them are given as ratios that are finite and smooth at 0, so that α = 0 needs no
branch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats

# 2 (atanh r - r) / r³ / 2 = Σ r^(2i) / (2i + 3): 17 terms are enough for r² <= 1/9.
_ATANH = tuple(1.0 / (2 * i + 3) for i in range(17))
# Below this q, y is within 6 % of its limit -1, and ln(1 + y) is the better unknown.
_SERIES_FROM = -2.0


def g_ratio(y: Floats) -> Floats:
    """G(y) = 2 g(y) / y², same shape; 1 at 0. With r = y/(2 + y), ln(1 + y) = 2 atanh r."""
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
    """y/q over any q, same shape; 1 at 0. The inverse of q = ±sqrt(2 g(y)), by Newton."""
    near = np.maximum(q, _SERIES_FROM)
    p = near * near / 2.0
    # Reversed series up to 2 (y = q + q²/3 + q³/36 - q⁴/270 ...), y = p + ln(1 + y) beyond.
    series = 1.0 + near / 3.0 + near**2 / 36.0 - near**3 / 270.0
    far = (p + np.log1p(p + np.log1p(p))) / np.where(near > 2.0, near, 1.0)
    ratio = np.where(near > 2.0, far, series)
    for _ in range(4):
        y = near * ratio
        # The root that Newton's method seeks makes this 1.
        root = ratio * np.sqrt(g_ratio(y))
        ratio = ratio - (root - 1.0) * root * (1.0 + y) / ratio
    low = q < _SERIES_FROM
    if low.any():
        ratio = np.where(low, _low_rate(np.minimum(q, _SERIES_FROM)) / np.where(low, q, 1.0), ratio)
    return np.asarray(ratio)


def _low_rate(q: Floats) -> Floats:
    """y for q <= -2, from ℓ + exp(-ℓ) = 1 + q²/2 with 1 + y = exp(-ℓ)."""
    wanted = 1.0 + q * q / 2.0
    ell = wanted
    for _ in range(4):
        ell = ell - (ell + np.exp(-ell) - wanted) / -np.expm1(-ell)
    return np.expm1(-ell)


def largest_force_rate(d: Floats, exponent: float) -> Floats:
    """y/d² where F is largest on the path that starts at y = d; same shape, (n + 1)/(2n) at d = 0.

    Root Y of n Y + (n + 1) g(d² Y)/d² = (n + 1) g(d)/d²: convex, so Newton comes down from above.
    """
    n = exponent
    wanted = (n + 1.0) / 2.0 * g_ratio(d)
    share = np.minimum(wanted / n, 1.0 / np.maximum(d, 1e-300))
    for _ in range(8):
        y = d * d * share
        excess = n * share + (n + 1.0) / 2.0 * y * share * g_ratio(y) - wanted
        share = share - excess / (n + (n + 1.0) * y / (1.0 + y))
    return np.asarray(share)
