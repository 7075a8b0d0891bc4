"""The bounce of eq. (16) as pure numbers: e over d = (3/2) α v_i, and back.

Separating variables in m v dv/dx = -k x^n (1 + a v), a = (3/2) α, gives d (1 + e) = ln(1 + d) -
ln(1 - d e): e = (1 + W0(-(1 + d) exp(-(1 + d)))) / d, W0 the principal Lambert W. Both lose digits
as d falls: W0 works next to its branch point. So e is evaluated as

    e = (1 + t S(t)) / (1 + d),    1 - e = d (1 - S(t) / (5 + d)) / (1 + d),    t = d / (5 + d),

two forms without cancellation, with S a Chebyshev series over 0 <= d <= 1, where most bounces are,
and another over 0 <= d <= 42. Beyond, e = 1/d to the last digit. The nearest singularities of S in
t are at the pole d = -5 and where d - ln(1 + d) = ±2πi; the shift 5 keeps both far and the series
short. tests/laws/test_closed_form.py makes the coefficients again: sample S at 64 Chebyshev points
in 60-digit arithmetic, discrete cosine transform, drop what is below 1e-17.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.terms.impact import Floats

SHIFT = 5.0
# (1 + d) exp(-(1 + d)) = 9e-18 here: from here on e and 1/d are the same double.
TOP = 42.0
# fmt: off
LOW = 1.0
LOW_SERIES = (
    1.3841315711724689, -0.2706494835811008, 0.01085920530818937, -0.0009310048810048926,
    8.73783794011912e-05, -7.212615049949131e-06, 7.313744781041737e-07, -7.12470957766144e-08,
    7.2578437436425365e-09, -7.600797554642898e-10, 8.023815127190313e-11, -8.656441218374736e-12,
    9.42654109096766e-13, -1.038692330904781e-13, 1.1553023699997146e-14, -1.2952607692684689e-15,
    1.4630706256883469e-16, -1.6631141218643358e-17,
)
SERIES = (
    0.6535149405641728, -0.8154677346208224, 0.19268799345376825, 0.0011744978101141568,
    -0.0004793371395136684, -0.006284272511286914, 0.0007835481276890518, 0.000694346667933714,
    0.0001977819100005642, -0.0001330281393995372, -6.357315811928071e-05, 1.4068187755798451e-06,
    1.5454566846392167e-05, 4.824768578357712e-06, -1.2476571280677665e-06, -1.5603750255925227e-06,
    -3.589548668532154e-07, 1.6267600094531608e-07, 1.42552785554808e-07, 2.947902538618883e-08,
    -1.34160671671405e-08, -1.113971866964732e-08, -2.6591627735155402e-09, 4.945295768573546e-10,
    5.609033284560939e-10, 1.9377581928751252e-10, 5.3685168498803067e-11, 2.1549540466636997e-11,
    1.8298787144887106e-12, -9.990387741780508e-12, -9.391314109091898e-12, -3.699015221554108e-12,
    1.6905613769915563e-13, 1.0695404340017788e-12, 6.371419216095591e-13, 1.630476370416197e-13,
    -2.6978572388629473e-14, -4.644880279889875e-14, -2.4459932243745152e-14, -8.44533649648168e-15,
    -1.7880183607585597e-15, 3.779216390265806e-16, 8.267089140504426e-16, 6.279862307284549e-16,
    2.97144037731886e-16, 7.313538560805752e-17, -1.4701724763611874e-17, -2.6422341859916037e-17,
    -1.6209775517342956e-17,
)
# fmt: on

# Numbers of a chunk: its few buffers stay in the processor's second-level cache.
_CHUNK = 8192
# d e / (1 - e) over e within 0.7 %: falls from 3/2 (no loss) to 1 (no
# bounce). Starts Newton's iteration.
_START = (0.99793785, 1.24335334, -0.36192314, -1.11520903, 0.73747348)


def _series(d: Floats, top: float) -> Floats:
    """S of e = (1 + t S)/(1 + d), t = d/(5 + d), at numbers 0 <= d <= top; shape (n,), as d.

    d = (3/2) α v_i is left as it is, and its range is not checked.
    top: LOW or TOP, the end of the range that a Chebyshev series is for. The sum is Clenshaw's
    recurrence.
    """
    series = LOW_SERIES if top == LOW else SERIES
    # Twice the argument of the Chebyshev polynomials: -2 at d = 0, 2 at d = top.
    x2 = d / (SHIFT + d)
    x2 *= 4.0 * (SHIFT + top) / top
    x2 -= 2.0
    b1 = np.zeros_like(d)
    b2 = np.zeros_like(d)
    # Three arrays take turns in Clenshaw's recurrence: the loop allocates no memory.
    work = np.empty_like(d)
    for coefficient in series[:0:-1]:
        np.multiply(x2, b1, out=work)
        work -= b2
        work += coefficient
        b1, b2, work = work, b1, b2
    b1 *= x2
    b1 *= 0.5
    b1 -= b2
    b1 += series[0]
    return b1


def _in_chunks(
    near: Callable[[Floats, float], Floats], far: Callable[[Floats], Floats], d: Floats
) -> Floats:
    """Evaluate a function of d = (3/2) α v_i >= 0 in pieces of _CHUNK numbers; same shape as d.

    near: (d, top) to values for d up to `top`, which is LOW or TOP: a series of its own for each.
    far: d to values beyond TOP. Each d gets the values of its own range.
    """
    flat = np.ascontiguousarray(d).reshape(-1)
    out = np.empty_like(flat)
    for start in range(0, flat.size, _CHUNK):
        part = flat[start : start + _CHUNK]
        most = part.max()
        if most <= LOW:
            out[start : start + _CHUNK] = near(part, LOW)
            continue
        values = near(np.minimum(part, TOP), TOP)
        if most > TOP:
            values = np.where(part > TOP, far(np.maximum(part, TOP)), values)
        low = part <= LOW
        values[low] = near(part[low], LOW)
        out[start : start + _CHUNK] = values
    return out.reshape(np.shape(d))


def _near_restitution(d: Floats, top: float) -> Floats:
    """e over 0 <= d <= top, same shape, by the series."""
    e = _series(d, top)
    e *= d
    e /= SHIFT + d
    e += 1.0
    e /= 1.0 + d
    return e


def _near_loss(d: Floats, top: float) -> Floats:
    """1 - e over 0 <= d <= top, same shape, by the same series, without its cancellation near 0."""
    share = _series(d, top)
    share /= SHIFT + d
    np.subtract(1.0, share, out=share)
    share *= d
    share /= 1.0 + d
    return share


def restitution_of(d: Floats) -> Floats:
    """e over d >= 0, same shape; relative error below 1e-15, e(0) = 1."""
    return _in_chunks(_near_restitution, lambda far: 1.0 / far, d)


def restitution_of_one(d: float) -> float:
    """e of one number d = (3/2) α v_i, 0 <= d <= TOP: without arrays a hundred times as fast.

    The range is not checked. e = (1 + t S)/(1 + d) with t = d/(5 + d), as in `_series`: S is the
    sum of Clenshaw's recurrence.
    """
    top = TOP
    series: tuple[float, ...] = SERIES
    if d <= LOW:
        top = LOW
        series = LOW_SERIES
    # Twice the argument of the Chebyshev polynomials: -2 at d = 0, 2 at d = top.
    x2 = 4.0 * (SHIFT + top) / top * d / (SHIFT + d) - 2.0
    b1 = b2 = 0.0
    for coefficient in series[:0:-1]:
        b1, b2 = x2 * b1 - b2 + coefficient, b1
    s = 0.5 * x2 * b1 - b2 + series[0]
    return (1.0 + d / (SHIFT + d) * s) / (1.0 + d)


def one_minus_restitution(d: Floats) -> Floats:
    """1 - e over d >= 0, same shape, to the same relative error however small d is."""
    return _in_chunks(_near_loss, lambda far: 1.0 - 1.0 / far, d)


def inverse_restitution(e: Floats) -> Floats:
    """d = (3/2) α v_i of restitutions 0 < e <= 1, same shape, by Newton's method.

    The error is taken of e below 0.5 and of 1 - e above, which has more digits there. The range is
    not checked: callers do. Where d is above TOP, e is 1/d, and d is 1/e.
    """
    shortfall = 1.0 - e
    start = np.polynomial.polynomial.polyval(e, _START)
    d: Floats = shortfall / e * start
    # The polynomial is wrong by 0.7 % at most: from there four steps reach the last digits.
    for _ in range(4):
        now = restitution_of(d)
        error = np.where(e >= 0.5, shortfall - one_minus_restitution(d), now - e)
        # With u = d e: du/dd = d (1 - u) / ((1 + d) u), and de/dd = (du/dd - e) / d. The difference
        # loses digits at small d, where de/dd = -2/3 + 8/9 d ... has them.
        u_rate = (1.0 - d * now) / ((1.0 + d) * now)
        slope = np.where(
            d < 1e-3, -2.0 / 3.0 + 8.0 / 9.0 * d, (u_rate - now) / np.maximum(d, 1e-300)
        )
        d = np.maximum(d - error / slope, 0.0)
    return np.where(e > 1.0 / TOP, d, 1.0 / e)
