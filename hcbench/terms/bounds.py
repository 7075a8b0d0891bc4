"""Bounds of physical numbers, and numbers that a formula has no meaning for: each is refused in one line
that names the slot.

One table of bounds serves options, studies, data, states and models. A number beyond its bounds is
nearly always a wrong unit. `--beyond-bounds` admits it; in Python, `with hcbench.beyond_bounds():`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

from hcbench.system.errors import QuantityError, UserError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


# Bounds of a quantity other than 0: squares of others leave the range of a float.
SMALLEST = 1e-30
LARGEST = 1e30
# Quantity -> (smallest, largest) size in SI units. 0 and negative
# numbers are the caller's to admit.
BOUNDS: dict[str, tuple[float, float]] = {
    "alpha": (0.0, 1e4),
    "speed": (1e-6, 1e4),
    "timestep": (1e-9, 1.0),
    "time": (0.0, 1e6),
    "mass": (1e-12, 1e9),
    "length": (1e-9, 1e4),
    "position": (0.0, 1e4),
    "pressure": (1.0, 1e14),
    "acceleration": (0.0, 1e3),
    "force": (0.0, 1e12),
    "stiffness": (1e-9, 1e30),
    "spin": (0.0, 1e6),
    "frequency": (1e-9, 1e9),
    "restitution": (0.0, 1.0),
    "exponent": (1.0, 5.0),
    "friction": (0.0, 10.0),
    "corners": (1.0, 100.0),
}
_beyond: ContextVar[bool] = ContextVar("hcbench beyond bounds", default=False)


@contextmanager
def beyond_bounds(admitted: bool = True) -> Iterator[None]:
    """Admit, or refuse, numbers beyond BOUNDS within a block."""
    token = _beyond.set(admitted)
    try:
        yield
    finally:
        _beyond.reset(token)


def admit_beyond_bounds() -> None:
    """Admit numbers beyond BOUNDS, until the block of a surrounding `beyond_bounds` ends."""
    _beyond.set(True)


def admits_beyond_bounds() -> bool:
    """Say whether numbers beyond BOUNDS are admitted."""
    return _beyond.get()


def require_bounds(
    slot: str, values: Iterable[float], quantity: str, unit: str = "", smallest: float | None = None
) -> None:
    """Raise QuantityError for the first value that is not finite or whose size is beyond its
    bounds; 0 is within them.

    slot: what to call the value in the error.
    values: SI.
    quantity: a name in BOUNDS; any other has SMALLEST and LARGEST, as all have within
    `beyond_bounds`.
    unit: SI, for the error.
    smallest: in place of the table's, also within `beyond_bounds`.
    """
    low = 0.0
    high = math.inf
    if not _beyond.get():
        low, high = BOUNDS.get(quantity, (low, high))
    if smallest is not None:
        low = smallest
    low = max(SMALLEST, low)
    high = min(LARGEST, high)
    for value in values:
        is_within = value == 0 or low <= abs(value) <= high
        if math.isfinite(value) and is_within:
            continue
        least = "0" if low == SMALLEST else f"{low:g}"
        shown = f"{value:.6g}"
        if shown in (f"{low:g}", f"{high:g}"):
            # Beyond the bound by less than six digits show.
            shown = repr(float(value))
        got = f"{shown} {unit}".strip()
        expected = f"{least} ... {high:g} {unit}".strip()
        advice = "" if _beyond.get() else "--beyond-bounds admits it, if it is meant"
        if quantity == "timestep" and value > high:
            advice = f"For milliseconds write '{value:.6g} ms'"
        raise QuantityError(slot, got, expected, advice)


def require(
    slot: str,
    value: object,
    good: bool,
    expected: str,
    advice: str = "",
    *,
    error: type[UserError] = UserError,
) -> None:
    """Raise `error` in the name of `slot` unless `good`; the message has value, what is expected,
    advice.
    """
    if not good:
        shown = f"{value:.6g}" if isinstance(value, float) else f"{value!r}"
        raise error(slot, shown, expected, advice)


def positive(slot: str, value: float, unit: str) -> None:
    """Raise UserError unless SMALLEST <= value <= LARGEST."""
    expected = f"a value above 0 {unit}".strip() + f", {SMALLEST:g} ... {LARGEST:g}"
    require(slot, value, SMALLEST <= value <= LARGEST, expected)


def within(slot: str, values: Floats | float, low: float, high: float, meaning: str) -> Floats:
    """The values as an array of floats; raises UserError unless low <= every value <= high.

    slot: what they are called.
    meaning: what is expected, in words. NaN is outside.
    """
    # The command line takes bounds from here for its help, which needs no arrays.
    import numpy as np

    array = np.asarray(values, dtype=float)
    bad = array[~((array >= low) & (array <= high))]
    if bad.size:
        require(slot, float(bad.flat[0]), False, meaning)
    return array
