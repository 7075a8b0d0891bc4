"""The speed v_i at which an impact began, from any state within it: what F = k x^n (1 + χ x'/v_i) needs.

The laws of `hcbench.laws.published` take v_i from each impact. It need not be remembered: with u = x'/v_i and
κ = k/m, a contact under this force alone has

    v_i² (H(1) - H(u)) = κ x^(n+1)/(n+1),   H(u) = ∫_0^u w/(1 + χ w) dw = (χ u - ln(1 + χ u))/χ²,

whose left side rises with v_i, so that (x, x') belongs to one v_i. A constant acceleration b towards contact,
as of gravity, does the work W = b ∫ dx/(1 + χ u) along the path, which is taken off the right side. W is
found on the path without b, to first order. For a resting body W exceeds the stored energy: it is capped at
3/4 of it, so that the damping stays finite. With steel on steel under its weight e is off by up to 1e-6 at
0.5 m/s, 7e-6 at 0.1 and 2e-4 at 0.025, where the weight's work is a twentieth of the energy. Other loads on a
contact, such as the forces of neighbours, are not seen: they shift v_i² by about twice their work over m.

The same lines in C are in touch_speed.c; a test compares the two.
"""

from __future__ import annotations

import math

_MAX_ITERATIONS = 60
_NO_SPEED = 1e-150  # m/s: the square of a slower one is 0
_NODES = (0.06943184420297371, 0.33000947820757187, 0.6699905217924281, 0.9305681557970263)  # Gauss-Legendre
_WEIGHTS = (0.17392742256872692, 0.32607257743127307, 0.32607257743127307, 0.17392742256872692)
_LARGEST_WORK = 0.75  # of the stored energy: what a constant load can have brought


def touch_speed(kappa: float, n: float, chi: float, e: float, load: float, x: float, v: float) -> float:
    """v_i in m/s of the impact that is at x with rate v (x <= 0: that begins or has ended with it).

    kappa: k/m. n: exponent. chi: χ > 0, e: what χ delivers. load: b, m/s².
    """
    if x <= 0.0:
        square = v * v - 2.0 * load * x if v > 0.0 else v * v + 2.0 * load * x
        return math.sqrt(max(square, 0.0)) * (1.0 if v > 0.0 else 1.0 / e)
    stored = float(kappa * x ** (n + 1.0) / (n + 1.0))
    speed = _speed_for_energy(stored, chi, e, v)
    for _ in range(2 if load != 0.0 else 0):
        work = load * _work_of_load(kappa, n, chi, e, x, v, speed)
        speed = _speed_for_energy(stored - min(work, _LARGEST_WORK * stored), chi, e, v)
    return speed


def _energy_ratio(chi: float, u: float) -> float:
    """H(u), without the digits that z - ln(1 + z) loses at small z."""
    z = chi * u
    if abs(z) > 0.3:
        return (z - math.log1p(z)) / (chi * chi)
    term, total, k = z, 0.0, 2
    while k < 80 and abs(term) > 1e-18 * abs(total):
        term *= -z
        total -= term / k
        k += 1
    return total / (chi * chi)


def _speed_for_energy(stored: float, chi: float, e: float, v: float) -> float:
    """Newton from a bound of v_i² (H(1) - H(v/v_i)) = stored: from below it goes above, then down."""
    one = _energy_ratio(chi, 1.0)
    lowest = v if v >= 0.0 else max(-v / e, -v * chi * (1.0 + 1e-12))
    speed = max(math.sqrt(max(stored + 0.5 * v * v, 0.0) / one), lowest)
    for _ in range(_MAX_ITERATIONS if speed > _NO_SPEED else 0):
        u = v / speed
        left = one - _energy_ratio(chi, u)
        step = (speed * speed * left - stored) / (speed * (2.0 * left + u * u / (1.0 + chi * u)))
        before, speed = speed, max(speed - step, lowest)
        if abs(before - speed) <= 1e-15 * speed:
            break
    return speed


def _work_of_load(kappa: float, n: float, chi: float, e: float, x: float, v: float, speed: float) -> float:
    """∫ dx/(1 + χ u) from touch to the state, along the path of an impact at `speed` that nothing loads."""
    one = _energy_ratio(chi, 1.0)
    deepest = float(max(x, ((n + 1.0) * speed * speed * one / kappa) ** (1.0 / (n + 1.0))))
    now = math.sqrt(1.0 - x / deepest)
    if v >= 0.0:
        return deepest * _work_of_leg(n, chi, e, one, 1.0, now, 1.0)
    return deepest * (
        _work_of_leg(n, chi, e, one, 1.0, 0.0, 1.0) + _work_of_leg(n, chi, e, one, 0.0, now, -1.0)
    )


def _work_of_leg(n: float, chi: float, e: float, one: float, w0: float, w1: float, way: float) -> float:
    """The part of it in or out, way ±1, over w = sqrt(1 - x/x_m), in which it is smooth at the turn."""
    total = 0.0
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        w = w0 + (w1 - w0) * node
        share = 1.0 - (1.0 - w * w) ** (n + 1.0)  # H(u)/H(1)
        u = math.sqrt(share) if way > 0.0 else -e * math.sqrt(share)
        for _ in range(8):
            if u == 0.0:
                break
            change = (_energy_ratio(chi, u) - share * one) * (1.0 + chi * u) / u
            u = max(u - change, -e)
            if abs(change) <= 1e-9:
                break
        total -= weight * 2.0 * w * (w1 - w0) / max(1.0 + chi * u, 1e-12)
    return total
