"""One impact of any force law as an ODE, m x'' = -F(x, x') + m g, with touch and parting located.

For laws and loads that have no closed form, above all under gravity. It is solved without units, so
that tolerances mean the same for steel and for rubber: rates over v_i, penetrations over the X at
which the elastic force F(X, 0) times X is m v_i², times over X/v_i. Integrator: DOP853, order 8 (E.
Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary Differential Equations I", Springer 1993,
section II.5), with its interpolant of order 7 for everything that lies between steps.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from hcbench.laws.kelvin_voigt import Ending
from hcbench.laws.published import TouchSpeedLaw
from hcbench.system.errors import EngineFailed, UserError
from hcbench.terms.bounds import positive, require
from hcbench.terms.impact import Floats, Impact, Launch, Loop, Status

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.laws.force import ForceLaw

    Force = Callable[[Floats | float, Floats | float], Floats]

__all__ = ["Ending", "impact"]

# A contact that lasts longer counts as never ending, in units of X/v_i; a lossless one lasts about
# 3.
LONGEST = 1e4


def impact(
    law: ForceLaw | TouchSpeedLaw,
    mass: float,
    speed: float,
    *,
    gravity: float = 0.0,
    ending: Ending = Ending.SURFACE,
    count: int = 401,
    tolerance: float = 1e-13,
    step_max: float = math.inf,
) -> Impact:
    """One impact of a body with a fixed plate, from touch to parting, with its loop of force.

    law: the force, N, over penetration and rate.
    mass: effective, kg.
    speed: v_i at touch, m/s.
    gravity: m/s² towards the plate, acting through the contact too.
    ending: parting where x = 0, or already where F = 0 (matters to laws that pull).
    count: points of the loop, even in time.
    tolerance: relative error of a step; the absolute one is a tenth of it, in units of v_i and X.
    step_max: largest step in units of X/v_i; the fixed step where the tolerance is inf.
    A body that turns back towards the plate before it has parted lacks the energy for it: RESTED.
    So is one that stays in contact for LONGEST.
    Raises UserError for mass or speed that are not above 0, gravity below 0, fewer than 3 points,
    and for a law that does not push back at rest; EngineFailed where the integrator gives up.
    """
    positive("mass", mass, "kg")
    positive("speed", speed, "m/s")
    require("gravity", gravity, 0 <= gravity < math.inf, "0 m/s^2 or more, towards the plate")
    require("count", count, count >= 3, "3 points or more")
    force_law: ForceLaw
    if isinstance(law, TouchSpeedLaw):
        force_law = law.at(speed)
    else:
        force_law = law
    depth = _depth_scale(force_law, mass, speed)
    force = _force_over_units(force_law, depth, speed)
    inertia = depth / (mass * speed**2)
    weight = gravity * depth / speed**2
    path = _solve(force, inertia, weight, ending, tolerance, step_max)
    # Times of each event, without unit, (k,); k is 0 for one that never came.
    at_surface, at_no_force, at_turn, _ = path.t_events
    end = float(path.t[-1])
    tau = np.linspace(0.0, end, count)
    # Penetration over its scale, and rate over the impact speed.
    xi, eta = path.sol(tau)
    # The interpolant misses its ends in the last digits; they are known.
    xi[0] = 0.0
    eta[0] = 1.0
    if at_surface.size:
        xi[-1] = 0.0
    # Penetration where it turned, over its scale.
    deepest = float(xi.max())
    if at_turn.size:
        deepest = float(path.sol(at_turn[0])[0])
    # Unless a parting was found, the body turned back in contact, or stayed for LONGEST.
    status = Status.RESTED
    reason = "lost too much energy in contact to part"
    speed_out = 0.0
    if at_surface.size or at_no_force.size:
        status = Status.PARTED
        reason = ""
        speed_out = float(-eta[-1] * speed)
    loop = Loop(tau * depth / speed, xi * depth, eta * speed, force(xi, eta))
    return Impact(
        launch=Launch(speed),
        status=status,
        reason=reason,
        speed_in=speed,
        speed_out=speed_out,
        duration=end * depth / speed,
        penetration_max=deepest * depth,
        force_max=_largest(lambda t: float(force(*path.sol(t))), tau, loop.force),
        samples=count,
        loop=loop,
    )


def _depth_scale(law: ForceLaw, mass: float, speed: float) -> float:
    """Depth scale X of an impact, m, with F(X, 0) X = m v_i².

    law: F in N over m.
    mass: m, kg.
    speed: v_i, m/s.
    Raises UserError for a law that stores this energy nowhere between 1e-15 and 1e3 m.
    """
    energy = mass * speed**2

    def excess(log_x: float) -> float:
        work = float(law.force(math.exp(log_x), 0.0)) * math.exp(log_x)
        return math.log(work / energy) if work > 0 else -math.inf

    low = math.log(1e-15)
    high = math.log(1e3)
    if not excess(low) < 0 < excess(high):
        raise UserError(
            "law",
            f"{law!r} stores {energy:.3g} J nowhere between 1e-15 and 1e3 m",
            "a law that pushes back at rest, F(x, 0) > 0",
        )
    return math.exp(float(brentq(excess, low, high, rtol=1e-12)))


def _force_over_units(law: ForceLaw, depth: float, speed: float) -> Force:
    """The force law, N, as a function of penetration over `depth` (X, m) and of its rate over
    `speed` (v_i, m/s).
    """

    def force(xi: Floats | float, eta: Floats | float) -> Floats:
        """F, N, over penetration and rate in units of the depth scale and of the impact speed."""
        x = np.asarray(xi) * depth
        v = np.asarray(eta) * speed
        inside = law.force(np.abs(x), v)
        if not (x < 0.0).any():
            return inside
        # A trial step may look past parting, where no law is defined: mirrored
        # about F(0, v) it stays smooth.
        return np.where(x < 0.0, 2.0 * law.force(np.zeros_like(x), v) - inside, inside)

    return force


def _solve(
    force: Force, inertia: float, weight: float, ending: Ending, tolerance: float, step_max: float
) -> Any:
    """Solve dξ/dτ = η, dη/dτ = -F inertia + weight from (0, 1), in units of depth and impact speed.

    force: F in N over ξ and η.
    inertia: X/(m v_i²), 1/N.
    weight: g X/v_i², without unit.
    ending: parting where x = 0, or already where F = 0.
    tolerance: relative error of a step.
    step_max: largest step in τ.
    Returns SciPy's solution: states (ξ, η) over τ, also between steps, up to the parting or
    LONGEST; its events are, in this order: x = 0, F = 0, turning, turning back.
    Raises EngineFailed where SciPy gives up.
    """

    def rates(_: float, state: Floats) -> list[float]:
        return [float(state[1]), float(weight - force(state[0], state[1]) * inertia)]

    def surface(_: float, state: Floats) -> float:
        return float(state[0])

    def pushing(_: float, state: Floats) -> float:
        if ending is Ending.FORCE:
            return float(force(state[0], state[1]) * inertia)
        # Above 0: this event never comes.
        return 1.0

    def turning(_: float, state: Floats) -> float:
        return float(state[1])

    def turning_back(_: float, state: Floats) -> float:
        return float(state[1])

    events = [
        _event(surface),
        _event(pushing),
        # The turning point tells the largest penetration.
        _event(turning, ends_contact=False),
        _event(turning_back, is_rising=True),
    ]
    first_step = step_max
    if math.isfinite(tolerance):
        first_step = min(step_max, 1e-3)
    path = solve_ivp(
        rates,
        (0.0, LONGEST),
        [0.0, 1.0],
        method="DOP853",
        events=events,
        dense_output=True,
        rtol=tolerance,
        atol=tolerance / 10.0,
        max_step=step_max,
        first_step=first_step,
    )
    if path.status < 0:
        raise EngineFailed("simulation", path.message, "a law that is finite and smooth for x > 0")
    return path


def _event(
    function: Callable[[float, Floats], float],
    *,
    ends_contact: bool = True,
    is_rising: bool = False,
) -> Any:
    """Make a function an event of SciPy's `solve_ivp`: where its value falls through 0.

    function: of τ and the state (ξ, η).
    ends_contact: whether the integration ends there.
    is_rising: the event is where the value rises through 0, instead.
    """
    event: Any = function
    event.terminal = ends_contact
    event.direction = 1 if is_rising else -1
    return event


def _largest(force: Callable[[float], float], tau: Floats, sampled: Floats) -> float:
    """Largest force, N: that of the samples, improved between the neighbours of its sample.

    force: N, over the time τ without unit.
    tau, sampled: times and forces of the samples, shape (n,).
    """
    top = int(sampled.argmax())
    low = tau[max(top - 1, 0)]
    high = tau[min(top + 1, len(tau) - 1)]
    best = minimize_scalar(
        lambda t: -force(t), bounds=(low, high), method="bounded", options={"xatol": 1e-9}
    )
    return max(float(sampled[top]), -float(best.fun))
