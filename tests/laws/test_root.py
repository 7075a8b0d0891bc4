"""Brent's method, of the book, beside SciPy's."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq

from hcbench.laws.solvers import root

FUNCTIONS: dict[str, Callable[[float], float]] = {
    "saturates": lambda x: math.tanh(3 * x) - 0.7,
    "three roots": lambda x: x**3 - 2 * x - 0.1,
    "exponential": lambda x: math.expm1(2 * x) - 40.0,
    "flat at its root": lambda x: math.atan(x - 0.3) ** 5,
    "jumps": lambda x: math.floor(7 * x) / 7 - 0.123,
}


@pytest.mark.parametrize("name", FUNCTIONS)
@pytest.mark.parametrize(
    ("absolute", "relative"), [(2e-12, 2.0**-50), (1e-300, 1e-15), (1e-3, 1e-9)]
)
def test_bits_are_those_of_scipy(name: str, absolute: float, relative: float) -> None:
    function = FUNCTIONS[name]
    ends = np.random.default_rng(1).uniform(0.0, 5.0, (50, 2)) * [-1.0, 1.0]
    for low, high in ends.tolist():
        if function(low) * function(high) < 0:
            found = brentq(function, low, high, xtol=absolute, rtol=relative, maxiter=1000)
            assert root(function, low, high, absolute, relative) == found


def test_an_end_may_be_the_root() -> None:
    assert root(lambda x: x, 0.0, 1.0, 1e-12) == 0.0
    assert root(lambda x: x - 1.0, 0.0, 1.0, 1e-12) == 1.0
