"""The best that one number can do: a constant e for a band of speeds, and
the spring-damper that has it.
"""

import math
from dataclasses import replace

import numpy as np

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.kelvin_voigt import Ending, damping_ratio_for
from hcbench.laws.solvers import root
from hcbench.recipes.target import Target
from hcbench.system.errors import SettingError
from hcbench.terms.resolution import (
    STEPS_MOST,
    STEPS_OF_A_LOOP,
    STEPS_OF_A_SOFTENED,
    STEPS_OF_A_SPRING,
)

# ln e of a spring-damper that only pushes tends to -2 at critical damping.
LOWEST_UNDERDAMPED = math.exp(-2.0)


def minimax_constant(target: Target) -> tuple[float, float]:
    """The constant e with the least largest error over the band, and that error.

    e falls with v, so the error is largest at both ends of the band and the best constant is
    halfway.
    """
    ends = target.restitution(np.array([target.speed_min, target.speed_max]))
    high = float(ends.max())
    low = float(ends.min())
    return (high + low) / 2, (high - low) / 2


def contact_time(target: Target, steps: float = STEPS_OF_A_SPRING) -> float:
    """Contact time, s, of the spring-damper that replaces the law: the law's at the geometric mean
    speed.

    At least `steps` time steps, so that a coarse step still sees a contact; the spring is then
    softer than the law.
    """
    speed = math.sqrt(target.speed_min * target.speed_max)
    duration = float(closed_form.duration(target.law, target.mass, speed))
    return max(duration, steps * target.timestep)


def implicit_spring_damper(target: Target, duration: float, instead: str) -> tuple[float, float]:
    """k, N/m, and c, N s/m, of F = k (x + h v') + c v', v' the rate after a step, for the best
    constant e.

    duration: of the contact, s. instead: recipe to name in an error.
    Those whose steps have the poles exp((-β ± i ω) h) of `spring_damper`'s contact exactly: m exp(2
    β h) = m + h c + h² k, so c is smaller than a continuous damper's by k h. Where c would be below
    0 the contact is made slower until it is not.
    Raises SettingError for e = 1, since such a step always damps, and for an e that only an
    overdamped contact has.
    """
    e, _ = minimax_constant(target)
    h = target.timestep
    m = target.mass
    if e >= 1.0:
        raise SettingError("restitution", "1", "e below 1", "An implicit step always damps")
    beta, omega = spring_damper(e, duration, instead)
    # c >= 0 asks for exp(2 β h) - 1 >= h² k / m, nearly 2 β >= ω² h.
    slower = max(1.0, (omega**2 + beta**2) * h / (2 * beta) * (1 + 1e-9))
    while True:
        grow = math.exp(beta / slower * h)
        turn = omega / slower * h
        stiffness = (grow**2 + 1 - 2 * grow * math.cos(turn)) / h**2
        damping = (grow**2 - 1) / h - stiffness * h
        if damping >= 0:
            return m * stiffness, m * damping
        slower *= 1.02


def spring_damper(restitution: float, duration: float, instead: str) -> tuple[float, float]:
    """β and ω, 1/s, of the contact x'' + 2 β x' + (ω² + β²) x = 0 that has this e and duration (s).

    instead: recipe to name in an error.
    The contact pushes only, so it ends where the force is 0, before x is: with the damping ratio
    sin ψ at ω t = π - 2 ψ, with β = ω tan ψ.
    Raises SettingError for an e outside exp(-2) < e <= 1, which only an overdamped contact has, or
    none.
    """
    if not LOWEST_UNDERDAMPED < restitution <= 1.0:
        raise SettingError(
            "restitution",
            f"{restitution:.4g}",
            f"e within {LOWEST_UNDERDAMPED:.4f} ... 1 for a spring and damper",
            f"Use `{instead}`, which has any e",
        )
    psi = math.asin(damping_ratio_for(restitution, Ending.FORCE))
    omega = (math.pi - 2 * psi) / duration
    return omega * math.tan(psi), omega


def one_way_spring_damper(target: Target, duration: float, instead: str) -> tuple[float, float]:
    """k, N/m, and c, N s/m, of F = k x + c x' on the way in and k x on the way out, for the best e.

    duration: of the contact, s. instead: recipe to name in an error.
    e = exp(-ζ/√(1-ζ²) acos ζ), ζ = c/(2 √(k m)), and it lasts (acos ζ/√(1-ζ²) + π/2)/ω, ω² = k/m:
    the way in is a damped oscillator's from touch to its first standstill.
    Raises SettingError for an e of exp(-0.99) = 0.372 or less, and for one above 1.
    """
    e, _ = minimax_constant(target)

    def way_in(zeta: float) -> float:
        return math.acos(zeta) / math.sqrt(1.0 - zeta**2)

    if not math.exp(-0.99) < e <= 1.0:
        raise SettingError("restitution", f"{e:.4g}", "e within 0.372 ... 1", f"Use `{instead}`")
    zeta = root(lambda z: z * way_in(z) + math.log(e), 0.0, 1.0 - 1e-9, 1e-15)
    omega = (way_in(zeta) + math.pi / 2) / duration
    k = target.mass * omega**2
    return k, 2.0 * zeta * math.sqrt(k * target.mass)


def require_end(target: Target) -> None:
    """Raise SettingError for a step so short that an evaluation would not end: STEPS_MOST in a
    contact.
    """
    steps = steps_per_contact(target)
    if steps > STEPS_MOST:
        got = f"{target.timestep:g} s, of which {steps:.2g} are the law's shortest contact"
        nearest = target.timestep * steps / STEPS_MOST
        raise SettingError(
            "timestep", got, f"up to {STEPS_MOST:g} steps", f"Use {nearest:.2g} s or more"
        )


def steps_per_contact(target: Target) -> float:
    """Time steps in the law's own contact at the highest speed of the band."""
    return float(closed_form.duration(target.law, target.mass, target.speed_max)) / target.timestep


def resolvable_law(target: Target, softened_steps: float = STEPS_OF_A_SOFTENED) -> HuntCrossley:
    """Law of the target, softened if its shortest contact lasts less than STEPS_OF_A_LOOP steps.

    A softened contact lasts `softened_steps` time steps at the speed at which it is shortest.
    """
    ends = np.array([target.speed_min, target.speed_max])
    steps = float(closed_form.duration(target.law, target.mass, ends).min()) / target.timestep
    if steps >= STEPS_OF_A_LOOP:
        return target.law
    softer = (steps / softened_steps) ** (target.law.exponent + 1.0)
    return replace(target.law, stiffness=target.law.stiffness * softer)
