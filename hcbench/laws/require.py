"""Refuse numbers that a formula has no meaning for, in one line that names the slot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hcbench.system.errors import UserError
from hcbench.terms.bounds import LARGEST, SMALLEST

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats


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

    slot: what they are called. meaning: what is expected, in words. NaN is outside.
    """
    array = np.asarray(values, dtype=float)
    bad = array[~((array >= low) & (array <= high))]
    if bad.size:
        require(slot, float(bad.flat[0]), False, meaning)
    return array
