"""Brent's root in a bracket and minimum between bounds, of the book, beside SciPy's."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from hcbench.laws.solvers import minimum, root

ROOTS: dict[str, Callable[[float], float]] = {
    "saturates": lambda x: math.tanh(3 * x) - 0.7,
    "three roots": lambda x: x**3 - 2 * x - 0.1,
    "exponential": lambda x: math.expm1(2 * x) - 40.0,
    "flat at its root": lambda x: math.atan(x - 0.3) ** 5,
    "jumps": lambda x: math.floor(7 * x) / 7 - 0.123,
}


@pytest.mark.parametrize("name", ROOTS)
@pytest.mark.parametrize(
    ("absolute", "relative"), [(2e-12, 2.0**-50), (1e-300, 1e-15), (1e-3, 1e-9)]
)
def test_a_root_has_the_bits_of_scipy(name: str, absolute: float, relative: float) -> None:
    function = ROOTS[name]
    ends = np.random.default_rng(1).uniform(0.0, 5.0, (50, 2)) * [-1.0, 1.0]
    for low, high in ends.tolist():
        if function(low) * function(high) < 0:
            found = brentq(function, low, high, xtol=absolute, rtol=relative, maxiter=1000)
            assert root(function, low, high, absolute, relative) == found


def test_an_end_may_be_the_root() -> None:
    assert root(lambda x: x, 0.0, 1.0, 1e-12) == 0.0
    assert root(lambda x: x - 1.0, 0.0, 1.0, 1e-12) == 1.0


MINIMA: dict[str, Callable[[float], float]] = {
    "a parabola": lambda x: (x - 0.3) ** 2,
    "a corner": lambda x: abs(x - 0.3),
    "least at an end": math.exp,
    "flat": lambda x: (x - 0.3) ** 8,
    "steps": lambda x: math.floor(7 * abs(x - 0.3)) / 7,
    "many minima": lambda x: math.cos(9 * x) + 0.1 * x * x,
    "constant": lambda x: 1.0,
}


@pytest.mark.parametrize("name", MINIMA)
@pytest.mark.parametrize("absolute", [1e-5, 1e-12, 0.1])
def test_a_minimum_has_the_bits_of_scipy(name: str, absolute: float) -> None:
    function = MINIMA[name]
    ends = np.sort(np.random.default_rng(1).uniform(-5.0, 5.0, (40, 2)), axis=1)
    for low, high in ends.tolist():
        found = minimize_scalar(
            function, bounds=(low, high), method="bounded", options={"xatol": absolute}
        )
        assert minimum(function, low, high, absolute) == (found.x, found.fun)


def test_nan_ends_the_search_after_its_most_values() -> None:
    values = []

    def unknown(x: float) -> float:
        values.append(x)
        return math.nan

    assert math.isnan(minimum(unknown, 0.0, 1.0)[1])
    assert len(values) <= 500
