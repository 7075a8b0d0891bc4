"""A contact of one row in continuous time: how fast the bodies part.

By the pair of orders 5 and 4 of Dormand and Prince, J. Comp. Appl. Math. 6 (1980), table 2, on
plain floats: importing SciPy's integrators takes ten times as long as all that a measurement asks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Push = Callable[[float, float], float]

_STAGES = (
    (1 / 5,),
    (3 / 40, 9 / 40),
    (44 / 45, -56 / 15, 32 / 9),
    (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
    (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
    (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
)
# Difference of the weights of order 5 and order 4: what a step's error is estimated by.
_ERROR = (71 / 57600, 0.0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40)
# Tolerances of a step: relative, and absolute in speeds at touch.
_RELATIVE = 1e-9
_ABSOLUTE = 1e-13
# Halvings of the step in which the bodies part: to the last bit. And a
# bound of the steps of one contact.
_BISECTIONS = 60
_MOST_STEPS = 100_000


def parting_speed(push: Push, speed: float, first_step: float, longest: float) -> float:
    """Speed at which the push has gone, m/s; 0 for a contact that has not ended by then.

    push: acceleration apart at (penetration, m; its rate, m/s), m/s^2.
    speed: of approach at touch, m/s.
    first_step: s, short beside all that happens.
    longest: how long it is followed, s.
    """
    time = 0.0
    x = 0.0
    v = speed
    step = first_step
    for _ in range(_MOST_STEPS):
        if time >= longest or time + step == time:
            break
        new_x, new_v, error_x, error_v = _step(push, x, v, step)
        error = max(
            error_x / (_RELATIVE * max(abs(x), abs(new_x)) + _ABSOLUTE * speed * step),
            error_v / (_RELATIVE * max(abs(v), abs(new_v)) + _ABSOLUTE * speed),
        )
        if error <= 1.0:
            if new_v < 0.0 and push(new_x, new_v) <= 0.0:
                return -_at_parting(push, x, v, step)
            time = time + step
            x = new_x
            v = new_v
        step *= min(5.0, max(0.2, 0.9 * max(error, 1e-12) ** -0.2))
    return 0.0


def _step(push: Push, x: float, v: float, step: float) -> tuple[float, float, float, float]:
    """(x m, v m/s) one step (s) on, and the sizes of their errors in the same units.

    push: acceleration of the contact, m/s², at (x, v); below 0 it counts as none.
    """
    # Rates of x and of v at each stage; the contact only pushes.
    speeds = [v]
    accelerations = [-max(0.0, push(x, v))]
    at_x = x
    at_v = v
    for weights in _STAGES:
        at_x = x + step * _weighted(weights, speeds)
        at_v = v + step * _weighted(weights, accelerations)
        speeds.append(at_v)
        accelerations.append(-max(0.0, push(at_x, at_v)))
    error_x = abs(step * _weighted(_ERROR, speeds))
    error_v = abs(step * _weighted(_ERROR, accelerations))
    return at_x, at_v, error_x, error_v


def _weighted(weights: Sequence[float], rates: Sequence[float]) -> float:
    """Sum of the rates at as many stages as there are weights, each times its weight."""
    return sum(weight * rate for weight, rate in zip(weights, rates, strict=True))


def _at_parting(push: Push, x: float, v: float, step: float) -> float:
    """v where the push goes within a step."""
    low = 0.0
    high = step
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        at_x, at_v, *_ = _step(push, x, v, middle)
        low, high = (low, middle) if at_v < 0.0 and push(at_x, at_v) <= 0.0 else (middle, high)
    return _step(push, x, v, high)[1]
