"""Closed forms of eq. (4), m x'' + c x' + k x = 0: the contact that
Hunt and Crossley argue against.

Contact is taken to end in one of two places: at x = 0, where the body is back at the undeformed
surface (the law has pulled it for a while by then), or at F = 0, where nothing presses any more
(the surface lags behind the body). With ζ = c / (2 √(k m)), ω = √(k/m):

    x = 0:  e = exp(-π ζ / √(1 - ζ²)),  t = π / (ω √(1 - ζ²));  no parting at all from ζ = 1 on
    F = 0:  e = exp(-2 ζ g(ζ)),         t = 2 g(ζ) / ω,         g(ζ) = arccos ζ / √(1 - ζ²)

T. Schwager, T. Pöschel, "Coefficient of restitution and linear-dashpot model revisited",
Granular Matter 9, 2007, 465-469, doi 10.1007/s10035-007-0065-z, for the second; the rest is the
damped sine of any textbook. Neither e depends on the impact speed: so ΔE ∝ v_i², and that is
the paper's objection (section 1.7).
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from hcbench.laws.force import KelvinVoigt
from hcbench.laws.solvers import root
from hcbench.terms.bounds import positive, within
from hcbench.terms.impact import Floats, Loop


class Ending(StrEnum):
    """Condition that ends the contact."""

    # The contact ends when the surfaces part: x = 0.
    SURFACE = "surface"
    # The contact ends when the force ends, so that it never pulls: F = 0.
    FORCE = "force"


def damping_ratio(law: KelvinVoigt, mass: float) -> float:
    """ζ = c / (2 √(k m)); mass in kg."""
    positive("mass", mass, "kg")
    return float(law.damping / (2.0 * np.sqrt(law.stiffness * mass)))


def restitution(zeta: Floats | float, ending: Ending) -> Floats:
    """e at any impact speed for damping ratios ζ; 0 where the body never parts.

    zeta: ζ, 0 or more; e has its shape.
    ending: condition that ends the contact.
    Raises UserError for a ζ below 0 or NaN.
    """
    z = within("zeta", zeta, 0.0, np.inf, "a damping ratio of 0 or more")
    if ending is Ending.FORCE:
        return np.asarray(np.exp(-2.0 * z * _g(z)))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(z < 1.0, np.exp(-np.pi * z / np.sqrt((1.0 - z) * (1.0 + z))), 0.0)


def damping_ratio_for(e: float, ending: Ending) -> float:
    """Damping ratio ζ that gives the restitution e, 0 < e <= 1: the inverse of `restitution`.

    ending: condition that ends the contact: x = 0 (SURFACE), or F = 0 (FORCE), for which ζ has no
    closed form and is searched for.
    Raises UserError for another e: no damping, however large, gives e = 0.
    """
    within(
        "restitution",
        e,
        np.nextafter(0.0, 1.0),
        1.0,
        "0 < e <= 1; no damping, however large, gives e = 0",
    )
    loss = -float(np.log(e))
    if ending is Ending.SURFACE:
        return float(loss / np.hypot(np.pi, loss))
    if e == 1.0:
        return 0.0
    # 2 ζ g(ζ) grows without bound but only as a logarithm: double until it is bracketed.
    top = 1.0
    while 2.0 * top * float(_g(np.asarray(top))) < loss:
        top *= 2.0
    return root(lambda z: 2.0 * z * float(_g(np.asarray(z))) - loss, 0.0, top, 1e-300, 1e-15)


def matched(e: float, duration: float, mass: float, ending: Ending) -> KelvinVoigt:
    """The spring and damper that give restitution e and contact time `duration` (s) to `mass` (kg).

    ending: whether the contact ends at x = 0 (SURFACE) or at F = 0 (FORCE).
    Raises UserError for an e outside 0 < e <= 1 and for a duration or mass that is not above 0.
    """
    positive("duration", duration, "s")
    positive("mass", mass, "kg")
    zeta = damping_ratio_for(e, ending)
    # ω t at the end of the contact, over t.
    omega = _end(zeta, ending) / duration
    return KelvinVoigt(stiffness=mass * omega**2, damping=2.0 * zeta * mass * omega)


@dataclass(frozen=True, slots=True)
class KelvinVoigtImpact:
    """One impact by eq. (4), SI.

    force_at_touch: c v_i, the shock at first touch.
    force_max: the largest push, the shock included.
    tension_max: largest pull before x = 0 (0 if contact ends at F = 0).
    penetration_left: x where it ends.
    """

    restitution: float
    duration: float
    penetration_max: float
    penetration_left: float
    force_max: float
    force_at_touch: float
    tension_max: float
    energy_loss: float


def bounce(law: KelvinVoigt, mass: float, speed: float, ending: Ending) -> KelvinVoigtImpact:
    """All of one impact in closed form; mass kg, speed v_i m/s.

    With ζ = sin β and θ = ω √(1-ζ²) t: F = m ω v_i e^(-θ tan β) sin(θ + 2β) / cos β. It is largest
    at θ = π/2 - 3β (at touch once ζ >= 1/2) and smallest at θ = 3π/2 - 3β, where it is -m ω v_i
    e^(-3 ζ g(ζ)), or at x = 0, whichever comes first.
    Raises UserError for a mass or speed that is not above 0. A contact that never ends has e = 0
    and an infinite duration.
    """
    positive("speed", speed, "m/s")
    zeta = damping_ratio(law, mass)
    omega = np.sqrt(law.stiffness / mass)
    # Largest spring force of an undamped bounce, m ω v_i, and force of the damper at touch, c v_i, N.
    elastic = mass * omega * speed
    shock = law.damping * speed
    e = float(restitution(zeta, ending))
    # ω t at the end of the contact.
    swing = _end(zeta, ending)
    beta = float(np.arcsin(min(zeta, 1.0)))
    push = shock
    if zeta < 0.5:
        push = elastic * float(np.exp(-np.tan(beta) * (np.pi / 2 - 3 * beta)))
    left = 0.0
    if ending is Ending.FORCE:
        at_the_end, _ = state(law, mass, speed, swing / omega)
        left = float(at_the_end)
        pull = 0.0
    elif zeta < 0.5:
        # Still rising in size at x = 0, where the damper alone pulls.
        pull = shock * e
    else:
        pull = elastic * float(np.exp(-3.0 * zeta * _g(np.asarray(zeta))))
    return KelvinVoigtImpact(
        restitution=e,
        duration=float(swing / omega),
        penetration_max=float(speed / omega * np.exp(-zeta * _g(np.asarray(zeta)))),
        penetration_left=left,
        force_max=push,
        force_at_touch=shock,
        tension_max=pull,
        energy_loss=0.5 * mass * speed**2 * (1.0 - e * e),
    )


def state(
    law: KelvinVoigt, mass: float, speed: float, time: Floats | float
) -> tuple[Floats, Floats]:
    """x (m) and v (m/s) at times since touch (s), as if the two never parted; shape of `time` each.

    law: a spring and damper, F = k x + c v.
    mass: kg.
    speed: v_i, m/s. v > 0 on approach.
    Raises UserError for a mass that is not above 0.
    """
    zeta = damping_ratio(law, mass)
    omega = np.sqrt(law.stiffness / mass)
    tau = omega * np.asarray(time, dtype=float)
    cosine, sine = _swing(zeta, tau)
    decay = np.exp(-zeta * tau)
    return np.asarray(speed / omega * decay * sine), np.asarray(
        speed * decay * (cosine - zeta * sine)
    )


def loop(law: KelvinVoigt, mass: float, speed: float, ending: Ending, count: int = 401) -> Loop:
    """Loop of one contact: `count` points even in time of x, m, v, m/s, and F, N; Fig. 1(a).

    mass: kg.
    speed: impact speed, m/s.
    ending: whether the contact ends at x = 0 (SURFACE) or at F = 0 (FORCE).
    Raises UserError for a mass or speed that is not above 0, and for a contact that never ends: x =
    0 needs a damping ratio below 1.
    """
    end = bounce(law, mass, speed, ending).duration
    within(
        "duration",
        end,
        0.0,
        np.finfo(float).max,
        "a contact that ends: a damping ratio below 1 for x = 0",
    )
    time = np.linspace(0.0, end, count)
    x, v = state(law, mass, speed, time)
    return Loop(time, x, v, law.force(x, v))


def _g(zeta: Floats) -> Floats:
    """arccos ζ / √(1 - ζ²), and arccosh ζ / √(ζ² - 1) beyond 1: one analytic function, 1 at ζ = 1.

    zeta: ζ, 0 or more; the result has its shape. ω t at the deepest point is g(ζ).
    """
    z = np.asarray(zeta, dtype=float)
    s2 = (1.0 - z) * (1.0 + z)
    s = np.sqrt(np.abs(s2))
    with np.errstate(divide="ignore", invalid="ignore"):
        under = np.arctan2(s, z) / s
        # arcsinh(√(ζ²-1)) = arccosh ζ, without the cancellation that arccosh has near 1.
        over = np.arcsinh(s) / s
        # Near ζ = 1 both are 0/0: arctan(y)/y with y = s/ζ to the fifth order in s².
        y2 = s2 / (z * z)
        near = (1.0 - y2 / 3.0 + y2**2 / 5.0 - y2**3 / 7.0 + y2**4 / 9.0) / z
    return np.where(np.abs(s2) < 1e-3, near, np.where(s2 > 0.0, under, over))


def _swing(zeta: float, tau: Floats) -> tuple[Floats, Floats]:
    """cos(s τ) and sin(s τ)/s with s² = 1 - ζ², continued to ζ >= 1."""
    s = np.sqrt(complex((1.0 - zeta) * (1.0 + zeta)))
    if s == 0:
        return np.ones_like(tau), tau
    return np.cos(s * tau).real, (np.sin(s * tau) / s).real


def _end(zeta: float, ending: Ending) -> float:
    """ω t at which contact ends; inf if it does not."""
    if ending is Ending.FORCE:
        return 2.0 * float(_g(np.asarray(zeta)))
    return float(np.pi / np.sqrt(1.0 - zeta * zeta)) if zeta < 1.0 else np.inf
