"""A root in a bracket: importing scipy.optimize takes longer than all
else that a command for one does.
"""

import math
from collections.abc import Callable

_MOST_STEPS = 1000


def root(
    function: Callable[[float], float],
    low: float,
    high: float,
    absolute: float,
    relative: float = 2.0**-50,
) -> float:
    """x between `low` and `high`, where `function` has unlike signs, within `absolute` + `relative`
    |x|.

    R. P. Brent, "Algorithms for Minimization without Derivatives", 1973, chapter 4: a secant or an
    inverse parabola where it falls well within the bracket, else its middle. The same bits as
    SciPy's brentq.
    Unlike signs are not checked: with like signs x is one of the ends. After _MOST_STEPS the last
    guess is returned. Raises what `function` raises.
    """
    before = low
    f_before = function(before)
    x = high
    f = function(x)
    if f_before == 0.0:
        return before
    # The root lies between x and `other`.
    other = low
    f_other = 0.0
    step = 0.0
    # The step before the last.
    earlier = 0.0
    for _ in range(_MOST_STEPS):
        if f != 0.0 and (f_before < 0.0) != (f < 0.0):
            other = before
            f_other = f_before
            step = x - before
            earlier = step
        # x is to be the better end of the bracket.
        if abs(f_other) < abs(f):
            before, f_before = x, f
            x, f = other, f_other
            other, f_other = before, f_before
        near = (absolute + relative * abs(x)) / 2
        half = (other - x) / 2
        if f == 0.0 or abs(half) < near:
            break
        guess = math.inf
        if abs(earlier) > near and abs(f) < abs(f_before):
            guess = _guess(before, x, other, f_before, f, f_other)
        # Well within the bracket, and less than half the step before the last: so it converges.
        if 2 * abs(guess) < min(abs(earlier), 3 * abs(half) - near):
            earlier = step
            step = guess
        else:
            earlier = half
            step = half
        before = x
        f_before = f
        if abs(step) > near:
            x += step
        elif half > 0.0:
            x += near
        else:
            x -= near
        f = function(x)
    return x


def _guess(a: float, b: float, c: float, f_a: float, f_b: float, f_c: float) -> float:
    """Step from b to the root of the secant through a and b, or of the inverse parabola through all
    three.

    f_a, f_b, f_c: values of the function there. With a == c it is the secant. Returns inf where the
    product of the slopes underflows.
    """
    if a == c:
        return -f_b * (b - a) / (f_b - f_a)
    slope_a = (f_a - f_b) / (a - b)
    slope_c = (f_c - f_b) / (c - b)
    bent = slope_c * slope_a * (f_c - f_a)
    # The product of the slopes underflows to 0.
    if not bent:
        return math.inf
    return -f_b * (f_c * slope_c - f_a * slope_a) / bent
