"""A root in a bracket and a minimum between bounds, of a function of one number; the numbers
nearest to others that rise.

Importing scipy.optimize takes longer than all else that a command for a root does, and as long as
all else that measuring a model does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

_MOST_STEPS = 1000


def root(
    function: Callable[[float], float],
    low: float,
    high: float,
    absolute: float,
    relative: float = 2.0**-50,
) -> float:
    """x where `function` is 0, to within `absolute` + `relative` |x|; between `low` and `high`, at
    which it has to have unlike signs.

    R. P. Brent, "Algorithms for Minimization without Derivatives", 1973, chapter 4: a secant or an
    inverse parabola where it falls well within the bracket, else its middle. The same bits as
    SciPy's brentq.
    Unlike signs are not checked: with like signs x is one of the ends. After _MOST_STEPS the last
    guess is returned.
    Raises what `function` raises.
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

    f_a, f_b, f_c: values of the function there. With a == c it is the secant.
    Returns inf where the product of the slopes underflows.
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


# A parabola through three values has its minimum to about the root of the round-off.
_ROUND_OFF_ROOT = math.sqrt(2.2e-16)
# Share of an interval at which golden section cuts it.
_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
_MOST_VALUES = 500


def minimum(
    function: Callable[[float], float], low: float, high: float, absolute: float = 1e-5
) -> tuple[float, float]:
    """(x, value) where `function` is least between `low` and `high`, x to within about `absolute`.

    R. P. Brent, "Algorithms for Minimization without Derivatives", 1973, chapter 5, as G. E.
    Forsythe, M. A. Malcolm and C. B. Moler have it ("Computer Methods for Mathematical
    Computations", 1977, FMIN): the minimum of a parabola through the three best points where it
    falls well within the interval, else golden section. The same bits as SciPy's bounded
    `minimize_scalar`.
    Of several minima it finds one; at an end, x stays a little inside. After _MOST_VALUES the best
    point is returned.
    Raises what `function` raises.
    """
    # The best three points until now, x first, and their values.
    x = second = third = low + _GOLDEN * (high - low)
    f = f_second = f_third = function(x)
    step = 0.0
    # The step before the last.
    earlier = 0.0
    for _ in range(_MOST_VALUES - 1):
        middle = 0.5 * (low + high)
        near = _ROUND_OFF_ROOT * abs(x) + absolute / 3.0
        if abs(x - middle) <= 2.0 * near - 0.5 * (high - low):
            break
        parabolic = None
        if abs(earlier) > near:
            to_ends = (low - x, high - x)
            parabolic = _to_vertex(
                x - second, x - third, f - f_second, f - f_third, earlier, to_ends
            )
            earlier = step
        if parabolic is None:
            # Golden section of the longer side.
            earlier = high - x
            if x >= middle:
                earlier = low - x
            step = _GOLDEN * earlier
        else:
            step = parabolic
            # No value is taken next to an end, which has been looked at.
            if x + step - low < 2.0 * near or high - (x + step) < 2.0 * near:
                step = math.copysign(near, middle - x)
        tried = x + math.copysign(max(abs(step), near), step)
        f_tried = function(tried)
        if f_tried <= f:
            # The old best point becomes the nearer end.
            if tried >= x:
                low = x
            else:
                high = x
            third, f_third = second, f_second
            second, f_second = x, f
            x, f = tried, f_tried
            continue
        # x stays the best; the point that was tried becomes an end.
        low, high = (tried, high) if tried < x else (low, tried)
        if f_tried <= f_second or second == x:
            third, f_third = second, f_second
            second, f_second = tried, f_tried
        elif f_tried <= f_third or third in (x, second):
            third, f_third = tried, f_tried
    return x, f


def _to_vertex(
    from_second: float,
    from_third: float,
    above_second: float,
    above_third: float,
    earlier: float,
    to_ends: tuple[float, float],
) -> float | None:
    """Step from the best point to the minimum of the parabola through the three best; None where it
    leaves the interval, or is not shorter than half the step before the last.

    from_second, from_third: of the best point, less the second best and the third best.
    above_second, above_third: value of the best point, less theirs.
    earlier: the step before the last.
    to_ends: steps to the interval's ends.
    """
    # Brent's p and q: the step is p/q, which is not computed unless it is taken, since q may be 0.
    r = from_second * above_third
    q = from_third * above_second
    p = from_third * q - from_second * r
    q = 2.0 * (q - r)
    if q > 0.0:
        p = -p
    q = abs(q)
    to_low, to_high = to_ends
    if abs(p) < abs(0.5 * q * earlier) and q * to_low < p < q * to_high:
        # -0.0 + 0.0 is 0.0, whose step goes up, as SciPy's.
        return (p + 0.0) / q
    return None


def rising(values: Iterable[float]) -> list[float]:
    """The numbers nearest to these by least squares that do not fall (isotonic regression); as
    many, in their order.

    Neighbours that fall are replaced by their mean until none do: pool adjacent violators, M. Ayer
    and others 1955. SciPy's takes longer to import.
    """
    # Each pool has neighbouring values, whose mean stands for all of them.
    pools: list[list[float]] = []
    means: list[float] = []
    for value in values:
        pool = [float(value)]
        while means and means[-1] > _mean(pool):
            means.pop()
            pool = pools.pop() + pool
        pools.append(pool)
        means.append(_mean(pool))
    nearest = []
    for pool, mean in zip(pools, means, strict=True):
        nearest += [mean] * len(pool)
    return nearest


def _mean(values: list[float]) -> float:
    return math.fsum(values) / len(values)
